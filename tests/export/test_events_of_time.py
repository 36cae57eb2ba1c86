"""What happens does not depend on how many frames show it, nor on how fast they play."""

from __future__ import annotations

from pathlib import Path

import pytest
from storied import BALL, clip, clip_of

from physgen.export.event_detection import Event, EventKind
from physgen.export.events import ClipTimes, story
from physgen.export.labels import Clip

SCENES = Path(__file__).parents[2] / "scenes"


def _plain(told: Clip) -> list[tuple[object, ...]]:
    return [(event.kind, event.surfaces, event.side) for event in told.shared(story).events]


def _numbers(event: Event) -> list[float]:
    numbers = (event.time, event.until, event.impulse, event.parting, event.far, *event.before, *event.after)
    return [0.0 if number is None else number for number in (*numbers, *(event.at or ()))]


@pytest.fixture(scope="module")
def dominoes() -> Clip:
    return clip_of(SCENES / "dominoes" / "scene.yaml")  # 90 frames, 3 s


@pytest.mark.parametrize("frames", [12, 49, 200])
def test_frames_change_no_event_and_no_caption(dominoes: Clip, frames: int) -> None:
    film = [f"render.frames={frames}", f"render.fps={frames / 3!r}"]
    told = clip_of(SCENES / "dominoes" / "scene.yaml", film)
    assert told.count == frames
    assert _plain(told) == _plain(dominoes)
    for event, same in zip(told.shared(story).events, dominoes.shared(story).events, strict=True):
        assert _numbers(event) == pytest.approx(_numbers(same), abs=1e-6, rel=1e-6)
    assert told.shared(story).caption == dominoes.shared(story).caption
    first = next(event for event in told.shared(story).events if event.kind is EventKind.FIRST_TOUCH)
    blows = [event for event in told.shared(story).events if event.kind is EventKind.COLLISION]
    assert set(blows[0].surfaces) == set(first.surfaces)  # domino-1 and domino-2
    assert blows[0].time == pytest.approx(first.time, abs=1 / 960)


def test_a_ball_is_heard_as_often_and_as_hard_in_seven_frames(tmp_path: Path) -> None:
    few, many = (clip(tmp_path, BALL, "world.duration=2", f"render.frames={n}") for n in (7, 480))
    assert _plain(few) == _plain(many)
    for one, other in zip(few.shared(story).events, many.shared(story).events, strict=True):
        assert _numbers(one) == pytest.approx(_numbers(other))


def test_what_comes_after_the_last_frame_has_the_last_frame(tmp_path: Path) -> None:
    ball = BALL.replace("center: [100, 70]", "center: [100, 160.5]")  # it meets the floor after 0.195 s
    for way, frame in (("forward", 3), ("backward", 0)):
        told = clip(tmp_path, ball, "world.duration=0.24", "render.frames=4", f"render.play={way}")
        (blow,) = (event for event in told.shared(story).events if event.kind is EventKind.COLLISION)
        assert blow.time > told.trajectory.times[-1]
        assert ClipTimes(told).frame(blow.time) == frame
        assert 0 <= ClipTimes(told).shown(blow.time) <= 4 / 60
