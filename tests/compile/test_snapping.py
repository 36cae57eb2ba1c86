"""Fitted shapes touch the lines they stand on; written shapes stay as written."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline


def scene(tmp_path: Path, floor: float, tilt: float = 0.0, shape: str = "auto") -> Path:
    """A block and a ball of a photo, standing on y = 120 by their masks, over a line at `floor`."""
    assets = tmp_path / "a"
    assets.mkdir(exist_ok=True)
    labels = np.zeros((160, 200), np.uint16)
    labels[80:120, 30:70] = 1
    yy, xx = np.mgrid[:160, :200]
    labels[np.hypot(xx - 130, yy - 99.5) <= 20] = 2
    cv2.imwrite(str(assets / "masks.png"), labels)
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((160, 200, 3), 128, np.uint8))
    file = tmp_path / "scene.yaml"
    file.write_text(
        "physgen: 1\nimage: photo.png\nassets: a\nobjects:\n"
        f"  block: {{mask: 1, shape: {shape}}}\n  ball: {{mask: 2}}\n"
        f"boundaries:\n  floor: {{segment: [[-50, {floor - 50 * tilt}], [250, {floor + 250 * tilt}]]}}\n"
    )
    return file


def compiled(file: Path):
    loaded = pipeline.load(file)
    return pipeline.compile(loaded, pipeline.percepts(loaded))


def heights(file: Path, tilt: float, floor: float) -> dict[str, float]:
    """px by which each body's lowest point lies over the line."""
    up = np.array([tilt, -1.0]) / np.hypot(tilt, 1)
    found = {}
    for body in compiled(file).world.bodies:
        start = np.array([0.0, floor])
        if body.radius is not None:
            found[body.name] = float((body.center - start) @ up) - body.radius
        else:
            points = np.concatenate(body.pieces) + body.center - start
            found[body.name] = float((points @ up).min())
    return found


@pytest.mark.parametrize("off", [-1.5, -0.4, 0.0, 0.7, 1.6])
@pytest.mark.parametrize("tilt", [0.0, 0.004])
def test_fitted_shapes_stand_on_the_line(tmp_path, off, tilt) -> None:
    floor = 119.5 + off - 80 * tilt
    file = scene(tmp_path, floor, tilt)
    for height in heights(file, tilt, floor).values():
        assert abs(height) < 1e-9


def test_what_is_far_from_a_line_stays(tmp_path) -> None:
    near, far = (
        compiled(scene(tmp_path, floor)).world.bodies for floor in (119.5, 126.0)
    )
    for a, b in zip(near, far, strict=True):
        assert a.center == pytest.approx(b.center, abs=0.3)
    assert min(heights(scene(tmp_path, 126.0), 0.0, 126.0).values()) > 5


def test_written_shapes_stay_as_written(tmp_path) -> None:
    shape = "{box: {center: [49.5, 98.5], size: [40, 40]}}"
    block = next(
        b
        for b in compiled(scene(tmp_path, 119.5, shape=shape)).world.bodies
        if b.name == "block"
    )
    assert block.center.tolist() == [49.5, 98.5]


def test_pushed_onto_its_line_a_pile_does_not_settle(tmp_path) -> None:
    file = scene(tmp_path, 120.7)
    loaded = pipeline.load(file)
    t = pipeline.simulate(
        pipeline.compile(loaded, pipeline.percepts(loaded)).world, rate=60
    )
    assert np.abs(t.poses - t.poses[0])[:, :, :2].max() < 0.01
