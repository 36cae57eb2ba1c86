"""Belts and turntables in views from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import written

from physgen.problems import InputError
from physgen.simulate.engine import simulate

SCENE = """\
physgen: 1
size: [600, 400]
world: {view: top, duration: 2, table: {friction: 0.3}}
objects:
  parcel: {shape: {box: {center: [100, 100], size: [30, 20]}}, mass: 100, friction: 0.3}
  aside: {shape: {circle: {center: [100, 300], radius: 15}}, mass: 80, friction: 0.3}
  rider: {shape: {box: {center: [500, 280], size: [20, 20]}}, mass: 50, friction: 0.3}
boundaries:
  stop: {segment: [[300, 40], [300, 160]], elasticity: 0.2}
fields:
  belt: {belt: [0, 50, 400, 100], velocity: [200, 0]}
  disc: {turntable: [480, 280, 60], spin: 90}
"""


def test_belts_carry_what_is_on_them_and_balance_energy(tmp_path: Path) -> None:
    run = simulate(written.world(tmp_path, SCENE), np.linspace(0, 2, 121))
    ends = dict(zip(run.names, run.poses[-1].tolist(), strict=True))
    assert ends["parcel"][0] == pytest.approx(285, abs=1)  # the stop holds it
    assert ends["aside"][:2] == [100, 300]
    assert ends["rider"][2] == pytest.approx(np.pi, abs=0.2)
    away = np.hypot(ends["rider"][0] - 480, ends["rider"][1] - 280)
    assert away == pytest.approx(20, abs=1)
    energy = run.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert np.abs(total).max() < 0.01 * energy.work.max()


def test_a_table_without_friction_carries_nothing(tmp_path: Path) -> None:
    smooth = SCENE.replace("table: {friction: 0.3}", "table: {friction: 0}")
    run = simulate(written.world(tmp_path, smooth), np.array([0.0, 1.0]))
    assert not run.velocities.any()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (", velocity: [200, 0]", ""),
        (", spin: 90", ""),
        ("spin: 90", "velocity: [1, 0], spin: 90"),
        ("turntable: [480, 280, 60]", "turntable: [480, 280]"),
    ],
)
def test_incomplete_belts_are_refused(tmp_path: Path, before: str, after: str) -> None:
    with pytest.raises(InputError):
        written.world(tmp_path, SCENE.replace(before, after))
