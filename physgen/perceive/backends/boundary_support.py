"""Photo, labels and outlines -> side or top view, the frame, and floors under what nothing else holds.

From the side, things stand on each other or on common lines, and what is above them mostly differs from what is below.
From above, the same surface is on all sides of things, and no line explains where they lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import bounds
from physgen.perceive.rest import Foot, Line, carried, clusters, floor, foot, free_ends
from physgen.perceive.roles import Boundary, Labels, Rgb, Setting, Thing, Wall
from physgen.scene.model import View

F32 = NDArray[np.float32]

ALIKE = 10.0
"""CIE 1976 Lab distance up to which two strips are the same surface."""
APART = 14.0
"""The same, lightness counted less because of shadows, from which what is above things is not what is below."""
FRICTION, ELASTICITY = 0.6, 0.4
CUSHION = 0.75
"""Elasticity of the frame seen from above: a pool cushion's 0.6 to 0.9 (Mathavan et al. 2010)."""


def support() -> Boundary:
    """The backend `support`."""
    return _support


def _support(rgb: Rgb, labels: Labels, things: Sequence[Thing], view: View | None) -> Setting:
    height, width = labels.shape
    standing = [foot(t) for t in things if not t.cut and not carried(t, labels, things)]
    groups = clusters(standing, max(2.5, 0.012 * height))
    alone = sum(len(group) for _, group in groups if len(group) == 1 and len(standing) > 1)
    explained = 1 - alone / max(len(things), 1)
    found, sure, reason = _view(rgb, labels, things, explained)
    if view is not None:
        found, sure, reason = view, 1.0, "as told"
    if found is View.TOP:
        return Setting(found, sure, reason, (_frame(width, height, 0.2, CUSHION),))
    walls = [_frame(width, height, FRICTION, ELASTICITY)]
    lab = _lab(rgb)
    groups = sorted(groups, key=lambda g: -max(float(f.lowest[1]) for f in g[1]))
    for number, (line, group) in enumerate(groups):
        others = [t for t in things if not t.cut and all(t is not f.thing for f in group)]
        across = (-0.5, width - 0.5)
        wish = across if number == 0 and len(group) > 1 else _seen(lab, labels, line, group, across)
        points = floor(line, group, free_ends(line, group, others, wish))
        name = "floor" if number == 0 else f"ledge-{number}"
        walls.append(
            Wall(name, tuple(points), FRICTION, ELASTICITY, _sure(group), "lowest points", _told(group))
        )
    return Setting(found, sure, reason, tuple(walls))


def _frame(width: int, height: int, friction: float, elasticity: float) -> Wall:
    right, bottom = width - 0.5, height - 0.5
    points = ((-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom), (-0.5, -0.5))
    return Wall(
        "frame", points, friction, elasticity, 1.0, "photo", "the photo's border, so that nothing leaves"
    )


def _span(group: Sequence[Foot], most: tuple[float, float]) -> tuple[float, float]:
    """From end to end of what stands there, and half a thing's width more."""
    boxes = [bounds(f.thing.outline) for f in group]
    margin = 0.5 * max(x1 - x0 for x0, _, x1, _ in boxes)
    return max(most[0], min(b[0] for b in boxes) - margin), min(most[1], max(b[2] for b in boxes) + margin)


def _seen(
    lab: F32, labels: Labels, line: Line, group: Sequence[Foot], most: tuple[float, float]
) -> tuple[float, float]:
    """From where to where the surface under a group is seen to reach; a guess where none is seen."""
    width = labels.shape[1]
    span = _span(group, most)
    columns = np.arange(width)
    below, above = (
        _strip(lab, labels, np.round(line.slope * columns + line.height).astype(int) + down)
        for down in (4, -10)
    )
    first, last = max(0, int(span[0])), min(width - 1, int(span[1]) + 1)
    under, over = (
        np.nanmedian(s[first : last + 1], axis=0) if _known(s[first : last + 1]) else None
        for s in (below, above)
    )
    if under is None or over is None or np.linalg.norm(under - over) < ALIKE:
        return span
    other = np.linalg.norm(below - under, axis=1) > 1.5 * ALIKE  # False where things hide it
    ends = []
    inner = min(float(f.left[0]) for f in group), max(float(f.right[0]) for f in group)
    for start, step in (
        (int(np.clip(inner[0], 0, width - 1)), -1),
        (int(np.clip(inner[1], 0, width - 1)), 1),
    ):
        missed, end, x = 0, start, start
        while 0 <= x < width and missed < 6:
            missed = missed + 1 if other[x] else 0
            end = x if not missed else end
            x += step
        ends.append(end)
    return min(inner[0], ends[0] - 0.5), max(inner[1], ends[1] + 0.5)


def _strip(lab: F32, labels: Labels, top: NDArray[np.int64]) -> NDArray[np.float64]:
    """Lab of each column `(W, 3)` over the 6 px from `top` (W,) on; NaN where objects or the photo's border hide it."""
    height, width = labels.shape
    rows = top[None, :] + np.arange(6)[:, None]
    hidden = (rows < 0) | (rows >= height)
    rows = np.clip(rows, 0, height - 1)
    hidden = (hidden | (labels[rows, np.arange(width)[None, :]] > 0)).any(0)
    strip = np.asarray(lab[rows, np.arange(width)[None, :]].mean(0), np.float64)
    strip[hidden] = np.nan
    return strip


def _known(strip: NDArray[np.float64]) -> bool:
    return int(np.isfinite(strip[:, 0]).sum()) >= 3


def _sure(group: Sequence[Foot]) -> float:
    return {1: 0.4, 2: 0.6}.get(len(group), 0.8)


def _told(group: Sequence[Foot]) -> str:
    if len(group) == 1:
        return "laid under the one object that nothing else holds there"
    return f"through the lowest points of {len(group)} objects, touching the shape of each"


def _view(rgb: Rgb, labels: Labels, things: Sequence[Thing], explained: float) -> tuple[View, float, str]:
    """Which view, how sure, and why."""
    if not things:
        return View.SIDE, 0.1, "there is no object to tell by"
    apart = _above_against_below(rgb, labels, things)
    if explained < 0.9 and apart < APART:
        sure = round(min(0.9, 0.5 + 0.5 * (0.9 - explained) + 0.01 * (APART - apart)), 2)
        return View.TOP, sure, "one surface is all around the objects, and no floor explains where they lie"
    reason = "the objects stand on one line or on each other"
    if explained < 0.9:
        reason = "what is above the objects differs from what is below them"
    many = 0.1 if len(things) > 2 else 0.0
    return View.SIDE, round(min(0.9, 0.4 + many + 0.015 * min(apart, 27)), 2), reason


def _lab(rgb: Rgb) -> F32:
    return cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB).astype(
        np.float32, copy=False
    )


def _above_against_below(rgb: Rgb, labels: Labels, things: Sequence[Thing]) -> float:
    """Lab distance between the background above things and below them, beyond their shadows; 0 where unseen."""
    lab = _lab(rgb)
    free = cv2.erode((labels == 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    height, width = labels.shape
    sides: tuple[list[Any], list[Any]] = [], []
    for thing in things:
        x0, y0, x1, y1 = bounds(thing.outline)
        near, far = (max(px, share * min(x1 - x0, y1 - y0)) for px, share in ((3.0, 0.3), (12.0, 1.5)))
        columns = slice(max(0, int(x0)), min(width, int(x1) + 2))
        for side, low, high in ((sides[0], y0 - far, y0 - near), (sides[1], y1 + near, y1 + far)):
            rows = slice(int(np.clip(low, 0, height)), int(np.clip(high, 0, height)))
            seen = lab[rows, columns][free[rows, columns]]
            if len(seen) >= 30:
                side.append(np.median(seen, axis=0))
    if not (sides[0] and sides[1]):
        return 0.0
    gap = np.median(sides[0], axis=0) - np.median(sides[1], axis=0)
    return float(np.linalg.norm(gap * (0.4, 1.0, 1.0)))
