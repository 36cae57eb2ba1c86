"""Tracks -> what speaks against each law of motion, one score, and the report.

A deviation is 0 where nothing is wrong beyond what noise explains, and grows with what is wrong, in parts of what is
right. Each question finds the deviations of all its instances: of a flight, an impact, a pair, a body.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from physgen.evaluate.measure import Bar, Findings, Section, Table, number
from physgen.evaluate.plausibility.motion import Motion, Segment, Turn, runs
from physgen.evaluate.plausibility.tracks import Array, Tracks
from physgen.problems import InputError
from physgen.scene.scene import View
from physgen.text import counted

EVEN = 0.5
"""Score below which a clip is called wrong."""
FEWEST = 8
"""Frames: with fewer, motion cannot be distinguished from noise."""


@dataclass(frozen=True)
class Tuning:
    """Chosen on the calibration in benchmarks/plausibility."""

    sure: float = 2.5
    """Standard deviations that noise may account for."""
    steep: float = 3.0
    """The score falls to 1/9 at twice the middle."""
    lift: float = 0.5
    """Of gravity: what is pulled upwards by less may lean on something."""
    known: float = 1.05
    guessed: float = 12.0
    """Factors by which a ratio of masses may be off: where masses are known, and as areas are."""
    spin: float = 0.1
    """Of its energy, at most, that a round body is taken to get out of its spin."""
    slow: float = 0.3
    """Of the speeds that a body has at all: slower impacts are measured by it."""
    jump: float = 6.0
    """Standard deviations of a step: four places, extrapolated."""
    doubtful: float = 0.4
    """What a jump counts where the motion around it is not smooth: two impacts in one frame look like a jump."""


TUNING = Tuning()


@dataclass(frozen=True)
class Evidence:
    """One instance of a question."""

    deviation: float
    frame: int
    """Where it is worst."""
    bodies: tuple[int, ...]
    """Indices."""
    text: str
    """What was found, with its size."""


# ---- questions ---------------------------------------------------------------------------------------------------


def gravity(motion: Motion) -> list[Evidence]:
    """Each flight's acceleration against the median of all."""
    pulled, found = motion.gravity, []
    if pulled is None:
        return []
    size = float(np.hypot(*pulled))
    for k, flight in motion.flights:
        own = float(np.hypot(*flight.terms[2]))
        if flight.terms[2, 1] < 0 and own < TUNING.lift * size:
            continue
        sure = TUNING.sure * np.sqrt(2) * _few(flight)
        apart = float(np.hypot(*(flight.terms[2] - pulled))) - sure * flight.error(
            flight.middle, 2
        )
        way = "is pulled upwards" if flight.terms[2, 1] < 0 else "falls"
        frames = f"frames {flight.first} to {flight.last}"
        text = f"{motion.tracks.names[k]}: {way} at {own:.0f} px/s² over {frames}, all flights at {size:.0f}"
        deviation = (
            apart / size
            if apart > 0 and not _kinked(motion, k, flight, pulled)
            else 0.0
        )
        found.append(Evidence(deviation, (flight.first + flight.last) // 2, (k,), text))
    return found


def _kinked(motion: Motion, body: int, flight: Segment, pulled: Array) -> bool:
    """Whether a fall as all others' with one small impact in it explains the places as well."""
    rows = slice(flight.first, flight.last + 1)
    path, s = (
        motion.tracks.places[rows, body],
        motion.tracks.times[rows] - flight.middle,
    )
    left = float(
        (
            (path - np.stack([np.ones_like(s), s, s * s / 2], axis=1) @ flight.terms)
            ** 2
        ).sum()
    )
    off, best = path - np.outer(s * s / 2, pulled), np.inf
    for at in (s[1:-2] + s[2:-1]) / 2:
        columns = np.stack([np.ones_like(s), s, np.maximum(s - at, 0.0)], axis=1)
        best = min(
            best, float(((off - columns @ (np.linalg.pinv(columns) @ off)) ** 2).sum())
        )
    return best <= left + 9 * float(motion.sigma[body]) ** 2


def _few(segment: Segment) -> float:
    """Few frames show little of their own noise, too: Student's t grows about so."""
    return 1 + 4 / max(segment.count - 3, 1)


def momentum(motion: Motion) -> list[Evidence]:
    """Each meeting of two that are free, from above or in flight; what is missing over what passes between them."""
    found = []
    for impact in motion.impacts:
        if len(impact.parts) < 2 or not all(
            _measured(motion, part) for part in impact.parts
        ):
            continue
        one, other = impact.parts
        masses = motion.tracks.masses
        off = TUNING.guessed if masses is None else TUNING.known
        weights = (
            np.array([form.reach**2 or 1.0 for form in motion.tracks.forms])
            if masses is None
            else masses
        )
        ratios = float(weights[other.body] / weights[one.body]) * np.geomspace(
            1 / off, off, 121
        )
        total = np.hypot(*(one.change[:, None] + ratios * other.change[:, None]))
        error = TUNING.sure * np.hypot(one.error(), ratios * other.error())
        passed = np.hypot(*one.change) + ratios * np.hypot(*other.change)
        missing = float(np.min(np.maximum(0.0, total - error) / passed))
        names = " and ".join(motion.tracks.names[k] for k in impact.bodies)
        changes = " and ".join(f"{np.hypot(*part.change):.0f}" for part in impact.parts)
        text = f"{names}: change by {changes} px/s, {missing:.0%} of the momentum that passes is missing"
        found.append(Evidence(missing, impact.frame, impact.bodies, text))
    return found


def _measured(motion: Motion, part: Turn) -> bool:
    """Whether nothing else acts on it, and its velocities are known."""
    if (
        not motion.moves(part.body)
        or part.before is part.after
        or part.after.first > part.before.last + 1
    ):
        return False  # what lies between may have been another impact
    pulled = motion.gravity
    if motion.tracks.view is View.TOP or motion.tracks.flat:
        return True
    if pulled is None:
        return False
    size = float(np.hypot(*pulled))
    errors = [
        (segment.error(part.time, 2), segment.terms[2] - pulled)
        for segment in (part.before, part.after)
    ]
    return all(
        error < 0.2 * size and np.hypot(*off) < 0.2 * size + 2 * error
        for error, off in errors
    )


def energy(motion: Motion) -> list[Evidence]:
    """Each impact of round bodies: parting over closing speed along the change of velocity, less what spin gave."""
    found = []
    for impact in motion.impacts:
        if not all(
            motion.tracks.forms[part.body].round for part in impact.parts if part.shown
        ):
            continue
        spins = [
            TUNING.spin * float(part.arrives @ part.arrives) * part.shown
            for part in impact.parts
        ]
        usual = [_usual(motion, part.body) for part in impact.parts]
        gain = max(
            _gain(part.arrives, part.leaves, part.error(), spin, own)
            for part, spin, own in zip(impact.parts, spins, usual, strict=True)
            if part.shown
        )
        if len(impact.parts) == 2:
            # they touched each other, or each something without a track: the kinder reading counts
            one, other = impact.parts
            error = float(np.hypot(one.error(), other.error()))
            arrives, leaves = one.arrives - other.arrives, one.leaves - other.leaves
            gain = min(gain, _gain(arrives, leaves, error, sum(spins), max(usual)))
        deviation, parting, closing = gain
        names = " and ".join(motion.tracks.names[k] for k in impact.bodies)
        text = f"{names}: parts at {max(parting, 0):.0f} px/s, came at {max(closing, 0):.0f} px/s"
        found.append(Evidence(deviation, impact.frame, impact.bodies, text))
    return found


def _gain(
    arrives: Array, leaves: Array, error: float, spin: float, usual: float
) -> tuple[float, float, float]:
    """How much faster it parts, over closing; both speeds, px/s. `spin`: px²/s² that it may add."""
    change = leaves - arrives
    size = float(np.hypot(*change))
    if size == 0:
        return 0.0, 0.0, 0.0
    closing, parting = float(-arrives @ change) / size, float(leaves @ change) / size
    allowed = np.sqrt(max(closing, 0.0) ** 2 + spin)
    gained = max(0.0, parting - allowed - TUNING.sure * error)
    return gained / max(closing, TUNING.slow * usual), parting, closing


def _usual(motion: Motion, body: int) -> float:
    """px/s that it is fast at times."""
    lengths = np.hypot(*motion.steps[:, body].T)
    return max(float(np.nanquantile(lengths, 0.9)), 1.0) / motion.tracks.step


def overlap(motion: Motion) -> list[Evidence]:
    """Each pair that comes near; depth beyond the one of the first frames, in parts of the thinner's width."""
    tracks, found = motion.tracks, []
    paths = [_dense(motion, k) for k in range(len(tracks.names))]
    for one, other in combinations(range(len(tracks.names)), 2):
        a, b = tracks.forms[one], tracks.forms[other]
        gap, thin = motion.gap(one, other), min(a.thin, b.thin)
        if {one, other} <= tracks.held or thin <= 0 or not np.isfinite(gap).any():
            continue
        depth, frame = float(-np.nanmin(gap)), int(np.nanargmin(gap))
        if a.round and b.round:  # between frames
            deep = a.reach + b.reach - np.hypot(*(paths[one] - paths[other]).T)
            if np.nanmax(deep, initial=-np.inf) > depth:
                depth, frame = float(np.nanmax(deep)), int(np.nanargmax(deep)) // PARTS
        if depth <= 0 and np.nanmin(gap) > motion.margin(one, other, 0, len(gap) - 1):
            continue
        start = max(0.0, -float(gap[np.isfinite(gap)][:2].min()))
        beyond = max(0.0, depth - 1.2 * start - 3 * motion.shake(one, other) - 1.0)
        text = f"{tracks.names[one]} and {tracks.names[other]}: {depth:.1f} px deep in each other at frame {frame}"
        found.append(Evidence(beyond / thin, frame, (one, other), text))
    return found


PARTS = 4
"""Moments looked at from frame to frame."""


def _dense(motion: Motion, body: int) -> Array:
    """(PARTS (T - 1) + 1, 2) px: between frames too; NaN where a segment ends, since what was hit turns there."""
    path = motion.tracks.places[:, body]
    frames, ticks = np.arange(len(path)), np.arange(PARTS * (len(path) - 1) + 1) / PARTS
    dense = np.stack(
        [np.interp(ticks, frames, path[:, axis]) for axis in (0, 1)], axis=1
    )
    for segment in motion.segments[body]:
        dense[PARTS * segment.last + 1 : PARTS * (segment.last + 1)] = np.nan
    return dense


def jumps(motion: Motion) -> list[Evidence]:
    """The worst step of each body."""
    return [
        _worst_step(motion, k, first, last)
        for k in range(len(motion.tracks.names))
        for first, last in runs(motion.tracks.seen[:, k])
        if last - first >= 6
    ]


def _worst_step(motion: Motion, body: int, first: int, last: int) -> Evidence:
    sigma, form = float(motion.sigma[body]), motion.tracks.forms[body]
    steps = motion.steps[first : last - 1, body]
    lengths = np.hypot(*steps.T)
    fall = (
        0.0
        if motion.gravity is None
        else float(np.hypot(*motion.gravity)) * motion.tracks.step**2 / 2
    )
    worst, frame, excess = 0.0, first, 0.0
    for k in range(1, len(steps) - 1):
        off = _beyond(steps, k)
        if off <= TUNING.jump * sigma:
            continue
        usual = float(
            np.concatenate([lengths[max(k - 3, 0) : k], lengths[k + 2 : k + 5]]).max(
                initial=0.0
            )
        )
        allowed = TUNING.jump * sigma + _shoved(motion, body, first + k, usual) + fall
        deviation = max(0.0, off - allowed) / max(
            usual, 0.3 * form.reach, 10 * sigma, 3.0
        )
        if not all(
            any(s.good and s.first <= at <= s.last for s in motion.segments[body])
            for at in (first + k, first + k + 1)
        ):
            deviation *= TUNING.doubtful
        if deviation > worst:
            worst, frame, excess = deviation, first + k + 1, off
    text = f"{motion.tracks.names[body]}: is {excess:.1f} px from where it could be at frame {frame}"
    return Evidence(worst, frame, (body,), text)


def _beyond(steps: Array, k: int) -> float:
    """px by which a step is none that the velocity before, the one after, or a change between the two makes."""
    before = [steps[k - 1]] + ([2 * steps[k - 1] - steps[k - 2]] if k >= 2 else [])
    after = [steps[k + 1]] + (
        [2 * steps[k + 1] - steps[k + 2]] if k + 2 < len(steps) else []
    )
    found = []
    for a in before:
        for way in (b - a for b in after):
            part = np.clip(
                (steps[k] - a) @ way / max(float(way @ way), 1e-12), 0.0, 1.0
            )
            found.append(float(np.hypot(*(steps[k] - a - part * way))))
    return min(found)


def _shoved(motion: Motion, body: int, frame: int, usual: float) -> float:
    """px by which something near, or a push, may have sped it up for less than a frame."""
    tracks = motion.tracks
    fastest = 0.0
    for other in range(len(tracks.names)):
        if other == body:
            continue
        gap = motion.gap(body, other)[max(frame - 1, 0) : frame + 1]
        nearer = max(0.0, float(gap[0] - gap[-1])) if np.isfinite(gap).all() else np.inf
        if gap[-1] <= 2.0 + 1.2 * nearer + 3 * motion.shake(body, other):
            lengths = np.hypot(*motion.steps[max(frame - 1, 0) : frame + 2, other].T)
            fastest = max(fastest, float(np.nanmax(lengths, initial=0.0)))
    return max(0.0, 2 * fastest - usual) if fastest > 1.0 else 0.0


# ---- verdict -----------------------------------------------------------------------------------------------------


class Question(NamedTuple):
    """What must hold, and what finds what speaks against it."""

    text: str
    middle: float
    """Deviation at which right and wrong are separated: the best of the calibration in benchmarks/plausibility."""
    ask: Callable[[Motion], list[Evidence]]
    why_not: str
    """Why nothing could be asked, where so."""


QUESTIONS = {
    "gravity": Question(
        "all that flies falls alike",
        0.2,
        gravity,
        "nothing flies freely for long enough",
    ),
    "momentum": Question(
        "bodies that meet push each other",
        0.3,
        momentum,
        "no two free bodies meet alone",
    ),
    "energy": Question(
        "nothing parts faster than it came",
        0.2,
        energy,
        "no impact of round bodies is clear",
    ),
    "overlap": Question(
        "nothing goes through another",
        0.1,
        overlap,
        "no two outlines come near each other",
    ),
    "jumps": Question("nothing jumps", 0.5, jumps, "no track goes on for 6 frames"),
}


def score(question: str, deviation: float) -> float:
    """1 for nothing wrong, 0.5 at the middle.

    >>> score("gravity", 0.0), round(score("gravity", QUESTIONS["gravity"].middle), 3)
    (1.0, 0.5)
    """
    return float(1.0 / (1.0 + (deviation / QUESTIONS[question].middle) ** TUNING.steep))


@dataclass(frozen=True, eq=False)
class Verdict:
    """On one clip."""

    tracks: Tracks
    motion: Motion
    answers: dict[str, list[Evidence]]
    """The worst first; empty where nothing could be asked."""

    def score(self, question: str) -> float | None:
        """0..1; None where it could not be asked."""
        found = self.answers.get(question)
        return score(question, found[0].deviation) if found else None

    @property
    def overall(self) -> float | None:
        """The least of what was asked; None where nothing could be."""
        return min(
            (s for name in self.answers if (s := self.score(name)) is not None),
            default=None,
        )

    @property
    def wrong(self) -> bool | None:
        """Whether it is called wrong; None where nothing could be asked."""
        return None if self.overall is None else self.overall < EVEN

    @property
    def word(self) -> str:
        """As tables have it."""
        return {True: "wrong", False: "right", None: "not asked"}[self.wrong]

    def faults(self) -> list[tuple[str, Evidence]]:
        """Question and evidence of all that is called wrong, the worst first."""
        found = [
            (name, evidence)
            for name, asked in self.answers.items()
            for evidence in asked
        ]
        found.sort(key=lambda pair: score(pair[0], pair[1].deviation))
        return [pair for pair in found if score(pair[0], pair[1].deviation) < EVEN]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        tracks, pulled = self.tracks, self.motion.gravity
        return {
            "clip": tracks.name,
            "source": tracks.source,
            "view": tracks.view.value,
            "frames": len(tracks.times),
            "fps": round(1 / tracks.step, 6),
            "bodies": len(tracks.names),
            "noise_px": {
                n: round(float(s), 4)
                for n, s in zip(tracks.names, self.motion.sigma, strict=True)
            },
            "gravity_px_s2": None
            if pulled is None
            else [round(float(g), 3) for g in pulled],
            "score": None if self.overall is None else round(self.overall, 4),
            "verdict": self.word,
            "questions": {name: self._answer(name) for name in self.answers},
        }

    def _answer(self, name: str) -> dict[str, Any]:
        found = self.answers[name]
        if not found:
            return {"asked": 0, "score": None, "why_not": QUESTIONS[name].why_not}
        evidence = [
            {
                "score": round(score(name, e.deviation), 4),
                "deviation": round(e.deviation, 4),
                "frame": e.frame,
                "time_s": round(float(self.tracks.times[e.frame]), 6),
                "objects": [self.tracks.names[k] for k in e.bodies],
                "text": e.text,
            }
            for e in found[:20]
        ]
        worst = {key: evidence[0][key] for key in ("score", "deviation")}
        return {"asked": len(found), **worst, "evidence": evidence}


def judge(tracks: Tracks, without: Collection[str] = ()) -> Verdict:
    """Ask everything but what is left out. Raises InputError for fewer frames than can be judged."""
    if len(tracks.times) < FEWEST:
        found, fix = f"{len(tracks.times)} frames", f"give {FEWEST} frames or more"
        raise InputError.of(tracks.name, found, "are too few to judge motion by", fix)
    motion = Motion(tracks)
    answers = {
        name: sorted(question.ask(motion), key=lambda e: -e.deviation)
        for name, question in QUESTIONS.items()
        if name not in without
    }
    return Verdict(tracks, motion, answers)


# ---- report ------------------------------------------------------------------------------------------------------

ABOUT = (
    "1: nothing wrong is seen. Below 0.5 a clip is called wrong; its score is that of its worst question. "
    "-: the clip shows nothing that could be asked, which is no success."
)


def findings(verdicts: Sequence[Verdict]) -> Findings:
    """Of one clip or many."""
    wrong = [v for v in verdicts if v.wrong]
    judged = sum(v.wrong is not None for v in verdicts)
    rows = tuple(
        (
            v.tracks.name,
            v.word,
            *(number(s) for s in (v.overall, *map(v.score, QUESTIONS))),
        )
        for v in verdicts
    )
    table = Table(("clip", "verdict", "score", *QUESTIONS), rows)
    sections = [Section("Scores", (ABOUT,), (table,)), *map(_section, verdicts)]
    sentences = [f"{len(wrong)} of {counted(judged, 'clip')} called wrong."]
    if unasked := [v.tracks.name for v in verdicts if v.wrong is None]:
        sentences.append(
            f"Nothing could be asked of {', '.join(unasked[:5])}: that is no verdict."
        )
    count = f"{len(wrong)} of {judged}" if judged else "nothing could be asked"
    bar = Bar("clips called wrong", count, "0", not wrong and judged > 0)
    title, records = (
        "Is the motion physically possible?",
        [v.as_dict() for v in verdicts],
    )
    return Findings(
        "plausibility",
        title,
        tuple(sentences),
        tuple(sections),
        records,
        (bar,),
        {"even": EVEN},
    )


def _section(verdict: Verdict) -> Section:
    tracks, sigma = verdict.tracks, verdict.motion.sigma
    about = (
        f"{tracks.source}; seen from {'above' if tracks.view is View.TOP else 'the side'}; "
        f"{len(tracks.times)} frames, {1 / tracks.step:.4g} a second; {counted(len(tracks.names), 'object')}; "
        f"noise {sigma.min():.2g} to {sigma.max():.2g} px."
    )
    rows = []
    for name, found in verdict.answers.items():
        worst = (
            f"frame {found[0].frame}: {found[0].text}"
            if found
            else f"not asked: {QUESTIONS[name].why_not}"
        )
        worst = worst if not found or found[0].deviation > 0 else "nothing beyond noise"
        rows.append(
            (QUESTIONS[name].text, str(len(found)), number(verdict.score(name)), worst)
        )
    table = Table(("what must hold", "asked", "score", "the worst"), tuple(rows))
    return Section(tracks.name, (about,), (table,))
