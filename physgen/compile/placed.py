"""Outlines and bodies as the photo shows them <-> as they are put at t = 0, where a scene puts them elsewhere."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry import Pose, rotation
from physgen.outline.outline import Disc, Outline, Region, Ring, mass_properties
from physgen.scene.model import Object, Scene

Array = NDArray[np.float64]


def put(outline: Outline, item: Object) -> Outline:
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


def rest(outline: Outline, item: Object, scene: Scene) -> Array | None:
    """(3,) px, px, rad: the pose in which the photo shows what is put elsewhere; `outline` as the photo shows it.

    None without a photo: what is drawn there is drawn where it is.
    """
    if item.place is None or scene.image is None:
        return None
    return np.array([*mass_properties(outline).center, -radians(item.place[2])])


def starts(world: World) -> tuple[Pose, ...]:
    """The poses in which the photo shows the bodies; empty where all begin so."""
    if all(body.rest is None for body in world.bodies):
        return ()
    shown = (np.append(body.center, 0.0) if body.rest is None else body.rest for body in world.bodies)
    return tuple(Pose(float(x), float(y), float(angle)) for x, y, angle in shown)


def pictured(body: Body) -> Body:
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
