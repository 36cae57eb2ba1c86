"""What a scene looks like before anything moves, and where the photo shows its objects.

Scenes that differ in masses, coefficients, velocities or forces alone look the same, and share their sprites.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry.polygon import Disc, Outline, Pose, Region, Ring, mass_properties, rotation
from physgen.scene.scene import Object, Scene

Array = NDArray[np.float64]


def placed_outline(outline: Outline, item: Object) -> Outline:
    """The outline at t = 0."""
    if item.place is None:
        return outline
    x, y, degrees = item.place
    center, turn = mass_properties(outline).center, rotation(radians(degrees))

    def there(points: Array) -> Array:
        return (points - center) @ turn.T + (x, y)

    if isinstance(outline, Disc):
        return Disc(np.array([x, y]), outline.radius)
    return Region(tuple(Ring(there(ring.outer), tuple(map(there, ring.holes))) for ring in outline.rings))


def rest_pose(outline: Outline, item: Object, scene: Scene) -> Array | None:
    """(3,) px, px, rad: the pose in which the photo shows what is put elsewhere; `outline` as the photo shows it.

    None without a photo: what is drawn there is drawn where it is.
    """
    if item.place is None or scene.image is None:
        return None
    return np.array([*mass_properties(outline).center, -radians(item.place[2])])


def photo_poses(world: World) -> tuple[Pose, ...]:
    """The poses in which the photo shows the bodies; empty where all begin so."""
    if all(body.rest is None for body in world.bodies):
        return ()
    shown = (np.append(body.center, 0.0) if body.rest is None else body.rest for body in world.bodies)
    return tuple(Pose(float(x), float(y), float(angle)) for x, y, angle in shown)


def body_in_photo(body: Body) -> Body:
    """The body as the photo shows it, in a frame turned by 0 there."""
    if body.rest is None:
        return body
    turn = rotation(float(body.rest[2]))
    return replace(
        body,
        center=body.rest[:2],
        rings=tuple(ring @ turn.T for ring in body.rings),
        pieces=tuple(piece @ turn.T for piece in body.pieces),
        rest=None,
    )


def world_in_photo(world: World) -> World:
    """The world with all bodies as the photo shows them."""
    return replace(world, bodies=tuple(map(body_in_photo, world.bodies)))


def appearance(scene: Scene, world: World) -> tuple[object, ...]:
    """All values but the photo's maps that a Stage depends on, as plain data for the key of a cache.

    Masses, coefficients, velocities, forces and times are not among them. A scene without a photo is drawn as large as
    it is filmed, so its camera counts.
    """
    render, settings = scene.render, scene.world
    camera = () if scene.image is not None else (render.scale, render.size, render.camera)
    bodies = [
        (body.center, body.radius, body.pieces, body.rings, body.solid)
        for body in world_in_photo(world).bodies
    ]
    return (
        (scene.size, scene.image is not None, scene.assets is not None, scene.light),
        (settings.view, settings.tilt, settings.backdrop),
        (render.relight, render.shadows, render.supersample, camera),
        [item.layer for item in scene.objects],
        (world.size, world.view, bodies, [wall.chains for wall in world.walls]),
    )
