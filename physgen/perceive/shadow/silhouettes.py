"""Silhouettes of objects that cast shadows, at any scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, inf

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc, bounds, mass_properties
from physgen.geometry.shadows import Silhouette
from physgen.perceive.roles import BoundaryGuess, Labels, Matter, PhotoObject
from physgen.scene.scene import Solid, View

Line = tuple[NDArray[np.float64], NDArray[np.float64]]
MOST = 40
"""Objects that are looked at; the largest."""
SUNK = 3.0
"""px by which a thing may reach below its floor."""


def object_silhouettes(
    labels: Labels,
    things: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    setting: BoundaryGuess,
    scale: float,
    floor: float | None = None,
) -> list[Silhouette]:
    """Of the largest things, on a picture 1 / scale of the size.

    Each stands over the highest boundary below it, or over `floor`, a row of the photo, where that is given.
    """
    top = setting.view is View.TOP
    grounds = [
        (np.array(a) / scale, np.array(b) / scale)
        for wall in setting.walls
        for a, b in zip(wall.points[:-1], wall.points[1:], strict=True)
    ]
    found = []
    sizes = {t.id: mass_properties(t.outline).area for t in things}
    for thing in sorted(things, key=lambda t: -sizes[t.id])[:MOST]:
        x0, y0, x1, y1 = bounds(thing.outline)
        a, b = max(int(x0) - 2, 0), max(int(y0) - 2, 0)
        c, d = min(ceil(x1) + 3, labels.shape[1]), min(ceil(y1) + 3, labels.shape[0])
        mask = (labels[b:d, a:c] == thing.id).astype(np.float32)
        if not mask.any():
            continue
        corner = int(a / scale), int(b / scale)
        w, h = ceil(c / scale) + 1 - corner[0], ceil(d / scale) + 1 - corner[1]
        matrix = np.array(
            [
                [1 / scale, 0, (a + 0.5) / scale - 0.5 - corner[0]],
                [0, 1 / scale, (b + 0.5) / scale - 0.5 - corner[1]],
            ]
        )
        soft = cv2.GaussianBlur(mask, (0, 0), 0.4 * scale) if scale > 1.2 else mask
        small = np.asarray(cv2.warpAffine(soft, matrix, (w, h), flags=cv2.INTER_LINEAR), np.float32)
        center = mass_properties(thing.outline).center / scale
        disc = isinstance(thing.outline, Disc)
        ball = disc and matter[thing.id].solid is Solid.SPHERE
        radius = thing.outline.radius / scale if isinstance(thing.outline, Disc) else None
        wide, high = (x1 - x0) / scale, (y1 - y0) / scale
        thick = 2 * radius if radius is not None else 0.9 * (wide * high) ** 0.5
        if top and not ball:
            thick *= 0.4 if disc else 0.6
        bottom = y1 / scale - 0.5
        below = _below(grounds, float(center[0]), bottom) if floor is None else floor / scale
        found.append(
            Silhouette(
                small,
                corner,
                (float(center[0]), float(center[1])),
                radius if ball else None,
                thick,
                below,
                thing.id,
            )
        )
    return found


def group_silhouettes(things: Sequence[Silhouette]) -> list[list[Silhouette]]:
    """Each ball alone; then all others, those of one floor and like thickness together."""
    balls = [[what] for what in things if what.radius is not None]
    groups: list[list[Silhouette]] = []
    for what in sorted((w for w in things if w.radius is None), key=lambda w: w.thick):
        for group in groups:
            if _alike(group[0], what):
                group.append(what)
                break
        else:
            groups.append([what])
    return balls + groups


def join_silhouettes(things: Sequence[Silhouette]) -> list[Silhouette]:
    """One for each of `grouped`: the shadows of things that stand side by side are one too."""
    return [group[0] if group[0].radius is not None else _one(group) for group in group_silhouettes(things)]


def _one(group: Sequence[Silhouette]) -> Silhouette:
    x0, y0 = (min(w.corner[k] for w in group) for k in (0, 1))
    x1, y1 = (max(w.corner[k] + w.coverage.shape[1 - k] for w in group) for k in (0, 1))
    whole = np.zeros((y1 - y0, x1 - x0), np.float32)
    for what in group:
        (x, y), (h, w) = what.corner, what.coverage.shape
        part = whole[y - y0 : y - y0 + h, x - x0 : x - x0 + w]
        np.maximum(part, what.coverage, out=part)
    thick = float(np.median([w.thick for w in group]))
    return Silhouette(whole, (x0, y0), group[0].center, None, thick, group[0].floor)


def _alike(one: Silhouette, other: Silhouette) -> bool:
    if one.floor is None or other.floor is None:
        return False
    return abs(one.floor - other.floor) < 1 and other.thick < 1.5 * one.thick


def lowest_floor(setting: BoundaryGuess) -> float | None:
    """The row, px, of the lowest boundary that things can stand on; None where there is none but the frame."""
    rows = [
        max(p[1], q[1])
        for wall in setting.walls
        if wall.name != "frame"
        for p, q in zip(wall.points[:-1], wall.points[1:], strict=True)
        if abs(q[0] - p[0]) > 1.2 * abs(q[1] - p[1])
    ]
    return max(rows, default=None)


def _below(grounds: Sequence[Line], x: float, bottom: float) -> float | None:
    rows = [
        float(p[1] + (q[1] - p[1]) * (x - p[0]) / (q[0] - p[0]))
        for p, q in grounds
        if abs(q[0] - p[0]) > 1.2 * abs(q[1] - p[1]) and min(p[0], q[0]) <= x <= max(p[0], q[0])
    ]
    return min((row for row in rows if row >= bottom - SUNK), default=None)


def typical_size(things: Sequence[Silhouette]) -> float:
    """px of a typical object: the root of its area."""
    areas = [float((s.coverage > 0.5).sum()) for s in things]
    return float(np.median([area**0.5 for area in areas])) + 1 if areas else inf
