"""Compile a scene and its masks into a World for the engine, and warn of doubtful
values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.compile import warnings as warnings

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["warnings"])
