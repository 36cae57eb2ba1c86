"""Scales of overlay arrows and the entries of their key."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import floor, log10

import numpy as np

from physgen.compile.world import World
from physgen.geometry.polygon import Array
from physgen.scene.scene import Load, Motion, Overlay
from physgen.simulate.trajectory import Trajectory


@dataclass(frozen=True)
class ScaleStyle:
    """Sizes of arrows, arcs and rings."""

    long: float = 0.17
    """Length of an arrow of the usual largest value, as a share of the picture's longer
    side.
    """
    longest: float = 0.45
    """Maximum length of a visible velocity, as a share of the longer side."""
    sample: float = 0.09
    """Maximum length of an arrow in the key, as a share of the longer side."""
    usual: int = 97
    """Percentile of all speeds that counts as the largest: a few fast ones may be
    longer.
    """


SCALE = ScaleStyle()

RING = 0.04
"""Radius of the strongest impact's ring, as a share of the picture's longer side."""
SWEEP = 1.6 * np.pi
"""Arc of the largest torque, rad."""
COLOURS = {
    Overlay.OUTLINES: (86, 190, 255),
    Overlay.VELOCITY: (40, 205, 150),
    Overlay.FORCES: (255, 112, 51),
    Overlay.WEIGHT: (214, 164, 255),
    Overlay.TRAILS: (250, 226, 70),
    Overlay.CONTACTS: (255, 255, 255),
    Overlay.BOUNDARIES: (230, 140, 185),
    Overlay.NAMES: (255, 255, 255),
    Overlay.JOINTS: (255, 190, 60),
    Overlay.FIELDS: (90, 200, 220),
}
"""sRGB, after Okabe and Ito's palette for all kinds of colour vision, lightened for
video.
"""


@dataclass(frozen=True)
class Scales:
    """Lengths of marks per unit, px of the photo; 0 for kinds without marks."""

    velocity: float
    """px per px/s, that is, s: an arrow's point is the place of its free object after
    this time.
    """
    force: float
    """px per g·px/s², also for weights."""
    impulse: float
    """px per g·px/s, for pushes."""
    torque: float
    """rad of arc per g·px²/s²."""
    ring: float
    """px² per g·px/s: the square of an impact's radius, so that areas show impulses."""


@dataclass(frozen=True)
class Entry:
    """A line of the key: the value of a sample of `size` px, or rad of an arc."""

    kind: Overlay
    load: Load | None
    text: str
    size: float


def scales(
    world: World,
    motion: Trajectory,
    kinds: Collection[Overlay],
    impacts: Sequence[float],
) -> Scales:
    """Return the scales of a clip; `impacts` are their impulses, g·px/s."""
    side = float(max(world.size))
    usual_length = SCALE.long * side
    velocity = 0.0
    speeds = _speeds(world, motion)
    if Overlay.VELOCITY in kinds and speeds.size:
        velocity = nearest_round(
            usual_length / float(np.percentile(speeds, SCALE.usual))
        )
        # Usual speeds decide the scale, unless the fastest arrow would leave the
        # picture.
        limit = SCALE.longest * side / float(speeds.max())
        velocity = min(velocity, largest_round(limit))
    largest_loads = _largest_loads(world, kinds)
    ring_scale = 0.0
    if Overlay.CONTACTS in kinds:
        ring_scale = _per((RING * side) ** 2, max(impacts, default=0.0))
    return Scales(
        velocity=velocity,
        force=_per(usual_length, largest_loads[Load.FORCE]),
        impulse=_per(usual_length, largest_loads[Load.IMPULSE]),
        torque=_per(SWEEP, largest_loads[Load.TORQUE]),
        ring=ring_scale,
    )


def _largest_loads(world: World, kinds: Collection[Overlay]) -> dict[Load, float]:
    """Return the largest push of each kind on a moving body; weights count as
    forces.
    """
    largest = dict.fromkeys(Load, 0.0)
    if Overlay.FORCES in kinds:
        for push in world.pushes:
            is_dynamic = world.bodies[push.body].motion is Motion.DYNAMIC
            # Pushes without effect in the clip must not shrink the other arrows.
            if not is_dynamic or push.start > world.duration:
                continue
            size = float(np.hypot(*push.vector))
            if push.load is Load.TORQUE:
                size = abs(push.torque)
            largest[push.load] = max(largest[push.load], size)
    if Overlay.WEIGHT in kinds:
        gravity = float(np.hypot(*world.gravity))
        for body in world.bodies:
            if body.motion is Motion.DYNAMIC:
                largest[Load.FORCE] = max(largest[Load.FORCE], body.mass * gravity)
    return largest


def key_entries(world: World, scale: Scales, kinds: Collection[Overlay]) -> list[Entry]:
    """Return the lines of the key, one for each scale.

    Each has the largest round number in SI units with a sample that is not too long.
    """
    entries = []
    for kind, load, name, unit_size, unit, limit in _key_rows(world, scale, kinds):
        if unit_size > 0:
            value = largest_round(limit / unit_size)
            text = f"{name} {value_text(value, unit)}"
            entries.append(Entry(kind, load, text, value * unit_size))
    if scale.ring > 0:
        newton = 1000 * world.pixels_per_meter  # g·px/s²
        area = scale.ring * newton
        value = largest_round((0.55 * RING * max(world.size)) ** 2 / area)
        radius = float(np.sqrt(value * scale.ring * newton))
        text = f"impact {value_text(value, 'N·s')}"
        entries.append(Entry(Overlay.CONTACTS, Load.IMPULSE, text, radius))
    return entries


_KeyRow = tuple[Overlay, Load | None, str, float, str, float]


"""Kind, load, name, size of a unit, unit, and the largest sample of a scale."""


def _key_rows(world: World, scale: Scales, kinds: Collection[Overlay]) -> list[_KeyRow]:
    """Return the scales of arrows and arcs in SI units."""
    length_limit = SCALE.sample * max(world.size)
    # Scales hold per px, g and s. Convert them to metres, newtons and seconds for the
    # key.
    meter = world.pixels_per_meter
    newton = 1000 * meter  # g·px/s²
    has_force = any(push.load is Load.FORCE for push in world.pushes)
    force_kind, force_name = Overlay.WEIGHT, "weight"
    if Overlay.FORCES in kinds and has_force:
        force_kind, force_name = Overlay.FORCES, "force"
    velocity = scale.velocity * meter
    force = scale.force * newton
    impulse = scale.impulse * newton
    torque = scale.torque * newton * meter
    return [
        (Overlay.VELOCITY, None, "velocity", velocity, "m/s", length_limit),
        (force_kind, Load.FORCE, force_name, force, "N", length_limit),
        (Overlay.FORCES, Load.IMPULSE, "impulse", impulse, "N·s", length_limit),
        (Overlay.FORCES, Load.TORQUE, "torque", torque, "N·m", SWEEP),
    ]


def largest_round(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20 ... up to a positive value.

    >>> [largest_round(v) for v in (1.0, 4.99, 50.0, 0.07)]
    [1.0, 2.0, 50.0, 0.05]
    """
    power = floor(log10(value) + 1e-12)
    step = value / 10.0**power
    digit = max(k for k in (1, 2, 5) if k <= step * (1 + 1e-9))
    return float(f"{digit}e{power}")


def nearest_round(value: float) -> float:
    """Return the nearest of 1, 2, 5, 10, 20 ... to a positive value, by logarithms."""
    lower = largest_round(value)
    upper = largest_round(lower * 2.5)
    return lower if value * value <= lower * upper else upper


def value_text(value: float, unit: str) -> str:
    """Return a round number with its unit.

    >>> value_text(0.005, "N·s"), value_text(2000.0, "N"), value_text(0.5, "m/s")
    ('5 mN·s', '2 kN', '0.5 m/s')
    """
    power = floor(log10(value) + 1e-9)
    # The font has no micro sign.
    prefix, factor = "", 1.0
    if power < -1:
        prefix, factor = "m", 1e3
    elif power > 2:
        prefix, factor = "k", 1e-3
    return f"{value * factor:g} {prefix}{unit}"


def _per(size: float, limit: float) -> float:
    """Return a size per unit; 0 without a value."""
    return size / limit if limit > 0 else 0.0


def _speeds(world: World, motion: Trajectory) -> Array:
    """Return the speeds (K,) px/s of visible moving bodies."""
    places = motion.poses[..., :2]
    is_inside = ((places >= 0) & (places < world.size)).all(axis=-1)
    speeds = np.hypot(motion.velocities[..., 0], motion.velocities[..., 1])[is_inside]
    smallest_speed = max(1.0, 0.02 * float(speeds.max(initial=0.0)))
    return np.asarray(speeds[speeds > smallest_speed])
