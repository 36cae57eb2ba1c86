"""Contacts at internal edges: their normals point into the continued surface.

An object that slides from one block or segment to the next first touches the side of
the next one, which the engine takes for a wall (Box2D's ghost collisions). Such a side
is covered: the surface continues along the normal, and no shape rises above it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, hypot, inf, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Spot = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right and bottom, px."""


@dataclass(frozen=True)
class EdgeTolerance:
    """Tolerances, px and cosines, within which two surfaces are one."""

    level: float = 0.02
    """Difference of height of two surfaces, px: four times the overlap of a resting
    contact.
    """
    rise: float = 0.06
    """Height over the surface, px, at which a rising shape is searched for."""
    depth: float = 1.0
    """Depth under the surface, px, of a contact of a body that lands beside a seam."""
    gap: float = 0.5
    """Gap between the ends of two surfaces, px; as of walls in `space`."""
    slope: float = 0.01
    """Cosine of normal and surface up to which the normal does not point into the
    surface.
    """
    slope_of_circles: float = 1e-6
    """The same for a circle, which touches the next surface along a slowly turning
    normal.
    """


TOLERANCE = EdgeTolerance()
ABOVE, BELOW = TOLERANCE.rise, TOLERANCE.depth
LEVEL, GAP = TOLERANCE.level, TOLERANCE.gap
# Module variables are faster than attributes, and these are read for each edge and
# point of each step.
ROUNDING = 1e-9
"""Difference, px, beyond that of two ways to compute a distance."""


@dataclass(frozen=True)
class ShapeOutline:
    """A shape of the engine."""

    owner: int
    """Index of the body, or the number of bodies plus the index of the wall."""
    is_static: bool
    corners: tuple[Spot, ...]
    """Corners in the owner's frame, px: two of a segment, none of a circle."""
    center: Spot
    """Centre of a circle around the corners, in the owner's frame, px."""
    reach: float
    """Radius of that circle, px."""


class Edge(NamedTuple):
    """One side of a shape, in the frame of its owner or, of a static shape, of the
    world.
    """

    x: float
    y: float
    dx: float
    dy: float
    length: float
    """Length, px, from x, y along dx, dy; the outer side of a polygon is along
    dy, -dx.
    """
    is_segment: bool
    owner: int

    @property
    def ends(self) -> tuple[Spot, Spot]:
        """Return both ends, px."""
        end = self.x + self.length * self.dx, self.y + self.length * self.dy
        return (self.x, self.y), end


class Contact(NamedTuple):
    """The contact of two shapes, in one frame."""

    normal: Spot
    """Unit vector from the first shape to the second."""
    points: Sequence[Spot]
    center: Spot = (0.0, 0.0)
    """Centre of the shape on the surface."""

    def reversed(self) -> Contact:
        """Return the contact of the second with the first."""
        return Contact((-self.normal[0], -self.normal[1]), self.points)


class Frame:
    """The pose of an owner as a coordinate frame."""

    __slots__ = ("cosine", "sine", "x", "y")

    def __init__(self, x: float, y: float, angle: float) -> None:
        self.x, self.y, self.cosine, self.sine = x, y, cos(angle), sin(angle)

    def place(self, point: Spot) -> Spot:
        """Transform a point of the owner to the world, px."""
        return (
            self.x + self.cosine * point[0] - self.sine * point[1],
            self.y + self.sine * point[0] + self.cosine * point[1],
        )

    def locate(self, point: Spot) -> Spot:
        """Transform a point of the world to this frame."""
        x = point[0] - self.x
        y = point[1] - self.y
        return self.cosine * x + self.sine * y, self.cosine * y - self.sine * x

    def locate_contact(self, contact: Contact) -> Contact:
        """Transform a contact of the world to this frame."""
        # This runs for most contacts of each step: a call for each point takes twice as
        # long.
        (nx, ny), points, (center_x, center_y) = contact
        x0, y0, c, s = self.x, self.y, self.cosine, self.sine
        local_points = []
        for px, py in points:
            x = px - x0
            y = py - y0
            local_points.append((c * x + s * y, c * y - s * x))
        x = center_x - x0
        y = center_y - y0
        center = c * x + s * y, c * y - s * x
        return Contact((c * nx + s * ny, c * ny - s * nx), local_points, center)


WORLD = Frame(0.0, 0.0, 0.0)


class Frames:
    """The frames of all owners, computed at first use."""

    def __init__(self, poses: Sequence[Sequence[float]]) -> None:
        """Store the poses: px, px, rad."""
        self.poses = poses
        self._known: dict[int, Frame] = {}

    def of(self, owner: int) -> Frame:
        """Return the frame of an owner."""
        frame = self._known.get(owner)
        if frame is None:
            frame = self._known[owner] = Frame(*self.poses[owner])
        return frame


def edges_of(outline: ShapeOutline, frame: Frame = WORLD) -> list[Edge]:
    """Return the edges of a shape with the corners in this frame."""
    corners = [frame.place(corner) for corner in outline.corners]
    # A segment has one edge and two sides; the outline of a polygon is closed.
    if len(corners) == 2:
        following = corners[1:]
    else:
        following = [*corners[1:], *corners[:1]]
    edges = []
    for (x0, y0), (x1, y1) in zip(corners, following, strict=False):
        length = hypot(x1 - x0, y1 - y0)
        # An edge of no length has no direction, and covers nothing.
        if length > 0:
            dx = (x1 - x0) / length
            dy = (y1 - y0) / length
            edges.append(Edge(x0, y0, dx, dy, length, len(corners) == 2, outline.owner))
    return edges


STILL = 1e-4
"""Distance, px, within which a contact at an internal edge stays one."""
MOST_LISTED = 8
"""Number of edges of an owner up to which a loop takes less time than a grid."""
CELL = 8.0
"""Width of a cell of the grid of edges, px: few edges are in one cell."""
MOST_CELLS = 400
"""Number of cells above which an edge is in none: those of 150 px at 45 degrees."""
LEEWAY = 0.05
"""Distance, px, by which the quick check covers more contacts."""
NEAREST, FARTHEST = ABOVE - LEEWAY, GAP + LEEWAY
LOWEST, HIGHEST = BELOW + LEEWAY, LEVEL + LEEWAY
NEIGHBOURS = 2.0
"""Largest distance of surfaces from a shape that they continue, px."""


class Cover:
    """The points of a contact covered by edges of third shapes."""

    __slots__ = (
        "_contact", "_exceptions", "_frame", "_shape", "_sides", "_slope", "_surface",
        "edges", "is_covered", "room",
    )  # fmt: skip

    def __init__(
        self,
        shape: ShapeOutline,
        surface: ShapeOutline,
        frame: Frame,
        contact: Contact,
        exceptions: Collection[tuple[int, int]],
        sides: Sequence[Edge],
    ) -> None:
        """Begin with uncovered points.

        `frame`: of the owner of `surface`. The normal of the contact points from
        `surface` to `shape`. `exceptions`: pairs of owners, in both orders, that do not
        collide. `sides`: the edges of `surface` in its owner's frame.
        """
        self._sides = sides
        self._shape, self._surface, self._frame = shape, surface, frame
        self._contact, self._exceptions = contact, exceptions
        self._slope = TOLERANCE.slope_of_circles
        if shape.corners:
            self._slope = TOLERANCE.slope
        self.is_covered = [False] * len(contact.points)
        self.edges: list[Edge] = []
        """Edges over a covered point."""
        self.room = inf
        """Smallest cosine between the normal and an edge of the continued surface."""

    @property
    def is_whole(self) -> bool:
        """Check whether all points are covered."""
        return False not in self.is_covered

    def extend(self, place: Frame, edges: Sequence[Edge]) -> None:
        """Cover further points by edges in a frame."""
        contact = self._contact
        if place is not WORLD:
            contact = place.locate_contact(contact)
        (nx, ny), points, _ = contact
        is_covered = self.is_covered
        slope = self._slope
        for edge in edges:
            # A normal across the edge is that of the edge itself. Only a normal with a
            # part along the edge can come from the hidden end of the neighbour.
            cosine = abs(nx * edge[2] + ny * edge[3])
            if cosine <= slope:
                continue
            for k, point in enumerate(points):
                if is_covered[k]:
                    continue
                # The order of tests is from cheap to expensive: the place over the
                # edge, then the exceptions, and at last the distance to the whole
                # surface.
                spot = _spot_over(edge, contact, point)
                if spot is None or self._passes_through(edge.owner):
                    continue
                # A normal that points hardly along the edge soon no longer does: its
                # pair may move less before the next test.
                self.room = min(self.room, cosine)
                # The surface of the contact must not rise above the edge at this place.
                # A step upwards is a real obstacle, which stops the shape.
                spot = self._frame.locate(place.place(spot))
                is_covered[k] = _is_outside(self._sides, self._surface.corners, spot)
                if is_covered[k]:
                    self.edges.append(edge)

    def _passes_through(self, owner: int) -> bool:
        """Check whether the shape belongs to an owner, or does not collide with it."""
        own = self._shape.owner
        return own == owner or (own, owner) in self._exceptions


class EdgeSet:
    """Edges in one frame, for a quick look at which may continue a surface."""

    __slots__ = ("_cells", "_long_edges", "edges")

    def __init__(self, edges: list[Edge]) -> None:
        """Sort many edges into the cells of a grid."""
        self.edges = edges
        self._long_edges: list[Edge] = edges
        """Edges that no cell contains."""
        self._cells: dict[tuple[int, int], list[Edge]] = {}
        # The outline of a photo's object has hundreds of edges, of which a few are near
        # a contact.
        if len(edges) > MOST_LISTED:
            self._long_edges = [edge for edge in edges if not self._sort_in(edge)]

    def _sort_in(self, edge: Edge) -> bool:
        """Add an edge to the cells near it; return False if these are too many."""
        (x0, y0), (x1, y1) = edge.ends
        columns = _cells_between(x0, x1)
        rows = _cells_between(y0, y1)
        if len(columns) * len(rows) > MOST_CELLS:
            return False
        for column in columns:
            for row in rows:
                self._cells.setdefault((column, row), []).append(edge)
        return True

    def may_continue(self, frame: Frame, contact: Contact, slope: float) -> bool:
        """Return whether an edge in a frame may cover a contact, whose normal is from the surface.

        As `_spot_over` decides, with some leeway.
        """
        if frame is not WORLD:
            contact = frame.locate_contact(contact)
        normal, points, _ = contact
        # Edges across many cells are in none of them, and are tested for every point.
        for point in points:
            if self._cells:
                cell = int(point[0] // CELL), int(point[1] // CELL)
                nearby_edges = self._cells.get(cell)
                if nearby_edges and _may_one_cover(nearby_edges, normal, point, slope):
                    return True
            if _may_one_cover(self._long_edges, normal, point, slope):
                return True
        return False


def _may_one_cover(
    edges: Sequence[Edge], normal: Spot, point: Spot, slope: float
) -> bool:
    """Check whether one of these edges may cover a point of a contact."""
    nx, ny = normal
    px, py = point
    for x, y, dx, dy, length, is_segment, _ in edges:
        # A normal along the edge cannot come from the edge itself: the edge covers the
        # point.
        into = nx * dx + ny * dy
        if -slope <= into <= slope:
            continue
        # Measure from the end of the edge that the normal points away from: the seam
        # with the other shape is there.
        ahead = (px - x) * dx + (py - y) * dy
        if into > 0:
            ahead = length - ahead
        if NEAREST < ahead < length + FARTHEST:
            if is_segment:
                highest = LOWEST
            else:
                highest = HIGHEST
            # The height over the edge is positive outside a polygon. A segment has no
            # inside, and covers points on both sides of it.
            height = (px - x) * dy - (py - y) * dx
            if -LOWEST < height < highest:
                return True
    return False


def _cells_between(start: float, end: float) -> range:
    """Return the numbers of the grid's cells along one axis near an edge."""
    # Farther away from an edge in height and along it, no contact is covered.
    reach = LOWEST + FARTHEST
    first = (min(start, end) - reach) // CELL
    last = (max(start, end) + reach) // CELL
    return range(int(first), int(last) + 1)


class InternalEdges:
    """Finds contacts at internal edges, by the shapes of a world."""

    def __init__(
        self,
        outlines: Sequence[ShapeOutline],
        separate_pairs: frozenset[tuple[int, int]],
    ) -> None:
        """Index the shapes; `separate_pairs`: pairs of owners, in both orders, that do
        not collide.
        """
        self._outlines = outlines
        self._apart = set(separate_pairs)
        self._edges = [edges_of(outline) for outline in outlines]
        self._boxes = [_box_around(outline.corners) for outline in outlines]
        """Around what is near a shape, in the frame of its owner."""
        # Circles have no edges that could continue a surface.
        self._of_owner: dict[int, list[int]] = {}
        for k, outline in enumerate(outlines):
            if outline.corners:
                self._of_owner.setdefault(outline.owner, []).append(k)
        self._reach_of_owner: dict[int, float] = {}
        """Radius, px, of a circle around all edges near an owner's shapes."""
        for owner, shapes in self._of_owner.items():
            reaches = [hypot(*outlines[k].center) + outlines[k].reach for k in shapes]
            self._reach_of_owner[owner] = max(reaches) + 2 * NEIGHBOURS
        self._static = {outline.owner for outline in outlines if outline.is_static}
        self._every_edge: dict[int, EdgeSet] = {}
        self._seams: dict[int, EdgeSet] = {}
        """Edges that may continue a shape of an owner, in the frame of the owner or, of a
        static one, of the world."""
        self._placed: dict[int, tuple[list[Spot], Box, list[Edge]]] = {}
        """Corners of static shapes, boxes around them and edges, in the frame of the world."""
        self._static_edges: dict[int, list[Edge]] = {}
        """Placed edges of static shapes near a static shape."""
        self._own_edges: dict[int, list[Edge]] = {}
        """Edges near a shape of other shapes of its owner, in the owner's frame."""
        self._covering: dict[tuple[int, int], list[Edge]] = {}
        """Edges beside the second shape, which covered its last contact with
        the first.
        """

    def unite(self, first: int, second: int) -> None:
        """Let two owners collide from now on, after their joint broke."""
        self._apart -= {(first, second), (second, first)}

    def may_cover(
        self,
        frames: Frames,
        pair: tuple[int, int],
        partners: Mapping[int, Collection[int]],
        contact: Contact,
    ) -> bool:
        """Return whether a contact of two owners may be at an internal edge.

        A quick look: most contacts have no third surface near them.
        """
        of_owner = self._of_owner
        count = (pair[0] in of_owner) + (pair[1] in of_owner)
        if not count:
            return False  # two circles
        if count == 2:
            slope = TOLERANCE.slope
        else:
            slope = TOLERANCE.slope_of_circles
        # the normal goes from the first to the second
        sides = (pair[0], pair[1], contact), (pair[1], pair[0], contact.reversed())
        for surface, own, touch in sides:
            if surface not in of_owner:
                continue
            # First the other pieces of the same surface: they are known once and for
            # all. Circles on a moving body are left out, as in `_nearby_edges`.
            is_static = surface in self._static
            if is_static or count == 2:
                seams = self._seams_of(surface, frames)
                if is_static:
                    frame = WORLD
                else:
                    frame = frames.of(surface)
                if seams.edges and seams.may_continue(frame, touch, slope):
                    return True
            # Then the other bodies that the shape touches at present, such as the next
            # one of two equal boxes in a row.
            thirds = partners.get(own, ())
            if own in self._static:  # much touches a floor
                thirds = set(thirds).intersection(partners.get(surface, ()))
            for third in thirds:
                if third == surface or third not in of_owner:
                    continue
                edges = self._edges_of_owner(third)
                if edges.may_continue(frames.of(third), touch, slope):
                    return True
        return False

    def _edges_of_owner(self, owner: int) -> EdgeSet:
        """Return all edges of an owner in its frame."""
        if owner not in self._every_edge:
            shapes = self._of_owner[owner]
            edges = [edge for k in shapes for edge in self._edges[k]]
            self._every_edge[owner] = EdgeSet(edges)
        return self._every_edge[owner]

    def _seams_of(self, owner: int, frames: Frames) -> EdgeSet:
        """Return the edges that may continue one of an owner's shapes."""
        if owner not in self._seams:
            edges: dict[Edge, None] = {}
            for k in self._of_owner[owner]:
                if self._outlines[k].is_static:
                    beside = self._edges_beside_static(k, frames)
                else:
                    beside = self._edges_beside(k)
                edges |= dict.fromkeys(beside)
            self._seams[owner] = EdgeSet(list(edges))
        return self._seams[owner]

    def room(
        self,
        frames: Frames,
        shapes: tuple[int, int],
        partners: Mapping[int, Collection[int]],
        contact: Contact,
    ) -> float:
        """Return the distance, px, that a contact at an internal edge may move; 0 if it
        is real.

        Within this distance the contact stays at the internal edge. Its normal points
        from the first to the second shape. `partners`: the touched owners of each
        owner.
        """
        first, second = shapes
        # Most contacts stay covered by the edges that covered them before: test these
        # first.
        if self._is_covered_contact(frames, (second, first), contact):
            return STILL
        reversed_contact = contact.reversed()
        if self._is_covered_contact(frames, shapes, reversed_contact):
            return STILL
        # Either of the two shapes may be the surface with the internal edge.
        return self._room(frames, second, first, partners, contact) or self._room(
            frames, first, second, partners, reversed_contact
        )

    def _is_covered_contact(
        self, frames: Frames, pair: tuple[int, int], contact: Contact
    ) -> bool:
        """Check whether the edges that covered a contact before still cover it.

        These are the edges in `_covering`; the shapes are no circles. The normal points
        from the second shape of the pair to the first.
        """
        edges = self._covering.get(pair)
        if edges is None:
            return False
        shape = self._outlines[pair[0]]
        surface = self._outlines[pair[1]]
        frame = frames.of(surface.owner)
        if surface.is_static:
            place = WORLD
        else:
            place = frame
        center = frames.of(shape.owner).place(shape.center)
        local_contact = Contact(contact.normal, contact.points, center)
        if place is not WORLD:
            local_contact = place.locate_contact(local_contact)
        (nx, ny), points, _ = local_contact
        # An edge covers only contacts whose normal points along it, into the next
        # surface.
        if shape.corners:
            smallest_cosine = TOLERANCE.slope
        else:
            smallest_cosine = TOLERANCE.slope_of_circles
        sides = self._edges[pair[1]]
        corners = surface.corners
        # For each point there must be an edge over which the next surface does not
        # rise.
        for point in points:
            for edge in edges:
                if abs(nx * edge[2] + ny * edge[3]) <= smallest_cosine:
                    continue
                spot = _spot_over(edge, local_contact, point)
                if spot is None:
                    continue
                if _is_outside(sides, corners, frame.locate(place.place(spot))):
                    break
            else:
                return False
        return True

    def _begin_cover(
        self, frames: Frames, pair: tuple[int, int], contact: Contact
    ) -> Cover:
        """Return the empty cover of a contact between two shapes.

        The normal points from the second shape to the first.
        """
        shape = self._outlines[pair[0]]
        surface = self._outlines[pair[1]]
        center = frames.of(shape.owner).place(shape.center)
        centred_contact = Contact(contact.normal, contact.points, center)
        frame = frames.of(surface.owner)
        sides = self._edges[pair[1]]
        return Cover(shape, surface, frame, centred_contact, self._apart, sides)

    def _room(
        self,
        frames: Frames,
        own_shape: int,
        other: int,
        partners: Mapping[int, Collection[int]],
        contact: Contact,
    ) -> float:
        """Return `room` of a contact with its normal from `other` to `own_shape`.

        The contact is at an internal edge if third shapes cover all its points.
        """
        shape = self._outlines[own_shape]
        surface = self._outlines[other]
        if not surface.corners:
            return 0.0
        cover: Cover | None = None
        nearby_edges = self._nearby_edges(
            frames, own_shape, other, partners, contact.points
        )
        for order, (place, edges) in enumerate(nearby_edges):
            if not edges:
                continue
            if cover is None:
                cover = self._begin_cover(frames, (own_shape, other), contact)
            cover.extend(place, edges)
            if not cover.is_whole:
                continue
            if shape.corners:
                # The edges beside the other shape never change: remember them.
                if order == 0:
                    self._covering[own_shape, other] = cover.edges
                return STILL
            # The normal of a circle turns while it moves, other normals change at once.
            return STILL + cover.room * shape.reach / 4
        return 0.0

    def _nearby_edges(
        self,
        frames: Frames,
        shape: int,
        other: int,
        partners: Mapping[int, Collection[int]],
        points: Sequence[Spot],
    ) -> Iterator[tuple[Frame, Sequence[Edge]]]:
        """Yield the edges near points that may continue the other shape, with their
        frames.
        """
        owner = self._outlines[shape].owner
        other_owner = self._outlines[other].owner
        is_static = self._outlines[other].is_static
        if is_static:
            yield WORLD, self._edges_beside_static(other, frames)
        elif self._outlines[shape].corners:
            # Circles are left out: one crosses the seams of a body's pieces with a loss
            # below 0.2 px/s, and bowls have many pieces.
            yield frames.of(other_owner), self._edges_beside(other)
        third_owners = partners.get(owner, ())
        # A floor has many partners: only those of both owners can be at the contact.
        if self._outlines[shape].is_static:
            third_owners = set(third_owners).intersection(partners.get(other_owner, ()))
        for third_owner in third_owners:
            shapes = self._of_owner.get(third_owner, ())
            if third_owner == other_owner or not shapes:
                continue
            if is_static and self._outlines[shapes[0]].is_static:
                continue
            # Circles and boxes around the third owner exclude most shapes before any
            # edge is read.
            frame = frames.of(third_owner)
            x, y = frame.locate(points[0])
            if hypot(x, y) >= self._reach_of_owner[third_owner]:
                continue
            spots = [(x, y), *map(frame.locate, points[1:])]
            edges: list[Edge] = []
            for k in shapes:
                if not _is_in_box(self._boxes[k], spots):
                    continue
                outline = self._outlines[k]
                reach = outline.reach + NEIGHBOURS
                if hypot(x - outline.center[0], y - outline.center[1]) < reach:
                    edges += self._edges[k]
            if edges:
                yield frame, edges

    def _edges_beside_static(self, shape: int, frames: Frames) -> list[Edge]:
        """Return the edges near a static shape, of other static shapes, in the world's
        frame.
        """
        # Static shapes never move: find their neighbours once.
        if not self._placed:
            for k, outline in enumerate(self._outlines):
                if outline.is_static and outline.corners:
                    frame = frames.of(outline.owner)
                    corners = [frame.place(corner) for corner in outline.corners]
                    box = _box_around(corners)
                    self._placed[k] = corners, box, edges_of(outline, frame)
        if shape not in self._static_edges:
            # Boxes of shapes that do not meet exclude most pairs before distances are
            # computed.
            corners, box, _ = self._placed[shape]
            self._static_edges[shape] = [
                edge
                for k, (_, other, edges) in self._placed.items()
                if k != shape and _do_meet(box, other)
                for edge in edges
                if _is_beside_shape(edge, corners)
            ]
        return self._static_edges[shape]

    def _edges_beside(self, shape: int) -> list[Edge]:
        """Return the edges near a shape of other shapes of its owner, in the owner's
        frame.
        """
        if shape not in self._own_edges:
            outline = self._outlines[shape]
            self._own_edges[shape] = [
                edge
                for k in self._of_owner[outline.owner]
                if k != shape
                and _do_meet(self._boxes[k], self._boxes[shape])
                and self._have_near_circles(k, shape)
                for edge in self._edges[k]
                if _is_beside_shape(edge, outline.corners)
            ]
        return self._own_edges[shape]

    def _have_near_circles(self, shape: int, other: int) -> bool:
        """Check whether circles around two shapes of one owner are near each other."""
        a = self._outlines[shape]
        b = self._outlines[other]
        distance = hypot(a.center[0] - b.center[0], a.center[1] - b.center[1])
        return distance < a.reach + b.reach + NEIGHBOURS


@lru_cache(maxsize=4)
def internal_edges(
    outlines: tuple[ShapeOutline, ...],
    exceptions: frozenset[tuple[int, int]],
    poses: tuple[tuple[float, ...], ...],
) -> InternalEdges:
    """Return the `InternalEdges` of a world, shared by all runs from the same poses of
    owners.

    They remember which edges are neighbours, which does not change any result.
    """
    return InternalEdges(outlines, exceptions)


def _is_in_box(box: Box, spots: Sequence[Spot]) -> bool:
    """Return whether one of these places is within a box."""
    left, top, right, bottom = box
    for x, y in spots:  # noqa: SIM110 - a generator takes twice as long
        if left < x < right and top < y < bottom:
            return True
    return False


def _do_meet(box: Box, other: Box) -> bool:
    """Return whether two boxes overlap."""
    return (
        box[0] <= other[2]
        and other[0] <= box[2]
        and box[1] <= other[3]
        and other[1] <= box[3]
    )


def _box_around(corners: Sequence[Spot]) -> Box:
    """Return the box around what is near corners."""
    xs = [x for x, _ in corners]
    ys = [y for _, y in corners]
    left = min(xs, default=0.0)
    top = min(ys, default=0.0)
    right = max(xs, default=0.0)
    bottom = max(ys, default=0.0)
    margin = NEIGHBOURS
    return left - margin, top - margin, right + margin, bottom + margin


def _is_beside_shape(edge: Edge, corners: Sequence[Spot]) -> bool:
    """Check whether an end of an edge is near a shape, or a corner of the shape near
    the edge.
    """
    # Convex shapes that do not overlap are nearest at a corner of one of them, so that
    # distances of ends and corners suffice.
    ends = edge.ends
    if _has_gap(ends, corners, 0) or _has_gap(ends, corners, 1):
        return False
    return any(_distance(corners, end) < NEIGHBOURS for end in ends) or any(
        _distance(ends, corner) < NEIGHBOURS for corner in corners
    )


def _has_gap(ends: Sequence[Spot], corners: Sequence[Spot], axis: int) -> bool:
    """Check whether the gap between an edge and a shape along an axis is too large."""
    low = ends[0][axis]
    high = ends[1][axis]
    if low > high:
        low, high = high, low
    # The shape is beyond the edge if all of its corners lie on one side, farther away
    # than neighbours may be.
    before, behind = low - NEIGHBOURS, high + NEIGHBOURS
    is_below = is_above = True
    for corner in corners:
        place = corner[axis]
        if place >= before:
            is_below = False
        if place <= behind:
            is_above = False
    return is_below or is_above


def _spot_over(edge: Edge, contact: Contact, point: Spot) -> Spot | None:
    """Return the place over an edge that must be free if the edge continues the
    surface.

    The place is above a point of a contact. None if the edge does not continue the
    surface.
    """
    x, y, dx, dy, length, is_segment, _ = edge
    # Coordinates along the edge (d) and away from it (u), from the beginning of the
    # edge.
    px = point[0] - x
    py = point[1] - y
    ux, uy = dy, -dx
    # A segment has two outer sides, a polygon one.
    if (contact[2][0] - x) * ux + (contact[2][1] - y) * uy < 0:
        if not is_segment:
            return None
        ux, uy = -ux, -uy
    # A contact may be deep under the edge if a body lands beside the seam. Far above
    # the edge, it belongs to another surface.
    height = px * ux + py * uy
    if not -BELOW <= height <= LEVEL:
        return None
    # The normal must point from the seam along the edge: measure the length that
    # remains in its direction, and accept a small gap between the two surfaces.
    remaining_length = px * dx + py * dy
    if contact[0][0] * dx + contact[0][1] * dy > 0:
        remaining_length = length - remaining_length
    if not ABOVE < remaining_length <= length + GAP:
        return None
    # Move the point to a fixed height over the edge: there the caller tests for a step.
    lift = ABOVE - height
    return point[0] + lift * ux, point[1] + lift * uy


def _is_outside(sides: Sequence[Edge], corners: Sequence[Spot], spot: Spot) -> bool:
    """Check whether a convex shape does not reach a place above a surface.

    `sides` are its edges and `corners` its corners, in the frame of the place.
    """
    x, y = spot
    smallest_distance = ABOVE - LEVEL
    # In most cases the place is far outside one side, which decides at once.
    for side in sides:
        if (x - side[0]) * side[3] - (y - side[1]) * side[
            2
        ] > smallest_distance + ROUNDING:
            return True
    return _distance(corners, spot) >= smallest_distance


def _distance(corners: Sequence[Spot], point: Spot) -> float:
    """Return the distance from a point to a segment or a convex polygon, px; 0
    inside.
    """
    nearest = inf
    is_inside = len(corners) > 2
    px, py = point
    x0, y0 = corners[-1]
    # Inside a clockwise polygon a point is on the same side of all edges. Outside, the
    # nearest point of each edge is its projection, cut off at both ends.
    for x1, y1 in corners:
        ex, ey = x1 - x0, y1 - y0
        wx, wy = px - x0, py - y0
        if wx * ey - wy * ex > 0:
            is_inside = False
        square = ex * ex + ey * ey
        parameter = 0.0
        if square > 1e-300:
            parameter = (wx * ex + wy * ey) / square
        if parameter < 0.0:
            parameter = 0.0
        elif parameter > 1.0:
            parameter = 1.0
        distance = hypot(wx - parameter * ex, wy - parameter * ey)
        if distance < nearest:
            nearest = distance
        x0, y0 = x1, y1
    if is_inside:
        return 0.0
    return nearest
