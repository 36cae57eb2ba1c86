"""Scenes whose photo or assets changed: reported once, and rebuilt by a refresh."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from physgen import pipeline
from physgen.cli.main import main
from physgen.maps import read_labels
from physgen.scene.files import equal

pytestmark = pytest.mark.slow  # each test perceives a photo, some of them twice


BALLS = ((60, 70), (150, 75), (240, 70))
RADIUS = 30
SIZE = (300, 140)
MASS_TOLERANCE = 1.0
"""g: a refresh fits outlines to masks, and perceiving to the photo; masses are rounded."""


@pytest.fixture(scope="module")
def perceived(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three balls on paper, found by masks, and by boxes."""
    folder = tmp_path_factory.mktemp("perceived")
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    photo = np.full((SIZE[1], SIZE[0], 3), (176, 186, 190), np.uint8)
    masks = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    colours = ((170, 60, 40), (40, 40, 170), (60, 120, 30))
    for id_, (x, y) in enumerate(BALLS, 1):
        inside = np.hypot(columns - x, rows - y) <= RADIUS
        photo[inside], masks[inside] = colours[id_ - 1], id_
    path = folder / "photo.png"
    cv2.imwrite(str(path), cv2.GaussianBlur(photo, (0, 0), 0.7))
    cv2.imwrite(str(folder / "marked.png"), masks)
    marked = ["--masks", str(folder / "marked.png")]
    boxes = [f"--box={x - 33},{y - 33},66,66" for x, y in BALLS]
    for name, flags in (("scene", marked), ("boxes", boxes)):
        output = ["-o", str(folder / f"{name}.yaml")]
        assert main(["perceive", str(path), *flags, *output]) == 0
    return folder


@pytest.fixture(scope="module")
def found_stones(bundled: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Curling stones, found without help."""
    folder = tmp_path_factory.mktemp("stones")
    photo = cv2.imread(str(bundled / "curling" / "photo.png"))
    small = cv2.resize(photo, (320, 320), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "photo.png"), small)
    output = ["-o", str(folder / "scene.yaml")]
    assert main(["perceive", str(folder / "photo.png"), *output]) == 0
    return folder


@pytest.fixture
def stones(found_stones: Path, tmp_path: Path) -> Path:
    shutil.copytree(found_stones, tmp_path, dirs_exist_ok=True)
    return tmp_path / "scene.yaml"


@pytest.fixture
def scene(perceived: Path, tmp_path: Path) -> Path:
    shutil.copytree(perceived, tmp_path, dirs_exist_ok=True)
    return tmp_path / "scene.yaml"


def resize_photo(scene: Path, width: int, height: int) -> None:
    photo = scene.with_name("photo.png")
    picture = cv2.imread(str(photo))
    cv2.imwrite(str(photo), cv2.resize(picture, (width, height)))


def data_of(scene: Path) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(scene.read_text())
    return data


def place_of(scene: Path, key: str) -> str:
    """File, line and column of the value of a key at the top of a scene."""
    lines = scene.read_text().splitlines()
    (line,) = (n for n, text in enumerate(lines, 1) if text.startswith(f"{key}: "))
    return f"{scene}:{line}:{len(key) + 3}: "


def files_of(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def refresh(scene: Path, *flags: str) -> int:
    return main(["perceive", "--refresh", str(scene), *flags])


# ---- messages


@pytest.mark.parametrize(
    "command", [["check"], ["render", "-o", "{out}"], ["simulate"], ["show"]]
)
@pytest.mark.parametrize("size", [(150, 70), (300, 200), (140, 300)])
def test_photo_of_another_size_is_one_problem(
    scene: Path,
    command: list[str],
    size: tuple[int, int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    resize_photo(scene, *size)
    out = str(scene.with_name("out"))
    name, *flags = [part.format(out=out) for part in command]
    assert main([name, str(scene), *flags]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(place_of(scene, "image"))
    assert f"{size[0]} x {size[1]}" in line
    assert "300 x 140" in line


@pytest.mark.parametrize("command", ["check", "simulate"])
@pytest.mark.parametrize("is_emptied", [False, True])
def test_deleted_assets_are_one_problem(
    scene: Path, command: str, is_emptied: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assets = scene.with_name("scene.assets")
    shutil.rmtree(assets)
    if is_emptied:
        assets.mkdir()
    assert main([command, str(scene)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(place_of(scene, "assets"))


def test_photo_deleted_with_its_assets_is_one_problem(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = scene.read_text().replace("image: photo.png", "image: scene.assets/p.png")
    scene.write_text(text)
    shutil.rmtree(scene.with_name("scene.assets"))
    assert main(["check", str(scene)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(place_of(scene, "assets"))


def test_single_map_of_another_size_is_named(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    masks = scene.parent / "scene.assets" / "masks.png"
    picture = cv2.imread(str(masks), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(masks), picture[:100])
    assert main(["check", str(scene)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(place_of(scene, "assets"))
    assert "scene.assets/masks.png" in line
    assert "300 x 100" in line


# ---- a refresh of deleted assets


def check_rebuilt(scene: Path) -> None:
    """Delete the assets, refresh, and compare the text and the masks."""
    assets = scene.with_name(data_of(scene)["assets"])
    text, masks = scene.read_text(), read_labels(assets / "masks.png")
    shutil.rmtree(assets)
    assert refresh(scene) == 0
    assert equal(data_of(scene), yaml.safe_load(text), MASS_TOLERANCE)
    assert scene.read_text().count("#") == text.count("#")
    assert np.array_equal(read_labels(assets / "masks.png"), masks)
    assert main(["check", str(scene)]) == 0
    assert not [path for path in scene.parent.iterdir() if path.name.startswith(".")]


def test_refresh_rebuilds_deleted_assets(stones: Path) -> None:
    check_rebuilt(stones)


def test_refresh_rebuilds_assets_from_prompts(scene: Path) -> None:
    check_rebuilt(scene.with_name("boxes.yaml"))


def test_refresh_rebuilds_emptied_assets(scene: Path) -> None:
    scene = scene.with_name("boxes.yaml")
    masks = scene.parent / "boxes.assets" / "masks.png"
    labels = read_labels(masks)
    shutil.rmtree(masks.parent / "cache")
    for file in masks.parent.iterdir():
        file.unlink()
    assert refresh(scene) == 0
    new = scene.with_name(data_of(scene)["assets"]) / "masks.png"
    assert np.array_equal(read_labels(new), labels)
    assert main(["check", str(scene)]) == 0


def test_refresh_of_deleted_assets_keeps_edits(stones: Path) -> None:
    data = data_of(stones)
    names = sorted(data["objects"])
    assert main(["remove", str(stones), names[2]]) == 0
    assert main(["rename", str(stones), names[1], "cherry"]) == 0
    text = stones.read_text() + "# mine\n"
    text = text.replace(f"mass: {data['objects'][names[0]]['mass']}", "mass: 77", 1)
    stones.write_text(text)
    shutil.rmtree(stones.with_name("scene.assets"))
    assert refresh(stones) == 0
    after = data_of(stones)
    assert set(after["objects"]) == {*names, "cherry"} - {*names[1:3]}
    assert after["objects"][names[0]]["mass"] == 77
    assert "# mine" in stones.read_text()
    assert main(["check", str(stones)]) == 0


def test_objects_that_are_not_there_again_stop_a_rebuild(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = scene.with_name("boxes.yaml")
    data = data_of(scene)
    shape = {"circle": {"center": [20, 20], "radius": 8}}
    data["objects"] |= {
        "mug-1": {"label": "mug", "mask": 99, "mass": 5},
        "bowl-1": {"label": "bowl", "mask": 98, "mass": 5},
        "drawn": {"shape": shape, "mass": 5},
    }
    scene.write_text(yaml.safe_dump(data, sort_keys=False))
    shutil.rmtree(scene.with_name("boxes.assets"))
    before = files_of(scene.parent)
    assert refresh(scene) == 2
    told = capsys.readouterr().err
    for name in ("bowl-1", "mug-1"):
        assert f"{scene}: objects.{name}: " in told
    assert files_of(scene.parent) == before
    del data["objects"]["bowl-1"]
    ball = data["objects"].pop(sorted(data["objects"])[0])
    data["objects"]["mug-1"]["prompt"] = ball["prompt"]
    scene.write_text(yaml.safe_dump(data, sort_keys=False))
    assert refresh(scene) == 0
    assert main(["check", str(scene)]) == 0


# ---- a refresh with a photo of another size


@pytest.mark.parametrize("factor", [0.5, 2])
def test_refresh_scales_what_a_user_set(scene: Path, factor: float) -> None:
    data = data_of(scene)
    first, second, third = sorted(data["objects"])
    data["objects"][first] |= {"velocity": [-60, -12], "mass": 77}
    data["objects"][second] |= {"velocity": ["24 px/s", "0.1 m/s"]}
    data["objects"][third] |= {"prompt": {"box": [207, 37, 66, 66]}, "velocity": [9, 0]}
    data["world"] |= {"duration": 0.5, "gravity": [0, 100]}
    data["forces"] = [{"object": first, "impulse": [100, 0], "at": [60, 70]}]
    data["boundaries"] = {"lid": {"segment": [[-50, 0], [350, 4]]}}
    data["render"] = {"size": [150, 70], "camera": {"center": [150, 70], "zoom": 2}}
    data["variants"] = {"fast": {f"objects.{first}.velocity": [80, 0]}}
    scene.write_text(yaml.safe_dump(data, sort_keys=False))
    before = pipeline.load(scene)
    old = pipeline.simulate(pipeline.compile(before, pipeline.percepts(before)).world)
    resize_photo(scene, int(SIZE[0] * factor), int(SIZE[1] * factor))
    assert refresh(scene) == 0
    after = data_of(scene)
    objects = after["objects"]

    def point(x: float, y: float) -> list[float]:
        return [factor * (x + 0.5) - 0.5, factor * (y + 0.5) - 0.5]

    assert objects[first]["velocity"] == [-60 * factor, -12 * factor]
    assert objects[first]["mass"] == 77
    assert objects[second]["velocity"] == [f"{24 * factor:g} px/s", "0.1 m/s"]
    box = [value * factor for value in (207, 37, 66, 66)]
    assert objects[third]["prompt"]["box"] == box
    scale = data["world"]["pixels_per_meter"]
    assert after["world"]["pixels_per_meter"] == pytest.approx(scale * factor)
    assert after["world"]["gravity"] == [0, 100 * factor]
    (force,) = after["forces"]
    assert force["impulse"] == [100 * factor, 0]
    assert force["at"] == point(60, 70)
    assert after["boundaries"] == {"lid": {"segment": [point(-50, 0), point(350, 4)]}}
    assert after["render"]["size"] == [150, 70]
    assert after["render"]["camera"]["center"] == point(150, 70)
    fast = after["variants"]["fast"][f"objects.{first}.velocity"]
    assert fast == [80 * factor, 0]
    assert main(["check", str(scene)]) == 0
    now = pipeline.load(scene)
    new = pipeline.simulate(pipeline.compile(now, pipeline.percepts(now)).world)
    ends = (new.poses[-1, :, :2] + 0.5) / factor - 0.5 - old.poses[-1, :, :2]
    assert np.abs(ends).max() < 3  # px: masks have other pixels, and stand on them
    assert not [path for path in scene.parent.iterdir() if path.name.startswith(".")]
    assert scene.with_name("scene.yaml~").is_file()


def test_refresh_for_other_proportions_keeps_what_it_can(
    stones: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = data_of(stones)
    for one in data["objects"].values():
        one |= {"mass": 77, "friction": 0.123, "velocity": [60, 0]}
    first = "object-1"
    data["objects"][first]["velocity"] = ["0.1 m/s", 0]
    data["forces"] = [{"object": first, "impulse": [100, 0]}]
    data["render"] = {"fps": 12}
    stones.write_text(yaml.safe_dump(data, sort_keys=False))
    edited = stones.read_bytes()
    photo = stones.with_name("photo.png")
    cv2.imwrite(str(photo), cv2.imread(str(photo))[:, :200])
    assert refresh(stones) == 0
    after, told = data_of(stones), capsys.readouterr().err
    objects = after["objects"]
    assert first in objects
    assert objects[first]["velocity"] == ["0.1 m/s", 0]
    for name, one in data["objects"].items():
        if name in objects:
            assert (objects[name]["mass"], objects[name]["friction"]) == (77, 0.123)
            assert objects[name].get("velocity") != [60, 0]
            assert f"objects.{name}.mass" in told
        else:
            assert f"{stones}: objects.{name}.mass: warning: " in told
        if one["velocity"] == [60, 0]:
            assert f"{stones}: objects.{name}.velocity: warning: " in told
    assert f"{stones}: forces: warning: " in told
    assert "forces" not in after
    assert after["render"]["fps"] == 12
    assert stones.with_name("scene.yaml~").read_bytes() == edited
    assert main(["check", str(stones)]) == 0
    assert refresh(stones) == 0  # the values are the user's from now on, too
    again = data_of(stones)["objects"]
    assert all(one["mass"] == 77 for one in again.values() if one["friction"] == 0.123)
    assert again[first]["mass"] == 77


def test_scene_that_extends_another_is_not_rebuilt(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    top = scene.with_name("top.yaml")
    top.write_text("extends: scene.yaml\nworld: {duration: 1}\n")
    resize_photo(scene, 150, 70)
    before = files_of(scene.parent)
    assert refresh(top) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{top}: ")
    assert files_of(scene.parent) == before


def test_other_proportions_spare_a_scene_that_extends(scene: Path) -> None:
    child = scene.with_name("child.yaml")
    child.write_text(f"extends: {scene.name}\nrender: {{fps: 25}}\n")
    resize_photo(scene, 300, 220)
    before = files_of(scene.parent)
    assert refresh(child) == 2
    assert files_of(scene.parent) == before


def test_other_proportions_without_objects_change_nothing(scene: Path) -> None:
    photo = np.full((220, 300, 3), 128, np.uint8)
    cv2.imwrite(str(scene.with_name("photo.png")), photo)
    before = files_of(scene.parent)
    assert refresh(scene) == 2
    assert files_of(scene.parent) == before


def test_missing_assets_suggest_no_older_ones(
    stones: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = stones.parent
    shutil.copytree(home / "scene.assets", home / "scene-2.assets")
    text = stones.read_text().replace("scene.assets", "scene-3.assets")
    stones.write_text(text)
    assert main(["check", str(stones)]) == 2
    told = capsys.readouterr().err
    assert "scene-2.assets" not in told
    assert "perceive" in told
