"""Arguments `KEY=VALUES` of a sweep as axes: keys of a scene with listed or drawn values."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from physgen.batch.values import EXAMPLES, Distribution, Value, ValueTextError, read_distribution, read_values
from physgen.problems import InputError, Place, Problem
from physgen.scene.overlay import parse_key
from physgen.text import KeyPath, dotted, quoted

WILDCARDS = {"*", "[*]"}
"""Parts of a key that stand for several."""
EXAMPLE = "objects.ball.mass=100,200"
_EACH = re.compile(r"\s*~\s*each\s+(.*)", re.DOTALL).fullmatch


@dataclass(frozen=True)
class Key:
    """One key that varies."""

    key: str
    """Dotted, as `--set` takes it."""
    argument: str
    """The whole argument as written."""

    @property
    def path(self) -> KeyPath:
        """The key's parts."""
        found = parse_key(self.key)
        assert found is not None
        return found

    @property
    def place(self) -> Place:
        """The argument as messages name it."""
        return Place(quoted(self.argument, "", 80))


@dataclass(frozen=True)
class Listed(Key):
    """Values one by one: an axis of the grid."""

    values: tuple[Value, ...]


@dataclass(frozen=True)
class Drawn(Key):
    """Values of a distribution."""

    distribution: Distribution
    each: bool = False
    """Every key that the wildcards match has its own draws; see `per_object`."""


Axis = Listed | Drawn


def read_axes(arguments: Sequence[str]) -> tuple[Axis, ...]:
    """Axes in the order of the arguments. Raises InputError with the problems of all of them."""
    problems: list[Problem] = []
    axes: list[Axis] = []
    for argument in arguments:
        try:
            axes.append(_read_axis(argument))
        except ValueTextError as error:
            problems.append(Problem(Key("", argument).place, "", "", error.expected, error.fix))
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
    """Raises ValueTextError."""
    key, equals, values = (part.strip() for part in argument.partition("="))
    if not equals:
        raise ValueTextError("has no =", f"write KEY=VALUES, in quotes where it has spaces, e.g. {EXAMPLE}")
    if parse_key(key) is None:
        found = f"{quoted(key)} is not a dotted key" if key else "has no key"
        raise ValueTextError(found, f"write e.g. {EXAMPLE}")
    if each := _EACH(values):
        if not WILDCARDS & set(parse_key(key) or ()):
            raise ValueTextError("is one key, and has one draw as it is", f"write {key}=~{each[1].strip()}")
        return Drawn(key, argument, read_distribution(f"~{each[1].strip()}"), each=True)
    if values.startswith("~"):
        return Drawn(key, argument, read_distribution(values))
    if (call := re.match(r"(\w+)\s*\(", values)) and call[1] in EXAMPLES:
        raise ValueTextError("is text as it stands", f"a distribution begins with ~: {key}=~{values}")
    return Listed(key, argument, read_values(values))


def same_key(axis: Axis) -> str:
    """The key in one spelling: `pivot[0]` as `pivot.0`."""
    return ".".join(map(_bare, axis.path))


def _covers(later: KeyPath, former: KeyPath) -> bool:
    """Whether everything that the former key names lies within what the later one sets."""
    pairs = zip(map(_bare, later), map(_bare, former), strict=False)
    return len(later) <= len(former) and all(a in ("*", b) for a, b in pairs)


def _bare(part: object) -> str:
    return str(part).strip("[]")


def per_object(axes: Sequence[Axis], documents: Sequence[Any]) -> tuple[Axis, ...]:
    """Replaces axes with `each` by one axis for every key that they match and no later axis sets.

    `documents` are the resolved scenes that the sweep starts from, as plain data; a key must be in all of them.
    Raises InputError where an axis matches nothing.
    """
    found: list[Axis] = []
    problems: list[Problem] = []
    for n, axis in enumerate(axes):
        if not isinstance(axis, Drawn) or not axis.each:
            found.append(axis)
            continue
        matches = [list(_matches(document, axis.path)) for document in documents]
        common = [path for path in matches[0] if all(path in others for others in matches[1:])]
        if not common:
            fix = "see the key's first parts"
            problems.append(Problem(axis.place, "", "", "matches nothing that the scene has", fix))
        text = axis.argument.partition("=")[2].lstrip(" ~").removeprefix("each").strip()
        for path in common:
            if not any(_covers(later.path, path) for later in axes[n + 1 :]):
                key = dotted(path)
                found.append(replace(axis, key=key, argument=f"{key}=~{text}", each=False))
    if problems:
        raise InputError(problems)
    return tuple(found)


def _matches(document: Any, path: KeyPath, before: KeyPath = ()) -> Iterator[KeyPath]:
    """Paths with every wildcard replaced; what follows the last wildcard need not exist."""
    wildcard = next((k for k, part in enumerate(path) if part in WILDCARDS), None)
    if wildcard is None:
        yield (*before, *path)
        return
    place = document
    for part in path[:wildcard]:
        place = _child(place, part)
    names: Sequence[str | int] = ()
    if isinstance(place, list):
        names = range(len(place))
    elif path[wildcard] == "*" and hasattr(place, "keys"):
        names = list(place.keys())
    for name in names:
        yield from _matches(_child(place, name), path[wildcard + 1 :], (*before, *path[:wildcard], name))


def _child(document: Any, part: str | int) -> Any:
    """One value of a list or mapping; None where it is missing."""
    if isinstance(document, list):
        return document[int(part)] if str(part).isdecimal() and int(part) < len(document) else None
    return document.get(part) if hasattr(document, "get") else None
