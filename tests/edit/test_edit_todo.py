"""What a person is asked to look at: every row is true, and what it offers settles it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from physgen.edit.live import Live
from physgen.edit.operations import apply_operations

SCENE = """\
physgen: 1
image: photo.png
objects:
  ball:
    shape: {circle: {center: [40, 40], radius: 20}}
    mass: 20
    friction: 0.5
    elasticity: 0.4
    from: {mass: table 0.4, friction: table 0.35, elasticity: vlm 0.9}
  crate:
    shape: {box: {center: [120, 70], size: [30, 30]}}
    rolling: 0.1
    mass: 30
    from: {mass: table 0.2}
boundaries:
  floor: {segment: [[0, 100], [200, 100]], from: lines 0.5}
forces:
  - {object: ball, force: [1, 0], start: 9}
variants:
  heavy: {objects.ball.mass: 90}
"""


def photographed(folder: Path, text: str = SCENE) -> tuple[Live, str]:
    picture = np.full((120, 200, 3), 180, np.uint8)
    picture[20:51, 150:191] = (30, 60, 160)
    cv2.imwrite(str(folder / "photo.png"), picture)
    (folder / "scene.yaml").write_text(text)
    return Live(folder / "scene.yaml"), text


def test_doubts_come_first_the_least_sure_of_all_at_the_top(tmp_path: Path) -> None:
    """Below 0.6 alone; what an object hides already, and what a person set in a variant, is no doubt."""
    live, text = photographed(tmp_path)
    rows = live.look(text).todo
    told = [(row["kind"], row["object"], row["path"], row["line"]) for row in rows]
    assert told[:3] == [
        ("doubt", "crate", "objects.crate.mass", 13),
        ("doubt", "ball", "objects.ball.friction", 7),
        ("doubt", None, "boundaries.floor", 16),
    ]
    assert {row["kind"] for row in rows[3:]} == {"lint"}
    assert "friction (table, 35%); mass (table, 40%)" in rows[1]["text"]
    assert "elasticity" not in rows[1]["text"]
    assert rows[2]["text"] == "floor (lines, 50%)"


def test_what_a_row_offers_settles_it(tmp_path: Path) -> None:
    """Its operations are made, one row after the other, and it does not come again."""
    live, text = photographed(tmp_path)
    offered = 0
    while True:
        rows = [row for row in live.look(text).todo if row["ops"]]
        if not rows:
            break
        made = apply_operations(text, rows[0]["ops"]).text
        left = live.look(made)
        assert left.scene is not None
        assert key(rows[0]) not in {key(row) for row in left.todo}
        text, offered = made, offered + 1
    assert offered == 3
    data = yaml.safe_load(text)
    assert "from" not in data["objects"]["crate"]
    assert data["objects"]["ball"]["from"] == {"elasticity": "vlm 0.9"}
    assert data["objects"]["ball"]["mass"] == 20


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    return row["kind"], row["path"], row["text"]


def test_errors_come_before_all_else(tmp_path: Path) -> None:
    live, text = photographed(tmp_path)
    rows = live.look(text.replace("mass: 30", "mass: heavy")).todo
    assert [(row["kind"], row["object"], row["line"]) for row in rows] == [
        ("error", "crate", 13)
    ]
    assert live.look(text, variant="heavy").todo[0]["kind"] == "doubt"


def test_doubtful_regions_come_with_outlines(tmp_path: Path) -> None:
    text = SCENE.replace("image: photo.png\n", "image: photo.png\nassets: maps\n")
    text += "doubtful: {maybe-1: {mask: 5, confidence: 0.3}, maybe-2: {mask: 6}}\n"
    labels = np.zeros((120, 200), np.uint16)
    labels[20:51, 150:191] = 5
    (tmp_path / "maps").mkdir()
    cv2.imwrite(str(tmp_path / "maps/masks.png"), labels)
    live, text = photographed(tmp_path, text)
    look = live.look(text)
    (region,) = look.doubtful  # the other one has no pixels
    assert region["name"] == "maybe-1"
    corners = {tuple(point) for ring in region["rings"] for point in ring}
    assert corners == {(150, 20), (190, 20), (190, 50), (150, 50)}
    rows = [row for row in look.todo if row["path"] == "doubtful.maybe-1"]
    assert [row["kind"] for row in rows] == ["doubt"]
    assert look.perception is None


def test_verdict_and_summary_come_from_the_record(tmp_path: Path) -> None:
    text = SCENE.replace("image: photo.png\n", "image: photo.png\nassets: maps\n")
    (tmp_path / "maps").mkdir()
    record = {
        "suitability": {"verdict": "doubtful", "reasons": ["few sure objects"]},
        "summary": ["2 objects", "  view      side"],
    }
    (tmp_path / "maps/perceived.json").write_text(json.dumps(record))
    live, text = photographed(tmp_path, text)
    assert live.look(text).perception == {
        "verdict": "doubtful: few sure objects",
        "summary": ["2 objects", "  view      side"],
    }
