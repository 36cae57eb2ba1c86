"""A run that is cut into pieces anywhere is the run that is not: bit for bit, samples as they are taken and all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.world import World
from physgen.simulate.engine import Running, simulate
from physgen.simulate.trajectory import Trajectory, read_trajectory

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
    running.read()
    made = running.trajectory()
    assert rounds > 20
    assert np.array_equal(made.poses, whole.poses)
    assert np.array_equal(made.velocities, whole.velocities)
    assert np.array_equal(made.contacts.touch_pairs, whole.contacts.touch_pairs)
    assert made.effort == whole.effort
    np.testing.assert_allclose(made.energy.dissipated, whole.energy.dissipated, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(made.turns, whole.turns, atol=1e-12)
    assert all(np.array_equal(part, whole.poses[: len(part)]) for part in early)
    same_at_other_times(world, made)


def same_at_other_times(world: World, made: Trajectory) -> None:
    """Fewer times, in the middle of a step, more, and beyond the end: nothing of the run depends on its samples."""
    end = made.times[-1]
    for times in (made.times[:1], np.array([0.0, 0.4321 * end]), np.linspace(0, 1.1 * end, 777)):
        again, fresh = made.sampled(times).as_arrays(), simulate(world, times).as_arrays()
        assert all(np.array_equal(again[key], fresh[key]) for key in fresh)


def test_a_run_too_large_to_be_kept_is_simulated_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("physgen.simulate.engine.STEP_BYTES", 1000)
    scene = pipeline.load(SCENES / "cups" / "scene.yaml", ["world.duration=0.2"])
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    same_at_other_times(world, simulate(world))


def test_a_clip_is_simulated_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Its end, frames, blur, page and trails are read from one run."""
    starts, start = [], Running._start
    monkeypatch.setattr(Running, "_start", lambda self: (starts.append(1), start(self))[1])
    edits = ["world.duration=auto", "render.fps=10", "render.motion_blur=0.5", "render.overlay=[trails, contacts]"]
    folder = pipeline.render_scene(SCENES / "cans" / "scene.yaml", tmp_path, overrides=tuple(edits))
    assert len(starts) == 1
    monkeypatch.undo()
    scene = pipeline.load(SCENES / "cans" / "scene.yaml", edits)
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    kept, fresh = read_trajectory(folder / "trajectory.npz").as_arrays(), simulate(world).as_arrays()
    assert all(np.array_equal(kept[key], fresh[key]) for key in fresh)
