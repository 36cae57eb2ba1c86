"""Whose number it is, and how sure: flags, variants, guesses, lines of files, defaults."""

from __future__ import annotations

from pathlib import Path

from physgen import pipeline
from physgen.report.parameters import parameter_rows
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
    (tmp_path / "scene.yaml").write_text(SCENE)
    scene = pipeline.load(tmp_path / "scene.yaml", ["objects.a.spin=90", "objects.*.elasticity=0.1"], "fast")
    world = pipeline.compile(scene, None).world
    a, b, floor = parameter_rows(scene, world, "fast")
    found = {name: cell.source for name, cell in a.cells.items()}
    assert found == {
        "shape": Source("file", "base.yaml, line 4"),
        "mass": Source("guess", "table", 0.4),
        "moment": Source("worked out", "worked out"),
        "friction": Source("file", "line 2"),
        "elasticity": Source("flag", "--set"),
        "rolling": Source("default", "default"),
        "velocity": Source("variant", "variant fast"),
        "spin": Source("flag", "--set"),
    }
    assert (a.cells["mass"].text, a.cells["spin"].text, a.cells["velocity"].text) == ("5", "90", "3, 4")
    assert a.also == "label: clip 0.7"
    assert (b.kind, "mass" in b.cells) == ("static", False)
    assert floor.cells["friction"].source == Source("file", "base.yaml, line 7")
    assert floor.cells["elasticity"].source.kind == "default"


def test_what_from_says() -> None:
    assert source("material table ebony 0.25") == Source("guess", "material table ebony", 0.25)
    assert source("vlm") == Source("guess", "vlm")
    assert source("qwen2.5") == Source("guess", "qwen2.5"), "a version is no confidence"
    assert source("sam-3 1") == Source("guess", "sam-3", 1.0)
