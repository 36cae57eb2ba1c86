"""Arguments `KEY=VALUES` of a sweep as axes: keys of a scene with listed or drawn values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from physgen.batch.values import (
    EXAMPLES,
    Distribution,
    Value,
    read_distribution,
    read_values,
)
from physgen.problems import InputError, Place, Problem, RefusedError
from physgen.scene.overlay import parse_key
from physgen.text import KeyPath, quoted

EXAMPLE = "objects.ball.mass=100,200"


@dataclass(frozen=True)
class Key:
    """One key that varies."""

    key: str  # dotted, as `--set` takes it
    argument: str  # the whole argument as written

    @property
    def path(self) -> KeyPath:
        """Return the key's parts."""
        parts = parse_key(self.key)
        assert parts is not None
        return parts

    @property
    def place(self) -> Place:
        """Return the argument as messages name it."""
        return Place(quoted(self.argument, "", 80))


@dataclass(frozen=True)
class Listed(Key):
    """Values one by one: an axis of the grid."""

    values: tuple[Value, ...]


@dataclass(frozen=True)
class Drawn(Key):
    """Values of a distribution."""

    distribution: Distribution


Axis = Listed | Drawn


def read_axes(arguments: Sequence[str]) -> tuple[Axis, ...]:
    """Return axes in the order of the arguments. Raise InputError with the problems of all of them."""
    problems: list[Problem] = []
    axes: list[Axis] = []
    for argument in arguments:
        try:
            axes.append(_read_axis(argument))
        except RefusedError as error:
            problems.append(
                Problem(Key("", argument).place, "", "", error.expected, error.fix)
            )
    for n, later in enumerate(axes):
        for former in axes[:n]:
            if _covers(later.path, former.path):
                found = f"leaves nothing of {former.place}"
                fix = f"keep one; several values go into one argument: {former.key}=VALUE,VALUE"
                problems.append(Problem(later.place, "", "", found, fix))
                break
    if problems:
        raise InputError(problems)
    return tuple(axes)


def _read_axis(argument: str) -> Axis:
    """Raise RefusedError."""
    key, equals, values = (part.strip() for part in argument.partition("="))
    if not equals:
        raise RefusedError(
            "has no =",
            f"write KEY=VALUES, in quotes where it has spaces, e.g. {EXAMPLE}",
        )
    if parse_key(key) is None:
        fault = f"{quoted(key)} is not a dotted key" if key else "has no key"
        raise RefusedError(fault, f"write e.g. {EXAMPLE}")
    if values.startswith("~"):
        return Drawn(key, argument, read_distribution(values))
    if (call := re.match(r"(\w+)\s*\(", values)) and call[1] in EXAMPLES:
        raise RefusedError(
            "is text as it stands", f"a distribution begins with ~: {key}=~{values}"
        )
    return Listed(key, argument, read_values(values))


def same_key(axis: Axis) -> str:
    """Return the key in one spelling: `pivot[0]` as `pivot.0`."""
    return ".".join(map(_bare, axis.path))


def _covers(later: KeyPath, former: KeyPath) -> bool:
    """Return whether the later key sets everything that the former key names."""
    pairs = zip(map(_bare, later), map(_bare, former), strict=False)
    return len(later) <= len(former) and all(a in ("*", b) for a, b in pairs)


def _bare(part: object) -> str:
    return str(part).strip("[]")
