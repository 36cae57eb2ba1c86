"""Plausibility of motion without ground truth: tracks, their segments of constant
acceleration, and questions about them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.evaluate.plausibility import judge as judge
    from physgen.evaluate.plausibility import tracks as tracks

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["judge", "tracks"])
