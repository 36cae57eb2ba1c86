"""Backend boundary=depth-normals: view and boundaries from depth and normals (paper,
appendix).

The paper ("Boundary extraction") selects background objects within the foreground's
depth range, selects planes by normals, and fits level and upright edges to their
borders. Here the supports come first: as in boundary=support, they lie under the
objects. Depth shows their extent and other solid matter in the plane of motion, and
normals show whether a border belongs to a plane. Slopes are edges too.

In every direction a photo shows the nearest surface. If that surface is nearer than the
plane of motion, the plane is hidden behind matter and is taken to be solid there; if it
is farther, the plane is free. The border between both regions is the section of all
static matter: floors, walls, tables, cushions.

Coordinates are image axes, px. An edge has the solid on its right in the direction from
`start` to `end` (y points down), so that a floor's edge runs from left to right. The
height of a floor comes from the objects, because they stand exactly on it; depth only
decides about its ends.
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
    feet_groups,
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
from physgen.perceive.support.cushions import find_cushions
from physgen.perceive.support.floor_surface import Photo
from physgen.perceive.support.ground_contact import Foot, Line
from physgen.perceive.support.supports import depth_inside, free_parts
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View


@dataclass(frozen=True)
class _Limits:
    """Limits of edges that become walls.

    Units are px, shares of the photo's longer side ("of the photo") or shares of the
    photo's depth range ("of depth").
    """

    # Least -y of the normal of a surface that faces up.
    up: float = 0.6
    # px: largest depth of an edge inside an outline, by an error of the mask or of the
    # depth beside it.
    through: float = 2.0
    # Least cosine between the surface's direction and the outward direction of an edge
    # that is the surface's section.
    section: float = 0.9
    # Least angle of a slope, degrees from level.
    slope: float = 8.0
    # px at a photo of 512 px: models blur an object's depth over its outline by this
    # distance.
    bleeds: int = 4
    # of depth: largest distance behind the objects' plane of a facing surface in the
    # plane.
    slack: float = 0.02
    # px: standard deviation of the blur along a border.
    soft: float = 1.5
    # Distance in front of all objects within which a surface is among them, as a share
    # of the foreground's depth.
    near: float = 1.0
    # of depth: least depth range of the foreground for its supports ...
    thin: float = 0.05
    # ... and for its shelves.
    deep: float = 0.2
    # Least cosine of a surface that faces the viewer.
    facing: float = 0.85
    # of the photo: shorter edges are details.
    shortest: float = 0.04
    # of the photo: largest deviation of a straight contour from its chord.
    bent: float = 0.005
    # px: largest RMS deviation of a contour from its line.
    rough: float = 1.5
    # Least visible share of an edge.
    seen: float = 0.4
    # Least length of the mean unit normal of a plane: all normals within about 30
    # degrees.
    flat: float = 0.85
    # px between an edge and the samples of normals and depth on its solid side.
    strip: tuple[int, ...] = (
        2,
        4,
        6,
    )
    # of the photo: largest distance of an edge's ends from a floor that contains it.
    same: float = 0.02
    # px below a floor at which solid matter is tested.
    under: tuple[int, ...] = (5, 8)
    # of the photo: a floor ends at a gap of this width without solid matter.
    nothing: float = 0.03
    # Least share of solid matter under the objects for a floor with known ends.
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
    """Return the view and the boundaries.

    `depth` (H, W) is known up to scale and shift. Without `normals`, every surface
    counts as a plane that faces the viewer. Raises InputError without depth.
    """
    unit_depth = normalised_depth(depth)
    if normals is None:
        facing = np.zeros((*labels.shape, 3), np.float32)
        facing[..., 2] = 1
    else:
        facing = np.asarray(cv2.blur(normals, (3, 3)), np.float32)
    groups = feet_groups(labels, objects)
    chances = view_chances(run_network(rgb).features)
    if view is None:
        small = cv2.resize(facing, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        view_guess, confidence, reason = guess_view(
            rgb,
            labels,
            np.asarray(small, np.float32),
            *view_evidence(objects, groups),
            chances,
        )
    else:
        view_guess, confidence, reason = view, 1.0, "as given"
    if not len(objects) or not (labels > 0).any():
        return BoundaryGuess(view_guess, confidence, reason, ())
    if view_guess is View.TOP:
        return BoundaryGuess(
            view_guess,
            confidence,
            reason,
            tuple(find_cushions(Photo(rgb, labels), objects)),
        )
    section = side_section(unit_depth, facing, labels, objects, groups, scenery)
    supports = lay_floors(rgb, labels, objects, partial(solid_reach, section))
    edges = section_edges(section, facing)
    others = [
        edge
        for edge in edges
        if not any(is_floor_edge(section, edge, wall) for wall in supports.walls)
    ]
    guess = BoundaryGuess(view_guess, confidence, reason, (), tilt=chances.tilt)
    guess = with_supports(guess, labels, supports)
    extra_walls = _walls(others, supports.objects, guess.walls)
    return replace(guess, walls=(*guess.walls, *extra_walls))


def _walls(
    found: Sequence[Edge], objects: Sequence[PhotoObject], taken: Sequence[Wall]
) -> list[Wall]:
    """Return walls along edges, without the parts inside objects."""
    outlines = [t.outline for t in objects]
    count, names = Counter[str](), {wall.name for wall in taken}
    walls: list[Wall] = []
    for edge in found:
        samples = edge.start + np.linspace(0, 1, max(2, int(edge.length)))[:, None] * (
            edge.end - edge.start
        )
        largest_depth = max(
            (float(depth_inside(o, samples).max()) for o in outlines), default=0.0
        )
        # A surface that faces up lies below the objects on it: an edge inside an object
        # is behind it.
        lies_behind = edge.out[1] < -0.7 and largest_depth > LIMITS.through
        if lies_behind or _is_rim(edge):
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
        confidence = round(min(0.9, 0.3 + 0.6 * edge.seen * edge.plane**2), 2)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < 4:
                continue
            count[kind] += 1
            while (name := f"{kind}-{count[kind]}") in names:
                count[kind] += 1
            source, reason = "depth and normals", "beyond it is far"
            walls.append(
                Wall(
                    name, tuple(part), FRICTION, ELASTICITY, confidence, source, reason
                )
            )
    return walls


def _is_rim(edge: Edge) -> bool:
    """Return whether an edge is only the rim of a nearer plane.

    For example, the side rim of a table's top ends a plane that faces up, not sideways.
    """
    assert edge.facing is not None
    direction = edge.facing[:2]
    return bool(
        np.hypot(*direction) > LIMITS.up
        and direction @ edge.out < LIMITS.section * np.hypot(*direction)
    )


# The section of the background by the plane of motion.


@dataclass(frozen=True)
class Section:
    """Solid matter in the plane of motion; depth is 0 at the nearest and 1 at the
    farthest point.
    """

    # (H, W): depth of the background, interpolated across objects in each row.
    depth: F32
    solid: Mask  # (H, W)
    # (H, W): False behind objects and their blurred depth.
    known: Mask
    # Depth in front of all objects; nearer surfaces do not interact with them.
    nearest: float

    @property
    def size(self) -> int:
        """Return the photo's longer side, px."""
        height, width = self.solid.shape
        return int(max(height, width))


@dataclass(frozen=True, eq=False)
class Edge:
    """A straight edge of the section."""

    start: Array  # (2,) px
    end: Array  # (2,) px
    # 0..1: visible share of the edge.
    seen: float = 0.0
    # 0..1: agreement of the normals on its solid side.
    plane: float = 0.0
    # (3,): their unit mean.
    facing: Array | None = None

    @property
    def length(self) -> float:
        """Return the length, px."""
        return float(hypot(*(self.end - self.start)))

    @property
    def along(self) -> Array:
        """Return the unit direction (2,) from start to end."""
        return np.asarray((self.end - self.start) / max(self.length, 1e-9))

    @property
    def out(self) -> Array:
        """Return the unit normal (2,) that points away from the solid."""
        return np.array([self.along[1], -self.along[0]])

    @property
    def angle(self) -> float:
        """Return the angle in degrees, -180..180: 0 for a floor, 90 for a solid's left
        side.
        """
        return degrees(atan2(self.along[1], self.along[0]))


def normalised_depth(depth: F32 | None) -> F32:
    """Return depth without specks, from 0 at the nearest to 1 at the farthest point.

    Raises InputError if depth is missing or constant.
    """
    if (
        depth is None
        or not np.isfinite(depth).all()
        or np.ptp(depth) <= 1e-6 * np.abs(depth).max()
    ):
        fault = (
            "no depth"
            if depth is None
            else "depth that is the same everywhere, or not finite"
        )
        raise Message.NO_DEPTH_FOR_BOUNDARY.error("--backend", fault)
    # Percentiles ignore outliers unless nearly all depths are equal.
    low, high = np.percentile(depth[::3, ::3], (0.5, 99.5))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low, high = depth.min(), depth.max()
    return np.asarray(
        cv2.medianBlur(((depth - low) / (high - low)).astype(np.float32), 5), np.float32
    )


def hidden_by_objects(labels: Labels) -> Mask:
    """Return the pixels (H, W) of objects and of their blurred depth."""
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
    """Return the section of a photo from the side.

    The plane of motion is as far as the supports at the objects' feet.
    """
    occlusion = hidden_by_objects(labels)
    full = _interpolate_background(depth, occlusion)
    parts = [depth[labels == item.id] for item in objects]
    ranges = [np.percentile(part, (10, 75)) for part in parts if part.size]
    nearest, farthest = (
        min(float(o[0]) for o in ranges),
        max(float(o[1]) for o in ranges),
    )
    depth_range = max(farthest - nearest, LIMITS.thin)
    stands = [
        d
        for line, group in groups
        if (d := _depth_beside(full, occlusion, line, group)) is not None
    ]
    # The surface visible under an object in the air is not its support.
    stands = [d for d in stands if nearest - depth_range <= d <= farthest + depth_range]
    plane = max(stands) if stands else farthest
    # Flat objects also stand in the plane; a surface that crosses the plane ends there.
    limit = plane + LIMITS.slack * (normals[..., 2] > LIMITS.facing)
    before = LIMITS.near * max(farthest - nearest, LIMITS.deep)
    solid = (full < limit).astype(np.float32)
    # The paper keeps only scenery within the foreground's range of depth.
    if scenery is not None:
        ids = np.where(occlusion, 0, scenery.labels)
        for i in np.unique(ids[ids > 0]).tolist():
            low, high = np.percentile(full[ids == i], (5, 95))
            if low > limit.max() or high < nearest - before:
                solid[scenery.labels == i] = 0.0
    smooth_solid = cv2.GaussianBlur(solid, (0, 0), LIMITS.soft) > 0.5
    return Section(full, smooth_solid, ~occlusion, nearest - before)


def _interpolate_background(depth: F32, away: Mask) -> F32:
    """Return the depth with `away` (H, W) interpolated in each row."""
    result = depth.copy()
    columns = np.arange(depth.shape[1])
    for row in np.flatnonzero(away.any(1)):
        is_visible = ~away[row]
        if is_visible.any():
            result[row, ~is_visible] = np.interp(
                columns[~is_visible], columns[is_visible], depth[row, is_visible]
            )
    return result


def _depth_beside(
    depth: F32, away: Mask, line: Line, group: Sequence[Foot]
) -> float | None:
    """Return the median depth of the support beside objects, or None if it is
    hidden.
    """
    height, width = depth.shape
    x0, x1 = min(f.left[0] for f in group), max(f.right[0] for f in group)
    margin = 0.5 * max(float(np.ptp(f.hull[:, 0])) for f in group) + 2 * LIMITS.bleeds
    columns = np.arange(max(0, int(x0 - margin)), min(width, int(x1 + margin) + 1))
    rows = np.round(line.slope * columns + line.height).astype(int)
    inside = (rows >= 0) & (rows < height)
    columns, rows = columns[inside], rows[inside]
    is_visible = ~away[rows, columns]
    return (
        float(np.median(depth[rows[is_visible], columns[is_visible]]))
        if is_visible.sum() >= 5
        else None
    )


# Edges of the section.


def section_edges(section: Section, normals: F32) -> list[Edge]:
    """Return the visible straight edges of the solid with a plane on their solid
    side.
    """
    contours, _ = cv2.findContours(
        section.solid.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    edges = [
        edge
        for contour in contours
        for edge in _straight_edges(contour[::-1, 0, :], section)
    ]
    planes = [_plane(edge, section, normals) for edge in edges]
    return [edge for edge in planes if edge is not None]


def _straight_edges(points: NDArray[Any], section: Section) -> Iterator[Edge]:
    """Yield the straight edges of one contour `(N, 2)`.

    Edges are shifted outwards by half a pixel, because the contour runs through the
    centres of the outermost solid pixels.
    """
    height, width = section.solid.shape
    least_length = LIMITS.shortest * section.size
    if len(points) < least_length:
        return
    corners = cv2.approxPolyDP(points, LIMITS.bent * section.size, True)[:, 0, :]
    order = np.sort(
        [int(np.flatnonzero((points == corner).all(-1))[0]) for corner in corners]
    )
    columns, rows = points.T
    border = (columns < 2) | (rows < 2) | (columns > width - 3) | (rows > height - 3)
    is_visible = section.known[rows, columns] & ~border
    for first, last in zip(order, np.roll(order, -1), strict=True):
        # A run of the contour between two corners, without its rounded ends.
        run = np.arange(
            first, last + 1 if last > first else last + 1 + len(points)
        ) % len(points)
        trim = min(len(run) // 5, 6)
        run_indices = run[trim : len(run) - trim]
        run_indices = run_indices[is_visible[run_indices]]
        if len(run_indices) < max(6, LIMITS.seen * (len(run) - 2 * trim)):
            continue
        x, y, u, v = cv2.fitLine(
            points[run_indices].astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01
        ).ravel()[[2, 3, 0, 1]]
        middle, direction = np.array([x, y], np.float64), np.array([u, v], np.float64)
        # Direct the line along the contour, with the solid on its right.
        direction = (
            direction if direction @ (points[last] - points[first]) >= 0 else -direction
        )
        out = np.array([direction[1], -direction[0]])
        if np.sqrt((((points[run_indices] - middle) @ out) ** 2).mean()) > LIMITS.rough:
            continue
        start, end = (
            middle + direction * ((points[k] - middle) @ direction) + 0.5 * out
            for k in (first, last)
        )
        edge = Edge(start, end, len(run_indices) / (len(run) - 2 * trim))
        if edge.length >= least_length:
            yield edge


def _plane(edge: Edge, section: Section, normals: F32) -> Edge | None:
    """Return the edge with its plane, or None without a plane or if it is nearer than
    all objects.
    """
    height, width = section.solid.shape
    best = replace(edge, plane=LIMITS.flat)
    share = np.linspace(0.1, 0.9, max(int(edge.length), 2))[:, None]
    for way in LIMITS.strip:
        points = edge.start + share * (edge.end - edge.start) - way * edge.out
        columns, rows = np.rint(points).astype(np.int64).T
        pixels = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        use = section.known[pixels] & section.solid[pixels]
        if use.sum() < 5 or np.median(section.depth[pixels][use]) < section.nearest:
            continue
        mean = normals[pixels][use].mean(0).astype(np.float64)
        if (length := float(np.linalg.norm(mean))) >= best.plane:
            best = replace(edge, plane=length, facing=mean / length)
    return best if best.facing is not None else None


# Floors.


def is_floor_edge(section: Section, edge: Edge, wall: Wall) -> bool:
    """Return whether an edge is a piece of a floor or its continuation."""
    (x0, y0), (x1, y1) = edge.start, edge.end
    distances = np.abs(np.interp([x0, x1], *np.array(wall.points).T) - [y0, y1])
    return bool(edge.out[1] < -0.5 and distances.max() <= LIMITS.same * section.size)


def solid_reach(
    section: Section, line: Line, group: Sequence[Foot]
) -> tuple[float, float] | None:
    """Return the ends of the floor under a group, or None without solid matter under
    it.

    An end is the first gap without solid matter; without a gap the floor ends outside
    the photo.
    """
    height, width = section.solid.shape
    columns = np.arange(width)
    empty, solid = np.ones(width, bool), np.ones(width, bool)
    for down in LIMITS.under:
        rows = np.rint(line.slope * columns + line.height).astype(int) + down
        inside = (rows >= 0) & (rows < height)
        pixels = np.clip(rows, 0, height - 1), columns
        empty &= ~inside | (section.known[pixels] & ~section.solid[pixels])
        solid &= section.solid[pixels] | ~section.known[pixels]
    boxes = np.array([bounds(foot.item.outline) for foot in group])
    inner = boxes[:, 0].min(), boxes[:, 2].max()
    margin = int(max(LIMITS.nothing * section.size, 1))
    near_feet = (columns >= inner[0] - margin) & (columns <= inner[1] + margin)
    if not near_feet.any() or solid[near_feet].mean() < LIMITS.backed:
        return None
    holes = np.flatnonzero(np.convolve(empty, np.ones(margin), "valid") >= margin)
    left, right = holes[holes + margin <= inner[0]], holes[holes >= inner[1]]
    start = float(left.max() + margin) - 0.5 if len(left) else -float(width)
    return start, float(right.min()) - 0.5 if len(right) else 2.0 * width
