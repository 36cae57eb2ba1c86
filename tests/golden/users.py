"""A user's folder with a scene and a test, in which pytest runs, and what it says there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physgen.compile.world import World
from physgen.pipeline import stages

FPS, SPEED = 60, 300.0
TABLE = f"""\
physgen: 1
size: [128, 96]
world: {{view: top, pixels_per_meter: 300, duration: 0.4, table: {{friction: 0}}}}
render: {{fps: {FPS}}}
objects:
  bystander: {{shape: {{circle: {{center: [20, 80], radius: 6}}}}, mass: 100}}
  cue: {{shape: {{circle: {{center: [20, 40], radius: 8}}}}, mass: 170, elasticity: 0.9, velocity: [{SPEED:g}, 0]}}
  target: {{shape: {{circle: {{center: [72, 44], radius: 8}}}}, mass: 170, elasticity: 0.9}}
"""
MEET = (52 - sqrt(16**2 - 4**2)) / SPEED
"""s: when the cue, of radius 8, reaches the target, which lies 52 px ahead and 4 px aside."""
ONE = 'def test_clip(physgen_golden):\n    physgen_golden("scene.yaml")\n'


def another_library(patch: pytest.MonkeyPatch, px: float) -> None:
    """As if it rounded otherwise: all that moves starts `px` from where it did."""
    simulate = stages.simulate

    def nudged(world: World, *more: Any, **how: Any) -> Any:
        bodies = [
            replace(b, center=b.center + np.array([0, px]) * (k % 3 - 1)) for k, b in enumerate(world.bodies)
        ]
        return simulate(replace(world, bodies=tuple(bodies)), *more, **how)

    patch.setattr(stages, "simulate", nudged)


Said = Callable[..., tuple[int, str]]


def told(text: str, about: str) -> str:
    """The line of a failure about something."""
    return next(line for line in text.splitlines() if line.startswith(f"E         {about}"))


def edit(scene: Path, *pairs: tuple[str, str]) -> None:
    text = scene.read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    scene.write_text(text)
