"""Level feet: objects on one line, and their feet straight on it.

Coordinates are image axes, px: the lowest point has the largest y.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import radians, sin

import numpy as np

from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, bounds
from physgen.geometry.simplify import crossings
from physgen.perceive.roles import Mask, PhotoObject
from physgen.perceive.support.box_outlines import touching_objects
from physgen.perceive.support.ground_contact import AGREE, STEEP, Foot, Line


@dataclass(frozen=True)
class _LevelLimits:
    """Limits of levelled feet and of their heights; px.

    The lowest border of a mask is ragged, and an object on two stray pixels rocks.
    Also, the front edge of an object is nearer to a camera that looks down slightly, so
    that it lies lower in the photo than the moving section through the object's middle.
    The foot is therefore lifted as the camera's usual tilt requires for an object as
    deep as it is wide.
    """

    # degrees: with 4 (`world.tilt`) the floor of a peer photo is missed by 3.3 px, with
    # 0 that of a bundled photo by 4.
    tilt: float = 2.0
    max_lift: float = 2.0
    # Largest distance of a round object from the common line, as a share of its radius.
    disc: float = 0.145
    # px: largest value of that distance.
    disc_reach: float = 3.6
    # Largest rise of a level foot of a narrow object.
    rise: float = 2.5
    # Largest distance of a flat foot below the others' line for a lift to that line.
    nearer: float = 4.0
    # Height above a foot in which the border belongs to the foot.
    band: float = 2.0
    # Largest distance between feet on one straight line.
    deviation: float = 1.5
    # Largest slope of a level foot; smaller slopes are errors of the mask.
    level: float = 0.08
    # Least slope of a sloped floor through three feet or more.
    least_slope: float = 0.03
    # Least width of a flat foot as a share of the object's width.
    least_width: float = 0.35


LEVEL = _LevelLimits()


def stands_flat(foot: Foot) -> bool:
    """Return whether an object stands on a level edge rather than a corner or a
    curve.
    """
    if isinstance(foot.item.outline, Disc):
        return False
    x0, _, x1, _ = bounds(foot.item.outline)
    low = foot.hull[foot.hull[:, 1] >= foot.hull[:, 1].max() - LEVEL.band]
    run = float(foot.right[0] - foot.left[0])
    level = abs(float(foot.right[1] - foot.left[1])) <= max(
        LEVEL.level * run, LEVEL.rise
    )
    return level and float(np.ptp(low[:, 0])) >= LEVEL.least_width * (x1 - x0)


def _height(foot: Foot) -> float:
    """Return the y at which an object stands.

    A flat foot is lifted from its front edge to the section through the object's
    middle.
    """
    x0, y0, x1, y1 = bounds(foot.item.outline)
    lift = min(LEVEL.max_lift, 0.5 * sin(radians(LEVEL.tilt)) * min(x1 - x0, y1 - y0))
    return float(foot.hull[:, 1].max()) - lift * (
        stands_flat(foot) and not foot.item.top
    )


def free_discs(objects: Sequence[PhotoObject]) -> frozenset[int]:
    """Return the ids of round objects that touch no other object.

    If such a disc is off the common line, its mask is wrong.
    """
    discs = set()
    for item in objects:
        if isinstance(item.outline, Disc):
            discs.add(item.id)
    return frozenset(discs - touching_objects(objects))


def split_group(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> list[tuple[Line, list[Foot]]]:
    """Return the feet of a group on one line, and each other foot by itself.

    The line is level unless most feet show its slope. One floor for all feet would be a
    chain of humps: a floor is flat, so the masks are wrong or some objects are nearer
    or farther. Objects `free` follow the line, as objects with flat feet do.
    """
    if abs(line.slope) > STEEP or _check_sloped_floor(line, group):
        return [(line, list(group))]
    _, level = _find_feet_near_line(group, 0.0, free, LEVEL.deviation)
    _, sloped_feet = _find_feet_near_line(group, line.slope, free, LEVEL.deviation)
    # A single additional object is no evidence of a slope.
    if len(sloped_feet) >= len(level) + 2:
        slope = line.slope
    else:
        slope = 0.0
    common_line, feet_on_line = _find_feet_near_line(
        group, slope, free, LEVEL.rise, LEVEL.nearer
    )
    separate = []
    for f in group:
        if len(feet_on_line) < 2 or f not in feet_on_line:
            separate.append(f)
    return [(common_line, feet_on_line)] * (len(feet_on_line) > 1) + [
        (Line(0.0, round(_height(f), 2)), [f]) for f in separate
    ]


def _check_sloped_floor(line: Line, group: Sequence[Foot]) -> bool:
    """Return whether a line belongs to a sloped floor."""
    return len(group) > 2 and abs(line.slope) >= LEVEL.least_slope


def _find_feet_near_line(
    group: Sequence[Foot],
    slope: float,
    free: Collection[int],
    tolerance: float,
    lower: float | None = None,
) -> tuple[Line, list[Foot]]:
    """Return the line of a slope through most of a group, and the feet on it.

    Feet are on the line within `tolerance` px. Feet that follow it may also be down to
    `lower` px below it.
    """
    intercepts = np.array(
        [_height(foot) - slope * float(foot.lowest[0]) for foot in group]
    )
    line = Line(slope, round(float(np.median(intercepts)), 2))
    follows = np.array([foot.item.id in free or stands_flat(foot) for foot in group])
    # A flat foot nearer to the camera is lower in the photo and can be lifted.
    largest = np.where(follows, tolerance if lower is None else lower, tolerance)
    reach = _measure_reach(group)
    line_members = (intercepts - line.height >= -np.minimum(tolerance, reach)) & (
        intercepts - line.height <= np.minimum(largest, reach)
    )
    line_members &= follows | _has_ends_on_line(group, line)
    return line, [
        foot for foot, is_member in zip(group, line_members, strict=True) if is_member
    ]


def _measure_reach(group: Sequence[Foot]) -> Array:
    """Return the largest distance (N,) of each foot from its line.

    A disc may move only as far as its pixels stay inside its circle.
    """
    radii = []
    for f in group:
        radii.append(
            f.item.outline.radius if isinstance(f.item.outline, Disc) else np.inf
        )
    return np.minimum(LEVEL.disc * np.array(radii), LEVEL.disc_reach)


def _has_ends_on_line(group: Sequence[Foot], line: Line) -> Mask:
    """Return (N,) whether both ends of each foot are on a line."""
    ends = np.array(
        [
            [f.left[1] - line.y_at(f.left[0]), f.right[1] - line.y_at(f.right[0])]
            for f in group
        ]
    )
    return np.asarray(np.abs(ends).max(axis=1) <= LEVEL.deviation)


def level_feet(
    line: Line, group: Sequence[Foot], free: Collection[int]
) -> dict[int, Outline]:
    """Return outlines, by id, with feet straight on the line of a group.

    This applies to objects with flat feet, or as steep as a slope; `free` discs are
    resized to reach the line.
    """
    result: dict[int, Outline] = {}
    is_level_group = line.slope == 0 and len(group) > 1
    for foot in group:
        outline = foot.item.outline
        if not isinstance(outline, Disc):
            if _follows_line(foot, line, group):
                band = _measure_band(foot, line)
                result[foot.item.id] = straighten_foot(outline, line, band)
        elif foot.item.id in free and is_level_group:
            x, y = outline.center
            r = (line.height - float(y) + outline.radius) / 2
            result[foot.item.id] = Disc(np.array([x, line.height - r]), r)
    return result


def _follows_line(foot: Foot, line: Line, group: Sequence[Foot]) -> bool:
    """Return whether a foot is to be straightened on the line of its group."""
    if abs(line.slope) > STEEP:
        return abs(foot.slope - line.slope) <= AGREE
    return stands_flat(foot) and not _check_sloped_floor(line, group)


def _measure_band(foot: Foot, line: Line) -> float:
    """Return the height above the line of the border that belongs to a foot, px."""
    if abs(line.slope) > STEEP:
        return LEVEL.band
    rise = abs(float(foot.right[1] - foot.left[1]))
    lift = line.y_at(float(foot.lowest[0])) - float(foot.hull[:, 1].max())
    return max(LEVEL.band, rise + 0.5, lift + 0.5)


def straighten_foot(outline: Region, line: Line, band: float = LEVEL.band) -> Region:
    """Return the outline cut off below a line, with its border close above moved onto
    the line.

    `band` is the height of that border, px. The outline is unchanged if its border
    would cross itself.
    """
    normal = np.array([-line.slope, 1.0]) / np.hypot(line.slope, 1.0)
    start = np.array([0.0, line.height])
    rings = []
    for ring in outline.rings:
        distances = (ring.outer - start) @ normal
        low = distances >= -band
        points = ring.outer - np.where(low, distances, 0.0)[:, None] * normal
        # Inside a straight run, points are redundant.
        inner = low & np.roll(low, 1) & np.roll(low, -1)
        if np.ptp(distances) > band and (~inner).sum() >= 3:
            rings.append(Ring(points[~inner], ring.holes))
    borders = [part for ring in rings for part in (ring.outer, *ring.holes)]
    # A thin neck would be pressed flat.
    if not rings or len(crossings([np.round(part, 2) for part in borders])):
        return outline
    return Region(tuple(rings))
