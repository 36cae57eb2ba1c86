"""Things that move by parts of a pixel, or turn, stay as sharp and as bright as they are in the photo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from physgen import pipeline
from physgen.geometry.polygon import rotation
from physgen.photometry import decode
from physgen.render.frames import render_frames
from physgen.render.stage import Stage
from physgen.simulate.engine import simulate

ROOT = Path(__file__).resolve().parents[2]


def sharpness(rgb: np.ndarray, weight: np.ndarray) -> float:
    """Weighted mean gradient of luma."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(float)
    gx, gy = (cv2.Scharr(grey, cv2.CV_64F, *order) / 32 for order in ((1, 0), (0, 1)))
    return float((np.hypot(gx, gy) * weight).sum() / weight.sum())


def colour(rgb: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(3,) weighted mean of light, in about grey levels."""
    light = (decode(rgb) * weight[..., None]).sum(axis=(0, 1)) / weight.sum()
    return 255 * np.cbrt(light)


@pytest.mark.parametrize("name", ["shelf", "kitchen", "dominoes"])
@pytest.mark.parametrize(
    "move",
    [(0.5, 0.0, 0.0), (0.5, 0.5, 0.0), (0.0, 0.0, 45.0)],
    ids=["x", "xy", "turned"],
)
def test_what_moves_stays_sharp_and_keeps_its_colour(
    name: str, move: tuple[float, float, float]
) -> None:
    scene = pipeline.load(
        ROOT / "scenes" / name / "scene.yaml",
        ["render.relight=false", "render.shadows=false"],
    )
    maps = pipeline.percepts(scene)
    assert maps is not None
    compiled = pipeline.compile(scene, maps)
    stage = pipeline.stage(scene, compiled, maps)
    still = simulate(compiled.world, np.array([0.0, 0.1]))
    dx, dy, degrees = move
    height, width = compiled.labels.shape
    tried = 0
    for k, body in enumerate(compiled.world.bodies):
        # alone in the picture, in its middle
        alone = Stage(stage.background, [s for s in stage.sprites if s.body == k])
        own = (compiled.labels == k + 1).astype(np.uint8)
        face = max((sprite.face for sprite in alone.sprites), default=0.0)
        first = np.flatnonzero(own.any(axis=1)).min(initial=height)
        own[: int(first + np.ceil(2 * face))] = 0  # its front alone turns
        own = cv2.erode(own, np.ones((11, 11)))
        # weights that fade towards the object's border, so that the same of it counts before and after
        weight = cv2.blur(
            own.astype(np.float32), (7, 7), borderType=cv2.BORDER_CONSTANT
        )
        if own.sum() < 400:
            continue
        poses = still.poses.copy()
        poses[1, k] = poses[0, k] + (dx, dy, np.radians(degrees))
        _, frame = render_frames(alone, replace(still, poses=poses))
        turn = rotation(np.radians(degrees))
        center = body.center + np.array(
            [0.0, face]
        )  # a front turns about its own middle
        matrix = np.column_stack([turn, center + np.array([dx, dy]) - turn @ center])
        there = cv2.warpAffine(weight, matrix, (width, height))
        if there.sum() < 0.999 * weight.sum():
            continue  # it turned out of the picture
        tried += 1
        assert sharpness(frame.rgb, there) >= 0.9 * sharpness(maps.rgb, weight), (
            body.name
        )
        assert (
            np.abs(colour(frame.rgb, there) - colour(maps.rgb, weight)).max() < 0.5
        ), body.name
    assert tried >= 3
