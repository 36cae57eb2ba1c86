"""How motion answers to pushes: as far as closed forms say, and wrong answers as wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physgen import pipeline
from physgen.cli.main import main as physgen
from physgen.evaluate.controllability import (
    PushGroup,
    PushSweep,
    findings,
    group_by_direction,
    join_groups,
    outcome,
    sweep,
)


def main(arguments: list[str]) -> int:
    return physgen(["evaluate", "controllability", *arguments])


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


def answers(swept: PushSweep) -> PushGroup:
    return join_groups(group_by_direction(swept))


def quiet(*_: object) -> None:
    pass


def table(tmp_path: Path, text: str = TABLE) -> Path:
    path = tmp_path / "table.yaml"
    path.write_text(text)
    return path


def test_a_puck_goes_where_and_as_far_as_it_is_pushed(tmp_path: Path) -> None:
    """On its own it slides v²/(2 mu g); the scene's own velocity and impulse are taken away."""
    swept = sweep(pipeline.load(table(tmp_path)), None, 4, [40, 80, 120], quiet)
    assert swept.object == "puck"
    found = answers(swept)
    assert findings(swept).as_dict()["still_px"] == pytest.approx(0, abs=1e-9)
    for one in swept.outcomes:
        if one.push.angle:
            assert not one.has_contact
            assert one.length == pytest.approx(
                one.push.size**2 / (2 * MU * GRAVITY), rel=1e-4
            )
    assert found.steps == (8, 8)
    assert found.spearman == 1
    assert max(found.deviations) == pytest.approx(0, abs=1e-6)


@pytest.mark.slow
def test_what_stands_in_the_way_counts_in_its_direction_alone(tmp_path: Path) -> None:
    swept = sweep(pipeline.load(table(tmp_path)), "puck", 4, [80, 260], quiet)
    met = [one.push.angle for one in swept.outcomes if one.has_contact]
    assert met == [0]
    hit = next(one for one in swept.outcomes if one.has_contact)
    assert (
        80 < np.hypot(*hit.free_response) <= 87.5
    )  # from 60 + 8 to 155, and a frame's way before it
    free = sweep(
        pipeline.load(table(tmp_path), ["objects.post=null"]),
        "puck",
        4,
        [80, 260],
        quiet,
    )
    assert not any(one.has_contact for one in free.outcomes)
    assert answers(free).free_steps == answers(free).steps == (4, 4)


def test_a_motion_that_answers_wrongly_is_told_to_be_wrong(tmp_path: Path) -> None:
    good = sweep(pipeline.load(table(tmp_path)), "puck", 4, [40, 80, 120], quiet)

    def bent(change) -> PushSweep:
        return replace(
            good,
            outcomes=tuple(
                outcome(*change(one), good.rest_path) for one in good.outcomes
            ),
        )

    def mirrored(one):
        places = 2 * one.path.places[0] - one.path.places
        return one.push, replace(one.path, places=places)

    def shrinking(one):
        places = (
            one.path.places[0]
            + (one.path.places - one.path.places[0]) * (100 / one.push.size) ** 4
        )
        return one.push, replace(one.path, places=places)

    back = answers(bent(mirrored))
    assert back.deviations == pytest.approx([180] * 12)
    less = answers(bent(shrinking))
    assert less.steps == (0, 8)
    assert less.spearman == -1


@pytest.mark.slow
def test_an_object_that_cannot_move_gives_words_and_no_nan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = TABLE + "joints: {pin: {objects: [puck], weld: [60, 60]}}\n"
    assert main([str(table(tmp_path, held)), "--angles", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["spearman_mean"], told["rising"], told["off_until_met"]["median"]) == (
        0,
        0,
        None,
    )


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
    time = 0.25  # of the last frame
    for one in flat:  # slides v²/(2 mu g), or as long as the clip lasts
        lasts = min(time, one.push.size / (0.5 * GRAVITY))
        assert one.length == pytest.approx(
            one.push.size * lasts - 0.25 * GRAVITY * lasts**2, rel=0.01
        )


def test_the_command_writes_json_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page"
    pushes = ["--angles", "4", "--sizes", "40,80", "--json", "-o", str(page)]
    assert main([str(table(tmp_path)), *pushes]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["object"] == "puck"
    assert found["still_px"] == pytest.approx(0, abs=1e-9)
    assert found["sideways"] == {"same": 4, "of": 4}
    for one in found["rows"]:
        assert one["met"] or one["length"] == pytest.approx(
            one["size"] ** 2 / (2 * MU * GRAVITY), rel=1e-3
        )
    assert "paths.svg" in {path.name for path in page.iterdir()}


def test_what_cannot_be_pushed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(table(tmp_path)), "--object", "pick"]) == 2
    assert "did you mean puck" in capsys.readouterr().err
    still = table(tmp_path, TABLE.replace("mass: 50,", "mass: 50, motion: static,"))
    assert main([str(still)]) == 2
    assert "no object that can be pushed" in capsys.readouterr().err
