"""Ranges `a:b:n` and distributions `~uniform(a, b)` of a sweep: parsing and drawing."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from functools import cache, cached_property
from hashlib import sha256
from math import inf, isfinite, isqrt, sqrt
from typing import Protocol

from physgen.batch.values import SplitError, Value, WrongError, numeric, of, split, yaml
from physgen.problems import InputError
from physgen.text import listed, nearest

# ----------------------------------------------------------------------
# A share in 0..1 -> the value below which that share of a distribution lies; the same bits on every machine.
#
# Logarithms and exponentials of the C library differ between machines in their last bit; those of `decimal`
# are rounded
# correctly, and so are +, -, *, / and square roots of floats.

FINE = Context(prec=28)
WRITTEN = Context(prec=15)
"""Digits that a float keeps: what lies between is the same float."""

# Wichura, M. J. (1988), Algorithm AS 241: The percentage points of the normal distribution, Applied Statistics 37 (3),
# 477-484, PPND16: ratios of polynomials, lowest power first
_MIDDLE = (
    (3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
     4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3),
    (1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
     2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3),
)  # fmt: skip
_FLANK = (
    (1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
     1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4),
    (1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
     1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9),
)  # fmt: skip
_TAIL = (
    (6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
     2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7),
    (1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
     7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15),
)  # fmt: skip


def normal(share: float) -> float:
    """Of the normal distribution of mean 0 and standard deviation 1, to 16 digits; 0 < share < 1."""
    off = share - 0.5
    if abs(off) <= 0.425:
        square = 0.180625 - off * off
        return off * _horner(_MIDDLE[0], square) / _horner(_MIDDLE[1], square)
    far = sqrt(float(-FINE.ln(Decimal(share if off < 0 else 1.0 - share))))
    above, below = (_FLANK, far - 1.6) if far <= 5.0 else (_TAIL, far - 5.0)
    value = _horner(above[0], below) / _horner(above[1], below)
    return value if off > 0 else -value


def below(value: float) -> Decimal:
    """The share of the normal distribution of mean 0 and standard deviation 1 that lies below `value`, to 25 digits.

    As exact in the lower tail, however small it is: 1/2 + phi(x) (x + x^3/3 + x^5/15 + ...), a series of one sign.
    """
    if value in (inf, -inf):
        return Decimal(int(value > 0))
    x = Decimal(value)
    context = Context(prec=40 + int(x * x / 4))  # what cancels in the tail, exp(-x^2 / 2), is carried along
    square = context.multiply(x, x)
    term = total = x
    count = 1
    while abs(term) > abs(total) * Decimal(10) ** -context.prec:
        count += 2
        term = context.divide(context.multiply(term, square), Decimal(count))
        total = context.add(total, term)
    root = context.sqrt(context.multiply(Decimal(2), _pi(context)))
    density = context.divide(context.exp(context.divide(square, Decimal(-2))), root)
    return FINE.plus(context.fma(density, total, Decimal("0.5")))


def _pi(context: Context) -> Decimal:
    """By Machin (1706): 16 arctan(1/5) - 4 arctan(1/239)."""

    def arctan(whole: int) -> Decimal:
        power = total = context.divide(Decimal(1), Decimal(whole))
        count = 1
        while abs(power) > Decimal(10) ** -context.prec:
            power = context.divide(power, Decimal(-whole * whole))
            count += 2
            total = context.add(total, context.divide(power, Decimal(count)))
        return total

    return context.subtract(
        context.multiply(Decimal(16), arctan(5)), context.multiply(Decimal(4), arctan(239))
    )


def between(low: float, high: float, share: Decimal) -> float:
    """Of the distribution from `low` to `high`, of one sign, whose logarithm is uniform; the share may be exact."""
    sign = 1 if low > 0 else -1
    begin, end = _ln(abs(low)), _ln(abs(high))
    power = FINE.add(begin, FINE.multiply(share, FINE.subtract(end, begin)))
    return sign * float(WRITTEN.plus(FINE.exp(power)))


@cache
def _ln(value: float) -> Decimal:
    return FINE.ln(Decimal(value))


def _horner(coefficients: Sequence[float], x: float) -> float:
    total = 0.0
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return total


# ----------------------------------------------------------------------
# `~uniform(0.2, 0.9)` and its like -> a distribution; a share in 0..1 -> its value.

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


def read_distribution(text: str) -> Distribution:
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


# ----------------------------------------------------------------------
# Seed, key and number of a draw -> a share in 0..1, from these alone: no draw needs those before it, nor a
# table.
#
# A draw is read off a SHA-256: the same on every machine, in any order, in any process; another key has other
# draws, so
# that a sweep keeps the draws of its keys when it gets one more.

BITS = 52
"""Of a draw; with half a unit added it is exact in a float, and never 0 or 1."""
STRATUM_BITS = 20
"""Bits that place a draw within its stratum: few enough that it never leaves it by rounding."""
ROUNDS = 8
"""Of the Feistel network that shuffles strata."""


def lot(seed: int, key: str, number: int) -> float:
    """A draw of the uniform distribution over 0 < x < 1, independent of those of all other seeds, keys and numbers."""
    return (_bits(f"{seed}\n{key}\n{number}", BITS) + 0.5) / float(2**BITS)


def stratified(seed: int, key: str, number: int, count: int) -> float:
    """The same where `count` draws are one design: a Latin hypercube (McKay and others 1979).

    Of the `count` equal strata of 0..1 each holds exactly one of the draws 0 .. count - 1, in an order that is
    another one for every key.
    """
    place = (_bits(f"{seed}\n{key}\n{number}\nplace", STRATUM_BITS) + 0.5) / float(2**STRATUM_BITS)
    return (shuffled(seed, key, number, count) + place) / count


def shuffled(seed: int, key: str, number: int, count: int) -> int:
    """Where a permutation of 0 .. count - 1 takes `number`.

    An alternating Feistel network over a rectangle of at least `count` cells (Black and Rogaway 2002, Ciphers with
    arbitrary finite domains); what falls off the count walks on.
    """
    wide = isqrt(count - 1) + 1 if count > 1 else 1
    high = -(-count // wide)
    while True:
        row, column = divmod(number, wide)
        for turn in range(ROUNDS):
            if turn % 2:
                column = (column + _bits(f"{seed}\n{key}\n{turn}\n{row}\norder", 64)) % wide
            else:
                row = (row + _bits(f"{seed}\n{key}\n{turn}\n{column}\norder", 64)) % high
        number = row * wide + column
        if number < count:
            return number


def _bits(text: str, count: int) -> int:
    return int.from_bytes(sha256(text.encode("utf-8")).digest()[:8], "big") >> (64 - count)


# ----------------------------------------------------------------------
# `a:b:n` -> evenly spaced numbers, `a:b:n:log` -> evenly spaced in their logarithm; any one of them by its
# index.

MOST = 10_000_000
WIDE = 2**53
"""Whole numbers from which on a float does not hold every one: they are floats here."""
_LOOKS = re.compile(r"[-+.\d][^:\s\[\]{}'\"]*(?::[^:\s\[\]{}'\"]*)+").fullmatch
_PLAIN = re.compile(r"[-+]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?").fullmatch


@dataclass(frozen=True)
class Steps:
    """Numbers from one end to the other, both among them."""

    begin: Fraction
    end: Fraction
    count: int
    log: bool = False
    """Each is the one before times the same factor."""

    def at(self, index: int) -> Value:
        """One of them; worked out exactly, so that 0:1:11 holds 0.3 and not 0.30000000000000004."""
        last = self.count - 1
        if self.log and 0 < index < last:
            share = FINE.divide(Decimal(index), Decimal(last))
            return of(_short(Fraction(between(float(self.begin), float(self.end), share))))
        return of(_short(self.begin + (self.end - self.begin) * Fraction(index, last)))

    @property
    def whole(self) -> bool:
        """Whether all of them are whole numbers, and small enough to be written as such."""
        step = (self.end - self.begin) / (self.count - 1)
        exact = not self.log and self.begin.denominator == step.denominator == 1
        return exact and max(abs(self.begin), abs(self.end)) < WIDE


def is_range(text: str) -> bool:
    """Whether text is meant as a range: `1:2:3`, and `1:2` and `1:2:x` too."""
    return _LOOKS(text) is not None


def read_range(text: str) -> Steps:
    """Raises WrongError."""
    parts = text.split(":")
    ends = [numeric(part) for part in parts[:2]]
    example = f"{parts[0]}:{parts[1]}:5" if None not in ends else "0.1:0.9:5"
    if len(parts) not in (3, 4) or None in ends:
        raise WrongError("is not start:end:count", f"write e.g. {example}; text goes in quotes within quotes")
    count = int(parts[2]) if re.fullmatch("[0-9]{1,18}", parts[2]) else 0
    if not 2 <= count <= MOST:
        fix = f"write start:end:count, e.g. {example}"
        raise WrongError(f"has no count from 2 to {MOST:,} behind its ends", fix)
    begin, end = (_exact(part) for part in parts[:2])
    if begin == end:
        raise WrongError("ends where it begins", f"write {parts[0]} alone, or another end")
    if parts[3:] not in ([], ["log"]):
        raise WrongError(f'ends in "{parts[3]}"', f"write {':'.join(parts[:3])} or {':'.join(parts[:3])}:log")
    if parts[3:] and begin * end <= 0:
        raise WrongError(
            "has no logarithm: 0 lies between its ends, or is one", "take both above 0, or both below"
        )
    return Steps(begin, end, count, bool(parts[3:]))


def _exact(text: str) -> Fraction:
    """What the text says, not the float next to it; of odd spellings the float."""
    value = numeric(text)
    assert value is not None
    return Fraction(text) if _PLAIN(text) else Fraction(value)


def _short(value: Fraction) -> int | float:
    return int(value) if value.denominator == 1 and abs(value) < WIDE else float(value)
