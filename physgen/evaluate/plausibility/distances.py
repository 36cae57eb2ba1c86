"""Distances between the outlines of tracked bodies."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Tracks

POLYGON_SIDES = 64
"""Number of sides of the polygon for a disc beside other shapes."""
MIN_SIDE = 1e-9
"""Minimum side of a piece with a direction, px."""
SAFE_SIDE = 1e-12
"""Divisor of shorter sides, px."""


class Distances:
    """Gaps between bodies of tracks. Each is computed once."""

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self._gaps: dict[tuple[int, int], Array] = {}

    def gap(self, first: int, second: int) -> Array:
        """Return the gap between two bodies, (T,) px: negative if they overlap,
        NaN if one is not visible.
        """
        key = (min(first, second), max(first, second))
        if key not in self._gaps:
            self._gaps[key] = self._measure_gap(*key)
        return self._gaps[key]

    def _measure_gap(self, first: int, second: int) -> Array:
        tracks = self.tracks
        outline = tracks.forms[first]
        other_outline = tracks.forms[second]
        offsets = tracks.places[:, first] - tracks.places[:, second]
        # The circles around both bodies give the gap of discs, and a lower bound
        # otherwise.
        gap = np.hypot(*offsets.T) - outline.reach - other_outline.reach
        if outline.is_round and other_outline.is_round:
            return np.asarray(gap)
        # Circles around distant bodies are enough for their gap.
        close = np.flatnonzero(gap < 0.5 * (outline.reach + other_outline.reach))
        # Bodies are as near as their nearest pieces.
        separations = []
        for piece in self._shapes[first]:
            for other_piece in self._shapes[second]:
                separations.append(_separate(piece[close], other_piece[close]))
        gap[close] = np.min(separations, axis=0)
        return np.asarray(gap)

    @cached_property
    def _shapes(self) -> list[list[Array]]:
        """Return the convex pieces (T, K, 2) of each body in the picture, with a
        polygon for a disc.
        """
        angles = np.linspace(0, 2 * np.pi, POLYGON_SIDES, endpoint=False)
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        shapes = []
        for k, outline in enumerate(self.tracks.forms):
            pieces = outline.pieces or (outline.reach * circle,)
            rotations = self._rotations(k)
            place = self.tracks.places[:, k, None]
            shape = []
            for piece in pieces:
                shape.append(np.einsum("tij,kj->tki", rotations, piece) + place)
            shapes.append(shape)
        return shapes

    def _rotations(self, body: int) -> Array:
        """Return the rotation matrices of a body, (T, 2, 2)."""
        angles: Array = np.zeros(len(self.tracks.times))
        if self.tracks.angles is not None:
            angles = self.tracks.angles[:, body]
        c = np.cos(angles)
        s = np.sin(angles)
        first_rows = np.stack([c, -s], axis=-1)
        second_rows = np.stack([s, c], axis=-1)
        return np.stack([first_rows, second_rows], axis=1)


def _separate(first: Array, second: Array) -> Array:
    """Return the widest gap of two convex pieces (T, K, 2) along the normal of any side, (T,) px.

    It is minus the depth if the pieces overlap (separating axes).
    """
    widest = np.full(len(first), -np.inf)
    for piece in (first, second):
        sides = np.roll(piece, -1, axis=1) - piece
        lengths = np.hypot(sides[..., 0], sides[..., 1])
        # One of the normals of convex pieces separates them, if any line does.
        normals = np.stack([sides[..., 1], -sides[..., 0]], axis=1)
        normals = normals / np.maximum(lengths, SAFE_SIDE)[:, None]
        # The shape is (T, K, sides).
        first_extent, second_extent = first @ normals, second @ normals
        gaps = np.maximum(
            second_extent.min(1) - first_extent.max(1),
            first_extent.min(1) - second_extent.max(1),
        )
        gaps = np.where(lengths > MIN_SIDE, gaps, -np.inf)
        widest = np.maximum(widest, gaps.max(axis=1))
    return widest
