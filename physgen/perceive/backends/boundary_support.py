"""Backend boundary=support: view, frame and floors from what the objects rest on.

From the side, objects stand on each other or on common lines, and the surface above them mostly differs from the one
below. From above, the same surface is on all sides of objects, and no line explains where they lie.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Outline, bounds
from physgen.perceive.roles import F32, Boundary, BoundaryGuess, Labels, PhotoObject, Rgb, Wall
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

Groups = Sequence[tuple[Line, list[Foot]]]
Span = tuple[float, float]

FRICTION, ELASTICITY = 0.6, 0.4
CUSHION = 0.75  # elasticity of the frame seen from above: a pool cushion's 0.6 to 0.9 (Mathavan et al. 2010)
GRIP = 1.25  # coefficient of friction over the slope that objects lie still on: at 1 they are about to slip
ALIKE = 10.0  # CIE 1976 Lab distance up to which two strips are the same surface
BEYOND = 0.04  # of the photo's width, that is compared on either side of a floor's end
FADED = 0.35  # of the contrast across its edge within, at most, beyond a floor's end
ROUNDING = 1e-3  # slope of a foot below which it is level


def support() -> Boundary:
    """The backend `support`."""
    return _support


def _support(rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], view: View | None) -> BoundaryGuess:
    groups = feet_groups(labels, objects)
    if view is None:
        alone, upright = view_evidence(objects, groups)
        found, sure, reason = guess_view(rgb, labels, run_network(rgb).normals, alone, upright)
    else:
        found, sure, reason = view, 1.0, "as given"
    if found is View.TOP:
        return BoundaryGuess(found, sure, reason, (photo_frame(labels, found),))
    stood = lay_floors(rgb, labels, objects, groups)
    walls = [photo_frame(labels, found), *stood.walls]
    more, held = add_supports(stood.objects, walls, stood.grip, FRICTION, ELASTICITY)
    return BoundaryGuess(found, sure, reason, (*walls, *more), stood.outlines, held, stood.grip)


def feet_groups(labels: Labels, objects: Sequence[PhotoObject]) -> Groups:
    """Feet on common lines, of all objects that no other objects carry."""
    feet = [find_foot(t) for t in objects if not t.cut and not is_carried(t, labels, objects)]
    return group_feet(feet, line_tolerance(labels))


def line_tolerance(labels: Labels) -> float:
    """px by which feet on one line may be off it."""
    return max(2.5, 0.012 * float(labels.shape[0]))


def view_evidence(objects: Sequence[PhotoObject], groups: Groups) -> tuple[int, int]:
    """The number of objects that share their line with none, and of those that stand upright."""
    count = sum(len(group) for _, group in groups)
    alone = sum(len(group) for _, group in groups if len(group) == 1 and count > 1)
    return alone, sum(stands_flat(find_foot(t)) for t in objects if not t.cut)


@dataclass(frozen=True)
class SupportedObjects:
    """Objects as they stand on the floors laid under them, seen from the side."""

    objects: Sequence[PhotoObject]
    outlines: Mapping[int, Outline]
    """Of those that stand better than their masks show."""
    walls: Sequence[Wall]
    grip: dict[int, float]
    """Least friction, by id."""


def lay_floors(rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], groups: Groups) -> SupportedObjects:
    """Objects with level feet, and floors that touch them."""
    outlines: dict[int, Outline] = {}
    groups = [part for line, group in groups for part in split_group(line, group)]
    for line, group in groups:
        outlines |= level_feet(line, group)
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    # a box stands level
    askew = {t.id for t in objects if t.id in outlines and abs(find_foot(t).slope) > ROUNDING}
    outlines |= {i: box for i, box in fit_rectangles(objects).items() if i not in askew}
    objects = [replace(t, outline=outlines.get(t.id, t.outline)) for t in objects]
    now = {t.id: t for t in objects}
    stand = [(line, [find_foot(now[f.item.id]) for f in group]) for line, group in groups]
    groups = [(levelled_line(line, group), group) for line, group in stand]
    walls = _floors(_Photo(rgb, labels), objects, groups, 2 * line_tolerance(labels))
    return SupportedObjects(objects, outlines, walls, _grip(objects, groups))


def _floors(photo: _Photo, objects: Sequence[PhotoObject], groups: Groups, close: float) -> list[Wall]:
    """Under every group of feet a wall, in pieces where it would enter an object.

    The floor is under the lowest group, or a larger one that is lower than `close` px above it.
    """
    groups = sorted(groups, key=lambda g: -_lowest(g[1]))
    level = [g for g in groups if abs(g[0].slope) <= STEEP]
    low = [g for g in level if _lowest(g[1]) >= _lowest(level[0][1]) - close]
    ground = max(low, key=lambda g: len(g[1]))[1] if low else []
    walls: list[Wall] = []
    for line, group in groups:
        sloped, is_ground = abs(line.slope) > STEEP, group is ground
        wish = photo.seen_span(line, group)
        if is_ground and len(group) > 1:  # it goes on unless its end is seen
            wish = photo.floor_ends(line, wish)
        others = [t for t in objects if all(t is not f.item for f in group)]
        ends = free_ends(line, group, [t for t in others if not t.cut], wish)
        for part in free_parts(floor_points(line, group, ends), [t.outline for t in others]):
            on = [f for f in group if part[0][0] <= f.right[0] and part[-1][0] >= f.left[0]]
            if not on:
                continue
            kind = "slope" if sloped else "floor" if is_ground else "ledge"
            count = 1 + sum(w.name.split("-")[0] == kind for w in walls)
            name = kind if kind == "floor" and count == 1 else f"{kind}-{count}"
            friction = max(FRICTION, round(GRIP * abs(line.slope), 2))
            sure = {1: 0.4, 2: 0.6}.get(len(on), 0.8)
            reason = _reason(on, sloped)
            walls.append(Wall(name, tuple(part), friction, ELASTICITY, sure, "lowest points", reason))
    return walls


def _lowest(group: Sequence[Foot]) -> float:
    """y of its lowest foot."""
    return max(float(f.lowest[1]) for f in group)


def _reason(group: Sequence[Foot], sloped: bool) -> str:
    if sloped:
        return "as steep as what lies on it; its friction is what holds that still"
    if len(group) == 1:
        return "laid under the one object that nothing else holds there"
    return f"through the lowest points of {len(group)} objects, touching the shape of each"


def _grip(objects: Sequence[PhotoObject], groups: Groups) -> dict[int, float]:
    """The least friction of objects on a slope, and of all that lean or lie on them there."""
    pairs = {(c.body, c.other) for c in contacts([t.outline for t in objects], [])}
    grip: dict[int, float] = {}
    for line, group in groups:
        steepest = max([abs(line.slope), *(abs(f.slope) for f in group)])
        if steepest <= STEEP:
            continue
        reached = {k for k, t in enumerate(objects) if any(t is f.item for f in group)}
        while more := {j for i, j in pairs if i in reached} | {i for i, j in pairs if j in reached}:
            if more <= reached:
                break
            reached |= more
        for k in reached:
            grip[objects[k].id] = max(grip.get(objects[k].id, 0.0), round(GRIP * steepest, 2))
    return grip


def photo_frame(labels: Labels, view: View) -> Wall:
    """The photo's border, a cushion where it is seen from above."""
    friction, elasticity = (0.2, CUSHION) if view is View.TOP else (FRICTION, ELASTICITY)
    right, bottom = labels.shape[1] - 0.5, labels.shape[0] - 0.5
    points = ((-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom), (-0.5, -0.5))
    reason = "the photo's border, so that nothing leaves"
    return Wall("frame", points, friction, elasticity, 1.0, "photo", reason)


class _Photo:
    """Colours of the background along lines."""

    def __init__(self, rgb: Rgb, labels: Labels) -> None:
        lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
        self.lab: F32 = np.asarray(lab, np.float32)
        self.labels = labels
        self.width = labels.shape[1]

    def strips(self, line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lab of each column `(W, 3)` below and above a line, 6 px high; NaN where objects or the border hide it."""
        columns = np.arange(self.width)
        level = np.round(line.slope * columns + line.height).astype(int)
        below, above = (self._strip(level + down) for down in (4, -10))
        return below, above

    def _strip(self, top: NDArray[np.int64]) -> NDArray[np.float64]:
        height, width = self.labels.shape
        rows = top[None, :] + np.arange(6)[:, None]
        hidden = (rows < 0) | (rows >= height)
        rows = np.clip(rows, 0, height - 1)
        hidden = (hidden | (self.labels[rows, np.arange(width)[None, :]] > 0)).any(0)
        strip = np.asarray(self.lab[rows, np.arange(width)[None, :]].mean(0), np.float64)
        strip[hidden] = np.nan
        return strip

    def seen_span(self, line: Line, group: Sequence[Foot]) -> Span:
        """From where to where the surface under a group is seen to reach; a guess where none is seen."""
        width = self.width
        boxes = [bounds(f.item.outline) for f in group]
        margin = 0.5 * max(x1 - x0 for x0, _, x1, _ in boxes)
        start, end = min(b[0] for b in boxes) - margin, max(b[2] for b in boxes) + margin
        span = max(-0.5, start), min(width - 0.5, end)
        below, above = self.strips(line)
        there = slice(max(0, int(span[0])), min(width - 1, int(span[1]) + 1) + 1)
        if any(np.isfinite(strip[there, 0]).sum() < 3 for strip in (below, above)):
            return span
        under, over = (np.nanmedian(strip[there], axis=0) for strip in (below, above))
        if np.linalg.norm(under - over) < ALIKE:
            return span
        other = np.linalg.norm(below - under, axis=1) > 1.5 * ALIKE  # False where objects hide it
        ends = []
        inner = min(float(f.left[0]) for f in group), max(float(f.right[0]) for f in group)
        for x_inner, step in zip(inner, (-1, 1), strict=True):
            first = int(np.clip(x_inner, 0, width - 1))
            missed, last, x = 0, first, first
            while 0 <= x < width and missed < 6:
                missed = missed + 1 if other[x] else 0
                last = x if not missed else last
                x += step
            ends.append(last)
        return min(inner[0], ends[0] - 0.5), max(inner[1], ends[1] + 0.5)

    def floor_ends(self, line: Line, seen: Span) -> Span:
        """The ends `seen` of a floor where the surface above it continues below beyond them; else the photo's."""
        width = self.width
        below, above = self.strips(line)
        step = np.linalg.norm(below - above, axis=1)
        length = max(12, round(BEYOND * width))
        ends = [-0.5, width - 0.5]
        for k, way in enumerate((-1, 1)):
            end = round(seen[k])
            within, beyond = (
                step[[x for x in range(start, start + way * side * length, way * side) if 0 <= x < width]]
                for start, side in ((end - 3 * way, -1), (end + 3 * way, 1))
            )
            if min(np.isfinite(within).sum(), np.isfinite(beyond).sum()) < length // 2:
                continue
            if np.nanmedian(within) >= ALIKE and np.nanmedian(beyond) < FADED * np.nanmedian(within):
                ends[k] = seen[k]
        return ends[0], ends[1]
