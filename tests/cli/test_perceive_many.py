"""Several photos at once: a folder of scenes, and what is wrong with one leaves the others be."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.cli.main import main
from physgen.messages import Message
from physgen.problems import THIS_PHOTO


@pytest.fixture
def photos(tmp_path: Path) -> list[str]:
    paths = []
    for k, name in enumerate(("a", "b")):
        rgb = np.full((90, 120, 3), (200, 190, 180), np.uint8)
        y, x = (
            np.mgrid[:90, :120] - np.array([50, 40 + 30 * k])[:, None, None]
        ) / 18  # a ball lit from above
        light = 0.35 + 0.65 * np.clip(
            0.6 * np.sqrt(np.clip(1 - x**2 - y**2, 0, 1)) - 0.8 * y, 0, 1
        )
        rgb[x**2 + y**2 <= 1] = (light[..., None] * (40, 90, 230))[x**2 + y**2 <= 1]
        cv2.imwrite(str(tmp_path / f"{name}.png"), rgb)
        paths.append(str(tmp_path / f"{name}.png"))
    return paths


def told(*arguments: str) -> int:
    return main(["perceive", *arguments, "--backend", "segment=learned"])


@pytest.mark.slow
def test_each_photo_becomes_the_scene_that_it_becomes_alone(
    photos, tmp_path: Path, capsys
):
    assert told(*photos, "-o", str(tmp_path / "all")) == 0
    assert capsys.readouterr().out.split() == [
        str(tmp_path / "all" / f"{name}.yaml") for name in "ab"
    ]
    assert told(photos[1], "-o", str(tmp_path / "alone" / "b.yaml")) == 0
    assert (tmp_path / "all/b.yaml").read_bytes() == (
        tmp_path / "alone/b.yaml"
    ).read_bytes()
    for map_ in ("masks.png", "background.png"):
        one, other = (
            tmp_path / folder / "b.assets" / map_ for folder in ("all", "alone")
        )
        assert one.read_bytes() == other.read_bytes()
    assert len(pipeline.load(tmp_path / "all/a.yaml").objects) == 1


def test_warnings_stand_below_their_photo(photos, monkeypatch, capsys):
    warning = Message.REMAINS_BEHIND.warning(THIS_PHOTO, "objects.x.mask", "a stem")

    def perceive(image, output, *, warn, inform, **others) -> str:
        warn(warning)
        inform(f"{image}: 1 object\n  picture")
        return ""

    monkeypatch.setattr(pipeline, "perceive", perceive)
    assert main(["perceive", *photos, "-o", "scenes"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[0] for line in lines] == [
        photos[0], photos[0], photos[1], photos[1],
    ]  # fmt: skip
    assert all("1 object" in line for line in lines[::2])


@pytest.mark.slow
def test_one_photo_goes_into_a_folder_that_is_not_there_yet_and_keeps_its_options(
    photos, tmp_path: Path, capsys
):
    where = tmp_path / "new"
    assert told(photos[0], "-o", f"{where}/", "--box", "20,30,40,40") == 0
    assert capsys.readouterr().out.split() == [str(where / "a.yaml")]
    (ball,) = pipeline.load(where / "a.yaml").objects
    assert ball.prompt is not None


@pytest.mark.slow
def test_one_bad_photo_leaves_the_others(photos, tmp_path: Path, capsys):
    (tmp_path / "bad.png").write_bytes(b"no picture")
    assert (
        told(
            photos[0], str(tmp_path / "bad.png"), photos[1], "-o", str(tmp_path / "all")
        )
        == 2
    )
    heard = capsys.readouterr()
    assert sorted(path.name for path in (tmp_path / "all").glob("*.yaml")) == [
        "a.yaml",
        "b.yaml",
    ]
    assert "bad.png" in heard.err
    problems = [line for line in heard.err.splitlines() if "suitability" not in line]
    assert not any("a.png" in line for line in problems)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ((), "2 photos need a folder; name it: -o FOLDER"),
        (("-o", "x.yaml"), "2 photos need a folder; name it: -o FOLDER"),
        (
            ("-o", "d", "--box", "1,2,30,40"),
            "perceive: --box is for one photo; leave it out, or name one photo",
        ),
        (("-o", "d", "--masks", "m.png"), "perceive: --masks is for one photo"),
    ],
)
def test_what_goes_with_one_photo_only_is_refused(
    photos, tmp_path, monkeypatch, capsys, more, message
):
    monkeypatch.chdir(tmp_path)
    assert told(*photos, *more) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


def test_two_photos_of_one_name_are_refused(photos, tmp_path: Path, capsys):
    assert told(photos[0], photos[0], "-o", str(tmp_path / "d")) == 2
    assert '"a" is the name of two photos; rename one' in capsys.readouterr().err


@pytest.mark.slow
def test_photos_of_one_name_go_by_their_folders(photos, tmp_path: Path):
    paths = [tmp_path / name / "photo.png" for name in ("cups", "pool")]
    for path, photo in zip(paths, photos, strict=True):
        path.parent.mkdir()
        path.write_bytes(Path(photo).read_bytes())
    assert told(*map(str, paths), "-o", str(tmp_path / "all")) == 0
    assert sorted(path.name for path in (tmp_path / "all").glob("*.yaml")) == [
        "cups.yaml",
        "pool.yaml",
    ]


def test_a_photo_that_is_not_there_stops_all_before_any_work(
    photos, tmp_path: Path, capsys
):
    assert told(photos[0], str(tmp_path / "none.png"), "-o", str(tmp_path / "all")) == 2
    assert "none.png: does not exist; name a photo" in capsys.readouterr().err
    assert not (tmp_path / "all").exists()


@pytest.mark.slow
def test_what_would_change_nothing_is_said(photos, tmp_path: Path, capsys):
    flags = ["--find", "ball, cup", "--backend", "categories=everyday"]
    assert told(photos[0], "-o", str(tmp_path / "s.yaml"), *flags) == 0
    said = capsys.readouterr().err
    assert (
        '--find: warning: "ball, cup" has no effect: no backend here finds named objects'
        in said
    )
    assert (
        "--backend: warning: categories=everyday has no effect: segment=learned needs no categories"
        in said
    )
