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

from physgen.batch import distributions
from physgen.batch.distributions import Choice, Distribution, Integers, Steps
from physgen.batch.values import SplitError, Value, WrongError, kind_of, split, yaml
from physgen.problems import InputError, Place, Problem
from physgen.scene.overlay import parse_key
from physgen.tables import Kind
from physgen.text import KeyPath, dotted, quoted

# ----------------------------------------------------------------------
# Arguments `KEY=VALUES` -> axes: keys of a scene, each with its values or the distribution of its draws.

STARS = {"*", "[*]"}
"""Parts of a key that stand for several."""
_EACH = re.compile(r"\s*~\s*each\s+(.*)", re.DOTALL).fullmatch
EXAMPLE = "objects.ball.mass=100,200"


@dataclass(frozen=True)
class Key:
    """One key that varies."""

    key: str
    """Dotted, as `--set` takes it."""
    argument: str
    """All of it, as it was written."""

    @property
    def path(self) -> KeyPath:
        """The key's parts."""
        found = parse_key(self.key)
        assert found is not None
        return found

    @property
    def place(self) -> Place:
        """Where messages point."""
        return place_of(self.argument)


@dataclass(frozen=True)
class Listed(Key):
    """Values one by one: an axis of the grid."""

    parts: tuple[Value | Steps, ...]

    def __len__(self) -> int:
        return self._begins[-1]

    def at(self, index: int) -> Value:
        """One of them, from 0."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        which = bisect_right(self._begins, index) - 1
        part = self.parts[which]
        return part.at(index - self._begins[which]) if isinstance(part, Steps) else part

    @cached_property
    def _begins(self) -> tuple[int, ...]:
        """Index of the first value of each part, and of the one that would come next."""
        return tuple(
            accumulate((part.count if isinstance(part, Steps) else 1 for part in self.parts), initial=0)
        )

    @cached_property
    def kind(self) -> Kind:
        """Of its values."""
        return kind_of(
            (0 if part.whole else 0.5) if isinstance(part, Steps) else part.data for part in self.parts
        )

    @property
    def telling(self) -> Iterator[int]:
        """Indices of the values that somebody wrote: of a range its ends."""
        index = 0
        for part in self.parts:
            yield index
            if isinstance(part, Steps):
                index += part.count - 1
                yield index
            index += 1


@dataclass(frozen=True)
class Drawn(Key):
    """Values by a distribution."""

    distribution: Distribution
    each: bool = False
    """The key's stars stand for draws of their own: see `batch.each`."""

    @cached_property
    def kind(self) -> Kind:
        """Of its values."""
        if isinstance(self.distribution, Choice):
            return kind_of(value.data for value in self.distribution.values)
        return Kind.WHOLE if isinstance(self.distribution, Integers) else Kind.NUMBER


Axis = Listed | Drawn


def place_of(argument: str) -> Place:
    """An argument as messages name it."""
    return Place(quoted(argument, "", 80))


def read_axes(arguments: Sequence[str]) -> tuple[Axis, ...]:
    """In the order in which they are written; raises InputError with what is wrong with each."""
    problems: list[Problem] = []
    axes: list[Axis] = []
    for pieces in _pieces(arguments):
        try:
            axes.append(_whole(pieces))
        except InputError as error:
            problems += error.problems
    problems += _clashes(axes)
    if problems:
        raise InputError(problems)
    return tuple(axes)


def _pieces(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Each `KEY=...` with what follows it and is none: the shell may have split it."""
    group: list[str] = []
    for argument in arguments:
        if group and ("=" in argument or "=" not in group[0]):
            yield group
            group = []
        group.append(argument)
    if group:
        yield group


def _whole(pieces: Sequence[str]) -> Axis:
    argument = " ".join(pieces)
    if len(pieces) > 1:
        fix = f"put it in quotes: {shlex.quote(argument)}"
        raise _wrong(argument, f"came in {len(pieces)} pieces: a shell splits at spaces", fix)
    key, equals, values = argument.partition("=")
    key = key.strip()
    if not equals:
        raise _wrong(argument, "has no =", f"write KEY=VALUES, e.g. {EXAMPLE}")
    if parse_key(key) is None:
        raise _wrong(
            argument, f"{quoted(key)} is not a dotted key" if key else "has no key", f"write e.g. {EXAMPLE}"
        )
    if not values.strip():
        raise _wrong(argument, "has no values", f"write e.g. {EXAMPLE}; null takes a key away")
    try:
        if each := _EACH(values):
            if not STARS & set(parse_key(key) or ()):
                raise WrongError("is one key, and has one draw as it is", f"write {key}=~{each[1].strip()}")
            return Drawn(key, argument, distributions.read_distribution(f"~{each[1].strip()}"), each=True)
        if values.lstrip().startswith("~"):
            return Drawn(key, argument, distributions.read_distribution(values.strip()))
        if (call := re.match(r"\s*([\w-]+)\s*\(", values)) and re.sub(
            "[-_]", "", call[1]
        ) in distributions.FORMS:
            raise WrongError("is text as it stands", f"a distribution begins with ~: {key}=~{values.strip()}")
        return Listed(key, argument, _parts(values))
    except WrongError as error:
        raise _wrong(argument, error.expected, error.fix) from None


def _parts(values: str) -> tuple[Value | Steps, ...]:
    try:
        texts = split(values)
    except SplitError as error:
        fix = "close it, or put text that holds it in quotes within quotes"
        raise WrongError(f"has a {error.mark} without its partner", fix) from None
    parts: list[Value | Steps] = []
    seen: set[str] = set()
    for text in texts:
        if not text:
            raise WrongError(
                "has an empty value between commas", "take the comma away; null takes a key away"
            )
        if text.startswith("~"):
            raise WrongError(
                "mixes values and a distribution", "write the distribution alone, or ~choice(...)"
            )
        if distributions.is_range(text):
            parts.append(distributions.read_range(text))
            continue
        try:
            value = yaml(text)
        except InputError as error:
            problem = error.problems[0]
            raise WrongError(f"{quoted(text)}: {problem.found} {problem.expected}", problem.fix) from None
        if (told := json.dumps(value.data)) in seen:
            raise WrongError(f"has {quoted(text, '')} twice", "keep one")
        seen.add(told)
        parts.append(value)
    return tuple(parts)


def _wrong(argument: str, expected: str, fix: str) -> InputError:
    return InputError([Problem(place_of(argument), "", "", expected, fix)])


def _clashes(axes: Sequence[Axis]) -> Iterator[Problem]:
    """Axes that leave nothing of one before them."""
    for n, later in enumerate(axes):
        for former in axes[:n]:
            if same_key(former) == same_key(later):
                fix = f"write one argument: {later.key}=VALUE,VALUE; a shell makes several of {{VALUE,VALUE}}"
                yield Problem(later.place, "", "", f"sets a key that {former.place} sets already", fix)
                break
            if covers(later.path, former.path):
                fix = "keep one of them, or set the parts of the one"
                yield Problem(later.place, "", "", f"leaves nothing of {former.place}", fix)
                break


def same_key(axis: Axis) -> str:
    """The key spelt in one way: `pivot[0]` as `pivot.0`."""
    return ".".join(map(_bare, axis.path))


def covers(later: KeyPath, former: KeyPath) -> bool:
    """Whether all that the former key names lies within what the later one does."""
    pairs = zip(map(_bare, later), map(_bare, former), strict=False)
    return len(later) <= len(former) and all(a in ("*", b) for a, b in pairs)


def _bare(part: object) -> str:
    return str(part).strip("[]")


# ----------------------------------------------------------------------
# `objects.*.mass=~each uniform(50, 200)` and a scene -> a key with draws of its own for each thing that `*`
# means.


def per_object(axes: Sequence[Axis], documents: Sequence[Any]) -> tuple[Axis, ...]:
    """All axes, those with `each` as one for each key that they mean; what a later axis sets anyway is left out.

    `documents` are the resolved scenes that the sweep starts from, as plain data: what some of them lack is no key.
    Raises InputError where there is none at all.
    """
    found: list[Axis] = []
    problems: list[Problem] = []
    for n, axis in enumerate(axes):
        if not isinstance(axis, Drawn) or not axis.each:
            found.append(axis)
            continue
        ways = [list(_meant(document, axis.path)) for document in documents]
        common = [way for way in ways[0] if all(way in others for others in ways[1:])]
        if not common:
            problems.append(
                Problem(axis.place, "", "", "means nothing that the scene has", "see the key's first parts")
            )
        text = axis.argument.partition("=")[2].lstrip(" ~").removeprefix("each").strip()
        for way in common:
            if not any(covers(later.path, way) for later in axes[n + 1 :]):
                key = dotted(way)
                found.append(replace(axis, key=key, argument=f"{key}=~{text}", each=False))
    if problems:
        raise InputError(problems)
    return tuple(found)


def _meant(document: Any, path: KeyPath, way: KeyPath = ()) -> Iterator[KeyPath]:
    """Ways that the path means, its stars replaced; what stands behind the last star need not be there."""
    star = next((k for k, part in enumerate(path) if part in STARS), None)
    if star is None:
        yield (*way, *path)
        return
    place = document
    for part in path[:star]:
        place = _child(place, part)
    if isinstance(place, list) and path[star] in ("*", "[*]"):
        children: Iterator[tuple[str | int, Any]] = iter(enumerate(place))
    elif path[star] == "*" and hasattr(place, "items"):
        children = iter(place.items())
    else:
        return
    for name, child in children:
        yield from _meant(child, path[star + 1 :], (*way, *path[:star], name))


def _child(place: Any, part: str | int) -> Any:
    """None where there is none."""
    if isinstance(place, list):
        return place[int(part)] if str(part).isdecimal() and int(part) < len(place) else None
    return place.get(part) if hasattr(place, "get") else None
