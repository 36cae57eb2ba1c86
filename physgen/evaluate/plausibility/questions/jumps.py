"""Does nothing jump? Each step against those before and after it."""

from __future__ import annotations

import numpy as np

from physgen.evaluate.plausibility.evidence import Asked, Evidence
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.questions.gravity import common
from physgen.evaluate.plausibility.tracks import Array, runs

FEWEST = 6
"""Frames of a track without a gap."""
SURE = 6.0
"""Standard deviations that noise may account for: four places, extrapolated."""
DOUBTFUL = 0.4
"""What counts where the motion around a step is not smooth: two blows in one frame look like a jump."""


def jumps(motion: Motion) -> Asked:
    """The worst step of each thing."""
    found = []
    for k in range(len(motion.tracks.names)):
        for first, last in runs(motion.tracks.seen[:, k]):
            if last - first >= FEWEST:
                found.append(_worst(motion, k, first, last))
    return Asked.of(found, f"no track goes on for {FEWEST} frames")


def _worst(motion: Motion, thing: int, first: int, last: int) -> Evidence:
    steps = motion.steps[first : last - 1, thing]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    pulled = common(motion)
    fall = 0.0 if pulled is None else float(np.hypot(*pulled)) * motion.tracks.step**2 / 2
    worst, frame = 0.0, first
    excess = 0.0
    for k in range(1, len(steps) - 1):
        off = _beyond(steps, k)
        if off <= SURE * motion.sigma[thing]:
            continue
        others = np.concatenate([lengths[max(k - 3, 0) : k], lengths[k + 2 : k + 5]])
        usual = float(others.max(initial=0.0))
        allowed = SURE * float(motion.sigma[thing]) + _shoved(motion, thing, first + k, usual) + fall
        form = motion.tracks.forms[thing]
        size: float = max(usual, 0.3 * form.reach, 10 * float(motion.sigma[thing]), 3.0)
        deviation = max(0.0, off - allowed) / size
        if not _smooth(motion, thing, first + k):
            deviation *= DOUBTFUL
        if deviation > worst:
            worst, frame, excess = deviation, first + k, off
    name = motion.tracks.names[thing]
    if worst == 0:
        return Evidence(0.0, frame, (thing,), f"{name}: each step follows from its neighbours")
    text = f"{name}: is {excess:.1f} px from where it could be at frame {frame + 1}"
    return Evidence(worst, frame + 1, (thing,), text)


def _beyond(steps: Array, k: int) -> float:
    """px by which a step is none that the velocity before, the one after, or a change between the two makes."""
    before = [steps[k - 1]] + ([2 * steps[k - 1] - steps[k - 2]] if k >= 2 else [])
    after = [steps[k + 1]] + ([2 * steps[k + 1] - steps[k + 2]] if k + 2 < len(steps) else [])
    return min(_off(steps[k], a, b) for a in before for b in after)


def _off(point: Array, a: Array, b: Array) -> float:
    along = b - a
    part = np.clip((point - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(point - a - part * along)))


def _shoved(motion: Motion, thing: int, frame: int, usual: float) -> float:
    """px by which something near, or a push, may have sped it up for less than a frame."""
    tracks = motion.tracks
    if motion.was_pushed(thing, tracks.times[frame], tracks.times[frame + 1]):
        return np.inf
    fastest = 0.0
    for other in range(len(tracks.names)):
        if other == thing:
            continue
        gap = motion.clearance.least(thing, other)[max(frame - 1, 0) : frame + 1]
        nearer = max(0.0, float(gap[0] - gap[-1])) if np.isfinite(gap).all() else np.inf
        if gap[-1] <= 2.0 + 1.2 * nearer + 3 * float(np.hypot(motion.sigma[thing], motion.sigma[other])):
            part = motion.steps[max(frame - 1, 0) : frame + 2, other]
            fastest = max(fastest, float(np.nanmax(np.hypot(part[:, 0], part[:, 1]), initial=0.0)))
    return max(0.0, 2 * fastest - usual) if fastest > 1.0 else 0.0


def _smooth(motion: Motion, thing: int, frame: int) -> bool:
    """Whether it moves without any turn for some frames before the step, and after it."""
    before, after = motion.stretch_at(thing, frame), motion.stretch_at(thing, frame + 1)
    return before is not None and after is not None
