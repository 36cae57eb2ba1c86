"""The formats of a clip's video and their limits, without the encoders."""

from __future__ import annotations

from enum import Enum
from errno import EDQUOT, EFBIG, ENOSPC

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import U8 as U8

I16 = NDArray[np.int16]

SOUND_RATE = 48_000
"""Samples/s of sound tracks."""


class Format(Enum):
    """Format of a clip's file."""

    MP4 = "mp4"
    GIF = "gif"
    WEBP = "webp"
    PNG = "png"

    @property
    def file(self) -> str:
        """Return the file name inside a scene's output folder."""
        return self.file_name("video")

    def file_name(self, name: str) -> str:
        """Return the name of another video beside it."""
        if self is Format.PNG:
            if name == "video":
                return "frames"
            return name
        return f"{name}.{self.value}"


MAX_RATES = {Format.GIF: 50, Format.WEBP: 90}
"""Maximum frame rates in browsers. Browsers show a frame for 100 ms if its delay is 10
ms or less. GIF counts 10 ms, so that its shortest delay is 20 ms; WebP counts 1 ms, and
90 frames/s give delays of 11 and 12 ms.
"""

NO_ROOM = (ENOSPC, EDQUOT, EFBIG)
"""Errors of a full disk."""
