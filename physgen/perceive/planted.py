"""Things that stand upright on a common line -> their outlines with level feet on it, as they would stand.

A mask's lowest border is ragged, and a thing on two stray pixels rocks. Its front edge, too, is nearer to a camera that
looks down a little, and so lower in the photo than the section through its middle that moves: the foot is lifted by as
much as the scene's default tilt says for a thing as deep as it is wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, sin

import numpy as np

from physgen.geometry import Array
from physgen.outline.outline import Disc, Outline, Region, Ring, bounds
from physgen.outline.simplify import crossings
from physgen.perceive.rest import AGREE, STEEP, Foot, Line
from physgen.perceive.roles import Thing

TILT = 2.0
"""degrees. Chosen on the studio's and the peers' photos: with the 4 of `world.tilt` one peer's floor is missed by
3.3 px, with none the studio's by up to 4."""
MOST_LIFT = 2.0
"""px."""
ASKEW = 2.5
"""px by which the foot of a narrow thing may rise and be level."""
NEARER = 4.0
"""px by which a flat foot may be lower than those of most and be lifted to their line."""
BAND = 2.0
"""px over a foot within which the border is the foot's."""
ALIKE = 1.5
"""px between feet up to which they stand on one straight line."""
EVEN = 0.05
"""px between feet at one height."""
LEVEL = 0.08
"""Slope of a foot up to which it is level, and its slope an error of the mask."""
SLOPED = 0.03
"""Slope of a line through three feet or more from which it is no level floor seen askew."""
WIDE = 0.35
"""Of a thing's width: what a foot has that it stands on flat."""


def lift(outline: Outline) -> float:
    """px by which the section through its middle stands higher in the photo than its front edge; 0 for round things."""
    if isinstance(outline, Disc):
        return 0.0
    x0, y0, x1, y1 = bounds(outline)
    return min(MOST_LIFT, 0.5 * sin(radians(TILT)) * min(x1 - x0, y1 - y0))


def flat(foot: Foot) -> bool:
    """Whether a thing stands on a level edge, not on a corner or a curve."""
    if isinstance(foot.thing.outline, Disc):
        return False
    x0, _, x1, _ = bounds(foot.thing.outline)
    low = foot.hull[foot.hull[:, 1] >= foot.hull[:, 1].max() - BAND]
    run = float(foot.right[0] - foot.left[0])
    level = abs(float(foot.right[1] - foot.left[1])) <= max(LEVEL * run, ASKEW)
    return level and float(np.ptp(low[:, 0])) >= WIDE * (x1 - x0)


def parted(line: Line, group: Sequence[Foot]) -> list[tuple[Line, list[Foot]]]:
    """A group of three or more on a level line without what stands higher or lower than most, which stands alone.

    One floor for all of them would be a chain of humps: as the floor is flat, the masks are wrong, or those things
    stand nearer or farther.
    """
    if len(group) < 3 or abs(line.slope) >= SLOPED:
        return [(line, list(group))]
    level, tilted = (_alike(group, slope, ALIKE)[1] for slope in (0.0, line.slope))
    # one thing alone tells no slope
    stood, kept = _alike(group, line.slope if len(tilted) >= len(level) + 2 else 0.0, ASKEW, NEARER)
    if len(kept) < 2 or len(kept) == len(group):
        return [(line, list(group))]
    return [(stood, kept), *((Line(0.0, float(f.lowest[1])), [f]) for f in group if f not in kept)]


def _alike(
    group: Sequence[Foot], slope: float, within: float, lower: float | None = None
) -> tuple[Line, list[Foot]]:
    """The line of a slope through most of a group, and those that stand `within` px of it, or flat and `lower`."""
    off = np.array([_height(foot) - slope * float(foot.lowest[0]) for foot in group])
    line = Line(slope, float(np.median(off)))
    # a flat foot nearer to the camera is lower, and can be lifted; what is round stands where it is
    most = np.array([lower if lower is not None and flat(foot) else within for foot in group])
    near = (off - line.height >= -within) & (off - line.height <= most)
    # what is not flat cannot be made to follow the line
    ends = np.array(
        [[foot.left[1] - line.at(foot.left[0]), foot.right[1] - line.at(foot.right[0])] for foot in group]
    )
    near &= np.array([flat(foot) for foot in group]) | (np.abs(ends).max(axis=1) <= ALIKE)
    return line, [foot for foot, here in zip(group, near, strict=True) if here]


def _height(foot: Foot) -> float:
    """y at which a thing stands."""
    return float(foot.hull[:, 1].max()) - (lift(foot.thing.outline) if flat(foot) else 0.0)


def planted(line: Line, group: Sequence[Foot]) -> dict[int, Outline]:
    """Outlines with straight feet, by id, of those in a group that stand flat: on one line where they nearly do."""
    result: dict[int, Outline] = {}
    if abs(line.slope) > STEEP:
        for foot in group:
            outline = foot.thing.outline
            if isinstance(outline, Region) and abs(foot.slope - line.slope) <= AGREE:
                result[foot.thing.id] = straightened(outline, line)
        return result
    feet = [foot for foot in group if flat(foot)]
    if not feet or (len(group) > 2 and abs(line.slope) >= SLOPED):
        return {}
    heights = np.array([_height(foot) for foot in feet])
    slope = 0.0
    if len(group) > 2:
        rest = heights - line.slope * np.array([foot.lowest[0] for foot in feet])
        if np.ptp(heights) > 2 * ALIKE and np.ptp(rest) < np.ptp(heights):
            slope, heights = line.slope, rest
        low, high = np.array([heights.min(), heights.max()]) - np.median(heights)
        if low >= -ASKEW and high <= NEARER:
            heights = np.full(len(feet), np.median(heights))
    for k in range(len(feet)):
        near = np.abs(heights - heights[k]) <= ALIKE
        if near.sum() > 1 and np.ptp(heights) <= 2 * ALIKE:
            heights = np.where(near, np.median(heights[near]), heights)
    for foot, height in zip(feet, heights.tolist(), strict=True):
        assert isinstance(foot.thing.outline, Region)
        stood = Line(slope, round(height, 2))
        low = float(foot.hull[:, 1].max())
        up = max(
            BAND, abs(float(foot.right[1] - foot.left[1])) + 0.5, stood.at(float(foot.lowest[0])) - low + 0.5
        )
        result[foot.thing.id] = straightened(foot.thing.outline, stood, up)
    return result


def levelled(line: Line, group: Sequence[Foot]) -> Line:
    """The line of a group, level where all of it stands at one height."""
    heights = [float(y) for foot in group for y in (foot.left[1], foot.right[1])]
    if max(heights) - min(heights) > EVEN:
        return line
    return Line(0.0, max(heights))


def straightened(outline: Region, line: Line, band: float = BAND) -> Region:
    """Nothing of it below the line, its border within `band` px above it on it; as it was where that would cross."""
    normal = np.array([-line.slope, 1.0]) / np.hypot(line.slope, 1.0)
    start = np.array([0.0, line.height])
    rings = []
    for ring in outline.rings:
        off = (ring.outer - start) @ normal
        low = off >= -band
        points = ring.outer - np.where(low, off, 0.0)[:, None] * normal
        inner = low & np.roll(low, 1) & np.roll(low, -1)
        if np.ptp(off) > band and (~inner).sum() >= 3:
            rings.append(Ring(points[~inner], ring.holes))
    borders = [part for ring in rings for part in (ring.outer, *ring.holes)]
    if not rings or len(crossings([np.round(part, 2) for part in borders])):  # a thin neck is pressed flat
        return outline
    return Region(tuple(rings))


def cradle(thing: Thing, center: Array, hull: Array, reach: float = 0.3) -> list[tuple[float, float]]:
    """A chain that follows the underside of a thing to both sides of its centre of mass: a nest that it lies in."""
    outline = thing.outline
    if isinstance(outline, Disc):
        x, y, r = float(outline.center[0]), float(outline.center[1]), outline.radius
        a = np.radians(25.0)
        inner, side, up = r * np.tan(a / 2), r * np.sin(a), r * np.cos(a)
        chain = [(x - side, y + up), (x - inner, y + r), (x + inner, y + r), (x + side, y + up)]
    else:
        x0, _, x1, _ = bounds(outline)
        ends = np.clip(
            [center[0] - reach * (x1 - x0), center[0] + reach * (x1 - x0)], hull[0, 0], hull[-1, 0]
        )
        # it lies on corners of its hull: without one on either side of its centre it would tip
        k = int(np.clip(np.searchsorted(hull[:, 0], center[0]), 1, len(hull) - 1))
        ends = np.clip(
            [min(ends[0], hull[k - 1, 0] - 0.5), max(ends[1], hull[k, 0] + 0.5)], hull[0, 0], hull[-1, 0]
        )
        inner = hull[(hull[:, 0] > ends[0]) & (hull[:, 0] < ends[1])]
        xs = [ends[0], *inner[:, 0], ends[1]]
        chain = [(float(px), float(np.interp(px, hull[:, 0], hull[:, 1]))) for px in xs]
    return [(round(float(px), 2), float(np.ceil(py * 100 - 1e-6) / 100)) for px, py in chain]
