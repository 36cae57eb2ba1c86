"""Another program's maps in place of ours: in their size or another, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import pipeline, registry
from physgen.cli.main import main
from physgen.perceive.backends.from_file import parted
from physgen.perceive.perceive import UNKNOWN
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
    cv2.imwrite(str(tmp_path / "n.png"), np.rint(true * 32767 + 32768).astype(np.uint16)[..., ::-1])
    assert np.abs(made("normals", tmp_path / "n.png")(rgb, None, [], UNKNOWN) - true).max() < 1e-4
    np.save(tmp_path / "n.npy", true * 1e30)
    assert np.abs(made("normals", tmp_path / "n.npy")(rgb, None, [], UNKNOWN) - true).max() < 1e-6


def test_a_shading_in_the_albedos_own_scale_is_not_scaled():
    grey = np.full((4, 4, 3), 128, np.uint8)
    found = parted(grey, np.full((4, 4), 0.5, np.float32))
    assert found.shading == pytest.approx(0.5)
    assert found.albedo == pytest.approx(decode(grey) / 0.5)


def test_objects_are_numbered_left_to_right_whatever_their_ids(tmp_path, rgb):
    labels = np.zeros((HEIGHT, WIDTH))
    labels[2:6, 5:9], labels[40:60, 20:40], labels[10:14, 80:90] = 70_000, 3, 9
    numbered = np.zeros((HEIGHT, WIDTH))
    numbered[2:6, 5:9], numbered[40:60, 20:40], numbered[10:14, 80:90] = 1, 2, 3
    for kind in (np.int64, np.uint32, np.int32):
        np.save(tmp_path / "m.npy", labels.astype(kind))
        assert np.array_equal(made("segment", tmp_path / "m.npy")(rgb).labels, numbered)
    np.save(tmp_path / "m.npy", np.repeat(np.repeat(labels.astype(np.int64), 2, 0), 2, 1))
    found = made("segment", tmp_path / "m.npy")(rgb)
    assert np.array_equal(found.labels, numbered)
    assert len(found.confidence) == 3
    np.save(tmp_path / "m.npy", np.zeros((HEIGHT, WIDTH), int))
    nothing = made("segment", tmp_path / "m.npy")(rgb)
    assert not nothing.labels.any()
    assert len(nothing.confidence) == 0


def test_an_object_lost_in_a_smaller_photo_leaves_no_gap(tmp_path, rgb):
    labels = np.zeros((HEIGHT * 3, WIDTH * 3), np.uint8)
    labels[9:90, 9:90], labels[102, 102], labels[9:90, 150:200] = 1, 2, 3
    np.save(tmp_path / "m.npy", labels)
    found = made("segment", tmp_path / "m.npy")(rgb)
    assert set(np.unique(found.labels)) - {0} == set(range(1, len(found.confidence) + 1))


def test_names_in_capitals(tmp_path, rgb):
    np.save(tmp_path / "d.npy", np.ones((HEIGHT, WIDTH)))
    np.save(tmp_path / "m.npy", np.eye(HEIGHT, WIDTH, dtype=int))
    np.save(tmp_path / "n.npy", np.ones((HEIGHT, WIDTH, 3)))
    for role, name in (("depth", "D.NPY"), ("segment", "M.NPY"), ("normals", "N.NPY")):
        (tmp_path / name.lower()).rename(tmp_path / name)
        made(role, tmp_path / name)


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
        ("normals", np.zeros((64, 96)), "is no map of normals; save (H, W, 3) finite numbers"),
        ("depth", np.full((64, 96), np.nan), "is no map of depth; save (H, W) finite numbers"),
        ("depth", np.zeros((64, 64)), "64 x 64 px has other proportions than the photo's 96 x 64 px"),
        ("depth", np.array(["a"]), "is no map of depth"),
        ("segment", np.full((64, 96), "x"), "label"),
        ("segment", np.zeros((0, 0), int), "is no label map"),
        (
            "segment",
            np.full((64, 96), -1),
            "-1 is no object's id; save whole numbers from 0 on, 0 = background",
        ),
        ("segment", np.arange(70_000).reshape(7, -1), "70000 ids are too many for a label map"),
        ("normals", np.full((64, 96, 3), np.nan), "is no map of normals; save (H, W, 3) finite numbers"),
        ("normals", np.full((64, 96, 3), "x"), "is no map of normals"),
        ("normals", np.zeros((0, 0, 3)), "is no map of normals"),
        ("depth", np.zeros((0, 0)), "is no map of depth"),
        ("depth", np.full((64, 96), 1e300), "is no map of depth; save (H, W) finite numbers"),
        ("depth", np.full((64, 96), 1j), "(64, 96) complex128 is no map of depth"),
        ("intrinsic", np.full((64, 96), 1e300), "is no map of shading"),
        ("matte", np.full((64, 96), 1j), "is no map of coverage"),
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
            registry.make("depth", "file", Setup(text))
        assert message in str(error.value)
    for content in (b"no", b""):
        for name in ("x.npy", "x.png"):
            (tmp_path / name).write_bytes(content)
            for role in ("segment", "depth", "normals", "intrinsic", "matte", "inpaint"):
                with pytest.raises(InputError):
                    made(role, tmp_path / name)
