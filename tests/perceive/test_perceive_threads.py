"""Perception on one and on two threads: the same bytes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.perceive.segment import detector, network


def _perceived(photo: Path, masks: Path, scene: Path, threads: int) -> dict[str, bytes]:
    """Return the files of a scene that is perceived on so many threads of OpenCV."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(threads)
    network._predict_maps.cache_clear()
    detector._run.cache_clear()
    try:
        text = pipeline.perceive(photo, scene, masks=masks)
    finally:
        cv2.setNumThreads(before)
    assert "velocity:" in text
    files = [path for path in scene.parent.rglob("*") if path.is_file()]
    return {path.name: path.read_bytes() for path in files}


@pytest.mark.slow
def test_scene_is_equal_with_one_and_two_threads(tmp_path: Path) -> None:
    """A ball on a floor of noise with its shadow, so that the background is refilled."""
    random = np.random.default_rng(2)
    photo = np.full((240, 320, 3), (190, 200, 205), np.uint8)
    photo[170:] = (100, 120, 140)
    noise = random.normal(0, 6, photo.shape)
    shadow = np.ones((240, 320), np.float32)
    cv2.ellipse(shadow, (215, 190), (55, 12), 0, 0, 360, 0.5, -1)
    shadow = cv2.GaussianBlur(shadow, (0, 0), 3)[..., None]
    photo = np.clip(photo * shadow + noise, 0, 255).astype(np.uint8)
    mask = np.zeros((240, 320), np.uint8)
    cv2.circle(photo, (160, 150), 40, (40, 90, 230), -1)
    cv2.circle(mask, (160, 150), 40, 255, -1)
    cv2.imwrite(str(tmp_path / "photo.png"), photo)
    cv2.imwrite(str(tmp_path / "masks.png"), mask)
    scenes = []
    for threads in (1, 2):
        scene = tmp_path / str(threads) / "scene.yaml"
        scene.parent.mkdir()
        paths = tmp_path / "photo.png", tmp_path / "masks.png"
        scenes.append(_perceived(*paths, scene, threads))
    one, two = scenes
    assert len(one) > 5
    assert one.keys() == two.keys()
    changed = [name for name in one if one[name] != two[name]]
    assert not changed
