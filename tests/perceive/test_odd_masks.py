"""Masks as people have them: touching the border, with holes, in many parts, specks, gaps in the ids, another size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from physgen import pipeline
from physgen.cli.main import main

SIZE = 240, 160
STILL = 1.0
"""px, in 2 s without a push."""


def drawn(labels: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """A photo of what the labels show, on a table before a wall."""
    rgb = np.full((*labels.shape, 3), (120, 140, 160), np.float32)
    rgb[130:] = (150, 110, 70)
    for i in np.unique(labels[labels > 0]).tolist():
        rgb[labels == i] = np.random.default_rng(i).integers(40, 230, 3)
    grain = np.random.default_rng(0).normal(0, 2, rgb.shape)
    return np.clip(cv2.GaussianBlur(rgb, (0, 0), 0.7) + grain, 0, 255).astype(np.uint8)


def boxes(*rows: tuple[int, int, int, int, int]) -> NDArray[np.uint16]:
    """Of the id, the left, the top, the width and the height of each box; the id 0 is a hole."""
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
    for i, x, y, w, h in rows:
        labels[y : y + h, x : x + w] = i
    return labels


MASKS = {
    "at the border": boxes(
        (1, 0, 90, 30, 50), (2, 100, 90, 40, 50), (3, 220, 140, 20, 20)
    ),
    "all over": boxes((1, 0, 0, *SIZE)),
    "with holes": boxes(
        (1, 60, 60, 80, 80), (0, 75, 75, 20, 20), (0, 105, 105, 20, 20)
    ),
    "in ten parts": boxes(
        *((1, 20 + 20 * k, 110 - 4 * (k % 3), 12, 30 + 4 * (k % 3)) for k in range(10))
    ),
    "one pixel": boxes((1, 60, 90, 40, 50), (2, 150, 100, 1, 1)),
    "gaps in the ids": boxes(
        (7, 40, 100, 30, 40), (900, 100, 100, 30, 40), (65535, 160, 100, 30, 40)
    ),
    "one in another": boxes((1, 60, 60, 90, 80), (2, 85, 85, 30, 30)),
    "thin": boxes(
        (1, 40, 60, 2, 80),
        (2, 80, 138, 100, 2),
        (3, 200, 40, 1, 90),
        (4, 60, 20, 80, 1),
    ),
    "thin frame": boxes((1, 60, 60, 80, 70), (0, 66, 66, 68, 63)),
}


def perceived(labels: NDArray[np.uint16], folder: Path, *flags: str) -> Path:
    cv2.imwrite(str(folder / "photo.png"), drawn(labels)[..., ::-1])
    cv2.imwrite(str(folder / "masks.png"), labels)
    path = folder / "scene.yaml"
    given = [
        "perceive",
        str(folder / "photo.png"),
        "--masks",
        str(folder / "masks.png"),
        "-o",
        str(path),
    ]
    assert main([*given, *flags]) == 0
    return path


@pytest.mark.slow
@pytest.mark.parametrize("labels", MASKS.values(), ids=MASKS)
def test_a_sensible_scene_comes_of_odd_masks_and_stands_still(
    labels, tmp_path: Path
) -> None:
    path = perceived(labels, tmp_path, "--still")
    scene = pipeline.load(path)
    assert main(["check", str(path), "--strict"]) == 0
    large = [i for i in np.unique(labels[labels > 0]) if (labels == i).sum() >= 12]
    assert len(scene.objects) == len(large)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    poses = pipeline.simulate(compiled.world).poses
    assert np.abs(poses[:, :, :2] - poses[:1, :, :2]).max() < STILL


@pytest.mark.slow
@pytest.mark.parametrize(
    "size", [(3, 4), (6, 2)], ids=lambda size: f"{size[0]}x{size[1]}"
)
def test_a_few_px_stand_on_a_level_floor(size: tuple[int, int], tmp_path: Path) -> None:
    path = perceived(boxes((1, 60, 90, 40, 50), (2, 150, 100, *size)), tmp_path)
    assert main(["check", "--strict", str(path)]) == 0
    assert not any(
        wall.name.startswith("slope") for wall in pipeline.load(path).boundaries
    )
