"""Positions of the objects of a clip over its frames, what is known of them, and how noisy the positions are."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import comb

import numpy as np
from numpy.typing import NDArray

from physgen.scene.scene import View

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """How a body lies about its tracked place. px."""

    core: float
    """Radius of a disc about the place that it surely covers; 0: not known."""
    reach: float
    """Distance of its farthest point from the place; 0: a point."""
    gyration: float = 0.0
    """Radius of gyration: its moment of inertia over its mass is this squared."""
    width: float = 0.0
    """Its smallest width; 0: twice its core."""
    pieces: tuple[Array, ...] = ()
    """Convex pieces, each (K, 2) about the place, turned by its angle; none for what is round, or not known better."""

    @property
    def thin(self) -> float:
        """px: its smallest width, as far as it is known."""
        return self.width or 2 * self.core

    @property
    def round(self) -> bool:
        """Whether it looks the same however it turns."""
        return not self.pieces and self.core >= 0.9 * self.reach


@dataclass(frozen=True)
class Known:
    """What the caller says acts from outside, so that no one wonders. Indices of bodies."""

    held: frozenset[int] = frozenset()
    """On joints or springs, or moved by a script: only jumps are asked of them."""
    blown: frozenset[int] = frozenset()
    """In wind or an attractor."""
    pushed: tuple[tuple[int, float, float], ...] = ()
    """Who, from when, until when, s."""
    joined: frozenset[tuple[int, int]] = frozenset()
    """Pairs that may lie over each other."""
    walls: tuple[Array, ...] = ()
    """Chains (K, 2) px of what is fixed, where known."""
    spun: frozenset[int] = frozenset()
    """Struck so that they turn faster than they roll: they may speed up by themselves."""


@dataclass(frozen=True)
class Tracks:
    """Of N bodies in T frames."""

    name: str
    times: Array
    """(T,) s, evenly spaced."""
    names: tuple[str, ...]
    places: Array
    """(T, N, 2) px, image axes: of the centre of mass or what stands for it; NaN where it is not seen."""
    angles: Array
    """(T, N) rad, a positive one turns +x towards +y; NaN where no one knows."""
    forms: tuple[Outline, ...]
    masses: Array
    """(N,) g, or in any other unit."""
    weighed: bool
    """Whether masses are known; else they are areas, or all equal, and any ratio up to 12 times that will do."""
    view: View
    floor: float
    """px: noise is never taken to be less."""
    source: str
    """What was read, in words: `boxes of MOT`."""
    given: Known = field(default_factory=Known)
    flat: bool = True
    """Whether gravity is known to be none, as in a scene that says so."""

    @property
    def step(self) -> float:
        """s from frame to frame."""
        return float(self.times[1] - self.times[0])

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(T, N)."""
        return np.asarray(np.isfinite(self.places).all(axis=2))


def runs(seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last + 1 of each stretch of frames without a gap.

    >>> runs(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


ORDERS = (3, 5)
"""Third differences see few blows; fifth ones see no swinging either."""
CLEARLY = 0.6
"""The fifth are taken where they say so much less."""
TO_SIGMA = 1.4826
"""Median of |x| -> standard deviation, of a normal distribution."""
FEWEST = 5


def noise(tracks: Tracks) -> Array:
    """(N,) px, standard deviation along each axis, at least `tracks.floor`.

    The median takes no notice of bounces, as long as they are few. A body at rest gives nothing: centroids of pixels
    shake only as they move. Where nothing is known, the median of the others is taken.
    """
    own = np.array([_of(tracks, k) for k in range(len(tracks.names))])
    known = own[np.isfinite(own)]
    typical = float(np.median(known)) if len(known) else tracks.floor
    own = np.where(np.isfinite(own), own, typical)
    return np.asarray(np.maximum(np.clip(own, typical / 2, None), tracks.floor))


def _of(tracks: Tracks, body: int) -> float:
    """px; NaN where nothing is known."""
    found = []
    for order in ORDERS:
        parts = []
        for first, last in runs(tracks.seen[:, body]):
            path = tracks.places[first:last, body]
            if len(path) > order:
                moved = np.hypot(*(path[order:] - path[:-order]).T) > 2 * tracks.floor
                parts.append(np.abs(np.diff(path, order, axis=0))[moved])
        values = np.concatenate(parts) if parts else np.empty((0, 2))
        spread = np.sqrt(sum(comb(order, k) ** 2 for k in range(order + 1)))
        found.append(TO_SIGMA * float(np.median(values)) / spread if len(values) >= FEWEST else np.nan)
    third, fifth = found
    return fifth if fifth < CLEARLY * third else third
