"""One file a backend; rows in `physgen.registry` name them. The only place in perceive for model libraries."""

from __future__ import annotations

import os

os.environ.setdefault(
    "TRANSFORMERS_VERBOSITY", "error"
)  # it warns of torchvision, which is not needed
