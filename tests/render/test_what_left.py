"""What objects leave behind, beside the path tracer's picture of the empty place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.compile.compile import Compiled
from physgen.maps import Percepts
from physgen.perceive.inpaint.poisson import dilate
from physgen.photometry import decode
from physgen.render.stage import Stage
from physgen.simulate.engine import simulate


def opened(bundled: Path, name: str) -> tuple[Percepts, Compiled, Stage]:
    """A bundled scene's maps, world and stage."""
    scene = pipeline.load(bundled / name / "scene.yaml")
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    return maps, compiled, pipeline.stage(scene, compiled, maps)


def emptied(compiled: Compiled, stage: Stage, stays: str = "") -> list[np.ndarray]:
    """sRGB of the first frame, and of one that all objects but one have left."""
    track = simulate(compiled.world, np.array([0.0, 0.1]))
    far = np.full(track.poses[0].shape, 1e5)
    far[:, 2] = 0
    far[[body.name == stays for body in compiled.world.bodies]] = 0
    away = replace(track, poses=track.poses + np.stack([0 * far, far]))
    return [frame.rgb.astype(int) for frame in pipeline.render(stage, away)]


@pytest.mark.parametrize("name", ["wall-ball", "rubber-balls"])
def test_objects_take_their_shadows_and_rims_with_them(bundled: Path, name: str) -> None:
    maps, compiled, stage = opened(bundled, name)
    first, empty = emptied(compiled, stage)
    assert np.abs(first - maps.rgb).max() <= 1
    old = np.abs(maps.rgb.astype(int) - maps.clean).max(axis=2) > 20
    assert np.count_nonzero(old) > 3000
    off = np.abs(empty - maps.clean).max(axis=2)
    assert np.percentile(off[old], 99) <= 3
    assert off[old].max() <= 24  # 17 px at the far edge of the flying ball's shadow


def test_marbles_leave_no_rims_beside_their_trough(bundled: Path) -> None:
    maps, compiled, stage = opened(bundled, "marbles")
    _, left = emptied(compiled, stage, "trough")
    trough = [body.name for body in compiled.world.bodies].index("trough")
    beside = (maps.labels > 0) & ~dilate(compiled.labels == trough + 1, 2)
    assert np.count_nonzero(beside) > 4000
    assert np.abs(left - maps.clean)[beside].max() <= 12


def test_shadows_go_on_behind_what_throws_them(bundled: Path) -> None:
    """What the photo shows of a shadow beside the plank, and what is worked out behind it, meet without a step."""
    maps, compiled, stage = opened(bundled, "seesaw")
    lit = stage.lit
    plank = compiled.labels == 1 + [body.name for body in compiled.world.bodies].index("plank")
    dark = cv2.blur(np.log(decode(maps.clean).mean(axis=2) / lit.behind().mean(axis=2)), (5, 1))
    for x in range(130, 190):  # clear of the stone above and of the log below
        bottom = np.flatnonzero(plank[:, x]).max()
        assert abs(dark[bottom + 4, x] - dark[bottom + 1, x]) < 0.35
        assert dark[bottom - 8, x] > -0.02


def test_shadows_of_many_leave_light_and_end_at_their_shelf(bundled: Path) -> None:
    """Three books lean together at the end: their shadows stay out of the shelf below, and nothing is black."""
    maps, compiled, stage = opened(bundled, "shelf")
    track = simulate(compiled.world, np.array([0.0, 1.5]))
    _, last = (frame.rgb.astype(int) for frame in pipeline.render(stage, track))
    assert np.count_nonzero(last.max(axis=2) < 4) < 20
    assert np.abs(last - maps.rgb)[470:, 20:490].max() <= 8
