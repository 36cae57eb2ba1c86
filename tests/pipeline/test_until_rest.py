"""`duration: auto` ends a clip when all rests, beside the closed form of a fall."""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path

import pytest
from written import loaded

from physgen import pipeline
from physgen.pipeline.stages import Maps, Stages
from physgen.problems import InputError

FALL = """\
physgen: 1
size: [200, 300]
world: {{view: side, gravity: [0, 200], duration: {}}}
objects: {{a: {{shape: {{box: {{center: [100, 40], size: [20, 20]}}}}, elasticity: 0}}}}
boundaries: {{floor: {{segment: [[0, 250], [200, 250]], elasticity: 0}}}}
render: {{slow: {}}}
"""
GLIDES = """\
physgen: 1
size: [200, 200]
world: {{view: top, duration: auto, table: {{friction: 0}}}}
objects: {{a: {{shape: {{circle: {{center: [50, 100], radius: 10}}}}, velocity: [{}, 0]}}}}
"""


@pytest.mark.parametrize("slow", [1, 4])
def test_a_clip_ends_shortly_after_a_fall(tmp_path: Path, slow: int) -> None:
    scene = loaded(tmp_path, FALL.format("auto", slow))
    world = pipeline.compile(scene, None).world
    fallen = sqrt(2 * 200 / 200)  # s, from 40 + 10 to 250 px
    end = max(fallen + 0.7 / slow, 2.5 / slow)
    assert world.duration == pytest.approx(end, abs=0.08)
    assert len(world.times) == round(30 * slow * world.duration)
    assert Stages().compile(scene, Maps(None, "")).world.duration == world.duration


def test_a_resolved_scene_has_the_time_it_took(tmp_path: Path) -> None:
    path = tmp_path / "fall.yaml"
    path.write_text(FALL.format("auto", 2))
    scene = pipeline.load(path)
    seconds = pipeline.compile(scene, None).world.duration
    assert (
        pipeline.render_scene(path, tmp_path / "out", overrides=["render.fps=5"])
        is not None
    )
    manifest = json.loads((tmp_path / "out" / "fall" / "manifest.json").read_text())
    assert manifest["document"]["world"]["duration"] == pytest.approx(seconds, rel=0.1)


def test_a_number_fixes_it_and_no_key_is_two_seconds(tmp_path: Path) -> None:
    assert (
        pipeline.compile(loaded(tmp_path, FALL.format("0.7", 1)), None).world.duration
        == 0.7
    )
    text = FALL.format("auto", 1).replace(", duration: auto", "")
    assert pipeline.compile(loaded(tmp_path, text), None).world.duration == 2.0


@pytest.mark.parametrize(
    ("speed", "seconds"),
    [
        pytest.param(0, 2.5, id="nothing moves: the shortest"),
        pytest.param(60, 160 / 60 + 0.7, id="it leaves the picture"),
        pytest.param(3, 10, id="it never stops"),
    ],
)
def test_what_left_the_picture_rests(
    tmp_path: Path, speed: float, seconds: float
) -> None:
    world = pipeline.compile(loaded(tmp_path, GLIDES.format(speed)), None).world
    assert world.duration == pytest.approx(seconds, abs=0.08)


def test_other_words_are_refused_with_what_fits(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="s or min behind it, or auto"):
        loaded(tmp_path, FALL.format("long", 1))


def test_a_clip_waits_for_a_force_and_a_view_that_come_after_rest(
    tmp_path: Path,
) -> None:
    force = "forces: [{object: a, impulse: [{}, 0], start: 3}]\n"
    fall = loaded(tmp_path, FALL.format("auto", 1) + force.replace("{}", "0.001"))
    assert pipeline.compile(fall, None).world.duration == pytest.approx(3.7, abs=0.1)
    view = loaded(
        tmp_path,
        FALL.format("auto", 1).replace("slow: 1", "camera: [{time: 0}, {time: 4}]"),
    )
    world = pipeline.compile(view, None).world
    assert world.duration == pytest.approx(4.7, abs=0.1)
    assert not [
        one
        for one in pipeline.lint(view, pipeline.compile(view, None))
        if "never reached" in one.expected
    ]
