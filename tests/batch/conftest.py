"""Small scenes to make many clips of."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

LESSON = """\
physgen: 1
size: [64, 48]
world: {duration: 0.3}
objects:
  ball: {shape: {circle: {center: [16, 30], radius: 7}}, mass: 100, velocity: [150, 0]}
  crate: {shape: {box: {center: [44, 32], size: [12, 16]}}, mass: 200}
boundaries:
  floor: {segment: [[-100, 40], [300, 40]]}
render: {fps: 20}
variants:
  light: {objects.ball.mass: 10}
  heavy: {objects.ball.mass: 900}
  slow: {objects.ball.velocity: [40, 0]}
"""

PHOTO = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {duration: 0.25, tilt: 20}
objects:
  ball: {mask: 1, shape: {circle: {center: [20, 34], radius: 8}}, solid: sphere, mass: 100, velocity: [120, 0]}
  crate: {mask: 2, mass: 200}
boundaries:
  floor: {segment: [[-100, 42], [300, 42]]}
light: {direction: [0.4, -0.6, 0.69], intensity: 0.7, ambient: 0.4}
render: {fps: 20}
"""


@pytest.fixture
def lesson(tmp_path: Path) -> Path:
    """Of flat shapes, with three variants."""
    path = tmp_path / "lesson.yaml"
    path.write_text(LESSON)
    return path


@pytest.fixture
def pictured(tmp_path: Path) -> Path:
    """Of a photo that was drawn, with masks and normals."""
    rng = np.random.default_rng(3)
    picture = np.full((56, 80, 3), 120, np.uint8)
    picture[42:] = 90
    masks = np.zeros((56, 80), np.uint16)
    cv2.circle(picture, (20, 34), 8, (40, 160, 210), -1, cv2.LINE_AA)
    masks[np.hypot(*(np.mgrid[:56, :80] - np.array([34, 20])[:, None, None])) <= 8] = 1
    picture[28:42, 50:64] = (160, 90, 60)
    masks[28:42, 50:64] = 2
    noisy = np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
    folder = tmp_path / "pictured"
    (folder / "photo.assets").mkdir(parents=True)
    cv2.imwrite(str(folder / "photo.png"), noisy)
    cv2.imwrite(str(folder / "photo.assets" / "masks.png"), masks)
    path = folder / "scene.yaml"
    path.write_text(PHOTO)
    return path
