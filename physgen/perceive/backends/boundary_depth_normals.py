"""Backend boundary=depth-normals: view and boundaries from depth and normals (paper,
appendix).

The paper ("Boundary extraction") takes background objects within the foreground's range
of depth, selects planes by normals, and fits level and upright edges to their borders.
Here the supports come first, as boundary=support lays them under what rests on them;
depth shows how far they reach and what else is solid in the plane in which the objects
move; normals show which of its borders are planes'. Slopes are edges too.

A photo shows, in every direction, the nearest surface. Where that is nearer than the
plane in which objects move, the plane is hidden behind matter and taken to be solid
there; where it is farther, the plane is free. The border between the two is the section
of all that stands still: a floor's, a wall's, a table's, a cushion's.

Image axes, px. An edge has the solid on its right as one goes along it from `start` to
`end` (y points down), so that a floor's goes from left to right. The height of a floor
is the objects': they stand exactly on it. Depth only decides where a floor begins and
ends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import atan2, degrees, hypot
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, bounds
from physgen.maps import F32
from physgen.messages import Message
from physgen.perceive.backends.boundary_support import (
    ELASTICITY,
    FRICTION,
    Photo,
    feet_groups,
    find_cushions,
    lay_floors,
    view_evidence,
    with_supports,
)
from physgen.perceive.roles import (
    Boundary,
    BoundaryGuess,
    Labels,
    Mask,
    PhotoObject,
    Rgb,
    Scenery,
    Wall,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.ground_contact import Foot, Line
from physgen.perceive.support.supports import depth_inside, free_parts
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View


@dataclass(frozen=True)
class _Limits:
    """Which edges are walls: px, shares of the photo's longer side ("of the photo"), or
    of its range of depth.
    """

    up: float = 0.6  # -y of a normal from which a surface faces up
    # px that an edge may run within an outline: an error of the mask, or of the depth beside it
    through: float = 2.0
    # cosine between the way an edge's surface faces and the way out of it, from which it is its section
    section: float = 0.9
    slope: float = 8.0  # degrees from level where slopes begin
    # at 512 px, by which an object's depth runs over its outline in the output of
    # models
    bleeds: int = 4
    # of depth, by which a face may lie behind the objects' plane and still be in it
    slack: float = 0.02
    soft: float = 1.5  # standard deviation of the blur that smooths a border
    # of the foreground's depth: how far before all objects a surface is still among
    # them
    near: float = 1.0
    # of depth: least depth of the foreground where its objects stand ...
    thin: float = 0.05
    deep: float = 0.2  # ... and for its shelves
    facing: float = 0.85  # cosine from which a surface faces the viewer
    shortest: float = 0.04  # of the photo: a shorter edge is a detail
    # of the photo, by which a contour may leave its chord and be straight
    bent: float = 0.005
    rough: float = 1.5  # RMS by which a contour may leave the line fitted to it
    seen: float = 0.4  # share of an edge that must not be hidden by objects
    # length of the mean of unit normals of one plane: all within about 30 degrees
    flat: float = 0.85
    # from an edge, where normals and depth are read on its solid side
    strip: tuple[int, ...] = (
        2,
        4,
        6,
    )
    # of the photo, by which the ends of a floor's edge may be off it
    same: float = 0.02
    under: tuple[int, ...] = (5, 8)  # below a floor, where solid matter is looked for
    # of the photo: a floor ends where as much of nothing is seen under it
    nothing: float = 0.03
    # share of a floor at objects that must be solid for its ends to be looked for
    backed: float = 0.5


LIMITS = _Limits()


def depth_normals() -> Boundary:
    """Return the backend `depth-normals`."""
    return _depth_normals


def _depth_normals(
    rgb: Rgb,
    labels: Labels,
    objects: Sequence[PhotoObject],
    view: View | None,
    *,
    depth: F32 | None = None,
    normals: F32 | None = None,
    scenery: Scenery | None = None,
) -> BoundaryGuess:
    """`depth` (H, W) up to scale and shift; without `normals`, everything counts as a
    plane that faces the viewer.

    Raises InputError where there is no depth.
    """
    even = normalised_depth(depth)
    if normals is None:
        facing = np.zeros((*labels.shape, 3), np.float32)
        facing[..., 2] = 1
    else:
        facing = np.asarray(cv2.blur(normals, (3, 3)), np.float32)
    groups = feet_groups(labels, objects)
    chances = view_chances(run_network(rgb).features)
    if view is None:
        small = cv2.resize(facing, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        found, sure, reason = guess_view(
            rgb,
            labels,
            np.asarray(small, np.float32),
            *view_evidence(objects, groups),
            chances,
        )
    else:
        found, sure, reason = view, 1.0, "as given"
    if not len(objects) or not (labels > 0).any():
        return BoundaryGuess(found, sure, reason, ())
    if found is View.TOP:
        return BoundaryGuess(
            found, sure, reason, tuple(find_cushions(Photo(rgb, labels), objects))
        )
    section = side_section(even, facing, labels, objects, groups, scenery)
    stood = lay_floors(rgb, labels, objects, partial(solid_reach, section))
    edges = section_edges(section, facing)
    others = [
        edge
        for edge in edges
        if not any(is_floor_edge(section, edge, wall) for wall in stood.walls)
    ]
    guess = BoundaryGuess(found, sure, reason, (), tilt=chances.tilt)
    guess = with_supports(guess, labels, stood)
    beside = _walls(others, stood.objects, guess.walls)
    return replace(guess, walls=(*guess.walls, *beside))


def _walls(
    found: Sequence[Edge], objects: Sequence[PhotoObject], taken: Sequence[Wall]
) -> list[Wall]:
    """Edges as walls, without the parts that run into objects."""
    outlines = [t.outline for t in objects]
    count, names = Counter[str](), {wall.name for wall in taken}
    walls: list[Wall] = []
    for edge in found:
        along = edge.start + np.linspace(0, 1, max(2, int(edge.length)))[:, None] * (
            edge.end - edge.start
        )
        within = max(
            (float(depth_inside(o, along).max()) for o in outlines), default=0.0
        )
        # objects stand lower than this
        behind = edge.out[1] < -0.7 and within > LIMITS.through
        if behind or _is_rim(edge):
            continue
        chain = [
            (round(float(x), 2), round(float(y), 2)) for x, y in (edge.start, edge.end)
        ]
        out, level = edge.out[1], abs(edge.angle) <= LIMITS.slope
        kind = (
            "ledge"
            if level
            else "slope"
            if out < -0.35
            else "underside"
            if out > 0.35
            else "side"
        )
        sure = round(min(0.9, 0.3 + 0.6 * edge.seen * edge.plane**2), 2)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < 4:
                continue
            count[kind] += 1
            while (name := f"{kind}-{count[kind]}") in names:
                count[kind] += 1
            source, reason = "depth and normals", "beyond it is far"
            walls.append(
                Wall(name, tuple(part), FRICTION, ELASTICITY, sure, source, reason)
            )
    return walls


def _is_rim(edge: Edge) -> bool:
    """Return whether it ends a plane nearer than the objects' that faces elsewhere, as
    the side rim of a table's top.
    """
    assert edge.facing is not None
    across = edge.facing[:2]
    return bool(
        np.hypot(*across) > LIMITS.up
        and across @ edge.out < LIMITS.section * np.hypot(*across)
    )


# section of the background by the plane of motion


@dataclass(frozen=True)
class Section:
    """Solid matter in the plane of motion; depths are 0 at the photo's nearest point, 1
    at its farthest.
    """

    # (H, W): the background's, interpolated across objects from side to side
    depth: F32
    solid: Mask  # (H, W)
    known: Mask  # (H, W): False where objects, or the bleeding of their depth, hide it
    nearest: float  # depth before which nothing is among the objects

    @property
    def size(self) -> int:
        """Return the photo's longer side, px."""
        height, width = self.solid.shape
        return int(max(height, width))


@dataclass(frozen=True, eq=False)
class Edge:
    """One straight edge."""

    start: Array  # (2,) px
    end: Array  # (2,) px
    seen: float = 0.0  # 0..1: the share of it that is
    plane: float = 0.0  # 0..1: how alike the normals on its solid side are
    facing: Array | None = None  # (3,) unit: their mean

    @property
    def length(self) -> float:
        """px."""
        return float(hypot(*(self.end - self.start)))

    @property
    def along(self) -> Array:
        """(2,) unit."""
        return np.asarray((self.end - self.start) / max(self.length, 1e-9))

    @property
    def out(self) -> Array:
        """(2,) unit: away from the solid."""
        return np.array([self.along[1], -self.along[0]])

    @property
    def angle(self) -> float:
        """degrees, -180..180: 0 a floor, 90 the left side of a solid."""
        return degrees(atan2(self.along[1], self.along[0]))


def normalised_depth(depth: F32 | None) -> F32:
    """Depth from 0, the photo's nearest, to 1, its farthest, without specks.

    Raises InputError where there is none.
    """
    if (
        depth is None
        or not np.isfinite(depth).all()
        or np.ptp(depth) <= 1e-6 * np.abs(depth).max()
    ):
        found = (
            "no depth"
            if depth is None
            else "depth that is the same everywhere, or not finite"
        )
        raise Message.NO_DEPTH_FOR_BOUNDARY.error("--backend", found)
    low, high = np.percentile(depth[::3, ::3], (0.5, 99.5))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low, high = depth.min(), depth.max()
    return np.asarray(
        cv2.medianBlur(((depth - low) / (high - low)).astype(np.float32), 5), np.float32
    )


def hidden_by_objects(labels: Labels) -> Mask:
    """(H, W): objects, and as far as their depth bleeds."""
    reach = 2 * max(2, round(LIMITS.bleeds * max(labels.shape) / 512)) + 1
    return np.asarray(
        cv2.dilate((labels > 0).astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    )


def side_section(
    depth: F32,
    normals: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    groups: Sequence[tuple[Line, list[Foot]]],
    scenery: Scenery | None,
) -> Section:
    """Return the section in a side view: the objects' plane is as far as what they
    stand on, where they stand.
    """
    away = hidden_by_objects(labels)
    full = _filled_behind(depth, away)
    parts = [depth[labels == item.id] for item in objects]
    own = [np.percentile(part, (10, 75)) for part in parts if part.size]
    nearest, farthest = min(float(o[0]) for o in own), max(float(o[1]) for o in own)
    around = max(farthest - nearest, LIMITS.thin)
    stands = [
        d
        for line, group in groups
        if (d := _depth_beside(full, away, line, group)) is not None
    ]
    # what is seen under an object in the air is no floor
    stands = [d for d in stands if nearest - around <= d <= farthest + around]
    plane = max(stands) if stands else farthest
    # flat objects stand in the plane, too; a surface that runs through it ends there
    limit = plane + LIMITS.slack * (normals[..., 2] > LIMITS.facing)
    before = LIMITS.near * max(farthest - nearest, LIMITS.deep)
    solid = (full < limit).astype(np.float32)
    if (
        scenery is not None
    ):  # the paper's choice: scenery within the foreground's range of depth
        ids = np.where(away, 0, scenery.labels)
        for i in np.unique(ids[ids > 0]).tolist():
            low, high = np.percentile(full[ids == i], (5, 95))
            if low > limit.max() or high < nearest - before:
                solid[scenery.labels == i] = 0.0
    smooth = cv2.GaussianBlur(solid, (0, 0), LIMITS.soft) > 0.5
    return Section(full, smooth, ~away, nearest - before)


def _filled_behind(depth: F32, away: Mask) -> F32:
    """Return the depth with `away` (H, W) interpolated from side to side."""
    result = depth.copy()
    columns = np.arange(depth.shape[1])
    for row in np.flatnonzero(away.any(1)):
        seen = ~away[row]
        if seen.any():
            result[row, ~seen] = np.interp(
                columns[~seen], columns[seen], depth[row, seen]
            )
    return result


def _depth_beside(
    depth: F32, away: Mask, line: Line, group: Sequence[Foot]
) -> float | None:
    """Median depth beside objects, where they stand."""
    height, width = depth.shape
    x0, x1 = min(f.left[0] for f in group), max(f.right[0] for f in group)
    margin = 0.5 * max(float(np.ptp(f.hull[:, 0])) for f in group) + 2 * LIMITS.bleeds
    columns = np.arange(max(0, int(x0 - margin)), min(width, int(x1 + margin) + 1))
    rows = np.round(line.slope * columns + line.height).astype(int)
    inside = (rows >= 0) & (rows < height)
    columns, rows = columns[inside], rows[inside]
    seen = ~away[rows, columns]
    return (
        float(np.median(depth[rows[seen], columns[seen]])) if seen.sum() >= 5 else None
    )


# edges


def section_edges(section: Section, normals: F32) -> list[Edge]:
    """Straight parts of the border of the solid that are seen and with a plane on their
    solid side.
    """
    contours, _ = cv2.findContours(
        section.solid.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    found = [
        edge
        for contour in contours
        for edge in _straight_edges(contour[::-1, 0, :], section)
    ]
    planes = [_plane(edge, section, normals) for edge in found]
    return [edge for edge in planes if edge is not None]


def _straight_edges(points: NDArray[Any], section: Section) -> Iterator[Edge]:
    """Edges of one contour `(N, 2)`, half a pixel out: it runs through the middles of
    the outermost solid pixels.
    """
    height, width = section.solid.shape
    least = LIMITS.shortest * section.size
    if len(points) < least:
        return
    corners = cv2.approxPolyDP(points, LIMITS.bent * section.size, True)[:, 0, :]
    order = np.sort(
        [int(np.flatnonzero((points == corner).all(-1))[0]) for corner in corners]
    )
    columns, rows = points.T
    border = (columns < 2) | (rows < 2) | (columns > width - 3) | (rows > height - 3)
    seen = section.known[rows, columns] & ~border
    for first, last in zip(order, np.roll(order, -1), strict=True):
        run = np.arange(
            first, last + 1 if last > first else last + 1 + len(points)
        ) % len(points)
        trim = min(len(run) // 5, 6)
        used = run[trim : len(run) - trim]
        used = used[seen[used]]
        if len(used) < max(6, LIMITS.seen * (len(run) - 2 * trim)):
            continue
        x, y, u, v = cv2.fitLine(
            points[used].astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01
        ).ravel()[[2, 3, 0, 1]]
        middle, along = np.array([x, y], np.float64), np.array([u, v], np.float64)
        along = along if along @ (points[last] - points[first]) >= 0 else -along
        out = np.array([along[1], -along[0]])
        if np.sqrt((((points[used] - middle) @ out) ** 2).mean()) > LIMITS.rough:
            continue
        start, end = (
            middle + along * ((points[k] - middle) @ along) + 0.5 * out
            for k in (first, last)
        )
        edge = Edge(start, end, len(used) / (len(run) - 2 * trim))
        if edge.length >= least:
            yield edge


def _plane(edge: Edge, section: Section, normals: F32) -> Edge | None:
    """Return the edge where its solid side is a plane, and not nearer than all objects."""
    height, width = section.solid.shape
    best = replace(edge, plane=LIMITS.flat)
    share = np.linspace(0.1, 0.9, max(int(edge.length), 2))[:, None]
    for way in LIMITS.strip:
        points = edge.start + share * (edge.end - edge.start) - way * edge.out
        columns, rows = np.rint(points).astype(np.int64).T
        at = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        use = section.known[at] & section.solid[at]
        if use.sum() < 5 or np.median(section.depth[at][use]) < section.nearest:
            continue
        mean = normals[at][use].mean(0).astype(np.float64)
        if (length := float(np.linalg.norm(mean))) >= best.plane:
            best = replace(edge, plane=length, facing=mean / length)
    return best if best.facing is not None else None


# floors


def is_floor_edge(section: Section, edge: Edge, wall: Wall) -> bool:
    """Return whether an edge is a piece of a floor, or continues it."""
    (x0, y0), (x1, y1) = edge.start, edge.end
    off = np.abs(np.interp([x0, x1], *np.array(wall.points).T) - [y0, y1])
    return bool(edge.out[1] < -0.5 and off.max() <= LIMITS.same * section.size)


def solid_reach(
    section: Section, line: Line, group: Sequence[Foot]
) -> tuple[float, float] | None:
    """Return the ends of the floor under a group: where nothing solid is seen under it
    any more, else far off.

    None where nothing solid is seen beside the objects.
    """
    height, width = section.solid.shape
    columns = np.arange(width)
    empty, solid = np.ones(width, bool), np.ones(width, bool)
    for down in LIMITS.under:
        rows = np.rint(line.slope * columns + line.height).astype(int) + down
        inside = (rows >= 0) & (rows < height)
        at = np.clip(rows, 0, height - 1), columns
        empty &= ~inside | (section.known[at] & ~section.solid[at])
        solid &= section.solid[at] | ~section.known[at]
    boxes = np.array([bounds(foot.item.outline) for foot in group])
    inner = boxes[:, 0].min(), boxes[:, 2].max()
    margin = int(max(LIMITS.nothing * section.size, 1))
    beside = (columns >= inner[0] - margin) & (columns <= inner[1] + margin)
    if not beside.any() or solid[beside].mean() < LIMITS.backed:
        return None
    holes = np.flatnonzero(np.convolve(empty, np.ones(margin), "valid") >= margin)
    left, right = holes[holes + margin <= inner[0]], holes[holes >= inner[1]]
    start = float(left.max() + margin) - 0.5 if len(left) else -float(width)
    return start, float(right.min()) - 0.5 if len(right) else 2.0 * width
