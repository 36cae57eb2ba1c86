"""Things in a room -> light and truth at each pixel: drawn one by one, farthest first, then shadowed and mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from .build import Model
from .canvas import Canvas, Pose, Sprite, reduced
from .hand import Array, Hand
from .light import Light, cast, softened
from .room import Room

MARGIN = 10
"""Px around the picture that are drawn too, so that what is just outside throws its shadow in."""
SMALL = 64
"""Px: smaller things are drawn at twice the size and reduced."""


GREY = np.full((1, 3), 1 / 3, np.float32)


@dataclass(frozen=True)
class Item:
    """A thing where it stands."""

    model: Model
    pose: Pose
    movable: bool = True
    """False for furniture, which the truth leaves out."""
    name: str = ""
    alike: bool = True
    """False where nobody could say whether it is a thing of its own."""

    @cached_property
    def hull(self) -> Array:
        """(N, 3) px about the thing, before the camera."""
        return self.pose.apply(self.model.hull)


@dataclass(frozen=True)
class Rendered:
    """Linear light and truth of a scene, (H, W, ...)."""

    light: Array
    labels: NDArray[np.uint16]
    unsaid: NDArray[np.bool_]
    normals: Array
    shadow: Array
    depth: Array
    outside: tuple[int, ...]
    """Ids whose things reach beyond the picture."""


def drawn(item: Item, size: int) -> Sprite | None:
    """The item as a sprite; None where nothing of it is near the picture."""
    hull = item.hull
    low = np.maximum(np.floor(hull[:, :2].min(axis=0)).astype(int) - 2, -MARGIN)
    high = np.minimum(np.ceil(hull[:, :2].max(axis=0)).astype(int) + 3, size + MARGIN)
    if (high - low).min() < 3:
        return None
    fine = 2 if float(np.ptp(hull[:, :2], axis=0).max()) < SMALL else 1
    width, height = ((high - low) * fine).tolist()
    canvas = Canvas(height, width)
    shift = np.array([low[0], low[1], 0], np.float32)
    at = (item.pose.at - shift) * fine + np.array([0.5, 0.5, 0], np.float32) * (
        fine - 1
    )
    pose = Pose(item.pose.turn, at.astype(np.float32), item.pose.scale * fine)
    for part in item.model.parts:
        part.draw(canvas, pose)
    sprite = reduced(canvas, int(low[0]), int(low[1]), fine)
    return Sprite(
        sprite.x0,
        sprite.y0,
        sprite.cover,
        sprite.depth / fine,
        sprite.normal,
        sprite.colour,
        sprite.finish,
    )


class Scene:
    """Buffers of one picture; `add` in any order, then `render`."""

    def __init__(self, hand: Hand, room: Room, light: Light) -> None:
        self.hand, self.room, self.light = hand, room, light
        self.items: list[Item] = []

    def add(self, item: Item) -> None:
        self.items.append(item)

    def render(self, blurred: int = 0) -> Rendered:
        """Draw all; the first `blurred` items lie far behind, out of focus."""
        size = self.room.size
        normals = self.room.normals()
        # a row has one normal, so the light on it is one colour
        by_room, by_lamp = self.light.shade(
            np.ones((size, 3), np.float32),
            normals[:, 0],
            np.zeros((size, 4), np.float32),
        )
        self.by_room, self.by_lamp = (
            self.room.albedo * by_room[:, None],
            self.room.albedo * by_lamp[:, None],
        )
        self.depth, self.normals = self.room.depth(), normals
        self.near = np.full((size, size), -np.inf, np.float32)
        self.labels = np.zeros((size, size), np.uint16)
        far = [
            s
            for s in (drawn(item, size) for item in self.items[:blurred])
            if s is not None
        ]
        for sprite in far:
            self._lay(sprite, 0)
        if far:
            spread = self.hand.between(4, 9)
            self.by_room, self.by_lamp = (
                cv2.GaussianBlur(self.by_room, (0, 0), spread),
                cv2.GaussianBlur(self.by_lamp, (0, 0), spread),
            )
            self.near[:] = -np.inf
            self.depth, self.normals = self.room.depth(), self.room.normals()
        sprites: list[tuple[float, int, Sprite, Item]] = []
        ids = 0
        for item in self.items[blurred:]:
            sprite_or_none = drawn(item, size)
            if sprite_or_none is None:
                continue
            ids += item.movable
            middle = float(item.hull[:, 2].mean())
            sprites.append((middle, ids if item.movable else 0, sprite_or_none, item))
        sprites.sort(key=lambda entry: entry[0])
        self._mirror([s for _, _, s, _ in sprites])
        clouds = []
        for _, number, sprite, item in sprites:
            self._lay(sprite, number)
            clouds.append(_cloud(sprite, item))
        return self._finish(sprites, clouds)

    def _lay(self, sprite: Sprite, number: int) -> None:
        """Composite a sprite where it is nearer than what is there."""
        size = self.room.size
        y0, x0 = max(0, sprite.y0), max(0, sprite.x0)
        y1, x1 = (
            min(size, sprite.y0 + sprite.cover.shape[0]),
            min(size, sprite.x0 + sprite.cover.shape[1]),
        )
        if y1 <= y0 or x1 <= x0:
            return
        inner = (
            slice(y0 - sprite.y0, y1 - sprite.y0),
            slice(x0 - sprite.x0, x1 - sprite.x0),
        )
        rows, columns = np.nonzero(
            (sprite.cover[inner] > 0.02)
            & (sprite.depth[inner] > self.near[y0:y1, x0:x1])
        )
        if not len(rows):
            return
        own = (
            (rows + inner[0].start) * sprite.cover.shape[1] + columns + inner[1].start
        )  # flat: found quicker
        at = (rows + y0) * size + columns + x0
        cover = sprite.cover.ravel()[own][:, None]
        colour, normal, finish = (
            np.take(m.reshape(-1, m.shape[2]), own, axis=0)
            for m in (sprite.colour, sprite.normal, sprite.finish)
        )
        by_room, by_lamp = self.light.shade(colour, normal, finish)
        clear = finish[:, 3:4]
        if clear.max() > 0:
            by_room, by_lamp = self._seen_through(
                (rows + y0, columns + x0), colour, normal, finish, by_room, by_lamp
            )
        for buffer, values in ((self.by_room, by_room), (self.by_lamp, by_lamp)):
            flat = buffer.reshape(-1, 3)
            before = np.take(flat, at, axis=0)
            flat[at] = before + (values - before) * cover
        most = cover[:, 0] >= 0.5
        at, own = at[most], own[most]
        self.near.ravel()[at] = self.depth.ravel()[at] = sprite.depth.ravel()[own]
        self.normals.reshape(-1, 3)[at] = normal[most]
        self.labels.ravel()[at] = number

    def _seen_through(
        self,
        at: tuple[Array, Array],
        colour: Array,
        normal: Array,
        finish: Array,
        by_room: Array,
        by_lamp: Array,
    ) -> tuple[Array, Array]:
        """Glass: what lies behind, bent by the surface, tinted, darker at grazing angles; highlights stay on top."""
        size, clear = self.room.size, finish[:, 3:4]
        bend = self.hand.between(3, 14)
        y = np.clip(
            at[0] + normal[:, 1] * bend * (1.2 - normal[:, 2]), 0, size - 1
        ).astype(int)
        x = np.clip(
            at[1] + normal[:, 0] * bend * (1.2 - normal[:, 2]), 0, size - 1
        ).astype(int)
        through = clear * colour * (0.35 + 0.65 * np.clip(normal[:, 2:], 0, 1) ** 0.7)
        shine_room, shine_lamp = self.light.shade(np.zeros_like(colour), normal, finish)
        return (
            by_room * (1 - clear) + through * self.by_room[y, x] + shine_room * clear,
            by_lamp * (1 - clear) + through * self.by_lamp[y, x] + shine_lamp * clear,
        )

    def _mirror(self, sprites: list[Sprite]) -> None:
        """What a polished floor shows of the things on it, upside down; drawn before the things themselves."""
        if self.room.mirror <= 0 or self.room.tilt > 0.6:
            return
        size, camera = self.room.size, self.room.camera
        seen = np.zeros((size, size, 4), np.float32)
        for sprite in sprites:
            rows, columns = np.nonzero(sprite.cover > 0.5)
            if not len(rows):
                continue
            y, x = (rows + sprite.y0).astype(np.float32), columns + sprite.x0
            height = camera[1, 1] * y + camera[1, 2] * sprite.depth[rows, columns]
            below = np.round(y - 2 * camera[1, 1] * height).astype(int)
            keep = (
                (below >= self.room.horizon)
                & (below < size)
                & (below >= 0)
                & (x >= 0)
                & (x < size)
                & (height > 0)
            )
            rows, columns, below, x = rows[keep], columns[keep], below[keep], x[keep]
            if not len(rows):
                continue
            a, b = self.light.shade(
                sprite.colour[rows, columns],
                sprite.normal[rows, columns],
                sprite.finish[rows, columns],
            )
            fade = np.exp(-height[keep] / 120)[:, None]
            seen[below, x] = np.concatenate([(a + b) * fade, fade], axis=1)
        seen = cv2.GaussianBlur(seen, (0, 0), self.hand.between(0.9, 2.0))
        share = np.clip(seen[..., 3:], 0, 1) * self.room.mirror
        image = seen[..., :3] / np.maximum(seen[..., 3:], 1e-3)
        self.by_room = self.by_room * (1 - share) + image * share
        self.by_lamp = self.by_lamp * (1 - share)

    def _finish(
        self, sprites: list[tuple[float, int, Sprite, Item]], clouds: list[Array]
    ) -> Rendered:
        size, room = self.room.size, self.room
        points = np.concatenate(clouds) if clouds else np.zeros((0, 3), np.float32)
        y, x = np.mgrid[:size, :size].astype(np.float32)
        seen = np.stack([x, y, self.depth], axis=2)
        floor = ~np.isfinite(self.near)
        dark = softened(cast(self.light, points, seen, 3.0), floor, self.light.softness)
        dark = np.maximum(dark, self._foreign())
        near = _contact(points, room, size) * floor
        lamp, around = (
            cv2.transform(self.by_lamp, GREY),
            cv2.transform(self.by_room, GREY),
        )
        shadow = dark * lamp / np.maximum(lamp + around, 1e-4)
        touch = near * self.hand.between(0.2, 0.75)
        light = (
            self.by_room * (1 - touch)[..., None]
            + self.by_lamp * ((1 - dark) * (1 - 0.5 * touch))[..., None]
        )
        labels, unsaid = self._judged(sprites)
        outside = tuple(
            n for _, n, _, item in sprites if n and _reaches_out(item, size)
        )
        return Rendered(
            light,
            labels,
            unsaid,
            self.normals,
            np.clip(shadow, 0, 1),
            self.depth,
            outside,
        )

    def _foreign(self) -> Array:
        """Shadows of what is not in the picture: a window's bars, a person, a leaf."""
        size = self.room.size
        out = np.zeros((size, size), np.float32)
        if self.hand.chance(0.14):
            if self.hand.chance(0.5):
                bars = surface_bars(self.hand, size)
                out = np.maximum(out, bars)
            else:
                corners = self.hand.rng.integers(
                    -size // 2, size + size // 2, (self.hand.whole(3, 5), 2)
                ).astype(np.int32)
                cv2.fillPoly(out, [cv2.convexHull(corners)], 1.0)
            out = cv2.GaussianBlur(
                out, (0, 0), self.hand.between(1, 8)
            ) * self.hand.between(0.4, 1)
        return out

    def _judged(
        self, sprites: list[tuple[float, int, Sprite, Item]]
    ) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
        """Labels with slivers and doubtful things taken out, renumbered 1, 2, ...; and what was taken out."""
        size = self.room.size
        count = np.bincount(self.labels.ravel(), minlength=len(sprites) + 2)
        new = np.zeros(len(count) + 1, np.uint16)
        drop = np.zeros(len(count) + 1, bool)
        self.kept: dict[int, int] = {}
        for _, number, sprite, item in sorted(sprites, key=lambda entry: entry[1]):
            if not number or not count[number]:
                continue
            whole = sprite.cover[
                max(0, -sprite.y0) : size - sprite.y0,
                max(0, -sprite.x0) : size - sprite.x0,
            ]
            if (
                count[number] < max(14, 0.06 * float((whole >= 0.5).sum()))
                or not item.alike
            ):
                drop[number] = True
            else:
                new[number] = self.kept[number] = len(self.kept) + 1
        return new[self.labels], drop[self.labels]


def surface_bars(hand: Hand, size: int) -> Array:
    """(size, size) 0..1 the shadow of a window's bars, aslant."""
    y, x = np.mgrid[:size, :size].astype(np.float32)
    turn, step = hand.between(0, 3.14), size * hand.between(0.12, 0.5)
    a = (x * np.cos(turn) + y * np.sin(turn)) % step < step * hand.between(0.1, 0.5)
    return a.astype(np.float32)


def _reaches_out(item: Item, size: int) -> bool:
    hull = item.hull
    return bool(hull[:, :2].min() < 0 or hull[:, :2].max() > size - 1)


def _cloud(sprite: Sprite, item: Item) -> Array:
    """(N, 3) px: the visible surface and, mirrored at its middle, a guess of the far side; none for clear glass."""
    rows, columns = np.nonzero(sprite.cover > 0.6)
    if len(rows) > 3000:
        even = (rows + columns) % 2 == 0
        rows, columns = rows[even], columns[even]
    if not len(rows) or float(sprite.finish[rows, columns, 3].mean()) > 0.4:
        return np.zeros((0, 3), np.float32)
    z = sprite.depth[rows, columns]
    hull = item.hull[:, 2]
    back = np.maximum(2 * float(hull.mean()) - z, float(hull.min()))
    front = np.stack([columns + sprite.x0, rows + sprite.y0, z], axis=1)
    hidden = np.stack(
        [columns + sprite.x0, rows + sprite.y0, np.minimum(back, z)], axis=1
    )
    return np.concatenate([front, hidden]).astype(np.float32)


def _contact(points: Array, room: Room, size: int) -> Array:
    """(H, W) 0..1: where the floor is close beneath something."""
    half = size // 2
    mark = np.zeros((half, half), np.float32)
    if len(points):
        world = points @ room.camera
        low = world[(world[:, 1] < 9) & (world[:, 1] > -9)]
        x, y = (
            (low[:, 0] / 2).astype(int),
            (low[:, 2] * np.sin(room.tilt) / 2).astype(int),
        )
        inside = (x >= 0) & (x < half) & (y >= 0) & (y < half)
        mark[y[inside], x[inside]] = 1
        mark = cv2.morphologyEx(mark, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        mark = 0.6 * cv2.GaussianBlur(mark, (0, 0), 1.2) + 0.4 * cv2.GaussianBlur(
            mark, (0, 0), 4
        )
    return cv2.resize(mark, (size, size), interpolation=cv2.INTER_LINEAR)
