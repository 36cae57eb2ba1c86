from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen.geometry.polygon import Disc, Region, Ring, mass_properties
from physgen.maps import read_labels
from physgen.perceive.backends.boundary_support import support
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.roles import PhotoObject
from physgen.perceive.segment.prompts import from_masks
from physgen.perceive.support.flat_bases import add_base, needs_base
from physgen.perceive.support.ground_contact import (
    Line,
    close_gaps_below,
    find_foot,
    has_carriers,
    lower_hull,
)
from physgen.perceive.support.supports import SOURCE
from physgen.photos import read_image
from physgen.scene.load import load
from physgen.scene.scene import View

W, H = 400, 300
GAP = 0.13
"""px between a thing and what it stands on: no eye sees it."""


class Desk:
    """A wall over a table, and things put on it by hand."""

    def __init__(self, horizon: int = 150) -> None:
        self.rgb = np.full((H, W, 3), (90, 120, 160), np.uint8)
        self.rgb[horizon:] = (150, 100, 60)
        self.labels = np.zeros((H, W), np.uint16)
        self.things: list[PhotoObject] = []

    def block(
        self,
        x: float,
        y: float,
        w: float,
        h: float,
        tilt: float = 0.0,
        cut: bool = False,
    ) -> PhotoObject:
        """Its lower left corner at x, y; its foot rises by `tilt` px to the right."""
        points = np.array(
            [[x, y], [x, y - h], [x + w, y - h - tilt], [x + w, y - tilt]]
        )
        self.labels[
            round(y - h + 0.5) : round(y + 0.5), round(x + 0.5) : round(x + w + 0.5)
        ] = len(self.things) + 1
        return self._add(Region((Ring(points),)), cut)

    def ball(self, x: float, y: float, r: float) -> PhotoObject:
        """Resting at height y."""
        rows, columns = np.mgrid[:H, :W]
        self.labels[np.hypot(columns - x, rows - y + r) <= r] = len(self.things) + 1
        return self._add(Disc(np.array([x, y - r]), r), False)

    def _add(self, outline: Disc | Region, cut: bool) -> PhotoObject:
        self.things.append(PhotoObject(len(self.things) + 1, outline, "", cut))
        return self.things[-1]

    def walls(self, view: View | None = View.SIDE):
        setting = support()(self.rgb, self.labels, self.things, view)
        self.things = [
            replace(t, outline=setting.outlines.get(t.id, t.outline))
            for t in self.things
        ]
        return {wall.name: np.array(wall.points) for wall in setting.walls}


def penetration(wall: np.ndarray, thing: PhotoObject) -> float:
    """How far a thing reaches under a wall, px; negative: how far above it stays."""
    hull = lower_hull(thing.outline)
    return float((hull[:, 1] - np.interp(hull[:, 0], wall[:, 0], wall[:, 1])).max())


def test_a_row_stands_on_one_floor_from_side_to_side():
    desk = Desk()
    for k, y in enumerate((220.0, 221.3, 219.6, 220.7, 220.0)):
        desk.block(30 + 70 * k, y, 20, 60)
    walls = desk.walls()
    assert set(walls) == {"bottom", "floor"}
    assert walls["floor"][[0, -1], 0].tolist() == [-W, 2 * W]
    for thing in desk.things:
        assert -GAP <= penetration(walls["floor"], thing) <= 1e-6


def board(first: int, last: int) -> Desk:
    """A board before a wall, 14 px thick, from column `first` to `last`, with three blocks on it."""
    desk = Desk(horizon=H)
    desk.rgb[181:195, first:last] = (215, 210, 200)
    for x in (150, 190, 260):
        desk.block(x, 180, 20, 60)
    return desk


def test_balls_whose_masks_are_off_stand_on_one_level_floor():
    """The mask of the last one has 3 px of the shelf; as it lay lower, it had a ledge of its own, without an end."""
    desk = Desk(horizon=H)
    desk.rgb[220:232, 40:330] = (40, 40, 45)
    for k, y in enumerate((220.0, 220.4, 219.7, 220.1, 223.0)):
        desk.ball(70 + 55 * k, y, 22)
    walls = desk.walls()
    assert set(walls) == {"bottom", "floor"}
    assert np.ptp(walls["floor"][:, 1]) == 0
    assert walls["floor"][[0, -1], 0] == pytest.approx([39.5, 329.5], abs=2)
    for thing in desk.things:
        assert -GAP <= penetration(walls["floor"], thing) <= 1e-6


@pytest.mark.parametrize(("radius", "lower"), [(30, 4), (15, 3), (8, 2)])
def test_a_ball_that_is_nearer_keeps_its_pixels_in_its_circle(radius: int, lower: int):
    """Else they are drawn as something flat that hangs on it."""
    desk = Desk()
    for k in range(4):
        desk.ball(60 + 80 * k, 220.0 + lower * (k == 2), radius)
    desk.walls()
    rows, columns = np.nonzero(desk.labels == 3)
    disc = desk.things[2].outline
    off = np.hypot(columns - disc.center[0], rows - disc.center[1]) - disc.radius
    assert (off > 2).mean() < 0.03


def test_balls_that_touch_stay_where_they_are():
    """Moved onto one line they would enter each other."""
    desk = Desk()
    for x, y in ((100.0, 220.0), (140.0, 221.0), (200.0, 220.2), (260.0, 220.0)):
        desk.ball(x, y, 20)
    before = [t.outline for t in desk.things]
    desk.walls()
    moved = [
        not np.array_equal(t.outline.center, was.center)
        for t, was in zip(desk.things, before, strict=True)
    ]
    assert moved[:2] == [False, False]


@pytest.mark.parametrize(("first", "last"), [(110, W), (0, 330), (110, 330), (0, W)])
def test_a_board_ends_where_its_edge_does(first: int, last: int):
    """A ball pushed off it must fall, not stand on air."""
    floor = board(first, last).walls()["floor"]
    assert (
        floor[0, 0] == pytest.approx(first - 0.5, abs=2) if first else floor[0, 0] == -W
    )
    assert (
        floor[-1, 0] == pytest.approx(last - 0.5, abs=2)
        if last < W
        else floor[-1, 0] == 2 * W
    )


def test_a_dark_board_before_a_dark_back_ends_where_its_edge_does():
    """Nothing tells it from what is behind it but at its ends."""
    desk = board(110, 330)
    desk.rgb[:] = 200
    desk.rgb[100:195, 110:330] = 30
    floor = desk.walls()["floor"]
    assert floor[[0, -1], 0] == pytest.approx([109.5, 329.5], abs=2)


def test_a_shadow_is_no_floor_s_end():
    desk = Desk(horizon=H)
    desk.rgb[:] = 180
    desk.rgb[225:245, 130:230] = 110
    desk.block(150, 224, 40, 60)
    assert desk.walls()["floor"][[0, -1], 0].tolist() == [-W, 2 * W]


def test_what_is_in_the_air_gets_a_short_ledge():
    """A wide one would stop what falls past it; over a slope, too, it is no floor."""
    desk = Desk(horizon=H)
    desk.ball(300, 80, 20)
    for x in (40, 110):
        desk.block(x, 180 - 0.3 * x, 50, 30, tilt=15)
    walls = desk.walls()
    assert "floor" not in walls
    assert np.ptp(walls["ledge-1"][:, 0]) < 60


@pytest.mark.parametrize("sides", [4, 2, 1])
def test_rails_of_a_table_seen_from_above(sides: int):
    """Cloth, a band of shade beside two rails, rails of the cloth's colour, wood."""
    table = Desk(horizon=0)
    table.rgb[:] = (30, 110, 60)
    ends = {
        "left": (30, 0),
        "top": (0, 40),
        "right": (W - 30, 0),
        "bottom": (0, H - 40),
    }
    for k, (x, y) in enumerate(list(ends.values())[:sides]):
        rail = (
            np.s_[:, :x]
            if k == 0
            else np.s_[:y]
            if k == 1
            else np.s_[:, x:]
            if k == 2
            else np.s_[y:]
        )
        table.rgb[rail] = (45, 140, 80)
    noise = np.random.default_rng(1).normal(0, 4, table.rgb.shape)
    table.rgb = np.clip(table.rgb + noise, 0, 255).astype(np.uint8)
    for x, y in ((80, 110), (120, 230), (200, 130), (290, 220)):
        table.ball(x, y, 15)
    walls = table.walls(View.TOP)
    assert len(walls) == (0 if sides < 2 else sides)
    if sides == 4:
        points = np.concatenate(list(walls.values()))
        assert points.min(0) == pytest.approx([29.5, 39.5], abs=1.5)
        assert points.max(0) == pytest.approx([W - 30.5, H - 40.5], abs=1.5)


def test_rails_of_the_bundled_billiards(bundled: Path):
    scene = load(bundled / "billiards" / "scene.yaml")
    rgb = read_image(bundled / "billiards" / "photo.png")
    found = from_masks(
        read_labels(bundled / "billiards" / "photo.assets" / "masks.png")
    )
    walls = support()(rgb, found.labels, fit_objects(rgb, found)[0], View.TOP).walls
    points = np.concatenate([wall.points for wall in walls])
    true = np.array(scene.boundaries[0].points)
    assert points.min(0) == pytest.approx(true.min(0), abs=3)
    assert points.max(0) == pytest.approx(true.max(0), abs=3)


def test_a_sloped_floor_is_found_and_touched():
    desk = Desk()
    for k in range(5):
        desk.block(20 + 75 * k, 240 - 3 * k, 30, 40, tilt=1.2)
    desk.ball(375, 222, 12)
    walls = desk.walls()
    assert set(walls) == {"bottom", "floor"}
    slope = np.polyfit(walls["floor"][:, 0], walls["floor"][:, 1], 1)[0]
    assert slope == pytest.approx(-0.044, abs=0.012)
    for thing in desk.things:
        assert -GAP <= penetration(walls["floor"], thing) <= 1e-6


def test_a_ball_gets_a_level_spot():
    desk = Desk()
    ball = desk.ball(200, 230, 25)
    floor = desk.walls()["floor"]
    under = np.interp([195, 200, 205], floor[:, 0], floor[:, 1])
    assert np.ptp(under) == 0
    assert -GAP <= penetration(floor, ball) <= 1e-6


def test_a_leaning_thing_is_not_carried():
    desk = Desk()
    desk.block(100, 240, 50, 50)
    side = desk.block(145, 189.5, 120, 60)  # its centre of mass is beyond the block
    assert not has_carriers(side, desk.labels, desk.things)


def test_the_foot_is_the_edge_under_the_centre_of_mass():
    points = np.array([[0, 0], [40, 0], [38, 50], [30, 52], [10, 51], [2, 49]], float)
    stand = find_foot(PhotoObject(1, Region((Ring(points),))))
    assert stand.left.tolist() == [10, 51]
    assert stand.right.tolist() == [30, 52]


def test_a_row_on_a_floor_seen_askew_stands_on_one_straight_line():
    desk = Desk()
    for k in range(6):
        desk.block(10 + 62 * k, 210 + 1.0 * k + (0.4, -0.4, 0.0)[k % 3], 40, 50)
    walls = desk.walls()
    assert len(walls["floor"]) == 2
    (x0, y0), (x1, y1) = walls["floor"]
    assert (y1 - y0) / (x1 - x0) == pytest.approx(1.0 / 62, abs=0.003)
    for thing in desk.things:
        assert -GAP < -penetration(walls["floor"], thing) < GAP


@pytest.mark.parametrize(("gap", "stands"), [(4, True), (14, False)])
def test_what_ends_just_above_a_book_stands_on_it(gap: int, stands: bool):
    """The mask of a candlestick without its foot: pointed, and a few px above the book below it."""
    desk = Desk()
    desk.block(100, 220, 120, 40)
    rows, columns = np.mgrid[:H, :W]
    stick = (
        (rows <= 180 - gap)
        & (rows > 90)
        & (np.abs(columns - 160) <= np.minimum(8, 0.5 * (181 - gap - rows)))
    )
    desk.labels[stick] = 2
    desk.things = fit_objects(desk.rgb, from_masks(desk.labels))[0]
    walls = desk.walls()
    assert any(name.startswith(("nest", "ledge")) for name in walls) != stands
    low = max(y for ring in desk.things[1].outline.rings for _, y in ring.outer)
    assert low == pytest.approx(179.5 if stands else 180.5 - gap, abs=0.7)


def test_a_stool_above_a_book_keeps_what_lies_under_it():
    """Its legs end a few px above the book, on which a ball lies between them: the ball stays, and so does the gap."""
    desk = Desk()
    desk.block(60, 220, 200, 40)
    rows, columns = np.mgrid[:H, :W]
    stool = (rows > 80) & (rows < 177) & (np.abs(columns - 160) < 45)
    stool &= (rows < 95) | (np.abs(columns - 160) > 30)
    desk.labels[stool] = 2
    desk.labels[np.hypot(rows - 169, columns - 160) <= 11] = 3
    desk.things = fit_objects(desk.rgb, from_masks(desk.labels))[0]
    before = [t.outline for t in desk.things]
    closed = close_gaps_below(desk.labels, desk.things)
    assert closed.keys() == {2}
    legs = 2 * 15 * 4  # px, what both lack
    assert mass_properties(closed[2]).area - mass_properties(
        before[1]
    ).area == pytest.approx(legs, rel=0.3)


def test_bars_behind_objects_are_no_shelf():
    """Right below two balls in the air it is dark, and beside them light, in no column both."""
    desk = Desk(horizon=260)
    for x in (120, 200):
        desk.rgb[:260, x - 22 : x + 23] = (30, 30, 40)
        desk.ball(x, 130, 20)
    desk.block(300, 270, 60, 40)
    walls = support()(desk.rgb, desk.labels, desk.things, View.SIDE).walls
    assert [wall.source for wall in walls if wall.name.startswith("ledge")] == [SOURCE]


def receding_shoe(lean: float) -> PhotoObject:
    """A thing seen from above its level: its base rises by `lean` px to the right."""
    corners = [(100, 80), (220, 80), (220, 200 - lean), (160, 200 - 0.3 * lean)]
    corners += [(110, 200), (100, 190)]
    return PhotoObject(1, Region((Ring(np.array(corners, np.float64)),)))


@pytest.mark.parametrize("lean", [35.0, 50.0])
def test_a_receding_base_becomes_flat(lean: float) -> None:
    item = receding_shoe(lean)
    foot = find_foot(item)
    assert needs_base(foot)
    outline = add_base(foot, Line(0.0, 200.0))
    assert outline is not None
    based = find_foot(replace(item, outline=outline))
    middle = mass_properties(outline).center[0]
    assert based.left[0] < middle - 20
    assert based.right[0] > middle + 20
    assert abs(based.left[1] - 200) + abs(based.right[1] - 200) < 1e-6
    assert not needs_base(based)


def test_a_base_is_not_added_far_above_the_ground() -> None:
    assert add_base(find_foot(receding_shoe(50)), Line(0.0, 300.0)) is None


@pytest.mark.parametrize(("label", "is_based"), [("apple", False), ("toy", True)])
def test_nearly_round_fruit_gets_no_base(label: str, is_based: bool) -> None:
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = Ring(100 + 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    item = PhotoObject(1, Region((ring,)), label)
    assert needs_base(find_foot(item)) == is_based
