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

from physgen.geometry.polygon import Array, Outline, bounds
from physgen.maps import F32
from physgen.messages import Message
from physgen.perceive.backends.boundary_support import (
    ELASTICITY,
    FRICTION,
    Groups,
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
    floor_normal: float = 0.6
    # px: largest depth of an edge inside an outline, by an error of the mask or of the
    # depth beside it.
    mask_error: float = 2.0
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
    border_blur: float = 1.5
    # Distance in front of all objects within which a surface is among them, as a share
    # of the foreground's depth.
    front: float = 1.0
    # of depth: least depth range of the foreground for its supports ...
    least_range: float = 0.05
    # ... and for its shelves.
    shelf_range: float = 0.2
    # Least cosine of a surface that faces the viewer.
    facing: float = 0.85
    # of the photo: shorter edges are details.
    shortest: float = 0.04
    # of the photo: largest deviation of a straight contour from its chord.
    curvature: float = 0.005
    # px: largest RMS deviation of a contour from its line.
    roughness: float = 1.5
    # Least visible share of an edge.
    visibility: float = 0.4
    # Least length of the mean unit normal of a plane: all normals within about 30
    # degrees.
    flatness: float = 0.85
    # px between an edge and the samples of normals and depth on its solid side.
    strip: tuple[int, ...] = (
        2,
        4,
        6,
    )
    # of the photo: largest distance of an edge's ends from a floor that contains it.
    floor_distance: float = 0.02
    # px below a floor at which solid matter is tested.
    floor_depths: tuple[int, ...] = (5, 8)
    # of the photo: a floor ends at a gap of this width without solid matter.
    gap: float = 0.03
    # Least share of solid matter under the objects for a floor with known ends.
    solid_share: float = 0.5
    # px: shorter pieces of an edge get no wall.
    least_piece: float = 4.0
    # Least -y of the outward direction of an edge on which objects lie.
    upward: float = 0.7
    # Largest |y| of the outward direction of an upright edge.
    sideways: float = 0.35


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
    facing = _smooth_normals(normals, labels.shape)
    groups = feet_groups(labels, objects)
    guess = _guess_photo_view(rgb, labels, objects, view, facing, groups)
    if not len(objects) or not (labels > 0).any():
        return replace(guess, tilt=None)
    if guess.view is View.TOP:
        cushions = find_cushions(Photo(rgb, labels), objects)
        return replace(guess, walls=tuple(cushions), tilt=None)
    section = side_section(unit_depth, facing, labels, objects, groups, scenery)
    supports = lay_floors(rgb, labels, objects, partial(solid_reach, section))
    edges = section_edges(section, facing)
    others = []
    for edge in edges:
        if not any(is_floor_edge(section, edge, wall) for wall in supports.walls):
            others.append(edge)
    guess = with_supports(guess, labels, supports)
    extra_walls = _walls(others, supports.objects, guess.walls)
    return replace(guess, walls=(*guess.walls, *extra_walls))


def _smooth_normals(normals: F32 | None, shape: tuple[int, ...]) -> F32:
    """Return smooth normals (H, W, 3), or normals that face the viewer."""
    if normals is not None:
        return np.asarray(cv2.blur(normals, (3, 3)), np.float32)
    facing = np.zeros((*shape, 3), np.float32)
    facing[..., 2] = 1
    return facing


def _guess_photo_view(
    rgb: Rgb,
    labels: Labels,
    objects: Sequence[PhotoObject],
    view: View | None,
    normals: F32,
    groups: Groups,
) -> BoundaryGuess:
    """Return the given or the guessed view of a photo, without walls."""
    chances = view_chances(run_network(rgb).features)
    if view is not None:
        return BoundaryGuess(view, 1.0, "as given", (), tilt=chances.tilt)
    small = cv2.resize(normals, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    view_guess, confidence, reason = guess_view(
        rgb,
        labels,
        np.asarray(small, np.float32),
        *view_evidence(objects, groups),
        chances,
    )
    return BoundaryGuess(view_guess, confidence, reason, (), tilt=chances.tilt)


def _walls(
    edges: Sequence[Edge], objects: Sequence[PhotoObject], walls: Sequence[Wall]
) -> list[Wall]:
    """Return walls along edges, without the parts inside objects.

    Their names differ from those of `walls`.
    """
    outlines = [t.outline for t in objects]
    count = Counter[str]()
    names = {wall.name for wall in walls}
    edge_walls: list[Wall] = []
    for edge in edges:
        if _is_behind_objects(edge, outlines) or _is_rim(edge):
            continue
        chain = []
        for x, y in (edge.start, edge.end):
            chain.append((round(float(x), 2), round(float(y), 2)))
        kind = _name_kind(edge)
        confidence = round(min(0.9, 0.3 + 0.6 * edge.visibility * edge.plane**2), 2)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < LIMITS.least_piece:
                continue
            count[kind] += 1
            while (name := f"{kind}-{count[kind]}") in names:
                count[kind] += 1
            edge_walls.append(
                Wall(
                    name,
                    tuple(part),
                    FRICTION,
                    ELASTICITY,
                    confidence,
                    "depth and normals",
                    "beyond it is far",
                )
            )
    return edge_walls


def _is_behind_objects(edge: Edge, outlines: Sequence[Outline]) -> bool:
    """Return whether an edge is behind an object on it.

    A surface that faces up lies below the objects on it: an edge inside an object is
    behind it.
    """
    if edge.out[1] >= -LIMITS.upward:
        return False
    share = np.linspace(0, 1, max(2, int(edge.length)))[:, None]
    samples = edge.start + share * (edge.end - edge.start)
    depths = (float(depth_inside(o, samples).max()) for o in outlines)
    return max(depths, default=0.0) > LIMITS.mask_error


def _name_kind(edge: Edge) -> str:
    """Return the first part of the name of a wall."""
    if abs(edge.angle) <= LIMITS.slope:
        return "ledge"
    if edge.out[1] < -LIMITS.sideways:
        return "slope"
    if edge.out[1] > LIMITS.sideways:
        return "underside"
    return "side"


def _is_rim(edge: Edge) -> bool:
    """Return whether an edge is only the rim of a nearer plane.

    For example, the side rim of a table's top ends a plane that faces up, not sideways.
    """
    assert edge.facing is not None
    direction = edge.facing[:2]
    return bool(
        np.hypot(*direction) > LIMITS.floor_normal
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
    visible_mask: Mask
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
    visibility: float = 0.0
    # 0..1: agreement of the normals on its solid side.
    plane: float = 0.0
    # (3,): their unit mean.
    facing: Array | None = None

    @property
    def length(self) -> float:
        """Return the length, px."""
        return float(hypot(*(self.end - self.start)))

    @property
    def direction(self) -> Array:
        """Return the unit direction (2,) from start to end."""
        return np.asarray((self.end - self.start) / max(self.length, 1e-9))

    @property
    def out(self) -> Array:
        """Return the unit normal (2,) that points away from the solid."""
        return np.array([self.direction[1], -self.direction[0]])

    @property
    def angle(self) -> float:
        """Return the angle in degrees, -180..180: 0 for a floor, 90 for a solid's left
        side.
        """
        return degrees(atan2(self.direction[1], self.direction[0]))


def normalised_depth(depth: F32 | None) -> F32:
    """Return depth without specks, from 0 at the nearest to 1 at the farthest point.

    Raises InputError if depth is missing or constant.
    """
    if (
        depth is None
        or not np.isfinite(depth).all()
        or np.ptp(depth) <= 1e-6 * np.abs(depth).max()
    ):
        if depth is None:
            fault = "no depth"
        else:
            fault = "depth that is the same everywhere, or not finite"
        raise Message.NO_DEPTH_FOR_BOUNDARY.error("--backend", fault)
    # Percentiles ignore outliers unless nearly all depths are equal.
    low, high = np.percentile(depth[::3, ::3], (0.5, 99.5))
    if high - low <= 1e-6 * max(abs(low), abs(high)):
        low = depth.min()
        high = depth.max()
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
    groups: Groups,
    scenery: Scenery | None,
) -> Section:
    """Return the section of a photo from the side.

    The plane of motion is as far as the supports at the objects' feet.
    """
    occlusion = hidden_by_objects(labels)
    background = _interpolate_background(depth, occlusion)
    nearest, farthest = _measure_foreground(depth, labels, objects)
    depth_range = max(farthest - nearest, LIMITS.least_range)
    plane = -np.inf
    for line, group in groups:
        depth_beside = _depth_beside(background, occlusion, line, group)
        if depth_beside is None:
            continue
        # The surface visible under an object in the air is not its support.
        if nearest - depth_range <= depth_beside <= farthest + depth_range:
            plane = max(plane, depth_beside)
    if plane == -np.inf:
        plane = farthest
    # Flat objects also stand in the plane; a surface that crosses the plane ends there.
    limit = plane + LIMITS.slack * (normals[..., 2] > LIMITS.facing)
    front = nearest - LIMITS.front * max(farthest - nearest, LIMITS.shelf_range)
    solid = (background < limit).astype(np.float32)
    if scenery is not None:
        visible_ids = np.where(occlusion, 0, scenery.labels)
        farthest = float(limit.max())
        for i in _find_other_scenery(background, visible_ids, (front, farthest)):
            solid[scenery.labels == i] = 0.0
    smooth_solid = cv2.GaussianBlur(solid, (0, 0), LIMITS.border_blur) > 0.5
    return Section(background, smooth_solid, ~occlusion, front)


def _find_other_scenery(
    depth: F32, labels: Labels, depth_range: tuple[float, float]
) -> list[int]:
    """Return the ids of scenery outside the foreground's range of depth.

    The paper keeps only scenery within that range.
    """
    nearest, farthest = depth_range
    ids = []
    for i in np.unique(labels[labels > 0]).tolist():
        low, high = np.percentile(depth[labels == i], (5, 95))
        if low > farthest or high < nearest:
            ids.append(i)
    return ids


def _measure_foreground(
    depth: F32, labels: Labels, objects: Sequence[PhotoObject]
) -> tuple[float, float]:
    """Return the depth of the nearest and of the farthest object."""
    parts = [depth[labels == item.id] for item in objects]
    ranges = []
    for part in parts:
        if part.size:
            ranges.append(np.percentile(part, (10, 75)))
    return min(float(r[0]) for r in ranges), max(float(r[1]) for r in ranges)


def _interpolate_background(depth: F32, occlusion: Mask) -> F32:
    """Return the depth behind `occlusion` (H, W) interpolated in each row."""
    result = depth.copy()
    columns = np.arange(depth.shape[1])
    for row in np.flatnonzero(occlusion.any(1)):
        is_visible = ~occlusion[row]
        if is_visible.any():
            result[row, ~is_visible] = np.interp(
                columns[~is_visible], columns[is_visible], depth[row, is_visible]
            )
    return result


def _depth_beside(
    depth: F32, occlusion: Mask, line: Line, group: Sequence[Foot]
) -> float | None:
    """Return the median depth of the support beside objects, or None if it is
    hidden.
    """
    height, width = depth.shape
    x0 = min(f.left[0] for f in group)
    x1 = max(f.right[0] for f in group)
    margin = 0.5 * max(float(np.ptp(f.hull[:, 0])) for f in group) + 2 * LIMITS.bleeds
    columns = np.arange(max(0, int(x0 - margin)), min(width, int(x1 + margin) + 1))
    rows = np.round(line.slope * columns + line.height).astype(int)
    inside = (rows >= 0) & (rows < height)
    columns = columns[inside]
    rows = rows[inside]
    is_visible = ~occlusion[rows, columns]
    if is_visible.sum() >= 5:
        return float(np.median(depth[rows[is_visible], columns[is_visible]]))
    return None


# Edges of the section.


def section_edges(section: Section, normals: F32) -> list[Edge]:
    """Return the visible straight edges of the solid with a plane on their solid
    side.
    """
    contours, _ = cv2.findContours(
        section.solid.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE
    )
    edges: list[Edge] = []
    for contour in contours:
        edges.extend(_straight_edges(contour[::-1, 0, :], section))
    planes = [_plane(edge, section, normals) for edge in edges]
    return [edge for edge in planes if edge is not None]


def _straight_edges(points: NDArray[Any], section: Section) -> Iterator[Edge]:
    """Yield the straight edges of one contour `(N, 2)`."""
    least_length = LIMITS.shortest * section.size
    if len(points) < least_length:
        return
    corners = cv2.approxPolyDP(points, LIMITS.curvature * section.size, True)[:, 0, :]
    order = np.sort(
        [int(np.flatnonzero((points == corner).all(-1))[0]) for corner in corners]
    )
    is_visible = _find_visible_points(points, section)
    for first, last in zip(order, np.roll(order, -1), strict=True):
        # A run of the contour between two corners, without its rounded ends.
        run = np.arange(
            first, last + 1 if last > first else last + 1 + len(points)
        ) % len(points)
        trim = min(len(run) // 5, 6)
        indices = run[trim : len(run) - trim]
        count = len(indices)
        indices = indices[is_visible[indices]]
        if len(indices) < max(6, LIMITS.visibility * count):
            continue
        edge = _fit_edge(points[indices], points[first], points[last])
        if edge is not None and edge.length >= least_length:
            yield replace(edge, visibility=len(indices) / count)


def _find_visible_points(points: NDArray[Any], section: Section) -> Mask:
    """Return (N,) whether points of a contour are visible and inside the photo."""
    height, width = section.solid.shape
    columns, rows = points.T
    border = (columns < 2) | (rows < 2) | (columns > width - 3) | (rows > height - 3)
    return np.asarray(section.visible_mask[rows, columns] & ~border)


def _fit_edge(
    points: NDArray[Any], first: NDArray[Any], last: NDArray[Any]
) -> Edge | None:
    """Return the edge through points (n, 2) from `first` to `last` (2,), or None.

    The edge is shifted outwards by half a pixel, because the contour runs through the
    centres of the outermost solid pixels.
    """
    line = cv2.fitLine(points.astype(np.float32), cv2.DIST_L2, 0, 0.01, 0.01).ravel()
    direction, middle = np.array(line, np.float64).reshape(2, 2)
    # Direct the line along the contour, with the solid on its right.
    if direction @ (last - first) < 0:
        direction = -direction
    out = np.array([direction[1], -direction[0]])
    if np.sqrt((((points - middle) @ out) ** 2).mean()) > LIMITS.roughness:
        return None
    start = middle + direction * ((first - middle) @ direction) + 0.5 * out
    end = middle + direction * ((last - middle) @ direction) + 0.5 * out
    return Edge(start, end)


def _plane(edge: Edge, section: Section, normals: F32) -> Edge | None:
    """Return the edge with its plane, or None without a plane or if it is nearer than
    all objects.
    """
    height, width = section.solid.shape
    best = replace(edge, plane=LIMITS.flatness)
    share = np.linspace(0.1, 0.9, max(int(edge.length), 2))[:, None]
    for way in LIMITS.strip:
        points = edge.start + share * (edge.end - edge.start) - way * edge.out
        columns, rows = np.rint(points).astype(np.int64).T
        pixels = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        use = section.visible_mask[pixels] & section.solid[pixels]
        if use.sum() < 5 or np.median(section.depth[pixels][use]) < section.nearest:
            continue
        mean = normals[pixels][use].mean(0).astype(np.float64)
        if (length := float(np.linalg.norm(mean))) >= best.plane:
            best = replace(edge, plane=length, facing=mean / length)
    if best.facing is not None:
        return best
    return None


# Floors.


def is_floor_edge(section: Section, edge: Edge, wall: Wall) -> bool:
    """Return whether an edge is a piece of a floor or its continuation."""
    (x0, y0), (x1, y1) = edge.start, edge.end
    distances = np.abs(np.interp([x0, x1], *np.array(wall.points).T) - [y0, y1])
    return bool(
        edge.out[1] < -0.5 and distances.max() <= LIMITS.floor_distance * section.size
    )


def solid_reach(
    section: Section, line: Line, group: Sequence[Foot]
) -> tuple[float, float] | None:
    """Return the ends of the floor under a group, or None without solid matter under
    it.

    An end is the first gap without solid matter; without a gap the floor ends outside
    the photo.
    """
    width = section.solid.shape[1]
    columns = np.arange(width)
    empty, solid = _test_matter_below(section, line)
    boxes = np.array([bounds(foot.item.outline) for foot in group])
    first = boxes[:, 0].min()
    last = boxes[:, 2].max()
    margin = int(max(LIMITS.gap * section.size, 1))
    near_feet = (columns >= first - margin) & (columns <= last + margin)
    if not near_feet.any() or solid[near_feet].mean() < LIMITS.solid_share:
        return None
    holes = np.flatnonzero(np.convolve(empty, np.ones(margin), "valid") >= margin)
    left = holes[holes + margin <= first]
    right = holes[holes >= last]
    if len(left):
        start = float(left.max() + margin) - 0.5
    else:
        start = -float(width)
    if len(right):
        end = float(right.min()) - 0.5
    else:
        end = 2.0 * width
    return start, end


def _test_matter_below(section: Section, line: Line) -> tuple[Mask, Mask]:
    """Return whether each column (W,) below a line is empty, and whether it is solid."""
    height, width = section.solid.shape
    columns = np.arange(width)
    empty = np.ones(width, bool)
    solid = np.ones(width, bool)
    for down in LIMITS.floor_depths:
        rows = np.rint(line.slope * columns + line.height).astype(int) + down
        inside = (rows >= 0) & (rows < height)
        pixels = np.clip(rows, 0, height - 1), columns
        is_visible = section.visible_mask[pixels]
        is_solid = section.solid[pixels]
        empty &= ~inside | (is_visible & ~is_solid)
        solid &= is_solid | ~is_visible
    return empty, solid
