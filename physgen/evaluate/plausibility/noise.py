"""Tracks -> how much they shake, px: from high differences, of which what falls, slides or swings has next to
none.
"""

from __future__ import annotations

from math import comb

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Tracks, runs

ORDERS = (3, 5)
"""Third differences see few blows; fifth ones see no swinging either."""
CLEARLY = 0.6
"""The fifth are taken where they say so much less."""
TO_SIGMA = 1.4826
"""Median of |x| -> standard deviation, of a normal distribution."""
FEWEST = 5


def noise(tracks: Tracks) -> Array:
    """(N,) px, standard deviation along each axis, at least `tracks.floor`.

    The median takes no notice of bounces, as long as they are few. What rests tells nothing: centroids of pixels
    shake only as they move. What nothing can be told of shakes as the others do.
    """
    own = np.array([_of(tracks, k) for k in range(len(tracks.names))])
    known = own[np.isfinite(own)]
    typical = float(np.median(known)) if len(known) else tracks.floor
    own = np.where(np.isfinite(own), own, typical)
    return np.asarray(np.maximum(np.clip(own, typical / 2, None), tracks.floor))


def _of(tracks: Tracks, thing: int) -> float:
    """px; NaN where nothing can be told."""
    found = []
    for order in ORDERS:
        parts = []
        for first, last in runs(tracks.seen[:, thing]):
            path = tracks.places[first:last, thing]
            if len(path) > order:
                moved = np.hypot(*(path[order:] - path[:-order]).T) > 2 * tracks.floor
                parts.append(np.abs(np.diff(path, order, axis=0))[moved])
        values = np.concatenate(parts) if parts else np.empty((0, 2))
        spread = np.sqrt(sum(comb(order, k) ** 2 for k in range(order + 1)))
        found.append(TO_SIGMA * float(np.median(values)) / spread if len(values) >= FEWEST else np.nan)
    third, fifth = found
    return fifth if fifth < CLEARLY * third else third
