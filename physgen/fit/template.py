"""Templates: pictures of the objects of a scene at the start, which a film shows again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, cos, hypot, sin

import cv2
import numpy as np

from physgen.arrays import F32, F64, U8
from physgen.compile.world import Body, World
from physgen.photometry import decode
from physgen.render.stage import Stage

WINDOW_MARGIN = 6
"""px of a window around a template, so that differences at its border count."""


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels in a picture."""

    origin: tuple[int, int]
    """Column and row of the first pixel."""
    size: tuple[int, int]
    """Width and height; zero if the window lies outside the picture."""

    def crop(self, picture: F32) -> F32:
        """Return the pixels of a picture inside the window."""
        x, y = self.origin
        width, height = self.size
        return picture[y : y + height, x : x + width]

    @property
    def far_corner(self) -> tuple[int, int]:
        """Return the column and row behind the last pixel."""
        return self.origin[0] + self.size[0], self.origin[1] + self.size[1]


def window_around(pose: F64, reach: float, shape: Sequence[int]) -> Window:
    """Return the window around a pose within a picture of a shape (H, W, ...).

    `reach` is the distance from the pose to the window's borders, px.
    """
    height, width = shape[:2]
    margin = ceil(reach) + WINDOW_MARGIN
    x = round(float(pose[0]))
    y = round(float(pose[1]))
    left = max(x - margin, 0)
    right = min(x + margin + 1, width)
    top = max(y - margin, 0)
    bottom = min(y + margin + 1, height)
    return Window((left, top), (max(right - left, 0), max(bottom - top, 0)))


def window_overlap(window: Window, other: Window) -> Window:
    """Return the common part of two windows."""
    left = max(window.origin[0], other.origin[0])
    top = max(window.origin[1], other.origin[1])
    right, bottom = window.far_corner
    return Window((left, top), (max(right - left, 0), max(bottom - top, 0)))


@dataclass(frozen=True)
class Template:
    """The picture of one object at the start."""

    body: int
    """Index of the object's body."""
    corner: tuple[int, int]
    """Column and row of the first pixel."""
    paint: F32
    """(h, w, 4): linear light multiplied by coverage, and the coverage."""
    center: tuple[float, float]
    """Centre of mass and of rotation, px."""
    gyration: float
    """Radius of gyration, px."""
    can_turn: bool
    """Whether the picture turns in the plane; a sphere seen from above does not."""
    is_circle: bool
    """Whether the outline is a circle, so that it does not show the angle."""

    def transform(self, pose: F64, origin: tuple[int, int]) -> F64:
        """Return the affine map (2, 3) from the paint to a window at `origin`."""
        x, y, angle = pose.tolist()
        cosine, sine = cos(angle), sin(angle)
        left = self.corner[0] - self.center[0]
        top = self.corner[1] - self.center[1]
        # The corner turns about the centre, and the centre moves to the pose.
        shift_x = cosine * left - sine * top + x - origin[0]
        shift_y = sine * left + cosine * top + y - origin[1]
        return np.array([[cosine, -sine, shift_x], [sine, cosine, shift_y]])

    def draw(self, pose: F64, window: Window) -> F32:
        """Return the paint (H, W, 4) of the object in a pose, on a window."""
        matrix = self.transform(pose, window.origin)
        return np.asarray(cv2.warpAffine(self.paint, matrix, window.size), np.float32)

    @property
    def reach(self) -> float:
        """Return the distance from the centre to the farthest corner, px."""
        height, width = self.paint.shape[:2]
        left = self.center[0] - self.corner[0]
        top = self.center[1] - self.corner[1]
        return hypot(max(left, width - left), max(top, height - top))

    @property
    def area(self) -> float:
        """Return the number of pixels that the object covers by more than half."""
        return float((self.paint[..., 3] > 0.5).sum())


def make_templates(
    stage: Stage, world: World, first_frame: U8, has_photo: bool
) -> list[Template]:
    """Return the templates of a scene's sprites, the farthest first.

    The light of a scene with a photo comes from the film's first frame, since a film has
    another exposure and other noise than the photo.
    """
    templates = []
    for sprite in stage.sprites:
        body = world.bodies[sprite.body]
        coverage = np.asarray(sprite.coverage, np.float32)
        light = np.asarray(sprite.light, np.float32)
        if has_photo:
            crop = _crop_with_border(first_frame, sprite.corner, coverage.shape)
            light = decode(crop) * coverage[..., None]
        left, top = sprite.corner
        x, y = body.center.tolist()
        templates.append(
            Template(
                body=sprite.body,
                corner=(left, top),
                paint=np.dstack([light, coverage]).astype(np.float32),
                center=(x, y),
                gyration=max((body.moment / body.mass) ** 0.5, 1.0),
                can_turn=not _rolls_in_space(body, world),
                is_circle=body.radius is not None,
            )
        )
    return templates


def _crop_with_border(frame: U8, corner: Sequence[int], shape: Sequence[int]) -> U8:
    """Return pixels (h, w, 3) of a frame, with the nearest pixels outside the frame."""
    left, top = corner
    crop_height, crop_width = shape[:2]
    height, width = frame.shape[:2]
    rows = np.clip(np.arange(top, top + crop_height), 0, height - 1)
    columns = np.clip(np.arange(left, left + crop_width), 0, width - 1)
    return frame[rows][:, columns]


def _rolls_in_space(body: Body, world: World) -> bool:
    """Return whether a body rolls on a table, so that its picture does not only turn."""
    return world.press > 0 and body.solid.value == "sphere"
