"""Steps that were kept tell the same motion as running again: bit for bit, whatever moves in the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from written import world

from physgen.simulate.engine import simulate
from physgen.simulate.recorder import StepLog
from physgen.simulate.trajectory import Trajectory

BUSY = """\
physgen: 1
size: [400, 300]
world: {duration: 0.6, gravity: [0, 600]}
objects:
  ball: {shape: {circle: {center: [60, 60], radius: 14}}, elasticity: 0.8, velocity: [90, 0]}
  crate: {shape: {box: {center: [200, 250], size: [40, 40]}}, velocity: [-60, 0], rolling: 0}
  lid: {shape: {box: {center: [200, 222], size: [30, 12]}}}
  bob: {shape: {circle: {center: [330, 100], radius: 12}}, velocity: [120, 0]}
  weight: {shape: {circle: {center: [120, 150], radius: 9}}}
  sweep: {shape: {box: {center: [30, 250], size: [12, 30]}}, motion: {path: [[0, 30, 250], [0.5, 150, 250]]}}
boundaries:
  floor: {segment: [[-1000, 270], [1000, 270]], elasticity: 0.5, friction: 0.4}
joints:
  thread: {objects: [bob], pivot: [330, 40]}
  coil: {objects: [weight], spring: [[120, 150], [120, 60]], stiffness: 4.0e5, damping: 300, length: 60}
forces:
  - {object: crate, impulse: [2.0e5, -1.0e5], at: [190, 240]}
  - {object: lid, force: [0, -4.0e5], start: 0.1, duration: 0.15}
"""
ROUND = """\
physgen: 1
size: [400, 300]
world: {view: top, duration: 0.5, table: {friction: 0.2}}
objects:
  a: {shape: {circle: {center: [100, 150], radius: 15}}, solid: sphere, velocity: [500, 20], roll: none}
  b: {shape: {circle: {center: [180, 155], radius: 15}}, solid: sphere}
boundaries:
  rim: {polyline: [[20, 20], [380, 20], [380, 280], [20, 280], [20, 20]], elasticity: 0.7}
"""


MOMENTS = np.unique(np.concatenate([np.linspace(0, 0.45, 137), [0.1003, 0.25]]))


def assert_equal(told: Trajectory, again: Trajectory) -> None:
    for name, array in again.as_arrays().items():
        if not name.startswith("effort"):
            assert np.array_equal(told.as_arrays()[name], array), name


@pytest.mark.parametrize("text", [BUSY, ROUND], ids=["busy", "round"])
def test_what_was_kept_is_what_would_be_run(tmp_path: Path, text: str) -> None:
    """Also where it ends before the run does: what comes after has no part in it."""
    made, tape = world(tmp_path, text), StepLog()
    run = simulate(made, tape=tape)
    assert run.effort.impacts
    for times in (MOMENTS, MOMENTS[:40], np.zeros(1), run.times):
        told, again = tape.read(times), simulate(made, times)
        assert told is not None
        assert_equal(told, again)
        assert told.effort == run.effort


def test_a_run_goes_on_for_who_asks_for_later(tmp_path: Path) -> None:
    made, tape = world(tmp_path, BUSY), StepLog()
    short = simulate(made, MOMENTS[:40], tape=tape)
    told, again = tape.read(MOMENTS), simulate(made, MOMENTS)
    assert told is not None
    assert_equal(told, again)
    before = simulate(made, MOMENTS[:40]).as_arrays()  # what was handed out stays as it was
    assert all(np.array_equal(before[name], array) for name, array in short.as_arrays().items())


def test_what_was_not_kept_is_not_told(tmp_path: Path) -> None:
    made = world(tmp_path, BUSY)
    small = StepLog(most=20_000)
    simulate(made, tape=small)
    assert small.read(MOMENTS[:2]) is None
    assert StepLog().read(MOMENTS) is None
