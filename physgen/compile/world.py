"""The world for the engine, without paths and defaults; px, s, g, rad; image axes.

A body's frame has its origin at the centre of mass and the angle 0 at t = 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf, radians, sqrt
from typing import Generic, TypeVar

import numpy as np
import shapely

from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Pose,
    Region,
    Ring,
    mass_properties,
    rotation,
)
from physgen.materials import drawn_kinds
from physgen.scene.scene import (
    MAIN_GROUP,
    Auto,
    Boundary,
    Combine,
    FieldKind,
    JointKind,
    Load,
    Motion,
    Object,
    Profile,
    Scene,
    Solid,
    View,
)
from physgen.text import name_ranges


@dataclass(frozen=True)
class Surface:
    """Factors of the coefficients of a body or wall. The coefficient of a pair is the
    product of its two factors.

    The factor is the square root of the coefficient for `combine: geometric`, and the
    coefficient itself for `multiply`; see `compile.pairs`.
    """

    friction: float
    elasticity: float
    static_friction: float | None = None
    """Factor before sliding starts; None: as `friction`."""
    conveyor: float = 0.0
    """Speed of the surface around the body or wall, px/s, to the right on its top."""


EVERY_GROUP = 0xFFFFFFFF
"""Bits of all collision groups."""


@dataclass(frozen=True)
class Passage:
    """Collision groups and the one-way direction of a body or a wall."""

    group: int = 1
    """Bit of its own collision group."""
    collides_with: int = EVERY_GROUP
    """Bits of the groups for collisions."""
    one_way: tuple[float, float] | None = None
    """Direction in which others can pass."""


@dataclass(frozen=True)
class Wheel:
    """A wheel on a pin of its body."""

    axle: Array
    """(2,) px in the body's frame."""
    radius: float
    """px."""
    turns: bool = True
    """Whether the wheel is drawn turning."""


@dataclass(frozen=True)
class Body:
    """A rigid body."""

    name: str
    motion: Motion
    center: Array
    """(2,) px: centre of mass at t = 0."""
    mass: float
    """g."""
    moment: float
    """g·px², about the centre of mass."""
    radius: float | None
    """Radius of a circle, px; None for pieces."""
    pieces: tuple[Array, ...]
    """Convex pieces, each (K, 2) px in the body's frame; empty for a circle."""
    rings: tuple[Array, ...]
    """Outline for drawing, outer rings and holes alike, each (K, 2) px in the
    body's frame.
    """
    surface: Surface
    solid: Solid
    rolling: float
    """Rolling resistance c, with a moment of c x normal force x radius."""
    patch: float
    """Radius of a disc with the body's own resistance against spinning on a table, px:
    3/2 of the mean distance from its centre of mass.
    """
    roll: Array
    """(2,) rad/s at t = 0 about +x and +y by the right-hand rule, for a rolling sphere
    seen from above. Rolling towards +x is negative about +y. Zeros for other bodies.
    """
    velocity: Array
    """(2,) px/s at t = 0."""
    spin: float
    """rad/s at t = 0."""
    path: Array
    """(K, 4): s, x px, y px, rad; empty unless scripted."""
    rest: Array | None = None
    """(3,) px, px, rad: pose in the photo, if the scene moves the object to another
    place; None: the pose at t = 0.
    """
    disc: tuple[Array, float] | None = None
    """Centre (2,) px in the body's frame, and radius px, of a circle with its mass
    elsewhere; `pieces` has its corners.
    """
    damping: float = 0.0
    """1/s."""
    gravity_scale: float = 1.0
    """Factor of gravity."""
    rocking: float = 0.0
    """Lever of the normal force's moment against turning on a corner, px."""
    passage: Passage = Passage()
    wheels: tuple[Wheel, ...] = ()
    """The wheels carry the body. Its pieces end above them; mass and moment include
    them.
    """
    ramp: float = 0.0
    """Duration of the smooth start to velocity, spin and roll, s; 0: a sudden start."""

    @property
    def reach(self) -> float:
        """Return the distance of the farthest point from the centre of mass, px."""
        if self.radius is not None:
            return self.radius
        return float(max(np.hypot(*piece.T).max() for piece in self.pieces))

    @property
    def size(self) -> float:
        """Return the smallest width of the thinnest limb, px. A step must not be
        longer.

        A piece along a wider piece, never farther from it than its own width, is a
        sliver and does not count as a limb.
        """
        if self.radius is not None:
            return 2 * self.radius
        return _limb_width(tuple(piece.tobytes() for piece in self.pieces))


@lru_cache(maxsize=256)
def _limb_width(pieces: tuple[bytes, ...]) -> float:
    """Return the smallest width of the thinnest limb of convex pieces, px.

    The pieces are bytes of (K, 2) arrays, because bytes can be keys of the cache:
    trials of a push simulate the same shapes many times.
    """
    arrays = [np.frombuffer(piece).reshape(-1, 2) for piece in pieces]
    pairs = [(_width(piece), piece) for piece in arrays]
    size = max(width for width, _ in pairs)
    if len(pairs) == 1:
        return size
    pairs.sort(key=lambda pair: -pair[0])
    corners = np.concatenate([piece for _, piece in pairs])
    owner = np.repeat(np.arange(len(pairs)), [len(piece) for _, piece in pairs])
    points = shapely.points(corners)
    shapes = shapely.polygons(shapely.linearrings(corners, indices=owner))
    distances = np.where(
        owner[:, None] > np.arange(len(pairs)),
        shapely.distance(points[:, None], shapes),
        np.inf,
    )
    union, joined_count = shapes[0], 1
    for k, (width, _) in enumerate(pairs[1:], 1):
        # A union is slow, and only a possible limb needs it. The union grows by the
        # pieces since the last limb.
        if distances[owner == k].min(axis=1).max() > 0.999 * width:
            union = shapely.union_all([union, *shapes[joined_count:k]])
            joined_count = k
            outer_distances = shapely.distance(points[owner == k], union)
            if outer_distances.max() > width:
                size = width
    return size


def _width(piece: Array) -> float:
    """Return the smallest distance of two parallel lines around a convex piece. One of
    the lines contains an edge.
    """
    edges = np.roll(piece, -1, axis=0) - piece
    length = np.hypot(*edges.T)
    edges = edges[length > 1e-9] / length[length > 1e-9, None]
    heights = np.stack([-edges[:, 1], edges[:, 0]], axis=1) @ piece.T
    return float((heights.max(axis=1) - heights.min(axis=1)).min())


@dataclass(frozen=True)
class Wall:
    """Fixed chains of segments."""

    name: str
    chains: tuple[Array, ...]
    """Each (K, 2) px. In a closed chain, the last point equals the first."""
    surface: Surface
    passage: Passage = Passage()
    pieces: tuple[Array, ...] = ()
    """Convex pieces (K, 2) px of solid scenery; the chains are their outlines."""
    disc: tuple[Array, float] | None = None
    """Centre (2,) and radius of round solid scenery, px."""
    is_smooth: bool = False
    """True for a smooth curve, false for the chords of a curve."""


@dataclass(frozen=True)
class Push:
    """An impulse at `start`, or a force or torque from `start` to `end`."""

    body: int
    """Index into `World.bodies`."""
    load: Load
    vector: Array
    """(2,) g·px/s or g·px/s², fixed in the world."""
    torque: float
    """g·px²/s²."""
    point: Array
    """(2,) px in the body's frame; the point moves with the body."""
    start: float
    end: float
    profile: Profile | None = None
    """Factor over the time since the start; None: 1."""


@dataclass(frozen=True)
class Joint:
    """A joint of two bodies, or of one body and the world."""

    name: str
    kind: JointKind
    first: int
    """Index into `World.bodies`."""
    second: int | None
    """None for the world."""
    first_at: Array
    """(2,) px in the first body's frame."""
    second_at: Array
    """(2,) px in the second body's frame, or in the photo for the world."""
    length: float
    """Length of a spring at rest, px."""
    stiffness: float
    """g/s²."""
    damping: float
    """g/s."""
    speed: float
    """Spin of the first body relative to the second, rad/s."""
    limit: float
    """Maximum torque, g·px²/s²; infinite: no limit."""
    collide: bool
    """True if the two bodies also collide."""
    guide: tuple[Array, ...] = ()
    """Vectors (2,) px. For a slider: its direction along the rail from `second_at`, in
    the second body's frame. For a pulley: its two points in the photo.
    """
    ratio: float = 1.0
    """Turns of the first body per turn of the second."""
    limits: tuple[float, float] | None = None
    """Smallest and greatest angle of the first body relative to the second, rad."""
    friction: float = 0.0
    """Torque of dry friction in a pin, g·px²/s²."""
    drive: float | None = None
    """Speed along the rail, px/s."""
    force: float = inf
    """Maximum force of the drive, g·px/s²; infinite: no limit."""
    breaks: float = inf
    """Breaking force, g·px/s²; infinite: the joint never breaks."""
    knots: Array | None = None
    """(K, 3) s, px, px: path of a finger."""


@dataclass(frozen=True)
class Field:
    """A force on many bodies; see `scene.model.Field`."""

    name: str
    kind: FieldKind
    bodies: tuple[int, ...]
    """Indices into `World.bodies`, only dynamic ones."""
    vector: Array
    """(2,) px/s for wind; position in px for an attractor."""
    drag: float
    strength: float
    soften: float
    linear: float = 0.0
    density: float = 0.0
    pull: float = 0.0
    extent: tuple[float, float] = (0.0, 0.0)
    """Width and height of water or a belt from its corner `vector`, px; for a
    turntable, its radius, twice.
    """
    velocity: Array | None = None
    """(2,) px/s for a belt."""
    spin: float = 0.0
    """rad/s for a turntable."""


@dataclass(frozen=True)
class World:
    """All bodies and walls, and the laws of their motion."""

    size: tuple[int, int]
    """Width and height of the canvas, px."""
    view: View
    gravity: Array
    """(2,) px/s²."""
    pixels_per_meter: float
    press: float
    """Acceleration of the bodies onto the table, px/s²; 0 in a side view."""
    table: Surface
    """Surface of the table. The pair coefficient with a body is the product of the two
    factors, as for walls.
    """
    combine: Combine
    duration: float
    steps_per_second: float
    times: Array
    """(T,) s: times of the video's frames, from t = 0."""
    bodies: tuple[Body, ...]
    walls: tuple[Wall, ...]
    pushes: tuple[Push, ...]
    joints: tuple[Joint, ...]
    fields: tuple[Field, ...]

    @property
    def surfaces(self) -> tuple[tuple[str, Surface], ...]:
        """Return name and surface of every body, then of every wall."""
        parts: tuple[Body | Wall, ...] = (*self.bodies, *self.walls)
        return tuple((part.name, part.surface) for part in parts)


def surface(friction: float, elasticity: float, combine: Combine) -> Surface:
    """Return the factors of a surface. The engine multiplies the factors of a pair, so
    that square roots give the geometric mean.

    >>> a, b = surface(0.4, 0.9, Combine.GEOMETRIC), surface(0.1, 0.4, Combine.GEOMETRIC)
    >>> round(a.friction * b.friction, 12), round(a.elasticity * b.elasticity, 12)
    (0.2, 0.6)
    """
    if combine is Combine.GEOMETRIC:
        return Surface(sqrt(friction), sqrt(elasticity))
    return Surface(friction, elasticity)


def surface_of(item: Object | Boundary, combine: Combine) -> Surface:
    """Return the surface of an object or a boundary."""
    pair_surface = surface(item.friction, item.elasticity, combine)
    if item.static_friction is None and item.conveyor is None:
        return pair_surface
    static = None
    if item.static_friction is not None:
        static = surface(item.static_friction, 0.0, combine).friction
    return replace(pair_surface, static_friction=static, conveyor=item.conveyor or 0.0)


def passages(scene: Scene) -> dict[str, Passage]:
    """Return the passages of objects and boundaries by path, without default ones."""
    parts: dict[str, Object | Boundary] = {}
    parts |= {f"objects.{item.name}": item for item in scene.objects}
    parts |= {f"boundaries.{item.name}": item for item in scene.boundaries}
    bits = _group_bits(item.collision_group for item in parts.values())
    passages_by_name: dict[str, Passage] = {}
    for path, item in parts.items():
        mask = EVERY_GROUP
        if item.collides_with is not None:
            mask = sum({bits.get(name, 0) for name in item.collides_with})
        passage = Passage(bits[item.collision_group or MAIN_GROUP], mask, item.one_way)
        # Most scenes have no groups: no entry means the default passage.
        if passage != Passage():
            passages_by_name[path] = passage
    return passages_by_name


def _group_bits(names: Iterable[str | None]) -> dict[str, int]:
    """Return the bit of each collision group; the main group has the first."""
    other_names = {name for name in names if name} - {MAIN_GROUP}
    groups = [MAIN_GROUP, *sorted(other_names)]
    return {name: 1 << number for number, name in enumerate(groups)}


TABLE = "the table"
"""Name of the table in pairs. Names in a scene have no spaces, so that this one is
unique.
"""


Names = TypeVar("Names")


@dataclass(frozen=True)
class Pairing(Generic[Names]):
    """Coefficients of two groups of objects with equal surfaces."""

    first: Names
    second: Names
    friction: float
    elasticity: float


def pair_table(world: World) -> list[Pairing[str]]:
    """Return the pair coefficients in use, as text for display; see `pairings`."""
    return [
        Pairing(_names(p.first), _names(p.second), p.friction, p.elasticity)
        for p in pairings(world)
    ]


def pairings(world: World) -> list[Pairing[list[str]]]:
    """Return the pair coefficients in use. Objects with equal surfaces share one entry.
    Views from above include the table.
    """
    groups: dict[Surface, list[str]] = {}
    movable = len(world.bodies)
    pairs: list[Pairing[list[str]]] = []
    for name, its in world.surfaces[:movable]:
        groups.setdefault(its, []).append(name)
    walls: dict[Surface, list[str]] = {}
    for name, its in world.surfaces[movable:]:
        walls.setdefault(its, []).append(name)
    if world.press > 0 and world.table.friction > 0:
        walls.setdefault(world.table, []).append(TABLE)
    rows = list(groups.items())
    for i, (a, first) in enumerate(rows):
        for b, second in (*rows[i:], *walls.items()):
            # A group of one object has no pair with itself.
            if second is not first or len(first) > 1:
                pairs.append(
                    Pairing(
                        first,
                        second,
                        a.friction * b.friction,
                        a.elasticity * b.elasticity,
                    )
                )
    return pairs


def _names(names: Sequence[str]) -> str:
    name_text = name_ranges(names)
    if name_text.count(",") < 3:
        return name_text
    return f"{names[0]}, {names[1]} and {len(names) - 2} more"


def mass_center(outline: Outline, item: Object) -> Array:
    """Return the centre of mass (2,) px of an object with this outline in the photo."""
    if item.center_of_mass is not None:
        return np.array(item.center_of_mass, np.float64)
    return np.asarray(mass_properties(outline).center)


def placed_outline(outline: Outline, item: Object) -> Outline:
    """Return the outline at t = 0."""
    if item.place is None:
        return outline
    x, y, degrees = item.place
    center = mass_center(outline, item)
    turn = rotation(radians(degrees))

    def move(points: Array) -> Array:
        return (points - center) @ turn.T + (x, y)

    if isinstance(outline, Disc):
        return Disc(move(np.asarray(outline.center)), outline.radius)
    return Region(
        tuple(
            Ring(move(ring.outer), tuple(map(move, ring.holes)))
            for ring in outline.rings
        )
    )


def rest_pose(outline: Outline, item: Object, scene: Scene) -> Array | None:
    """Return the pose in the photo (3,) px, px, rad, of an object with another `place`.
    `outline` comes from the photo.

    Return None without a photo: the object is drawn at its place only.
    """
    if item.place is None or scene.image is None:
        return None
    return np.array([*mass_center(outline, item), -radians(item.place[2])])


def photo_poses(world: World) -> tuple[Pose, ...]:
    """Return the poses of the bodies in the photo, or nothing if all start there."""
    if all(body.rest is None for body in world.bodies):
        return ()
    poses = (
        np.append(body.center, 0.0) if body.rest is None else body.rest
        for body in world.bodies
    )
    return tuple(Pose(float(x), float(y), float(angle)) for x, y, angle in poses)


def body_in_photo(body: Body) -> Body:
    """Return the body as in the photo, with the angle 0 there."""
    if body.rest is None:
        return body
    turn = rotation(float(body.rest[2]))
    return replace(
        body,
        center=body.rest[:2],
        rings=tuple(ring @ turn.T for ring in body.rings),
        pieces=tuple(piece @ turn.T for piece in body.pieces),
        wheels=tuple(replace(w, axle=turn @ w.axle) for w in body.wheels),
        rest=None,
    )


def world_in_photo(world: World) -> World:
    """Return the world with all bodies as in the photo."""
    return replace(world, bodies=tuple(map(body_in_photo, world.bodies)))


def world_as_drawn(world: World, shapes: Sequence[Outline]) -> World:
    """Return the world with balls as large as their whole outlines.

    If neighbours hide a part of a ball, the engine's disc is smaller than the ball.
    """
    bodies = []
    for body, shape in zip(world.bodies, shapes, strict=True):
        is_larger = (
            isinstance(shape, Disc)
            and body.radius is not None
            and shape.radius > body.radius
        )
        if is_larger and isinstance(shape, Disc):
            body = replace(body, radius=shape.radius)
        bodies.append(body)
    return replace(world, bodies=tuple(bodies))


def appearance(scene: Scene, world: World) -> tuple[object, ...]:
    """Return all values of a Stage without the photo's maps, as plain data for a cache
    key.

    Masses, coefficients, velocities, forces and times have no influence. A scene
    without a photo is drawn in the size of the video, so that its camera counts.
    """
    render, settings = scene.render, scene.world
    camera: tuple[object, ...] = ()
    if scene.image is None:
        camera = (render.scale, render.size, render.camera)
    bodies = []
    for body in world_in_photo(world).bodies:
        bodies.append(
            (body.center, body.radius, body.pieces, body.rings, body.solid, body.wheels)
        )
    return (
        (scene.size, scene.image is not None, scene.assets is not None, scene.light),
        (settings.view, settings.tilt, settings.backdrop),
        (render.relight, render.shadows, render.supersample, camera),
        (render.contact_shade, render.smooth_outlines),
        [(item.layer, drawn_kinds(item.label)) for item in scene.objects],
        [item.shape.whole for item in scene.objects if isinstance(item.shape, Auto)],
        (world.size, world.view, bodies, [wall.chains for wall in world.walls]),
    )
