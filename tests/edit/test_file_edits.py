"""Edits of a file at once, and comments: everything that a user wrote stays, in all bundled scenes."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from written import commented

from physgen import pipeline
from physgen.cli.main import main
from physgen.edit.operations import apply_operations
from physgen.edit.session import EditRequest, Session

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*/scene.yaml"))


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.parent.name)
def test_edits_keep_every_comment(path: Path) -> None:
    text, mine = commented(path.read_text())
    first, second = list(yaml.safe_load(text)["objects"])[:2]
    ops = [
        {"rename": ["objects", first], "to": "the-first"},
        {"set": ["objects", second, "layer"], "value": 3},
        {"set": ["objects", "the-first", "mass"], "value": 12.5},
    ]
    after = apply_operations(text, ops).text
    assert [line for line in after.splitlines() if line in mine] == mine
    before, now = text.splitlines(), after.splitlines()
    changed = [line for line in now if line not in before]
    assert len(changed) <= 3 + text.count(first)
    removed = apply_operations(after, [{"remove": ["objects", second]}]).text
    gone = set(mine) - {line for line in removed.splitlines() if line in mine}
    lines = after.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"  {second}:"))
    names = ("  ", "   ")
    stop = next(
        k
        for k, line in enumerate(lines[start + 1 :], start + 1)
        if line and not line.startswith(names[1])
    )
    inside = [line for line in lines[start - 1 : stop] if line in mine]
    assert set(inside) <= gone, "comments of the object go with it"
    if f"object: {second}" not in text and f"[{second}" not in text:
        assert gone == set(inside), "and no others"
    assert second not in yaml.safe_load(removed)["objects"]


def test_commands_edit_the_file(
    tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without what the editor in the browser needs, and with the file as it was before beside it."""
    for module in ("fastapi", "filelock", "uvicorn"):
        monkeypatch.setitem(sys.modules, module, None)
    scene = tmp_path / "dominoes" / "scene.yaml"
    shutil.copytree(SCENES[5].parent, scene.parent)
    first, second, third = list(yaml.safe_load(scene.read_text())["objects"])[:3]
    before = scene.read_bytes()
    assert main(["rename", str(scene), first, "start"]) == 0
    assert scene.with_name("scene.yaml~").read_bytes() == before
    assert f"renamed {first} to start; backup: scene.yaml~" in capsys.readouterr().err
    assert main(["remove", str(scene), third]) == 0
    assert main(["merge", str(scene), "start", second]) == 0
    names = [item.name for item in pipeline.load(scene).objects]
    assert "start" in names
    assert not {first, second, third} & set(names)
    capsys.readouterr()
    assert main(["remove", str(scene), "strat"]) == 2
    assert 'did you mean "start"?' in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("gap", [10, 90])
def test_a_merge_of_objects_far_apart_says_how_far(
    gap: int, tmp_path: Path, capsys
) -> None:
    labels = np.zeros((100, 200), np.uint8)
    labels[40:80, 20:50], labels[40:80, 50 + gap : 80 + gap] = 1, 2
    for name, picture in (("photo", labels * 60 + 40), ("masks", labels)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), cv2.merge([picture] * 3))
    scene = tmp_path / "scene.yaml"
    command = [
        "perceive",
        str(tmp_path / "photo.png"),
        "--masks",
        str(tmp_path / "masks.png"),
        "-o",
        str(scene),
    ]
    assert main([*command, "--label", "*=block", "--still"]) == 0
    capsys.readouterr()
    assert (
        main(
            ["merge", str(scene), *(item.name for item in pipeline.load(scene).objects)]
        )
        == 0
    )
    said = capsys.readouterr().err
    assert (f", {gap} px away: one rigid body now" in said) is (gap > 10)
    (whole,) = pipeline.compile(
        pipeline.load(scene), pipeline.percepts(pipeline.load(scene))
    ).world.bodies
    assert f" ({whole.mass:,.4g} g); backup: scene.yaml~" in said
    text = scene.read_text()
    assert "objects:  # 1 x block, from the masks given" in text
    assert re.search(r"\n    mask: \d+\n", text), "no comment on the mask that was"


@pytest.mark.slow
def test_brush_removes_comment_of_mask_alone(tmp_path: Path) -> None:
    labels = np.zeros((100, 200), np.uint8)
    labels[40:80, 20:50], labels[40:80, 100:130] = 1, 2
    for name, picture in (("photo", labels * 60 + 40), ("masks", labels)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), cv2.merge([picture] * 3))
    scene = tmp_path / "scene.yaml"
    masks = ["--masks", str(tmp_path / "masks.png"), "--label", "*=block", "--still"]
    photo = str(tmp_path / "photo.png")
    assert main(["perceive", photo, *masks, "-o", str(scene)]) == 0
    text = scene.read_text().replace("    mask: 1", "    # mine\n    mask: 1")
    text = text.replace("    mask: 2", "    # mine, too\n    mask: 2")
    scene.write_text(text)
    before = re.findall(r"mask: \d+  # (.*)", text)
    assert len(before) == 2
    session = Session(scene)
    stroke = {"kind": "brush", "object": "block-1", "radius": 6}
    stroke["strokes"] = [[50, 60], [58, 60]]
    session.correct(EditRequest(version=session.history.version), stroke)
    after = session.current_state.text
    assert re.findall(r"mask: \d+  # (.*)", after) == before[1:]
    assert "    # mine\n    mask: 1\n" in after
    assert "    # mine, too\n" in after
    counts = re.findall(r"objects:  # (.*)", text)
    assert re.findall(r"objects:  # (.*)", after) == counts


def test_a_merge_leaves_doubtful_regions_in_the_label_map(tmp_path: Path) -> None:
    labels = np.zeros((120, 160), np.uint8)
    labels[60:100, 20:50], labels[60:100, 50:80], labels[70:100, 110:140] = 1, 2, 3
    (tmp_path / "maps").mkdir()
    pictures = {
        "masks": labels,
        "coverage": np.where(np.isin(labels, (1, 2)), 255, 0).astype(np.uint8),
    }
    for name, picture in pictures.items():
        cv2.imwrite(str(tmp_path / "maps" / f"{name}.png"), picture)
    photo = cv2.merge([labels * 60 + 40] * 3)
    for name in ("photo.png", "maps/background.png"):
        cv2.imwrite(str(tmp_path / name), photo)
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "physgen: 1\nimage: photo.png\nassets: maps\nobjects:\n  a: {mask: 1, mass: 0.1 kg}\n  b: {mask: 2, mass: 20}\n"
        "doubtful:\n  maybe-1: {mask: 3, confidence: 0.2}\n"
    )
    assert main(["merge", str(scene), "a", "b"]) == 0
    assert {item.name: item.mass for item in pipeline.load(scene).objects} == {"a": 120}
    after = cv2.imread(
        str(pipeline.load(scene).assets / "masks.png"), cv2.IMREAD_UNCHANGED
    )
    assert np.array_equal(after == 3, labels == 3)
    assert np.array_equal(after == 1, np.isin(labels, (1, 2)))


def test_merge_takes_names_and_doubtful_regions(tmp_path: Path, capsys) -> None:
    """A mug, its rim, its handle that is doubtful, and another doubtful region."""
    labels = np.zeros((120, 200), np.uint8)
    labels[60:100, 20:50], labels[50:60, 20:50], labels[70:90, 50:60] = 1, 2, 3
    labels[70:100, 110:140] = 4
    (tmp_path / "maps").mkdir()
    coverage = np.where(np.isin(labels, (1, 2)), 255, 0).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "maps" / "masks.png"), labels)
    cv2.imwrite(str(tmp_path / "maps" / "coverage.png"), coverage)
    photo = cv2.merge([labels * 50 + 40] * 3)
    for name in ("photo.png", "maps/background.png"):
        cv2.imwrite(str(tmp_path / name), photo)
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        "physgen: 1\nimage: photo.png\nassets: maps\nobjects:\n"
        "  mug: {mask: 1, mass: 100}\n  rim: {mask: 2, mass: 20}\ndoubtful:\n"
        "  maybe-1: {mask: 3, confidence: 0.3}\n  maybe-2: {mask: 4, confidence: 0.2}\n"
    )
    before = scene.read_bytes()
    assert main(["merge", str(scene), "maybe-1", "mug"]) == 2
    assert "mug maybe-1" in capsys.readouterr().err
    assert main(["merge", str(scene), "mug", "mug"]) == 2
    assert scene.read_bytes() == before
    assert main(["merge", str(scene), "mug", "rim", "maybe-1"]) == 0
    after = pipeline.load(scene)
    assert {item.name: item.mass for item in after.objects} == {"mug": 120}
    assert set(after.document["doubtful"]) == {"maybe-2"}
    masks = cv2.imread(str(after.assets / "masks.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(masks == 1, np.isin(labels, (1, 2, 3)))
    assert np.array_equal(masks == 4, labels == 4)
