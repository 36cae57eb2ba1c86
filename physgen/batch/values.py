"""Parse the values of a sweep's arguments: YAML between commas, ranges `a:b:n`, and
distributions `~uniform(a, b)`.
"""

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

from physgen.messages import Message
from physgen.problems import InputError
from physgen.scene.document import Source, read, to_plain_data
from physgen.tables import Cell
from physgen.text import listed, nearest, number, quoted

MAX_COUNT = 100_000
"""Maximum number of values in a range."""
EXACT_INT = 2**53
"""From this number on, a float does not hold every whole number."""
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

    # YAML, in the syntax of `--set`.
    text: str
    # Parsed value: None, bool, int, float, str, list or dict.
    data: Any

    @property
    def cell(self) -> Cell:
        """Return the cell of a table. Lists and mappings become YAML text."""
        if isinstance(self.data, list | dict):
            return self.text
        cell: Cell = self.data
        return cell


def split(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the parts between commas outside brackets and quotes, and whether each is
    bare text.

    Raise RefusedError for invalid YAML.

    >>> list(split("1, [2, 3],'a,b'"))
    [('1', True), ('[2, 3]', False), ("'a,b'", False)]
    """
    try:
        # The newline ends a comment before the closing bracket, so that the check below
        # can report it.
        root = yaml.compose(f"[{text}\n]", Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError, ValueError):
        raise Message.VALUES_NOT_YAML.refusal() from None
    if root is not None:
        nodes = root.value
    else:
        nodes = []
    # Subtract the added bracket.
    spans = [(node.start_mark.index - 1, node.end_mark.index - 1) for node in nodes]
    begins, ends = [begin for begin, _ in spans], [end for _, end in spans]
    if any(
        "#" in text[begin:end]
        for begin, end in zip([0, *ends], [*begins, len(text)], strict=True)
    ):
        raise Message.VALUES_WITH_COMMENT.refusal()
    for node, (begin, end) in zip(nodes, spans, strict=True):
        yield (
            text[begin:end].strip(),
            isinstance(node, yaml.ScalarNode) and node.style is None,
        )


def read_values(text: str) -> tuple[Value, ...]:
    """Return the values and ranges between commas. Raise RefusedError."""
    values: list[Value] = []
    for part, is_bare in split(text):
        if part.startswith("~"):
            raise Message.VALUES_MIXED.refusal()
        values += _read_range(part) if is_bare and _RANGE(part) else [_read_value(part)]
    if not values:
        raise Message.VALUES_MISSING.refusal()
    value_texts: set[str] = set()
    for value in values:
        if (value_text := repr(value.data)) in value_texts:
            raise Message.TWICE_IN_LIST.refusal(value=quoted(value.text, ""))
        value_texts.add(value_text)
    return tuple(values)


def _read_value(text: str) -> Value:
    try:
        return parse_yaml(text)
    except InputError as error:
        problem = error.problems[0]
        reason = f"{problem.found} {problem.expected}"
        wrong = Message.VALUE_NOT_YAML
        raise wrong.refusal(
            value=quoted(text), reason=reason, fix=problem.fix
        ) from None


def parse_yaml(text: str) -> Value:
    """Parse YAML. Raise InputError with problems without places."""
    return Value(text, to_plain_data(read(text, Source("", Path()), has_lines=False)))


def number_value(data: int | float) -> Value:
    """Return a number with its shortest exact text."""
    return Value(number(data), data)


def _read_range(text: str) -> list[Value]:
    """Return the numbers of `start:end:count[:log]`. Raise RefusedError.

    The numbers are computed as fractions, so that 0:1:11 holds 0.3.
    """
    parts = text.split(":")
    if (
        len(parts) not in (3, 4)
        or not all(map(_DECIMAL, parts[:2]))
        or parts[3:] not in ([], ["log"])
    ):
        raise Message.NOT_A_RANGE.refusal()
    count = 0
    # Other text leaves a count of 0, which the next test refuses.
    if re.fullmatch("[0-9]{1,18}", parts[2]):
        count = int(parts[2])
    if not 2 <= count <= MAX_COUNT:
        raise Message.RANGE_COUNT.refusal(most=MAX_COUNT)
    begin, end = map(Fraction, parts[:2])
    if begin == end:
        raise Message.RANGE_WITHOUT_LENGTH.refusal(value=parts[0])
    if not parts[3:]:
        exact = [begin + (end - begin) * Fraction(k, count - 1) for k in range(count)]
    elif begin * end > 0:
        inner = (
            _log_between(float(begin), float(end), k / (count - 1))
            for k in range(1, count - 1)
        )
        exact = [begin, *map(Fraction, inner), end]
    else:
        raise Message.RANGE_WITHOUT_LOGARITHM.refusal()
    return [
        number_value(
            int(value)
            if value.denominator == 1 and abs(value) < EXACT_INT
            else float(value)
        )
        for value in exact
    ]


def _log_between(low: float, high: float, share: float) -> float:
    """Return a number between two numbers of one sign, by linear interpolation of the
    logarithm. It is rounded to 15 digits, so that 1:1000:4 holds 10.
    """
    begin, end = log(abs(low)), log(abs(high))
    size = float(f"{exp(begin + share * (end - begin)):.15g}")
    # Rounding must not leave the range.
    size = min(max(size, min(abs(low), abs(high))), max(abs(low), abs(high)))
    if low > 0:
        return size
    return -size


@dataclass(frozen=True)
class Distribution:
    """The distribution of the values of one key."""

    # One of EXAMPLES.
    name: str
    # Both ends, or mean and standard deviation of a normal distribution.
    numbers: tuple[float, ...] = ()
    # Choices; a repeated value is drawn more often.
    values: tuple[Value, ...] = ()

    def quantile(self, share: float) -> Value:
        """Return the quantile of a share: the share of draws below this value, 0 <
        share < 1.
        """
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
    name = ""
    if call:
        name = call[1].lower()
    if call is None or name not in EXAMPLES:
        close = nearest(name, EXAMPLES)
        fix = f"write {listed(EXAMPLES.values())}"
        if close:
            fix = f"did you mean {EXAMPLES[close]}?"
        raise Message.UNKNOWN_DISTRIBUTION.refusal(fix=fix)
    parts = [part for part, _ in split(call[2] or "")]
    if name == "choice":
        distribution = Distribution(name, values=tuple(map(_read_value, parts)))
        fault = ""
        if len(parts) < 2:
            fault = "has not two values to choose from"
    else:
        distribution = Distribution(
            name, tuple(float(part) for part in parts if _DECIMAL(part))
        )
        fault = _fault(distribution, len(parts))
    if fault:
        wrong = Message.DISTRIBUTION_WRONG
        raise wrong.refusal(fault=fault, example=EXAMPLES[name])
    return distribution


def _fault(distribution: Distribution, parts: int) -> str:
    """Return the fault of a distribution's numbers, or an empty text. `parts` counts
    the parts between commas.
    """
    numbers = distribution.numbers
    if distribution.name == "normal":
        if len(numbers) != 2 or parts != 2 or not all(map(isfinite, numbers)):
            return "does not hold a mean and a standard deviation"
        if numbers[1] > 0:
            return ""
        return f"has a standard deviation of {numbers[1]:g}"
    # The width of the interval must be finite too, and it can overflow between two
    # finite ends.
    if (
        len(numbers) != 2
        or parts != 2
        or not all(map(isfinite, (*numbers, numbers[1] - numbers[0])))
    ):
        return "does not hold two numbers"
    if numbers[0] >= numbers[1]:
        return "goes down, or nowhere"
    if distribution.name == "loguniform" and numbers[0] * numbers[1] <= 0:
        return NO_LOGARITHM
    return ""
