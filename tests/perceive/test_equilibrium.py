"""What stands by the balance of forces, against what nature and closed forms say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.support.equilibrium import (
    MANY,
    TILTED,
    UNHELD,
    contacts,
    unbalanced_forces,
    unstable_objects,
)
from tests.perceive.lambertian import block

GROUND = np.array([[-500.0, 0.0], [900.0, 0.0]])


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    a = np.radians(degrees)
    return points @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


@pytest.mark.parametrize("degrees", [-35, -20, -8, 8, 20, 35])
def test_a_block_slips_where_the_slope_is_steeper_than_friction(degrees):
    outline = Region((Ring(turned(block(0, 0, 60, 16).rings[0].outer, degrees)),))
    found = contacts([outline], [turned(GROUND, degrees)])
    limit = np.tan(np.radians(abs(degrees)))
    sure = np.tan(np.radians(abs(degrees)) + TILTED)
    assert unstable_objects([outline], found, {}, default=0.97 * limit) == [0]
    assert unstable_objects([outline], found, {}, default=1.03 * sure) == []


def test_a_tall_block_tips_on_a_slope_that_would_hold_it():
    for height, stands in (
        (30, True),
        (90, False),
    ):  # tan 20 degrees is 0.36: width over height
        outline = Region((Ring(turned(block(0, 0, 20, height).rings[0].outer, 20)),))
        found = contacts([outline], [turned(GROUND, 20)])
        assert (unstable_objects([outline], found, {}, default=2.0) == []) is stands


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(
    ("over", "stands"), [(0.3, True), (0.44, True), (0.56, False), (0.7, False)]
)
def test_a_block_over_an_edge_by_more_than_half_falls(side, over, stands):
    edge = np.array([[-300.0, 0.0], [0.0, 0.0]]) * (side, 1)
    x = -100 * (1 - over) if side > 0 else -100 * over
    outline = block(x, 0, 100, 20)
    assert (
        unstable_objects([outline], contacts([outline], [edge]), {}) == []
    ) is stands


def bricks(rows: int, across: int) -> list[Region]:
    return [
        block(24 * k + 12 * (row % 2), -12 * row, 24, 12)
        for row in range(rows)
        for k in range(across)
    ]


def test_a_ball_stands_on_the_floor_and_between_two_but_not_on_one():
    low, right, above = (
        Disc(np.array(at, float), 10.0)
        for at in ((0, -10), (20, -10), (10, -10 - 300**0.5))
    )
    top = Disc(np.array([0.0, -30.0]), 10.0)
    stop = (
        np.array([[30.0, -20.0], [30.0, 0.0]]),
        np.array([[-10.0, -20.0], [-10.0, 0.0]]),
    )
    pair, three = [low, top], [low, right, above]
    assert unstable_objects(pair, contacts(pair, [GROUND]), {}) == [1]
    assert unstable_objects(three, contacts(three, [GROUND, *stop]), {}) == []


def test_a_large_pile_stands_and_only_what_lacks_support_is_held():
    pile = bricks(8, 8)
    assert len(pile) > MANY
    assert unstable_objects(pile, contacts(pile, [GROUND]), {}) == []
    overhang = block(24 * 8, -12 * 8, 60, 12)  # on the last of the top row by a fifth
    more = [*pile, overhang]
    assert unstable_objects(more, contacts(more, [GROUND]), {}) == [len(pile)]
    short = np.array([[-10.0, 0.0], [100.0, 0.0]])
    held = unstable_objects(pile, contacts(pile, [short]), {})
    assert held
    assert unstable_objects(pile, contacts(pile, [short]), {}, held_ids=held) == []


def test_scipy_leaves_the_same_unbalanced():
    rng = np.random.default_rng(3)
    for count, columns in ((4, 9), (12, 30), (20, 90)):
        pairs = np.stack(
            [rng.integers(0, count, columns), rng.integers(-1, count, columns)], 1
        )
        pairs[pairs[:, 0] == pairs[:, 1], 1] = -1
        parts = rng.normal(size=(columns, 2, 3)) * (pairs >= 0)[:, :, None]
        matrix = np.zeros((3 * count, columns))
        for m, (both, part) in enumerate(zip(pairs, parts, strict=True)):
            for i, three in zip(both, part, strict=True):
                if i >= 0:
                    matrix[3 * i : 3 * i + 3, m] += three
        wanted = rng.normal(size=(count, 3))
        rest = wanted.ravel() - matrix @ nnls(matrix, wanted.ravel())[0]
        assert unbalanced_forces(pairs, parts, wanted).ravel() == pytest.approx(
            rest, abs=UNHELD / 2
        )
