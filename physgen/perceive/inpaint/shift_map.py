"""Fill of a hole by coherent copies of the photo: a shift map with blended gradients.

A few offsets are chosen by statistics at reduced size, every pixel of the hole is labelled with one of them or with the
guide, another fill, and patches are copied at full size. The gradients of the copies are joined by Poisson's equation
(He and Sun 2012; Perez et al. 2003). A mean of many patches is a blur; a copy is as sharp as the photo.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import I64, Offsets, copy_offsets
from physgen.perceive.inpaint.offset_labels import COSTS, OffsetLabels, ReducedPhoto
from physgen.perceive.inpaint.poisson import dilate, join_gradients
from physgen.perceive.roles import Mask


@dataclass(frozen=True)
class _Tuning:
    """Sizes, chosen for time; px of the photo unless said otherwise."""

    hole_pixels: int = 700  # of the reduced picture, at most
    reduced_side: int = 200  # px of the reduced picture's longer side, at most
    context: float = 3.0  # of a hole's longer side: surroundings that are copied from
    least_context: int = 64
    smallest: int = 40  # px: a smaller piece of the hole keeps the guide
    detail: float = 3.0  # standard deviation of the blur that separates fine detail
    ring: int = 14  # px around the hole whose contrast a fill should have
    grain: float = 4.0  # px: standard deviation of the blur that makes grain even
    even: float = 9.0  # squared levels of detail: 3 levels, as for smooth pieces
    favour: float = (
        0.15  # logarithm: copies are taken unless they are worse by this ...
    )
    even_gain: float = 1.0  # ... or, on an even ground, unless they are better by this
    most_gain: float = (
        1.1  # of fine detail: 1.2 loses 0.3 dB and is right no more often
    )
    noise: float = 4.0  # squared levels of detail that nobody sees
    seam_band: int = 2  # px around a copy over which its place is refined
    border: int = 4  # px: bands beside the border whose colours are compared ...
    border_blur: float = 2.0  # ... after a blur of this standard deviation
    seam_weight: float = 1.5  # of the border's step beside the contrast
    copy_seam_weight: float = 0.5  # the same before gradients are joined: joining
    # spreads the step of a wrong copy over the hole
    least_step: float = 1.0  # levels across the border that nobody sees
    most_step: float = 60.0  # levels: a larger step is an edge of another object


TUNING = _Tuning()


def shift_map_fill(picture: F32, hole: Mask, guide: F32) -> F32:
    """`picture` (H, W, 3) with `hole` (H, W) filled by copies from its surroundings.

    `guide` (H, W, 3) is a fill by other means: copies follow its colours roughly, and
    a piece of the hole keeps it if its contrast and its border suit the surroundings
    better. A blur is as wrong as too much texture, or as a line that ends at the border.
    """
    result = np.where(hole[..., None], guide, picture)
    for part, piece in _windows(hole):
        window = _Window(picture[part], guide[part], piece, hole[part])
        copies, joined = window.fill()
        filled = window.strengthened(joined)
        gain = window.contrast_error() - window.contrast_error(filled)
        gain -= TUNING.seam_weight * window.seam_growth(filled)
        gain -= TUNING.copy_seam_weight * window.seam_growth(copies)
        if gain > window.least_gain():
            result[part] = np.where(piece[..., None], filled, result[part])
    return np.asarray(result, np.float32)


def _windows(hole: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Rows and columns around each connected piece of `hole`, and the piece there."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=8
    )
    for number in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[number])
        if area < TUNING.smallest:
            continue
        margin = int(max(TUNING.least_context, TUNING.context * max(width, height)))
        rows = slice(max(0, top - margin), top + height + margin)
        columns = slice(max(0, left - margin), left + width + margin)
        yield (rows, columns), names[rows, columns] == number


@dataclass(frozen=True)
class _Window:
    """A piece of the hole and its surroundings, (H, W) and (H, W, 3)."""

    picture: F32
    guide: F32
    hole: Mask
    blocked: Mask

    def fill(self) -> tuple[F32, F32]:
        """(H, W, 3) twice: copies and guide in the hole, as they are and joined."""
        scale = self._scale()
        reduced = self._reduced(scale)
        offsets = copy_offsets(
            reduced.picture, reduced.hole, reduced.blocked, COSTS.far
        )
        if not len(offsets):
            return self.guide, self.guide
        labels = OffsetLabels(reduced, offsets).solve()
        shifts = self._shifts(_enlarged(labels, scale, self.hole), offsets, scale)
        rows, columns = np.indices(self.hole.shape)
        sources = self._sources()
        copies = sources[rows + shifts[..., 0], columns + shifts[..., 1]]
        return copies, join_gradients(sources, shifts, self.hole)

    def strengthened(self, filled: F32) -> F32:
        """`filled` (H, W, 3) with the fine detail that blended seams took from it."""
        missing = self._contrast_gap(filled)
        gain = float(np.clip(np.exp(-missing / 2), 1, TUNING.most_gain))
        whole = np.where(self.hole[..., None], filled, self.picture)
        detail = whole - cv2.GaussianBlur(whole, (0, 0), TUNING.detail)
        stronger = np.clip(whole + (gain - 1) * detail, 0, 255)
        return np.where(self.hole[..., None], stronger, filled)

    def contrast_error(self, filled: F32 | None = None) -> float:
        """Difference of contrast in the hole and around it, as logarithm of squares.

        `filled` (H, W, 3) is the fill; the guide if it is None.
        """
        return abs(self._contrast_gap(self.guide if filled is None else filled))

    def _contrast_gap(self, fill: F32) -> float:
        """Logarithm of squared fine detail in the hole over that around it."""
        whole = np.where(self.hole[..., None], fill, self.picture)
        inside = self._detail(whole, ~self.blocked | self.hole)[self.hole]
        around = self._detail_around()
        if not len(around):
            return 0.0
        means = [np.log(part + TUNING.noise).mean() for part in (inside, around)]
        return float(means[0] - means[1])

    def seam_growth(self, filled: F32) -> float:
        """Logarithm of the step across the border with `filled` over the guide's.

        A line of the photo that ends at the border is a step; so is a displaced one.
        """
        return float(np.log(self._border_step(filled) / self._border_step(self.guide)))

    def _border_step(self, fill: F32) -> float:
        """Levels between bands on both sides of the hole's border, on average."""
        inside = _band_means(fill, self.hole & ~_eroded(self.hole, TUNING.border))
        known = dilate(self.hole, TUNING.border) & ~self.blocked
        outside = _band_means(self.picture, known)
        line = dilate(self.hole, 1) & ~self.blocked
        if not line.any():
            return TUNING.least_step
        step = np.abs(inside - outside).mean(axis=2)[line]
        return float(np.minimum(step, TUNING.most_step).mean()) + TUNING.least_step

    def least_gain(self) -> float:
        """By how much copies must suit the surroundings better, as such a logarithm.

        On an even ground, edges apart, the guide is right but for its own artefacts.
        """
        around = self._detail_around()
        even = not len(around) or np.median(around) < TUNING.even
        return TUNING.even_gain if even else -TUNING.favour

    def _detail_around(self) -> F32:
        """(n,): squared fine detail of the pixels around the hole."""
        ring = dilate(self.hole, TUNING.ring) & ~dilate(self.blocked, 1)
        squares = self._detail(self.picture, ~self.blocked)
        return np.asarray(cv2.GaussianBlur(squares, (0, 0), TUNING.grain)[ring])

    def _sources(self) -> F32:
        """(2 H, W, 3): the photo, and the guide below it, so that one shift names it."""
        return np.concatenate([self.picture, self.guide])

    def _scale(self) -> int:
        """How many px of the photo are one of the reduced picture."""
        by_area = (self.hole.sum() / TUNING.hole_pixels) ** 0.5
        by_side = max(self.hole.shape) / TUNING.reduced_side
        return max(1, int(np.ceil(max(by_area, by_side))))

    def _reduced(self, scale: int) -> ReducedPhoto:
        blocked = _block_means(self.blocked.astype(np.float32), scale) > 0
        hole = _block_means(self.hole.astype(np.float32), scale) > 0
        filled = np.where(self.blocked[..., None], self.guide, self.picture)
        guide = _block_means(filled, scale)
        detail = self._detail(self.picture, ~self.blocked)
        energy = np.log(_block_means(detail, scale) + TUNING.noise)
        return ReducedPhoto(guide, guide, hole, blocked, energy)

    @staticmethod
    def _detail(picture: F32, known: Mask) -> F32:
        """(H, W): squared fine detail of the grey levels."""
        grey, weight = picture.mean(axis=2), known.astype(np.float32)
        share = np.maximum(cv2.GaussianBlur(weight, (0, 0), TUNING.detail), 1e-3)
        soft = cv2.GaussianBlur(grey * weight, (0, 0), TUNING.detail) / share
        return np.asarray(((grey - soft) * weight) ** 2, np.float32)

    def _shifts(self, labels: I64, offsets: Offsets, scale: int) -> I64:
        """(H, W, 2) rows and columns to the source of each pixel, refined by copies."""
        height = len(self.hole)
        shifts = np.zeros((*self.hole.shape, 2), np.int64)
        result, done = self.picture.copy(), ~self.blocked
        for number, piece in _pieces_by_size(labels):
            place = np.argwhere(piece)
            if number < len(offsets):
                offset = self._refined(place, offsets[number], scale, (result, done))
            else:
                offset = None
            if offset is None:
                offset = np.array([height, 0])
            there = place + offset
            shifts[place[:, 0], place[:, 1]] = offset
            result[place[:, 0], place[:, 1]] = self._sources()[there[:, 0], there[:, 1]]
            done[place[:, 0], place[:, 1]] = True
        return shifts

    def _refined(
        self, place: I64, offset: I64, scale: int, composed: tuple[F32, Mask]
    ) -> I64 | None:
        """The full-size offset of a piece that suits what is beside it; None if none."""
        result, done = composed
        beside = self._beside(place, done)
        aim = result[beside[:, 0], beside[:, 1]]
        last = np.array(self.hole.shape) - 1
        rated = []
        for step in np.ndindex(2 * scale - 1, 2 * scale - 1):
            moved = offset * scale + np.array(step) - (scale - 1)
            there = np.clip(beside + moved, 0, last)
            gap = ((self.picture[there[:, 0], there[:, 1]] - aim) ** 2).sum(axis=1)
            cost = gap.mean() if len(gap) else 0.0
            rated.append((float(cost), *step, moved))
        rated.sort(key=lambda one: one[:3])
        for one in rated:
            there = place + one[3]
            if (there < 0).any() or (there > last).any():
                continue
            if not self.blocked[there[:, 0], there[:, 1]].any():
                return np.asarray(one[3], np.int64)
        return None

    def _beside(self, place: I64, done: Mask) -> I64:
        """(n, 2) pixels beside a piece that are composed already."""
        band = TUNING.seam_band
        low = np.maximum(place.min(axis=0) - band, 0)
        high = place.max(axis=0) + band + 1
        box = np.s_[low[0] : high[0], low[1] : high[1]]
        own = np.zeros_like(done[box])
        own[place[:, 0] - low[0], place[:, 1] - low[1]] = True
        ring = dilate(own, band) & ~own & done[box]
        return np.asarray(np.argwhere(ring) + low, np.int64)


def _pieces_by_size(labels: I64) -> Iterator[tuple[int, Mask]]:
    """Labels and masks of the connected pieces of `labels` (H, W), largest first."""
    pieces = []
    for number in np.unique(labels[labels >= 0]):
        count, names, stats, _ = cv2.connectedComponentsWithStats(
            (labels == number).astype(np.uint8), connectivity=4
        )
        areas = stats[:, cv2.CC_STAT_AREA]
        pieces += [(-int(areas[k]), int(number), k, names) for k in range(1, count)]
    for _, number, k, names in sorted(pieces, key=lambda one: one[:3]):
        yield number, names == k


def _band_means(picture: F32, band: Mask) -> F32:
    """(H, W, 3): local means of `picture` (H, W, 3) from the pixels of `band` (H, W)."""
    weight = band.astype(np.float32)
    share = cv2.GaussianBlur(weight, (0, 0), TUNING.border_blur)[..., None]
    sums = cv2.GaussianBlur(picture * weight[..., None], (0, 0), TUNING.border_blur)
    return np.asarray(sums / np.maximum(share, 1e-3), np.float32)


def _eroded(mask: Mask, radius: int) -> Mask:
    """(H, W): the pixels of `mask` that are farther than `radius` px from its border."""
    return ~dilate(~mask, radius)


def _enlarged(labels: I64, scale: int, hole: Mask) -> I64:
    """`labels` of the reduced picture at full size in `hole` (H, W), elsewhere -1."""
    height, width = hole.shape
    large = labels.repeat(scale, axis=0).repeat(scale, axis=1)[:height, :width]
    return np.where(hole, large, -1)


def _block_means(picture: F32, scale: int) -> F32:
    """Means of blocks of `scale` px a side; the last ones are filled up."""
    height, width = picture.shape[:2]
    pads = [(0, -height % scale), (0, -width % scale)]
    pads += [(0, 0)] * (picture.ndim - 2)
    padded = np.pad(picture, pads, mode="edge")
    rows, columns = padded.shape[0] // scale, padded.shape[1] // scale
    blocks = padded.reshape(rows, scale, columns, scale, *picture.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)
