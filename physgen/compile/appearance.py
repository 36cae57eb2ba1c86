"""What a scene looks like before anything moves, and where the photo shows its objects.

`appearance` sets all values without effect on the first frame to constants. Sprites are cut out for its results, so
scenes that differ in masses, coefficients, velocities or forces alone share them.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, Surface, World
from physgen.geometry.polygon import Disc, Outline, Pose, Region, Ring, mass_properties, rotation
from physgen.scene.scene import Auto, Combine, Motion, Object, Play, Refine, Scene

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


SMOOTH = Surface(0.0, 0.0)
NO_REFINEMENT = Refine("none", 0.5, 0, 1, 0, None, "", None, 0.0, 0.0)


def appearance(scene: Scene, world: World) -> tuple[Scene, World]:
    """What `pipeline.stage` is made of. A scene without a photo is drawn as large as it is filmed."""
    return _scene(scene), _world(world)


def _scene(scene: Scene) -> Scene:
    settings = replace(
        scene.world,
        pixels_per_meter=1.0,
        gravity=(0.0, 0.0),
        table_friction=0.0,
        combine=Combine.GEOMETRIC,
        duration=1.0,
        steps_per_second=1.0,
    )
    render = replace(
        scene.render, fps=1.0, frames=None, motion_blur=0.0, overlay=(), slow=1.0, play=Play.FORWARD
    )
    if scene.image is not None:
        render = replace(render, scale=None, size=None, camera=())
    return replace(
        scene,
        name="",
        folder=Path(),
        image=None if scene.image is None else Path("photo"),
        assets=None if scene.assets is None else Path("assets"),
        world=settings,
        objects=tuple(map(_object, scene.objects)),
        boundaries=(),
        forces=(),
        joints=(),
        fields=(),
        render=render,
        refine=NO_REFINEMENT,
        places=MappingProxyType({}),
        document=MappingProxyType({}),
        variants=(),
    )


def _object(item: Object) -> Object:
    """Who is in front of whom is all that counts beside the world's bodies."""
    return Object(
        name="",
        label="",
        mask=None,
        shape=Auto(),
        solid=None,
        mass=1.0,
        density=None,
        friction=0.0,
        elasticity=0.0,
        rolling=0.0,
        velocity=(0.0, 0.0),
        spin=0.0,
        roll="none",
        motion=Motion.DYNAMIC,
        path=(),
        layer=item.layer,
        provenance={},
    )


def _world(world: World) -> World:
    return replace(
        world,
        gravity=np.zeros(2),
        pixels_per_meter=1.0,
        press=0.0,
        table=SMOOTH,
        combine=Combine.GEOMETRIC,
        duration=1.0,
        steps_per_second=1.0,
        times=np.zeros(1),
        bodies=tuple(map(_body, world.bodies)),
        walls=tuple(replace(wall, name="", surface=SMOOTH) for wall in world.walls),
        pushes=(),
        joints=(),
        fields=(),
    )


def _body(body: Body) -> Body:
    return replace(
        body_in_photo(body),
        name="",
        motion=Motion.DYNAMIC,
        mass=1.0,
        moment=1.0,
        surface=SMOOTH,
        rolling=0.0,
        patch=0.0,
        roll=np.zeros(2),
        velocity=np.zeros(2),
        spin=0.0,
        path=np.zeros((0, 4)),
    )
