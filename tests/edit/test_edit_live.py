"""What a text is seen to be: the motion of `physgen simulate`, however it is asked for; problems where they lie."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from served import simulated, unpacked

from physgen.edit.live import COLUMNS, Live, Look, MotionStream
from physgen.edit.operations import apply_operations

Copy = Callable[[str], Path]
FREE = """\
physgen: 1
size: [400, 300]
world: {gravity: [0, 0], duration: 0.8}
objects:
  ball: {shape: {circle: {center: [60, 150], radius: 10}}, mass: 20%s}
  box: {shape: {box: {center: [300, 60], size: [20, 20]}}}
"""


def scene(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def parts(live: Live, look: Look) -> tuple[np.ndarray, list[int]]:
    """All samples (T, N, 6) of a look's motion, and the numbers of those that are frames."""
    part: Any = look.motion
    assert part is not None
    frames, total, found = part["frames"], part["total"], []
    while True:
        assert part["from"] == sum(map(len, found))
        columns = [
            [unpacked(body[name]) for name in COLUMNS] for body in part["bodies"]
        ]
        found.append(np.moveaxis(np.array(columns), 2, 0))
        if part["done"]:
            break
        part = live.next_part(part["key"], part["upto"])
        assert part is not None
        assert part["upto"] > part["from"], "every answer brings something"
    every = np.concatenate(found)
    assert len(every) == total
    return every, frames


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "ops", "variant"),
    [
        ("wall-ball", [], "beach-ball"),
        ("seesaw", [{"set": ["world", "gravity"], "value": [30, 600]}], None),
        (
            "dominoes",
            [{"set": ["objects", "domino-3", "place"], "value": [300, 200, 20]}],
            None,
        ),
    ],
)
def test_poses_are_those_of_simulate_to_the_bit(
    copied: Copy, name: str, ops: list[dict[str, Any]], variant: str | None
) -> None:
    """After an edit, of the file as it is saved: no pose and no velocity differs in its last place."""
    path = copied(name)
    text = apply_operations(path.read_text(), ops).text if ops else path.read_text()
    live = Live(path)
    every, frames = parts(live, live.look(text, variant=variant))
    path.write_text(text)
    run = simulated(path, *([] if variant is None else ["--variant", variant]))
    assert np.array_equal(every[frames][:, :, :3], run.poses)
    assert np.array_equal(every[frames][:, :, 3:], run.velocities)


def test_a_push_is_seen_as_newton_has_it(tmp_path: Path) -> None:
    """Without gravity: x = v t after a velocity, v = J / m after an impulse, x = F t² / 2 m under a force."""
    live = Live(scene(tmp_path, FREE % ""))
    t: np.ndarray | None = None
    for text, way in (
        (FREE % ", velocity: [250, -50]", lambda t: (250 * t, -50 * t)),
        (
            FREE % "" + "forces:\n  - {object: ball, impulse: [3000, 0]}\n",
            lambda t: (150 * t, 0 * t),
        ),
        (
            FREE % "" + "forces:\n  - {object: ball, force: [0, 8000]}\n",
            lambda t: (0 * t, 400 * t**2 / 2),
        ),
    ):
        look = live.look(text)
        every, _ = parts(live, look)
        assert look.motion is not None
        t = unpacked(look.motion["times"])
        ball = [body["name"] for body in look.motion["bodies"]].index("ball")
        x, y = way(t)
        np.testing.assert_allclose(every[:, ball, 0], 60 + x, atol=1e-6)
        np.testing.assert_allclose(every[:, ball, 1], 150 + y, atol=1e-6)
    assert t is not None
    assert t[0] == 0


def test_lints_are_told_at_the_object_that_they_mean(tmp_path: Path) -> None:
    """In its entry alone; the line is where the key stands."""
    text = (
        FREE % ", rolling: 0.1"
        + "forces:\n  - {object: box, force: [1, 0], start: 7}\n"
    )
    text = text.replace("size: [20, 20]}}}", "size: [20, 20]}}, rolling: 0.2}")
    look = Live(scene(tmp_path, text)).look(text)
    wrong = Live(scene(tmp_path, text)).look(text.replace("start: 7", "start: soon"))
    assert [(p["object"], p["line"]) for p in wrong.problems] == [(None, 8)]
    told = {(p["path"], p["object"], p["line"]) for p in look.problems}
    assert ("objects.box.rolling", "box", 6) in told
    assert ("forces[0].start", None, 8) in told
    assert look.motion is not None


def test_a_run_that_leaves_all_numbers_ends_there_and_says_so(tmp_path: Path) -> None:
    """What was simulated until then is shown; nobody is asked to wait for more."""
    text = FREE % "" + "forces:\n  - {object: ball, force: [1.0e12, 0], start: 0.2}\n"
    sight = Live(scene(tmp_path, text)).state(text)
    light = tuple(
        replace(body, mass=1e-300, moment=1e-300)
        for body in sight.compiled_scene.world.bodies
    )
    stream = MotionStream(
        "motion", sight.scene, replace(sight.compiled_scene.world, bodies=light)
    )
    part = stream.part(0, time.perf_counter() + 60)
    assert part["done"]
    assert part["upto"] < part["total"]
    (problem,) = stream.problems
    assert problem.path == "objects.ball"
    assert "becomes larger than any number by t = 0.2" in str(problem)
    assert unpacked(part["bodies"][0]["x"]).tolist() == [60.0] * part["upto"]


def test_a_file_that_it_extends_is_read_again(tmp_path: Path) -> None:
    base = tmp_path / "base.yaml"
    base.write_text(FREE % "")
    text = "extends: base.yaml\nobjects: {ball: {mass: 30}}\n"
    live = Live(scene(tmp_path, text))
    assert live.look(text).derived_data["objects"]["ball"]["centre"] == [60, 150]  # type: ignore[index]
    base.write_text((FREE % "").replace("[60, 150]", "[90, 150]"))
    assert live.look(text).derived_data["objects"]["ball"]["centre"] == [90, 150]  # type: ignore[index]


def test_centres_and_masses_are_those_of_the_engine(tmp_path: Path) -> None:
    """A box of density 2 weighs what its area says, and is where it is put."""
    text = (FREE % "").replace(
        "size: [20, 20]}}}", "size: [40, 20]}}, density: 2, place: [200, 100, 90]}"
    )
    derived = Live(scene(tmp_path, text)).look(text).derived_data
    assert derived is not None
    box = derived["objects"]["box"]
    assert box["mass"] == pytest.approx(2 * 40 * 20)
    assert box["moment"] == pytest.approx(1600 * (40**2 + 20**2) / 12)
    assert box["centre"] == pytest.approx([200, 100])
