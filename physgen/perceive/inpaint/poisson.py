"""Harmonic fill of holes (Laplace's equation) and seamless blending.

The equation is solved by conjugate gradients, preconditioned by one multigrid V-cycle
(Briggs, A Multigrid Tutorial). The photo's border is free (no flow through it); the
pixels beside the hole are boundary values.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.inpaint.contact_strips import contact_strips, shaded_islands
from physgen.perceive.inpaint.outgrowths import outgrowths
from physgen.photometry import channel_mean

if TYPE_CHECKING:
    from physgen.perceive.roles import Inpaint, Mask, Rgb

# px: gaps between objects narrower than this are mostly contact shadow.
ISLAND = 6
# px into the hole over which a difference at its border fades.
FADE = 5.0
# Surroundings of a small hole over its longer side ...
CONTEXT = 3.0
# ... and their least width, px.
LEAST_CONTEXT = 96
# px: soft border of contact shadow.
CONTACT_RIM = 2
# Levels: contrast of very few edges.
JUMP = 100.0
# Levels: a larger step at a seam is an edge and is not blended.
STEP = 60.0
# Levels: error of blended copies, below rounding.
SEAM_ERROR = 0.3


@dataclass(frozen=True)
class _Halo:
    """Limits of the traces of objects around their masks."""

    reach: float = 20 / 512
    """Largest reach over the photo's longer side; half the kernel of the paper's
    dilation (appendix).
    """
    edge: float = 0.1
    """Share of the steepest slope across a mask's border below which the blurred rim
    ends.
    """
    # px inside the border at which the steepest slope may lie, since coverage reaches
    # over the edge.
    inner_reach: int = 6
    # px: widest measured rim.
    widest: int = 12
    margin: int = 3
    """px outside the measured rim: sharpening leaves a line there, and masks have
    errors of this size.
    """
    # px: standard deviation of the blur before photo and fill are compared.
    blur_width: float = 1.5
    levels: float = 3.0
    """Least visible difference from another program's background on an even
    surface ...
    """
    # ... and its least ratio to random differences.
    loud: float = 2.0


HALO = _Halo()


def harmonic_fill(picture: F32, hole: Mask, tolerance: float = 0.02) -> F32:
    """Return `(H, W, C)` float32 with `hole` (H, W) filled by a harmonic function.

    The fill meets the values around the hole and reproduces linear ramps. `tolerance`
    is the largest error in the picture's unit. If the hole covers the picture, it is
    returned unchanged.
    """
    if not hole.any() or hole.all():
        return picture.copy()
    result = _pull_push(picture, hole)
    for part, piece in hole_pieces(hole):
        result[part] = _solve(result[part], piece, tolerance)
    return result


def join_gradients(sources: F32, shifts: NDArray[np.int64], hole: Mask) -> F32:
    """Return copies (H, W, 3) in `hole` (H, W) whose gradients meet without seams.

    The first H rows of `sources` (n, W, 3) are the photo. `shifts` (H, W, 2) are rows
    and columns from a pixel of the hole to its source. At a seam, the gradient comes
    from one source; steps above `STEP` stay, as edges.
    """
    result = sources[: len(hole)].copy()
    if not hole.any():
        return result
    x, y, w, h = cv2.boundingRect(hole.view(np.uint8))
    # One px more on all sides, because gradients cross the hole's border.
    corner = np.array([max(y - 1, 0), max(x - 1, 0)])
    box = np.s_[corner[0] : y + h + 1, corner[1] : x + w + 1]
    hole = hole[box]
    shifts = np.where(hole[..., None], shifts[box], 0)
    rows, columns = np.indices(hole.shape) + corner[:, None, None]
    copies = sources[rows + shifts[..., 0], columns + shifts[..., 1]]
    right = _divergence(copies, sources, shifts, hole, corner)
    for part, piece in hole_pieces(hole):
        copies[part] = _solve(copies[part], piece, SEAM_ERROR, right=right[part])
    result[box] = np.clip(copies, 0, 255)
    return result


def _divergence(
    copies: F32,
    sources: F32,
    shifts: NDArray[np.int64],
    hole: Mask,
    corner: NDArray[np.int64],
) -> F32:
    """Return the divergence (h, w, 3) of the gradients of `copies`.

    `corner` is the row and column of the photo at the top left.
    """
    height, width = hole.shape
    right = np.zeros_like(copies)
    for down, right_step in ((1, 0), (0, 1)):
        first = np.s_[: height - down, : width - right_step]
        second = np.s_[down:, right_step:]
        slope = copies[second] - copies[first]
        seam = (shifts[first] != shifts[second]).any(axis=-1)
        place = np.argwhere(seam)
        neighbours = place + np.array([down, right_step])
        shift = np.where(
            hole[first][seam][:, None], shifts[first][seam], shifts[second][seam]
        )
        aim = _seam_slopes(sources, (place + corner, neighbours + corner), shift)
        excess = slope[seam] - aim
        slope[seam] = aim + np.sign(excess) * np.maximum(np.abs(excess) - STEP, 0)
        right[second] += slope
        right[first] -= slope
    return right


def _seam_slopes(
    sources: F32,
    sides: tuple[NDArray[np.int64], NDArray[np.int64]],
    shift: NDArray[np.int64],
) -> F32:
    """Return slopes (n, 3) between pixels on both `sides` of a seam, from one of the
    copies.

    A mean of two copies would have less contrast than each. `shift` (n, 2) belongs to
    that copy.
    """
    last = np.array(sources.shape[:2]) - 1
    first_places, second_places = (np.clip(place + shift, 0, last) for place in sides)
    slopes = (
        sources[second_places[:, 0], second_places[:, 1]]
        - sources[first_places[:, 0], first_places[:, 1]]
    )
    return np.asarray(slopes, np.float32)


def seamless(other: Rgb, photo: Rgb, hole: Mask) -> Rgb:
    """Return another program's background in `hole` (H, W) without seams.

    Pixels around the hole are replaced as well if they differ clearly. A difference in
    exposure does not count: the difference at the border is interpolated over the hole
    by a harmonic fill and subtracted (Perez et al. 2003, Poisson image editing).
    Elsewhere the result equals `photo`.
    """
    reach, distance = _reach_around(hole)
    gap = photo.astype(np.float32) - other
    free, outer_weights = (
        (distance > limit).astype(np.float32)[:, :, None] for limit in (0, reach)
    )
    difference = np.abs(
        blur_known_pixels(gap, free, HALO.blur_width)
        - blur_known_pixels(gap, outer_weights, reach)
    ).max(axis=2)
    chance = (
        blur_known_pixels(difference[:, :, None] ** 2, outer_weights, reach)[:, :, 0]
        ** 0.5
    )
    differs = (difference > HALO.levels + HALO.loud * chance) & (distance <= 2 * reach)
    full_hole = dilate(_find_connected_pixels(hole, differs), 1)
    spread = harmonic_fill(
        np.where(full_hole[:, :, None], np.float32(0), gap), full_hole
    )
    composite = np.clip(other + spread + 0.5, 0, 255).astype(np.uint8)
    return np.where(full_hole[:, :, None], composite, photo)


def _reach_around(hole: Mask) -> tuple[float, F32]:
    """Return the possible reach of a halo, px, and the distance (H, W) from `hole`.

    The reach is reduced if it would cover the photo.
    """
    distance = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 5)
    reach = HALO.reach * max(hole.shape)
    while reach > 1 and (distance <= reach).all():
        reach /= 2
    return reach, np.asarray(distance, np.float32)


def rim_width(photo: Rgb, hole: Mask) -> int:
    """Return the width of objects' blurred rims outside `hole` (H, W), px.

    It is measured by the photo's slopes across the border.
    """
    profile = _border_slopes(photo, hole)
    if profile is None:
        return HALO.margin
    base = float(np.median(profile[-HALO.widest // 2 :]))
    top = int(np.argmax(profile[: HALO.inner_reach + 2]))
    low = np.flatnonzero(profile[top:] < base + HALO.edge * (profile[top] - base))
    return HALO.margin + max(
        0, top + int(low[0]) - HALO.inner_reach if len(low) else HALO.widest
    )


def _border_slopes(photo: Rgb, hole: Mask) -> F32 | None:
    """Return mean slopes (n,) across the hole's border per px of distance, from inside
    outwards; None if the object fills the photo or is tiny.
    """
    outside, inside = (
        cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (~hole, hole)
    )
    signed_distance = outside - inside
    normals = np.gradient(cv2.GaussianBlur(signed_distance, (0, 0), 1))
    slopes = np.gradient(channel_mean(photo.astype(np.float32)))
    slope = np.abs(slopes[0] * normals[0] + slopes[1] * normals[1])
    # No pixel lies at 0: the border is between 1 px inside and 1 px outside.
    steps = [*range(-HALO.inner_reach, 0), *range(1, HALO.widest + 1)]
    rings = [
        slope[(signed_distance > step - 1) & (signed_distance <= step)]
        for step in steps
    ]
    if not all(ring.size for ring in rings):
        return None
    return np.array([ring.mean() for ring in rings], np.float32)


def fill_behind(photo: Rgb, hole: Mask, fill: Inpaint) -> Rgb:
    """Return `photo` with `hole` (H, W), its blurred rim and its contact shadow
    filled.
    """
    if not hole.any() or hole.all():
        return photo.copy()
    return fill(photo, with_rim(photo, hole))


def fill_from_surroundings(photo: Rgb, hole: Mask, fill: Inpaint) -> Rgb:
    """Return `photo` with each piece of a `hole` (H, W) filled from its
    surroundings.
    """
    result = photo.copy()
    square = np.ones((LEAST_CONTEXT, LEAST_CONTEXT), np.uint8)
    wide_hole = cv2.dilate(hole.view(np.uint8), square)
    count, groups = cv2.connectedComponents(wide_hole, connectivity=8)
    for group in range(1, count):
        group_hole = hole & (groups == group)
        left, top, width, height = cv2.boundingRect(group_hole.view(np.uint8))
        margin = max(LEAST_CONTEXT, round(CONTEXT * max(width, height)))
        part = np.s_[
            max(0, top - margin) : top + height + margin,
            max(0, left - margin) : left + width + margin,
        ]
        patch = fill(np.ascontiguousarray(result[part]), hole[part].copy())
        result[part] = np.where(group_hole[part][..., None], patch, result[part])
    return result


def with_rim(photo: Rgb, hole: Mask) -> Mask:
    """Return `hole` (H, W) with its blurred rim, contact shadow and missed parts.

    Returns `hole` itself if no other pixel of the photo (H, W, 3) would remain.
    """
    if not hole.any() or hole.all():
        return hole
    wide_hole = _reach_around(hole)[1] <= rim_width(photo, hole)
    strips = dilate(contact_strips(photo, hole), CONTACT_RIM)
    wide_hole |= strips | shaded_islands(photo, wide_hole, strips)
    wide_hole |= dilate(outgrowths(photo, hole), CONTACT_RIM)
    return hole if wide_hole.all() else wide_hole


def blend_at_border(filled: F32, photo: Rgb, hole: Mask) -> Rgb:
    """Return `filled` (H, W, 3) in the hole and `photo` outside, as uint8.

    Shadows at the border fade out a few pixels inside. A shadow dims every colour: a
    pixel that is brighter in any channel belongs to an object's blurred rim and is not
    continued.
    """
    if not hole.any() or hole.all():
        return photo.copy()
    brightness = ((photo.astype(np.float32) + 1) / (np.maximum(filled, 0) + 1)).max(
        axis=2, keepdims=True
    )
    loss = np.where(
        hole[:, :, None], np.float32(0), np.minimum(brightness, 1) - 1
    ).astype(np.float32)
    depth = cv2.distanceTransform(hole.astype(np.uint8), cv2.DIST_L2, 5)[:, :, None]
    gain = 1 + harmonic_fill(loss, hole, tolerance=8e-3) * np.exp(
        -((depth / FADE) ** 2)
    )
    return np.where(
        hole[:, :, None], np.clip(filled * gain + 0.5, 0, 255).astype(np.uint8), photo
    )


def blur_known_pixels(picture: F32, known: F32, sigma: float) -> F32:
    """Return a blur of (H, W, C) from `known` pixels (H, W, 1)."""
    shape = picture.shape
    sums, weights = (
        cv2.GaussianBlur(part, (0, 0), sigma).reshape(*shape[:2], -1)
        for part in (picture * known, known)
    )
    return np.asarray(sums / np.maximum(weights, 1e-3), np.float32)


def _find_connected_pixels(hole: Mask, differs: Mask) -> Mask:
    """Return the hole and all `differs` pixels connected to it (H, W)."""
    _, names = cv2.connectedComponents(
        (hole | differs).astype(np.uint8), connectivity=8
    )
    connection = np.zeros(int(names.max()) + 1, bool)
    connection[names[hole]] = True
    return np.asarray(connection[names] & (hole | differs))


def close_gaps(hole: Mask) -> Mask:
    """Return the hole without narrow gaps and small islands."""
    closed_mask = cv2.morphologyEx(
        np.pad(hole, ISLAND).astype(np.uint8), cv2.MORPH_CLOSE, _disc(ISLAND)
    )
    closed_mask = closed_mask[ISLAND:-ISLAND, ISLAND:-ISLAND]
    count, ids, stats, _ = cv2.connectedComponentsWithStats(
        1 - closed_mask, connectivity=4
    )
    small = np.array(
        [k > 0 and stats[k, cv2.CC_STAT_AREA] < 16 * ISLAND**2 for k in range(count)]
    )
    return np.asarray(hole | (closed_mask > 0) | small[ids])


def dilate(mask: Mask, radius: int) -> Mask:
    """Return the mask dilated by `radius` px."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(radius)) > 0)


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8
    )


def hole_pieces(hole: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Yield the connected pieces of `hole` (H, W).

    Each is a box with 1 px around it, and the mask of the piece in the box.
    """
    count, ids, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=4
    )
    for k in range(1, count):
        x, y, w, h = (int(n) for n in stats[k, :4])
        part = slice(max(0, y - 1), y + h + 1), slice(max(0, x - 1), x + w + 1)
        yield part, ids[part] == k


def nearest_piece(hole: Mask) -> NDArray[np.int32]:
    """Return the number (H, W), from 1, of the nearest connected piece of `hole`."""
    return np.asarray(
        cv2.distanceTransformWithLabels((~hole).astype(np.uint8), cv2.DIST_L2, 5)[1],
        np.int32,
    )


def seams(
    filled: F32, picture: F32, hole: Mask, pieces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the mean excess contrast at the border of each piece of `hole`, in levels.

    The contrast is between `filled` and `picture` (H, W, 3); the part above most edges
    counts. The lower border is excluded, because a support may begin there.
    """
    known_weights = np.where(hole, np.float32(0), np.float32(1))
    kernel = np.array([[1, 1, 1], [1, 1, 1], [0, 0, 0]], np.float32) / 9
    share = cv2.filter2D(known_weights, -1, kernel)
    sums = cv2.filter2D(picture * known_weights[:, :, None], -1, kernel)
    rim = hole & (share > 0.01)
    excess = np.maximum(
        np.abs(filled[rim] - sums[rim] / share[rim][:, None]).mean(1) - JUMP, 0
    )
    count = int(pieces.max()) + 1
    return np.bincount(pieces[rim], excess, count) / np.maximum(
        np.bincount(pieces[rim], minlength=count), 1
    )


def _pull_push(picture: F32, hole: Mask) -> F32:
    """Return a first estimate of the fill from ever coarser averages (Gortler et al.
    1996).
    """
    known_weights = np.where(hole, np.float32(0), np.float32(1))
    if not hole.any() or min(hole.shape) < 2:
        return picture.copy()
    h, w = (n + n % 2 for n in hole.shape)
    pad, size = (0, h - hole.shape[0], 0, w - hole.shape[1]), (w // 2, h // 2)
    padded_maps = [
        cv2.copyMakeBorder(part, *pad, cv2.BORDER_CONSTANT)
        for part in (known_weights, picture * known_weights[:, :, None])
    ]
    half_weights, sums = (
        cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in padded_maps
    )
    mean = sums.reshape(h // 2, w // 2, -1) / np.maximum(half_weights, 1e-9)[:, :, None]
    coarse_fill = _pull_push(mean.astype(np.float32), half_weights == 0)
    fine_fill = cv2.resize(coarse_fill, (w, h), interpolation=cv2.INTER_LINEAR).reshape(
        h, w, -1
    )
    return np.where(
        hole[:, :, None], fine_fill[: hole.shape[0], : hole.shape[1]], picture
    )


@dataclass(frozen=True)
class _Grid:
    """One level of the multigrid (H, W): unknown pixels and their numbers of
    neighbours.

    Pictures are (C, H, W): NumPy works on whole planes several times as fast.
    """

    free: F32
    degree: F32

    @cached_property
    def damp(self) -> F32:
        """Return the share of its error by which a pixel changes in a round
        (Jacobi).
        """
        return np.float32(0.8) * self.free / self.degree

    def apply(self, x: F32) -> F32:
        """Return degree times x minus its neighbours; x is 0 outside the hole."""
        y = self.degree * x
        y[:, 1:] -= x[:, :-1]
        y[:, :-1] -= x[:, 1:]
        y[:, :, 1:] -= x[:, :, :-1]
        y[:, :, :-1] -= x[:, :, 1:]
        y *= self.free
        return y


def _grids(hole: Mask) -> list[_Grid]:
    """Return the levels of the multigrid, finest first."""
    grids = []
    while True:
        h, w = hole.shape
        degree = np.full((h, w), 4, np.float32)
        for edge in (degree[0], degree[-1], degree[:, 0], degree[:, -1]):
            edge -= 1
        grids.append(_Grid(hole.astype(np.float32), np.maximum(degree, 1)))
        if min(h, w) < 4 or not hole.any():
            return grids
        padded_hole = cv2.copyMakeBorder(
            hole.view(np.uint8), 0, h % 2, 0, w % 2, cv2.BORDER_REPLICATE
        ).view(bool)
        hole = (
            padded_hole[::2, ::2]
            & padded_hole[::2, 1::2]
            & padded_hole[1::2, ::2]
            & padded_hole[1::2, 1::2]
        )


def _v_cycle(grids: list[_Grid], level: int, right: F32) -> F32:
    """Return an approximate solution x of `grid.apply(x) = right`, symmetric in
    `right`.
    """
    grid = grids[level]
    damp = grid.damp
    x = damp * right
    coarsest = level == len(grids) - 1
    rounds = 8 if coarsest else 1
    for _ in range(rounds):
        x += damp * (right - grid.apply(x))
    if coarsest:
        return x
    # Restrict the residual, solve on the coarser level, add the correction and smooth
    # again.
    channels, h, w = right.shape
    rest = np.zeros((channels, h + h % 2, w + w % 2), np.float32)
    np.subtract(right, grid.apply(x), out=rest[:, :h, :w])
    down = (
        rest[:, ::2, ::2]
        + rest[:, ::2, 1::2]
        + rest[:, 1::2, ::2]
        + rest[:, 1::2, 1::2]
    )
    correction = (
        _v_cycle(grids, level + 1, down * grids[level + 1].free)
        .repeat(2, axis=1)
        .repeat(2, axis=2)
    )
    x += correction[:, :h, :w] * grid.free
    for _ in range(rounds + 1):
        x += damp * (right - grid.apply(x))
    return x


def _dot(a: F32, b: F32) -> NDArray[np.float64]:
    """Return the sums of products (C,) over the picture, channel by channel."""
    return np.asarray([plane.sum(dtype=np.float64) for plane in a * b])


def _solve(
    start: F32,
    hole: Mask,
    tolerance: float,
    max_iterations: int = 60,
    right: F32 | None = None,
) -> F32:
    """Return `start` (H, W, C) with every pixel of `hole` equal to its neighbours'
    mean.

    `right` (H, W, C) is the required sum of its differences from the neighbours, by
    default 0.
    """
    values = np.ascontiguousarray(np.moveaxis(start, 2, 0))
    grids = _grids(hole)
    grid = grids[0]
    rest = -_Grid(np.ones_like(grid.free), grid.degree).apply(values) * grid.free
    if right is not None:
        rest += np.moveaxis(right, 2, 0) * grid.free
    z = _v_cycle(grids, 0, rest)
    p = z.copy()
    rz = _dot(rest, z)
    for _ in range(max_iterations):
        # z estimates the error.
        if float(np.abs(z).max()) <= tolerance:
            break
        q = grid.apply(p)
        pq = _dot(p, q)
        step = np.where(pq > 0, rz / np.where(pq > 0, pq, 1), 0).astype(np.float32)
        values += step[:, None, None] * p
        rest -= step[:, None, None] * q
        z = _v_cycle(grids, 0, rest)
        new = _dot(rest, z)
        p = (
            z
            + np.where(rz > 0, new / np.where(rz > 0, rz, 1), 0).astype(np.float32)[
                :, None, None
            ]
            * p
        )
        rz = new
    return np.where(hole[:, :, None], np.moveaxis(values, 0, 2), start)
