"""The bundled scenes as they were when last looked at and found right. `pytest --force-regen` takes what is now.

Trajectories hold to 1e-6 px, frames by their mean difference. Another kind of processor may differ: docs/decisions.md.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline

SCENES = ("billiards", "dominoes")
FRAMES = 12
"""Frames a scene that are kept, spread over the clip."""
SHRINK = 4
MEAN_DIFFERENCE = 0.05
"""Of 255, over one shrunken frame: a sprite of 20 px that moves by a tenth of a pixel shows."""


@pytest.fixture(scope="module", params=SCENES)
def run(request: pytest.FixtureRequest):
    path = Path(__file__).resolve().parents[2] / "scenes" / request.param / "scene.yaml"
    scene = pipeline.load(path)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    assert pipeline.lint(scene, compiled) == []
    return request.param, scene, maps, compiled, pipeline.simulate(compiled.world)


def test_trajectory(run, ndarrays_regression) -> None:
    name, _, _, _, trajectory = run
    arrays = {"poses": trajectory.poses, "velocities": trajectory.velocities}
    ndarrays_regression.check(
        arrays, basename=f"trajectory_{name}", default_tolerance={"atol": 1e-6, "rtol": 0}
    )


def test_frames(run, request: pytest.FixtureRequest) -> None:
    name, scene, maps, compiled, trajectory = run
    kept = set(np.linspace(0, len(trajectory.times) - 1, FRAMES).astype(int).tolist())
    small = []
    for frame in pipeline.render(pipeline.stage(scene, compiled, maps), trajectory):
        if frame.index == 0:
            assert np.array_equal(frame.rgb, maps.rgb), "frame 0 is not the photo"
        if frame.index in kept:
            height, width = frame.rgb.shape[:2]
            size = (width // SHRINK, height // SHRINK)
            small.append((frame.index, cv2.resize(frame.rgb, size, interpolation=cv2.INTER_AREA)))
    strip = np.concatenate([picture for _, picture in small])
    path = Path(__file__).parent / f"frames_{name}.png"
    if request.config.getoption("force_regen"):
        cv2.imwrite(str(path), strip[:, :, ::-1])
    golden = cv2.imread(str(path))
    assert golden is not None, f"{path.name} is missing: make it with pytest --force-regen, and look at it"
    for (index, picture), right in zip(small, np.split(golden[:, :, ::-1], len(small)), strict=True):
        difference = np.abs(picture.astype(int) - right).mean()
        assert difference <= MEAN_DIFFERENCE, (
            f"{name}: frame {index} is the first to differ, by {difference:.3f} of 255"
        )


def test_energy_balances(run) -> None:
    name, _, _, _, trajectory = run
    energy = trajectory.energy
    total = (energy.kinetic + energy.potential + energy.dissipated)[
        1:
    ]  # the push does its work in the first step
    scale = energy.kinetic.max() + np.ptp(energy.potential)
    assert np.ptp(total) <= 0.04 * scale, f"{name}: {np.ptp(total) / scale:.2%}"
