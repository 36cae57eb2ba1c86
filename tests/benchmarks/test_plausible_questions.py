"""Plausibility against nature: motions written down by hand, and the same with one body made wrong."""

from __future__ import annotations

import numpy as np
import pytest

from physgen.evaluate.plausibility.judge import Verdict, judge
from physgen.evaluate.plausibility.tracks import Tracks, disc
from physgen.problems import InputError
from physgen.scene.scene import View

FPS = 30.0
RNG = np.random.default_rng(3)


def clip(
    paths: list[np.ndarray],
    view: View = View.SIDE,
    radius: float = 10.0,
    **more: object,
) -> Tracks:
    names = tuple(f"ball-{k + 1}" for k in range(len(paths)))
    forms = (disc(radius),) * len(paths)
    times = np.arange(len(paths[0])) / FPS
    return Tracks(
        "clip",
        times,
        names,
        np.stack(paths, axis=1),
        None,
        forms,
        view,
        0.02,
        "by hand",
        **more,
    )


def fall(
    g: float = 900.0,
    frames: int = 40,
    x: float = 50.0,
    vx: float = 80.0,
    vy: float = -500.0,
) -> np.ndarray:
    t = np.arange(frames) / FPS
    return np.stack([x + vx * t, 300 + vy * t + g * t * t / 2], axis=1)


def along(x: float, y: float, vx: float, vy: float, frames: int = 40) -> np.ndarray:
    t = np.arange(frames)[:, None] / FPS
    return np.array([x, y]) + t * np.array([vx, vy])


def bounce(
    e: float, floor: float = 400.0, g: float = 900.0, frames: int = 45
) -> np.ndarray:
    """Let go at y = 200: down, and up again at e times the speed; closed form."""
    t = np.arange(frames) / FPS
    down = np.sqrt(2 * (floor - 200) / g)
    speed = g * down
    s = t - down
    return np.stack(
        [
            np.full(frames, 60.0),
            np.where(s < 0, 200 + g * t * t / 2, floor - e * speed * s + g * s * s / 2),
        ],
        1,
    )


def deviation(verdict: Verdict, question: str) -> float:
    return verdict.answers[question][0].deviation


def test_a_throw_is_right_and_its_gravity_is_found() -> None:
    verdict = judge(clip([fall(), fall(x=250, vx=-60, vy=-420)]))
    assert verdict.is_wrong is False
    assert verdict.motion.gravity == pytest.approx((0, 900), abs=1)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_gravity_that_changes_midway_is_seen_where_it_does(noise: float) -> None:
    before, t = fall(frames=24), np.arange(1, 25)[:, None] / FPS
    place, velocity = before[-1], np.array([80.0, -500 + 900 * 23 / FPS])
    path = np.concatenate(
        [before, place + t * velocity + t * t / 2 * np.array([0, 450.0])]
    )
    verdict = judge(clip([path + RNG.normal(0, noise, path.shape)]))
    question, evidence = verdict.faults()[0]
    assert question == "gravity"
    assert 0.35 < evidence.deviation < 1.1
    assert (
        judge(clip([fall(frames=48) + RNG.normal(0, noise, (48, 2))])).is_wrong is False
    )


def test_what_is_pulled_upwards_is_seen_beside_what_falls() -> None:
    t = np.arange(1, 25)[:, None] / FPS
    before = fall(frames=25)
    velocity = np.array([80.0, -500 + 900 * 24 / FPS])
    turned = np.concatenate(
        [before, before[-1] + t * velocity - t * t / 2 * np.array([0, 900.0])]
    )
    question, evidence = judge(clip([turned])).faults()[0]
    assert (question, "pulled upwards at 900" in evidence.text) == ("gravity", True)
    assert evidence.deviation == pytest.approx(
        2, abs=0.1
    )  # the other way is twice as far off as none
    beside = judge(clip([fall(), fall(x=250, vx=-60, vy=-420), 600 - fall(x=400)]))
    assert [evidence.bodies for _, evidence in beside.faults()] == [(2,)]


@pytest.mark.parametrize(("e", "wrong"), [(0.5, False), (0.95, False), (1.3, True)])
def test_no_ball_comes_back_faster_than_it_came(e: float, wrong: bool) -> None:
    verdict = judge(clip([bounce(e)]))
    assert verdict.answers["energy"]
    assert (verdict.score("energy") < 0.5) is wrong
    assert deviation(verdict, "energy") == pytest.approx(
        max(0.0, e - np.sqrt(1.1)), abs=0.03
    )  # a tenth may be spin


def two(
    v1: np.ndarray, v2: np.ndarray, after1: np.ndarray, after2: np.ndarray
) -> list[np.ndarray]:
    """Two that come together, discs of 10 px, between frames 20 and 21; x is the line of centres."""
    t = (np.arange(45) / FPS - 20.4 / FPS)[:, None]
    a, b = np.array([190.0, 200.0]), np.array([210.0, 200.0])
    return [
        np.where(t < 0, a + t * v1, a + t * after1),
        np.where(t < 0, b + t * v2, b + t * after2),
    ]


def test_momentum_of_two_discs_on_a_table() -> None:
    rest, fast = np.zeros(2), np.array([300.0, 0.0])
    right = judge(clip(two(fast, rest, 0.1 * fast, 0.9 * fast), View.TOP))
    assert right.answers["momentum"]
    assert right.is_wrong is False
    alone = judge(
        clip(
            two(fast, np.array([0.0, 30.0]), -0.5 * fast, np.array([0.0, 30.0])),
            View.TOP,
        )
    )
    assert "momentum" in {
        question for question, _ in alone.faults()
    }  # the second takes no notice
    across = judge(clip(two(fast, rest, 0.2 * fast, np.array([0.0, 250.0])), View.TOP))
    assert across.is_wrong


def test_known_masses_tell_more() -> None:
    fast = np.array([300.0, 0.0])
    paths = two(
        fast, np.zeros(2), 0.5 * fast, 1.0 * fast
    )  # right if the second has half the mass
    assert judge(clip(paths, View.TOP)).is_wrong is False
    assert judge(clip(paths, View.TOP, masses=np.array([2.0, 1.0]))).is_wrong is False
    heavy = judge(clip(paths, View.TOP, masses=np.array([1.0, 3.0])))
    assert deviation(heavy, "momentum") == pytest.approx(
        0.5 * 300 * 5 / (150 + 900), abs=0.05
    )


def test_one_goes_through_another_in_frames_and_between_them() -> None:
    through = judge(clip([along(50, 200, 240, 0), along(330, 203, -180, 0)], View.TOP))
    assert (
        0.7 < deviation(through, "overlap") < 1
    )  # a whole ball deep, less what frames and noise leave open
    fast = judge(clip([along(-890, 200, 1800, 0), along(300, 200, 0, 0)], View.TOP))
    assert fast.is_wrong
    apart = judge(clip([along(50, 200, 240, 0), along(330, 240, -180, 0)], View.TOP))
    assert apart.is_wrong is False


def test_a_jump_is_found_in_its_frame_by_its_size() -> None:
    path = fall()
    path[22:] += (40, -20)
    question, evidence = judge(clip([path])).faults()[0]
    assert (question, evidence.frame) == ("jumps", 22)
    assert float(evidence.text.split()[2]) == pytest.approx(np.hypot(40, 20), abs=2)
    flicker = fall()
    flicker[22] += (40, 0)
    assert judge(clip([flicker])).is_wrong


def test_what_cannot_be_asked_is_no_success() -> None:
    verdict = judge(clip([along(60, 60, 90, 0)]))
    assert verdict.score("gravity") is None
    assert verdict.as_dict()["questions"]["gravity"]["why_not"]
    gaps = along(60, 60, 90, 0)
    gaps[::3] = np.nan
    nothing = judge(clip([gaps]))
    assert nothing.overall is None
    assert nothing.as_dict()["verdict"] == "not asked"


def test_too_few_frames_are_refused() -> None:
    with pytest.raises(InputError, match="5 frames are too few"):
        judge(clip([fall(frames=5)]))
