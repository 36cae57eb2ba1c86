"""Answers to the questions with their evidence, and the score of a deviation."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Evidence:
    """One instance of a question: a flight, a blow, a pair, a body."""

    deviation: float
    """0: nothing wrong beyond what noise explains; it grows with what is wrong, in parts of what is right."""
    frame: int
    """Where it is worst."""
    bodies: tuple[int, ...]
    """Indices."""
    text: str
    """What was found, with its size."""


@dataclass(frozen=True)
class Answer:
    """All instances of one question."""

    evidence: tuple[Evidence, ...]
    """The worst first; empty where the clip shows nothing that can be asked."""
    why_not: str = ""
    """Where it is empty."""

    @classmethod
    def of(cls, evidence: list[Evidence], why_not: str) -> Answer:
        """Sorted."""
        plain = [replace(e, deviation=float(e.deviation), frame=int(e.frame)) for e in evidence]
        return cls(tuple(sorted(plain, key=lambda e: -e.deviation)), "" if evidence else why_not)

    @property
    def deviation(self) -> float:
        """Of the worst."""
        return self.evidence[0].deviation if self.evidence else 0.0


MIDDLE = {
    "gravity": 0.2,
    "momentum": 0.3,
    "energy": 0.2,
    "overlap": 0.1,
    "jumps": 0.5,
    "starts": 0.6,
    "speeding": 0.2,
}
"""Deviations at which right and wrong are separated: the best of the calibration in benchmarks/plausibility."""
STEEP = 3.0
"""The score falls to 1/9 at twice the middle."""
EVEN = 0.5


def score(question: str, deviation: float) -> float:
    """1 for nothing wrong, 0.5 at the middle.

    >>> score("gravity", 0.0), round(score("gravity", MIDDLE["gravity"]), 3)
    (1.0, 0.5)
    """
    return float(1.0 / (1.0 + (deviation / MIDDLE[question]) ** STEEP))
