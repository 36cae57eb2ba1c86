from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.backends.boundary_support import support
from physgen.perceive.roles import PhotoObject
from physgen.perceive.support.ground_contact import find_foot, is_carried, lower_hull
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
        self, x: float, y: float, w: float, h: float, tilt: float = 0.0, cut: bool = False
    ) -> PhotoObject:
        """Its lower left corner at x, y; its foot rises by `tilt` px to the right."""
        points = np.array([[x, y], [x, y - h], [x + w, y - h - tilt], [x + w, y - tilt]])
        self.labels[round(y - h + 0.5) : round(y + 0.5), round(x + 0.5) : round(x + w + 0.5)] = (
            len(self.things) + 1
        )
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
        self.things = [replace(t, outline=setting.outlines.get(t.id, t.outline)) for t in self.things]
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
    assert set(walls) == {"frame", "floor"}
    assert walls["floor"][[0, -1], 0].tolist() == [-0.5, W - 0.5]
    for thing in desk.things:
        assert -GAP <= penetration(walls["floor"], thing) <= 1e-6


def board(first: int, last: int) -> Desk:
    """A board before a wall, 14 px thick, from column `first` to `last`, with three blocks on it."""
    desk = Desk(horizon=H)
    desk.rgb[181:195, first:last] = (215, 210, 200)
    for x in (150, 190, 260):
        desk.block(x, 180, 20, 60)
    return desk


@pytest.mark.parametrize(("first", "last"), [(110, W), (0, 330), (110, 330)])
def test_a_board_ends_where_its_edge_does(first: int, last: int):
    """A ball pushed off it must fall, not stand on air."""
    floor = board(first, last).walls()["floor"]
    for found, end, border in ((floor[0, 0], first, 0), (floor[-1, 0], last, W)):
        assert found == pytest.approx(end - 0.5, abs=0.5 if end == border else 2)


def test_a_floor_of_the_wall_s_colour_goes_on():
    """No edge is seen anywhere: nothing tells an end."""
    desk = board(150, 150)
    assert desk.walls()["floor"][[0, -1], 0].tolist() == [-0.5, W - 0.5]


def test_a_sloped_floor_is_found_and_touched():
    desk = Desk()
    for k in range(5):
        desk.block(20 + 75 * k, 240 - 3 * k, 30, 40, tilt=1.2)
    desk.ball(375, 222, 12)
    walls = desk.walls()
    assert set(walls) == {"frame", "floor"}
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
    assert not is_carried(side, desk.labels, desk.things)


def test_another_height_gets_a_ledge_of_its_own():
    desk = Desk()
    for k in range(4):
        desk.block(20 + 60 * k, 260, 25, 50)
    shelf = desk.ball(320, 140, 20)
    walls = desk.walls()
    assert set(walls) == {"frame", "floor", "ledge-1"}
    ledge = walls["ledge-1"]
    assert ledge[0, 0] < 310
    assert ledge[-1, 0] > 330
    assert -GAP <= penetration(ledge, shelf) <= 1e-6


def test_a_floor_runs_into_nothing_else():
    desk = Desk()
    desk.block(20, 260, 25, 50)
    desk.block(100, 260, 25, 50)
    high = desk.block(200, 180, 40, 60)
    beside = desk.block(255, 205, 40, 60)
    walls = desk.walls()
    for name, wall in walls.items():
        if name == "frame":
            continue
        for thing in (high, beside):
            box = thing.outline.rings[0].outer
            (left, top), (right, bottom) = box.min(0), box.max(0)
            assert not [p for p in wall if left < p[0] < right and top < p[1] < bottom], name


def test_the_foot_is_the_edge_under_the_centre_of_mass():
    points = np.array([[0, 0], [40, 0], [38, 50], [30, 52], [10, 51], [2, 49]], float)
    stand = find_foot(PhotoObject(1, Region((Ring(points),))))
    assert stand.left.tolist() == [10, 51]
    assert stand.right.tolist() == [30, 52]


def test_a_shelf_is_followed_as_far_as_it_is_seen():
    desk = Desk(horizon=H)
    desk.rgb[140:170, 60:260] = (240, 240, 235)
    desk.ball(150, 139.5, 30)
    floor = desk.walls()["floor"]
    assert floor[0, 0] == pytest.approx(59.5, abs=1.01)
    assert floor[-1, 0] == pytest.approx(259.5, abs=1.01)


def test_views():
    desk = Desk()
    for k in range(4):
        desk.block(20 + 60 * k, 260, 25, 50)
    assert support()(desk.rgb, desk.labels, desk.things, None).view is View.SIDE
    table = Desk(horizon=0)
    for x, y in ((50, 60), (120, 210), (200, 110), (290, 250), (330, 80), (180, 180)):
        table.ball(x, y, 18)
    setting = support()(table.rgb, table.labels, table.things, None)
    assert setting.view is View.TOP
    assert [wall.name for wall in setting.walls] == ["frame"]


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
