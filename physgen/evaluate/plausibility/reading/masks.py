"""Maps of ids, one a frame -> tracks: centroids of what is seen, and the discs that surely lie in them and about them.

What another thing or the border hides has no centroid that means anything: it is not seen then.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.plausibility.tracks import Array, Form

Ids = NDArray[np.integer]
WHOLE = 0.93
"""Of a thing's usual area: it is hidden in part where less is seen."""
SHAKE = 0.08
"""px: what centroids of some hundred pixels shake, at least."""
LEAST = 12
"""px of area: smaller things have no place."""


@dataclass
class Silhouettes:
    """What is kept of the maps as they go by."""

    size: tuple[int, int] = (0, 0)
    count: int = 0
    areas: dict[int, dict[int, float]] = field(default_factory=dict)
    """id -> frame -> px."""
    places: dict[int, dict[int, tuple[float, float]]] = field(default_factory=dict)
    cut: dict[int, set[int]] = field(default_factory=dict)
    """id -> frames in which it reaches the border."""
    cores: dict[int, list[float]] = field(default_factory=dict)
    reaches: dict[int, list[float]] = field(default_factory=dict)


def gathered(maps: Iterable[Ids]) -> Silhouettes:
    """One map after the other; 0 is the background."""
    found = Silhouettes()
    for frame, ids in enumerate(maps):
        height, width = ids.shape
        found.size, found.count = (width, height), frame + 1
        for one in np.unique(ids).tolist():
            if one:
                _add(found, frame, one, ids == one)
    return found


def _add(found: Silhouettes, frame: int, one: int, mask: NDArray[np.bool_]) -> None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    y0, y1, x0, x1 = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    part = mask[y0:y1, x0:x1]
    ys, xs = np.nonzero(part)
    if len(xs) < LEAST:
        return
    center = float(xs.mean()), float(ys.mean())
    found.areas.setdefault(one, {})[frame] = float(len(xs))
    found.places.setdefault(one, {})[frame] = (x0 + center[0], y0 + center[1])
    if x0 == 0 or y0 == 0 or y1 == mask.shape[0] or x1 == mask.shape[1]:
        found.cut.setdefault(one, set()).add(frame)
        return
    padded = np.pad(part, 1).astype(np.uint8)
    inside = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    row, column = (round(c) + 1 for c in (center[1], center[0]))
    found.cores.setdefault(one, []).append(max(float(inside[row, column]) - 0.5, 0.0))
    found.reaches.setdefault(one, []).append(float(np.hypot(xs - center[0], ys - center[1]).max()) + 0.5)


def tracked(found: Silhouettes) -> tuple[list[int], Array, tuple[Form, ...], Array]:
    """Ids, places (T, N, 2) with NaN where a thing is not wholly seen, forms, and areas (N,) px²."""
    ids = sorted(found.areas)
    places = np.full((found.count, len(ids), 2), np.nan)
    forms, areas = [], []
    for k, one in enumerate(ids):
        usual = float(np.quantile(list(found.areas[one].values()), 0.8))
        for frame, area in found.areas[one].items():
            if area >= WHOLE * usual and frame not in found.cut.get(one, ()):
                places[frame, k] = found.places[one][frame]
        cores, reaches = found.cores.get(one, [0.0]), found.reaches.get(one, [0.0])
        core, reach = float(np.quantile(cores, 0.8)), float(np.quantile(reaches, 0.8))
        round_ = core > 0.85 * reach
        radius = float(np.sqrt(usual / np.pi))
        forms.append(Form(radius, radius, 0.7 * radius) if round_ else Form(core, reach, 0.6 * reach))
        areas.append(usual)
    return ids, places, tuple(forms), np.array(areas)
