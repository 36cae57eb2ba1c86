"""A scene after overlays and defaults: frozen dataclasses in px, s, g and degrees.

Image axes: origin at the top-left pixel's centre, +x right, +y down, a positive angle
turns +x towards +y. `schemas/scene-1.schema.json` explains every field.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from math import radians
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from physgen.geometry import polygon
from physgen.problems import UNKNOWN_PLACE, InputError, Place
from physgen.scene import framing
from physgen.scene.files import Record

Point = framing.Point
ADD_OBJECT = "add one: physgen perceive PHOTO --box X,Y,W,H or --point X,Y, or an entry of objects"
"""Fix for a scene without objects."""


Points = tuple[Point, ...]


MAIN_GROUP = "main"
"""The default collision group."""


def collides(first: Object | Boundary, second: Object | Boundary) -> bool:
    """Return whether two parts of a scene collide, by their groups."""
    return all(
        item.collides_with is None
        or (other.collision_group or MAIN_GROUP) in item.collides_with
        for item, other in ((first, second), (second, first))
    )


class Solid(Enum):
    """The solid behind an outline; sets the moment of inertia."""

    SPHERE = "sphere"
    DISC = "disc"
    HOOP = "hoop"
    PLATE = "plate"


class Motion(Enum):
    """Motion by forces, no motion, or motion along a script."""

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
    """`shape: {polygon: ...}` or `{polygons: ...}`: one ring per piece; the pieces move
    as one body.
    """

    rings: tuple[Ring, ...]


@dataclass(frozen=True)
class Auto:
    """`shape: outline`: the mask's outline, stored or fitted."""

    stored: Circle | Box | Polygon | None = None
    """From the assets' outlines.json."""
    crc: int = 0
    """`mask_crc` of the mask of the stored shape."""
    whole: Circle | Box | Polygon | None = None
    """The shape with its hidden part, for drawing; None if unknown."""


Shape = Circle | Box | Polygon | Auto


def _array_ring(ring: Ring) -> polygon.Ring:
    """Return a ring of the scene with its points as arrays."""
    holes = tuple(np.array(hole, np.float64) for hole in ring.holes)
    return polygon.Ring(np.array(ring.outline, np.float64), holes)


def shape_outline(shape: Shape) -> polygon.Outline | None:
    """Return the outline of an explicit shape, px of the photo, or None for
    the mask's.
    """
    match shape:
        case Circle(center=center, radius=radius):
            return polygon.Disc(np.array(center, np.float64), float(radius))
        case Box(center=center, size=(width, height), angle=angle):
            upper_corners = [[-width, -height], [width, -height]]
            lower_corners = [[width, height], [-width, height]]
            corners = np.array(upper_corners + lower_corners) / 2
            # Positive angles turn +x towards +y, clockwise in the image.
            turned_corners = corners @ polygon.rotation(radians(angle)).T
            ring = polygon.Ring(turned_corners + center, ())
            return polygon.Region((ring,))
        case Polygon(rings=rings):
            return polygon.Region(tuple(map(_array_ring, rings)))
        case _:
            return None


@dataclass(frozen=True)
class MaskId:
    """The object's id in `masks.png`."""

    id: int


@dataclass(frozen=True)
class MaskPolygon:
    """`mask: {polygon: ...}`: an outline in px, filled by the even-odd rule."""

    points: Points


Mask = MaskId | MaskPolygon


@dataclass(frozen=True)
class Waypoint:
    """One knot of a scripted motion: time s, centre px, angle degrees."""

    time: float
    position: Point
    angle: float = 0.0


@dataclass(frozen=True)
class BoxPrompt:
    """The user's box around an object."""

    box: tuple[float, float, float, float]
    """Left, top, width, height, px."""


@dataclass(frozen=True)
class PointPrompt:
    """The user's point on an object."""

    point: Point
    """x, y px."""


@dataclass(frozen=True)
class Wheel:
    """A wheel of a vehicle: a circle of the photo."""

    center: Point
    """Position of its axle, px."""
    radius: float
    """px."""
    turns: bool = True
    """Whether the wheel is drawn turning."""


class Facing(Enum):
    """The side of the photo with the front of a vehicle."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True)
class Object:
    """One object of the photo."""

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
    """Order of drawing; larger is nearer."""
    provenance: Mapping[str, str]
    """`from`: source and confidence of each number, e.g. `{"mass": "table 0.4"}`."""
    prompt: BoxPrompt | PointPrompt | None = None
    """The user's box or point, for finding the mask again."""
    place: tuple[float, float, float] | None = None
    """px, px, degrees: centre of mass at t = 0, and rotation relative to the photo;
    None: as in the photo.
    """
    wheels: tuple[Wheel, ...] = ()
    """Wheels on pins of the object; empty unless it is a vehicle."""
    facing: Facing | None = None
    """Side of its front; None: unknown."""
    loop: bool = False
    """True if its path repeats."""
    center_of_mass: Point | None = None
    """px in the photo; None: computed from the shape."""
    moment: float | None = None
    """g·px² about its centre of mass; None: computed from the shape."""
    damping: float | None = None
    """1/s; None: none."""
    gravity_scale: float | None = None
    """None: 1."""
    rocking: float | None = None
    """Resistance to turning on a corner; None: none."""
    static_friction: float | None = None
    """None: as friction."""
    conveyor: float | None = None
    """Speed of its surface around it, px/s, to the right on its top; None: 0."""
    one_way: Point | None = None
    """Direction in which others can pass through it; None: no passage."""
    collision_group: str | None = None
    """None: MAIN_GROUP."""
    collides_with: tuple[str, ...] | None = None
    """Groups; None: all."""


@dataclass(frozen=True)
class Boundary:
    """A fixed line for collisions: a chain of segments, or the outlines of a mask."""

    name: str
    points: Points
    """(K, 2) px, K >= 2; empty with a mask or a shape."""
    mask: Mask | None
    friction: float
    elasticity: float
    static_friction: float | None = None
    """None: as friction."""
    conveyor: float | None = None
    """Speed of its surface, px/s, to the right on its top; None: 0."""
    one_way: Point | None = None
    """Direction in which others can pass through it; None: no passage."""
    collision_group: str | None = None
    """None: MAIN_GROUP."""
    collides_with: tuple[str, ...] | None = None
    """Groups; None: all."""
    shape: Circle | Box | Polygon | None = None
    """Solid scenery."""
    is_smooth: bool = False
    """True for points of an arc or of Bézier curves."""


class JointKind(Enum):
    """The kind of a joint."""

    PIVOT = "pivot"
    """A pin through one point. Both sides turn freely."""
    SPRING = "spring"
    """A spring with a damper between two points."""
    WELD = "weld"
    """A rigid connection, in position and angle."""
    MOTOR = "motor"
    """A pin with a relative speed of its two sides and a maximum torque."""
    SLIDER = "slider"
    """A rail with two ends. The first side slides without turning."""
    ROPE = "rope"
    """A maximum distance between two points."""
    PULLEY = "pulley"
    """A rope over two points of the world."""
    GEAR = "gear"
    """A fixed ratio of two rotations."""
    FINGER = "finger"
    """A spring with a moving end along knots."""


SPRINGS = (JointKind.SPRING, JointKind.FINGER)
"""Joints that are only forces and do not hold a point in place."""


@dataclass(frozen=True)
class Joint:
    """One entry of `joints`."""

    name: str
    kind: JointKind
    objects: tuple[str, ...]
    """One name (joined to the world) or two."""
    points: Points
    """Points of the photo at t = 0: a pin's point; the ends of a spring or rope on the
    first and second side; the ends of a slider's rail; four points along a pulley's
    rope; none for a gear.
    """
    length: float | None
    """Length at rest or of a rope, px; None: the length at t = 0."""
    stiffness: float
    """g/s²."""
    damping: float
    """g/s."""
    speed: float
    """Speed of the first object relative to the second or the world, degrees/s."""
    limit: float | None
    """g·px²/s²; None: unlimited."""
    collide: bool
    """True if the two objects also collide."""
    gear: float = 1.0
    """Turns of the first object per turn of the second."""
    limits: Point | None = None
    """Smallest and largest rotation of a pin since t = 0, degrees."""
    friction: float = 0.0
    """Torque of dry friction in a pin, g·px²/s²."""
    drive: float | None = None
    """Speed along a rail, px/s; None: free sliding."""
    force: float | None = None
    """Maximum force of a drive, g·px/s²; None: unlimited."""
    breaks: float | None = None
    """Breaking force, g·px/s²; None: never breaks."""
    knots: tuple[tuple[float, float, float], ...] = ()
    """s, px, px: path of a finger."""


class FieldKind(Enum):
    """Kind of a force field."""

    WIND = "wind"
    ATTRACTOR = "attractor"
    AIR = "air"
    WATER = "water"
    MAGNET = "magnet"
    BELT = "belt"
    TURNTABLE = "turntable"


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
    """Wind, g/px²: the force is drag x width x

    u

     u, with the wind's velocity u relative to the object.
    """
    strength: float
    """Attractor, px³/s²: the acceleration is strength x distance / (distance² +
    soften²)^1.5; negative repels.
    """
    soften: float
    """Plummer's softening of an attractor or a magnet, px."""
    linear: float = 0.0
    """Air and water, g/(px·s): linear drag."""
    density: float = 0.0
    """Water, g/px²."""
    pull: float = 0.0
    """Magnet, g·px³/s²."""
    extent: Point = (0.0, 0.0)
    """Water and belt, px: width and height from the corner `vector`. Turntable: twice
    its radius.
    """
    velocity: Point = (0.0, 0.0)
    """Belt, px/s."""
    spin: float = 0.0
    """Turntable, degrees/s."""


class ProfileKind(Enum):
    """The change of a force with time."""

    RAMP = "ramp"
    SINE = "sine"
    PULSE = "pulse"
    TABLE = "table"


@dataclass(frozen=True)
class Profile:
    """Factor of a force over the time since its start."""

    kind: ProfileKind
    numbers: Points
    """Ramp: ((s, 0),). Sine: ((1/s, 0),). Pulse: ((s on, s off),). Table: (s, factor)
    of each point.
    """


class Load(Enum):
    """Kind of a force entry."""

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
    """Point of the photo at t = 0; it moves with the body. None: the centre of mass."""
    start: float
    duration: float | None
    """s; None: to the end of the clip. Impulses ignore it."""
    profile: Profile | None = None
    """Change with time; None: constant."""


class Overlay(Enum):
    """Marks over finished frames, for teaching."""

    OUTLINES = "outlines"
    """Outlines of the objects' shapes."""
    VELOCITY = "velocity"
    """Arrows from the centres."""
    FORCES = "forces"
    """Forces, impulses and torques of the scene during their action."""
    WEIGHT = "weight"
    """Arrows from the centres, in the forces' scale."""
    TRAILS = "trails"
    """Paths of the centres so far."""
    CONTACTS = "contacts"
    """Contact points, and rings at impacts."""
    BOUNDARIES = "boundaries"
    """Walls and floors."""
    NAMES = "names"
    """Names at the centres."""
    JOINTS = "joints"
    """Pins, ropes, rails, springs and pulleys."""
    FIELDS = "fields"
    """Water, belts, turntables and magnets."""


class Play(Enum):
    """Direction of playback."""

    FORWARD = "forward"
    BACKWARD = "backward"
    THERE_AND_BACK = "there-and-back"


class SoundLevel(Enum):
    """The rule for the loudness of the sound track."""

    PEAK = "peak"
    """The loudest moment reaches -3 dB of full scale."""
    FIXED = "fixed"
    """Equal pressures give equal samples in all clips."""


class Noise(Enum):
    """Noise of the video."""

    NONE = "none"
    MATCH = "match"


class Striker(Enum):
    """The hand or tool that enters the picture and pushes."""

    NONE = "none"
    FINGER = "finger"
    CUE = "cue"
    STICK = "stick"


@dataclass(frozen=True)
class CameraView:
    """One view of the camera. A single one lasts for the whole clip."""

    time: float
    """Time of the motion at this view, s."""
    center: Point | None
    """px of the photo; None: its middle, or the followed object."""
    follow: str | None
    """Name of an object."""
    zoom: float


@dataclass(frozen=True)
class Render:
    """`render:`."""

    fps: float
    frames: int | None
    """None: fps x duration x slow, rounded. Given: t_k = k duration / frames, and fps
    only sets the speed of playback.
    """
    relight: bool
    shadows: bool
    motion_blur: float
    overlay: tuple[Overlay, ...]
    slow: float
    play: Play
    scale: float | None
    size: tuple[int, int] | None
    """Width and height of the video, px; at most one of scale and size is given."""
    camera: tuple[CameraView, ...]
    """In the order of their times; empty: all of the photo."""
    supersample: int
    grain: Noise = Noise.NONE
    hold: int = 0
    """Frames of the photo before the motion."""
    handheld: float = 0.0
    """px of the video, standard deviation of the camera's drift."""
    chroma: int = 420
    """420 or 444: colour resolution of an mp4, half or full on each side."""
    contact_shade: bool = False
    smooth_outlines: bool = False
    squash: bool = False
    """True if soft objects are flat for two frames after an impact."""
    first_blur: bool = False
    """True if objects in the air at t = 0 are also blurred in the first frame."""
    enter: Striker = Striker.NONE
    """The hand or tool that pushes the objects at t = 0."""
    sound: SoundLevel | None = None
    """None: silent."""


@dataclass(frozen=True)
class Refine:
    """`refine:`."""

    backend: str
    strength: float
    stop: int
    steps: int
    seed: int
    prompt: str | None
    """None: the labels of the objects."""
    negative: str
    guidance: float | None
    """None: the advice of the model's authors."""
    lock: float
    detail: float


class View(Enum):
    """`SIDE`: gravity points down the photo. `TOP`: seen from above, gravity
    presses on the tabletop.
    """

    SIDE = "side"
    TOP = "top"


class Combine(Enum):
    """The rule for a pair's coefficient from two surfaces."""

    GEOMETRIC = "geometric"
    MULTIPLY = "multiply"


@dataclass(frozen=True)
class Settings:
    """`world:`."""

    view: View
    pixels_per_meter: float
    gravity: Point
    """px/s²."""
    table_friction: float
    combine: Combine
    duration: float
    until_rest: bool
    """`duration: auto`: a clip ends at rest; `duration` is its maximum."""
    steps_per_second: float
    tilt: float
    """Angle of the camera towards the floor in a side view, degrees."""
    backdrop: float | None
    """Distance from the objects back to an upright wall, px; None: no near wall."""
    ramp: float = 0.0
    """Duration of the smooth start to velocity and spin, s; 0: a sudden start."""
    gravity_in_units: bool = False
    """True for gravity with a unit, such as 9.81 m/s²."""


@dataclass(frozen=True)
class Light:
    """`light:`: unit vector towards the light (+x right, +y down, +z to the viewer),
    and two strengths.
    """

    direction: tuple[float, float, float]
    intensity: float
    ambient: float
    softness: float
    """Half its angular width, degrees."""
    provenance: str = ""
    """`from`: source and confidence of its direction; may be empty."""


@dataclass(frozen=True)
class Scene:
    """A scene file with overlays and defaults."""

    name: str
    """The file's stem, or its folder's name for `scene.yaml`."""
    folder: Path
    """Start of relative paths."""
    image: Path | None
    """Resolved path of the photo; None for a scene without a photo."""
    size: tuple[int, int]
    """Width and height of the canvas, px: the photo's, or as given."""
    assets: Path | None
    """Resolved folder of the maps; None without one."""
    world: Settings
    objects: tuple[Object, ...]
    """In natural order of names, as boundaries, joints and fields; the document keeps
    the file's order.
    """
    boundaries: tuple[Boundary, ...]
    forces: tuple[Force, ...]
    joints: tuple[Joint, ...]
    fields: tuple[Field, ...]
    light: Light | None
    render: Render
    refine: Refine
    maps: Mapping[str, tuple[float, float]]
    """Meaning of 0 and 65535 in a 16-bit map: `{"depth": (lo, hi), "shading": (lo,
    hi)}`.
    """
    record: Record = field(default_factory=Record, compare=False, repr=False)
    """The record of perception."""
    places: Mapping[str, Place] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """Dotted path -> place in the file. A default has the place of its nearest written
    ancestor.
    """
    document: Mapping[str, Any] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """The resolved document as plain YAML data with defaults, for a clip's manifest."""
    variants: tuple[str, ...] = ()
    """Names of the variants in the file."""
    title: str | None = None
    """Title of the clip; None: made from the name."""
    files: tuple[Path, ...] = field(default=(), compare=False, repr=False)
    """The file and its bases."""

    @property
    def video_size(self) -> tuple[int, int]:
        """Return the width and height of the video, px."""
        return framing.video_size(self.size, self.render.scale, self.render.size)

    def place(self, path: str) -> Place:
        """Return the place of a value, or of its nearest ancestor."""
        while path:
            if path in self.places:
                return self.places[path]
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self.places.get("", Place(str(self.folder / self.name)))

    @contextmanager
    def located(self) -> Iterator[None]:
        """Give problems of a simulation the places of their values."""
        try:
            yield
        except InputError as error:
            problems = []
            for problem in error.problems:
                if problem.place == UNKNOWN_PLACE:
                    problem = replace(problem, place=self.place(problem.path))
                problems.append(problem)
            raise InputError(problems) from None
