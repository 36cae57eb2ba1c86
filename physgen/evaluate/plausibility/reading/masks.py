"""Maps of ids, one a frame -> tracks: centroids of what is seen, and the discs that surely lie in them and about
them.

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
Pixels = NDArray[np.intp]
WHOLE = 0.965
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
        ys, xs = np.nonzero(ids)
        owners = ids[ys, xs]
        if not len(owners):
            continue
        order = np.argsort(owners, kind="stable")
        names, starts = np.unique(owners[order], return_index=True)
        for one, some in zip(names.tolist(), np.split(order, starts[1:]), strict=True):
            _add(found, frame, one, ys[some], xs[some])
    return found


def _add(found: Silhouettes, frame: int, one: int, ys: Pixels, xs: Pixels) -> None:
    disc = _disc(ys, xs)
    if disc is None:
        return
    place, core, reach, area = disc
    found.areas.setdefault(one, {})[frame] = area
    found.places.setdefault(one, {})[frame] = place
    width, height = found.size
    if xs.min() == 0 or ys.min() == 0 or xs.max() == width - 1 or ys.max() == height - 1:
        found.cut.setdefault(one, set()).add(frame)
        return
    found.cores.setdefault(one, []).append(core)
    found.reaches.setdefault(one, []).append(reach)


def disc_about(mask: NDArray[np.bool_]) -> tuple[tuple[float, float], float, float, float] | None:
    """Centroid px, radii of the largest disc about it inside and the least around, area px²; None for a few pixels."""
    return _disc(*np.nonzero(mask))


def _disc(ys: Pixels, xs: Pixels) -> tuple[tuple[float, float], float, float, float] | None:
    if len(xs) < LEAST:
        return None
    x0, y0 = int(xs.min()), int(ys.min())
    part = np.zeros((int(ys.max()) - y0 + 3, int(xs.max()) - x0 + 3), np.uint8)
    part[ys - y0 + 1, xs - x0 + 1] = 1
    x, y = float(xs.mean()), float(ys.mean())
    inside = cv2.distanceTransform(part, cv2.DIST_L2, 5)
    core = max(float(inside[round(y) - y0 + 1, round(x) - x0 + 1]) - 0.5, 0.0)
    return (x, y), core, float(np.hypot(xs - x, ys - y).max()) + 0.5, float(len(xs))


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
