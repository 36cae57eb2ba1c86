"""World + Trajectory + Percepts -> Frames, one at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.render import camera as camera
    from physgen.render import flat_drawing as flat_drawing
    from physgen.render import frames as frames
    from physgen.render import sprites as sprites
    from physgen.render import staging as staging

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["camera", "flat_drawing", "frames", "sprites", "staging"]
)
