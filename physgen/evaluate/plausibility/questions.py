"""The questions on impacts, overlap, jumps and speed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from physgen.evaluate.plausibility.evidence import Answer, Evidence
from physgen.evaluate.plausibility.gravity import common
from physgen.evaluate.plausibility.impacts import Impact, Part, impacts
from physgen.evaluate.plausibility.motion import Motion, Segment
from physgen.evaluate.plausibility.tracks import Array, runs
from physgen.scene.scene import View

SURE = 2.5
"""Standard deviations that noise may account for."""
SPIN = 4
"""Frames before and after a blow that tell how fast a body turns."""
UNSEEN = 0.1
"""Of its energy, at most, that a round body that shows no angle is taken to get out of its spin."""
SLOW = 0.3
"""Of the speeds that a body has at all: slower blows are measured by it."""


def energy(motion: Motion) -> Answer:
    """Each blow: parting over closing speed along the change of velocity, less what spin gave."""
    found = []
    for blow in impacts(motion):
        if any(_spin_energy(motion, part) is None for part in blow.parts):
            continue
        gain = max(_of_one(motion, part) for part in blow.parts if part.shown)
        if len(blow.parts) == 2:
            # who knows whether they touched each other, or each something without a track: the kinder reading counts
            gain = min(gain, _of_two(motion, *blow.parts))
        deviation, parting, closing = gain
        names = " and ".join(motion.tracks.names[k] for k in blow.bodies)
        text = f"{names}: parts at {max(parting, 0):.0f} px/s, came at {max(closing, 0):.0f} px/s"
        found.append(Evidence(deviation, blow.frame, blow.bodies, text))
    return Answer.of(found, "no impact is clear from the frames around it")


def _of_one(motion: Motion, part: Part) -> tuple[float, float, float]:
    spin = _spin_energy(motion, part) or 0.0
    return _gain(part.arrives, part.leaves, part.error, spin, _usual(motion, part.body))


def _of_two(motion: Motion, one: Part, other: Part) -> tuple[float, float, float]:
    spin = (_spin_energy(motion, one) or 0.0) + (_spin_energy(motion, other) or 0.0)
    error = float(np.hypot(one.error, other.error))
    usual = max(_usual(motion, one.body), _usual(motion, other.body))
    return _gain(one.arrives - other.arrives, one.leaves - other.leaves, error, spin, usual)


def _gain(
    arrives: Array, leaves: Array, error: float, spin: float, usual: float
) -> tuple[float, float, float]:
    """How much faster it parts, over closing; both speeds, px/s."""
    change = leaves - arrives
    size = float(np.hypot(*change))
    if size == 0:
        return 0.0, 0.0, 0.0
    closing, parting = float(-arrives @ change) / size, float(leaves @ change) / size
    allowed = np.sqrt(max(closing, 0.0) ** 2 + spin)
    return max(0.0, parting - allowed - SURE * error) / max(closing, SLOW * usual), parting, closing


def _usual(motion: Motion, body: int) -> float:
    """px/s that it is fast at times."""
    steps = motion.steps[:, body]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    lengths = lengths[np.isfinite(lengths)]
    return max(float(np.quantile(lengths, 0.9)), 1.0) / motion.tracks.step


def _spin_energy(motion: Motion, part: Part) -> float | None:
    """px²/s²: twice what turning slower gave, a unit of mass; None where that is unknown.

    Of what is round, and shows no angle, a rolling ball's.
    """
    form = motion.tracks.forms[part.body]
    if not part.shown:
        return 0.0
    first, last = part.before.last, part.after.first
    before = motion.spin(part.body, max(part.before.first, first - SPIN), first)
    after = motion.spin(part.body, last, min(part.after.last, last + SPIN))
    if before is None or after is None:
        return UNSEEN * float(part.arrives @ part.arrives) if form.round else None
    if not form.round and not (before.steady and after.steady):
        return None
    return float(max(0.0, form.gyration**2 * (before.rate**2 - after.rate**2)))


FEWEST = 6
"""Frames of a track without a gap."""
JUMPS_SURE = 6.0
"""Standard deviations that noise may account for: four places, extrapolated."""
DOUBTFUL = 0.4
"""What counts where the motion around a step is not smooth: two blows in one frame look like a jump."""


def jumps(motion: Motion) -> Answer:
    """The worst step of each body."""
    found = []
    for k in range(len(motion.tracks.names)):
        for first, last in runs(motion.tracks.seen[:, k]):
            if last - first >= FEWEST:
                found.append(_worst(motion, k, first, last))
    return Answer.of(found, f"no track goes on for {FEWEST} frames")


def _worst(motion: Motion, body: int, first: int, last: int) -> Evidence:
    steps = motion.steps[first : last - 1, body]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    pulled = common(motion)
    fall = 0.0 if pulled is None else float(np.hypot(*pulled)) * motion.tracks.step**2 / 2
    worst, frame = 0.0, first
    excess = 0.0
    for k in range(1, len(steps) - 1):
        off = _beyond(steps, k)
        if off <= JUMPS_SURE * motion.sigma[body]:
            continue
        others = np.concatenate([lengths[max(k - 3, 0) : k], lengths[k + 2 : k + 5]])
        usual = float(others.max(initial=0.0))
        allowed = JUMPS_SURE * float(motion.sigma[body]) + _shoved(motion, body, first + k, usual) + fall
        form = motion.tracks.forms[body]
        size: float = max(usual, 0.3 * form.reach, 10 * float(motion.sigma[body]), 3.0)
        deviation = max(0.0, off - allowed) / size
        if not _smooth(motion, body, first + k):
            deviation *= DOUBTFUL
        if deviation > worst:
            worst, frame, excess = deviation, first + k, off
    name = motion.tracks.names[body]
    if worst == 0:
        return Evidence(0.0, frame, (body,), f"{name}: each step follows from its neighbours")
    text = f"{name}: is {excess:.1f} px from where it could be at frame {frame + 1}"
    return Evidence(worst, frame + 1, (body,), text)


def _beyond(steps: Array, k: int) -> float:
    """px by which a step is none that the velocity before, the one after, or a change between the two makes."""
    before = [steps[k - 1]] + ([2 * steps[k - 1] - steps[k - 2]] if k >= 2 else [])
    after = [steps[k + 1]] + ([2 * steps[k + 1] - steps[k + 2]] if k + 2 < len(steps) else [])
    return min(_off(steps[k], a, b) for a in before for b in after)


def _off(point: Array, a: Array, b: Array) -> float:
    along = b - a
    part = np.clip((point - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return float(np.hypot(*(point - a - part * along)))


def _shoved(motion: Motion, body: int, frame: int, usual: float) -> float:
    """px by which something near, or a push, may have sped it up for less than a frame."""
    tracks = motion.tracks
    if motion.was_pushed(body, tracks.times[frame], tracks.times[frame + 1]):
        return np.inf
    fastest = 0.0
    for other in range(len(tracks.names)):
        if other == body:
            continue
        gap = motion.clearance.least(body, other)[max(frame - 1, 0) : frame + 1]
        nearer = max(0.0, float(gap[0] - gap[-1])) if np.isfinite(gap).all() else np.inf
        if gap[-1] <= 2.0 + 1.2 * nearer + 3 * float(np.hypot(motion.sigma[body], motion.sigma[other])):
            part = motion.steps[max(frame - 1, 0) : frame + 2, other]
            fastest = max(fastest, float(np.nanmax(np.hypot(part[:, 0], part[:, 1]), initial=0.0)))
    return max(0.0, 2 * fastest - usual) if fastest > 1.0 else 0.0


def _smooth(motion: Motion, body: int, frame: int) -> bool:
    """Whether it moves without any turn for some frames before the step, and after it."""
    before, after = motion.stretch_at(body, frame), motion.stretch_at(body, frame + 1)
    return before is not None and after is not None


KNOWN, GUESSED = 1.05, 12.0
"""Factors by which a ratio of masses may be off: as weighed, and as areas are."""
TRIES = 121


def momentum(motion: Motion) -> Answer:
    """Each meeting of two that are free, seen from above or in flight; what is missing over what was given."""
    pulled = common(motion)
    found = []
    for blow in impacts(motion):
        if len(blow.parts) == 2 and _free(motion, blow, pulled):
            found.append(_judged(motion, blow))
    return Answer.of(found, "no two free bodies meet by themselves")


def _free(motion: Motion, blow: Impact, pulled: Array | None) -> bool:
    side = motion.tracks.view is View.SIDE and not motion.tracks.flat
    if side and pulled is None:
        return False
    for part in blow.parts:
        if not motion.moves[part.body] or part.before is part.after:
            return False
        if part.after.first - part.before.last > 1:  # what lies between may have been another blow
            return False
        if motion.near_wall(part.body, part.before.last, part.after.first):
            return False
        if side and not all(_in_flight(s, pulled) for s in (part.before, part.after)):
            return False
    return True


def _in_flight(stretch: Segment, pulled: Array | None) -> bool:
    assert pulled is not None
    size, error = float(np.hypot(*pulled)), stretch.acceleration_error
    return bool(error < 0.2 * size and np.hypot(*(stretch.acceleration - pulled)) < 0.2 * size + 2 * error)


def _judged(motion: Motion, blow: Impact) -> Evidence:
    one, other = blow.parts
    tracks = motion.tracks
    ratio = float(tracks.masses[other.body] / tracks.masses[one.body])
    off = KNOWN if tracks.weighed else GUESSED
    best, chosen = np.inf, ratio
    for factor in np.geomspace(1 / off, off, TRIES):
        missing = _missing(one, other, ratio * float(factor))
        if missing < best:
            best, chosen = missing, ratio * float(factor)
    pulled = _pulled(motion, one, other)
    names = f"{tracks.names[one.body]} and {tracks.names[other.body]}"
    changes = (
        f"{tracks.names[one.body]} changes by {np.hypot(*one.change):.0f} px/s, "
        f"{tracks.names[other.body]} by {np.hypot(*other.change):.0f} px/s"
    )
    if pulled > best:
        return Evidence(
            pulled, blow.frame, blow.bodies, f"{names}: draw each other nearer as they meet; {changes}"
        )
    masses = "as weighed" if tracks.weighed else f"at masses of 1 to {chosen:.3g}"
    text = f"{names}: {best:.0%} of the momentum that passes is missing, {masses}; {changes}"
    return Evidence(best, blow.frame, blow.bodies, text)


def _missing(one: Part, other: Part, ratio: float) -> float:
    """What both momenta change by, which is nothing in nature, over what passes between them."""
    total = float(np.hypot(*(one.change + ratio * other.change)))
    error = SURE * float(np.hypot(one.error, ratio * other.error))
    passes = float(np.hypot(*one.change) + ratio * np.hypot(*other.change))
    return max(0.0, total - error) / passes


def _pulled(motion: Motion, one: Part, other: Part) -> float:
    """By which part of its change a round body was drawn to the other."""
    if not all(motion.tracks.forms[part.body].round for part in (one, other)):
        return 0.0
    apart = one.place - other.place
    size = float(np.hypot(*apart))
    if size == 0:
        return 0.0
    worst = 0.0
    for part, sign in ((one, 1.0), (other, -1.0)):
        change = float(np.hypot(*part.change))
        if change > 0:
            away = sign * float(part.change @ apart) / size
            worst = max(worst, (-away - SURE * part.error) / change)
    return worst


LONGEST = 0.5
"""s of a gap in a track that can be bridged."""
SHIFTED = 0.4
"""px, root mean square: centroids of what is just about to be hidden are off by some."""
SIDES = (6, 4, 3)
"""Frames on each side of it that the bridge stands on, at most: fewer, where something was hit there."""
PARTS = 4
"""Moments looked at between two frames."""


def overlap(motion: Motion) -> Answer:
    """Each pair that comes near; depth beyond the one of the first frames, in parts of the smaller core."""
    tracks = motion.tracks
    found = []
    for one in range(len(tracks.names)):
        for other in range(one):
            if (other, one) in tracks.given.joined or (one, other) in tracks.given.joined:
                continue
            evidence = _pair(motion, other, one)
            if evidence is not None:
                found.append(evidence)
    return Answer.of(found, "no two bodies with outlines come near each other")


def _pair(motion: Motion, one: int, other: int) -> Evidence | None:
    tracks = motion.tracks
    a, b = tracks.forms[one], tracks.forms[other]
    gap = motion.clearance.most(one, other)
    known = np.isfinite(gap)
    if not known.any():
        return None
    if min(a.thin, b.thin) <= 0:
        return None
    hidden, at_hidden = _hidden(motion, one, other)
    if hidden <= 0 and np.nanmin(motion.clearance.least(one, other)) > motion.margin(
        one, other, 0, len(gap) - 1
    ):
        return None
    start = max(0.0, -float(gap[known][:2].min()))
    depth, frame = float(-gap[known].min()), int(np.flatnonzero(known)[np.argmin(gap[known])])
    between, at = _between(motion, one, other)
    if between > depth:
        depth, frame = between, at
    if hidden > depth:
        depth, frame = hidden, at_hidden
    noise = 3 * float(np.hypot(motion.sigma[one], motion.sigma[other]))
    beyond = max(0.0, depth - 1.2 * start - noise - 1.0)
    names = f"{tracks.names[one]} and {tracks.names[other]}"
    size = min(a.thin, b.thin)
    if beyond == 0:
        return Evidence(0.0, frame, (one, other), f"{names}: come near, and stay apart")
    text = f"{names}: {depth:.1f} px deep in each other at frame {frame}" + (
        f", {start:.1f} px at the start" if start > 0.5 else ""
    )
    return Evidence(beyond / size, frame, (one, other), text)


def _between(motion: Motion, one: int, other: int) -> tuple[float, int]:
    """The deepest between frames in which neither turns suddenly, of discs about both places; and the frame before."""
    tracks = motion.tracks
    cores = [tracks.forms[body].core for body in (one, other)]
    if min(cores) <= 0:
        return 0.0, 0
    reach = sum(cores)
    away: Array = tracks.places[:, one] - tracks.places[:, other]
    turning = np.zeros(len(away) - 1, bool)
    for body in (one, other):
        ends = [s.last for s in motion.stretches[body]]
        turning[[e for e in ends if e < len(turning)]] = True
    depth, frame = 0.0, 0
    for k in range(1, PARTS):
        part = k / PARTS
        far = np.hypot(*((1 - part) * away[:-1] + part * away[1:]).T)
        deep = np.where(turning | ~np.isfinite(far), 0.0, reach - far)
        if deep.max(initial=0.0) > depth:
            frame = int(np.argmax(deep))
            depth = float(deep[frame])
    return depth, frame


def _hidden(motion: Motion, one: int, other: int) -> tuple[float, int]:
    """The deepest while one hides the other: its way goes on smoothly behind it, as nothing that was hit does."""
    tracks = motion.tracks
    cores = [tracks.forms[body].core for body in (one, other)]
    if min(cores) <= 0:
        return 0.0, 0
    reach = sum(cores)
    ways = [_bridged(motion, body) for body in (one, other)]
    away = ways[0] - ways[1]
    far = np.hypot(away[:, 0], away[:, 1])
    gone = ~(tracks.seen[:, one] & tracks.seen[:, other]) & np.isfinite(far)
    if not gone.any():
        return 0.0, 0
    deep = np.where(gone, reach - far, 0.0)
    frame = int(np.argmax(deep))
    return float(deep[frame]), frame


def _bridged(motion: Motion, body: int) -> Array:
    """(T, 2): places, and in short gaps those of the parabola through the frames around it, if there is one."""
    tracks = motion.tracks
    path = tracks.places[:, body].copy()
    known = runs(tracks.seen[:, body])
    for (first, end), (begin, last) in pairwise(known):
        if (begin - end + 1) * tracks.step > LONGEST:
            continue
        for side in SIDES:
            rows = np.concatenate(
                [np.arange(max(first, end - side), end), np.arange(begin, min(last, begin + side))]
            )
            s = tracks.times[rows] - tracks.times[end]
            columns = np.stack([np.ones(len(s)), s, s * s / 2], axis=1)
            terms = np.linalg.pinv(columns) @ tracks.places[rows, body]
            left = tracks.places[rows, body] - columns @ terms
            if len(rows) > 4 and np.sqrt((left**2).mean()) <= 2.5 * motion.sigma[body] + SHIFTED:
                gap = tracks.times[end:begin] - tracks.times[end]
                path[end:begin] = np.stack([np.ones(len(gap)), gap, gap * gap / 2], axis=1) @ terms
                break
    return path


LASTS = 0.5
"""s after a blow, at most, in which spin gives back speed."""
FOLLOW = 2 / 7
"""Of the speed that a ball has lost in blows, its spin gives back: a follow shot (any billiards text)."""


def speeding(motion: Motion) -> Answer:
    """Each stretch that nothing touches: how much faster it ends than it began, over its speed."""
    if motion.tracks.view is View.SIDE:
        return Answer((), "seen from the side: what falls speeds up")
    found = []
    for k in range(len(motion.tracks.names)):
        if not motion.free(k) or k in motion.tracks.given.spun or not motion.moves[k]:
            continue
        for stretch in motion.stretches[k]:
            if stretch.count >= FEWEST and _alone(motion, k, stretch):
                evidence = _speeding_judged(motion, k, stretch, _came_at(motion, k, stretch))
                if evidence is not None:
                    found.append(evidence)
    return Answer.of(found, "nothing moves by itself for long enough")


def _alone(motion: Motion, body: int, stretch: Segment) -> bool:
    tracks = motion.tracks
    if motion.was_pushed(body, tracks.times[stretch.first], tracks.times[stretch.last]):
        return False
    inner = slice(stretch.first + 1, stretch.last)
    gaps = [motion.clearance.to_walls(body)[inner]]
    gaps += [motion.clearance.least(body, k)[inner] for k in range(len(tracks.names)) if k != body]
    return all(np.nanmin(gap, initial=np.inf) > 0.5 + 3 * motion.sigma[body] for gap in gaps)


def _came_at(motion: Motion, body: int, stretch: Segment) -> float:
    """px/s that it ever went, where blows were not long before, else 0: spin may stem from the first of them."""
    first = max(0, stretch.first - int(np.ceil(LASTS / motion.tracks.step)))
    sudden = any(turn.sudden and first <= turn.frame < stretch.first for turn in motion.turns[body])
    vague = any(not s.good and s.last >= first and s.last < stretch.first for s in motion.stretches[body])
    if not (sudden or vague):
        return 0.0
    steps = motion.steps[: stretch.first, body]
    return float(np.nanmax(np.hypot(steps[:, 0], steps[:, 1]), initial=0.0)) / motion.tracks.step


def _speed(motion: Motion, stretch: Segment, frame: int) -> float:
    return float(np.hypot(*stretch.velocity(float(motion.tracks.times[frame]))))


def _speeding_judged(motion: Motion, body: int, stretch: Segment, came: float) -> Evidence | None:
    begin, end = (_speed(motion, stretch, frame) for frame in (stretch.first, stretch.last))
    seconds = (stretch.count - 1) * motion.tracks.step
    if max(begin, end) * seconds < max(2.0, 8 * float(motion.sigma[body])):
        return None
    # few frames tell little of their own noise, too: Student's t grows about so
    error = stretch.acceleration_error * seconds * (1 + 4 / (stretch.count - 3))
    returned = FOLLOW * max(0.0, came - begin)
    gained = max(0.0, end - begin - returned - SURE * error)
    name = motion.tracks.names[body]
    text = f"{name}: {begin:.0f} px/s at frame {stretch.first}, {end:.0f} px/s at frame {stretch.last}"
    usual = max(begin, 0.25 * end)
    return Evidence(gained / usual, stretch.last, (body,), text)
