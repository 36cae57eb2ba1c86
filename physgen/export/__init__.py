"""Write the ground truth of frames and trajectories in the formats of other tools, one
file per format.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from physgen.export import formats as formats
    from physgen.export import video as video
    from physgen.export import video_formats as video_formats

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["formats", "video", "video_formats"]
)
