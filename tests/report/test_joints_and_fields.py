"""Joints, fields and walls in the report's picture and tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from pytest import approx

from physgen import pipeline
from physgen.report.page import PageParts, report_page
from physgen.report.parameters import constraint_drawing, constraint_rows
from physgen.report.record import RunRecord

SCENE = """\
physgen: 1
size: [200, 150]
objects:
  bob: {shape: {circle: {center: [50, 60], radius: 10}}}
  car: {shape: {box: {center: [120, 60], size: [20, 20]}}}
boundaries:
  frame: {mask: {polygon: [[10, 100], [190, 100], [190, 140], [10, 140]]}}
joints:
  hinge: {objects: [bob], pivot: [50, 20]}
  tow: {objects: [bob, car], spring: [[50, 60], [110, 60]], stiffness: 4.0e4, damping: 200}
  drive: {objects: [bob, car], motor: [90, 60], speed: 360, limit: 2.0e9, collide: true}
fields:
  breeze: {wind: [300, 0], drag: 2.0e-3, objects: [bob]}
  calm: {wind: [0, 0], drag: 1}
  magnet: {attractor: [180, 20], strength: -4.0e7, soften: 5}
"""


def scene_and_world(tmp_path: Path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    scene = pipeline.load(tmp_path / "scene.yaml")
    return scene, pipeline.compile(scene, None).world


def test_what_is_listed(tmp_path: Path) -> None:
    scene, _ = scene_and_world(tmp_path)
    rows = {row["name"]: [row[key] for key in ("kind", "on", "at", "how")] for row in constraint_rows(scene)}
    assert rows == {
        "drive": [
            "motor",
            "bob and car",
            "90, 60",
            "360 °/s, at most 2e+09 g·px²/s², the two bump into each other",
        ],
        "hinge": ["pivot", "bob and the world", "50, 20", ""],
        "tow": ["spring", "bob and car", "50, 60 to 110, 60", "40000 g/s², damping 200 g/s, length 60 px"],
        "breeze": ["wind", "bob", "everywhere", "300, 0 px/s, drag 0.002 g/px²"],
        "calm": ["wind", "every dynamic object", "everywhere", "0, 0 px/s, drag 1 g/px²"],
        "magnet": ["attractor", "every dynamic object", "180, 20", "-4e+07 px³/s², softened over 5 px"],
    }


def test_what_is_drawn(tmp_path: Path) -> None:
    scene, world = scene_and_world(tmp_path)
    shapes = constraint_drawing(scene, world)
    lines = [(line["kind"], line["x1"], line["y1"], line["x2"], line["y2"]) for line in shapes["lines"]]
    assert lines == [
        ("rod", 90, 60, 50, 60),
        ("rod", 90, 60, 120, 60),
        ("rod", 50, 20, 50, 60),
        ("spring", 50, 60, 110, 60),
    ]
    dots = [(dot["kind"], dot["x"], dot["y"]) for dot in shapes["dots"]]
    assert dots[:2] == [("pin", 90, 60), ("pin", 50, 20)]
    assert dots[-1] == ("attractor", 180, 20)
    blowing, still = shapes["arrows"]
    assert blowing["x2"] - blowing["x1"] == approx(0.1 * np.hypot(200, 150), abs=0.11)
    assert blowing["y1"] == blowing["y2"]
    assert (still["x1"], still["y1"]) == (still["x2"], still["y2"])


def test_the_page_shows_them(tmp_path: Path) -> None:
    scene, world = scene_and_world(tmp_path)
    page = report_page(
        scene,
        world,
        RunRecord("scene", ["physgen"]),
        np.zeros((150, 200, 3), np.uint8),
        None,
        SCENE,
        PageParts(),
    )
    assert page.count('<line class="joint ') == 4
    assert page.count('<circle class="joint ') == 5
    assert page.count('<line class="arrow wind"') == 2
    assert len(re.findall(r'<polyline class="wall" points="[^"]+"><title>frame', page)) == 1
    assert "<h2>Joints and fields</h2>" in page
    assert "<td><b>tow</b></td><td>spring</td><td>bob and car</td>" in page
    plain = SCENE[: SCENE.index("joints:")]
    (tmp_path / "scene.yaml").write_text(plain)
    scene = pipeline.load(tmp_path / "scene.yaml")
    world = pipeline.compile(scene, None).world
    page = report_page(
        scene,
        world,
        RunRecord("scene", ["physgen"]),
        np.zeros((150, 200, 3), np.uint8),
        None,
        plain,
        PageParts(),
    )
    assert "Joints and fields" not in page
    assert "tip-wind" not in page
