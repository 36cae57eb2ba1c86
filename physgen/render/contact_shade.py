"""Ambient light that objects hide from each other where they come to touch."""

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
    """Of the ambient share of light, lost at the point of contact; chosen by eye."""
    spread: float = 2.5
    """px, standard deviation: the darkening ends 5 px from a neighbour."""
    reach: int = 6
    """px between boxes beyond which there is none."""
    overlap: float = 0.05
    """Of the smaller object: more in common is one object before another, not a contact."""
    least: float = 0.01
    """Share of the darkening that is invisible."""
    faint: float = 0.1
    """Share of the darkening from which objects touch in the photo."""


SHADE = ContactShadeTuning()
Part = tuple[Slices, F32]
"""Box of the canvas, and coverage (h, w) on it."""


def contact_depth(scene: Scene) -> float:
    """Return the share of light that is lost at a contact; 0 if the scene does not ask for it."""
    light = scene.light
    if light is None or not scene.render.contact_shade:
        return 0.0
    straight = light.intensity * max(light.direction[2], 0.0)
    return SHADE.depth * light.ambient / max(light.ambient + straight, 1e-6)


class ContactShade:
    """Darkening of sprites at contacts that the photo does not show."""

    def __init__(self, sprites: Sequence[Sprite], depth: float) -> None:
        self._depth, self._sprites = np.float32(depth), sprites
        self._photo_contacts: dict[tuple[int, int], bool] = {}

    def factors(self, parts: dict[int, Part]) -> dict[int, F32]:
        """Return (h, w) by which the light of sprites is multiplied, on their boxes.

        `parts` are the visible sprites by index.
        """
        factors: dict[int, F32] = {}
        if not self._depth:
            return factors
        for pair in combinations(sorted(parts), 2):
            first, second = parts[pair[0]], parts[pair[1]]
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
        """Return whether two sprites touch where they were cut out."""
        known = self._photo_contacts.get(pair)
        if known is not None:
            return known
        first, second = (_part_at_rest(self._sprites[k]) for k in pair)
        found = False
        if _is_near(first[0], second[0]):
            shades = [shade for shade in _shades(first, second) if shade is not None]
            found = any(shade[1].max() > SHADE.faint for shade in shades)
        self._photo_contacts[pair] = found
        return found


def _part_at_rest(sprite: Sprite) -> Part:
    (x, y), (height, width) = sprite.corner, sprite.coverage.shape
    return np.s_[y : y + height, x : x + width], sprite.coverage


def _is_near(box: Slices, other: Slices) -> bool:
    """Return whether two boxes are close enough for a darkening."""
    for own, their in zip(box, other, strict=True):
        if max(own.start, their.start) > min(own.stop, their.stop) + SHADE.reach:
            return False
    return True


def _shades(first: Part, second: Part) -> tuple[Part | None, Part | None]:
    """Return the darkening 0..1 of both objects by each other, in boxes of their own pictures.

    None if there is none.
    """
    margin = 2 * SHADE.reach
    corners, ends = [], []
    for axis in (0, 1):
        own, their = first[0][axis], second[0][axis]
        corners.append(max(own.start, their.start) - margin)
        ends.append(min(own.stop, their.stop) + margin)
    views = [_cut(part, corners, ends) for part in (first, second)]
    common = float((views[0] * views[1]).sum())
    least = min(float(first[1].sum()), float(second[1].sum()))
    # the shade fades as one object moves behind the other
    strength = 1 - common / max(SHADE.overlap * least, 1e-9)
    if strength <= 0:
        return None, None
    return (
        _shade(first, views[0], strength * views[1], corners),
        _shade(second, views[1], strength * views[0], corners),
    )


def _shade(part: Part, own: F32, other: F32, corners: Sequence[int]) -> Part | None:
    """Return the darkening of a part by another one; both coverages are seen from `corners` on."""
    soft = np.asarray(cv2.GaussianBlur(other, (0, 0), SHADE.spread), np.float32)
    # An edge of a plane hides half of the blur's weight.
    values = np.minimum(2 * soft, 1) * (own > 0)
    return _own_part(part, np.asarray(values, np.float32), corners)


def _cut(part: Part, corners: Sequence[int], ends: Sequence[int]) -> F32:
    """Return a part's coverage between two corners of the canvas, 0 outside of its box."""
    box, coverage = part
    view = np.zeros((ends[0] - corners[0], ends[1] - corners[1]), np.float32)
    own, place = [], []
    for axis in (0, 1):
        start = max(box[axis].start, corners[axis])
        stop = min(box[axis].start + coverage.shape[axis], ends[axis])
        stop = max(stop, start)
        own.append(slice(start - box[axis].start, stop - box[axis].start))
        place.append(slice(start - corners[axis], stop - corners[axis]))
    view[tuple(place)] = coverage[tuple(own)]
    return view


def _own_part(part: Part, values: F32, corners: Sequence[int]) -> Part | None:
    """Return values in the box of a part's picture that they cover; None if they are faint."""
    if float(values.max(initial=0)) < SHADE.least:
        return None
    box, coverage = part
    own, place = [], []
    for axis in (0, 1):
        offset = corners[axis] - box[axis].start
        start = max(offset, 0)
        stop = min(offset + values.shape[axis], coverage.shape[axis])
        own.append(slice(start, stop))
        place.append(slice(start - offset, stop - offset))
    return (own[0], own[1]), values[place[0], place[1]]


def multiply_light(light: F32, factor: F32) -> F32:
    """Return light (h, w, 3) multiplied by a factor (h, w)."""
    return np.asarray(cv2.multiply(light, three_channels(factor)), np.float32)
