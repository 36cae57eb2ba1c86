"""The engine in small worlds built by hand. benchmarks/physics holds it to the closed forms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pytest import approx
from worlds import GRAVITY, ball, box, floor, push, world

from physgen import pipeline
from physgen.problems import InputError
from physgen.scene.scene import Load, Motion, Solid
from physgen.simulate.engine import simulate
from physgen.simulate.trajectory import read_trajectory


def test_loads_change_momentum_as_newton_says() -> None:
    free = {"gravity": (0, 0)}
    t = simulate(
        world(ball("a", 0, 0), pushes=[push(Load.IMPULSE, (3e4, -1e4))], **free)
    )
    assert t.velocities[-1, 0, :2] == approx([300, -100])
    t = simulate(
        world(ball("a", 0, 0), pushes=[push(Load.IMPULSE, (3e4, 0), start=0.5)], **free)
    )
    assert t.velocities[[0, 14, -1], 0, 0] == approx([0, 0, 300])
    t = simulate(
        world(
            ball("a", 0, 0),
            pushes=[push(Load.TORQUE, torque=1e6, start=0.2, end=0.7)],
            **free,
        )
    )
    assert t.velocities[-1, 0, 2] == approx(1e6 * 0.5 / (100 * 200))


def test_scripted_body_follows_its_path_and_pushes() -> None:
    pusher = box(
        "pusher",
        0,
        0,
        motion=Motion.SCRIPTED,
        path=[(0, 0, 0, 0), (0.5, 100, 0, 0), (2, 100, 0, 0)],
    )
    t = simulate(world(pusher, ball("a", 60, 0, e=0, mu=0), gravity=(0, 0)))
    x = t.poses[:, 0, 0]
    assert x == approx(np.interp(t.times, [0, 0.5], [0, 100]), abs=0.3)
    assert t.velocities[-1, 1, 0] == approx(200, rel=1e-2)


def test_samples_do_not_change_the_motion() -> None:
    scene = world(box("a", 100, 300, spin=2.0), walls=[floor()], duration=1)
    coarse, fine = simulate(scene), simulate(scene, np.arange(121) / 120)
    assert np.array_equal(coarse.poses, fine.poses[::4])


def test_contacts_name_who_touched_and_when() -> None:
    t = simulate(world(ball("a", 100, 280, e=0), walls=[floor(e=0)], duration=1))
    assert t.contacts.surfaces == ("a", "floor")
    assert t.contacts.touch_pairs.tolist() == [[0, 1]]
    begin, end = t.contacts.touch_times[0]
    assert begin == approx(np.sqrt(2 * 100 / GRAVITY), abs=2 / 960)
    assert np.isinf(end)
    rows, j = t.contacts.impulse_rows, t.contacts.impulses
    resting = j[rows[:, 0] == 20][0]
    assert resting == approx([0, -100 * GRAVITY / 30], rel=1e-3, abs=1)


def test_static_bodies_stay_and_are_listed_in_place() -> None:
    t = simulate(
        world(
            ball("a", 0, 0),
            box("s", 0, 200, motion=Motion.STATIC),
            ball("b", 300, 0),
            duration=0.5,
        )
    )
    assert np.array_equal(t.poses[:, 1], np.tile([0, 200, 0], (len(t.times), 1)))
    assert t.poses[-1, 2, 1] == approx(GRAVITY * 0.125, rel=5e-3)
    assert t.poses[0, 2, 0] == 300


def test_archive_reads_back_and_repeats_its_bytes(tmp_path: Path) -> None:
    scene = world(
        *(ball(f"b{k}", 40.3 * k, 380 - 41 * (k % 3), e=0.5) for k in range(9)),
        walls=[floor()],
    )
    simulate(scene).save(tmp_path / "a.npz")
    simulate(scene).save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back, now = read_trajectory(tmp_path / "a.npz"), simulate(scene)
    assert back.names == now.names
    for name, array in now.as_arrays().items():
        assert np.array_equal(back.as_arrays()[name], array), name


def test_samples_inside_a_contact_step_are_before_or_after_it() -> None:
    wall = floor(y=100, e=1)
    t = simulate(
        world(
            ball("a", 0, 40, v=(0, 300), e=1),
            walls=[wall],
            gravity=(0, 0),
            rate=10000,
            duration=0.5,
        )
    )
    assert np.abs(np.abs(t.velocities[:, 0, 1]) - 300).max() < 1e-6
    assert np.ptp(t.energy.kinetic) < 1e-6 * t.energy.kinetic[0]
    t = simulate(
        world(ball("a", 0, 300, e=1), walls=[floor(e=1)], rate=1000, duration=2)
    )
    total = t.energy.kinetic + t.energy.potential + t.energy.dissipated
    assert np.ptp(total) < 0.01 * t.energy.kinetic.max()


def test_motion_beyond_all_numbers_is_told() -> None:
    light = ball("a", 0, 0, mass=1e-300, v=(1e12, 0))
    with pytest.raises(
        InputError, match=r"objects\.a: becomes larger than any number by t ="
    ):
        simulate(world(light, pushes=[push(Load.FORCE, (1e12, 0))]))


@pytest.mark.parametrize("solid", [Solid.SPHERE, Solid.DISC, Solid.HOOP])
def test_many_bodies_on_a_table_move_as_one_does(solid: Solid) -> None:
    """Arrays and plain numbers: sliding, spinning and, at last, at rest."""
    first = ball("a", 0, 0, v=(250, 40), spin=9.0, mu=0.4, rolling=0.05, solid=solid)
    many = [
        replace(first, name=f"b{k}", center=np.array([0, 1000.0 * k]))
        for k in range(12)
    ]
    flat = {"gravity": (0, 0), "press": GRAVITY, "table": 0.3, "duration": 2.0}
    one, all_ = simulate(world(first, **flat)), simulate(world(*many, **flat))
    assert np.abs(one.velocities[-1]).max() < (150 if solid is Solid.SPHERE else 1e-9)
    for k in range(12):
        assert all_.velocities[:, k] == approx(one.velocities[:, 0], abs=1e-3)
        assert all_.rolls[:, k] == approx(one.rolls[:, 0], abs=1e-4)


def test_a_pinned_disc_is_braked_along_its_circle(tmp_path: Path) -> None:
    """Friction mu m g against the way turns R from the pin: the circle ends after w0^2 R / (2 mu g k) rad, where
    w0 = k v / R, and k = R^2 / (R^2 + r^2 / 2) is the disc's share of its moment about the pin."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 400]\n"
        "world: {view: top, pixels_per_meter: 800, duration: 1, table: {friction: 0.2}}\n"
        "objects:\n  a: {shape: {circle: {center: [250, 200], radius: 3}}, friction: 0.2, velocity: [0, 700]}\n"
        "joints: {pin: {objects: [a], pivot: [200, 200]}}\n"
    )
    x, y = (
        simulate(pipeline.compile(pipeline.load(path), None).world).poses[:, 0, :2]
        - 200
    ).T
    angle = np.unwrap(np.arctan2(y, x))
    k = 50**2 / (50**2 + 3**2 / 2)
    assert angle[-1] == approx(
        (k * 700 / 50) ** 2 * 50 / (2 * 0.2 * 9.8 * 800 * k), rel=3e-3
    )
    assert np.hypot(x, y) == approx(50, abs=0.01)
