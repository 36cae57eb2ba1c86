"""Fitted outlines + boundaries -> outlines that touch what they stand on: neither sunk into it nor a hair above.

A mask's border and a boundary that was drawn or found by eye differ by a pixel; left so, a pile settles at t = 0.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import Disc, Outline, Region, Ring, mass_properties
from physgen.scene.model import Scene, View

Array = NDArray[np.float64]

BAND = 2.0
"""px between a mask's lowest points and the line that it stands on."""
LEVEL = 0.7
"""Cosine of the angle between gravity and the normal of a line up to which things stand on it."""


def standing(scene: Scene, outlines: tuple[Outline, ...], fitted: list[bool]) -> tuple[Outline, ...]:
    """The outlines, those that were fitted brought onto the lines within reach of their lowest points."""
    gravity = np.array(scene.world.gravity, np.float64)
    strength = float(np.hypot(*gravity))
    if scene.world.view is View.TOP or strength == 0 or not any(fitted):
        return outlines
    lines = [
        line
        for boundary in scene.boundaries
        for a, b in pairwise(np.array(boundary.points, np.float64).reshape(-1, 2))
        if (line := _Line.of(a, b, gravity / strength)) is not None
    ]
    return tuple(
        _stood(outline, lines) if fit else outline for outline, fit in zip(outlines, fitted, strict=True)
    )


class _Line:
    """A segment that carries: its start, the unit vector along it, its length, and its normal upwards."""

    def __init__(self, start: Array, along: Array, length: float, up: Array) -> None:
        self.start, self.along, self.length, self.up = start, along, length, up

    @staticmethod
    def of(a: Array, b: Array, down: Array) -> _Line | None:
        length = float(np.hypot(*(b - a)))
        if length == 0:
            return None
        along = (b - a) / length
        up = np.array([-along[1], along[0]])
        up = -up if up @ down > 0 else up
        return _Line(a, along, length, up) if -(up @ down) >= LEVEL else None

    def near(self, points: Array) -> tuple[NDArray[np.bool_], Array]:
        """Which points lie along the segment, and the heights of all over its line."""
        off = points - self.start
        along = off @ self.along
        return (along >= -BAND) & (along <= self.length + BAND), off @ self.up


def _stood(outline: Outline, lines: list[_Line]) -> Outline:
    for line in lines:
        if isinstance(outline, Disc):
            along, height = line.near(outline.center[None])
            gap = float(height[0]) - outline.radius
            if along[0] and abs(gap) <= BAND:
                outline = Disc(outline.center - gap * line.up, outline.radius)
            continue
        points = np.concatenate([ring.outer for ring in outline.rings])
        along, height = line.near(points)
        below = height[along]
        above = (mass_properties(outline).center - line.start) @ line.up > BAND
        if above and len(below) and -BAND <= below.min() <= BAND:
            outline = Region(tuple(Ring(_flat(ring.outer, line), ring.holes) for ring in outline.rings))
    return outline


def _flat(points: Array, line: _Line) -> Array:
    """Points within the band brought onto the line."""
    along, height = line.near(points)
    at = along & (np.abs(height) <= BAND)
    moved = points.copy()
    moved[at] -= height[at, None] * line.up
    return moved
