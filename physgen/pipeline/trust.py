"""A clip that was made -> whether it is what it is taken for: its files as they were read, its energy accounted for."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physgen.problems import Problem, Severity
from physgen.whole import Stamp, stamped

if TYPE_CHECKING:
    from physgen.compile.world import World
    from physgen.report.record import RunRecord
    from physgen.scene.model import Scene
    from physgen.simulate.trajectory import Trajectory

UNBALANCED = 0.03
"""Part of the energy that flows above which a simulation is not to be trusted."""


def sound(scene: Scene, record: RunRecord, begun: int, stamps: Sequence[tuple[Path, Stamp]]) -> bool:
    """Whether nothing that the clip was made of was written since: `begun`, ns since 1970, or maps were stamped."""
    home = scene.folder.resolve()
    times = [stamped(Path(os.path.normpath(home / name)))[:2] for name in record.inputs]
    same = all(stamped(file) == stamp for file, stamp in stamps)
    return same and all(max(pair) < begun for pair in times)


def unbalanced(scene: Scene, world: World, trajectory: Trajectory, record: RunRecord) -> Problem | None:
    """A simulation that is not to be trusted."""
    # a body's fall by a pixel is the least that counts: at rest, nothing flows
    weight = sum(body.mass for body in world.bodies) * float(np.hypot(*world.gravity))
    record.imbalance = trajectory.imbalance(weight)
    if record.imbalance <= UNBALANCED:
        return None
    fix = "raise world.steps_per_second, or look for masses far apart or joints that contradict each other"
    found = f"miss {record.imbalance:.0%} of what flows"
    return Problem(scene.place("world"), "world", "the books of energy", found, fix, Severity.WARNING)
