"""A scene, directions and sizes -> what each push of one object does; nothing is drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from physgen import pipeline
from physgen.compile.world import Push as Load
from physgen.compile.world import World
from physgen.evaluate.controllability.closed import Law, law, slid
from physgen.evaluate.controllability.outcomes import Outcome, Path, Push, outcome, path_of
from physgen.problems import InputError
from physgen.registry import suggestion
from physgen.scene.scene import Load as Kind
from physgen.scene.scene import Motion, Scene, View
from physgen.simulate.trajectory import Trajectory

Progress = Callable[[str, int, int], None]

SIZES = 5
"""Of pushes, where nobody says."""
REACH = 1 / 3
"""Of the canvas's shorter side, that the hardest push takes an object about as far, where nobody says."""


FASTEST = 1e5
"""px/s."""


@dataclass(frozen=True)
class Swept:
    """All pushes of one object."""

    scene: str
    object: str
    view: View | None
    """None where clips were made elsewhere."""
    outcomes: tuple[Outcome, ...]
    still: Path | None
    """Without a push; None: nobody knows."""
    law: Law | None
    photo: NDArray[np.uint8] | None = None
    """(H, W, 3) uint8."""
    meter: float | None = None
    """px."""


def sweep(scene: Scene, name: str | None, angles: int, sizes: Sequence[float], progress: Progress) -> Swept:
    """`sizes` are px/s, none: chosen by the scene. Raises InputError where no such object can be pushed."""
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    index = pushed(scene, compiled.world, name)
    world = quiet(compiled.world, index)
    body = world.bodies[index]
    sizes = list(sizes) or usual(world, index)
    pushes = [
        Push(size * cos(turn), size * sin(turn)) for turn in directions(angles, world.view) for size in sizes
    ]

    def run(push: Push | None) -> Trajectory:
        if push is None:
            return pipeline.simulate(world)
        vector = body.mass * np.array([push.x, push.y])
        load = Load(index, Kind.IMPULSE, vector, 0.0, np.zeros(2), 0.0, 0.0)
        return pipeline.simulate(replace(world, pushes=(*world.pushes, load)))

    progress("no push", 0, len(pushes) + 1)
    still = path_of(run(None), body.name)
    outcomes = []
    for k, push in enumerate(pushes, 1):
        progress(f"push {k}", k, len(pushes) + 1)
        outcomes.append(outcome(push, path_of(run(push), body.name), still))
    photo = None if maps is None else maps.rgb
    return Swept(
        scene.name,
        body.name,
        world.view,
        tuple(outcomes),
        still,
        law(world, index),
        photo,
        world.pixels_per_meter,
    )


def pushed(scene: Scene, world: World, name: str | None) -> int:
    """Index of the object; unless it is named, the one that the scene pushes, or that moves first, or the first."""
    free = [body.name for body in world.bodies if body.motion is Motion.DYNAMIC]
    place = str(scene.place("objects").file)
    if not free:
        raise InputError.of(place, "", "has no object that can be pushed", "give it a dynamic object")
    if name is None:
        forced = [world.bodies[push.body].name for push in world.pushes]
        moving = [body.name for body in world.bodies if np.hypot(*body.velocity) > 0]
        name = next((one for one in (*forced, *moving) if one in free), free[0])
    names = [body.name for body in world.bodies]
    if name not in names:
        raise InputError.of("--object", f'"{name}"', "is no object of the scene", suggestion(name, names))
    if name not in free:
        raise InputError.of(
            "--object", f'"{name}"', "cannot be pushed: it is not dynamic", suggestion(name, free)
        )
    return names.index(name)


def quiet(world: World, index: int) -> World:
    """The world with that body at rest and nothing pushing it; all others move as they do."""
    body = world.bodies[index]
    rest = replace(body, velocity=np.zeros(2), spin=0.0, roll=np.zeros(2))
    bodies = (*world.bodies[:index], rest, *world.bodies[index + 1 :])
    return replace(world, bodies=bodies, pushes=tuple(push for push in world.pushes if push.body != index))


def directions(count: int, view: View) -> list[float]:
    """rad. Seen from above all round; from the side from right over up to left, never down into what holds it."""
    if view is View.TOP:
        return [2 * pi * k / count for k in range(count)]
    return [-pi * k / max(count - 1, 1) for k in range(count)]


def usual(world: World, index: int) -> list[float]:
    """px/s: even steps up to what takes the body about a third of the canvas, sliding or rolling."""
    body = world.bodies[index]
    known = law(world, index)
    if known is None:
        ground = max((wall.surface.friction for wall in world.walls), default=0.0)
        slides = body.radius is None and world.view is View.SIDE
        brake = body.surface.friction * ground * float(np.hypot(*world.gravity)) if slides else 0.0
        known = Law("", lambda speed, time: slid(speed, time, brake))
    reach, most = REACH * min(world.size), 1.0
    while known.way(most, world.duration) < reach and most < FASTEST:
        most *= 1.02
    step = float(f"{most / SIZES:.2g}")
    return [step * k for k in range(1, SIZES + 1)]
