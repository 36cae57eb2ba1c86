"""Whose number it is, and how sure: flags, variants, guesses, lines of files, defaults."""

from __future__ import annotations

from pathlib import Path

from written import loaded

from physgen import pipeline
from physgen.report.parameters import merge_equal_rows, parameter_rows
from physgen.scene.provenance import Source, source

BASE = """\
physgen: 1
size: [100, 80]
objects:
  a: {shape: {circle: {center: [30, 20], radius: 8}}, mass: 5, from: {mass: table 0.4, label: clip 0.7}}
  b: {shape: {box: {center: [60, 20], size: [8, 8]}}, motion: static}
boundaries:
  floor: {segment: [[0, 70], [99, 70]], friction: 0.3}
"""
SCENE = """\
extends: base.yaml
objects: {a: {friction: 0.2}}
variants: {fast: {objects.a.velocity: [3, 4]}}
"""


def test_each_number_has_its_source(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(BASE)
    scene = loaded(
        tmp_path, SCENE, "objects.a.spin=90", "objects.*.elasticity=0.1", variant="fast"
    )
    world = pipeline.compile(scene, None).world
    a, b, floor = parameter_rows(scene, world, "fast")
    found = {name: cell.source for name, cell in a.cells.items()}
    assert found == {
        "shape": Source("file", "base.yaml, line 4"),
        "mass": Source("guess", "table", 0.4),
        "moment": Source("computed", "computed"),
        "friction": Source("file", "line 2"),
        "elasticity": Source("flag", "--set"),
        "rolling": Source("default", "default"),
        "velocity": Source("variant", "variant fast"),
        "spin": Source("flag", "--set"),
    }
    assert (a.cells["mass"].text, a.cells["spin"].text, a.cells["velocity"].text) == (
        "5",
        "90",
        "(3, 4)",
    )
    assert a.other_sources == "label: clip 0.7"
    assert (b.kind, "mass" in b.cells) == ("static", False)
    assert floor.cells["friction"].source == Source("file", "base.yaml, line 7")
    assert floor.cells["elasticity"].source.kind == "default"


def test_what_from_says() -> None:
    assert source("material table ebony 0.25") == Source(
        "guess", "material table ebony", 0.25
    )
    assert source("vlm") == Source("guess", "vlm")
    assert source("qwen2.5") == Source("guess", "qwen2.5"), "a version is no confidence"
    assert source("sam-3 1") == Source("guess", "sam-3", 1.0)


def test_objects_with_equal_rows_share_one(tmp_path: Path) -> None:
    lines = [
        f"  ball-{k}: {{shape: {{circle: {{center: [{9 * k}, 9], radius: 4}}}}, mass: 5}}"
        for k in (1, 2, 3, 5)
    ]
    other = "  ball-4: {shape: {circle: {center: [36, 9], radius: 4}}, mass: 6}"
    scene = loaded(
        tmp_path, "\n".join(["physgen: 1", "size: [60, 20]", "objects:", *lines, other])
    )
    alike, apart = merge_equal_rows(
        parameter_rows(scene, pipeline.compile(scene, None).world, None)
    )
    assert (alike.name, apart.name) == ("ball-1 to ball-3, ball-5", "ball-4")
    assert alike.cells["mass"].source == Source("file", "lines 4 to 7")
    assert alike.cells["spin"].source == Source("default", "default")
