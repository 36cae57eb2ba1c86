"""`physgen dataset` as a person runs it; what it makes read as Hugging Face documents it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import webdataset

from physgen.batch.clips import find_clips
from physgen.batch.dataset import Splits, read_splits
from physgen.batch.layouts import LAYOUTS, Folders
from physgen.cli.main import main

SCENE = """\
physgen: 1
size: [48, 32]
world: {duration: 0.2, gravity: [0, 0]}
objects:
  ball: {shape: {circle: {center: [%d, 16], radius: 6}}, mass: 100, velocity: [60, 0]}
render: {fps: 15}
"""
HALVES = ["--split", "train=0.5,test=0.5", "--seed", "3"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of one scene, and single clips of four others."""
    root = tmp_path_factory.mktemp("clips")
    scenes = root / "scenes"
    scenes.mkdir()
    for k in range(5):
        (scenes / f"scene-{k}.yaml").write_text(SCENE % (12 + k))
    labels = ["--export", "events,flo", "--report", "none"]
    sweep = [
        "sweep",
        str(scenes / "scene-0.yaml"),
        "objects.ball.velocity.0=30,60.5",
        "objects.ball.mass=50,200",
    ]
    assert main([*sweep, "-o", str(root / "out" / "sweep"), *labels]) == 0
    others = [str(scenes / f"scene-{k}.yaml") for k in range(1, 4)]
    assert main(["render", *others, "-o", str(root / "out" / "few"), *labels]) == 0
    assert (
        main(
            [
                "render",
                str(scenes / "scene-4.yaml"),
                "-o",
                str(root / "out" / "plain"),
                *labels,
            ]
        )
        == 0
    )
    return root / "out"


def dataset(made: Path, out: Path, *flags: str) -> int:
    return main(["dataset", str(made), "-o", str(out), *flags])


def rows(out: Path) -> Iterator[tuple[Path, dict]]:
    """As `datasets` documents `metadata.jsonl`: file_name is relative to it, and splits are folders."""
    for path in sorted(out.glob("*/metadata.jsonl")):
        for line in path.read_text().splitlines():
            yield path.parent, json.loads(line)


def test_a_folder_has_a_row_for_every_clip(made: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "data"
    assert dataset(made, out, *HALVES) == 0
    told = list(rows(out))
    assert len(told) == 8
    columns = {tuple(row) for _, row in told}
    assert len(columns) == 1  # a table has the same ones in every row
    for home, row in told:
        video = home / row["file_name"]
        assert video.read_bytes()[4:8] == b"ftyp"
        assert row["split"] == home.name
        assert row["scene"].startswith("scene-")
        assert (row["frames"], row["fps"], row["width"], row["height"]) == (
            3,
            15,
            48,
            32,
        )
        assert set(row["labels"]) <= {"events", "flo"}
        assert all((video.parent / name).is_dir() for name in row["labels"])
        about = json.loads((video.parent / "clip.json").read_text())
        assert row == {"file_name": row["file_name"], **about}
        with np.load(video.parent / "trajectory.npz") as file:
            assert len(file["times"]) == 3
    swept = [
        json.loads(row["parameters"]) for _, row in told if row["scene"] == "scene-0"
    ]
    assert [tuple(values.values()) for values in swept] == [
        (30, 50),
        (30, 200),
        (60.5, 50),
        (60.5, 200),
    ]
    assert set(swept[0]) == {"objects.ball.velocity.0", "objects.ball.mass"}
    assert capsys.readouterr().out.split() == [
        str(out / name / "metadata.jsonl") for name in ("test", "train")
    ]
    made_of = json.loads((out / "dataset.json").read_text())
    assert made_of["clips"] == {
        name: sum(row["split"] == name for _, row in told) for name in ("train", "test")
    }


def test_all_clips_of_a_photo_are_in_one_split_whatever_else_there_is(
    made: Path, tmp_path: Path
) -> None:
    dataset(made, tmp_path / "all", *HALVES)
    where: dict[str, set[str]] = {}
    for _, row in rows(tmp_path / "all"):
        where.setdefault(row["photo"], set()).add(row["split"])
    assert len(where) == 5
    assert all(len(splits) == 1 for splits in where.values())
    assert len({split for splits in where.values() for split in splits}) == 2
    main(["dataset", str(made / "few"), "-o", str(tmp_path / "few"), *HALVES])
    for _, row in rows(tmp_path / "few"):
        assert {row["split"]} == where[row["photo"]]


def test_shares_are_kept_in_the_mean() -> None:
    splits = read_splits("train=0.8,validation=0.15,test=0.05", 7)
    counts = Counter(splits.assign(f"{k:064x}") for k in range(4000))
    for name, share in splits.shares:
        assert counts[name] / 4000 == pytest.approx(
            share, abs=4 * (share * (1 - share) / 4000) ** 0.5
        )
    other = Splits(splits.shares, 8)
    assert sum(splits.assign(str(k)) != other.assign(str(k)) for k in range(400)) > 50


def bytes_of(out: Path) -> dict[str, bytes]:
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in out.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_same_clips_give_the_same_bytes(
    made: Path, tmp_path: Path, monkeypatch, layout: str
) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        assert dataset(made, Path("data"), "--layout", layout, *HALVES) == 0
    assert bytes_of(tmp_path / "a") == bytes_of(tmp_path / "b")


def test_an_interrupted_run_leaves_nothing(
    made: Path, tmp_path: Path, monkeypatch
) -> None:
    add = Folders.add

    def stopping(self: Folders, *sample: Any) -> None:
        add(self, *sample)
        raise KeyboardInterrupt

    monkeypatch.setattr(Folders, "add", stopping)
    assert dataset(made, tmp_path / "data", *HALVES) == 130
    assert not list(tmp_path.iterdir())


def test_shards_are_read_by_webdataset(made: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "100% data"
    flags = ["--layout", "webdataset", "--shard-clips", "2", *HALVES]
    assert dataset(made, out, *flags) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert files == sorted(out.glob("*/shard-*.tar"))
    assert dataset(made, tmp_path / "folder", *HALVES) == 0
    expected = {row["key"]: (home, row) for home, row in rows(tmp_path / "folder")}
    found = []
    for path in files:
        clips = list(webdataset.WebDataset(str(path), shardshuffle=False))
        assert 1 <= len(clips) <= 2
        for clip in clips:
            home, row = expected[clip["__key__"]]
            about = json.loads(clip["json"])
            assert {"file_name": row["file_name"], **about} == row
            assert path.parent.name == row["split"]
            folder = home / row["key"]
            assert clip["mp4"] == (folder / "video.mp4").read_bytes()
            flow = clip["flo.forward.00000.flo"]
            assert flow == (folder / "flo/forward/00000.flo").read_bytes()
            found.append(clip["__key__"])
    assert sorted(found) == sorted(expected)


def test_shards_without_webdataset_are_refused(made, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("physgen.batch.layouts.find_spec", lambda name: None)
    assert dataset(made, tmp_path / "data", "--layout", "webdataset") == 2
    assert "needs webdataset, which is not installed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_folder_loads_with_hugging_faces_datasets(made: Path, tmp_path: Path):
    out = tmp_path / "data"
    assert dataset(made, out, *HALVES) == 0
    code = (
        "import sys, json, datasets\n"
        "found = datasets.load_dataset(sys.argv[1], cache_dir=sys.argv[2])\n"
        "found = found.cast_column('video', datasets.Video(decode=False))\n"
        "print(json.dumps({name: [row['key'] for row in split] for name, split in found.items()}))\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(out), str(tmp_path / "cache")],
        capture_output=True,
        text=True,
        check=True,
    )
    keys = json.loads(run.stdout)
    assert set(keys) == {"train", "test"}
    expected = {name: [] for name in keys}
    for home, row in rows(out):
        expected[home.name].append(row["key"])
    assert {name: sorted(found) for name, found in keys.items()} == {
        name: sorted(found) for name, found in expected.items()
    }


def test_links_that_lead_back_are_not_followed(made: Path, tmp_path: Path) -> None:
    copy = tmp_path / "out"
    shutil.copytree(made / "few", copy / "few")
    (copy / "few" / "back").symlink_to(copy)
    (copy / "other").symlink_to(made / "plain")
    assert [found.name for found in find_clips([copy])] == [
        *(f"out/few/scene-{k}" for k in (1, 2, 3)),
        "out/other/scene-4",
    ]


def test_clips_that_cannot_be_used_are_told_and_left_out(
    made: Path, tmp_path: Path, capsys
) -> None:
    copy = tmp_path / "out"
    shutil.copytree(made / "few", copy)
    one, other, third = (copy / f"scene-{k}" for k in (1, 2, 3))
    (one / "video.mp4").unlink()
    (other / "manifest.json").write_text('{"manifest": 1, "samples"')
    assert main(["dataset", str(copy), "-o", str(tmp_path / "data")]) == 2
    said = capsys.readouterr().err
    assert f"{one / 'video.mp4'}: is missing; render the clip again" in said
    assert f"{other}: has no manifest that can be read; render it again" in said
    assert [row["scene"] for _, row in rows(tmp_path / "data")] == ["scene-3"]
    assert third.is_dir()


@pytest.mark.parametrize("name", ["truth/../../../secret", "truth//etc/passwd"])
def test_a_manifest_may_not_name_files_elsewhere(
    made: Path, tmp_path: Path, capsys, name: str
) -> None:
    clip = tmp_path / "out" / "clip"
    clip.mkdir(parents=True)
    told = json.loads((made / "few" / "scene-1" / "manifest.json").read_text())
    (clip / "video.mp4").write_bytes(b"x")
    (clip / "truth" / "events").mkdir(parents=True)
    (clip / "truth" / "events" / "events.json").write_bytes(b"x")
    told["files"] = dict.fromkeys(("video.mp4", "truth/events/events.json", name), "0")
    (clip / "manifest.json").write_text(json.dumps(told))
    assert main(["dataset", str(tmp_path / "out"), "-o", str(tmp_path / "data")]) == 2
    assert "has a damaged manifest" in capsys.readouterr().err


def refusal(capsys, *command: str) -> str:
    try:
        code = main(["dataset", *command])
    except SystemExit as left:
        code = left.code
    assert code == 2
    return capsys.readouterr().err


def test_what_cannot_be_is_refused_in_one_line(
    made: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    full, data, empty = tmp_path / "full", tmp_path / "data", tmp_path / "empty"
    full.mkdir()
    empty.mkdir()
    (full / "letter.txt").write_text("mine")
    few = str(made / "few")
    assert f"{full}: is not empty" in refusal(capsys, few, "-o", str(full))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert "cannot be replaced" in refusal(capsys, few, "-o", ".")
    assert (full / "letter.txt").read_text() == "mine"
    assert "has no clip that can be used" in refusal(
        capsys, str(empty), "-o", str(data)
    )
    assert not data.exists()
    assert "is not a folder" in refusal(capsys, str(tmp_path / "none"), "-o", str(data))
    assert f"lies in {few}, which is read" in refusal(capsys, few, "-o", f"{few}/data")
    assert "have the same clips" in refusal(capsys, few, str(made), "-o", str(data))
    assert "adds up to 0.9" in refusal(
        capsys, few, "-o", str(data), "--split", "train=0.8,test=0.1"
    )
    assert '"Train" is not a split' in refusal(
        capsys, few, "-o", str(data), "--split", "Train"
    )
