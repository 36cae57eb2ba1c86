"""Sprite + where it stands in many frames -> its pixels in all of them, drawn by torch: `placing.drawn` for a batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from physgen.render.ball import RIM, Ball
from physgen.render.finer import doubled
from physgen.render.placing import Placement
from physgen.render.relief import MOST
from physgen.render.sprites import Sprite

Standing = Sequence[tuple[int, Placement]]
"""Frames of the batch, each with where the sprite is there."""


@dataclass(frozen=True)
class Patch:
    """A sprite's pixels in n frames of a batch; its boxes are made as large as the largest, h by w."""

    at: tuple[Tensor, Tensor, Tensor]
    """Frames (n, 1, 1), rows (n, h, 1) and columns (n, 1, w) of the batch."""
    light: Tensor
    """(n, h, w, 3) linear, multiplied by coverage."""
    coverage: Tensor
    """(n, h, w) in 0..1."""
    rest: Tensor | None = None
    """(n, h, w, 3), see `placing.drawn`."""


@dataclass(frozen=True)
class Cutout:
    """A sprite on a device."""

    sprite: Sprite
    device: torch.device
    fine: int = 1
    """Samples a pixel, along each side, where it moved."""

    def _here(self, values: object) -> Tensor:
        return torch.tensor(np.asarray(values, np.float32), device=self.device)

    @cached_property
    def _still(self) -> Tensor:
        """(h, w, 4) light at t = 0, and coverage."""
        return self._here(np.dstack([self.sprite.light, self.sprite.coverage]))

    @cached_property
    def _fine(self) -> Tensor:
        """(2h - 1, 2w - 1, 4), see `Sprite.fine`; of a ball, what it shows beside its shaded skin."""
        if (ball := self.sprite.ball) is None:
            return self._here(self.sprite.fine)
        coverage = self.sprite.coverage[..., None]
        return self._here(doubled(np.dstack([ball.gloss * coverage, coverage])))

    @cached_property
    def _rest(self) -> Tensor:
        """(h, w, 3), see `Sprite.rest`."""
        return self._here(self.sprite.rest)

    @cached_property
    def _skin(self) -> Tensor:
        """(2h - 1, 2w - 1, 3), see `Ball.skin`; of what the sprite covers."""
        assert self.sprite.ball is not None
        x0, y0, x1, y1 = self.sprite.within
        return self._here(doubled(np.maximum(self.sprite.ball.skin[y0:y1, x0:x1], 0)))

    @cached_property
    def _lit(self) -> Tensor:
        """(2h - 1, 2w - 1, 3), see `Ball.lit`; times coverage."""
        assert self.sprite.ball is not None
        return self._here(doubled(self.sprite.ball.lit * self.sprite.coverage[..., None]))

    @cached_property
    def _relief(self) -> Tensor:
        """(4, h, w): `along`, `across`, `fixed` and `even` of `Relief`."""
        found = self.sprite.relief
        assert found is not None
        return self._here([found.along, found.across, found.fixed, found.even])

    def patches(
        self, standing: Standing, size: tuple[int, int], factors: Sequence[NDArray[np.float32] | None]
    ) -> Iterator[Patch]:
        """Its pixels on canvases of `size` (W, H); `factors`, one a frame, multiply its light on its box."""
        if still := [(m, where) for m, where in standing if where.own is not None]:
            at, _, _ = self._box(still, size)
            picture = self._still[still[0][1].own].expand(len(still), -1, -1, -1)  # the same in all frames
            rest = None
            if self.sprite.rest is not None:
                rest = self._rest[still[0][1].own].expand(len(still), -1, -1, -1)
            yield self._veiled(Patch(at, picture[..., :3], picture[..., 3], rest), still, factors)
        if moved := [(m, where) for m, where in standing if where.own is None]:
            yield self._veiled(self._moved(moved, size), moved, factors)

    def _veiled(
        self, patch: Patch, standing: Standing, factors: Sequence[NDArray[np.float32] | None]
    ) -> Patch:
        if all(factors[m] is None for m, _ in standing):
            return patch
        n, h, w = patch.coverage.shape
        more = np.ones((n, h, w), np.float32)
        _, rows, columns = patch.at
        for j, (m, where) in enumerate(standing):
            if (factor := factors[m]) is not None:
                y, x = where.box[0].start - int(rows[j, 0, 0]), where.box[1].start - int(columns[j, 0, 0])
                more[j, y : y + factor.shape[0], x : x + factor.shape[1]] = factor
        return replace(patch, light=patch.light * self._here(more)[..., None])

    def _box(
        self, standing: Standing, size: tuple[int, int]
    ) -> tuple[tuple[Tensor, Tensor, Tensor], NDArray[np.int64], Tensor]:
        """`Patch.at`, (n, 2) its first columns and rows, and (n, h, w) where the placements' own boxes are."""
        boxes = [where.box for _, where in standing]
        low = np.array([[columns.start, rows.start] for rows, columns in boxes])
        high = np.array([[columns.stop, rows.stop] for rows, columns in boxes])
        w, h = (high - low).max(axis=0).tolist()
        first = np.minimum(low, np.array(size) - (w, h))  # so that the largest fits everywhere

        def across(values: NDArray[np.int64]) -> Tensor:
            return torch.tensor(values, device=self.device)[:, None, None]

        columns = across(first[:, 0]) + torch.arange(w, device=self.device)
        rows = across(first[:, 1]) + torch.arange(h, device=self.device)[:, None]
        inside = (columns >= across(low[:, 0])) & (columns < across(high[:, 0]))
        inside = inside & (rows >= across(low[:, 1])) & (rows < across(high[:, 1]))
        return (across(np.array([m for m, _ in standing])), rows, columns), first, inside

    def _moved(self, standing: Standing, size: tuple[int, int]) -> Patch:
        at, first, inside = self._box(standing, size)
        wheres = [where for _, where in standing]
        h, w = inside.shape[1:]
        # a placement's matrix counts from the corner of its own box
        lows = np.array([[where.box[1].start, where.box[0].start] for where in wheres])
        matrices = np.array([where.matrix for where in wheres])
        matrices[..., 2:] += matrices[..., :2] @ (first - lows)[..., None]
        (a, b, c), (d, e, f) = self._here(matrices.transpose(1, 2, 0))[..., None, None]
        p = torch.arange(w, dtype=torch.float32, device=self.device)
        q = torch.arange(h, dtype=torch.float32, device=self.device)[:, None]
        light = torch.zeros((*inside.shape, 3), device=self.device)
        coverage = torch.zeros(inside.shape, device=self.device)
        steps = (np.arange(self.fine) + 0.5) / self.fine - 0.5
        turns = self._here([where.turn for where in wheres])[:, None, None]
        ratio = None if self.sprite.relief is None else self._ratio(turns)[..., None]
        for right, down in ((i, j) for j in steps.tolist() for i in steps.tolist()):
            pp, qq = p + right, q + down
            x, y = a * pp + b * qq + c, d * pp + e * qq + f  # (n, h, w) px of the sprite
            fine = sampled(self._fine, 2 * x, 2 * y)
            part, covers = fine[..., :3], fine[..., 3].clamp(0, 1)
            if ratio is not None:
                part = part * torch.where(turns[..., None] != 0, sampled(ratio, x, y), 1.0)
            if (ball := self.sprite.ball) is not None:
                middles = np.array(ball.center) + [where.shift for where in wheres] - first
                spaces = self._here([where.space for where in wheres])
                part = part + self._seen(ball, self._here(middles), spaces, pp, qq)
            light, coverage = light + part / self.fine**2, coverage + covers / self.fine**2
        rest = None
        if self.sprite.rest is not None and any(where.rest > 0 for where in wheres):
            shares = self._here([where.rest for where in wheres])[:, None, None, None]
            x, y = a * p + b * q + c, d * p + e * q + f
            rest = shares * sampled(self._rest, x, y) * inside[..., None]
        return Patch(at, light * inside[..., None], coverage * inside, rest)

    def _ratio(self, turns: Tensor) -> Tensor:
        """(n, h, w), see `Relief.ratio`; `turns` (n, 1, 1) rad."""
        along, along_too, fixed, even = self._relief
        facing = along * torch.cos(turns) - along_too * torch.sin(turns) + fixed
        return (facing.clamp(min=0) + even).clamp(1 / MOST, MOST)

    def _seen(self, ball: Ball, middles: Tensor, spaces: Tensor, p: Tensor, q: Tensor) -> Tensor:
        """(n, h, w, 3) a ball's shaded skin times coverage, see `balls.py`.

        `middles` (n, 2) px from the boxes' corners, `spaces` (n, 3, 3).
        """
        u = (p - middles[:, 0, None, None]) / ball.radius
        v = (q - middles[:, 1, None, None]) / ball.radius
        z = (1 - (u * u + v * v)).clamp(min=1 - RIM * RIM).sqrt()
        back = ball.radius * spaces.permute(2, 1, 0)[..., None, None]  # of the inverse turn, (3, 3, n, 1, 1)
        x, y = (
            back[k, 0] * u
            + (ball.center[k] - ball.corner[k] - self.sprite.within[k])
            + back[k, 1] * v
            - back[k, 2] * z
            for k in (0, 1)
        )
        skin = sampled(self._skin, 2 * x, 2 * y)
        right = p - middles[:, 0, None, None] + (ball.center[0] - ball.corner[0])
        down = q - middles[:, 1, None, None] + (ball.center[1] - ball.corner[1])
        right, down = torch.broadcast_tensors(right, down)
        return skin * sampled(self._lit, 2 * right, 2 * down)


def sampled(picture: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """(n, h, w, C) of a picture ([n,] H, W, C) at `x`, `y` (n, h, w) px; beyond its border lies the border's pixel."""
    H, W, C = picture.shape[-3:]
    grid = torch.stack((2 * x / (W - 1) - 1, 2 * y / (H - 1) - 1), dim=-1)
    pictures = picture.expand(len(x), H, W, C).permute(0, 3, 1, 2)
    found = grid_sample(pictures, grid, mode="bilinear", padding_mode="border", align_corners=True)
    return found.permute(0, 2, 3, 1)
