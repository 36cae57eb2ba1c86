"""What holds for every world, whatever is in it; hypothesis draws the worlds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from worlds import ball, box, floor, world

from physgen.compile.world import World
from physgen.simulate.engine import simulate

number = st.floats(-1.0, 1.0, allow_nan=False, width=32)
bodies = st.lists(
    st.tuples(st.booleans(), *[number] * 6, st.floats(0.25, 1.0, width=32)),
    min_size=2,
    max_size=4,
)
elasticity = st.sampled_from([0.0, 0.3, 0.8, 1.0])
friction = st.sampled_from([0.0, 0.2, 0.9])


def drawn(rows, e, mu, **kwargs) -> World:
    """Balls and boxes on their own places, 90 px apart, thrown at each other."""
    made = []
    for k, (round_, dx, dy, vx, vy, spin, size, heavy) in enumerate(rows):
        x, y = 90.0 * (k % 2) + 10 * dx, 90.0 * (k // 2) + 10 * dy
        toward = np.array([45.0 - x, 45.0 - y])
        v = 3.0 * toward + 150 * np.array([vx, vy])
        common = {"mass": 100 * heavy, "v": v, "spin": 5 * spin, "e": e, "mu": mu}
        if round_:
            made.append(ball(f"b{k}", x, y, r=16 + 6 * size, **common))
        else:
            made.append(box(f"b{k}", x, y, w=34 + 8 * size, h=26.0, **common))
    return world(*made, rate=60, **kwargs)


def momenta(w: World, t) -> np.ndarray:
    """(T, 3): momentum and angular momentum about the origin."""
    m, moment = (
        np.array([b.mass for b in w.bodies]),
        np.array([b.moment for b in w.bodies]),
    )
    x, v = t.poses[:, :, :2], t.velocities
    turning = x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]
    return np.stack(
        [
            (m * v[..., 0]).sum(1),
            (m * v[..., 1]).sum(1),
            (m * turning + moment * v[..., 2]).sum(1),
        ],
        axis=1,
    )


@settings(max_examples=10)
@given(bodies, elasticity, friction)
def test_free_collisions_keep_momentum_and_angular_momentum(rows, e, mu) -> None:
    w = drawn(rows, e, mu, gravity=(0, 0))
    t = simulate(w)
    kept = momenta(w, t)
    speeds = np.abs(t.velocities[0, :, :2]).max() + 5 * 20
    scale = sum(b.mass for b in w.bodies) * speeds
    assert np.ptp(kept[:, :2], axis=0).max() < 1e-6 * scale
    # blows keep it to the last digits; bodies that go on pressing overlap by 0.005 px, which is their forces' lever
    assert np.ptp(kept[:, 2]) < 2e-4 * scale * 90


@settings(max_examples=10)
@given(bodies, elasticity, friction, st.booleans())
def test_energy_never_grows_without_a_force(rows, e, mu, falling) -> None:
    w = drawn(
        rows,
        e,
        mu,
        gravity=(0, 980.0 if falling else 0.0),
        walls=[floor(y=260, e=e, mu=mu)],
    )
    t = simulate(w)
    total = t.energy.kinetic + t.energy.potential
    scale = t.energy.kinetic.max()
    assert (np.diff(total) < 1e-3 * scale).all()
    assert (np.diff(t.energy.dissipated) > -1e-3 * scale).all()
    balance = total + t.energy.dissipated - t.energy.work
    assert np.ptp(balance) < 0.01 * scale


@settings(max_examples=10)
@given(bodies, elasticity, friction)
def test_mirrored_scenes_give_mirrored_motion(rows, e, mu) -> None:
    w = drawn(rows, e, mu, walls=[floor(y=260, e=e, mu=mu)], duration=0.4)
    flip = np.array([-1.0, 1.0])

    def mirrored(body):
        pieces = tuple(
            np.ascontiguousarray((piece * flip)[::-1]) for piece in body.pieces
        )
        return replace(
            body,
            center=body.center * flip,
            velocity=body.velocity * flip,
            spin=-body.spin,
            pieces=pieces,
        )

    walls = tuple(
        replace(wall, chains=tuple(chain * flip for chain in wall.chains))
        for wall in w.walls
    )
    there = simulate(replace(w, bodies=tuple(map(mirrored, w.bodies)), walls=walls))
    here = simulate(w)
    assert there.poses * [-1, 1, -1] == pytest.approx(here.poses, abs=2e-3)


@settings(max_examples=8, phases=[Phase.explicit, Phase.generate])
@given(bodies, elasticity, friction, st.sampled_from([0.5, 2.0, 4.0]))
def test_scaled_length_and_time_give_the_same_motion(rows, e, mu, scale) -> None:
    w = drawn(rows, e, mu, walls=[floor(y=260, e=e, mu=mu)], duration=0.4)
    slow = scale**0.5  # under the same gravity, lengths go as the square of times

    def grown(body):
        return replace(
            body,
            center=body.center * scale,
            velocity=body.velocity * slow,
            spin=body.spin / slow,
            radius=None if body.radius is None else body.radius * scale,
            pieces=tuple(piece * scale for piece in body.pieces),
            moment=body.moment * scale**2,
        )

    large = replace(
        w,
        bodies=tuple(map(grown, w.bodies)),
        walls=tuple(
            replace(wall, chains=tuple(chain * scale for chain in wall.chains))
            for wall in w.walls
        ),
        duration=w.duration * slow,
        steps_per_second=w.steps_per_second / slow,
        times=w.times * slow,
    )
    a, b = simulate(w), simulate(large)
    # impacts at one moment may fall in another order, and amplify rounding
    assert b.poses / [scale, scale, 1] == pytest.approx(a.poses, abs=0.5)
