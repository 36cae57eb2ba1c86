"""A rival's name -> its `run`; the one table, importing nothing until asked.

>>> names()
('plain', 'box2d', 'mujoco')
>>> find("plain").missing()
()
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.evaluate.rivals.stepping import Unsupported
from physgen.problems import InputError
from physgen.simulate.trajectory import Trajectory

__all__ = ["RIVALS", "Rival", "Run", "Unsupported", "find", "listing", "make", "names"]

Array = NDArray[np.float64]

INSTALL = 'pip install "physgen[rivals]"'


class Run(Protocol):
    """A second engine."""

    def __call__(self, world: World, times: Array) -> Trajectory:
        """Motion at `times` (T,) s, t = 0 first; raises Unsupported for what the engine cannot express."""
        ...


@dataclass(frozen=True)
class Rival:
    """One row of the table."""

    name: str
    target: str
    """Module with a function `run` and a table `CANNOT`."""
    package: str
    """The package on PyPI that brings what it imports."""
    rate: float
    """Its steps a second. Between steps, samples are read off a straight line, bounces or not: see `rate_near`."""
    about: str
    """One sentence for the scorecard's legend."""

    def missing(self) -> tuple[str, ...]:
        """The package that is not installed (looked for, not imported)."""
        return () if self.version() else (self.package,)

    def rate_near(self, rate: float) -> float:
        """The highest rate of samples, at most `rate`, that falls on its steps.

        >>> find("plain").rate_near(240.0), find("plain").rate_near(24.0), find("mujoco").rate_near(240.0)
        (60.0, 20.0, 240.0)
        """
        return self.rate / ceil(self.rate / rate - 1e-9)

    def version(self) -> str | None:
        """Of the installed package; None where it is missing."""
        try:
            return metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return None


_HERE = "physgen.evaluate.rivals"

RIVALS: tuple[Rival, ...] = (
    Rival("plain", f"{_HERE}.plain", "pymunk", 60.0,
          "pymunk as it comes: 60 steps a second, 10 iterations."),
    Rival("box2d", f"{_HERE}.box2d", "Box2D", 240.0,
          "Box2D 2.3 in single precision: 240 steps a second, 8 and 3 iterations."),
    Rival("mujoco", f"{_HERE}.mujoco", "mujoco-core", 960.0,
          "MuJoCo 4: soft contacts, 960 steps a second, 15,360 where things bounce."),
)  # fmt: skip


def names() -> tuple[str, ...]:
    """Every rival, in the table's order."""
    return tuple(row.name for row in RIVALS)


def find(name: str) -> Rival:
    """The row called `name`; raises InputError for a name that is not in the table."""
    for row in RIVALS:
        if row.name == name:
            return row
    raise InputError.of("rival", f'"{name}"', "is not a rival engine", f"choose from {', '.join(names())}")


def make(name: str) -> Run:
    """The rival's `run`, imported now; raises InputError for an unknown name or a package that is not installed."""
    row = find(name)
    if missing := row.missing():
        found = f"needs {', '.join(missing)}, which is not installed"
        raise InputError.of("rival", f'"{name}"', found, INSTALL)
    run: Run = importlib.import_module(row.target).run
    return run


def listing() -> list[Mapping[str, Any]]:
    """One mapping a row: name, package, version (None: not installed), install, about."""
    return [
        {
            "name": row.name,
            "package": row.package,
            "version": row.version(),
            "install": INSTALL if row.missing() else None,
            "about": row.about,
        }
        for row in RIVALS
    ]
