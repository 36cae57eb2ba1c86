"""The bundled scenes as they were when last looked at and found right. `pytest --force-regen` takes what is now.

Motion holds to 1e-6 (px, rad, px/s, rad/s), and small frames to 0.05 grey levels in the mean. Another kind of
processor may differ: docs/decisions.md.
"""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from pytest_regressions.image_regression import ImageRegressionFixture
from pytest_regressions.ndarrays_regression import NDArraysRegressionFixture

from physgen import pipeline
from physgen.simulate.engine import simulate

SCENES = {"billiards": 12, "dominoes": 12, "wall-ball": 6}
"""And how many frames of each are kept."""
WIDTH = 144
"""px of a kept frame."""
TOLERANCE = {"atol": 1e-6, "rtol": 0.0}
LEVELS = 100 * 0.05 / 255
"""% of the range of grey levels."""


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_clip(
    name: str,
    bundled: Path,
    ndarrays_regression: NDArraysRegressionFixture,
    image_regression: ImageRegressionFixture,
) -> None:
    first = (
        ["world.duration=2"] if name == "billiards" else []
    )  # what a break becomes later hangs on the last bit
    scene = pipeline.load(bundled / name / "scene.yaml", first)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    trajectory = pipeline.simulate(compiled.world)
    motion = {
        key: getattr(trajectory, key)
        for key in ("times", "poses", "turns", "velocities")
    }
    ndarrays_regression.check(motion, basename=name, default_tolerance=TOLERANCE)

    chosen = np.linspace(0, len(trajectory.times) - 1, SCENES[name]).round().astype(int)
    shown = simulate(compiled.world, trajectory.times[chosen])
    frames = pipeline.render(pipeline.stage(scene, compiled, maps), shown)
    sheet = np.vstack([_small(frame.rgb) for frame in frames])
    png = io.BytesIO()
    Image.fromarray(sheet).save(png, "PNG")
    image_regression.check(png.getvalue(), diff_threshold=LEVELS, basename=name)

    energy = trajectory.energy
    total = energy.kinetic + energy.potential + energy.dissipated - energy.work
    scale = energy.kinetic.max() + np.ptp(energy.potential)
    assert np.ptp(total) <= 0.04 * scale, f"{name}: {np.ptp(total) / scale:.2%}"


def _small(rgb: np.ndarray) -> np.ndarray:
    height = round(WIDTH * rgb.shape[0] / rgb.shape[1])
    return np.asarray(cv2.resize(rgb, (WIDTH, height), interpolation=cv2.INTER_AREA))
