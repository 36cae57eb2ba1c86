"""`~uniform(0.2, 0.9)` and its like -> a distribution; a share in 0..1 -> its value."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from math import inf, isfinite
from typing import Protocol

from physgen.batch.quantiles import below, between, normal
from physgen.batch.values import SplitError, Value, WrongError, numeric, of, split, yaml
from physgen.problems import InputError
from physgen.scene.words import listed, nearest

FORMS = {
    "uniform": "~uniform(0.2, 0.9)",
    "loguniform": "~loguniform(1, 1000)",
    "normal": "~normal(200, 15)",
    "integers": "~integers(1, 6)",
    "choice": "~choice(disc, hoop)",
}
FAR = 37.0
"""Standard deviations from the mean beyond which nothing is drawn."""
LEAST = 1e-300
"""Of the bell, that must lie within its bounds."""
_CALL = re.compile(r"~\s*([\w-]*)\s*(?:\((.*)\))?", re.DOTALL).fullmatch


class Distribution(Protocol):
    """Of the values of one key."""

    def at(self, share: float) -> Value:
        """The value below which that share of draws lies, 0 < share < 1."""
        ...


@dataclass(frozen=True)
class Uniform:
    """Any number between two, all alike."""

    low: float
    high: float

    def at(self, share: float) -> Value:
        """See Distribution."""
        return of(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class LogUniform:
    """Any number between two of one sign, each factor alike: as many from 1 to 10 as from 10 to 100."""

    low: float
    high: float

    def at(self, share: float) -> Value:
        """See Distribution."""
        return of(between(self.low, self.high, Decimal(share)))


@dataclass(frozen=True)
class Normal:
    """The bell about a mean."""

    mean: float
    deviation: float
    """Standard deviation."""

    def at(self, share: float) -> Value:
        """See Distribution."""
        return of(self.mean + self.deviation * normal(share))


@dataclass(frozen=True)
class Within:
    """The bell about a mean, of which only what lies between two bounds is drawn; one of them may be infinite."""

    mean: float
    deviation: float
    """Standard deviation, of the whole bell."""
    low: float
    high: float

    def at(self, share: float) -> Value:
        """See Distribution."""
        turned = self.low + self.high > 2 * self.mean  # in the lower tail shares are told from one another
        begin, end = self._shares
        part = 1 - share if turned else share
        z = normal(float(begin + (end - begin) * Decimal(part)))
        value = self.mean + self.deviation * (-z if turned else z)
        return of(min(max(value, self.low), self.high))

    @cached_property
    def _shares(self) -> tuple[Decimal, Decimal]:
        """Of the bell below its bounds; where most of it lies below them, above them."""
        ends = [(end - self.mean) / self.deviation for end in (self.low, self.high)]
        if self.low + self.high > 2 * self.mean:
            ends = [-end for end in reversed(ends)]
        return below(ends[0]), below(ends[1])

    @property
    def holds(self) -> bool:
        """Whether enough of the bell lies between the bounds to be drawn."""
        begin, end = self._shares
        return float(end) > LEAST and float(end - begin) > LEAST


@dataclass(frozen=True)
class Integers:
    """Whole numbers from the least to the greatest, both among them."""

    least: int
    greatest: int

    def at(self, share: float) -> Value:
        """See Distribution."""
        return of(min(self.least + int(share * (self.greatest - self.least + 1)), self.greatest))


@dataclass(frozen=True)
class Choice:
    """One of a few values; one that is named twice comes twice as often."""

    values: tuple[Value, ...]

    def at(self, share: float) -> Value:
        """See Distribution."""
        return self.values[int(share * len(self.values))]


def read(text: str) -> Distribution:
    """`~NAME(...)`; raises WrongError."""
    call = _CALL(text)
    name = re.sub("[-_]", "", call[1]).lower() if call else ""
    if call is None or name not in FORMS:
        close = nearest(name, FORMS)
        fix = f"did you mean {FORMS[close]}?" if close else f"write {listed(FORMS.values())}"
        expected = "names no distribution that is known" if name else "names no distribution"
        raise WrongError(expected, fix)
    if call[2] is None:
        raise WrongError("has no numbers", f"write e.g. {FORMS[name]}, in quotes")
    if name == "choice":
        return _choice(call[2])
    if name == "normal" and call[2].count(",") == 3:
        return _within(call[2])
    return _of_two(name, call[2])


def _choice(text: str) -> Choice:
    try:
        values = [yaml(part) for part in split(text)]
    except (SplitError, InputError) as error:
        raise WrongError("holds a value that is not YAML", f"write e.g. {FORMS['choice']}") from error
    if len(values) < 2 or not all(value.text for value in values):
        raise WrongError("has not two values to choose from", f"write e.g. {FORMS['choice']}")
    return Choice(tuple(values))


def _within(text: str) -> Within:
    """A normal distribution with bounds, of which one may be `.inf`."""
    example = "~normal(0.5, 0.1, 0, 1)"
    numbers = [_endless(part.strip()) for part in text.split(",")]
    mean, deviation, low, high = numbers
    if mean is None or deviation is None or low is None or high is None or not isfinite(mean):
        raise WrongError("does not hold a mean, a standard deviation and two bounds", f"write e.g. {example}")
    if not 0 < deviation < inf:
        raise WrongError(f"has a standard deviation of {deviation:g}", f"write one above 0, e.g. {example}")
    if not low < high:
        raise WrongError(
            "has bounds that leave nothing between them", f"write the lower one first, e.g. {example}"
        )
    bounded = Within(mean, deviation, low, high)
    if max((low - mean) / deviation, (mean - high) / deviation) > FAR or not bounded.holds:
        raise WrongError(
            "has bounds so far from the mean that nothing is drawn there", "bring them nearer to it"
        )
    return bounded


def _endless(text: str) -> float | None:
    """A number; `.inf` and `inf` with a sign or without."""
    endless = {"inf": inf, "+inf": inf, "-inf": -inf}
    found = endless.get(text.replace(".inf", "inf"), numeric(text))
    return None if found is None else float(found)


def _of_two(name: str, text: str) -> Distribution:
    numbers = [numeric(part.strip()) for part in text.split(",")]
    example = FORMS[name]
    a, b = numbers if len(numbers) == 2 else (None, None)
    if a is None or b is None:
        what = "a mean and a standard deviation" if name == "normal" else "two numbers"
        raise WrongError(f"does not hold {what}", f"write e.g. {example}")
    if name == "normal":
        if b <= 0:
            raise WrongError(f"has a standard deviation of {b:g}", f"write one above 0, e.g. {example}")
        return Normal(float(a), float(b))
    if a >= b:
        raise WrongError("goes down, or nowhere", f"write the lower number first, e.g. {example}")
    if name == "integers":
        if float(a) % 1 or float(b) % 1 or max(abs(a), abs(b)) > 2**50:
            raise WrongError("does not hold whole numbers", f"write e.g. {example}")
        return Integers(int(a), int(b))
    if name == "loguniform" and a * b <= 0:
        raise WrongError(
            "has no logarithm: 0 lies between its ends, or is one", "take both above 0, or both below"
        )
    if not isfinite(float(b) - float(a)):
        raise WrongError("is too wide for numbers of a computer", f"write e.g. {example}")
    make: Callable[[float, float], Distribution] = Uniform if name == "uniform" else LogUniform
    return make(float(a), float(b))
