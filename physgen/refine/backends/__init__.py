"""Video diffusion models, one file each; what each takes and gives is `refine.denoiser.Denoiser`.

`sampling` is what they share: weights, devices, steps, memory. A model's own file knows its layout of latents, its
text, its schedule, and what else it wants to be shown.
"""

from __future__ import annotations

import os

os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")  # no warnings about torchvision, which is not needed
