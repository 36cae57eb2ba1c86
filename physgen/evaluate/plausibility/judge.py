"""Judge tracks: evidence against each law of motion, one score, and the report.

A deviation is 0 if noise explains the whole fault, and grows with the fault, as a part
of the right value. Each question finds the deviations of all its instances: flights,
impacts, pairs, bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from physgen.evaluate.measure import Bar, Findings, Section, Table, number
from physgen.evaluate.plausibility.motion import Impact, Motion, Turn
from physgen.evaluate.plausibility.segments import Segment, find_runs
from physgen.evaluate.plausibility.tracks import Array, Tracks
from physgen.messages import Message
from physgen.scene.scene import View
from physgen.text import counted

EVEN = 0.5
"""Maximum score of a wrong clip."""
MIN_FRAMES = 8
"""Minimum number of frames. In shorter clips, noise hides the motion."""
MIN_TRACK = 6
"""Minimum number of frames in a track with jumps."""
SHOWN_EVIDENCE = 20
"""Number of instances of a question in the JSON, the worst first."""


@dataclass(frozen=True)
class Tuning:
    """Constants from the calibration in benchmarks/plausibility."""

    certainty: float = 2.5
    """Standard deviations that noise can explain."""
    exponent: float = 3.0
    """Exponent of the score: it falls to 1/9 at twice the middle."""
    lift: float = 0.5
    """Minimum upward acceleration of a fault over gravity. A body with less may lean on
    something.
    """
    mass_factor: float = 1.05
    """Maximum error factor of a ratio of known masses."""
    area_factor: float = 12.0
    """Maximum error factor of a ratio of masses from areas."""
    spin: float = 0.1
    """Maximum gain of a round body from its spin, over its energy."""
    slow_part: float = 0.3
    """Share of a body's usual speeds. Slower impacts are compared with it."""
    jump: float = 6.0
    """Standard deviations of a step from four extrapolated places."""
    rough_weight: float = 0.4
    """Weight of a jump in rough motion: two impacts in one frame look like a jump."""


TUNING = Tuning()


@dataclass(frozen=True)
class Evidence:
    """One instance of a question."""

    deviation: float
    frame: int
    """The worst frame."""
    bodies: tuple[int, ...]
    """Indices of bodies."""
    text: str
    """The instance and its size, in words."""


# ---- questions


def ask_gravity(motion: Motion) -> list[Evidence]:
    """Compare each flight's acceleration with the median of all."""
    gravity = motion.gravity
    if gravity is None:
        return []
    # All flights of one clip have one gravity, whatever it is: the median of all needs
    # no scale.
    size = float(np.hypot(*gravity))
    evidence = []
    for k, flight in motion.flights:
        acceleration = float(np.hypot(*flight.acceleration))
        is_upward = flight.acceleration[1] < 0
        if is_upward and acceleration < TUNING.lift * size:
            continue
        # The error of a vector with the same error along both axes.
        factor = TUNING.certainty * np.sqrt(2) * _few_frames_factor(flight)
        error = factor * flight.error(flight.middle, 2)
        excess = float(np.hypot(*(flight.acceleration - gravity))) - error
        deviation = 0.0
        if excess > 0 and not _has_hidden_impact(motion, k, flight, gravity):
            deviation = excess / size
        verb = "is pulled upwards" if is_upward else "falls"
        frames = f"frames {flight.first} to {flight.last}"
        text = f"{motion.tracks.names[k]}: {verb} at {acceleration:.0f} px/s² over {frames}, all flights at {size:.0f}"
        frame = (flight.first + flight.last) // 2
        evidence.append(Evidence(deviation, frame, (k,), text))
    return evidence


def _has_hidden_impact(
    motion: Motion, body: int, flight: Segment, gravity: Array
) -> bool:
    """Return whether a normal fall with a small impact in it also explains
    the places.
    """
    rows = slice(flight.first, flight.last + 1)
    path = motion.tracks.places[rows, body]
    s = motion.tracks.times[rows] - flight.middle
    ones = np.ones_like(s)
    powers = np.stack([ones, s, s * s / 2], axis=1)
    parabola = powers @ flight.terms
    flight_error = float(((path - parabola) ** 2).sum())
    # Less the fall, the path of a normal flight is straight, and bends at an impact.
    straight_path = path - np.outer(s * s / 2, gravity)
    best_error = np.inf
    # An impact may be between any two frames.
    for time in (s[1:-2] + s[2:-1]) / 2:
        # A line, and a second slope from the impact on.
        columns = np.stack([ones, s, np.maximum(s - time, 0.0)], axis=1)
        terms = np.linalg.pinv(columns) @ straight_path
        deviations = straight_path - columns @ terms
        best_error = min(best_error, float((deviations**2).sum()))
    # Three standard deviations: a bend that explains the path nearly as well.
    return best_error <= flight_error + 9 * float(motion.sigma[body]) ** 2


def _few_frames_factor(segment: Segment) -> float:
    """Return a factor of errors: few frames reveal little of their own noise. Student's
    t grows similarly.
    """
    return 1 + 4 / max(segment.count - 3, 1)


MASS_RATIOS = 121
"""Number of mass ratios to try."""


def ask_momentum(motion: Motion) -> list[Evidence]:
    """Return the missing momentum over the passing momentum in each impact of two free
    bodies.
    """
    evidence = []
    for impact in motion.impacts:
        is_measured = all(_is_measured(motion, part) for part in impact.parts)
        if len(impact.parts) < 2 or not is_measured:
            continue
        missing = _missing_momentum(motion.tracks, impact)
        names = _join_names(motion.tracks, impact.bodies)
        changes = " and ".join(f"{np.hypot(*part.change):.0f}" for part in impact.parts)
        text = f"{names}: change by {changes} px/s, {missing:.0%} of the momentum that passes is missing"
        evidence.append(Evidence(missing, impact.frame, impact.bodies, text))
    return evidence


def _missing_momentum(tracks: Tracks, impact: Impact) -> float:
    """Return the smallest missing share of momentum for any possible ratio of the
    masses.
    """
    first, second = impact.parts
    factor, masses = TUNING.mass_factor, tracks.masses
    if masses is None:
        factor = TUNING.area_factor
        # Without masses, the square of the reach stands for them; points count as
        # equal.
        masses = np.array([outline.reach**2 or 1.0 for outline in tracks.forms])
    # Masses from a film are uncertain: every ratio in a range is possible.
    ratio = float(masses[second.body] / masses[first.body])
    ratios = ratio * np.geomspace(1 / factor, factor, MASS_RATIOS)
    # By conservation of momentum, both changes times their masses cancel.
    momenta = first.change[:, None] + ratios * second.change[:, None]
    total = np.hypot(*momenta)
    error = TUNING.certainty * np.hypot(first.error(), ratios * second.error())
    # The momentum that one body gives and the other takes.
    passed = np.hypot(*first.change) + ratios * np.hypot(*second.change)
    return float(np.min(np.maximum(0.0, total - error) / passed))


def _join_names(tracks: Tracks, bodies: Sequence[int]) -> str:
    return " and ".join(tracks.names[k] for k in bodies)


def _is_measured(motion: Motion, part: Turn) -> bool:
    """Return whether no other force acts on a body, and its velocities are known."""
    # Frames between the segments may contain another impact.
    is_continuous = part.after.first <= part.before.last + 1
    is_one_segment = part.before is part.after
    if not motion.is_movable(part.body) or is_one_segment or not is_continuous:
        return False
    if motion.tracks.view is View.TOP or motion.tracks.is_weightless:
        return True
    gravity = motion.gravity
    if gravity is None:
        return False
    return all(
        _is_free_fall(segment, part.time, gravity)
        for segment in (part.before, part.after)
    )


def _is_free_fall(segment: Segment, time: float, gravity: Array) -> bool:
    """Return whether an acceleration is precise and equals gravity."""
    size = float(np.hypot(*gravity))
    error = segment.error(time, 2)
    deviation = np.hypot(*(segment.acceleration - gravity))
    return bool(error < 0.2 * size and deviation < 0.2 * size + 2 * error)


class _Gain(NamedTuple):
    """Speeds before and after an impact, along the change of velocity."""

    deviation: float
    """Excess of the speed after the impact, over the speed before."""
    parting: float
    """px/s."""
    closing: float
    """px/s."""


NO_GAIN = _Gain(0.0, 0.0, 0.0)


def ask_energy(motion: Motion) -> list[Evidence]:
    """Compare speeds before and after each impact of round bodies, less the
    energy that spin may give.
    """
    evidence = []
    for impact in motion.impacts:
        visible_parts = []
        for part in impact.parts:
            if part.is_visible:
                visible_parts.append(part)
        forms = motion.tracks.forms
        if not all(forms[part.body].is_round for part in visible_parts):
            continue
        if not motion.tracks.bumped_bodies.isdisjoint(impact.bodies):
            continue
        # Each body against a resting partner, such as a wall.
        gain = max(_own_gain(motion, part) for part in visible_parts)
        if len(impact.parts) == 2:
            # They may have hit each other, or untracked bodies: the smaller gain
            # counts.
            gain = min(gain, _relative_gain(motion, impact))
        names = _join_names(motion.tracks, impact.bodies)
        parting = max(gain.parting, 0)
        closing = max(gain.closing, 0)
        text = f"{names}: parts at {parting:.0f} px/s, came at {closing:.0f} px/s"
        evidence.append(Evidence(gain.deviation, impact.frame, impact.bodies, text))
    return evidence


def _own_gain(motion: Motion, part: Turn) -> _Gain:
    """Return the gain of one body against a resting partner."""
    return _gain(
        part.velocity_before,
        part.velocity_after,
        part.error(),
        _spin_energy(part),
        _usual_speed(motion, part.body),
    )


def _relative_gain(motion: Motion, impact: Impact) -> _Gain:
    """Return the gain of two bodies against each other."""
    first, second = impact.parts
    usual_speeds = [_usual_speed(motion, part.body) for part in impact.parts]
    return _gain(
        first.velocity_before - second.velocity_before,
        first.velocity_after - second.velocity_after,
        float(np.hypot(first.error(), second.error())),
        _spin_energy(first) + _spin_energy(second),
        max(usual_speeds),
    )


def _spin_energy(part: Turn) -> float:
    """Return the squared speed that a body's spin may add, px²/s²."""
    velocity = part.velocity_before
    return TUNING.spin * float(velocity @ velocity) * part.is_visible


def _gain(
    before: Array, after: Array, error: float, spin_energy: float, usual_speed: float
) -> _Gain:
    """Return the gain from the velocities (2,) px/s before and after an impact.

    `error` belongs to the change, px/s; `spin_energy` px²/s² may be added;
    `usual_speed` px/s is the body's.
    """
    change = after - before
    size = float(np.hypot(*change))
    if size == 0:
        return NO_GAIN
    # Only the speed along the change of velocity takes part in the impact.
    closing = float(-before @ change) / size
    parting = float(after @ change) / size
    allowed_speed = np.sqrt(max(closing, 0.0) ** 2 + spin_energy)
    # Newton's law with e = 1, and the energy that spin can turn into speed.
    excess = max(0.0, parting - allowed_speed - TUNING.certainty * error)
    # The noise of a slow impact is large against its own speed.
    deviation = excess / max(closing, TUNING.slow_part * usual_speed)
    return _Gain(deviation, parting, closing)


def _usual_speed(motion: Motion, body: int) -> float:
    """Return a high but repeated speed of a body, px/s."""
    lengths = np.hypot(*motion.steps[:, body].T)
    return max(float(np.nanquantile(lengths, 0.9)), 1.0) / motion.tracks.step


def ask_overlap(motion: Motion) -> list[Evidence]:
    """Return the depth of each close pair beyond the depth of the first frames, over
    the smaller width.
    """
    tracks = motion.tracks
    evidence = []
    paths = [_dense_path(motion, k) for k in range(len(tracks.names))]
    for pair in combinations(range(len(tracks.names)), 2):
        # The gap is negative for bodies in each other. Outlines are inexact: the depth
        # in the first frames counts as none.
        gap = motion.gap(*pair)
        width = min(tracks.forms[k].width for k in pair)
        is_guided = set(pair) <= tracks.guided_bodies or motion.passes(*pair)
        if is_guided or width <= 0 or not np.isfinite(gap).any():
            continue
        # Fast bodies may pass through each other between two frames.
        depth, frame = _greatest_depth(motion, pair, gap, paths)
        is_distant = np.nanmin(gap) > motion.margin(*pair, 0, len(gap) - 1)
        if depth <= 0 and is_distant:
            continue
        excess = _excess_depth(motion, pair, gap, depth)
        names = _join_names(tracks, pair)
        text = f"{names}: {depth:.1f} px deep in each other at frame {frame}"
        evidence.append(Evidence(excess / width, frame, pair, text))
    return evidence


def _greatest_depth(
    motion: Motion, pair: tuple[int, int], gap: Array, paths: Sequence[Array]
) -> tuple[float, int]:
    """Return the greatest depth of a pair, px, and its frame; between frames too for
    two discs.
    """
    depth = float(-np.nanmin(gap))
    frame = int(np.nanargmin(gap))
    first, second = (motion.tracks.forms[k] for k in pair)
    if first.is_round and second.is_round:
        # The distance of two discs is exact at any time between frames; other shapes
        # would need their angles there.
        distances = np.hypot(*(paths[pair[0]] - paths[pair[1]]).T)
        depths = first.reach + second.reach - distances
        if np.nanmax(depths, initial=-np.inf) > depth:
            depth = float(np.nanmax(depths))
            frame = int(np.nanargmax(depths)) // MOMENTS
    return depth, frame


def _excess_depth(
    motion: Motion, pair: tuple[int, int], gap: Array, depth: float
) -> float:
    """Return the depth (px) beyond that of the first frames and beyond noise."""
    first_gaps = gap[np.isfinite(gap)][:2]
    # Masks that overlap at the start have wrong outlines, not a wrong motion.
    first_depth = max(0.0, -float(first_gaps.min()))
    noise = motion.distance_noise(*pair)
    return max(0.0, depth - 1.2 * first_depth - 3 * noise - 1.0)


MOMENTS = 4
"""Number of compared moments per frame."""


def _dense_path(motion: Motion, body: int) -> Array:
    """Return places at and between frames, (MOMENTS (T - 1) + 1, 2) px.

    They are NaN at the end of a segment, because a hit body turns there.
    """
    path = motion.tracks.places[:, body]
    frames = np.arange(len(path))
    ticks = np.arange(MOMENTS * (len(path) - 1) + 1) / MOMENTS
    axes = [np.interp(ticks, frames, path[:, axis]) for axis in (0, 1)]
    dense_path = np.stack(axes, axis=1)
    for segment in motion.segments[body]:
        # A straight line through an impact would cut the corner.
        dense_path[MOMENTS * segment.last + 1 : MOMENTS * (segment.last + 1)] = np.nan
    return dense_path


def ask_jumps(motion: Motion) -> list[Evidence]:
    """Return the worst step of each track."""
    evidence = []
    for k in range(len(motion.tracks.names)):
        for first, last in find_runs(motion.tracks.visible[:, k]):
            if last - first >= MIN_TRACK:
                evidence.append(_worst_step(motion, k, first, last))
    return evidence


def _worst_step(motion: Motion, body: int, first: int, last: int) -> Evidence:
    """Return the evidence of a body's worst step in a run of frames."""
    noise = TUNING.jump * float(motion.sigma[body])
    steps = motion.steps[first : last - 1, body]
    worst, frame, distance = 0.0, first, 0.0
    # The first and the last step have no neighbours on both sides to compare with.
    for k in range(1, len(steps) - 1):
        offset = _step_offset(steps, k)
        if offset <= noise:
            continue
        deviation = _step_deviation(motion, body, first, k, steps, offset)
        if deviation > worst:
            worst = deviation
            frame = first + k + 1
            distance = offset
    name = motion.tracks.names[body]
    text = f"{name}: is {distance:.1f} px from where it could be at frame {frame}"
    return Evidence(worst, frame, (body,), text)


def _step_deviation(
    motion: Motion, body: int, first: int, k: int, steps: Array, offset: float
) -> float:
    """Return the deviation of step `k` after frame `first`; `offset` is the distance
    from possible places, px.
    """
    sigma = float(motion.sigma[body])
    outline = motion.tracks.forms[body]
    lengths = np.hypot(*steps.T)
    # The step itself and its neighbour do not count: they contain the jump.
    lengths_nearby = np.concatenate(
        [lengths[max(k - 3, 0) : k], lengths[k + 2 : k + 5]]
    )
    usual_length = float(lengths_nearby.max(initial=0.0))
    fall = 0.0
    if motion.gravity is not None:
        fall = float(np.hypot(*motion.gravity)) * motion.tracks.step**2 / 2
    allowed = TUNING.jump * sigma + _hidden_push(motion, body, first + k, usual_length)
    allowed += fall
    # A jump counts against the usual step, the size of the body, and the noise.
    scale = max(usual_length, 0.3 * outline.reach, 10 * sigma, 3.0)
    deviation = max(0.0, offset - allowed) / scale
    frames = (first + k, first + k + 1)
    if not all(_is_in_segment(motion, body, frame) for frame in frames):
        # Between segments, a track is rough: a jump there counts less.
        deviation *= TUNING.rough_weight
    return deviation


def _is_in_segment(motion: Motion, body: int, frame: int) -> bool:
    """Return whether a frame belongs to a segment with a velocity."""
    return any(
        segment.has_velocity and segment.first <= frame <= segment.last
        for segment in motion.segments[body]
    )


def _step_offset(steps: Array, k: int) -> float:
    """Return the distance (px) of a step from all steps possible with the velocities
    before and after, or a change of them.
    """
    # Before and after the step, the velocity is constant or changes evenly.
    steps_before = [steps[k - 1]]
    if k >= 2:
        steps_before.append(2 * steps[k - 1] - steps[k - 2])
    steps_after = [steps[k + 1]]
    if k + 2 < len(steps):
        steps_after.append(2 * steps[k + 1] - steps[k + 2])
    offsets = []
    for before in steps_before:
        for after in steps_after:
            change = after - before
            square = max(float(change @ change), 1e-12)
            # Any impact within the frame gives a step between both velocities.
            step_change = steps[k] - before
            part = np.clip(step_change @ change / square, 0.0, 1.0)
            offset = np.hypot(*(step_change - part * change))
            offsets.append(float(offset))
    return min(offsets)


def _hidden_push(motion: Motion, body: int, frame: int, usual_length: float) -> float:
    """Return the possible motion of a body from a near body or a push within a frame,
    px.
    """
    fastest = 0.0
    begin = max(frame - 1, 0)
    for other in range(len(motion.tracks.names)):
        if other == body:
            continue
        gap = motion.gap(body, other)[begin : frame + 1]
        # A partner that was not visible may have come from anywhere.
        approach = np.inf
        if np.isfinite(gap).all():
            approach = max(0.0, float(gap[0] - gap[-1]))
        noise = motion.distance_noise(body, other)
        if gap[-1] <= 2.0 + 1.2 * approach + 3 * noise:
            lengths = np.hypot(*motion.steps[begin : frame + 2, other].T)
            fastest = max(fastest, float(np.nanmax(lengths, initial=0.0)))
    if fastest <= 1.0:
        return 0.0
    # A hit by a much heavier body gives at most twice its speed.
    return max(0.0, 2 * fastest - usual_length)


# ---- verdict


class Question(NamedTuple):
    """A law of motion, and the function for evidence against it."""

    text: str
    middle: float
    """Deviation between right and wrong: the best one of the calibration in
    benchmarks/plausibility.
    """
    ask: Callable[[Motion], list[Evidence]]
    obstacle: str
    """Reason of a clip without an instance of the question."""


QUESTIONS = {
    "gravity": Question(
        "all that flies falls alike",
        0.2,
        ask_gravity,
        "nothing flies freely for long enough",
    ),
    "momentum": Question(
        "bodies that meet push each other",
        0.3,
        ask_momentum,
        "no two free bodies meet alone",
    ),
    "energy": Question(
        "nothing parts faster than it came",
        0.2,
        ask_energy,
        "no impact of round bodies is clear",
    ),
    "overlap": Question(
        "nothing goes through another",
        0.1,
        ask_overlap,
        "no two outlines come near each other",
    ),
    "jumps": Question("nothing jumps", 0.5, ask_jumps, "no track goes on for 6 frames"),
}


def score(question: str, deviation: float) -> float:
    """Return 1 for no deviation, 0.5 at the middle.

    >>> score("gravity", 0.0), round(score("gravity", QUESTIONS["gravity"].middle), 3)
    (1.0, 0.5)
    """
    middle = QUESTIONS[question].middle
    return float(1.0 / (1.0 + (deviation / middle) ** TUNING.exponent))


@dataclass(frozen=True, eq=False)
class Verdict:
    """The verdict on one clip."""

    tracks: Tracks
    motion: Motion
    answers: dict[str, list[Evidence]]
    """The worst first; empty without an instance of a question."""

    def score(self, question: str) -> float | None:
        """Return a score from 0 to 1, or None without an instance of the question."""
        evidence = self.answers.get(question)
        if not evidence:
            return None
        return score(question, evidence[0].deviation)

    @property
    def overall(self) -> float | None:
        """Return the lowest score, or None without any instance."""
        scores = list(map(self.score, self.answers))
        return min((s for s in scores if s is not None), default=None)

    @property
    def is_wrong(self) -> bool | None:
        """Return whether the clip is called wrong, or None without any instance."""
        overall = self.overall
        if overall is None:
            return None
        return overall < EVEN

    @property
    def word(self) -> str:
        """Return the verdict for tables."""
        return {True: "wrong", False: "right", None: "not asked"}[self.is_wrong]

    def faults(self) -> list[tuple[str, Evidence]]:
        """Return question and evidence of all faults, the worst first."""
        scored_evidence = list(self._scored_evidence())
        scored_evidence.sort(key=lambda item: item[0])
        return [
            (name, evidence)
            for value, name, evidence in scored_evidence
            if value < EVEN
        ]

    def _scored_evidence(self) -> Iterator[tuple[float, str, Evidence]]:
        for name, answer in self.answers.items():
            for evidence in answer:
                yield score(name, evidence.deviation), name, evidence

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON."""
        tracks = self.tracks
        gravity = self.motion.gravity
        overall = self.overall
        noise = {}
        for name, sigma in zip(tracks.names, self.motion.sigma, strict=True):
            noise[name] = round(float(sigma), 4)
        rounded_gravity = None
        if gravity is not None:
            rounded_gravity = [round(float(value), 3) for value in gravity]
        return {
            "clip": tracks.name,
            "source": tracks.source,
            "view": tracks.view.value,
            "frames": len(tracks.times),
            "fps": round(1 / tracks.step, 6),
            "bodies": len(tracks.names),
            "noise_px": noise,
            "gravity_px_s2": rounded_gravity,
            "score": None if overall is None else round(overall, 4),
            "verdict": self.word,
            "questions": {name: self._answer(name) for name in self.answers},
        }

    def _answer(self, name: str) -> dict[str, Any]:
        answer = self.answers[name]
        if not answer:
            return {"asked": 0, "score": None, "why_not": QUESTIONS[name].obstacle}
        records = []
        for evidence in answer[:SHOWN_EVIDENCE]:
            records.append(
                {
                    "score": round(score(name, evidence.deviation), 4),
                    "deviation": round(evidence.deviation, 4),
                    "frame": evidence.frame,
                    "time_s": round(float(self.tracks.times[evidence.frame]), 6),
                    "objects": [self.tracks.names[k] for k in evidence.bodies],
                    "text": evidence.text,
                }
            )
        worst = {key: records[0][key] for key in ("score", "deviation")}
        return {"asked": len(answer), **worst, "evidence": records}


def judge(tracks: Tracks, skip: Collection[str] = ()) -> Verdict:
    """Ask all questions except `skip`. Raise InputError for fewer than MIN_FRAMES
    frames.
    """
    if len(tracks.times) < MIN_FRAMES:
        raise Message.MOTION_TOO_SHORT.error(
            tracks.name, f"{len(tracks.times)} frames", least=MIN_FRAMES
        )
    motion = Motion(tracks)
    answers = {}
    for name, question in QUESTIONS.items():
        if name in skip:
            continue
        evidence = question.ask(motion)
        answers[name] = sorted(evidence, key=lambda item: -item.deviation)
    return Verdict(tracks, motion, answers)


# ---- report

SCORE_NOTE = (
    "1: nothing wrong is seen. Below 0.5 a clip is called wrong; its score is that of its worst question. "
    "-: the clip shows nothing that could be asked, which is no success."
)


def findings(verdicts: Sequence[Verdict]) -> Findings:
    """Return the findings of one clip or many."""
    wrong_clips = sum(verdict.is_wrong is True for verdict in verdicts)
    judged_clips = sum(verdict.is_wrong is not None for verdict in verdicts)
    rows = []
    for verdict in verdicts:
        scores = (verdict.overall, *map(verdict.score, QUESTIONS))
        rows.append((verdict.tracks.name, verdict.word, *map(number, scores)))
    table = Table(("clip", "verdict", "score", *QUESTIONS), tuple(rows))
    sentences = [f"{wrong_clips} of {counted(judged_clips, 'clip')} called wrong."]
    names = []
    for verdict in verdicts:
        if verdict.is_wrong is None:
            names.append(verdict.tracks.name)
    if names:
        clips = ", ".join(names[:5])
        sentences.append(f"Nothing could be asked of {clips}: that is no verdict.")
    count = "nothing could be asked"
    if judged_clips:
        count = f"{wrong_clips} of {judged_clips}"
    has_passed = wrong_clips == 0 and judged_clips > 0
    return Findings(
        measure="plausibility",
        title="Is the motion physically possible?",
        sentences=tuple(sentences),
        sections=(
            Section("Scores", (SCORE_NOTE,), (table,)),
            *map(_section, verdicts),
        ),
        rows=[verdict.as_dict() for verdict in verdicts],
        bars=(Bar("clips called wrong", count, "0", has_passed),),
        extra={"even": EVEN},
    )


def _section(verdict: Verdict) -> Section:
    """Return the part of the page about one clip."""
    tracks, sigma = verdict.tracks, verdict.motion.sigma
    view = "the side"
    if tracks.view is View.TOP:
        view = "above"
    facts = (
        f"{tracks.source}; seen from {view}",
        f"{len(tracks.times)} frames, {1 / tracks.step:.4g} a second",
        counted(len(tracks.names), "object"),
        f"noise {sigma.min():.2g} to {sigma.max():.2g} px.",
    )
    rows = []
    for name, answer in verdict.answers.items():
        question = QUESTIONS[name]
        if not answer:
            worst = f"not asked: {question.obstacle}"
        elif answer[0].deviation > 0:
            worst = f"frame {answer[0].frame}: {answer[0].text}"
        else:
            worst = "nothing beyond noise"
        value = number(verdict.score(name))
        rows.append((question.text, str(len(answer)), value, worst))
    table = Table(("what must hold", "asked", "score", "the worst"), tuple(rows))
    return Section(tracks.name, ("; ".join(facts),), (table,))
