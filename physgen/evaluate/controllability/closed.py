"""A body on a table seen from above -> how far a push takes it in a time, in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from physgen.compile.world import World
from physgen.scene.scene import Solid, View

SHARE = 5 / 2
"""m R²/I of a solid sphere."""


@dataclass(frozen=True)
class Law:
    """Distance by speed and time."""

    formula: str
    way: Callable[[float, float], float]
    """(px/s, s) -> px."""


def law(world: World, index: int) -> Law | None:
    """None where there is no closed form: seen from the side, or under joints, fields or pushes of the scene's own."""
    body = world.bodies[index]
    held = any(index in (joint.first, joint.second) for joint in world.joints)
    blown = any(index in field.bodies for field in world.fields)
    if world.view is not View.TOP or held or blown or any(push.body == index for push in world.pushes):
        return None
    grip = body.surface.friction * world.table.friction
    if body.solid is Solid.SPHERE and body.radius is not None:
        slip, resist = grip * world.press, body.rolling * world.press
        if resist >= slip:
            return None
        formula = "slides until v = R w, then rolls: v falls by mu g, then by 5/7 c g"
        return Law(formula, lambda speed, time: rolled(speed, time, slip, resist))
    brake = grip * world.press
    formula = "v²/(2 mu g), or v t - mu g t²/2 while it slides" if brake > 0 else "v t"
    return Law(formula, lambda speed, time: slid(speed, time, brake))


def slid(speed: float, time: float, brake: float) -> float:
    """px after `time` s of sliding, px/s² being lost.

    >>> slid(100, 10, 50), slid(100, 1, 50), slid(100, 2, 0)
    (100.0, 75.0, 200.0)
    """
    lasts = min(time, speed / brake) if brake > 0 else time
    return speed * lasts - brake * lasts**2 / 2


def rolled(speed: float, time: float, slip: float, resist: float) -> float:
    """px of a solid sphere that is pushed at its centre: `slip` is mu g, `resist` is c g, px/s².

    While it slides, friction turns it and resistance holds against that: v = v0 - mu g t, R w = 5/2 (mu - c) g t.

    >>> round(rolled(70, 0.1, 100, 10), 3), round(rolled(70, 60, 100, 10), 2)
    (6.5, 177.15)
    """
    if slip <= 0:
        return speed * time
    until = speed / (slip + SHARE * (slip - resist))
    if time <= until:
        return slid(speed, time, slip)
    left = speed - slip * until
    slows = resist * SHARE / (1 + SHARE)
    return slid(speed, until, slip) + slid(left, time - until, slows)
