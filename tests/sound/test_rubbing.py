"""Sliding and rolling of whole scenes, as sound hears them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physgen.export.events import ClipTimes
from physgen.export.labels import Clip
from physgen.pipeline import stages
from physgen.sound.track import Caption, SoundTrack, rubbings

HEAD = """
physgen: 1
size: [400, 200]
world: {world}
"""
SIDE = "{view: side, duration: 1, pixels_per_meter: 400}"
TOP = "{view: top, duration: 1, pixels_per_meter: 400, table: {friction: 0.5}}"


def heard_power(folder: Path, world: str, body: str) -> float:
    """Return the mean power (W) of friction noise over a clip."""
    path = folder / "scene.yaml"
    path.write_text(HEAD.replace("{world}", world) + body)
    scene = stages.load(path, [])
    compiled, _ = stages.ended(scene, stages.compile(scene, None))
    motion = stages.simulate(compiled.world)
    shot = stages.shot(scene, motion)
    clip = Clip(
        "clip", scene, compiled.world, motion, None, scene.video_size,
        scene.render.fps, len(shot.order), shot,
    )  # fmt: skip
    found = rubbings(clip, ClipTimes(clip))
    return float(sum(np.mean(rubbing.power) for rubbing in found))


FLOOR = "boundaries:\n  floor: {polyline: [[-900, 150], [1300, 150]], %s}\n"
BOX = "shape: {box: {center: [200, 130], size: [40, 40]}}"


def test_box_at_rest_on_a_belt_slides(tmp_path: Path) -> None:
    held = "objects:\n  box: {" + BOX + ", friction: 0.1}\n"
    walls = "  wall: {polyline: [[221, 0], [221, 150]], friction: 0}\n"
    running = heard_power(tmp_path, SIDE, held + FLOOR % "conveyor: 200" + walls)
    still = heard_power(tmp_path, SIDE, held + FLOOR % "friction: 0.5" + walls)
    assert running > 1e-9
    assert running > 20 * still


def test_puck_carried_by_a_belt_is_quiet(tmp_path: Path) -> None:
    puck = "objects:\n  puck: {shape: {circle: {center: [100, 100], radius: 10}}%s}\n"
    belt = "fields:\n  belt: {belt: [0, 0, 400, 200], velocity: [80, 0]}\n"
    carried = heard_power(tmp_path, TOP, puck % ", velocity: [80, 0]" + belt)
    thrown = heard_power(tmp_path, TOP, puck % ", velocity: [80, 0]")
    assert thrown > 1e-10
    assert carried < 0.05 * thrown


def test_rolling_is_the_same_for_each_order_of_names(tmp_path: Path) -> None:
    shape = "shape: {circle: {center: [80, 90], radius: 10}}, solid: sphere"
    ball = "{" + shape + ", rolling: 0.02, velocity: [150, 0], spin: 859}"
    slab = "{shape: {box: {center: [200, 110], size: [380, 20]}}, motion: static}"
    first = heard_power(tmp_path, SIDE, f"objects:\n  a: {ball}\n  b: {slab}\n")
    second = heard_power(tmp_path, SIDE, f"objects:\n  b: {ball}\n  a: {slab}\n")
    assert first == pytest.approx(second, rel=0.05)
    assert first > 0


def test_captions_escape_labels() -> None:
    track = SoundTrack(
        np.zeros((2, 2), np.int16), (Caption(0.5, "a --> b\n\n<ball>", 1.0),)
    )
    assert "a --&gt; b &lt;ball&gt;" in track.vtt()
    assert track.vtt().count("-->") == 1
