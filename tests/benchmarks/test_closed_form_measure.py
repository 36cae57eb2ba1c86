"""`physgen evaluate physics` as a person runs it; its JSON, page and scenes as they are committed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.evaluate import physics
from physgen.evaluate.measure import text
from physgen.evaluate.physics import ROWS, examples
from physgen.evaluate.physics.scorecard import (
    Case,
    Measure,
    Row,
    choose,
    evaluate,
    findings,
    record,
    run_draw,
    scene_file,
    write_scenes,
)

ROOT = Path(__file__).resolve().parents[2]
QUICK = ["--rows", "1,6", "--draws", "1", "--no-convergence", "--jobs", "1"]


def main(arguments: list[str]) -> int:
    return physgen(["evaluate", "physics", *arguments])


def test_table_on_stdout_and_nothing_on_stderr(capsys) -> None:
    assert main(QUICK) == 0
    said = capsys.readouterr()
    assert said.err == ""
    lines = said.out.splitlines()
    assert lines[2] == "2 of 2 rows pass."
    assert lines[6].split() == [
        "row",
        "closed",
        "form",
        "bar",
        "worst",
        "error",
        "verdict",
    ]
    assert lines[8].split()[:3] == ["1", "free", "fall"]
    assert "switch: as stated" in said.out


def test_json(capsys) -> None:
    assert main(["--rows", "5", "--draws", "1", "--jobs", "1", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["passed"] is True
    [row] = result["rows"]
    assert (row["row"], row["name"], row["passed"], row["problems"]) == (
        5,
        "slide",
        True,
        [],
    )
    assert row["scenes"] == ["05-slide.yaml"]
    [measure] = row["measures"]
    assert measure["bar"] == 0.003
    assert 0 <= measure["error"] <= measure["bar"]
    assert list(measure["convergence"]) == ["240", "480", "960", "1920"]
    assert measure["convergence"]["240"] > measure["convergence"]["1920"]
    assert measure["worst"] == "draw 1"


def test_a_missed_bar_exits_1(monkeypatch, capsys) -> None:
    fall = replace(ROWS[0], measures=(Measure("fall", -1.0),))
    monkeypatch.setattr(physics, "ROWS", (fall,))
    assert main(["--draws", "1", "--no-convergence", "--jobs", "1"]) == 1
    printed = capsys.readouterr().out
    assert "FAIL" in printed
    assert "0 of 1 rows pass." in printed


def test_scenes_are_kept_and_can_be_rendered(tmp_path: Path, capsys) -> None:
    folder = tmp_path / "kept"
    assert (
        main(["--rows", "39", "--draws", "2", *QUICK[-3:], "--scenes", str(folder)])
        == 0
    )
    assert sorted(p.name for p in folder.iterdir()) == [
        "39-falling-over-draw-2.yaml",
        "39-falling-over.yaml",
    ]
    text = (folder / "39-falling-over.yaml").read_text()
    assert text.startswith("# Row 39 of the physics scorecard: plank falling over")
    assert "# w² = 2 g (y0 - y)/(I/m + (dy/da)²)" in text
    assert "# bar: spin 0.3 %" in text
    capsys.readouterr()
    out = tmp_path / "out"
    scene = str(folder / "39-falling-over.yaml")
    assert (
        physgen(
            [
                "render",
                scene,
                "-o",
                str(out),
                "--set",
                "render.frames=3",
                "--format",
                "png",
            ]
        )
        == 0
    )
    assert len(list((out / "39-falling-over" / "frames").iterdir())) == 3


@pytest.mark.slow
def test_results_do_not_depend_on_jobs() -> None:
    rows = choose(ROWS, [1, 3, 13])
    one, two = (evaluate(rows, 2, (240, 960), workers=workers) for workers in (1, 2))
    assert one == two


def test_a_scene_that_cannot_be_run_misses_its_bar(tmp_path: Path) -> None:
    def cases(draw) -> list[Case]:
        return [
            Case(
                {"physgen": 1, "size": [10, 10], "objects": {"a": {"mass": -1}}},
                lambda run: {"x": 0.0},
            )
        ]

    row = Row(99, "broken", "broken", "", "", "", (Measure("x", 1.0),), cases)
    write_scenes(row, 0, tmp_path)
    found = record(row, 1, (), {(0, None): run_draw(row, 0, tmp_path)})
    assert found["passed"] is False
    assert found["measures"][0]["error"] is None
    assert any(
        "99-broken.yaml:" in problem and "mass" in problem
        for problem in found["problems"]
    )
    assert str(tmp_path) not in json.dumps(found)
    shown = text(findings([found]))
    assert "FAIL" in shown
    assert "row 99: 99-broken.yaml" in shown


def test_what_is_no_number_misses_its_bar(tmp_path: Path) -> None:
    fall = ROWS[0]
    case = replace(fall.draw(0)[0], measure=lambda run: {"fall": float("nan")})
    row = replace(fall, cases=lambda draw: [case])
    write_scenes(row, 0, tmp_path)
    result = record(row, 1, (), {(0, None): run_draw(row, 0, tmp_path)})
    assert not result["passed"]
    json.dumps(result, allow_nan=False)


# ---- what is committed -------------------------------------------------------------------------------------------


def test_json_is_of_these_rows() -> None:
    """Figures are of the day they were measured; what they are figures of is as the rows say now."""
    stored = json.loads((ROOT / "benchmarks" / "results" / "physics.json").read_text())[
        "rows"
    ]
    assert len(stored) == len(ROWS)
    for row, kept in zip(ROWS, stored, strict=True):
        now = {
            "row": row.number, "name": row.name, "title": row.title, "closed_form": row.closed_form,
            "draws": row.ranges, "why": row.reason, "scenes": [scene_file(row, case, 0) for case in row.draw(0)],
        }  # fmt: skip
        assert {key: kept[key] for key in now} == now
        bars = [(m.name, m.bar, m.unit.value) for m in row.measures]
        assert [(m["name"], m["bar"], m["unit"]) for m in kept["measures"]] == bars
        assert kept["passed"], row.name


def test_scenes_are_what_the_rows_draw_first() -> None:
    folder = ROOT / "scenes" / "physics"
    assert {p.name: p.read_text() for p in folder.glob("*.yaml")} == dict(examples())


@pytest.mark.parametrize("name", [name for name, _ in examples()])
def test_scenes_show_what_happens(name: str) -> None:
    """Things begin on the canvas, none is a dot on it, and some second of them is seen."""
    scene = pipeline.load(ROOT / "scenes" / "physics" / name)
    world = pipeline.compile(scene, None).world
    width, height = scene.size
    assert max(width, height) <= 1000
    assert len(world.times) >= 48
    for body in world.bodies:
        assert 0 <= body.center[0] <= width, body.name
        assert 0 <= body.center[1] <= height, body.name
        assert body.reach >= 3, body.name
    end = pipeline.simulate(world).poses[-1, :, :2]
    seen = ((end > -20) & (end < np.array([width, height]) + 20)).all(axis=1)
    assert seen.mean() >= 0.5
