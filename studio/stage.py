"""What a studio scene is made of: a camera, movable things with their true physics, scenery, light, a story.

World axes are metres. Seen from the side: +x right, +y away from the camera, +z up, and things move in the plane y = 0.
Seen from above: +x right, +y up the picture, +z towards the camera. A place in the picture's plane is (x, up).
Angles are degrees as the scene file has them: a positive angle turns +x towards the bottom of the picture.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from optics import T

Point = tuple[float, float]
SIZE = 512, 512


@dataclass(frozen=True)
class Camera:
    """A view camera: the film is parallel to the plane of motion, so motion in that plane is to scale everywhere.

    The lens may stand above or beside the middle (`rise`), as a shift lens does; what is in front of the plane or
    behind it is out of focus by `aperture`.
    """

    view: str
    """side or top."""
    height: float
    """m of the plane of motion that the photo's height shows."""
    centre: Point
    """(x, up) m in the middle of the photo."""
    distance: float = 4.0
    """m from the lens to the plane of motion: a long lens."""
    rise: Point = (0.0, 0.0)
    """(right, up) m of the lens from the middle of the photo: 0.3 m at 4 m looks down by 4 degrees."""
    aperture: float = 0.02
    """Radius of the lens's opening, m; 0 is sharp everywhere."""
    plane: float = 0.0
    """m: where the plane of motion lies, positive towards the camera (a ball's radius on a table seen from above)."""
    size: tuple[int, int] = SIZE
    """Width and height of the photo, px."""

    @property
    def ppm(self) -> float:
        """Pixels per metre in the plane of motion."""
        return self.size[1] / self.height

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): rows are right, up and towards the viewer."""
        if self.view == "side":
            return np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        return np.eye(3)

    @property
    def eye(self) -> np.ndarray:
        """(3,) m: the middle of the lens."""
        right, up = np.add(self.centre, self.rise)
        return np.array([right, up, self.plane + self.distance]) @ self.axes

    def pixel(self, points: object) -> np.ndarray:
        """(..., 2) m in the plane -> (..., 2) px, origin at the top-left pixel's centre."""
        right, up = (
            np.moveaxis(np.asarray(points, float) - self.centre, -1, 0) * self.ppm
        )
        return np.stack(
            [right + (self.size[0] - 1) / 2, (self.size[1] - 1) / 2 - up], -1
        )

    def shift(self, vector: object) -> list[float]:
        """A displacement or velocity in m or m/s -> px or px/s, image axes, rounded."""
        right, up = np.asarray(vector, float) * self.ppm
        return tidy([right, -up])

    def push(self, impulse: object) -> list[float]:
        """An impulse in N·s -> g·px/s, or a force in N -> g·px/s²."""
        return tidy(np.array(self.shift(np.asarray(impulse, float) * 1000)), 0)

    def place(self, at: Point, degrees: float = 0.0, depth: float = 0.0) -> T:
        """A thing's own frame -> the world. `depth` is m behind the plane (side) or above the table (top)."""
        if self.view == "side":
            return T().translate([at[0], depth, at[1]]).rotate([0, 1, 0], degrees)
        return T().translate([at[0], at[1], depth]).rotate([0, 0, 1], -degrees)


def tidy(values: object, digits: int = 2) -> list[float]:
    """Rounded plain numbers, whole ones as int."""
    return [
        int(v) if float(v).is_integer() else float(v)
        for v in (np.round(np.asarray(values, float), digits) + 0.0).tolist()
    ]


@dataclass(frozen=True)
class Mesh:
    """Triangles in a thing's own frame."""

    vertices: np.ndarray
    """(V, 3) m."""
    normals: np.ndarray | None
    """(V, 3) unit, None for flat faces."""
    uv: np.ndarray
    """(V, 2)."""
    faces: np.ndarray
    """(F, 3)."""
    bsdf: dict


Part = Mesh | dict
"""A mesh, or a Mitsuba shape as a dictionary with `to_world` into the thing's own frame."""


@dataclass(frozen=True)
class Thing:
    """One movable object, whole or of several parts that move as one."""

    name: str
    label: str
    parts: list[Part]
    outline: dict
    """In its own frame, m, (x, up): {circle: radius}, {box: (width, height)} or {polygon: [(x, up), ...]}."""
    at: Point
    """(x, up) m of its frame's origin."""
    mass: float
    """g."""
    friction: float
    elasticity: float
    degrees: float = 0.0
    depth: float = 0.0
    """m: side view, how far behind the plane of motion its frame's origin is; top view, how high above the table."""
    solid: str | None = None
    rolling: float | None = None
    velocity: Point | None = None
    """m/s, (right, up)."""
    spin: float | None = None
    """degrees/s."""
    note: str = ""
    """A comment for the scene file."""
    extra: dict = field(default_factory=dict)
    """More keys of the object in the scene file, as they shall be written."""

    def shape(self, camera: Camera) -> dict:
        """The scene file's `shape` in px: the section through the plane of motion."""
        ((kind, size),) = self.outline.items()
        if kind == "circle":
            return {
                "circle": {
                    "center": tidy(camera.pixel(self.at)),
                    "radius": tidy([size * camera.ppm])[0],
                }
            }
        if kind == "box":
            box = {
                "center": tidy(camera.pixel(self.at)),
                "size": tidy(np.array(size) * camera.ppm),
            }
            return {
                "box": box
                | ({"angle": tidy([self.degrees], 4)[0]} if self.degrees else {})
            }
        turn = np.radians(-self.degrees)
        rotation = np.array(
            [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        )
        points = np.array(size, float) @ rotation.T + self.at
        return {"polygon": [tidy(point) for point in camera.pixel(points)]}


@dataclass(frozen=True)
class Boundary:
    """A fixed line that things stand on or bounce off."""

    points: list[Point]
    """(x, up) m."""
    friction: float
    elasticity: float
    note: str = ""
    static_friction: float | None = None


@dataclass(frozen=True)
class Stage:
    """A whole studio scene."""

    name: str
    title: str
    """What happens, in a few words."""
    story: str
    """What is seen and what happens: comments at the head of the scene file."""
    camera: Camera
    things: list[Thing]
    scenery: dict[str, Part]
    lights: dict[str, dict]
    """Mitsuba emitters (or shapes that emit)."""
    boundaries: dict[str, Boundary]
    duration: float = 2.0
    exposure: float = 1.0
    """Light of radiance 1/exposure becomes white; the middle of a photo should come out near 0.2 of it."""
    softness: float = 10.0
    """degrees: half the width of the main light as the things see it."""
    sun: tuple[float, float, float] | None = None
    """World direction towards a sun that throws the shadows; None: the light's direction is fitted."""
    backdrop: float | None = None
    """m from the plane of motion back to an upright wall that takes the things' shadows."""
    world: dict = field(default_factory=dict)
    """More keys of `world` in the scene file (table, ...); they replace what the camera says."""
    sections: Callable[[Camera], dict] = lambda camera: {}
    """More sections of the scene file, in px: forces, joints, fields, render, variants."""
    diffuse: bool = False
    """Every surface is matt, so the photo equals albedo times shading."""
    vignette: float = 0.05
    depth: int = 7
    """Bounces of light."""
    film: dict | None = None
    """Truth video of the scene's own motion: {frames: 12 or more, until: s}, and `variant: NAME` if not itself."""
    clips: dict | None = None
    """Many short clips: {count, frames, until: s, edit: (camera, random generator) -> list of KEY=VALUE}."""
    wide: Camera | None = None
    """A second photo of the same scene, 1920 x 1080."""
