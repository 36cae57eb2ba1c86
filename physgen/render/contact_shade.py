"""Darkening of objects at contacts, where they block each other's ambient light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.render.sprites import Sprite
from physgen.render.stage import Slices, three_channels
from physgen.scene.scene import Scene


@dataclass(frozen=True)
class ContactShadeTuning:
    """Size and depth of the darkening."""

    depth: float = 0.25
    """Share of the ambient light lost at the contact; chosen by eye."""
    spread: float = 2.5
    """Standard deviation, px: the darkening ends 5 px from a neighbour."""
    reach: int = 6
    """Distance between boxes, px, beyond which there is no darkening."""
    overlap: float = 0.05
    """Share of the smaller object: a larger overlap is no contact, but one object
    before another.
    """
    least_share: float = 0.01
    """Largest invisible share of the darkening."""
    contact_share: float = 0.1
    """Share of the darkening above which objects touch in the photo."""


SHADE = ContactShadeTuning()
Part = tuple[Slices, F32]
"""Box on the canvas, and coverage (h, w) in it."""


def contact_depth(scene: Scene) -> float:
    """Return the share of light lost at a contact; 0 if the scene has no
    contact shade.
    """
    light = scene.light
    if light is None or not scene.render.contact_shade:
        return 0.0
    direct_light = light.intensity * max(light.direction[2], 0.0)
    return SHADE.depth * light.ambient / max(light.ambient + direct_light, 1e-6)


class ContactShade:
    """Darkening of sprites at contacts that the photo does not show."""

    def __init__(self, sprites: Sequence[Sprite], depth: float) -> None:
        self._depth, self._sprites = np.float32(depth), sprites
        self._photo_contacts: dict[tuple[int, int], bool] = {}

    def factors(self, parts: dict[int, Part]) -> dict[int, F32]:
        """Return the factors (h, w) of the light of sprites, on their boxes.

        `parts` are the visible sprites by index.
        """
        factors: dict[int, F32] = {}
        if not self._depth:
            return factors
        for pair in combinations(sorted(parts), 2):
            first, second = parts[pair[0]], parts[pair[1]]
            # The photo already shows the shade of pairs in contact there.
            if not _is_near(first[0], second[0]) or self._touches_in_photo(pair):
                continue
            for k, shade in zip(pair, _shades(first, second), strict=True):
                if shade is None:
                    continue
                box, values = shade
                if k not in factors:
                    factors[k] = np.ones(parts[k][1].shape, np.float32)
                factors[k][box] *= 1 - self._depth * values
        return factors

    def _touches_in_photo(self, pair: tuple[int, int]) -> bool:
        """Check whether two sprites touch in the photo, which then shows the darkening
        already.
        """
        result = self._photo_contacts.get(pair)
        if result is not None:
            return result
        first, second = (_part_at_rest(self._sprites[k]) for k in pair)
        is_contact = False
        if _is_near(first[0], second[0]):
            shades = [shade for shade in _shades(first, second) if shade is not None]
            is_contact = any(shade[1].max() > SHADE.contact_share for shade in shades)
        self._photo_contacts[pair] = is_contact
        return is_contact


def _part_at_rest(sprite: Sprite) -> Part:
    """Return the box and the coverage of a sprite at its place in the photo."""
    (x, y), (height, width) = sprite.corner, sprite.coverage.shape
    return np.s_[y : y + height, x : x + width], sprite.coverage


def _is_near(box: Slices, other: Slices) -> bool:
    """Check whether two boxes are close enough for a darkening."""
    for first_slice, second_slice in zip(box, other, strict=True):
        if (
            max(first_slice.start, second_slice.start)
            > min(first_slice.stop, second_slice.stop) + SHADE.reach
        ):
            return False
    return True


def _shades(first: Part, second: Part) -> tuple[Part | None, Part | None]:
    """Return the darkening 0..1 of both objects by each other, in their own boxes.

    None for an object without darkening.
    """
    margin = 2 * SHADE.reach
    corners, ends = [], []
    for axis in (0, 1):
        first_slice, second_slice = first[0][axis], second[0][axis]
        corners.append(max(first_slice.start, second_slice.start) - margin)
        ends.append(min(first_slice.stop, second_slice.stop) + margin)
    views = [_cut(part, corners, ends) for part in (first, second)]
    overlap_area = float((views[0] * views[1]).sum())
    smaller_area = min(float(first[1].sum()), float(second[1].sum()))
    # The shade fades while one object moves behind the other.
    strength = 1 - overlap_area / max(SHADE.overlap * smaller_area, 1e-9)
    if strength <= 0:
        return None, None
    return (
        _shade(first, views[0], strength * views[1], corners),
        _shade(second, views[1], strength * views[0], corners),
    )


def _shade(
    part: Part, own_coverage: F32, other: F32, corners: Sequence[int]
) -> Part | None:
    """Return the darkening of a part by another one; both coverages begin at
    `corners`.
    """
    blurred_cover = np.asarray(
        cv2.GaussianBlur(other, (0, 0), SHADE.spread), np.float32
    )
    # An edge of a plane hides half of the blur's weight.
    values = np.minimum(2 * blurred_cover, 1) * (own_coverage > 0)
    return _own_part(part, np.asarray(values, np.float32), corners)


def _cut(part: Part, corners: Sequence[int], ends: Sequence[int]) -> F32:
    """Return a part's coverage between two corners of the canvas, 0 outside of
    its box.
    """
    box, coverage = part
    view = np.zeros((ends[0] - corners[0], ends[1] - corners[1]), np.float32)
    source_slices, place = [], []
    for axis in (0, 1):
        start = max(box[axis].start, corners[axis])
        stop = min(box[axis].start + coverage.shape[axis], ends[axis])
        stop = max(stop, start)
        source_slices.append(slice(start - box[axis].start, stop - box[axis].start))
        place.append(slice(start - corners[axis], stop - corners[axis]))
    view[tuple(place)] = coverage[tuple(source_slices)]
    return view


def _own_part(part: Part, values: F32, corners: Sequence[int]) -> Part | None:
    """Crop values to the box of a part's picture; None if they are invisible."""
    if float(values.max(initial=0)) < SHADE.least_share:
        return None
    box, coverage = part
    target_slices, place = [], []
    for axis in (0, 1):
        offset = corners[axis] - box[axis].start
        start = max(offset, 0)
        stop = min(offset + values.shape[axis], coverage.shape[axis])
        target_slices.append(slice(start, stop))
        place.append(slice(start - offset, stop - offset))
    return (target_slices[0], target_slices[1]), values[place[0], place[1]]


def multiply_light(light: F32, factor: F32) -> F32:
    """Return light (h, w, 3) multiplied by a factor (h, w)."""
    return np.asarray(cv2.multiply(light, three_channels(factor)), np.float32)
