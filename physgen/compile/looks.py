"""Scene and world -> the same with all that cannot be seen before anything moves made one value.

What is cut out of the photo is made of these, so scenes that differ in masses, coefficients, velocities or forces alone
look the same by construction, and share it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from physgen.compile.placed import pictured
from physgen.compile.world import Body, Surface, World
from physgen.scene.model import (
    Auto,
    Combine,
    Motion,
    Object,
    Play,
    Refine,
    Scene,
)

SMOOTH = Surface(0.0, 0.0)
NOBODY = Refine("none", 0.5, 0, 1, 0, None, "", None, 0.0, 0.0)


def looks(scene: Scene, world: World) -> tuple[Scene, World]:
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
        refine=NOBODY,
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
        pictured(body),
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
