"""Drawn boxes on floors, ledges and slopes: what is a person's stays where the ground follows a correction."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from physgen.cli.main import main
from physgen.edit.corrections import correct, drift
from physgen.edit.live import Live

SIDE = 256
FLOOR = 230
SLOPE = math.radians(33)
INKS = ((40, 40, 200), (40, 180, 40), (200, 60, 40), (30, 160, 200))
Corners = Sequence[Sequence[float]]


def box(x0: float, y0: float, x1: float, y1: float) -> Corners:
    """Corners of the pixels from (x0, y0) up to, not with, (x1, y1)."""
    return [[x0, y0], [x1 - 1, y0], [x1 - 1, y1 - 1], [x0, y1 - 1]]


def on_slope(x: float, w: float, h: float) -> Corners:
    """A box that lies on a slope through (0, 60)."""
    c, s = math.cos(SLOPE), math.sin(SLOPE)
    mid = x + s * h / 2, 60 + x * s / c - c * h / 2
    corners = ((-w / 2, -h / 2), (w / 2, -h / 2), (w / 2, h / 2), (-w / 2, h / 2))
    return [[mid[0] + c * a - s * b, mid[1] + s * a + c * b] for a, b in corners]


class Scene:
    """A photo of boxes, perceived with their masks, of which some miss a part."""

    def __init__(
        self, folder: Path, masks: Sequence[Corners], more: Sequence[Corners] = (), slope: bool = False
    ):
        y, x = np.mgrid[:SIDE, :SIDE]
        ground = y > 60 + math.tan(SLOPE) * x if slope else y >= FLOOR
        photo = np.where(ground[..., None], (90, 110, 130), (210, 210, 210)).astype(np.uint8)
        labels = np.zeros((SIDE, SIDE), np.uint8)
        for k, corners in enumerate((*more, *masks)):
            cv2.fillPoly(photo, [np.rint(corners).astype(np.int32)], INKS[k % 4])
        for k, corners in enumerate(masks):
            cv2.fillPoly(labels, [np.rint(corners).astype(np.int32)], k + 1)
        grain = np.random.default_rng(0).normal(0, 3, photo.shape)
        cv2.imwrite(str(folder / "photo.png"), np.clip(photo + grain, 0, 255).astype(np.uint8))
        cv2.imwrite(str(folder / "given.png"), labels)
        self.path = folder / "scene.yaml"
        flags = ["--masks", str(folder / "given.png"), "-o", str(self.path)]
        assert main(["perceive", str(folder / "photo.png"), *flags]) == 0

    @property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    def edit(self, change: Callable[[str], str]) -> None:
        before = self.text
        self.path.write_text(change(before), encoding="utf-8")
        assert self.text != before

    def name(self, mask: int) -> str:
        return next(name for name, one in data(self.text)["objects"].items() if one["mask"] == mask)

    def draw(self, corners: Corners, name: str | None) -> tuple[str, dict[str, float]]:
        """The text after it, and how far things move that nobody pushes."""
        live, out = Live(self.path), self.path.parent / "maps"
        op = {"kind": "polygon", "object": name, "polygon": [list(map(float, one)) for one in corners]}
        made = correct(live, self.text, None, op, out)
        return made.text, drift(live.state(made.text, out).compiled.world)


def data(text: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(text)
    return found


def lines(text: str) -> dict[str, Any]:
    return {
        name: wall.get("segment") or wall.get("polyline") for name, wall in data(text)["boundaries"].items()
    }


def without(name: str) -> Callable[[str], str]:
    return lambda text: re.sub(rf"\n  {name}:.*?(?=\n  \w|\n[#\w])", "", text, flags=re.S)


A, HALF, WHOLE, C = (
    box(20, 190, 60, 230),
    box(100, 120, 150, 190),
    box(100, 120, 150, 230),
    box(180, 60, 230, 110),
)


@pytest.fixture
def ledges(tmp_path: Path) -> Scene:
    """A on the floor, B whose mask misses its lower part and so is on a ledge, C on a higher one."""
    return Scene(tmp_path, (A, HALF, C), more=(WHOLE,))


def test_the_ledge_of_a_half_found_thing_goes_and_no_others(ledges: Scene) -> None:
    before = lines(ledges.text)
    assert list(before) == ["frame", "floor", "ledge-1", "ledge-2"]
    text, moved = ledges.draw(WHOLE, ledges.name(2))
    now = lines(text)
    assert list(now) == ["frame", "floor", "ledge-2"], "perception would call it ledge-1: it is the same one"
    assert now["ledge-2"] == before["ledge-2"]
    assert max(moved.values()) < 0.5
    assert "through the lowest points of 2 objects" in text
    assert "through the lowest points of 1" not in text


def test_the_ledge_that_a_person_took_out_stays_out_and_others_stay(ledges: Scene) -> None:
    ledges.edit(without("ledge-1"))
    text, moved = ledges.draw(WHOLE, ledges.name(2))
    assert list(lines(text)) == ["frame", "floor", "ledge-2"]
    assert max(moved.values()) < 0.5


def test_a_new_thing_gets_a_ledge_and_the_one_taken_out_stays_out(ledges: Scene) -> None:
    ledges.edit(without("ledge-2"))
    high = lines(ledges.text)
    text, moved = ledges.draw(box(10, 130, 50, 165), None)
    more = {name: wall for name, wall in lines(text).items() if wall not in high.values()}
    assert len(more) == 1
    assert max(y for ((_, y), *_) in more.values()) == pytest.approx(164.5, abs=1)
    assert moved[ledges.name(3)] > 100, "C falls, as it did"
    assert sum(far > 1.5 for far in moved.values()) == 1


def test_numbers_and_remarks_of_a_person_stay_on_their_wall(ledges: Scene) -> None:
    ledges.edit(
        lambda text: re.sub(
            r"  ledge-2:.*\n(.*\n)    friction: \S+", r"  ledge-2:  # mine, waxed\n\1    friction: 0.01", text
        )
    )
    text, _ = ledges.draw(WHOLE, ledges.name(2))
    assert "  ledge-2:  # mine, waxed\n" in text
    assert data(text)["boundaries"]["ledge-2"]["friction"] == 0.01


@pytest.mark.parametrize("height", [227.5, 228.2, 229.6, 230.5])
def test_a_corrected_thing_stands_on_a_persons_floor(ledges: Scene, height: float) -> None:
    floor = f"\n  floor: {{segment: [[-0.5, {height}], [255.5, {height}]], friction: 0.6}}"
    ledges.edit(lambda text: re.sub(r"\n  floor:.*?(?=\n  \w)", floor, text, flags=re.S))
    name = ledges.name(1)
    text, moved = ledges.draw(box(20, 185, 60, 230), name)
    assert lines(text)["floor"] == [[-0.5, height], [255.5, height]]
    assert moved[name] < 0.5


def test_a_wall_that_a_person_drew_is_enough(ledges: Scene) -> None:
    ledges.edit(
        lambda text: text.replace(
            "boundaries:\n", "boundaries:\n  mine: {segment: [[0, 165.5], [60, 165.5]]}\n"
        )
    )
    before = lines(ledges.text)
    text, moved = ledges.draw(box(10, 130, 50, 165), None)
    assert lines(text) == before
    assert max(moved.values()) < 1.5


@pytest.mark.parametrize("feet", [(230, 228, 231, 226), (231, 229, 227, 224), (226, 231, 229, 222)])
def test_what_stood_on_a_floor_that_follows_stands_on_it(tmp_path: Path, feet: Sequence[int]) -> None:
    """Four things that do not stand quite level; the last one's mask ends too high."""
    tall = (190, 185, 180, 190)
    left = (15, 75, 135, 195)
    boxes = [box(x, y, x + 40, foot) for x, y, foot in zip(left, tall, feet, strict=True)]
    scene = Scene(tmp_path, boxes, more=(box(195, 190, 235, 230),))
    text, moved = scene.draw(box(195, 190, 235, 230), scene.name(4))
    assert max(moved.values()) < 0.5
    assert len(lines(text)) <= len(lines(scene.text))


def test_a_thing_that_is_added_on_a_slope_has_the_friction_to_lie_there(tmp_path: Path) -> None:
    seen = [on_slope(60, 50, 30), on_slope(140, 50, 34), on_slope(210, 44, 30)]
    scene = Scene(tmp_path, seen, more=(on_slope(100, 26, 24),), slope=True)
    before = lines(scene.text)
    text, moved = scene.draw(on_slope(100, 26, 24), None)
    (new,) = data(text)["objects"].keys() - data(scene.text)["objects"].keys()
    assert moved[new] < 0.5
    assert data(text)["objects"][new]["friction"] > math.tan(SLOPE)
    assert len(lines(text)) == len(before)
