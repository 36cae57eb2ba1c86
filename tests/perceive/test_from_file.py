"""Another program's maps in place of ours: in their size or another, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import pipeline, registry
from physgen.cli.main import main
from physgen.perceive.perception_run import UNKNOWN
from physgen.photometry import decode
from physgen.photos import read_photo
from physgen.problems import InputError
from physgen.registry import Setup

WIDTH, HEIGHT = 96, 64


@pytest.fixture
def rgb() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    picture = np.stack([120 + x, 60 + y, 0 * x + 90], -1).astype(np.uint8)
    picture[20:44, 30:54] = (220, 40, 30)
    return picture


def made(role: str, path) -> object:
    return registry.make(role, "file", Setup(str(path)))


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


def test_normals_of_16_bits_are_those_of_an_array(tmp_path, rgb):
    y, x = np.mgrid[:HEIGHT, :WIDTH] / HEIGHT - 0.5
    true = np.stack([x / 2, y, np.sqrt(1 - x * x / 4 - y * y)], -1)
    cv2.imwrite(
        str(tmp_path / "n.png"),
        np.rint(true * 32767 + 32768).astype(np.uint16)[..., ::-1],
    )
    assert (
        np.abs(made("normals", tmp_path / "n.png")(rgb, None, [], UNKNOWN) - true).max()
        < 1e-4
    )
    np.save(tmp_path / "n.npy", true * 1e30)
    assert (
        np.abs(made("normals", tmp_path / "n.npy")(rgb, None, [], UNKNOWN) - true).max()
        < 1e-6
    )


def test_shading_of_any_scale_parts_the_photo(tmp_path, rgb):
    shading = np.linspace(2.0, 9.0, WIDTH * HEIGHT, dtype=np.float32).reshape(
        HEIGHT, WIDTH
    )
    np.save(tmp_path / "s.npy", shading)
    found = made("intrinsic", tmp_path / "s.npy")(rgb, None, None)
    assert np.abs(found.albedo * found.shading[..., None] - decode(rgb)).max() < 1e-5
    assert 0.9 < np.percentile(found.albedo, 99.9) <= 1
    most = (
        found.shading / shading
    )  # the same shading but for a factor, save where albedo would pass 1
    assert np.percentile(most, 90) == pytest.approx(np.median(most), rel=1e-4)


def test_depth_from_a_picture(tmp_path, rgb):
    far = (np.mgrid[:HEIGHT, :WIDTH][1] * 600).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "d.PNG"), far)
    found = made("depth", tmp_path / "d.PNG")(rgb)
    assert found.dtype == np.float32
    assert (np.diff(found, axis=1) > 0).all()


def test_a_whole_scene_from_files(tmp_path, rgb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("photo.png", rgb[..., ::-1])
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    labels[20:44, 30:54] = 7
    cv2.imwrite("m.png", labels)
    plate = np.full((HEIGHT, WIDTH, 3), 77, np.uint8)
    cv2.imwrite("plate.png", plate)
    np.save("d.npy", np.ones((HEIGHT, WIDTH)))
    flags = ["inpaint=file:plate.png", "depth=file:d.npy"]
    words = [word for flag in flags for word in ("--backend", flag)]
    assert (
        main(["perceive", "photo.png", "--masks", "m.png", "-o", "s.yaml", *words]) == 0
    )
    scene = pipeline.load("s.yaml")
    assert len(scene.objects) == 1
    background = read_photo(tmp_path / "s.assets/background.png").rgb
    assert (background[22:42, 32:52] == 77).all()
    assert (background[:10] == rgb[:10]).all()
    assert '"backend": "file"' in (tmp_path / "s.assets/perceived.json").read_text()


@pytest.mark.parametrize(
    ("role", "values", "message"),
    [
        (
            "normals",
            np.zeros((64, 96)),
            "is not a map of normals; save (H, W, 3) finite numbers",
        ),
        (
            "depth",
            np.full((64, 96), np.nan),
            "is not a map of depth; save (H, W) finite numbers",
        ),
        (
            "depth",
            np.zeros((64, 64)),
            "64 x 64 px has other proportions than the photo's 96 x 64 px",
        ),
        ("depth", np.array(["a"]), "is not a map of depth"),
        (
            "normals",
            np.full((64, 96, 3), np.nan),
            "is not a map of normals; save (H, W, 3) finite numbers",
        ),
        ("normals", np.full((64, 96, 3), "x"), "is not a map of normals"),
        ("normals", np.zeros((0, 0, 3)), "is not a map of normals"),
        ("depth", np.zeros((0, 0)), "is not a map of depth"),
        (
            "depth",
            np.full((64, 96), 1e300),
            "is not a map of depth; save (H, W) finite numbers",
        ),
        ("depth", np.full((64, 96), 1j), "(64, 96) complex128 is not a map of depth"),
        ("intrinsic", np.full((64, 96), 1e300), "is not a map of shading"),
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
        (str(tmp_path / "no.npy"), "does not exist"),
    ):
        with pytest.raises(InputError) as error:
            registry.make("depth", "file", Setup(text))
        assert message in str(error.value)
    for content in (b"no", b""):
        for name in ("x.npy", "x.png"):
            (tmp_path / name).write_bytes(content)
            for role in ("depth", "normals", "intrinsic", "inpaint"):
                with pytest.raises(InputError):
                    made(role, tmp_path / name)
