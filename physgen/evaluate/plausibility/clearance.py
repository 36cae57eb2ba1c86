"""Distances between objects in every frame: a lower bound (do they touch?) and an upper bound (do they overlap?)."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.plausibility.tracks import Array, Outline, Tracks

PART = 0.35
"""px between segments, at most, into which a wall is cut."""


class Clearance:
    """Of all pairs, reckoned as they are asked for. Negative where they overlap, NaN where one is not seen."""

    def __init__(self, tracks: Tracks) -> None:
        self._tracks = tracks
        self._pairs: dict[tuple[int, int], tuple[Array, Array]] = {}
        self._shapes: dict[int, list[Array]] = {}
        self._walls: dict[int, Array] = {}

    def least(self, one: int, other: int) -> Array:
        """(T,) px: they are no nearer than this. Negative in all frames where one is a bare point: who knows."""
        return self._pair(one, other)[0]

    def most(self, one: int, other: int) -> Array:
        """(T,) px: they are no farther apart; infinite where nothing is known of how far they reach."""
        return self._pair(one, other)[1]

    def to_walls(self, one: int) -> Array:
        """(T,) px to the nearest known wall, no nearer than this; infinite where no wall is known."""
        if one not in self._walls:
            self._walls[one] = self._wall(one)
        return self._walls[one]

    def _pair(self, one: int, other: int) -> tuple[Array, Array]:
        key = (min(one, other), max(one, other))
        if key not in self._pairs:
            self._pairs[key] = self._between(*key)
        return self._pairs[key]

    def _between(self, one: int, other: int) -> tuple[Array, Array]:
        a, b = self._tracks.forms[one], self._tracks.forms[other]
        away = self._tracks.places[:, one] - self._tracks.places[:, other]
        far = np.hypot(away[:, 0], away[:, 1])
        least = far - a.reach - b.reach
        most = far - a.core - b.core if a.core > 0 and b.core > 0 else np.full(len(far), np.inf)
        if not (self._exact(one) and self._exact(other)):
            return least, most
        if a.round and b.round:
            return least, least
        close = np.flatnonzero(least < 0.5 * (a.reach + b.reach))
        exact = least.copy()
        if len(close):
            exact[close] = self._parted(one, other, close)
        return exact, exact

    def _exact(self, k: int) -> bool:
        form = self._tracks.forms[k]
        return form.round or bool(form.pieces)

    def _placed(self, k: int) -> list[Array]:
        """Pieces (T, K, 2) in the picture."""
        if k not in self._shapes:
            angle, place = np.nan_to_num(self._tracks.angles[:, k]), self._tracks.places[:, k]
            c, s = np.cos(angle), np.sin(angle)
            turn = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=1)
            self._shapes[k] = [
                np.einsum("tij,kj->tki", turn, piece) + place[:, None]
                for piece in self._tracks.forms[k].pieces
            ]
        return self._shapes[k]

    def _parted(self, one: int, other: int, frames: NDArray[np.intp]) -> Array:
        a, b = self._tracks.forms[one], self._tracks.forms[other]
        least = np.full(len(frames), np.inf)
        if a.round or b.round:
            ball, box = (one, other) if a.round else (other, one)
            center = self._tracks.places[frames, ball]
            for piece in self._placed(box):
                least = np.minimum(least, _from_disc(center, self._tracks.forms[ball], piece[frames]))
            return least
        for mine in self._placed(one):
            for others in self._placed(other):
                least = np.minimum(least, _separation(mine[frames], others[frames]))
        return least

    def _wall(self, k: int) -> Array:
        tracks, form = self._tracks, self._tracks.forms[k]
        least = np.full(len(tracks.times), np.inf)
        corners = self._placed(k) if form.pieces else []
        for a, b in self._segments:
            if corners:
                along = (b - a) / np.hypot(*(b - a))
                side = np.array([-along[1], along[0]])
                points = np.concatenate(corners, axis=1) - a
                across, down = points @ side, points @ along
                apart = np.where(across.min(axis=1) > 0, across.min(axis=1), -across.max(axis=1))
                beyond = np.maximum(-down.max(axis=1), down.min(axis=1) - np.hypot(*(b - a)))
                least = np.fmin(least, np.maximum(apart, beyond))
            else:
                least = np.fmin(least, _to_segment(tracks.places[:, k], a, b) - form.reach)
        return least

    @cached_property
    def _segments(self) -> list[tuple[Array, Array]]:
        found = []
        for chain in self._tracks.given.walls:
            for a, b in pairwise(chain):
                if np.hypot(*(b - a)) > PART:
                    found.append((a, b))
        return found


def _to_segment(points: Array, a: Array, b: Array) -> Array:
    along = b - a
    part = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
    off = points - a - part[:, None] * along
    return np.hypot(off[:, 0], off[:, 1])


def _from_disc(center: Array, form: Outline, piece: Array) -> Array:
    """(T,): a disc and a convex piece (T, K, 2); exact."""
    following = np.roll(piece, -1, axis=1)
    along = following - piece
    off = center[:, None] - piece
    length = np.maximum((along**2).sum(-1), 1e-12)
    part = np.clip((off * along).sum(-1) / length, 0.0, 1.0)
    to = off - part[..., None] * along
    near = np.hypot(to[..., 0], to[..., 1]).min(axis=1)
    turns = along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0]
    inside = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
    return np.asarray(np.where(inside, -near, near) - form.core)


def _separation(a: Array, b: Array) -> Array:
    """(T,): of convex pieces (T, K, 2), the widest gap along any side's normal; minus the depth where they overlap."""
    widest = np.full(len(a), -np.inf)
    for mine in (a, b):
        along = np.roll(mine, -1, axis=1) - mine
        normal = np.stack([along[..., 1], -along[..., 0]], axis=-1)
        size = np.hypot(normal[..., 0], normal[..., 1])
        normal = normal / np.maximum(size, 1e-12)[..., None]
        on_a, on_b = (np.einsum("tmj,tkj->tmk", normal, part) for part in (a, b))
        gap = np.maximum(on_b.min(-1) - on_a.max(-1), on_a.min(-1) - on_b.max(-1))
        widest = np.maximum(widest, np.where(size > 1e-9, gap, -np.inf).max(axis=1))
    return widest
