"""Backend light=shading: one distant light and ambient light from the shading of objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.maps.lambert import estimate_light
from physgen.perceive.roles import Intrinsics, Labels, Light, LightGuess, PhotoObject, Rgb
from physgen.photometry import DistantLight

FROM_ABOVE = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)
"""Where lamps and skies mostly are: above and before the scene."""
EVEN = 1.2
"""Shading of a surface that faces the light."""
LEAST = 0.1
"""Of the differences of light, that must be explained for the light to be told."""
ENOUGH = 0.2
"""Of the same, from which on only rivals make the light unsure: prints and reflections leave much unexplained."""


def shading() -> Light:
    """The backend `shading`."""
    return _shading


def _shading(
    rgb: Rgb,
    labels: Labels,
    things: Sequence[PhotoObject],
    normals: NDArray[np.float32],
    intrinsics: Intrinsics,
) -> LightGuess:
    found = estimate_light(rgb, labels, things, normals) if things else None
    if found is None or (found.explained < LEAST and found.spots < 2):
        return LightGuess(
            FROM_ABOVE, 0.1, "no thing's shading shows the light; taken to come from above and the front"
        )
    light = _scaled(found.light)
    rival = max((score for _, score in found.others), default=0.0)
    told = min(1.0, (found.explained + 0.05 * found.spots) / ENOUGH)
    known = min(1.0, found.trust + 0.2 * found.spots)
    sure = round(0.1 + 0.8 * told * (known * (1 - rival)) ** 0.5, 2)
    rivals = tuple((_scaled(one), score) for one, score in found.others)
    spots = f" and {found.spots} highlights" if found.spots > 1 else ""
    reason = f"fitted to how things are shaded{spots} ({found.explained:.0%} explained)"
    return LightGuess(light, sure, reason, rivals)


def _scaled(light: DistantLight) -> DistantLight:
    """Where it falls straight, a surface shows its own colour."""
    total = light.intensity + light.ambient
    return DistantLight(light.direction, EVEN * light.intensity / total, EVEN * light.ambient / total)
