"""Balls that moved -> their pixels, many at a time.

Their pictures lie in an atlas, two samples a pixel as `Sprite.fine` has them; with four channels, which OpenCV warps
several times as fast as three.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.render.atlas import GAP, Strip, laid, shared, warped
from physgen.render.ball import RIM, Ball
from physgen.render.finer import doubled
from physgen.render.placing import Placement, thrice
from physgen.render.sprites import Sprite

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Drawn:
    """Pixels on a placement's box."""

    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    through: F32
    """(h, w, 3): the share of what is behind that shows through, in each channel."""


class Balls:
    """All of a stage's balls."""

    def __init__(self, sprites: Sequence[Sprite]) -> None:
        balls = [(k, s, s.ball) for k, s in enumerate(sprites) if s.ball is not None]
        self._homes: dict[int, tuple[_Atlas, int]] = {}
        for members in shared([(s.within[2] - s.within[0], s.within[3] - s.within[1]) for _, s, _ in balls]):
            atlas = _Atlas([balls[i][1:] for i in members])
            self._homes |= {balls[i][0]: (atlas, place) for place, i in enumerate(members)}

    def drawn(self, there: Iterable[tuple[int, Placement]], fine: int = 1) -> dict[int, Drawn]:
        """Pixels of the balls among `there`, indices of sprites and where they moved to; others are passed over.

        Each pixel is the mean of `fine` x `fine` samples.
        """
        together: dict[int, tuple[_Atlas, list[tuple[int, int, Placement]]]] = {}
        for k, where in there:
            if k in self._homes and where.own is None:
                atlas, place = self._homes[k]
                together.setdefault(id(atlas), (atlas, []))[1].append((k, place, where))
        found: dict[int, Drawn] = {}
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
            lit.append(np.dstack([ball.lit[own] * coverage[..., None], np.zeros_like(coverage)]))
            skin.append(np.dstack([np.maximum(ball.skin[own], 0), np.zeros_like(coverage)]))
        row, starts = laid(still, cv2.BORDER_CONSTANT)
        self.still, self.left = doubled(row), 2 * starts
        self.lit = doubled(laid(lit, cv2.BORDER_CONSTANT)[0])
        self.skin = doubled(laid(skin, cv2.BORDER_REPLICATE)[0])
        self.corner = within[:, :2] + [sprite.corner for sprite, _ in members]
        self.center = np.array([ball.center for _, ball in members], np.float64)
        self.radius = np.array([ball.radius for _, ball in members], np.float64)
        self.last = 2 * (within[:, 2:] - within[:, :2]) - 2  # half pixels, of each picture's own end

    def drawn(self, which: Sequence[int], wheres: Sequence[Placement], fine: int) -> list[Drawn]:
        """See `Balls.drawn`; of the atlas' balls `which`."""
        some = np.array(which)
        h, w = (max(where.box[k].stop - where.box[k].start for where in wheres) for k in (0, 1))
        strip = Strip(len(wheres), (h, w), fine)
        along, columns, rows = strip.along, strip.columns, strip.rows
        at = np.array([(where.box[1].start, where.box[0].start) for where in wheres], np.float64)
        shift = np.array([where.shift for where in wheres])
        turn = np.array([where.space for where in wheres]).transpose(0, 2, 1)  # back to where points were
        radius, center, corner, left = (
            part[some] for part in (self.radius, self.center, self.corner, self.left)
        )
        x, y = strip.empty(), strip.empty()
        # what does not turn moves along
        moved = 2 * (at - corner - shift)
        x[:] = 2 * columns + along(moved[:, 0] + left)
        np.add(2 * rows, along(moved[:, 1] + 2 * GAP), out=y)
        picture, lit = warped(self.still, x, y), warped(self.lit, x, y)
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
        for k, place in enumerate((x, y)):
            back = 2 * radius[:, None] * turn[:, k]
            np.multiply(v, along(back[:, 1]), out=place)
            place += u * along(back[:, 0]) + along(2 * (center - corner)[:, k])
            place -= z * along(back[:, 2])
            np.maximum(place, 0, out=place)
            np.minimum(place, along(self.last[some, k]), out=place)
            place += along(left) if k == 0 else np.float32(2 * GAP)
        cv2.multiply(warped(self.skin, x, y), lit, dst=lit)
        cv2.add(picture, lit, dst=picture)
        if fine > 1:
            picture = np.asarray(
                cv2.resize(picture, (strip.n * w, h), interpolation=cv2.INTER_AREA), np.float32
            )
        light = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGRA2BGR), np.float32)  # the first three channels
        coverage = np.asarray(cv2.extractChannel(picture, 3), np.float32)
        through = thrice(1 - coverage)
        found = []
        for j, where in enumerate(wheres):
            tall, wide = (part.stop - part.start for part in where.box)
            own = np.s_[:tall, j * w : j * w + wide]
            found.append(Drawn(light[own], coverage[own], through[own]))
        return found
