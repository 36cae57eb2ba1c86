"""What is missing from a data set, or lies beside it, is told by name."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from physgen.cli.main import main

SCENE = """\
physgen: 1
size: [48, 32]
world: {duration: 0.1, gravity: [0, 0]}
objects: {ball: {shape: {circle: {center: [16, 16], radius: 6}}, velocity: [60, 0]}}
render: {fps: 20}
"""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("told")
    for name, labels in (("one", ["--export", "order"]), ("two", [])):
        (root / f"{name}.yaml").write_text(SCENE)
        scene = str(root / f"{name}.yaml")
        assert main(["render", scene, "-o", str(root / "out"), "--report", "none", *labels]) == 0
    return root / "out"


def test_formats_that_no_clip_has_or_some_lack_are_told(clips: Path, tmp_path: Path, capsys) -> None:
    data = tmp_path / "data"
    gather = ["dataset", str(clips), "-o", str(data), "--split", "train=1"]
    assert main([*gather, "--format", "depth,order"]) == 0
    said = capsys.readouterr().err
    assert "no clip has depth" in said
    assert "1 clip of 2 have no order" in said
    assert f"without a caption, e.g. {clips / 'one'}" in said
    assert main(gather) == 2
    assert 'holds a data set with formats ["depth", "order"], not all' in capsys.readouterr().err


def test_shards_whose_clips_have_different_files_are_told(clips: Path, tmp_path: Path, capsys) -> None:
    one = ["dataset", str(clips / "one"), "-o", str(tmp_path / "even"), "--layout", "webdataset"]
    assert main(one) == 0
    assert "different files" not in capsys.readouterr().err
    assert "which they have not here" not in (tmp_path / "even/README.md").read_text()
    both = ["dataset", str(clips), "-o", str(tmp_path / "uneven"), "--layout", "webdataset"]
    assert main(both) == 0
    assert f"holds clips with different files, e.g. {clips / 'two'}" in capsys.readouterr().err
    assert "which they have not here" in (tmp_path / "uneven/README.md").read_text()


def test_strays_are_named(clips: Path, tmp_path: Path, capsys) -> None:
    data = tmp_path / "data"
    assert main(["dataset", str(clips), "-o", str(data), "--split", "train=1"]) == 0
    assert main(["dataset", str(clips / "one"), "-o", str(data), "--split", "train=1"]) == 0
    assert f"clips that are not named here, e.g. {data / 'train'}" in capsys.readouterr().err


def test_a_clip_whose_manifest_is_lost_is_told(clips: Path, tmp_path: Path, capsys) -> None:
    shutil.copytree(clips, tmp_path / "out")
    (tmp_path / "out/two/manifest.json").unlink()
    lost = str(tmp_path / "out/two")
    assert main(["dataset", str(tmp_path / "out"), "-o", str(tmp_path / "data")]) == 2
    assert f"{lost}: has no manifest that can be read" in capsys.readouterr().err
    assert main(["verify", str(tmp_path / "out")]) == 2
    assert f"{lost}: not verified" in capsys.readouterr().out


@pytest.mark.parametrize(("to", "said"), [("out/data", "lies in"), (".", "holds")])
def test_a_data_set_within_what_is_read(clips: Path, capsys, to: str, said: str) -> None:
    out = clips.parent / to
    assert main(["dataset", str(clips), "-o", str(out)]) == 2
    assert f"{out}: {said} {clips}, which is read; name a folder beside it with -o" in capsys.readouterr().err
