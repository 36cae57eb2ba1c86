"""What the page, the manifest and the table of a fan tell: of a ball that may roll over an edge."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest
from browser import opened

from physgen import pipeline
from physgen.problems import Severity
from physgen.simulate.uncertainty import simulate_ensemble

EDGE = """\
physgen: 1
size: [160, 120]
world: {duration: 0.9}
objects:
  ball: {label: ball, shape: {circle: {center: [50, 50], radius: 10}}, mass: 40, solid: sphere, velocity: [130, 0],
    friction: 0.8, rolling: 0.12, from: {rolling: table 0.4, mass: table 0.5}}
  block: {shape: {box: {center: [20, 50], size: [16, 20]}}, mass: 30, from: {friction: by eye 0.5}}
boundaries:
  table: {segment: [[0, 60], [100, 60]], friction: 0.8}
  floor: {segment: [[0, 118], [159, 118]]}
light: {direction: [0.2, -0.7, 0.6], from: shadows 0.6}
render: {frames: 4}
"""
DRAWS = 6


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("fan")
    (home / "edge.yaml").write_text(EDGE)
    return pipeline.render_scene(
        home / "edge.yaml", home / "out", draws=DRAWS, draw_seed=5
    )


def test_manifest_and_table_tell_the_same(clip: Path) -> None:
    told = json.loads((clip / "manifest.json").read_text())
    assert told["seeds"]["fan"] == 5
    assert "fan.csv" in told["files"]
    made = told["fan"]
    rows = list(csv.DictReader((clip / "fan.csv").open()))
    assert [int(row["draw"]) for row in rows] == list(range(DRAWS))
    falls = [row["ball.fate"] == "falls" for row in rows]
    assert 0 < sum(falls) < DRAWS
    assert made["objects"]["ball"]["draws"] == {
        "falls": sum(falls),
        "moves": DRAWS - sum(falls),
    }
    assert made["objects"]["block"]["decided"]
    assert f"falls in {sum(falls)} of {DRAWS}" in made["objects"]["ball"]["verdict"]
    rolling = [float(row["objects.ball.rolling"]) for row in rows]
    assert max(r for r, fell in zip(rolling, falls, strict=True) if fell) < min(
        r for r, fell in zip(rolling, falls, strict=True) if not fell
    ), "and nothing else matters"
    heading = (clip / "fan.csv").read_text().partition("\n")[0].split(",")
    assert heading == ["draw", *(one["path"] for one in made["drawn"]), *heading[4:]]
    told = (Path(__file__).parents[2] / "docs" / "rendering.md").read_text()
    assert all(f"NAME.{name.partition('.')[2]}`" in told for name in heading[4:])
    turned = [float(row["ball.angle_degrees"]) for row in rows]
    assert max(turned) > 90, "it rolls"
    assert {one["path"] for one in made["drawn"]} == {
        "objects.ball.rolling",
        "objects.ball.mass",
        "objects.block.friction",
    }


def test_the_python_way_gives_the_same_draws(clip: Path) -> None:
    """And so does any other run of that seed; the clip itself is the file's own."""
    scene = pipeline.load(clip.parent.parent / "edge.yaml")
    compiled = pipeline.compile(scene, None)
    again = simulate_ensemble(scene, compiled, DRAWS, 5)
    assert again.table() == (clip / "fan.csv").read_text()
    plain = pipeline.render_scene(
        clip.parent.parent / "edge.yaml", clip.parent.parent / "plain"
    )
    both = [
        json.loads((folder / "manifest.json").read_text()) for folder in (clip, plain)
    ]
    assert both[0]["frames"] == both[1]["frames"]
    assert both[0]["samples"] == both[1]["samples"]
    assert both[1]["fan"] is None
    assert "fan" not in both[1]["seeds"]


def test_the_page_shows_every_draw(browser: Any, clip: Path) -> None:
    made = json.loads((clip / "manifest.json").read_text())["fan"]
    with opened(
        browser, clip / "report.html", ready=False, java_script_enabled=False
    ) as seen:
        section = seen.page.locator("#fan")
        assert made["verdict"] in section.inner_text()
        counts = made["objects"]["ball"]["draws"]
        for fate, count in counts.items():
            assert section.locator(f".ways path.{fate}").count() == count
        assert section.locator(".own path").count() == 1, "of what moves in the clip"
        assert "block" in section.locator("table").inner_text()
        assert seen.errors == []


def test_with_nothing_uncertain_there_is_a_warning_and_a_clip(tmp_path: Path) -> None:
    (tmp_path / "sure.yaml").write_text(
        re.sub(r",\s+from: ({[^}]*}|shadows 0.6)", "", EDGE)
    )
    heard = []
    folder = pipeline.render_scene(
        tmp_path / "sure.yaml", tmp_path / "out", draws=5, warn=heard.append
    )
    (told,) = [problem for problem in heard if problem.path == "--fan"]
    assert told.severity is Severity.WARNING
    assert "nothing in the scene is uncertain" in str(told)
    assert json.loads((folder / "manifest.json").read_text())["fan"] is None
    assert not (folder / "fan.csv").exists()
    assert 'id="fan"' not in (folder / "report.html").read_text()
