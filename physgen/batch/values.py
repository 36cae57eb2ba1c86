"""Values of a sweep's arguments: YAML between commas, ranges `a:b:n`, and distributions `~uniform(a, b)`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import exp, isfinite, log
from pathlib import Path
from statistics import NormalDist
from typing import Any

import yaml

from physgen.problems import InputError, RefusedError
from physgen.scene.document import Source, plain, read
from physgen.tables import Cell
from physgen.text import listed, nearest, number, quoted

MAX_COUNT = 100_000
"""Values of a range."""
EXACT_INT = 2**53
"""From here on a float does not hold every whole number."""
EXAMPLES = {
    "uniform": "~uniform(0.2, 0.9)",
    "loguniform": "~loguniform(1, 1000)",
    "normal": "~normal(200, 15)",
    "choice": "~choice(disc, hoop)",
}
NO_LOGARITHM = "has no logarithm: 0 lies between its ends, or is one"
_CALL = re.compile(r"~\s*(\w*)\s*(?:\((.*)\))?", re.DOTALL).fullmatch
_RANGE = re.compile(r"[-+.\d][^:\s]*(?::[^:\s]*)+").fullmatch
_DECIMAL = re.compile(
    r"[-+]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][-+]?\d{1,3})?"
).fullmatch


@dataclass(frozen=True)
class Value:
    """One value of a key."""

    text: str  # YAML, as `--set` takes it
    data: Any  # the parsed value: None, bool, int, float, str, list or dict

    @property
    def cell(self) -> Cell:
        """Return a value as tables have it; lists and mappings become YAML text."""
        return self.text if isinstance(self.data, list | dict) else self.data


def split(text: str) -> Iterator[tuple[str, bool]]:
    """Return parts between commas that are outside brackets and quotes, and whether each is bare text.

    Raise RefusedError for what is no YAML.

    >>> list(split("1, [2, 3],'a,b'"))
    [('1', True), ('[2, 3]', False), ("'a,b'", False)]
    """
    try:
        root = yaml.compose(f"[{text}\n]", Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError):
        fix = "close brackets and quotes, and put text that holds such a character in quotes within quotes"
        raise RefusedError("is not YAML with commas between the values", fix) from None
    nodes = root.value if root is not None else []
    spans = [(node.start_mark.index - 1, node.end_mark.index - 1) for node in nodes]
    begins, ends = [begin for begin, _ in spans], [end for _, end in spans]
    if any(
        "#" in text[begin:end]
        for begin, end in zip([0, *ends], [*begins, len(text)], strict=True)
    ):
        fix = "put text that holds # in quotes within quotes"
        raise RefusedError("holds # after a space, which begins a comment", fix)
    for node, (begin, end) in zip(nodes, spans, strict=True):
        yield (
            text[begin:end].strip(),
            isinstance(node, yaml.ScalarNode) and node.style is None,
        )


def read_values(text: str) -> tuple[Value, ...]:
    """Return values and ranges between commas. Raise RefusedError."""
    values: list[Value] = []
    for part, is_bare in split(text):
        if part.startswith("~"):
            fix = "write the distribution alone, or ~choice(...)"
            raise RefusedError("mixes values and a distribution", fix)
        values += _read_range(part) if is_bare and _RANGE(part) else [_read_value(part)]
    if not values:
        raise RefusedError(
            "has no values",
            "write some, with commas between them; null takes a key away",
        )
    texts: set[str] = set()
    for value in values:
        if (same := repr(value.data)) in texts:
            raise RefusedError(f"has {quoted(value.text, '')} twice", "keep one")
        texts.add(same)
    return tuple(values)


def _read_value(text: str) -> Value:
    try:
        return parse_yaml(text)
    except InputError as error:
        problem = error.problems[0]
        raise RefusedError(
            f"{quoted(text)}: {problem.found} {problem.expected}", problem.fix
        ) from None


def parse_yaml(text: str) -> Value:
    """Raise InputError with messages that name no place."""
    return Value(text, plain(read(text, Source("", Path()), counted=False)))


def number_value(data: int | float) -> Value:
    """Return a number with its shortest exact text."""
    return Value(number(data), data)


def _read_range(text: str) -> list[Value]:
    """Return the numbers of `start:end:count[:log]`, exactly: 0.3 is in 0:1:11. Raise RefusedError."""
    parts = text.split(":")
    fix = "write e.g. 0.1:0.9:5, or 1:1000:4:log; text goes in quotes within quotes"
    if (
        len(parts) not in (3, 4)
        or not all(map(_DECIMAL, parts[:2]))
        or parts[3:] not in ([], ["log"])
    ):
        raise RefusedError("is not start:end:count", fix)
    count = int(parts[2]) if re.fullmatch("[0-9]{1,18}", parts[2]) else 0
    if not 2 <= count <= MAX_COUNT:
        raise RefusedError(f"has no count from 2 to {MAX_COUNT:,} behind its ends", fix)
    begin, end = map(Fraction, parts[:2])
    if begin == end:
        raise RefusedError(
            "ends where it begins", f"write {parts[0]} alone, or another end"
        )
    if not parts[3:]:
        exact = [begin + (end - begin) * Fraction(k, count - 1) for k in range(count)]
    elif begin * end > 0:
        inner = (
            _log_between(float(begin), float(end), k / (count - 1))
            for k in range(1, count - 1)
        )
        exact = [begin, *map(Fraction, inner), end]
    else:
        raise RefusedError(NO_LOGARITHM, "take both above 0, or both below")
    return [
        number_value(
            int(value)
            if value.denominator == 1 and abs(value) < EXACT_INT
            else float(value)
        )
        for value in exact
    ]


def _log_between(low: float, high: float, share: float) -> float:
    """Return numbers between two of one sign, even in the logarithm; rounded to 15 digits: 10 is in 1:1000:4."""
    begin, end = log(abs(low)), log(abs(high))
    size = float(f"{exp(begin + share * (end - begin)):.15g}")
    size = min(max(size, min(abs(low), abs(high))), max(abs(low), abs(high)))
    return size if low > 0 else -size


@dataclass(frozen=True)
class Distribution:
    """Distribution of the values of one key."""

    name: str  # one of EXAMPLES
    numbers: tuple[
        float, ...
    ] = ()  # both ends; of a normal distribution its mean and its standard deviation
    values: tuple[Value, ...] = ()  # of a choice; a repeated value is drawn more often

    def at(self, share: float) -> Value:
        """Return the quantile: that share of draws is below the value, 0 < share < 1."""
        if self.name == "choice":
            return self.values[int(share * len(self.values))]
        low, high = self.numbers
        if self.name == "uniform":
            return number_value(low + share * (high - low))
        if self.name == "loguniform":
            return number_value(_log_between(low, high, share))
        return number_value(NormalDist(low, high).inv_cdf(share))


def read_distribution(text: str) -> Distribution:
    """Parse `~NAME(...)`. Raise RefusedError."""
    call = _CALL(text)
    name = call[1].lower() if call else ""
    if call is None or name not in EXAMPLES:
        close = nearest(name, EXAMPLES)
        fix = (
            f"did you mean {EXAMPLES[close]}?"
            if close
            else f"write {listed(EXAMPLES.values())}"
        )
        raise RefusedError(f"names no {'known ' * bool(name)}distribution", fix)
    parts = [part for part, _ in split(call[2] or "")]
    if name == "choice":
        distribution = Distribution(name, values=tuple(map(_read_value, parts)))
        fault = "has not two values to choose from" if len(parts) < 2 else ""
    else:
        distribution = Distribution(
            name, tuple(float(part) for part in parts if _DECIMAL(part))
        )
        fault = _fault(distribution, len(parts))
    if fault:
        raise RefusedError(fault, f"write e.g. {EXAMPLES[name]}")
    return distribution


def _fault(found: Distribution, parts: int) -> str:
    """Return the fault of the numbers of a distribution with so many parts."""
    numbers = found.numbers
    if found.name == "normal":
        if len(numbers) != 2 or parts != 2 or not all(map(isfinite, numbers)):
            return "does not hold a mean and a standard deviation"
        return "" if numbers[1] > 0 else f"has a standard deviation of {numbers[1]:g}"
    if (
        len(numbers) != 2
        or parts != 2
        or not all(map(isfinite, (*numbers, numbers[1] - numbers[0])))
    ):
        return "does not hold two numbers"
    if numbers[0] >= numbers[1]:
        return "goes down, or nowhere"
    return (
        NO_LOGARITHM
        if found.name == "loguniform" and numbers[0] * numbers[1] <= 0
        else ""
    )
