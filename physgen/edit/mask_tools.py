"""Pixels of what the user draws (strokes, polygons, lines) or points at (boxes, points)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from physgen.edit.errors import impossible
from physgen.perceive.roles import PromptedMask, Rgb, Segments
from physgen.perceive.segment.prompts import (
    PhotoProposals,
    photo_proposals,
    prompted_answers,
    segment_box,
    segment_point,
    segmenter,
)
from physgen.pipeline.stages import Recent
from physgen.problems import InputError
from physgen.registry import Backends

Mask = NDArray[np.bool_]
Point = tuple[float, float]

MAX_STROKE_WORK = 10**9
"""Distances of pixels to segments that are computed for one stroke: about half a minute."""


class PromptSegmenter:
    """Finds the objects in boxes and at points; segments and proposals of a photo are kept for the next point."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._segmented: Recent[Segments] = Recent(1)
        self._proposed: Recent[PhotoProposals] = Recent(1)

    def box(self, rgb: Rgb, key: str, box: Sequence[float]) -> PromptedMask:
        """The object in a box (left, top, width, height). Raises EditError."""
        with self._lock, _edit_errors():
            segment = segmenter(Backends())
            x, y, width, height = box
            answers = prompted_answers(rgb, [(x, y, width, height)], [], segment)
            return answers.get(0) or segment_box(rgb, (x, y, width, height))

    def point(self, rgb: Rgb, key: str, point: Point) -> PromptedMask:
        """The object at a point. Raises EditError; `key` identifies the photo."""
        with self._lock, _edit_errors():
            segment = segmenter(Backends())
            answers = prompted_answers(rgb, [], [point], segment)
            if 0 in answers:
                return answers[0]
            found = self._segmented.of(key, partial(segment, rgb))
            return segment_point(
                rgb, point, found, partial(self._proposed.of, key, partial(photo_proposals, rgb))
            )


@contextmanager
def _edit_errors() -> Iterator[None]:
    """Turn errors of perception into errors of the editor."""
    try:
        yield
    except InputError as error:
        problem = error.problems[0]
        fix = "draw a box around it" if "--box" in problem.fix else problem.fix
        raise impossible(f"what is marked {problem.expected}", fix) from error


def stroke(points: Sequence[Point], radius: float, size: tuple[int, int]) -> Mask:
    """(H, W): pixels whose centre is within a radius of a line; `size` is width, height. Raises EditError for too many.

    >>> int(stroke([(2, 2)], 1.0, (5, 5)).sum())
    5
    """
    width, height = size
    near = np.zeros((height, width), np.bool_)
    line = np.array(points, np.float64)
    work = 0
    for a, b in zip(line[: max(len(line) - 1, 1)], line[1:] if len(line) > 1 else line, strict=True):
        x0, y0 = np.floor(np.minimum(a, b) - radius).astype(int)
        x1, y1 = np.ceil(np.maximum(a, b) + radius).astype(int) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if x1 <= x0 or y1 <= y0 or near[y0:y1, x0:x1].all():
            continue
        work += int((x1 - x0) * (y1 - y0))
        if work > MAX_STROKE_WORK:
            raise impossible("the stroke is too long for its width", "paint it in parts")
        y, x = np.mgrid[y0:y1, x0:x1]
        along, (dx, dy) = b - a, (x - a[0], y - a[1])
        length = float(along @ along)
        part = np.clip((dx * along[0] + dy * along[1]) / length, 0, 1) if length > 0 else np.zeros(x.shape)
        near[y0:y1, x0:x1] |= (dx - part * along[0]) ** 2 + (dy - part * along[1]) ** 2 <= radius**2 + 1e-9
    return near


def beyond(line: Sequence[Point], size: tuple[int, int]) -> Mask:
    """(H, W): pixels to the right of a line from its first to its second point, extended at both ends."""
    (x0, y0), (x1, y1) = line
    y, x = np.mgrid[: size[1], : size[0]]
    return np.asarray((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0)
