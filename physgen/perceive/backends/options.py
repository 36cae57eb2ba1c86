"""A model's table of physgen.toml -> its values, checked: `[marigold]`, `[diffusion]`, `[lama]` ..."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from physgen.backends import Setup, choose
from physgen.problems import InputError, Place, Problem


@dataclass(frozen=True)
class Whole:
    """A whole number from `least` on."""

    default: int | None
    """None: as the weights' own configuration has it."""
    least: int = 0

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        right = isinstance(value, int) and not isinstance(value, bool) and value >= self.least
        return "" if right else f"is not a whole number from {self.least} on"


@dataclass(frozen=True)
class Real:
    """A finite number >= 0."""

    default: float | None

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return "" if number and math.isfinite(value) and value >= 0 else "is not a number >= 0"


@dataclass(frozen=True)
class Text:
    """Any text."""

    default: str

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        return "" if isinstance(value, str) else "is not text"


@dataclass(frozen=True)
class OneOf:
    """One of some words, true and false read as `on` and `off` where those are among them."""

    default: str
    others: tuple[str, ...]

    def fault(self, value: Any) -> str:
        """What is wrong with a value; `""`: nothing."""
        right = (switched(value) if isinstance(value, bool) else value) in (self.default, *self.others)
        return "" if right else f"is not one of {', '.join((self.default, *self.others))}"


def switched(value: Any) -> Any:
    """True and false as words.

    >>> switched(True), switched("auto")
    ('on', 'auto')
    """
    return ("off", "on")[value] if isinstance(value, bool) else value


Option = Whole | Real | Text | OneOf


def read(setup: Setup, table: str, known: Mapping[str, Option]) -> dict[str, Any]:
    """Every option of `[table]`, the missing ones by their defaults. Raises InputError with every wrong one.

    >>> read(Setup(options={"steps": 4}), "marigold", {"steps": Whole(None, 1), "seed": Whole(0)})
    {'steps': 4, 'seed': 0}
    """
    problems = []
    for key, value in setup.options.items():
        at = f"{table}.{key}"
        if key not in known:
            problems.append(
                Problem(Place("physgen.toml"), at, f'"{key}"', "means nothing here", choose(key, known))
            )
        elif fault := known[key].fault(value):
            default = known[key].default
            fix = "leave it out" if default is None else f"the default is {default!r}"
            problems.append(Problem(Place("physgen.toml"), at, repr(value), fault, fix))
    if problems:
        raise InputError(problems)
    return {key: setup.options.get(key, option.default) for key, option in known.items()}
