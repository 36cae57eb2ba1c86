"""World -> Trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.simulate import engine as engine
    from physgen.simulate import trajectory as trajectory
    from physgen.simulate import uncertain_values as uncertain_values
    from physgen.simulate import uncertainty as uncertainty

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["engine", "trajectory", "uncertain_values", "uncertainty"]
)
