"""The bodies and supports of a world as resonators: modes, damping and radiation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi, sqrt

import numpy as np

from physgen.arrays import F64, Points
from physgen.compile.world import Body, Wall, World
from physgen.materials import Kind, Material, kind
from physgen.scene.scene import Scene, Solid
from physgen.sound.impact import Surface
from physgen.sound.modes import (
    Elasticity,
    bar_frequencies,
    block_frequencies,
    disc_frequencies,
    long_bar_frequencies,
    plate_frequencies,
    ring_frequencies,
    sphere_frequencies,
)

GIGA = 1e9
AIR_DENSITY = 1.2
"""kg/m³."""
AIR_SPEED = 343.0
"""m/s of sound in air."""


@dataclass(frozen=True)
class ResonatorLimits:
    """Shape classes and the damping of touched objects."""

    lowest: float = 40.0
    """Hz: lower modes are not heard."""
    highest: float = 18_000.0
    """Hz: higher modes are not heard, and would alias."""
    modes: int = 16
    """Of a body, at most."""
    bar: float = 0.35
    """Second longest side over the longest, up to which a solid is a bar."""
    hollow: float = 0.5
    """Share of its volume that is material, up to which an object is a shell."""
    wall: float = 0.06
    """Thickness of a shell's wall over its radius, if the filled share is unknown."""
    disc: float = 0.1
    """Thickness of a disc or coaster seen from its face, over its radius."""
    edge: float = 0.003
    """m: radius of the edges and corners of what is not round; estimate."""
    support_thickness: float = 0.025
    """m of a table top, a shelf or a panel."""
    support_depth: float = 0.6
    """m of a support, which the photo does not show, and least length."""
    support_efficiency: float = 0.05
    """Radiation efficiency of a panel below its critical frequency, where air flows from
    its hills to its valleys; Fahy, chapter 3."""
    support_loss: float = 0.04
    """Loss factor that the joints of furniture add; Cremer, Heckl and Petersson."""
    content_loss: float = 0.05
    """Loss factor that the content of a can or bottle adds; estimate."""
    touch_loss: float = 0.03
    """Loss factor that lying on another object adds; estimate."""
    modal_mass: float = 0.25
    """Of the mass: that of a mode which is 1 at its ends; exact for bars."""


LIMITS = ResonatorLimits()

SUPPORT_MATERIALS = {
    "floor": "wood",
    "ground": "stone",
    "road": "stone",
    "street": "stone",
    "wall": "plaster",
    "cushion": "rubber",
    "ice": "ice",
    "rink": "ice",
}
"""Materials of supports by the words of their names; others are of wood."""


@dataclass(frozen=True)
class Resonator:
    """One body or support that sounds."""

    name: str
    material: Material
    frequencies: F64
    """(M,) Hz."""
    mass: float
    """kg of the part that vibrates."""
    area: float
    """m² that radiate."""
    surface: Surface
    """As a contact meets it."""
    loss: float
    """Loss factor of its modes."""
    efficiency: float = 1.0
    """Largest radiation efficiency."""

    @property
    def radius(self) -> float:
        """Return the radius (m) of the sphere with the same area."""
        return sqrt(self.area / (4 * pi))

    def decay_rates(self, is_touched: bool) -> F64:
        """Return (M,) 1/s: a mode decays by exp(-rate t)."""
        loss = self.loss + (LIMITS.touch_loss if is_touched else 0.0)
        return np.asarray(pi * self.frequencies * loss)

    def radiation(self) -> F64:
        """Return (M,) Pa at 1 m for each m/s of a mode's velocity.

        A vibrating body radiates rho c S sigma v² (Fahy, Sound and Structural Vibration,
        chapter 3); sigma falls with the fourth power below k a = 1.
        """
        size = 2 * pi * self.frequencies / AIR_SPEED * self.radius
        efficiency = self.efficiency * size**4 / (1 + size**4)
        return np.asarray(
            AIR_DENSITY * AIR_SPEED * np.sqrt(self.area * efficiency / (4 * pi))
        )


def world_resonators(scene: Scene, world: World) -> list[Resonator]:
    """Return the resonators of all bodies, then of all walls, in the order of `World.surfaces`."""
    meters = 1 / world.pixels_per_meter
    resonators = []
    for item, body in zip(scene.objects, world.bodies, strict=True):
        label = item.label or item.name
        resonators.append(body_resonator(body, kind(label), meters))
    for wall in world.walls:
        resonators.append(support_resonator(wall, meters))
    return resonators


def body_resonator(body: Body, label: Kind, meters: float) -> Resonator:
    """Return the resonator of a body; `meters` is the size of one px."""
    width, height = _sides(body, meters)
    material = label.material
    solid = _elasticity(material)
    is_round = body.radius is not None
    radius = width / 2
    if body.solid is Solid.SPHERE:
        frequencies = sphere_frequencies(solid, radius, LIMITS.modes)
        area = 4 * pi * radius**2
    elif label.filled < LIMITS.hollow and label.form in ("turned", "hoop", "slab"):
        frequencies = _shell_frequencies(solid, label, width, height)
        area = pi * width * height
    elif is_round:
        thickness = LIMITS.disc * radius
        frequencies = disc_frequencies(solid, radius, thickness, LIMITS.modes)
        area = 2 * pi * radius**2
    else:
        frequencies = solid_frequencies(solid, width, height)
        area = 2 * width * height
    is_audible = (frequencies > LIMITS.lowest) & (frequencies < LIMITS.highest)
    curvature = radius if is_round else LIMITS.edge
    mass = body.mass / 1000
    surface = Surface(mass, curvature, solid.young, solid.poisson)
    loss = material.loss
    if label.holds > 0:
        loss += LIMITS.content_loss
    return Resonator(
        body.name, material, frequencies[is_audible], mass, area, surface, loss
    )


def solid_frequencies(solid: Elasticity, width: float, height: float) -> F64:
    """Return the modes of a solid with a box (m) around its outline, as deep as it is thick.

    It is a bar or a block by its proportions.
    """
    long, short = max(width, height), min(width, height)
    if short > LIMITS.bar * long:
        return block_frequencies(solid, (long, short, short), LIMITS.modes)
    bending = bar_frequencies(solid, long, short, LIMITS.modes)
    compression = long_bar_frequencies(solid, long, LIMITS.modes)
    return np.sort(np.concatenate([bending, compression]))[: LIMITS.modes]


def _shell_frequencies(
    solid: Elasticity, label: Kind, width: float, height: float
) -> F64:
    """Return the modes of a hollow object: waves around its wall."""
    radius = min(width, height) / 2
    # a wall of thickness t fills 2 t / radius of a cylinder
    thickness = radius * label.filled / 2 if label.filled > 0 else radius * LIMITS.wall
    return ring_frequencies(solid, radius, thickness, LIMITS.modes)


def support_resonator(wall: Wall, meters: float) -> Resonator:
    """Return the resonator of a support or wall: a plate of its material."""
    width, height = _extent(wall.chains)
    diagonal = float(np.hypot(width, height)) * meters
    length = max(diagonal, LIMITS.support_depth)
    material = support_material(wall.name)
    solid = _elasticity(material)
    thickness = LIMITS.support_thickness
    sides = (length, LIMITS.support_depth)
    frequencies = plate_frequencies(solid, sides, thickness, LIMITS.modes)
    is_audible = (frequencies > LIMITS.lowest) & (frequencies < LIMITS.highest)
    area = length * LIMITS.support_depth
    mass = area * thickness * solid.density
    surface = Surface(inf, inf, solid.young, solid.poisson)
    loss = material.loss + LIMITS.support_loss
    return Resonator(
        wall.name,
        material,
        frequencies[is_audible],
        mass,
        area,
        surface,
        loss,
        LIMITS.support_efficiency,
    )


def support_material(name: str) -> Material:
    """Return the material of a support by its name."""
    words = name.lower().replace("-", " ").replace("_", " ").split()
    for word in words:
        for key, material in SUPPORT_MATERIALS.items():
            if word.startswith(key):
                return kind(material).material
    named = kind(" ".join(words)).material
    return kind("wood").material if named.name == "unknown" else named


def _elasticity(material: Material) -> Elasticity:
    return Elasticity(material.young * GIGA, material.poisson, material.density * 1000)


def _sides(body: Body, meters: float) -> tuple[float, float]:
    """Return width and height (m) of the box about a body's outline, in the body's frame."""
    if body.radius is not None:
        return 2 * body.radius * meters, 2 * body.radius * meters
    width, height = _extent(body.rings)
    return max(width * meters, MIN_SIDE), max(height * meters, MIN_SIDE)


MIN_SIDE = 1e-4
"""m: thinner outlines are counted as this thick."""


def _extent(lines: Sequence[Points]) -> tuple[float, float]:
    """Return width and height of the box about all points."""
    width, height = np.ptp(np.concatenate(lines), axis=0).tolist()
    return width, height
