"""A small scene."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

LESSON = """\
physgen: 1
size: [96, 64]
world: {duration: 0.25}
objects:
  ball: {shape: {circle: {center: [25, 45], radius: 10}}, mass: 100, velocity: [300, 0]}
  crate: {shape: {box: {center: [70, 45], size: [16, 20]}}, mass: 200}
boundaries:
  floor: {segment: [[-100, 55], [300, 55]]}
render: {fps: 24}
variants:
  heavy: {objects.ball.mass: 900}
"""


@pytest.fixture
def lesson(tmp_path: Path) -> Path:
    """A ball meets a crate; a variant."""
    path = tmp_path / "lesson.yaml"
    path.write_text(LESSON)
    return path


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    """Two blocks on a floor, and their label map."""
    picture = np.full((90, 120, 3), 90, np.uint8)
    picture[70:] = (60, 80, 100)
    labels = np.zeros((90, 120), np.uint16)
    for id_, x in ((1, 15), (2, 70)):
        picture[45:70, x : x + 22] = (40, 60 + 80 * id_, 200)
        labels[45:70, x : x + 22] = id_
    noise = np.random.default_rng(3).normal(0, 2, picture.shape)
    noisy = np.clip(picture + noise, 0, 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), noisy)
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    return tmp_path / "photo.png"
