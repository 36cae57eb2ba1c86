"""Fill of a hole by coherent copies of the photo: a shift map with blended gradients.

A few offsets are chosen by statistics at reduced size, every pixel of the hole is labelled with one of them or with the
guide, another fill, and patches are copied at full size. The gradients of the copies are joined by Poisson's equation
(He and Sun 2012; Perez et al. 2003). A mean of many patches is a blur; a copy is as sharp as the photo.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import I64, Offsets, copy_offsets
from physgen.perceive.inpaint.offset_labels import COSTS, OffsetLabels, ReducedPhoto
from physgen.perceive.inpaint.patch_match import thin_out
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
    beside: int = 400  # pixels of that band that are compared, at most
    tries: int = 15  # places a side that are compared at once
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
        shifts = self._shifts(labels, offsets, scale)
        rows, columns = np.nonzero(self.hole)
        down, right = shifts[rows, columns].T
        copies = self.picture.copy()
        copies[rows, columns] = self.sources[rows + down, columns + right]
        return copies, join_gradients(self.sources, shifts, self.hole)

    def strengthened(self, filled: F32) -> F32:
        """`filled` (H, W, 3) with the fine detail that blended seams took from it."""
        missing = self._contrast_gap(filled)
        gain = float(np.clip(np.exp(-missing / 2), 1, TUNING.most_gain))
        hole = self.hole[self.near][..., None]
        whole = np.where(hole, filled[self.near], self.picture[self.near])
        detail = whole - cv2.GaussianBlur(whole, (0, 0), TUNING.detail)
        stronger = np.clip(whole + (gain - 1) * detail, 0, 255)
        result = filled.copy()
        result[self.near] = np.where(hole, stronger, filled[self.near])
        return result

    def contrast_error(self, filled: F32 | None = None) -> float:
        """Difference of contrast in the hole and around it, as logarithm of squares.

        `filled` (H, W, 3) is the fill; the guide if it is None.
        """
        return abs(self._contrast_gap(self.guide if filled is None else filled))

    def _contrast_gap(self, fill: F32) -> float:
        """Logarithm of squared fine detail in the hole over that around it."""
        hole = self.hole[self.near]
        whole = np.where(hole[..., None], fill[self.near], self.picture[self.near])
        inside = self._detail(whole, ~self.blocked[self.near] | hole)[hole]
        around = self._detail_around
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
        hole, blocked = self.hole[self.near], self.blocked[self.near]
        inside = _band_means(fill[self.near], hole & ~_eroded(hole, TUNING.border))
        known = dilate(hole, TUNING.border) & ~blocked
        outside = _band_means(self.picture[self.near], known)
        line = dilate(hole, 1) & ~blocked
        if not line.any():
            return TUNING.least_step
        step = np.abs(inside - outside).mean(axis=2)[line]
        return float(np.minimum(step, TUNING.most_step).mean()) + TUNING.least_step

    def least_gain(self) -> float:
        """By how much copies must suit the surroundings better, as such a logarithm.

        On an even ground, edges apart, the guide is right but for its own artefacts.
        """
        around = self._detail_around
        even = not len(around) or np.median(around) < TUNING.even
        return TUNING.even_gain if even else -TUNING.favour

    @cached_property
    def _detail_around(self) -> F32:
        """(n,): squared fine detail of the pixels around the hole."""
        hole, blocked = self.hole[self.near], self.blocked[self.near]
        ring = dilate(hole, TUNING.ring) & ~dilate(blocked, 1)
        squares = self._detail(self.picture[self.near], ~blocked)
        return np.asarray(cv2.GaussianBlur(squares, (0, 0), TUNING.grain)[ring])

    @cached_property
    def near(self) -> tuple[slice, slice]:
        """Rows and columns of the hole and of all that its contrast is compared with."""
        left, top, width, height = cv2.boundingRect(self.hole.view(np.uint8))
        margin = TUNING.ring + round(4 * (TUNING.grain + TUNING.detail))
        rows = slice(max(0, top - margin), top + height + margin)
        return rows, slice(max(0, left - margin), left + width + margin)

    @cached_property
    def sources(self) -> F32:
        """(H, W, 3): the photo, and the guide in the hole, which no shift names."""
        return np.where(self.hole[..., None], self.guide, self.picture)

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
        """(H, W, 2) rows and columns to the source of each pixel, refined by copies.

        `labels` (h, w) are those of the reduced picture.
        """
        shifts = np.zeros((*self.hole.shape, 2), np.int64)
        composed = _Composed(self.picture.copy(), ~self.blocked)
        for number, piece in _pieces_by_size(labels, scale, self.hole):
            offset = None
            if number < len(offsets):
                offset = self._refined(piece, offsets[number], scale, composed)
            if offset is None:
                offset = np.zeros(2, np.int64)
            shifts[piece.box][piece.mask] = offset
            copied = self.sources[piece.moved(offset)][piece.mask]
            composed.picture[piece.box][piece.mask] = copied
            composed.done[piece.box] |= piece.mask
        return shifts

    def _refined(
        self, piece: _Piece, offset: I64, scale: int, composed: _Composed
    ) -> I64 | None:
        """The full-size offset of a piece that suits what is beside it; None if none."""
        spacing = -(-(2 * scale - 1) // TUNING.tries)
        steps = np.arange(1 - scale, scale, spacing)
        best = self._legal_offset(piece, offset * scale, steps, composed)
        if best is None or spacing == 1:
            return best
        closer = np.arange(1 - spacing, spacing)
        return self._legal_offset(piece, best, closer, composed)

    def _legal_offset(
        self, piece: _Piece, offset: I64, steps: I64, composed: _Composed
    ) -> I64 | None:
        """The best of the offsets `steps` away by which known pixels are copied."""
        down, right = np.meshgrid(steps, steps, indexing="ij")
        tries = offset + np.stack([down.ravel(), right.ravel()], axis=1)
        beside = composed.beside(piece)
        aim = composed.picture[beside[:, 0], beside[:, 1]]
        last = np.array(self.hole.shape) - 1
        there = np.clip(beside + tries[:, None], 0, last)
        gaps = self.picture[there[..., 0], there[..., 1]]
        gaps -= aim
        costs = np.einsum("nkc,nkc->n", gaps, gaps)
        for k in np.argsort(costs, kind="stable").tolist():
            rows, columns = piece.moved(tries[k])
            if min(rows.start, columns.start) < 0:
                continue
            if rows.stop > last[0] + 1 or columns.stop > last[1] + 1:
                continue
            if not (self.blocked[rows, columns] & piece.mask).any():
                return np.asarray(tries[k], np.int64)
        return None


@dataclass(frozen=True)
class _Piece:
    """Connected pixels of the hole with one label."""

    box: tuple[slice, slice]
    mask: Mask
    """(h, w) in the box."""

    def moved(self, offset: I64) -> tuple[slice, slice]:
        """Rows and columns of the box at an offset."""
        rows, columns = self.box
        down, right = int(offset[0]), int(offset[1])
        return (
            slice(rows.start + down, rows.stop + down),
            slice(columns.start + right, columns.stop + right),
        )


@dataclass(frozen=True)
class _Composed:
    """The copies so far."""

    picture: F32
    done: Mask
    """(H, W): pixels that are known or copied."""

    def beside(self, piece: _Piece) -> I64:
        """(n, 2) pixels beside a piece that are composed already, evenly thinned out."""
        band = TUNING.seam_band
        top, left = (part.start for part in piece.box)
        own = np.pad(piece.mask, band)
        rows = slice(max(top - band, 0), piece.box[0].stop + band)
        columns = slice(max(left - band, 0), piece.box[1].stop + band)
        done = self.done[rows, columns]
        own = own[rows.start - top + band :, columns.start - left + band :]
        own = own[: done.shape[0], : done.shape[1]]
        ring = np.argwhere(dilate(own, band) & ~own & done)
        ring += [rows.start, columns.start]
        return np.asarray(thin_out(ring, TUNING.beside), np.int64)


def _pieces_by_size(
    labels: I64, scale: int, hole: Mask
) -> Iterator[tuple[int, _Piece]]:
    """Labels and connected pieces of the reduced `labels` (h, w), largest first.

    Pieces are at full size, in the `hole` (H, W).
    """
    pieces = []
    for number in np.unique(labels[labels >= 0]):
        count, names, stats, _ = cv2.connectedComponentsWithStats(
            (labels == number).astype(np.uint8), connectivity=4
        )
        boxes = stats.tolist()
        pieces += [
            (-boxes[k][4], int(number), k, names, boxes[k]) for k in range(1, count)
        ]
    for _, number, k, names, (left, top, width, height, _) in sorted(
        pieces, key=lambda one: one[:3]
    ):
        small = names[top : top + height, left : left + width] == k
        large = small.repeat(scale, axis=0).repeat(scale, axis=1)
        rows = slice(top * scale, min((top + height) * scale, hole.shape[0]))
        columns = slice(left * scale, min((left + width) * scale, hole.shape[1]))
        inside = hole[rows, columns]
        mask = large[: inside.shape[0], : inside.shape[1]] & inside
        if mask.any():
            yield number, _Piece((rows, columns), mask)


def _band_means(picture: F32, band: Mask) -> F32:
    """(H, W, 3): local means of `picture` (H, W, 3) from the pixels of `band` (H, W)."""
    weight = band.astype(np.float32)
    share = cv2.GaussianBlur(weight, (0, 0), TUNING.border_blur)[..., None]
    sums = cv2.GaussianBlur(picture * weight[..., None], (0, 0), TUNING.border_blur)
    return np.asarray(sums / np.maximum(share, 1e-3), np.float32)


def _eroded(mask: Mask, radius: int) -> Mask:
    """(H, W): the pixels of `mask` that are farther than `radius` px from its border."""
    return ~dilate(~mask, radius)


def _block_means(picture: F32, scale: int) -> F32:
    """Means of blocks of `scale` px a side; the last ones are filled up."""
    height, width = picture.shape[:2]
    padded = cv2.copyMakeBorder(
        picture, 0, -height % scale, 0, -width % scale, cv2.BORDER_REPLICATE
    )
    size = padded.shape[1] // scale, padded.shape[0] // scale
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA))
