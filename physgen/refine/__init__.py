"""Retouch frames by a video diffusion model: soft shadows, reflections, unchanged
objects.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.refine import denoiser as denoiser
    from physgen.refine import fusion as fusion

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["denoiser", "fusion"])
