"""Ranges `a:b:n` and distributions `~uniform(a, b)` of a sweep: parsing and drawing.

A draw depends on the seed, the key and the number of the draw only, so that sweeps can be extended and made in any
order by any number of processes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from hashlib import sha256
from math import erfc, exp, inf, isfinite, log, sqrt
from statistics import NormalDist
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.batch.values import Value, ValueTextError, number_value, parse_number, parse_yaml, split
from physgen.problems import InputError
from physgen.text import listed, nearest

MAX_COUNT = 10_000_000
"""Values of a range."""
EXACT_INT = 2**53
"""From here on a float does not hold every whole number."""
MIN_SHARE = 1e-9
"""Of a normal distribution that must lie between its bounds: floats resolve less too coarsely."""
EXAMPLES = {
    "uniform": "~uniform(0.2, 0.9)",
    "loguniform": "~loguniform(1, 1000)",
    "normal": "~normal(200, 15)",
    "integers": "~integers(1, 6)",
    "choice": "~choice(disc, hoop)",
}
NO_LOGARITHM = ("has no logarithm: 0 lies between its ends, or is one", "take both above 0, or both below")
_CALL = re.compile(r"~\s*([\w-]*)\s*(?:\((.*)\))?", re.DOTALL).fullmatch
_RANGE = re.compile(r"[-+.\d][^:\s\[\]{}'\"]*(?::[^:\s\[\]{}'\"]*)+").fullmatch
_DECIMAL = re.compile(r"[-+]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?").fullmatch
_NORMAL = NormalDist()


@dataclass(frozen=True)
class Steps:
    """Evenly spaced numbers from `begin` to `end`, both included."""

    begin: Fraction
    end: Fraction
    count: int
    log: bool = False
    """Evenly spaced logarithms."""

    def at(self, index: int) -> Value:
        """One of the numbers; computed exactly, so that 0:1:11 holds 0.3 and not 0.30000000000000004."""
        last = self.count - 1
        if self.log and 0 < index < last:
            value = _log_between(float(self.begin), float(self.end), index / last)
            return number_value(_shortest(Fraction(value)))
        return number_value(_shortest(self.begin + (self.end - self.begin) * Fraction(index, last)))

    @property
    def whole(self) -> bool:
        """Whether all of them are integers that a float holds exactly."""
        step = (self.end - self.begin) / (self.count - 1)
        exact = not self.log and self.begin.denominator == step.denominator == 1
        return exact and max(abs(self.begin), abs(self.end)) < EXACT_INT


def is_range(text: str) -> bool:
    """Whether text is meant as a range: `1:2:3`, and also `1:2` and `1:2:x`."""
    return _RANGE(text) is not None


def read_range(text: str) -> Steps:
    """Parses `start:end:count[:log]`. Raises ValueTextError."""
    parts = text.split(":")
    ends = [parse_number(part) for part in parts[:2]]
    example = f"{parts[0]}:{parts[1]}:5" if None not in ends else "0.1:0.9:5"
    if len(parts) not in (3, 4) or None in ends:
        raise ValueTextError(
            "is not start:end:count", f"write e.g. {example}; text goes in quotes within quotes"
        )
    count = int(parts[2]) if re.fullmatch("[0-9]{1,18}", parts[2]) else 0
    if not 2 <= count <= MAX_COUNT:
        fix = f"write start:end:count, e.g. {example}"
        raise ValueTextError(f"has no count from 2 to {MAX_COUNT:,} behind its ends", fix)
    begin, end = _exact(parts[0]), _exact(parts[1])
    if begin == end:
        raise ValueTextError("ends where it begins", f"write {parts[0]} alone, or another end")
    if parts[3:] not in ([], ["log"]):
        plain = ":".join(parts[:3])
        raise ValueTextError(f'ends in "{parts[3]}"', f"write {plain} or {plain}:log")
    if parts[3:] and begin * end <= 0:
        raise ValueTextError(*NO_LOGARITHM)
    return Steps(begin, end, count, bool(parts[3:]))


def _exact(text: str) -> Fraction:
    """The number as written in decimal digits, not the nearest float; unusual spellings as the float."""
    value = parse_number(text)
    assert value is not None
    return Fraction(text) if _DECIMAL(text) else Fraction(value)


def _shortest(value: Fraction) -> int | float:
    return int(value) if value.denominator == 1 and abs(value) < EXACT_INT else float(value)


def _log_between(low: float, high: float, share: float) -> float:
    """Between two numbers of one sign, linear in the logarithm; rounded to 15 digits, so that 1:1000:4 holds 10."""
    begin, end = log(abs(low)), log(abs(high))
    size = float(f"{exp(begin + share * (end - begin)):.15g}")
    size = min(max(size, min(abs(low), abs(high))), max(abs(low), abs(high)))
    return size if low > 0 else -size


class Distribution(Protocol):
    """Distribution of the values of one key."""

    def at(self, share: float) -> Value:
        """The quantile: the value below which that share of draws lies, 0 < share < 1."""
        ...


@dataclass(frozen=True)
class Uniform:
    """Numbers between two, equally likely; with `log`, their logarithms are."""

    low: float
    high: float
    log: bool = False

    def at(self, share: float) -> Value:
        """See Distribution."""
        if self.log:
            return number_value(_log_between(self.low, self.high, share))
        return number_value(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class Normal:
    """A normal distribution, truncated to `low` .. `high`."""

    mean: float
    deviation: float
    """Standard deviation of the distribution without bounds."""
    low: float = -inf
    high: float = inf

    def at(self, share: float) -> Value:
        """See Distribution."""
        begin, end = self._shares
        z = _NORMAL.inv_cdf(min(max(begin + (end - begin) * share, 1e-320), 1 - 2**-53))
        return number_value(min(max(self.mean + self.deviation * z, self.low), self.high))

    @property
    def _shares(self) -> tuple[float, float]:
        """Shares of the distribution without bounds that lie below both bounds."""
        bounds = ((bound - self.mean) / self.deviation for bound in (self.low, self.high))
        begin, end = (0.5 * erfc(-bound / sqrt(2)) for bound in bounds)
        return begin, end

    @property
    def is_empty(self) -> bool:
        """Whether no part of the distribution that floats can resolve lies between the bounds."""
        begin, end = self._shares
        return not end - begin > MIN_SHARE


@dataclass(frozen=True)
class Integers:
    """Integers from the least to the greatest, both included."""

    least: int
    greatest: int

    def at(self, share: float) -> Value:
        """See Distribution."""
        return number_value(min(self.least + int(share * (self.greatest - self.least + 1)), self.greatest))


@dataclass(frozen=True)
class Choice:
    """One of several values; a repeated value is drawn more often."""

    values: tuple[Value, ...]

    def at(self, share: float) -> Value:
        """See Distribution."""
        return self.values[int(share * len(self.values))]


def read_distribution(text: str) -> Distribution:
    """Parses `~NAME(...)`. Raises ValueTextError."""
    call = _CALL(text)
    name = re.sub("[-_]", "", call[1]).lower() if call else ""
    if call is None or name not in EXAMPLES:
        close = nearest(name, EXAMPLES)
        fix = f"did you mean {EXAMPLES[close]}?" if close else f"write {listed(EXAMPLES.values())}"
        raise ValueTextError(f"names no {'known ' * bool(name)}distribution", fix)
    if call[2] is None:
        raise ValueTextError("has no numbers", f"write e.g. {EXAMPLES[name]}, in quotes")
    if name == "choice":
        return _choice(call[2])
    if name == "normal" and call[2].count(",") == 3:
        return _truncated(call[2])
    return _of_two_numbers(name, call[2])


def _choice(text: str) -> Choice:
    example = f"write e.g. {EXAMPLES['choice']}"
    try:
        values = [parse_yaml(part) for part in split(text)]
    except (ValueTextError, InputError) as error:
        raise ValueTextError("holds a value that is not YAML", example) from error
    if len(values) < 2 or not all(value.text for value in values):
        raise ValueTextError("has not two values to choose from", example)
    return Choice(tuple(values))


def _truncated(text: str) -> Normal:
    """A normal distribution with two bounds, of which one may be infinite."""
    example = "~normal(0.5, 0.1, 0, 1)"
    infinite = {"inf": inf, "+inf": inf, "-inf": -inf}
    parts = [part.strip().replace(".inf", "inf") for part in text.split(",")]
    mean, deviation, low, high = (infinite.get(part, parse_number(part)) for part in parts)
    if mean is None or deviation is None or low is None or high is None or not isfinite(mean):
        found = "does not hold a mean, a standard deviation and two bounds"
        raise ValueTextError(found, f"write e.g. {example}")
    if not 0 < deviation < inf:
        raise ValueTextError(
            f"has a standard deviation of {deviation:g}", f"write one above 0, e.g. {example}"
        )
    if not low < high:
        fix = f"write the lower one first, e.g. {example}"
        raise ValueTextError("has bounds that leave nothing between them", fix)
    found_distribution = Normal(float(mean), float(deviation), float(low), float(high))
    if found_distribution.is_empty:
        raise ValueTextError(
            "has bounds so far from the mean that nothing is drawn there", "bring them nearer to it"
        )
    return found_distribution


def _of_two_numbers(name: str, text: str) -> Distribution:
    numbers = [parse_number(part.strip()) for part in text.split(",")]
    example = EXAMPLES[name]
    a, b = numbers if len(numbers) == 2 else (None, None)
    if a is None or b is None:
        expected = "a mean and a standard deviation" if name == "normal" else "two numbers"
        raise ValueTextError(f"does not hold {expected}", f"write e.g. {example}")
    if name == "normal":
        if b <= 0:
            raise ValueTextError(f"has a standard deviation of {b:g}", f"write one above 0, e.g. {example}")
        return Normal(float(a), float(b))
    if a >= b:
        raise ValueTextError("goes down, or nowhere", f"write the lower number first, e.g. {example}")
    if name == "integers":
        if float(a) % 1 or float(b) % 1 or max(abs(a), abs(b)) > 2**50:
            raise ValueTextError("does not hold whole numbers", f"write e.g. {example}")
        return Integers(int(a), int(b))
    if name == "loguniform" and a * b <= 0:
        raise ValueTextError(*NO_LOGARITHM)
    if not isfinite(float(b) - float(a)):
        raise ValueTextError("is too wide for floating-point numbers", f"write e.g. {example}")
    return Uniform(float(a), float(b), log=name == "loguniform")


def draw(seed: int, key: str, number: int) -> float:
    """A draw of the uniform distribution over 0 < x < 1, independent for every seed, key and number."""
    digest = sha256(f"{seed}\n{key}\n{number}".encode()).digest()
    return ((int.from_bytes(digest[:8], "big") >> 12) + 0.5) / 2**52


def latin_draw(seed: int, key: str, number: int, count: int) -> float:
    """The same as one of `count` draws of a Latin hypercube (McKay and others 1979): one in each of `count` strata."""
    return float(_latin_column(seed, key, count)[number])


@lru_cache(maxsize=64)
def _latin_column(seed: int, key: str, count: int) -> NDArray[np.float64]:
    """(count,): draws of one key; the keys are independent, so that another key changes none of them."""
    random = np.random.default_rng(int.from_bytes(sha256(f"{seed}\n{key}".encode()).digest(), "big"))
    return np.asarray((random.permutation(count) + random.uniform(2**-20, 1 - 2**-20, count)) / count)
