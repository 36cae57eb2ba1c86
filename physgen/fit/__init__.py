"""From filmed motion back to physics: tracks, estimates with intervals, and a report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.fit import run as run

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["run"])
