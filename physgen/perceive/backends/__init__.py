"""One file per backend; the only modules of perceive with model libraries.

The registry, `physgen.registry`, names the backends.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.perceive.backends import vlm as vlm

# The library of a server is loaded when a server is asked.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["vlm"])

# it warns of torchvision, which is not needed
os.environ.setdefault("TRANSFORMERS_VERBOSITY", "error")
