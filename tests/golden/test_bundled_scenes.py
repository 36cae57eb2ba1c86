"""The bundled scenes as they were when last looked at and found right. `pytest --force-regen` takes what is now.

Places hold to 1e-6 px, and a quarter of the frames' size to 4 grey levels in any pixel and 0.05 in the mean. Another
kind of processor may differ: docs/decisions.md.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.batch.tolerances import Motion, Pixels
from physgen.pytest_plugin import GoldenFixture
from physgen.simulate.engine import simulate

SCENES = {"billiards": 12, "dominoes": 12, "wall-ball": 6}
"""And how many frames of each are kept."""
MOTION = Motion(px=1e-6, degrees=1e-5, px_per_s=1e-6, degrees_per_s=1e-5)
PIXELS = Pixels(levels=4, share=0, mean=0.05)


@pytest.mark.parametrize("name", SCENES)
def test_clip(name: str, physgen_golden: GoldenFixture) -> None:
    trajectory = physgen_golden(
        f"scenes/{name}/scene.yaml",
        frames=SCENES[name],
        side=216,
        motion=MOTION,
        pixels=PIXELS,
        basename=name,
    )
    energy = trajectory.energy
    total = (energy.kinetic + energy.potential + energy.dissipated)[
        1:
    ]  # the push does its work in the first step
    scale = energy.kinetic.max() + np.ptp(energy.potential)
    assert np.ptp(total) <= 0.04 * scale, f"{name}: {np.ptp(total) / scale:.2%}"


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_odd_and_frame_0_is_the_photo(name: str, bundled: Path) -> None:
    scene = pipeline.load(bundled / name / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    assert pipeline.lint(scene, compiled, maps) == []
    start = simulate(compiled.world, np.zeros(1))
    frame = next(pipeline.render(pipeline.stage(scene, compiled, maps), start))
    assert maps is not None
    assert np.array_equal(frame.rgb, maps.rgb)
