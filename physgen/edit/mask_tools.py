"""Pixels of what the user draws (strokes, polygons, lines) or points at (boxes, points)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.shapes import fill_polygon
from physgen.edit.errors import EditError, impossible
from physgen.perceive.roles import SMALLEST_OBJECT, PromptedMask, Rgb, Segments
from physgen.perceive.segment.prompts import (
    PhotoProposals,
    photo_proposals,
    prompted_answers,
    segment_box,
    segment_point,
    segmenter,
)
from physgen.pipeline.warm import Recent
from physgen.problems import InputError
from physgen.registry import Backends

Mask = NDArray[np.bool_]
Point = tuple[float, float]

MOST_POINTS = 20_000
"""Of a stroke or a polygon."""
MOST_LOOKED = 10**9
"""Pixels that are looked at for one stroke: about half a minute."""
FAR = 1e6
"""px beyond which no place is meant."""
WIDEST = 2000.0
"""px: radius of a brush."""


class Finder:
    """Finds what boxes and points mean; what it worked out of a photo serves the next point, too."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._segmented: Recent[Segments] = Recent(1)
        self._proposed: Recent[PhotoProposals] = Recent(1)

    def box(self, rgb: Rgb, key: str, box: Sequence[float]) -> PromptedMask:
        """The object in a box (left, top, width, height). Raises EditError."""
        with self._lock, _told():
            segment = segmenter(Backends())
            x, y, width, height = box
            said = prompted_answers(rgb, [(x, y, width, height)], [], segment)
            return said.get(0) or segment_box(rgb, (x, y, width, height))

    def point(self, rgb: Rgb, key: str, point: Point) -> PromptedMask:
        """The object at a point. Raises EditError; `key` tells photos apart."""
        with self._lock, _told():
            segment = segmenter(Backends())
            said = prompted_answers(rgb, [], [point], segment)
            if 0 in said:
                return said[0]
            found = self._segmented.of(key, partial(segment, rgb))
            return segment_point(
                rgb, point, found, partial(self._proposed.of, key, partial(photo_proposals, rgb))
            )


@contextmanager
def _told() -> Iterator[None]:
    """What perception refuses becomes what the editor refuses."""
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
    looked = 0
    for a, b in zip(line[: max(len(line) - 1, 1)], line[1:] if len(line) > 1 else line, strict=True):
        x0, y0 = np.floor(np.minimum(a, b) - radius).astype(int)
        x1, y1 = np.ceil(np.maximum(a, b) + radius).astype(int) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if x1 <= x0 or y1 <= y0 or near[y0:y1, x0:x1].all():
            continue
        looked += int((x1 - x0) * (y1 - y0))
        if looked > MOST_LOOKED:
            raise impossible("the stroke is too long for its width", "paint it in parts")
        y, x = np.mgrid[y0:y1, x0:x1]
        along, (dx, dy) = b - a, (x - a[0], y - a[1])
        length = float(along @ along)
        part = np.clip((dx * along[0] + dy * along[1]) / length, 0, 1) if length > 0 else np.zeros(x.shape)
        near[y0:y1, x0:x1] |= (dx - part * along[0]) ** 2 + (dy - part * along[1]) ** 2 <= radius**2 + 1e-9
    return near


def inside(points: Sequence[Point], size: tuple[int, int]) -> Mask:
    """(H, W): pixels whose centre lies in a polygon, by the even-odd rule."""
    return fill_polygon(tuple(points), size)


def beyond(line: Sequence[Point], size: tuple[int, int]) -> Mask:
    """(H, W): pixels to the right of a line as one walks along it; the line goes on at both ends."""
    (x0, y0), (x1, y1) = line
    y, x = np.mgrid[: size[1], : size[0]]
    return np.asarray((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0)


# What a request holds


def points_of(op: Mapping[str, Any], key: str, least: int, most: int = MOST_POINTS) -> list[Point]:
    """A list of points of an operation. Raises EditError."""
    value = op.get(key)
    if not isinstance(value, list) or not least <= len(value) <= most:
        what = f"{least} points" if least == most else f"a list of {least} points or more"
        raise impossible(f"{key} is not {what}", f"send {key}: [[x, y], ...] in px of the photo")
    return [(numbers(point, 2, key)[0], numbers(point, 2, key)[1]) for point in value]


def numbers(value: Any, count: int, key: str) -> list[float]:
    """So many finite numbers. Raises EditError."""
    if not isinstance(value, list) or len(value) != count or not all(map(_number, value)):
        raise impossible(f"{key} is not {count} numbers", f"send {key} in px of the photo")
    return [float(one) for one in value]


def radius_of(op: Mapping[str, Any]) -> float:
    """Of a brush, px. Raises EditError."""
    value = op.get("radius")
    if not _number(value) or not 0 < float(value) <= WIDEST:  # type: ignore[arg-type]
        raise impossible("radius is not a length", f"send radius: px, at most {WIDEST:g}")
    return float(value)  # type: ignore[arg-type]


def large_enough(mask: Mask, what: str) -> Mask:
    """The mask, where it is more than a speck. Raises EditError."""
    if np.count_nonzero(mask) < SMALLEST_OBJECT:
        raise too_small(what)
    return mask


def too_small(what: str) -> EditError:
    """Nothing, or next to nothing, is left."""
    return impossible(
        f"{what} would have fewer than {SMALLEST_OBJECT} px", "mark more of it, or delete the object"
    )


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FAR
