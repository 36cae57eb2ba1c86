"""Frames of a clip -> pictures of the flow between them: hue is direction, saturation is speed.

As Baker et al. colour it, A Database and Evaluation Methodology for Optical Flow, IJCV 92, 2011. How many px are full
colour decides what a distance between such pictures means. `REFERENCE`: as many as the reference's fastest pair of
frames moves, for all clips, so that twice the speed looks otherwise and rest is white. `FRAME`: as many as that very
pair moves at most, as RAFT's own pictures have it and so the paper's, by all that is known: speed is then not seen,
and where nothing moves, noise is in full colour.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from itertools import pairwise

import cv2
import numpy as np

from physgen.evaluate.fid.roles import F32, U8, Flow
from physgen.export.flow import coloured

PEAK = 99.9
"""% of pixels that are no faster than a pair's speed: a few wild ones do not count."""
LEAST = 1.0
"""px that are full colour, at least."""
TINY = 1e-5
"""px: what RAFT's pictures add before they divide."""


class Normalise(Enum):
    """What full colour is, where no number of px is said."""

    REFERENCE = "reference"
    FRAME = "frame"


def flows(frames: Iterable[U8], flow: Flow) -> Iterator[F32]:
    """(H, W, 2) px from each frame to the next."""
    return (flow(one, other) for one, other in pairwise(frames))


def peak(moved: F32) -> float:
    """px: the speed of a pair of frames."""
    return float(np.percentile(cv2.magnitude(moved[..., 0], moved[..., 1]), PEAK))


def pictured(moved: F32, full: float | None) -> U8:
    """(H, W, 3) sRGB of a flow (H, W, 2); `full` px are full colour, what is faster too. None: this flow's fastest."""
    speed = cv2.magnitude(moved[..., 0], moved[..., 1])
    if full is None:
        full = float(speed.max()) + TINY
    held = np.minimum(1.0, full / np.maximum(speed, TINY)).astype(np.float32)
    bgr = coloured(moved * held[..., None], full)
    return np.ascontiguousarray(bgr[..., ::-1])
