"""Video diffusion models, one file each, with its latents, text, schedule and memory; `sampling` loads and runs it."""

from __future__ import annotations

import os

os.environ.setdefault(
    "TRANSFORMERS_VERBOSITY", "error"
)  # no warnings about torchvision, which is not needed
