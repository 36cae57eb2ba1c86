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
    """Of the picture's longer side: how long an arrow of the most common largest is."""
    longest: float = 0.45
    """Of the picture's longer side: how long any velocity in sight is."""
    sample: float = 0.09
    """Of the picture's longer side: how long an arrow of the key is at most."""
    usual: int = 97
    """Percentile of all speeds that counts as the largest: a rare fast one may be longer than the rest."""


SCALE = ScaleStyle()

RING = 0.04
"""Of the picture's longer side: the radius of the strongest impact's ring."""
SWEEP = 1.6 * np.pi
"""rad: the arc of the strongest torque."""
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
"""sRGB, after Okabe and Ito's palette for all kinds of colour vision, lightened for video."""


@dataclass(frozen=True)
class Scales:
    """What a px of overlay stands for.

    0: there is nothing of the kind. px are those of the photo.
    """

    velocity: float
    """px of arrow a px/s: s, so that an arrow's point is where its object would be after as long, left alone."""
    force: float
    """px a g·px/s²; weights have the same."""
    impulse: float
    """px a g·px/s, of pushes."""
    torque: float
    """rad of arc a g·px²/s²."""
    ring: float
    """px² a g·px/s: the square of an impact's radius; its area shows its impulse."""


@dataclass(frozen=True)
class Entry:
    """A line of the key: what a sample of `size` px, or rad of an arc, stands for."""

    kind: Overlay
    load: Load | None
    text: str
    size: float


def scales(
    world: World, seen: Trajectory, kinds: Collection[Overlay], impacts: Sequence[float]
) -> Scales:
    """Return the scales of a clip; `impacts` are their impulses, g·px/s."""
    side = float(max(world.size))
    usual = SCALE.long * side
    velocity = 0.0
    speeds = _speeds(world, seen)
    if Overlay.VELOCITY in kinds and speeds.size:
        velocity = nearest_round(usual / float(np.percentile(speeds, SCALE.usual)))
        longest = SCALE.longest * side / float(speeds.max())
        velocity = min(velocity, largest_round(longest))
    most = _largest_loads(world, kinds)
    ring_scale = 0.0
    if Overlay.CONTACTS in kinds:
        ring_scale = _per((RING * side) ** 2, max(impacts, default=0.0))
    return Scales(
        velocity=velocity,
        force=_per(usual, most[Load.FORCE]),
        impulse=_per(usual, most[Load.IMPULSE]),
        torque=_per(SWEEP, most[Load.TORQUE]),
        ring=ring_scale,
    )


def _largest_loads(world: World, kinds: Collection[Overlay]) -> dict[Load, float]:
    """Return the largest push of each kind on a moving body, weights among the forces."""
    largest = dict.fromkeys(Load, 0.0)
    if Overlay.FORCES in kinds:
        for push in world.pushes:
            is_dynamic = world.bodies[push.body].motion is Motion.DYNAMIC
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
    """Return the key's lines: for each scale, the largest round number in SI units whose sample is not too long."""
    longest = SCALE.sample * max(world.size)
    meter = world.pixels_per_meter
    newton = 1000 * meter  # g·px/s²
    has_force = any(push.load is Load.FORCE for push in world.pushes)
    force_kind, force_name = Overlay.WEIGHT, "weight"
    if Overlay.FORCES in kinds and has_force:
        force_kind, force_name = Overlay.FORCES, "force"
    velocity, force = scale.velocity * meter, scale.force * newton
    impulse, torque = scale.impulse * newton, scale.torque * newton * meter
    rows: list[tuple[Overlay, Load | None, str, float, str, float]] = [
        (Overlay.VELOCITY, None, "velocity", velocity, "m/s", longest),
        (force_kind, Load.FORCE, force_name, force, "N", longest),
        (Overlay.FORCES, Load.IMPULSE, "impulse", impulse, "N·s", longest),
        (Overlay.FORCES, Load.TORQUE, "torque", torque, "N·m", SWEEP),
    ]
    entries = []
    for kind, load, name, unit_size, unit, most in rows:
        if unit_size > 0:
            value = largest_round(most / unit_size)
            text = f"{name} {value_text(value, unit)}"
            entries.append(Entry(kind, load, text, value * unit_size))
    if scale.ring > 0:
        area = scale.ring * newton
        value = largest_round((0.55 * RING * max(world.size)) ** 2 / area)
        radius = float(np.sqrt(value * scale.ring * newton))
        text = f"impact {value_text(value, 'N·s')}"
        entries.append(Entry(Overlay.CONTACTS, Load.IMPULSE, text, radius))
    return entries


def largest_round(value: float) -> float:
    """Return the largest of 1, 2, 5, 10, 20 ... that is not above a positive value.

    >>> [largest_round(v) for v in (1.0, 4.99, 50.0, 0.07)]
    [1.0, 2.0, 50.0, 0.05]
    """
    power = floor(log10(value) + 1e-12)
    step = value / 10.0**power
    digit = max(k for k in (1, 2, 5) if k <= step * (1 + 1e-9))
    return float(f"{digit}e{power}")


def nearest_round(value: float) -> float:
    """Return the one of 1, 2, 5, 10, 20 ... with the nearest logarithm to a positive value."""
    low = largest_round(value)
    high = largest_round(low * 2.5)
    return low if value * value <= low * high else high


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


def _per(size: float, most: float) -> float:
    return size / most if most > 0 else 0.0


def _speeds(world: World, seen: Trajectory) -> Array:
    """Return (K,) px/s: the speeds of visible moving bodies."""
    places = seen.poses[..., :2]
    inside = ((places >= 0) & (places < world.size)).all(axis=-1)
    speeds = np.hypot(seen.velocities[..., 0], seen.velocities[..., 1])[inside]
    least = max(1.0, 0.02 * float(speeds.max(initial=0.0)))
    return np.asarray(speeds[speeds > least])
