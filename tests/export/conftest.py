"""A photo with texture on every thing, and scenes on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from labelled import Labelled, hall, labelled

from physgen.cli.main import main

SIDE = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {duration: 0.4}
objects:
  ball: {mask: 1, shape: {circle: {center: [40, 60], radius: 16}}, velocity: [150, -60], spin: 200}
  crate: {mask: 2, mass: 200, velocity: [-60, -120], spin: -120}
boundaries:
  floor: {segment: [[-300, 110], [500, 110]]}
render: {fps: 20, relight: false, shadows: false}
"""
TOP = """\
physgen: 1
image: photo.png
assets: photo.assets
world: {view: top, duration: 0.4, table: {friction: 0.2}}
objects:
  ball: {mask: 1, shape: {circle: {center: [40, 60], radius: 16}}, solid: sphere, velocity: [120, 30]}
  crate: {mask: 2, mass: 200, velocity: [-50, 20], spin: 90}
light: {direction: [0, 0, 1], intensity: 0.001, ambient: 1.0}
render: {fps: 20, shadows: false}
"""


def texture(seed: int, height: int, width: int, level: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    field = cv2.GaussianBlur(
        rng.normal(0, 1, (height, width, 3)).astype(np.float32), None, 2.5
    )
    return np.clip(level + 90 * field / np.abs(field).max(), 0, 255)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """The folder of a photo of 160 x 128 px, its masks and both scenes."""
    height, width = 128, 160
    picture = texture(0, height, width, 110)
    masks = np.zeros((height, width), np.uint16)
    y, x = np.indices((height, width))
    round_ = np.hypot(x - 40, y - 60) <= 16
    square = (x >= 96) & (x < 130) & (y >= 50) & (y < 76)
    for number, (mask, level) in enumerate(((round_, 170), (square, 60)), 1):
        picture[mask] = texture(number, height, width, level)[mask]
        masks[mask] = number
    (tmp_path / "photo.assets").mkdir()
    cv2.imwrite(str(tmp_path / "photo.png"), picture.astype(np.uint8))
    cv2.imwrite(str(tmp_path / "photo.assets" / "masks.png"), masks)
    (tmp_path / "side.yaml").write_text(SIDE)
    (tmp_path / "top.yaml").write_text(TOP)
    return tmp_path


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Labelled:
    """The hall with masks and tracks in every format."""
    home = tmp_path_factory.mktemp("hall")
    return labelled(hall(home), home / "out", "frames,coco,davis,mot")


Export = Callable[..., Path]


@pytest.fixture
def export(photo: Path, tmp_path: Path) -> Export:
    """Labels of a scene, with edits -> their folder."""

    def run(scene: str, formats: str, *edits: str, out: str = "labels") -> Path:
        sets = [part for edit in edits for part in ("--set", edit)]
        path = photo / f"{scene}.yaml"
        assert (
            main(
                [
                    "export",
                    str(path),
                    "--format",
                    formats,
                    "-o",
                    str(tmp_path / out),
                    *sets,
                ]
            )
            == 0
        )
        return tmp_path / out / scene

    return run
