"""Whole outlines of the assets: for drawing alone, and only while the mask is the same."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen.cli.main import main
from physgen.compile.compile import compile_shapes
from physgen.compile.shapes import mask_crc, shapes_of
from physgen.compile.world import world_as_drawn
from physgen.geometry.polygon import Disc
from physgen.scene.load import load


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene of a ball that another object hides in part."""
    labels = np.zeros((120, 200), np.uint8)
    cv2.circle(labels, (80, 60), 30, 1, -1)
    labels[40:100, 95:140] = 2
    assets = tmp_path / "maps"
    assets.mkdir()
    photo = cv2.merge([labels * 60 + 40] * 3)
    cv2.imwrite(str(assets / "masks.png"), labels)
    cv2.imwrite(str(assets / "background.png"), photo)
    cv2.imwrite(str(tmp_path / "photo.png"), photo)
    outlines = {
        "1": {
            "crc": mask_crc(labels.astype(np.uint16), 1),
            "shape": {"circle": {"center": [80, 60], "radius": 14}},
            "solid": "sphere",
            "whole": {"circle": {"center": [80, 60], "radius": 30}},
        }
    }
    (assets / "outlines.json").write_text(json.dumps(outlines))
    (tmp_path / "scene.yaml").write_text(
        "physgen: 1\nimage: photo.png\nassets: maps\nworld: {view: top}\nobjects:\n"
        "  ball: {label: apple, mask: 1}\n  box: {mask: 2}\n"
    )
    return tmp_path


def test_a_whole_outline_is_drawn_and_does_not_collide(folder: Path) -> None:
    labels = cv2.imread(str(folder / "maps/masks.png"), -1).astype(np.uint16)
    scene = load(folder / "scene.yaml")
    shapes = shapes_of(scene, labels)
    assert isinstance(shapes.outlines[0], Disc)
    assert shapes.outlines[0].radius == 14
    assert isinstance(shapes.drawn[0], Disc)
    assert shapes.drawn[0].radius == 30
    world = compile_shapes(scene, shapes).world
    assert world.bodies[0].radius == 14
    assert world_as_drawn(world, shapes.drawn).bodies[0].radius == 30


def test_a_painted_mask_has_no_stored_whole(folder: Path) -> None:
    labels = cv2.imread(str(folder / "maps/masks.png"), -1).astype(np.uint16)
    labels[20:30, 60:70] = 1
    shapes = shapes_of(load(folder / "scene.yaml"), labels)
    assert shapes.wholes == ()


def test_a_wrong_whole_outline_is_answered(folder: Path, capsys) -> None:
    file = folder / "maps" / "outlines.json"
    file.write_text(file.read_text().replace('"radius": 30', '"radius": "wide"'))
    assert main(["check", str(folder / "scene.yaml")]) == 2
    told = capsys.readouterr().err
    assert "outlines.json" in told
    assert "wide" in told
