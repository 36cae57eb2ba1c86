"""Balls apart from threads and handles on them, and lumpy fruit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physgen.arrays import F32
from physgen.compile.world import Body, World
from physgen.materials import (
    is_billiard_ball,
    is_polished_metal,
)
from physgen.render.hanging_ball import without_eyelet
from physgen.render.sprites import (
    Sprite,
)
from physgen.scene.scene import Scene, Solid, View


@dataclass(frozen=True)
class BallPartTuning:
    """Limits of parts outside a ball's circle."""

    outside_share: float = 0.03
    """Largest share of a ball's pixels outside its circle."""
    lump_reach: float = 0.5
    """Extent of a fruit beyond its circle, radii."""
    lump_turn: float = 0.2
    """Share of a turn in which a lump reaches beyond its circle; a thread
    covers less.
    """


PART = BallPartTuning()


def split_balls(
    scene: Scene, world: World, sprites: Sequence[Sprite]
) -> list[tuple[Sprite, bool]]:
    """Separate balls from threads as `separate_thread`; lumps in the side view stay whole."""
    parts = []
    for sprite in sprites:
        lumpiness = 0.0
        label = scene.objects[sprite.body].label
        # A lump does not roll as a sphere does: its picture turns as a whole.
        if world.view is View.SIDE and is_lump(sprite, world.bodies[sprite.body]):
            parts.append((sprite, False))
            continue
        if world.view is View.TOP and not is_billiard_ball(label):
            lumpiness = PART.lump_reach
        body = world.bodies[sprite.body]
        own_parts = separate_thread(sprite, body, lumpiness)
        if len(own_parts) == 2 and is_polished_metal(label):
            thread, ball = own_parts
            bare_ball = without_eyelet(ball[0], thread[0], body)
            own_parts = [thread, (bare_ball, False)]
        parts += own_parts
    return parts


def is_lump(sprite: Sprite, body: Body) -> bool:
    """Check whether a rolling object reaches beyond its circle on many sides.

    Such fruit turns as a picture: a skin on its circle would leave its outline behind.
    """
    if body.radius is None:
        return False
    rows, columns = np.nonzero(sprite.coverage > 0.5)
    x = columns + sprite.corner[0] - body.center[0]
    y = rows + sprite.corner[1] - body.center[1]
    is_stray = np.hypot(x, y) > body.radius + 2
    if np.count_nonzero(is_stray) <= PART.outside_share * len(rows):
        return False
    steps = np.unique((np.arctan2(y, x)[is_stray] * 36 / np.pi).astype(int))
    return len(steps) >= PART.lump_turn * 72


def separate_thread(
    sprite: Sprite, body: Body, lumpiness: float = 0.0
) -> list[tuple[Sprite, bool]]:
    """Separate a ball from a thread or a handle on it, which turns as a picture.

    The second value of a pair is True for a thread. Parts up to `lumpiness` radii
    beyond the circle belong to the ball.
    """
    if body.radius is None or body.solid is not Solid.SPHERE:
        return [(sprite, False)]
    x, y = body.center.tolist()
    rows, columns = np.indices(sprite.coverage.shape)
    distance = np.hypot(columns + sprite.corner[0] - x, rows + sprite.corner[1] - y)
    stray_area = sprite.coverage[distance > body.radius + 2].sum()
    farthest = distance[sprite.coverage > 0.5].max(initial=0.0)
    has_thread = bool(
        stray_area > PART.outside_share * sprite.coverage.sum()
        and farthest > (1 + lumpiness) * body.radius
    )
    # The thread is beneath the ball and reaches a pixel farther inwards, so that no gap
    # is visible between both.
    rim = 1 if has_thread else 2
    ball_share = np.clip(body.radius + rim - distance, 0, 1).astype(np.float32)
    ball = _mask_sprite(sprite, ball_share)
    if not has_thread:
        return [(ball, False)]
    thread_share = np.clip(distance - body.radius + 1, 0, 1).astype(np.float32)
    return [(_mask_sprite(sprite, thread_share), True), (ball, False)]


def _mask_sprite(sprite: Sprite, share: F32) -> Sprite:
    """Return the sprite with a share (h, w) of its light and coverage."""
    light = sprite.light * share[..., None]
    return replace(sprite, light=light, coverage=sprite.coverage * share)
