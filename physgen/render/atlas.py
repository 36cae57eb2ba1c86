"""Balls and sliding shadows drawn many at a time, from atlases of similar sizes.

Pictures of about one size share an atlas and one warp. An atlas has two samples per
pixel and four channels, which OpenCV warps several times as fast as three.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, log

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64
from physgen.geometry.raster import double_resolution
from physgen.render.ball import Ball
from physgen.render.ball_patterns import RIM, Pattern
from physgen.render.shadow_decomposition import CastShadow
from physgen.render.sphere_texture import continue_skin
from physgen.render.sprites import Sprite
from physgen.render.stage import Placement, Slices, SpritePose

GAP = 3
"""Border of each picture in an atlas, px, as wide as Lanczos' kernel."""
PIXELS = 60_000
"""Maximum number of pixels of an atlas; a single picture may have more."""
WIDEST = 4_000
"""Maximum length of an atlas, half pixels: positions are floats of 32 bits."""
ALIKE = 1.3
"""Maximum ratio of sizes in one atlas."""


def atlas_groups(sizes: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Group pictures by size, (columns, rows), for one atlas each."""
    by_size: dict[int, list[int]] = {}
    for k, size in enumerate(sizes):
        # Pictures of one class have similar sizes, so that their cells waste little
        # room.
        size_class = ceil(log(max(*size, 1)) / log(ALIKE))
        by_size.setdefault(size_class, []).append(k)
    groups = []
    for members in by_size.values():
        side = max(max(sizes[k]) for k in members)
        count = max(1, min(PIXELS // side**2, WIDEST // (2 * side + 4 * GAP)))
        for first in range(0, len(members), count):
            groups.append(members[first : first + count])
    return groups


def lay_side_by_side(pictures: Sequence[F32], border: int) -> tuple[F32, F64]:
    """Concatenate pictures (H, W, ...) in a row, and return it with their first columns
    (n,).

    OpenCV's `border` fills the gaps. The first row of each picture is `GAP`.
    """
    height = max(map(len, pictures)) + 2 * GAP
    parts = []
    for picture in pictures:
        bottom_margin = height - GAP - len(picture)
        parts.append(cv2.copyMakeBorder(picture, GAP, bottom_margin, GAP, GAP, border))
    widths = [part.shape[1] for part in parts[:-1]]
    starts = np.cumsum([0, *widths]) + GAP
    row = np.ascontiguousarray(np.concatenate(parts, axis=1), np.float32)
    return row, starts.astype(np.float64)


@dataclass(frozen=True)
class Strip:
    """The grid of a warp: `n` cells of (h, w) px side by side, `samples` samples per
    pixel.
    """

    n: int
    size: tuple[int, int]
    samples: int = 1

    def to_columns(self, values: F64) -> F32:
        """Return (n,) values as one value for each column of the strip."""
        return np.repeat(values.astype(np.float32), self.size[1] * self.samples)

    @property
    def columns(self) -> F32:
        """Return (W,) px from the left of each cell."""
        return np.tile(self._steps(1), self.n)

    @property
    def rows(self) -> F32:
        """Return (H, 1) px from the top."""
        return self._steps(0)[:, None]

    def _steps(self, axis: int) -> F32:
        steps = np.arange(self.size[axis] * self.samples, dtype=np.float32)
        return (steps + np.float32(0.5 - self.samples / 2)) / np.float32(self.samples)

    def empty(self) -> F32:
        """Return (H, W) to be filled."""
        height, width = self.size
        return np.empty(
            (height * self.samples, self.n * width * self.samples), np.float32
        )


def warp_picture(picture: F32, x: F32, y: F32) -> F32:
    """Return (h, w[, 4]) of a picture (H, W[, 4]) at px `x`, `y` (h, w)."""
    result = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(result, np.float32)


def equal_area(
    skin: F32, center: F64, radius: float, pattern: Pattern | None
) -> list[F32]:
    """Project near and far side of a `skin` (h, w, 3) by Lambert's equal-area
    projection.

    Both sides are seen from the photo's side. In this projection the rim, which the
    photo hardly shows, is wide.
    """
    height, width = skin.shape[:2]
    x = (np.arange(width) - center[0]) / radius
    y = (np.arange(height) - center[1]) / radius
    u, v = np.meshgrid(x, y)
    # Lambert's projection: a point at the distance r of the map has z = 1 - r², and its
    # place on the sphere is sqrt(1 + z) times the place on the map.
    z = np.maximum(1 - u * u - v * v, -1)
    factor = np.sqrt(1 + z)
    sides = []
    for side in (1, -1):
        points = np.dstack([factor * u, factor * v, side * z])
        if pattern is None:
            # Without a pattern, a point of the far side has the colour of its antipode.
            sides.append(_skin_at(skin, side * points, center, radius))
            continue
        share, places = pattern.map_to_disc(points, 1 / radius)
        writing = _skin_at(skin, places, center, radius)
        painted_colour = pattern.paint(points, 2 / radius)
        sides.append(
            np.asarray(painted_colour + share * (writing - painted_colour), np.float32)
        )
    return sides


def _skin_at(skin: F32, places: F64, center: F64, radius: float) -> F32:
    """Return (h, w, 3) the skin at points (h, w, 3) of a sphere."""
    x = np.asarray(center[0] + radius * places[..., 0], np.float32)
    y = np.asarray(center[1] + radius * places[..., 1], np.float32)
    border = cv2.BORDER_REPLICATE
    picture = cv2.remap(skin, x, y, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(picture, np.float32)


class BallSprites:
    """All of a stage's balls."""

    def __init__(self, sprites: Sequence[Sprite]) -> None:
        balls = [(k, s, s.ball) for k, s in enumerate(sprites) if s.ball is not None]
        sizes = []
        for _, sprite, _ in balls:
            # Margins of sprites are empty, and would waste room in the atlas.
            x0, y0, x1, y1 = sprite.covered_box
            sizes.append((x1 - x0, y1 - y0))
        self._homes: dict[int, tuple[_Atlas, int]] = {}
        for members in atlas_groups(sizes):
            atlas = _Atlas([balls[i][1:] for i in members])
            for place, i in enumerate(members):
                self._homes[balls[i][0]] = (atlas, place)

    def draw(
        self, placements: Iterable[tuple[int, Placement]], samples: int = 1
    ) -> dict[int, tuple[F32, F32]]:
        """Draw the balls among `placements`, pairs of a sprite's index and its
        placement.

        Each pixel is the mean of `samples` x `samples` samples. Returns pictures as
        `draw_sprite`.
        """
        groups: dict[int, tuple[_Atlas, list[tuple[int, int, Placement]]]] = {}
        for k, placement in placements:
            if k in self._homes and placement.photo_box is None:
                atlas, place = self._homes[k]
                group = groups.setdefault(id(atlas), (atlas, []))
                group[1].append((k, place, placement))
        pictures: dict[int, tuple[F32, F32]] = {}
        # One warp per atlas draws all of its balls, in less time than a warp per ball.
        for atlas, members in groups.values():
            places = [place for _, place, _ in members]
            ball_placements = [placement for _, _, placement in members]
            ball_pictures = atlas.draw(places, ball_placements, samples)
            for (k, _, _), picture in zip(members, ball_pictures, strict=True):
                pictures[k] = picture
        return pictures


class _Atlas:
    """Balls of about one size, with their positions and radii as arrays of one row
    each.
    """

    def __init__(self, members: Sequence[tuple[Sprite, Ball]]) -> None:
        within = np.array([sprite.covered_box for sprite, _ in members], np.float64)
        corners = [sprite.corner for sprite, _ in members]
        self.corner = within[:, :2] + corners
        self.center = np.array([ball.center for _, ball in members], np.float64)
        self.radius = np.array([ball.radius for _, ball in members], np.float64)
        self.last = 2 * (within[:, 2:] - within[:, :2]) - 2
        """Half pixels to the end of each picture."""
        self._lay_pictures(members)
        for k, (_, ball) in enumerate(members):
            self._project_skin(k, ball)

    def _lay_pictures(self, members: Sequence[tuple[Sprite, Ball]]) -> None:
        """Lay gloss, shading and skin of the balls side by side, each with a fourth
        channel.
        """
        gloss_pictures, shading_pictures, skin_pictures = _member_pictures(members)
        row, starts = lay_side_by_side(gloss_pictures, cv2.BORDER_CONSTANT)
        self.still, self.left = double_resolution(row), 2 * starts
        shading_row, _ = lay_side_by_side(shading_pictures, cv2.BORDER_CONSTANT)
        self.lit = double_resolution(shading_row)
        skin_row, _ = lay_side_by_side(skin_pictures, cv2.BORDER_REPLICATE)
        near_skins = double_resolution(skin_row)
        # The far side, below the near side, is projected for each ball below.
        self.skin = np.concatenate([near_skins, near_skins])

    def _project_skin(self, k: int, ball: Ball) -> None:
        """Replace a ball's skin by its near and far side in the equal-area
        projection.
        """
        height = len(self.skin) // 2
        right, bottom = self.last[k].astype(int) + 1
        first = int(self.left[k])
        place = np.s_[2 * GAP : 2 * GAP + bottom, first : first + right]
        centre = 2 * (self.center[k] - self.corner[k])
        radius = 2 * ball.radius
        near_side = self.skin[:height]
        far_side = self.skin[height:]
        skin = near_side[place][..., :3].copy()
        # A painted ball has its pattern on the far side, another ball a continuation.
        if ball.has_continued_texture:
            sides = continue_skin(np.ascontiguousarray(skin), centre, radius)
        else:
            sides = equal_area(skin, centre, radius, ball.pattern)
        near_side[place][..., :3], far_side[place][..., :3] = sides

    def draw(
        self, places: Sequence[int], wheres: Sequence[Placement], samples: int
    ) -> list[tuple[F32, F32]]:
        """Draw the atlas' balls at `places`; see `BallSprites.draw`."""
        height = max(
            placement.box[0].stop - placement.box[0].start for placement in wheres
        )
        width = max(
            placement.box[1].stop - placement.box[1].start for placement in wheres
        )
        strip = Strip(len(wheres), (height, width), samples)
        picture = self._warp(np.array(places), wheres, strip)
        if samples > 1:
            size = (strip.n * width, height)
            reduced = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
            picture = np.asarray(reduced, np.float32)
        # The conversion keeps the first three channels.
        light = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGRA2BGR), np.float32)
        coverage = np.asarray(cv2.extractChannel(picture, 3), np.float32)
        pictures = []
        for j, placement in enumerate(wheres):
            rows, columns = (part.stop - part.start for part in placement.box)
            cell = np.s_[:rows, j * width : j * width + columns]
            pictures.append((light[cell], coverage[cell]))
        return pictures

    def _warp(
        self, places: NDArray[np.int64], wheres: Sequence[Placement], strip: Strip
    ) -> F32:
        """Return light and coverage (H, W, 4) of balls on the cells of a strip."""
        corners = [
            (placement.box[1].start, placement.box[0].start) for placement in wheres
        ]
        # Offsets of the cells from the ball's box at t = 0 after its displacement.
        shifts = np.array([placement.shift for placement in wheres])
        start = np.array(corners, np.float64) - self.corner[places] - shifts
        offsets = np.array(corners, np.float64) - self.center[places] - shifts
        left = self.left[places]
        x = strip.empty()
        y = strip.empty()
        # Gloss and shading move without turning.
        first_samples = 2 * start
        x[:] = 2 * strip.columns + strip.to_columns(first_samples[:, 0] + left)
        np.add(2 * strip.rows, strip.to_columns(first_samples[:, 1] + 2 * GAP), out=y)
        picture = warp_picture(self.still, x, y)
        shading_light = warp_picture(self.lit, x, y)
        # The inverse rotations lead from the present skin to that of the photo.
        turns = np.array([placement.space for placement in wheres]).transpose(0, 2, 1)
        self._skin_places(x, y, places, offsets, turns, strip)
        cv2.multiply(warp_picture(self.skin, x, y), shading_light, dst=shading_light)
        cv2.add(picture, shading_light, dst=picture)
        return picture

    def _skin_places(
        self,
        x: F32,
        y: F32,
        places: NDArray[np.int64],
        middle: F64,
        turns: F64,
        strip: Strip,
    ) -> None:
        """Set `x` and `y` (H, W) to the place of each sample on the skins, in place.

        This takes most of the time of a frame with balls.
        """
        repeated, radius = strip.to_columns, self.radius[places]
        u, v, z = _sphere_points(strip, middle, radius)
        # Coordinate towards the viewer at t = 0: its sign tells near and far side
        # apart.
        depth = (
            v * repeated(turns[:, 2, 1])
            + u * repeated(turns[:, 2, 0])
            - z * repeated(turns[:, 2, 2])
        )
        # Skins are in the equal-area projection.
        shrink = 1 / np.sqrt(1 + np.abs(depth))
        for axis, place in enumerate((x, y)):
            rotation_row = 2 * radius[:, None] * turns[:, axis]
            np.multiply(v, repeated(rotation_row[:, 1]), out=place)
            place += u * repeated(rotation_row[:, 0])
            place -= z * repeated(rotation_row[:, 2])
            place *= shrink
            place += repeated(2 * (self.center - self.corner)[places, axis])
            np.maximum(place, 0, out=place)
            np.minimum(place, repeated(self.last[places, axis]), out=place)
        x += repeated(self.left[places])
        y += np.float32(2 * GAP)
        # Samples of the far side are in the lower half of the atlas.
        y += (depth > 0) * np.float32(len(self.skin) // 2)


def _sphere_points(strip: Strip, middle: F64, radius: F64) -> tuple[F32, F32, F32]:
    """Return the points u, v, z of spheres at the samples of a strip, in radii.

    `middle` (n, 2) leads from the centres to the corners, px. Beyond the rim, the skin
    of the rim is continued.
    """
    repeated = strip.to_columns
    inverse = repeated(1 / radius)
    u = (strip.columns + repeated(middle[:, 0])) * inverse
    v = strip.rows * inverse
    v += repeated(middle[:, 1] / radius)
    # In place, as this takes a large part of the time of a frame.
    z = v * v
    z += u * u
    np.subtract(1, z, out=z)
    np.maximum(z, np.float32(1 - RIM * RIM), out=z)
    np.sqrt(z, out=z)
    return u, v, z


def _member_pictures(
    members: Sequence[tuple[Sprite, Ball]],
) -> tuple[list[F32], list[F32], list[F32]]:
    """Return pictures of the gloss, the shading and the skin of balls, each with a
    fourth channel.
    """
    gloss_pictures, shading_pictures, skin_pictures = [], [], []
    for sprite, ball in members:
        x0, y0, x1, y1 = sprite.covered_box
        box = np.s_[y0:y1, x0:x1]
        coverage = sprite.coverage[box]
        alpha = coverage[..., None]
        zeros = np.zeros_like(coverage)
        gloss_pictures.append(np.dstack([ball.gloss[box] * alpha, coverage]))
        shading_pictures.append(np.dstack([ball.shading[box] * alpha, zeros]))
        skin_pictures.append(np.dstack([np.maximum(ball.skin[box], 0), zeros]))
    return gloss_pictures, shading_pictures, skin_pictures


class ShadowSprites:
    """The sliding shadows of a decomposed background."""

    def __init__(self, casts: Sequence[CastShadow]) -> None:
        sliding_shadows = []
        for k, cast in enumerate(casts):
            if cast.sliding is not None:
                sliding_shadows.append((k, *cast.sliding, cast.lean))
        sizes = [
            (picture.shape[1], picture.shape[0]) for _, _, picture, _ in sliding_shadows
        ]
        self._homes: dict[int, tuple[_Row, int]] = {}
        for members in atlas_groups(sizes):
            row = _Row([sliding_shadows[i][1:] for i in members])
            for place, i in enumerate(members):
                self._homes[sliding_shadows[i][0]] = (row, place)

    def add_shadows(
        self, darkness: F32, stands: Iterable[tuple[SpritePose, float]]
    ) -> list[Slices]:
        """Add the sliding shadows of `stands`, times weights, to `darkness` (H, W).

        Returns their boxes.
        """
        groups: dict[int, tuple[_Row, list[tuple[int, SpritePose, float]]]] = {}
        for stand, weight in stands:
            if stand.k in self._homes:
                row, place = self._homes[stand.k]
                group = groups.setdefault(id(row), (row, []))
                group[1].append((place, stand, weight))
        boxes = []
        for row, members in groups.values():
            boxes += row.add_shadows(darkness, members)
        return boxes


def _visible_boxes(boxes: F64, corners: F64) -> NDArray[np.intp]:
    """Return the indices of boxes (n, 4) with pixels in the picture.

    A diverged motion has no finite corner (n, 2).
    """
    is_inside = (boxes[:, 2:] > boxes[:, :2]).all(axis=1)
    return np.flatnonzero(is_inside & np.isfinite(corners).all(axis=1))


def _add_cells(
    darkness: F32,
    picture: F32,
    width: int,
    boxes: NDArray[np.int64],
    weights: Sequence[float],
) -> list[Slices]:
    """Add the cells of a picture, `width` px each, to boxes (n, 4) of `darkness`, times
    weights; return the boxes.
    """
    slices: list[Slices] = []
    for j, (left, top, right, bottom) in enumerate(boxes.tolist()):
        start = j * width
        shadow = picture[: bottom - top, start : start + right - left]
        # Most weights are 1: a product would only cost time.
        if weights[j] != 1:
            shadow = np.float32(weights[j]) * shadow
        darkness[top:bottom, left:right] += shadow
        slices.append(np.s_[top:bottom, left:right])
    return slices


class _Row:
    """Sliding shadows of about one size, side by side."""

    def __init__(self, members: Sequence[tuple[tuple[int, int], F32, float]]) -> None:
        corners, pictures, leans = zip(*members, strict=True)
        self.picture, self.left = lay_side_by_side(pictures, cv2.BORDER_CONSTANT)
        self.corner = np.array(corners, np.float64)
        self.size = np.array([picture.shape[::-1] for picture in pictures])
        self.speed = 1 + np.array(leans)[:, None]

    def add_shadows(
        self, darkness: F32, members: Sequence[tuple[int, SpritePose, float]]
    ) -> list[Slices]:
        """Add shadows, times weights, to `darkness` (H, W); return their boxes."""
        places = np.array([place for place, _, _ in members])
        corner = self._shifted_corners(places, [stand for _, stand, _ in members])
        boxes = self._clip_boxes(places, corner, darkness.shape[::-1])
        visible = _visible_boxes(boxes, corner)
        if not len(visible):
            return []
        pixel_boxes = boxes[visible].astype(int)
        picture, width = self._warp(places[visible], corner[visible], pixel_boxes)
        weights = [members[number][2] for number in visible.tolist()]
        return _add_cells(darkness, picture, width, pixel_boxes, weights)

    def _shifted_corners(
        self, places: NDArray[np.int64], stands: Sequence[SpritePose]
    ) -> F64:
        """Return the corners (n, 2) of shadows at the poses of their objects, px."""
        shifts = []
        for stand in stands:
            shift_x = stand.pose.x - stand.start.x
            shift_y = stand.pose.y - stand.start.y
            shifts.append((shift_x, shift_y))
        # A leaning light moves the shadow further than the object.
        shadow_shifts = self.speed[places] * np.array(shifts)
        return np.asarray(self.corner[places] + shadow_shifts, np.float64)

    def _clip_boxes(
        self, places: NDArray[np.int64], corner: F64, size: tuple[int, ...]
    ) -> F64:
        """Return the boxes (n, 4) of shadows on a canvas of `size` (W, H)."""
        first = np.floor(corner)
        last = np.minimum(first + self.size[places] + 1, size)
        return np.hstack([np.maximum(first, 0), last])

    def _warp(
        self, places: NDArray[np.int64], corner: F64, boxes: NDArray[np.int64]
    ) -> tuple[F32, int]:
        """Return the shadows side by side in cells of the largest box; and a cell's
        width.
        """
        # Corners are between pixels: the warp interpolates the remaining part.
        offset = boxes[:, :2] - corner
        width, height = (boxes[:, 2:] - boxes[:, :2]).max(axis=0).tolist()
        strip = Strip(len(places), (height, width))
        x = strip.empty()
        y = strip.empty()
        x[:] = strip.columns + strip.to_columns(offset[:, 0] + self.left[places])
        np.add(strip.rows, strip.to_columns(offset[:, 1] + GAP), out=y)
        return warp_picture(self.picture, x, y), width
