"""A scene and axes -> the clips of a sweep, each from its number alone: nothing is listed, so millions take no room.

Variants go outermost, then the keys of the grid in the order in which they were written, the last one fastest; at every
point of the grid stand all draws, the same ones, so that points differ in nothing but the grid.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from math import prod

from physgen.batch.axes import Axis, Drawn, Listed, same_key
from physgen.batch.lots import lot, stratified
from physgen.batch.naming import name
from physgen.batch.values import Value
from physgen.problems import InputError, Problem
from physgen.report.swept import apart

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
        called = name(
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
        return [".".join(parts) for parts in apart([axis.key for axis in self.axes])]

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
            fix = "see physgen.batch.each.apart"
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
