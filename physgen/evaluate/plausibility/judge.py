"""Tracks -> the answer to every question with its evidence, and one score."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

from physgen.evaluate.plausibility.evidence import EVEN, Answer, Evidence, score
from physgen.evaluate.plausibility.gravity import common, gravity
from physgen.evaluate.plausibility.motion import Motion
from physgen.evaluate.plausibility.questions import energy, jumps, momentum, overlap, speeding
from physgen.evaluate.plausibility.starts import starts
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.problems import InputError


class Question(NamedTuple):
    """What must hold, in words, and who finds what speaks against it."""

    text: str
    ask: Callable[[Motion], Answer]


QUESTIONS = {
    "gravity": Question("all that flies falls alike", gravity),
    "momentum": Question("who meets another pushes it back", momentum),
    "energy": Question("nothing parts faster than it came", energy),
    "overlap": Question("nothing goes through another", overlap),
    "jumps": Question("nothing jumps", jumps),
    "starts": Question("nothing at rest starts by itself", starts),
    "speeding": Question("nothing on a table speeds up by itself", speeding),
}


FEWEST = 8
"""Frames: with fewer, motion cannot be distinguished from noise."""
MOST_TOLD = 20
"""Instances of a question in JSON."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """On one clip."""

    tracks: Tracks
    motion: Motion
    answers: dict[str, Answer]

    def score(self, question: str) -> float | None:
        """0..1; None where it could not be asked."""
        answer = self.answers.get(question)
        return score(question, answer.deviation) if answer is not None and answer.evidence else None

    @property
    def overall(self) -> float | None:
        """The least of what was asked; None where nothing could be."""
        scores = [s for name in self.answers if (s := self.score(name)) is not None]
        return min(scores) if scores else None

    @property
    def wrong(self) -> bool | None:
        """Whether it is called wrong; None where nothing could be asked."""
        return None if self.overall is None else self.overall < EVEN

    @property
    def gravity(self) -> tuple[float, float] | None:
        """px/s² along x and y, that all flights have in common; None where nothing flies."""
        pulled = common(self.motion)
        return None if pulled is None else (float(pulled[0]), float(pulled[1]))

    def faults(self) -> list[tuple[str, Evidence]]:
        """Question and evidence of all that is called wrong, the worst first."""
        scored = [
            (score(name, evidence.deviation), name, evidence)
            for name, asked in self.answers.items()
            for evidence in asked.evidence
        ]
        return [(name, evidence) for s, name, evidence in sorted(scored, key=lambda t: t[0]) if s < EVEN]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        tracks = self.tracks
        pulled = self.gravity
        return {
            "clip": tracks.name,
            "source": tracks.source,
            "view": tracks.view.value,
            "frames": len(tracks.times),
            "fps": round(1 / tracks.step, 6),
            "bodies": len(tracks.names),
            "noise_px": {n: round(float(s), 4) for n, s in zip(tracks.names, self.motion.sigma, strict=True)},
            "gravity_px_s2": None if pulled is None else [round(g, 3) for g in pulled],
            "score": _short(self.overall),
            "verdict": verdict_word(self.wrong),
            "questions": {name: self._answer(name) for name in self.answers},
        }

    def _answer(self, name: str) -> dict[str, Any]:
        asked = self.answers[name]
        if not asked.evidence:
            return {"asked": 0, "score": None, "why_not": asked.why_not}
        return {
            "asked": len(asked.evidence),
            "score": _short(self.score(name)),
            "deviation": round(asked.deviation, 4),
            "evidence": [
                {
                    "score": _short(score(name, e.deviation)),
                    "deviation": round(e.deviation, 4),
                    "frame": e.frame,
                    "time_s": round(float(self.tracks.times[e.frame]), 6),
                    "objects": [self.tracks.names[k] for k in e.bodies],
                    "text": e.text,
                }
                for e in asked.evidence[:MOST_TOLD]
            ],
        }


def verdict_word(wrong: bool | None) -> str:
    """As tables have it."""
    return {True: "wrong", False: "right", None: "not asked"}[wrong]


def judge(tracks: Tracks, sigma: float | None = None, without: Collection[str] = ()) -> Verdict:
    """Ask everything but what is left out. `sigma` px: noise where it is known, else it is estimated from the tracks.

    Raises InputError for fewer frames than can be judged.
    """
    check(tracks)
    motion = Motion(tracks, sigma)
    return Verdict(tracks, motion, {n: q.ask(motion) for n, q in QUESTIONS.items() if n not in without})


def check(tracks: Tracks) -> None:
    """Raises InputError for tracks that nothing can be asked of."""
    if not tracks.names:
        raise InputError.of(tracks.name, "", "has no tracks", "give what moves in it an id in every frame")
    if len(tracks.times) < FEWEST:
        found, fix = f"{len(tracks.times)} frames", f"give {FEWEST} frames or more"
        raise InputError.of(tracks.name, found, "are too few to judge motion by", fix)


def _short(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
