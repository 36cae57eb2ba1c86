"""Tracks -> how much they shake, px: from third differences, of which what falls or slides has none."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.tracks import Array, Tracks, runs

SPREAD = np.sqrt(20.0)
"""Standard deviation of a third difference of independent noise of 1: (1, -3, 3, -1)."""
TO_SIGMA = 1.4826
"""Median of |x| -> standard deviation, of a normal distribution."""
FEWEST = 5


def noise(tracks: Tracks) -> Array:
    """(N,) px, standard deviation along each axis, at least `tracks.floor`.

    The median takes no notice of bounces, as long as they are few. What rests tells nothing: centroids of pixels
    shake only as they move. What nothing can be told of shakes as the others do.
    """
    own = np.full(len(tracks.names), np.nan)
    for k in range(len(own)):
        differences = []
        for first, last in runs(tracks.seen[:, k]):
            path = tracks.places[first:last, k]
            if len(path) < 4:
                continue
            moved = np.hypot(*(path[3:] - path[:-3]).T) > 2 * tracks.floor
            differences.append(np.abs(np.diff(path, 3, axis=0))[moved])
        values = np.concatenate(differences) if differences else np.empty((0, 2))
        if len(values) >= FEWEST:
            own[k] = TO_SIGMA * np.median(values) / SPREAD
    known = own[np.isfinite(own)]
    typical = float(np.median(known)) if len(known) else tracks.floor
    own = np.where(np.isfinite(own), own, typical)
    return np.maximum(np.clip(own, typical / 2, None), tracks.floor)
