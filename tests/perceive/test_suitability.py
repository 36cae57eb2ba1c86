"""Whether a photo suits: doubts that follow from what is drawn."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from physgen.geometry.polygon import Disc
from physgen.perceive.perceive import perceive
from physgen.perceive.roles import BoundaryGuess, Detections, Doubt, PhotoObject, Wall
from physgen.perceive.scene_files import write_scene
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.prompts import from_masks
from physgen.perceive.support import viewpoint
from physgen.perceive.support.supports import SOURCE
from physgen.perceive.support.viewpoint import judge_suitability
from physgen.pipeline import perceive as perceive_file
from physgen.report.perception import written_suitability
from physgen.scene.scene import View

H, W = 192, 256
GOOD = BoundaryGuess(
    View.SIDE, 0.9, "", (Wall("floor", ((0, 150), (W, 150)), 0.6, 0.4, 0.8, "", ""),)
)


class Found:
    """Three balls on a plain background, and what perception says of them."""

    def __init__(self, radius: int = 20, sure: float = 0.9) -> None:
        rows, columns = np.mgrid[:H, :W]
        self.rgb = np.full((H, W, 3), (150, 130, 110), np.uint8)
        labels = np.zeros((H, W), np.uint16)
        self.objects = []
        for k, x in enumerate((50, 120, 200), 1):
            labels[np.hypot(columns - x, rows - 120) <= radius] = k
            self.objects.append(
                PhotoObject(k, Disc(np.array([x, 120.0]), float(radius)), "ball")
            )
        self.found = Detections(labels, "learned", dict.fromkeys((1, 2, 3), sure), {})

    def doubts(self, boundaries: BoundaryGuess = GOOD) -> str:
        return str(judge_suitability(self.rgb, self.found, self.objects, boundaries))


def test_things_on_a_table_are_good():
    assert Found().doubts() == "good"


@pytest.mark.parametrize("turn", [np.fliplr, np.flipud])
def test_texture_all_over(turn):
    """Noise as fine as gravel or a crowd; the same however the photo is turned."""
    one = Found()
    one.rgb = turn(
        np.random.default_rng(2).integers(0, 255, one.rgb.shape).astype(np.uint8)
    )
    assert "is cluttered" in one.doubts() or "leaves or grass" in one.doubts()


def test_grain_of_a_plain_wall_is_no_clutter():
    one = Found()
    grain = np.random.default_rng(4).normal(150, 8, one.rgb.shape)
    one.rgb = np.clip(grain, 0, 255).astype(np.uint8)
    assert viewpoint.fine_detail(one.rgb).mean() > 0.9
    assert "is cluttered" not in one.doubts()


def test_sky_and_leaves():
    one = Found()
    one.rgb[:90] = (110, 160, 230)
    assert "sky" in one.doubts()
    one = Found()
    leaves = np.random.default_rng(3).integers(30, 160, (H // 3, W, 1))
    one.rgb[-(H // 3) :] = leaves * (0.5, 1.0, 0.3)
    assert "leaves" in one.doubts()


def test_unsure_objects_and_doubtful_regions():
    assert "few sure objects" in Found(sure=0.4).doubts()
    one = Found()
    region = Doubt([(0, 0), (W - 1, 0), (W - 1, 60), (0, 60)], 0.2)
    one.found = replace(one.found, doubtful=[region])
    assert "may be objects" in one.doubts()


@pytest.mark.parametrize(
    ("movable", "height", "fills"),
    [(0.2, 40, True), (0.9, 40, False), (0.2, 10, False)],
)
def test_people_animals_and_furniture(
    monkeypatch, movable: float, height: int, fills: bool
):
    """Where the network sees wholes that nobody moves, on more than a tenth of the photo."""
    one = Found()
    seen = run_network(one.rgb)
    foreground = np.zeros_like(seen.foreground)
    foreground[:height] = 0.9
    seen = replace(
        seen, foreground=foreground, movable=np.full_like(seen.movable, movable)
    )
    monkeypatch.setattr(viewpoint, "run_network", lambda rgb: seen)
    assert ("looks immovable" in one.doubts()) == fills


def test_nothing_beneath_and_an_unclear_view():
    one = Found()
    assert "no support" in one.doubts(replace(GOOD, held_ids=frozenset((1, 2, 3))))
    assert "the view is uncertain" in one.doubts(replace(GOOD, confidence=0.52))


@pytest.mark.parametrize(("name", "source", "held"), [
    ("nest-1", SOURCE, False), ("ledge-1", SOURCE, False), ("ledge-1", "lowest points", True), ("wall-1", SOURCE, True),
])  # fmt: skip
def test_ledges_that_nobody_sees_are_no_support(name: str, source: str, held: bool):
    one = Found()
    pieces = (
        ((20, 140), (80, 140)),
        ((45, 140), (150, 140)),
    )  # under two of three balls, under one twice
    walls = tuple(
        replace(GOOD.walls[0], name=name, source=source, points=part) for part in pieces
    )
    assert one.doubts(replace(GOOD, walls=walls[:1])) == "good"
    assert one.doubts(replace(GOOD, walls=walls)) == (
        "good" if held else "doubtful: no support is visible beneath 2 of 3 objects"
    )


def test_colours_and_detail_count_where_no_object_is():
    """A blue umbrella is no sky, and green speckled apples are no leaves."""
    one = Found()
    one.found.labels[:150, :200] = 1
    one.rgb[one.found.labels == 1] = (110, 160, 230)
    assert "blue" not in one.doubts()
    speckles = np.random.default_rng(3).integers(30, 160, (H, W, 1)) * (0.5, 1.0, 0.3)
    one.rgb = np.where(one.found.labels[..., None] > 0, speckles, one.rgb).astype(
        np.uint8
    )
    assert "leaves" not in one.doubts()
    one.found.labels[:] = 0
    one.found.labels[120:] = 1
    one.found.labels[-1, :2] = 2, 3
    assert "79 % of the background looks like leaves or grass" in one.doubts()


def test_an_object_that_fills_the_photo():
    one = Found()
    one.found.labels[:120] = 1
    assert "one object fills 6" in one.doubts()


def test_masks_that_are_given_are_sure():
    one = Found(sure=0.1)
    one.found = replace(one.found, source="given")
    assert one.doubts() == "good"


@pytest.mark.parametrize(
    ("source", "count"), [("pointed at", 2), ("given", 2), ("pointed at", 1)]
)
def test_people_that_are_pointed_at(monkeypatch, source: str, count: int):
    """The network sees `count` of the three as what nobody moves: together they are a twentieth of the photo."""
    one = Found()
    one.found = replace(one.found, source=source)
    seen = run_network(one.rgb)
    h, w = seen.movable.shape
    small = one.found.labels[np.arange(h)[:, None] * H // h, np.arange(w) * W // w]
    foreground, movable = (
        (small > 0).astype(np.float32),
        (small > count).astype(np.float32),
    )
    seen = replace(seen, foreground=foreground, movable=movable)
    monkeypatch.setattr(viewpoint, "run_network", lambda rgb: seen)
    says = "doubtful: the marked object looks immovable"
    assert one.doubts() == (says if count == 2 else "good")


def test_a_photo_in_which_no_push_moves_anything(tmp_path):
    """All that is found reaches the border; with room beside it, it moves."""
    verdicts = []
    for left in (0, 20):
        rgb, labels = (
            np.full((120, 180, 3), (150, 130, 110), np.uint8),
            np.zeros((120, 180), np.uint8),
        )
        labels[40:90, left : left + 40] = 1
        rgb[labels > 0], rgb[90:] = (200, 50, 50), (90, 60, 40)
        for name, picture in (("photo", rgb), ("marked", labels)):
            cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
        told: list[str] = []
        perceive_file(
            tmp_path / "photo.png",
            tmp_path / "scene.yaml",
            masks=tmp_path / "marked.png",
            inform=told.append,
        )
        verdicts.append("no push moves anything" in told[0].splitlines()[0])
    assert verdicts == [True, False]


@pytest.mark.slow
def test_it_is_recorded(tmp_path):
    one = Found()
    one.rgb[one.found.labels > 0] = (200, 50, 50)
    made = perceive(
        one.rgb, from_masks(one.found.labels, dict.fromkeys((1, 2, 3), "cat"))
    )
    write_scene(made, None, "photo", tmp_path / "scene.yaml")
    record = json.loads((tmp_path / "scene.assets" / "perceived.json").read_text())
    assert record["suitability"] == {
        "verdict": made.suitability.verdict,
        "reasons": list(made.suitability.reasons),
    }
    assert written_suitability(tmp_path / "scene.assets") == str(made.suitability)
    assert written_suitability(tmp_path) == ""


@pytest.mark.parametrize(("turn", "says"), [(0, "blue"), (1, "looks like leaves")])
def test_a_doubt_says_no_more_than_is_seen(turn: int, says: str):
    """A blue wall indoors is no sky, and speckled green cloth is no grass: the look is named, not the place."""
    one = Found()
    speckles = np.random.default_rng(3).integers(30, 160, (H // 3, W, 1)) * (
        0.5,
        1.0,
        0.3,
    )
    one.rgb[: H // 2 if turn == 0 else H // 3] = speckles if turn else (110, 160, 230)
    told = one.doubts()
    assert says in told
    assert "outdoors" not in told
