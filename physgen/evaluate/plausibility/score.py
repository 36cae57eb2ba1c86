"""How far off -> a score from 0, surely wrong, to 1, nothing wrong; 0.5 parts right from wrong."""

from __future__ import annotations

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
