"""Balls and moving shadows drawn many at a time: pictures of about one size share an atlas and one warp.

An atlas has two samples a pixel and four channels, which OpenCV warps several times as fast as three.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, log

import cv2
import numpy as np

from physgen.geometry.raster import double_resolution
from physgen.render.ball import F32, RIM, Array, Ball, Pattern
from physgen.render.shadow_decomposition import CastShadow
from physgen.render.sphere_texture import continue_skin
from physgen.render.sprites import Sprite
from physgen.render.stage import Placement, Slices, SpritePose

GAP = 3
"""px of an atlas on each side of a picture, as far as Lanczos' kernel looks."""
PIXELS = 60_000
"""Of the pictures of an atlas; a single one may have more."""
WIDEST = 4_000
"""Half pixels along an atlas: the farther along, the coarser is a float of 32 bits."""
ALIKE = 1.3
"""Sizes that share an atlas are within this ratio."""


def atlas_groups(sizes: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Which of some pictures, of so many columns and rows, go into each atlas."""
    alike: dict[int, list[int]] = {}
    for k, size in enumerate(sizes):
        alike.setdefault(ceil(log(max(*size, 1)) / log(ALIKE)), []).append(k)
    found = []
    for members in alike.values():
        side = max(max(sizes[k]) for k in members)
        most = max(1, min(PIXELS // side**2, WIDEST // (2 * side + 4 * GAP)))
        found += [
            members[first : first + most] for first in range(0, len(members), most)
        ]
    return found


def lay_side_by_side(pictures: Sequence[F32], border: int) -> tuple[F32, Array]:
    """(H, W, ...) pictures in a row, and (n,) px of the first column of each; its row is GAP.

    Between them is what OpenCV's `border` says.
    """
    height = max(len(picture) for picture in pictures) + 2 * GAP
    row = [
        cv2.copyMakeBorder(picture, GAP, height - GAP - len(picture), GAP, GAP, border)
        for picture in pictures
    ]
    starts = np.cumsum([0] + [picture.shape[1] for picture in row[:-1]]) + GAP
    return np.ascontiguousarray(np.concatenate(row, axis=1), np.float32), starts.astype(
        np.float64
    )


@dataclass(frozen=True)
class Strip:
    """The grid on which some pictures are warped: `n` cells of (h, w) px side by side, `fine` samples a pixel."""

    n: int
    size: tuple[int, int]
    fine: int = 1

    def along(self, values: Array) -> F32:
        """(n,) -> one value for each column of the strip."""
        return np.repeat(values.astype(np.float32), self.size[1] * self.fine)

    @property
    def columns(self) -> F32:
        """(W,) px from the left of each cell."""
        return np.tile(self._steps(1), self.n)

    @property
    def rows(self) -> F32:
        """(H, 1) px from the top."""
        return self._steps(0)[:, None]

    def _steps(self, axis: int) -> F32:
        steps = np.arange(self.size[axis] * self.fine, dtype=np.float32) + np.float32(
            0.5 - self.fine / 2
        )
        return steps / np.float32(self.fine)

    def empty(self) -> F32:
        """(H, W) to be filled."""
        return np.empty(
            (self.size[0] * self.fine, self.n * self.size[1] * self.fine), np.float32
        )


def warp_picture(picture: F32, x: F32, y: F32) -> F32:
    """(h, w[, 4]) of a picture (H, W[, 4]) at px `x`, `y` (h, w)."""
    found = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32)


def equal_area(
    skin: F32, center: Array, radius: float, pattern: Pattern | None
) -> list[F32]:
    """(h, w, 3) near and far side of a `skin` (h, w, 3) in Lambert's azimuthal equal-area projection, each as seen from
    the photo's side.

    There the rim, which the photo hardly shows, is wide.
    """
    x, y = (
        (np.arange(size) - c) / radius
        for size, c in zip(skin.shape[1::-1], center, strict=True)
    )
    u, v = np.meshgrid(x, y)
    z = np.maximum(1 - u * u - v * v, -1)
    out = np.sqrt(1 + z)
    found = []
    for side in (1, -1):
        points = np.dstack([out * u, out * v, side * z])
        share, there = np.ones((1, 1, 1), np.float32), side * points
        if pattern is not None:
            share, there = pattern.written(points, 1 / radius)
        px, py = (
            np.asarray(c + radius * there[..., k], np.float32)
            for k, c in enumerate(center)
        )
        seen = cv2.remap(
            skin, px, py, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        plain = seen if pattern is None else pattern.painted(points, 2 / radius)
        found.append(np.asarray(plain + share * (seen - plain), np.float32))
    return found


class BallSprites:
    """All of a stage's balls."""

    def __init__(self, sprites: Sequence[Sprite]) -> None:
        balls = [(k, s, s.ball) for k, s in enumerate(sprites) if s.ball is not None]
        self._homes: dict[int, tuple[_Atlas, int]] = {}
        for members in atlas_groups(
            [
                (s.within[2] - s.within[0], s.within[3] - s.within[1])
                for _, s, _ in balls
            ]
        ):
            atlas = _Atlas([balls[i][1:] for i in members])
            self._homes |= {
                balls[i][0]: (atlas, place) for place, i in enumerate(members)
            }

    def drawn(
        self, there: Iterable[tuple[int, Placement]], fine: int = 1
    ) -> dict[int, tuple[F32, F32]]:
        """As `draw_sprite`: the balls among `there`, indices of sprites and where they moved to, no others.

        Each pixel is the mean of `fine` x `fine` samples.
        """
        together: dict[int, tuple[_Atlas, list[tuple[int, int, Placement]]]] = {}
        for k, where in there:
            if k in self._homes and where.own is None:
                atlas, place = self._homes[k]
                together.setdefault(id(atlas), (atlas, []))[1].append((k, place, where))
        found: dict[int, tuple[F32, F32]] = {}
        for atlas, some in together.values():
            names, places, wheres = zip(*some, strict=True)
            found.update(zip(names, atlas.drawn(places, wheres, fine), strict=True))
        return found


class _Atlas:
    """Balls of about one size; where they turn, and how large they are, in arrays of one row each."""

    def __init__(self, members: Sequence[tuple[Sprite, Ball]]) -> None:
        within = np.array([sprite.within for sprite, _ in members], np.float64)
        still, lit, skin = [], [], []
        for sprite, ball in members:
            x0, y0, x1, y1 = sprite.within
            own = np.s_[y0:y1, x0:x1]
            coverage = sprite.coverage[own]
            still.append(np.dstack([ball.gloss[own] * coverage[..., None], coverage]))
            lit.append(
                np.dstack(
                    [ball.lit[own] * coverage[..., None], np.zeros_like(coverage)]
                )
            )
            skin.append(
                np.dstack([np.maximum(ball.skin[own], 0), np.zeros_like(coverage)])
            )
        row, starts = lay_side_by_side(still, cv2.BORDER_CONSTANT)
        self.still, self.left = double_resolution(row), 2 * starts
        self.lit = double_resolution(lay_side_by_side(lit, cv2.BORDER_CONSTANT)[0])
        near = double_resolution(lay_side_by_side(skin, cv2.BORDER_REPLICATE)[0])
        self.skin = np.concatenate([near, near])  # the far side stands below
        self.corner = within[:, :2] + [sprite.corner for sprite, _ in members]
        self.center = np.array([ball.center for _, ball in members], np.float64)
        self.radius = np.array([ball.radius for _, ball in members], np.float64)
        self.last = (
            2 * (within[:, 2:] - within[:, :2]) - 2
        )  # half pixels, of each picture's own end
        for k, (_, ball) in enumerate(members):
            (right, low), first = self.last[k].astype(int) + 1, int(self.left[k])
            place = np.s_[2 * GAP : 2 * GAP + low, first : first + right]
            middle = 2 * (self.center[k] - self.corner[k])
            own_skin, radius = near[place][..., :3], 2 * ball.radius
            sides = (
                continue_skin(np.ascontiguousarray(own_skin), middle, radius)
                if ball.is_continued
                else equal_area(own_skin, middle, radius, ball.pattern)
            )
            self.skin[place][..., :3], self.skin[len(near) :][place][..., :3] = sides

    def drawn(
        self, which: Sequence[int], wheres: Sequence[Placement], fine: int
    ) -> list[tuple[F32, F32]]:
        """See `Balls.drawn`; of the atlas' balls `which`."""
        some = np.array(which)
        h, w = (
            max(where.box[k].stop - where.box[k].start for where in wheres)
            for k in (0, 1)
        )
        strip = Strip(len(wheres), (h, w), fine)
        along, columns, rows = strip.along, strip.columns, strip.rows
        at = np.array(
            [(where.box[1].start, where.box[0].start) for where in wheres], np.float64
        )
        shift = np.array([where.shift for where in wheres])
        turn = np.array([where.space for where in wheres]).transpose(
            0, 2, 1
        )  # back to where points were
        radius, center, corner, left = (
            part[some] for part in (self.radius, self.center, self.corner, self.left)
        )
        x, y = strip.empty(), strip.empty()
        # what does not turn moves along
        moved = 2 * (at - corner - shift)
        x[:] = 2 * columns + along(moved[:, 0] + left)
        np.add(2 * rows, along(moved[:, 1] + 2 * GAP), out=y)
        picture, lit = warp_picture(self.still, x, y), warp_picture(self.lit, x, y)
        # points of the sphere in radii from its middle; beyond the rim the skin goes on as it is there
        inverse, middle = along(1 / radius), at - center - shift
        u = (columns + along(middle[:, 0])) * inverse
        v = rows * inverse
        v += along(middle[:, 1] / radius)
        z = v * v
        z += u * u
        np.subtract(1, z, out=z)
        np.maximum(z, np.float32(1 - RIM * RIM), out=z)
        np.sqrt(z, out=z)  # towards the viewer
        depth = (
            v * along(turn[:, 2, 1])
            + u * along(turn[:, 2, 0])
            - z * along(turn[:, 2, 2])
        )  # at t = 0
        side = 1 / np.sqrt(1 + np.abs(depth))  # skins are in the equal-area projection
        for k, place in enumerate((x, y)):
            back = 2 * radius[:, None] * turn[:, k]
            np.multiply(v, along(back[:, 1]), out=place)
            place += u * along(back[:, 0])
            place -= z * along(back[:, 2])
            place *= side
            place += along(2 * (center - corner)[:, k])
            np.maximum(place, 0, out=place)
            np.minimum(place, along(self.last[some, k]), out=place)
            place += along(left) if k == 0 else np.float32(2 * GAP)
        y += (depth > 0) * np.float32(len(self.skin) // 2)  # the far side
        cv2.multiply(warp_picture(self.skin, x, y), lit, dst=lit)
        cv2.add(picture, lit, dst=picture)
        if fine > 1:
            picture = np.asarray(
                cv2.resize(picture, (strip.n * w, h), interpolation=cv2.INTER_AREA),
                np.float32,
            )
        light = np.asarray(
            cv2.cvtColor(picture, cv2.COLOR_BGRA2BGR), np.float32
        )  # the first three channels
        coverage = np.asarray(cv2.extractChannel(picture, 3), np.float32)
        found = []
        for j, where in enumerate(wheres):
            tall, wide = (part.stop - part.start for part in where.box)
            own = np.s_[:tall, j * w : j * w + wide]
            found.append((light[own], coverage[own]))
        return found


class ShadowSprites:
    """The sliding shadows of a background taken apart."""

    def __init__(self, casts: Sequence[CastShadow]) -> None:
        sliding = [
            (k, *cast.sliding, cast.lean)
            for k, cast in enumerate(casts)
            if cast.sliding is not None
        ]
        self._homes: dict[int, tuple[_Row, int]] = {}
        for members in atlas_groups(
            [picture.shape[::-1] for _, _, picture, _ in sliding]
        ):
            row = _Row([sliding[i][1:] for i in members])
            self._homes |= {
                sliding[i][0]: (row, place) for place, i in enumerate(members)
            }

    def thrown(
        self, dark: F32, stands: Iterable[tuple[SpritePose, float]]
    ) -> list[Slices]:
        """Put the shadows of those of `stands` that slide, times weights, into `dark` (H, W); returns where that is."""
        together: dict[int, tuple[_Row, list[tuple[int, SpritePose, float]]]] = {}
        for stand, weight in stands:
            if stand.k in self._homes:
                row, place = self._homes[stand.k]
                together.setdefault(id(row), (row, []))[1].append(
                    (place, stand, weight)
                )
        return [
            box for row, some in together.values() for box in row.thrown(dark, some)
        ]


class _Row:
    def __init__(self, members: Sequence[tuple[tuple[int, int], F32, float]]) -> None:
        corners, pictures, leans = zip(*members, strict=True)
        self.picture, self.left = lay_side_by_side(pictures, cv2.BORDER_CONSTANT)
        self.corner = np.array(corners, np.float64)
        self.size = np.array([picture.shape[::-1] for picture in pictures])
        self.way = 1 + np.array(leans)[:, None]

    def thrown(
        self, dark: F32, some: Sequence[tuple[int, SpritePose, float]]
    ) -> list[Slices]:
        which = np.array([place for place, _, _ in some])
        shift = np.array(
            [(s.pose.x - s.start.x, s.pose.y - s.start.y) for _, s, _ in some]
        )
        at = self.corner[which] + self.way[which] * shift
        first = np.floor(at)
        low = np.maximum(first, 0)
        high = np.minimum(first + self.size[which] + 1, dark.shape[::-1])
        seen = ((high > low).all(axis=1) & np.isfinite(at).all(axis=1)).nonzero()[0]
        if not len(seen):
            return []
        which, at, low, high = (
            which[seen],
            at[seen],
            low[seen].astype(int),
            high[seen].astype(int),
        )
        w, h = (high - low).max(axis=0).tolist()
        strip = Strip(len(seen), (h, w))
        x, y = strip.empty(), strip.empty()
        x[:] = strip.columns + strip.along(low[:, 0] - at[:, 0] + self.left[which])
        np.add(strip.rows, strip.along(low[:, 1] - at[:, 1] + GAP), out=y)
        picture = warp_picture(self.picture, x, y)
        boxes: list[Slices] = []
        for j, (left, top, right, bottom) in enumerate(np.hstack([low, high]).tolist()):
            box = np.s_[top:bottom, left:right]
            one, weight = (
                picture[: bottom - top, j * w : j * w + right - left],
                some[seen[j]][2],
            )
            dark[box] += one if weight == 1 else np.float32(weight) * one
            boxes.append(box)
        return boxes
