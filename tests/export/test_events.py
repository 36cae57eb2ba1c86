"""Events against closed forms, their files against each other, and independence of the frame rate."""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from storied import BALL, G, clip, clip_of, happened

from physgen.batch.outcomes import outcomes
from physgen.export.events import ClipTimes, Event, EventKind, Events, events
from physgen.export.labels import Clip
from physgen.export.physics import physics

E = sqrt(0.64 * 1)  # of the ball and the floor
FRAME = 1 / 60


def test_a_ball_that_is_dropped_meets_the_floor_as_free_fall_has_it(
    tmp_path: Path,
) -> None:
    told = clip(tmp_path, BALL, "world.duration=1.8")
    fall, speed = sqrt(2 * 100 / G), sqrt(2 * G * 100)
    (falls,) = happened(told, EventKind.MOVE)
    assert falls.time == 0
    blows = happened(told, EventKind.COLLISION)
    assert [blow.time for blow in blows[:2]] == pytest.approx(
        [fall, fall * (1 + 2 * E)], abs=2e-3
    )
    first = blows[0]
    assert first.time == pytest.approx(fall, abs=2e-4)
    assert first.impulse == pytest.approx(5 * (1 + E) * speed, rel=5e-3)
    assert first.closing == pytest.approx(speed, rel=1e-2)
    assert first.vector == pytest.approx((0, -1), abs=1e-9)  # the floor pushes it up
    assert first.place == pytest.approx((100, 180), abs=0.1)


@pytest.mark.parametrize(("light", "heavy"), [(5, 5), (5, 20)])
def test_two_balls_part_as_momentum_and_elasticity_have_it(
    tmp_path: Path, light: float, heavy: float
) -> None:
    balls = (
        f"  a: {{shape: {{circle: {{center: [100, 60], radius: 10}}}}, mass: {light}, velocity: [200, 0]}}\n"
        f"  b: {{shape: {{circle: {{center: [220, 60], radius: 10}}}}, mass: {heavy}}}\n"
    )
    told = clip(tmp_path, balls, "world.gravity=[0, 0]", "objects.*.elasticity=1")
    (blow,) = happened(told, EventKind.COLLISION)
    assert blow.time == pytest.approx(100 / 200, abs=1e-4)
    given = 2 * light * heavy / (light + heavy) * 200
    assert blow.impulse == pytest.approx(given, rel=1e-6)
    assert blow.closing == pytest.approx(200)
    (started,) = happened(told, EventKind.MOVE)
    assert told.world.bodies[started.surfaces[0]].name == "b"
    assert abs(started.time - blow.time) < 1 / 960


def test_who_leaves_the_picture_does_so_when_its_rim_does(tmp_path: Path) -> None:
    ball = BALL.replace("mass", "velocity: [300, 0], mass")
    told = clip(tmp_path, ball, "world.gravity=[0, 0]")
    (gone,) = happened(told, EventKind.LEAVE)
    assert gone.time == pytest.approx((399.5 + 10 - 100) / 300, abs=1e-6)
    assert gone.side == "right"
    zoomed = clip(tmp_path, ball, "world.gravity=[0, 0]", "render.camera={zoom: 2}")
    (gone,) = happened(zoomed, EventKind.LEAVE)
    assert gone.time == pytest.approx(
        (299.5 + 10 - 100) / 300, abs=1e-6
    )  # the right half of the photo is not seen
    small = clip(tmp_path, ball, "world.gravity=[0, 0]", "render.scale=0.25")
    (gone,) = happened(small, EventKind.LEAVE)
    assert gone.time == pytest.approx((399.5 + 10 - 100) / 300, abs=1e-6)


def test_what_slides_rests_when_tables_say_so_and_friction_has_it(
    tmp_path: Path,
) -> None:
    block = "  block: {shape: {box: {center: [50, 170], size: [40, 20]}}, mass: 50, friction: 0.4, velocity: [60, 0]}\n"
    told = clip(tmp_path, block)
    (rest,) = happened(told, EventKind.REST)
    slow = (60 - 1) / (0.4 * G)  # at 1 px/s it rests
    assert slow - 1e-3 <= rest.time <= slow + 1 / 240 + 1e-3
    table = outcomes(told.trajectory, ["block"])["objects.block.rest_time"]
    assert table is not None
    assert rest.time - 1e-9 <= table <= rest.time + FRAME


def test_pushes_begin_and_end_when_the_scene_says(tmp_path: Path) -> None:
    forces = "forces=[{object: ball, force: [900, 0], start: 0.25, duration: 0.5}, {object: ball, impulse: [0, 70]}]"
    told = clip(tmp_path, BALL, forces, "world.gravity=[0, 0]", "boundaries={}")
    push, begin = happened(told, EventKind.PUSH)
    assert (begin.time, begin.end) == (0.25, 0.75)
    assert (push.time, push.impulse, push.vector) == (0, 70, (0, 70))
    assert begin.place == pytest.approx(
        (100, 70 + 14 * 0.25), abs=1e-6
    )  # where the ball is by then


def test_the_file_names_what_the_scene_names(tmp_path: Path) -> None:
    told = clip(tmp_path, BALL, "world.pixels_per_meter=250", "render.scale=0.5")
    (tmp_path / "made").mkdir()
    Events(tmp_path / "made", told).close()
    data = json.loads((tmp_path / "made" / "events.json").read_text())
    assert len(data["events"]) == len(events(told))
    for event in data["events"]:
        assert event["who"][0] == "ball"
        if event["kind"] == "collision":
            assert event["who"] == ["ball", "floor"]
            impulse, place = event["impulse"], event["place"]
            assert impulse["N_s"] == pytest.approx(impulse["g_px_s"] / 1000 / 250)
            seen = [(99.5 + 1) / 2 - 0.5, (place["photo"][1] + 0.5) / 2 - 0.5]
            assert place["video"] == pytest.approx(seen, abs=0.3)
            assert event["frame"] == np.ceil(event["time"] * 60 - 1e-6)


def test_a_clip_that_plays_backward_shows_events_in_that_order(tmp_path: Path) -> None:
    forward, backward = (
        clip(tmp_path, BALL, f"render.play={way}") for way in ("forward", "backward")
    )
    last = len(forward.trajectory.times) - 1
    for event in happened(forward, EventKind.COLLISION):
        there, back = ClipTimes(forward), ClipTimes(backward)
        assert there.clip_time(event.time) == pytest.approx(event.time)
        assert back.clip_time(event.time) == pytest.approx(last / 60 - event.time)
        # the first frame that shows what came of it: the sample after, and played backward the one before
        assert there.frame(event.time) + back.frame(event.time) in (last + 1, last)
    both = clip(tmp_path, BALL, "render.play=there-and-back")
    assert ClipTimes(both).frame(0.5) == ClipTimes(forward).frame(0.5)


SCENES = Path(__file__).parents[2] / "scenes"


def _plain(told: Clip) -> list[tuple[object, ...]]:
    return [(event.kind, event.surfaces, event.side) for event in events(told)]


def _numbers(event: Event) -> list[float]:
    numbers = (event.time, event.end, event.impulse, event.closing, *event.place)
    return [0.0 if number is None else number for number in numbers]


@pytest.fixture(scope="module")
def dominoes() -> Clip:
    return clip_of(SCENES / "dominoes" / "scene.yaml")  # 90 frames, 3 s


@pytest.mark.slow
@pytest.mark.parametrize("frames", [12, 200])
def test_frames_change_no_event(dominoes: Clip, frames: int) -> None:
    film = [f"render.frames={frames}", f"render.fps={frames / 3!r}"]
    told = clip_of(SCENES / "dominoes" / "scene.yaml", film)
    assert told.count == frames
    assert _plain(told) == _plain(dominoes)
    for event, same in zip(events(told), events(dominoes), strict=True):
        assert _numbers(event) == pytest.approx(_numbers(same), abs=1e-6, rel=1e-6)


def test_push_that_takes_a_while_begins_at_rest(tmp_path: Path) -> None:
    ball = BALL.replace("mass", "velocity: [300, 0], mass")
    ramped = clip(tmp_path, ball, "world.ramp=0.1", "world.gravity=[0, 0]")
    assert not happened(ramped, EventKind.MOVING)
    (start,) = happened(ramped, EventKind.MOVE)
    assert 0 <= start.time < 0.01
    abrupt = clip(tmp_path, ball, "world.gravity=[0, 0]")
    assert [event.time for event in happened(abrupt, EventKind.MOVING)] == [0]
    told, before = physics(ramped), physics(abrupt)
    assert told["objects"][0].pop("ramp") == 0.1
    assert "ramp" in told["units"]
    assert "ramp" not in before["units"] | before["objects"][0]
