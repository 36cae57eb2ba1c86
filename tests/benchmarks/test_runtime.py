"""Times of stages from records: medians by hand, nothing invented, and a machine that is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physgen import environment
from physgen.cli.main import main as physgen
from physgen.evaluate.runtime import read_runs


def main(arguments: list[str]) -> int:
    return physgen(["evaluate", "runtime", *arguments])


WALLS = (1.0, 5.0, 2.0)


def clip(folder: Path, wall: float, **more: Any) -> Path:
    folder.mkdir(parents=True)
    stages = {"load": {"wall": 0.5, "cpu": 0.25}, "compile": {"wall": 0.1, "cpu": 0.1},
              "simulate": {"wall": wall, "cpu": wall / 2}, "render": {"wall": 3.0, "cpu": 2.0},
              "refine": {"wall": 9.0, "cpu": 1.0}}  # fmt: skip
    told = {
        "manifest": 1, "samples": [], "scene": "a", "source": "../../scene.yaml",
        "versions": {"physgen": "9"},
        "platform": {"machine": "x", "system": "Y", "processor": "Abacus 3", "cores": 4, "memory_gib": 8.0},
        "device": "cpu", "video": {"size": [64, 48], "fps": 30}, "frames": ["a"] * 16, "document": {"objects": {}},
    }  # fmt: skip
    (folder / "timing.json").write_text(
        json.dumps({"stages": more.pop("stages", stages)})
    )
    (folder / "manifest.json").write_text(json.dumps(told | more))
    return folder


@pytest.fixture
def clips(tmp_path: Path) -> Path:
    for k, wall in enumerate(WALLS):
        clip(tmp_path / "out" / f"clip-{k}", wall)
    return tmp_path / "out"


def told_of(*flags: object, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main([*map(str, flags), "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_medians_and_ranges(clips: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = told_of(clips, capsys=capsys)
    rows = {(row["kind"], row["name"]): row for row in told["rows"]}
    simulate = rows["stage", "simulate"]
    assert (
        simulate["runs"],
        simulate["wall"],
        simulate["wall_least"],
        simulate["wall_most"],
    ) == (3, 2, 1, 5)
    assert simulate["cpu"] == 1
    simulation = rows["part", "simulation"]
    assert (simulation["wall"], simulation["paper"]) == (pytest.approx(2.1), 5)
    assert rows["part", "refinement"]["paper"] == 35
    assert not any("perception" in name for _, name in rows)
    assert told["machines"] == ["Abacus 3, 4 cores, 8 GiB, Y"]


def test_the_papers_time_is_of_the_same_parts(
    clips: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By its table: 5 s of simulation, 60 of rendering, 35 of refinement; nobody perceived."""
    assert main([str(clips)]) == 0
    told = capsys.readouterr().out
    assert "The paper: 100 s for these parts, on an A40." in " ".join(told.split())
    assert next(
        line for line in told.splitlines() if line.startswith("whole runs")
    ).endswith("100 of 180")


def test_parts_leave_no_stage_out(
    clips: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip(
        clips / "odd",
        2.0,
        stages={"simulate": {"wall": 1, "cpu": 1}, "chaos": {"wall": 7, "cpu": 7}},
    )
    rows = told_of(clips / "odd", capsys=capsys)["rows"]
    walls = {
        kind: sum(row["wall"] for row in rows if row["kind"] == kind)
        for kind in ("part", "stage")
    }
    assert walls == {"part": 8, "stage": 8}


def test_machines_are_not_mixed(
    clips: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip(clips / "old", 50.0, platform={"machine": "x", "system": "Y"})
    clip(clips / "gpu", 60.0, device="cuda: H200")
    told = told_of(clips, capsys=capsys)
    assert told["machines"] == [
        "Abacus 3, 4 cores, 8 GiB, Y",
        "Abacus 3, 4 cores, 8 GiB, Y; cuda: H200",
        "not recorded",
    ]
    walls = [row["wall"] for row in told["rows"] if row["name"] == "simulate"]
    assert walls == [2, 60, 50]


def test_what_models_took_comes_from_the_scenes_assets(clips: Path) -> None:
    assets = clips.parent / "scene.assets"
    assets.mkdir()
    steps = [
        {"role": "segment", "backend": "learned", "weights": "w", "seconds": 40.0},
        {"role": "inpaint", "backend": "fill", "weights": "", "seconds": 2.0},
        {"role": "inpaint", "backend": "fill", "weights": "", "seconds": 1.0},
    ]
    (assets / "perceived.json").write_text(json.dumps({"steps": steps}))
    clip(clips / "seen", 2.0, document={"assets": "scene.assets", "objects": {}})
    run = next(run for run in read_runs([clips]) if run.name.endswith("seen"))
    assert run.stages["perceive segment"][0] == 40
    assert run.stages["perceive inpaint"][0] == 3
    assert np.isnan(run.stages["perceive inpaint"][1])
    assert run.models == ("segment=learned",)


def test_manifests_without_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip(tmp_path / "out" / "a", 1.0, stages={"a": {"wall": float("nan"), "cpu": 0}})
    assert main([str(tmp_path / "out")]) == 2
    assert (
        "out/a/manifest.json: has no times of its stages; make the clip again"
        in capsys.readouterr().err
    )
    clip(tmp_path / "out" / "b", 1.0)
    assert main([str(tmp_path / "out")]) == 0
    assert (
        "out/a/manifest.json: warning: has no times of its stages"
        in capsys.readouterr().err
    )


def test_a_manifest_names_the_machine(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "physgen: 1\nsize: [64, 48]\nworld: {duration: 0.1}\n"
        "objects: {a: {shape: {circle: {center: [30, 20], radius: 8}}}}\n"
    )
    assert (
        physgen(["render", str(tmp_path / "a.yaml"), "-o", str(tmp_path / "out")]) == 0
    )
    told = json.loads((tmp_path / "out" / "a" / "manifest.json").read_text())
    assert told["platform"] == environment.this_machine().as_dict()
    assert told["platform"]["cores"] >= 1
    (run,) = read_runs([tmp_path / "out"])
    assert run.machine == str(environment.this_machine())
