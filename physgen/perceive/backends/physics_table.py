"""Labels and outlines -> mass, friction and elasticity from the material table.

A thing of an ordinary weight (a billiard ball) gets it. Anything else is weighed: its outline's area, a depth assumed
from its solid, its material's density, at the photo's true scale. Where nobody gave the scale, things of known size
tell it; failing that, the photo is taken to show half a metre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from physgen.materials import Kind, kind
from physgen.outline.outline import Disc, Outline, bounds, mass_properties
from physgen.perceive.roles import Matter, Physics, Rgb, Thing
from physgen.scene.model import Solid

ASSUMED_WIDTH = 0.5
"""m that a photo shows along its longer side when nothing in it tells."""


def table() -> Physics:
    """The backend `table`."""
    return _table


def _table(rgb: Rgb, things: Sequence[Thing], pixels_per_meter: float | None) -> Mapping[int, Matter]:
    kinds = {thing.id: kind(thing.label) for thing in things}
    scale, why = _scale(rgb, things, kinds, pixels_per_meter)
    return {thing.id: _matter(thing, kinds[thing.id], scale, why) for thing in things}


def _scale(
    rgb: Rgb, things: Sequence[Thing], kinds: Mapping[int, Kind], given: float | None
) -> tuple[float, str]:
    """px/m, and a sentence about where it comes from."""
    if given is not None:
        return given, f"at {given:.4g} px/m"
    known = [
        _longest(thing.outline) / size * 1000
        for thing in things
        if not thing.cut and (size := kinds[thing.id].size) is not None
    ]
    if known:
        scale = float(np.median(known))
        return scale, f"at {scale:.0f} px/m, from things of known size"
    scale = max(rgb.shape[:2]) / ASSUMED_WIDTH
    return scale, f"taking the photo to show {ASSUMED_WIDTH:g} m"


def _matter(thing: Thing, what: Kind, scale: float, why: str) -> Matter:
    solid = _solid(thing.outline, what.solid)
    material = what.material
    if what.mass is not None:
        mass, sure, reason = float(what.mass), 0.8, f"an ordinary {what.noun} ({what.source})"
    else:
        volume = _volume(thing.outline, solid) / scale**3 * 1e6
        mass = max(material.density * what.filled * volume, 1e-3)
        sure = 0.4 if what.noun else 0.35 if material.name != "unknown" else 0.15
        stuff = "an unknown material" if material.name == "unknown" else material.name
        hollow = "" if what.filled == 1 else f", {what.filled:.3g} of it filled"
        reason = f"{stuff} of {material.density:g} g/cm³{hollow}, {why}"
    return Matter(float(f"{mass:.3g}"), material.friction, material.elasticity, solid, sure, reason)


def _solid(outline: Outline, said: str | None) -> Solid:
    if not isinstance(outline, Disc):
        return Solid.PLATE
    return Solid(said) if said else Solid.SPHERE


def _volume(outline: Outline, solid: Solid) -> float:
    """px³: a ball; a fifth of its width deep for a disc or hoop; as deep as its narrow side for the rest."""
    area = mass_properties(outline).area
    if isinstance(outline, Disc):
        return area * outline.radius * (4 / 3 if solid is Solid.SPHERE else 0.4)
    return area * min(_sides(outline))


def _sides(outline: Outline) -> tuple[float, float]:
    """px: width and height of the smallest box around it, turned as it likes."""
    if isinstance(outline, Disc):
        return 2 * outline.radius, 2 * outline.radius
    points = np.concatenate([ring.outer for ring in outline.rings]).astype(np.float32)
    (_, (w, h), _) = cv2.minAreaRect(points)
    x0, y0, x1, y1 = bounds(outline)
    return max(float(w), 1e-3 * (x1 - x0)), max(float(h), 1e-3 * (y1 - y0))


def _longest(outline: Outline) -> float:
    return max(_sides(outline))
