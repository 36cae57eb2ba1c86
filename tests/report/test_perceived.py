"""The sheet of what was perceived, read by another library."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from physgen.cli.main import main
from physgen.report.perception import CAPTION, GAP, WIDTH, _rings

ROOT = Path(__file__).resolve().parents[2]


def test_a_sheet_shows_the_photo_and_all_that_was_perceived(tmp_path: Path) -> None:
    scene = ROOT / "scenes/dominoes"
    photo = np.asarray(Image.open(scene / "photo.png").convert("RGB"))[::2, ::2]
    masks = np.asarray(Image.open(scene / "photo.assets/masks.png"))[::2, ::2]
    Image.fromarray(photo).save(tmp_path / "photo.png")
    cv2.imwrite(str(tmp_path / "masks.png"), masks)
    files = [str(tmp_path / name) for name in ("photo.png", "masks.png", "scene.yaml", "sheets/sheet.png")]
    assert main(["perceive", files[0], "--masks", files[1], "-o", files[2], "--sheet", files[3]]) == 0
    page = np.asarray(Image.open(files[3]))
    height = round(photo.shape[0] * WIDTH / photo.shape[1])
    assert page.shape == (3 * (height + CAPTION + GAP) + GAP, 4 * (WIDTH + GAP) + GAP, 3)
    first = page[GAP + CAPTION : GAP + CAPTION + height, GAP : GAP + WIDTH]
    assert (
        np.abs(first.astype(int) - cv2.resize(photo, (WIDTH, height), interpolation=cv2.INTER_AREA)).mean()
        < 2
    )
    shapes = page[GAP + CAPTION : GAP + CAPTION + height, 3 * GAP + 2 * WIDTH : 3 * (GAP + WIDTH)]
    assert (np.ptp(shapes.astype(int), axis=2) > 150).mean() > 0.005  # outlines in strong colours


def test_rings_of_every_shape_enclose_its_area() -> None:
    def area(shape: dict) -> float:
        return sum(abs(cv2.contourArea(ring.astype(np.float32))) for ring in _rings(shape))

    assert abs(area({"circle": {"center": [50, 40], "radius": 10}}) - np.pi * 100) < 1
    assert abs(area({"box": {"center": [50, 40], "size": [20, 30], "angle": 30}}) - 600) < 0.01
    assert abs(area({"polygon": [[0, 0], [10, 0], [0, 10]]}) - 50) < 0.01
    box = _rings({"box": {"center": [0, 0], "size": [20, 2], "angle": 90}})[
        0
    ]  # a positive angle turns +x to +y
    assert np.allclose(np.ptp(box, axis=0), [2, 20])
