"""Starts that trip engines: photos' piles and racks, chains of blows, fast and thin things, keys in any order."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pytest import approx
from worlds import ball, box, floor, pin, push, world

from physgen import pipeline
from physgen.compile.world import Field, Wall, surface
from physgen.problems import InputError
from physgen.scene.scene import Combine, FieldKind, JointKind, Load, Motion, Solid
from physgen.simulate import collisions
from physgen.simulate.engine import simulate

SCENES = Path(__file__).resolve().parents[2] / "scenes"


def moved(t) -> dict[str, float]:
    """px by which each object strayed from where it was."""
    far = np.hypot(*(t.poses - t.poses[0])[:, :, :2].T).max(axis=1)
    return dict(zip(t.names, far.tolist(), strict=True))


# ---- photos ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pile(tmp_path_factory) -> Path:
    """The peer boxes as perceived from their masks, and a second scene on the annotated line of support."""
    source = Path(os.environ["PHYSGEN_PEER_SCENES"]) / "boxes"
    file = tmp_path_factory.mktemp("pile") / "boxes.yaml"
    pipeline.perceive(source / "original.png", file, masks=source / "mask.png")
    ids = sorted(item.mask.id for item in pipeline.load(file).objects)
    rows = "".join(f"  b{i}: {{mask: {i}}}\n" for i in ids)
    # masks alone: the stored outlines were fitted to the floor that perception found
    (file.parent / "line.assets").mkdir()
    shutil.copy(file.parent / "boxes.assets" / "masks.png", file.parent / "line.assets")
    (file.parent / "line.yaml").write_text(
        f"physgen: 1\nimage: {pipeline.load(file).image.relative_to(file.parent)}\nassets: line.assets\n"
        f"objects:\n{rows}boundaries:\n  table: {{segment: [[-0.5, 458.7], [511.5, 466.8]]}}\n"
    )
    return file


def run(file: Path, *overrides: str):
    """The motion without the push that perception chose."""
    scene = pipeline.load(file, ("objects.*.velocity=[0, 0]", *overrides))
    return pipeline.simulate(pipeline.compile(scene, pipeline.percepts(scene)).world)


def rows_of(file: Path) -> list[list[str]]:
    """Names of the pile's rows from the top, each from the left."""
    scene = pipeline.load(file)
    bodies = pipeline.compile(scene, pipeline.percepts(scene)).world.bodies
    down = sorted(bodies, key=lambda body: body.center[1])
    ends = [0, 1, 3, 6, 10, 15, 21]
    return [
        [b.name for b in sorted(down[i:j], key=lambda b: b.center[0])]
        for i, j in pairwise(ends)
    ]


@pytest.mark.slow
@pytest.mark.peer_scenes
def test_a_real_pile_stands(pile) -> None:
    assert max(moved(run(pile)).values()) < 0.25
    # outlines, true to 0.75 px, stand on a line that they were not fitted to: blocks settle by a fraction of that
    assert max(moved(run(pile.parent / "line.yaml")).values()) < 0.25


@pytest.mark.slow
@pytest.mark.peer_scenes
@pytest.mark.parametrize("corner", [(0, 1), (4, 5)])
def test_a_real_pile_falls_where_its_corner_is_taken_away(pile, corner) -> None:
    rows = rows_of(pile)
    gone = [rows[5][k] for k in corner]
    far = moved(run(pile, *(f"objects.{name}=null" for name in gone)))
    lost = rows[4][0 if corner[0] == 0 else 4]
    assert far.pop(lost) > 20
    assert max(far.values()) < 1


@pytest.mark.slow
@pytest.mark.peer_scenes
def test_a_real_rack_rests(tmp_path) -> None:
    source = Path(os.environ["PHYSGEN_PEER_SCENES"]) / "pool"
    pipeline.import_physgen(source, tmp_path / "pool.yaml")
    t = run(
        tmp_path / "pool.yaml",
        "forces=[]",
        "objects.*.velocity=[0, 0]",
        "world.duration=2",
    )
    assert max(moved(t).values()) < 0.5


# ---- blows -------------------------------------------------------------------------------------------------------


def test_a_blow_on_a_rod_moves_all_that_is_pinned_to_it() -> None:
    # two equal boxes welded side by side, hit in line: as one body of twice the mass
    halves = [box("left", 0, 0), box("right", 40, 0)]
    weld = pin(0, 1, at=(20, 0), to=(-20, 0), kind=JointKind.WELD)
    thrown = ball("ball", -140, 0, v=(300, 0), e=0.5, mu=0)
    t = simulate(world(*halves, thrown, joints=[weld], gravity=(0, 0)))
    e = np.sqrt(0.4 * 0.5)
    assert t.velocities[-1, 2, 0] == approx(300 * (100 - e * 200) / 300, rel=1e-3)
    assert t.velocities[-1, :2, 0] == approx(300 * 100 * (1 + e) / 300, rel=1e-3)


def test_a_blow_on_a_pinned_bar_turns_it() -> None:
    bar = box("bar", 0, 100, w=10, h=200, mass=300)
    thrown = ball("ball", -100, 180, v=(300, 0), mass=50, e=1, mu=0)
    t = simulate(
        world(
            replace(bar, surface=surface(0, 1, Combine.GEOMETRIC)),
            thrown,
            joints=[pin(at=(0, -100))],
            gravity=(0, 0),
        )
    )
    moment = 300 * (100 + 200**2) / 12 + 300 * 100**2
    spin = 2 * 50 * 300 * 180 / (moment + 50 * 180**2)
    first = int(np.flatnonzero(np.abs(t.velocities[:, 0, 2]) > 0.1)[0])
    assert abs(t.velocities[first, 0, 2]) == approx(spin, rel=2e-3)


def test_nothing_fast_passes_through_a_line() -> None:
    wall = Wall(
        "wall",
        (np.array([[500.0, -4e4], [500.0, 4e4]]),),
        surface(0, 1, Combine.GEOMETRIC),
    )
    for speed in (4e3, 4e4, 4e5):
        t = simulate(
            world(
                ball("a", 0, 0, r=4, v=(speed, 3), e=1, mu=0),
                walls=[wall],
                gravity=(0, 0),
                duration=0.3,
            )
        )
        assert t.poses[-1, 0, 0] < 500
        assert t.velocities[-1, 0, 0] == approx(-speed)
    assert t.effort.divided > 0
    assert t.effort.most_parts > 10


# ---- the same bytes ----------------------------------------------------------------------------------------------


def test_the_order_of_keys_does_not_change_a_byte(tmp_path) -> None:
    things = [
        f"b{k}: {{shape: {{box: {{center: [{60 + 41 * (k % 4)}, {300 - 45 * (k // 4)}], size: [40, 40]}}}}}}"
        for k in range(8)
    ]
    walls = [
        f"w{k}: {{segment: [[{300 * k - 300}, 330], [{300 * k}, 330]]}}"
        for k in range(3)
    ]
    head = "physgen: 1\nsize: [300, 400]\n"
    texts = []
    for order in (1, -1):
        objects = "objects:\n" + "".join(f"  {line}\n" for line in things[::order])
        boundaries = "boundaries:\n" + "".join(f"  {line}\n" for line in walls[::order])
        texts.append(
            head + (objects + boundaries if order > 0 else boundaries + objects)
        )
    saved = []
    for k, text in enumerate(texts):
        (tmp_path / f"{k}.yaml").write_text(text)
        run(tmp_path / f"{k}.yaml").save(tmp_path / f"{k}.npz")
        saved.append((tmp_path / f"{k}.npz").read_bytes())
    assert saved[0] == saved[1]


# ---- the books ---------------------------------------------------------------------------------------------------


def busy_worlds():
    spring = pin(0, 1, kind=JointKind.SPRING, length=80.0, stiffness=4e4, damping=300.0)
    yield (
        "spring",
        world(
            ball("a", 0, 100, e=0.3),
            ball("b", 130, 60, e=0.3),
            walls=[floor(y=200)],
            joints=[spring],
        ),
    )
    motor = pin(kind=JointKind.MOTOR, to=(0, 0), speed=20.0, limit=4e6)
    yield (
        "motor",
        world(box("fan", 0, 0, w=120, h=12), ball("a", 45, -90, e=0.6), joints=[motor]),
    )
    wind = Field("wind", FieldKind.WIND, (0, 1), np.array([300.0, 0.0]), 5e-3, 0.0, 0.0)
    pull = Field(
        "pull", FieldKind.ATTRACTOR, (0, 1), np.array([100.0, 150.0]), 0.0, 3e7, 10.0
    )
    yield (
        "fields",
        world(
            ball("a", 0, 0, e=0.5),
            box("b", 100, 40),
            walls=[floor(y=200)],
            fields=[wind, pull],
        ),
    )
    path = [(0, 0, 60, 0), (0.4, 120, 60, 0.4), (0.8, 40, 60, 0), (1, 40, 60, 0)]
    paddle = box("paddle", 0, 60, w=20, h=80, motion=Motion.SCRIPTED, path=path)
    yield (
        "paddle",
        world(
            paddle, ball("a", 60, 60, e=0.8), ball("b", 130, 60), walls=[floor(y=120)]
        ),
    )
    rolling = ball(
        "a",
        0,
        0,
        v=(400, 60),
        k=0.4,
        solid=Solid.SPHERE,
        roll=(0.0, 5.0),
        rolling=0.02,
        spin=4.0,
    )
    sliding = box("b", 120, 10, v=(-200, 0), spin=9.0)
    yield (
        "table",
        world(rolling, sliding, gravity=(0, 0), press=980.0, table=0.3, duration=2.0),
    )
    shove = push(Load.FORCE, (3e5, -1e5), at=(20, -20), start=0.1, end=0.3)
    yield "shove", world(box("a", 0, 180, mu=0.3), walls=[floor(y=200)], pushes=[shove])


@pytest.mark.parametrize(("name", "scene"), list(busy_worlds()))
def test_energy_is_accounted_for(name, scene) -> None:
    t = simulate(scene, np.arange(int(scene.duration * 240) + 1) / 240)
    assert t.imbalance() < 0.01, name
    assert (np.diff(t.energy.dissipated) > -1e-3 * t.energy.kinetic.max()).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["billiards", "dominoes", "kitchen"])
def test_energy_of_the_bundled_scenes_is_accounted_for(name) -> None:
    scene = pipeline.load(SCENES / name / "scene.yaml")
    world = pipeline.compile(scene, pipeline.percepts(scene)).world
    assert pipeline.simulate(world).imbalance() < 0.005
    assert (
        pipeline.simulate(world, rate=960).imbalance() < 0.03
    )  # a step in the middle of a blow counts half of it


def test_what_overlaps_is_lifted_by_work() -> None:
    """2 px of overlap with the floor go without a velocity: neither heat nor motion."""
    t = simulate(world(box("a", 0, 182), walls=[floor(y=200)], duration=2.0))
    e, risen = t.energy, 182 - t.poses[-1, 0, 1]
    assert risen > 1
    assert e.potential[-1] - e.potential[0] == pytest.approx(
        t.energy.work[-1], rel=0.02
    )
    assert max(e.kinetic.max(), e.dissipated.max()) < 0.01 * e.work[-1]


# ---- what a review found --------------------------------------------------------------------------------------------


def chain(kind, bodies, anchor, links):
    """Joints from the world at `anchor` to the first body, then from each to the next at the points `links`."""
    joints = [
        pin(0, None, at=np.array(anchor) - bodies[0].center, to=anchor, kind=kind)
    ]
    return joints + [
        pin(
            k,
            k + 1,
            at=np.array(p) - bodies[k].center,
            to=np.array(p) - bodies[k + 1].center,
            kind=kind,
        )
        for k, p in enumerate(links)
    ]


def test_a_chain_with_a_heavy_load_keeps_its_energy() -> None:
    links = [box(f"l{k:02}", 20 + 40 * k, 100, w=40, h=8, mass=20) for k in range(12)]
    load = ball("load", 490, 100, r=15, mass=5000)
    joints = chain(
        JointKind.PIVOT,
        [*links, load],
        (0, 100),
        [(40 * (k + 1), 100) for k in range(12)],
    )
    t = simulate(world(*links, load, joints=joints, duration=2))
    assert t.imbalance() < 1e-3


@pytest.mark.parametrize("force", [1e8, 1e9])
def test_a_sudden_force_does_not_push_through_a_line(force) -> None:
    wall = Wall(
        "wall",
        (np.array([[400.0, -900.0], [400.0, 900.0]]),),
        surface(0.5, 0.5, Combine.GEOMETRIC),
    )
    shove = push(Load.FORCE, (force, 0), start=0.0101, end=0.02)
    t = simulate(
        world(
            ball("a", 330, 0, r=2, mass=10),
            walls=[wall],
            pushes=[shove],
            gravity=(0, 0),
            duration=0.1,
        )
    )
    assert t.poses[:, 0, 0].max() < 400


def test_a_spring_too_stiff_for_any_step_is_refused_by_name() -> None:
    stiff = pin(kind=JointKind.SPRING, length=100.0, stiffness=1e14)
    with pytest.raises(
        InputError, match=r"joints\.joint\.stiffness: needs every step divided"
    ):
        simulate(world(ball("a", 100, 0, mass=1), joints=[stiff]))


@pytest.mark.parametrize("rate", [30.0, 37.0, 1000.0])
def test_impulses_up_to_a_sample_are_the_change_of_momentum(rate) -> None:
    bouncing = ball("a", 0, 200, v=(50, 0), e=0.9, mu=0.0)
    scene = world(
        bouncing,
        walls=[floor(e=0.9, mu=0.0)],
        gravity=(0, 0),
        pushes=[push(Load.IMPULSE, (0, 4e4))],
    )
    t = simulate(scene, np.arange(int(rate) + 1) / rate)
    given = np.zeros((len(t.times), 2))
    np.add.at(given, t.contacts.impulse_rows[:, 0], t.contacts.impulses)
    change = 100 * (t.velocities[:, 0, :2] - t.velocities[0, 0, :2])
    assert np.cumsum(given, axis=0) == approx(change, abs=1.0)


@pytest.mark.slow
def test_where_pieces_of_a_body_lie_in_memory_does_not_matter() -> None:
    """Concave bodies and bent walls: several contacts of one pair, some at one corner."""
    sides = [(-34, -30, 12, 60), (34, -30, 12, 60), (0, -6, 56, 12)]
    pieces = tuple(
        np.array(
            [
                [x - w / 2, y - h / 2],
                [x + w / 2, y - h / 2],
                [x + w / 2, y + h / 2],
                [x - w / 2, y + h / 2],
            ]
        )
        for x, y, w, h in sides
    )
    cups = [
        replace(
            box(f"cup{k}", 90 + 100 * k, 300 - 20 * (k % 2), e=0.3, spin=0.4 * k - 0.8),
            pieces=pieces,
        )
        for k in range(5)
    ]
    balls = [
        ball(f"b{k}{m}", 90 + 100 * k + 3 * m, 200 - 45 * m, r=12, e=0.6)
        for k in range(5)
        for m in range(2)
    ]
    bent = np.array(
        [[20.0, 0.0], [20, 320], [200, 330], [350, 330], [600, 320], [600, 0]]
    )
    trough = Wall("trough", (bent,), surface(0.5, 0.3, Combine.GEOMETRIC))
    busy = world(*cups, *balls, walls=[trough])
    hashes, dirt = set(), []
    for run in range(4):
        hashes.add(simulate(busy).sample_hashes()[-1])
        dirt.append([np.full(n, 1e300) for n in range(1 + run, 2000, 7)])
    assert len(hashes) == 1


def test_dense_impacts_are_solved_to_the_same_bit(monkeypatch) -> None:
    random = np.random.default_rng(0)
    for points in (25, 60):
        jacobian = random.normal(size=(2 * points, 9))
        matrix = jacobian @ jacobian.T + 1e-3 * np.eye(2 * points)
        before = random.normal(size=2 * points)
        arguments = matrix, before, [0.3] * points, [0.5] * points, 1e-13
        dense, passes = collisions.simultaneous_impulses(*arguments)
        with monkeypatch.context() as patch:
            sparse = replace(collisions.TUNING, dense_count=10**9)
            patch.setattr(collisions, "TUNING", sparse)
            listed, same_passes = collisions.simultaneous_impulses(*arguments)
        assert np.array_equal(dense, listed)
        assert passes == same_passes
