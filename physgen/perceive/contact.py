"""Background and what stands on it -> the shade of soft light about feet and rims, where no one light tells of shadows.

An overcast sky, or lamps on all sides, leave a thing's surroundings dark where they see least of the sky. Where that
must lie is known without a light. It is believed where the photo is darker just there than in all like places near by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.darkened import missing, standing_out
from physgen.perceive.roles import Rgb
from physgen.perceive.silhouettes import typical
from physgen.perceive.trace import foretold
from physgen.photometry import DistantLight
from physgen.shadow.cast import Setting as Place
from physgen.shadow.cast import Silhouette

F32 = NDArray[np.float32]

LONGEST = 512
"""px: longer side of the picture that is looked at."""
RING = 2
"""px around objects where the background still shows traces of them."""
EVEN = 1.2
"""Shading of a surface that faces the light."""
SKIES = ((0.0, 5.7), (0.6, 9.6))
"""How much of the light is direct, from straight above; and degrees by which the camera looks down on a floor."""
WIDE = 40.0
"""degrees: half the width of such a light."""
DEEP, FAINT = 0.05, 0.02
"""-log of foretold light: what is darker is looked at, and compared with what is lighter."""
SHADED = 0.03
"""From which a place says nothing of surfaces in the light."""
BESIDE = (0.4, 0.15), (0.3, 0.3)
"""Of an object's size, across and down: how far from there; seen from the side, and from above."""
NEAR_BY = (0.5, 1.0, 1.5, 2.0)
"""Of an object's size: how far off shadows might lie as well, if they were chance."""
SURE = 6.0
"""Times what chance gives, from which on it is believed (studio photos of the split `tune`)."""
SEEN = 0.025
"""-log of light: less is not believed."""
RIMS = (30.0, 8.0, 2.0)
"""px: standard deviations, the widest first, of the means by which a rim's darkness is carried behind a thing."""
STRENGTHS = (0.3, 3.0)
"""By how much less or more than foretold may be dark."""


@dataclass(frozen=True)
class Contact:
    """Shade of soft light, in px of the photo."""

    place: Place
    factor: float
    """By how much more is dark than foretold, as a logarithm."""
    sure: float
    """Times what chance gives."""
    missing: F32
    """(H, W) -log of the light that the photo misses, smooth."""

    @property
    def confidence(self) -> float:
        """0..1."""
        return round(min(0.7, 0.1 * self.sure), 2)

    @property
    def reason(self) -> str:
        """A sentence for the scene's comments."""
        return f"soft light from all sides: dark about feet and rims, {self.sure:.0f} times what chance gives"


def contact(
    background: Rgb, coverage: F32, silhouettes: Callable[[float], Sequence[Silhouette]], *, from_above: bool
) -> Contact | None:
    """`silhouettes` gives them on a picture so many times smaller. None where nothing tells."""
    H, W = coverage.shape
    scale = max(max(H, W) / LONGEST, 1.0)
    things = silhouettes(scale)
    if not things:
        return None
    w, h = max(1, round(W / scale)), max(1, round(H / scale))
    picture = np.asarray(cv2.resize(background, (w, h), interpolation=cv2.INTER_AREA), np.uint8)
    ring = np.ones((2 * RING + 1, 2 * RING + 1), np.uint8)
    near = np.asarray(cv2.dilate((coverage > 0).astype(np.uint8), ring), np.float32)
    free = np.asarray(cv2.resize(near, (w, h), interpolation=cv2.INTER_AREA) == 0)
    size = typical(things)
    best: Contact | None = None
    for direct, down in SKIES:
        place = _sky(direct, down, (w, h), from_above)
        model = foretold(things, place)
        seen = model[free & (model > FAINT)]
        if not seen.size:
            continue
        deep = (model > max(DEEP, float(np.median(seen)))) & free
        wide = tuple(2 * int(part * size) + 1 for part in BESIDE[from_above])
        beside = cv2.dilate((model > SHADED).astype(np.uint8), np.ones(wide[::-1], np.uint8)) > 0
        beside &= model < FAINT
        dark = missing(picture, free.astype(np.float32), model > SHADED, size, from_above=from_above)
        contrast, sure = standing_out(dark, free, deep, beside, _elsewhere(size, from_above))
        if contrast < SEEN or sure < SURE or (best is not None and best.sure >= sure):
            continue
        told = float(np.median(model[deep]) - np.median(model[beside & free]))
        factor = min(max(contrast / max(told, 1e-3), STRENGTHS[0]), STRENGTHS[1])
        full = np.asarray(cv2.resize(dark, (W, H), interpolation=cv2.INTER_LINEAR), np.float32)
        best = Contact(_sky(direct, down, (W, H), from_above), factor, sure, full)
    return best


def rimmed(dark: F32, coverage: F32) -> F32:
    """(H, W): behind things as dark as about their rims, from where the background was filled there."""
    free = (coverage == 0).astype(np.float32)
    values = dark * free
    result = dark.copy()
    for sigma in RIMS:
        near = cv2.GaussianBlur(free, (0, 0), sigma)
        hidden = (free == 0) & (near > 1e-3)
        result[hidden] = (cv2.GaussianBlur(values, (0, 0), sigma) / np.maximum(near, 1e-6))[hidden]
    return np.asarray(result, np.float32)


def _sky(direct: float, down: float, size: tuple[int, int], from_above: bool) -> Place:
    towards = (0.0, 0.0, 1.0) if from_above else (0.0, -1.0, 0.0)
    light = DistantLight(towards, EVEN * direct, EVEN * (1 - direct))
    return Place(light, WIDE, from_above, tan(radians(down)), inf, size)


def _elsewhere(size: float, from_above: bool) -> list[tuple[int, int]]:
    """px right and down: where else shadows might lie. Seen from the side they are flat, and lie apart a row away."""
    steps = [0.0, *NEAR_BY, *(-part for part in NEAR_BY)]
    downs = steps if from_above else [0.6 * part for part in steps if 0 < abs(part) <= 1]
    least = 1.0 if from_above else 0.3
    return [(int(a * size), int(b * size)) for b in downs for a in steps if abs(a) + abs(b) >= least]
