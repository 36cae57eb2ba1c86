"""Backend inpaint=fill: exemplar-based fill with matched colour and grain.

Copied patches continue lines and grain. Their difference from the photo around the hole
is interpolated across the hole, so that no seam shows. If the surroundings are smooth,
a harmonic fill gives the colours and the patches give only the grain. Pixels next to an
object are mixed with its blurred edge and its contact shadow: they are excluded as
sources, and the fill meets them within a few pixels. On a large photo, colours and
patches are chosen at reduced size, and finer detail is copied at full size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.band_grain import match_grain
from physgen.perceive.inpaint.certain_lines import CertainLine, certain_lines
from physgen.perceive.inpaint.copy_offsets import I64
from physgen.perceive.inpaint.edge_continuation import continue_arcs
from physgen.perceive.inpaint.line_strips import paint_lines
from physgen.perceive.inpaint.patch_match import patch_match_fill
from physgen.perceive.inpaint.poisson import (
    blend_at_border,
    close_gaps,
    dilate,
    harmonic_fill,
    hole_pieces,
)
from physgen.perceive.inpaint.shift_map import shift_map_fill
from physgen.perceive.inpaint.soft_ground import (
    find_soft_pieces,
    interpolate_shading,
)
from physgen.perceive.roles import Inpaint, Mask, Rgb
from physgen.perceive.working_size import working_size


@dataclass(frozen=True)
class _Limits:
    """Limits of the pixels beside the hole, of smooth surroundings and of level
    lines.
    """

    # px beside the hole whose colours are mixed with the object's edge.
    mixed_width: int = 2
    # px beyond them, filled as well to measure the difference from the photo.
    band: int = 3
    # Largest difference in levels; a larger one is not a difference of light.
    limit: float = 24.0
    # px around a piece of the hole for the test of smoothness.
    surroundings: int = 12
    # Levels: largest RMS distance of smooth surroundings from a quadratic surface.
    smoothness: float = 3.0
    # px: standard deviation of the blur between grain and colour.
    grain: float = 10.0
    # Compared px along and beside a level line (a shelf's edge) at both ends of the
    # hole.
    line: tuple[int, int] = (4, 4)
    # Least contrast of a level line, in levels.
    contrast: float = 25.0
    # Least contrast in multiples of the median detail, because leaves contain no lines.
    over_texture: float = 12.0
    # Largest difference between the two ends of a line, as a share of its contrast.
    differ: float = 0.3
    # Largest change along one end of a line, as a share of its contrast.
    unevenness: float = 0.5
    # px: length of a line's continuation outside the hole.
    farther: int = 12
    # px: half the width of a drawn line.
    line_width: int = 2
    # Levels: larger detail beside an arc is an edge of the fill rather than grain.
    arc_grain: float = 8.0
    # px: standard deviation of the blur for the separation of grain.
    detail: float = 2.0
    # Largest number of pixels for each pixel of a source cell, and largest detail of a
    # cell of more pixels over the median.
    repeats: int = 3
    usual_detail: float = 4.0


LIMITS = _Limits()
GREY = np.float32(128)
"""Level of a texture without detail."""
SAMPLED_COLUMNS = 1024
"""Row length of sampled pixels: OpenCV allows at most 32,767 columns."""


def fill(*, copies: bool = True) -> Inpaint:
    """Return the backend `fill`; without `copies` it averages patches everywhere."""
    return partial(_fill, copies=copies)


@dataclass(frozen=True, eq=False)
class _Guide:
    """A fill without copies of whole pieces."""

    picture: F32
    """(H, W, 3)."""
    inner_hole: Mask
    """(H, W): the hole without gaps, and the mixed pixels beside it."""
    smooth_hole: Mask
    """(H, W): pieces with smooth surroundings."""
    arc_mask: Mask
    """(H, W): continued circles and ellipses."""
    places: I64 | None
    """(H, W, 2): row and column of the source of each pixel."""
    lines: tuple[CertainLine, ...]
    """Straight lines through the hole."""


def _fill(rgb: Rgb, hole: Mask, *, copies: bool, barriers: Mask | None = None) -> Rgb:
    """Return the photo (H, W, 3) with a filled hole (H, W).

    Objects in `barriers` (H, W) are not copied.
    """
    if not hole.any() or hole.all():
        return rgb.copy()
    photo = rgb.astype(np.float32)
    soft_mask, shading = _soft_ground(photo, hole)
    if shading is None:
        picture = _fill_picture(photo, hole, barriers, copies=copies)
    else:
        # On softly shaded ground only the texture is filled.
        texture = photo - shading + GREY
        picture = _fill_picture(texture, hole, barriers, copies=copies) - GREY + shading
        if (hole & ~soft_mask).any():
            other_picture = _fill_picture(photo, hole, barriers, copies=copies)
            picture = np.where(soft_mask[..., None], picture, other_picture)
    if copies:
        picture = match_grain(picture, photo, hole)
    left, top, width, height = cv2.boundingRect(hole.view(np.uint8))
    box = np.s_[
        max(0, top - LIMITS.surroundings) : top + height + LIMITS.surroundings,
        max(0, left - LIMITS.surroundings) : left + width + LIMITS.surroundings,
    ]
    result = rgb.copy()
    result[box] = blend_at_border(picture[box], rgb[box], hole[box])
    return result


def _soft_ground(photo: F32, hole: Mask) -> tuple[Mask, F32 | None]:
    """Return the softly shaded pieces of `hole` (H, W) with the pixels beside them, and
    the shading (H, W, 3) or None.
    """
    size = working_size(hole.shape)
    picture = photo
    small_hole = hole
    if size is not None:
        picture = np.asarray(
            cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.float32
        )
        share = cv2.resize(hole.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        small_hole = np.asarray(share > 0)
    small_hole = dilate(close_gaps(small_hole), LIMITS.mixed_width + LIMITS.band)
    soft_mask = find_soft_pieces(picture, small_hole)
    if not soft_mask.any():
        return np.zeros_like(hole), None
    shading = interpolate_shading(picture, small_hole)
    if size is not None:
        full_size = hole.shape[1], hole.shape[0]
        shading = np.asarray(cv2.resize(shading, full_size), np.float32)
        soft_mask = np.asarray(
            cv2.resize(
                soft_mask.view(np.uint8), full_size, interpolation=cv2.INTER_NEAREST
            )
            > 0
        )
    return soft_mask, shading


def _fill_picture(
    photo: F32, hole: Mask, barriers: Mask | None, *, copies: bool
) -> F32:
    """Return a picture (H, W, 3) with a filled hole (H, W); pixels beside the hole may
    change.
    """
    size = working_size(hole.shape)
    if size is None:
        guide = _make_guide(photo, hole)
    else:
        guide = _make_large_guide(photo, hole, size)
    picture = guide.picture
    textured_hole = guide.inner_hole & ~guide.smooth_hole & ~guide.arc_mask
    if copies and textured_hole.any():
        level = _pieces_without(guide.arc_mask, guide.inner_hole)
        copied_picture = shift_map_fill(picture, textured_hole, picture, barriers)
        picture = _carry_level_lines(copied_picture, photo, level)
    if guide.lines:
        if size is None:
            scale = 1.0
        else:
            scale = max(hole.shape) / max(size)
        picture = paint_lines(picture, photo, guide.inner_hole, guide.lines, scale)
    return picture


def _make_guide(photo: F32, hole: Mask) -> _Guide:
    """Return the guide for the `hole` (H, W) of a photo (H, W, 3)."""
    closed_hole = close_gaps(hole)
    inner_hole = dilate(closed_hole, LIMITS.mixed_width)
    outer_hole = dilate(closed_hole, LIMITS.mixed_width + LIMITS.band)
    # Hardly any pixels remain as sources: use the hole itself.
    if outer_hole.all():
        inner_hole = outer_hole = hole
    patches = patch_match_fill(photo, outer_hole)
    patch_picture, smooth_hole = _smooth_pieces(photo, patches.picture, outer_hole)
    # Spread the difference at the border over the hole, so that no seam shows.
    gap = np.where(
        inner_hole[:, :, None],
        np.float32(0),
        np.clip(photo - patch_picture, -LIMITS.limit, LIMITS.limit),
    )
    filled_picture = np.where(
        inner_hole[:, :, None],
        patch_picture + harmonic_fill(gap, inner_hole, 0.4),
        photo,
    )
    guide, arc_mask = _carry_arcs(filled_picture, photo, inner_hole)
    guide = _carry_level_lines(guide, photo, _pieces_without(arc_mask, inner_hole))
    lines = tuple(certain_lines(photo, outer_hole))
    return _Guide(guide, inner_hole, smooth_hole, arc_mask, patches.places, lines)


def _make_large_guide(photo: F32, hole: Mask, size: tuple[int, int]) -> _Guide:
    """Return the guide of a large photo, computed at a reduced `size` (width, height).

    The fine detail lost by the reduction is copied from the source of each pixel.
    """
    height, width = hole.shape
    small: F32 = np.asarray(
        cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.float32
    )
    share = cv2.resize(hole.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    guide = _make_guide(small, np.asarray(share > 0))
    inner_hole = dilate(close_gaps(hole), LIMITS.mixed_width)
    if inner_hole.all():
        inner_hole = hole

    def enlarge_mask(mask: Mask) -> NDArray[np.uint8]:
        values = mask.view(np.uint8)
        large = cv2.resize(values, (width, height), interpolation=cv2.INTER_NEAREST)
        return np.asarray(large, np.uint8)

    smooth_pieces = enlarge_mask(guide.smooth_hole)
    arcs = enlarge_mask(guide.arc_mask)
    pixels = np.stack(np.nonzero(inner_hole))
    steps = np.array([[height / size[1]], [width / size[0]]])
    values = _sample(guide.picture, pixels, steps)
    if guide.places is not None:
        detail = _copy_detail((photo, small), inner_hole, guide.places, pixels, steps)
        detail[arcs[inner_hole] > 0] = 0
        values += detail
    picture = photo.copy()
    picture[inner_hole] = np.clip(values, 0, 255)
    return _Guide(
        picture,
        inner_hole,
        (smooth_pieces > 0) & inner_hole,
        (arcs > 0) & inner_hole,
        None,
        tuple(line.scale_steps(steps[::-1, 0]) for line in guide.lines),
    )


def _sample(picture: F32, pixels: I64, steps: NDArray[np.float64]) -> F32:
    """Return values (n, 3) of a reduced `picture` at pixels (2, n) of the large one.

    `steps` (2, 1) is the number of large pixels per reduced pixel.
    """
    count = pixels.shape[1]
    lines = -(-count // SAMPLED_COLUMNS)
    place = ((pixels + 0.5) / steps - 0.5).astype(np.float32)
    # Fold the samples into a rectangle, since OpenCV limits the row length.
    place = np.pad(place, ((0, 0), (0, lines * SAMPLED_COLUMNS - count)))
    rows, columns = place.reshape(2, lines, SAMPLED_COLUMNS)
    values = cv2.remap(
        picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(values.reshape(-1, 3)[:count], np.float32)


def _copy_detail(
    pictures: tuple[F32, F32],
    hole_mask: Mask,
    places: I64,
    pixels: I64,
    steps: NDArray[np.float64],
) -> F32:
    """Return the detail (n, 3) lost in the reduced photo.

    `pictures` are the photo and the reduced photo. `places` (h, w, 2) is the source of
    each reduced pixel. Detail is taken at the sources of `pixels` (2, n) and is 0 if a
    source is unknown.
    """
    photo, small = pictures
    last = np.array(small.shape[:2])[:, None] - 1
    cells = np.minimum((pixels / steps).astype(np.int64), last)
    shift = (places[cells[0], cells[1]].T - cells) * steps
    place = np.rint(pixels + shift).astype(np.int64)
    sources = np.clip(place, 0, np.array(hole_mask.shape)[:, None] - 1)
    is_valid = (place == sources).all(axis=0) & ~hole_mask[sources[0], sources[1]]
    detail = photo[sources[0], sources[1]] - _sample(small, sources, steps)
    detail[~is_valid] = 0
    source_cells = np.minimum((sources / steps).astype(np.int64), last)
    _limit_repeated_detail(
        detail,
        source_cells[0] * small.shape[1] + source_cells[1],
        LIMITS.repeats * float(steps.prod()),
    )
    return np.asarray(detail, np.float32)


def _limit_repeated_detail(detail: F32, sources: I64, repeats: float) -> None:
    """Limit detail (n, 3) of `sources` (n,) of more than `repeats` pixels, in place.

    A bright speck that is the source of many pixels would be a grid of dots.
    """
    is_set = detail.any(axis=1)
    if not is_set.any():
        return
    counts = np.bincount(sources)[sources]
    shared_pixels = counts > repeats
    # The specks themselves hardly change a median.
    limit = LIMITS.usual_detail * float(np.median(np.abs(detail[is_set])))
    detail[shared_pixels] = np.clip(detail[shared_pixels], -limit, limit)


def _carry_arcs(picture: F32, photo: F32, hole: Mask) -> tuple[F32, Mask]:
    """Return `picture` with circles and ellipses continued through the hole, and their
    mask.

    Continued strips keep the fine detail of the fill.
    """
    arcs, arc_mask = continue_arcs(photo, hole)
    if not arc_mask.any():
        return picture, arc_mask
    detail = picture - cv2.GaussianBlur(picture, (0, 0), LIMITS.detail)
    detail = np.clip(detail, -LIMITS.arc_grain, LIMITS.arc_grain)
    return np.where(arc_mask[..., None], arcs + detail, picture), arc_mask


def _pieces_without(arc_mask: Mask, hole: Mask) -> Mask:
    """Return the connected pieces of `hole` (H, W) without a `arc_mask` pixel."""
    count, names = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    is_free = np.bincount(names[arc_mask], minlength=count) == 0
    is_free[0] = False
    return np.asarray(is_free[names])


def _carry_level_lines(picture: F32, photo: F32, hole: Mask) -> F32:
    """Return `picture` with the level lines at both sides of the hole continued."""
    if not hole.any():
        return picture
    # The box contains the compared pixels and the reach of the blur.
    margin = LIMITS.surroundings + round(4 * LIMITS.detail) + 1
    left, top, width, height = cv2.boundingRect(hole.view(np.uint8))
    part = np.s_[
        max(0, top - margin) : top + height + margin,
        max(0, left - margin) : left + width + margin,
    ]
    result = picture.copy()
    result[part] = _draw_level_lines(picture[part], photo[part], hole[part])
    return result


@dataclass(frozen=True, eq=False)
class _RowGap:
    """A gap of the hole in a row, and the visible ends of a level line beside it."""

    # Columns of the first pixel inside and after the gap.
    left: int
    right: int
    # (2, rows, n, 3): the pixels to the left and to the right.
    ends: F32

    @cached_property
    def left_end(self) -> F32:
        """Return the mean colour (rows, 3) to the left."""
        return np.asarray(self.ends[0].mean(axis=1))

    @cached_property
    def right_end(self) -> F32:
        """Return the mean colour (rows, 3) to the right."""
        return np.asarray(self.ends[1].mean(axis=1))

    @cached_property
    def valid_rows(self) -> Mask:
        """Return (rows,) whether both ends are visible."""
        return np.asarray(~np.isnan(self.left_end + self.right_end).any(axis=1))

    @cached_property
    def difference(self) -> float:
        """Return the difference of both ends, levels."""
        differences = np.abs(self.left_end - self.right_end)
        return float(differences[self.valid_rows].mean())


def _draw_level_lines(picture: F32, photo: F32, hole: Mask) -> F32:
    """Return `picture` with continued level lines, on the box of a hole."""
    (end_length, half_height), half_width = LIMITS.line, LIMITS.line_width
    result = picture.copy()
    best = np.full(hole.shape, np.inf, np.float32)
    least_contrast = max(LIMITS.contrast, LIMITS.over_texture * _texture(photo, hole))
    known_photo = np.where(hole[..., None], np.float32(np.nan), photo)
    for y in range(half_height, len(hole) - half_height):
        rows = known_photo[y - half_height : y + half_height + 1]
        for gap in _find_row_gaps(rows, hole[y], end_length):
            if not _has_level_line(gap, known_photo[y], half_height, least_contrast):
                continue
            part = np.s_[y - half_width : y + half_width + 1, gap.left : gap.right]
            _draw_level_line(result[part], best[part], hole[part], gap)
    return result


def _draw_level_line(
    picture: F32, penalties: F32, hole_part: Mask, gap: _RowGap
) -> None:
    """Draw the level line across a gap into views of a picture (n, w, 3) and of the
    penalties (n, w) of its lines.
    """
    (_, half_height), half_width = LIMITS.line, LIMITS.line_width
    middle = slice(half_height - half_width, half_height + half_width + 1)
    row_distances = 3 * np.abs(np.arange(-half_width, half_width + 1))
    # If lines compete for a pixel, the one with the better match and the closer middle
    # wins.
    row_penalties = np.where(
        gap.valid_rows[middle], gap.difference + row_distances, np.inf
    )
    penalty = row_penalties[:, None]
    closer = hole_part & (penalty < penalties)
    share = np.linspace(0, 1, gap.right - gap.left)[None, :, None]
    left_end = gap.left_end[middle][:, None]
    right_end = gap.right_end[middle][:, None]
    line = (1 - share) * left_end + share * right_end
    picture[...] = np.where(closer[..., None], line, picture)
    penalties[...] = np.where(closer, penalty, penalties)


def _find_row_gaps(rows: F32, hole_row: Mask, end_length: int) -> Iterator[_RowGap]:
    """Yield the gaps of the hole in a row with pixels on both sides.

    `rows` (n, W, 3) is nan at unknown pixels.
    """
    width = len(hole_row)
    borders = np.flatnonzero(np.diff(hole_row, prepend=False, append=False)).tolist()
    for left, right in zip(borders[::2], borders[1::2], strict=True):
        # The hole must have known pixels on both sides.
        if left < end_length or right > width - end_length:
            continue
        left_pixels = rows[:, left - end_length : left]
        right_pixels = rows[:, right : right + end_length]
        yield _RowGap(left, right, np.stack([left_pixels, right_pixels]))


def _has_level_line(gap: _RowGap, row: F32, middle: int, least_contrast: float) -> bool:
    """Return whether a level line runs through a gap of a row (W, 3).

    A line has contrast, matches at both ends, is even along itself and continues.
    `middle` is the index of the row among those of the gap.
    """
    valid_rows = gap.valid_rows
    # Enough rows must be known at both ends.
    if not valid_rows[middle] or valid_rows.sum() <= middle:
        return False
    left_end = gap.left_end
    contrast = np.abs(left_end - left_end[middle])[valid_rows].max()
    if contrast < least_contrast or gap.difference > LIMITS.differ * contrast:
        return False
    ends = gap.ends
    unevenness = np.abs(ends - ends.mean(axis=2, keepdims=True))[:, valid_rows].max()
    if unevenness > LIMITS.unevenness * contrast:
        return False
    return _goes_on(row, (gap.left, gap.right), ends[:, middle], contrast)


def _goes_on(row: F32, hole: tuple[int, int], ends: F32, contrast: float) -> bool:
    """Return whether a line continues on both sides of a hole from left to right, px.

    `row` (W, 3) is nan at unknown pixels; `ends` (2, n, 3) are the visible ends of the
    line. The test separates lines from the shorter grains of a carpet.
    """
    left, right = hole
    reach = LIMITS.farther
    sides = row[max(left - reach, 0) : left], row[right : right + reach]
    for side, end in zip(sides, ends, strict=True):
        known_colours = side[~np.isnan(side).any(axis=1)]
        step = np.abs(known_colours - end.mean(axis=0)).max(initial=0.0)
        if step > LIMITS.unevenness * contrast:
            return False
    return True


def _texture(photo: F32, hole: Mask) -> float:
    """Return the median fine detail of the pixels around `hole` (H, W), in levels."""
    ring = dilate(hole, LIMITS.surroundings) & ~hole
    if not ring.any():
        return 0.0
    grey = photo.mean(axis=2)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), LIMITS.detail)
    return float(np.median(np.abs(detail[ring])))


def _smooth_pieces(photo: F32, texture: F32, hole: Mask) -> tuple[F32, Mask]:
    """Return `texture` with harmonic fills in pieces with smooth surroundings, and
    these pieces.

    A harmonic fill gets the grain of one place.
    """
    smooth_pieces = np.zeros_like(hole)
    detail = texture - cv2.GaussianBlur(texture, (0, 0), LIMITS.grain)
    grain = detail.copy()
    for part, piece in hole_pieces(hole):
        window = tuple(
            slice(max(0, s.start - LIMITS.surroundings), s.stop + LIMITS.surroundings)
            for s in part
        )
        inner = np.zeros_like(hole[window])
        inner_box = tuple(
            slice(s.start - w.start, s.stop - w.start)
            for s, w in zip(part, window, strict=True)
        )
        inner[inner_box][piece] = True
        roughness = _roughness(
            photo[window], dilate(inner, LIMITS.surroundings) & ~dilate(hole[window], 1)
        )
        if roughness < LIMITS.smoothness:
            smooth_pieces[window] |= inner
            like = _like_place(detail, hole, part, piece, roughness)
            grain[part][piece] = np.clip(
                detail[like][piece], -2 * roughness, 2 * roughness
            )
    if not smooth_pieces.any():
        return texture, smooth_pieces
    film = harmonic_fill(np.where(hole[:, :, None], texture, photo), smooth_pieces, 0.1)
    return np.where(smooth_pieces[:, :, None], film + grain, texture), smooth_pieces


def _like_place(
    grain: F32, hole: Mask, part: tuple[slice, slice], piece: Mask, roughness: float
) -> tuple[slice, slice]:
    """Return rows and columns of the nearest place with grain for a whole `piece` (h,
    w).

    The grain must not be rougher than `roughness` levels. Returns `part` itself if no place
    qualifies. A single source matters: means of many places keep only the finest grain.
    """
    top, left = (s.start for s in part)
    (h, w), (height, width) = piece.shape, hole.shape
    corners = []
    for y in range(top % (h // 2), height - h + 1, h // 2):
        for x in range(left % (w // 2), width - w + 1, w // 2):
            corners.append((y, x))
    for y, x in sorted(
        corners, key=lambda at: (at[0] - top) ** 2 + (at[1] - left) ** 2
    ):
        place = slice(y, y + h), slice(x, x + w)
        if (
            not hole[place][piece].any()
            and (grain[place][piece] ** 2).mean() < (1.2 * roughness) ** 2
        ):
            return place
    return part


def _roughness(photo: F32, surroundings: Mask) -> float:
    """Return the RMS distance of the pixels `surroundings` from a quadratic surface, in
    levels.
    """
    y, x = np.nonzero(surroundings)
    if len(y) < 24:
        return float(np.inf)
    u = (y - y.mean()) / 64
    v = (x - x.mean()) / 64
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
    colours = photo[y, x].astype(np.float64)
    residuals = colours - terms @ np.linalg.lstsq(terms, colours, rcond=None)[0]
    return float(np.sqrt((residuals**2).mean(0)).max())
