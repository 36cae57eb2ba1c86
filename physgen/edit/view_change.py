"""A changed view: supports are found anew, so that the objects stay in the picture.

Perception lays floors and ledges under objects seen from the side, and rails around
objects seen from above. After a change of the view, the scene still has the boundaries
of the other view: seen from the side, all objects on a table would fall.
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
from physgen.edit.operations import apply_operations
from physgen.geometry.scale import photo_object
from physgen.maps import Percepts
from physgen.perceive import document, shape_entries
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
"""Smallest time of objects at rest, s, as in perception."""
SAMPLES = 81
"""Number of comparisons of positions: 40 a second."""
PUSHED = 4.0
"""Time after which pushed objects must be in the picture, s; most clips are over by
then.
"""
PUSHES = (1.0, 0.5, 0.25, 0.0)
"""Factors of perception's push, tried in this order until no object leaves the
picture.
"""
STILL = 1.0
"""Distance by which an object at rest may move, px, as in perception."""


@dataclass(frozen=True)
class ViewChange:
    """A text in which objects stay at their places, and the list of changes in
    words.
    """

    text: str
    changes: str


def hold_objects(
    live: Live, before: str, after: str, variant: str | None = None
) -> ViewChange | None:
    """Find the supports of the objects if an edit changed the view.

    `before` and `after` are texts of the file. None if the view is the same, if the
    scene has no photo, or if one of the texts is not a scene.
    """
    try:
        old = live.state(before, variant).scene.world.view
        state = live.state(after, variant)
        percepts = state.percepts
        is_same = state.scene.world.view is old
        if is_same or percepts is None or not state.scene.objects:
            return None
        return _hold(live, after, state, percepts, variant)
    except (InputError, EditError):
        # The edit of the user is applied even if no supports can be found.
        return None


def _hold(
    live: Live,
    text: str,
    state: LiveScene,
    percepts: Percepts,
    variant: str | None,
) -> ViewChange:
    """Set walls, held objects and the push for the new view; returns the text."""
    guess = _guess(state, percepts)
    ops = [
        *_world_ops(state.scene, live.document(text), guess.tilt),
        *_wall_ops(state.scene, guess),
        *_shape_ops(state.scene, guess),
    ]
    text = apply_operations(text, ops, variant).text
    # Seen from above, gravity acts only along a tilted table, and no object falls.
    held_objects: list[str] = []
    if state.scene.world.view is View.SIDE:
        held_objects = _falling(live.state(text, variant))
    ops = []
    for name in held_objects:
        ops.append({"set": ["objects", name, "motion"], "value": "static"})
    text = apply_operations(text, ops, variant).text
    ops = _push_ops(live.state(text, variant))
    title = f"{counted(len(guess.walls), 'support')} found"
    if held_objects:
        title += f", {counted(len(held_objects), 'object')} held"
    return ViewChange(apply_operations(text, ops, variant).text, title)


def _guess(state: LiveScene, percepts: Percepts) -> BoundaryGuess:
    """Return the walls that perception finds in the scene's view."""
    scene = state.scene
    objects = []
    for k, (item, outline) in enumerate(
        zip(scene.objects, state.compiled_scene.shapes.outlines, strict=True)
    ):
        objects.append(photo_object(k + 1, outline, item.label, scene.size))
    find_boundaries = registry.make("boundary")
    guess: BoundaryGuess = find_boundaries(
        percepts.rgb, state.compiled_scene.labels, objects, scene.world.view
    )
    return guess


def _world_ops(
    scene: Scene, document_data: Mapping[str, Any], tilt: float | None
) -> list[Data]:
    """Return the operations on gravity, on the table in the picture and on its tilt.

    `tilt`: degrees by which the camera looks down, if perception finds an angle.
    """
    world = document_data.get("world") or {}
    ops: list[Data] = []
    is_top = scene.world.view is View.TOP
    # Seen from above, a gravity for the side view would move objects over the table.
    if is_top and "gravity" in world:
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
    perceived_walls = scene.record.world.get("boundaries", {})
    user_walls = [
        name
        for name, wall in walls.items()
        if not _is_perceived(wall, perceived_walls.get(name))
    ]
    ops: list[Data] = [
        {"remove": ["boundaries", name]} for name in walls if name not in user_walls
    ]
    # A perceived wall must not take the name of a wall of the user.
    used_names = set(user_walls)
    for wall in guess.walls:
        name = free_name(wall.name, used_names)
        used_names.add(name)
        path = ["boundaries", name]
        ops.append({"set": path, "value": shape_entries.wall_entry(wall)})
    return ops


def _is_perceived(wall: Mapping[str, Any], wrote: Mapping[str, Any] | None) -> bool:
    """Return whether a wall is as perception found it, in this view or another one."""
    if "from" not in wall:
        return False
    if wrote is None:
        return True
    return all(equal(wall.get(key), wrote.get(key), SAME) for key in LINES)


def _shape_ops(scene: Scene, guess: BoundaryGuess) -> list[Data]:
    """Return the operations to set objects level on their supports."""
    ops: list[Data] = []
    for k, item in enumerate(scene.objects):
        outline = guess.outlines.get(k + 1)
        if outline is not None and item.place is None:
            path = ["objects", item.name, "shape"]
            ops.append({"set": path, "value": shape_entries.shape_entry(outline)})
    return ops


def _push_ops(state: LiveScene) -> list[Data]:
    """Return the operations that change perception's push so that nothing leaves the picture.

    In the side view the push is level: an object thrown upwards leaves the picture.
    """
    scene = state.scene
    pushes = list(perceived_pushes(scene))
    if not pushes:
        return []
    # Objects that leave the picture even without a push do not count against a push.
    unavoidable_objects = _leaving(state, dict.fromkeys(pushes, (0.0, 0.0)))
    velocities: dict[str, tuple[float, float]] = {}
    for factor in PUSHES:
        for item in scene.objects:
            if item.name in pushes:
                velocities[item.name] = _scaled_push(item, scene.world.view, factor)
        if _leaving(state, velocities) <= unavoidable_objects:
            break
    ops: list[Data] = []
    for item in scene.objects:
        velocity = velocities.get(item.name, item.velocity)
        if velocity != item.velocity:
            value = [meters(v / scene.world.pixels_per_meter) for v in velocity]
            path = ["objects", item.name, "velocity"]
            ops.append({"set": path, "value": value})
        # The spin of an object that is tipped suits its first velocity alone.
        if item.name in pushes and item.spin:
            ops.append({"set": ["objects", item.name, "spin"], "value": 0})
    return ops


def _scaled_push(item: Object, view: View, factor: float) -> tuple[float, float]:
    """Return an object's velocity, px/s, times a factor; level if seen from the
    side.
    """
    x, y = item.velocity
    if view is View.SIDE and y:
        # The speed stays, and its direction becomes level.
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
    # Velocities do not change shapes, so the shapes of the compiled scene serve.
    world = compile_shapes(scene, state.compiled_scene.shapes).world
    end_positions = simulate(world, np.linspace(0, PUSHED, SAMPLES)).poses[-1, :, :2]
    is_inside = np.all((end_positions >= 0) & (end_positions < scene.size), axis=1)
    outside_indices = np.flatnonzero(~is_inside).tolist()
    return {scene.objects[k].name for k in outside_indices}


def _falling(state: LiveScene) -> list[str]:
    """Return the objects without a stable rest, in order of motion."""
    objects = tuple(
        replace(item, velocity=(0.0, 0.0), spin=0.0) for item in state.scene.objects
    )
    scene = replace(state.scene, objects=objects, forces=())
    times = np.linspace(0, WATCHED, SAMPLES)
    falling: list[str] = []
    # Hold the first objects that move and simulate again: objects that rest on them may
    # stay at rest then.
    while True:
        world = compile_shapes(scene, state.compiled_scene.shapes).world
        poses = simulate(world, times).poses[..., :2]
        distances = np.hypot(*np.moveaxis(poses - poses[:1], -1, 0))
        is_free = [item.motion is Motion.DYNAMIC for item in scene.objects]
        is_moving = (distances > STILL) & np.array(is_free)
        if not is_moving.any():
            return falling
        first_indices = np.flatnonzero(
            is_moving[int(is_moving.any(axis=1).argmax())]
        ).tolist()
        names = [scene.objects[k].name for k in first_indices]
        falling += names
        objects = tuple(
            replace(item, motion=Motion.STATIC) if item.name in names else item
            for item in scene.objects
        )
        scene = replace(scene, objects=objects)
