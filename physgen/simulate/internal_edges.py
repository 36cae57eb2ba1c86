"""Contacts at internal edges: their normals point into a surface that continues.

What slides from one block or segment to the next one first touches the side of the next one,
which the engine takes for a wall (Box2D's ghost collisions). Such a side is covered: the
surface goes on along the normal, and nothing rises above it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, sin
from typing import NamedTuple

Spot = tuple[float, float]


@dataclass(frozen=True)
class EdgeTolerance:
    """Lengths in px and cosines by which surfaces are one."""

    level: float = 0.02
    """px that two surfaces may differ in height: four times the overlap of a resting contact."""
    above: float = 0.06
    """px over the surface at which a shape that rises above it is looked for."""
    below: float = 1.0
    """px under the surface that a contact may be, of what lands beside a seam."""
    gap: float = 0.5
    """px between the ends of two surfaces that are one; as of walls in `space`."""
    slope: float = 0.01
    """Cosine between a normal and a surface up to which it does not point into the surface."""
    slope_of_circles: float = 1e-6
    """A circle touches the next surface along a normal that turns slowly."""


TOLERANCE = EdgeTolerance()


@dataclass(frozen=True)
class ShapeOutline:
    """A shape of the engine."""

    owner: int
    """Its body, or the number of bodies plus the index of its wall."""
    is_static: bool
    corners: tuple[Spot, ...]
    """In the frame of its owner, px: two of a segment, none of a circle."""
    center: Spot
    """Of a circle around the corners, in the frame of its owner, px."""
    reach: float
    """px: radius of that circle."""


class Edge(NamedTuple):
    """One side of a shape, in the frame of its owner or, of a static one, of the world."""

    x: float
    y: float
    dx: float
    dy: float
    length: float
    """px, from x, y along dx, dy; the side of a polygon that is outside is along dy, -dx."""
    is_segment: bool
    owner: int

    @property
    def ends(self) -> tuple[Spot, Spot]:
        """Both ends, px."""
        end = self.x + self.length * self.dx, self.y + self.length * self.dy
        return (self.x, self.y), end


class Contact(NamedTuple):
    """Where two shapes touch, in one frame."""

    normal: Spot
    """From the one to the other."""
    points: Sequence[Spot]
    center: Spot = (0.0, 0.0)
    """Of what is on the surface."""

    def reversed(self) -> Contact:
        """Return the contact of the second with the first."""
        return Contact((-self.normal[0], -self.normal[1]), self.points)


class Frame:
    """Pose of an owner."""

    __slots__ = ("cosine", "sine", "x", "y")

    def __init__(self, x: float, y: float, angle: float) -> None:
        self.x, self.y, self.cosine, self.sine = x, y, cos(angle), sin(angle)

    def place(self, point: Spot) -> Spot:
        """Return where a point of the owner is, px."""
        return (
            self.x + self.cosine * point[0] - self.sine * point[1],
            self.y + self.sine * point[0] + self.cosine * point[1],
        )

    def locate(self, point: Spot) -> Spot:
        """Return a point of the world in this frame."""
        x, y = point[0] - self.x, point[1] - self.y
        return self.cosine * x + self.sine * y, self.cosine * y - self.sine * x

    def locate_contact(self, contact: Contact) -> Contact:
        """Return a contact of the world in this frame."""
        (nx, ny), c, s = contact.normal, self.cosine, self.sine
        points = [self.locate(point) for point in contact.points]
        normal = c * nx + s * ny, c * ny - s * nx
        return Contact(normal, points, self.locate(contact.center))


WORLD = Frame(0.0, 0.0, 0.0)


class Frames:
    """Poses of all owners; each is looked up when it is needed."""

    def __init__(self, poses: Sequence[Sequence[float]]) -> None:
        """poses: px, px, rad."""
        self.poses = poses
        self._known: dict[int, Frame] = {}

    def of(self, owner: int) -> Frame:
        """Return the frame of an owner."""
        if owner not in self._known:
            self._known[owner] = Frame(*self.poses[owner])
        return self._known[owner]


def edges_of(outline: ShapeOutline, frame: Frame = WORLD) -> list[Edge]:
    """Return the edges of a shape with the corners in this frame."""
    corners = [frame.place(corner) for corner in outline.corners]
    following = corners[1:] if len(corners) == 2 else (*corners[1:], *corners[:1])
    edges = []
    for (x0, y0), (x1, y1) in zip(corners, following, strict=False):
        length = hypot(x1 - x0, y1 - y0)
        if length > 0:
            dx, dy = (x1 - x0) / length, (y1 - y0) / length
            edges.append(Edge(x0, y0, dx, dy, length, len(corners) == 2, outline.owner))
    return edges


STILL = 1e-4
"""px within which a contact at an internal edge is not looked at again."""
NEIGHBOURS = 2.0
"""px around a shape, in which the surfaces lie that may continue it."""


class InternalEdges:
    """Finds contacts at internal edges, by the shapes of a world."""

    def __init__(
        self, outlines: Sequence[ShapeOutline], apart: frozenset[tuple[int, int]]
    ) -> None:
        """`apart`: pairs of owners, in both orders, that do not collide."""
        self._outlines = outlines
        self._apart = apart
        self._edges = [edges_of(outline) for outline in outlines]
        self._of_owner: dict[int, list[int]] = {}
        for k, outline in enumerate(outlines):
            if outline.corners:
                self._of_owner.setdefault(outline.owner, []).append(k)
        self._static_edges: dict[int, list[Edge]] = {}
        """Placed edges of static shapes near a static shape."""
        self._own_edges: dict[int, list[Edge]] = {}
        """Edges near a shape, of other shapes of its owner, in the frame of the owner."""

    def room(
        self,
        frames: Frames,
        shapes: tuple[int, int],
        partners: Mapping[int, Collection[int]],
        contact: Contact,
    ) -> float:
        """Return the px that two shapes may move before their contact at an internal edge becomes a real one.

        Return 0 if it is real. Its normal goes from the first to the second shape.
        partners: of each owner, the owners that it touches.
        """
        first, second = shapes
        return self._room(frames, second, first, partners, contact) or self._room(
            frames, first, second, partners, contact.reversed()
        )

    def _room(
        self,
        frames: Frames,
        own: int,
        other: int,
        partners: Mapping[int, Collection[int]],
        contact: Contact,
    ) -> float:
        """Return `room` of a contact whose normal goes from `other` to `own`.

        The contact is at an internal edge if a third shape covers its every point.
        """
        shape, beside = self._outlines[own], self._outlines[other]
        if not beside.corners:
            return 0.0
        slope = TOLERANCE.slope if shape.corners else TOLERANCE.slope_of_circles
        least = TOLERANCE.above - TOLERANCE.level
        frame = frames.of(beside.owner)
        center = frames.of(shape.owner).place(shape.center)
        contact = contact._replace(center=center)
        covered = [False] * len(contact.points)
        least_room = inf
        point = contact.points[0]
        for place, edges in self._nearby_edges(frames, own, other, partners, point):
            local = place.locate_contact(contact)
            nx, ny = local.normal
            for edge in edges:
                into = abs(nx * edge.dx + ny * edge.dy)
                if into <= slope:
                    continue
                if (
                    edge.owner == shape.owner
                    or (shape.owner, edge.owner) in self._apart
                ):
                    continue
                for k, point in enumerate(local.points):
                    if covered[k]:
                        continue
                    spot = _spot_over(edge, local, point)
                    if spot is None:
                        continue
                    over = frame.locate(place.place(spot))
                    covered[k] = _distance(beside.corners, over) >= least
                    least_room = min(least_room, into)
            if all(covered):
                # the normal of a circle turns as it moves, others change at once
                return STILL if shape.corners else STILL + least_room * shape.reach / 4
        return 0.0

    def _nearby_edges(
        self,
        frames: Frames,
        own: int,
        other: int,
        partners: Mapping[int, Collection[int]],
        point: Spot,
    ) -> Iterator[tuple[Frame, list[Edge]]]:
        """Yield edges near a point that may continue the other shape, with the frame that they are in."""
        owner, beside = self._outlines[own].owner, self._outlines[other].owner
        is_static = self._outlines[other].is_static
        if is_static:
            yield WORLD, self._edges_beside_static(other, frames)
        elif self._outlines[own].corners:
            # a circle crosses the seams of a body's pieces with less than 0.2 px/s of
            # loss, and pieces of bowls are many
            yield frames.of(beside), self._edges_beside(other)
        thirds = partners.get(owner, ())
        if self._outlines[own].is_static:  # much touches a floor
            thirds = set(thirds).intersection(partners.get(beside, ()))
        for third in thirds:
            shapes = self._of_owner.get(third, ())
            if third == beside or not shapes:
                continue
            if is_static and self._outlines[shapes[0]].is_static:
                continue
            frame = frames.of(third)
            x, y = frame.locate(point)
            edges: list[Edge] = []
            for k in shapes:
                outline = self._outlines[k]
                reach = outline.reach + NEIGHBOURS
                if hypot(x - outline.center[0], y - outline.center[1]) < reach:
                    edges += self._edges[k]
            yield frame, edges

    def _edges_beside_static(self, shape: int, frames: Frames) -> list[Edge]:
        """Return edges near a static shape, of other static shapes, in the frame of the world."""
        if shape not in self._static_edges:
            outline = self._outlines[shape]
            frame = frames.of(outline.owner)
            corners = [frame.place(corner) for corner in outline.corners]
            found = []
            for k, neighbour in enumerate(self._outlines):
                if k != shape and neighbour.is_static and neighbour.corners:
                    edges = edges_of(neighbour, frames.of(neighbour.owner))
                    found += [edge for edge in edges if _is_beside(edge, corners)]
            self._static_edges[shape] = found
        return self._static_edges[shape]

    def _edges_beside(self, shape: int) -> list[Edge]:
        """Return edges near a shape, of other shapes of its owner, in the frame of the owner."""
        if shape not in self._own_edges:
            outline = self._outlines[shape]
            self._own_edges[shape] = [
                edge
                for k in self._of_owner[outline.owner]
                if k != shape and self._are_near(k, shape)
                for edge in self._edges[k]
                if _is_beside(edge, outline.corners)
            ]
        return self._own_edges[shape]

    def _are_near(self, one: int, other: int) -> bool:
        """Return whether circles around two shapes of one owner are near each other."""
        a, b = self._outlines[one], self._outlines[other]
        apart = hypot(a.center[0] - b.center[0], a.center[1] - b.center[1])
        return apart < a.reach + b.reach + NEIGHBOURS


def _is_beside(edge: Edge, corners: Sequence[Spot]) -> bool:
    """Return whether an edge has an end near a shape, or a corner of the shape near it."""
    ends = edge.ends
    return any(_distance(corners, end) < NEIGHBOURS for end in ends) or any(
        _distance(ends, corner) < NEIGHBOURS for corner in corners
    )


def _spot_over(edge: Edge, contact: Contact, point: Spot) -> Spot | None:
    """Return the place over an edge at which nothing may rise if it continues the surface at a point of a contact.

    None if the edge does not continue the surface.
    """
    x, y, dx, dy, length, is_segment, _ = edge
    px, py = point[0] - x, point[1] - y
    along = px * dx + py * dy
    into = contact.normal[0] * dx + contact.normal[1] * dy
    ahead = length - along if into > 0 else along
    if not TOLERANCE.above < ahead <= length + TOLERANCE.gap:
        return None
    ux, uy = dy, -dx
    if (contact.center[0] - x) * ux + (contact.center[1] - y) * uy < 0:
        if not is_segment:
            return None
        ux, uy = -ux, -uy
    height = px * ux + py * uy
    if not -TOLERANCE.below <= height <= TOLERANCE.level:
        return None
    lift = TOLERANCE.above - height
    return point[0] + lift * ux, point[1] + lift * uy


def _distance(corners: Sequence[Spot], point: Spot) -> float:
    """Return the px from a point to a segment or a convex polygon; 0 inside."""
    nearest = float("inf")
    is_inside = len(corners) > 2
    px, py = point
    for (x0, y0), (x1, y1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        ex, ey = x1 - x0, y1 - y0
        square = ex * ex + ey * ey
        part = ((px - x0) * ex + (py - y0) * ey) / max(square, 1e-300)
        part = min(max(part, 0.0), 1.0)
        nearest = min(nearest, hypot(px - x0 - part * ex, py - y0 - part * ey))
        if (px - x0) * ey - (py - y0) * ex > 0:
            is_inside = False
    return 0.0 if is_inside else nearest
