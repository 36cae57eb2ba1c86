"""The clips by which the judge is judged are what they say, and a few of them."""

from __future__ import annotations

import numpy as np
import pytest
from plausibility import balls, families, faults
from plausibility.confusion import balanced, counted, findings, interval
from plausibility.films import stranger
from plausibility.pieces import in_two
from plausibility.trial import Said

from physgen.evaluate.plausibility.judge import judge
from physgen.evaluate.plausibility.tracks import from_world
from physgen.simulate.engine import simulate

pytestmark = pytest.mark.slow

FPS = 24
SEED = 7001


def closed(fault: str | None, seed: int = SEED) -> balls.Tracks:
    rng = np.random.default_rng(seed)
    return next(
        clip
        for clip in (balls.made(rng, fault, FPS) for _ in range(400))
        if clip is not None
    )


def test_balls_in_closed_form_keep_energy_and_momentum() -> None:
    rng = np.random.default_rng(3)
    state = balls._drawn(rng, True)
    state.bounce = 1.0
    fine = np.arange(0, 0.6, 1e-3)
    places, blows = balls._run(balls._copy(state), fine, None, 0.0, rng) or pytest.fail(
        "it never ends"
    )
    velocity = np.diff(places, axis=0) / 1e-3
    energy = (state.masses * (velocity**2).sum(-1)).sum(-1)
    calm = [
        k
        for k, t in enumerate(fine[:-1])
        if all(abs(t - time) > 2e-3 for time, _, _ in blows)
    ]
    assert np.ptp(energy[calm]) < 1e-6 * energy[0]
    walls = [time for time, _, other in blows if other < 0]
    momentum = (state.masses[:, None] * velocity).sum(1)
    before = [k for k in calm if fine[k] < min(walls, default=1) - 2e-3]
    assert (
        np.ptp(momentum[before], axis=0).max()
        < 1e-6 * np.abs(state.masses[:, None] * velocity[0]).sum()
    )


def test_a_run_in_two_pieces_is_the_run_in_one() -> None:
    world = families.world_of("pendulum", np.random.default_rng(SEED))
    times = np.arange(20) / FPS
    whole = simulate(world, times).poses
    parts = in_two(world, times, 0.31, lambda then: then)
    assert parts is not None
    assert np.abs(parts - whole)[..., :2].max() < 0.1


@pytest.mark.parametrize("fault", [None, *balls.KINDS])
def test_balls_that_go_wrong_are_called_wrong(fault: str | None) -> None:
    assert judge(stranger(closed(fault))).is_wrong is (fault is not None)


@pytest.mark.parametrize(
    ("family", "fault"), [("bouncing", "energy is gained"), ("table top", "a jump")]
)
def test_our_own_clips_and_the_same_with_a_fault(family: str, fault: str) -> None:
    rng = np.random.default_rng(SEED + 1)
    world = families.world_of(family, rng)
    times = np.arange(int(world.duration * FPS) + 1) / FPS
    fine = simulate(world, np.arange(int(world.duration * 480) + 1) / 480)
    poses = faults.FAULTS[fault](world, times, fine, rng)
    assert poses is not None
    right = from_world(family, world, times, fine.poses[:: 480 // FPS])
    assert judge(stranger(right)).is_wrong is False
    assert judge(stranger(from_world(family, world, times, poses))).is_wrong is True


def test_balanced_accuracy_counts_right_and_wrong_alike() -> None:
    said = [Said("physgen", "ramp", "right", k, 30, "exact", 1.0, {}) for k in range(8)]
    said += [
        Said("physgen", "ramp", "a jump", k, 30, "exact", [0.1, None, 0.7, 0.2][k], {})
        for k in range(4)
    ]
    rows = counted(said)
    assert [(row["clips"], row["called_wrong"]) for row in rows] == [(8, 0), (4, 2)]
    assert balanced(rows) == 0.75
    assert balanced(rows[:1]) is None
    assert interval(rows[:1]) is None
    silent = counted(
        [*said, Said("physgen", "ramp", "right", 9, 30, "exact", None, {})]
    )
    assert silent[0]["not_asked"] == 1
    assert balanced(silent) == pytest.approx(
        (8 / 9 + 0.5) / 2
    )  # what cannot be asked is not told rightly
    found = findings(rows, range(1000, 1001))
    assert not found.has_passed
    assert "75.0 %" in found.sentences[0]
