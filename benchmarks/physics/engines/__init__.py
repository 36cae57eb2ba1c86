"""Second engines for the closed forms: each a module with `run(world, times) -> Trajectory`, imported on demand."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from math import ceil

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.files import install
from physgen.problems import InputError
from physgen.simulate.trajectory import Trajectory

from .stepping import Unsupported

__all__ = ["ENGINES", "Engine", "Unsupported", "make"]

Run = Callable[[World, NDArray[np.float64]], Trajectory]


@dataclass(frozen=True)
class Engine:
    """One row of the table."""

    module: str
    package: str
    """On PyPI, for what the module imports."""
    rate: float
    """Steps a second. Between steps, samples are interpolated linearly, bounces or not: see `rate_near`."""

    def rate_near(self, rate: float) -> float:
        """The highest sampling rate, at most `rate`, that falls on the engine's steps.

        >>> ENGINES["plain"].rate_near(240.0), ENGINES["plain"].rate_near(24.0), ENGINES["mujoco"].rate_near(240.0)
        (60.0, 20.0, 240.0)
        """
        return self.rate / ceil(self.rate / rate - 1e-9)

    def installed(self) -> bool:
        try:
            metadata.version(self.package)
        except metadata.PackageNotFoundError:
            return False
        return True


ENGINES = {
    "plain": Engine("plain", "pymunk", 60.0),  # pymunk as it comes: 10 iterations
    "box2d": Engine(
        "box2d", "Box2D", 240.0
    ),  # Box2D 2.3, single precision, 8 and 3 iterations
    "mujoco": Engine(
        "mujoco_soft", "mujoco-core", 960.0
    ),  # soft contacts; 15,360 a second where things bounce
}


def make(name: str) -> Run:
    """The engine's `run`. Raises InputError for an unknown name or a package that is not installed."""
    if name not in ENGINES:
        raise InputError.of(
            "engine",
            f'"{name}"',
            "is not a second engine",
            f"choose from {', '.join(ENGINES)}",
        )
    engine = ENGINES[name]
    if not engine.installed():
        found = f"needs {engine.package}, which is not installed"
        raise InputError.of("engine", f'"{name}"', found, install("rivals"))
    run: Run = importlib.import_module(f".{engine.module}", __name__).run
    return run
