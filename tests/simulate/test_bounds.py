"""Joints with bounds: impulses against all choices of active bounds, energy, and breaking."""

from __future__ import annotations

from itertools import product
from math import inf
from pathlib import Path

import numpy as np
import pytest
import written

from physgen.problems import InputError
from physgen.simulate.bounds import bounded_impulses
from physgen.simulate.engine import simulate

MACHINES = """\
physgen: 1
size: [800, 500]
world: {view: side, duration: 1.2, gravity: [0, 980]}
objects:
  bob: {shape: {circle: {center: [100, 100], radius: 10}}, mass: 100}
  door: {shape: {box: {center: [300, 100], size: [100, 10]}}, mass: 100}
  cart: {shape: {box: {center: [500, 100], size: [40, 20]}}, mass: 100}
  left: {shape: {circle: {center: [600, 200], radius: 10}}, mass: 100}
  right: {shape: {circle: {center: [700, 200], radius: 10}}, mass: 150}
  hung: {shape: {circle: {center: [200, 300], radius: 10}}, mass: 100}
joints:
  rope: {objects: [bob], rope: [[100, 100], [130, 60]], length: 120}
  hinge: {objects: [door], pivot: [250, 100], limits: [-10, 60], friction: 1.0e6}
  rail: {objects: [cart], slider: [[480, 90], [560, 170]]}
  pull: {objects: [left, right], pulley: [[600, 190], [600, 50], [700, 50], [700, 190]]}
  spring: {objects: [hung], spring: [[200, 290], [200, 190]], stiffness: 2000, breaks: 1.5e5}
"""


def test_bounded_impulses_meet_one_of_all_choices() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        rows = rng.normal(size=(5, 7))
        give, goal = rows @ rows.T, rng.normal(size=5)
        low = np.array([-inf, -inf, 0.0, 0.0, -0.3])
        high = np.array([inf, inf, inf, inf, 0.3])
        impulse, _ = bounded_impulses(give, goal, low, high)
        matches = []
        for choice in product(("free", "low", "high"), repeat=3):
            states = np.array(["free", "free", *choice])
            exact = np.where(states == "low", low, np.where(states == "high", high, 0))
            if not np.isfinite(exact).all():
                continue
            free = states == "free"
            rest = goal[free] - give[np.ix_(free, ~free)] @ exact[~free]
            exact[free] = np.linalg.solve(give[np.ix_(free, free)], rest)
            short = goal - give @ exact
            fits = (exact >= low - 1e-9).all() and (exact <= high + 1e-9).all()
            fits &= (short[states == "low"] <= 1e-9).all()
            fits &= (short[states == "high"] >= -1e-9).all()
            if fits:
                matches.append(exact)
        assert len(matches) == 1
        np.testing.assert_allclose(impulse, matches[0], atol=1e-8)


@pytest.mark.slow
def test_energy_is_balanced_with_bounds(tmp_path: Path) -> None:
    run = simulate(written.world(tmp_path, MACHINES), np.linspace(0, 1.2, 60))
    energy = run.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert np.ptp(total) < 1e-3 * energy.kinetic.max()
    hung, bob = run.names.index("hung"), run.names.index("bob")
    assert run.poses[-1, hung, 1] > 500  # its spring broke
    apart = np.hypot(*(run.poses[:, bob, :2] - (130, 60)).T)
    assert apart.max() == pytest.approx(120, abs=0.01)


DRIVES = """\
physgen: 1
size: [500, 300]
world: {duration: 1, gravity: [0, 980]}
objects:
  cart: {shape: {box: {center: [100, 100], size: [20, 20]}}, mass: 100}
  arm: {shape: {box: {center: [400, 100], size: [60, 20]}}, mass: 100}
joints:
  rail: {objects: [cart], slider: [[100, 100], [200, 100]], drive: 300}
  hinge: {objects: [arm], motor: [370, 100], speed: 360, limits: [-90, 90]}
"""


def test_drives_without_a_limit_stop_at_their_ends(tmp_path: Path) -> None:
    """They work m v² at most, and not against what ends their way."""
    run = simulate(written.world(tmp_path, DRIVES), np.linspace(0.05, 1, 20))
    cart, arm = run.names.index("cart"), run.names.index("arm")
    assert run.poses[-1, cart, 0] == pytest.approx(200, abs=1e-6)
    assert run.poses[-1, arm, 2] == pytest.approx(np.pi / 2, abs=1e-6)
    energy = run.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    assert abs(total[-1] - total[0]) < 1e-2 * energy.kinetic.max()
    assert energy.work[-1] < 2 * 100 * 300**2


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        ("{objects: [bob], gear: -2}", "is one object, but a gear turns two"),
        ("{objects: [bob, left], gear: 0}", "turns nothing"),
        ("{objects: [bob], slider: [[1, 2], [1, 2]]}", "two points at the same place"),
        (
            "{objects: [bob], rope: [[100, 100], [100, 0]], length: 90}",
            "is less than the 100 px between its points",
        ),
        (
            "{objects: [bob], slider: [[1, 2], [8, 2]], force: 5}",
            "its force needs it",
        ),
        ("{objects: [bob], weld: [1, 2], limits: [-1, 2]}", "it, and this is a"),
        ("{objects: [bob], slider: [[130, 100], [200, 100]]}", "30.0 px before bob"),
        ("{objects: [bob, left], rope: [[5, 5], [5, 5]]}", "two points at the same"),
        (
            "{objects: [bob], finger: [[0, 100, 100], [1, 200, 100]], stiffness: 9, breaks: 1}",
            "breaks: has no effect here",
        ),
    ],
)
def test_mistakes_in_joints_are_named(tmp_path: Path, joint: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        written.world(tmp_path, f"{MACHINES}  extra: {joint}\n")
