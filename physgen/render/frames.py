"""World + Trajectory + sprites -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose, rotation
from physgen.photometry import decode, encode_u8
from physgen.render.sprites import Sprite
from physgen.simulate.trajectory import Trajectory

F32 = NDArray[np.float32]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]


FADE = 3.0
"""px of motion over which the photo's own border pixels give way to the object's clean ones."""


Slices = tuple[slice, slice]


@dataclass(frozen=True)
class Frame:
    """One picture of the video."""

    index: int
    time: float
    """s."""
    rgb: U8
    """(H, W, 3) sRGB."""
    ids: U16
    """(H, W): body k shows as k + 1, 0 = background."""


@dataclass(frozen=True)
class Stage:
    """What is drawn: sprites in order, the farthest first, over a background `(H, W, 3)` sRGB."""

    background: U8
    sprites: Sequence[Sprite]


def render_frames(stage: Stage, trajectory: Trajectory) -> Iterator[Frame]:
    """Frames at the trajectory's times. Each object's own box is warped, and only touched pixels are encoded again."""
    behind = decode(stage.background)
    centers = trajectory.poses[0] if len(trajectory.poses) else np.zeros((0, 3))
    canvas: F32 = behind.copy()
    touched: list[Slices] = []
    for index, time in enumerate(trajectory.times):
        for box in touched:
            canvas[box] = behind[box]
        touched.clear()
        rgb = stage.background.copy()
        ids = np.zeros(rgb.shape[:2], np.uint16)
        for sprite in stage.sprites:
            start = Pose(*centers[sprite.body].tolist())
            placed = _place(sprite, start, trajectory.pose(index, sprite.body), (rgb.shape[1], rgb.shape[0]))
            if placed is None:
                continue
            box, light, coverage = placed
            canvas[box] = light + (1 - coverage[..., None]) * canvas[box]
            ids[box][coverage >= 0.5] = sprite.body + 1
            touched.append(box)
        for box in touched:
            rgb[box] = encode_u8(canvas[box])
        yield Frame(index, float(time), rgb, ids)


def _place(sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int]) -> tuple[Slices, F32, F32] | None:
    """The sprite's light and coverage where they fall on a canvas of `size` (W, H); None when outside."""
    height, width = sprite.coverage.shape
    corner = np.array(sprite.corner, np.float64)
    turn = pose.angle - start.angle
    if turn == 0.0 and pose[:2] == start[:2]:  # at rest: the photo's own pixels
        x0, y0 = sprite.corner
        left, top = max(-x0, 0), max(-y0, 0)
        right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
        if left >= right or top >= bottom:
            return None
        own = np.s_[top:bottom, left:right]
        light = sprite.light[own] if sprite.rest is None else sprite.light[own] + sprite.rest[own]
        return np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right], light, sprite.coverage[own]
    forward = rotation(turn)
    here = np.array(start[:2])
    corners = corner + np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    moved = (corners - here) @ forward.T + pose[:2]
    if not np.isfinite(moved).all():
        return None
    low, high = moved.min(axis=0), moved.max(axis=0)
    if (high < 0).any() or low[0] >= size[0] or low[1] >= size[1]:
        return None
    x0, y0 = max(floor(low[0]), 0), max(floor(low[1]), 0)
    x1, y1 = min(ceil(high[0]) + 1, size[0]), min(ceil(high[1]) + 1, size[1])
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    back = forward.T
    shift = back @ (np.array([x0, y0]) - pose[:2]) + here - corner
    matrix = 2 * np.concatenate([back, shift[:, None]], axis=1)  # the fine grid has two samples a pixel
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped: F32 = cv2.warpAffine(  # type: ignore[assignment]  # OpenCV keeps float32
        sprite.fine, matrix, (x1 - x0, y1 - y0), flags=how, borderMode=cv2.BORDER_CONSTANT
    )
    light = warped[..., :3]
    left_behind = float(np.abs(moved - corners).max()) / FADE
    if sprite.rest is not None and left_behind < 1:
        light = light + (1 - left_behind) * cv2.warpAffine(
            sprite.rest, matrix / 2, (x1 - x0, y1 - y0), flags=how, borderMode=cv2.BORDER_CONSTANT
        )
    return np.s_[y0:y1, x0:x1], light, np.clip(warped[..., 3], 0.0, 1.0)
