"""Grades of pushes, and the choice among them, on scenes whose answer is plain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.shapes import shapes_of
from physgen.geometry.scale import PLAYBACK, push_speed
from physgen.pipeline import push_trials
from physgen.pipeline.push_outcomes import (
    TRIAL,
    Grade,
    TrialScene,
    playback_of,
    ramp_of,
)
from physgen.pipeline.push_ranks import rank_pushes
from physgen.pipeline.push_trials import (
    choose_push,
    compile_trials,
    simulate_push,
)
from physgen.simulate.engine import simulate

FLOOR = "boundaries: {floor: {segment: [[-400, 250], [800, 250]], friction: 0.6}}\n"


def trials_of(tmp_path: Path, objects: str, walls: str = FLOOR) -> TrialScene:
    """Compile a side view of 400 x 300 px with these objects."""
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [400, 300]\nworld: {pixels_per_meter: 800}\n"
        f"objects:\n{objects}{walls}"
    )
    scene = pipeline.load(path)
    return compile_trials(scene, shapes_of(scene, None))


def box(name: str, x: float, width: float, height: float, more: str = "") -> str:
    """Write a box that stands on the floor."""
    center = f"[{x}, {250 - height / 2}]"
    shape = f"{{box: {{center: {center}, size: [{width}, {height}]}}}}"
    return f"  {name}: {{shape: {shape}, friction: 0.5{more}}}\n"


@pytest.mark.parametrize("x", [60, 200, 340])
def test_a_heavy_box_slides_and_stays_inside(tmp_path: Path, x: float) -> None:
    trials = trials_of(tmp_path, box("crate", x, 80, 50))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade >= Grade.SHORT
    assert chosen.outcome.travel >= TRIAL.travel
    scene = trials.scene
    edit = f"objects.crate.velocity=[{chosen.velocity[0]}, 0]"
    pushed = pipeline.load(tmp_path / "scene.yaml", [edit])
    poses = simulate(pipeline.compile(pushed, None).world, np.linspace(0, 3, 61)).poses
    assert 40 <= poses[-1, 0, 0] <= scene.size[0] - 40
    assert np.ptp(poses[-5:, 0, 0]) < 0.1


def test_a_tall_thing_falls_over_beside_a_free_way(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, box("bottle", 200, 30, 110))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.STORY
    edit = f"objects.bottle.velocity=[{chosen.velocity[0]}, 0]"
    pushed = pipeline.load(tmp_path / "scene.yaml", [edit])
    poses = simulate(pipeline.compile(pushed, None).world, np.linspace(0, 4, 81)).poses
    assert abs(np.degrees(poses[-1, 0, 2])) == pytest.approx(90, abs=5)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_vehicle_drives_forwards(tmp_path: Path, side: str) -> None:
    trials = trials_of(tmp_path, box("car", 200, 80, 40, ", label: car"))
    chosen = choose_push(trials, {}, {"car": side})
    assert chosen is not None
    assert chosen.velocity[0] * (1 if side == "right" else -1) > 0


@pytest.mark.parametrize(
    ("label", "grade"), [("crate", Grade.STORY), ("bus", Grade.NOTHING)]
)
def test_a_vehicle_that_turns_over_is_no_story(
    tmp_path: Path, label: str, grade: Grade
) -> None:
    """A tall crate falls over; a tall bus may only drive."""
    trials = trials_of(tmp_path, box("thing", 200, 50, 110, f", label: {label}"))
    outcome = simulate_push(trials, {"thing": (350.0, -50.0)}, spins={"thing": 250.0})
    assert outcome.turn > 45 or label == "bus"
    assert outcome.grade is grade


def test_a_ball_that_never_rests_is_pushed_gently(tmp_path: Path) -> None:
    """Without rolling resistance it leaves the picture in the end."""
    ball = "  ball: {shape: {circle: {center: [200, 230], radius: 20}}}\n"
    trials = trials_of(tmp_path, ball)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.RESTLESS
    assert chosen.speed < 0.5 * push_speed(400, 800)


def test_the_gentlest_push_is_taken_if_all_leave(tmp_path: Path) -> None:
    """By 5 % of the photo it would leave it: it has 3 % of room on either side."""
    trials = trials_of(tmp_path, box("sofa", 199.5, 396, 100))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.LEAVES
    assert chosen.outcome.left == ("sofa",)
    assert chosen.speed < push_speed(400, 800)


@pytest.mark.parametrize(
    ("label", "is_pushed"),
    [("dog", False), ("woman", False), ("toy dog", True), ("teddy bear", True)],
)
def test_people_and_animals_are_never_pushed(
    tmp_path: Path, label: str, is_pushed: bool
) -> None:
    trials = trials_of(tmp_path, box("a", 200, 60, 60, f', label: "{label}"'))
    assert (choose_push(trials, {}, {}) is not None) == is_pushed


def test_a_trial_ends_when_something_leaves(tmp_path: Path) -> None:
    ball = "  ball: {shape: {circle: {center: [360, 230], radius: 20}}}\n"
    trials = trials_of(tmp_path, ball)
    near = simulate_push(trials, {"ball": (900, 0)})
    far = simulate_push(trials, {"ball": (-900, 0)})
    assert near.grade is far.grade is Grade.LEAVES or near.grade is Grade.NOTHING
    assert near.work < far.work


def test_mirrored_pushes_have_equal_outcomes(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, box("crate", 199.5, 80, 50))
    left, right = (
        simulate_push(trials, {"crate": (way * 600.0, 0.0)}) for way in (-1, 1)
    )
    assert left.grade is right.grade
    assert left.travel == pytest.approx(right.travel, rel=0.02)


def test_travel_of_a_slide_follows_the_closed_form(tmp_path: Path) -> None:
    """v^2 / (2 mu g), with mu the geometric mean of the two coefficients."""
    trials = trials_of(tmp_path, box("plank", 200, 120, 20))
    outcome = simulate_push(trials, {"plank": (600.0, 0.0)})
    slowed = np.sqrt(0.5 * 0.6) * 9.8 * 800
    assert outcome.travel * 400 == pytest.approx(600**2 / (2 * slowed), rel=0.05)
    ends = 600 / slowed * (1 - np.sqrt(TRIAL.unrest / outcome.travel))
    sample = trials.unit / TRIAL.samples
    assert outcome.seconds == pytest.approx(ends, abs=sample)


def test_slow_motion_suits_the_time_of_motion(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, box("crate", 200, 80, 50))
    assert playback_of(trials, 0.1) == 8
    assert playback_of(trials, 0.5) == 4
    assert playback_of(trials, 1.0) == 2
    assert playback_of(trials, 3 * PLAYBACK.longest) == 1


def test_nothing_ends_half_beyond_a_seen_edge(tmp_path: Path) -> None:
    """The bench ends beside the box; to the other side there is room."""
    walls = "boundaries: {bench: {segment: [[100, 250], [800, 250]], friction: 0.6}}\n"
    trials = trials_of(tmp_path, box("pot", 160, 80, 50), walls)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.velocity[0] > 0


def test_a_bowl_that_tumbles_counts_little(tmp_path: Path) -> None:
    """On a rough floor its narrow foot stops, and it turns over."""
    outcomes = []
    for friction, speed in ((0.9, 700.0), (0.2, 400.0)):
        bowl = "[[140, 180], [260, 180], [215, 250], [185, 250]]"
        shape = f"{{polygon: {bowl}}}"
        text = f"  bowl: {{shape: {shape}, friction: {friction}}}\n"
        trials = trials_of(tmp_path, text, FLOOR.replace("0.6", str(friction)))
        outcomes.append(simulate_push(trials, {"bowl": (speed, 0.0)}))
    tumbling, sliding = outcomes
    assert min(tumbling.travel, sliding.travel) > TRIAL.travel
    assert tumbling.score < 0.5 * sliding.score
    assert tumbling.grade is not Grade.STORY


def test_a_short_slide_is_watched_in_slow_motion(tmp_path: Path) -> None:
    """Friction ends it within 0.2 s at any speed at which it stays in the picture."""
    trials = trials_of(tmp_path, box("crate", 200, 160, 50))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    seconds = chosen.outcome.seconds
    assert playback_of(trials, seconds) * seconds > 0.6 * PLAYBACK.least_motion


@pytest.mark.parametrize("x", [150, 250])
def test_a_slide_ends_away_from_the_border(tmp_path: Path, x: float) -> None:
    trials = trials_of(tmp_path, box("crate", x, 120, 50))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    edit = f"objects.crate.velocity=[{chosen.velocity[0]}, 0]"
    pushed = pipeline.load(tmp_path / "scene.yaml", [edit])
    poses = simulate(pipeline.compile(pushed, None).world, np.linspace(0, 3, 61)).poses
    assert 60 + TRIAL.border * 400 <= poses[-1, 0, 0] <= 340 - TRIAL.border * 400


def test_a_push_up_to_the_border_counts_less(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, box("crate", 250, 120, 50))
    slowed = np.sqrt(0.5 * 0.6) * 9.8 * 800
    inside, crowded = (
        simulate_push(trials, {"crate": (float(np.sqrt(2 * slowed * way)), 0.0)})
        for way in (75, 87)
    )
    assert inside.grade >= Grade.SHORT <= crowded.grade
    assert crowded.score < inside.score


def test_a_slide_of_a_hand_counts_in_full(tmp_path: Path) -> None:
    """A longer one uncovers more of what is filled in, and tells no more."""
    trials = trials_of(tmp_path, box("crate", 200, 120, 30))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert TRIAL.slide < chosen.outcome.travel < 2.2 * TRIAL.slide
    hard = simulate_push(trials, {"crate": (1.3 * chosen.speed, 0.0)})
    assert hard.travel > 1.5 * chosen.outcome.travel
    assert hard.score == 1.0


def test_a_ball_that_climbs_a_step_counts_little(tmp_path: Path) -> None:
    ball = (
        "  ball: {shape: {circle: {center: [150, 220], radius: 30}}, solid: sphere, "
        "rolling: 0.02, friction: 0.5}\n"
    )
    step = box("step", 260, 90, 20).replace("friction", "motion: static, friction")
    trials = trials_of(tmp_path, ball + step)
    stopped = simulate_push(trials, {"ball": (822.0, 0.0)})
    climbs = simulate_push(trials, {"ball": (1500.0, 0.0)})
    assert climbs.travel > 1.5 * stopped.travel
    assert climbs.score < 0.5 * stopped.score
    assert climbs.grade < Grade.SHORT <= stopped.grade


def test_a_wide_thing_moves_a_little_and_stays_inside(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, box("sofa", 199.5, 370, 100))
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.SHORT
    assert TRIAL.least_travel <= chosen.outcome.travel < TRIAL.travel


def count_trials(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float]]:
    """Return a list that collects the names and steps per second of trials."""
    trials: list[tuple[str, float]] = []

    def simulate_and_count(common, velocities, world=None, ramp=None, spins=None):
        used_world = common.world if world is None else world
        trials.append((*velocities, used_world.steps_per_second))
        return simulate_push(common, velocities, world, ramp, spins or {})

    monkeypatch.setattr(push_trials, "simulate_push", simulate_and_count)
    return trials


def test_the_chosen_push_is_tried_once_with_its_ramp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = trials_of(tmp_path, box("crate", 150, 60, 40))
    tried = count_trials(monkeypatch)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.ramp == ramp_of(playback_of(trials, chosen.outcome.seconds))
    checked = [rate for _, rate in tried if rate > TRIAL.rate]
    assert checked == [trials.world.steps_per_second]
    spins = {"crate": chosen.spin}
    at_once = simulate_push(trials, {"crate": chosen.velocity}, None, 0.0, spins)
    assert at_once.grade >= Grade.SHORT
    assert at_once.travel == pytest.approx(chosen.outcome.travel, rel=0.1)


def disc(name: str, x: float, radius: float) -> str:
    """Write a disc on the floor."""
    shape = f"{{circle: {{center: [{x}, {250 - radius}], radius: {radius}}}}}"
    return f"  {name}: {{shape: {shape}, friction: 0.5}}\n"


def crowd() -> str:
    """Write objects of which one push rests in 240 steps a second, but not in 960.

    The push is that of `o4`, within 0.013 s.
    """
    boxes = [(94, 40, 20), (137, 8, 60), (155, 14, 20), (215, 14, 20)]
    objects = [box(f"o{k}", *sizes) for k, sizes in enumerate(boxes, 1)]
    return "".join([disc("o0", 49, 8), *objects, disc("o5", 266, 14)])


def test_the_chosen_outcome_holds_in_the_scene_s_steps(tmp_path: Path) -> None:
    trials = trials_of(tmp_path, crowd())
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.ramp is not None
    push = {chosen.item.name: chosen.velocity}
    again = simulate_push(trials, push, None, chosen.ramp)
    assert again.grade is chosen.outcome.grade is Grade.STORY
    ramp = ramp_of(playback_of(trials, again.seconds))
    assert simulate_push(trials, push, None, ramp).grade < Grade.STORY
    assert chosen.ramp == 0.0


def test_a_given_ramp_is_tried_and_kept(tmp_path: Path) -> None:
    trials = replace(trials_of(tmp_path, box("crate", 150, 60, 40)), ramp=0.04)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.ramp == 0.04
    push = {"crate": chosen.velocity}
    again = simulate_push(trials, push, None, 0.04, {"crate": chosen.spin})
    assert again.travel == chosen.outcome.travel


def test_work_counts_all_trials_of_verified_pushes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No outcome in the scene's steps is good: the limit of work ends the trials."""
    trials = trials_of(tmp_path, crowd())
    work = 0.6 * TRIAL.work
    count = []

    def simulate_badly(common, velocities, world=None, ramp=None, spins=None):
        outcome = simulate_push(common, velocities, world, ramp, spins or {})
        if world is None or world.steps_per_second == TRIAL.rate:
            return outcome
        count.append(ramp)
        return replace(outcome, grade=Grade.RESTLESS, work=work)

    monkeypatch.setattr(push_trials, "simulate_push", simulate_badly)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.RESTLESS
    assert len(count) == 2, "both trials of the first push exceed the limit"


def test_no_push_is_counted_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = trials_of(tmp_path, crowd())
    tried = []
    counted = []

    def simulate_and_count(common, velocities, world=None, ramp=None, spins=None):
        tried.append(velocities)
        return simulate_push(common, velocities, world, ramp, spins or {})

    ends_after = push_trials._SearchEffort.ends_after

    def end_and_count(effort, weighted, candidate):
        counted.append((candidate.item.name, candidate.direction, candidate.speed))
        return ends_after(effort, weighted, candidate)

    monkeypatch.setattr(push_trials, "simulate_push", simulate_and_count)
    monkeypatch.setattr(push_trials._SearchEffort, "ends_after", end_and_count)
    list(push_trials._candidates(trials, {}, {}))
    assert len(counted) == len(set(counted))
    assert len(tried) >= len(counted)


@pytest.mark.slow
def test_the_search_ends_after_pairs_without_better_story(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crates = "".join(box(f"crate-{k}", 60 + 90 * k, 40, 30) for k in range(4))
    trials = trials_of(tmp_path, crates)
    pairs = rank_pushes(trials, {})
    tried = count_trials(monkeypatch)
    chosen = choose_push(trials, {}, {})
    assert chosen is not None
    assert chosen.outcome.grade is Grade.STORY
    searched_names = {name for name, rate in tried if rate == TRIAL.rate}
    first_names = {item.name for item, _ in pairs[: TRIAL.patience + 1]}
    assert searched_names <= first_names
    tried.clear()
    monkeypatch.setattr(
        push_trials, "TRIAL", replace(TRIAL, patience=len(pairs), pairs=len(pairs))
    )
    patient = choose_push(trials, {}, {})
    assert patient is not None
    assert patient.item.name == chosen.item.name
    assert len({name for name, _ in tried}) > len(searched_names)
