"""Where things stand: the camera's tilt, a floor or table, perhaps a wall behind it, and their light-free colours."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array, Hand
from .surfaces import LINEAR, TABLE_ODDS, TABLES, WALLS, hang, print_on, srgb8, surface


@dataclass(frozen=True)
class Room:
    """World axes: X right, Y up, Z to the viewer, px; the floor is Y = 0, and its point (X, Z) = (0, 0) is at pixel (0, 0)."""

    size: int
    tilt: float
    """Radians the camera looks down: 0 = level, pi / 2 = from above."""
    horizon: float
    """Row where floor and wall meet; at or above 0 means no wall is seen."""
    albedo: Array
    """(H, W, 3) linear reflectance of what does not move."""
    mirror: float
    """Share of light that the floor mirrors."""
    drawn: tuple[str, ...] = field(default=())
    """What was printed, laid and hung."""

    @property
    def camera(self) -> Array:
        """(3, 3) world -> camera (+x right, +y down, +z to the viewer); it is its own inverse."""
        s, c = np.sin(self.tilt), np.cos(self.tilt)
        return np.array([[1, 0, 0], [0, -c, s], [0, s, c]], np.float32)

    def on_floor(self, x: float, y: float) -> Array:
        """(3,) px before the camera: the floor's point seen at pixel (x, y)."""
        return np.array([x, y, y / np.tan(self.tilt)], np.float32)

    @property
    def wall(self) -> float:
        """World Z of the wall."""
        return self.horizon / float(np.sin(self.tilt))

    def is_floor(self) -> NDArray[np.bool_]:
        """(H,) which rows see the floor."""
        return np.arange(self.size) >= self.horizon

    def depth(self) -> Array:
        """(H, W) px to the viewer of floor and wall."""
        y = np.arange(self.size, dtype=np.float32)
        s, c = np.sin(self.tilt), np.cos(self.tilt)
        wall = s * (s * self.wall - y) / max(c, 1e-3) + c * self.wall
        return np.repeat(
            np.where(self.is_floor(), y * c / s, wall)[:, None], self.size, axis=1
        ).astype(np.float32)

    def normals(self) -> Array:
        """(H, W, 3) of floor and wall."""
        up, out = self.camera[:, 1], self.camera[:, 2]
        return np.repeat(
            np.where(self.is_floor()[:, None], up, out)[:, None], self.size, axis=1
        ).astype(np.float32)


def furnish(hand: Hand, view: str, size: int) -> Room:
    """A room for one of the views side, oblique, top."""
    if view == "top":
        tilt, horizon = np.radians(hand.between(74, 89)), -1.0
    elif view == "oblique":
        tilt = np.radians(hand.between(18, 60))
        horizon = size * hand.between(0.05, 0.4) if hand.chance(0.5) else -1.0
    else:
        tilt, horizon = np.radians(hand.between(3, 14)), size * hand.between(0.45, 0.9)
    drawn: list[str] = []
    floor = _floor(hand, size, float(tilt), horizon, drawn)
    image = floor
    if horizon > 0:
        wall = _wall(hand, size, int(horizon), drawn)
        image = np.where((np.arange(size) >= horizon)[:, None, None], floor, wall)
    albedo = LINEAR[image]
    if horizon > 0:
        soft = hand.between(0.5, 5)
        rows = slice(
            max(0, int(horizon - 3 * soft)), min(size, int(horizon + 3 * soft) + 1)
        )
        if hand.chance(0.5):
            albedo[rows] = cv2.GaussianBlur(albedo, (0, 0), soft)[rows]
    mirror = hand.between(0.08, 0.45) if hand.chance(0.25) else 0.0
    return Room(size, float(tilt), float(horizon), albedo, mirror, tuple(drawn))


def _floor(
    hand: Hand, size: int, tilt: float, horizon: float, drawn: list[str]
) -> NDArray[np.uint8]:
    side = int(size * 1.4)
    plan = surface(hand, TABLES, TABLE_ODDS, side)
    if hand.chance(0.4):
        for _ in range(hand.whole(1, 3)):
            drawn.append(print_on(hand, plan))
    # the plan as seen: squeezed by the tilt, its far edge narrower than its near one, turned about
    top, s = max(horizon, 0.0), max(float(np.sin(tilt)), 0.12)
    turn = np.radians(hand.one_of([0.0, 0.0, hand.between(-60, 60)]))
    narrow = hand.between(0.05, 0.45) * (1 - s)
    near = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * side * 1.3
    near = near @ np.array(
        [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    )
    depth = (near[:, 1] / side + 0.5).clip(-0.8, 1.8)
    tall = max(size - top, 20.0)
    x = size / 2 + near[:, 0] * (1 - narrow * (1 - depth)) * (1.0 if s > 0.4 else 1.6)
    y = top + tall / 2 + near[:, 1] / side * max(tall, side * s) * 1.3
    source = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32)
    warp = cv2.getPerspectiveTransform(
        source, np.stack([x, y], axis=1).astype(np.float32)
    )
    back = np.linalg.inv(warp).astype(np.float32)
    rows, columns = (
        np.arange(size, dtype=np.float32)[:, None],
        np.arange(size, dtype=np.float32)[None],
    )
    u, v, w = (back[k, 0] * columns + back[k, 1] * rows + back[k, 2] for k in range(3))
    w = np.where(np.abs(w) < 1e-4, np.float32(1e-4), w)
    folded = [
        side - 1 - np.abs((q / w) % (2 * side - 2) - (side - 1)) for q in (u, v)
    ]  # mirrored beyond its edges
    return cv2.remap(plan, folded[0], folded[1], cv2.INTER_LINEAR)


def _wall(hand: Hand, size: int, horizon: int, drawn: list[str]) -> NDArray[np.uint8]:
    wall = surface(hand, WALLS, None, size)
    if hand.chance(0.25):  # a studio's backdrop: black, white or grey paper
        wall[:] = np.array(srgb8(hand.grey(0.01, 0.9)), np.uint8)
    elif hand.chance(0.6):
        for _ in range(hand.whole(1, 3)):
            drawn.append(hang(hand, wall, horizon))
    if hand.chance(0.25):  # skirting board, or the table's far edge
        cv2.rectangle(
            wall,
            (0, horizon - hand.whole(2, 22)),
            (size, horizon),
            srgb8(hand.colour()),
            -1,
        )
    if hand.chance(0.5):
        drawn.append("defocused wall")
        if hand.chance(0.5):
            for _ in range(hand.whole(2, 14)):
                x, y, r = hand.whole(0, size), hand.whole(0, horizon), hand.whole(3, 40)
                if hand.chance(0.5):
                    cv2.circle(wall, (x, y), r, srgb8(hand.colour()), -1, cv2.LINE_AA)
                else:
                    cv2.rectangle(
                        wall, (x, y), (x + r, y + 2 * r), srgb8(hand.colour()), -1
                    )
        wall = cv2.GaussianBlur(wall, (0, 0), hand.between(1.5, 9))
    return wall
