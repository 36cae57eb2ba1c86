"""A map of the photo resampled for any frame: each object's part moves with the object.

The map is split once: the background, filled smoothly where an object stood, and a part for each object. A frame is
composed by its ids; each pixel reads the place in the photo that it shows, linearly between pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.correspondence import BallTurn, is_still, photo_view, similarity, spans, turns_in_space
from physgen.export.labels import Clip, View
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.render.stage import Slices

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class LayerLimits:
    """How a map is split and filled."""

    rim: int = 3
    """px around an object in which pixels mix it and the background: the background is filled in there, too."""
    pad: int = 4
    """px around an object's mask to which its outermost values are extended."""
    ball_rim: float = 0.955
    """Of the radius, as in `render.ball`: farther out the photo shows a ball mixed and foreshortened."""
    fill_error: float = 2e-4
    """Of a map's range: the largest error of the smooth fill."""


LIMITS = LayerLimits()

WARP = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Part:
    """A map on one object."""

    corner: tuple[int, int]
    """Photo column and row of its first pixel."""
    values: F32
    """(h, w[, C]), extended beyond the object's mask."""

    def warped(self, box: Slices, m: complex, n: complex) -> F32:
        """(h, w[, C]) on a box of a view; `m` and `n` lead from its px to those of the photo."""
        rows, columns = box
        n += m * complex(columns.start, rows.start) - complex(*self.corner)
        matrix = np.array([[m.real, -m.imag, n.real], [m.imag, m.real, n.imag]])
        size = (columns.stop - columns.start, rows.stop - rows.start)
        warped = cv2.warpAffine(self.values, matrix, size, flags=WARP, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(warped, np.float32)

    def at(self, x: Array, y: Array) -> F32:
        """(h, w[, C]) at px x and y (h, w) of the photo."""
        where = (x - self.corner[0]).astype(np.float32), (y - self.corner[1]).astype(np.float32)
        found = cv2.remap(self.values, *where, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(found, np.float32)

    def extended(self, center: tuple[float, float], radius: float) -> Part:
        """Values farther than `radius` from a px of the photo are replaced by those at `radius` in their direction."""
        height, width = self.values.shape[:2]
        x = np.arange(width) + self.corner[0] - center[0]
        y = (np.arange(height) + self.corner[1] - center[1])[:, None]
        within = np.minimum(radius / np.maximum(np.hypot(x, y), 1e-9), 1)
        return Part(self.corner, self.at(center[0] + x * within, center[1] + y * within))


Sample = Callable[[int, Part, View, Slices], F32]
"""Body, its part, view and box -> what the box shows of the body, (h, w[, C])."""


class Layers:
    """A map in layers; `encode` turns its values into the integers of files."""

    def __init__(
        self, clip: Clip, ground: F32, parts: Mapping[int, Part], encode: Callable[[F32], U16]
    ) -> None:
        """`ground` (H, W[, C]) of the photo without objects; `parts` by body."""
        self._world, self._size = clip.world, clip.size
        self._photo = photo_view(clip.trajectory, clip.world)
        self._ground, self._parts, self._encode = ground, parts, encode
        self._background: tuple[Array, U16] | None = None
        self._frame = np.zeros((0, 0), np.uint16)
        self._skins: dict[int, Part] = {}

    def composed(self, view: View, sample: Sample) -> U16:
        """(h, w[, C]) of a view; the next view overwrites it, since new memory costs more than a copy."""
        ground = self._ground_seen(view.lens)
        if self._frame.shape != ground.shape:
            self._frame = np.empty_like(ground)
        np.copyto(self._frame, ground)
        for body, box in view.boxes.items():
            if body in self._parts:
                mine = view.ids[box] == body + 1
                values = self._encode(sample(body, self._parts[body], view, box))
                cv2.copyTo(values, mine.view(np.uint8), self._frame[box])  # faster than NumPy with channels
        return self._frame

    def turned(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that turns with its body in the picture."""
        return part.warped(box, *similarity(body, view, self._photo))

    def moved(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that moves with its body and never turns."""
        m, _ = similarity(-1, view, self._photo)
        (x, y), (to_x, to_y) = view.lens @ [*view.poses[body, :2], 1.0], self._photo.poses[body, :2]
        return part.warped(box, m, complex(to_x, to_y) - m * complex(x, y))

    def rolled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that turns with its body, for balls in space; their far side mirrors the near one, as in frames."""
        if not turns_in_space(body, view, self._world) or is_still(body, view, self._photo):
            return self.turned(body, part, view, box)
        ball = BallTurn.between(body, view, self._photo, self._world)
        if body not in self._skins:
            self._skins[body] = part.extended(ball.to, LIMITS.ball_rim * ball.radius * ball.scale)
        return self._skins[body].at(*ball.origin(*spans(box)))

    def _ground_seen(self, lens: Array) -> U16:
        """The background through the camera; computed again only when the camera has moved."""
        if self._background is None or not np.array_equal(self._background[0], lens):
            values = self._ground
            height, width = values.shape[:2]
            if self._size != (width, height) or not np.array_equal(lens, np.eye(2, 3)):
                matrix = cv2.invertAffineTransform(lens)
                warped = cv2.warpAffine(
                    values, matrix, self._size, flags=WARP, borderMode=cv2.BORDER_REPLICATE
                )
                values = np.asarray(warped, np.float32)
            self._background = lens, self._encode(values)
        return self._background[1]


def unknown_ground(clip: Clip) -> Mask:
    """(H, W) of the photo: pixels on objects or beside them, where the background is not known."""
    return dilate(clip.stood > 0, LIMITS.rim)


def filled(values: F32, where: Mask) -> F32:
    """(H, W[, C]) with a harmonic fill of `where` (H, W)."""
    deep = values if values.ndim == 3 else values[..., None]
    error = max(float(np.ptp(deep)), 1e-6) * LIMITS.fill_error
    return harmonic_fill(deep, where, error).reshape(values.shape)


def parts_of(values: F32, clip: Clip) -> dict[int, Part]:
    """Each body's part of a map (H, W[, C]) of the photo; bodies that the photo does not show have none."""
    found = {}
    for body in range(len(clip.world.bodies)):
        own = clip.stood == body + 1
        x, y, w, h = cv2.boundingRect(own.view(np.uint8))
        if w:
            box = np.s_[
                max(y - LIMITS.pad, 0) : y + h + LIMITS.pad, max(x - LIMITS.pad, 0) : x + w + LIMITS.pad
            ]
            found[body] = Part((box[1].start, box[0].start), _nearest(values[box], own[box]))
    return found


def _nearest(values: F32, known: Mask) -> F32:
    """(h, w[, C]) with the nearest known value everywhere."""
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros((int(nearest.max()) + 1, *values.shape[2:]), np.float32)
    table[nearest[known]] = values[known]
    return np.ascontiguousarray(table[nearest])
