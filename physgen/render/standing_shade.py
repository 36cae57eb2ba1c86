"""Shade of a standing object on its floor while the object rocks.

The shade of the photo stays on the floor. It is as dark and as narrow as in the photo
where the base touches the floor, and lighter and softer below a part of the base that
is lifted. Behind the object, where the photo shows no shade, the shade beside the base
continues: light enters the gap below a lifted base.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import ceil, exp, inf, sin, tan

import cv2
import numpy as np

from physgen.arrays import F32, F64, Mask
from physgen.geometry.polygon import Pose, rotation
from physgen.geometry.shadows import PixelBox, Silhouette, clipped_box
from physgen.perceive.inpaint.poisson import harmonic_fill


@dataclass(frozen=True)
class StandingTuning:
    """Change of shade with the height of a base; lengths are in sizes of an object."""

    penumbra: float = 0.4
    """Standard deviation of the blur, px for each px of lift: that of a wide light."""
    sigmas: tuple[float, ...] = (0.0, 1.5, 3.0, 6.0, 12.0)
    """Standard deviations of the stored pictures, px; others are mixtures."""
    half_lift: float = 0.04
    """Lift at which half of the contact shade is left; by eye."""
    reach: float = 0.1
    """Distance from the base over which shade belongs to the contact."""
    base_height: float = 0.25
    """Height of the base over its lowest point."""
    ring: int = 6
    """Width of the border of an object, px, in which shade is unreliable."""
    side_per_step: float = 200.0
    """Size of an object for each px of the side of its grid cells, px."""
    largest_step: int = 3
    """Largest side of the grid cells, px."""
    fill_step: int = 4
    """Side of the cells in which shade is continued behind an object, px."""
    begin: float = 1.0
    """Lift of an end of the base, px, over which the moving shade takes over."""
    turns: tuple[float, float] = (0.2, 0.5)
    """Rotations, rad, between which the shade of the photo loses its validity."""
    rise: float = 0.25
    """Height over the floor over which the shade of the photo loses its validity."""
    gap: float = 0.03
    """Largest height of a standing object over its floor, in its heights."""
    slack: float = 0.3
    """Height of the lowest pixel over the floor that is uncertain, relative to the
    lift of an end: the outline of a round base is not that of the simulation."""


STANDING = StandingTuning()


@dataclass(frozen=True)
class BaseMotion:
    """The motion of a base from the photo to a pose, px."""

    shift: tuple[float, float]
    """Displacement of the shade along the floor."""
    pivot: float
    """Column of the lowest point of the object."""
    pivot_lift: float
    """Lift of that point, relative to `shift`; negative if it is lower."""
    slope: float
    """Lift for each px to the right."""
    ends: tuple[float, float]
    """Columns of both ends of the base."""
    height: float
    """Height of the lowest point over the floor."""
    turn: float
    """Rotation, rad."""

    def lifts(self, columns: F32) -> F32:
        """Return the lift (w,) of the base at columns (w,)."""
        places = np.clip(columns, *self.ends) - np.float32(self.pivot)
        return np.asarray(
            np.float32(self.pivot_lift) + np.float32(self.slope) * places, np.float32
        )

    def begin_share(self) -> float:
        """Return 0 for a base on its floor as in the photo, and 1 for a lifted one."""
        lifts = self.lifts(np.array(self.ends, np.float32))
        return min(float(np.abs(lifts).max()) / STANDING.begin, 1.0)

    def rocking_share(self, side: float) -> float:
        """Return the share of an object's shade that is drawn by its lift; the object
        has the size `side` px.
        """
        return self.begin_share() * self._valid_share(side)

    def _valid_share(self, side: float) -> float:
        """Return the share of the photo's shade that is valid."""
        low, high = STANDING.turns
        turn_share = (high - abs(self.turn)) / (high - low)
        distance = self.height / (STANDING.rise * side)
        return min(max(turn_share, 0.0), 1.0) * exp(-(distance**2))


def base_points(start: Silhouette) -> F64:
    """Return the corners (n, 2) of the lower outline of an object, px of the photo;
    none of an empty one.
    """
    first_column, lowest = start.lowest
    columns = np.flatnonzero(lowest)
    if not len(columns):
        return np.zeros((0, 2))
    x = start.corner[0] + first_column + columns
    y = start.corner[1] + lowest[columns] - 0.5
    points = np.stack([x, y], axis=1).astype(np.float32)
    return np.asarray(cv2.convexHull(points).reshape(-1, 2), np.float64)


def measure_base_motion(
    points: F64, start: Pose, pose: Pose, floor_drop: float
) -> BaseMotion:
    """Return the motion of a base with corners `points` (n, 2) px.

    `floor_drop`: displacement of the floor below the object, px down.
    """
    # Rotate the corners of the base with the object; the lowest one, with the largest
    # y, is the point on which the object rocks.
    turn = pose.angle - start.angle
    offsets = points - (start.x, start.y)
    moved_points = offsets @ rotation(turn).T + (pose.x, pose.y)
    k = int(np.argmax(moved_points[:, 1]))
    pivot, moved_pivot = points[k].tolist(), moved_points[k].tolist()
    left, right = points[:, 0].min(), points[:, 0].max()
    # The corner may stand on the floor or slightly beside it, as masks are inexact. The
    # shade stays on the floor within the slack of a tilted base.
    drop = moved_pivot[1] - float(points[:, 1].max())
    slack = STANDING.slack * abs(sin(turn)) * (right - left)
    shift = (
        moved_pivot[0] - pivot[0],
        min(max(drop, floor_drop - slack), floor_drop + slack),
    )
    # The lift grows linearly along the base from the pivot: its slope is the tangent of
    # the rotation, limited before it becomes infinite.
    return BaseMotion(
        shift=shift,
        pivot=moved_pivot[0],
        pivot_lift=pivot[1] + shift[1] - moved_pivot[1],
        slope=-tan(min(max(turn, -1.0), 1.0)),
        ends=(left + shift[0], right + shift[0]),
        height=abs(shift[1] - drop),
        turn=turn,
    )


@dataclass(frozen=True)
class StandingShade:
    """Shade of an object at its base; darkness is -log of the remaining light."""

    corner: tuple[int, int]
    """Column and row of the photo."""
    contact: F32
    """Darkness (h, w, 3) of grid cells in the photo."""
    step: int
    """Side of the grid cells, px."""
    points: F64
    """Corners of the lower outline, as `base_points`."""
    side: float
    """Size of the object, px."""

    @cached_property
    def _levels(self) -> list[F32]:
        """Return the blurred shade for each of `STANDING.sigmas`, with a margin."""
        margin = self._margin
        padded_shade = cv2.copyMakeBorder(
            self.contact, margin, margin, margin, margin, cv2.BORDER_CONSTANT
        )
        levels = [np.asarray(padded_shade, np.float32)]
        for sigma in STANDING.sigmas[1:]:
            width = sigma / self.step
            blurred_shade = cv2.GaussianBlur(padded_shade, (0, 0), width)
            levels.append(np.asarray(blurred_shade, np.float32))
        return levels

    @property
    def _margin(self) -> int:
        """Return the margin of blurred shade, cells."""
        return ceil(2 * STANDING.sigmas[-1] / self.step)

    def draw(
        self,
        motion: BaseMotion,
        size: tuple[int, int],
        ends: tuple[float, float] = (-inf, inf),
    ) -> tuple[PixelBox, F32] | None:
        """Return a box and the share (h, w, 3) of light that the shade below a moved
        base leaves, on a canvas of `size` (W, H); None outside the canvas.

        `ends`: columns of both ends of the floor.
        """
        margin = self.step * self._margin
        left = self.corner[0] - margin + motion.shift[0]
        top = self.corner[1] - margin + motion.shift[1]
        height, width = self._levels[0].shape[:2]
        right, bottom = left + self.step * width, top + self.step * height
        box = clipped_box((left, top, right, bottom), size)
        if box is None:
            return None
        columns = _cell_centers(box[0], box[2], self.step)
        rows = _cell_centers(box[1], box[3], self.step)[:, None] - np.float32(top)
        lifts = motion.lifts(columns)
        weights = self._level_weights(lifts) * _share_between(columns, ends)
        # A part of the base that turned down has pushed its shade before it.
        rows = np.asarray(rows + np.minimum(lifts, 0), np.float32)
        darkness = self._mix_levels(columns - np.float32(left), rows, weights)
        return box, self._enlarge(np.asarray(cv2.exp(-darkness), np.float32), box)

    def _level_weights(self, lifts: F32) -> F32:
        """Return the weight of each level in each column, (levels, w)."""
        heights = np.maximum(lifts, 0)
        # The penumbra widens in proportion to the height over the floor. Levels are
        # copies of the shade with fixed blurs: interpolate linearly between the two
        # next ones.
        sigmas = np.float32(STANDING.penumbra) * heights
        count = len(STANDING.sigmas)
        places = np.interp(sigmas, STANDING.sigmas, np.arange(count))
        weights = np.maximum(1 - np.abs(places - np.arange(count)[:, None]), 0)
        # More light comes below a higher base: the shade is half as dark at a lift of
        # `half_lift` times the side of the object.
        light_share = 1 / (1 + heights / np.float32(STANDING.half_lift * self.side))
        return np.asarray(weights * light_share, np.float32)

    def _mix_levels(self, columns: F32, rows: F32, weights: F32) -> F32:
        """Return the mixture of levels, (h, w, 3), at columns (w,) and rows (h, w), px
        from the corner of the levels.

        `weights`: (levels, w).
        """
        # Positions count from the centres of pixels; the centre of cell 0 is half a
        # step from the corner.
        cell_rows = (rows + np.float32(0.5)) / np.float32(self.step) - np.float32(0.5)
        cell_columns = (columns + np.float32(0.5)) / np.float32(self.step)
        cell_columns = np.repeat(cell_columns[None] - np.float32(0.5), len(rows), 0)
        darkness = np.zeros((*rows.shape, 3), np.float32)
        for level, level_weights in zip(self._levels, weights, strict=True):
            # Each level is needed in few columns, as the lift changes along the base.
            used = np.flatnonzero(level_weights)
            if not len(used):
                continue
            span = np.s_[:, used[0] : used[-1] + 1]
            part = cv2.remap(
                level, cell_columns[span], cell_rows[span], cv2.INTER_LINEAR
            )
            darkness[span] += part * level_weights[span[1], None]
        return darkness

    def _enlarge(self, cells: F32, box: PixelBox) -> F32:
        """Return the pixels (h, w, 3) of a box, given its cells."""
        if self.step == 1:
            return cells
        size = (cells.shape[1] * self.step, cells.shape[0] * self.step)
        pixels = cv2.resize(cells, size, interpolation=cv2.INTER_LINEAR)
        part = pixels[: box[3] - box[1], : box[2] - box[0]]
        return np.asarray(part, np.float32)


def _share_between(columns: F32, ends: tuple[float, float]) -> F32:
    """Return the share 0..1 of columns (w,) between two ends, px."""
    inside = np.minimum(columns - ends[0], ends[1] - columns) + 0.5
    return np.asarray(np.clip(inside, 0, 1), np.float32)


def _cell_centers(start: int, end: int, step: int) -> F32:
    """Return the centres (n,) px of cells that cover the pixels from `start` on."""
    count = ceil((end - start) / step)
    return np.asarray(start - 0.5 + step * (np.arange(count) + 0.5), np.float32)


def split_contact_shade(
    start: Silhouette, box: PixelBox, shade: F32, measured_mask: Mask
) -> tuple[StandingShade, F32] | None:
    """Split the shade (h, w, 3) of an object in a box of the photo.

    `measured_mask` (h, w): pixels with valid shade up to the border of the object.
    Returns the shade at its base, and the mean (h, w) of the remaining shade, both
    continued behind the object. None for an object without a visible base.
    """
    points = base_points(start)
    if not len(points) or not shade.size:
        return None
    side = float(min(start.coverage.shape))
    # Shade behind the object and in its blurred border is unknown: continue the shade
    # of the surroundings into it.
    cover = _covered_pixels(start, box)
    hole = _dilated(cover, STANDING.ring) & ~measured_mask | _dilated(cover, 1)
    whole_shade = continue_into(shade, hole)
    share = _contact_share(cover, points, box[1], side)
    if share is None:
        return None
    rest = np.asarray((1 - share) * whole_shade.mean(axis=2), np.float32)
    # Store only the window with a visible share, in cells of the object's size: the
    # shade is smooth.
    x, y, width, height = cv2.boundingRect((share > LEAST_SHARE).astype(np.uint8))
    window = np.s_[y : y + height, x : x + width]
    step = min(max(int(side / STANDING.side_per_step), 1), STANDING.largest_step)
    contact = _cell_means(share[window][..., None] * whole_shade[window], step)
    corner = (box[0] + x, box[1] + y)
    return StandingShade(corner, contact, step, points, side), rest


def _cell_means(pixels: F32, step: int) -> F32:
    """Return the means (h, w, 3) of the cells of `step` px that cover a picture."""
    height, width = pixels.shape[:2]
    padding = ((0, -height % step), (0, -width % step), (0, 0))
    padded_pixels = np.pad(pixels, padding, "edge")
    cells = (padded_pixels.shape[1] // step, padded_pixels.shape[0] // step)
    means = cv2.resize(padded_pixels, cells, interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)


def continue_into(shade: F32, hole: Mask) -> F32:
    """Return shade (h, w, 3) that continues smoothly into a hole (h, w)."""
    height, width = hole.shape
    step = max(min(STANDING.fill_step, height // 4, width // 4), 1)
    cells = (ceil(width / step), ceil(height / step))
    # A coarse grid suffices, since the continuation is smooth; means over the known
    # pixels of a cell keep their level.
    known = np.asarray(~hole, np.float32)
    share = cv2.resize(known, cells, interpolation=cv2.INTER_AREA)
    sums = cv2.resize(shade * known[..., None], cells, interpolation=cv2.INTER_AREA)
    coarse_shade = sums / np.maximum(share, np.float32(LEAST_SHARE))[..., None]
    coarse_hole = np.asarray(share < FULL_CELL, np.bool_)
    filled = harmonic_fill(np.asarray(coarse_shade, np.float32), coarse_hole)
    smooth = cv2.resize(filled, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.where(hole[..., None], smooth, shade), np.float32)


FULL_CELL = 0.5
"""Least known share of a cell with a known shade."""
LEAST_SHARE = 0.01
"""Largest invisible share of shade."""


def _contact_share(cover: Mask, points: F64, top: int, side: float) -> F32 | None:
    """Return the share (h, w) of shade that belongs to the contact; None without a
    visible base.

    `cover` (h, w): pixels of the object, whose first row is at row `top` of the photo.
    """
    # The base is the lowest part of the visible pixels. Shade belongs to the contact in
    # proportion to exp(-(distance / reach)²).
    foot = float(points[:, 1].max())
    first_row = foot - STANDING.base_height * side - top
    is_base = cover.copy()
    is_base[: max(ceil(first_row), 0)] = False
    if not is_base.any():
        return None
    distance = cv2.distanceTransform((~is_base).astype(np.uint8), cv2.DIST_L2, 5)
    share = np.exp(-np.square(distance / (STANDING.reach * side)))
    # Above the base, the shade beside an object does not depend on the lift.
    rows = np.arange(len(cover), dtype=np.float32)[:, None]
    rise = (rows - np.float32(first_row)) / np.float32(STANDING.reach * side)
    return np.asarray(share * np.clip(rise, 0, 1), np.float32)


def _covered_pixels(start: Silhouette, box: PixelBox) -> Mask:
    """Return the mask (h, w) of an object in a box of the photo."""
    shift_x, shift_y = start.corner[0] - box[0], start.corner[1] - box[1]
    matrix = np.array([[1.0, 0, shift_x], [0, 1, shift_y]])
    size = (box[2] - box[0], box[3] - box[1])
    coverage = cv2.warpAffine(start.coverage, matrix, size)
    return np.asarray(coverage > LEAST_SHARE, np.bool_)


def _dilated(mask: Mask, reach: int) -> Mask:
    """Return a mask (h, w) with a margin of `reach` px."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0, np.bool_)
