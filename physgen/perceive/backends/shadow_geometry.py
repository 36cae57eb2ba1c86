"""Backend shadow=geometry: shadows removed and the light that casts them.

A light is searched whose shadows, by the simple geometry of `physgen.geometry.shadows`, lie where the photo is darker
than surfaces of its kind nearby, on a floor seen from the side or a table seen from above. They are removed as far as
the photo is dark there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan, degrees, inf

import numpy as np

from physgen.geometry.shadows import Silhouette, shadow_darkness
from physgen.perceive.roles import (
    F32,
    BoundaryGuess,
    Labels,
    LightGuess,
    Matter,
    PhotoObject,
    Rgb,
    Shadow,
    Shadows,
)
from physgen.perceive.shadow.shadow_assignment import shadow_owners
from physgen.perceive.shadow.shadow_fit import fit_light, matched_light
from physgen.perceive.shadow.shadow_removal import edge_ratio, remove_shadows
from physgen.perceive.shadow.silhouettes import (
    join_silhouettes,
    lowest_floor,
    object_silhouettes,
    predicted_darkness,
    typical_size,
)
from physgen.scene.scene import View

CALM = 0.9
"""Share of the slopes of light that removal may leave: a shadow's edges go with it."""


def geometry() -> Shadow:
    """The backend `geometry`."""
    return _geometry


def _geometry(
    background: Rgb,
    coverage: F32,
    labels: Labels,
    objects: Sequence[PhotoObject],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    light: LightGuess,
) -> Shadows:
    top = boundaries.view is View.TOP
    nothing = Shadows(None, None, light.light, 4.0, 4.0, None, 0.0, "no shadow of the objects is seen")

    def at(scale: float, floor: float | None) -> list[Silhouette]:
        return object_silhouettes(labels, objects, matter, boundaries, scale, floor)

    floors = [None] if top else list(dict.fromkeys([None, lowest_floor(boundaries), inf]))
    fit = fit_light(background, coverage, at, floors, light, top=top)
    if fit is None:
        return nothing
    silhouettes = at(1.0, fit.floor)
    dark = np.float32(fit.factor) * predicted_darkness(join_silhouettes(silhouettes), fit.setting)
    clean = remove_shadows(background, coverage, dark, typical_size(silhouettes), top=top)
    if edge_ratio(background, clean, coverage) > CALM:
        return nothing
    casts = [
        (what.id, found[0], np.float32(fit.factor) * found[1])
        for what in silhouettes
        if (found := shadow_darkness(what, fit.setting)) is not None
    ]
    owners = shadow_owners(background, clean, coverage, casts)
    tilt = 4.0 if top else round(degrees(atan(fit.setting.tilt)), 1)
    back = None if fit.setting.backdrop == inf else round(fit.setting.backdrop, 1)
    reason = f"where the objects' shadows lie (correlation {fit.likeness:.2f})"
    sure = round(min(0.9, fit.likeness), 2)
    softness = round(fit.setting.softness, 1)
    return Shadows(clean, owners, matched_light(fit), softness, tilt, back, sure, reason)
