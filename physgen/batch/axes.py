"""Arguments `KEY=VALUES` of a sweep as axes: keys of a scene with listed or drawn values."""

from __future__ import annotations

import json
import re
import shlex
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import Any

from physgen.batch.distributions import (
    EXAMPLES,
    Choice,
    Distribution,
    Integers,
    Steps,
    is_range,
    read_distribution,
    read_range,
)
from physgen.batch.values import Value, ValueTextError, kind_of, parse_yaml, split
from physgen.problems import InputError, Place, Problem
from physgen.scene.overlay import parse_key
from physgen.tables import Kind
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

    parts: tuple[Value | Steps, ...]

    def __len__(self) -> int:
        return self._starts[-1]

    def at(self, index: int) -> Value:
        """Value `index`, from 0. Raises IndexError."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        which = bisect_right(self._starts, index) - 1
        part = self.parts[which]
        return part.at(index - self._starts[which]) if isinstance(part, Steps) else part

    @cached_property
    def _starts(self) -> tuple[int, ...]:
        """Index of the first value of each part, and the number of values."""
        counts = (part.count if isinstance(part, Steps) else 1 for part in self.parts)
        return tuple(accumulate(counts, initial=0))

    @cached_property
    def kind(self) -> Kind:
        """Of its column."""
        return kind_of(
            (0 if part.whole else 0.5) if isinstance(part, Steps) else part.data for part in self.parts
        )


@dataclass(frozen=True)
class Drawn(Key):
    """Values of a distribution."""

    distribution: Distribution
    each: bool = False
    """Every key that the wildcards match has its own draws; see `per_object`."""

    @cached_property
    def kind(self) -> Kind:
        """Of its column."""
        if isinstance(self.distribution, Choice):
            return kind_of(value.data for value in self.distribution.values)
        return Kind.WHOLE if isinstance(self.distribution, Integers) else Kind.NUMBER


Axis = Listed | Drawn


def read_axes(arguments: Sequence[str]) -> tuple[Axis, ...]:
    """Axes in the order of the arguments. Raises InputError with the problems of all of them."""
    problems: list[Problem] = []
    axes: list[Axis] = []
    for pieces in _grouped(arguments):
        argument = " ".join(pieces)
        try:
            if len(pieces) > 1:
                found = f"came in {len(pieces)} pieces: a shell splits at spaces"
                raise ValueTextError(found, f"put it in quotes: {shlex.quote(argument)}")
            axes.append(_read_axis(argument))
        except ValueTextError as error:
            problems.append(Problem(Key("", argument).place, "", "", error.expected, error.fix))
    problems += _conflicts(axes)
    if problems:
        raise InputError(problems)
    return tuple(axes)


def _grouped(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Each `KEY=...` with the arguments without `=` that follow it: the shell may have split one."""
    group: list[str] = []
    for argument in arguments:
        if group and ("=" in argument or "=" not in group[0]):
            yield group
            group = []
        group.append(argument)
    if group:
        yield group


def _read_axis(argument: str) -> Axis:
    """Raises ValueTextError."""
    key, equals, values = (part.strip() for part in argument.partition("="))
    example = f"write e.g. {EXAMPLE}"
    if not equals:
        raise ValueTextError("has no =", f"write KEY=VALUES, e.g. {EXAMPLE}")
    if parse_key(key) is None:
        raise ValueTextError(f"{quoted(key)} is not a dotted key" if key else "has no key", example)
    if not values:
        raise ValueTextError("has no values", f"{example}; null takes a key away")
    if each := _EACH(values):
        if not WILDCARDS & set(parse_key(key) or ()):
            raise ValueTextError("is one key, and has one draw as it is", f"write {key}=~{each[1].strip()}")
        return Drawn(key, argument, read_distribution(f"~{each[1].strip()}"), each=True)
    if values.startswith("~"):
        return Drawn(key, argument, read_distribution(values))
    if (call := re.match(r"([\w-]+)\s*\(", values)) and re.sub("[-_]", "", call[1]) in EXAMPLES:
        raise ValueTextError("is text as it stands", f"a distribution begins with ~: {key}=~{values}")
    return Listed(key, argument, tuple(_parts(values)))


def _parts(values: str) -> Iterator[Value | Steps]:
    seen: set[str] = set()
    for text in split(values):
        if not text:
            raise ValueTextError(
                "has an empty value between commas", "take the comma away; null takes a key away"
            )
        if text.startswith("~"):
            raise ValueTextError(
                "mixes values and a distribution", "write the distribution alone, or ~choice(...)"
            )
        if is_range(text):
            yield read_range(text)
            continue
        try:
            value = parse_yaml(text)
        except InputError as error:
            problem = error.problems[0]
            raise ValueTextError(f"{quoted(text)}: {problem.found} {problem.expected}", problem.fix) from None
        if (canonical := json.dumps(value.data)) in seen:
            raise ValueTextError(f"has {quoted(text, '')} twice", "keep one")
        seen.add(canonical)
        yield value


def _conflicts(axes: Sequence[Axis]) -> Iterator[Problem]:
    """Axes that override all of an earlier one."""
    for n, later in enumerate(axes):
        for former in axes[:n]:
            if same_key(former) == same_key(later):
                fix = f"write one argument: {later.key}=VALUE,VALUE; a shell makes several of {{VALUE,VALUE}}"
                yield Problem(later.place, "", "", f"sets a key that {former.place} sets already", fix)
                break
            if _covers(later.path, former.path):
                fix = "keep one of them, or set the parts of the one"
                yield Problem(later.place, "", "", f"leaves nothing of {former.place}", fix)
                break


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
