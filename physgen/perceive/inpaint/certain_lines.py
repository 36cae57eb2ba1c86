"""Straight lines that are visible on both sides of a hole.

A line that is visible on both sides of a hole, straight and in the same direction, is
certain. If one end is round or rough, such as the rim of an old bench, the surfaces on
both sides must agree closely.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.border_ends import (
    BorderEnd,
    KnownSurroundings,
    border_ends,
)
from physgen.perceive.inpaint.edge_continuation import colour_differences, line_points
from physgen.perceive.inpaint.ellipse_arcs import follow_edge
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import Mask

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class LineLimits:
    """Limits of certain lines; sizes are px of the reduced photo.

    Chosen by eye on five photos of tables; `inside` on holes in half of the photos of
    the benchmark of fills.
    """

    # Levels between both sides of the weaker end.
    contrast: float = 40.0
    # Least visible length at each end ...
    visible: float = 24.0
    # ... and the largest distance of that part from a straight line.
    largest_bend: float = 1.5
    # Visible length that determines the direction.
    direction_length: float = 48.0
    # rad: largest angle between the chord of both ends and each visible part.
    turn: float = 0.12
    # Largest difference of both ends over their mean contrast: on the more similar side
    # and on the other.
    differ: tuple[float, float] = (0.35, 0.6)
    # The same limits for a straight end and a rough one, and the least contrast and the
    # largest turn, rad, of the rough end.
    rough_differ: tuple[float, float] = (0.15, 0.35)
    rough_contrast: float = 80.0
    rough_turn: float = 0.25
    # Least length of a line in a hole.
    shortest: float = 12.0
    # Least share of the line in the hole: a line beside the hole needs no fill.
    inside: float = 0.5


LINES = LineLimits()


@dataclass(frozen=True, eq=False)
class CertainLine:
    """A straight line through a hole, px of the photo."""

    # x, y of both ends at the border of the hole.
    start: F64
    end: F64
    # Unit vectors (x, y) of the visible line into the hole at `start`, out of the hole
    # at `end`.
    first: F64
    last: F64
    # Whether the visible line before `start` or after `end` is not straight.
    rough_ends: tuple[bool, bool] = (False, False)

    @property
    def has_rough_end(self) -> bool:
        """Return whether one end is not straight."""
        return any(self.rough_ends)

    def scale_steps(self, steps: F64) -> CertainLine:
        """Return the line in a photo with `steps` (x, y) px per px."""
        first, last = self.first * steps, self.last * steps
        return CertainLine(
            (self.start + 0.5) * steps - 0.5,
            (self.end + 0.5) * steps - 0.5,
            first / np.hypot(*first),
            last / np.hypot(*last),
            self.rough_ends,
        )


def certain_lines(picture: F32, hole: Mask) -> list[CertainLine]:
    """Return straight lines that are visible on both sides of `hole` (H, W)."""
    surroundings = KnownSurroundings.measure(picture, dilate(hole, 1))
    count, ids = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    lines = []
    for number in range(1, count):
        piece = ids == number
        ends = [
            end
            for end in border_ends(surroundings, piece)
            if end.contrast > LINES.contrast
        ]
        lines += [
            line
            for line in _certain_pairs(ends, surroundings)
            if _share_inside(line, piece) >= LINES.inside
        ]
    return lines


def _share_inside(line: CertainLine, piece: Mask) -> float:
    """Return the share of a line in a `piece` (H, W) of the hole."""
    x, y = np.round(line_points(line.start, line.end)).astype(int).T
    return float(piece[y, x].mean())


def _certain_pairs(
    ends: Sequence[BorderEnd], known: KnownSurroundings
) -> Iterator[CertainLine]:
    """Yield the lines between pairs of ends, straightest first; no two lines cross."""
    chords: list[tuple[int, int]] = []
    # A rough end has no angle of its own: its pairs come after those of straight ends.
    pairs = sorted(
        _straight_pairs(ends, known),
        key=lambda pair: (pair[3].has_rough_end, *pair[:3]),
    )
    for _, i, j, line in pairs:
        has_line = any({i, j} & {p, q} for p, q in chords)
        if has_line or any((p < i < q) != (p < j < q) for p, q in chords):
            continue
        chords.append((min(i, j), max(i, j)))
        yield line


def _straight_pairs(
    ends: Sequence[BorderEnd], known: KnownSurroundings
) -> Iterator[tuple[float, int, int, CertainLine]]:
    """Yield the turn of each nearly straight line, rad, its ends' numbers and the
    line.
    """
    visible_ends = [_VisibleEnd.measure(end, known) for end in ends]
    for i, a in enumerate(visible_ends):
        for j, b in enumerate(visible_ends[:i]):
            chord = b.end.place - a.end.place
            if float(np.hypot(*chord)) < LINES.shortest:
                continue
            line = _straight_line(a, b)
            if line is not None:
                turn = max(_angle(chord, line.first), _angle(chord, line.last))
                yield turn, i, j, line


@dataclass(frozen=True, eq=False)
class _VisibleEnd:
    """An end and the visible line that leads to it."""

    end: BorderEnd
    is_visible: bool
    """Whether the visible line is long enough."""
    direction: F64 | None
    """Unit vector (x, y) into the hole; None of a line that is not straight."""

    @staticmethod
    def measure(end: BorderEnd, known: KnownSurroundings) -> _VisibleEnd:
        """Follow the visible line from an end."""
        points = follow_edge(
            known.picture, known.blocked_mask, end.place, -end.direction
        )
        lengths = np.hypot(*(points - points[0]).T)
        points = points[lengths <= LINES.direction_length]
        if lengths.max() < LINES.visible:
            return _VisibleEnd(end, is_visible=False, direction=None)
        center = points.mean(axis=0)
        _, _, axes = np.linalg.svd(points - center)
        direction: F64 = axes[0]
        distances = np.abs((points - center) @ axes[1])
        if distances.max() > LINES.largest_bend:
            return _VisibleEnd(end, is_visible=True, direction=None)
        if direction @ end.direction <= 0:
            direction = -direction
        return _VisibleEnd(end, is_visible=True, direction=direction)


def _straight_line(a: _VisibleEnd, b: _VisibleEnd) -> CertainLine | None:
    """Return the straight line between two ends; None if the ends are not of one line."""
    if not (a.is_visible and b.is_visible):
        return None
    start, end = a.end.place, b.end.place
    chord = end - start
    if a.direction is not None and b.direction is not None:
        turn = max(_angle(chord, a.direction), _angle(chord, -b.direction))
        if turn <= LINES.turn and _similar(a.end, b.end, LINES.differ):
            return CertainLine(start, end, a.direction, -b.direction)
        return None
    # One straight end determines the line if the colours on both sides agree closely.
    unit_chord = chord / np.hypot(*chord)
    if a.direction is not None and _is_continuation(a.direction, b.end, a.end, chord):
        return CertainLine(start, end, a.direction, unit_chord, (False, True))
    if b.direction is not None and _is_continuation(b.direction, a.end, b.end, -chord):
        return CertainLine(start, end, unit_chord, -b.direction, (True, False))
    return None


def _is_continuation(
    direction: F64, rough_end: BorderEnd, straight_end: BorderEnd, chord: F64
) -> bool:
    """Return whether a rough end is the other end of a straight one.

    `direction` and `chord` point from the straight end to the rough one.
    """
    return (
        rough_end.contrast > LINES.rough_contrast
        and _angle(chord, direction) <= LINES.turn
        and _angle(-chord, rough_end.direction) <= LINES.rough_turn
        and _similar(straight_end, rough_end, LINES.rough_differ)
    )


def _similar(a: BorderEnd, b: BorderEnd, limits: tuple[float, float]) -> bool:
    """Return whether two ends show the same surfaces on both sides.

    `limits`: largest differences on the more similar side and on the other, over the
    mean contrast.
    """
    contrast = (a.contrast + b.contrast) / 2
    least_difference, largest_difference = colour_differences(a, b)
    if least_difference > limits[0] * contrast:
        return False
    return largest_difference <= limits[1] * contrast


def _angle(a: F64, b: F64) -> float:
    """Return the angle between two vectors, rad."""
    return float(abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))
