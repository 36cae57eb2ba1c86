"""A metal ball, also on a thread, which turns with the ball; mirror images do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physgen.arrays import F32, Mask
from physgen.compile.world import Body
from physgen.perceive.inpaint.poisson import harmonic_fill
from physgen.render.sprites import CUT, Sprite

EYELET = 0.4
"""Reach of the foot of a thread, inwards and outwards, radii; chosen by eye."""


PAINT = 0.2
"""Difference of a colour's share of the light from the median of its ball that is
paint; chosen by eye.
"""
PAINTED = 0.15
"""Share of a ball's pixels from which paint is a pattern."""


def has_one_hue(ball: Sprite) -> bool:
    """Check whether a metal ball is bare: mirror images have the hue of the metal."""
    light = ball.light[ball.coverage >= 1] + np.float32(CUT.least_light)
    if not len(light):
        return True
    hue = light / light.sum(axis=1, keepdims=True)
    difference = np.abs(hue - np.median(hue, axis=0)).max(axis=1)
    return float((difference > PAINT).mean()) < PAINTED


def without_eyelet(ball: Sprite, thread: Sprite, body: Body) -> Sprite:
    """Return a metal ball without the foot of its thread, which turns with the thread.

    The metal beside the foot continues behind it. A painted ball stays.
    """
    if not has_one_hue(ball):
        return ball
    is_foot = _foot(ball, thread, body)
    is_metal = (ball.coverage >= 1) & ~is_foot
    if not is_foot.any() or not is_metal.any():
        return ball
    colour = ball.light / np.maximum(ball.coverage, 1e-3)[..., None]
    level = np.asarray(np.log(colour + np.float32(CUT.least_light)), np.float32)
    filling = np.exp(harmonic_fill(level, ~is_metal)) - np.float32(CUT.least_light)
    filling = np.maximum(filling, 0) * ball.coverage[..., None]
    light: F32 = np.where(is_foot[..., None], filling, ball.light).astype(np.float32)
    return replace(ball, light=light)


def _foot(ball: Sprite, thread: Sprite, body: Body) -> Mask:
    """Return the pixels (h, w) of a ball beneath the foot of its thread."""
    radius = body.radius
    assert radius is not None
    rows, columns = np.indices(ball.coverage.shape)
    x = columns + ball.corner[0] - body.center[0]
    y = rows + ball.corner[1] - body.center[1]
    distance = np.hypot(x, y)
    inner = radius + CUT.clean_depth + 1
    outer = (1 + EYELET) * radius
    # The thread just above the ball shows where its foot is.
    foot = thread.coverage * ((distance > inner) & (distance < outer))
    direction = np.array([(x * foot).sum(), (y * foot).sum()], np.float64)
    length = float(np.hypot(*direction))
    if length < 1e-6:
        return np.zeros(ball.coverage.shape, np.bool_)
    distance_along = (x * direction[0] + y * direction[1]) / length
    distance_across = np.abs(x * direction[1] - y * direction[0]) / length
    width = distance_across[foot > 0.5].max(initial=0.0) + CUT.clean_depth
    is_foot = (distance_across <= width) & (distance_along > (1 - EYELET) * radius)
    return np.asarray(is_foot, np.bool_)
