"""Contact shadow under an object, also between its wheels or legs.

Such a strip is far darker than the ground around it and shows almost no texture. It is
therefore filled with the hole, while an ordinary shadow is divided out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from physgen.maps import F32
from physgen.perceive.roles import Mask, Rgb
from physgen.photometry import decode, luminance


@dataclass(frozen=True)
class _Tuning:
    """Limits of contact shadows, chosen on two photos (a car, a toy car) and
    drawings.
    """

    reach: float = 10 / 512
    """Extent below and beside the foot, as a share of the photo's longer side; half the
    paper's kernel.
    """
    # Height of the gaps between wheels above the foot, as a share of the object's
    # height.
    legs: float = 0.3
    # Largest share of the ground's light in a contact shadow.
    shadow_light: float = 0.45
    # Quantile of the ground's light reached by its dark grains ...
    low: float = 0.1
    # ... and the share of that quantile below which a pixel is shadow.
    below_low: float = 0.8
    # Linear light: no shadow is visible on a darker ground.
    least_ground: float = 0.02
    # px of ground that must be visible.
    fewest: int = 30
    # px: standard deviation of the blur against grain.
    blur_width: float = 1.0
    # px: least area of an object.
    smallest: int = 100
    # Largest area of a strip over the object's; a larger dark region is another
    # surface.
    largest_area: float = 0.4
    # Largest share of a strip's outline at which the dark region continues below or
    # beside the searched surroundings. In 79 labelled photos of COCO, the largest share
    # of a shadow is 0.39, and all strips above are other surfaces, e.g. a hedge.
    longest: float = 0.4
    # Largest light of an island of ground between an object and its strips, over that
    # of the ground around the strips.
    island_light: float = 0.8


TUNING = _Tuning()


def contact_strips(photo: Rgb, hole: Mask) -> Mask:
    """Return dark strips (H, W) under the objects in `hole` (H, W) of `photo` (H, W,
    3).
    """
    result = np.zeros_like(hole)
    for piece, dark_strip in _dark_strips(photo, hole):
        shadow = dark_strip.ending_parts()
        if shadow.sum() < TUNING.largest_area * piece.sum():
            result |= shadow
    return result & ~hole


@dataclass(frozen=True, eq=False)
class _DarkStrip:
    """Dark pixels at the foot of an object, (H, W)."""

    strip: Mask
    """In the surroundings of the foot and connected to the object."""
    dark_mask: Mask
    """Below the highest row of the surroundings."""
    ground: Mask

    def ending_parts(self) -> Mask:
        """Return the connected parts of the strip that end on lighter ground.

        A dark region that continues outside the surroundings is another surface.
        """
        count, names = cv2.connectedComponents(self.strip.view(np.uint8))
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        beside_dark, beside_ground = (
            cv2.dilate(mask.view(np.uint8), cross) > 0
            for mask in (self.dark_mask & ~self.strip, self.ground)
        )
        continued = np.bincount(names[beside_dark], minlength=count)
        outline = np.bincount(names[beside_dark | beside_ground], minlength=count)
        is_ending = continued <= TUNING.longest * outline
        return np.asarray(self.strip & is_ending[names])


def _dark_strips(photo: Rgb, hole: Mask) -> Iterator[tuple[Mask, _DarkStrip]]:
    """Yield the connected pieces of `hole` (H, W), each with its dark strip."""
    light = luminance(decode(photo)).astype(np.float32)
    known_weights = (~hole).astype(np.float32)
    share = np.maximum(cv2.GaussianBlur(known_weights, (0, 0), TUNING.blur_width), 1e-3)
    sums = cv2.GaussianBlur(light * known_weights, (0, 0), TUNING.blur_width)
    light = np.asarray(sums / share, np.float32)
    reach = max(2, round(TUNING.reach * max(hole.shape)))
    for piece, box in _objects(hole):
        yield piece, _strip(light, hole, piece, box, reach)


def _objects(hole: Mask) -> Iterator[tuple[Mask, tuple[int, int, int, int]]]:
    """Yield connected pieces of `hole`, each with its left, top, width and height."""
    count, names, stats, _ = cv2.connectedComponentsWithStats(
        hole.astype(np.uint8), connectivity=8
    )
    for number in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[number])
        if area >= TUNING.smallest:
            yield names == number, (left, top, width, height)


def _strip(
    light: F32, hole: Mask, piece: Mask, box: tuple[int, int, int, int], reach: int
) -> _DarkStrip:
    """Return dark pixels (H, W) around the foot of one `piece` and connected to it."""
    dark_mask = ~hole & (light < _darkest_ground(light, hole, box, reach))
    shadow = _foot_surroundings(piece, box, reach) & dark_mask
    _, names = cv2.connectedComponents(
        (shadow | piece).astype(np.uint8), connectivity=8
    )
    component_ids = np.unique(names[piece])
    strip = np.asarray(shadow & np.isin(names, component_ids[component_ids > 0]))
    ground_mask = ~dark_mask & ~hole
    dark_mask[: _highest_row(box)] = False
    return _DarkStrip(strip, dark_mask, ground_mask)


def _foot_surroundings(piece: Mask, box: tuple[int, int, int, int], reach: int) -> Mask:
    """Return the pixels (H, W) under a `piece` (H, W) or directly beside its foot."""
    left, top, width, height = box
    room = np.zeros_like(piece)
    rows = slice(_highest_row(box), top + height + reach)
    room[rows, max(0, left - reach) : left + width + reach] = True
    mask_below = np.maximum.accumulate(piece, axis=0)
    return room & (mask_below | _dilate(piece, reach))


def _highest_row(box: tuple[int, int, int, int]) -> int:
    """Return the highest row of the gaps between the wheels of an object."""
    _, top, _, height = box
    return max(0, top + height - int(TUNING.legs * height))


def _darkest_ground(
    light: F32, hole: Mask, box: tuple[int, int, int, int], reach: int
) -> float:
    """Return the light below which the ground around a foot is shadow; 0 if it is
    unknown.

    The darker ground counts, below or beside the object: a car on a dark road may stand
    behind a pale pavement. Dark grains of the ground are not shadow.
    """
    left, top, width, height = box
    foot = top + height
    side = max(width // 2, 2 * reach)
    columns = slice(max(0, left - reach), left + width + reach)
    lower_ground, side_ground = np.zeros_like(hole), np.zeros_like(hole)
    lower_ground[foot + reach : foot + 3 * reach, columns] = True
    rows = slice(max(0, foot - reach), foot + reach)
    side_ground[rows, max(0, left - side) : left + width + side] = True
    side_ground[rows, columns] = False
    limits = []
    for ground in (lower_ground & ~hole, side_ground & ~hole):
        if ground.sum() < TUNING.fewest:
            continue
        low, middle = np.quantile(light[ground], [TUNING.low, 0.5])
        if middle > TUNING.least_ground:
            limits.append(min(TUNING.shadow_light * middle, TUNING.below_low * low))
    return float(min(limits, default=0.0))


def shaded_islands(photo: Rgb, hole: Mask, strips: Mask) -> Mask:
    """Return the ground (H, W) of a `photo` (H, W, 3) that `strips` (H, W) enclose with
    the rest of a `hole` (H, W).

    Ground between a body and the strip below it is shaded by the body, and would stay
    behind as a dark patch.
    """
    result = np.zeros_like(hole)
    free = ~(hole | strips)
    islands = list(_islands(free)) if strips.any() else []
    if not islands:
        return result
    light = luminance(decode(photo)).astype(np.float32)
    _, names = cv2.connectedComponents(strips.astype(np.uint8), connectivity=8)
    reach = max(2, round(TUNING.reach * max(hole.shape)))
    for island in islands:
        numbers = np.unique(names[_dilate(island, 1)])
        closing = np.isin(names, numbers[numbers > 0])
        # A larger island is scenery seen between legs.
        if np.count_nonzero(island) > np.count_nonzero(closing):
            continue
        ground = _dilate(closing, reach) & free & ~island
        ground_light = np.median(light[ground]) if ground.any() else 0.0
        if np.median(light[island]) < TUNING.island_light * ground_light:
            result |= island
    return result


def _islands(free: Mask) -> Iterator[Mask]:
    """Yield the connected parts of `free` (H, W) apart from the photo's border."""
    count, names = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    at_border = np.unique(
        np.concatenate([names[0], names[-1], names[:, 0], names[:, -1]])
    )
    for number in range(1, count):
        if number not in at_border:
            yield names == number


def _dilate(mask: Mask, reach: int) -> Mask:
    """Return a mask (H, W) dilated by `reach` px in all directions."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)
