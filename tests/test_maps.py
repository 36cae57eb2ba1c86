"""The maps of a photo on disk, read back by OpenCV and Pillow, and the many kinds of pictures that people have."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from physgen.files import write_with_backup
from physgen.maps import Percepts, read_labels, read_percepts, write_assets
from physgen.problems import InputError

H, W = 40, 60


@pytest.fixture
def percepts() -> Percepts:
    rng = np.random.default_rng(1)
    rgb = rng.integers(0, 256, (H, W, 3), np.uint8)
    labels = np.zeros((H, W), np.uint16)
    labels[5:20, 5:30] = 1
    labels[22:35, 10:50] = 40000
    normals = rng.normal(size=(H, W, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return Percepts(
        rgb=rgb,
        labels=labels,
        coverage=(labels > 0).astype(np.float32),
        background=rgb[::-1].copy(),
        clean=rgb[:, ::-1].copy(),
        depth=rng.uniform(1, 9, (H, W)).astype(np.float32),
        normals=normals,
        albedo=rng.uniform(0, 1, (H, W, 3)).astype(np.float32),
        shading=rng.uniform(0, 4, (H, W)).astype(np.float32),
    )


def test_maps_come_back(percepts: Percepts, tmp_path: Path) -> None:
    Image.fromarray(percepts.rgb).save(tmp_path / "photo.png")
    ranges = write_assets(percepts, tmp_path / "photo.assets")
    back = read_percepts(tmp_path / "photo.png", tmp_path / "photo.assets", ranges)
    assert back is not None
    for name in ("rgb", "labels", "background", "clean"):
        assert np.array_equal(getattr(back, name), getattr(percepts, name)), name
    for name, step in (
        ("coverage", 1 / 255),
        ("depth", 8 / 65535),
        ("albedo", 1 / 65535),
        ("shading", 4 / 65535),
        ("normals", 1 / 127),
    ):
        assert (
            np.abs(getattr(back, name) - getattr(percepts, name)).max() <= 0.51 * step
        ), name


def test_maps_are_pictures_as_documented(percepts: Percepts, tmp_path: Path) -> None:
    write_assets(percepts, tmp_path)
    with Image.open(tmp_path / "masks.png") as masks:
        assert np.array_equal(np.asarray(masks), percepts.labels)
    with Image.open(tmp_path / "background.png") as background:
        assert np.array_equal(np.asarray(background), percepts.background)
    for name in ("depth", "shading", "albedo"):
        assert (
            cv2.imread(str(tmp_path / f"{name}.png"), cv2.IMREAD_UNCHANGED).dtype
            == np.uint16
        )
    flat = Percepts(
        percepts.rgb, percepts.labels, normals=np.tile(np.float32([0, 0, 1]), (H, W, 1))
    )
    write_assets(flat, tmp_path / "flat")
    with Image.open(tmp_path / "flat" / "normals.png") as normals:
        assert np.asarray(normals)[0, 0].tolist() == [
            128,
            128,
            255,
        ]  # 128 = 0, towards the viewer


def test_nothing_painted_is_lost(percepts: Percepts, tmp_path: Path) -> None:
    write_assets(percepts, tmp_path)
    painted = tmp_path / "masks.png"
    painted.write_bytes(b"by hand")
    told: list[Path] = []
    write_assets(percepts, tmp_path, told.append)
    assert (tmp_path / "masks.png~").read_bytes() == b"by hand"
    painted.write_bytes(b"by hand again")
    write_assets(percepts, tmp_path, told.append)
    assert (tmp_path / "masks.png~").read_bytes() == b"by hand"
    assert (tmp_path / "masks.png~2").read_bytes() == b"by hand again"
    write_assets(percepts, tmp_path, told.append)
    assert [path.name for path in told] == ["masks.png~", "masks.png~2"]
    write_with_backup(tmp_path / "new", b"1")
    assert not (tmp_path / "new~").exists()


def saved(tmp_path: Path, picture: Image.Image, name: str, **options: object) -> Path:
    picture.save(tmp_path / name, **options)
    return tmp_path / name


def test_every_kind_of_label_map(tmp_path: Path) -> None:
    ids = np.zeros((H, W), np.uint8)
    ids[2:9, 3:30], ids[20:30, 5:40] = 3, 7
    assert np.array_equal(
        read_labels(saved(tmp_path, Image.fromarray(ids), "grey.png")), ids
    )
    palette = Image.fromarray(ids).convert("P")
    palette.putpalette([9, 9, 9] * 256)
    assert np.array_equal(read_labels(saved(tmp_path, palette, "palette.png")), ids)
    colours = np.zeros((H, W, 3), np.uint8)
    colours[ids == 3], colours[ids == 7] = (200, 10, 0), (0, 90, 30)
    read = read_labels(saved(tmp_path, Image.fromarray(colours), "colour.png"))
    assert (read > 0).tolist() == (ids > 0).tolist()
    assert len(np.unique(read)) == 3
    deep = np.zeros((H, W, 3), np.uint16)
    deep[ids == 3], deep[ids == 7] = (256, 0, 0), (0, 1, 0)
    cv2.imwrite(str(tmp_path / "deep.png"), deep)
    assert len(np.unique(read_labels(tmp_path / "deep.png"))) == 3
    with pytest.raises(InputError, match="is a JPEG, whose compression changes ids"):
        read_labels(saved(tmp_path, Image.fromarray(ids), "lossy.jpg"))


def test_a_map_of_another_size_is_refused(percepts: Percepts, tmp_path: Path) -> None:
    Image.fromarray(percepts.rgb).save(tmp_path / "photo.png")
    write_assets(percepts, tmp_path / "assets")
    Image.fromarray(percepts.rgb[:20]).save(tmp_path / "assets" / "background.png")
    with pytest.raises(
        InputError, match="60 x 20 px differs from the photo's 60 x 40 px"
    ):
        read_percepts(tmp_path / "photo.png", tmp_path / "assets", {})
