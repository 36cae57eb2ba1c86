"""Backend light=shading: one distant light and ambient light from the shading of objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physgen.perceive.maps.lambert import estimate_light
from physgen.perceive.roles import F32, Intrinsics, Labels, Light, LightGuess, PhotoObject, Rgb
from physgen.photometry import DistantLight

FROM_ABOVE = DistantLight((0.0, -0.6, 0.8), 0.8, 0.4)
"""The usual place of lamps and skies: above and in front of the scene."""


@dataclass(frozen=True)
class _Limits:
    """When the shading of objects shows the light."""

    full: float = 1.2  # shading of a surface that faces the light: there it shows its own colour
    least: float = 0.1  # of the differences of light, that must be explained for a light to be found
    # of the same, from which only rivals make the light unsure: prints and reflections stay unexplained
    enough: float = 0.2


LIMITS = _Limits()


def shading() -> Light:
    """The backend `shading`."""
    return _shading


def _shading(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], normals: F32, intrinsics: Intrinsics
) -> LightGuess:
    found = estimate_light(rgb, labels, objects, normals) if objects else None
    if found is None or (found.explained < LIMITS.least and found.spots < 2):
        reason = "no object's shading shows the light; taken to come from above and the front"
        return LightGuess(FROM_ABOVE, 0.1, reason)
    explained = min(1.0, (found.explained + 0.05 * found.spots) / LIMITS.enough)
    known = min(1.0, found.trust + 0.2 * found.spots)
    sure = round(0.1 + 0.8 * explained * (known * (1 - found.rival)) ** 0.5, 2)
    spots = f" and {found.spots} highlights" if found.spots > 1 else ""
    reason = f"fitted to how objects are shaded{spots} ({found.explained:.0%} explained)"
    total = found.light.intensity + found.light.ambient
    scaled = DistantLight(
        found.light.direction,
        LIMITS.full * found.light.intensity / total,
        LIMITS.full * found.light.ambient / total,
    )
    return LightGuess(scaled, sure, reason)
