"""Models for measures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.evaluate.backends import inception as inception

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["inception"])
