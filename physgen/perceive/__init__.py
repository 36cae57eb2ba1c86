"""Perception: a photo becomes percepts and an editable scene file; each role has swappable backends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.perceive import perception_run as perception_run

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["perception_run"])
