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
"""Speed of sound in air, m/s."""


@dataclass(frozen=True)
class ResonatorLimits:
    """Shape classes and the damping of touched objects."""

    lowest: float = 40.0
    """Lowest audible mode, Hz."""
    highest: float = 18_000.0
    """Highest audible mode, Hz. Higher modes would alias."""
    modes: int = 16
    """Maximum number of modes of a body."""
    bar: float = 0.35
    """Maximum ratio of the second longest side to the longest, for a bar."""
    hollow: float = 0.5
    """Maximum share of material in the volume, for a shell."""
    wall: float = 0.06
    """Thickness of a shell's wall over its radius, if the share of material
    is unknown.
    """
    disc: float = 0.1
    """Thickness of a disc or coaster seen from its face, over its radius."""
    edge: float = 0.003
    """Radius of edges and corners, m; estimate."""
    support_thickness: float = 0.025
    """Thickness of a table top, a shelf or a panel, m."""
    support_depth: float = 0.6
    """Depth of a support, invisible in the photo, and minimum length, m."""
    support_efficiency: float = 0.05
    """Radiation efficiency of a panel below its critical frequency: air flows from its
    hills to its valleys; Fahy, chapter 3.
    """
    support_loss: float = 0.04
    """Additional loss factor from the joints of furniture; Cremer, Heckl and
    Petersson.
    """
    content_loss: float = 0.05
    """Additional loss factor from the content of a can or bottle; estimate."""
    touch_loss: float = 0.03
    """Additional loss factor from contact with another object; estimate."""
    modal_mass: float = 0.25
    """Modal mass over mass, for a mode with amplitude 1 at its ends; exact for bars."""


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
"""Materials of supports by words in their names; the default is wood."""


@dataclass(frozen=True)
class Resonator:
    """A body or support as a source of sound."""

    name: str
    material: Material
    frequencies: F64
    """(M,) Hz."""
    mass: float
    """Mass of the vibrating part, kg."""
    area: float
    """Radiating area, m²."""
    surface: Surface
    """The surface in contacts."""
    loss: float
    """Loss factor of the modes."""
    efficiency: float = 1.0
    """Largest radiation efficiency."""

    @property
    def radius(self) -> float:
        """Return the radius of a sphere with the same area, m."""
        return sqrt(self.area / (4 * pi))

    def decay_rates(self, has_contact: bool) -> F64:
        """Return (M,) 1/s: a mode decays by exp(-rate t)."""
        loss = self.loss + (LIMITS.touch_loss if has_contact else 0.0)
        return np.asarray(pi * self.frequencies * loss)

    def radiation(self) -> F64:
        """Return (M,) Pa at 1 m for each m/s of a mode's velocity.

        A vibrating body radiates rho c S sigma v² (Fahy, Sound and Structural
        Vibration, chapter 3); sigma falls with the fourth power below k a = 1.
        """
        size = 2 * pi * self.frequencies / AIR_SPEED * self.radius
        efficiency = self.efficiency * size**4 / (1 + size**4)
        return np.asarray(
            AIR_DENSITY * AIR_SPEED * np.sqrt(self.area * efficiency / (4 * pi))
        )


def world_resonators(scene: Scene, world: World) -> list[Resonator]:
    """Return the resonators of all bodies, then of all walls, in the order of
    `World.surfaces`.
    """
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
    if is_round:
        curvature = radius
    else:
        curvature = LIMITS.edge
    # Scenes have g, acoustics kg.
    mass = body.mass / 1000
    surface = Surface(mass, curvature, solid.young, solid.poisson)
    loss = material.loss
    if label.holds > 0:
        loss += LIMITS.content_loss
    return Resonator(
        body.name, material, frequencies[is_audible], mass, area, surface, loss
    )


def solid_frequencies(solid: Elasticity, width: float, height: float) -> F64:
    """Return the modes of a solid from the box around its outline (m). Its depth equals
    its thickness.

    The proportions decide between a bar and a block.
    """
    long = max(width, height)
    short = min(width, height)
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
    # A wall of thickness t fills 2 t / radius of a cylinder.
    if label.filled > 0:
        thickness = radius * label.filled / 2
    else:
        thickness = radius * LIMITS.wall
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
    """Return the material of a support from its name."""
    words = name.lower().replace("-", " ").replace("_", " ").split()
    for word in words:
        for key, material in SUPPORT_MATERIALS.items():
            if word.startswith(key):
                return kind(material).material
    named = kind(" ".join(words)).material
    if named.name == "unknown":
        return kind("wood").material
    return named


def _elasticity(material: Material) -> Elasticity:
    return Elasticity(material.young * GIGA, material.poisson, material.density * 1000)


def _sides(body: Body, meters: float) -> tuple[float, float]:
    """Return width and height of the box around a body's outline (m), in the body's
    frame.
    """
    if body.radius is not None:
        return 2 * body.radius * meters, 2 * body.radius * meters
    width, height = _extent(body.rings)
    return max(width * meters, MIN_SIDE), max(height * meters, MIN_SIDE)


MIN_SIDE = 1e-4
"""Minimum side of an outline, m."""


def _extent(lines: Sequence[Points]) -> tuple[float, float]:
    """Return width and height of the box around all points."""
    width, height = np.ptp(np.concatenate(lines), axis=0).tolist()
    return width, height
