"""What the draws of a row gave -> its line of the scorecard, as data and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from types import MappingProxyType
from typing import Any

from physgen.evaluate.row import Measure, Row
from physgen.evaluate.trial import Done, Worst, scene_file

DEFAULT_STEPS = 960
"""Steps a second that a scene takes that does not say."""


@dataclass(frozen=True)
class Score:
    """One measure of one row."""

    measure: Measure
    worst: Worst
    convergence: Mapping[int, float]
    """Steps a second -> the first draw's error."""

    @property
    def passed(self) -> bool:
        """Whether the bar is met; an error that is no number meets none."""
        return self.worst.error <= self.measure.bar

    def as_dict(self) -> dict[str, Any]:
        """As JSON; null for an error that is not finite."""
        return {
            "name": self.measure.name,
            "unit": self.measure.unit.value,
            "bar": self.measure.bar,
            "error": _rounded(self.worst.error),
            "worst": self.worst.where,
            "passed": self.passed,
            "convergence": {str(steps): _rounded(error) for steps, error in self.convergence.items()},
        }


@dataclass(frozen=True)
class RowScore:
    """One row's line."""

    row: Row
    scores: tuple[Score, ...]
    problems: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every measure meets its bar."""
        return all(score.passed for score in self.scores)

    def as_dict(self) -> dict[str, Any]:
        """As JSON; `measures` may be given `rivals` later: name -> error, null for what a rival cannot do."""
        return {
            "row": self.row.number,
            "name": self.row.name,
            "title": self.row.title,
            "closed_form": self.row.closed_form,
            "draws": self.row.ranges,
            "why": self.row.why,
            "scenes": [scene_file(self.row, case, 0) for case in self.row.draw(0)],
            "passed": self.passed,
            "measures": [score.as_dict() for score in self.scores],
            "problems": list(self.problems),
        }


def _rounded(error: float) -> float | None:
    return float(f"{error:.3g}") if isfinite(error) else None


def score(
    row: Row, draws: int, steps: Sequence[int], done: Mapping[tuple[int, int | None], Done]
) -> RowScore:
    """Of `done` by draw and steps a second (None: the default), the largest errors and the first draw's convergence."""
    scores = []
    for measure in row.measures:
        found = [done[index, None].errors.get(measure.name) for index in range(draws)]
        taken = [worst for worst in found if worst is not None]
        worst = max(taken, key=lambda one: one.size, default=Worst(nan, "never measured"))
        first = {rate: done[0, None if rate == DEFAULT_STEPS else rate].errors for rate in steps}
        convergence = {
            rate: errors[measure.name].error for rate, errors in first.items() if measure.name in errors
        }
        scores.append(Score(measure, worst, MappingProxyType(convergence)))
    problems = [problem for index in range(draws) for problem in done[index, None].problems]
    return RowScore(row, tuple(scores), tuple(dict.fromkeys(problems)))
