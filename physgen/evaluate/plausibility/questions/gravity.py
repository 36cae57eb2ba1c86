"""Does all that flies fall alike, at all times? Seen from the side."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.stretches import Stretch
from physgen.evaluate.plausibility.tracks import Array
from physgen.scene.model import View

FEWEST = 6
"""Frames of a flight."""
SHORTEST = 0.18
"""s of a flight."""
PLUMB = np.sin(np.radians(10))
"""What falls on a straight line within this of the picture's vertical may fly; else it may slide."""
SURE = 2.5
"""Standard deviations that noise may account for."""


def gravity(motion: Motion) -> Asked:
    """Each flight's acceleration against the median of all flights' (by length), and against itself over its time."""
    if motion.tracks.view is View.TOP:
        return Asked((), "seen from above: gravity presses on the table")
    if motion.tracks.flat:
        return Asked((), "the scene has no gravity")
    flights = [(k, s) for k in range(len(motion.tracks.names)) for s in motion.stretches[k] if flies(motion, k, s)]
    if not flights:
        return Asked((), "nothing flies freely for long enough")
    common = pull(flights)
    size = float(np.hypot(*common))
    told = [_judged(motion, k, s, common, size) for k, s in flights]
    return Asked.of(told, "")


def flies(motion: Motion, thing: int, stretch: Stretch) -> bool:
    """Whether a stretch is surely a flight: curved or plumb, touched by nothing that is known, smooth all along."""
    tracks = motion.tracks
    if not motion.free(thing) or stretch.count < FEWEST or (stretch.count - 1) * tracks.step < SHORTEST:
        return False
    first, last = tracks.times[stretch.first], tracks.times[stretch.last]
    if motion.was_pushed(thing, first, last) or not _falls(motion, thing, stretch):
        return False
    inner = stretch.first + 1, stretch.last - 1
    if any(
        np.nanmin(motion.clearance.least(thing, other)[inner[0] : inner[1] + 1], initial=np.inf) < 1.0
        for other in range(len(tracks.names))
        if other != thing and tracks.forms[other].reach > 0
    ):
        return False
    return bool(np.nanmin(motion.clearance.to_walls(thing)[inner[0] : inner[1] + 1], initial=np.inf) > 0.5)


def _falls(motion: Motion, thing: int, stretch: Stretch) -> bool:
    """A parabola, or a plumb line that gets faster or slower downwards."""
    sigma, error = float(motion.sigma[thing]), stretch.acceleration_error
    a = stretch.acceleration
    size = float(np.hypot(*a))
    if a[1] <= 0 or size < 5 * error or size == 0:
        return False
    times = motion.tracks.times[stretch.first : stretch.last + 1]
    bow = size * (times[-1] - times[0]) ** 2 / 8
    if bow < max(5 * sigma, 1.5) or stretch.residual > 2.5:
        return False
    if float(np.hypot(*stretch.jerk)) * (times[-1] - times[0]) / 2 > 0.35 * size + SURE * _bend_error(stretch, times):
        return False
    across = abs(a[0]) < PLUMB * size + 2 * error
    way = stretch.velocity(float(times.mean()))
    speed = float(np.hypot(*way))
    bent = speed > 0 and abs(a[0] * way[1] - a[1] * way[0]) / speed > max(4 * error, 0.25 * size)
    return bool(across or bent)


def pull(flights: list[tuple[int, Stretch]]) -> Array:
    """(2,) px/s²: the median of the flights' accelerations, each as heavy as it is long and sure."""
    accelerations = np.array([s.acceleration for _, s in flights])
    weights = np.array([s.count for _, s in flights], np.float64)
    return np.array([_median(accelerations[:, k], weights) for k in (0, 1)])


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(heap, heap[-1] / 2))])


def _judged(motion: Motion, thing: int, stretch: Stretch, common: Array, size: float) -> Evidence:
    off = float(np.hypot(*(stretch.acceleration - common)))
    apart = max(0.0, off - SURE * stretch.acceleration_error * np.sqrt(2)) / size
    times = motion.tracks.times[stretch.first : stretch.last + 1]
    bend = float(np.hypot(*stretch.jerk)) * (times[-1] - times[0]) / 2
    bent = max(0.0, bend - SURE * np.sqrt(2) * _bend_error(stretch, times)) / size
    found = float(np.hypot(*stretch.acceleration))
    name = motion.tracks.names[thing]
    frames = f"frames {stretch.first} to {stretch.last}"
    if bent > apart:
        text = f"{name}: its fall changes by {bend / size:.0%} of gravity over {frames}"
    else:
        text = f"{name}: falls at {found:.0f} px/s² over {frames}, all flights at {size:.0f}"
    return Evidence(max(apart, bent), (stretch.first + stretch.last) // 2, (thing,), text)


def _bend_error(stretch: Stretch, times: Array) -> float:
    return float(stretch.jerk_error * (times[-1] - times[0]) / 2)
