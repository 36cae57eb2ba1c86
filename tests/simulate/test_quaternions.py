"""How spheres turn in space: closed forms, and another reader of rotations."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from worlds import ball, world

from physgen.scene.scene import Solid
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import (
    cumulative_quaternions,
    quaternions_from_vectors,
    rotation_matrices,
)

RNG = np.random.default_rng(4)


def test_turns_are_those_of_rodrigues() -> None:
    vectors = RNG.normal(size=(50, 3))
    for vector, found in zip(
        vectors, rotation_matrices(quaternions_from_vectors(vectors)), strict=True
    ):
        assert found == pytest.approx(cv2.Rodrigues(vector)[0], abs=1e-12)


def test_running_turns_are_products_in_order() -> None:
    vectors = RNG.normal(size=(37, 3, 3))
    start = quaternions_from_vectors(RNG.normal(size=(3, 3)))
    now = rotation_matrices(start)
    for vector, found in zip(
        vectors, cumulative_quaternions(vectors, start), strict=True
    ):
        now = rotation_matrices(quaternions_from_vectors(vector)) @ now
        assert rotation_matrices(found) == pytest.approx(now, abs=1e-12)


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
def test_a_ball_that_rolls_turns_by_its_way_over_its_radius(way) -> None:
    r, speed = 20.0, 150.0
    vx, vy = speed * np.array(way)
    scene = world(
        ball("a", 100, 100, r=r, v=(vx, vy), solid=Solid.SPHERE, k=0.4, roll=(vy / r, -vx / r)),
        gravity=(0, 0), press=980.0, table=0.3, duration=1.0,
    )  # fmt: skip
    t = simulate(scene, np.linspace(0, 1, 7))
    for k, time in enumerate(t.times):
        way_rolled = speed * time / r
        # the ball's lowest point, farthest from the viewer, moves against the way
        expected = cv2.Rodrigues(np.array([way[1], -way[0], 0.0]) * way_rolled)[0]
        assert rotation_matrices(t.turns[k, 0]) == pytest.approx(expected, abs=1e-6)


def test_a_spin_in_the_picture_alone_is_the_angle() -> None:
    scene = world(
        ball("a", 100, 100, solid=Solid.SPHERE, k=0.4, spin=3.0),
        gravity=(0, 0), press=980.0, table=0.3, duration=1.0,
    )  # fmt: skip
    t = simulate(scene, np.linspace(0, 1, 5))
    angle = t.poses[-1, 0, 2]
    assert angle == pytest.approx(3.0, rel=1e-6)
    assert rotation_matrices(t.turns[-1, 0])[:2, :2] == pytest.approx(
        np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]),
        abs=1e-9,
    )


@pytest.mark.parametrize(
    ("spin", "roll"),
    [(3.0, (0.0, 0.0)), (-3.0, (0.0, 5.0))],
    ids=["on the spot", "rolls"],
)
def test_rolling_resistance_brakes_the_spin_of_a_ball(
    spin: float, roll: tuple[float, float]
) -> None:
    """Evenly, down to rest: by c x normal force x radius over the moment. What is lost is friction's."""
    r, k, resistance, press = 20.0, 0.4, 0.02, 980.0
    scene = world(
        ball(
            "a", 100, 100, r=r, k=k, solid=Solid.SPHERE, rolling=resistance,
            spin=spin, v=(-r * roll[1], 0.0), roll=roll,
        ),
        gravity=(0, 0), press=press, table=0.3, duration=2.0,
    )  # fmt: skip
    t = simulate(scene, np.linspace(0, 2, 21))
    slows = resistance * press / (k * r)
    expected = np.sign(spin) * np.maximum(abs(spin) - slows * t.times, 0)
    assert t.velocities[:, 0, 2] == pytest.approx(expected, abs=slows / 960 + 1e-9)
    assert t.velocities[-1, 0, 2] == 0
    assert t.energy.kinetic + t.energy.dissipated == pytest.approx(
        t.energy.kinetic[0], rel=1e-3
    )
