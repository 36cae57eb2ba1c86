"""Straight lines through a hole, continued with their texture.

Copies of patches lose thin structures: the gap between two planks, the edge of a table
or a horizon ends at the hole. The strip of a certain line is straightened on both sides,
copied along the line and blended into the fill (structure propagation, Sun et al. 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.certain_lines import LINES, CertainLine
from physgen.perceive.inpaint.copy_offsets import I64
from physgen.perceive.inpaint.line_sides import LineSides, has_other_colours, mend_sides
from physgen.perceive.roles import Mask

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class _Tuning:
    """Limits and sizes of strips, px of the reduced photo; by eye on five photos of
    tables.
    """

    # Visible length that is copied, and that at a rough end.
    copied_length: int = 120
    rough_length: float = 32.0
    # Least share of a pixel that no line has painted.
    free: float = 0.05
    # Half the width of the searched structure.
    search: int = 24
    # Change of colour per px in a line over the largest change.
    gradient: float = 0.25
    # Levels per px: smaller changes are texture.
    least_gradient: float = 3.0
    # Width of plain ground between two edges of one structure.
    gap: int = 10
    # Width of the ground beside a line that is copied with it.
    ground_width: int = 10
    # Levels, RMS: ground with more detail along the line, e.g. leaves beside a window,
    # is better copied as patches.
    ground_detail: float = 8.0
    # Largest copied detail over its median, beside this many levels.
    outlier: float = 2.5
    least_detail: float = 2.0
    # Least visible length of a column of the strip.
    fewest: float = 4.0
    # Levels: larger differences between the ground beside the hole and the visible ends
    # of the line are another structure ...
    departure: float = 60.0
    # ... in at most this share of the strip.
    departing: float = 0.1
    # Length of the mean colours at each end.
    mean: int = 16
    # Length of the blend between copies.
    blend: int = 8
    # Standard deviation of the blur across a line against grain.
    blur_width: float = 1.0
    # Largest distance of the same edge at both ends from their line.
    edge_shift: float = 4.0


TUNING = _Tuning()
KNOWN_ERROR = 1e-3
"""Largest share of an unknown pixel in an interpolated known colour."""
LEAST_RUN = 5
"""px: shortest visible part of a column of a strip."""
MOST_ROWS = 16_384
"""Rows of pixels in one call of OpenCV, which allows at most 32,767."""


def paint_lines(
    filled: F32, photo: F32, hole: Mask, lines: Sequence[CertainLine], scale: float
) -> F32:
    """Return `filled` (H, W, 3) with the strips of `lines` copied into `hole` (H, W).

    `scale` is the number of px of the photo per px of the reduced photo.
    """
    result = filled.copy()
    free_share = hole.astype(np.float32)
    for line in lines:
        strip = _straighten(photo, hole, line, scale)
        continuation = strip.continue_colours()
        if continuation is not None:
            _blend_strip(result, free_share, strip, *continuation)
            # Painted pixels are right.
            free_hole = hole & (free_share > TUNING.free)
            sides = _measure_sides(strip, free_hole, continuation[1])
            if sides is not None:
                mend_sides(result, free_hole, sides)
    return result


@dataclass(frozen=True, eq=False)
class _Strip:
    """The straightened surroundings of a line; rows follow the line."""

    colours: F32
    """(n, m, 3): row along the line, column across it."""
    known_mask: Mask
    """(n, m)."""
    center: F64
    """(n, 2): x, y of the line at each row."""
    normal: F64
    """(n, 2): unit vectors along increasing columns."""
    outside: int
    """Rows before the start and after the end of the line."""
    copied_rows: tuple[int, int]
    """Rows before the start and after the end that show the line."""
    scale: float

    @property
    def box(self) -> tuple[slice, slice]:
        """Return the rows and columns of the photo around the strip."""
        half_width = self.known_mask.shape[1] // 2
        low = np.maximum(np.floor(self.center.min(axis=0)).astype(int) - half_width, 0)
        high = np.ceil(self.center.max(axis=0)).astype(int) + half_width + 1
        return np.s_[low[1] : high[1], low[0] : high[0]]

    def continue_colours(self) -> tuple[F32, F32] | None:
        """Return continued colours (n, m, 3) and their weights (n, m).

        None means that the line has no structure, or that the structure beside the
        hole departs from the line.
        """
        colours = self.colours.copy()
        is_set = np.zeros(self.known_mask.shape, np.bool_)
        share, structure = self._shares()
        departures = []
        for column in np.flatnonzero(share > 0).tolist():
            for first, last in _unknown_runs(self.known_mask[:, column]):
                run = self._continue_column(column, first, last)
                if run is not None:
                    colours[first:last, column], departure = run
                    is_set[first:last, column] = True
                    if structure[column]:
                        departures.append(departure)
        # A curved line beside a border that is nearly parallel to it departs from its
        # chord: then the colours beside the hole are not those of its ends.
        if not departures or _share_above(departures) > TUNING.departing:
            return None
        inner = slice(self.outside, len(colours) - self.outside)
        self._close_gaps(
            colours[inner], is_set[inner], self.known_mask[inner], share > 0
        )
        return colours, np.where(is_set, share, np.float32(0))

    def _close_gaps(
        self, colours: F32, is_set: Mask, known: Mask, columns: Mask
    ) -> None:
        """Fill unknown pixels of `columns` (m,) from neighbouring columns, in place."""
        size = 2 * round(TUNING.edge_shift * self.scale) + 1, 1
        weights = is_set.astype(np.float32)
        total = cv2.blur(weights, size)[..., None]
        sums = cv2.blur(colours * weights[..., None], size)
        gaps = ~known & ~is_set & columns & (total[..., 0] > KNOWN_ERROR)
        colours[gaps] = sums[gaps] / total[gaps]
        is_set[gaps] = True

    def _continue_column(
        self, column: int, first: int, last: int
    ) -> tuple[F32, float] | None:
        """Return colours (last - first, 3) of an unknown run of a column, or None.

        The second value is the departure of the colours beside the run from the visible
        ends of the line, in levels.
        """
        before, after = self._copied_colours(column, first, last)
        length = round(TUNING.mean * self.scale)
        if min(len(before), len(after)) < TUNING.fewest * self.scale:
            return None
        count = last - first
        place = (np.arange(count, dtype=np.float32) + 0.5)[:, None] / count
        means = before[:length].mean(axis=0), after[:length].mean(axis=0)
        # Copies meet in the middle of the run.
        blend = max(TUNING.blend * self.scale / count, 1e-3)
        second_share = np.clip((place - 0.5) / blend + 0.5, 0, 1)
        detail = (1 - second_share) * _reflected_detail(before, count, length)
        detail += second_share * _reflected_detail(after, count, length)[::-1]
        run = (1 - place) * means[0] + place * means[1] + detail
        departure = max(
            float(np.abs(mean - profile[column]).max())
            for mean, profile in zip(means, self.profiles, strict=True)
        )
        return np.asarray(run, np.float32), departure

    def _copied_colours(self, column: int, first: int, last: int) -> tuple[F32, F32]:
        """Return the known colours (n, 3) before and after a run, from the run
        outwards.
        """
        values, known_rows = self.colours[:, column], self.known_mask[:, column]
        before = _known_run(values[:first][::-1], known_rows[:first][::-1])
        after = _known_run(values[last:], known_rows[last:])
        return before[: self.copied_rows[0]], after[: self.copied_rows[1]]

    def _shares(self) -> tuple[F32, Mask]:
        """Return the weight (m,) of each column, and the columns of the structure.

        The weight is 1 in the structure and 0 beyond its sides.
        """
        reach = np.ones(2 * round(TUNING.edge_shift * self.scale) + 1)
        changes = [
            np.convolve(self._change(profile), reach, mode="same") > 0
            for profile in self.profiles
        ]
        # Both ends show the structure, perhaps displaced by a few px.
        structure = np.flatnonzero(changes[0] & changes[1])
        middle = self.known_mask.shape[1] // 2
        share = np.zeros(self.known_mask.shape[1], np.float32)
        if not len(structure):
            return share, share > 0
        gap = round(TUNING.gap * self.scale)
        groups = np.split(structure, np.flatnonzero(np.diff(structure) > gap) + 1)
        group = min(groups, key=lambda one: np.abs(one - middle).min())
        distance = np.arange(len(share))
        distance = np.maximum(group[0] - distance, distance - group[-1])
        # The outer half of the ground beside the structure is blended.
        margin = TUNING.ground_width * self.scale
        share = np.clip(2 - 2 * distance / margin, 0, 1)
        share *= self._plainness()
        return np.asarray(share, np.float32), distance <= 0

    def _plainness(self) -> F64:
        """Return weights (m,): 1 in the line, lower from the first busy column on."""
        visible = self.known_mask.astype(np.float32)[..., None]
        visible[self.outside : len(visible) - self.outside] = 0
        size = 1, round(TUNING.mean * self.scale)
        total = cv2.blur(visible, size, borderType=cv2.BORDER_CONSTANT)[..., None]
        sums = cv2.blur(self.colours * visible, size, borderType=cv2.BORDER_CONSTANT)
        detail = (self.colours - sums / np.maximum(total, KNOWN_ERROR)) * visible
        counts = np.maximum(visible.sum(axis=(0, 2)), 1)
        levels = np.sqrt((detail**2).mean(axis=2).sum(axis=0) / counts)
        weights = np.clip(2 - levels / TUNING.ground_detail, 0, 1)
        middle, half_width = len(weights) // 2, round(TUNING.edge_shift * self.scale)
        weights[middle - half_width : middle + half_width + 1] = 1
        weights[middle:] = np.minimum.accumulate(weights[middle:])
        weights[middle::-1] = np.minimum.accumulate(weights[middle::-1])
        return np.asarray(weights, np.float64)

    def _change(self, profile: F32) -> Mask:
        """Return the columns (m,) with an edge along the line."""
        smooth_profile = cv2.GaussianBlur(
            profile[None], (0, 0), TUNING.blur_width * self.scale
        )[0]
        change = (
            np.linalg.norm(np.gradient(smooth_profile, axis=0), axis=1) * self.scale
        )
        middle = len(change) // 2
        half_width = round(TUNING.edge_shift * self.scale)
        largest = change[middle - half_width : middle + half_width + 1].max()
        limit = max(TUNING.least_gradient, TUNING.gradient * largest)
        return np.asarray(change > limit)

    def places_of(self, pixels: I64) -> tuple[F64, F64]:
        """Return column and row (n,) in the strip of pixels x, y (n, 2)."""
        # The line is nearly straight: its chord gives the nearest row.
        start, end = self.center[self.outside], self.center[-self.outside - 1]
        direction = (end - start) / np.hypot(*(end - start))
        place = (pixels - start) @ direction + self.outside
        nearest = np.clip(np.rint(place).astype(int), 0, len(self.center) - 1)
        offset = pixels - self.center[nearest]
        normal = self.normal[nearest]
        column_places = (offset * normal).sum(axis=1) + self.known_mask.shape[1] // 2
        row_places = nearest + offset[:, 0] * normal[:, 1] - offset[:, 1] * normal[:, 0]
        return column_places, row_places

    @cached_property
    def profiles(self) -> tuple[F32, F32]:
        """Return the mean colours (m, 3) across the line before and after the hole."""
        rows_before, rows_after = self.copied_rows
        end = len(self.colours) - self.outside
        before = self._profile(slice(self.outside - rows_before, self.outside))
        return before, self._profile(slice(end, end + rows_after))

    @cached_property
    def end_columns(self) -> NDArray[np.bool_]:
        """Return the columns (m,) with visible pixels at both ends of the line."""
        rows_before, rows_after = self.copied_rows
        end = len(self.colours) - self.outside
        first_rows = self.known_mask[self.outside - rows_before : self.outside]
        last_rows = self.known_mask[end : end + rows_after]
        return np.asarray(first_rows.any(axis=0) & last_rows.any(axis=0))

    def _profile(self, rows: slice) -> F32:
        """Return the mean colours (m, 3) across the line on visible rows."""
        weights = self.known_mask[rows].astype(np.float32)[..., None]
        total = weights.sum(axis=0)
        sums = (self.colours[rows] * weights).sum(axis=0)
        return np.asarray(sums / np.maximum(total, 1), np.float32)


def _straighten(photo: F32, hole: Mask, line: CertainLine, scale: float) -> _Strip:
    """Return the strip around a line."""
    outside = round(TUNING.copied_length * scale)
    center = _center_line(line, outside)
    half_width = round(TUNING.search * scale)
    tangent = np.gradient(center, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    columns = np.arange(-half_width, half_width + 1, dtype=np.float64)[None, :, None]
    places = (center[:, None] + columns * normal[:, None]).astype(np.float32)
    x, y = np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])
    # Linear interpolation would blur the grain.
    colours = cv2.remap(photo, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    weights = cv2.remap((~hole).astype(np.float32), x, y, cv2.INTER_CUBIC)
    visible = (np.abs(weights - 1) < KNOWN_ERROR).astype(np.uint8)
    # Single visible pixels at a ragged border do not divide the hole.
    column = np.ones((LEAST_RUN, 1), np.uint8)
    known_mask = np.asarray(cv2.morphologyEx(visible, cv2.MORPH_OPEN, column) > 0)
    return _Strip(
        np.asarray(colours, np.float32),
        known_mask,
        center,
        normal,
        outside,
        _copied_rows(line, scale),
        scale,
    )


def _copied_rows(line: CertainLine, scale: float) -> tuple[int, int]:
    """Return the rows before the start and after the end of a line that are copied."""
    rows = [round(TUNING.copied_length * scale)] * 2
    for k, is_rough in enumerate(line.rough_ends):
        if is_rough:
            rows[k] = round(TUNING.rough_length * scale)
    return rows[0], rows[1]


def _center_line(line: CertainLine, outside: int) -> F64:
    """Return the points (n, 2) of a line in steps of 1 px, with `outside` more at each
    end.
    """
    chord = line.end - line.start
    length = float(np.hypot(*chord))
    direction = chord / length
    steps = np.arange(-outside, round(length) + outside + 1, dtype=np.float64)[:, None]
    inside = np.clip(steps, 0, length)
    # Inside the hole a cubic joins both visible parts.
    share = inside / length
    bend = share * (1 - share) ** 2 * (line.first - direction)
    bend -= share * share * (1 - share) * (line.last - direction)
    center = line.start + inside * direction + length * bend
    before = np.minimum(steps, 0) * line.first
    after = np.maximum(steps - length, 0) * line.last
    return np.asarray(center + before + after, np.float64)


def _blend_strip(
    result: F32, free_share: F32, strip: _Strip, colours: F32, weights: F32
) -> None:
    """Blend a strip into `result` (H, W, 3), in place; `free_share` (H, W) decreases.

    `colours` (n, m, 3) and `weights` (n, m) belong to the straightened strip.
    """
    box = strip.box
    rows, columns = np.nonzero(free_share[box] > 0)
    pixels = np.stack([columns + box[1].start, rows + box[0].start], axis=1)
    column_places, row_places = strip.places_of(pixels)
    x, y = (
        column_places.astype(np.float32)[:, None],
        row_places.astype(np.float32)[:, None],
    )
    share = _sample_rows(weights, x, y)
    sums = _sample_rows(colours * weights[..., None], x, y)
    values = sums / np.maximum(share, KNOWN_ERROR)[:, None]
    share = np.clip(share, 0, 1) * free_share[box][rows, columns]
    target = result[box]
    old = target[rows, columns]
    target[rows, columns] = old + share[:, None] * (values - old)
    free_share[box][rows, columns] -= share


def _measure_sides(strip: _Strip, hole: Mask, weights: F32) -> LineSides | None:
    """Return the pixels of `hole` (H, W) beside a line; None without clear ground there.

    `weights` (n, m) are those of the painted strip.
    """
    middle = strip.known_mask.shape[1] // 2
    half_line = round(TUNING.edge_shift * strip.scale)
    colours = _measure_ground_colours(strip, half_line)
    box = strip.box
    rows, columns = np.nonzero(hole[box])
    painted_columns = np.flatnonzero(weights.any(axis=0))
    if colours is None or not (len(rows) and len(painted_columns)):
        return None
    rows, columns = rows + box[0].start, columns + box[1].start
    column_places, row_places = strip.places_of(np.stack([columns, rows], axis=1))
    plain_columns = _find_plain_columns(strip, colours, half_line)
    nearest_columns = np.clip(np.rint(column_places).astype(int), 0, 2 * middle)
    side_mask = plain_columns[nearest_columns]
    side_mask &= (column_places >= 0) & (column_places <= 2 * middle)
    side_mask &= row_places >= strip.outside
    side_mask &= row_places < len(strip.center) - strip.outside
    return LineSides(
        pixels=(rows[side_mask], columns[side_mask]),
        offsets=np.asarray(column_places[side_mask] - middle, np.float32),
        colours=colours,
        half_line=half_line,
        painted_offsets=(painted_columns[0] - middle, painted_columns[-1] - middle),
        largest_offset=float(middle),
        scale=strip.scale,
    )


def _measure_ground_colours(strip: _Strip, half_line: int) -> tuple[F32, F32] | None:
    """Return the mean colours (3,) of the visible ground on both sides of a line.

    None if the ground is not visible at both ends, or if both sides are alike.
    """
    middle = strip.known_mask.shape[1] // 2
    width = round(TUNING.ground_width * strip.scale)
    end_columns = strip.end_columns
    profile = (strip.profiles[0] + strip.profiles[1]) / 2
    columns = np.arange(len(profile)) - middle
    near_columns = (np.abs(columns) > half_line) & (
        np.abs(columns) <= half_line + width
    )
    means = []
    for side_columns in (columns < 0, columns > 0):
        ground = profile[near_columns & side_columns & end_columns]
        if not len(ground):
            return None
        means.append(np.asarray(ground.mean(axis=0), np.float32))
    if float(np.linalg.norm(means[0] - means[1])) < LINES.contrast:
        return None
    return means[0], means[1]


def _find_plain_columns(
    strip: _Strip, colours: tuple[F32, F32], half_line: int
) -> NDArray[np.bool_]:
    """Return the columns (m,) from a line to the first other structure beside it.

    Beyond a dark bar, the ground may have the colours of the other side of the bar.
    """
    middle = strip.known_mask.shape[1] // 2
    offsets = np.arange(-middle, middle + 1).astype(np.float32)
    plain_columns = strip.end_columns.copy()
    for profile in strip.profiles:
        plain_columns &= ~has_other_colours(profile, offsets, colours)
    plain_columns |= np.abs(offsets) <= half_line
    plain_columns[middle:] = np.logical_and.accumulate(plain_columns[middle:])
    plain_columns[middle::-1] = np.logical_and.accumulate(plain_columns[middle::-1])
    return np.asarray(plain_columns)


def _sample_rows(array: F32, x: F32, y: F32) -> F32:
    """Return interpolated values of `array` at x and y (n, 1); 0 outside it."""
    parts = [
        cv2.remap(array, x[k : k + MOST_ROWS], y[k : k + MOST_ROWS], cv2.INTER_CUBIC)
        for k in range(0, len(x), MOST_ROWS)
    ]
    return np.asarray(np.concatenate(parts)[:, 0], np.float32)


def _share_above(departures: Sequence[float]) -> float:
    """Return the share of departures above the limit."""
    return float((np.array(departures) > TUNING.departure).mean())


def _unknown_runs(known: Mask) -> list[tuple[int, int]]:
    """Return first and last row (exclusive) of the runs of unknown rows.

    Runs at the ends of the strip are left out.
    """
    borders = np.flatnonzero(np.diff(~known, prepend=False, append=False)).tolist()
    runs = zip(borders[::2], borders[1::2], strict=True)
    return [(a, b) for a, b in runs if a > 0 and b < len(known)]


def _known_run(values: F32, known: Mask) -> F32:
    """Return the first values (n, 3) up to the first unknown one."""
    return values[: int(np.argmin(np.append(known, False)))]


def _reflected_detail(values: F32, count: int, length: int) -> F32:
    """Return `count` rows (count, 3) of the fine detail of `values` (n, 3), reflected
    at its ends.

    A reflection has no seam. `length` rows are averaged for the coarse part.
    """
    coarse_part = cv2.blur(values[:, None], (1, length), borderType=cv2.BORDER_REFLECT)
    detail = values - coarse_part[:, 0]
    # Another structure that crosses the visible line is not copied.
    size = np.abs(detail).max(axis=1, keepdims=True)
    limit = TUNING.outlier * np.median(size) + TUNING.least_detail
    detail *= np.clip(2 - size / limit, 0, 1)
    period = np.arange(count) % (2 * len(values))
    return np.asarray(detail[np.minimum(period, 2 * len(values) - 1 - period)])
