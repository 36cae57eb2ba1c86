"""One file a backend; rows in `physgen.backends` name them. The only place in perceive for model libraries."""
