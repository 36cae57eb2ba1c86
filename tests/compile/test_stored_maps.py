"""A photo that was edited after its maps were made is told of; compression, and maps that were painted, are not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline

SCENE = """\
physgen: 1
image: photo.png
assets: .
world: {view: top}
objects: {ball: {mask: 1}}
"""
STICKER = (slice(20, 32), slice(90, 110))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A ball before a grainy wall, and the maps that perceiving it would have left: soft borders, one shadow."""
    rng = np.random.default_rng(7)
    wall = np.clip(rng.normal(120, 12, (100, 140, 3)), 0, 255).astype(np.uint8)
    background, clean = wall.copy(), wall.copy()
    background[70:80, 40:80] //= 2  # the shadow
    rows, columns = np.mgrid[:100, :140]
    off = np.hypot(rows - 50, columns - 60)
    coverage = np.clip(21 - off, 0, 1)
    photo = (
        background * (1 - coverage[..., None])
        + np.array([30, 60, 220]) * coverage[..., None]
    )
    for name, picture in (
        ("photo", photo),
        ("background", background),
        ("clean", clean),
    ):
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture.astype(np.uint8))
    cv2.imwrite(str(tmp_path / "coverage.png"), (coverage * 255).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "masks.png"), (off <= 20).astype(np.uint8))
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path


def told(folder: Path) -> list[str]:
    scene = pipeline.load(folder / "scene.yaml")
    maps = pipeline.percepts(scene)
    return [
        str(p)
        for p in pipeline.lint(scene, pipeline.compile(scene, maps), maps)
        if p.path == "image"
    ]


def painted(folder: Path, *names: str, where: tuple[slice, slice] = STICKER) -> None:
    for name in names:
        picture = cv2.imread(str(folder / f"{name}.png"))
        picture[where] = (20, 200, 40)
        cv2.imwrite(str(folder / f"{name}.png"), picture)


def test_an_edit_beside_the_objects_is_told_with_its_place(folder: Path) -> None:
    assert told(folder) == []
    painted(folder, "photo")
    (line,) = told(folder)
    assert line.startswith(
        f"{folder / 'scene.yaml'}:2:8: image: warning: photo.png differs from background.png in "
    )
    count = int(line.split(" in ")[1].split(" px")[0])
    assert 12 * 20 <= count <= 16 * 24
    assert "(x 88 to 111, y 18 to 33)" in line
    assert line.endswith(
        "if the photo was edited, physgen perceive --refresh makes the maps again"
    )
    (folder / "clean.png").unlink()
    assert told(folder) == [line]


def test_what_is_no_edit_of_the_surroundings_is_not_told(folder: Path) -> None:
    painted(
        folder, "photo", where=(slice(45, 55), slice(55, 65))
    )  # the ball itself is shown as the photo has it
    assert told(folder) == []
    painted(folder, "photo", where=(slice(10, 13), slice(10, 13)))  # a speck
    assert told(folder) == []
    photo = cv2.imread(str(folder / "photo.png"))
    _, data = cv2.imencode(".jpg", photo, [cv2.IMWRITE_JPEG_QUALITY, 70])
    cv2.imwrite(str(folder / "photo.png"), cv2.imdecode(data, cv2.IMREAD_COLOR))
    assert told(folder) == []


def test_who_paints_the_background_means_it(folder: Path) -> None:
    painted(folder, "background")
    assert told(folder) == []  # clean.png is still like the photo
    painted(folder, "photo", "clean")
    assert told(folder) == []
    (folder / "coverage.png").unlink()  # the background is made anew, of the photo
    painted(folder, "photo", where=(slice(0, 30), slice(0, 30)))
    assert told(folder) == []
