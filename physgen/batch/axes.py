"""Parse the arguments `KEY=VALUES` of a sweep into axes. An axis is a scene key with
listed or drawn values.
"""

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
from physgen.messages import Message
from physgen.problems import InputError, Place, Problem, RefusedError
from physgen.scene.overlay import parse_key
from physgen.text import KeyPath, quoted

EXAMPLE = "objects.ball.mass=100,200"


@dataclass(frozen=True)
class Key:
    """A scene key with several values in a sweep."""

    # Dotted, in the syntax of `--set`.
    key: str
    # The whole argument, for messages.
    argument: str

    @property
    def path(self) -> KeyPath:
        """Return the key's parts."""
        parts = parse_key(self.key)
        assert parts is not None
        return parts

    @property
    def place(self) -> Place:
        """Return the argument as the place of a problem."""
        return Place(quoted(self.argument, "", 80))


@dataclass(frozen=True)
class ListAxis(Key):
    """An axis of the grid: a key with listed values."""

    values: tuple[Value, ...]


@dataclass(frozen=True)
class DistributionAxis(Key):
    """A key with values from a distribution."""

    distribution: Distribution


Axis = ListAxis | DistributionAxis


def read_axes(arguments: Sequence[str]) -> tuple[Axis, ...]:
    """Return the axes in the order of the arguments. Raise InputError with all problems
    of all arguments.
    """
    problems: list[Problem] = []
    axes: list[Axis] = []
    for argument in arguments:
        try:
            axes.append(_read_axis(argument))
        except RefusedError as error:
            problems.append(error.problem(Key("", argument).place))
    # A later axis would overwrite an earlier one with the same key or with a key inside
    # its value.
    for n, later in enumerate(axes):
        for former in axes[:n]:
            if _covers(later.path, former.path):
                message = Message.AXIS_COVERED
                problem = message.problem(
                    later.place, other=former.place, key=former.key
                )
                problems.append(problem)
                break
    if problems:
        raise InputError(problems)
    return tuple(axes)


def _read_axis(argument: str) -> Axis:
    """Parse one argument. Raise RefusedError."""
    key, equals, values = (part.strip() for part in argument.partition("="))
    if not equals:
        raise Message.AXIS_WITHOUT_VALUES.refusal()
    if parse_key(key) is None:
        if not key:
            raise Message.AXIS_WITHOUT_KEY.refusal(example=EXAMPLE)
        raise Message.AXIS_KEY_WRONG.refusal(key=quoted(key), example=EXAMPLE)
    if values.startswith("~"):
        return DistributionAxis(key, argument, read_distribution(values))
    # `~uniform(...)` without its tilde would be taken for a list of texts.
    if (call := re.match(r"(\w+)\s*\(", values)) and call[1] in EXAMPLES:
        raise Message.AXIS_IS_TEXT.refusal(key=key, values=values)
    return ListAxis(key, argument, read_values(values))


def same_key(axis: Axis) -> str:
    """Return the key in one spelling: `pivot[0]` becomes `pivot.0`."""
    return ".".join(map(_strip_brackets, axis.path))


def _covers(later: KeyPath, former: KeyPath) -> bool:
    """Return whether the later key sets all values below the former key. `*` covers
    every name.
    """
    pairs = zip(map(_strip_brackets, later), map(_strip_brackets, former), strict=False)
    return len(later) <= len(former) and all(a in ("*", b) for a, b in pairs)


def _strip_brackets(part: object) -> str:
    return str(part).strip("[]")
