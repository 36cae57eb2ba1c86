"""Sentences: plain, true, and made of nothing that did not happen; judged from the trajectory alone."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from storied import clip, clip_of

from physgen.export.events import story
from physgen.export.labels import Clip

CAN = """\
  ball:
    {label: a red ball, shape: {circle: {center: [60, 168], radius: 12}}, mass: 300, velocity: [260, 0], friction: 0.1}
  can: {label: can, shape: {box: {center: [200, 150], size: [24, 60]}}, mass: 60, friction: 0.8, elasticity: 0.1}
"""
TABLE = "boundaries.floor.elasticity=0.2"
PUSHED = "  cup: {label: cup, shape: {box: {center: [60, 165], size: [30, 30]}}, mass: 100, friction: 0.3}\n"
PUSH = "forces=[{object: cup, impulse: [8000, 0]}]"


def caption(told: Clip) -> str:
    return story(told).caption


def test_the_caption_is_made_of_the_sentences_of_events(tmp_path: Path) -> None:
    told = clip(tmp_path, CAN, TABLE, "world.duration=2")
    text = caption(told)
    assert text.startswith("The red ball moves to the right at the start. ")
    assert "The red ball hits the can after 0.4" in text
    assert "The can tips over after " in text
    assert "tips" not in caption(clip(tmp_path, CAN, TABLE, "objects.ball.mass=2"))
    assert "can" not in caption(clip(tmp_path, CAN, TABLE, "objects.can="))


def test_without_the_push_nothing_moves(tmp_path: Path) -> None:
    pushed = caption(clip(tmp_path, PUSHED, PUSH))
    assert pushed.startswith("The cup is pushed to the right at the start. The cup comes to rest after ")
    assert caption(clip(tmp_path, PUSHED)) == "Nothing moves."
    left = caption(clip(tmp_path, PUSHED, PUSH.replace("8000", "-8000")))
    assert left == pushed.replace("right", "left")  # mirrored


def test_objects_with_one_label_are_called_by_their_names(tmp_path: Path) -> None:
    balls = "".join(
        f"  ball-{k}: {{shape: {{circle: {{center: [{60 + 80 * k}, 100], radius: 12}}}}, mass: 5, elasticity: 1}}\n"
        for k in range(3)
    )
    edits = ("objects.ball-0.velocity=[300, 0]", "world.gravity=[0, 0]", "world.duration=0.8")
    assert "ball-0 hits ball-1 after 0.19 s." in caption(clip(tmp_path, balls, *edits)).lower()


def test_a_clip_in_slow_motion_has_its_own_time(tmp_path: Path) -> None:
    told = clip(tmp_path, CAN, TABLE, "render.frames=72", "render.fps=15")  # 1.2 s in 4.8 s
    assert caption(told).endswith("The clip shows this 4 times slower than it happens.")
    assert "hits the can after 1.9" in caption(told)
    back = clip(tmp_path, CAN, TABLE, "render.play=backward")
    assert caption(back).endswith("The clip shows this backward.")


def test_what_happens_outside_the_picture_is_not_in_the_caption(tmp_path: Path) -> None:
    away = "render.camera={zoom: 4, center: [60, 150]}"  # the can is not seen
    told = clip(tmp_path, CAN, TABLE, away)
    assert caption(told) == (
        "The red ball moves to the right at the start. "
        "The red ball leaves the picture on the right after 0.25 s."
    )


@pytest.mark.parametrize(
    "label", ["ball. The can explodes", "\u202eball\u202c", "b" * 200, "<b>ball</b>", "=cmd()"]
)
def test_a_label_that_is_no_few_words_is_not_in_sentences(tmp_path: Path, label: str) -> None:
    told = clip(tmp_path, CAN.replace("a red ball", json.dumps(label)), TABLE)
    assert caption(told) == caption(clip(tmp_path, CAN, TABLE)).replace("red ball", "ball")


# What a sentence claims is looked up in the trajectory, not in the events

HALF = 0.0051
SCENES = {
    "can": (CAN, (TABLE,)),
    "pushed": (PUSHED, (PUSH,)),
    "stack": (
        "".join(
            f"  block-{k}: {{shape: {{box: {{center: [200, {165 - 30 * k}], size: [30, 30]}}}}, mass: 40}}\n"
            for k in range(4)
        )
        + "  ball: {shape: {circle: {center: [40, 120], radius: 12}}, mass: 90, velocity: [420, -60]}\n",
        (TABLE,),
    ),
    "out": (CAN, (TABLE, "objects.ball.velocity=[900, 0]", "boundaries.floor.friction=0")),
}


@pytest.mark.parametrize("name", SCENES)
def test_every_claim_is_true_of_the_trajectory(tmp_path: Path, name: str) -> None:
    objects, edits = SCENES[name]
    told = clip(tmp_path, objects, *edits)
    judged(told)


@pytest.mark.parametrize(
    ("scene", "variant"),
    [("dominoes", None), ("dominoes", "gap"), ("bottle-book", None), ("bottle-book", "too-gentle")],
)
def test_every_claim_about_a_bundled_scene_is_true(bundled: Path, scene: str, variant: str | None) -> None:
    told = clip_of(bundled / scene / "scene.yaml", (), variant)
    judged(told)
    turned = np.abs(told.trajectory.poses[:, :, 2]).max(axis=0) > np.pi / 4
    standing = np.array([body.radius is None for body in told.world.bodies])
    fallen = int((turned & standing).sum())
    if scene == "dominoes":
        assert f"{fallen} objects tip over" in caption(told)
        assert fallen == (8 if variant else 9)
    if variant == "too-gentle":
        assert fallen == 0
        assert "over" not in caption(told)
        assert "The glazed bottle" not in caption(told)


def judged(told: Clip) -> None:
    """Each sentence of one event."""
    names = [name for name, _ in told.world.surfaces]
    for event, text in zip(story(told).events, story(told).sentences, strict=True):
        if " and " not in text and event.time <= told.trajectory.times[-1]:
            claim(told, text, [names[k] for k in event.surfaces])


def claim(told: Clip, text: str, who: list[str]) -> None:
    """Fails where a sentence about some things says what the trajectory does not."""
    seen, pace = told.trajectory, 1 / (told.fps * told.trajectory.times[1])
    index = {name: k for k, name in enumerate(seen.names)}
    bodies = [index[name] for name in who if name in index]
    when = [float(number) / pace for number in re.findall(r"([\d.]+) s\b", text)]
    moved = np.hypot(*np.moveaxis(seen.poses[:, bodies, :2] - seen.poses[0, bodies, :2], -1, 0)).max(axis=0)
    turned = np.abs(seen.poses[:, bodies, 2]).max(axis=0)
    speed = np.hypot(*np.moveaxis(seen.velocities[:, bodies, :2], -1, 0))
    if " hits " in text:
        surfaces = list(seen.contacts.surfaces)
        pairs = [
            (begin, end)
            for (one, other), (begin, end) in zip(
                seen.contacts.touch_pairs, seen.contacts.touch_times, strict=True
            )
            if {surfaces[one], surfaces[other]} <= set(who)
        ]
        assert any(begin - HALF - 0.01 <= when[0] <= end + HALF + 0.01 for begin, end in pairs), text
    if " over" in text:
        assert (turned > np.pi / 4 - 0.1).any(), text
    if "comes to rest" in text:
        rest = int(np.searchsorted(seen.times, when[-1] + HALF / pace + 1e-6))
        assert speed[min(rest, len(speed) - 1) :].max() < 1, text
        assert moved.min() > 0, text
    if "leaves the picture" in text:
        side = 0 if "left" in text or "right" in text else 1
        assert (
            np.abs(seen.poses[:, bodies, side] - told.size[side] / 2).max(axis=0) > told.size[side] / 2
        ).all(), text
    for word, sign in (("to the right", 1), ("to the left", -1)):
        if f"moves {word}" in text or f"pushed {word}" in text:
            assert (sign * (seen.poses[3, bodies, 0] - seen.poses[0, bodies, 0]) > 0).all(), text
    assert re.fullmatch(r"[A-Z0-9“].*[^.]\.", text), text
