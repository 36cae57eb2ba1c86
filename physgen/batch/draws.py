"""`~uniform(0.2, 0.9)` and its like -> a distribution; a share in 0..1 -> its value."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from math import isfinite
from typing import Protocol

from physgen.batch.quantiles import between, normal
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
    return _of_two(name, call[2])


def _choice(text: str) -> Choice:
    try:
        values = [yaml(part) for part in split(text)]
    except (SplitError, InputError) as error:
        raise WrongError("holds a value that is not YAML", f"write e.g. {FORMS['choice']}") from error
    if len(values) < 2 or not all(value.text for value in values):
        raise WrongError("has not two values to choose from", f"write e.g. {FORMS['choice']}")
    return Choice(tuple(values))


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
