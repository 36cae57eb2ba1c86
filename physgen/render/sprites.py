"""From photo, label map and background to one sprite per object, with relief shading.

At t = 0 the sprites over the background equal the photo exactly: the unexplained rest
of soft borders is stored with the topmost object, and fades as the object leaves its
place. Relief shading follows Lambert's law (section 3.3 of the paper): the photo's
light times the ratio of two shadings is albedo times the new shading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import Indices
from physgen.arrays import Mask as Mask
from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.geometry.raster import coverage_box, double_resolution
from physgen.geometry.shadows import PixelBox
from physgen.maps import F32, U8, U16
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.photometry import DistantLight, decode
from physgen.render.ball import Ball
from physgen.render.block_tops import BlockTop
from physgen.render.foot_halos import FootHalo
from physgen.render.wheel_sprites import WheelSprite

MOST_RELIGHTING = 3.0
"""Maximum change of brightness to the photo, as a factor: beyond it, normals or light
are wrong.
"""


@dataclass(frozen=True)
class SpriteTuning:
    """Widths and thresholds of cut-out sprites."""

    facing: float = 0.02
    """Minimum change of shading by a rotation; below it, no normals are stored."""
    border_reach: int = 5
    """Reach of the soft coverage beyond a mask's border, px."""
    blur: float = 1.2
    """Width of the sharing of coverage far from all masks, px."""
    touch_width: float = 0.5
    """Width of the sharing between touching objects along their border, px."""
    blur_weight: float = 1e-3
    """Weight of the share by `blur` relative to that by `touch_width`."""
    least_blur: float = 1e-4
    """Value of a mask's blur below which it is 0: with `blur`, 4.4 px beyond the
    border.
    """
    clean_depth: int = 2
    """Distance inside the border, px, at which the photo shows only the object."""
    halo: float = 40 / 512
    """Reach of the blurred rim around an object, as a share of the photo's
    longer side.
    """
    rest_width: float = 5.0
    """Width of the sharing of the rest between neighbours, px."""
    unseen: float = 1e-4
    """Linear light below which a difference from the photo is invisible."""
    gap: int = 10
    """Distance from an object, px, up to which darkness beside it may be another
    object's.
    """
    rim: int = 4
    """Depth of rounded edges inside an outline, px."""
    outline_width: float = 8.0
    """Width of smoothing along the outline, px."""
    fill_error: float = 0.2
    """Error in log light that a fill of shading may leave."""
    faces: float = 0.5
    """Cosine to the light above which a gap deprives a border of light."""
    brightest: float = 2.0
    """Largest light of a border pixel relative to that inside."""
    light_excess: float = 0.03
    """Linear light that a border pixel may have beyond that."""
    leak: float = 2.0
    """Light that a border may lose, relative to what its background lacks."""
    coverage_error: float = 0.3
    """Error of a border's coverage: the share of the light outside it may lose."""
    gap_shade: float = 0.25
    """Darkness in log light by which a gap beside a border shows."""
    free_share: float = 0.2
    """Share of an object's mask that must be apart from others, so that pixels near
    others' rims can be left out of continuation.
    """
    trace: float = 0.1
    """Coverage up to which the rest belongs to the ground: traces of coverage are
    speckled along a border, and a rest that moves there beside one that stays shows
    as dots. Chosen by eye at the foot of a cup that slides by half a pixel.
    """
    hidden_share: float = 0.2
    """Share of light let through by objects in front below which a pixel is all
    theirs.
    """
    side_reach: float = 0.35
    """Reach of visible parts beside an object's shape, in roots of its mask's area."""
    lumpy: float = 0.08
    """Largest distance of a fruit's outline from its disc, in roots of the disc's area."""
    step: float = 2.0
    """Least distance of a mask's pixels from the disc of a fruit, px."""
    crack: int = 2
    """Largest width of a crack between two masks, px."""
    crack_coverage: float = 0.8
    """Least coverage in such a crack; ground is visible in a real gap."""
    face: float = 0.35
    """Reach of a face above the shape that is visible only on one side, in the same
    unit.
    """
    shade_share: float = 0.8
    """Share of the usual light of a top's row below which it is in another object's
    shadow.
    """
    top_variation: float = 2.0
    """Variation of height of a level top, px."""
    texture: float = 3.0
    """Scale, px, between texture and shading."""
    glint: float = 2.0
    """Ratio to the mean texture above which detail is no texture."""
    side_light: float = 0.7
    """Minimum light of a block's sides, relative to its top, by tables and walls."""
    side_hidden: float = 0.9
    """Share of a side's light that near fronts of others block."""
    leans: float = 0.25
    """Rotation, rad, over which a block's sides replace the top of the photo."""
    least_light: float = 0.003
    """Smallest linear light with reliable differences of levels."""
    sides: int = 12
    """Number of sides of the hull of a sprite."""


CUT = SpriteTuning()


@dataclass(frozen=True)
class Relief:
    """Shading of one object on its sprite's box by its rotation: Lambert's law is
    linear.
    """

    plane_light: F32
    """Intensity x (n . l) in the picture's plane over the photo's shading, (h, w)."""
    cross_light: F32
    """The same with the light turned by a quarter from +x to +y, (h, w)."""
    view_light: F32
    """The same along the view, which no rotation changes, (h, w)."""
    ambient_light: F32
    """Ambient light over the photo's shading, (h, w)."""

    def ratio(self, turn: float) -> F32:
        """Return the factor (h, w) of light after a rotation by `turn` rad."""
        # The normals turn with the object, and the light does not: n·l after a rotation
        # is cos * (n·l) - sin * (n·l of the light turned by a quarter), plus the part
        # along the view. Light behind a surface counts as none.
        facing: F32 = np.asarray(
            cv2.addWeighted(
                self.plane_light, cos(turn), self.cross_light, -sin(turn), 0.0
            ),
            np.float32,
        )
        # In place, as this takes a large part of the time of a frame.
        facing += self.view_light
        np.maximum(facing, 0, out=facing)
        facing += self.ambient_light
        np.clip(facing, 1 / MOST_RELIGHTING, MOST_RELIGHTING, out=facing)
        return facing


def lambert(light: DistantLight, normals: F32) -> F32:
    """Return the shading (h, w) of normals (h, w, 3)."""
    facing = np.maximum(normals @ np.array(light.direction, np.float32), 0)
    shading = np.float32(light.ambient) + np.float32(light.intensity) * facing
    return np.asarray(shading, np.float32)


TURNS = (0.8, 1.6, 3.1, 4.7)
"""Rotations at which a relief is compared with the photo, rad, about a quarter
apart.
"""


def relief_of(normals: F32, object_mask: Mask, light: DistantLight) -> Relief | None:
    """Return the relief of `normals` (h, w, 3); those in `object_mask` (h, w) belong to the
    object.

    None if rotation changes nothing visible.
    """
    if not object_mask.any() or light.intensity <= 0:
        return None
    continued_normals = _carried_normals(normals, object_mask)
    # Divide by the photo's own shading, since the sprite already contains it. A lower
    # bound keeps dark pixels from becoming infinitely bright after a turn.
    shade = np.maximum(lambert(light, continued_normals), np.float32(0.05))
    x, y, z = (np.float32(light.intensity * part) / shade for part in light.direction)
    relief = Relief(
        plane_light=np.asarray(
            continued_normals[..., 0] * x + continued_normals[..., 1] * y, np.float32
        ),
        # A quarter turn takes (x, y) to (-y, x).
        cross_light=np.asarray(
            continued_normals[..., 1] * x - continued_normals[..., 0] * y, np.float32
        ),
        view_light=np.asarray(continued_normals[..., 2] * z, np.float32),
        ambient_light=np.asarray(np.float32(light.ambient) / shade, np.float32),
    )
    # A flat picture, or one under frontal light, looks the same at any rotation: it
    # needs no relief.
    changes = []
    for turn in TURNS:
        ratio = relief.ratio(turn)[object_mask]
        changes.append(float(np.abs(ratio - 1).mean()))
    return relief if max(changes) > CUT.facing else None


def _carried_normals(normals: F32, object_mask: Mask) -> F32:
    """Return unit normals (h, w, 3), with the known ones continued outwards.

    Far outside they face the viewer.
    """
    weight = object_mask.astype(np.float32)
    result = np.where(object_mask[..., None], normals, np.float32(0))
    # Blur in growing widths: the nearest known normals reach a pixel first.
    for sigma in (1.0, 3.0):
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(result * weight[..., None], (0, 0), sigma)
        is_reached = (weight == 0) & (norm > 1e-3)
        result[is_reached] = spread[is_reached] / norm[is_reached][:, None]
        weight[is_reached] = 1.0
    result[weight == 0] = (0.0, 0.0, 1.0)
    # The mean of unit vectors is shorter than 1: Lambert's law needs unit vectors.
    result /= np.maximum(np.linalg.norm(result, axis=2, keepdims=True), 1e-6)
    return result


@dataclass(frozen=True)
class Sides:
    """The visible upper sides of a block behind its front, seen from slightly above.

    They are the front swept upwards.
    """

    first: float
    """Row of the sprite's box at which the front begins, below the top, in the
    photo.
    """
    depth: float
    """Height of its back above its front, px."""
    colour: F32
    """Linear light of its top in the photo, (3,)."""
    light: DistantLight | None
    """Light on the sides; None: every side has the colour of the top."""
    top: BlockTop | None = None
    """The photo's own top, if it is not of one colour."""

    def share(self, turn: float) -> float:
        """Return the share 0..1 of the sides in place of the photo's top, after `turn`
        rad.
        """
        if self.top is not None:
            return float(turn != 0.0)
        share = min(abs(turn) / CUT.leans, 1.0)
        return share if share * self.depth >= 0.5 else 0.0

    def remaining_share(
        self, matrix: NDArray[np.float64], shape: tuple[int, int], turn: float
    ) -> F32:
        """Return the remaining share of the top, (h, w) of a picture of this `shape`.

        `matrix` (2, 3) leads from the picture to the sprite.
        """
        # The row in the sprite of a pixel (x, y) is matrix_x x + matrix_y y + shift.
        # Rows above `first` belong to the top; within one pixel of this row the share
        # is a ramp, so that the border stays smooth in motion.
        matrix_x, matrix_y, shift = matrix[1].astype(np.float32)
        height, width = shape
        x = np.arange(width, dtype=np.float32)
        y = np.arange(height, dtype=np.float32)
        first = np.float32(self.first + 0.5) - shift - matrix_y * y
        top_share = np.clip(matrix_x * -x + first[:, None], 0, 1)
        return np.asarray(1 - np.float32(self.share(turn)) * top_share, np.float32)

    def draw(self, coverage: F32, turn: float) -> tuple[F32, F32]:
        """Draw the sides of a front with `coverage` (h, w), after a rotation by `turn`
        rad.

        Returns their coverage (h, w), and the factor (w,) of `colour` in each column.
        """
        height = round(self.share(turn) * self.depth) + 1
        column = np.ones((height, 1), np.uint8)
        # The side is the area that the front sweeps on its way backwards, which is
        # upwards in the photo.
        swept_cover = cv2.dilate(coverage, column, anchor=(0, 0))
        block = np.asarray(swept_cover, np.float32)
        sides = np.asarray(block - coverage, np.float32)
        if self.light is None:
            return sides, np.ones(block.shape[1], np.float32)
        # After a quarter turn, another pair of sides of the block is up.
        angle = turn % (np.pi / 2)
        left, right, top = self._face_light(angle)
        corner = _top_corner(block, is_left=angle < np.pi / 4)
        is_left_side = np.arange(block.shape[1]) < corner
        shade = np.where(is_left_side, left, right) / max(top, 1e-3)
        return sides, np.maximum(shade, CUT.side_light).astype(np.float32)

    def paint(
        self, side: F32, shade: F32, matrix: NDArray[np.float64], turn: float
    ) -> tuple[F32, F32]:
        """Return the coverage (h, w) and the colours (h, w, 3) of drawn sides.

        `side` and `shade` are those of `draw`; `matrix` (2, 3) leads from the picture
        to the sprite.
        """
        # Each column has one shade, that of the side below it; the photo's own top
        # covers it as long as it is visible.
        colours = np.empty((*side.shape, 3), np.float32)
        colours[:] = shade[:, None] * self.colour
        if self.top is None or not self.top.is_visible(turn):
            return side, colours
        colour, coverage = self.top.warp(matrix, side.shape, turn)
        is_top = coverage > 0
        colours[is_top] = colour[is_top]
        # The covers rise above the pages: between them, the background is visible.
        is_band = coverage.max(axis=0) > BAND
        return np.where(is_band, np.minimum(side, coverage), side), colours

    def _face_light(self, angle: float) -> tuple[float, float, float]:
        """Return the light on the left and the right upper side of a rotated block, and
        on its top.
        """
        assert self.light is not None
        left = [-cos(angle), -sin(angle), 0]
        right = [sin(angle), -cos(angle), 0]
        normals = np.array([left, right, [0, -1, 0]], np.float32)
        left_light, right_light, top_light = lambert(self.light, normals).tolist()
        return left_light, right_light, top_light


def _top_corner(block: F32, is_left: bool) -> int:
    """Return the first or last + 1 column of the uppermost row of a block's
    coverage.
    """
    first_row = np.argmax((block > 0.5).any(axis=1))
    columns = np.flatnonzero(block[first_row] > 0.5)
    if not len(columns):
        return 0
    return int(columns[0]) if is_left else int(columns[-1]) + 1


@dataclass(frozen=True)
class Gloss:
    """Highlights of a round object, which move with it and do not turn."""

    light: F32
    """Linear light at the start, on the sprite's box, (h, w, 3)."""
    center: tuple[float, float]
    """Centre of rotation, px of the sprite."""

    def draw(self, matrix: NDArray[np.float64], size: tuple[int, int]) -> F32:
        """Return the light (h, w, 3) on a picture of `size` (w, h).

        `matrix` (2, 3) leads from the picture to the sprite.
        """
        to_picture = cv2.invertAffineTransform(matrix)
        x, y = to_picture @ [*self.center, 1.0]
        scale = float(np.sqrt(abs(np.linalg.det(to_picture[:, :2]))))
        shift_x = x - scale * self.center[0]
        shift_y = y - scale * self.center[1]
        move = np.array([[scale, 0.0, shift_x], [0.0, scale, shift_y]])
        picture = cv2.warpAffine(self.light, move, size, flags=cv2.INTER_LINEAR)
        return np.asarray(picture, np.float32)


BAND = 0.9
"""Coverage from which a column belongs to a book's top and not to its other side."""
MARGIN = 2
"""Empty border of a sprite, px, so that interpolation fades to nothing."""


TRUST = (0.3, 0.8)
"""Coverage below which a pixel's own light is a guess, and above which it is the photo
minus the background.
"""


@dataclass(frozen=True)
class Sprite:
    """One object's pixels at t = 0."""

    body: int
    """Index into the world's bodies."""
    corner: tuple[int, int]
    """Column and row of the box's first pixel in the photo; may be negative."""
    light: F32
    """Linear light times coverage, (h, w, 3)."""
    coverage: F32
    """Coverage, (h, w) in 0..1."""
    rest: F32 | None = None
    """Linear light of the photo beyond light and background at the border, (h, w, 3),
    of either sign."""
    halo: tuple[tuple[int, int], F32, NDArray[np.int32]] | None = None
    """The same around the object: column and row of the photo, linear light (h, w, 3),
    and (h, w) 1 + another near body, with which the halo fades, too; 0 without one."""
    foot_halo: FootHalo | None = None
    """The part of the halo on the floor, which moves with the object."""
    ball: Ball | None = None
    """A sphere's skin, turning in space; `light` is then valid only at t = 0."""
    relief: Relief | None = None
    """The shading of an object that is not a ball, if its normals are known."""
    hider: NDArray[np.int32] | None = None
    """1 + the body beside this pixel in the photo, (h, w), with which `rest` fades; 0
    without one."""

    face: float = 0.0
    """Distance of the visible front below the plane of motion at any rotation, px."""
    sides: Sides | None = None
    wheels: tuple[WheelSprite, ...] = ()
    """Wheels that turn on it."""
    gloss: Gloss | None = None
    """Its highlights, which do not turn with it."""

    @property
    def turning_light(self) -> F32:
        """Return the linear light times coverage (h, w, 3) that turns with it."""
        return self.light if self.gloss is None else self.light - self.gloss.light

    @cached_property
    def hull(self) -> list[tuple[float, float]]:
        """Return the corners, px of the photo, of a polygon around all visible pixels.

        It has `CUT.sides` sides.
        """
        rows, columns = np.nonzero(self.coverage)
        if not len(rows):
            return []
        pixels = np.column_stack([columns, rows]).astype(np.int32)
        points = cv2.convexHull(pixels).reshape(-1, 2)
        angle = np.arange(CUT.sides) * (2 * np.pi / CUT.sides)
        # The reach in each of the directions bounds the object: the polygon
        # circumscribes all pixels, and is never smaller than the object.
        normals = np.column_stack([np.cos(angle), np.sin(angle)])
        reach = (points @ normals.T).max(axis=0)
        # Corners are the intersections of neighbouring sides.
        pairs = np.stack([normals, np.roll(normals, -1, axis=0)], axis=1)
        reaches = np.stack([reach, np.roll(reach, -1)], axis=1)
        corners = np.linalg.solve(pairs, reaches[..., None])[..., 0]
        x0, y0 = self.corner
        return [(x + x0, y + y0) for x, y in corners.tolist()]

    @cached_property
    def hiders(self) -> int:
        """Return 1 + the largest index of the body itself and of those in `hider` and
        `halo`.
        """
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
        # Move the pixels of the object from the sprite's box to the box of the halo,
        # which may be smaller.
        rows, columns = np.nonzero(self.coverage > 0)
        rows = rows + self.corner[1] - y
        columns = columns + self.corner[0] - x
        has_row = (rows >= 0) & (rows < height)
        has_column = (columns >= 0) & (columns < width)
        is_within = has_row & has_column
        is_free = np.ones((height, width), np.uint8)
        is_free[rows[is_within], columns[is_within]] = 0
        reach = cv2.distanceTransform(is_free, cv2.DIST_L2, 5)
        return np.asarray(reach, np.float32)

    @cached_property
    def neighbours(self) -> NDArray[np.int32]:
        """Return the numbers (n,) in `hider`; 0 without any."""
        return np.zeros(1, np.int32) if self.hider is None else np.unique(self.hider)

    @cached_property
    def half_pixels(self) -> F32:
        """Return light and coverage at every half pixel, (2h - 1, 2w - 1, 4), for
        warps.

        With Lanczos at half pixels, linear interpolation on this grid stays sharp and
        moves a picture exactly; OpenCV's own cubic (a = -0.75) is wrong by up to 0.05
        px.
        """
        return double_resolution(np.dstack([self.turning_light, self.coverage]))

    @cached_property
    def covered_box(self) -> tuple[int, int, int, int]:
        """Return x0, y0, x1, y1 px of the covered part of its box."""
        is_covered = self.coverage > 0
        rows = np.flatnonzero(is_covered.any(axis=1))
        columns = np.flatnonzero(is_covered.any(axis=0))
        if not len(rows):
            return 0, 0, 1, 1
        return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

    @cached_property
    def fine_coverage(self) -> F32:
        """Return the coverage of `half_pixels` alone, (2h - 1, 2w - 1)."""
        return double_resolution(self.coverage)


def cut_sprites(
    rgb: U8,
    labels: U16,
    absent: Mask,
    coverage: F32,
    background: U8,
    order: Mapping[int, int],
    shapes: Sequence[Outline] = (),
    light_direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> list[Sprite]:
    """Cut the photo's objects out as sprites in drawing order, the farthest first.

    Hidden parts of their `shapes`, one per body, are completed. `order` has bodies and
    their layers in turn: an object of a larger layer is in front. `rgb`, `background`
    (H, W, 3) sRGB; `labels` (H, W): id k + 1 is body k; `absent` (H, W): objects of the
    photo that the scene leaves out, and that vanish; `coverage` (H, W) of all objects,
    also of absent ones. The sprites are not `anchor_sprites` yet. Borders that are dark in
    narrow gaps get the light from the direction `light_direction` that they would have without
    the gap.
    """
    # A completed object needs a box that also contains its hidden part.
    boxes = _boxes(labels)
    hidden_parts: dict[int, _HiddenPart] = {}
    for k, shape in enumerate(shapes):
        if k + 1 not in boxes:
            continue
        part = _find_hidden_part(labels, absent, coverage, k, shape, boxes[k + 1])
        if part is not None:
            hidden_parts[k] = part
            boxes[k + 1] = part.box
    # Absent objects share borders with the others, although the scene has no sprite of
    # them: the blurs below must know them.
    is_object = (labels > 0) | absent
    cutter = _Cutter(
        photo=decode(rgb),
        background=decode(background),
        labels=labels,
        absent=absent,
        coverage=coverage,
        soft_total=_blur_mask(is_object, CUT.blur),
        crisp_total=_blur_mask(is_object, CUT.touch_width),
        gaps=_dim_gaps(is_object),
        shapes=shapes,
        light_direction=light_direction,
    )
    sprites = []
    for k in _hiding_last(order, hidden_parts):
        if k + 1 in boxes:
            sprites.append(cutter.cut(k, boxes[k + 1], hidden_parts.get(k)))
    return sprites


def _dim_gaps(object_mask: Mask) -> Mask:
    """Return gaps between objects too narrow for light, and the borders beside them."""
    object_pixels = object_mask.astype(np.uint8)
    square = np.ones((CUT.gap + 1, CUT.gap + 1), np.uint8)
    closed_pixels = cv2.morphologyEx(
        object_pixels, cv2.MORPH_CLOSE, square, borderType=cv2.BORDER_REPLICATE
    )
    return dilate(closed_pixels > object_pixels, CUT.clean_depth + 1)


@dataclass(frozen=True)
class _Cutter:
    """Cuts single objects out of a photo; maps are (H, W)."""

    photo: F32
    """Linear light, (H, W, 3)."""
    background: F32
    """Background, (H, W, 3) linear."""
    labels: U16
    absent: Mask
    coverage: F32
    soft_total: F32
    """Blur of all masks by `CUT.blur`."""
    crisp_total: F32
    """Blur of all masks by `CUT.touch_width`."""
    gaps: Mask
    """Gaps too narrow for light, and borders beside them."""
    shapes: Sequence[Outline]
    light_direction: tuple[float, float, float]

    def cut(
        self, k: int, bounds_px: PixelBox, hidden_part: _HiddenPart | None
    ) -> Sprite:
        """Cut out body k in a box of the photo."""
        box = _slices_of(bounds_px)
        labels = self.labels[box]
        mask = labels == k + 1
        others = np.where(mask, 0, labels).astype(np.int32)
        is_other = (others > 0) | self.absent[box]
        # Store the neighbour of each border pixel: the border's light changes when it
        # leaves.
        no_pixels = np.zeros(mask.shape, np.bool_)
        touching_numbers = _nearest(others, no_pixels, CUT.gap)
        # The order matters: light and coverage come from the photo, then hidden parts
        # continue them, since a continuation needs the object's own light.
        gain = self._border_gain(mask, touching_numbers > 0, box, self._is_disc(k))
        light, alpha = self._foreground(k, mask, box, gain)
        has_neighbour = bool((dilate(is_other, CUT.clean_depth) & mask).any())
        # A neighbour hides a part or spoils the border; reconstruct the light there.
        if hidden_part is not None or has_neighbour:
            part = hidden_part or _HiddenPart(
                bounds_px, labels, np.zeros_like(alpha), no_pixels, is_other
            )
            light, alpha, is_shaded = self._complete(k, mask, light, alpha, part, gain)
            if is_shaded.any():
                nearest = _nearest(others, no_pixels, sum(self.labels.shape))
                touching_numbers = np.where(is_shaded, nearest, touching_numbers)
        # A turned sprite is interpolated at its border: the margin keeps it empty.
        margin = ((MARGIN, MARGIN), (MARGIN, MARGIN))
        return Sprite(
            body=k,
            corner=(bounds_px[0] - MARGIN, bounds_px[1] - MARGIN),
            light=np.pad(light.astype(np.float32), (*margin, (0, 0))),
            coverage=np.pad(alpha, margin),
            hider=np.pad(touching_numbers, margin) if touching_numbers.any() else None,
        )

    def _is_disc(self, k: int) -> bool:
        """Check whether the shape of body k is a disc."""
        return k < len(self.shapes) and isinstance(self.shapes[k], Disc)

    def _foreground(
        self, k: int, mask: Mask, box: tuple[slice, slice], gain: F32
    ) -> tuple[F32, F32]:
        """Return the light times coverage (h, w, 3) of body k, and its coverage."""
        share, alpha = self._coverage(mask, box)
        light = _foreground(
            self.photo[box],
            self.background[box],
            mask,
            alpha,
            share,
            gain,
            self._is_disc(k),
        )
        return light, alpha

    def _complete(
        self,
        k: int,
        mask: Mask,
        light: F32,
        alpha: F32,
        part: _HiddenPart,
        gain: F32,
    ) -> tuple[F32, F32, Mask]:
        """Return light and coverage with the hidden part, and the mask of pixels that
        a neighbour shades.
        """
        x0, y0, x1, y1 = part.box
        box = np.s_[y0:y1, x0:x1]
        photo = self.photo[box]
        is_disc = self._is_disc(k)
        light, alpha = _complete_hidden_part(
            photo, mask, light, alpha, self.coverage[box], part, gain, is_disc
        )
        if k >= len(self.shapes) or is_disc:
            return light, alpha, np.zeros_like(mask)
        # A neighbour on top of a block shades the block, which must not keep that shade
        # when it moves away.
        shape_top = bounds(self.shapes[k])[1] - y0
        unshaded_photo, is_shaded = _unshaded_top(photo, mask, part.others, shape_top)
        unshaded_light = unshaded_photo * alpha[..., None]
        return np.where(is_shaded[..., None], unshaded_light, light), alpha, is_shaded

    def _coverage(self, mask: Mask, box: tuple[slice, slice]) -> tuple[F32, F32]:
        """Return an object's share of the covered pixels, and its coverage."""
        # At a border pixel, all objects together have the measured coverage. Divide it
        # among them by their blurred masks: the narrow blur decides next to a mask, and
        # the wide one farther out, as at hair or motion blur.
        wide_blur = _blur_mask(mask, CUT.blur)
        narrow_blur = _blur_mask(mask, CUT.touch_width)
        own_weight = narrow_blur + CUT.blur_weight * wide_blur
        all_weights = self.crisp_total[box] + CUT.blur_weight * self.soft_total[box]
        share = np.asarray(own_weight / np.maximum(all_weights, 1e-9), np.float32)
        alpha = np.where(wide_blur > CUT.least_blur, self.coverage[box] * share, 0.0)
        alpha = alpha.astype(np.float32)
        # Rounding must not let the background shine through the inside of an object.
        alpha[mask & (alpha > 0.995)] = 1.0
        return share, alpha

    def _border_gain(
        self, mask: Mask, is_touched: Mask, box: tuple[slice, slice], is_disc: bool
    ) -> F32:
        """Return the light (h, w) of borders without the darkness of gaps.

        It follows from the cosine to the light.
        """
        # Holes of the object itself do not count, and its other borders must be
        # brighter.
        gaps = self.gaps[box] & dilate(is_touched, CUT.clean_depth + 1)
        rim = mask & ~gaps & dilate(~mask, CUT.clean_depth)
        photo = self.photo[box]
        # For a ball, light and shade are separated later.
        is_lit = bool(
            not is_disc and rim.any() and photo[rim].mean() > photo[mask].mean() / 2
        )
        # The gradient of a blurred mask points into the object: its opposite is the
        # outward normal of the outline. Lambert's law with this normal tells how much
        # light the border would get without the gap.
        slope_y, slope_x = np.gradient(_blur_mask(mask, CUT.clean_depth))
        slope = self.light_direction[0] * slope_x + self.light_direction[1] * slope_y
        light_cosine = -slope / np.maximum(np.hypot(slope_x, slope_y), 1e-6)
        gain = np.where(gaps & is_lit, np.maximum(light_cosine, 0), 0)
        return gain.astype(np.float32)


@dataclass(frozen=True)
class _HiddenPart:
    """A hidden part of an object's shape in the photo."""

    box: PixelBox
    """Box x0, y0, x1, y1 px of the photo around mask and shape."""
    labels: U16
    """Labels of the photo, (h, w)."""
    shape: F32
    """Coverage, (h, w)."""
    hole: Mask
    """Hidden pixels, (h, w)."""
    others: Mask
    """Pixels of other objects, (h, w)."""

    def uncover(self, body: int) -> None:
        """Remove the pixels of `body`, which is farther, from the hidden ones.

        Cracks beside it alone are not hidden either.
        """
        self.hole[self.labels == body + 1] = False
        is_behind = dilate(self.hole & self.others, CUT.crack + 1)
        self.hole[~self.others & ~is_behind] = False


def _unshaded_top(
    photo: F32, mask: Mask, is_other: Mask, shape_top: float
) -> tuple[F32, Mask]:
    """Return an object (h, w, 3) with even light on its top, and the mask of shadows
    there.

    The top is on both sides of the first row `shape_top` of its shape.
    """
    # Compare pixels within a row, since all pixels of a row of a level top have about
    # one distance and one angle to the light.
    is_visible = mask & ~dilate(is_other, CUT.clean_depth)
    x = np.arange(mask.shape[1])
    even_photo = photo.copy()
    is_dark = np.zeros_like(mask)
    is_top = np.zeros_like(mask)
    for y in _top_rows(mask, shape_top):
        if not is_visible[y].any():
            continue
        level = photo[y].mean(axis=1)
        # A high percentile is the level of the lit part, even if most of the row is in
        # shadow.
        usual_level = np.percentile(level[is_visible[y]], 70)
        is_dark[y] = is_visible[y] & (level < CUT.shade_share * usual_level)
        is_bright = is_visible[y] & ~is_dark[y]
        if 3 * np.count_nonzero(is_bright) > len(x):
            # Continue the light of the bright pixels linearly along the row.
            start, slope = np.polynomial.polynomial.polyfit(
                x[is_bright], photo[y][is_bright], 1
            )
            even_photo[y] = np.maximum(np.outer(x, slope) + start, 0)
            is_top[y] = True
    _, pieces = cv2.connectedComponents(is_dark.astype(np.uint8))
    # Only a dark piece beside another object can be its shadow.
    is_shadow = np.isin(pieces, pieces[is_dark & dilate(is_other, CUT.clean_depth + 2)])
    is_shaded = is_top & dilate(is_shadow | is_other, CUT.clean_depth + 1)
    return even_photo, is_shaded & is_shadow.any()


def _top_rows(mask: Mask, shape_top: float) -> range:
    """Return the rows of an object's top: as many below the first row of its shape as
    above.
    """
    first = int(mask.any(axis=1).argmax())
    if shape_top - first <= 0.7:
        return range(0)
    return range(first, min(ceil(2 * shape_top - first), len(mask)))


def _find_hidden_part(
    labels: U16, absent: Mask, coverage: F32, k: int, shape: Outline, box: PixelBox
) -> _HiddenPart | None:
    """Return the part of body k's shape behind other objects; None without such a part.

    `box`: that of its mask.
    """
    shape_cover, (left, top) = coverage_box(
        shape, (0, 0, labels.shape[1], labels.shape[0])
    )
    if not shape_cover.size:
        return None
    # The box must hold the visible mask and the fitted shape, and may go beyond the
    # former.
    height, width = shape_cover.shape
    x0, y0 = np.minimum(box[:2], (left, top)).tolist()
    x1, y1 = np.maximum(box[2:], (left + width, top + height)).tolist()
    part = labels[y0:y1, x0:x1]
    mask = part == k + 1
    is_other = ((part > 0) & ~mask) | absent[y0:y1, x0:x1]
    cover = np.zeros(part.shape, np.float32)
    cover[top - y0 : top - y0 + height, left - x0 : left - x0 + width] = shape_cover
    # Only parts of the shape below other objects are hidden, and cracks between their
    # masks. A part of the shape over background is an error of the fit, and stays
    # empty.
    behind = is_other | _cracks(mask, is_other, coverage[y0:y1, x0:x1])
    # A mask that reaches beyond the fitted shape may go on beyond it behind its
    # neighbour.
    cover[behind & _beyond_shape(mask, is_other, cover)] = 1
    if isinstance(shape, Disc):
        cover[behind & _rounded_shape(mask, cover)] = 1
    hole = (cover >= 0.5) & behind
    if not hole.any():
        return None
    return _HiddenPart((x0, y0, x1, y1), part, cover, hole, is_other)


def _rounded_shape(mask: Mask, cover: F32) -> Mask:
    """Return the pixels (h, w) near a disc's `cover` inside the hull of disc and mask.

    A fruit is no exact ball: its hidden outline begins at the visible one, without a
    step.
    """
    is_solid = cover >= 0.5
    distance = cv2.distanceTransform((~is_solid).astype(np.uint8), cv2.DIST_L2, 5)
    if distance[mask].max(initial=0.0) < CUT.step:
        return np.zeros_like(mask)
    hull = np.zeros(mask.shape, np.uint8)
    corners = cv2.convexHull(np.argwhere(mask | is_solid)[:, ::-1].astype(np.int32))
    cv2.fillConvexPoly(hull, corners, 1)
    reach = CUT.lumpy * np.count_nonzero(is_solid) ** 0.5
    return (hull > 0) & (distance <= reach)


def _cracks(mask: Mask, is_other: Mask, coverage: F32) -> Mask:
    """Return the pixels (h, w) of neither mask in cracks between an object and others.

    `coverage` (h, w) of all objects.
    """
    square = np.ones((2 * CUT.crack + 1, 2 * CUT.crack + 1), np.uint8)
    masks = (mask | is_other).astype(np.uint8)
    closed_masks = cv2.morphologyEx(
        masks, cv2.MORPH_CLOSE, square, borderType=cv2.BORDER_REPLICATE
    )
    # A crack touches both masks: gaps inside one object are none.
    neighbourhood = dilate(mask, CUT.crack + 1) & dilate(is_other, CUT.crack + 1)
    is_full = coverage >= CUT.crack_coverage
    return (closed_masks > masks) & neighbourhood & is_full


def _beyond_shape(mask: Mask, is_other: Mask, cover: F32) -> Mask:
    """Return the pixels beside a shape's `cover` (h, w) to which a visible rim or face
    leads.
    """
    # A rim or a face beside the shape that is visible on both sides of an object in
    # front continues behind this object.
    reach = CUT.side_reach * np.count_nonzero(mask) ** 0.5
    is_outside = (cover < 0.5).astype(np.uint8)
    is_near = cv2.distanceTransform(is_outside, cv2.DIST_L2, 3) <= reach
    to_right, to_left = _find_pixels_beside(mask, is_other)
    is_continued = is_near & to_right & to_left
    is_solid = cover >= 0.5
    top_rows = is_solid.argmax(axis=0)[is_solid.any(axis=0)]
    if len(top_rows) and np.ptp(np.percentile(top_rows, (10, 90))) <= CUT.top_variation:
        # The face above a level top may be visible on one side only.
        column = np.ones((2 * round(CUT.face * reach) + 1, 1), np.uint8)
        is_above = cv2.dilate(is_solid.astype(np.uint8), column) > 0
        to_right, to_left = _find_pixels_beside(mask & ~is_solid, is_other)
        is_continued |= is_above & (to_right | to_left)
    return np.asarray(is_continued, np.bool_)


def _find_pixels_beside(own_mask: Mask, is_other: Mask) -> tuple[Mask, Mask]:
    """Return the pixels (h, w) to the right, and to the left, of `own_mask` pixels in their
    row.

    Only pixels of others are between.
    """
    is_open = ~is_other & ~own_mask
    to_right = _last_column(own_mask) > _last_column(is_open)
    to_left = _last_column(own_mask[:, ::-1]) > _last_column(is_open[:, ::-1])
    return to_right, to_left[:, ::-1]


def _last_column(mask: Mask) -> NDArray[np.int64]:
    """Return 1 + the last column of a mask up to each pixel, (h, w); 0 without one."""
    columns = np.arange(1, mask.shape[1] + 1)
    return np.maximum.accumulate(np.where(mask, columns, 0), axis=1)


def _hiding_last(
    order: Mapping[int, int], hidden_parts: Mapping[int, _HiddenPart]
) -> list[int]:
    """Return the drawing order, changed within a layer such that hiding objects come
    last.

    An object in a farther layer hides nothing; of two that hide parts of each other,
    the one that hides more is in front. The pixels of the other one are removed from
    the `hole`.
    """
    # Area of the hidden part of k behind each other object: the evidence that the other
    # one is in front.
    areas = {}
    for k, part in hidden_parts.items():
        for other in order:
            area = int((part.labels[part.hole] == other + 1).sum())
            if area:
                areas[k, other] = area
    # `farther[x]` contains all objects behind x, also through objects in between
    # (transitive closure).
    farther: dict[int, set[int]] = {k: set() for k in order}
    # The largest overlaps decide first; a contradiction with them, a cycle, is left
    # out.
    for k, front in sorted(areas, key=areas.__getitem__, reverse=True):
        if front in farther[k] or order[front] < order[k]:
            hidden_parts[k].uncover(front)
            continue
        for other in order:
            if other == front or front in farther[other]:
                farther[other] |= {k} | farther[k]
    # Topological sorting: an object is drawn as soon as all objects behind it are
    # drawn. The first one in the given order comes first, so that free choices keep
    # this order.
    remaining, drawing_order = list(order), []
    while remaining:
        k = next(k for k in remaining if farther[k].isdisjoint(remaining))
        drawing_order.append(k)
        remaining.remove(k)
    return drawing_order


def _complete_hidden_part(
    photo: F32,
    mask: Mask,
    light: F32,
    alpha: F32,
    total_coverage: F32,
    part: _HiddenPart,
    gain: F32,
    is_disc: bool,
) -> tuple[F32, F32]:
    """Return light (h, w, 3) and coverage (h, w) with the hidden part and an undarkened
    rim.

    The coverage is at most that of all objects, `total_coverage` (h, w). Shading is continued
    smoothly, texture is mirrored.
    """
    is_reliable = mask & ~dilate(part.others, CUT.clean_depth + 1) & (gain < CUT.faces)
    if np.count_nonzero(is_reliable) < CUT.free_share * np.count_nonzero(mask):
        is_reliable = mask
    # Light is a product of reflectance and shading. Its logarithm is a sum, in which a
    # smooth fill continues shading without a bias to bright pixels.
    level = np.log(photo + np.float32(CUT.least_light))
    filled_level = harmonic_fill(level, ~is_reliable) + _mirrored_texture(
        level, is_reliable
    )
    object_mask = mask | (part.shape >= 0.5)
    # The rim of a ball follows from its light.
    if not is_disc:
        filled_level += _rims(level, filled_level, is_reliable, object_mask)
    # Leave the logarithm again, without the constant that kept black finite.
    filling = np.maximum(np.exp(filled_level) - np.float32(CUT.least_light), 0)
    # The coverage is known in the photo, except near the hole: there it follows from
    # the completed mask.
    zone = dilate(part.hole, CUT.clean_depth + 1)
    edge = np.clip(2 * _blur_mask(object_mask) - 0.5, 0, 1)
    full_cover = np.maximum(alpha, np.minimum(edge, total_coverage))
    cover = np.where(zone, full_cover, alpha).astype(np.float32)
    is_new = zone | (mask & dilate(part.others, CUT.clean_depth))
    if not is_disc:
        # The gap between two objects darkens more of their borders in places. Stripes
        # of a ball may end at its border: they are no shade.
        darkness = (filled_level - level).mean(axis=2)
        is_new |= (
            mask & dilate(part.others, CUT.clean_depth + 1) & (darkness > CUT.gap_shade)
        )
    is_new &= ~is_reliable
    result = np.where(is_new[..., None], filling * cover[..., None], light)
    return np.asarray(result, np.float32), cover


def _mirrored_texture(level: F32, reliable: Mask) -> F32:
    """Return the fine detail of log light (h, w, 3), mirrored at the border of
    `reliable`.
    """
    weight = reliable.astype(np.float32)
    norm = np.maximum(cv2.GaussianBlur(weight, (0, 0), CUT.texture), 1e-3)[..., None]
    smooth_level = (
        cv2.GaussianBlur(level * weight[..., None], (0, 0), CUT.texture) / norm
    )
    # The detail is the part without slow changes of light.
    detail = np.where(reliable[..., None], level - smooth_level, np.float32(0))
    # Limit highlights: mirrored glints would look like paint.
    limit = CUT.glint * np.abs(detail[reliable]).mean(axis=0)
    detail = np.clip(detail, -limit, limit).astype(np.float32)
    unknown = (~reliable).astype(np.uint8)
    # Find the nearest reliable pixel of each pixel, and mirror the pixel about it.
    _, seeds = cv2.distanceTransformWithLabels(
        unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(seeds.max()) + 1, 2), np.int64)
    places[seeds[reliable]] = np.argwhere(reliable)
    pixels = np.moveaxis(np.indices(reliable.shape), 0, -1)
    last = np.array(reliable.shape) - 1
    source_pixels = np.clip(2 * places[seeds] - pixels, 0, last)
    return np.asarray(detail[source_pixels[..., 0], source_pixels[..., 1]], np.float32)


def _rims(level: F32, filling: F32, reliable: Mask, object_mask: Mask) -> F32:
    """Return the rim (h, w, 3) that `filling` lacks, from `reliable` pixels of equal
    depth.

    Rounded edges change the `level` of light with their depth, not along the outline.
    """
    # Rings of equal distance from the outline: a rounded edge has about one brightness
    # along each ring.
    padded_mask = np.pad(object_mask, 1).astype(np.uint8)
    depth = np.rint(cv2.distanceTransform(padded_mask, cv2.DIST_L2, 3)[1:-1, 1:-1])
    inner = harmonic_fill(level, ~(reliable & (depth > CUT.rim)), CUT.fill_error)
    rims = np.zeros_like(filling)
    for number in range(1, CUT.rim + 1):
        ring = depth == number
        weight = (ring & reliable).astype(np.float32)
        norm = cv2.GaussianBlur(weight, (0, 0), CUT.outline_width)[..., None]
        difference = (level - inner) * weight[..., None]
        blurred_difference = cv2.GaussianBlur(difference, (0, 0), CUT.outline_width)
        rim = blurred_difference / np.maximum(norm, 1e-6)
        # Half a line of reliable pixels up to here is enough.
        share = np.clip(5 * CUT.outline_width * norm, 0, 1)
        is_unknown = (ring & ~reliable)[..., None]
        rims += np.where(is_unknown, share * (inner + rim - filling), 0)
    return rims


def anchor_sprites(
    sprites: Sequence[Sprite],
    photo: F32,
    background: F32,
    absent: Mask,
    owner: NDArray[np.int32] | None = None,
    reach: float | None = None,
) -> list[Sprite]:
    """Return sprites with `rest` and `halo`, such that the frame at t = 0 equals the
    photo.

    `background` (H, W, 3) is linear. A pixel's rest belongs to the object that shows
    most there; outside all objects, to its `owner` (H, W), 1 + an index, or for 0 to
    the nearest object, up to `reach` shares of the photo's longer side.
    """
    reach_px = round((CUT.halo if reach is None else reach) * max(photo.shape[:2]))
    boxes = list(map(_SpriteBox.from_sprite, sprites))
    rest, top = _explain_photo(sprites, boxes, photo, background)
    # Light at absent objects belongs to them, and vanishes with them.
    if absent.any():
        rest[_blur_mask(absent) > CUT.least_blur] = 0.0
    near_numbers = _nearest(top, absent, reach_px)
    if owner is not None:
        near_numbers = np.where(owner > 0, owner, near_numbers)
    largest = np.maximum.reduce(cv2.split(np.abs(rest)))
    near_numbers[(top > 0) | (largest <= CUT.unseen)] = 0
    # Outside the objects, halos of neighbours blend into each other instead of ending
    # at a sharp line.
    near_weight = _blur_mask(near_numbers > 0, CUT.rest_width)
    bodies = np.array([0, *(sprite.body + 1 for sprite in sprites)], np.int32)
    anchored_sprites = []
    for number, (sprite, box) in enumerate(zip(sprites, boxes, strict=True), 1):
        own_rest = np.zeros_like(sprite.light)
        is_own = (top[box.photo] == number)[..., None]
        own_rest[box.sprite] = np.where(is_own, rest[box.photo], np.float32(0))
        halo = _halo(number, near_numbers, near_weight, rest, top, bodies)
        anchored_sprites.append(replace(sprite, rest=own_rest, halo=halo))
    return anchored_sprites


def _explain_photo(
    sprites: Sequence[Sprite],
    boxes: Sequence[_SpriteBox],
    photo: F32,
    background: F32,
) -> tuple[F32, NDArray[np.int32]]:
    """Return the rest (H, W, 3) of the photo, and the number (H, W) of its sprite.

    All sprites are drawn over the background as in the first frame. The difference to
    the photo is the rest, which the transmission of the sprites above divides.
    """
    composite, top, last = _compose(sprites, boxes, background)
    transmission = _compute_visible_share(sprites, boxes, top)
    is_covered = transmission < CUT.hidden_share
    top[is_covered], transmission[is_covered] = last[is_covered], 1
    rest = (photo - composite) / cv2.merge((transmission, transmission, transmission))
    return rest, top


@dataclass(frozen=True)
class _SpriteBox:
    """The pixels of a sprite within its margin."""

    sprite: tuple[slice, slice]
    """Rows and columns of the sprite."""
    photo: tuple[slice, slice]
    """Rows and columns of the photo."""

    @classmethod
    def from_sprite(cls, sprite: Sprite) -> _SpriteBox:
        """Return the box of a sprite."""
        height, width = sprite.coverage.shape
        x0, y0 = sprite.corner
        inner_box = np.s_[MARGIN : height - MARGIN, MARGIN : width - MARGIN]
        return cls(
            inner_box,
            np.s_[
                y0 + MARGIN : y0 + height - MARGIN, x0 + MARGIN : x0 + width - MARGIN
            ],
        )


def _compose(
    sprites: Sequence[Sprite], boxes: Sequence[_SpriteBox], background: F32
) -> tuple[F32, NDArray[np.int32], NDArray[np.int32]]:
    """Draw sprites over the background.

    Returns the picture (H, W, 3), and 1 + the index of the most visible and of the last
    sprite, (H, W).
    """
    composite = background.copy()
    shape = background.shape[:2]
    top = np.zeros(shape, np.int32)
    last = np.zeros(shape, np.int32)
    largest = np.zeros(shape, np.float32)
    pairs = zip(sprites, boxes, strict=True)
    for number, (sprite, box) in enumerate(pairs, 1):
        alpha = sprite.coverage[box.sprite]
        place = box.photo
        remaining = (1 - alpha[..., None]) * composite[place]
        composite[place] = sprite.light[box.sprite] + remaining
        largest[place] *= 1 - alpha
        # The number of a pixel is that of the sprite with the largest visible share
        # there.
        is_ahead = (alpha > CUT.trace) & (alpha >= largest[place])
        top[place][is_ahead] = number
        largest[place][is_ahead] = alpha[is_ahead]
        last[place][alpha > 0] = number
    return composite, top, last


def _halo(
    number: int,
    nearest_numbers: NDArray[np.int32],
    near_weight: F32,
    rest: F32,
    top: NDArray[np.int32],
    bodies: NDArray[np.int32],
) -> tuple[tuple[int, int], F32, NDArray[np.int32]] | None:
    """Return the halo of sprite `number`: its share of the rest outside all sprites.

    None without one.
    """
    is_own = nearest_numbers == number
    x, y, width, height = cv2.boundingRect(is_own.astype(np.uint8))
    if not width:
        return None
    # Four standard deviations contain the whole blur of the shares.
    margin = max(ceil(4 * CUT.rest_width), CUT.gap)
    x0 = max(x - margin, 0)
    y0 = max(y - margin, 0)
    box = np.s_[y0 : y + height + margin, x0 : x + width + margin]
    # Neighbours share the rest softly: all shares at a pixel add up to 1.
    own_share = _blur_mask(is_own[box], CUT.rest_width) / np.maximum(
        near_weight[box], 1e-6
    )
    share = np.where(nearest_numbers[box] > 0, own_share, 0)
    others = np.where(top[box] == number, 0, top[box])
    no_pixels = np.zeros(others.shape, np.bool_)
    near_numbers = _nearest(others, no_pixels, CUT.gap)
    picture = np.asarray(share[..., None] * rest[box], np.float32)
    return (x0, y0), picture, bodies[near_numbers]


def _compute_visible_share(
    sprites: Sequence[Sprite],
    boxes: Sequence[_SpriteBox],
    top: NDArray[np.int32],
) -> F32:
    """Return the transmission (H, W) of all sprites in front of sprite number `top` (H,
    W).
    """
    transmission = np.ones(top.shape, np.float32)
    pairs = zip(sprites, boxes, strict=True)
    for number, (sprite, box) in enumerate(pairs, 1):
        transmission[box.photo] *= 1 - sprite.coverage[box.sprite]
        transmission[box.photo][top[box.photo] == number] = 1
    return transmission


def _nearest(top: NDArray[np.int32], absent: Mask, reach: int) -> NDArray[np.int32]:
    """Return the nearest number in `top`, (H, W).

    0 for an `absent` object, or for a distance above `reach` px.
    """
    is_seed = (top > 0) | absent
    if not is_seed.any():
        return np.zeros_like(top)
    # The labels of the distance transform number the nearest seed pixel; a table by
    # this number returns its object.
    distance, places = cv2.distanceTransformWithLabels(
        (~is_seed).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    numbers = np.zeros(int(places.max()) + 1, np.int32)
    numbers[places[is_seed]] = top[is_seed]
    return np.where(distance <= reach, numbers[places], 0).astype(np.int32)


def _blur_mask(mask: Mask, sigma: float = CUT.blur) -> F32:
    """Blur a mask by `sigma` px: shares of touching masks add up to that of their
    union.
    """
    result = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), sigma)
    return np.asarray(result, np.float32)


def _slices_of(bounds_px: PixelBox) -> tuple[slice, slice]:
    """Return the rows and columns of a box."""
    x0, y0, x1, y1 = bounds_px
    return np.s_[y0:y1, x0:x1]


def _boxes(labels: U16) -> dict[int, PixelBox]:
    """Return the box of every id with a margin for its soft border, in one pass."""
    height, width = labels.shape
    rows, columns = np.nonzero(labels)
    if not len(rows):
        return {}
    ids = labels[rows, columns]
    # Sort the pixels by id, and reduce each run of equal ids.
    order = np.argsort(ids, kind="stable")
    present_ids, first = np.unique(ids[order], return_index=True)
    left, right = _soft_extents(columns[order], first, width)
    top, bottom = _soft_extents(rows[order], first, height)
    corners = zip(
        left.tolist(), top.tolist(), right.tolist(), bottom.tolist(), strict=True
    )
    return dict(zip(present_ids.tolist(), corners, strict=True))


def _soft_extents(
    places: Indices, first: Indices, size: int
) -> tuple[Indices, Indices]:
    """Return the begin and end of each run of places along one axis, with the soft
    border, from 0 to `size`; `first` are the first elements of the runs.
    """
    lowest = np.minimum.reduceat(places, first) - CUT.border_reach
    highest = np.maximum.reduceat(places, first) + CUT.border_reach + 1
    return np.maximum(lowest, 0), np.minimum(highest, size)


def _foreground(
    photo: F32,
    background: F32,
    mask: Mask,
    alpha: F32,
    share: F32,
    gain: F32,
    is_disc: bool,
) -> F32:
    """Return the object's own light times `alpha` (h, w, 3): the photo minus the
    background.

    In pixels with little of the object and an uncertain background, light from the
    inside bounds it, less so for a disc, which has a darker rim. The result has at
    least the share `gain` (h, w) of this light.
    """
    padded_mask = np.pad(mask, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded_mask, cv2.DIST_L2, 3)[1:-1, 1:-1]
    # Pixels well inside the mask show the object alone.
    is_reliable = (depth > CUT.clean_depth) & (alpha >= 1.0) & (gain == 0)
    if not is_reliable.any():
        is_reliable = depth >= min(float(depth.max()), CUT.clean_depth)
    inner_light = _carried_light(photo, is_reliable, alpha > 0)
    opacity = alpha[..., None]
    # Invert the composition photo = object + (1 - alpha) * background.
    own_light = np.clip(photo - (1 - opacity) * background, 0, None)
    # The difference above is uncertain for pixels with little coverage: an error of the
    # background is as large there as the object's light. Trust rises with the coverage,
    # and needs a pixel that belongs to this object almost alone.
    lowest_trust, full_trust = TRUST
    trust = np.clip(
        ((1 + is_disc) * opacity - lowest_trust) / (full_trust - lowest_trust), 0, 1
    )
    trust = trust * np.clip(10 * share - 9, 0, 1)[..., None]
    # A thread has no inside: the light of what it hangs on says nothing about it.
    is_border = (alpha > 0) & (alpha < 1) & dilate(is_reliable, CUT.clean_depth + 2)
    most_light = opacity * (CUT.brightest * inner_light + np.float32(CUT.light_excess))
    most_light = np.maximum(
        most_light, own_light - _leak(photo, background, alpha, is_border)
    )
    own_light[is_border] = np.minimum(own_light, most_light)[is_border]
    # Uncertain pixels get the light of the inside in proportion to their coverage.
    mixed_light = trust * own_light + (1 - trust) * opacity * inner_light
    light = np.where(opacity > 0, mixed_light, 0)
    least_light = gain[..., None] * opacity * inner_light
    return np.asarray(np.maximum(light, least_light), np.float32)


def _leak(photo: F32, background: F32, alpha: F32, border: Mask) -> F32:
    """Return the light (h, w, 3) that a wrong background leaves in an object's border.

    It is what the background behind the border lacks of the light just outside, of a
    neighbour too, and light from outside that wrong coverage leaves. A rim brighter
    than that is the object's own.
    """
    outside = _carried_light(photo, ~dilate(alpha > 0, 1), border)
    lack = np.maximum(outside - background, 0)
    leak = CUT.leak * (1 - alpha[..., None]) * lack + CUT.coverage_error * outside
    return np.asarray(leak, np.float32)


def _carried_light(photo: F32, reliable: Mask, target: Mask) -> F32:
    """Return the photo (h, w, 3) with the light of `reliable` pixels continued to
    `target` ones.
    """
    light: F32 = photo.copy()
    weight = reliable.astype(np.float32)
    is_known = reliable.copy()
    # Blur in growing widths: the nearest reliable light reaches a pixel first.
    for sigma in (1.0, 2.0, 4.0, 8.0):
        if is_known[target].all():
            break
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        blurred_light = cv2.GaussianBlur(photo * weight[..., None], (0, 0), sigma)
        is_reached = ~is_known & (norm > 1e-3)
        # Normalised convolution: divide the blurred light by the blurred weight, so
        # that unknown pixels count nothing.
        light[is_reached] = blurred_light[is_reached] / norm[is_reached][:, None]
        is_known |= is_reached
    return light
