"""A sweep: clips computed from their number alone, their names, and a check before anything is rendered."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from math import prod
from typing import Any

from physgen.batch.axes import Axis, Drawn, Listed, same_key
from physgen.batch.distributions import lot, stratified
from physgen.batch.values import Value
from physgen.problems import InputError, Place, Problem, Severity, by_place
from physgen.report.sweep_keys import shortest_names
from physgen.scene.load import Opened
from physgen.scene.scene import Scene
from physgen.text import KeyPath, listed, quoted

# ----------------------------------------------------------------------
# Where a clip stands in a sweep and what it is set to -> the name of its folder.
#
# `04-01,velocity.x=-500,elasticity=0.9`: the fifth value of the first key, the second of the second. Draws
# count in four
# digits or more: `0007,mass=183.4`. The numbers make names unique and sort them, as people and galleries
# sort, in the
# order of the sweep; what stands behind them is for reading. A value that is added behind an axis, and draws
# that are
# added to draws, leave the names of the others as they are.

BYTES = 100
"""Of a name, at most: file systems take 255, and traces and parts of files are named after it."""
WORD = 24
"""Characters of a value, at most."""


def clip_name(
    variant: int | None,
    said: str | None,
    places: Sequence[int],
    draw: int | None,
    told: Sequence[tuple[str, Value]],
) -> str:
    """`variant`: its index, None where there is one alone; `said`: its name. `told`: short keys with their values."""
    numbers = [f"{place:02d}" for place in ([] if variant is None else [variant]) + [*places]]
    numbers += [] if draw is None else [f"{draw:04d}"]
    parts = ([] if variant is None or said is None else [said]) + [
        f"{key}={short_text(v)}" for key, v in told
    ]
    text = "-".join(numbers)
    for n, part in enumerate(parts):
        longer = f"{text},{part}"
        left = len(parts) - n - 1
        if len(longer.encode()) + (len(f",+{left}") if left else 0) > BYTES:
            return f"{text},+{left + 1}"
        text = longer
    return text


def short_text(value: Value) -> str:
    """A value in about four digits or a word, of characters that no shell and no file system minds.

    >>> [short(Value("", data)) for data in (-500, 0.1 + 0.2, 12345.678, 1.5e-7, True, None, [256, 256], "a b/c")]
    ['-500', '0.3', '12346', '1.5e-7', 'true', 'none', '256x256', 'a_b_c']
    """
    data = value.data
    if isinstance(data, list) and 0 < len(data) <= 4 and all(isinstance(item, int | float) for item in data):
        return "x".join(map(_scalar, data))
    return _scalar(value.text if isinstance(data, list | dict) else data)


def _scalar(data: Any) -> str:
    if data is None or isinstance(data, bool):
        return {None: "none", True: "true", False: "false"}[data]
    if isinstance(data, int | float):
        size = abs(data)
        text = f"{data:.0f}" if (size < 1e7 and data % 1 == 0) or 1e3 <= size < 1e7 else f"{data:.4g}"
        return re.sub(r"e\+?(-?)0*", r"e\1", text)
    return re.sub(r"[^\w.+-]+", "_", str(data)).strip("_.")[:WORD] or "_"


# ----------------------------------------------------------------------
# A scene and axes -> the clips of a sweep, each from its number alone: nothing is listed, so millions take no
# room.
#
# Variants go outermost, then the keys of the grid in the order in which they were written, the last one
# fastest; at every
# point of the grid stand all draws, the same ones, so that points differ in nothing but the grid.

MOST = 10_000_000
"""Clips of a sweep."""


class Design(Enum):
    """How draws lie."""

    INDEPENDENT = "independent"
    """Each by itself; more of them leave the first ones as they are."""
    LATIN = "latin"
    """A Latin hypercube: as evenly as can be for each key by itself; another number is another design."""


@dataclass(frozen=True)
class Point:
    """One clip of a sweep."""

    number: int
    """From 0."""
    name: str
    """Of its folder."""
    variant: str | None
    values: tuple[Value, ...]
    """One for each axis."""
    overrides: tuple[str, ...]
    """`KEY=VALUE`, one for each axis: what `--set` would take."""


@dataclass(frozen=True)
class Sweep:
    """All that is to be made; `sweep[k]` is clip k."""

    axes: tuple[Axis, ...]
    variants: tuple[str | None, ...] = (None,)
    """None is the file itself."""
    samples: int = 0
    """Draws at each point of the grid; 0 where no key is drawn."""
    seed: int = 0
    design: Design = Design.INDEPENDENT

    def __len__(self) -> int:
        return prod(map(len, self._grid)) * max(self.samples, 1) * len(self.variants)

    def __getitem__(self, number: int) -> Point:
        if not 0 <= number < len(self):
            raise IndexError(number)
        rest, draw = divmod(number, max(self.samples, 1))
        places: list[int] = []
        for axis in reversed(self._grid):
            rest, place = divmod(rest, len(axis))
            places.insert(0, place)
        values = self._values(iter(places), draw)
        variant = self.variants[rest]
        several = len(self.variants) > 1
        called = clip_name(
            rest if several else None,
            variant,
            places,
            draw if self.samples else None,
            list(zip(self._short, values, strict=True)),
        )
        return Point(number, called, variant, values, self.set_to(values))

    def __iter__(self) -> Iterator[Point]:
        return map(self.__getitem__, range(len(self)))

    def find(self, name: str) -> Point | None:
        """The clip of that name."""
        places = [
            int(part) for part in re.split("[-,]", name)[: self._numbers] if re.fullmatch("[0-9]{1,18}", part)
        ]
        sizes = ([len(self.variants)] if len(self.variants) > 1 else []) + [len(axis) for axis in self._grid]
        sizes += [self.samples] if self.samples else []
        if len(places) != len(sizes) or any(place >= size for place, size in zip(places, sizes, strict=True)):
            return None
        number = 0
        for place, size in zip(places, sizes, strict=True):
            number = number * size + place
        point = self[number]
        return point if point.name == name else None

    @property
    def _numbers(self) -> int:
        """That a name begins with."""
        return (len(self.variants) > 1) + len(self._grid) + bool(self.samples)

    @cached_property
    def _grid(self) -> tuple[Listed, ...]:
        return tuple(axis for axis in self.axes if isinstance(axis, Listed))

    @cached_property
    def _short(self) -> list[str]:
        return [".".join(parts) for parts in shortest_names([axis.key for axis in self.axes])]

    def _values(self, places: Iterator[int], draw: int) -> tuple[Value, ...]:
        found = []
        for axis in self.axes:
            if isinstance(axis, Listed):
                found.append(axis.at(next(places)))
            else:
                key = same_key(axis)
                latin = self.design is Design.LATIN
                share = stratified(self.seed, key, draw, self.samples) if latin else lot(self.seed, key, draw)
                found.append(axis.distribution.at(share))
        return tuple(found)

    def set_to(self, values: Sequence[Value]) -> tuple[str, ...]:
        """`KEY=VALUE` for each axis."""
        return tuple(f"{axis.key}={value.text}" for axis, value in zip(self.axes, values, strict=True))

    def typical(self) -> tuple[Value, ...]:
        """The first value of each list, and of each distribution the middle: no tail of it."""
        return tuple(
            axis.at(0) if isinstance(axis, Listed) else axis.distribution.at(0.5) for axis in self.axes
        )


def planned(
    axes: Sequence[Axis],
    variants: Sequence[str | None] = (None,),
    samples: int | None = None,
    seed: int | None = None,
    design: Design = Design.INDEPENDENT,
) -> Sweep:
    """A sweep whose parts fit together; raises InputError where they do not. None is what nobody said."""
    problems: list[Problem] = []
    drawn = [axis for axis in axes if isinstance(axis, Drawn)]
    for axis in drawn:
        if axis.each:
            fix = "see physgen.batch.axes.per_object"
            problems.append(
                Problem(axis.place, "", "", "stands for several keys, and nobody has said which", fix)
            )

    def wrong(flag: str, expected: str, fix: str) -> None:
        problems.extend(InputError.of(flag, "", expected, fix).problems)

    if drawn and samples is None:
        wrong(
            str(drawn[0].place), "is a distribution, and nobody says how many draws", "add e.g. --samples 100"
        )
    if not drawn:
        fix = "give a key a distribution, e.g. 'objects.ball.mass=~uniform(100, 200)'"
        flags = (("--samples", samples), ("--seed", seed), ("--latin", design is Design.LATIN or None))
        for flag, said in flags:
            if said is not None:
                wrong(flag, "has nothing to draw", fix)
    if not axes and len(variants) == 1:
        wrong("sweep", "has no keys to vary", "write e.g. objects.ball.mass=100:900:9, or --variant all")
    sweep = Sweep(tuple(axes), tuple(variants), (samples or 0) if drawn else 0, seed or 0, design)
    count = prod(map(len, sweep._grid)) * max(sweep.samples, 1) * len(variants)
    if count > MOST:
        parts = [*(len(axis) for axis in sweep._grid), *([sweep.samples] if sweep.samples else [])]
        parts += [len(variants)] if len(variants) > 1 else []
        found = " x ".join(f"{part:,}" for part in parts) + f" are {count:,} clips"
        fix = f"make at most {MOST:,}; draws (KEY=~uniform(a, b) --samples N) cover many keys with few"
        wrong("sweep", found, fix)
    if problems:
        raise InputError(problems)
    return sweep


# ----------------------------------------------------------------------
# A sweep and its scene file -> what is wrong before anything is made: keys, and values that somebody wrote.

MOST_TRIED = 200
"""Values that somebody wrote, tried at most: no sweep begins with a long wait."""
MOST_VARIANTS = 50


@dataclass(frozen=True)
class Trial:
    """What trying told."""

    objects: tuple[str, ...]
    """Names of all that can move, of all variants, in natural order."""
    size: tuple[int, int]
    """Of the video, px, as the first clip has it."""
    warnings: tuple[Problem, ...]
    """Values of which every clip will fail."""


def try_values(sweep: Sweep, opened: Opened, overrides: Sequence[str] = ()) -> Trial:
    """The first value of every key together, then the other values one by one; `overrides` are those of `--set`.

    Raises InputError where the first ones make no scene: a key is misspelt, then, or no value fits it. Others that
    make none are warnings: their clips fail, and the rest does not.
    """
    typical = sweep.typical()
    scenes = []
    problems: dict[Problem, None] = {}
    for variant in sweep.variants[:MOST_VARIANTS]:
        try:
            scenes.append(_scene(sweep, opened, overrides, typical, variant))
        except InputError as error:
            problems |= dict.fromkeys(error.problems)
    if not problems:
        problems = dict.fromkeys(_without_effect(sweep.axes, typical, scenes[0]))
    if problems:
        raise InputError(problems)
    names = {item.name: None for scene in scenes for item in scene.objects if item.motion.value != "static"}
    warnings = by_place(_failing(sweep, opened, overrides, typical))
    return Trial(tuple(names), scenes[0].video_size, tuple(warnings))


def _scene(
    sweep: Sweep, opened: Opened, overrides: Sequence[str], values: Sequence[Value], variant: str | None
) -> Scene:
    """Raises InputError; what `--set` would say of a value, the argument says."""
    ours = sweep.set_to(values)
    named = {quoted(f"--set {text}", "", 80): axis.place for text, axis in zip(ours, sweep.axes, strict=True)}
    try:
        return opened.scene((*overrides, *ours), variant)
    except InputError as error:
        raise InputError(renamed(error.problems, named)) from None


def renamed(problems: Sequence[Problem], named: dict[str, Place]) -> list[Problem]:
    """Problems of files in `named`, with the places there."""
    return [replace(problem, place=named.get(problem.place.file, problem.place)) for problem in problems]


def _failing(
    sweep: Sweep, opened: Opened, overrides: Sequence[str], typical: tuple[Value, ...]
) -> Iterator[Problem]:
    """Each value in the company of the first ones of the other keys."""
    left = MOST_TRIED
    for n, axis in enumerate(sweep.axes):
        for index in axis.telling if isinstance(axis, Listed) else ():
            if index == 0:
                continue
            left -= 1
            if left < 0:
                return
            assert isinstance(axis, Listed)
            values = (*typical[:n], axis.at(index), *typical[n + 1 :])
            try:
                _scene(sweep, opened, overrides, values, sweep.variants[0])
            except InputError as error:
                yield from (
                    replace(
                        problem, fix=f"{problem.fix}; as it is, its clips fail", severity=Severity.WARNING
                    )
                    for problem in error.problems
                )


def _without_effect(axes: Sequence[Axis], values: Sequence[Value], scene: Scene) -> Iterator[Problem]:
    """Keys that another argument's key rules out, as a mass does a density: they are not in the scene."""
    for axis, value in zip(axes, values, strict=True):
        if value.data is not None and not _there(scene.document, axis.path):
            others = [str(other.place) for other in axes if other is not axis]
            expected = f"has no effect: {listed(others, 'or')} rules it out"
            yield Problem(axis.place, "", "", expected, "keep one of them")


def _there(document: Any, path: KeyPath) -> bool:
    """Whether anything in the document has the path."""
    if not path:
        return True
    part, rest = path[0], path[1:]
    if isinstance(document, list):
        if part in ("*", "[*]"):
            return any(_there(item, rest) for item in document)
        return str(part).isdecimal() and int(part) < len(document) and _there(document[int(part)], rest)
    try:
        items = dict(document)
    except (TypeError, ValueError):
        return False
    if part == "*":
        return any(_there(item, rest) for item in items.values())
    return part in items and _there(items[part], rest)
