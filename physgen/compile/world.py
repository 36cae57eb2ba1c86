"""The resolved world that the engine simulates: no paths, no defaults; px, s, g, rad; image axes.

A body's frame has its origin at the centre of mass and is turned by 0 at t = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    """Factors of a body's or wall's coefficients: a pair's coefficient is the product of the two factors.

    `combine: geometric` puts the square root here, `multiply` the coefficient itself; see `compile.pairs`.
    """

    friction: float
    elasticity: float
    static_friction: float | None = None
    """Factor while nothing slides; None: as friction."""
    conveyor: float = 0.0
    """px/s at which the surface runs around the body or wall, to the right on its top."""


EVERY_GROUP = 0xFFFFFFFF
"""Bits of all collision groups."""


@dataclass(frozen=True)
class Passage:
    """What passes through a body or a wall."""

    group: int = 1
    """Bit of its own collision group."""
    collides_with: int = EVERY_GROUP
    """Bits of the groups that it collides with."""
    one_way: tuple[float, float] | None = None
    """Direction in which others pass."""


@dataclass(frozen=True)
class Wheel:
    """A wheel that turns on a pin of its body."""

    axle: Array
    """(2,) px in the body's frame."""
    radius: float
    """px."""


@dataclass(frozen=True)
class Body:
    """One rigid body."""

    name: str
    motion: Motion
    center: Array
    """(2,) px: its centre of mass at t = 0."""
    mass: float
    """g."""
    moment: float
    """g·px², about the centre of mass."""
    radius: float | None
    """px of a circle; None for pieces."""
    pieces: tuple[Array, ...]
    """Convex pieces, each (K, 2) px in the body's frame; empty for a circle."""
    rings: tuple[Array, ...]
    """Outline for drawing, outer rings and holes alike, each (K, 2) px in the body's frame."""
    surface: Surface
    solid: Solid
    rolling: float
    """Rolling resistance c: a moment of c x normal force x radius."""
    patch: float
    """px: radius of the disc that resists spinning on a table as the body's own area does: 3/2 of the mean distance
    from its centre of mass."""
    roll: Array
    """(2,) rad/s at t = 0 about +x and +y by the right hand: how a sphere seen from above rolls; rolling towards +x is
    negative about +y. Zeros for all others."""
    velocity: Array
    """(2,) px/s at t = 0."""
    spin: float
    """rad/s at t = 0."""
    path: Array
    """(K, 4): s, x px, y px, rad; empty unless scripted."""
    rest: Array | None = None
    """(3,) px, px, rad: the pose in which the photo shows it, where it is put elsewhere; None: as it is at t = 0."""
    disc: tuple[Array, float] | None = None
    """Centre (2,) px in its frame, and radius px, of a circle with its mass elsewhere; `pieces` has corners."""
    damping: float = 0.0
    """1/s."""
    gravity_scale: float = 1.0
    """How many times gravity acts on it."""
    rocking: float = 0.0
    """px: lever of the normal force's moment against turning on a corner."""
    passage: Passage = Passage()
    wheels: tuple[Wheel, ...] = ()
    """They carry it instead of its pieces, which end above them; mass and moment include them."""
    ramp: float = 0.0
    """s in which it reaches velocity, spin and roll from rest; 0: it has them at t = 0."""

    @property
    def reach(self) -> float:
        """Return the distance of its farthest point from the centre of mass, px."""
        if self.radius is not None:
            return self.radius
        return float(max(np.hypot(*piece.T).max() for piece in self.pieces))

    @property
    def size(self) -> float:
        """Return the smallest width of its thinnest limb in any direction, px: what a step may not jump over.

        A piece that lies along wider ones, nowhere farther from them than it is wide, is a sliver and no limb.
        """
        if self.radius is not None:
            return 2 * self.radius
        return _limb_width(tuple(piece.tobytes() for piece in self.pieces))


@lru_cache(maxsize=256)
def _limb_width(pieces: tuple[bytes, ...]) -> float:
    """Return the smallest width of the thinnest limb of convex pieces, px.

    The pieces are the bytes of (K, 2) arrays: trials of a push simulate the same shapes
    again and again.
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
    for k, (width, _) in enumerate(pairs[1:], 1):
        # a union takes long, and is needed only for what may be a limb
        if distances[owner == k].min(axis=1).max() > 0.999 * width:
            outer_distances = shapely.distance(
                points[owner == k], shapely.union_all(shapes[:k])
            )
            size = width if outer_distances.max() > width else size
    return size


def _width(piece: Array) -> float:
    """Return the least distance of two parallel lines with a convex piece between them; one of them holds an edge."""
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
    """Each (K, 2) px; closed where the last point is the first again."""
    surface: Surface
    passage: Passage = Passage()
    pieces: tuple[Array, ...] = ()
    """Convex pieces (K, 2) px of solid scenery, of which the chains are the outlines."""
    disc: tuple[Array, float] | None = None
    """Centre (2,) and radius, px, of solid scenery that is round."""
    is_smooth: bool = False
    """Whether it is a smooth curve, and not the chords that stand for it."""


@dataclass(frozen=True)
class Push:
    """An impulse (at `start`), or a force or torque (from `start` to `end`)."""

    body: int
    """Index into `World.bodies`."""
    load: Load
    vector: Array
    """(2,) g·px/s or g·px/s², fixed in the world."""
    torque: float
    """g·px²/s²."""
    at: Array
    """(2,) px in the body's frame, rides on the body."""
    start: float
    end: float
    profile: Profile | None = None
    """Factor by the time since start; None: 1."""


@dataclass(frozen=True)
class Joint:
    """Holds two bodies, or one and the world, together."""

    name: str
    kind: JointKind
    first: int
    """Index into `World.bodies`."""
    second: int | None
    """None: the world."""
    first_at: Array
    """(2,) px in the first body's frame."""
    second_at: Array
    """(2,) px in the second body's frame; of the photo for the world."""
    length: float
    """px at rest, of a spring."""
    stiffness: float
    """g/s²."""
    damping: float
    """g/s."""
    speed: float
    """rad/s of the first against the second."""
    limit: float
    """g·px²/s²; infinite: as much as it takes."""
    collide: bool
    """Whether the two bodies also bump into each other."""
    guide: tuple[Array, ...] = ()
    """Each (2,) px. Of a slider: the way along its rail from `second_at`, in the second body's frame. Of a pulley: its
    two points, of the photo."""
    ratio: float = 1.0
    """Turning of the first for each turn of the second."""
    limits: tuple[float, float] | None = None
    """rad: least and greatest turning of the first against the second."""
    friction: float = 0.0
    """g·px²/s² of dry friction in a pin."""
    drive: float | None = None
    """px/s along the rail."""
    force: float = inf
    """g·px/s² of the drive; infinite: as much as it takes."""
    breaks: float = inf
    """g·px/s²; infinite: never."""
    knots: Array | None = None
    """(K, 3) s, px, px of a finger."""


@dataclass(frozen=True)
class Field:
    """A force on many bodies; see `scene.model.Field`."""

    name: str
    kind: FieldKind
    bodies: tuple[int, ...]
    """Indices into `World.bodies`, dynamic ones only."""
    vector: Array
    """(2,) px/s of wind; px of an attractor."""
    drag: float
    strength: float
    soften: float
    linear: float = 0.0
    density: float = 0.0
    pull: float = 0.0
    extent: tuple[float, float] = (0.0, 0.0)
    """px: width and height of water or a belt from the corner `vector`; of a turntable, its radius, twice."""
    velocity: Array | None = None
    """(2,) px/s of a belt."""
    spin: float = 0.0
    """rad/s of a turntable."""


@dataclass(frozen=True)
class World:
    """Everything that moves or is bumped into, and the laws."""

    size: tuple[int, int]
    """Width and height of the canvas, px."""
    view: View
    gravity: Array
    """(2,) px/s²."""
    pixels_per_meter: float
    press: float
    """px/s² at which the bodies press on the table; 0 seen from the side."""
    table: Surface
    """Of the table; its pair coefficient with a body is the product of the two factors, as for walls."""
    combine: Combine
    duration: float
    steps_per_second: float
    times: Array
    """(T,) s: when the video's frames are taken, t = 0 first."""
    bodies: tuple[Body, ...]
    walls: tuple[Wall, ...]
    pushes: tuple[Push, ...]
    joints: tuple[Joint, ...]
    fields: tuple[Field, ...]

    @property
    def surfaces(self) -> tuple[tuple[str, Surface], ...]:
        """Name and surface of every body, then of every wall."""
        parts: tuple[Body | Wall, ...] = (*self.bodies, *self.walls)
        return tuple((part.name, part.surface) for part in parts)


def surface(friction: float, elasticity: float, combine: Combine) -> Surface:
    """Return the factors of a surface; the engine multiplies those of a pair, so a mean is a product of square roots.

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
    """Return what passes through each object and boundary that says so, by its path."""
    parts: dict[str, Object | Boundary] = {}
    parts |= {f"objects.{item.name}": item for item in scene.objects}
    parts |= {f"boundaries.{item.name}": item for item in scene.boundaries}
    names = [item.collision_group for item in parts.values()]
    groups = [MAIN_GROUP, *sorted({name for name in names if name} - {MAIN_GROUP})]
    bits = {name: 1 << number for number, name in enumerate(groups)}
    passages_by_name: dict[str, Passage] = {}
    for path, item in parts.items():
        mask = EVERY_GROUP
        if item.collides_with is not None:
            mask = sum({bits[name] for name in item.collides_with if name in bits})
        passage = Passage(bits[item.collision_group or MAIN_GROUP], mask, item.one_way)
        if passage != Passage():
            passages_by_name[path] = passage
    return passages_by_name


TABLE = "the table"
"""How the table pairs are called; two words, so that nothing in a scene has that name."""


Names = TypeVar("Names")


@dataclass(frozen=True)
class Pairing(Generic[Names]):
    """What holds between two groups of objects with equal surfaces."""

    first: Names
    second: Names
    friction: float
    elasticity: float


def pair_table(world: World) -> list[Pairing[str]]:
    """Return the pair coefficients in use, as they are shown; see `pairings`."""
    return [
        Pairing(_names(p.first), _names(p.second), p.friction, p.elasticity)
        for p in pairings(world)
    ]


def pairings(world: World) -> list[Pairing[list[str]]]:
    """The pair coefficients in use; objects with equal surfaces share one. Seen from above, so does the table."""
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
    return (
        name_text
        if name_text.count(",") < 3
        else f"{names[0]}, {names[1]} and {len(names) - 2} more"
    )


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
    center, turn = mass_center(outline, item), rotation(radians(degrees))

    def there(points: Array) -> Array:
        return (points - center) @ turn.T + (x, y)

    if isinstance(outline, Disc):
        return Disc(there(np.asarray(outline.center)), outline.radius)
    return Region(
        tuple(
            Ring(there(ring.outer), tuple(map(there, ring.holes)))
            for ring in outline.rings
        )
    )


def rest_pose(outline: Outline, item: Object, scene: Scene) -> Array | None:
    """(3,) px, px, rad: the pose in which the photo shows what is put elsewhere; `outline` as the photo shows it.

    None without a photo: what is drawn there is drawn where it is.
    """
    if item.place is None or scene.image is None:
        return None
    return np.array([*mass_center(outline, item), -radians(item.place[2])])


def photo_poses(world: World) -> tuple[Pose, ...]:
    """Return the poses in which the photo shows the bodies; empty where all begin so."""
    if all(body.rest is None for body in world.bodies):
        return ()
    poses = (
        np.append(body.center, 0.0) if body.rest is None else body.rest
        for body in world.bodies
    )
    return tuple(Pose(float(x), float(y), float(angle)) for x, y, angle in poses)


def body_in_photo(body: Body) -> Body:
    """Return the body as the photo shows it, in a frame turned by 0 there."""
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
    """Return the world with all bodies as the photo shows them."""
    return replace(world, bodies=tuple(map(body_in_photo, world.bodies)))


def world_as_drawn(world: World, shapes: Sequence[Outline]) -> World:
    """Return the world with balls as large as their whole outlines.

    Neighbours that hide a ball keep the engine's disc smaller than it.
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
    """Return all values but the photo's maps that a Stage depends on, as plain data for the key of a cache.

    Masses, coefficients, velocities, forces and times are not among them. A scene without a photo is drawn as large as
    it is filmed, so its camera counts.
    """
    render, settings = scene.render, scene.world
    camera = (
        () if scene.image is not None else (render.scale, render.size, render.camera)
    )
    bodies = [
        (body.center, body.radius, body.pieces, body.rings, body.solid, body.wheels)
        for body in world_in_photo(world).bodies
    ]
    return (
        (scene.size, scene.image is not None, scene.assets is not None, scene.light),
        (settings.view, settings.tilt, settings.backdrop),
        (render.relight, render.shadows, render.supersample, camera),
        render.contact_shade,
        [(item.layer, drawn_kinds(item.label)) for item in scene.objects],
        [item.shape.whole for item in scene.objects if isinstance(item.shape, Auto)],
        (world.size, world.view, bodies, [wall.chains for wall in world.walls]),
    )
