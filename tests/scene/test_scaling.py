"""Lengths in pixels of a scene, for its photo at another size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from physgen.scene.files import equal
from physgen.scene.scaling import scale_part, scale_scene


@pytest.mark.parametrize(
    ("path", "value", "doubled"),
    [
        (("world", "pixels_per_meter"), 700, 1400),
        (("world", "gravity"), [0, 981.5], [0, 1963.0]),
        (("world", "gravity"), "9.8 m/s²", "9.8 m/s²"),
        (("world", "duration"), "auto", "auto"),
        (("objects", "a", "velocity"), ["3 px/s", "1 m/s"], ["6 px/s", "1 m/s"]),
        (("objects", "a", "velocity", 0), 4, 8),
        (("objects", "a", "mass"), 170, 170),
        (("objects", "a", "mask"), 3, 3),
        (("objects", "a", "density"), 8, 2),
        (("objects", "a", "place"), [10, 20, 45], [20.5, 40.5, 45]),
        (("objects", "a", "spin"), 90, 90),
        (
            ("objects", "a", "shape", "polygon"),
            [[0, 0], [4, 0], [4, 3]],
            [[0.5, 0.5], [8.5, 0.5], [8.5, 6.5]],
        ),
        (("objects", "a", "shape", "circle", "radius"), 5, 10),
        (("objects", "a", "shape", "box", "size"), [5, 6], [10, 12]),
        (("objects", "a", "prompt", "box"), [1, 2, 3, 4], [2, 4, 6, 8]),
        (
            ("objects", "a", "motion", "path"),
            [[0, 10, 20], [1, 30, 40, 90]],
            [[0, 20.5, 40.5], [1, 60.5, 80.5, 90]],
        ),
        (("forces", 0, "at"), [1, 2], [2.5, 4.5]),
        (("world", "backdrop"), 200, 400),
        (("forces", 0, "torque"), 5, 20),
        (("fields", "a", "strength"), 5, 40),
        (("joints", "a", "stiffness"), 5, 5),
        (("render", "size"), [640, 480], [640, 480]),
        (("render", "fps"), 30, 30),
        (("variants", "a", "nothing"), 5, 5),
    ],
)
def test_lengths_grow_with_the_power_of_their_unit(
    path: tuple[str | int, ...], value: Any, doubled: Any
) -> None:
    assert scale_part(value, path, 2.0) == doubled


def test_scaling_back_gives_the_same_scene(bundled: Path) -> None:
    for file in sorted(bundled.glob("*/scene.yaml")):
        data = yaml.safe_load(file.read_text())
        there = scale_scene(data, 2.0)
        assert not equal(there, data)
        assert equal(scale_scene(there, 0.5), data)
