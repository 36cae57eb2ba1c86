"""One file a backend; rows in `physgen.backends` name them. The only place in perceive for model libraries."""

import os

os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")  # it tells of torchvision, which nobody here needs
