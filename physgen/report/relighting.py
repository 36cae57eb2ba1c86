"""One frame with and without relighting, for a slider on the report page."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.render.frames import render_frames
from physgen.render.stage import Stage
from physgen.report.perception import Comparison, compared
from physgen.simulate.trajectory import Trajectory, rotation_matrices

U8 = NDArray[np.uint8]
Array = NDArray[np.float64]

TURNED = 0.03
"""1 - cos of the turn, 14 degrees, below which light is as good as where it was."""
SEEN = 6.0
"""Grey levels of 255, where most is seen: below, nobody would."""
PARTS = (0.4, 0.55, 0.75)
"""Of the frame's sides, that are cut out of it."""
ENOUGH = 0.6
"""Of all that differs, that lies in what is cut out."""


def relighting_comparison(stage: Stage, trajectory: Trajectory) -> Comparison | None:
    """At the moment at which things that can be relit have turned most, as near as most of it can be seen.

    Without relighting, shading turns with its thing, as it does on a cut-out.
    """
    able = [sprite.ball is not None or sprite.relief is not None for sprite in stage.sprites]
    if not any(able) or len(trajectory.times) < 2:
        return None
    sample = _turned_most(stage, trajectory, able)
    if sample is None:
        return None
    bare = replace(
        stage,
        sprites=[
            replace(sprite, ball=None, relief=None) if can else sprite
            for sprite, can in zip(stage.sprites, able, strict=True)
        ],
    )
    before, after = (next(render_frames(drawn, trajectory, (sample,))).rgb for drawn in (bare, stage))
    window = _where(before, after)
    if window is None:
        return None
    rolls = trajectory.turns.size and any(sprite.ball is not None for sprite in stage.sprites)
    new = "balls roll, and the light stays where it is" if rolls else "the light stays where it is"
    said = (
        f"A part of the frame at {trajectory.times[sample]:.2f} s. Cut out, things take their light and shade along as "
        f"they turn; relit, {new}."
    )
    return compared("relit", "Relighting", said, ("cut out", before[window]), ("relit", after[window]))


def _where(before: U8, after: U8) -> tuple[slice, slice] | None:
    """Rows and columns of the smallest part that holds most of the difference; None where there is none to see."""
    off = np.asarray(cv2.absdiff(before, after), np.uint8).max(axis=2).astype(np.float32)
    height, width = off.shape
    if float(cv2.blur(off, (5, 5)).max()) < SEEN:
        return None
    sums = cv2.integral(off)
    for part in PARTS:
        tall, wide = round(part * height), round(part * width)
        inside = sums[tall:, wide:] - sums[:-tall, wide:] - sums[tall:, :-wide] + sums[:-tall, :-wide]
        y, x = np.unravel_index(int(inside.argmax()), inside.shape)
        if inside[y, x] >= ENOUGH * sums[-1, -1]:
            here = off[y : y + tall, x : x + wide]
            middle = [
                float((here.sum(axis=axis) * np.arange(here.shape[1 - axis])).sum() / here.sum())
                for axis in (1, 0)
            ]
            top = int(np.clip(y + middle[0] - tall / 2, 0, height - tall))
            left = int(np.clip(x + middle[1] - wide / 2, 0, width - wide))
            return slice(top, top + tall), slice(left, left + wide)
    return slice(0, height), slice(0, width)


def _turned_most(stage: Stage, trajectory: Trajectory, able: list[bool]) -> int | None:
    """The sample at which most would be wrong: pixels times 1 - cos of how far each has turned. None: none turns."""
    wrong = np.zeros(len(trajectory.times))
    axes = rotation_matrices(trajectory.turns) if trajectory.turns.size else None
    height, width = stage.background.shape[:2]
    for sprite, can in zip(stage.sprites, able, strict=True):
        if not can:
            continue
        pose = trajectory.poses[:, sprite.body]
        turn = 1 - np.cos(pose[:, 2] - pose[0, 2])
        if sprite.ball is not None and axes is not None:
            turn = np.maximum(turn, 1 - axes[:, sprite.body, 2, 2])
        x, y = (pose[:, :2].T + 0.5) * stage.scale - 0.5
        inside = (x > 0) & (x < width) & (y > 0) & (y < height)
        wrong += np.where(turn > TURNED, turn, 0) * inside * float(sprite.coverage.sum())
    return int(wrong.argmax()) if wrong.any() else None
