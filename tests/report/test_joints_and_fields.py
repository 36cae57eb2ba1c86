"""Joints, fields and walls in the report's picture and tables."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from written import loaded

from physgen import pipeline
from physgen.report.page import PageParts, report_page
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


def test_the_page_shows_them(tmp_path: Path) -> None:
    scene = loaded(tmp_path, SCENE)
    world, photo = (
        pipeline.compile(scene, None).world,
        np.zeros((150, 200, 3), np.uint8),
    )
    page = report_page(
        scene, world, RunRecord("scene", ["physgen"]), photo, None, SCENE, PageParts()
    )
    assert (
        len(re.findall(r'<polyline class="wall" points="[^"]+"><title>frame', page))
        == 1
    )
    assert "<h2>Joints and fields</h2>" in page
    assert "<td><b>tow</b></td><td>spring</td><td>bob and car</td>" in page
