"""Parts of an object outside its mask: rims of a base, a wheel, a heel tab.

The mask of a network may end before its object. Missing parts of the object and its
contact shadow look like the object, unlike the ground beside them, and start at its
outline. They belong to the hole, because the fill would copy them and they would remain
visible. The colours of object and ground are two mixtures of Gaussians, and the border
is a minimal cut (Rother et al. 2004, GrabCut) at reduced size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.maps import F32
from physgen.perceive.roles import Labels, Mask, Rgb
from physgen.photometry import largest_channel


@dataclass(frozen=True)
class OutgrowthConstants:
    """Constants of the search, chosen on six photos of one object each."""

    # px: longer side of an object's surroundings in the search.
    side: int = 224
    # Width of these surroundings over the object's size (root of its area).
    surroundings_width: float = 0.3
    # Largest distance of a part from the mask over the object's size.
    reach: float = 0.22
    # Least area of an object over the photo's; parts of smaller objects are too small.
    least_area: float = 0.01
    # Number of searched objects, the largest ones; more are a heap.
    objects: int = 5
    # Rounds of GrabCut after its first estimate.
    rounds: int = 2
    # Seed of its first clusters.
    seed: int = 1
    # px at reduced size: largest gap between a part and the object.
    touches: float = 2.0
    # Least length of contact over the root of a part's area.
    contact: float = 0.9
    # px at reduced size: least area of a part.
    smallest: int = 12
    # Largest area of a part over the object's; more is similar background.
    part: float = 0.12
    # Largest area of all parts together over the object's.
    total_area: float = 0.2
    # Largest area of added parts over the object's.
    added_area: float = 0.06
    # Reach of a part of the upper half, e.g. a rim, over the object's size.
    rim_reach: float = 0.05
    # Largest extent over the reach: a longer region is similar background.
    longest: float = 0.9
    # px: width of the compared surroundings of a part.
    ring: int = 4
    # 8-bit levels: largest colour difference of a part's continuation.
    continuation_difference: float = 45.0
    # Largest number of continuations of a part.
    continuations: int = 3
    # px at reduced size: largest width of a bright line across a part.
    highlight: int = 5
    # Levels across 3 px at the border of a part of the object ...
    sharp: float = 30.0
    # ... and the least ratio to the ground's gradient; shadows have less.
    clearer: float = 2.0
    # Least share of the border with this sharpness.
    border_share: float = 0.7
    # 8-bit levels: least difference between a part and the ground beside it.
    ground_difference: float = 18.0


OUTGROWTHS = OutgrowthConstants()


def outgrowths(photo: Rgb, hole: Mask) -> Mask:
    """Return the parts (H, W) of objects in `hole` (H, W) that lie outside it."""
    result = np.zeros_like(hole)
    for piece, box in _large_pieces(hole):
        result[box] |= _parts(photo[box], piece, hole[box]) > 0
    return _without_ground(result & ~hole)


def attach_outgrowths(photo: Rgb, labels: Labels) -> Labels:
    """Return the label map (H, W) with sharply bordered parts added to their objects.

    Contact shadow has a soft border and is excluded. Parts of touching objects stay
    outside, because their owner is uncertain.
    """
    result = labels.copy()
    hole = labels > 0
    for piece, box in _large_pieces(hole):
        owners = np.unique(labels[box][piece])
        if len(owners) == 1:
            parts = np.zeros_like(hole)
            parts[box] = _parts(photo[box], piece, hole[box], is_clear=True) >= 0.5
            parts = _without_ground(parts & (result == 0))
            if parts.sum() <= OUTGROWTHS.added_area * piece.sum():
                result[parts] = owners[0]
    return result


def _without_ground(parts: Mask) -> Mask:
    """Return parts (H, W) without pieces at the photo's border, which are ground."""
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
        if area < OUTGROWTHS.least_area * hole.size:
            break
        margin = round(OUTGROWTHS.surroundings_width * float(np.sqrt(area)))
        rows = slice(max(0, top - margin), top + height + margin)
        columns = slice(max(0, left - margin), left + width + margin)
        yield names[rows, columns] == k + 1, (rows, columns)


def _parts(photo: Rgb, own: Mask, hole: Mask, *, is_clear: bool = False) -> F32:
    """Return the coverage (h, w), 0..1, of the surroundings by parts of one object.

    If `is_clear`, only parts with a sharp border count.
    """
    height, width = own.shape
    scale = min(1.0, OUTGROWTHS.side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(photo, size, interpolation=cv2.INTER_AREA), np.uint8)
    object_mask = _downscale_mask(own, size)
    other_objects = _downscale_mask(hole & ~own, size)
    reach = OUTGROWTHS.reach * float(np.sqrt(np.count_nonzero(object_mask)))
    distance = np.asarray(
        cv2.distanceTransform((~object_mask).view(np.uint8), cv2.DIST_L2, 5), np.float32
    )
    if not object_mask.any() or not (distance > reach).any():
        return np.zeros(own.shape, np.float32)
    like = _like_object(small, object_mask, (distance <= reach) & ~other_objects)
    surroundings = _Neighbourhood(small, distance, object_mask | other_objects, reach)
    parts = surroundings.parts(like)
    if is_clear:
        parts = surroundings.clear(parts)
    return np.asarray(cv2.resize(parts.astype(np.float32), (width, height)), np.float32)


def _downscale_mask(mask: Mask, size: tuple[int, int]) -> Mask:
    small_mask = cv2.resize(mask.view(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(small_mask > 0)


def _like_object(photo: Rgb, own: Mask, band: Mask) -> Mask:
    """Return the pixels (h, w) of a `band` that look like the object rather than the
    ground.
    """
    seeds: NDArray[np.uint8] = np.full(own.shape, cv2.GC_BGD, np.uint8)
    seeds[own] = cv2.GC_FGD
    full_rectangle = 0, 0, own.shape[1], own.shape[0]
    background_model, object_model = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(OUTGROWTHS.seed)
    # The models are learnt without the band: a wheel in it has no ground colour.
    ground = np.where(band[..., None], _nearest_outside(photo, band | own), photo)
    cv2.grabCut(
        ground,
        seeds,
        full_rectangle,
        background_model,
        object_model,
        1,
        cv2.GC_INIT_WITH_MASK,
    )
    classes: NDArray[np.uint8] = np.full(own.shape, cv2.GC_BGD, np.uint8)
    classes[band] = cv2.GC_PR_BGD
    classes[own] = cv2.GC_FGD
    cv2.grabCut(
        photo,
        classes,
        full_rectangle,
        background_model,
        object_model,
        1,
        cv2.GC_EVAL_FREEZE_MODEL,
    )
    cv2.grabCut(
        photo,
        classes,
        full_rectangle,
        background_model,
        object_model,
        OUTGROWTHS.rounds,
        cv2.GC_EVAL,
    )
    like = ((classes == cv2.GC_PR_FGD) & ~own).view(np.uint8)
    cleaned_mask = cv2.morphologyEx(like, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    return np.asarray(cleaned_mask > 0)


def _nearest_outside(photo: Rgb, mask: Mask) -> Rgb:
    """Return the photo (h, w, 3) with each pixel of a mask replaced by the nearest
    other one.
    """
    _, nearest = cv2.distanceTransformWithLabels(
        mask.view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(nearest.max()) + 1, 2), np.int64)
    places[nearest[~mask]] = np.argwhere(~mask)
    source = places[nearest]
    return np.asarray(photo[source[..., 0], source[..., 1]])


@dataclass(frozen=True)
class _Neighbourhood:
    """The surroundings of an object at reduced size, (h, w)."""

    photo: Rgb
    distance: F32
    """Distance to the object, px."""
    object_mask: Mask
    """Pixels of all objects."""
    reach: float
    """Largest reach of a part, px."""

    def parts(self, like: Mask) -> Mask:
        """Return the complete parts among the pieces of `like`; none if they are too
        many.
        """
        area = np.count_nonzero(self.object_mask)
        parts = np.zeros_like(like)
        count, names = cv2.connectedComponents(like.view(np.uint8), connectivity=8)
        for k in range(1, count):
            piece = names == k
            if np.count_nonzero(piece) < OUTGROWTHS.smallest:
                continue
            # Try the piece with its longest continuation first, the piece alone last.
            for part in reversed(self._continuations(piece, like)):
                is_small = np.count_nonzero(part) <= OUTGROWTHS.part * area
                if is_small and self._is_part(part):
                    parts |= part
                    break
        is_texture = np.count_nonzero(parts) > OUTGROWTHS.total_area * area
        return np.zeros_like(parts) if is_texture else parts

    def clear(self, parts: Mask) -> Mask:
        """Return the pieces of `parts` (h, w) with sharper borders than the ground."""
        square = np.ones((3, 3), np.uint8)
        slope = cv2.cvtColor(self.photo, cv2.COLOR_RGB2GRAY)
        slope = np.asarray(cv2.morphologyEx(slope, cv2.MORPH_GRADIENT, square))
        result = np.zeros_like(parts)
        count, names = cv2.connectedComponents(parts.view(np.uint8), connectivity=8)
        for k in range(1, count):
            piece = names == k
            inner = cv2.erode(piece.view(np.uint8), square) > 0
            border = piece & ~inner & (self.distance > OUTGROWTHS.touches)
            ground = self._ring(cv2.dilate(piece.view(np.uint8), square) > 0, parts)
            if not (border.any() and ground.any()):
                continue
            usual = OUTGROWTHS.clearer * float(np.median(slope[ground]))
            sharp_pixels = slope[border] >= max(OUTGROWTHS.sharp, usual)
            if sharp_pixels.mean() >= OUTGROWTHS.border_share:
                result |= piece
        return result

    def _continuations(self, piece: Mask, like: Mask) -> list[Mask]:
        """Return a piece and its growing continuations, each from the one before.

        The colour of a tyre changes along it: each continuation has a colour of its
        own.
        """
        result = [piece]
        for _ in range(OUTGROWTHS.continuations):
            part = self._whole(result[-1], like | result[-1])
            if np.array_equal(part, result[-1]):
                break
            result.append(part)
        return result

    def _whole(self, piece: Mask, like: Mask) -> Mask:
        """Return a piece with the adjacent pixels of its colour beside and below it."""
        ground = self._ring(piece, like)
        if not ground.any():
            return piece
        own_difference, ground_difference = self._steps(piece), self._steps(ground)
        own_pixels = (
            (own_difference <= OUTGROWTHS.continuation_difference)
            & (own_difference < ground_difference)
            & ~self.object_mask
        )
        own_pixels[: np.nonzero(piece)[0].min()] = False
        square = np.ones((OUTGROWTHS.highlight, OUTGROWTHS.highlight), np.uint8)
        # Closing bridges bright lines, so that a highlight does not cut the part.
        joint_mask = cv2.morphologyEx(
            (own_pixels | piece).view(np.uint8), cv2.MORPH_CLOSE, square
        )
        _, names = cv2.connectedComponents(joint_mask, connectivity=8)
        return np.isin(names, np.unique(names[piece])) & ~self.object_mask

    def _is_part(self, piece: Mask) -> bool:
        """Return whether a piece starts at the object, ends nearby and stands out."""
        distance = self.distance[piece]
        middle = float(np.nonzero(self.distance == 0)[0].mean())
        is_low = np.nonzero(piece)[0].mean() >= middle
        share = 1.0 if is_low else OUTGROWTHS.rim_reach / OUTGROWTHS.reach
        ends = distance.max() <= OUTGROWTHS.longest * self.reach * share
        contact = np.count_nonzero(distance <= OUTGROWTHS.touches) / OUTGROWTHS.touches
        if contact < OUTGROWTHS.contact * float(np.sqrt(len(distance))) or not ends:
            return False
        ground = self._ring(piece, piece)
        if not ground.any():
            return False
        return (
            float(np.median(self._steps(piece)[ground])) >= OUTGROWTHS.ground_difference
        )

    def _ring(self, piece: Mask, like: Mask) -> Mask:
        """Return the ground around a piece."""
        kernel = np.ones((2 * OUTGROWTHS.ring + 1,) * 2, np.uint8)
        neighbourhood = cv2.dilate(piece.view(np.uint8), kernel) > 0
        return np.asarray(neighbourhood & ~like & ~self.object_mask)

    def _steps(self, mask: Mask) -> F32:
        """Return the difference (h, w) from the median colour of a mask, 8-bit
        levels.
        """
        colour = np.median(self.photo[mask], axis=0)
        return np.asarray(largest_channel(np.abs(self.photo - colour)), np.float32)
