"""Boundaries that are masks: lines along their outlines, that meet what rests on them, and stay in the picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
import written
from pytest import approx
from shapely.affinity import translate

from physgen import pipeline
from physgen.compile.warnings import depth_across
from physgen.geometry.convex import outline_shape
from physgen.geometry.polygon import polygon_moments

HEIGHT, WIDTH = 150, 200


def disc(x: float, y: float, r: float):
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.hypot(columns - x, rows - y) <= r


def photo(tmp_path: Path, labels: np.ndarray) -> None:
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((HEIGHT, WIDTH, 3), 100, np.uint8))
    (tmp_path / "maps").mkdir(exist_ok=True)
    cv2.imwrite(str(tmp_path / "maps" / "masks.png"), labels.astype(np.uint16))


def compiled(tmp_path: Path, body: str, head: str = "image: photo.png\nassets: maps"):
    return written.compiled(tmp_path, f"physgen: 1\n{head}\n{body}")


def area(chain: np.ndarray) -> float:
    return polygon_moments(chain[:-1]).area


def test_closed_chains_along_a_mask_and_its_holes(tmp_path: Path) -> None:
    labels = np.zeros((HEIGHT, WIDTH), int)
    labels[20:60, 30:90] = 7
    labels[30:50, 50:70] = 0
    labels[100:120, 100:140] = 7
    photo(tmp_path, labels)
    c = compiled(
        tmp_path,
        "objects: {}\nboundaries: {wall: {mask: 7, friction: 0.25, elasticity: 0.16}}",
    )
    [wall] = c.world.walls
    assert (wall.surface.friction, wall.surface.elasticity) == (0.5, approx(0.4))
    assert all(
        (chain[0] == chain[-1]).all() and chain.dtype == np.float64
        for chain in wall.chains
    )
    assert [round(area(chain), -1) for chain in wall.chains] == [2400, -400, 800]
    low, high = wall.chains[0].min(axis=0), wall.chains[0].max(axis=0)
    assert low == approx([29.5, 19.5], abs=0.3)
    assert high == approx([89.5, 59.5], abs=0.3)
    assert np.array_equal(c.scenery, labels == 7)
    assert not c.labels.any()


@pytest.mark.parametrize("shape", ["block", "ball"])
def test_what_stands_on_a_mask_touches_it(tmp_path: Path, shape: str) -> None:
    """Fitted alone, each outline may be off by half a pixel, and the two would overlap or gape."""
    labels = np.zeros((HEIGHT, WIDTH), int)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    slope = rows >= 90 + columns // 8
    labels[slope] = 7
    thing = (
        disc(100, 77, 24.6)
        if shape == "ball"
        else (columns >= 60) & (columns < 110) & (rows > 60)
    )
    labels[thing & ~slope] = 1
    photo(tmp_path, labels)
    c = compiled(tmp_path, "objects: {a: {mask: 1}}\nboundaries: {hill: {mask: 7}}")
    body = c.world.bodies[0]
    assert (body.radius is not None) == (shape == "ball")
    outline, line = (
        outline_shape(c.outlines[0]),
        shapely.LineString(c.world.walls[0].chains[0]),
    )
    assert depth_across(outline, line) < 0.01
    assert (
        depth_across(translate(outline, 0, 0.3), line) > 0.2
    )  # it is in contact, not above


def test_masks_written_out(tmp_path: Path) -> None:
    polygon = "{polygon: [[10, 10], [60, 10], [60, 40], [10, 40]]}"
    c = compiled(
        tmp_path,
        f"objects: {{}}\nboundaries: {{a: {{mask: {polygon}}}}}",
        "size: [200, 150]",
    )
    [chain] = c.world.walls[0].chains
    assert chain.min(axis=0) == approx([10, 10], abs=0.6)
    assert chain.max(axis=0) == approx([60, 40], abs=0.6)


def test_a_mask_behind_an_object_has_no_hole_there(tmp_path: Path) -> None:
    """Else the object would be caught in a hole of its own shape."""
    body = """\
objects:
  ball: {mask: {polygon: [[90, 60], [110, 60], [110, 80], [90, 80]]}}
boundaries:
  back: {mask: {polygon: [[50, 30], [150, 30], [150, 110], [50, 110]]}}
  more: {mask: {polygon: [[140, 100], [190, 100], [190, 140], [140, 140]]}}
"""
    c = compiled(tmp_path, body, "size: [200, 150]")
    assert [len(wall.chains) for wall in c.world.walls] == [1, 1]
    assert area(c.world.walls[0].chains[0]) == approx(101 * 81, rel=0.02)
    assert area(c.world.walls[1].chains[0]) == approx(
        51 * 41, rel=0.03
    )  # the two cross, each as it is
    assert not c.scenery[65:75, 95:105].any()
    assert c.scenery[40, 60]


# In the picture


@pytest.mark.slow
def test_scenery_stays_in_the_picture(tmp_path: Path) -> None:
    """Even where the maps were made when it still was an object, and lack it behind the ball."""
    labels = np.zeros((HEIGHT, WIDTH), int)
    labels[100:130, 20:180] = 7
    labels[disc(100, 79, 20.6)] = 1
    rng = np.random.default_rng(0)
    rgb = np.full((HEIGHT, WIDTH, 3), 180, np.uint8) + rng.integers(
        0, 20, (HEIGHT, WIDTH, 3)
    ).astype(np.uint8)
    rgb[labels == 7] = (60, 90, 140)
    rgb[labels == 1] = (200, 60, 60)
    source = tmp_path / "source.png"
    cv2.imwrite(str(source), rgb[..., ::-1])
    cv2.imwrite(str(tmp_path / "labels.png"), labels.astype(np.uint16))
    pipeline.perceive(source, tmp_path / "scene.yaml", masks=tmp_path / "labels.png")
    was = pipeline.load(tmp_path / "scene.yaml")
    assert pipeline.percepts(was).coverage[labels == 7].max() == 1
    (tmp_path / "bowl.yaml").write_text(
        f"physgen: 1\nimage: source.png\nassets: {was.assets.name}\n"
        "objects: {ball: {mask: 1}}\nboundaries: {shelf: {mask: 7}}\n"
    )
    scene = pipeline.load(tmp_path / "bowl.yaml")
    maps = pipeline.percepts(scene)
    c = pipeline.compile(scene, maps)
    assert pipeline.lint(scene, c) == []
    stage = pipeline.stage(scene, c, maps)
    near = cv2.dilate((labels == 1).astype(np.uint8), np.ones((11, 11))) > 0
    assert np.array_equal(stage.background[~near], rgb[~near])
    # behind the ball is neither the ball nor nothing
    assert np.abs(stage.background[75, 100].astype(int) - [200, 60, 60]).max() > 60
    assert len(stage.sprites) == 1
