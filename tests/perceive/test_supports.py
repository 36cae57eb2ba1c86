"""Walls for what would fall: few, only where they are needed, and found for large piles as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physgen.geometry.polygon import Disc, Outline, Region, Ring
from physgen.perceive.roles import PhotoObject, Wall
from physgen.perceive.support.equilibrium import contacts, unstable_objects
from physgen.perceive.support.ground_contact import find_foot
from physgen.perceive.support.supports import SOURCE, add_supports
from tests.perceive.lambertian import block

FLOOR = Wall("floor", ((-100.0, 0.0), (900.0, 0.0)), 0.6, 0.4, 1.0, "", "")


def upholding(outlines: list[Outline]) -> tuple[list[Wall], frozenset[int]]:
    things = [PhotoObject(k + 1, outline) for k, outline in enumerate(outlines)]
    (floor, *walls), held = add_supports(things, [FLOOR], {}, 0.6, 0.4)
    assert floor is FLOOR
    chains = [np.array(wall.points) for wall in (FLOOR, *walls)]
    fixed = [i - 1 for i in held]
    assert (
        unstable_objects(outlines, contacts(outlines, chains), {}, fixed, default=0.4)
        == []
    )
    return walls, held


def test_what_stands_needs_nothing():
    assert upholding(
        [block(0, 0, 40, 40), block(10, -40, 40, 30), block(200, 0, 20, 80)]
    ) == (
        [],
        frozenset(),
    )


def test_what_hangs_gets_a_ledge():
    walls, held = upholding([block(0, 0, 40, 40), Disc(np.array([300.0, -90.0]), 15.0)])
    assert [wall.name for wall in walls] == ["nest-1"]
    assert not held
    x = [p[0] for p in walls[0].points]
    assert min(x) < 300 < max(x)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_leaning_plank_gets_its_wall(side):
    a = np.radians(15)
    turn = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    points = block(-4, 0, 8, 120).rings[0].outer @ turn * (side, 1)
    points = points - (0, points[:, 1].max()) + (200, 0)
    walls, held = upholding([Region((Ring(points if side > 0 else points[::-1]),))])
    (wall,) = walls
    assert wall.name == "wall-1"
    assert not held
    (x, _), (_, low) = wall.points
    assert low < points[:, 1].max() - 60, "what rolls along the floor does not meet it"
    assert x == pytest.approx(
        points[:, 0].max() if side > 0 else points[:, 0].min(), abs=0.05
    )


def test_an_unseen_ledge_that_nothing_needs_goes():
    """The block stands on the floor as on the ledge, which reaches to where nothing is; the ball needs its own."""
    things = [
        PhotoObject(1, block(0, 0, 40, 40)),
        PhotoObject(2, Disc(np.array([300.0, -90.0]), 15.0)),
    ]
    ledges = [
        Wall(f"ledge-{k}", ((x, y), (x + 200, y)), 0.6, 0.4, 0.4, source, "")
        for k, (x, y, source) in enumerate(
            [
                (-20.0, 0.3, SOURCE),
                (-20.0, 0.4, "lowest points"),
                (250.0, -75.0, SOURCE),
            ]
        )
    ]
    walls, held = add_supports(things, [FLOOR, *ledges], {}, 0.6, 0.4)
    assert walls == [FLOOR, *ledges[1:]]
    assert not held


def test_each_wall_has_a_name_of_its_own_and_the_floor_stays():
    """Two nests; the floor is unseen, and nothing needs it."""
    things = [PhotoObject(k, Disc(np.array([200.0 * k, -90.0]), 15.0)) for k in (1, 2)]
    floor = replace(FLOOR, source=SOURCE)
    walls, held = add_supports(things, [floor], {}, 0.6, 0.4)
    assert [wall.name for wall in walls] == ["floor", "nest-1", "nest-2"]
    assert not held


def test_a_ledge_stays_where_only_friction_would_hold_what_lies_on_it():
    """A block that is wedged between two others stands without it, on nothing."""
    things = [
        PhotoObject(k + 1, block(x, y, 40, 40))
        for k, (x, y) in enumerate([(0, 0), (40, -20), (80, 0)])
    ]
    ledge = Wall("ledge-1", ((41.0, -20.0), (79.0, -20.0)), 0.6, 0.4, 0.4, SOURCE, "")
    sides = [
        Wall(f"wall-{k}", ((x, -60.0), (x, 0.0)), 0.6, 0.4, 0.4, "edges", "")
        for k, x in enumerate((0.0, 120.0))
    ]
    walls, _ = add_supports(
        things, [FLOOR, *sides, ledge], dict.fromkeys((1, 2, 3), 0.9), 0.6, 0.4
    )
    assert ledge in walls


def test_a_pile_of_a_hundred_blocks_ends():
    rng = np.random.default_rng(5)
    pile = [
        block(24 * k + 12 * (row % 2), -12 * row, 24, 12) for row in range(10) for k in range(10)
        if row == 0 or rng.random() < 0.93
    ]  # fmt: skip
    upholding(pile)  # with gaps: some hang, some tip


def test_a_few_px_are_level():
    points = np.array([[149.5, 99.33], [152.5, 99.8], [152.5, 103.67], [149.5, 103.2]])
    assert find_foot(PhotoObject(1, Region((Ring(points),)))).slope == 0
    assert find_foot(
        PhotoObject(1, Region((Ring(points * 10),)))
    ).slope == pytest.approx(0.157, abs=0.01)


def wedge_and_balls(side: int) -> list[Outline]:
    """A wedge that falls to the right, or to the left, and two balls of one size on it, one against the other."""
    corners = np.array([[0, -60.0], [200, 0], [0, 0]]) * (side, 1)
    down = np.array([200.0, 60]) / np.hypot(200, 60) * (side, 1)
    out = np.array([60 * side, -200.0]) / np.hypot(200, 60)
    at = [np.array([0, -60.0]) + run * down + 15.0 * out for run in (60.0, 90.0)]
    ring = corners if side > 0 else corners[::-1]
    return [Region((Ring(ring),)), *(Disc(center, 15.0) for center in at)]


@pytest.mark.parametrize("side", [-1, 1])
def test_balls_that_would_roll_get_a_stop_and_none_of_them_is_held(side):
    outlines = wedge_and_balls(side)
    walls, held = upholding(outlines)
    assert not held
    assert [wall.name for wall in walls] == ["stop-1"]
    (x0, y0), (x1, y1) = walls[0].points
    lower = outlines[2]
    assert isinstance(lower, Disc)
    assert x0 == x1 == pytest.approx(lower.center[0] + side * 15, abs=0.03)
    assert min(y0, y1) < lower.center[1] < max(y0, y1)


def test_a_ball_on_level_ground_gets_no_stop():
    assert upholding([Disc(np.array([50.0, -15.0]), 15.0)]) == ([], frozenset())
