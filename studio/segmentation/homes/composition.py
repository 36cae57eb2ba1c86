"""A seed in, a composed `Shot` out: the room, what stands in it, the camera. No Mitsuba."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studio.segmentation.homes import rooms, roster
from studio.segmentation.homes.furniture import Room
from studio.segmentation.homes.placement import Placed, Support, arrange
from studio.segmentation.homes.prints import Rng

SCANNED = 0.6
"""Share of the rooms where every other thing is a scanned one."""
CLOSE = 0.3
"""Share of the photos whose camera looks at one thing."""


@dataclass(frozen=True)
class Camera:
    """A thin-lens camera."""

    eye: np.ndarray
    """(3,) m."""
    target: np.ndarray
    """(3,) m."""
    up: np.ndarray
    """(3,)."""
    fov: float
    """degrees over the photo's longer side."""
    aperture: float
    """m: the lens's radius."""
    size: tuple[int, int]
    """Width and height, px."""

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): rows are right, down and away."""
        away = self.target - self.eye
        away = away / np.linalg.norm(away)
        right = np.cross(away, self.up)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(away, right), away])

    @property
    def slopes(self) -> tuple[float, float]:
        """tan of half the field of view, across and down."""
        width, height = self.size
        long = np.tan(np.radians(self.fov / 2))
        return long * width / max(self.size), long * height / max(self.size)


@dataclass(frozen=True)
class Shot:
    """All that a photo needs."""

    room: Room
    placed: list[Placed]
    camera: Camera


def shot(seed: int, long_side: int) -> Shot:
    """The same for the same numbers; the photo's longer side is `long_side` px."""
    rng = np.random.default_rng([seed, 11])
    room = rooms.room(rng)
    kinds = some(rng, list(roster.makers()))
    if rng.random() < SCANNED and "scan" in roster.makers():
        kinds += ["scan"] * len(kinds)
    count = int(rng.choice([0, 1, 2, 3, *range(4, 13), *range(4, 13), *range(13, 26)]))
    placed: list[Placed] = []
    shares = (
        [count] if len(room.supports) == 1 else split(rng, count, len(room.supports))
    )
    for support, share in zip(room.supports, shares, strict=True):
        placed += arrange(support, share, kinds, rng)
    return Shot(room, placed, camera(rng, room, placed, long_side))


def some(rng: Rng, kinds: list[str]) -> list[str]:
    """All kinds; or a few of them, so that photos full of books or of balls happen too."""
    if rng.random() < 0.4:
        return kinds
    return [str(k) for k in rng.choice(kinds, int(rng.integers(1, 6)), replace=False)]


def split(rng: Rng, count: int, ways: int) -> list[int]:
    parts = rng.multinomial(count, np.full(ways, 1 / ways))
    return [int(p) for p in parts]


def camera(rng: Rng, room: Room, placed: list[Placed], long_side: int) -> Camera:
    """Looks at what is placed, from where the room says, so near that most of it fills the photo."""
    sides = [4 / 3, 3 / 2, 1.0, 3 / 4, 4 / 3]
    aspect = float(rng.choice(sides))
    size = (
        (long_side, round(long_side / aspect))
        if aspect >= 1
        else (round(long_side * aspect), long_side)
    )
    first = room.supports[0]
    wide = first.size[0]
    near = placed
    if placed:
        if rng.random() < CLOSE:
            near = [placed[int(rng.integers(len(placed)))]]
        points = np.concatenate(
            [part.solid.vertices[::7] for p in near for part in p.parts]
        )
        low, high = points.min(0), points.max(0)
    else:
        low, high = support_box(first)
    middle = (low + high) / 2
    spread = max(
        (high - low)[0],
        (high - low)[2] * aspect * 0.9,
        *((0.3 * wide, 0.14) if near is placed else ()),
    )
    if room.elevation[1] > 45:
        spread = max(spread, (high - low)[1] * aspect)
    spread *= rng.uniform(0.75, 1.5)
    target = middle + rng.normal(0, 0.06, 3) * spread * [1, 1, 0.5]
    fov = rng.uniform(22, 48)
    elevation = np.radians(rng.uniform(*room.elevation))
    azimuth = np.radians(rng.uniform(-room.azimuth, room.azimuth))
    visible = spread if aspect >= 1 else spread / aspect
    distance = 0.5 * visible / np.tan(np.radians(fov / 2)) + 0.5 * (high - low)[
        1
    ] * np.cos(elevation)
    toward = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            -np.cos(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    roll = np.radians(rng.normal(0, 3))
    if elevation > np.radians(70):
        roll = rng.uniform(-np.pi, np.pi)
    level = (
        np.array([-np.sin(azimuth), np.cos(azimuth), 0])
        if elevation > np.radians(60)
        else np.array([0, 0, 1.0])
    )
    side = np.cross(-toward, level)
    up = level * np.cos(roll) + side * np.sin(roll)
    blurred = rng.random() < 0.4
    aperture = distance * (rng.uniform(0.004, 0.014) if blurred else 0.0005)
    return Camera(
        target + toward * distance, target, up, float(fov), float(aperture), size
    )


def support_box(support: Support) -> tuple[np.ndarray, np.ndarray]:
    """(3,) m: the lower and the upper corner of the room above a support that things fill."""
    at, half = np.array(support.at), np.array([*support.size, 0]) / 2
    return at - half, at + half + [0, 0, 0.1]
