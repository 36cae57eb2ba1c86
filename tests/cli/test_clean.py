"""Backups of scenes, and `physgen clean`: nothing that a user made is lost."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from physgen.cli.main import main
from physgen.files import machine_id

pytestmark = pytest.mark.slow  # each test perceives a photo, some of them twice


NO_PROCESS = 2**22 + 1
"""Above the highest process id of Linux."""


FAST = ("--still", "--backend", "label=shape")
"""Leaves out steps of `perceive` whose results these tests do not read."""


def perceive_label(photo: Path, scene: Path, label: str) -> None:
    masks = str(photo.with_name("masks.png"))
    arguments = ["perceive", str(photo), "--masks", masks, "--label", f"*={label}"]
    assert main([*arguments, *FAST, "-o", str(scene)]) == 0


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if path.name.startswith("scene")}


@pytest.fixture
def scene(blocks: Path) -> Path:
    (blocks.parent / "home").mkdir()
    path = blocks.parent / "home" / "scene.yaml"
    perceive_label(blocks, path, "brick")
    return path


def test_perceiving_again_keeps_one_backup(blocks: Path, scene: Path) -> None:
    for label in ("book", "can", "mug"):
        before = scene.read_bytes()
        perceive_label(blocks, scene, label)
        backup = scene.with_name("scene.yaml~")
        assert backup.read_bytes() == before
        used = {yaml.safe_load(path.read_text())["assets"] for path in (scene, backup)}
        assert names(scene.parent) == {"scene.yaml", "scene.yaml~", *used}
        assert len(used) == 2
        shutil.copy(backup, scene.with_name("old.yaml"))
        assert main(["check", str(scene), str(scene.with_name("old.yaml"))]) == 0
        scene.with_name("old.yaml").unlink()


def test_refreshing_again_keeps_one_backup(scene: Path) -> None:
    for label in ("book", "can", "mug"):
        arguments = ["perceive", "--refresh", str(scene), "--label", f"*={label}"]
        assert main([*arguments, *FAST]) == 0
    folders = [path for path in scene.parent.iterdir() if path.is_dir()]
    assert len(folders) <= 3  # of the scene, of its backup, and of the photo's copy
    assert [path.name for path in scene.parent.glob("*~*")] == ["scene.yaml~"]
    assert main(["check", str(scene)]) == 0


def test_edited_scenes_are_never_replaced(blocks: Path, scene: Path) -> None:
    edited = []
    for round_, label in enumerate(("book", "can", "mug", "box")):
        if round_ % 2 == 0:
            edited.append(f"{scene.read_text()}# mine: {round_}\n")
            scene.write_text(edited[-1])
        perceive_label(blocks, scene, label)
    backups = [path.read_text() for path in scene.parent.glob("scene.yaml~*")]
    assert set(edited) <= set(backups)
    assert len(backups) == len(edited) + 1
    for number, text in enumerate(edited):
        copy = scene.with_name(f"copy-{number}.yaml")
        copy.write_text(text)
        assert main(["check", str(copy)]) == 0


def test_edits_by_commands_keep_one_backup(scene: Path) -> None:
    for name, to in (("brick-1", "a"), ("a", "b"), ("b", "c"), ("c", "d")):
        assert main(["rename", str(scene), name, to]) == 0
    backup = scene.with_name("scene.yaml~")
    assert [path.name for path in scene.parent.glob("*~*")] == [backup.name]
    assert "c" in yaml.safe_load(backup.read_text())["objects"]


def test_merging_again_keeps_one_backup(tmp_path: Path) -> None:
    picture = np.full((90, 200, 3), 90, np.uint8)
    labels = np.zeros((90, 200), np.uint16)
    for id_ in range(1, 5):
        columns = slice(45 * id_ - 30, 45 * id_ - 8)
        picture[45:70, columns] = (40, 50 * id_, 200)
        labels[45:70, columns] = id_
    cv2.imwrite(str(tmp_path / "photo.png"), picture)
    cv2.imwrite(str(tmp_path / "masks.png"), labels)
    (tmp_path / "home").mkdir()
    scene = tmp_path / "home" / "scene.yaml"
    perceive_label(tmp_path / "photo.png", scene, "brick")
    for other in ("brick-2", "brick-3", "brick-4"):
        assert main(["merge", str(scene), "brick-1", other]) == 0
    backup = scene.with_name("scene.yaml~")
    named = {yaml.safe_load(path.read_text())["assets"] for path in (scene, backup)}
    images = {
        yaml.safe_load(path.read_text())["image"].partition("/")[0]
        for path in (scene, backup)
    }
    assert names(scene.parent) == {scene.name, backup.name, *named, *images}
    assert main(["check", str(scene)]) == 0


def test_perceiving_again_keeps_painted_maps(blocks: Path, scene: Path) -> None:
    masks = scene.parent / "scene.assets" / "masks.png"
    masks.write_bytes(masks.read_bytes() + b"painted")
    painted = masks.read_bytes()
    for label in ("book", "can", "mug"):
        perceive_label(blocks, scene, label)
    assert masks.read_bytes() == painted
    assert main(["clean", str(scene.parent), "--yes"]) == 0
    assert masks.read_bytes() == painted


def test_clean_lists_what_it_removes(
    blocks: Path, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    perceive_label(blocks, scene, "book")
    home = scene.parent
    assets = yaml.safe_load(scene.read_text())["assets"]
    partial = home / f".scene.yaml.{NO_PROCESS}-{machine_id()}.part"
    partial.write_bytes(b"half")
    before = sorted(home.rglob("*"))
    capsys.readouterr()
    assert main(["clean", str(home), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert sorted(home.rglob("*")) == before
    rows = {(Path(row["path"]).name, row["kind"]) for row in listed["unused"]}
    assert rows == {
        ("scene.yaml~", "backup"),
        ("scene.assets", "assets"),
        ("cache", "cache"),
        (partial.name, "partial"),
    }
    assert not listed["removed"]
    assert listed["bytes"] == sum(row["bytes"] for row in listed["unused"])
    assert main(["clean", str(home)]) == 0
    shown = capsys.readouterr()
    assert len(shown.out.splitlines()) == 4
    assert "--yes" in shown.err
    assert main(["clean", str(scene), "--yes"]) == 0
    assert {path.name for path in home.iterdir()} == {"scene.yaml", assets}
    assert main(["check", str(scene)]) == 0
    capsys.readouterr()
    assert main(["clean", str(home), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unused"] == []


def test_clean_spares_all_that_users_made(
    blocks: Path, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = scene.parent
    scene.write_text(f"{scene.read_text()}# mine\n")
    perceive_label(blocks, scene, "book")  # scene.yaml~ is the user's
    other = home / "copy.yaml"
    shutil.copy(scene, other)
    perceive_label(blocks, scene, "can")  # scene-2.assets is that of copy.yaml
    (home / "lost.yaml~").write_bytes(other.read_bytes())  # the last copy of a scene
    (home / "mine.assets").mkdir()
    (home / "mine.assets" / "masks.png").write_bytes(b"drawn")
    shutil.copytree(home / "scene.assets", home / "painted.assets")
    (home / "painted.assets" / "note.txt").write_text("mine")
    (home / ".scene.yaml.editing").mkdir()
    (home / ".scene.yaml.editing" / "draft.json").write_text("{}")
    running = home / f".out.{1}-{machine_id()}.part"
    running.mkdir()
    removed = {home / "scene.yaml~2", *home.rglob("cache"), *home.rglob("cache/*")}
    before = set(home.rglob("*")) - removed
    capsys.readouterr()
    assert main(["clean", str(home), "--yes", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["unused"]
    assert {Path(row["path"]).name for row in rows} == {"scene.yaml~2", "cache"}
    assert set(home.rglob("*")) == before


def test_clean_spares_assets_of_drafts_and_of_scenes_above(
    blocks: Path, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    home = scene.parent
    for draft in (home / ".scene.yaml.editing", home / ".other.yaml.editing"):
        draft.mkdir()
    shutil.copytree(home / "scene.assets", home / "scene-7.assets")
    shutil.copytree(home / "scene.assets", home / "scene-8.assets")
    text = scene.read_text().replace("scene.assets", "scene-7.assets")
    (home / ".scene.yaml.editing" / "draft.json").write_text(json.dumps({"text": text}))
    above = text.replace("scene-7.assets", "home/scene-8.assets")
    (home.parent / "above.yaml").write_text(above)
    capsys.readouterr()
    assert main(["clean", str(home), "--yes", "--json"]) == 0
    unused = json.loads(capsys.readouterr().out)["unused"]
    # caches are always unused, all else is in use
    assert {Path(row["path"]).name for row in unused} <= {"cache"}
    for name in ("scene.assets", "scene-7.assets", "scene-8.assets"):
        assert (home / name / "masks.png").is_file()


def test_clean_removes_the_cache_if_named(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    answers = tmp_path / "cache" / "physgen" / "vlm"
    answers.mkdir(parents=True)
    (answers / "a.json").write_bytes(bytes(500))
    (tmp_path / "home").mkdir()
    for flags, count in (([], 0), (["--cache"], 1)):
        assert main(["clean", str(tmp_path / "home"), "--yes", "--json", *flags]) == 0
        listed = json.loads(capsys.readouterr().out)
        assert [row["bytes"] for row in listed["unused"]] == [500] * count
        assert answers.exists() is not bool(count)


def test_clean_needs_a_path_that_exists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = str(tmp_path / "no.yaml")
    assert main(["clean", missing, "--yes"]) == 2
    assert capsys.readouterr().err.startswith(f"{missing}: ")


@pytest.mark.parametrize("kind", ["copy", "below", "escaped"])
def test_assets_of_other_users_stay(blocks: Path, scene: Path, kind: str) -> None:
    home = scene.parent
    scene = scene.rename(home / "Käse.yaml")
    shutil.rmtree(home / "scene.assets")
    perceive_label(blocks, scene, "brick")
    text = scene.read_text()
    assets = home / yaml.safe_load(text)["assets"]
    if kind == "copy":
        (home / "saved.bak").write_text(text)
    elif kind == "below":
        (home / "sub").mkdir()
        (home / "sub" / "x.yaml").write_text(text.replace("assets: ", "assets: ../"))
    else:
        (home / "x.json").write_text(json.dumps(yaml.safe_load(text)))
    for label in ("book", "can", "mug"):
        perceive_label(blocks, scene, label)
    assert main(["clean", str(home), "--yes"]) == 0
    assert (assets / "masks.png").is_file()


def test_clean_lists_each_path_once(
    blocks: Path, scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    perceive_label(blocks, scene, "book")
    home = scene.parent
    capsys.readouterr()
    paths = [str(home), str(home / ".." / home.name), str(home.resolve())]
    assert main(["clean", *paths, "--json"]) == 0
    listed = [row["path"] for row in json.loads(capsys.readouterr().out)["unused"]]
    assert len({Path(path).resolve() for path in listed}) == len(listed)
    assert main(["clean", *paths, "--yes"]) == 0


def test_clean_of_a_scene_spares_assets_of_other_backups(
    blocks: Path, scene: Path
) -> None:
    other = scene.with_name("other.yaml")
    shutil.copy(scene, other.with_name("other.yaml~"))
    perceive_label(blocks, other, "can")
    for label in ("book", "mug"):
        perceive_label(blocks, scene, label)
    assets = scene.parent / yaml.safe_load(Path(f"{other}~").read_text())["assets"]
    assert main(["clean", str(scene), "--yes"]) == 0
    assert Path(f"{other}~").is_file()
    assert (assets / "masks.png").is_file()
