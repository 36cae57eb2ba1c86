"""Another program's maps in place of ours: in their size or another, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import backends, pipeline
from physgen.backends import Setup
from physgen.cli import main
from physgen.perceive.scene import UNKNOWN
from physgen.percepts.photo import read_photo
from physgen.photometry import decode
from physgen.problems import InputError

WIDTH, HEIGHT = 96, 64


@pytest.fixture
def rgb() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    picture = np.stack([120 + x, 60 + y, 0 * x + 90], -1).astype(np.uint8)
    picture[20:44, 30:54] = (220, 40, 30)
    return picture


def made(role: str, path) -> object:
    return backends.make(role, "file", Setup(str(path)))


def test_normals_keep_their_frame_in_any_size_and_of_any_length(tmp_path, rgb):
    true = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    true[:, :48], true[:, 48:] = (0.6, 0, 0.8), (0, -0.6, 0.8)
    np.save(tmp_path / "n.npy", 3 * np.repeat(np.repeat(true, 2, 0), 2, 1))
    picture = np.rint(true * 127 + 128).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "n.png"), picture[..., ::-1])
    for name in ("n.npy", "n.png"):
        found = made("normals", tmp_path / name)(rgb, None, [], UNKNOWN)
        assert found.dtype == np.float32
        assert np.abs(found - true)[:, [*range(46), *range(50, 96)]].max() < 0.01
        assert np.abs(np.linalg.norm(found, axis=2) - 1).max() < 1e-5


def test_shading_of_any_scale_parts_the_photo(tmp_path, rgb):
    shading = np.linspace(2.0, 9.0, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    np.save(tmp_path / "s.npy", shading)
    found = made("intrinsic", tmp_path / "s.npy")(rgb, None, None)
    assert np.abs(found.albedo * found.shading[..., None] - decode(rgb)).max() < 1e-5
    assert 0.9 < np.percentile(found.albedo, 99.9) <= 1
    most = found.shading / shading  # the same shading but for a factor, save where albedo would pass 1
    assert np.percentile(most, 90) == pytest.approx(np.median(most), rel=1e-4)


def test_depth_and_coverage_from_pictures(tmp_path, rgb):
    far = (np.mgrid[:HEIGHT, :WIDTH][1] * 600).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "d.png"), far)
    found = made("depth", tmp_path / "d.png")(rgb)
    assert found.dtype == np.float32
    assert (np.diff(found, axis=1) > 0).all()
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    labels[20:44, 30:54] = 1
    cv2.imwrite(str(tmp_path / "c.png"), np.full((HEIGHT, WIDTH), 128, np.uint8))
    coverage = made("matte", tmp_path / "c.png")(rgb, labels)
    assert coverage[32, 42] == 1  # deep inside, whatever the file says
    assert coverage[0, 0] == 0
    assert coverage[20, 42] == pytest.approx(128 / 255)


def test_a_whole_scene_from_files(tmp_path, rgb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", rgb[..., ::-1])
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    labels[20:44, 30:54] = 7
    np.save("m.npy", labels)
    plate = np.full((HEIGHT, WIDTH, 3), 77, np.uint8)
    cv2.imwrite("plate.png", plate)
    np.save("d.npy", np.ones((HEIGHT, WIDTH)))
    flags = ["segment=file:m.npy", "inpaint=file:plate.png", "depth=file:d.npy"]
    assert main(["perceive", "photo.png", "-o", "s.yaml", *(x for f in flags for x in ("--backend", f))]) == 0
    scene = pipeline.load("s.yaml")
    assert len(scene.objects) == 1
    background = read_photo(tmp_path / "s.assets/background.png").rgb
    assert (background[22:42, 32:52] == 77).all()
    assert (background[:10] == rgb[:10]).all()
    assert "mask: file" in (tmp_path / "s.yaml").read_text()
    assert '"backend": "file"' in (tmp_path / "s.assets/perceived.json").read_text()


@pytest.mark.parametrize(
    ("role", "values", "message"),
    [
        ("normals", np.zeros((64, 96)), "is no map of normals; save (H, W, 3)"),
        ("depth", np.full((64, 96), np.nan), "is no map of depth; save (H, W) finite numbers"),
        ("depth", np.zeros((64, 64)), "64 x 64 px has other proportions than the photo's 96 x 64 px"),
        ("depth", np.array(["a"]), "is no map of depth"),
        ("segment", np.full((64, 96), "x"), "label"),
    ],
)
def test_maps_that_do_not_fit_are_refused(tmp_path, rgb, role, values, message):
    np.save(tmp_path / "m.npy", values)
    with pytest.raises(InputError) as error:
        made(role, tmp_path / "m.npy")(rgb)
    assert message in str(error.value)


def test_files_that_are_not_there_or_no_maps(tmp_path):
    for text, message in (
        ("", "names no file; write depth=file:PATH"),
        (str(tmp_path / "no.npy"), "is not there"),
    ):
        with pytest.raises(InputError) as error:
            backends.make("depth", "file", Setup(text))
        assert message in str(error.value)
    (tmp_path / "x.npy").write_bytes(b"no")
    (tmp_path / "x.png").write_bytes(b"no")
    for name in ("x.npy", "x.png"):
        with pytest.raises(InputError):
            made("depth", tmp_path / name)
