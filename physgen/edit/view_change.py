"""A changed view: what holds the objects is found anew, so that they stay in the picture.

Perception lays floors and ledges under objects that it sees from the side, and rails around those that it sees from
above. A scene whose view is set has those of the other view: seen from the side, all that lies on a table would fall.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import copysign, hypot
from typing import Any

import numpy as np

from physgen import registry
from physgen.compile.compile import compile_shapes
from physgen.edit.live import Live, LiveScene
from physgen.edit.operations import edited
from physgen.geometry.scale import photo_object
from physgen.maps import Percepts
from physgen.perceive import document
from physgen.perceive.refresh import LINES, SAME, free_name
from physgen.perceive.roles import BoundaryGuess
from physgen.pipeline.pushes import perceived_pushes
from physgen.problems import EditError, InputError
from physgen.scene.files import equal
from physgen.scene.provenance import meters
from physgen.scene.scene import Motion, Object, Scene, View
from physgen.simulate.engine import simulate
from physgen.text import counted

Data = dict[str, Any]
WATCHED = 2.0
"""s for which objects must stay at rest; perception watches them as long."""
SAMPLES = 81
"""Times at which positions are compared, 40 a second."""
PUSHED = 4.0
"""s after which what is pushed must be in the picture; most clips are over by then."""
PUSHES = (1.0, 0.5, 0.25, 0.0)
"""Parts of perception's push that are tried, until nothing leaves the picture."""
STILL = 1.0
"""px by which an object at rest may move, as in perception."""


@dataclass(frozen=True)
class ViewChange:
    """A text in which objects stay where they are, and what was done, in words."""

    text: str
    what: str


def hold_objects(
    live: Live, before: str, after: str, variant: str | None = None
) -> ViewChange | None:
    """Find what holds the objects if an edit changed the view.

    `before` and `after` are texts of the file. None if the view is the same, if the scene has no photo, or if one of
    the texts is not a scene.
    """
    try:
        old = live.state(before, variant).scene.world.view
        state = live.state(after, variant)
        percepts = state.percepts
        is_same = state.scene.world.view is old
        if is_same or percepts is None or not state.scene.objects:
            return None
        return _held(live, after, state, percepts, variant)
    except (InputError, EditError):  # the edit itself is made all the same
        return None


def _held(
    live: Live,
    text: str,
    state: LiveScene,
    percepts: Percepts,
    variant: str | None,
) -> ViewChange:
    """Return the text in which walls, held objects and the push are those of its view."""
    guess = _guess(state, percepts)
    ops = [
        *_world_ops(state.scene, live.document(text), guess.tilt),
        *_wall_ops(state.scene, guess),
        *_shape_ops(state.scene, guess),
    ]
    text = edited(text, ops, variant).text
    held: list[str] = []
    if state.scene.world.view is View.SIDE:
        held = _falling(live.state(text, variant))
    ops = [{"set": ["objects", name, "motion"], "value": "static"} for name in held]
    text = edited(text, ops, variant).text
    ops = _push_ops(live.state(text, variant))
    what = f"{counted(len(guess.walls), 'support')} found"
    if held:
        what += f", {counted(len(held), 'object')} held"
    return ViewChange(edited(text, ops, variant).text, what)


def _guess(state: LiveScene, percepts: Percepts) -> BoundaryGuess:
    """Return the walls that perception finds in the scene's view."""
    scene = state.scene
    objects = [
        photo_object(k + 1, outline, item.label, scene.size)
        for k, (item, outline) in enumerate(
            zip(scene.objects, state.compiled.shapes.outlines, strict=True)
        )
    ]
    find = registry.make("boundary")
    guess: BoundaryGuess = find(
        percepts.rgb, state.compiled.labels, objects, scene.world.view
    )
    return guess


def _world_ops(
    scene: Scene, written: Mapping[str, Any], tilt: float | None
) -> list[Data]:
    """Return the operations on gravity, on the table in the picture and on its tilt.

    `tilt`: degrees by which the camera looks down, if perception finds an angle.
    """
    world = written.get("world") or {}
    ops: list[Data] = []
    is_top = scene.world.view is View.TOP
    if is_top and "gravity" in world:  # it would draw objects over the table
        ops.append({"unset": ["world", "gravity"]})
    if is_top and "table" not in world:
        ops.append({"set": ["world", "table"], "value": dict(document.TABLE)})
    if is_top and tilt is not None and world.get("tilt") == tilt:
        ops.append({"unset": ["world", "tilt"]})
    if not is_top and tilt is not None and "tilt" not in world:
        ops.append({"set": ["world", "tilt"], "value": tilt})
    if not is_top and world.get("table") == document.TABLE:
        ops.append({"unset": ["world", "table"]})
    return ops


def _wall_ops(scene: Scene, guess: BoundaryGuess) -> list[Data]:
    """Return the operations that replace perception's walls; those of the user stay."""
    walls = scene.document["boundaries"]
    wrote = scene.record.world.get("boundaries", {})
    kept = [
        name for name, wall in walls.items() if not _is_perceived(wall, wrote.get(name))
    ]
    ops: list[Data] = [
        {"remove": ["boundaries", name]} for name in walls if name not in kept
    ]
    names = set(kept)
    for wall in guess.walls:
        name = free_name(wall.name, names)
        names.add(name)
        path = ["boundaries", name]
        ops.append({"set": path, "value": document.wall_entry(wall)})
    return ops


def _is_perceived(wall: Mapping[str, Any], wrote: Mapping[str, Any] | None) -> bool:
    """Return whether a wall is as perception found it, in this view or another one."""
    if "from" not in wall:
        return False
    if wrote is None:
        return True
    return all(equal(wall.get(key), wrote.get(key), SAME) for key in LINES)


def _shape_ops(scene: Scene, guess: BoundaryGuess) -> list[Data]:
    """Return the operations that set objects level on what supports them."""
    ops: list[Data] = []
    for k, item in enumerate(scene.objects):
        outline = guess.outlines.get(k + 1)
        if outline is not None and item.place is None:
            path = ["objects", item.name, "shape"]
            ops.append({"set": path, "value": document.shape_entry(outline)})
    return ops


def _push_ops(state: LiveScene) -> list[Data]:
    """Return the operations that change perception's push so that nothing leaves the picture.

    Seen from the side it is level: what is thrown up is lost.
    """
    scene = state.scene
    pushes = list(perceived_pushes(scene))
    if not pushes:
        return []
    stays = _leaving(state, dict.fromkeys(pushes, (0.0, 0.0)))
    velocities: dict[str, tuple[float, float]] = {}
    for factor in PUSHES:
        for item in scene.objects:
            if item.name in pushes:
                velocities[item.name] = _scaled_push(item, scene.world.view, factor)
        if _leaving(state, velocities) <= stays:
            break
    ops: list[Data] = []
    for item in scene.objects:
        velocity = velocities.get(item.name, item.velocity)
        if velocity != item.velocity:
            value = [meters(v / scene.world.pixels_per_meter) for v in velocity]
            path = ["objects", item.name, "velocity"]
            ops.append({"set": path, "value": value})
    return ops


def _scaled_push(item: Object, view: View, factor: float) -> tuple[float, float]:
    """Return an object's velocity, px/s, times a factor; level if seen from the side."""
    x, y = item.velocity
    if view is View.SIDE and y:
        x, y = copysign(hypot(x, y), x or 1.0), 0.0
    return x * factor, y * factor


def _leaving(
    state: LiveScene, velocities: Mapping[str, tuple[float, float]]
) -> set[str]:
    """Return the objects that end outside the picture if they have these velocities."""
    objects = tuple(
        replace(item, velocity=velocities.get(item.name, item.velocity))
        for item in state.scene.objects
    )
    scene = replace(state.scene, objects=objects)
    world = compile_shapes(scene, state.compiled.shapes).world
    end = simulate(world, np.linspace(0, PUSHED, SAMPLES)).poses[-1, :, :2]
    is_inside = np.all((end >= 0) & (end < scene.size), axis=1)
    outside = np.flatnonzero(~is_inside).tolist()
    return {scene.objects[k].name for k in outside}


def _falling(state: LiveScene) -> list[str]:
    """Return the objects that do not stay at rest by themselves, the first to go first."""
    objects = tuple(
        replace(item, velocity=(0.0, 0.0), spin=0.0) for item in state.scene.objects
    )
    scene = replace(state.scene, objects=objects, forces=())
    times = np.linspace(0, WATCHED, SAMPLES)
    falling: list[str] = []
    while True:
        world = compile_shapes(scene, state.compiled.shapes).world
        poses = simulate(world, times).poses[..., :2]
        distances = np.hypot(*np.moveaxis(poses - poses[:1], -1, 0))
        is_free = [item.motion is Motion.DYNAMIC for item in scene.objects]
        moves = (distances > STILL) & np.array(is_free)
        if not moves.any():
            return falling
        first = np.flatnonzero(moves[int(moves.any(axis=1).argmax())]).tolist()
        names = [scene.objects[k].name for k in first]
        falling += names
        objects = tuple(
            replace(item, motion=Motion.STATIC) if item.name in names else item
            for item in scene.objects
        )
        scene = replace(scene, objects=objects)
