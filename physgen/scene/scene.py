"""A scene as its file describes it, after overlays and defaults: frozen dataclasses in px, s, g and degrees.

Image axes: origin at the top-left pixel's centre, +x right, +y down, a positive angle turns +x towards +y.
Every field is explained once, in `schemas/scene-1.schema.json`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from math import floor, radians
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from physgen.geometry import polygon
from physgen.problems import UNKNOWN_PLACE, InputError, Place
from physgen.scene.files import Record

Size = tuple[int, int]
"""Width and height, px."""
Point = tuple[float, float]


ADD_OBJECT = "add one: physgen perceive PHOTO --box X,Y,W,H or --point X,Y, or an entry of objects"
"""What to do where a scene has no object."""


def video_size(photo: Size, scale: float | None, size: Size | None) -> Size:
    """Return the size of the video by `render.scale` or `render.size`, else that of the photo.

    >>> video_size((960, 541), 0.5, None)
    (480, 271)
    """
    if size is not None:
        return size
    width, height = (max(1, floor(side * (scale or 1.0) + 0.5)) for side in photo)
    return width, height


def magnification(photo: Size, video: Size, zoom: float) -> float:
    """Return the video pixels per photo pixel: the photo covers the video, and more so zoomed in.

    >>> magnification((960, 540), (480, 480), 2.25)
    2.0
    """
    return zoom * max(video[0] / photo[0], video[1] / photo[1])


def room(photo: Size, video: Size, zoom: float) -> tuple[Point, Point]:
    """Return the least and greatest x and y, px, of centres from which the view does not leave the photo.

    >>> room((200, 100), (100, 100), 1.0)
    ((49.5, 49.5), (149.5, 49.5))
    """
    large = magnification(photo, video, zoom)
    low, high = [], []
    for side, visible_length in zip(photo, video, strict=True):
        half_share, middle = visible_length / (2 * large), (side - 1) / 2
        low.append(
            min(half_share - 0.5, middle)
        )  # where there is no room, a rounding must not make less
        high.append(max(side - 0.5 - half_share, middle))
    return (low[0], low[1]), (high[0], high[1])


def confine_center(center: Point, photo: Size, video: Size, zoom: float) -> Point:
    """Return the nearest centre to `center` from which the view does not leave the photo.

    >>> confine_center((0.0, 50.0), (200, 100), (100, 100), 1.0)
    (49.5, 49.5)
    """
    low, high = room(photo, video, zoom)
    x, y = (min(max(c, a), b) for c, a, b in zip(center, low, high, strict=True))
    return x, y


def affine(photo: Size, video: Size, center: Point, zoom: float) -> tuple[float, Point]:
    """Scale s and shift t of photo px x -> video px s x + t, with `center` in the video's middle.

    >>> affine((100, 50), (200, 100), (49.5, 24.5), 1.0)
    (2.0, (0.5, 0.5))
    """
    large = magnification(photo, video, zoom)
    x, y = ((side - 1) / 2 - large * c for side, c in zip(video, center, strict=True))
    return large, (x, y)


"""x px, y px."""
Points = tuple[Point, ...]


MAIN_GROUP = "main"
"""The collision group of what names none."""


def collides(first: Object | Boundary, second: Object | Boundary) -> bool:
    """Return whether two parts of a scene collide, by their groups."""
    return all(
        item.collides_with is None
        or (other.collision_group or MAIN_GROUP) in item.collides_with
        for item, other in ((first, second), (second, first))
    )


class Solid(Enum):
    """The body whose outline is shown; sets the moment of inertia."""

    SPHERE = "sphere"
    DISC = "disc"
    HOOP = "hoop"
    PLATE = "plate"


class Motion(Enum):
    """Moved by forces, not moved, or moved along a script."""

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
    """`shape: outline`: that of the mask, which is fitted unless it is stored."""

    stored: Circle | Box | Polygon | None = None
    """From the assets' outlines.json."""
    crc: int = 0
    """`mask_crc` of the mask for which it is stored."""
    whole: Circle | Box | Polygon | None = None
    """With the part that other objects hide, for drawing; None if none is known."""


Shape = Circle | Box | Polygon | Auto


def shape_outline(shape: Shape) -> polygon.Outline | None:
    """Return the outline of an explicit shape, px of the photo; None where it is that of the mask."""
    match shape:
        case Circle(center=center, radius=radius):
            return polygon.Disc(np.array(center, np.float64), float(radius))
        case Box(center=center, size=(width, height), angle=angle):
            corners = (
                np.array(
                    [
                        [-width, -height],
                        [width, -height],
                        [width, height],
                        [-width, height],
                    ]
                )
                / 2
            )
            return polygon.Region(
                (
                    polygon.Ring(
                        corners @ polygon.rotation(radians(angle)).T + center, ()
                    ),
                )
            )
        case Polygon(rings=rings):
            return polygon.Region(
                tuple(
                    polygon.Ring(
                        np.array(r.outline, np.float64),
                        tuple(np.array(h, np.float64) for h in r.holes),
                    )
                    for r in rings
                )
            )
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
    """An object lies in a box."""

    box: tuple[float, float, float, float]
    """Left, top, width, height, px."""


@dataclass(frozen=True)
class PointPrompt:
    """An object lies at a point."""

    point: Point
    """x, y px."""


@dataclass(frozen=True)
class Wheel:
    """A wheel of a vehicle: a circle of the photo."""

    center: Point
    """px: its axle."""
    radius: float
    """px."""


class Facing(Enum):
    """The side of the photo at which the front of a vehicle is."""

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
    """Where a user pointed, so that its mask can be found again."""
    place: tuple[float, float, float] | None = None
    """px, px, degrees: where its centre of mass is at t = 0, and how far it is turned from what the photo shows; None:
    as the photo shows it."""
    wheels: tuple[Wheel, ...] = ()
    """They turn on pins of the object; empty unless it is a vehicle."""
    facing: Facing | None = None
    """Where its front is; None: unknown."""
    loop: bool = False
    """Whether its path begins again."""
    center_of_mass: Point | None = None
    """px, as the photo shows it; None: of its shape."""
    moment: float | None = None
    """g·px² about its centre of mass; None: of its shape."""
    damping: float | None = None
    """1/s; None: none."""
    gravity_scale: float | None = None
    """None: 1."""
    rocking: float | None = None
    """Resistance to turning on a corner; None: none."""
    static_friction: float | None = None
    """None: as friction."""
    conveyor: float | None = None
    """px/s at which its surface runs around it, to the right on its top; None: not at all."""
    one_way: Point | None = None
    """Direction in which others pass through it; None: nothing passes."""
    collision_group: str | None = None
    """None: MAIN_GROUP."""
    collides_with: tuple[str, ...] | None = None
    """Groups; None: all."""


@dataclass(frozen=True)
class Boundary:
    """Fixed lines that objects collide with: a chain of segments, or the outlines of a mask."""

    name: str
    points: Points
    """(K, 2) px, K >= 2; empty where a mask or a shape is given."""
    mask: Mask | None
    friction: float
    elasticity: float
    static_friction: float | None = None
    """None: as friction."""
    conveyor: float | None = None
    """px/s at which its surface runs around it, to the right on its top; None: not at all."""
    one_way: Point | None = None
    """Direction in which others pass through it; None: nothing passes."""
    collision_group: str | None = None
    """None: MAIN_GROUP."""
    collides_with: tuple[str, ...] | None = None
    """Groups; None: all."""
    shape: Circle | Box | Polygon | None = None
    """Solid scenery."""
    is_smooth: bool = False
    """Whether the points are of an arc or of Bézier curves."""


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
    SLIDER = "slider"
    """A rail on which the first side slides without turning, between two ends."""
    ROPE = "rope"
    """A greatest distance between two points."""
    PULLEY = "pulley"
    """A rope over two points of the world."""
    GEAR = "gear"
    """Two sides that turn at a ratio."""
    FINGER = "finger"
    """A spring whose other end moves along knots."""


SPRINGS = (JointKind.SPRING, JointKind.FINGER)
"""Joints that are forces: they keep no point in place."""


@dataclass(frozen=True)
class Joint:
    """One entry of `joints`."""

    name: str
    kind: JointKind
    objects: tuple[str, ...]
    """One name (joined to the world) or two."""
    points: Points
    """Points of the photo at t = 0: where it is pinned; a spring and a rope have two, their ends on the first and the
    second side, a slider the ends of its rail, a pulley four along its rope, a gear none."""
    length: float | None
    """px at rest, or of a rope; None: as long as at t = 0."""
    stiffness: float
    """g/s²."""
    damping: float
    """g/s."""
    speed: float
    """degrees/s of the first object against the second, or the world."""
    limit: float | None
    """g·px²/s²; None: unlimited."""
    collide: bool
    """Whether the two objects also bump into each other."""
    gear: float = 1.0
    """Turning of the first object for each turn of the second."""
    limits: Point | None = None
    """degrees: least and greatest turning since t = 0, of a pin."""
    friction: float = 0.0
    """g·px²/s² of dry friction in a pin."""
    drive: float | None = None
    """px/s along a rail; None: it slides freely."""
    force: float | None = None
    """g·px/s² of a drive; None: unlimited."""
    breaks: float | None = None
    """g·px/s²; None: never."""
    knots: tuple[tuple[float, float, float], ...] = ()
    """s, px, px: the way of a finger."""


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
    """Wind, g/px²: the force is drag x width x |u| u, u being the wind's velocity against the object."""
    strength: float
    """Attractor, px³/s²: the acceleration is strength x distance / (distance² + soften²)^1.5; negative repels."""
    soften: float
    """px, of an attractor or a magnet (Plummer's softening)."""
    linear: float = 0.0
    """Air and water, g/(px·s): linear drag."""
    density: float = 0.0
    """Water, g/px²."""
    pull: float = 0.0
    """Magnet, g·px³/s²."""
    extent: Point = (0.0, 0.0)
    """Water and belt, px: width and height from the corner `vector`. Turntable: twice its radius."""
    velocity: Point = (0.0, 0.0)
    """Belt, px/s."""
    spin: float = 0.0
    """Turntable, degrees/s."""


class ProfileKind(Enum):
    """How a force changes with time."""

    RAMP = "ramp"
    SINE = "sine"
    PULSE = "pulse"
    TABLE = "table"


@dataclass(frozen=True)
class Profile:
    """Factor of a force by the time since its start."""

    kind: ProfileKind
    numbers: Points
    """Ramp: ((s, 0),). Sine: ((1/s, 0),). Pulse: ((s on, s off),). Table: (s, factor) of each point."""


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
    """Point of the photo at t = 0 where it acts, rides on the body; None: the centre of mass."""
    start: float
    duration: float | None
    """s; None: to the end of the clip. Of no meaning for an impulse."""
    profile: Profile | None = None
    """How it changes with time; None: not at all."""


class Overlay(Enum):
    """Drawn over finished frames, for teaching."""

    OUTLINES = "outlines"
    """Of the objects' shapes."""
    VELOCITY = "velocity"
    """Arrows from the centres."""
    FORCES = "forces"
    """The scene's forces, impulses and torques while they act."""
    WEIGHT = "weight"
    """Arrows from the centres, on the forces' scale."""
    TRAILS = "trails"
    """Where the centres have been."""
    CONTACTS = "contacts"
    """Contact points, and rings at impacts."""
    BOUNDARIES = "boundaries"
    """Walls and floors."""
    NAMES = "names"
    """At the centres."""
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
    """How the loudness of the sound track is set."""

    PEAK = "peak"
    """The loudest moment reaches -3 dB of full scale."""
    FIXED = "fixed"
    """The same pressure gives the same sample in all clips."""


class Noise(Enum):
    """Noise of the video."""

    NONE = "none"
    MATCH = "match"


@dataclass(frozen=True)
class CameraView:
    """One view of the camera; one alone holds from the first frame to the last."""

    time: float
    """s of the motion at which it is reached."""
    center: Point | None
    """px of the photo; None: its middle, or the object that it follows."""
    follow: str | None
    """Name of an object."""
    zoom: float


@dataclass(frozen=True)
class Render:
    """`render:`."""

    fps: float
    frames: int | None
    """None: fps x duration x slow, rounded. Given: t_k = k duration / frames, and fps only says how fast it plays."""
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
    """420 or 444: colours of an mp4 at every second pixel of each side, or at all."""
    contact_shade: bool = False
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
    """None: made of the objects' labels."""
    negative: str
    guidance: float | None
    """None: as the model's authors advise."""
    lock: float
    detail: float


class View(Enum):
    """`SIDE`: gravity points down the photo. `TOP`: seen from above, gravity presses on the tabletop."""

    SIDE = "side"
    TOP = "top"


class Combine(Enum):
    """How the coefficients of two surfaces make the pair's."""

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
    """`duration: auto`: a clip ends when all rests; `duration` is the longest that it may take."""
    steps_per_second: float
    tilt: float
    """degrees by which the camera looks down on the floor, seen from the side."""
    backdrop: float | None
    """px from the objects back to an upright wall; None: none is near."""
    gravity_in_units: bool = False
    """Whether gravity was written with a unit, such as 9.81 m/s²."""


@dataclass(frozen=True)
class Light:
    """`light:`: unit vector towards the light (+x right, +y down, +z to the viewer), and two strengths."""

    direction: tuple[float, float, float]
    intensity: float
    ambient: float
    softness: float
    """degrees: half its width as the objects see it."""
    provenance: str = ""
    """`from`: source and confidence of its direction; may be empty."""


@dataclass(frozen=True)
class Scene:
    """One scene file, with its overlays applied and every default filled in."""

    name: str
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    folder: Path
    """Where relative paths start."""
    image: Path | None
    """The photo, resolved; None for a scene without one."""
    size: tuple[int, int]
    """Width and height of the canvas, px: the photo's, or as given."""
    assets: Path | None
    """Folder of the maps, resolved; None when the scene names none."""
    world: Settings
    objects: tuple[Object, ...]
    """In the natural order of their names, as boundaries, joints and fields are; the document keeps the file's."""
    boundaries: tuple[Boundary, ...]
    forces: tuple[Force, ...]
    joints: tuple[Joint, ...]
    fields: tuple[Field, ...]
    light: Light | None
    render: Render
    refine: Refine
    maps: Mapping[str, tuple[float, float]]
    """What 0 and 65535 stand for in a 16-bit map: `{"depth": (lo, hi), "shading": (lo, hi)}`."""
    record: Record = field(default_factory=Record, compare=False, repr=False)
    """What perception wrote of it."""
    places: Mapping[str, Place] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """Dotted path -> where it was written; the nearest written ancestor's place is used for a default."""
    document: Mapping[str, Any] = field(
        default_factory=lambda: MappingProxyType({}), compare=False, repr=False
    )
    """The resolved document as plain YAML data, defaults filled in: what a clip's manifest has."""
    variants: tuple[str, ...] = ()
    """Names of the variants that the file offers."""
    files: tuple[Path, ...] = field(default=(), compare=False, repr=False)
    """The file and those that it extends, as they were opened."""

    @property
    def video_size(self) -> tuple[int, int]:
        """Return the width and height of the video, px."""
        return video_size(self.size, self.render.scale, self.render.size)

    def place(self, path: str) -> Place:
        """Return the place of a value, or of its nearest ancestor."""
        while path:
            if path in self.places:
                return self.places[path]
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self.places.get("", Place(str(self.folder / self.name)))

    @contextmanager
    def located(self) -> Iterator[None]:
        """Give problems of a simulation the places where their values were written."""
        try:
            yield
        except InputError as error:
            problems = []
            for problem in error.problems:
                if problem.place == UNKNOWN_PLACE:
                    problem = replace(problem, place=self.place(problem.path))
                problems.append(problem)
            raise InputError(problems) from None
