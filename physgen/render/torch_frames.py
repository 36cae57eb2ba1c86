"""Frames drawn in batches by torch, within 1 grey level of `frames`.

Placement and shadows are computed by NumPy and OpenCV; the pixels of a batch are drawn on the device and come back
once, as bytes. OpenCV samples between pixels exactly from version 5 on; older ones round to 1/32 px, and edges may then
differ by more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import grid_sample

from physgen.photometry import decode, encode_u8
from physgen.problems import InputError
from physgen.render.ball import RIM, Ball
from physgen.render.occlusion import add_shadow, occlusion_factors, remove_photo_shadow, sprite_silhouette
from physgen.render.sprites import MOST_RELIGHTING, Sprite, double_resolution
from physgen.render.stage import Cover, Frame, Placement, SpritePose, Stage, sprite_coverage, sprite_poses
from physgen.simulate.trajectory import Trajectory

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
        return self._here(double_resolution(np.dstack([ball.gloss * coverage, coverage])))

    @cached_property
    def _rest(self) -> Tensor:
        """(h, w, 3), see `Sprite.rest`."""
        return self._here(self.sprite.rest)

    @cached_property
    def _skin(self) -> Tensor:
        """(2h - 1, 2w - 1, 3), see `Ball.skin`; of what the sprite covers."""
        assert self.sprite.ball is not None
        x0, y0, x1, y1 = self.sprite.within
        return self._here(double_resolution(np.maximum(self.sprite.ball.skin[y0:y1, x0:x1], 0)))

    @cached_property
    def _lit(self) -> Tensor:
        """(2h - 1, 2w - 1, 3), see `Ball.lit`; times coverage."""
        assert self.sprite.ball is not None
        return self._here(double_resolution(self.sprite.ball.lit * self.sprite.coverage[..., None]))

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
        return (facing.clamp(min=0) + even).clamp(1 / MOST_RELIGHTING, MOST_RELIGHTING)

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


F32 = NDArray[np.float32]
Moment = tuple[float, list[SpritePose]]

MOST = 32
"""Frames that are drawn at a time."""
BYTES = 256
"""That a pixel of a frame takes while it is drawn."""
ON_CPU = 2**30
"""Bytes for a batch, where torch draws on the processor."""


def opened(name: str) -> torch.device:
    """The device called `cpu`, `cuda`, `cuda:1`. Raises InputError where there is none."""
    device = torch.device(name)
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        fix = "leave --device out, or install NVIDIA's driver and a torch that is made for it"
        raise InputError.of("--device", f'"{name}"', "is no GPU that torch can use here", fix)
    return device


def title(name: str) -> str:
    """What draws on a device, for the manifest; raises as `opened`."""
    device = opened(name)
    model = f" ({torch.cuda.get_device_name(device)})" if device.type == "cuda" else ""
    return f"{device}{model}, torch {torch.__version__}"


def render_frames_torch(
    stage: Stage,
    trajectory: Trajectory,
    order: Sequence[int] | None = None,
    parts: int = 1,
    *,
    device: str,
    batch: int | None = None,
) -> Iterator[Frame]:
    """The frames of `render_frames(stage, trajectory, order, parts)`, drawn a `batch` at a time, or as many as fit.

    Raises as `opened`, and MemoryError where the device holds too little for a single one.
    """
    try:
        canvas = Canvas(stage, opened(device))
        batch = batch or _fitting(stage.background[..., 0].size, canvas.device)
        moments, index = sprite_poses(stage, trajectory, order), 0
        while group := list(islice(moments, batch * parts)):
            with torch.inference_mode():
                rgb, ids = (pictures.cpu().numpy() for pictures in canvas.exposed(group, parts))
            for (time, stands), picture, names in zip(group[parts - 1 :: parts], rgb, ids, strict=True):
                named, covering = partial(names.view, np.uint16), partial(_covering, stage, stands)
                yield Frame(index, time, picture, named, covering)
                index += 1
    except torch.OutOfMemoryError as error:
        raise MemoryError from error


def _covering(stage: Stage, stands: Sequence[SpritePose]) -> list[Cover]:
    """Worked out on the processor, which few ask for: at an edge, a pixel may differ from what was drawn."""
    there = [(stage.sprites[stand.k], stand.where) for stand in stands if stand.where is not None]
    return [Cover(sprite.body, where.box, sprite_coverage(sprite, where) >= 0.5) for sprite, where in there]


def _fitting(pixels: int, device: torch.device) -> int:
    """Frames of so many pixels that half of the free memory holds."""
    free = torch.cuda.mem_get_info(device)[0] // 2 if device.type == "cuda" else ON_CPU
    return max(1, min(MOST, free // (BYTES * pixels)))


class Canvas:
    """A stage on a device."""

    def __init__(self, stage: Stage, device: torch.device) -> None:
        self.stage, self.device, self.lit = stage, device, stage.lit
        self.plate = self._here(decode(stage.background) if self.lit is None else self.lit.plate)
        self.encoding = self._here(encode_u8(np.arange(65536) / 65535))
        self.cutouts = [Cutout(sprite, device, stage.supersample) for sprite in stage.sprites]
        self.tint = None if self.lit is None else self._here(self.lit.tint)

    def _here(self, values: NDArray[np.generic]) -> Tensor:
        return torch.tensor(values, device=self.device)

    def exposed(self, moments: Sequence[Moment], parts: int) -> tuple[Tensor, Tensor]:
        """(n, H, W, 3) uint8 sRGB, the means of `parts` moments each in linear light, and (n, H, W) ids of the last."""
        light = torch.zeros((), device=self.device)
        for part in range(parts):
            more, ids = self.drawn([stands for _, stands in moments[part::parts]])
            light = light + more
        return self._encoded(light / parts), ids

    def _encoded(self, light: Tensor) -> Tensor:
        """As `photometry.encode_u8`."""
        return self.encoding[(light * 65535 + 0.5).int().clamp(0, 65535)]

    def drawn(self, moments: Sequence[Sequence[SpritePose]]) -> tuple[Tensor, Tensor]:
        """(n, H, W, 3) linear light and (n, H, W) int16 ids."""
        n, (H, W) = len(moments), self.plate.shape[:2]
        factors: list[dict[int, F32]] = [{} for _ in moments]
        brighter: Tensor | None = None
        if self.lit is None or self.tint is None:
            light = self.plate.repeat(n, 1, 1, 1)
        else:
            dark, factors = self.darkness(moments)
            light = self.plate * torch.exp(self._here(dark)[..., None] * -self.tint)
            brighter = torch.exp((self._here(self.lit.total) - self._here(dark)).clamp(max=1))[..., None]
        ids = torch.zeros((n, H, W), dtype=torch.int16, device=self.device)
        for k, cutout in enumerate(self.cutouts):
            there = [(m, where) for m, stands in enumerate(moments) if (where := stands[k].where) is not None]
            for patch in cutout.patches(there, (W, H), [factor.get(k) for factor in factors]):
                at = patch.at
                light[at] = light[at] * (1 - patch.coverage)[..., None] + patch.light
                if patch.rest is not None:
                    light[at] += patch.rest if brighter is None else patch.rest * brighter[at]
                ids[at] = torch.where(patch.coverage >= 0.5, cutout.sprite.body + 1, ids[at])
        return light, ids

    def darkness(self, moments: Sequence[Sequence[SpritePose]]) -> tuple[F32, list[dict[int, F32]]]:
        """(n, H, W) -log of the light that all shadows leave behind objects, and for each moment `veiled`."""
        assert self.lit is not None
        dark: F32 = np.repeat(self.lit.total[None], len(moments), axis=0)
        factors = []
        for picture, stands in zip(dark, moments, strict=True):
            figures = {}
            for stand in stands:
                asked = self.stage.veils is not None or self.lit.casts[stand.k].sliding is None
                if stand.where is not None and asked:
                    coverage = sprite_coverage(self.stage.sprites[stand.k], stand.where)
                    figures[stand.k] = sprite_silhouette(self.stage, stand, stand.where, coverage)
            moved = [stand for stand in stands if stand.start != stand.pose]
            for stand in moved:
                remove_photo_shadow(picture, self.lit, stand)
                add_shadow(picture, self.lit, stand, figures.get(stand.k))
            seen = [stand for stand in stands if stand.where is not None]
            factors.append(occlusion_factors(self.stage, seen, figures))
        return dark, factors
