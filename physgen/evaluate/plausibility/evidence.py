"""What is asked of a clip, and what speaks for an answer: who, when, how much."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Evidence:
    """One instance of a question: a flight, a blow, a pair, a thing."""

    deviation: float
    """0: nothing wrong beyond what noise explains; it grows with what is wrong, in parts of what is right."""
    frame: int
    """Where it is worst."""
    things: tuple[int, ...]
    """Indices."""
    text: str
    """What was found, with its size."""


@dataclass(frozen=True)
class Asked:
    """All instances of one question."""

    evidence: tuple[Evidence, ...]
    """The worst first; empty where the clip shows nothing that can be asked."""
    why_not: str = ""
    """Where it is empty."""

    @classmethod
    def of(cls, evidence: list[Evidence], why_not: str) -> Asked:
        """Sorted."""
        plain = [replace(e, deviation=float(e.deviation), frame=int(e.frame)) for e in evidence]
        return cls(tuple(sorted(plain, key=lambda e: -e.deviation)), "" if evidence else why_not)

    @property
    def deviation(self) -> float:
        """Of the worst."""
        return self.evidence[0].deviation if self.evidence else 0.0
