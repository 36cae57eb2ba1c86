"""Scene -> warnings about what is written and does nothing."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor

from physgen.compile.assemble import Compiled
from physgen.compile.warning import warning
from physgen.compile.world import Body
from physgen.problems import Problem
from physgen.scene.model import FieldKind, Motion, Object, Overlay, Scene, Solid, View


def without_effect(scene: Scene, compiled: Compiled) -> Iterator[Problem]:
    """What a reader would expect to change the clip, and does not."""
    yield from _stages(scene)
    for item, body in zip(scene.objects, compiled.world.bodies, strict=True):
        yield from _object(scene, item, body)
    motion = {item.name: item.motion for item in scene.objects}
    yield from _forces(scene, motion)
    yield from _joints(scene, motion)
    yield from _fields(scene, motion)


def _stages(scene: Scene) -> Iterator[Problem]:
    yield from _refine(scene)
    friction = scene.world.table_friction
    if friction > 0 and scene.world.view is View.SIDE:
        why = "has no effect seen from the side"
        yield warning(scene, "world.table.friction", f"{friction:g}", why, "take it out, or write view: top")
    for kind, what, there in (
        (Overlay.FORCES, "forces", bool(scene.forces)),
        (Overlay.WEIGHT, "gravity in the picture's plane", any(scene.world.gravity)),
        (Overlay.BOUNDARIES, "boundaries", bool(scene.boundaries)),
    ):
        if kind in scene.render.overlay and not there:
            why = f"has no effect: the scene has no {what}"
            yield warning(scene, "render.overlay", kind.value, why, "take it out")
    if scene.world.view is View.TOP:
        for key in ("tilt", "backdrop"):
            if f"world.{key}" in scene.places:
                why = "has no effect seen from above: shadows fall on the table"
                yield warning(scene, f"world.{key}", key, why, "take it out, or write view: side")


def _refine(scene: Scene) -> Iterator[Problem]:
    told = scene.refine
    if told.backend == "none":
        for path, place in scene.places.items():
            if path.startswith("refine.") and place.file.startswith("--set") and path != "refine.backend":
                why = "has no effect: nobody refines"
                value = str(getattr(told, path.removeprefix("refine.")))
                yield warning(scene, path, value, why, "write --refine animatediff, or another backend")
        return
    run = floor(told.steps * told.strength + 0.5)
    if told.stop >= run:
        why = f"leaves none of the {run} steps that run in which objects are drawn to the guidance"
        yield warning(scene, "refine.stop", f"{told.stop}", why, f"write less than {run}, or more steps")
    if told.negative and told.guidance == 1:
        why = "has no effect: the model listens to no prompt at guidance 1"
        yield warning(scene, "refine.negative", told.negative, why, "take it out, or write more guidance")


def _object(scene: Scene, item: Object, body: Body) -> Iterator[Problem]:
    path = f"objects.{item.name}"
    fixed = f"has no effect on an object whose motion is {item.motion.value}"
    if item.motion is not Motion.DYNAMIC and (any(item.velocity) or item.spin):
        key = "velocity" if any(item.velocity) else "spin"
        yield warning(scene, f"{path}.{key}", key, fixed, "take it out, or write motion: dynamic")
    sphere = body.radius is not None and body.solid is Solid.SPHERE
    above = scene.world.view is View.TOP
    if item.rolling > 0:
        why = fix = ""
        if item.motion is not Motion.DYNAMIC:
            why, fix = fixed, "take it out, or write motion: dynamic"
        elif body.radius is None:
            why, fix = "has no effect: only circles roll", "take it out, or write shape: {circle: ...}"
        elif above and not sphere:
            why = f"has no effect seen from above: a {body.solid.value} lies flat and does not roll"
            fix = "take it out, or write solid: sphere"
        if why:
            yield warning(scene, f"{path}.rolling", f"{item.rolling:g}", why, fix)
    if item.roll != "natural":
        why = fix = ""
        if not above:
            why, fix = "has no effect seen from the side", "take it out, or write view: top"
        elif item.motion is not Motion.DYNAMIC:
            why, fix = fixed, "take it out, or write motion: dynamic"
        elif not sphere:
            why = f"has no effect: a {body.solid.value} does not roll on a table"
            fix = "take it out, or write solid: sphere and shape: {circle: ...}"
        elif scene.world.table_friction == 0:
            why, fix = "has no effect: the table has no friction", "write world: {table: {friction: 0.2}}"
        if why:
            found = item.roll if isinstance(item.roll, str) else f"[{item.roll[0]:g}, {item.roll[1]:g}]"
            yield warning(scene, f"{path}.roll", found, why, fix)


def _forces(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    end = scene.world.duration
    for k, force in enumerate(scene.forces):
        how = motion[force.object]
        if how is not Motion.DYNAMIC:
            why = f"has no effect: the motion of {force.object} is {how.value}"
            fix = "take it out, or write motion: dynamic"
            yield warning(scene, f"forces[{k}]", force.load.value, why, fix)
        elif force.start >= end:
            why = f"begins after the end of the clip at {end:g} s"
            fix = "begin earlier or lengthen the duration"
            yield warning(scene, f"forces[{k}].start", f"{force.start:g}", why, fix)


def _joints(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    for item in scene.joints:
        path = f"joints.{item.name}"
        if all(motion[name] is not Motion.DYNAMIC for name in item.objects):
            told = [f"{name} is {motion[name].value}" for name in item.objects]
            why = f"has no effect: {' and '.join(told)}"
            yield warning(scene, path, item.name, why, "take it out, or write motion: dynamic")
        elif item.collide and len(item.objects) == 1:
            why = f"has no effect: {item.objects[0]} is joined to the world, which it bumps into anyway"
            yield warning(scene, f"{path}.collide", "true", why, "take it out")


def _fields(scene: Scene, motion: dict[str, Motion]) -> Iterator[Problem]:
    for item in scene.fields:
        path = f"fields.{item.name}"
        fix = "take it out, or write motion: dynamic"
        if not item.objects and all(how is not Motion.DYNAMIC for how in motion.values()):
            yield warning(scene, path, item.name, "has no effect: no object is dynamic", fix)
        for name in dict.fromkeys(item.objects):
            if motion[name] is not Motion.DYNAMIC:
                why = f"has no effect on {name}, whose motion is {motion[name].value}"
                yield warning(scene, f"{path}.objects", item.name, why, fix)
        key, strength = "drag", item.drag
        if item.kind is FieldKind.ATTRACTOR:
            key, strength = "strength", item.strength
        if strength == 0:
            yield warning(scene, f"{path}.{key}", f"{strength:g}", "has no effect", "write another number")
