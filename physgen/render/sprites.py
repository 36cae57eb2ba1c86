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

from physgen.arrays import Mask as Mask
from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.geometry.raster import coverage_box, double_resolution
from physgen.geometry.shadows import PixelBox
from physgen.maps import F32, U8, U16
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.photometry import DistantLight, decode
from physgen.render.ball import Ball
from physgen.render.wheel_sprites import WheelSprite

MOST_RELIGHTING = 3.0
"""Times brighter or darker than in the photo, at most: beyond, normals or light are in error."""


@dataclass(frozen=True)
class SpriteTuning:
    """Widths and thresholds of cut-out sprites."""

    facing: float = 0.02
    """Of the shading, by which it must change somewhere for the normals to be worth keeping."""
    soft: int = 5
    """px beyond a mask's border that its soft coverage may reach."""
    blur: float = 1.2
    """px: how gently coverage far from all masks is shared."""
    crisp: float = 0.5
    """px: how gently touching objects share the pixels along their border."""
    distant: float = 1e-3
    """Weight of BLUR's share beside CRISP's."""
    least: float = 1e-4
    """Of a mask's blur: with BLUR, what is left of it 4.4 px beyond the border."""
    clean: int = 2
    """px inside the border where the photo shows the object alone, unmixed with what is behind it."""
    halo: float = 40 / 512
    """Of the photo's longer side: how far around an object its blurred rim may reach."""
    shared: float = 5.0
    """px: how gently neighbours share what the photo shows between them."""
    unseen: float = 1e-4
    """Of linear light: less is no difference from the photo."""
    gap: int = 10
    """px from an object up to which what is dark beside it may be another one's doing, too."""
    rim: int = 4
    """px inside an outline, where light changes with the depth: rounded edges."""
    along: float = 8.0
    """px: how gently that goes on along the outline."""
    rough: float = 0.2
    """Of log light: error that a fill may leave which only shades."""
    faces: float = 0.5
    """Cosine to the light, from which a gap keeps light from a border that would have it."""
    seen: float = 0.2
    """Of an object's mask that must lie apart from others, for their rims to be left out of what is continued."""
    covered: float = 0.2
    """Share of light that objects in front let through, below which all that a pixel shows is theirs."""
    beside: float = 0.35
    """Of an object's size (root of its mask's area): how far what the lens sees of it may lie beside its shape."""
    face: float = 0.35
    """Of that: how far above its shape a face of it that is seen on one side only."""
    shaded: float = 0.8
    """Of the usual light of a row of its top, that the shadows of others leave at most."""
    flat: float = 2.0
    """px by which the top of a shape may rise and be level."""
    texture: float = 3.0
    """px: what is finer is texture, what is coarser is shading."""
    glint: float = 2.0
    """Times its mean: what texture stands out more is no texture."""
    side_light: float = 0.7
    """Of a block's top, that any of its sides has: tables and walls give light."""
    side_hidden: float = 0.9
    """Of a side's light, kept away by fronts of others close to it."""
    leans: float = 0.25
    """rad from which the top that the photo shows of a block has given way to its sides."""
    dark: float = 0.003
    """Of linear light, below which levels are alike."""
    sides: int = 12
    """Of the shape that stands for a sprite where only its reach matters."""


CUT = SpriteTuning()


@dataclass(frozen=True)
class Relief:
    """Shading of one object on its sprite's box, by how far it has turned: Lambert's law is linear in the light."""

    along: F32
    """(h, w): intensity x (n . l) in the picture's plane, over the photo's shading."""
    across: F32
    """(h, w): the same with the light turned by a quarter from +x to +y."""
    fixed: F32
    """(h, w): the same along the view, which no turn changes."""
    even: F32
    """(h, w): ambient light over the photo's shading."""

    def ratio(self, turn: float) -> F32:
        """Return (h, w) by which light is multiplied if the object has turned by `turn` rad."""
        facing: F32 = np.asarray(
            cv2.addWeighted(self.along, cos(turn), self.across, -sin(turn), 0.0),
            np.float32,
        )
        # In place: this is a large part of the time of a frame.
        facing += self.fixed
        np.maximum(facing, 0, out=facing)
        facing += self.even
        np.clip(facing, 1 / MOST_RELIGHTING, MOST_RELIGHTING, out=facing)
        return facing


def lambert(light: DistantLight, normals: F32) -> F32:
    """Return the shading (h, w) of normals (h, w, 3)."""
    facing = np.maximum(normals @ np.array(light.direction, np.float32), 0)
    shading = np.float32(light.ambient) + np.float32(light.intensity) * facing
    return np.asarray(shading, np.float32)


TURNS = (0.8, 1.6, 3.1, 4.7)
"""rad at which a relief is compared with the photo, about a quarter of a turn apart."""


def relief_of(normals: F32, known: Mask, light: DistantLight) -> Relief | None:
    """Return the relief of `normals` (h, w, 3), of which those `known` (h, w) are the object's.

    None if turning changes nothing.
    """
    if not known.any() or light.intensity <= 0:
        return None
    carried = _carried_normals(normals, known)
    shade = np.maximum(lambert(light, carried), np.float32(0.05))
    x, y, z = (np.float32(light.intensity * part) / shade for part in light.direction)
    relief = Relief(
        along=np.asarray(carried[..., 0] * x + carried[..., 1] * y, np.float32),
        # turned by a quarter, (x, y) is (-y, x)
        across=np.asarray(carried[..., 1] * x - carried[..., 0] * y, np.float32),
        fixed=np.asarray(carried[..., 2] * z, np.float32),
        even=np.asarray(np.float32(light.ambient) / shade, np.float32),
    )
    changes = []
    for turn in TURNS:
        changes.append(float(np.abs(relief.ratio(turn)[known] - 1).mean()))
    return relief if max(changes) > CUT.facing else None


def _carried_normals(normals: F32, known: Mask) -> F32:
    """Return unit normals (h, w, 3), the known ones carried outwards.

    They face the viewer far from these.
    """
    weight = known.astype(np.float32)
    carried = np.where(known[..., None], normals, np.float32(0))
    for sigma in (1.0, 3.0):
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(carried * weight[..., None], (0, 0), sigma)
        reached = (weight == 0) & (norm > 1e-3)
        carried[reached] = spread[reached] / norm[reached][:, None]
        weight[reached] = 1.0
    carried[weight == 0] = (0.0, 0.0, 1.0)
    carried /= np.maximum(np.linalg.norm(carried, axis=2, keepdims=True), 1e-6)
    return carried


@dataclass(frozen=True)
class Sides:
    """What is seen of a block beside its front, from a little above: its upper sides, swept upwards behind it."""

    first: float
    """Row of its sprite's box at which its front begins, below its top, as it stands in the photo."""
    depth: float
    """px by which its back appears higher than its front."""
    colour: F32
    """(3,) linear light of its top in the photo."""
    light: DistantLight | None
    """None: every side has that colour."""

    def share(self, turn: float) -> float:
        """Return 0..1: how far the sides stand for the top that the photo shows, of a block turned by `turn` rad."""
        share = min(abs(turn) / CUT.leans, 1.0)
        return share if share * self.depth >= 0.5 else 0.0

    def kept(
        self, matrix: NDArray[np.float64], shape: tuple[int, int], turn: float
    ) -> F32:
        """Return (h, w) of a picture of this `shape`: the share that remains of the top.

        `matrix` (2, 3) leads from the picture to the sprite.
        """
        along, down, shift = matrix[1].astype(np.float32)
        height, width = shape
        x = np.arange(width, dtype=np.float32)
        y = np.arange(height, dtype=np.float32)
        first = np.float32(self.first + 0.5) - shift - down * y
        top = np.clip(along * -x + first[:, None], 0, 1)
        return np.asarray(1 - np.float32(self.share(turn)) * top, np.float32)

    def drawn(self, coverage: F32, turn: float) -> tuple[F32, F32]:
        """Draw the sides of a front with its `coverage` (h, w) that has turned by `turn` rad.

        Return their coverage (h, w), and (w,) by which `colour` is multiplied in each column.
        """
        height = round(self.share(turn) * self.depth) + 1
        column = np.ones((height, 1), np.uint8)
        dilated = cv2.dilate(coverage, column, anchor=(0, 0))
        block = np.asarray(dilated, np.float32)
        sides = np.asarray(block - coverage, np.float32)
        if self.light is None:
            return sides, np.ones(block.shape[1], np.float32)
        angle = turn % (np.pi / 2)
        left, right, top = self._face_light(angle)
        corner = _top_corner(block, is_left=angle < np.pi / 4)
        is_left_side = np.arange(block.shape[1]) < corner
        shade = np.where(is_left_side, left, right) / max(top, 1e-3)
        return sides, np.maximum(shade, CUT.side_light).astype(np.float32)

    def _face_light(self, angle: float) -> tuple[float, float, float]:
        """Return the light on the left and the right upper side of a turned block, and on its top."""
        assert self.light is not None
        left = [-cos(angle), -sin(angle), 0]
        right = [sin(angle), -cos(angle), 0]
        normals = np.array([left, right, [0, -1, 0]], np.float32)
        left_light, right_light, top_light = lambert(self.light, normals).tolist()
        return left_light, right_light, top_light


def _top_corner(block: F32, is_left: bool) -> int:
    """Return the first or, past the end, the last column of the uppermost row of a block's coverage."""
    first_row = np.argmax((block > 0.5).any(axis=1))
    columns = np.flatnonzero(block[first_row] > 0.5)
    if not len(columns):
        return 0
    return int(columns[0]) if is_left else int(columns[-1]) + 1


MARGIN = 2
"""px of nothing around a sprite, so that interpolation fades to nothing."""


TRUST = (0.3, 0.8)
"""Coverage up to which a pixel's own light is a guess, and from which it is the photo less the background."""


@dataclass(frozen=True)
class Sprite:
    """One object's pixels at t = 0."""

    body: int
    """Index into the world's bodies."""
    corner: tuple[
        int, int
    ]  # photo column and row of the box's first pixel; may be negative
    light: F32
    """(h, w, 3) linear, multiplied by coverage."""
    coverage: F32
    """(h, w) in 0..1."""
    rest: F32 | None = None
    """(h, w, 3) linear: what the photo shows here beyond light and background, at the border alone; of either sign."""
    halo: tuple[tuple[int, int], F32, NDArray[np.int32]] | None = None
    """The same around the object, where it covers nothing: a photo column and row, (h, w, 3) linear, and (h, w)
    1 + the body that is near, too; as it goes, so does the halo. 0: none."""
    ball: Ball | None = None
    """Of a sphere: its skin, which turns in space; `light` then holds at t = 0 alone."""
    relief: Relief | None = None
    """Of what is no ball: the normals that turn with it, where they are known."""
    hider: NDArray[np.int32] | None = None
    """(h, w): 1 + the body that touches the object here in the photo; as it goes, so does `rest`.

    0: none.
    """

    face: float = 0.0
    """px by which the front that is seen lies below the plane of motion, however the object turns."""
    sides: Sides | None = None
    wheels: tuple[WheelSprite, ...] = ()
    """They turn on it."""

    @cached_property
    def hull(self) -> list[tuple[float, float]]:
        """Return the corners, px of the photo, of a shape with CUT.sides sides around all visible pixels."""
        rows, columns = np.nonzero(self.coverage)
        if not len(rows):
            return []
        pixels = np.column_stack([columns, rows]).astype(np.int32)
        points = cv2.convexHull(pixels).reshape(-1, 2)
        angle = np.arange(CUT.sides) * (2 * np.pi / CUT.sides)
        normals = np.column_stack([np.cos(angle), np.sin(angle)])
        reach = (points @ normals.T).max(axis=0)
        # Corners are where neighbouring sides meet.
        pairs = np.stack([normals, np.roll(normals, -1, axis=0)], axis=1)
        reaches = np.stack([reach, np.roll(reach, -1)], axis=1)
        corners = np.linalg.solve(pairs, reaches[..., None])[..., 0]
        x0, y0 = self.corner
        return [(x + x0, y + y0) for x, y in corners.tolist()]

    @cached_property
    def hiders(self) -> int:
        """Return 1 + the last of the body itself and of those in `hider` and `halo`."""
        numbers = [self.body + 1]
        if self.hider is not None:
            numbers.append(int(self.hider.max()))
        if self.halo is not None:
            numbers.append(int(self.halo[2].max()))
        return max(numbers)

    @cached_property
    def halo_reach(self) -> F32:
        """Return (h, w) px from the pixels of `halo` to the object."""
        assert self.halo is not None
        (x, y), picture, _ = self.halo
        height, width = picture.shape[:2]
        rows, columns = np.nonzero(self.coverage > 0)
        rows, columns = rows + self.corner[1] - y, columns + self.corner[0] - x
        is_within = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        is_free = np.ones((height, width), np.uint8)
        is_free[rows[is_within], columns[is_within]] = 0
        reach = cv2.distanceTransform(is_free, cv2.DIST_L2, 5)
        return np.asarray(reach, np.float32)

    @cached_property
    def beside(self) -> NDArray[np.int32]:
        """Return (n,) the numbers in `hider`, 0 if there are none."""
        return np.zeros(1, np.int32) if self.hider is None else np.unique(self.hider)

    @cached_property
    def fine(self) -> F32:
        """Return (2h - 1, 2w - 1, 4): light and coverage at every half pixel, for warps.

        Lanczos halfway between pixels, so that linear interpolation on this grid stays sharp and moves a picture by
        exactly what was asked; OpenCV's own cubic (a = -0.75) is off by up to 0.05 px.
        """
        return double_resolution(np.dstack([self.light, self.coverage]))

    @cached_property
    def within(self) -> tuple[int, int, int, int]:
        """Return x0, y0, x1, y1 px of its own box around all that it covers."""
        solid = self.coverage > 0
        rows = np.flatnonzero(solid.any(axis=1))
        columns = np.flatnonzero(solid.any(axis=0))
        if not len(rows):
            return 0, 0, 1, 1
        return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

    @cached_property
    def fine_coverage(self) -> F32:
        """Return (2h - 1, 2w - 1): the coverage of `fine` alone."""
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
    """Cut the photo's objects out as sprites in drawing order, the farthest first.

    What others hide of their `shapes`, one a body, is completed. `order` has bodies and their layers in turn: where
    these differ, the larger is in front, whatever seems hidden. `rgb`, `background` (H, W, 3) sRGB; `labels` (H, W),
    id k + 1 is body k; `absent` (H, W): objects of the photo that the scene leaves out, which vanish; `coverage`
    (H, W) of all objects together, absent ones too. None is `anchored`. Borders that narrow gaps keep dark are lit by
    a light that is `toward`, as they would be without the gap.
    """
    boxes = _boxes(labels)
    hidden: dict[int, _Hidden] = {}
    for k, shape in enumerate(shapes):
        if k + 1 not in boxes:
            continue
        part = _hidden(labels, absent, k, shape, boxes[k + 1])
        if part is not None:
            hidden[k] = part
            boxes[k + 1] = part.box
    taken = (labels > 0) | absent
    cutter = _Cutter(
        photo=decode(rgb),
        behind=decode(background),
        labels=labels,
        absent=absent,
        coverage=coverage,
        soft_total=_soft(taken, CUT.blur),
        crisp_total=_soft(taken, CUT.crisp),
        dim=_dim_gaps(taken),
        shapes=shapes,
        toward=toward,
    )
    sprites = []
    for k in _hiding_last(order, hidden):
        if k + 1 in boxes:
            sprites.append(cutter.cut(k, boxes[k + 1], hidden.get(k)))
    return sprites


def _dim_gaps(taken: Mask) -> Mask:
    """Return gaps between objects that are too narrow for light, and the borders beside them."""
    solid = taken.astype(np.uint8)
    square = np.ones((CUT.gap + 1, CUT.gap + 1), np.uint8)
    closed = cv2.morphologyEx(
        solid, cv2.MORPH_CLOSE, square, borderType=cv2.BORDER_REPLICATE
    )
    return dilate(closed > solid, CUT.clean + 1)


@dataclass(frozen=True)
class _Cutter:
    """Cuts single objects out of a photo; maps are (H, W)."""

    photo: F32
    """(H, W, 3) linear."""
    behind: F32
    """(H, W, 3) linear: the background."""
    labels: U16
    absent: Mask
    coverage: F32
    soft_total: F32
    """Blur of all masks, by CUT.blur."""
    crisp_total: F32
    """Blur of all masks, by CUT.crisp."""
    dim: Mask
    """Gaps too narrow for light, and borders beside them."""
    shapes: Sequence[Outline]
    toward: tuple[float, float, float]

    def cut(self, k: int, bounds_px: PixelBox, hidden: _Hidden | None) -> Sprite:
        """Cut out body k, in a box of the photo."""
        x0, y0, x1, y1 = bounds_px
        box = np.s_[y0:y1, x0:x1]
        labels, photo = self.labels[box], self.photo[box]
        mask = labels == k + 1
        share, alpha = self._coverage(mask, box)
        is_disc = k < len(self.shapes) and isinstance(self.shapes[k], Disc)
        nothing = np.zeros(alpha.shape, np.bool_)
        others = np.where(mask, 0, labels).astype(np.int32)
        is_other = (others > 0) | self.absent[box]
        touching = _nearest(others, nothing, CUT.gap)
        gain = self._border_gain(mask, touching > 0, box, is_disc)
        light = _foreground(photo, self.behind[box], mask, alpha, share, gain, is_disc)
        has_neighbour = bool((dilate(is_other, CUT.clean) & mask).any())
        if hidden is not None or has_neighbour:
            part = hidden or _Hidden(
                bounds_px, labels, np.zeros_like(alpha), nothing, is_other
            )
            light, alpha = _completed(
                photo, mask, light, alpha, self.coverage[box], part, gain, is_disc
            )
            if k < len(self.shapes) and not is_disc:
                shape_top = bounds(self.shapes[k])[1] - y0
                plain, shaded = _unshaded_top(photo, mask, is_other, shape_top)
                light = np.where(shaded[..., None], plain * alpha[..., None], light)
                nearest = _nearest(others, nothing, sum(self.labels.shape))
                touching = np.where(shaded, nearest, touching)
        margin = ((MARGIN, MARGIN), (MARGIN, MARGIN))
        return Sprite(
            body=k,
            corner=(x0 - MARGIN, y0 - MARGIN),
            light=np.pad(light.astype(np.float32), (*margin, (0, 0))),
            coverage=np.pad(alpha, margin),
            hider=np.pad(touching, margin) if touching.any() else None,
        )

    def _coverage(self, mask: Mask, box: tuple[slice, slice]) -> tuple[F32, F32]:
        """Return an object's share of the pixels that objects cover, and its coverage."""
        soft, crisp = _soft(mask, CUT.blur), _soft(mask, CUT.crisp)
        own = crisp + CUT.distant * soft
        every = self.crisp_total[box] + CUT.distant * self.soft_total[box]
        share = np.asarray(own / np.maximum(every, 1e-9), np.float32)
        alpha = np.where(soft > CUT.least, self.coverage[box] * share, 0.0)
        alpha = alpha.astype(np.float32)
        alpha[mask & (alpha > 0.995)] = 1.0
        return share, alpha

    def _border_gain(
        self, mask: Mask, is_touched: Mask, box: tuple[slice, slice], is_disc: bool
    ) -> F32:
        """Return (h, w) the light that borders in dark gaps would have without the gap, by the cosine to the light."""
        # Not holes of its own; and its other borders must not be as dark.
        gaps = self.dim[box] & dilate(is_touched, CUT.clean + 1)
        rim = mask & ~gaps & dilate(~mask, CUT.clean)
        photo = self.photo[box]
        # A ball's light is told from its shade later.
        is_lit = bool(
            not is_disc and rim.any() and photo[rim].mean() > photo[mask].mean() / 2
        )
        down, right = np.gradient(_soft(mask, CUT.clean))
        slope = self.toward[0] * right + self.toward[1] * down
        facing = -slope / np.maximum(np.hypot(right, down), 1e-6)
        gain = np.where(gaps & is_lit, np.maximum(facing, 0), 0)
        return gain.astype(np.float32)


@dataclass(frozen=True)
class _Hidden:
    """A part of an object's shape that others hide in the photo."""

    box: PixelBox
    """X0, y0, x1, y1 px of the photo around mask and shape."""
    labels: U16
    """(h, w) of the photo."""
    shape: F32
    """(h, w) coverage."""
    hole: Mask
    """(h, w): hidden pixels."""
    by: Mask
    """(h, w): pixels of what hides it, or any other object."""


def _unshaded_top(
    photo: F32, mask: Mask, is_other: Mask, shape_top: float
) -> tuple[F32, Mask]:
    """Return (h, w, 3) an object with its top in even light; and (h, w) the shadows of others that stand on it.

    The top is seen on either side of the first row `shape_top` of its shape.
    """
    visible = mask & ~dilate(is_other, CUT.clean)
    x = np.arange(mask.shape[1])
    plain, dark, top = photo.copy(), np.zeros_like(mask), np.zeros_like(mask)
    for y in _top_rows(mask, shape_top):
        if not visible[y].any():
            continue
        level = photo[y].mean(axis=1)
        usual = np.percentile(level[visible[y]], 70)
        dark[y] = visible[y] & (level < CUT.shaded * usual)
        lit = visible[y] & ~dark[y]
        if 3 * np.count_nonzero(lit) > len(x):
            # The light of the lit pixels goes on evenly along the row.
            start, slope = np.polynomial.polynomial.polyfit(x[lit], photo[y][lit], 1)
            plain[y] = np.maximum(np.outer(x, slope) + start, 0)
            top[y] = True
    _, pieces = cv2.connectedComponents(dark.astype(np.uint8))
    # Only dark pieces that touch another object are its shadow.
    near_other = dilate(is_other, CUT.clean + 2)
    shadow = np.isin(pieces, pieces[dark & near_other])
    shaded = top & dilate(shadow | is_other, CUT.clean + 1)
    return plain, shaded & shadow.any()


def _top_rows(mask: Mask, shape_top: float) -> range:
    """Return the rows of an object's top, as many below the first row of its shape as above."""
    first = int(mask.any(axis=1).argmax())
    if shape_top - first <= 0.7:
        return range(0)
    return range(first, min(ceil(2 * shape_top - first), len(mask)))


def _hidden(
    labels: U16, absent: Mask, k: int, shape: Outline, box: PixelBox
) -> _Hidden | None:
    """Return the part of body k's shape that other objects hide, whose mask's box is given.

    None if they hide nothing.
    """
    window = (0, 0, labels.shape[1], labels.shape[0])
    shape_cover, (left, top) = coverage_box(shape, window)
    if not shape_cover.size:
        return None
    right, bottom = left + shape_cover.shape[1], top + shape_cover.shape[0]
    x0, y0 = min(box[0], left), min(box[1], top)
    x1, y1 = max(box[2], right), max(box[3], bottom)
    part = labels[y0:y1, x0:x1]
    mask = part == k + 1
    is_other = ((part > 0) & ~mask) | absent[y0:y1, x0:x1]
    cover = np.pad(shape_cover, ((top - y0, y1 - bottom), (left - x0, x1 - right)))
    beyond = _beyond_shape(mask, is_other, cover)
    cover = np.maximum(cover, (is_other & beyond).astype(np.float32))
    hole = (cover >= 0.5) & is_other
    if not hole.any():
        return None
    return _Hidden((x0, y0, x1, y1), part, cover, hole, is_other)


def _beyond_shape(mask: Mask, is_other: Mask, cover: F32) -> Mask:
    """Return the pixels beside a shape's `cover` (h, w) that a visible rim or face of the object continues to."""
    # A rim or a face that the lens sees beside the shape goes on behind what stands before its middle.
    reach = CUT.beside * np.count_nonzero(mask) ** 0.5
    outside = (cover < 0.5).astype(np.uint8)
    is_near = cv2.distanceTransform(outside, cv2.DIST_L2, 3) <= reach
    to_right, to_left = _beside(mask, is_other)
    beyond = is_near & to_right & to_left
    solid = cover >= 0.5
    tops = solid.argmax(axis=0)[solid.any(axis=0)]
    if len(tops) and np.ptp(np.percentile(tops, (10, 90))) <= CUT.flat:
        # Above a level top is a face of it, which is seen on either side.
        column = np.ones((2 * round(CUT.face * reach) + 1, 1), np.uint8)
        above = cv2.dilate(solid.astype(np.uint8), column) > 0
        to_right, to_left = _beside(mask & ~solid, is_other)
        beyond |= above & (to_right | to_left)
    return np.asarray(beyond, np.bool_)


def _beside(own: Mask, is_other: Mask) -> tuple[Mask, Mask]:
    """Return (h, w) the pixels to the right, and to the left, of an object's `own` pixels in their row.

    Only pixels of others lie between.
    """
    is_open = ~is_other & ~own
    to_right = _last_column(own) > _last_column(is_open)
    to_left = _last_column(own[:, ::-1]) > _last_column(is_open[:, ::-1])
    return to_right, to_left[:, ::-1]


def _last_column(mask: Mask) -> NDArray[np.int64]:
    """Return (h, w) 1 + the last column of a mask up to each pixel, 0 if there is none."""
    columns = np.arange(1, mask.shape[1] + 1)
    return np.maximum.accumulate(np.where(mask, columns, 0), axis=1)


def _hiding_last(order: Mapping[int, int], hidden: Mapping[int, _Hidden]) -> list[int]:
    """Return the drawing order, changed within a layer so that an object that hides another is drawn after it.

    Pixels of what hides nothing leave the `hole`: what is in a farther layer, and of two that hide parts of each other
    the one that hides less.
    """
    areas = {}
    for k, part in hidden.items():
        for other in order:
            area = int((part.labels[part.hole] == other + 1).sum())
            if area:
                areas[k, other] = area
    farther: dict[int, set[int]] = {k: set() for k in order}
    for k, front in sorted(areas, key=areas.__getitem__, reverse=True):
        if front in farther[k] or order[front] < order[k]:
            hidden[k].hole[hidden[k].labels == front + 1] = False
            continue
        for other in order:
            if other == front or front in farther[other]:
                farther[other] |= {k} | farther[k]
    remaining, drawing_order = list(order), []
    while remaining:
        k = next(k for k in remaining if farther[k].isdisjoint(remaining))
        drawing_order.append(k)
        remaining.remove(k)
    return drawing_order


def _completed(
    photo: F32,
    mask: Mask,
    light: F32,
    alpha: F32,
    together: F32,
    part: _Hidden,
    gain: F32,
    is_disc: bool,
) -> tuple[F32, F32]:
    """Return light (h, w, 3) and coverage (h, w) with the hidden part, and with a rim that others do not darken.

    The coverage is at most that of all objects, `together` (h, w). Shading goes on smoothly, texture is mirrored.
    """
    reliable = mask & ~dilate(part.by, CUT.clean + 1) & (gain < CUT.faces)
    if np.count_nonzero(reliable) < CUT.seen * np.count_nonzero(mask):
        reliable = mask
    level = np.log(photo + np.float32(CUT.dark))
    smooth = harmonic_fill(level, ~reliable) + _mirrored_texture(level, reliable)
    object_mask = mask | (part.shape >= 0.5)
    if not is_disc:  # a ball's rim is known from its light
        smooth += _rims(level, smooth, reliable, object_mask)
    filling = np.maximum(np.exp(smooth) - np.float32(CUT.dark), 0)
    zone = dilate(part.hole, CUT.clean + 1)
    edge = np.clip(2 * _soft(object_mask) - 0.5, 0, 1)
    completed = np.maximum(alpha, np.minimum(edge, together))
    cover = np.where(zone, completed, alpha).astype(np.float32)
    is_new = (zone | (mask & dilate(part.by, CUT.clean))) & ~reliable
    result = np.where(is_new[..., None], filling * cover[..., None], light)
    return np.asarray(result, np.float32), cover


def _mirrored_texture(level: F32, reliable: Mask) -> F32:
    """Return (h, w, 3) the fine detail of log light, mirrored at the border of the `reliable` pixels (h, w)."""
    weight = reliable.astype(np.float32)
    norm = np.maximum(cv2.GaussianBlur(weight, (0, 0), CUT.texture), 1e-3)[..., None]
    even = cv2.GaussianBlur(level * weight[..., None], (0, 0), CUT.texture) / norm
    fine = np.where(reliable[..., None], level - even, np.float32(0))
    limit = CUT.glint * np.abs(fine[reliable]).mean(axis=0)
    fine = np.clip(fine, -limit, limit).astype(np.float32)
    unknown = (~reliable).astype(np.uint8)
    _, seeds = cv2.distanceTransformWithLabels(
        unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(seeds.max()) + 1, 2), np.int64)
    places[seeds[reliable]] = np.argwhere(reliable)
    pixels = np.moveaxis(np.indices(reliable.shape), 0, -1)
    last = np.array(reliable.shape) - 1
    mirrored = np.clip(2 * places[seeds] - pixels, 0, last)
    return np.asarray(fine[mirrored[..., 0], mirrored[..., 1]], np.float32)


def _rims(level: F32, smooth: F32, reliable: Mask, object_mask: Mask) -> F32:
    """Return (h, w, 3) the rim that `smooth` lacks, by the `reliable` pixels at the same depth beside.

    Rounded edges change the `level` of light with their depth, not along the outline.
    """
    padded = np.pad(object_mask, 1).astype(np.uint8)
    depth = np.rint(cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1])
    inner = harmonic_fill(level, ~(reliable & (depth > CUT.rim)), CUT.rough)
    rims = np.zeros_like(smooth)
    for number in range(1, CUT.rim + 1):
        ring = depth == number
        weight = (ring & reliable).astype(np.float32)
        norm = cv2.GaussianBlur(weight, (0, 0), CUT.along)[..., None]
        difference = (level - inner) * weight[..., None]
        spread = cv2.GaussianBlur(difference, (0, 0), CUT.along)
        rim = spread / np.maximum(norm, 1e-6)
        # Half a line of reliable pixels that ends here is enough.
        share = np.clip(5 * CUT.along * norm, 0, 1)
        is_unknown = (ring & ~reliable)[..., None]
        rims += np.where(is_unknown, share * (inner + rim - smooth), 0)
    return rims


def anchored(
    sprites: Sequence[Sprite],
    photo: F32,
    behind: F32,
    absent: Mask,
    owner: NDArray[np.int32] | None = None,
) -> list[Sprite]:
    """Return sprites whose `rest` and `halo` make them, over `behind` (H, W, 3) linear, the photo (H, W, 3) at t = 0.

    A pixel's rest goes with the object that shows most there; where none covers it, with its `owner`
    (H, W), 1 + an index, or with the nearest where that is 0.
    """
    height, width = behind.shape[:2]
    boxes = [_SpriteBox.of(sprite) for sprite in sprites]
    composite, top, last = _compose(sprites, boxes, behind)
    through = _seen_through(sprites, boxes, top)
    is_covered = through < CUT.covered
    top[is_covered], through[is_covered] = last[is_covered], 1
    rest = (photo - composite) / cv2.merge((through, through, through))
    if absent.any():
        rest[_soft(absent) > CUT.least] = 0.0
    near = _nearest(top, absent, round(CUT.halo * max(height, width)))
    if owner is not None:
        near = np.where(owner > 0, owner, near)
    largest = np.maximum.reduce(cv2.split(np.abs(rest)))
    near[(top > 0) | (largest <= CUT.unseen)] = 0
    all_near = _soft(near > 0, CUT.shared)
    bodies = np.array([0, *(sprite.body + 1 for sprite in sprites)], np.int32)
    anchored_sprites = []
    pairs = zip(sprites, boxes, strict=True)
    for number, (sprite, box) in enumerate(pairs, 1):
        own_rest = np.zeros_like(sprite.light)
        is_own = (top[box.photo] == number)[..., None]
        own_rest[box.sprite] = np.where(is_own, rest[box.photo], np.float32(0))
        halo = _halo(number, near, all_near, rest, top, bodies)
        anchored_sprites.append(replace(sprite, rest=own_rest, halo=halo))
    return anchored_sprites


@dataclass(frozen=True)
class _SpriteBox:
    """The pixels of a sprite within its margin."""

    sprite: tuple[slice, slice]
    """Rows and columns of the sprite."""
    photo: tuple[slice, slice]
    """The same of the photo."""

    @classmethod
    def of(cls, sprite: Sprite) -> _SpriteBox:
        height, width = sprite.coverage.shape
        x0, y0 = sprite.corner
        inside = np.s_[MARGIN : height - MARGIN, MARGIN : width - MARGIN]
        return cls(
            inside,
            np.s_[
                y0 + MARGIN : y0 + height - MARGIN, x0 + MARGIN : x0 + width - MARGIN
            ],
        )


def _compose(
    sprites: Sequence[Sprite], boxes: Sequence[_SpriteBox], behind: F32
) -> tuple[F32, NDArray[np.int32], NDArray[np.int32]]:
    """Draw sprites over the background.

    Return the picture (H, W, 3), and (H, W) 1 + the index of the sprite that shows most, and of the last one.
    """
    composite, shape = behind.copy(), behind.shape[:2]
    top, last = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    largest = np.zeros(shape, np.float32)
    pairs = zip(sprites, boxes, strict=True)
    for number, (sprite, box) in enumerate(pairs, 1):
        alpha, place = sprite.coverage[box.sprite], box.photo
        remaining = (1 - alpha[..., None]) * composite[place]
        composite[place] = sprite.light[box.sprite] + remaining
        largest[place] *= 1 - alpha
        is_ahead = (alpha > 0) & (alpha >= largest[place])
        top[place][is_ahead] = number
        largest[place][is_ahead] = alpha[is_ahead]
        last[place][alpha > 0] = number
    return composite, top, last


def _halo(
    number: int,
    near: NDArray[np.int32],
    all_near: F32,
    rest: F32,
    top: NDArray[np.int32],
    bodies: NDArray[np.int32],
) -> tuple[tuple[int, int], F32, NDArray[np.int32]] | None:
    """Return the halo of sprite `number`: a sprite's share of the rest that no sprite covers.

    None if it has none.
    """
    mine = near == number
    x, y, width, height = cv2.boundingRect(mine.astype(np.uint8))
    if not width:
        return None
    margin = max(ceil(4 * CUT.shared), CUT.gap)
    x0, y0 = max(x - margin, 0), max(y - margin, 0)
    box = np.s_[y0 : y + height + margin, x0 : x + width + margin]
    own_share = _soft(mine[box], CUT.shared) / np.maximum(all_near[box], 1e-6)
    share = np.where(near[box] > 0, own_share, 0)
    others = np.where(top[box] == number, 0, top[box])
    nothing = np.zeros(others.shape, np.bool_)
    beside = _nearest(others, nothing, CUT.gap)
    picture = np.asarray(share[..., None] * rest[box], np.float32)
    return (x0, y0), picture, bodies[beside]


def _seen_through(
    sprites: Sequence[Sprite],
    boxes: Sequence[_SpriteBox],
    top: NDArray[np.int32],
) -> F32:
    """Return (H, W) the share of sprite number `top` (H, W) that the sprites drawn after it let through."""
    through = np.ones(top.shape, np.float32)
    pairs = zip(sprites, boxes, strict=True)
    for number, (sprite, box) in enumerate(pairs, 1):
        through[box.photo] *= 1 - sprite.coverage[box.sprite]
        through[box.photo][top[box.photo] == number] = 1
    return through


def _nearest(top: NDArray[np.int32], absent: Mask, reach: int) -> NDArray[np.int32]:
    """Return (H, W) the nearest number in `top`.

    0 if the nearest is an `absent` object or farther than `reach` px.
    """
    seeds = (top > 0) | absent
    if not seeds.any():
        return np.zeros_like(top)
    distance, places = cv2.distanceTransformWithLabels(
        (~seeds).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    numbers = np.zeros(int(places.max()) + 1, np.int32)
    numbers[places[seeds]] = top[seeds]
    return np.where(distance <= reach, numbers[places], 0).astype(np.int32)


def _soft(mask: Mask, sigma: float = CUT.blur) -> F32:
    """Blur a mask by `sigma` px: shares of touching masks add up to that of their union."""
    blurred = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma)
    return np.asarray(blurred, np.float32)


def _boxes(labels: U16) -> dict[int, PixelBox]:
    """Return the box of every id with room for its soft border, in one pass over the map."""
    height, width = labels.shape
    rows, columns = np.nonzero(labels)
    if not len(rows):
        return {}
    ids = labels[rows, columns]
    order = np.argsort(ids, kind="stable")
    present, first = np.unique(ids[order], return_index=True)
    rows, columns = rows[order], columns[order]
    left = np.minimum.reduceat(columns, first) - CUT.soft
    top = np.minimum.reduceat(rows, first) - CUT.soft
    right = np.maximum.reduceat(columns, first) + CUT.soft + 1
    bottom = np.maximum.reduceat(rows, first) + CUT.soft + 1
    table = np.column_stack([present, left, top, right, bottom]).tolist()
    boxes = {}
    for id_, x0, y0, x1, y1 in table:
        boxes[id_] = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
    return boxes


def _foreground(
    photo: F32,
    behind: F32,
    mask: Mask,
    alpha: F32,
    share: F32,
    gain: F32,
    is_disc: bool,
) -> F32:
    """Return the object's own light times `alpha` (h, w, 3): the photo less what shows through of the background.

    Where little of a pixel is the object's, and what is behind it is not well known, the light that is carried outwards
    from inside bounds it, less so of a disc, whose rim is darker. It has at least the share `gain` (h, w) of that.
    """
    padded = np.pad(mask, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
    reliable = (depth > CUT.clean) & (alpha >= 1.0) & (gain == 0)
    if not reliable.any():
        reliable = depth >= min(float(depth.max()), CUT.clean)
    carried = _carried_light(photo, reliable, alpha > 0)
    opacity = alpha[..., None]
    own = np.clip(photo - (1 - opacity) * behind, 0, None)
    least, full = TRUST
    trust = np.clip(((1 + is_disc) * opacity - least) / (full - least), 0, 1)
    trust = trust * np.clip(10 * share - 9, 0, 1)[..., None]
    mixed = trust * own + (1 - trust) * opacity * carried
    light = np.where(opacity > 0, mixed, 0)
    least_light = gain[..., None] * opacity * carried
    return np.asarray(np.maximum(light, least_light), np.float32)


def _carried_light(photo: F32, reliable: Mask, needed: Mask) -> F32:
    """Return the photo (h, w, 3) with the light of `reliable` pixels carried to all `needed` ones."""
    carried: F32 = photo.copy()
    weight, known = reliable.astype(np.float32), reliable.copy()
    for sigma in (1.0, 2.0, 4.0, 8.0):
        if known[needed].all():
            break
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(photo * weight[..., None], (0, 0), sigma)
        reached = ~known & (norm > 1e-3)
        carried[reached] = spread[reached] / norm[reached][:, None]
        known |= reached
    return carried
