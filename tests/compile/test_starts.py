"""Spins of pinned objects, and velocities that joints exclude."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline

SAMPLES = 200


def compiled(folder: Path, rod: dict, pin: list[float]):
    text = {
        "physgen": 1,
        "size": [800, 800],
        "world": {"gravity": [0, 0], "duration": 0.1},
        "objects": {"rod": rod},
        "joints": {"pin": {"objects": ["rod"], "pivot": pin}},
    }
    file = folder / "scene.yaml"
    file.write_text(json.dumps(text))
    scene = pipeline.load(file)
    return scene, pipeline.compile(scene, None)


@pytest.mark.slow
def test_pinned_rod_turns_about_pin_at_its_spin(tmp_path):
    random = np.random.default_rng(4)
    for _ in range(SAMPLES):
        center, size = random.uniform(200, 600, 2), random.uniform(5, 200, 2)
        pin = center + random.uniform(-0.5, 0.5, 2) * size
        spin = random.uniform(-400, 400)
        shape = {"box": {"center": center.tolist(), "size": size.tolist()}}
        rod = {"shape": shape, "spin": spin}
        _, result = compiled(tmp_path, rod, pin.tolist())
        (body,) = result.world.bodies
        arm = center - pin
        expected = np.radians(spin) * np.array([-arm[1], arm[0]])
        np.testing.assert_allclose(body.velocity, expected, rtol=1e-9, atol=1e-9)


def test_pinned_rod_keeps_its_spin(tmp_path):
    shape = {"box": {"center": [250, 200], "size": [100, 10]}}
    scene, result = compiled(tmp_path, {"shape": shape, "spin": 90}, [200, 200])
    spins = np.degrees(pipeline.simulate(result.world).velocities[:, 0, 2])
    np.testing.assert_allclose(spins, 90, rtol=1e-4)
    assert pipeline.lint(scene, result) == []


def test_velocity_that_pin_excludes_is_named_with_the_one_that_fits(tmp_path):
    shape = {"box": {"center": [250, 200], "size": [100, 10]}}
    rod = {"shape": shape, "spin": 90, "velocity": [30, 0]}
    scene, result = compiled(tmp_path, rod, [200, 200])
    (problem,) = pipeline.lint(scene, result)
    assert problem.path == "objects.rod.velocity"
    # m l w/2 + I w0 about the end: 90 I/(I + m l²/4) with I = m (l² + b²)/12
    moment = (100**2 + 10**2) / 12
    spin = 90 * moment / (moment + 50**2)
    assert f"spin: {spin:.4g}" in problem.fix
    start = pipeline.simulate(result.world).velocities[0, 0]
    assert np.degrees(start[2]) == pytest.approx(spin, rel=1e-6)
    assert start[1] == pytest.approx(np.radians(spin) * 50, rel=1e-6)
