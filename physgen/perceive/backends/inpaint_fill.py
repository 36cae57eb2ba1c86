"""Backend inpaint=fill: exemplar-based fill with matched colour and grain.

Borrowed patches carry lines and grain on. Their difference from the photo around the hole is spread over it, so that
no seam shows. Where the surroundings are smooth, a harmonic fill is right and the patches bring the grain only.
Pixels right beside an object are mixed with its blurred edge and its contact shadow: they are not learnt from, they
stay, and the fill meets them within a few pixels. Colours and patches of a large photo are chosen at reduced size;
finer detail is copied at full size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.copy_offsets import I64
from physgen.perceive.inpaint.edge_continuation import continue_arcs
from physgen.perceive.inpaint.patch_match import patch_match_fill
from physgen.perceive.inpaint.poisson import (
    blend_at_border,
    close_gaps,
    dilate,
    harmonic_fill,
    hole_pieces,
)
from physgen.perceive.inpaint.shift_map import shift_map_fill
from physgen.perceive.roles import Inpaint, Mask, Rgb
from physgen.perceive.working_size import working_size


@dataclass(frozen=True)
class _Limits:
    """Pixels beside the hole, and smooth surroundings."""

    mixed: int = 2  # px beside the hole that are mixed with the object's edge
    band: int = 3  # px beyond them that are filled too, so that their difference from the photo is known
    limit: float = (
        24.0  # levels of that difference, at most: more is no difference of light
    )
    around: int = 12  # px around a piece of the hole in which smoothness is judged
    # levels: RMS distance from a quadratic surface up to which the surroundings are smooth
    smooth: float = 3.0
    grain: float = (
        10.0  # px: standard deviation of the blur that separates grain from colour
    )
    # level lines, as a shelf's edge: px along and beside them in which they are seen, levels by which they stand out,
    # shares of these by which their ends differ at most, and each along itself, and px beside their middle drawn
    line: tuple[int, int] = (4, 4)
    contrast: float = 25.0
    over_texture: float = 12.0  # times the median detail: leaves contain no lines
    differ: float = 0.3
    uneven: float = 0.5
    farther: int = 12  # px along it, as far as known, in which it must go on
    drawn: int = 2
    arc_grain: float = 8.0  # levels: more beside an arc is an edge of the fill
    detail: float = 2.0  # px: standard deviation of the blur below which is grain


LIMITS = _Limits()
SAMPLED_COLUMNS = 1024
"""Pixels in a row of those that are sampled: OpenCV allows no rows of over 32,767."""


def fill(*, copies: bool = True) -> Inpaint:
    """The backend `fill`; without `copies`, means of patches everywhere."""
    return partial(_fill, copies=copies)


@dataclass(frozen=True, eq=False)
class _Guide:
    """A fill without copies of whole pieces."""

    picture: F32
    """(H, W, 3)."""
    near: Mask
    """(H, W): the hole without gaps, and what is mixed with it."""
    smooth: Mask
    """(H, W): pieces with smooth surroundings."""
    drawn: Mask
    """(H, W): continued circles and ellipses."""
    places: I64 | None
    """(H, W, 2): rows and columns of the known place that each pixel is from."""


def _fill(rgb: Rgb, hole: Mask, *, copies: bool) -> Rgb:
    if not hole.any() or hole.all():
        return rgb.copy()
    photo = rgb.astype(np.float32)
    size = working_size(hole.shape)
    guide = (
        _make_guide(photo, hole)
        if size is None
        else _make_large_guide(photo, hole, size)
    )
    picture, textured = guide.picture, guide.near & ~guide.smooth & ~guide.drawn
    if copies and textured.any():
        level = _pieces_without(guide.drawn, guide.near)
        copied = shift_map_fill(picture, textured, picture)
        picture = _carry_level_lines(copied, photo, level)
    if size is None:
        return blend_at_border(picture, rgb, hole)
    left, top, width, height = cv2.boundingRect(hole.view(np.uint8))
    box = np.s_[
        max(0, top - LIMITS.around) : top + height + LIMITS.around,
        max(0, left - LIMITS.around) : left + width + LIMITS.around,
    ]
    result = rgb.copy()
    result[box] = blend_at_border(picture[box], rgb[box], hole[box])
    return result


def _make_guide(photo: F32, hole: Mask) -> _Guide:
    """Return the guide in the `hole` (H, W) of a photo (H, W, 3)."""
    whole = close_gaps(hole)
    near, far = dilate(whole, LIMITS.mixed), dilate(whole, LIMITS.mixed + LIMITS.band)
    if far.all():  # hardly anything is left to learn from
        near = far = hole
    patches = patch_match_fill(photo, far)
    borrowed, smooth = _smooth_pieces(photo, patches.picture, far)
    gap = np.where(
        near[:, :, None],
        np.float32(0),
        np.clip(photo - borrowed, -LIMITS.limit, LIMITS.limit),
    )
    filled = np.where(near[:, :, None], borrowed + harmonic_fill(gap, near, 0.4), photo)
    guide, drawn = _carry_arcs(filled, photo, near)
    guide = _carry_level_lines(guide, photo, _pieces_without(drawn, near))
    return _Guide(guide, near, smooth, drawn, patches.places)


def _make_large_guide(photo: F32, hole: Mask, size: tuple[int, int]) -> _Guide:
    """Return the guide of a photo that is chosen at a `size` (width, height).

    The fine detail that the reduced picture lacks is copied from the place that each
    pixel is from.
    """
    height, width = hole.shape
    small: F32 = np.asarray(
        cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.float32
    )
    share = cv2.resize(hole.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    guide = _make_guide(small, np.asarray(share > 0))
    near = dilate(close_gaps(hole), LIMITS.mixed)
    if near.all():
        near = hole
    smooth, drawn = (
        cv2.resize(
            part.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST
        )
        for part in (guide.smooth, guide.drawn)
    )
    pixels = np.stack(np.nonzero(near))
    steps = np.array([[height / size[1]], [width / size[0]]])
    filled = _sample(guide.picture, pixels, steps)
    if guide.places is not None:
        detail = _copy_detail((photo, small), near, guide.places, pixels, steps)
        detail[drawn[near] > 0] = 0
        filled += detail
    picture = photo.copy()
    picture[near] = np.clip(filled, 0, 255)
    return _Guide(picture, near, (smooth > 0) & near, (drawn > 0) & near, None)


def _sample(picture: F32, pixels: I64, steps: NDArray[np.float64]) -> F32:
    """(n, 3): a reduced `picture` at rows and columns (2, n) px of the large one.

    `steps` (2, 1) px of the large one are one of the reduced one.
    """
    count = pixels.shape[1]
    lines = -(-count // SAMPLED_COLUMNS)
    place = ((pixels + 0.5) / steps - 0.5).astype(np.float32)
    place = np.pad(place, ((0, 0), (0, lines * SAMPLED_COLUMNS - count)))
    rows, columns = place.reshape(2, lines, SAMPLED_COLUMNS)
    values = cv2.remap(
        picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(values.reshape(-1, 3)[:count], np.float32)


def _copy_detail(
    pictures: tuple[F32, F32],
    near: Mask,
    places: I64,
    pixels: I64,
    steps: NDArray[np.float64],
) -> F32:
    """(n, 3): the detail that the photo has and the reduced one lacks, by pixel.

    `pictures` are both; `places` (h, w, 2) the source of each pixel of the reduced
    one. Details are those at the sources of `pixels` (2, n), 0 if they are not known.
    """
    photo, small = pictures
    last = np.array(small.shape[:2])[:, None] - 1
    here = np.minimum((pixels / steps).astype(np.int64), last)
    shift = (places[here[0], here[1]].T - here) * steps
    place = np.rint(pixels + shift).astype(np.int64)
    sources = np.clip(place, 0, np.array(near.shape)[:, None] - 1)
    is_known = (place == sources).all(axis=0) & ~near[sources[0], sources[1]]
    detail = photo[sources[0], sources[1]] - _sample(small, sources, steps)
    detail[~is_known] = 0
    return np.asarray(detail, np.float32)


def _carry_arcs(filled: F32, photo: F32, hole: Mask) -> tuple[F32, Mask]:
    """`filled` (H, W, 3) with circles and ellipses continued through the `hole`, and where.

    Strips have the fine detail of the fill.
    """
    arcs, drawn = continue_arcs(photo, hole)
    if not drawn.any():
        return filled, drawn
    detail = filled - cv2.GaussianBlur(filled, (0, 0), LIMITS.detail)
    detail = np.clip(detail, -LIMITS.arc_grain, LIMITS.arc_grain)
    return np.where(drawn[..., None], arcs + detail, filled), drawn


def _pieces_without(drawn: Mask, hole: Mask) -> Mask:
    """The pieces of `hole` (H, W) without a `drawn` pixel."""
    count, names = cv2.connectedComponents(hole.astype(np.uint8), connectivity=8)
    chosen = np.bincount(names[drawn], minlength=count) == 0
    chosen[0] = False
    return np.asarray(chosen[names])


def _carry_level_lines(filled: F32, photo: F32, hole: Mask) -> F32:
    """`filled` (H, W, 3) with level lines that the photo shows at both sides of the `hole` (H, W) carried on."""
    if not hole.any():
        return filled
    # the hole, what is compared with it and the reach of a blur there
    margin = LIMITS.around + round(4 * LIMITS.detail) + 1
    left, top, width, height = cv2.boundingRect(hole.view(np.uint8))
    part = np.s_[
        max(0, top - margin) : top + height + margin,
        max(0, left - margin) : left + width + margin,
    ]
    result = filled.copy()
    result[part] = _draw_level_lines(filled[part], photo[part], hole[part])
    return result


def _draw_level_lines(filled: F32, photo: F32, hole: Mask) -> F32:
    """The same for the box of a hole."""
    (along, beside), thick = LIMITS.line, LIMITS.drawn
    found, best = filled.copy(), np.full(hole.shape, np.inf, np.float32)
    least = max(LIMITS.contrast, LIMITS.over_texture * _texture(photo, hole))
    seen = np.where(hole[..., None], np.float32(np.nan), photo)
    for y in range(beside, len(hole) - beside):
        rows, middle = (
            slice(y - beside, y + beside + 1),
            slice(beside - thick, beside + thick + 1),
        )
        borders = np.flatnonzero(np.diff(hole[y], prepend=False, append=False))
        for left, right in zip(borders[::2], borders[1::2], strict=True):
            if left < along or right > hole.shape[1] - along:
                continue
            ends = np.stack(
                [seen[rows, left - along : left], seen[rows, right : right + along]]
            )
            one, other = ends.mean(axis=2)
            both = ~np.isnan(one + other).any(axis=1)
            if not both[beside] or both.sum() <= beside:
                continue
            contrast, off = (
                np.abs(one - one[beside])[both].max(),
                float(np.abs(one - other)[both].mean()),
            )
            uneven = np.abs(ends - ends.mean(axis=2, keepdims=True))[:, both].max()
            if (
                contrast < least
                or off > LIMITS.differ * contrast
                or uneven > LIMITS.uneven * contrast
                or not _goes_on(seen[y], (left, right), ends[:, beside], contrast)
            ):
                continue
            part = np.s_[y - thick : y + thick + 1, left:right]
            away = np.where(
                both[middle], off + 3 * np.abs(np.arange(-thick, thick + 1)), np.inf
            )[:, None]
            closer = hole[part] & (away < best[part])
            share = np.linspace(0, 1, right - left)[None, :, None]
            line = (1 - share) * one[middle, None] + share * other[middle, None]
            found[part], best[part] = (
                np.where(closer[..., None], line, found[part]),
                np.where(closer, away, best[part]),
            )
    return found


def _goes_on(row: F32, hole: tuple[int, int], ends: F32, contrast: float) -> bool:
    """Return whether a line goes on at both sides of a hole from left to right, px.

    `row` (W, 3) has nan where nothing is known; `ends` (2, n, 3) are what is seen of the
    line. Grains of a carpet are shorter than a line.
    """
    left, right = hole
    reach = LIMITS.farther
    sides = row[max(left - reach, 0) : left], row[right : right + reach]
    for side, end in zip(sides, ends, strict=True):
        known = side[~np.isnan(side).any(axis=1)]
        step = np.abs(known - end.mean(axis=0)).max(initial=0.0)
        if step > LIMITS.uneven * contrast:
            return False
    return True


def _texture(photo: F32, hole: Mask) -> float:
    """Levels: fine detail of most of the pixels around `hole` (H, W)."""
    ring = dilate(hole, LIMITS.around) & ~hole
    if not ring.any():
        return 0.0
    grey = photo.mean(axis=2)
    detail = grey - cv2.GaussianBlur(grey, (0, 0), LIMITS.detail)
    return float(np.median(np.abs(detail[ring])))


def _smooth_pieces(photo: F32, borrowed: F32, hole: Mask) -> tuple[F32, Mask]:
    """`borrowed` (H, W, 3), but a harmonic fill with grain of one place in pieces with smooth surroundings.

    And (H, W) these pieces.
    """
    smooth, own = (
        np.zeros_like(hole),
        borrowed - cv2.GaussianBlur(borrowed, (0, 0), LIMITS.grain),
    )
    grain = own.copy()
    for part, piece in hole_pieces(hole):
        wide = tuple(
            slice(max(0, s.start - LIMITS.around), s.stop + LIMITS.around) for s in part
        )
        inner = np.zeros_like(hole[wide])
        here = tuple(
            slice(s.start - w.start, s.stop - w.start)
            for s, w in zip(part, wide, strict=True)
        )
        inner[here][piece] = True
        rough = _roughness(
            photo[wide], dilate(inner, LIMITS.around) & ~dilate(hole[wide], 1)
        )
        if rough < LIMITS.smooth:
            smooth[wide] |= inner
            like = _like_place(own, hole, part, piece, rough)
            grain[part][piece] = np.clip(own[like][piece], -2 * rough, 2 * rough)
    if not smooth.any():
        return borrowed, smooth
    film = harmonic_fill(np.where(hole[:, :, None], borrowed, photo), smooth, 0.1)
    return np.where(smooth[:, :, None], film + grain, borrowed), smooth


def _like_place(
    grain: F32, hole: Mask, part: tuple[slice, slice], piece: Mask, rough: float
) -> tuple[slice, slice]:
    """Rows and columns of the nearest place that shows a whole `piece` (h, w) of grain no rougher than `rough` levels;
    `part` itself where there is none. Copies of many places, averaged, lose all but the finest grain."""
    top, left = (s.start for s in part)
    (h, w), (height, width) = piece.shape, hole.shape
    corners = [
        (y, x)
        for y in range(top % (h // 2), height - h + 1, h // 2)
        for x in range(left % (w // 2), width - w + 1, w // 2)
    ]
    for y, x in sorted(
        corners, key=lambda at: (at[0] - top) ** 2 + (at[1] - left) ** 2
    ):
        there = slice(y, y + h), slice(x, x + w)
        if (
            not hole[there][piece].any()
            and (grain[there][piece] ** 2).mean() < (1.2 * rough) ** 2
        ):
            return there
    return part


def _roughness(photo: F32, around: Mask) -> float:
    """Levels: RMS distance of the pixels `around` (H, W) from a quadratic surface."""
    y, x = np.nonzero(around)
    if len(y) < 24:
        return float(np.inf)
    u, v = (y - y.mean()) / 64, (x - x.mean()) / 64
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
    colours = photo[y, x].astype(np.float64)
    off = colours - terms @ np.linalg.lstsq(terms, colours, rcond=None)[0]
    return float(np.sqrt((off**2).mean(0)).max())
