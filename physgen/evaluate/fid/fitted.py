"""A clip's frames -> those that count, all of them of one size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np

from physgen.evaluate.fid.sides import U8, Source
from physgen.problems import InputError

ALIKE = 0.02
"""By which two ratios of width to height may differ and still be one, of videos with even sides."""


class Fit(Enum):
    """How frames of any size become frames of one."""

    WHOLE = "whole"
    """The shorter side becomes `side`; all clips have to be of one shape."""
    CROP = "crop"
    """The middle square."""
    STRETCH = "stretch"
    """A square, whatever becomes of the shape."""


@dataclass(frozen=True)
class Rule:
    """One for all clips that are compared."""

    side: int = 256
    """px."""
    fit: Fit = Fit.WHOLE
    count: int | None = None
    """Frames of a clip, evenly from the first to the last; None: all."""

    def __str__(self) -> str:
        how = {
            Fit.WHOLE: f"whole, the shorter side made {self.side} px",
            Fit.CROP: f"the middle square, made {self.side} x {self.side} px",
            Fit.STRETCH: f"stretched to {self.side} x {self.side} px",
        }
        return how[self.fit]

    def frames(self, source: Source) -> Iterator[U8]:
        """(H, W, 3) sRGB. Raises InputError for a clip that cannot be read, is empty, or is shorter than `count`."""
        if self.count is None:
            empty = True
            for frame in source.frames():
                empty = False
                yield self.sized(frame)
            if empty:
                after = f" after the first {source.skip}" if source.skip else ""
                raise InputError.of(str(source.path), "", f"has no frame{after}", "leave it out")
            return
        frames = [self.sized(frame) for frame in source.frames()]
        if len(frames) < self.count:
            found = f"{len(frames)} frame{'s' * (len(frames) != 1)}"
            fix = f"give --frames {max(len(frames), 1)}, or leave the clip out"
            raise InputError.of(str(source.path), found, f"are fewer than --frames {self.count}", fix)
        for k in np.rint(np.linspace(0, len(frames) - 1, self.count)).astype(int):
            yield frames[k]

    def sized(self, frame: U8) -> U8:
        """Pixels' areas are averaged where it gets smaller, so that nothing aliases; cubic where it gets larger."""
        height, width = frame.shape[:2]
        if self.fit is Fit.CROP:
            short = min(height, width)
            top, left = (height - short) // 2, (width - short) // 2
            frame = frame[top : top + short, left : left + short]
            height = width = short
        if self.fit is Fit.WHOLE:
            scale = self.side / min(height, width)
            size = round(width * scale), round(height * scale)
        else:
            size = self.side, self.side
        if size == (width, height):
            return np.ascontiguousarray(frame)
        way = cv2.INTER_AREA if min(size) < min(height, width) else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(frame, size, interpolation=way), np.uint8)


def one_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes (height, width) have about one shape.

    >>> one_shape((360, 640), (1080, 1920)), one_shape((256, 256), (360, 640))
    (True, False)
    """
    first, second = one[1] / one[0], other[1] / other[0]
    return abs(first / second - 1) <= ALIKE
