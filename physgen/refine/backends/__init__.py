"""Video diffusion models, one file each; what each takes and gives is `refine.denoiser.Denoiser`.

`sampling` loads pipelines and takes steps. A model's own file knows its layout of latents, its
text, its schedule and its memory.
"""

from __future__ import annotations

import os

os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")  # no warnings about torchvision, which is not needed
