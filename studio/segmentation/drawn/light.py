"""One lamp, the room's own light, and a room to be mirrored: how surfaces look, and what cast shadows keep away."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .hand import Array, Hand
from .room import Room


@dataclass(frozen=True)
class Light:
    """Light of a picture, linear; directions are the camera's (+x right, +y down, +z to the viewer)."""

    toward: Array
    """(3,) unit vector to the lamp."""
    up: Array
    """(3,) the world's up."""
    lamp: Array
    """(3,) strength and colour of the lamp."""
    sky: Array
    """(3,) strength and colour of the room's light."""
    windows: Array
    """(K, 5) rectangles seen mirrored: middle and half-size in two directions' sines, and strength."""
    softness: float
    """Px of blur of cast shadows."""

    def mirrored(self, normal: Array) -> Array:
        """(..., 1) the room seen in a mirror: dark floor, brighter ceiling, windows."""
        bounce = 2 * normal[..., 2:] * normal - np.array([0, 0, 1], np.float32)
        height, side = bounce @ self.up, bounce[..., 0]
        tone = 0.32 + 0.4 * np.tanh(height * 4)
        for a, b, half_a, half_b, strength in self.windows:
            inside = np.clip((half_a - np.abs(side - a)) * 12 + 0.5, 0, 1) * np.clip(
                (half_b - np.abs(height - b)) * 12 + 0.5, 0, 1
            )
            tone = tone + strength * inside
        return tone[..., None].astype(np.float32)

    def shade(self, colour: Array, normal: Array, finish: Array) -> tuple[Array, Array]:
        """Light from (N, 3) points by the room and by the lamp; finish (N, 4) as `Finish.row` gives it."""
        facing = np.maximum(normal @ self.toward, 0)[:, None]
        upward = (normal @ self.up)[:, None]
        room = colour * self.sky * (0.78 + 0.22 * upward)
        lamp = colour * self.lamp * facing
        gloss, metal = finish[:, 0:1], finish[:, 2:3]
        if gloss.max() > 0:
            half = self.toward + np.array([0, 0, 1], np.float32)
            half = half / np.linalg.norm(half)
            sharp = np.exp(finish[:, 1])
            spot = np.power(np.maximum(normal @ half, 1e-4), sharp)[:, None]
            lamp = lamp + self.lamp * gloss * spot * 0.9
            around = self.mirrored(normal)
            edge = 0.05 + 0.5 * (1 - np.clip(normal[:, 2:], 0, 1)) ** 4
            room = room * (1 - metal) + self.sky * around * (
                colour * metal + gloss * edge * 0.7
            )
            lamp = lamp * (1 - 0.7 * metal)
        return room, lamp


def lit(hand: Hand, room: Room) -> Light:
    """A lamp somewhere above, hard or soft, with or against the room's light."""
    turn, height = hand.between(0, 6.283), np.radians(hand.between(22, 80))
    world = np.array(
        [
            np.cos(turn) * np.cos(height),
            np.sin(height),
            np.sin(turn) * np.cos(height) * 0.8 + 0.2,
        ]
    )
    world /= np.linalg.norm(world)
    share, strength = hand.between(0.15, 0.85), hand.between(0.8, 1.35)
    warm = np.array([1.0, hand.between(0.82, 1), hand.between(0.6, 1)])
    warm = warm if hand.chance(0.7) else warm[::-1]
    tint = 1 + 0.06 * hand.rng.standard_normal(3)
    count = hand.whole(0, 3)
    panes = [
        [
            hand.between(-0.8, 0.8),
            hand.between(0.1, 0.9),
            hand.between(0.05, 0.3),
            hand.between(0.05, 0.3),
            hand.between(0.6, 4),
        ]
        for _ in range(count)
    ]
    return Light(
        toward=(room.camera @ world).astype(np.float32),
        up=room.camera[:, 1],
        lamp=(share * strength * 1.5 * warm).astype(np.float32),
        sky=((1 - share) * strength * tint).astype(np.float32),
        windows=np.array(panes, np.float32).reshape(-1, 5),
        softness=hand.between(0.5, 4.5),
    )


CELL = 2.0
"""Px of a cell of the shadow map."""


def cast(light: Light, points: Array, seen: Array, bias: float) -> Array:
    """(H, W) 0 or 1: which of the seen points (H, W, 3) lie in the shadow of the surface `points` (N, 3), both px.

    A shadow map (Williams 1978): the nearest surface to the lamp in each cell of a grid across its direction.
    """
    height, width = seen.shape[:2]
    if not len(points):
        return np.zeros((height, width), np.float32)
    a = np.cross(light.toward, [0.3, 0.9, 0.1])
    a = (a / np.linalg.norm(a)).astype(np.float32)
    b = np.cross(light.toward, a).astype(np.float32)
    axes = np.stack([a / CELL, b / CELL, light.toward], axis=1)
    p = points @ axes
    low = p[:, :2].min(axis=0) - 3
    shape = np.minimum((p[:, :2].max(axis=0) - low + 6).astype(int), 1200)
    grid = np.full((int(shape[1]), int(shape[0])), -1e6, np.float32)
    order = np.argsort(p[:, 2], kind="stable")
    x, y = (p[order, :2] - low).astype(int).T
    inside = (x < shape[0]) & (y < shape[1])
    grid[y[inside], x[inside]] = p[order, 2][inside]
    grid = cv2.morphologyEx(grid, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    q = cv2.transform(seen, np.ascontiguousarray(axes.T)).reshape(-1, 3)
    x, y = (q[:, 0] - low[0]).astype(np.int32), (q[:, 1] - low[1]).astype(np.int32)
    padded = np.pad(grid, 1, constant_values=-1e6)
    np.clip(x + 1, 0, shape[0] + 1, out=x)
    np.clip(y + 1, 0, shape[1] + 1, out=y)
    above = padded.ravel()[y * (int(shape[0]) + 2) + x]
    return (above > q[:, 2] + bias).astype(np.float32).reshape(height, width)


def softened(dark: Array, same: NDArray[np.bool_], blur: float) -> Array:
    """Blur (H, W) shadows over the floor and, apart from it, over things, so that neither bleeds into the other."""
    out = np.zeros_like(dark)
    for part in (same, ~same):
        weight = part.astype(np.float32)
        spread = cv2.GaussianBlur(weight, (0, 0), blur)
        out += (
            weight
            * cv2.GaussianBlur(dark * weight, (0, 0), blur)
            / np.maximum(spread, 1e-3)
        )
    return out
