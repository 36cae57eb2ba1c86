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
}
"""sRGB, after Okabe and Ito's palette for all kinds of colour vision, lightened for video."""


@dataclass(frozen=True)
class Scales:
    """What a px of overlay stands for; 0: there is nothing of the kind. px are those of the photo."""

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
    """The scales of a clip; `impacts` are their impulses, g·px/s."""
    side = float(max(world.size))
    usual = SCALE.long * side
    speeds = _speeds(world, seen)
    tau = 0.0
    if Overlay.VELOCITY in kinds and speeds.size:
        tau = nearest_round(usual / float(np.percentile(speeds, SCALE.usual)))
        tau = min(tau, largest_round(SCALE.longest * side / float(speeds.max())))
    loads: dict[Load, list[float]] = {load: [] for load in Load}
    if Overlay.FORCES in kinds:
        for push in world.pushes:
            if (
                world.bodies[push.body].motion is Motion.DYNAMIC
                and push.start <= world.duration
            ):
                turning = push.load is Load.TORQUE
                loads[push.load].append(
                    abs(push.torque) if turning else float(np.hypot(*push.vector))
                )
    if Overlay.WEIGHT in kinds:
        pull = float(np.hypot(*world.gravity))
        loads[Load.FORCE] += [
            body.mass * pull for body in world.bodies if body.motion is Motion.DYNAMIC
        ]
    most = {load: max(values, default=0.0) for load, values in loads.items()}
    strongest = max(impacts, default=0.0)
    return Scales(
        velocity=tau,
        force=_per(usual, most[Load.FORCE]),
        impulse=_per(usual, most[Load.IMPULSE]),
        torque=_per(SWEEP, most[Load.TORQUE]),
        ring=_per((RING * side) ** 2, strongest) if Overlay.CONTACTS in kinds else 0.0,
    )


def key_entries(world: World, scale: Scales, kinds: Collection[Overlay]) -> list[Entry]:
    """The key's lines: for each scale, the largest round number in SI units whose sample is not too long."""
    longest = SCALE.sample * max(world.size)
    meter = world.pixels_per_meter
    newton = 1000 * meter  # g·px/s²
    pushed = Overlay.FORCES in kinds and any(
        push.load is Load.FORCE for push in world.pushes
    )
    forces = Overlay.FORCES if pushed else Overlay.WEIGHT
    rows = (
        (Overlay.VELOCITY, None, "velocity", scale.velocity * meter, "m/s", longest),
        (
            forces,
            Load.FORCE,
            "force" if pushed else "weight",
            scale.force * newton,
            "N",
            longest,
        ),
        (
            Overlay.FORCES,
            Load.IMPULSE,
            "impulse",
            scale.impulse * newton,
            "N·s",
            longest,
        ),
        (
            Overlay.FORCES,
            Load.TORQUE,
            "torque",
            scale.torque * newton * meter,
            "N·m",
            SWEEP,
        ),
    )
    found = []
    for kind, load, name, unit_size, unit, most in rows:
        if unit_size > 0:
            value = largest_round(most / unit_size)
            found.append(
                Entry(
                    kind, load, f"{name} {value_text(value, unit)}", value * unit_size
                )
            )
    if scale.ring > 0:
        value = largest_round(
            (0.55 * RING * max(world.size)) ** 2 / (scale.ring * newton)
        )
        size = float(np.sqrt(value * scale.ring * newton))
        found.append(
            Entry(
                Overlay.CONTACTS,
                Load.IMPULSE,
                f"impact {value_text(value, 'N·s')}",
                size,
            )
        )
    return found


def largest_round(value: float) -> float:
    """The largest of 1, 2, 5, 10, 20 ... that is not above a positive value.

    >>> [largest_round(v) for v in (1.0, 4.99, 50.0, 0.07)]
    [1.0, 2.0, 50.0, 0.05]
    """
    power = floor(log10(value) + 1e-12)
    step = value / 10.0**power
    return float(f"{max(k for k in (1, 2, 5) if k <= step * (1 + 1e-9))}e{power}")


def nearest_round(value: float) -> float:
    """The one of 1, 2, 5, 10, 20 ... with the nearest logarithm to a positive value."""
    low = largest_round(value)
    high = largest_round(low * 2.5)
    return low if value * value <= low * high else high


def value_text(value: float, unit: str) -> str:
    """A round number with its unit.

    >>> value_text(0.005, "N·s"), value_text(2000.0, "N"), value_text(0.5, "m/s")
    ('5 mN·s', '2 kN', '0.5 m/s')
    """
    power = floor(log10(value) + 1e-9)
    prefix, by = (
        ("m", 1e3) if power < -1 else ("k", 1e-3) if power > 2 else ("", 1.0)
    )  # the font has no micro sign
    return f"{value * by:g} {prefix}{unit}"


def _per(size: float, most: float) -> float:
    return size / most if most > 0 else 0.0


def _speeds(world: World, seen: Trajectory) -> Array:
    """(K,) px/s: the speeds of what moves in sight."""
    inside = ((seen.poses[..., :2] >= 0) & (seen.poses[..., :2] < world.size)).all(
        axis=-1
    )
    speeds = np.hypot(seen.velocities[..., 0], seen.velocities[..., 1])[inside]
    return np.asarray(speeds[speeds > max(1.0, 0.02 * float(speeds.max(initial=0.0)))])
