"""A small scene."""

from __future__ import annotations

from pathlib import Path

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
