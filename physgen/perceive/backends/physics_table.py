"""Backend physics=table: mass, friction, elasticity and rolling from the material table.

An object of a standard mass (a billiard ball) gets that mass. Other masses follow from the outline's area, the depth
that the form implies, the material's density and the photo's scale; they are averaged with the typical mass of the kind
where the size is about typical. A photo of unknown scale is assumed to show half a metre.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log, pi, sqrt

from physgen.geometry.polygon import Disc, Outline
from physgen.materials import Kind, Material, kind
from physgen.perceive.roles import Matter, PhotoObject, Physics, Rgb
from physgen.perceive.scale import Extent, assumed_scale, object_extent
from physgen.scene.scene import Solid


@dataclass(frozen=True)
class WeighingConstants:
    """Constants of the masses."""

    unscaled: float = 0.3
    """Confidence of a mass, at most, where the scale is assumed."""
    standard: float = 0.05
    """Spread of sizes up to which the kind has one standard mass."""
    like: float = 0.4
    """|log| of the size ratio up to which an object may be the typical one."""
    lightest: float = 1e-3
    """g."""


WEIGHING = WeighingConstants()


def table() -> Physics:
    """The backend `table`."""
    return _table


def _table(rgb: Rgb, objects: Sequence[PhotoObject], pixels_per_meter: float | None) -> Mapping[int, Matter]:
    kinds = {item.id: kind(item.label) for item in objects}
    if pixels_per_meter is not None:
        value, most = pixels_per_meter, 1.0
    else:
        value, most = assumed_scale(max(rgb.shape[:2])), WEIGHING.unscaled
    return {item.id: _matter(item, kinds[item.id], value, most) for item in objects}


def _matter(item: PhotoObject, what: Kind, pixels_per_meter: float, most: float) -> Matter:
    solid, material = _solid(item.outline, what), what.material
    mass, confidence, reason = _mass(object_extent(item.outline, what), what, pixels_per_meter)
    return Matter(
        mass=float(f"{max(mass, WEIGHING.lightest):.3g}"),
        friction=material.friction,
        elasticity=material.elasticity,
        rolling=material.rolling,
        solid=solid,
        confidence=min(confidence, most),
        reason=reason,
        surface=_surface(material),
    )


def _mass(found: Extent, what: Kind, pixels_per_meter: float) -> tuple[float, float, str]:
    """Mass in g, confidence and a sentence."""
    volume = found.volume / pixels_per_meter**3 * 1e6
    what = what.hollowed(10 * (6 * volume / pi) ** (1 / 3))
    weighed = volume * what.density
    estimate = f"{float(f'{volume:.3g}'):,g} cm³ of {_stuff(what)}"
    if what.mass is None:
        return weighed, 0.4 if what.noun else 0.35 if what.material.name != "unknown" else 0.15, estimate
    source = what.source.replace("EST: ", "").replace("EST", "estimated")
    ordinary = f"an ordinary {what.noun} ({source})"
    off = 0.0 if found.per_mm is None else log(found.per_mm * 1000 / pixels_per_meter)
    if abs(off) < WEIGHING.like and what.spread <= WEIGHING.standard:
        return what.mass, 0.8, ordinary
    if abs(off) < WEIGHING.like:
        return (
            sqrt(weighed * what.mass),
            0.6,
            f"between {estimate}, and an ordinary {what.noun}, {what.mass:g} g",
        )
    return weighed, 0.4, f"{estimate}; an ordinary {what.noun} has another size"


def _stuff(what: Kind) -> str:
    """The material, in words.

    >>> from physgen.materials import kind
    >>> _stuff(kind("steel ball")), _stuff(kind("beer bottle"))
    ('steel, 7.85 g/cm³', 'glass and content, 1.19 g/cm³')
    """
    name, solid = _name(what.material.name), what.material.density
    if what.holds:
        return f"{name} and content, {what.density:.3g} g/cm³"
    if abs(what.filled - 1) < 0.01:
        return f"{name}, {solid:g} g/cm³"
    if what.filled > 1:
        return f"{name}, {what.density:.3g} g/cm³ in all"
    return f"{name}, {solid:g} g/cm³ and {100 * what.filled:.2g} % of the volume"


def _surface(material: Material) -> str:
    """The source of friction in words; elasticity and rolling are of the same material.

    >>> from physgen.materials import kind
    >>> _surface(kind("mug").material)
    'friction of ceramic: estimate'
    """
    if material.name == "unknown":
        return "ordinary friction: the material is unknown"
    return f"friction of {material.name}: {material.surface.split('; ')[0].removeprefix('friction: ')}"


def _name(material: str) -> str:
    return "an unknown material" if material == "unknown" else material


def _solid(outline: Outline, what: Kind) -> Solid:
    if not isinstance(outline, Disc):
        return Solid.PLATE
    return Solid(what.solid) if what.solid else Solid.SPHERE
