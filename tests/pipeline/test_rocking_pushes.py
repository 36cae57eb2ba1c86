"""Pushes at the top of objects, which rock on their foot and settle."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from math import atan2, degrees
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.shapes import shapes_of
from physgen.perceive.roles import PerceivedScene
from physgen.pipeline.push_choice import round_ends
from physgen.pipeline.push_motion import tipping_motion
from physgen.pipeline.push_outcomes import TRIAL, Candidate, Grade, TrialScene
from physgen.pipeline.push_tips import SWAY, Hand
from physgen.pipeline.push_trials import choose_push, compile_trials, simulate_push
from physgen.simulate.engine import simulate

WIDTH, HEIGHT = 80, 70


def box_trials(
    tmp_path: Path,
    size: str,
    motion: str = "",
    round_ends: Collection[tuple[str, str]] = (),
    friction: float = 0.8,
) -> TrialScene:
    """Compile a lone box of a size, px, on a floor in the side view."""
    height = float(size.strip("[]").split(",")[1])
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 300]\nworld: {pixels_per_meter: 800}\n"
        f"objects: {{box: {{shape: {{box: {{center: [200, {250 - height / 2}], "
        f"size: {size}}}}}, friction: {friction}, elasticity: 0{motion}}}}}\n"
        "boundaries: {floor: {segment: [[-400, 250], [800, 250]], "
        f"friction: {friction}}}}}\n"
    )
    scene = pipeline.load(path)
    return compile_trials(scene, shapes_of(scene, None), round_ends=round_ends)


@pytest.mark.parametrize(("side", "ramp"), [(1.0, 0.0), (-1.0, 0.0), (1.0, 0.05)])
def test_tipping_motion_reaches_its_angle(
    tmp_path: Path, side: float, ramp: float
) -> None:
    trials = box_trials(tmp_path, f"[{WIDTH}, {HEIGHT}]")
    gravity = float(np.hypot(*trials.world.gravity))
    (x, y), spin = tipping_motion(trials.world.bodies[0], side, 8.0, gravity, ramp)
    edits = [f"objects.box.velocity=[{x}, {y}]", f"objects.box.spin={spin}"]
    edits.append(f"world.ramp={ramp}")
    scene = pipeline.load(tmp_path / "scene.yaml", edits)
    world = pipeline.compile(scene, None).world
    turns = np.degrees(simulate(world, np.linspace(0, 2, 241)).poses[:, 0, 2])
    assert (side * turns).max() == pytest.approx(8.0, abs=0.5)
    assert abs(turns[-1]) < 0.5


def test_tipping_stays_below_the_fall(tmp_path: Path) -> None:
    trials = box_trials(tmp_path, "[20, 150]")
    gravity = float(np.hypot(*trials.world.gravity))
    body = trials.world.bodies[0]
    motion = tipping_motion(body, 1.0, 45.0, gravity, 0.0)
    falling_angle = degrees(atan2(10, 75))
    assert motion == tipping_motion(
        body, 1.0, TRIAL.rocks_most * falling_angle, gravity, 0.0
    )


def test_lone_object_rocks_and_settles(tmp_path: Path) -> None:
    trials = box_trials(tmp_path, f"[{WIDTH}, {HEIGHT}]")
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.spin
    assert chosen.outcome.grade is Grade.STORY


@pytest.mark.parametrize("more", [", facing: left", ", motion: static"])
def test_vehicles_and_held_objects_never_rock(tmp_path: Path, more: str) -> None:
    trials = box_trials(tmp_path, f"[{WIDTH}, {HEIGHT}]", more)
    chosen = choose_push(trials, {}, {})
    assert chosen is None or not chosen.spin


def first_tip(trials: TrialScene) -> float:
    """Return the rotation, degrees, by the first push at the top of the box."""

    def attempt(candidate: Candidate) -> Candidate:
        push, spin = {"box": candidate.velocity}, {"box": candidate.spin}
        outcome = simulate_push(trials, push, None, candidate.ramp, spin)
        return replace(candidate, outcome=outcome)

    hand = Hand(trials, trials.scene.objects[0], 1.0, is_vehicle=False)
    return next(hand.tips(attempt)).outcome.turn


def test_a_tip_lifts_no_side_too_high(tmp_path: Path) -> None:
    narrow, wide = 60, 160
    narrow_trials = box_trials(tmp_path, f"[{narrow}, 150]")
    wide_trials = box_trials(tmp_path, f"[{wide}, 150]")
    wide_turn = first_tip(wide_trials)
    assert first_tip(narrow_trials) > 1.1 * wide_turn
    lift = np.sin(np.radians(wide_turn)) * wide / wide_trials.side
    assert lift == pytest.approx(SWAY.tip_lift, rel=0.15)


def test_flat_object_slides(tmp_path: Path) -> None:
    chosen = choose_push(box_trials(tmp_path, "[120, 20]"), {}, {})
    assert chosen is not None
    assert not chosen.spin


@pytest.mark.parametrize("size", ["[120, 50]", "[90, 60]"])
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_wide_object_sways_by_a_small_angle(
    tmp_path: Path, size: str, friction: float
) -> None:
    trials = box_trials(tmp_path, size, friction=friction)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.spin
    assert chosen.outcome.grade >= Grade.SHORT
    velocity = [round(part, 1) for part in chosen.velocity]
    edits = [f"objects.box.velocity={velocity}", f"objects.box.spin={chosen.spin}"]
    edits.append(f"world.ramp={chosen.ramp}")
    scene = pipeline.load(tmp_path / "scene.yaml", edits)
    world = pipeline.compile(scene, None).world
    turns = np.degrees(simulate(world, np.linspace(0, 2, 241)).poses[:, 0, 2])
    assert 1.0 < abs(turns).max() < 2 * SWAY.turn
    assert abs(turns[-1]) < 0.2


def test_object_that_fills_the_picture_stays_inside(tmp_path: Path) -> None:
    chosen = choose_push(box_trials(tmp_path, "[370, 200]"), {}, {})
    assert chosen is not None
    assert chosen.spin
    assert chosen.outcome.grade is Grade.SHORT


def test_object_tips_only_over_a_visible_end(tmp_path: Path) -> None:
    ends = [("box", "right")]
    chosen = choose_push(box_trials(tmp_path, f"[{WIDTH}, {HEIGHT}]", "", ends), {}, {})
    assert chosen is not None
    assert chosen.spin < 0


def test_object_with_a_round_foot_sways_less(tmp_path: Path) -> None:
    trials = box_trials(
        tmp_path, f"[{WIDTH}, {HEIGHT}]", round_ends=[("box", "left"), ("box", "right")]
    )
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.spin
    assert chosen.outcome.turn <= SWAY.range[1] * SWAY.round_turn


@pytest.mark.parametrize("is_round", [True, False])
def test_foot_is_round_above_the_ends_of_its_base(is_round: bool) -> None:
    rows, columns = np.mgrid[:100, :100]
    disc = np.hypot(columns - 50, rows - 50) <= 40
    base = (abs(columns - 50) <= 25) & (rows >= 50) & (rows <= 90)
    labels = (disc if is_round else disc | base).astype(np.uint16)
    polygon = [[10, 50], [50, 10], [90, 50], [75, 90], [25, 90]]
    objects = {"toy": {"mask": 1, "shape": {"polygon": polygon}}}
    perceived = SimpleNamespace(
        document={"objects": objects}, percepts=SimpleNamespace(labels=labels)
    )
    ends = round_ends(cast(PerceivedScene, perceived))
    assert ends == ({("toy", "left"), ("toy", "right")} if is_round else set())
