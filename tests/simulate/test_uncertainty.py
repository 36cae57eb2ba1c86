"""Fans beside closed forms: what slides, what does not care, what falls."""

from __future__ import annotations

from math import cos, radians, sin, sqrt, tan
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from written import loaded

from physgen import pipeline
from physgen.simulate.uncertainty import (
    Ensemble,
    Fate,
    radius,
    simulate_ensemble,
    verdicts,
    wilson,
)

SLOPE = 24.0
"""degrees."""


def made(tmp_path: Path, text: str, count: int, seed: int = 0) -> Ensemble:
    scene = loaded(tmp_path, text)
    return simulate_ensemble(scene, pipeline.compile(scene, None), count, seed)


def ramp(friction: float, said: str) -> str:
    """A block at rest on a slope that sinks to the right."""
    t, half = radians(SLOPE), 3.0
    x, y = 60.0, 60.0
    cx, cy = x + half * sin(t), y - half * cos(t)
    return f"""\
physgen: 1
size: [200, 160]
world: {{duration: 0.9, steps_per_second: 480}}
objects:
  block: {{shape: {{box: {{center: [{cx}, {cy}], size: [12, {2 * half}], angle: {SLOPE}}}}}, mass: 50,
    friction: {friction}, from: {{friction: {said}, mass: table 0.3}}}}
boundaries:
  slope: {{segment: [[0, {y - x * tan(t)}], [199, {y + (199 - x) * tan(t)}]], friction: 0.5, elasticity: 0}}
"""


@pytest.mark.slow
def test_a_block_slides_where_friction_is_less_than_the_slope(tmp_path: Path) -> None:
    """Coulomb: it slides where the pair's coefficient is below tan(slope), whatever it weighs."""
    count = 60
    found = made(tmp_path, ramp(0.4, "table 0.4"), count)
    limit = (
        tan(radians(SLOPE)) ** 2 / 0.5
    )  # of the block's own: the pair's is the geometric mean
    column = [doubt.parameter for doubt in found.doubts].index("friction")
    value = found.values[:, column]
    fates = np.array([one.fates[0] for one in found.outcomes])
    clear = (
        np.abs(value / limit - 1) > 0.1
    )  # nearer, it slides less than half its size in the time
    assert clear.sum() > 0.7 * count
    assert np.array_equal(fates[clear] == Fate.MOVES, value[clear] < limit)
    assert not np.isin(fates, (Fate.FALLS, Fate.LEAVES)).any(), (
        "what slides down a slope does not fall"
    )
    expected = stats.norm.cdf(np.log(limit / 0.4) / (-0.5 * np.log(0.4)))
    share = (value < limit).mean()
    assert abs(share - expected) < 4 * sqrt(expected * (1 - expected) / count)
    (told,) = verdicts(found)
    assert not told.decided
    assert told.interval[0] < expected < told.interval[1]


def test_what_lies_on_a_slope_in_the_photo_does_not_slide_in_any_draw(
    tmp_path: Path,
) -> None:
    """`perceive` says of it that friction is at least so much."""
    least = 1.1 * tan(radians(SLOPE)) ** 2 / 0.5
    (told,) = verdicts(made(tmp_path, ramp(round(least, 3), "lies on a slope 0.3"), 24))
    assert told.decided
    assert told.event is Fate.STAYS


def test_a_throw_does_not_care_what_it_weighs(tmp_path: Path) -> None:
    """Galilei: mass alone is open, and all that happens is decided, to the last digit."""
    text = """\
physgen: 1
size: [300, 200]
world: {duration: 0.5}
objects:
  ball: {shape: {circle: {center: [30, 100], radius: 6}}, velocity: [300, -250], mass: 60, from: {mass: table 0.1}}
"""
    found = made(tmp_path, text, 8)
    assert np.ptp(found.values) > 20
    assert np.abs(found.poses - found.own_poses).max() < 1e-9
    (told,) = verdicts(found)
    t = 0.5
    assert found.poses[0, -1, 0, :2] == pytest.approx(
        [30 + 300 * t, 100 - 250 * t + 490 * t * t], abs=1e-6
    )
    assert (told.decided, told.placed) == (True, True)


def test_an_impulse_does(tmp_path: Path) -> None:
    """v = p / m: how far it comes is spread as 1 / mass is."""
    text = """\
physgen: 1
size: [300, 200]
world: {duration: 0.5, gravity: [0, 0]}
objects:
  ball: {shape: {circle: {center: [30, 100], radius: 6}}, mass: 60, from: {mass: table 0.5}}
forces: [{object: ball, impulse: [6000, 0]}]
"""
    found = made(tmp_path, text, 60)
    way = found.poses[:, -1, 0, 0] - 30
    assert way == pytest.approx(6000 / found.values[:, 0] * 0.5)
    (told,) = verdicts(found)
    off = np.sort(np.abs(way - np.median(way)))
    assert told.radius == pytest.approx(off[53], abs=1.0), "9 of 10 are within"


HEAD = "physgen: 1\nsize: [240, 160]\nworld: {duration: 0.8}\n"
DOUBT = "from: {mass: table 0.4}"
SCENES = {
    "rolls down a slope": (
        "objects: {it: {shape: {circle: {center: [40, 40.1], radius: 10}}, mass: 9, solid: sphere, friction: 0.9, "
        + DOUBT + "}}\nboundaries: {slope: {segment: [[0, 34], [239, 129.6]], friction: 0.9}}\n",
        Fate.MOVES,
    ),
    "rolls off a table": (
        "objects: {it: {shape: {circle: {center: [60, 40], radius: 10}}, mass: 9, velocity: [120, 0], " + DOUBT
        + "}}\nboundaries: {table: {segment: [[0, 50], [90, 50]]}, floor: {segment: [[0, 120], [239, 120]]}}\n",
        Fate.FALLS,
    ),
    "is thrown up and caught": (
        "objects: {it: {shape: {circle: {center: [60, 110], radius: 10}}, mass: 9, velocity: [0, -250], elasticity: 0, "
        + DOUBT + "}}\nboundaries: {floor: {segment: [[0, 120], [239, 120]], elasticity: 0}}\n",
        Fate.MOVES,
    ),
    "tips over": (
        "objects: {it: {shape: {box: {center: [100, 90], size: [12, 60]}}, mass: 9, spin: 420, friction: 0.9, " + DOUBT
        + "}}\nboundaries: {floor: {segment: [[0, 120], [239, 120]], friction: 0.9}}\n",
        Fate.FALLS,
    ),
    "swings": (
        "objects: {it: {shape: {circle: {center: [160, 60], radius: 10}}, mass: 9, " + DOUBT
        + "}}\njoints: {rod: {pivot: [100, 40], objects: [it]}}\n",
        Fate.MOVES,
    ),
    "glides out of the photo": (
        "objects: {it: {shape: {box: {center: [180, 114], size: [30, 12]}}, mass: 9, velocity: [300, 0], friction: 0, "
        + DOUBT + "}}\nboundaries: {floor: {segment: [[-500, 120], [900, 120]]}}\n",
        Fate.LEAVES,
    ),
    "stands": (
        "objects: {it: {shape: {box: {center: [100, 90], size: [30, 60]}}, mass: 9, " + DOUBT
        + "}}\nboundaries: {floor: {segment: [[0, 120], [239, 120]]}}\n",
        Fate.STAYS,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_fates_are_called_by_their_names(tmp_path: Path, name: str) -> None:
    text, fate = SCENES[name]
    found = made(tmp_path, HEAD + text, 2)
    assert {
        Fate(int(one.fates[0])) for one in (found.clip_outcome, *found.outcomes)
    } == {fate}


def test_a_draw_that_cannot_be_simulated_is_told(tmp_path: Path) -> None:
    """A mass so far off that no engine takes it beside the other; the others are judged without it."""
    text = (
        HEAD
        + """\
objects:
  light: {shape: {circle: {center: [60, 40], radius: 10}}, mass: 1.0e-8, from: {mass: table 0.3}}
  heavy: {shape: {circle: {center: [160, 40], radius: 10}}, mass: 5}
"""
    )
    found = made(tmp_path, text, 12)
    far = found.values[:, 0] * 1e9 <= 5
    assert 0 < far.sum() < 12
    assert [one is None for one in found.outcomes] == far.tolist()
    assert "10^9" in str(found.failures[0])
    assert {v.total for v in verdicts(found)} == {int((~far).sum())}
    assert found.table().count("\n") == 13


@pytest.mark.parametrize(("count", "total"), [(0, 2), (13, 32), (32, 32), (1, 1000)])
def test_intervals_are_wilsons(count: int, total: int) -> None:
    known = stats.binomtest(count, total).proportion_ci(0.95, method="wilson")
    assert wilson(count, total) == pytest.approx((known.low, known.high), abs=1e-9)


def test_nine_of_ten_places_lie_within_the_radius() -> None:
    places = np.random.default_rng(3).normal(0, 10, (4000, 2))
    assert radius(places) == pytest.approx(
        10 * np.sqrt(stats.chi2(2).ppf(0.9)), rel=0.05
    )
