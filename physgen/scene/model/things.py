"""What a scene holds: objects with masks and shapes, boundaries, joints, fields, forces; frozen, px, g, degrees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

Point = tuple[float, float]
"""x px, y px."""
Points = tuple[Point, ...]


class Solid(Enum):
    """What the outline is a picture of; sets the moment of inertia."""

    SPHERE = "sphere"
    DISC = "disc"
    HOOP = "hoop"
    PLATE = "plate"


class Motion(Enum):
    """Moved by forces, not moved at all, or moved along a script that pushes others."""

    DYNAMIC = "dynamic"
    STATIC = "static"
    SCRIPTED = "scripted"


@dataclass(frozen=True)
class Circle:
    """`shape: {circle: ...}`: centre px, radius px."""

    center: Point
    radius: float


@dataclass(frozen=True)
class Box:
    """`shape: {box: ...}`: centre px, width and height px, angle degrees."""

    center: Point
    size: Point
    angle: float = 0.0


@dataclass(frozen=True)
class Ring:
    """One outline with its holes; each `(K, 2)` px, not closed, in either direction."""

    outline: Points
    holes: tuple[Points, ...] = ()


@dataclass(frozen=True)
class Polygon:
    """`shape: {polygon: ...}` or `{polygons: ...}`: one ring a piece; the pieces move as one body."""

    rings: tuple[Ring, ...]


@dataclass(frozen=True)
class Auto:
    """`shape: auto`: fitted from the mask."""


Shape = Circle | Box | Polygon | Auto


@dataclass(frozen=True)
class MaskId:
    """The object's id in `masks.png`."""

    id: int


@dataclass(frozen=True)
class MaskPolygon:
    """`mask: {polygon: ...}`: an outline in px, filled by the even-odd rule."""

    points: Points


@dataclass(frozen=True)
class MaskRle:
    """`mask: {rle: ...}`: run lengths down the columns as in COCO, starting with background; size is `(H, W)`."""

    size: tuple[int, int]
    counts: tuple[int, ...]


Mask = MaskId | MaskPolygon | MaskRle


@dataclass(frozen=True)
class Waypoint:
    """One knot of a scripted motion: time s, centre px, angle degrees."""

    time: float
    position: Point
    angle: float = 0.0


@dataclass(frozen=True)
class BoxPrompt:
    """An object lies in a box."""

    box: tuple[float, float, float, float]
    """Left, top, width, height, px."""


@dataclass(frozen=True)
class PointPrompt:
    """An object lies at a point."""

    point: Point
    """x, y px."""


@dataclass(frozen=True)
class Object:
    """One thing of the photo."""

    name: str
    label: str
    mask: Mask | None
    shape: Shape
    solid: Solid | None
    """None: disc for circles, plate for others."""
    mass: float | None
    """g; exactly one of mass and density is set."""
    density: float | None
    """g/px²."""
    friction: float
    elasticity: float
    rolling: float
    velocity: Point
    """px/s at t = 0."""
    spin: float
    """degrees/s at t = 0."""
    roll: str | Point
    """`natural`, `none`, or degrees/s about x and y."""
    motion: Motion
    path: tuple[Waypoint, ...]
    """Knots of a scripted motion, empty otherwise."""
    layer: int
    """Who is drawn over whom; larger is nearer."""
    provenance: Mapping[str, str]
    """`from`: who said each number and how sure, e.g. `{"mass": "table 0.4"}`."""
    prompt: BoxPrompt | PointPrompt | None = None
    """Where a person pointed, so that its mask can be found again."""
    place: tuple[float, float, float] | None = None
    """px, px, degrees: where its centre of mass is at t = 0, and how far it is turned from what the photo shows; None:
    as the photo shows it."""


@dataclass(frozen=True)
class Boundary:
    """Fixed lines that objects collide with: a chain of segments, or the outlines of a mask."""

    name: str
    points: Points
    """(K, 2) px, K >= 2; empty where a mask is given."""
    mask: Mask | None
    friction: float
    elasticity: float


class JointKind(Enum):
    """How a joint holds."""

    PIVOT = "pivot"
    """A pin through one point; both sides turn freely about it."""
    SPRING = "spring"
    """A spring with a damper between two points."""
    WELD = "weld"
    """Held in place and in angle."""
    MOTOR = "motor"
    """A pin whose two sides are turned against each other at a speed, with at most a limit of torque."""


@dataclass(frozen=True)
class Joint:
    """One entry of `joints`."""

    name: str
    kind: JointKind
    objects: tuple[str, ...]
    """One name (joined to the world) or two."""
    points: Points
    """Points of the photo at t = 0: where it is pinned; a spring has two, its ends on the first and the second side."""
    length: float | None
    """px at rest; None: as long as at t = 0."""
    stiffness: float
    """g/s²."""
    damping: float
    """g/s."""
    speed: float
    """degrees/s of the first object against the second, or the world."""
    limit: float | None
    """g·px²/s²; None: as much as it takes."""
    collide: bool
    """Whether the two objects also bump into each other."""


class FieldKind(Enum):
    """What a force field does."""

    WIND = "wind"
    ATTRACTOR = "attractor"


@dataclass(frozen=True)
class Field:
    """One entry of `fields`: a force on many objects at once."""

    name: str
    kind: FieldKind
    objects: tuple[str, ...]
    """Names; empty: every dynamic object."""
    vector: Point
    """Wind: its velocity, px/s. Attractor: its place, px."""
    drag: float
    """Wind, g/px²: the force is drag x width x |u| u, u being the wind's velocity against the object."""
    strength: float
    """Attractor, px³/s²: the acceleration is strength x distance / (distance² + soften²)^1.5; negative repels."""
    soften: float
    """px, of an attractor (Plummer's softening)."""


class Load(Enum):
    """What a force entry applies."""

    IMPULSE = "impulse"
    """(2,) g·px/s, once at `start`."""
    FORCE = "force"
    """(2,) g·px/s²."""
    TORQUE = "torque"
    """g·px²/s², positive turns +x towards +y."""


@dataclass(frozen=True)
class Force:
    """One entry of `forces`."""

    object: str
    load: Load
    vector: Point
    """The impulse or the force, in image axes; (0, 0) for a torque."""
    torque: float
    at: Point | None
    """Point of the photo at t = 0 where it acts, rides on the body; None: the centre of mass."""
    start: float
    duration: float | None
    """s; None: to the end of the clip. Of no meaning for an impulse."""
