"""What the part `objects` counts: objects of the scene, and none that is only a speck."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from physgen.perceive.roles import SMALLEST_OBJECT, Segments

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "benchmarks"))

from objects import scene_objects  # noqa: E402


def test_specks_are_no_objects_of_scene() -> None:
    labels = np.zeros((60, 80), np.uint16)
    labels[20:40, 20:40] = 1
    labels[50, 70 : 70 + SMALLEST_OBJECT // 2] = 2
    rgb = np.full((60, 80, 3), 90, np.uint8)
    counted = scene_objects(rgb, Segments(labels, np.array([0.9, 0.8])))
    assert np.unique(counted.labels).tolist() == [0, 1]
    assert counted.confidence.tolist() == [0.9, 0.8]


def test_doubtful_regions_alone_count_nothing() -> None:
    rgb = np.full((60, 80, 3), 90, np.uint8)
    nothing = Segments(np.zeros((60, 80), np.uint16), np.zeros(0))
    assert not scene_objects(rgb, nothing).labels.any()
