"""How motion answers to pushes: rank correlations as scipy's, closed forms as integrals, wrong answers as wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from physgen import pipeline
from physgen.cli.main import main
from physgen.evaluate.controllability import (
    Swept,
    answers,
    findings,
    kendall,
    outcome,
    rolled,
    slid,
    spearman,
    sweep,
)

MU, GRAVITY = 0.25, 980.0
TABLE = """\
physgen: 1
size: [200, 120]
world: {view: top, duration: 1.2, table: {friction: 0.25}}
objects:
  puck: {shape: {circle: {center: [60, 60], radius: 8}}, solid: disc, mass: 50, friction: 0.25, velocity: [30, 9]}
  post: {shape: {box: {center: [160, 60], size: [10, 60]}}, motion: static}
forces: [{object: puck, impulse: [900, 0]}]
render: {fps: 20}
"""


def quiet(*_: object) -> None:
    pass


def table(tmp_path: Path, text: str = TABLE) -> Path:
    path = tmp_path / "table.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("seed", range(4))
def test_rank_correlations_are_scipys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.integers(0, 6, 12).astype(float), rng.integers(0, 6, 12).astype(float)
    assert spearman(one, other) == pytest.approx(stats.spearmanr(one, other).statistic)
    assert kendall(one, other) == pytest.approx(stats.kendalltau(one, other).statistic)


def test_what_never_changes_has_no_correlation() -> None:
    assert spearman(np.arange(3.0), np.zeros(3)) is None
    assert kendall(np.arange(3.0), np.zeros(3)) is None


@pytest.mark.parametrize("time", [0.1, 0.5, 5.0])
def test_closed_forms_are_integrals(time: float) -> None:
    def integral(speed: float, slip: float, resist: float, ball: bool, steps: int = 40_000) -> float:
        h, v, surface, way = time / steps, speed, 0.0, 0.0
        for _ in range(steps):
            if not ball:
                v = max(v - slip * h, 0.0)
            elif v > surface:  # its lowest point slides: I = 2/5 m R²
                v, surface = v - slip * h, surface + 2.5 * (slip - resist) * h
            else:
                v = surface = max(v - resist * 5 / 7 * h, 0.0)
            way += v * h
        return way

    assert slid(150, time, 245) == pytest.approx(integral(150, 245, 0, False), rel=1e-3)
    assert rolled(150, time, 196, 30) == pytest.approx(integral(150, 196, 30, True), rel=1e-3)


def test_a_puck_goes_where_and_as_far_as_it_is_pushed(tmp_path: Path) -> None:
    """On its own it slides v²/(2 mu g); the scene's own velocity and impulse are taken away."""
    swept = sweep(pipeline.load(table(tmp_path)), None, 4, [40, 80, 120], quiet)
    assert swept.object == "puck"
    found = answers(swept)
    assert found.still == pytest.approx(0, abs=1e-9)
    for one in swept.outcomes:
        if one.push.angle:
            assert not one.met
            assert one.length == pytest.approx(one.push.size**2 / (2 * MU * GRAVITY), rel=1e-4)
    assert found.steps == (8, 8)
    assert found.correlation == (1, 1)
    assert found.first.worst == pytest.approx(0, abs=1e-6)
    assert found.turns == (4, 4)
    assert found.law is not None
    assert found.law[1] < 1e-4


def test_what_stands_in_the_way_counts_in_its_direction_alone(tmp_path: Path) -> None:
    swept = sweep(pipeline.load(table(tmp_path)), "puck", 4, [80, 260], quiet)
    met = [one.push.angle for one in swept.outcomes if one.met]
    assert met == [0]
    hit = next(one for one in swept.outcomes if one.met)
    assert 80 < np.hypot(*hit.at_first) <= 87.5  # from 60 + 8 to 155, and a frame's way before it
    free = sweep(pipeline.load(table(tmp_path), ["objects.post=null"]), "puck", 4, [80, 260], quiet)
    assert not any(one.met for one in free.outcomes)
    assert findings(free).as_dict()["closed_form"]["worst"] < 1e-4


def test_a_motion_that_answers_wrongly_is_told_to_be_wrong(tmp_path: Path) -> None:
    good = sweep(pipeline.load(table(tmp_path)), "puck", 4, [40, 80, 120], quiet)

    def bent(change) -> Swept:
        return replace(good, outcomes=tuple(outcome(*change(one), good.still) for one in good.outcomes))

    def mirrored(one):
        places = 2 * one.path.places[0] - one.path.places
        return one.push, replace(one.path, places=places)

    def shrinking(one):
        places = one.path.places[0] + (one.path.places - one.path.places[0]) * (100 / one.push.size) ** 4
        return one.push, replace(one.path, places=places)

    back = answers(bent(mirrored))
    assert back.first.median == pytest.approx(180)
    assert back.turns == (4, 4)  # round the other way, but still round
    less = answers(bent(shrinking))
    assert less.steps == (0, 8)
    assert less.correlation == (-1, -1)
    assert less.law is not None
    assert less.law[1] > 0.3


def test_an_object_that_cannot_move_gives_words_and_no_nan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = TABLE + "joints: {pin: {objects: [puck], weld: [60, 60]}}\n"
    assert main(["evaluate", "controllability", str(table(tmp_path, held)), "--angles", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["spearman_mean"], told["rising"], told["off_at_end"]["median"]) == (None, 0, None)


def test_seen_from_the_side_nobody_is_pushed_into_the_ground(tmp_path: Path) -> None:
    text = """\
physgen: 1
size: [200, 120]
world: {duration: 0.3}
objects: {box: {shape: {box: {center: [60, 90], size: [20, 20]}}, mass: 50, friction: 0.5}}
boundaries: {floor: {segment: [[-900, 100], [900, 100]], friction: 0.5}}
render: {fps: 20}
"""
    swept = sweep(pipeline.load(table(tmp_path, text)), None, 4, [], quiet)
    assert all(one.push.y <= 1e-9 for one in swept.outcomes)
    assert len({round(one.push.angle) for one in swept.outcomes}) == 4
    assert answers(swept).sideways == (20, 20)
    flat = [one for one in swept.outcomes if abs(one.push.y) < 1e-9]
    for one in flat:  # slides v²/(2 mu g), or as long as the clip lasts
        assert one.length == pytest.approx(
            slid(one.push.size, float(one.path.times[-1]), 0.5 * GRAVITY), rel=0.01
        )


def test_the_command_writes_json_and_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page"
    pushes = ["--angles", "4", "--sizes", "40,80", "--json", "-o", str(page)]
    assert main(["evaluate", "controllability", str(table(tmp_path)), *pushes]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["object"] == "puck"
    assert found["still_px"] == pytest.approx(0, abs=1e-9)
    assert found["sideways"] == {"same": 4, "of": 4}
    for one in found["rows"]:
        assert one["met"] or one["length"] == pytest.approx(one["size"] ** 2 / (2 * MU * GRAVITY), rel=1e-3)
    assert (page / "index.html").read_text().count("data:image/svg+xml") == 2


@pytest.mark.parametrize(
    ("flags", "wrong"),
    [
        (["--object", "pick"], "did you mean puck"),
        (["--object", "post"], "cannot be pushed"),
        (["--sizes", "10"], "is not 2 to 100 sizes"),
        (["--sizes", "10,nan"], "is not a number above 0"),
        (["--angles", "0"], "is not a whole number from 1"),
        (["--variant", "all"], "names more than one"),
    ],
)
def test_faults_of_pushes(
    flags: list[str], wrong: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: object = main(["evaluate", "controllability", str(table(tmp_path)), *flags])
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2
    assert wrong in capsys.readouterr().err


def test_scenes_without_an_object_to_push(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "controllability", str(tmp_path / "no.yaml")]) == 2
    still = table(tmp_path, TABLE.replace("mass: 50,", "mass: 50, motion: static,"))
    assert main(["evaluate", "controllability", str(still)]) == 2
    assert "no object that can be pushed" in capsys.readouterr().err
