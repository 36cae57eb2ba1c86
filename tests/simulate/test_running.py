"""A run that is cut into pieces anywhere is the run that is not: bit for bit, samples as they are taken and all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.simulate.engine import Running, simulate

SCENES = Path(__file__).resolve().parents[2] / "scenes"


@pytest.mark.parametrize("name", ["cups", "billiards", "pendulum"])
def test_pieces_of_a_run_are_the_run(name: str) -> None:
    """Contacts, blows, joints, what rolls on a table; cut after every step, after many, and in the middle of blocks."""
    scene = pipeline.load(SCENES / name / "scene.yaml")
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    whole = simulate(world)
    assert whole.effort.impacts
    running, random, rounds = Running(world), np.random.default_rng(5), 0
    early: list[np.ndarray] = []
    while running.done < len(whole.times):
        left = int(random.integers(1, 20))

        def enough() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        running.on(running.end, enough=enough)
        if rounds % 3:
            running.read()
            early.append(running.trajectory().poses[: running.done].copy())
        rounds += 1
    running.rest()
    made = running.trajectory()
    assert rounds > 20
    assert np.array_equal(made.poses, whole.poses)
    assert np.array_equal(made.velocities, whole.velocities)
    assert np.array_equal(made.contacts.touch_pairs, whole.contacts.touch_pairs)
    assert made.effort == whole.effort
    np.testing.assert_allclose(made.energy.dissipated, whole.energy.dissipated, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(made.turns, whole.turns, atol=1e-12)
    assert all(np.array_equal(part, whole.poses[: len(part)]) for part in early)
