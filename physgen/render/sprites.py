"""Photo, label map and background to one sprite per object, with relief shading.

At t = 0 the sprites laid over the background give the photo exactly: what soft borders leave unexplained is kept beside
the object that is on top there, and fades as the object leaves its place. Relief shading follows Lambert's law (section
3.3 of the paper); the photo's light times the ratio of two shadings is albedo times the new one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.geometry.raster import coverage_box, double_resolution
from physgen.geometry.shadows import PixelBox
from physgen.maps import F32, U8, U16
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.photometry import DistantLight, decode
from physgen.render.ball import Ball
from physgen.render.wheel_sprites import WheelSprite

Mask = NDArray[np.bool_]

MOST_RELIGHTING = 3.0
"""Times brighter or darker than in the photo, at most: beyond, normals or light are in error."""


@dataclass(frozen=True)
class SpriteTuning:
    """Widths and thresholds of cut-out sprites."""

    facing: float = 0.02
    """Of the shading, by which it must change somewhere for the normals to be worth keeping."""
    soft: int = 5  # px beyond a mask's border that its soft coverage may reach
    blur: float = 1.2  # px: how gently coverage far from all masks is shared
    crisp: float = (
        0.5  # px: how gently touching objects share the pixels along their border
    )
    distant: float = 1e-3  # weight of BLUR's share beside CRISP's
    least: float = (
        1e-4  # of a mask's blur: with BLUR, what is left of it 4.4 px beyond the border
    )
    clean: int = 2
    """px inside the border where the photo shows the object alone, unmixed with what is behind it."""
    halo: float = (
        40 / 512
    )  # of the photo's longer side: how far around an object its blurred rim may reach
    shared: float = (
        5.0  # px: how gently neighbours share what the photo shows between them
    )
    unseen: float = 1e-4  # of linear light: less is no difference from the photo
    gap: int = 10  # px from an object up to which what is dark beside it may be another one's doing, too
    rim: int = (
        4  # px inside an outline, where light changes with the depth: rounded edges
    )
    along: float = 8.0  # px: how gently that goes on along the outline
    rough: float = 0.2  # of log light: error that a fill may leave which only shades
    faces: float = 0.5  # cosine to the light, from which a gap keeps light from a border that would have it
    seen: float = 0.2
    """Of an object's mask that must lie apart from others, for their rims to be left out of what is continued."""
    covered: float = 0.2
    """Share of light that objects in front let through, below which all that a pixel shows is theirs."""
    beside: float = 0.35
    """Of an object's size (root of its mask's area): how far what the lens sees of it may lie beside its shape."""
    face: float = 0.35  # of that: how far above its shape a face of it that is seen on one side only
    shaded: float = 0.8  # of the usual light of a row of its top, that the shadows of others leave at most
    flat: float = 2.0  # px by which the top of a shape may rise and be level
    texture: float = 3.0  # px: what is finer is texture, what is coarser is shading
    glint: float = 2.0  # times its mean: what texture stands out more is no texture
    side_light: float = (
        0.7  # of a block's top, that any of its sides has: tables and walls give light
    )
    side_hidden: float = (
        0.9  # of a side's light, kept away by fronts of others close to it
    )
    leans: float = 0.25  # rad from which the top that the photo shows of a block has given way to its sides
    dark: float = 0.003  # of linear light, below which levels are alike
    sides: int = (
        12  # of the shape that stands for a sprite where only its reach matters
    )


CUT = SpriteTuning()


@dataclass(frozen=True)
class Relief:
    """Shading of one object on its sprite's box, by how far it has turned: Lambert's law is linear in the light."""

    along: F32  # (h, w): intensity x (n . l) in the picture's plane, over the photo's shading.
    across: F32  # (h, w): the same with the light turned by a quarter from +x to +y
    fixed: F32  # (h, w): the same along the view, which no turn changes
    even: F32  # (h, w): ambient light over the photo's shading

    def ratio(self, turn: float) -> F32:
        """(h, w) by which light is multiplied where the object has turned by `turn` rad."""
        facing: F32 = np.asarray(
            cv2.addWeighted(self.along, cos(turn), self.across, -sin(turn), 0.0),
            np.float32,
        )
        facing += self.fixed
        np.maximum(facing, 0, out=facing)
        facing += self.even
        return np.asarray(
            np.clip(facing, 1 / MOST_RELIGHTING, MOST_RELIGHTING, out=facing),
            np.float32,
        )


def lambert(light: DistantLight, normals: F32) -> F32:
    """(h, w) of normals (h, w, 3)."""
    facing = normals @ np.array(light.direction, np.float32)
    return np.asarray(
        np.float32(light.ambient) + np.float32(light.intensity) * np.maximum(facing, 0),
        np.float32,
    )


def relief_of(normals: F32, known: Mask, light: DistantLight) -> Relief | None:
    """`normals` (h, w, 3), of which those `known` (h, w) are the object's; None where turning changes nothing."""
    if not known.any() or light.intensity <= 0:
        return None
    weight = known.astype(np.float32)
    carried = np.where(known[..., None], normals, np.float32(0))
    for sigma in (1.0, 3.0):
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(carried * weight[..., None], (0, 0), sigma)
        new = (weight == 0) & (norm > 1e-3)
        carried[new] = spread[new] / norm[new][:, None]
        weight[new] = 1.0
    carried[weight == 0] = (0.0, 0.0, 1.0)
    carried /= np.maximum(np.linalg.norm(carried, axis=2, keepdims=True), 1e-6)
    shade = np.maximum(lambert(light, carried), np.float32(0.05))
    x, y, z = (np.float32(light.intensity * part) / shade for part in light.direction)
    found = Relief(
        along=np.asarray(carried[..., 0] * x + carried[..., 1] * y, np.float32),
        # turned by a quarter, (x, y) is (-y, x)
        across=np.asarray(carried[..., 1] * x - carried[..., 0] * y, np.float32),
        fixed=np.asarray(carried[..., 2] * z, np.float32),
        even=np.asarray(np.float32(light.ambient) / shade, np.float32),
    )
    changes = max(
        float(np.abs(found.ratio(turn)[known] - 1).mean())
        for turn in (0.8, 1.6, 3.1, 4.7)
    )
    return found if changes > CUT.facing else None


@dataclass(frozen=True)
class Sides:
    """What is seen of a block beside its front, from a little above: its upper sides, swept upwards behind it."""

    first: float
    """Row of its sprite's box at which its front begins, below its top, as it stands in the photo."""
    depth: float  # px by which its back appears higher than its front
    colour: F32  # (3,) linear light of its top in the photo
    light: DistantLight | None  # None: every side has that colour

    def share(self, turn: float) -> float:
        """0..1: how far the sides stand for the top that the photo shows, of a block turned by `turn` rad."""
        share = min(abs(turn) / CUT.leans, 1.0)
        return share if share * self.depth >= 0.5 else 0.0

    def kept(
        self, matrix: NDArray[np.float64], shape: tuple[int, int], turn: float
    ) -> F32:
        """(h, w) of a picture of this `shape`: what is left where the top was; `matrix` (2, 3) leads to the sprite."""
        along, down, off = matrix[1].astype(np.float32)
        x, y = (np.arange(side, dtype=np.float32) for side in shape[::-1])
        top = np.clip(
            along * -x + (np.float32(self.first + 0.5) - off - down * y)[:, None], 0, 1
        )
        return np.asarray(1 - np.float32(self.share(turn)) * top, np.float32)

    def drawn(self, coverage: F32, turn: float) -> tuple[F32, F32]:
        """(h, w) coverage of the sides of a front with its `coverage` (h, w) that has turned by `turn` rad.

        And (w,) by which `colour` is multiplied in each column.
        """
        tall = np.ones((round(self.share(turn) * self.depth) + 1, 1), np.uint8)
        whole, angle = cv2.dilate(coverage, tall, anchor=(0, 0)), turn % (np.pi / 2)
        if self.light is None:
            return np.asarray(whole - coverage, np.float32), np.ones(
                whole.shape[1], np.float32
            )
        faces = [
            [-cos(angle), -sin(angle), 0],
            [sin(angle), -cos(angle), 0],
            [0, -1, 0],
        ]
        left, right, top = lambert(self.light, np.array(faces, np.float32)).tolist()
        uppermost = np.flatnonzero(whole[np.argmax((whole > 0.5).any(axis=1))] > 0.5)
        corner = (
            0
            if not len(uppermost)
            else uppermost[0]
            if angle < np.pi / 4
            else uppermost[-1] + 1
        )
        shade = np.where(np.arange(whole.shape[1]) < corner, left, right) / max(
            top, 1e-3
        )
        return np.asarray(whole - coverage, np.float32), np.maximum(
            shade, CUT.side_light
        ).astype(np.float32)


MARGIN = 2  # px of nothing around a sprite, so that interpolation fades to nothing


TRUST = (0.3, 0.8)
"""Coverage up to which a pixel's own light is a guess, and from which it is the photo less the background."""


@dataclass(frozen=True)
class Sprite:
    """One object's pixels at t = 0."""

    body: int  # index into the world's bodies
    corner: tuple[
        int, int
    ]  # photo column and row of the box's first pixel; may be negative
    light: F32  # (h, w, 3) linear, multiplied by coverage
    coverage: F32  # (h, w) in 0..1.
    rest: F32 | None = None
    """(h, w, 3) linear: what the photo shows here beyond light and background, at the border alone; of either sign."""
    halo: tuple[tuple[int, int], F32, NDArray[np.int32]] | None = None
    """The same around the object, where it covers nothing: a photo column and row, (h, w, 3) linear, and (h, w)
    1 + the body that is near, too; as it goes, so does the halo. 0: none."""
    ball: Ball | None = (
        None  # of a sphere: its skin, which turns in space; `light` then holds at t = 0 alone
    )
    relief: Relief | None = (
        None  # of what is no ball: the normals that turn with it, where they are known
    )
    hider: NDArray[np.int32] | None = None
    """(h, w): 1 + the body that touches the object here in the photo; as it goes, so does `rest`. 0: none."""

    face: float = 0.0
    """px by which the front that is seen lies below the plane of motion, however the object turns."""
    sides: Sides | None = None
    wheels: tuple[WheelSprite, ...] = ()
    """They turn on it."""

    @cached_property
    def hull(self) -> list[tuple[float, float]]:
        """px of the photo: corners of a shape with CUT.sides sides around all that shows anything."""
        rows, columns = np.nonzero(self.coverage)
        if not len(rows):
            return []
        points = cv2.convexHull(
            np.column_stack([columns, rows]).astype(np.int32)
        ).reshape(-1, 2)
        angle = np.arange(CUT.sides) * (2 * np.pi / CUT.sides)
        across = np.column_stack([np.cos(angle), np.sin(angle)])
        far = (points @ across.T).max(axis=0)
        # where neighbouring sides meet
        pairs = np.stack([across, np.roll(across, -1, axis=0)], axis=1)
        corners = np.linalg.solve(
            pairs, np.stack([far, np.roll(far, -1)], axis=1)[..., None]
        )[..., 0]
        return [(x + self.corner[0], y + self.corner[1]) for x, y in corners.tolist()]

    @cached_property
    def hiders(self) -> int:
        """1 + the last of the body itself and of those in `hider` and `halo`."""
        beside = (self.hider, None if self.halo is None else self.halo[2])
        return max(
            [self.body + 1, *(int(near.max()) for near in beside if near is not None)]
        )

    @cached_property
    def beside(self) -> NDArray[np.int32]:
        """(n,) all that is in `hider`, 0 where there is none."""
        return np.zeros(1, np.int32) if self.hider is None else np.unique(self.hider)

    @cached_property
    def fine(self) -> F32:
        """(2h - 1, 2w - 1, 4): light and coverage at every half pixel, for warps.

        Lanczos halfway between pixels, so that linear interpolation on this grid stays sharp and moves a picture by
        exactly what was asked; OpenCV's own cubic (a = -0.75) is off by up to 0.05 px.
        """
        return double_resolution(np.dstack([self.light, self.coverage]))

    @cached_property
    def within(self) -> tuple[int, int, int, int]:
        """x0, y0, x1, y1 px of its own box around all that it covers."""
        rows, columns = (
            np.flatnonzero((self.coverage > 0).any(axis=axis)) for axis in (1, 0)
        )
        if not len(rows):
            return 0, 0, 1, 1
        return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

    @cached_property
    def fine_coverage(self) -> F32:
        """(2h - 1, 2w - 1): the coverage of `fine` alone."""
        return double_resolution(self.coverage)


def cut_sprites(
    rgb: U8,
    labels: U16,
    absent: Mask,
    coverage: F32,
    background: U8,
    order: Mapping[int, int],
    shapes: Sequence[Outline] = (),
    toward: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> list[Sprite]:
    """Sprites in drawing order, the farthest first; what others hide of their `shapes`, one a body, is completed.

    `order` has bodies and their layers in turn: where these differ, the larger is in front, whatever seems hidden.
    `rgb`, `background` (H, W, 3) sRGB; `labels` (H, W), id k + 1 is body k; `absent` (H, W): objects of the photo that
    the scene leaves out, which vanish; `coverage` (H, W) of all objects together, absent ones too. None is `anchored`.
    Borders that narrow gaps keep dark are lit by a light that is `toward`, as they would be without the gap.
    """
    photo, behind = decode(rgb), decode(background)
    taken, square = (
        ((labels > 0) | absent).astype(np.uint8),
        np.ones((CUT.gap + 1,) * 2, np.uint8),
    )
    closed = cv2.morphologyEx(
        taken, cv2.MORPH_CLOSE, square, borderType=cv2.BORDER_REPLICATE
    )
    dim = dilate(
        closed > taken, CUT.clean + 1
    )  # gaps too narrow for light, and borders beside them
    boxes = _boxes(labels)
    hidden = {}
    for k, shape in enumerate(shapes):
        if (
            k + 1 in boxes
            and (part := _hidden(labels, absent, k, shape, boxes[k + 1])) is not None
        ):
            hidden[k], boxes[k + 1] = part, part.box
    drawn = _hiding_last(order, hidden)
    total, crisp_total = (
        _soft((labels > 0) | absent, sigma) for sigma in (CUT.blur, CUT.crisp)
    )
    around = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    sprites = []
    for k in drawn:
        if k + 1 not in boxes:
            continue
        x0, y0, x1, y1 = boxes[k + 1]
        box = np.s_[y0:y1, x0:x1]
        soft, crisp = (
            _soft(labels[box] == k + 1, sigma) for sigma in (CUT.blur, CUT.crisp)
        )
        shared = (crisp + CUT.distant * soft) / np.maximum(
            crisp_total[box] + CUT.distant * total[box], 1e-9
        )
        share: F32 = np.asarray(shared, np.float32)
        alpha = np.where(soft > CUT.least, coverage[box] * share, 0.0).astype(
            np.float32
        )
        alpha[(labels[box] == k + 1) & (alpha > 0.995)] = 1.0
        mine, none = labels[box] == k + 1, np.zeros(alpha.shape, np.bool_)
        down, right = np.gradient(_soft(mine, CUT.clean))
        facing = -(toward[0] * right + toward[1] * down) / np.maximum(
            np.hypot(right, down), 1e-6
        )
        disc = k < len(shapes) and isinstance(
            shapes[k], Disc
        )  # `ball` tells light from shade
        others = np.where(mine, 0, labels[box]).astype(np.int32)
        touching, by = _nearest(others, none, CUT.gap), (others > 0) | absent[box]
        # no hole of its own; and its other borders are not as dark
        gaps = dim[box] & dilate(touching > 0, CUT.clean + 1)
        rim = mine & ~gaps & dilate(~mine, CUT.clean)
        plain = (
            not disc
            and rim.any()
            and photo[box][rim].mean() > photo[box][mine].mean() / 2
        )
        lit = np.where(gaps & plain, np.maximum(facing, 0), 0).astype(np.float32)
        light = _foreground(photo[box], behind[box], mine, alpha, share, lit, disc)
        if k in hidden or (dilate(by, CUT.clean) & mine).any():
            part = hidden.get(k) or _Hidden(
                boxes[k + 1], labels[box], np.zeros_like(alpha), none, by
            )
            light, alpha = _completed(
                photo[box], mine, light, alpha, coverage[box], part, lit, disc
            )
            if k < len(shapes) and not disc:
                plain, shaded = _unshaded_top(
                    photo[box], mine, by, bounds(shapes[k])[1] - y0
                )
                light = np.where(shaded[..., None], plain * alpha[..., None], light)
                touching = np.where(
                    shaded, _nearest(others, none, sum(labels.shape)), touching
                )
        sprites.append(
            Sprite(
                body=k,
                corner=(x0 - MARGIN, y0 - MARGIN),
                light=np.pad(light.astype(np.float32), (*around, (0, 0))),
                coverage=np.pad(alpha, around),
                hider=np.pad(touching, around) if touching.any() else None,
            )
        )
    return sprites


@dataclass(frozen=True)
class _Hidden:
    """A part of an object's shape that others hide in the photo."""

    box: PixelBox  # x0, y0, x1, y1 px of the photo around mask and shape
    labels: U16  # (h, w) of the photo
    shape: F32  # (h, w) coverage
    hole: Mask  # (h, w): hidden pixels
    by: Mask  # (h, w): pixels of what hides it, or any other object


def _unshaded_top(photo: F32, mine: Mask, by: Mask, row: float) -> tuple[F32, Mask]:
    """(h, w, 3) an object with its top, which is seen on either side of the first `row` of its shape, in even light;
    and (h, w) where that has the shadows of others, `by`, that stand on it."""
    first, free = int(mine.any(axis=1).argmax()), mine & ~dilate(by, CUT.clean)
    x, plain, dark, top = (
        np.arange(mine.shape[1]),
        photo.copy(),
        np.zeros_like(mine),
        np.zeros_like(mine),
    )
    for y in range(
        first, min(ceil(2 * row - first), len(photo)) if row - first > 0.7 else first
    ):
        if not free[y].any():
            continue
        level = photo[y].mean(axis=1)
        dark[y] = free[y] & (level < CUT.shaded * np.percentile(level[free[y]], 70))
        lit = free[y] & ~dark[y]
        if 3 * np.count_nonzero(lit) > len(x):
            top[y], line = (
                True,
                np.polynomial.polynomial.polyfit(x[lit], photo[y][lit], 1),
            )
            plain[y] = np.maximum(np.outer(x, line[1]) + line[0], 0)
    _, parts = cv2.connectedComponents(dark.astype(np.uint8))
    shade = np.isin(parts, parts[dark & dilate(by, CUT.clean + 2)])
    return plain, top & dilate(shade | by, CUT.clean + 1) & shade.any()


def _hidden(
    labels: U16, absent: Mask, k: int, shape: Outline, box: PixelBox
) -> _Hidden | None:
    """What other objects hide of body k's shape, whose mask's box is given; None: nothing."""
    flat, (left, top) = coverage_box(shape, (0, 0, labels.shape[1], labels.shape[0]))
    if not flat.size:
        return None
    right, bottom = left + flat.shape[1], top + flat.shape[0]
    x0, y0, x1, y1 = (
        min(box[0], left),
        min(box[1], top),
        max(box[2], right),
        max(box[3], bottom),
    )
    part = labels[y0:y1, x0:x1]
    mine = part == k + 1
    by = ((part > 0) & ~mine) | absent[y0:y1, x0:x1]
    cover = np.pad(flat, ((top - y0, y1 - bottom), (left - x0, x1 - right)))
    # a rim or a face that the lens sees beside the shape goes on behind what stands before its middle
    reach = CUT.beside * np.count_nonzero(mine) ** 0.5
    near = (
        cv2.distanceTransform((cover < 0.5).astype(np.uint8), cv2.DIST_L2, 3) <= reach
    )
    both = near & np.logical_and(*_beside(mine, by))
    solid = cover >= 0.5
    tops = solid.argmax(axis=0)[solid.any(axis=0)]
    # above a level top: a face of it, seen on either side
    if len(tops) and np.ptp(np.percentile(tops, (10, 90))) <= CUT.flat:
        tall = np.ones((2 * round(CUT.face * reach) + 1, 1), np.uint8)
        over = cv2.dilate(solid.astype(np.uint8), tall) > 0
        both |= over & np.logical_or(*_beside(mine & ~solid, by))
    cover = np.maximum(cover, (by & both).astype(np.float32))
    hole = (cover >= 0.5) & by
    return _Hidden((x0, y0, x1, y1), part, cover, hole, by) if hole.any() else None


def _beside(own: Mask, by: Mask) -> tuple[Mask, Mask]:
    """(h, w): pixels to the right, and to the left, of an object's `own` in their row; none but others are between."""
    x = np.arange(1, own.shape[1] + 1)
    sides = []
    for step in (1, -1):
        last, open_ = (
            np.maximum.accumulate(np.where(part[:, ::step], x, 0), axis=1)[:, ::step]
            for part in (own, ~by & ~own)
        )
        sides.append(last > open_)
    return sides[0], sides[1]


def _hiding_last(order: Mapping[int, int], hidden: Mapping[int, _Hidden]) -> list[int]:
    """The drawing order, changed within a layer so that what hides another object is drawn after it.

    Pixels of what hides nothing leave the `hole`: what is in a farther layer, and of two that hide parts of each other
    the one that hides less.
    """
    seen = {
        (k, j): int((h.labels[h.hole] == j + 1).sum())
        for k, h in hidden.items()
        for j in order
    }
    before: dict[int, set[int]] = {k: set() for k in order}
    for k, by in sorted(
        (pair for pair in seen if seen[pair]), key=seen.__getitem__, reverse=True
    ):
        if by in before[k] or order[by] < order[k]:
            hidden[k].hole[hidden[k].labels == by + 1] = False
        else:
            for other in order:
                before[other] |= (
                    {k} | before[k] if other == by or by in before[other] else set()
                )
    left, drawn = list(order), []
    while left:
        drawn.append(next(k for k in left if before[k].isdisjoint(left)))
        left.remove(drawn[-1])
    return drawn


def _completed(
    photo: F32,
    mask: Mask,
    light: F32,
    alpha: F32,
    together: F32,
    part: _Hidden,
    lit: F32,
    round_: bool,
) -> tuple[F32, F32]:
    """Light (h, w, 3) and coverage (h, w) with the hidden part, and with a rim that others do not darken.

    The coverage is at most that of all objects, `together` (h, w). Shading goes on smoothly, texture is mirrored.
    """
    sure = mask & ~dilate(part.by, CUT.clean + 1) & (lit < CUT.faces)
    if np.count_nonzero(sure) < CUT.seen * np.count_nonzero(mask):
        sure = mask
    level = np.log(photo + np.float32(CUT.dark))
    smooth = harmonic_fill(level, ~sure)
    weight = sure.astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(weight, (0, 0), CUT.texture), 1e-3)[..., None]
    even = cv2.GaussianBlur(level * weight[..., None], (0, 0), CUT.texture) / near
    seeds = cv2.distanceTransformWithLabels(
        (~sure).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    places = np.zeros((int(seeds.max()) + 1, 2), np.int64)
    places[seeds[sure]] = np.argwhere(sure)
    here = np.moveaxis(np.indices(mask.shape), 0, -1)
    mirrored = np.clip(2 * places[seeds] - here, 0, np.array(mask.shape) - 1)
    y, x = mirrored[..., 0], mirrored[..., 1]
    fine = np.where(sure[..., None], level - even, np.float32(0))
    most = CUT.glint * np.abs(fine[sure]).mean(axis=0)
    smooth = smooth + np.clip(fine, -most, most).astype(np.float32)[y, x]
    if not round_:  # a ball's rim is known from its light
        smooth += _rims(level, smooth, sure, mask | (part.shape >= 0.5))
    filled = np.maximum(np.exp(smooth) - np.float32(CUT.dark), 0)
    zone = dilate(part.hole, CUT.clean + 1)
    edge = np.clip(2 * _soft(mask | (part.shape >= 0.5)) - 0.5, 0, 1)
    cover = np.where(zone, np.maximum(alpha, np.minimum(edge, together)), alpha).astype(
        np.float32
    )
    anew = ((zone | (mask & dilate(part.by, CUT.clean))) & ~sure)[..., None]
    return np.asarray(
        np.where(anew, filled * cover[..., None], light), np.float32
    ), cover


def _rims(level: F32, smooth: F32, sure: Mask, whole: Mask) -> F32:
    """(h, w, 3) what `smooth` lacks of the rim of a `whole` object (h, w), by what is `sure` at the same depth beside.

    Rounded edges change the `level` of light with their depth, not along the outline.
    """
    depth = np.rint(
        cv2.distanceTransform(np.pad(whole, 1).astype(np.uint8), cv2.DIST_L2, 3)[
            1:-1, 1:-1
        ]
    )
    inner, found = (
        harmonic_fill(level, ~(sure & (depth > CUT.rim)), CUT.rough),
        np.zeros_like(smooth),
    )
    for d in range(1, CUT.rim + 1):
        there = ((depth == d) & sure).astype(np.float32)
        near = cv2.GaussianBlur(there, (0, 0), CUT.along)[..., None]
        rim = cv2.GaussianBlur(
            (level - inner) * there[..., None], (0, 0), CUT.along
        ) / np.maximum(near, 1e-6)
        share = np.clip(
            5 * CUT.along * near, 0, 1
        )  # half a line that ends here is enough
        found += np.where(
            ((depth == d) & ~sure)[..., None], share * (inner + rim - smooth), 0
        )
    return found


def anchored(
    sprites: Sequence[Sprite],
    photo: F32,
    behind: F32,
    absent: Mask,
    owner: NDArray[np.int32] | None = None,
) -> list[Sprite]:
    """Sprites whose `rest` and `halo` make them, over `behind` (H, W, 3) linear, the photo (H, W, 3) at t = 0.

    A pixel's rest goes with the object that shows most there; where none covers it, with its `owner`
    (H, W), 1 + an index, or with the nearest where that is 0.
    """
    height, width = behind.shape[:2]
    composite, top = behind.copy(), np.zeros((height, width), np.int32)
    last, most = np.zeros_like(top), np.zeros((height, width), np.float32)
    insides = [
        np.s_[
            MARGIN : s.coverage.shape[0] - MARGIN, MARGIN : s.coverage.shape[1] - MARGIN
        ]
        for s in sprites
    ]
    places = []
    for number, (sprite, inside) in enumerate(zip(sprites, insides, strict=True), 1):
        alpha = sprite.coverage[inside]
        x0, y0 = sprite.corner[0] + MARGIN, sprite.corner[1] + MARGIN
        place = np.s_[y0 : y0 + alpha.shape[0], x0 : x0 + alpha.shape[1]]
        composite[place] = (
            sprite.light[inside] + (1 - alpha[..., None]) * composite[place]
        )
        most[place] *= 1 - alpha
        ahead = (alpha > 0) & (alpha >= most[place])
        top[place][ahead], most[place][ahead] = number, alpha[ahead]
        last[place][alpha > 0] = number
        places.append(place)
    through = _seen_through(sprites, insides, places, top)
    covered = through < CUT.covered
    top[covered], through[covered] = last[covered], 1
    rest = (photo - composite) / cv2.merge((through, through, through))
    if absent.any():
        rest[_soft(absent) > CUT.least] = 0.0
    near = _nearest(top, absent, round(CUT.halo * max(height, width)))
    if owner is not None:
        near = np.where(owner > 0, owner, near)
    near[(top > 0) | (np.maximum.reduce(cv2.split(np.abs(rest))) <= CUT.unseen)] = 0
    all_near, pad = _soft(near > 0, CUT.shared), max(ceil(4 * CUT.shared), CUT.gap)
    none, bodies = (
        np.zeros_like(absent),
        np.array([0, *(sprite.body + 1 for sprite in sprites)], np.int32),
    )
    found = []
    for number, (sprite, inside, place) in enumerate(
        zip(sprites, insides, places, strict=True), 1
    ):
        own = np.zeros_like(sprite.light)
        own[inside] = np.where(
            (top[place] == number)[..., None], rest[place], np.float32(0)
        )
        mine, halo = near == number, None
        x, y, w, h = cv2.boundingRect(mine.astype(np.uint8))
        if w:
            x0, y0 = max(x - pad, 0), max(y - pad, 0)
            there = np.s_[y0 : y + h + pad, x0 : x + w + pad]
            share = np.where(
                near[there] > 0,
                _soft(mine[there], CUT.shared) / np.maximum(all_near[there], 1e-6),
                0,
            )
            beside = _nearest(
                np.where(top[there] == number, 0, top[there]), none[there], CUT.gap
            )
            halo = (
                (x0, y0),
                np.asarray(share[..., None] * rest[there], np.float32),
                bodies[beside],
            )
        found.append(replace(sprite, rest=own, halo=halo))
    return found


def _seen_through(
    sprites: Sequence[Sprite],
    insides: Sequence[tuple[slice, slice]],
    places: Sequence[tuple[slice, slice]],
    top: NDArray[np.int32],
) -> F32:
    """(H, W) of what is drawn with sprite number `top` (H, W): what those drawn after it let through."""
    through = np.ones(top.shape, np.float32)
    for number, (sprite, inside, place) in enumerate(
        zip(sprites, insides, places, strict=True), 1
    ):
        through[place] *= 1 - sprite.coverage[inside]
        through[place][top[place] == number] = 1
    return through


def _nearest(top: NDArray[np.int32], absent: Mask, reach: int) -> NDArray[np.int32]:
    """(H, W) the number in `top` that is nearest, 0 where that is an `absent` object or none within `reach` px."""
    seeds = (top > 0) | absent
    if not seeds.any():
        return np.zeros_like(top)
    away, places = cv2.distanceTransformWithLabels(
        (~seeds).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    numbers = np.zeros(int(places.max()) + 1, np.int32)
    numbers[places[seeds]] = top[seeds]
    return np.where(away <= reach, numbers[places], 0).astype(np.int32)


def _soft(mask: Mask, sigma: float = CUT.blur) -> F32:
    """A mask blurred by `sigma` px: shares of touching masks add up to that of their union."""
    return np.asarray(
        cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma), np.float32
    )


def _boxes(labels: U16) -> dict[int, tuple[int, int, int, int]]:
    """Box x0, y0, x1, y1 of every id with room for its soft border, in one pass over the map."""
    height, width = labels.shape
    rows, columns = np.nonzero(labels)
    ids = labels[rows, columns]
    order = np.argsort(ids, kind="stable")
    present, first = np.unique(ids[order], return_index=True)
    low = (
        [np.minimum.reduceat(at[order], first) - CUT.soft for at in (columns, rows)]
        if len(first)
        else []
    )
    high = (
        [np.maximum.reduceat(at[order], first) + CUT.soft + 1 for at in (columns, rows)]
        if len(first)
        else []
    )
    boxes = zip(*(part.tolist() for part in (present, *low, *high)), strict=True)
    return {
        k: (max(x0, 0), max(y0, 0), min(x1, width), min(y1, height))
        for k, x0, y0, x1, y1 in boxes
    }


def _foreground(
    photo: F32, behind: F32, mask: Mask, alpha: F32, share: F32, lit: F32, disc: bool
) -> F32:
    """The object's own light times `alpha` (h, w, 3): the photo less what shows through of the background.

    Where little of a pixel is the object's, and what is behind it is not well known, the light that is carried outwards
    from inside bounds it, less so of a `disc`, whose rim is darker. It has at least the share `lit` (h, w) of that.
    """
    inside = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[
        1:-1, 1:-1
    ]
    sure = (inside > CUT.clean) & (alpha >= 1.0) & (lit == 0)
    if not sure.any():
        sure = inside >= min(float(inside.max()), CUT.clean)
    weight = sure.astype(np.float32)
    filled: F32 = photo.copy()
    known = sure.copy()
    for sigma in (1.0, 2.0, 4.0, 8.0):
        if known[alpha > 0].all():
            break
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(photo * weight[..., None], (0, 0), sigma)
        new = ~known & (norm > 1e-3)
        filled[new] = spread[new] / norm[new][:, None]
        known |= new
    a = alpha[..., None]
    own = photo - (1 - a) * behind
    trust = np.clip(((1 + disc) * a - TRUST[0]) / (TRUST[1] - TRUST[0]), 0, 1)
    trust = trust * np.clip(10 * share - 9, 0, 1)[..., None]
    light = np.where(a > 0, trust * np.clip(own, 0, None) + (1 - trust) * a * filled, 0)
    return np.asarray(np.maximum(light, lit[..., None] * a * filled), np.float32)
