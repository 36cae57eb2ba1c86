"""Harmonic fill of holes (Laplace's equation) and seamless blending.

The equation is solved by conjugate gradients, preconditioned by one multigrid V-cycle (Briggs, A Multigrid Tutorial).
The photo's border is free (no flow through it); values beside the hole are boundary values.
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
from physgen.perceive.inpaint.contact_strips import contact_strips
from physgen.perceive.inpaint.outgrowths import outgrowths

if TYPE_CHECKING:
    from physgen.perceive.roles import Inpaint, Mask, Rgb

ISLAND = 6  # px: gaps between objects narrower than this are mostly contact shadow
FADE = 5.0  # px into the hole over which a difference at its border fades
CONTEXT = 3.0  # of a hole's longer side: surroundings of a small hole
LEAST_CONTEXT = 96  # px, at least
CONTACT_RIM = 2  # px around contact shadow: its soft end
JUMP = 100.0  # levels of contrast that edges seldom have
STEP = 60.0  # levels: a larger step at a seam is an edge, and is not blended
SEAM_ERROR = 0.3  # levels of blended copies: less than rounding


@dataclass(frozen=True)
class _Halo:
    """What objects leave around their masks."""

    reach: float = 20 / 512
    """Of the photo's longer side: how far it may reach; half the kernel by which the paper dilates (appendix)."""
    edge: float = 0.1
    """Of the steepest slope across a mask's border: where it falls below, the blurred rim ends."""
    within: int = 6  # px inside the border where the steepest slope may lie: coverage reaches over the edge
    widest: int = 12  # px: widest rim that is measured
    margin: int = 3
    """px beyond the measured rim: sharpening leaves a line there, and masks are off by as much."""
    smooth: float = (
        1.5  # px, standard deviation of the blur over which photo and fill are compared
    )
    levels: float = 3.0
    """Difference from another program's background from which one is seen on an even surface ..."""
    loud: float = (
        2.0  # ... and how many times as large as differences are by chance it is
    )


HALO = _Halo()


def harmonic_fill(picture: F32, hole: Mask, tolerance: float = 0.02) -> F32:
    """`(H, W, C)` float32 with `hole` (H, W) filled by the harmonic function that meets the rest.

    Linear ramps are reproduced. `tolerance` is the error that may be left, in the picture's unit. Where nothing is
    outside the hole, the picture is returned unchanged.
    """
    if not hole.any() or hole.all():
        return picture.copy()
    result = _pull_push(picture, hole)
    for part, piece in hole_pieces(hole):
        result[part] = _solve(result[part], piece, tolerance)
    return result


def join_gradients(sources: F32, shifts: NDArray[np.int64], hole: Mask) -> F32:
    """(H, W, 3): copies in `hole` (H, W) whose gradients meet without seams.

    The first H rows of `sources` (n, W, 3) are the photo. `shifts` (H, W, 2): rows and columns
    from a pixel of the hole to its source. At a seam, the gradient is what one
    source has there; steps beyond `STEP` stay, as edges.
    """
    result = sources[: len(hole)].copy()
    if not hole.any():
        return result
    x, y, w, h = cv2.boundingRect(hole.view(np.uint8))
    # a px more on all sides: gradients cross the hole's border
    corner = np.array([max(y - 1, 0), max(x - 1, 0)])
    box = np.s_[corner[0] : y + h + 1, corner[1] : x + w + 1]
    hole = hole[box]
    shifts = np.where(hole[..., None], shifts[box], 0)
    rows, columns = np.indices(hole.shape) + corner[:, None, None]
    joined = sources[rows + shifts[..., 0], columns + shifts[..., 1]]
    right = _divergence(joined, sources, shifts, hole, corner)
    for part, piece in hole_pieces(hole):
        joined[part] = _solve(joined[part], piece, SEAM_ERROR, right=right[part])
    result[box] = np.clip(joined, 0, 255)
    return result


def _divergence(
    copies: F32,
    sources: F32,
    shifts: NDArray[np.int64],
    hole: Mask,
    corner: NDArray[np.int64],
) -> F32:
    """(h, w, 3): by how much each pixel exceeds its neighbours, by the gradients of `copies`.

    `corner`: row and column of the photo at the top left.
    """
    height, width = hole.shape
    right = np.zeros_like(copies)
    for down, across in ((1, 0), (0, 1)):
        first = np.s_[: height - down, : width - across]
        second = np.s_[down:, across:]
        slope = copies[second] - copies[first]
        seam = (shifts[first] != shifts[second]).any(axis=-1)
        place = np.argwhere(seam)
        beyond = place + np.array([down, across])
        shift = np.where(
            hole[first][seam][:, None], shifts[first][seam], shifts[second][seam]
        )
        aim = _seam_slopes(sources, (place + corner, beyond + corner), shift)
        off = slope[seam] - aim
        slope[seam] = aim + np.sign(off) * np.maximum(np.abs(off) - STEP, 0)
        right[second] += slope
        right[first] -= slope
    return right


def _seam_slopes(
    sources: F32,
    sides: tuple[NDArray[np.int64], NDArray[np.int64]],
    shift: NDArray[np.int64],
) -> F32:
    """(n, 3): slopes between pixels on both `sides` of a seam, by one of the copies.

    A mean of two copies would have less contrast than each. `shift` (n, 2) is that copy's.
    """
    last = np.array(sources.shape[:2]) - 1
    one, other = (np.clip(place + shift, 0, last) for place in sides)
    slopes = sources[other[:, 0], other[:, 1]] - sources[one[:, 0], one[:, 1]]
    return np.asarray(slopes, np.float32)


def seamless(other: Rgb, photo: Rgb, hole: Mask) -> Rgb:
    """Another program's background `(H, W, 3)` in `hole` (H, W) and where it differs from the photo beside it.

    Its difference in exposure does not count: what is left at the border is spread over the hole by a harmonic fill
    and subtracted (Perez et al. 2003, Poisson image editing). Elsewhere the result equals `photo`.
    """
    reach, away = _reach_around(hole)
    gap = photo.astype(np.float32) - other
    free, beyond = ((away > far).astype(np.float32)[:, :, None] for far in (0, reach))
    off = np.abs(_smoothed(gap, free, HALO.smooth) - _smoothed(gap, beyond, reach)).max(
        axis=2
    )
    chance = _smoothed(off[:, :, None] ** 2, beyond, reach)[:, :, 0] ** 0.5
    differs = (off > HALO.levels + HALO.loud * chance) & (away <= 2 * reach)
    whole = dilate(_joined_to(hole, differs), 1)
    spread = harmonic_fill(np.where(whole[:, :, None], np.float32(0), gap), whole)
    filled = np.clip(other + spread + 0.5, 0, 255).astype(np.uint8)
    return np.where(whole[:, :, None], filled, photo)


def _reach_around(hole: Mask) -> tuple[float, F32]:
    """px that a halo may reach, less where that would cover the photo; (H, W) px from `hole`."""
    away = cv2.distanceTransform((~hole).astype(np.uint8), cv2.DIST_L2, 5)
    reach = HALO.reach * max(hole.shape)
    while reach > 1 and (away <= reach).all():
        reach /= 2
    return reach, np.asarray(away, np.float32)


def rim_width(photo: Rgb, hole: Mask) -> int:
    """px beyond the border of `hole` (H, W) to which objects' blurred rims reach, by the photo's slopes across it."""
    outside, inside = (
        cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (~hole, hole)
    )
    away = outside - inside
    across = np.gradient(cv2.GaussianBlur(away, (0, 0), 1))
    slopes = np.gradient(photo.astype(np.float32).mean(axis=2))
    slope = np.abs(slopes[0] * across[0] + slopes[1] * across[1])
    # no pixel lies at 0: the border is between 1 px inside and 1 px outside
    steps = [-HALO.within + k for k in range(HALO.within)] + list(
        range(1, HALO.widest + 1)
    )
    rings = [
        slope[(away > d - 1) & (away <= d)]
        for d in steps
        if ((away > d - 1) & (away <= d)).any()
    ]
    if len(rings) < len(steps):  # an object that fills the photo, or a tiny one
        return HALO.margin
    profile = np.array([ring.mean() for ring in rings])
    base = float(np.median(profile[-HALO.widest // 2 :]))
    top = int(np.argmax(profile[: HALO.within + 2]))
    low = np.flatnonzero(profile[top:] < base + HALO.edge * (profile[top] - base))
    return HALO.margin + max(
        0, top + int(low[0]) - HALO.within if len(low) else HALO.widest
    )


def fill_behind(photo: Rgb, hole: Mask, fill: Inpaint) -> Rgb:
    """`photo` (H, W, 3) with `hole` (H, W), its blurred rim and contact shadow filled."""
    if not hole.any() or hole.all():
        return photo.copy()
    return fill(photo, with_rim(photo, hole))


def fill_from_surroundings(photo: Rgb, hole: Mask, fill: Inpaint) -> Rgb:
    """`photo` (H, W, 3) with pieces of a `hole` (H, W) filled from what is close to each."""
    result = photo.copy()
    square = np.ones((LEAST_CONTEXT, LEAST_CONTEXT), np.uint8)
    wide = cv2.dilate(hole.view(np.uint8), square)
    count, groups = cv2.connectedComponents(wide, connectivity=8)
    for group in range(1, count):
        own = hole & (groups == group)
        left, top, width, height = cv2.boundingRect(own.view(np.uint8))
        margin = max(LEAST_CONTEXT, round(CONTEXT * max(width, height)))
        part = np.s_[
            max(0, top - margin) : top + height + margin,
            max(0, left - margin) : left + width + margin,
        ]
        filled = fill(np.ascontiguousarray(result[part]), hole[part].copy())
        result[part] = np.where(own[part][..., None], filled, result[part])
    return result


def with_rim(photo: Rgb, hole: Mask) -> Mask:
    """Return `hole` (H, W) with its blurred rim, contact shadow and left-out parts.

    `hole` itself if nothing else of the photo (H, W, 3) would be left.
    """
    if not hole.any() or hole.all():
        return hole
    wide = _reach_around(hole)[1] <= rim_width(photo, hole)
    wide |= dilate(contact_strips(photo, hole), CONTACT_RIM)
    wide |= dilate(outgrowths(photo, hole), CONTACT_RIM)
    return hole if wide.all() else wide


def blend_at_border(filled: F32, photo: Rgb, hole: Mask) -> Rgb:
    """`filled` (H, W, 3) in the hole and `photo` outside, as uint8; shadows at the border fade out a few pixels inside.

    A shadow dims every colour: a pixel that is brighter in any channel is an object's blurred rim and is not carried.
    """
    if not hole.any() or hole.all():
        return photo.copy()
    dimmed = ((photo.astype(np.float32) + 1) / (np.maximum(filled, 0) + 1)).max(
        axis=2, keepdims=True
    )
    loss = np.where(hole[:, :, None], np.float32(0), np.minimum(dimmed, 1) - 1).astype(
        np.float32
    )
    depth = cv2.distanceTransform(hole.astype(np.uint8), cv2.DIST_L2, 5)[:, :, None]
    kept = 1 + harmonic_fill(loss, hole, tolerance=8e-3) * np.exp(
        -((depth / FADE) ** 2)
    )
    return np.where(
        hole[:, :, None], np.clip(filled * kept + 0.5, 0, 255).astype(np.uint8), photo
    )


def _smoothed(picture: F32, known: F32, sigma: float) -> F32:
    """A blur of (H, W, C) from what is `known` (H, W, 1)."""
    shape = picture.shape
    sums, weights = (
        cv2.GaussianBlur(part, (0, 0), sigma).reshape(*shape[:2], -1)
        for part in (picture * known, known)
    )
    return np.asarray(sums / np.maximum(weights, 1e-3), np.float32)


def _joined_to(hole: Mask, differs: Mask) -> Mask:
    """(H, W) the hole and what `differs` in one piece with it."""
    _, names = cv2.connectedComponents(
        (hole | differs).astype(np.uint8), connectivity=8
    )
    kept = np.zeros(int(names.max()) + 1, bool)
    kept[names[hole]] = True
    return np.asarray(kept[names] & (hole | differs))


def close_gaps(hole: Mask) -> Mask:
    """The hole with narrow gaps and small islands in it closed."""
    shut = cv2.morphologyEx(
        np.pad(hole, ISLAND).astype(np.uint8), cv2.MORPH_CLOSE, _disc(ISLAND)
    )
    shut = shut[ISLAND:-ISLAND, ISLAND:-ISLAND]
    count, ids, stats, _ = cv2.connectedComponentsWithStats(1 - shut, connectivity=4)
    small = np.array(
        [k > 0 and stats[k, cv2.CC_STAT_AREA] < 16 * ISLAND**2 for k in range(count)]
    )
    return np.asarray(hole | (shut > 0) | small[ids])


def dilate(mask: Mask, radius: int) -> Mask:
    """The mask and all within `radius` px of it."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(radius)) > 0)


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * radius + 1
    return np.asarray(
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), np.uint8
    )


def hole_pieces(hole: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """The connected pieces of `hole` (H, W): each as rows and columns with 1 px around, and its mask in there."""
    count, ids, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=4
    )
    for k in range(1, count):
        x, y, w, h = (int(n) for n in stats[k, :4])
        part = slice(max(0, y - 1), y + h + 1), slice(max(0, x - 1), x + w + 1)
        yield part, ids[part] == k


def nearest_piece(hole: Mask) -> NDArray[np.int32]:
    """(H, W): the number, from 1 on, of the connected piece of `hole` that is nearest."""
    return np.asarray(
        cv2.distanceTransformWithLabels((~hole).astype(np.uint8), cv2.DIST_L2, 5)[1],
        np.int32,
    )


def seams(
    filled: F32, picture: F32, hole: Mask, pieces: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Levels by which the contrast of `filled` and `picture` (H, W, 3) across the border of each piece of `hole` (H, W)
    goes beyond that of most edges, on average; by piece. Not below the hole, where what carries an object may begin."""
    known = np.where(hole, np.float32(0), np.float32(1))
    around = np.array([[1, 1, 1], [1, 1, 1], [0, 0, 0]], np.float32) / 9
    share = cv2.filter2D(known, -1, around)
    sums = cv2.filter2D(picture * known[:, :, None], -1, around)
    rim = hole & (share > 0.01)
    beyond = np.maximum(
        np.abs(filled[rim] - sums[rim] / share[rim][:, None]).mean(1) - JUMP, 0
    )
    most = int(pieces.max()) + 1
    return np.bincount(pieces[rim], beyond, most) / np.maximum(
        np.bincount(pieces[rim], minlength=most), 1
    )


def _pull_push(picture: F32, hole: Mask) -> F32:
    """First guess of the fill from ever coarser averages (Gortler et al. 1996)."""
    known = np.where(hole, np.float32(0), np.float32(1))
    if not hole.any() or min(hole.shape) < 2:
        return picture.copy()
    h, w = (n + n % 2 for n in hole.shape)
    pad, size = (0, h - hole.shape[0], 0, w - hole.shape[1]), (w // 2, h // 2)
    even = [
        cv2.copyMakeBorder(part, *pad, cv2.BORDER_CONSTANT)
        for part in (known, picture * known[:, :, None])
    ]
    half, sums = (cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in even)
    mean = sums.reshape(h // 2, w // 2, -1) / np.maximum(half, 1e-9)[:, :, None]
    coarse = _pull_push(mean.astype(np.float32), half == 0)
    fine = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_LINEAR).reshape(h, w, -1)
    return np.where(hole[:, :, None], fine[: hole.shape[0], : hole.shape[1]], picture)


@dataclass(frozen=True)
class _Grid:
    """One level of the multigrid: unknown pixels, and the number of neighbours of each in the picture; (H, W).

    Pictures of it are (C, H, W): a channel is a whole plane, which NumPy works on several times as fast.
    """

    free: F32
    degree: F32

    @cached_property
    def damp(self) -> F32:
        """Share of its error by which a pixel changes in a round (Jacobi)."""
        return np.float32(0.8) * self.free / self.degree

    def apply(self, x: F32) -> F32:
        """Degree times x minus its neighbours; x is 0 outside the hole."""
        y = self.degree * x
        y[:, 1:] -= x[:, :-1]
        y[:, :-1] -= x[:, 1:]
        y[:, :, 1:] -= x[:, :, :-1]
        y[:, :, :-1] -= x[:, :, 1:]
        y *= self.free
        return y


def _grids(hole: Mask) -> list[_Grid]:
    grids = []
    while True:
        h, w = hole.shape
        degree = np.full((h, w), 4, np.float32)
        for edge in (degree[0], degree[-1], degree[:, 0], degree[:, -1]):
            edge -= 1
        grids.append(_Grid(hole.astype(np.float32), np.maximum(degree, 1)))
        if min(h, w) < 4 or not hole.any():
            return grids
        even = cv2.copyMakeBorder(
            hole.view(np.uint8), 0, h % 2, 0, w % 2, cv2.BORDER_REPLICATE
        ).view(bool)
        hole = even[::2, ::2] & even[::2, 1::2] & even[1::2, ::2] & even[1::2, 1::2]


def _v_cycle(grids: list[_Grid], level: int, right: F32) -> F32:
    """An approximate solution x of `grid.apply(x) = right`, symmetric in `right`."""
    grid = grids[level]
    damp = grid.damp
    x = damp * right
    coarsest = level == len(grids) - 1
    rounds = 8 if coarsest else 1
    for _ in range(rounds):
        x += damp * (right - grid.apply(x))
    if coarsest:
        return x
    channels, h, w = right.shape
    rest = np.zeros((channels, h + h % 2, w + w % 2), np.float32)
    np.subtract(right, grid.apply(x), out=rest[:, :h, :w])
    down = (
        rest[:, ::2, ::2]
        + rest[:, ::2, 1::2]
        + rest[:, 1::2, ::2]
        + rest[:, 1::2, 1::2]
    )
    up = (
        _v_cycle(grids, level + 1, down * grids[level + 1].free)
        .repeat(2, axis=1)
        .repeat(2, axis=2)
    )
    x += up[:, :h, :w] * grid.free
    for _ in range(rounds + 1):
        x += damp * (right - grid.apply(x))
    return x


def _dot(a: F32, b: F32) -> NDArray[np.float64]:
    """(C,): the sum of products over the picture, channel by channel."""
    return np.asarray([plane.sum(dtype=np.float64) for plane in a * b])


def _solve(
    start: F32,
    hole: Mask,
    tolerance: float,
    max_iterations: int = 60,
    right: F32 | None = None,
) -> F32:
    """`start` (H, W, C) changed inside `hole` until every pixel there is the mean of its neighbours.

    `right` (H, W, C): by how much the sum of its differences from them exceeds 0.
    """
    values = np.ascontiguousarray(np.moveaxis(start, 2, 0))
    grids = _grids(hole)
    fine = grids[0]
    rest = -_Grid(np.ones_like(fine.free), fine.degree).apply(values) * fine.free
    if right is not None:
        rest += np.moveaxis(right, 2, 0) * fine.free
    z = _v_cycle(grids, 0, rest)
    p = z.copy()
    rz = _dot(rest, z)
    for _ in range(max_iterations):
        if float(np.abs(z).max()) <= tolerance:  # z estimates the error
            break
        q = fine.apply(p)
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
