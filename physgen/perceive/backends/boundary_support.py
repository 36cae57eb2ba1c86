"""Backend boundary=support: view, frame and floors from what the objects rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Outline, bounds
from physgen.perceive.roles import Boundary, BoundaryGuess, Labels, PhotoObject, Rgb, Wall
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.equilibrium import contacts
from physgen.perceive.support.ground_contact import (
    STEEP,
    Foot,
    Line,
    find_foot,
    fit_rectangles,
    floor_points,
    free_ends,
    group_feet,
    is_carried,
    level_feet,
    levelled_line,
    split_group,
    stands_flat,
)
from physgen.perceive.support.supports import add_supports, free_parts
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Groups = Sequence[tuple[Line, list[Foot]]]

ALIKE = 10.0
"""CIE 1976 Lab distance up to which two strips are the same surface."""
BEYOND, FADED = 0.04, 0.35
"""Of the photo's width that is looked at on either side of a floor's end; of the contrast across its edge within, what
may be left beyond."""
GRIP = 1.25
"""Coefficient of friction over the slope that things lie still on: at 1 they are about to slip."""
LEVEL = 1e-3
"""Slope of a foot below which it is level: rounding."""
FRICTION, ELASTICITY = 0.6, 0.4
CUSHION = 0.75
"""Elasticity of the frame seen from above: a pool cushion's 0.6 to 0.9 (Mathavan et al. 2010)."""


def support() -> Boundary:
    """The backend `support`."""
    return _support


def _support(rgb: Rgb, labels: Labels, things: Sequence[PhotoObject], view: View | None) -> BoundaryGuess:
    groups = feet_groups(labels, things)
    if view is None:
        alone, upright = view_evidence(things, groups)
        found, sure, reason = guess_view(rgb, labels, run_network(rgb).normals, alone, upright)
    else:
        found, sure, reason = view, 1.0, "as told"
    if found is View.TOP:
        return BoundaryGuess(found, sure, reason, (photo_frame(labels, found),))
    stood = lay_floors(rgb, labels, things, groups)
    walls = [photo_frame(labels, found), *stood.walls]
    more, held = add_supports(stood.things, walls, stood.grip, FRICTION, ELASTICITY)
    return BoundaryGuess(found, sure, reason, (*walls, *more), stood.outlines, held, stood.grip)


def feet_groups(labels: Labels, things: Sequence[PhotoObject]) -> Groups:
    """Feet on common lines, of all things that no other things carry."""
    feet = [find_foot(t) for t in things if not t.cut and not is_carried(t, labels, things)]
    return group_feet(feet, line_tolerance(labels))


def line_tolerance(labels: Labels) -> float:
    """px by which feet on one line may be off it."""
    return max(2.5, 0.012 * float(labels.shape[0]))


def view_evidence(things: Sequence[PhotoObject], groups: Groups) -> tuple[int, int]:
    """How many things share their line with nothing, and how many stand upright: what tells the view."""
    count = sum(len(group) for _, group in groups)
    alone = sum(len(group) for _, group in groups if len(group) == 1 and count > 1)
    return alone, sum(stands_flat(find_foot(t)) for t in things if not t.cut)


@dataclass(frozen=True)
class SupportedObjects:
    """Things as they stand on what is laid under them, seen from the side."""

    things: Sequence[PhotoObject]
    outlines: Mapping[int, Outline]
    """Of those that stand better than their masks tell."""
    walls: Sequence[Wall]
    grip: dict[int, float]
    """Least friction, by id."""


def lay_floors(rgb: Rgb, labels: Labels, things: Sequence[PhotoObject], groups: Groups) -> SupportedObjects:
    """Things with level feet, and floors that touch them."""
    outlines: dict[int, Outline] = {}
    groups = [part for line, group in groups for part in split_group(line, group)]
    for line, group in groups:
        outlines |= level_feet(line, group)
    things = [replace(t, outline=outlines.get(t.id, t.outline)) for t in things]
    # a box stands level
    askew = {t.id for t in things if t.id in outlines and abs(find_foot(t).slope) > LEVEL}
    outlines |= {i: box for i, box in fit_rectangles(things).items() if i not in askew}
    things = [replace(t, outline=outlines.get(t.id, t.outline)) for t in things]
    now = {t.id: t for t in things}
    stand = [(line, [find_foot(now[f.thing.id]) for f in group]) for line, group in groups]
    groups = [(levelled_line(line, group), group) for line, group in stand]
    walls = _floors(_lab(rgb), labels, things, groups, 2 * line_tolerance(labels))
    return SupportedObjects(things, outlines, walls, _grip(things, groups))


def _floors(
    lab: F32, labels: Labels, things: Sequence[PhotoObject], groups: Groups, close: float
) -> list[Wall]:
    """Under every group of feet a wall, in pieces where it would enter something.

    The floor is under the lowest group, or a larger one that is lower than `close` px above it.
    """
    width = labels.shape[1]
    groups = sorted(groups, key=lambda g: -_lowest(g[1]))
    level = [g for g in groups if abs(g[0].slope) <= STEEP]
    low = [g for g in level if _lowest(g[1]) >= _lowest(level[0][1]) - close]
    ground = max(low, key=lambda g: len(g[1]))[1] if low else []
    walls: list[Wall] = []
    for line, group in groups:
        others = [t for t in things if not t.cut and all(t is not f.thing for f in group)]
        across = (-0.5, width - 0.5)
        sloped = abs(line.slope) > STEEP
        first = group is ground
        wish = _seen(lab, labels, line, group, across)
        if first and len(group) > 1:  # it goes on unless its end is seen
            wish = _ending(lab, labels, line, wish, across)
        points = floor_points(line, group, free_ends(line, group, others, wish))
        here = [t.outline for t in things if all(t is not f.thing for f in group)]
        for part in free_parts(points, here):
            on = [f for f in group if part[0][0] <= f.right[0] and part[-1][0] >= f.left[0]]
            if not on:
                continue
            kind = "slope" if sloped else "floor" if first else "ledge"
            count = 1 + sum(w.name.split("-")[0] == kind for w in walls)
            name = kind if kind == "floor" and count == 1 else f"{kind}-{count}"
            friction = max(FRICTION, round(GRIP * abs(line.slope), 2))
            walls.append(
                Wall(name, tuple(part), friction, ELASTICITY, _sure(on), "lowest points", _told(on, sloped))
            )
    return walls


def _lowest(group: Sequence[Foot]) -> float:
    """y of its lowest foot."""
    return max(float(f.lowest[1]) for f in group)


def _grip(things: Sequence[PhotoObject], groups: Groups) -> dict[int, float]:
    """The least friction of what lies on a slope, and of all that leans or lies on it there."""
    outlines = [t.outline for t in things]
    pairs = {(c.thing, c.other) for c in contacts(outlines, [])}
    grip: dict[int, float] = {}
    for line, group in groups:
        steepest = max([abs(line.slope), *(abs(f.slope) for f in group)])
        if steepest <= STEEP:
            continue
        reached = {k for k, t in enumerate(things) if any(t is f.thing for f in group)}
        while more := {j for i, j in pairs if i in reached} | {i for i, j in pairs if j in reached}:
            if more <= reached:
                break
            reached |= more
        for k in reached:
            grip[things[k].id] = max(grip.get(things[k].id, 0.0), round(GRIP * steepest, 2))
    return grip


def photo_frame(labels: Labels, view: View) -> Wall:
    """The photo's border, a cushion where it is seen from above."""
    friction, elasticity = (0.2, CUSHION) if view is View.TOP else (FRICTION, ELASTICITY)
    right, bottom = labels.shape[1] - 0.5, labels.shape[0] - 0.5
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


def _ending(
    lab: F32, labels: Labels, line: Line, seen: tuple[float, float], most: tuple[float, float]
) -> tuple[float, float]:
    """Of the ends up to which a surface is `seen`, those beyond which what is above it goes on below; else `most`."""
    width = labels.shape[1]
    columns = np.arange(width)
    level = np.round(line.slope * columns + line.height).astype(int)
    below, above = (_strip(lab, labels, level + down) for down in (4, -10))
    step = np.linalg.norm(below - above, axis=1)
    long = max(12, round(BEYOND * width))
    ends = list(most)
    for k, way in enumerate((-1, 1)):
        end = round(seen[k])
        within, beyond = (
            step[[x for x in range(start, start + way * side * long, way * side) if 0 <= x < width]]
            for start, side in ((end - 3 * way, -1), (end + 3 * way, 1))
        )
        if min(np.isfinite(within).sum(), np.isfinite(beyond).sum()) < long // 2:
            continue
        if np.nanmedian(within) >= ALIKE and np.nanmedian(beyond) < FADED * np.nanmedian(within):
            ends[k] = seen[k]
    return ends[0], ends[1]


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


def _told(group: Sequence[Foot], sloped: bool) -> str:
    if sloped:
        return "as steep as what lies on it; its friction is what holds that still"
    if len(group) == 1:
        return "laid under the one object that nothing else holds there"
    return f"through the lowest points of {len(group)} objects, touching the shape of each"


def _lab(rgb: Rgb) -> F32:
    return cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB).astype(
        np.float32, copy=False
    )
