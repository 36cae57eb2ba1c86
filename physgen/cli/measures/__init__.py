"""`physgen evaluate`: one module a measure, with its flags and its handler."""
