"""What hangs on an object outside its mask: rims of a base, a wheel, a heel tab.

A mask of a network may end before its object does. Parts of the object and its contact
shadow that are left out look like the object, unlike the ground beside them, and start
at its outline. They belong to the hole: the fill would copy them, and they would stay
behind. Colours of object and ground are two mixtures of Gaussians, the border a minimal
cut (Rother et al. 2004, GrabCut), at reduced size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb


@dataclass(frozen=True)
class OutgrowthConstants:
    """Constants of the search, chosen on six photos of one object each."""

    side: int = 224  # px: longer side of an object's surroundings when it is searched
    around: float = 0.3  # of an object's size (root of its area): these surroundings
    reach: float = 0.22  # of its size: how far a part reaches
    least: float = 0.01  # of the photo's area: of smaller objects parts are too small
    objects: int = 5  # the largest ones; more are a heap
    rounds: int = 2  # of GrabCut, from its first guess
    seed: int = 1  # of its first clusters
    touches: float = 2.0  # px between a part and the object, at reduced size
    contact: float = 0.9  # length along which they touch, over the root of its area
    smallest: int = 12  # px of a part, at reduced size
    part: float = 0.12  # of the object's area, at most: more is background like it
    every: float = 0.2  # of its area, all parts together
    attached: float = 0.06  # of its area, at most, that becomes a part of the object
    thin: float = 0.05  # of its size: reach of a part of its upper half, as of a rim
    longest: float = 0.9  # of the reach: what goes on is background like the object
    ring: int = 4  # px around a part with which it is compared
    alike: float = 45.0  # 8-bit codes from a part's colour, with which it goes on
    highlight: int = 5  # px at reduced size: a bright line across a part is narrower
    sharp: float = 30.0  # codes across 3 px at the border of a part of the object ...
    clearer: float = 2.0  # ... and times those of the ground; shadows have less
    bordered: float = 0.7  # share of its border that is so clear
    unlike: float = 18.0  # 8-bit codes between a part and the ground beside it


OUTGROWTHS = OutgrowthConstants()


def outgrowths(photo: Rgb, hole: Mask) -> Mask:
    """Return parts (H, W) of what is in `hole` (H, W) that lie outside it."""
    result = np.zeros_like(hole)
    for own, box in _large_pieces(hole):
        result[box] |= _parts(photo[box], own, hole[box]) > 0
    return _without_ground(result & ~hole)


def attach_outgrowths(photo: Rgb, labels: Labels) -> Labels:
    """Return the label map (H, W) with parts of clear borders as their objects'.

    Contact shadow has a soft border. A part of one of several objects that touch each
    other stays outside: its owner is unsure.
    """
    attached = labels.copy()
    hole = labels > 0
    for own, box in _large_pieces(hole):
        owners = np.unique(labels[box][own])
        if len(owners) == 1:
            parts = np.zeros_like(hole)
            parts[box] = _parts(photo[box], own, hole[box], is_clear=True) >= 0.5
            parts = _without_ground(parts & (attached == 0))
            if parts.sum() <= OUTGROWTHS.attached * own.sum():
                attached[parts] = owners[0]
    return attached


def _without_ground(parts: Mask) -> Mask:
    """Return parts (H, W) without those that reach the photo's border: these are ground."""
    _, names = cv2.connectedComponents(parts.view(np.uint8), connectivity=8)
    sides = (names[0], names[-1], names[:, 0], names[:, -1])
    at_border = np.unique(np.concatenate(sides))
    return np.asarray(parts & ~np.isin(names, at_border))


def _large_pieces(hole: Mask) -> Iterator[tuple[Mask, tuple[slice, slice]]]:
    """Yield the largest pieces of `hole`, each in the box of its surroundings."""
    _, names, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=8
    )
    areas = stats[1:, cv2.CC_STAT_AREA]
    for k in np.argsort(-areas, kind="stable")[: OUTGROWTHS.objects].tolist():
        left, top, width, height, area = (int(value) for value in stats[k + 1])
        if area < OUTGROWTHS.least * hole.size:
            break
        margin = round(OUTGROWTHS.around * float(np.sqrt(area)))
        rows = slice(max(0, top - margin), top + height + margin)
        columns = slice(max(0, left - margin), left + width + margin)
        yield names[rows, columns] == k + 1, (rows, columns)


def _parts(photo: Rgb, own: Mask, hole: Mask, *, is_clear: bool = False) -> F32:
    """Return how far (h, w) 0..1 parts beside one object cover its surroundings.

    Those with a clear border alone if `is_clear`.
    """
    height, width = own.shape
    scale = min(1.0, OUTGROWTHS.side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8)
    mine = _reduced(own, size)
    blocked = _reduced(hole & ~own, size)
    reach = OUTGROWTHS.reach * float(np.sqrt(np.count_nonzero(mine)))
    away = np.asarray(
        cv2.distanceTransform((~mine).view(np.uint8), cv2.DIST_L2, 5), np.float32
    )
    if not mine.any() or not (away > reach).any():
        return np.zeros(own.shape, np.float32)
    like = _like_object(small, mine, (away <= reach) & ~blocked)
    beside = _Beside(small, away, mine | blocked, reach)
    parts = beside.parts(like)
    if is_clear:
        parts = beside.clear(parts)
    return np.asarray(cv2.resize(parts.astype(np.float32), (width, height)), np.float32)


def _reduced(mask: Mask, size: tuple[int, int]) -> Mask:
    reduced = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(reduced > 0)


def _like_object(photo: Rgb, own: Mask, band: Mask) -> Mask:
    """Return the pixels (h, w) of a `band` that look like an object, not like ground."""
    known: NDArray[np.uint8] = np.full(own.shape, cv2.GC_BGD, np.uint8)
    known[own] = cv2.GC_FGD
    whole = 0, 0, own.shape[1], own.shape[0]
    far, near = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(OUTGROWTHS.seed)
    # models are learnt without the band: a wheel there is no colour of the ground
    ground = np.where(band[..., None], _nearest_outside(photo, band | own), photo)
    cv2.grabCut(ground, known, whole, far, near, 1, cv2.GC_INIT_WITH_MASK)
    classes: NDArray[np.uint8] = np.full(own.shape, cv2.GC_BGD, np.uint8)
    classes[band] = cv2.GC_PR_BGD
    classes[own] = cv2.GC_FGD
    cv2.grabCut(photo, classes, whole, far, near, 1, cv2.GC_EVAL_FREEZE_MODEL)
    cv2.grabCut(photo, classes, whole, far, near, OUTGROWTHS.rounds, cv2.GC_EVAL)
    like = ((classes == cv2.GC_PR_FGD) & ~own).view(np.uint8)
    opened = cv2.morphologyEx(like, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return np.asarray(opened > 0)


def _nearest_outside(photo: Rgb, mask: Mask) -> Rgb:
    """Return the photo (h, w, 3), each pixel of a mask as the nearest outside it."""
    _, nearest = cv2.distanceTransformWithLabels(
        mask.view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(nearest.max()) + 1, 2), np.int64)
    places[nearest[~mask]] = np.argwhere(~mask)
    source = places[nearest]
    return np.asarray(photo[source[..., 0], source[..., 1]])


@dataclass(frozen=True)
class _Beside:
    """The surroundings of an object at reduced size, (h, w)."""

    photo: Rgb
    away: F32
    """px to the object."""
    taken: Mask
    """All objects."""
    reach: float
    """px that a part reaches at most."""

    def parts(self, like: Mask) -> Mask:
        """Return the pieces of `like` that are parts, whole; none if too many."""
        area = np.count_nonzero(self.taken)
        parts = np.zeros_like(like)
        count, names = cv2.connectedComponents(like.view(np.uint8), connectivity=8)
        for k in range(1, count):
            piece = names == k
            if np.count_nonzero(piece) < OUTGROWTHS.smallest:
                continue
            for part in (self._whole(piece, like), piece):
                is_small = np.count_nonzero(part) <= OUTGROWTHS.part * area
                if is_small and self._is_part(part):
                    parts |= part
                    break
        is_texture = np.count_nonzero(parts) > OUTGROWTHS.every * area
        return np.zeros_like(parts) if is_texture else parts

    def clear(self, parts: Mask) -> Mask:
        """Return the pieces of `parts` (h, w) with borders clearer than the ground."""
        square = np.ones((3, 3), np.uint8)
        slope = cv2.cvtColor(self.photo, cv2.COLOR_RGB2GRAY)
        slope = np.asarray(cv2.morphologyEx(slope, cv2.MORPH_GRADIENT, square))
        result = np.zeros_like(parts)
        count, names = cv2.connectedComponents(parts.view(np.uint8), connectivity=8)
        for k in range(1, count):
            piece = names == k
            inner = cv2.erode(piece.view(np.uint8), square) > 0
            border = piece & ~inner & (self.away > OUTGROWTHS.touches)
            ground = self._ring(cv2.dilate(piece.view(np.uint8), square) > 0, parts)
            if not (border.any() and ground.any()):
                continue
            usual = OUTGROWTHS.clearer * float(np.median(slope[ground]))
            is_clear = slope[border] >= max(OUTGROWTHS.sharp, usual)
            if is_clear.mean() >= OUTGROWTHS.bordered:
                result |= piece
        return result

    def _whole(self, piece: Mask, like: Mask) -> Mask:
        """Return a piece with what of its colour goes on beside it and below."""
        ground = self._ring(piece, like)
        if not ground.any():
            return piece
        own, other = self._steps(piece), self._steps(ground)
        is_own = (own <= OUTGROWTHS.alike) & (own < other) & ~self.taken
        is_own[: np.nonzero(piece)[0].min()] = False
        square = np.ones((OUTGROWTHS.highlight, OUTGROWTHS.highlight), np.uint8)
        joined = cv2.morphologyEx(
            (is_own | piece).view(np.uint8), cv2.MORPH_CLOSE, square
        )
        _, names = cv2.connectedComponents(joined, connectivity=8)
        return np.isin(names, np.unique(names[piece])) & ~self.taken

    def _is_part(self, piece: Mask) -> bool:
        """Return whether a piece starts at the object, ends nearby and stands out."""
        distance = self.away[piece]
        middle = float(np.nonzero(self.away == 0)[0].mean())
        is_low = np.nonzero(piece)[0].mean() >= middle
        share = 1.0 if is_low else OUTGROWTHS.thin / OUTGROWTHS.reach
        ends = distance.max() <= OUTGROWTHS.longest * self.reach * share
        contact = np.count_nonzero(distance <= OUTGROWTHS.touches) / OUTGROWTHS.touches
        if contact < OUTGROWTHS.contact * float(np.sqrt(len(distance))) or not ends:
            return False
        ground = self._ring(piece, piece)
        if not ground.any():
            return False
        return float(np.median(self._steps(piece)[ground])) >= OUTGROWTHS.unlike

    def _ring(self, piece: Mask, like: Mask) -> Mask:
        """Return the ground around a piece."""
        kernel = np.ones((2 * OUTGROWTHS.ring + 1,) * 2, np.uint8)
        near = cv2.dilate(piece.view(np.uint8), kernel) > 0
        return np.asarray(near & ~like & ~self.taken)

    def _steps(self, mask: Mask) -> F32:
        """Return 8-bit codes (h, w) from the median colour of a mask."""
        colour = np.median(self.photo[mask], axis=0)
        return np.asarray(np.abs(self.photo - colour).max(axis=2), np.float32)
