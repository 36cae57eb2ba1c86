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


def empty() -> NDArray[np.uint16]:
    return np.zeros((SIZE[1], SIZE[0]), np.uint16)


def box(labels: NDArray[np.uint16], i: int, x: int, y: int, w: int, h: int) -> None:
    labels[y : y + h, x : x + w] = i


def at_the_border() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 0, 90, 30, 50)
    box(labels, 2, 100, 90, 40, 50)
    box(labels, 3, 220, 140, 20, 20)
    return labels


def all_over() -> NDArray[np.uint16]:
    return np.full_like(empty(), 1)


def with_holes() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 60, 60, 80, 80)
    box(labels, 0, 75, 75, 20, 20)
    box(labels, 0, 105, 105, 20, 20)
    return labels


def in_ten_parts() -> NDArray[np.uint16]:
    labels = empty()
    for k in range(10):
        box(labels, 1, 20 + 20 * k, 110 - 4 * (k % 3), 12, 30 + 4 * (k % 3))
    return labels


def one_pixel() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 60, 90, 40, 50)
    box(labels, 2, 150, 100, 1, 1)
    return labels


def gaps_in_the_ids() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 7, 40, 100, 30, 40)
    box(labels, 900, 100, 100, 30, 40)
    box(labels, 65535, 160, 100, 30, 40)
    return labels


def one_in_another() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 60, 60, 90, 80)
    box(labels, 2, 85, 85, 30, 30)
    return labels


def thin() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 40, 60, 2, 80)
    box(labels, 2, 80, 138, 100, 2)
    box(labels, 3, 200, 40, 1, 90)
    box(labels, 4, 60, 20, 80, 1)
    return labels


def thin_frame() -> NDArray[np.uint16]:
    labels = empty()
    box(labels, 1, 60, 60, 80, 70)
    box(labels, 0, 66, 66, 68, 63)
    return labels


MASKS = (
    at_the_border, all_over, with_holes, in_ten_parts, one_pixel, gaps_in_the_ids, one_in_another, thin, thin_frame,
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("shown", MASKS, ids=lambda shown: shown.__name__)
def test_a_sensible_scene_comes_of_odd_masks_and_stands_still(shown, tmp_path: Path) -> None:
    labels = shown()
    cv2.imwrite(str(tmp_path / "photo.png"), drawn(labels)[..., ::-1])
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    path = tmp_path / "scene.yaml"
    given = ["perceive", str(tmp_path / "photo.png"), "--masks", str(tmp_path / "masks.png"), "-o", str(path)]
    assert main([*given, "--still"]) == 0
    scene = pipeline.load(path)
    assert main(["check", str(path), "--strict"]) == 0
    large = [i for i in np.unique(labels[labels > 0]) if (labels == i).sum() >= 12]
    assert len(scene.objects) == len(large)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    poses = pipeline.simulate(compiled.world).poses
    assert np.abs(poses[:, :, :2] - poses[:1, :, :2]).max() < STILL


@pytest.mark.parametrize("size", [(3, 4), (6, 2)], ids=lambda size: f"{size[0]}x{size[1]}")
def test_a_few_px_stand_on_a_level_floor(size: tuple[int, int], tmp_path: Path) -> None:
    labels = empty()
    box(labels, 1, 60, 90, 40, 50)
    box(labels, 2, 150, 100, *size)
    cv2.imwrite(str(tmp_path / "photo.png"), drawn(labels)[..., ::-1])
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    path = tmp_path / "scene.yaml"
    given = ["perceive", str(tmp_path / "photo.png"), "--masks", str(tmp_path / "masks.png"), "-o", str(path)]
    assert main(given) == 0
    assert main(["check", "--strict", str(path)]) == 0
    assert not any(wall.name.startswith("slope") for wall in pipeline.load(path).boundaries)
