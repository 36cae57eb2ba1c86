"""Fill of a hole by coherent copies of the photo: a shift map with blended gradients.

A few offsets are chosen by statistics at reduced size, every pixel of the hole is
labelled with one of them or with the guide, another fill, and patches are copied at
full size. Poisson's equation joins the gradients of the copies (He and Sun 2012; Perez
et al. 2003). A mean of many patches is blurred; a copy is as sharp as the photo.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import I64, Offsets, copy_offsets
from physgen.perceive.inpaint.odd_pieces import replace_odd_pieces
from physgen.perceive.inpaint.offset_labels import COSTS, OffsetLabels, ReducedPhoto
from physgen.perceive.inpaint.patch_match import thin_out
from physgen.perceive.inpaint.poisson import dilate, join_gradients
from physgen.perceive.roles import Mask
from physgen.photometry import channel_mean


@dataclass(frozen=True)
class _Tuning:
    """Sizes, chosen for time; px of the photo unless stated."""

    # Largest number of hole pixels of the reduced picture.
    hole_pixels: int = 700
    # px: longest side of the reduced picture.
    reduced_side: int = 200
    # Width of the surroundings with sources over the hole's longer side.
    context: float = 3.0
    least_context: int = 64
    # px: a smaller piece of the hole keeps the guide.
    smallest: int = 40
    # Standard deviation of the blur for the separation of fine detail.
    detail: float = 3.0
    # px around the hole with the target contrast.
    ring: int = 14
    # px: standard deviation of the blur of squared grain.
    grain: float = 4.0
    # Squared levels of detail: 3 levels, as for smooth pieces.
    even_detail: float = 9.0
    # Logarithm: copies are used unless they are worse by this ...
    favour: float = 0.15
    # ... or, on an even ground, only if they are better by this.
    even_gain: float = 1.0
    # Largest gain of fine detail: 1.2 loses 0.3 dB and is not correct more often.
    most_gain: float = 1.1
    # Squared levels of invisible detail.
    noise: float = 4.0
    # px around a copy for the refinement of its source.
    seam_band: int = 2
    # Largest number of compared pixels of that band.
    band_pixels: int = 400
    # Largest number of pixels of a copy that are compared with the guide, ...
    guide_pixels: int = 400
    # ... and their weight relative to the band: the guide continues strong edges at
    # the right place.
    guide_weight: float = 0.1
    # Width around another piece of the hole that is not copied over the square root of
    # its area: an object's rim, shadow, reflection or saucer would appear twice.
    around_others: float = 0.5
    # Least area of the sources over that of the piece.
    sources: float = 4.0
    # Positions per side in one comparison.
    tries: int = 15
    # px: width of the compared bands beside the border ...
    border: int = 4
    # ... after a blur of this standard deviation.
    border_blur: float = 2.0
    # Weight of the border's step relative to the contrast.
    seam_weight: float = 1.5
    # The same before gradients are joined, because joining spreads the step of a wrong
    # copy over the hole.
    copy_seam_weight: float = 0.5
    # Levels: invisible step across the border.
    least_step: float = 1.0
    # Levels: a larger step is an edge of another object.
    most_step: float = 60.0


TUNING = _Tuning()


def shift_map_fill(
    picture: F32, hole: Mask, guide: F32, barriers: Mask | None = None
) -> F32:
    """Return `picture` (H, W, 3) with `hole` (H, W) filled by copies of its
    surroundings.

    `guide` (H, W, 3) is another fill: copies follow its colours roughly, and a piece of
    the hole keeps it if its contrast and border suit the surroundings better. A blur is
    as wrong as too much texture, or as a line that ends at the border. Objects in
    `barriers` (H, W) are not copied.
    """
    result = np.where(hole[..., None], guide, picture)
    for part, piece in _windows(hole):
        blocked_mask = block_others(piece, hole[part])
        if barriers is not None:
            blocked_mask = _block_barriers(piece, blocked_mask, barriers[part])
        window = _Window(picture[part], guide[part], piece, blocked_mask)
        copies, joint_copies = window.fill()
        strong_fill = window.strengthen(joint_copies)
        # Copies replace the guide only if contrast and seams improve.
        gain = window.contrast_error() - window.contrast_error(strong_fill)
        gain -= TUNING.seam_weight * window.seam_growth(strong_fill)
        gain -= TUNING.copy_seam_weight * window.seam_growth(copies)
        if gain > window.least_gain():
            result[part] = np.where(piece[..., None], strong_fill, result[part])
    return np.asarray(result, np.float32)


def _windows(hole: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Yield rows and columns around each connected piece of `hole`, and the piece
    there.
    """
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


def block_others(piece: Mask, hole: Mask) -> Mask:
    """Return `hole` (H, W) with the surroundings of its pieces other than `piece`."""
    others = hole & ~piece
    if not others.any():
        return hole
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        others.astype(np.uint8), connectivity=8
    )
    # Pixels at the border of the piece are not sources but boundary values.
    border = dilate(piece, TUNING.ring)
    factor = TUNING.around_others
    max_area = hole.size - TUNING.sources * piece.sum()
    while factor > TUNING.around_others / 8:
        blocked_mask = hole.copy()
        for number in range(1, count):
            reach = factor * float(stats[number, cv2.CC_STAT_AREA]) ** 0.5
            is_free = (names != number).view(np.uint8)
            blocked_mask |= cv2.distanceTransform(is_free, cv2.DIST_L2, 5) <= reach
        blocked_mask &= hole | ~border
        if blocked_mask.sum() <= max_area:
            return np.asarray(blocked_mask)
        factor /= 2
    return hole


def _block_barriers(piece: Mask, blocked_mask: Mask, barriers: Mask) -> Mask:
    """Return `blocked_mask` (H, W) with `barriers`, if enough sources remain.

    Pixels beside the `piece` stay boundary values.
    """
    result = blocked_mask | (barriers & ~dilate(piece, TUNING.seam_band))
    if (~result).sum() < TUNING.sources * piece.sum():
        return blocked_mask
    return result


@dataclass(frozen=True)
class _Window:
    """A piece of the hole and its surroundings, (H, W) and (H, W, 3)."""

    picture: F32
    guide: F32
    hole: Mask
    blocked_mask: Mask

    def fill(self) -> tuple[F32, F32]:
        """Return copies and guide in the hole (H, W, 3), before and after joining."""
        scale = self._scale()
        reduced_photo = self._reduce(scale)
        offsets, rarity = copy_offsets(
            reduced_photo.picture,
            reduced_photo.hole,
            reduced_photo.blocked_mask,
            COSTS.distance,
        )
        if not len(offsets):
            return self.guide, self.guide
        reduced_photo = replace(reduced_photo, rarity=rarity)
        labels = OffsetLabels(reduced_photo, offsets).solve()
        labels = replace_odd_pieces(labels, offsets, reduced_photo)
        shifts = self._shifts(labels, offsets, scale)
        rows, columns = np.nonzero(self.hole)
        down, right = shifts[rows, columns].T
        copies = self.picture.copy()
        copies[rows, columns] = self.sources[rows + down, columns + right]
        return copies, join_gradients(self.sources, shifts, self.hole)

    def strengthen(self, filled: F32) -> F32:
        """Return `filled` with the fine detail that joining removed."""
        contrast_gap = self._contrast_gap(filled)
        gain = float(np.clip(np.exp(-contrast_gap / 2), 1, TUNING.most_gain))
        hole = self.hole[self.near][..., None]
        composite = np.where(hole, filled[self.near], self.picture[self.near])
        detail = composite - cv2.GaussianBlur(composite, (0, 0), TUNING.detail)
        stronger = np.clip(composite + (gain - 1) * detail, 0, 255)
        result = filled.copy()
        result[self.near] = np.where(hole, stronger, filled[self.near])
        return result

    def contrast_error(self, filled: F32 | None = None) -> float:
        """Return the difference of contrast in the hole and around it, as a log of
        squares.

        `filled` (H, W, 3) is the fill, or the guide if it is None.
        """
        return abs(self._contrast_gap(self.guide if filled is None else filled))

    def _contrast_gap(self, fill: F32) -> float:
        """Return the log ratio of squared fine detail in the hole and around it."""
        hole = self.hole[self.near]
        composite = np.where(hole[..., None], fill[self.near], self.picture[self.near])
        inside = self._detail(composite, ~self.blocked_mask[self.near] | hole)[hole]
        surrounding_detail = self._detail_around
        if not len(surrounding_detail):
            return 0.0
        means = [
            np.log(part + TUNING.noise).mean() for part in (inside, surrounding_detail)
        ]
        return float(means[0] - means[1])

    def seam_growth(self, filled: F32) -> float:
        """Return the log ratio of the steps across the border with `filled` and the
        guide.

        A line of the photo that ends at the border is a step; so is a displaced line.
        """
        return float(np.log(self._border_step(filled) / self._border_step(self.guide)))

    def _border_step(self, fill: F32) -> float:
        """Return the mean difference between bands on both sides of the hole's border,
        levels.
        """
        hole, blocked_mask = self.hole[self.near], self.blocked_mask[self.near]
        inside = _band_means(fill[self.near], hole & ~_erode_mask(hole, TUNING.border))
        known_band = dilate(hole, TUNING.border) & ~blocked_mask
        outside = _band_means(self.picture[self.near], known_band)
        line = dilate(hole, 1) & ~blocked_mask
        if not line.any():
            return TUNING.least_step
        step = channel_mean(np.abs(inside - outside))[line]
        return float(np.minimum(step, TUNING.most_step).mean()) + TUNING.least_step

    def least_gain(self) -> float:
        """Return the gain, as such a logarithm, that copies must reach.

        On an even ground, apart from edges, the guide is correct except for its own
        artefacts.
        """
        surrounding_detail = self._detail_around
        plain_ground = (
            not len(surrounding_detail)
            or np.median(surrounding_detail) < TUNING.even_detail
        )
        return TUNING.even_gain if plain_ground else -TUNING.favour

    @cached_property
    def _detail_around(self) -> F32:
        """Return the squared fine detail (n,) of the pixels around the hole."""
        hole, blocked_mask = self.hole[self.near], self.blocked_mask[self.near]
        ring = dilate(hole, TUNING.ring) & ~dilate(blocked_mask, 1)
        squares = self._detail(self.picture[self.near], ~blocked_mask)
        return np.asarray(cv2.GaussianBlur(squares, (0, 0), TUNING.grain)[ring])

    @cached_property
    def near(self) -> tuple[slice, slice]:
        """Return rows and columns of the hole and of the pixels compared with it."""
        left, top, width, height = cv2.boundingRect(self.hole.view(np.uint8))
        margin = TUNING.ring + round(4 * (TUNING.grain + TUNING.detail))
        rows = slice(max(0, top - margin), top + height + margin)
        return rows, slice(max(0, left - margin), left + width + margin)

    @cached_property
    def sources(self) -> F32:
        """Return the photo (H, W, 3) with the guide in the hole, where no shift
        points.
        """
        return np.where(self.hole[..., None], self.guide, self.picture)

    def _scale(self) -> int:
        """Return the number of px of the photo per px of the reduced picture."""
        by_area = (self.hole.sum() / TUNING.hole_pixels) ** 0.5
        by_side = max(self.hole.shape) / TUNING.reduced_side
        return max(1, int(np.ceil(max(by_area, by_side))))

    def _reduce(self, scale: int) -> ReducedPhoto:
        """Return the reduced photo for the labelling."""
        blocked_mask = _block_means(self.blocked_mask.astype(np.float32), scale) > 0
        hole = _block_means(self.hole.astype(np.float32), scale) > 0
        guided_picture = np.where(
            self.blocked_mask[..., None], self.guide, self.picture
        )
        guide = _block_means(guided_picture, scale)
        detail = self._detail(self.picture, ~self.blocked_mask)
        # A block with both known pixels and pixels of the guide counts as the guide.
        guide_detail = self._detail(guided_picture, np.ones_like(self.blocked_mask))
        energy, guide_energy = (
            np.log(_block_means(part, scale) + TUNING.noise)
            for part in (detail, guide_detail)
        )
        energy = np.where(blocked_mask, guide_energy, energy)
        rarity = np.zeros(hole.shape, np.float32)
        texture = _texture(guided_picture, scale)
        return ReducedPhoto(guide, guide, hole, blocked_mask, energy, rarity, texture)

    @staticmethod
    def _detail(picture: F32, known: Mask) -> F32:
        """Return the squared fine detail (H, W) of the grey levels."""
        grey, weight = channel_mean(picture), known.astype(np.float32)
        share = np.maximum(cv2.GaussianBlur(weight, (0, 0), TUNING.detail), 1e-3)
        blurred_grey = cv2.GaussianBlur(grey * weight, (0, 0), TUNING.detail) / share
        return np.asarray(((grey - blurred_grey) * weight) ** 2, np.float32)

    def _shifts(self, labels: I64, offsets: Offsets, scale: int) -> I64:
        """Return rows and columns (H, W, 2) to the source of each pixel, refined piece
        by piece.

        `labels` (h, w) belong to the reduced picture.
        """
        shifts = np.zeros((*self.hole.shape, 2), np.int64)
        composition = _Composition(self.picture.copy(), ~self.blocked_mask)
        # Large pieces are placed first; smaller ones adapt to them.
        for number, piece in _pieces_by_size(labels, scale, self.hole):
            offset = None
            if number < len(offsets):
                offset = self._refine_offset(piece, offsets[number], scale, composition)
            if offset is None:
                offset = np.zeros(2, np.int64)
            shifts[piece.box][piece.mask] = offset
            source_pixels = self.sources[piece.move(offset)][piece.mask]
            composition.picture[piece.box][piece.mask] = source_pixels
            composition.complete_mask[piece.box] |= piece.mask
        return shifts

    def _refine_offset(
        self, piece: _Piece, offset: I64, scale: int, composed: _Composition
    ) -> I64 | None:
        """Return the full-size offset of a piece that suits its neighbours, or None."""
        # Search coarsely first, then around the best offset.
        spacing = -(-(2 * scale - 1) // TUNING.tries)
        steps = np.arange(1 - scale, scale, spacing)
        best = self._legal_offset(piece, offset * scale, steps, composed)
        if best is None or spacing == 1:
            return best
        closer = np.arange(1 - spacing, spacing)
        return self._legal_offset(piece, best, closer, composed)

    def _legal_offset(
        self, piece: _Piece, offset: I64, steps: I64, composed: _Composition
    ) -> I64 | None:
        """Return the best valid offset among `steps`, or None.

        A valid offset copies known pixels only.
        """
        down, right = np.meshgrid(steps, steps, indexing="ij")
        tries = offset + np.stack([down.ravel(), right.ravel()], axis=1)
        costs = self._gaps(composed.picture, composed.find_neighbours(piece), tries)
        inside = thin_out(piece.pixels(), TUNING.guide_pixels)
        costs = costs + TUNING.guide_weight * self._gaps(self.guide, inside, tries)
        last = np.array(self.hole.shape) - 1
        for k in np.argsort(costs, kind="stable").tolist():
            rows, columns = piece.move(tries[k])
            if min(rows.start, columns.start) < 0:
                continue
            if rows.stop > last[0] + 1 or columns.stop > last[1] + 1:
                continue
            if not (self.blocked_mask[rows, columns] & piece.mask).any():
                return np.asarray(tries[k], np.int64)
        return None

    def _gaps(self, picture: F32, pixels: I64, tries: I64) -> F32:
        """Return mean squared differences (n,) of `picture` and the sources of `pixels`
        (k, 2) at the offsets `tries` (n, 2).
        """
        last = np.array(self.hole.shape) - 1
        sources = np.clip(pixels + tries[:, None], 0, last)
        gaps = self.picture[sources[..., 0], sources[..., 1]]
        gaps -= picture[pixels[:, 0], pixels[:, 1]]
        sums = np.einsum("nkc,nkc->n", gaps, gaps)
        return np.asarray(sums / max(len(pixels), 1), np.float32)


@dataclass(frozen=True)
class _Piece:
    """Connected pixels of the hole with one label."""

    box: tuple[slice, slice]
    mask: Mask
    """(h, w) in the box."""

    def pixels(self) -> I64:
        """Return the rows and columns (n, 2) of the piece in the window."""
        corner = [part.start for part in self.box]
        return np.asarray(np.argwhere(self.mask) + corner, np.int64)

    def move(self, offset: I64) -> tuple[slice, slice]:
        """Return rows and columns of the box at an offset."""
        rows, columns = self.box
        down, right = int(offset[0]), int(offset[1])
        return (
            slice(rows.start + down, rows.stop + down),
            slice(columns.start + right, columns.stop + right),
        )


@dataclass(frozen=True)
class _Composition:
    """The copies so far."""

    picture: F32
    complete_mask: Mask
    """(H, W): known or copied pixels."""

    def find_neighbours(self, piece: _Piece) -> I64:
        """Return composed pixels (n, 2) beside a piece, evenly thinned out."""
        band = TUNING.seam_band
        top, left = (part.start for part in piece.box)
        piece_mask = np.pad(piece.mask, band)
        rows = slice(max(top - band, 0), piece.box[0].stop + band)
        columns = slice(max(left - band, 0), piece.box[1].stop + band)
        done_window = self.complete_mask[rows, columns]
        piece_mask = piece_mask[
            rows.start - top + band :, columns.start - left + band :
        ]
        piece_mask = piece_mask[: done_window.shape[0], : done_window.shape[1]]
        ring = np.argwhere(dilate(piece_mask, band) & ~piece_mask & done_window)
        ring += [rows.start, columns.start]
        return np.asarray(thin_out(ring, TUNING.band_pixels), np.int64)


def _pieces_by_size(
    labels: I64, scale: int, hole: Mask
) -> Iterator[tuple[int, _Piece]]:
    """Yield labels and connected pieces of the reduced `labels` (h, w), largest first.

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
    for _, number, k, names, box in sorted(pieces, key=lambda one: one[:3]):
        piece = _enlarge_piece(names, k, box[:4], scale, hole)
        if piece.mask.any():
            yield number, piece


def _enlarge_piece(
    names: NDArray[np.int32], name: int, box: Sequence[int], scale: int, hole: Mask
) -> _Piece:
    """Return the piece `name` of reduced `names` (h, w) at full size in the `hole`
    (H, W).

    `box` is its left, top, width and height in `names`.
    """
    left, top, width, height = box
    small = names[top : top + height, left : left + width] == name
    large = small.repeat(scale, axis=0).repeat(scale, axis=1)
    rows = slice(top * scale, min((top + height) * scale, hole.shape[0]))
    columns = slice(left * scale, min((left + width) * scale, hole.shape[1]))
    inside = hole[rows, columns]
    mask = large[: inside.shape[0], : inside.shape[1]] & inside
    return _Piece((rows, columns), mask)


def _band_means(picture: F32, band: Mask) -> F32:
    """Return local means (H, W, 3) of `picture` (H, W, 3) over the pixels of `band` (H,
    W).
    """
    weight = band.astype(np.float32)
    share = cv2.GaussianBlur(weight, (0, 0), TUNING.border_blur)[..., None]
    sums = cv2.GaussianBlur(picture * weight[..., None], (0, 0), TUNING.border_blur)
    return np.asarray(sums / np.maximum(share, 1e-3), np.float32)


def _erode_mask(mask: Mask, radius: int) -> Mask:
    """Return the pixels (H, W) of `mask` farther than `radius` px from its border."""
    return ~dilate(~mask, radius)


def _texture(picture: F32, scale: int) -> F32:
    """Return logarithms (h, w, 4) of mean squared differences in four directions.

    They are means of blocks of `scale` px a side of a `picture` (H, W, 3).
    """
    grey = channel_mean(picture)
    log_squares = []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        difference = grey - np.roll(grey, step, (0, 1))
        log_squares.append(np.log(_block_means(difference**2, scale) + TUNING.noise))
    return np.stack(log_squares, axis=-1)


def _block_means(picture: F32, scale: int) -> F32:
    """Return means of blocks of `scale` px a side; the last ones are extended."""
    height, width = picture.shape[:2]
    padded_picture = cv2.copyMakeBorder(
        picture, 0, -height % scale, 0, -width % scale, cv2.BORDER_REPLICATE
    )
    size = padded_picture.shape[1] // scale, padded_picture.shape[0] // scale
    return np.asarray(cv2.resize(padded_picture, size, interpolation=cv2.INTER_AREA))
