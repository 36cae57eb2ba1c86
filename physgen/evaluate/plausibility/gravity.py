"""Do all flights fall alike, at all times? Seen from the side."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Answer, Evidence
from physgen.evaluate.plausibility.motion import Motion, Segment
from physgen.evaluate.plausibility.tracks import Array
from physgen.scene.scene import View

FEWEST = 6
"""Frames of a flight."""
SHORTEST = 0.18
"""s of a flight."""
PLUMB = np.sin(np.radians(10))
"""What falls on a straight line within this of the picture's vertical may fly; else it may slide."""
EQUAL = 9.0
"""Squared errors, in squared noise, by which one explanation must be better than another."""
SURE = 2.5
"""Standard deviations that noise may account for."""
DOWN, UP = 1.0, -1.0
"""Along y, in the picture."""
LIFT = 0.5
"""Of gravity: what is pulled upwards by less may lean on something."""


def gravity(motion: Motion) -> Answer:
    """Each flight's acceleration against the median of all flights' (by length), and against itself over its time.

    What flies as freely, but is pulled upwards, is judged by the same.
    """
    if motion.tracks.view is View.TOP:
        return Answer((), "seen from above: gravity presses on the table")
    if motion.tracks.flat:
        return Answer((), "the scene has no gravity")
    pulled = common(motion)
    if pulled is None:
        return Answer((), "nothing flies freely for long enough")
    size = float(np.hypot(*pulled))
    lifted = [(k, s) for k, s in flights(motion, UP) if np.hypot(*s.acceleration) > LIFT * size]
    return Answer.of([_judged(motion, k, s, pulled, size) for k, s in (*flights(motion), *lifted)], "")


def common(motion: Motion) -> Array | None:
    """(2,) px/s²: the median of the flights' accelerations, each as heavy as it is long; None where nothing flies."""
    found = flights(motion)
    if not found:
        return None
    accelerations = np.array([s.acceleration for _, s in found])
    weights = np.array([s.count for _, s in found], np.float64)
    return np.array([_median(accelerations[:, k], weights) for k in (0, 1)])


def flights(motion: Motion, way: float = DOWN) -> list[tuple[int, Segment]]:
    """Bodies and their flights, all that are pulled one `way`; what is guided, as a pendulum is, has none."""
    if motion.tracks.view is View.TOP or motion.tracks.flat:
        return []
    return [
        (k, s)
        for k in range(len(motion.tracks.names))
        if not _guided(motion, k)
        for s in motion.stretches[k]
        if flies(motion, k, s, way)
    ]


def _guided(motion: Motion, body: int) -> bool:
    """Whether its acceleration changes without a blow again and again: gravity may change once, a rope turns on."""
    smooth = 0
    for turn in motion.turns[body]:
        a, b = turn.before, turn.after
        off = float(np.hypot(*(a.acceleration - b.acceleration)))
        error = float(np.hypot(a.acceleration_error, b.acceleration_error))
        size = max(float(np.hypot(*a.acceleration)), float(np.hypot(*b.acceleration)))
        moves = max(float(np.hypot(*turn.arrives)), float(np.hypot(*turn.leaves))) * motion.tracks.step > 0.5
        smooth += not turn.sudden and moves and off > 3 * error and off > 0.15 * size
    return smooth >= 2


def flies(motion: Motion, body: int, stretch: Segment, way: float = DOWN) -> bool:
    """Whether a stretch is surely a flight: curved or plumb, touched by nothing that is known, smooth all along."""
    tracks = motion.tracks
    if not motion.free(body) or stretch.count < FEWEST or (stretch.count - 1) * tracks.step < SHORTEST:
        return False
    first, last = tracks.times[stretch.first], tracks.times[stretch.last]
    if motion.was_pushed(body, first, last) or not _falls(motion, body, stretch, way):
        return False
    spin = motion.spin(body, stretch.first, stretch.last)
    if spin is not None and not spin.steady:  # what nothing touches turns evenly
        return False
    inner = stretch.first + 1, stretch.last - 1
    if any(
        np.nanmin(motion.clearance.least(body, other)[inner[0] : inner[1] + 1], initial=np.inf) < 1.0
        for other in range(len(tracks.names))
        if other != body and tracks.forms[other].reach > 0
    ):
        return False
    return bool(np.nanmin(motion.clearance.to_walls(body)[inner[0] : inner[1] + 1], initial=np.inf) > 0.5)


def _falls(motion: Motion, body: int, stretch: Segment, way: float) -> bool:
    """A parabola, or a plumb line that gets faster or slower that way."""
    sigma, error = float(motion.sigma[body]), stretch.acceleration_error
    a = stretch.acceleration
    size = float(np.hypot(*a))
    if way * a[1] <= 0 or size < 5 * error or size == 0:
        return False
    times = motion.tracks.times[stretch.first : stretch.last + 1]
    bow = size * (times[-1] - times[0]) ** 2 / 8
    if bow < max(5 * sigma, 1.5) or stretch.residual > 2.5:
        return False
    if float(np.hypot(*stretch.jerk)) * (times[-1] - times[0]) / 2 > 0.35 * size + SURE * _bend_error(
        stretch, times
    ):
        return False
    across = abs(a[0]) < PLUMB * size + 2 * error
    goes = stretch.velocity(float(times.mean()))
    speed = float(np.hypot(*goes))
    bent = speed > 0 and abs(a[0] * goes[1] - a[1] * goes[0]) / speed > max(4 * error, 0.25 * size)
    return bool(across or bent)


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    heap = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(heap, heap[-1] / 2))])


def _judged(motion: Motion, body: int, stretch: Segment, pulled: Array, size: float) -> Evidence:
    off = float(np.hypot(*(stretch.acceleration - pulled)))
    # few frames tell little of their own noise, too: Student's t grows about so
    sure = SURE * np.sqrt(2) * (1 + 4 / (stretch.count - 3))
    apart = max(0.0, off - sure * stretch.acceleration_error) / size
    times = motion.tracks.times[stretch.first : stretch.last + 1]
    bend = float(np.hypot(*stretch.jerk)) * (times[-1] - times[0]) / 2
    bent = max(0.0, bend - sure * _bend_error(stretch, times)) / size
    if max(apart, bent) > 0 and _kinked(motion, body, stretch, pulled):
        apart = bent = 0.0
    found = float(np.hypot(*stretch.acceleration))
    name = motion.tracks.names[body]
    frames = f"frames {stretch.first} to {stretch.last}"
    if stretch.acceleration[1] < 0:
        text = f"{name}: is pulled upwards at {found:.0f} px/s² over {frames}, all flights fall at {size:.0f}"
    elif bent > apart:
        text = f"{name}: its fall changes by {bend / size:.0%} of gravity over {frames}"
    else:
        text = f"{name}: falls at {found:.0f} px/s² over {frames}, all flights at {size:.0f}"
    return Evidence(max(apart, bent), (stretch.first + stretch.last) // 2, (body,), text)


def _kinked(motion: Motion, body: int, stretch: Segment, pulled: Array) -> bool:
    """Whether a fall as all others' with one small blow in it explains the places as well."""
    rows = slice(stretch.first, stretch.last + 1)
    s = motion.tracks.times[rows] - stretch.middle
    path = motion.tracks.places[rows, body]
    off = path - np.outer(s * s / 2, pulled)
    left = float(((path - np.array([stretch.place(t) for t in motion.tracks.times[rows]])) ** 2).sum())
    best = np.inf
    for at in (s[1:-2] + s[2:-1]) / 2:
        columns = np.stack([np.ones(len(s)), s, np.maximum(s - at, 0.0)], axis=1)
        best = min(best, float(((off - columns @ (np.linalg.pinv(columns) @ off)) ** 2).sum()))
    return best <= left + EQUAL * float(motion.sigma[body]) ** 2


def _bend_error(stretch: Segment, times: Array) -> float:
    return float(stretch.jerk_error * (times[-1] - times[0]) / 2)
