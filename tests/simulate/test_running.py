"""A run that is cut into pieces anywhere is the run that is not: bit for bit, samples as they are taken and all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.world import World
from physgen.simulate.collisions import TUNING
from physgen.simulate.engine import Running, simulate
from physgen.simulate.trajectory import Trajectory, read_trajectory

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def read(scene: str, *edits: str) -> World:
    opened = pipeline.load(SCENES / scene, edits)
    return pipeline.compile(opened, pipeline.percepts(opened)).world


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        "cups/scene.yaml",
        "billiards/scene.yaml",
        "pendulum/scene.yaml",
        "physics/24-thin-walls.yaml",
    ],
)
def test_pieces_of_a_run_are_the_run(scene: str) -> None:
    """Contacts, blows, joints, what rolls on a table, divided steps; cut after every step, and after many."""
    world = read(scene)
    whole = simulate(world)
    assert whole.effort.impacts
    assert whole.effort.divided or "walls" not in scene
    running, random, rounds = Running(world), np.random.default_rng(5), 0
    early: list[np.ndarray] = []
    while running.sample_count < len(whole.times):
        left = int(random.integers(1, 20))

        def enough() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        running.advance(running.end, should_stop=enough)
        if rounds % 3:
            early.append(running.trajectory().poses[: running.sample_count].copy())
        rounds += 1
    made = running.trajectory()
    assert rounds > 20
    assert np.array_equal(made.poses, whole.poses)
    assert np.array_equal(made.velocities, whole.velocities)
    assert np.array_equal(made.contacts.touch_pairs, whole.contacts.touch_pairs)
    assert made.effort == whole.effort
    np.testing.assert_allclose(
        made.energy.dissipated, whole.energy.dissipated, rtol=1e-9, atol=1e-6
    )
    np.testing.assert_allclose(made.turns, whole.turns, atol=1e-12)
    assert all(np.array_equal(part, whole.poses[: len(part)]) for part in early)
    same_at_other_times(world, made)


def same_at_other_times(world: World, made: Trajectory) -> None:
    """Fewer times, in the middle of a step, more, and beyond the end: nothing of the run depends on its samples."""
    end = made.times[-1]
    for times in (
        made.times[:1],
        np.array([0.0, 0.4321 * end]),
        np.linspace(0, 1.1 * end, 777),
    ):
        again, fresh = (
            made.resample(times).as_arrays(),
            simulate(world, times).as_arrays(),
        )
        assert all(np.array_equal(again[key], fresh[key]) for key in fresh)


@pytest.mark.parametrize("most", [0, 1000, 500_000])
def test_a_run_too_large_to_be_kept_is_simulated_again(most: int) -> None:
    """Too large from the start, within the clip, and where it goes on beyond its end."""
    world = read("cups/scene.yaml", "world.duration=0.2")
    running = Running(world, max_bytes=most)
    running.advance(running.end)
    same_at_other_times(world, running.trajectory())


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_squares_that_overflow_are_read_again_without_a_warning() -> None:
    world = read("physics/01-free-fall.yaml", "world.duration=0.1")
    world = replace(
        world,
        bodies=tuple(
            replace(body, velocity=np.array([1e160, 0])) for body in world.bodies
        ),
    )
    same_at_other_times(world, simulate(world))


@pytest.mark.slow
@pytest.mark.parametrize("duration", ["auto", "0.4"])
def test_a_clip_is_simulated_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, duration: str
) -> None:
    """Its end, frames, blur, page, trails and events are read from one run."""
    starts, start = [], Running._start
    monkeypatch.setattr(
        Running, "_start", lambda self: (starts.append(1), start(self))[1]
    )
    edits = [
        f"world.duration={duration}",
        "render.fps=10",
        "render.motion_blur=0.5",
        "render.overlay=[trails, contacts]",
    ]
    folder = pipeline.render_scene(
        SCENES / "cans" / "scene.yaml",
        tmp_path,
        overrides=tuple(edits),
        export=("events",),
    )
    assert len(starts) == 1
    monkeypatch.undo()
    world = read("cans/scene.yaml", *edits)
    kept, fresh = (
        read_trajectory(folder / "trajectory.npz").as_arrays(),
        simulate(world).as_arrays(),
    )
    assert all(np.array_equal(kept[key], fresh[key]) for key in fresh)


@pytest.mark.parametrize(("base", "brings"), [(0.01, 0.0), (1e-4, 1.0)])
def test_a_run_may_take_a_hundred_times_the_work_of_a_pyramid(
    monkeypatch: pytest.MonkeyPatch, base: float, brings: float
) -> None:
    """Of what it begins with; where that is next to nothing, what the time before the hit brings is enough."""
    less = replace(
        TUNING,
        start_work=TUNING.start_work * base,
        work_per_second=TUNING.work_per_second * brings,
    )
    monkeypatch.setattr("physgen.simulate.collisions.TUNING", less)
    assert simulate(read("pyramid/scene.yaml")).effort.overworked == -1
    none = replace(TUNING, start_work=0.0, work_per_second=0.0)
    monkeypatch.setattr("physgen.simulate.collisions.TUNING", none)
    assert simulate(read("pyramid/scene.yaml")).effort.overworked >= 0


KEEPING = """
import atexit
import sys


def clear_modules():
    for name in ("space", "body", "shapes", "constraints"):
        vars(sys.modules[f"pymunk.{name}"]).update(cp=None, ffi=None, lib=None)


atexit.register(clear_modules)  # before physgen is imported: it runs last

from physgen import pipeline

scene = pipeline.load(sys.argv[1])
compiled = pipeline.compile(scene, pipeline.percepts(scene))
trajectory = pipeline.simulate(compiled.world)
"""
"""Keeps a trajectory to the end, when the interpreter clears modules that are still referred to."""


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["pendulum/scene.yaml", "physics/24-thin-walls.yaml"])
def test_a_trajectory_kept_to_the_end_is_silent(scene: str) -> None:
    command = [sys.executable, "-c", KEEPING, str(SCENES / scene)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0
    assert result.stderr == ""
