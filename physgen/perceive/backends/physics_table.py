"""Backend physics=table: mass, friction, elasticity and rolling from the material
table.

An object with a standard mass (a billiard ball) gets that mass. Other masses follow
from the outline's area, the depth implied by the form, the material's density and the
photo's scale. If the size is typical of the label, they are averaged with the label's
typical mass. A photo of unknown scale is assumed to show half a metre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from physgen.geometry.polygon import Disc, Outline
from physgen.geometry.scale import WEIGHING, assumed_scale, is_assumed, weigh
from physgen.materials import Kind, Material, kind
from physgen.perceive.roles import Matter, PhotoObject, Physics, Rgb
from physgen.perceive.spheres import is_shaded_as_sphere
from physgen.scene.scene import Solid


def table() -> Physics:
    """Return the backend `table`."""
    return _table


def _table(
    rgb: Rgb, objects: Sequence[PhotoObject], pixels_per_meter: float | None
) -> Mapping[int, Matter]:
    kinds = {item.id: kind(item.label) for item in objects}
    side = max(rgb.shape[:2])
    if pixels_per_meter is None:
        value = assumed_scale(side)
    else:
        value = pixels_per_meter
    if is_assumed(value, side):
        maximum = WEIGHING.unscaled_confidence
    else:
        maximum = 1.0
    return {
        item.id: _matter(rgb, item, kinds[item.id], value, maximum) for item in objects
    }


def _matter(
    rgb: Rgb,
    item: PhotoObject,
    noun_kind: Kind,
    pixels_per_meter: float,
    largest: float,
) -> Matter:
    solid = _solid(rgb, item.outline, noun_kind)
    material = noun_kind.material
    mass, confidence, reason = weigh(item.outline, noun_kind, pixels_per_meter)
    return Matter(
        mass=mass,
        friction=material.friction,
        elasticity=material.elasticity,
        rolling=material.rolling,
        solid=solid,
        confidence=min(confidence, largest),
        reason=reason,
        surface=_surface(material),
    )


def _surface(material: Material) -> str:
    """Describe the source of the friction; elasticity and rolling use the same
    material.

    >>> from physgen.materials import kind
    >>> _surface(kind("mug").material)
    'friction of ceramic: estimate'
    """
    if material.name == "unknown":
        return "ordinary friction: the material is unknown"
    return f"friction of {material.name}: {material.surface.split('; ')[0].removeprefix('friction: ')}"


def _solid(rgb: Rgb, outline: Outline, noun_kind: Kind) -> Solid:
    if not isinstance(outline, Disc):
        return Solid.PLATE
    if noun_kind.solid:
        return Solid(noun_kind.solid)
    if is_shaded_as_sphere(rgb, outline):
        return Solid.SPHERE
    return Solid.DISC
