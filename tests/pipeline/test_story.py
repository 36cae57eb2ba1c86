"""Motions that sentences ask for, judged by the simulation of the edits that they print."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from physgen.pipeline import stages
from physgen.pipeline.story import tell_story
from physgen.problems import InputError
from physgen.scene.load import OpenedScene
from physgen.scene.write import flow_text

ROOT = Path(__file__).resolve().parents[2]
SENTENCES: list[dict[str, Any]] = yaml.safe_load(
    Path(__file__).with_name("story_sentences.yaml").read_text("utf-8")
)
LEAST_FULFILLED = 32


@cache
def opened(name: str) -> OpenedScene:
    return OpenedScene(ROOT / "scenes" / name / "scene.yaml", False)


@lru_cache(maxsize=2)
def compiled_of(name: str, overrides: tuple[str, ...] = ()) -> tuple[Any, Any]:
    scene = opened(name).scene(overrides, None)
    compiled, _ = stages.ended(scene, stages.compile(scene, stages.percepts(scene)))
    return scene, compiled


class Film:
    """The motion after the edits of a sentence, and what of it can be asked."""

    def __init__(self, name: str, sentence: str) -> None:
        scene, compiled = compiled_of(name)
        self.telling = tell_story(scene, compiled, sentence)
        edits = self.telling.edits.items()
        overrides = tuple(f"{key}={flow_text(value, ())}" for key, value in edits)
        self.scene, after = compiled_of(name, overrides)
        self.world = after.world
        self.motion = stages.simulate(after.world)
        self.surfaces = [surface for surface, _ in self.world.surfaces]

    def poses(self, name: str) -> np.ndarray:
        return np.asarray(self.motion.poses[:, self.surfaces.index(name)])

    def height(self, name: str) -> float:
        rings = self.world.bodies[self.surfaces.index(name)].rings
        return float(np.ptp(np.concatenate(rings)[:, 1]))

    def touch(self, first: str, second: str) -> bool:
        pair = {self.surfaces.index(first), self.surfaces.index(second)}
        contacts = self.motion.contacts
        rows = zip(contacts.touch_pairs.tolist(), contacts.touch_times, strict=True)
        begins = [times[0] for row, times in rows if set(row) == pair]
        return bool(begins) and min(begins) > 0.005

    def turn(self, name: str, degrees: float) -> bool:
        angle = self.poses(name)[:, 2]
        return bool(np.degrees(np.abs(angle - angle[0]).max()) >= degrees)

    def shift(self, name: str, way: str) -> bool:
        offset = self.poses(name)[:, :2] - self.poses(name)[0, :2]
        ways = {"left": -offset[:, 0], "right": offset[:, 0], "up": -offset[:, 1]}
        distance = ways.get(way, np.hypot(*offset.T))
        return bool(distance.max() >= 0.05 * max(self.world.size))

    def drop(self, name: str) -> bool:
        y = self.poses(name)[:, 1]
        return bool(y[-1] - y[0] >= 0.5 * self.height(name))

    def rise(self, name: str) -> bool:
        y = self.poses(name)[:, 1]
        return bool(y[0] - y.min() >= 0.25 * self.height(name))

    def rest(self, name: str) -> bool:
        last = self.poses(name)[-3:]
        return bool(np.ptp(last[:, :2], axis=0).max() < 0.5)


def holds(film: Film, kind: str, arguments: list[Any]) -> bool:
    """Return whether an outcome is true of one of the objects that each argument lists."""
    choices: list[list[Any]] = [[]]
    for argument in arguments:
        options = argument if isinstance(argument, list) else [argument]
        choices = [[*choice, option] for choice in choices for option in options]
    return any(getattr(film, kind)(*choice) for choice in choices)


def is_fulfilled(row: dict[str, Any]) -> bool:
    film = Film(row["scene"], row["sentence"])
    return all(holds(film, kind, args) for kind, args in row["outcome"].items())


@pytest.mark.slow
def test_most_sentences_come_true() -> None:
    missed = [row["sentence"] for row in SENTENCES if not is_fulfilled(row)]
    assert len(SENTENCES) == 40
    assert len(SENTENCES) - len(missed) >= LEAST_FULFILLED, missed


@pytest.mark.slow
@pytest.mark.parametrize("row", [SENTENCES[0], SENTENCES[10]], ids=["turn", "drop"])
def test_sentence_comes_true(row: dict[str, Any]) -> None:
    assert is_fulfilled(row)


@pytest.mark.slow
def test_impossible_story_reports_the_nearest_outcome() -> None:
    scene, compiled = compiled_of("bottle-book")
    telling = tell_story(scene, compiled, "lift the table with the bottle")
    assert not telling.comes_true
    assert "bottle" in telling.outcome


@pytest.mark.parametrize(
    ("sentence", "code"),
    [
        ("the bottle is green", "story-without-verb"),
        ("push it", "story-without-object"),
        ("", "story-without-verb"),
        ("the zebra hits the bottle", "story-noun-unknown"),
    ],
)
def test_sentence_that_is_not_understood(sentence: str, code: str) -> None:
    scene, compiled = compiled_of("bottle-book")
    with pytest.raises(InputError) as error:
        tell_story(scene, compiled, sentence)
    assert [problem.code for problem in error.value.problems] == [code]
