"""Wheels of vehicles: cut from the photo, or drawn in one colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physgen.arrays import F32
from physgen.compile.world import World
from physgen.render.sprites import (
    Sprite,
)
from physgen.render.wheel_sprites import drawn_wheel, wheel_from_photo


def locate_axles(sprite: Sprite, world: World) -> list[tuple[int, tuple[float, float]]]:
    """Return the number of each wheel of a sprite's body, and its axle in px of the
    sprite.
    """
    before = sum(len(body.wheels) for body in world.bodies[: sprite.body])
    body = world.bodies[sprite.body]
    axles = []
    for k, wheel in enumerate(body.wheels):
        x, y = (body.center + wheel.axle - sprite.corner).tolist()
        axles.append((before + k, (x, y)))
    return axles


def add_drawn_wheels(sprite: Sprite, world: World, colour: F32) -> Sprite:
    """Add wheels of a colour `(3,)` to a sprite, also at rest."""
    body = world.bodies[sprite.body]
    if not body.wheels:
        return sprite
    wheels = []
    light = sprite.light.copy()
    pairs = zip(locate_axles(sprite, world), body.wheels, strict=True)
    for (number, axle), body_wheel in pairs:
        wheel = drawn_wheel(number, axle, body_wheel.radius, 0.5 * colour)
        wheel.draw(light, sprite.coverage, np.eye(2, 3), 0.0)
        if body_wheel.turns:
            wheels.append(wheel)
    return replace(sprite, light=light, wheels=tuple(wheels))


def add_photo_wheels(sprite: Sprite, world: World) -> Sprite:
    """Add the wheels of its body that are drawn turning to a sprite, cut from the
    photo.
    """
    body = world.bodies[sprite.body]
    wheels = []
    pairs = zip(locate_axles(sprite, world), body.wheels, strict=True)
    for (number, axle), body_wheel in pairs:
        if not body_wheel.turns:
            continue
        radius = body_wheel.radius
        wheel = wheel_from_photo(sprite.light, sprite.coverage, number, axle, radius)
        if wheel is not None:
            wheels.append(wheel)
    return replace(sprite, wheels=tuple(wheels)) if wheels else sprite
