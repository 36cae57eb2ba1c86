"""Depth of the photo and a view -> the depth of each pixel of the view: things take theirs along in its plane."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.motion import boxes, is_ball
from physgen.export.truth import View
from physgen.geometry import Pose
from physgen.perceive.membrane import membrane

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

EXACT = 1e-3
"""Of the photo's range of depths: how well what things have hidden is filled."""
RIM = 4
"""px beyond its pixels in the photo that a thing's depth is known, from the nearest of them."""


class Depths:
    """Of one clip."""

    def __init__(self, depth: F32, owners: NDArray[np.uint16], world: World) -> None:
        """depth (H, W), larger = farther; owners (H, W): body k of the photo is k + 1, 0 = background."""
        self.range = float(depth.min()), float(depth.max())
        """Least and greatest of the photo."""
        self._world = world
        wide = max(self.range[1] - self.range[0], 1e-6)
        self._behind = membrane(depth[..., None], owners > 0, EXACT * wide)[..., 0]
        self._own: dict[int, tuple[F32, int, int]] = {}
        for k, box in enumerate(boxes(owners)):
            if box is not None:
                self._own[k] = _spread(depth, owners == k + 1, box)

    def seen(self, view: View) -> F32:
        """(H, W) in the photo's unit."""
        width, height = view.size
        x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        lens = view.lens
        photo_x, photo_y = (x - lens[0, 2]) / lens[0, 0], (y - lens[1, 2]) / lens[1, 1]
        result = np.asarray(_sampled(self._behind, photo_x, photo_y), np.float32)
        for k, box in enumerate(boxes(view.ids)):
            if box is None or k not in self._own:
                continue
            mine = view.ids[box] == k + 1
            places = np.column_stack([photo_x[box][mine], photo_y[box][mine]])
            pose, body = Pose(*view.poses[k].tolist()), self._world.bodies[k]
            if is_ball(body):  # it turns, its shape does not
                pose = Pose(pose.x, pose.y, 0.0)
            start = pose.invert(places) + body.center
            own, left, top = self._own[k]
            result[box][mine] = _sampled(own, start[:, 0] - left, start[:, 1] - top)
        return result


def _spread(depth: F32, mine: NDArray[np.bool_], box: tuple[slice, slice]) -> tuple[F32, int, int]:
    """A thing's depths with a rim around them; and the photo's px of the first."""
    top, left = max(box[0].start - RIM, 0), max(box[1].start - RIM, 0)
    part = np.s_[top : box[0].stop + RIM, left : box[1].stop + RIM]
    inside = mine[part]
    apart = np.where(inside, 0, 255).astype(np.uint8)
    _, nearest = cv2.distanceTransformWithLabels(apart, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    values[nearest[inside]] = depth[part][inside]
    return np.asarray(values[nearest], np.float32), left, top


def _sampled(picture: F32, x: Array, y: Array) -> Array:
    """Between pixels; beyond the border, the border."""
    height, width = picture.shape
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, top = (
        np.minimum(x.astype(np.int64), max(width - 2, 0)),
        np.minimum(y.astype(np.int64), max(height - 2, 0)),
    )
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    part, down = x - left, y - top
    upper = picture[top, left] * (1 - part) + picture[top, right] * part
    lower = picture[below, left] * (1 - part) + picture[below, right] * part
    return np.asarray(upper * (1 - down) + lower * down)
