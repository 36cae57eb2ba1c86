"""A map of the photo resampled for any frame: each object's part moves with the object."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.export.correspondence import Ball, PhotoPose, is_still, similarity, spans, turns_in_space
from physgen.export.labels import Clip, View
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.render.stage import Slices

F32 = NDArray[np.float32]
U16 = NDArray[np.uint16]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]

RIM = 3
"""px around what stood there at t = 0 in which the map is mixed: the background is filled in there, too."""
PAD = 4
"""px around a thing's mask to which its outermost values are carried on."""
RIM_OF_BALL = 0.955
"""Of the radius, as in `render.ball`: farther out the photo shows a ball mixed and foreshortened."""
HOW = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Part:
    """What a map tells of one thing."""

    corner: tuple[int, int]
    """Photo column and row of its first pixel."""
    values: F32
    """(h, w[, C]), carried on beyond the thing's mask."""

    def warped(self, box: Slices, m: complex, n: complex) -> F32:
        """(h, w[, C]) on a box of a view; `m` and `n` lead from its px to those of the photo."""
        rows, columns = box
        n += m * complex(columns.start, rows.start) - complex(*self.corner)
        matrix = np.array([[m.real, -m.imag, n.real], [m.imag, m.real, n.imag]])
        size = (columns.stop - columns.start, rows.stop - rows.start)
        return np.asarray(
            cv2.warpAffine(self.values, matrix, size, flags=HOW, borderMode=cv2.BORDER_REPLICATE), np.float32
        )

    def at(self, x: Array, y: Array) -> F32:
        """(h, w[, C]) at px x and y (h, w) of the photo."""
        here, way = (x - self.corner[0]).astype(np.float32), cv2.INTER_LINEAR
        there = (y - self.corner[1]).astype(np.float32)
        return np.asarray(
            cv2.remap(self.values, here, there, way, borderMode=cv2.BORDER_REPLICATE), np.float32
        )

    def squeezed(self, middle: tuple[float, float], radius: float) -> Part:
        """What lies farther than `radius` from a px of the photo gives way to what is there in its direction."""
        height, width = self.values.shape[:2]
        x = np.arange(width) + self.corner[0] - middle[0]
        y = (np.arange(height) + self.corner[1] - middle[1])[:, None]
        within = np.minimum(radius / np.maximum(np.hypot(x, y), 1e-9), 1)
        return Part(self.corner, self.at(middle[0] + x * within, middle[1] + y * within))


Sample = Callable[[int, Part, View, Slices], F32]
"""What the part of a body shows of it in the box of a view, (h, w[, C])."""


class Layers:
    """A map in layers; `finish` makes of its values what is written."""

    def __init__(
        self, clip: Clip, ground: F32, parts: Mapping[int, Part], finish: Callable[[F32], U16]
    ) -> None:
        """`ground` (H, W[, C]) of the photo without things; `parts` by body."""
        self._world, self._still, self._size = (
            clip.world,
            PhotoPose.of(clip.trajectory, clip.world),
            clip.size,
        )
        self._ground, self._parts, self._finish = ground, parts, finish
        self._filmed: tuple[Array, U16] | None = None
        self._shown: U16 | None = None
        self._skins: dict[int, Part] = {}

    def seen(self, view: View, sample: Sample) -> U16:
        """(h, w[, C]) of a view, finished; the next view overwrites it: new memory costs more than a copy."""
        ground = self._background(view.lens)
        if self._shown is None or self._shown.shape != ground.shape:
            self._shown = np.empty_like(ground)
        shown = self._shown
        np.copyto(shown, ground)
        for body, box in view.boxes.items():
            if body in self._parts:
                mine = view.ids[box] == body + 1
                values = self._finish(sample(body, self._parts[body], view, box))
                cv2.copyTo(
                    values, mine.view(np.uint8), shown[box]
                )  # where NumPy spreads masks over channels slowly
        return shown

    def turned(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that turns with its body in the picture."""
        return part.warped(box, *similarity(body, view, self._still))

    def carried(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that moves with its body and never turns."""
        m, _ = similarity(-1, view, self._still)
        (x, y), (to_x, to_y) = view.lens @ [*view.poses[body, :2], 1.0], self._still.poses[body, :2]
        return part.warped(box, m, complex(to_x, to_y) - m * complex(x, y))

    def rolled(self, body: int, part: Part, view: View, box: Slices) -> F32:
        """A part that turns with its body, in space where that does.

        What no photo shows, of a ball's far side, is the mirror image of what it does: as frames have it.
        """
        if not turns_in_space(body, view, self._world) or is_still(body, view, self._still):
            return self.turned(body, part, view, box)
        ball = Ball.between(body, view, self._still, self._world)
        if body not in self._skins:
            self._skins[body] = part.squeezed(ball.to, RIM_OF_BALL * ball.radius * ball.larger)
        return self._skins[body].at(*ball.origin(*spans(box)))

    def _background(self, lens: Array) -> U16:
        """As it is filmed; again only where the camera has moved."""
        if self._filmed is None or not np.array_equal(self._filmed[0], lens):
            values = self._ground
            height, width = values.shape[:2]
            if self._size != (width, height) or not np.array_equal(lens, np.eye(2, 3)):
                matrix = cv2.invertAffineTransform(lens)
                values = np.asarray(
                    cv2.warpAffine(values, matrix, self._size, flags=HOW, borderMode=cv2.BORDER_REPLICATE),
                    np.float32,
                )
            self._filmed = lens, self._finish(values)
        return self._filmed[1]


def hole(clip: Clip) -> Mask:
    """(H, W) of the photo: where the background is not known, for something stands there or beside."""
    return dilate(clip.stood > 0, RIM)


def filled(values: F32, where: Mask) -> F32:
    """(H, W[, C]) with a soap film in the place of what is not known (`perceive.membrane`)."""
    deep = values if values.ndim == 3 else values[..., None]
    reach = float(np.ptp(deep))
    return harmonic_fill(deep, where, max(reach, 1e-6) * FILM).reshape(values.shape)


FILM = 2e-4
"""Of a map's reach: the error that the film may leave."""


def parted(values: F32, clip: Clip) -> dict[int, Part]:
    """Each body's part of a map (H, W[, C]) of the photo; bodies that the photo does not show have none."""
    found = {}
    for body in range(len(clip.world.bodies)):
        own = clip.stood == body + 1
        x, y, w, h = cv2.boundingRect(own.view(np.uint8))
        if w:
            box = np.s_[max(y - PAD, 0) : y + h + PAD, max(x - PAD, 0) : x + w + PAD]
            found[body] = Part((box[1].start, box[0].start), _spread(values[box], own[box]))
    return found


def _spread(values: F32, known: Mask) -> F32:
    """(h, w[, C]) with the nearest known value everywhere."""
    _, nearest = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros((int(nearest.max()) + 1, *values.shape[2:]), np.float32)
    table[nearest[known]] = values[known]
    return np.ascontiguousarray(table[nearest])
