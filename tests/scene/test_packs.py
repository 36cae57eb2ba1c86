"""A pack holds what its scene reads, no more and no less, and means the same wherever it is opened."""

from __future__ import annotations

import io
import json
import os
import shutil
import stat
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.shapes import mask_crc
from physgen.problems import InputError
from physgen.scene.pack import pack_scene
from physgen.scene.scene import Auto, Circle
from physgen.scene.unpack import unpack_to

SCENE = """\
# a ball, and what it falls on
physgen: 1
image: photo.png   # ours
assets: photo.assets
world: {duration: 0.2}
objects:
  ball: {mask: 1, mass: 100, solid: sphere, velocity: [40, 0], from: {mass: physics 0.5}}
boundaries:
  floor: {segment: [[-20, 40], [90, 40]]}
light: {direction: [0.3, -0.6, 0.74]}
render: {fps: 30}
"""


def photo(folder: Path, name: str = "photo.png", seed: int = 1) -> None:
    """64 x 48 px, noisy, with a ball."""
    rng = np.random.default_rng(seed)
    picture = rng.integers(80, 120, (48, 64, 3), dtype=np.uint8)
    cv2.circle(picture, (20, 24), 9, (40, 160, 210), -1, cv2.LINE_AA)
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / name), picture)


def maps(folder: Path) -> None:
    folder.mkdir(parents=True)
    y, x = np.mgrid[:48, :64]
    labels = (np.hypot(x - 20, y - 24) <= 9).astype(np.uint16)
    cv2.imwrite(str(folder / "masks.png"), labels)
    outline = {"crc": mask_crc(labels, 1), "shape": {"circle": {"center": [20, 24], "radius": 9.5}}}
    (folder / "outlines.json").write_text(json.dumps({"1": outline}))
    (folder / "perceived.json").write_text('{"values": {"ball": {"mass": 50}}}')  # 100 g are the user's


@pytest.fixture
def pool(tmp_path: Path) -> Path:
    """A scene with all that it reads."""
    folder = tmp_path / "there" / "pool"
    photo(folder)
    maps(folder / "photo.assets")
    (folder / "scene.yaml").write_text(SCENE)
    return folder / "scene.yaml"


def members(data: bytes) -> dict[str, bytes]:
    """What a reader of its own finds, each name once and each sum right."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert len(set(archive.namelist())) == len(archive.namelist())
        return {name: archive.read(name) for name in archive.namelist()}


def render(path: Path, out: Path, **how) -> dict[str, object]:
    """What a clip is, by its manifest; and the bytes of its video."""
    folder = pipeline.render_scene(path, out, page=pipeline.Page.NONE, **how)
    told = json.loads((folder / "manifest.json").read_text())
    return {
        "inputs": sorted(told["inputs"].values()),
        "samples": told["samples"],
        "frames": told["frames"],
        "video": (folder / "video.mp4").read_bytes(),
        "motion": (folder / "trajectory.npz").read_bytes(),
    }


def test_a_plain_zip_with_the_same_bytes_always(pool: Path, tmp_path: Path) -> None:
    data = pack_scene(pool)
    other = tmp_path / "elsewhere" / "deeper" / "pool"
    shutil.copytree(pool.parent, other)
    for file in other.rglob("*"):
        os.utime(file, (1, 1))
        file.chmod(0o700)
    (other / "notes.txt").write_text("not read")
    (other / "photo.assets" / "masks.png~").write_bytes(b"an older one")
    assert pack_scene(other / "scene.yaml") == data
    assert pack_scene(os.path.relpath(other / "scene.yaml")) == data
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = ["masks.png", "outlines.json", "perceived.json"]
        maps = [f"pool/photo.assets/{name}" for name in files]
        names = ["pack.json", "pool/scene.yaml", *maps, "pool/photo.png"]
        assert archive.namelist() == names
        for entry in archive.infolist():
            assert entry.compress_type == zipfile.ZIP_STORED
            assert entry.date_time == (1980, 1, 1, 0, 0, 0)
            assert entry.external_attr >> 16 == stat.S_IFREG | 0o644
    found = members(data)
    for name in names[1:]:
        assert found[name] == (pool.parent.parent / name).read_bytes()
    photo(other, seed=2)
    assert pack_scene(other / "scene.yaml") != data


def test_clips_of_the_file_the_pack_and_what_was_in_it_are_the_same(pool: Path, tmp_path: Path) -> None:
    photo(pool.parent, "other.png", seed=5)
    soft = pool.parent.parent / "soft" / "scene.yaml"
    soft.parent.mkdir()
    soft.write_text(
        "physgen: 1\nextends: ../pool/scene.yaml  # the same table\n"
        "objects: {ball: {mass: 60}}\nvariants:\n  far: {image: there.png}\n"
    )
    photo(soft.parent, "there.png", seed=9)
    data = pack_scene(soft)
    assert set(members(data)) == {
        "pack.json",
        "soft/scene.yaml",
        "pool/scene.yaml",
        "pool/photo.png",
        "pool/photo.assets/masks.png",
        "pool/photo.assets/outlines.json",
        "pool/photo.assets/perceived.json",
        "soft/there.png",
    }
    pack = tmp_path / "soft.physgen"
    pack.write_bytes(data)
    scene = unpack_to(data, tmp_path / "here")
    assert scene == tmp_path / "here" / "soft" / "scene.yaml"
    assert scene.read_text() == soft.read_text()
    here, there = (pipeline.load(path).objects[0] for path in (soft, pack))
    assert here == there
    assert isinstance(here.shape, Auto)
    assert here.shape.stored == Circle((20, 24), 9.5)
    assert "mass" not in here.provenance
    shots = []
    for variant in (None, "far"):
        clips = [
            render(path, tmp_path / "out" / str(k), variant=variant)
            for k, path in enumerate((soft, pack, scene))
        ]
        assert clips[0] == clips[1] == clips[2]
        shots.append(clips[0]["frames"])
    assert shots[0] != shots[1]
    assert pack_scene(scene) == data
    assert sorted(p.name for p in (tmp_path / "out" / "1").iterdir()) == ["soft", "soft-far"]


def test_links_are_followed_and_an_empty_folder_of_maps_comes_along(pool: Path, tmp_path: Path) -> None:
    (pool.parent / "photo.png").rename(pool.parent / "real.png")
    (pool.parent / "photo.png").symlink_to("real.png")
    (pool.parent / "none").mkdir()
    shape = "objects.ball.shape: {circle: {center: [20, 24], radius: 9}}, objects.ball.mask: null"
    pool.write_text(SCENE + "variants:\n  bare: {assets: none, " + shape + "}\n")
    data = pack_scene(pool)
    assert {"pool/photo.png", "pool/none/", "pool/photo.assets/masks.png"} <= set(members(data))
    scene = unpack_to(data, tmp_path / "here")
    assert not any(path.is_symlink() for path in (tmp_path / "here").rglob("*"))
    assert render(pool, tmp_path / "a") == render(scene, tmp_path / "b")


def test_what_no_pack_can_hold_is_refused(pool: Path, tmp_path: Path) -> None:
    photo(tmp_path / "far", "shot.png", seed=4)
    pool.write_text(SCENE.replace("photo.png ", "'../../far/shot.png' "))
    with pytest.raises(InputError) as caught:
        pack_scene(pool)
    assert str(caught.value) == (
        f'{pool}:3:8: image: "../../far/shot.png" leads out of the scene\'s folder; '
        "keep it below the scene's folder"
    )
    pool.write_text(SCENE.replace("photo.png ", "photo.assets/../photo.png "))
    with pytest.raises(InputError) as caught:
        pack_scene(pool)
    assert "leads round about; write the straight path" in str(caught.value)
    photo(pool.parent, "b\\c.png")
    pool.write_text(SCENE.replace("photo.png ", "b\\c.png "))
    with pytest.raises(InputError) as caught:
        pack_scene(pool)
    assert "is no plain name" in str(caught.value)


def test_a_pack_is_unpacked_once_and_again_when_it_changes(pool: Path, tmp_path: Path) -> None:
    pack = tmp_path / "pool.physgen"
    pack.write_bytes(pack_scene(pool))
    first = pipeline.load(pack)
    assert pipeline.load(pack).image == first.image
    photo(pool.parent, seed=3)
    pack.write_bytes(pack_scene(pool))  # another pack under the same name
    second = pipeline.load(pack)
    assert first.image is not None
    assert second.image is not None
    assert first.image.read_bytes() != second.image.read_bytes() == (pool.parent / "photo.png").read_bytes()


def test_a_pack_opens_where_nothing_can_be_kept(
    pool: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PHYSGEN_CACHE_BYTES", "0")
    pack = tmp_path / "pool.physgen"
    pack.write_bytes(pack_scene(pool))
    scene = pipeline.load(pack)
    assert pipeline.percepts(scene) is not None
    assert scene.name == "pool"
