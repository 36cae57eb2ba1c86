"""The overview of a perceived photo, decoded by another library, and where it is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from physgen.cli.main import main
from physgen.report.overview import LONGEST, draw_overview
from physgen.report.perception import DOUBTFUL, SUPPORT, colour

DOCUMENT = {
    "world": {"view": "side"},
    "objects": {"ball-1": {"mask": 1}, "box-1": {"mask": 2}},
    "doubtful": {"maybe-1": {"mask": 3, "confidence": 0.3}},
    "boundaries": {
        "floor": {"segment": [[-300, 500], [1900, 500]]},
        "bottom": {"segment": [[-300, 599.5], [1900, 599.5]]},
    },
}


def photo(scale: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A grey photo of 1000 x 600 px, times `scale`, with three regions."""
    labels = np.zeros((600 * scale, 1000 * scale), np.uint16)
    for id_, left in ((1, 150), (2, 450), (3, 750)):
        there = np.s_[300 * scale : 400 * scale, left * scale : (left + 100) * scale]
        labels[there] = id_
    return np.full((*labels.shape, 3), 120, np.uint8), labels


def count(picture: np.ndarray, wanted: tuple[int, int, int]) -> int:
    """Pixels of nearly a colour."""
    apart = np.abs(picture.astype(int) - wanted).max(axis=2)
    return int(np.count_nonzero(apart < 12))


def test_overview_marks_objects_supports_and_doubts() -> None:
    rgb, labels = photo()
    picture = draw_overview(rgb, labels, DOCUMENT, {})
    for number, left in ((1, 150), (2, 450)):
        around = picture[280:420, left - 20 : left + 120]
        assert count(around, colour(number)) > 0.8 * 400
    dashed = count(picture[280:420, 745:755], DOUBTFUL)
    solid = count(picture[280:420, 145:155], colour(1))
    assert 0.3 * solid < dashed < 0.9 * solid
    assert count(picture[495:506], SUPPORT) > 900
    assert count(picture[590:600], SUPPORT) == 0


def test_overview_names_every_region() -> None:
    rgb, labels = photo()
    named = draw_overview(rgb, labels, DOCUMENT, {})
    for left in (150, 450, 750):
        above = named[260:298, left - 40 : left + 140]
        assert count(above, (255, 255, 255)) > 50
        assert count(above, (18, 20, 26)) > 500


def test_arrow_points_along_the_push() -> None:
    rgb, labels = photo()
    without = draw_overview(rgb, labels, DOCUMENT, {})
    pushed = draw_overview(rgb, labels, DOCUMENT, {"ball-1": (400.0, 0.0)})
    changed = np.any(without[:600] != pushed[:600], axis=2)
    columns = np.flatnonzero(changed.any(axis=0))
    rows = np.flatnonzero(changed.any(axis=1))
    assert columns[0] == pytest.approx(200, abs=10)
    assert columns[-1] == pytest.approx(200 + 0.35 * 400, abs=10)
    assert rows.mean() == pytest.approx(350, abs=10)


@pytest.mark.parametrize("scale", [1, 4])
def test_overview_has_a_readable_size(scale: int) -> None:
    rgb, labels = photo(scale)
    height, width = draw_overview(rgb, labels, DOCUMENT, {}).shape[:2]
    assert 960 <= max(height, width) <= LONGEST
    tall, marked = np.rot90(rgb), np.rot90(labels)
    assert max(draw_overview(tall, marked, DOCUMENT, {}).shape) <= LONGEST


@pytest.fixture
def perceived(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., tuple[Path, str]]:
    """A block on a floor, perceived with its mask; the scene and what stderr has."""
    monkeypatch.chdir(tmp_path)
    rgb, labels = np.full((96, 128, 3), 190, np.uint8), np.zeros((96, 128), np.uint8)
    rgb[50:80, 40:80], labels[50:80, 40:80] = (40, 60, 170), 1
    cv2.imwrite("photo.png", rgb)
    cv2.imwrite("masks.png", labels)

    def run(*flags: str) -> tuple[Path, str]:
        command = ["perceive", "photo.png", "--masks", "masks.png", "-o", "scene.yaml"]
        assert main([*command, *flags] if "--refresh" not in flags else flags) == 0
        return tmp_path / "scene.yaml", capsys.readouterr().err

    return run


def overview_of(scene: Path) -> Path:
    return scene.parent / yaml.safe_load(scene.read_text())["assets"] / "overview.png"


def test_perceive_writes_and_prints_the_overview(perceived) -> None:
    scene, said = perceived()
    file = overview_of(scene)
    with Image.open(file) as image:
        assert max(image.size) <= LONGEST
    assert str(file.relative_to(scene.parent)) in said
    assert "\r" not in said


@pytest.mark.slow
def test_refresh_writes_the_overview_anew(perceived) -> None:
    scene, _ = perceived()
    before = overview_of(scene).read_bytes()
    text = scene.read_text().replace("block-1", "crate-7")
    scene.write_text(text)
    _, said = perceived("perceive", "--refresh", "scene.yaml")
    after = overview_of(scene)
    assert after.read_bytes() != before
    assert after.name in said
    assert not after.with_name("overview.png~").exists()


def test_clean_removes_assets_with_overview(perceived) -> None:
    scene, _ = perceived()
    assets = overview_of(scene).parent
    scene.unlink()
    assert main(["clean", "--yes"]) == 0
    assert not assets.exists()


def test_clean_keeps_assets_with_painted_overview(perceived) -> None:
    scene, _ = perceived()
    file = overview_of(scene)
    file.write_bytes(file.read_bytes() + b"mine")
    scene.unlink()
    assert main(["clean", "--yes"]) == 0
    assert file.exists()
