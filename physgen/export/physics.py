"""Write the masses, coefficients, forces and joints of a motion as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, isfinite
from typing import Any

from physgen.compile.world import (
    Body,
    Field,
    Joint,
    Pairing,
    Push,
    Wall,
    World,
    pairings,
)
from physgen.export.labels import Clip, Scale, Writer, write_json
from physgen.scene.scene import Boundary, FieldKind, JointKind, Load, Object, Scene
from physgen.simulate.ramps import has_ramp

UNITS = {
    "size, place, radius, length": "px",
    "time, start, end": "s",
    "mass": "g",
    "mass_kg": "kg",
    "moment": "g·px², about the centre of mass",
    "moment_kg_m2": "kg·m²",
    "velocity": "px/s",
    "spin": "degrees/s, positive turns +x towards +y",
    "gravity": "px/s²",
    "gravity_m_s2": "m/s²",
    "impulse": "g·px/s",
    "force": "g·px/s²",
    "torque": "g·px²/s²",
    "stiffness": "g/s²",
    "damping": "g/s",
    "friction, elasticity": "of one surface; `pairs` has the values for two",
}
RAMP_UNIT = {"ramp": "s in which the velocity is reached, from rest"}
"""Additional unit for objects with a smooth start."""
SOURCE_KEYS = (
    "mass",
    "density",
    "friction",
    "elasticity",
    "rolling",
    "velocity",
    "spin",
    "solid",
    "motion",
)
"""Keys of an object with sources in the file."""


class Physics(Writer):
    """Writes `physics.json`."""

    def close(self) -> None:
        """Write the file."""
        write_json(self._folder / "physics.json", physics(self._clip))


FIELD_KEYS = ("linear", "density", "pull", "extent", "spin")
"""Numbers of air, water, magnets and turntables."""
CONTACT_KEYS = (
    "static_friction",
    "conveyor",
    "one_way",
    "collision_group",
    "collides_with",
    "damping",
    "gravity_scale",
    "rocking",
    "center_of_mass",
)
"""Rare keys of objects and boundaries, written only if present."""


def physics(clip: Clip) -> dict[str, Any]:
    """Return the inputs of the motion for JSON.

    `from` is `written` for a key in the scene file, `default` for a missing key, or the
    source of a guess.
    """
    scene = clip.scene
    world = clip.world
    scale = clip.scale
    gravity = world.gravity.tolist()
    table = None
    if world.press > 0:
        table = {"friction": scene.world.table_friction, "press": world.press}
    return {
        "version": 1,
        "clip": clip.name,
        "units": UNITS | (RAMP_UNIT if any(map(has_ramp, world.bodies)) else {}),
        "scale": scale.as_dict(),
        "view": world.view.value,
        "size": list(world.size),
        "duration": world.duration,
        "steps_per_second": world.steps_per_second,
        "combine": world.combine.value,
        "gravity": gravity,
        "gravity_m_s2": list(map(scale.meters, gravity)),
        "table": table,
        "objects": _objects(clip),
        "boundaries": _boundaries(scene, world),
        "pairs": list(map(_pairing, pairings(world))),
        "forces": [_push(push, world) for push in world.pushes],
        "joints": [_joint(joint, world) for joint in world.joints],
        "fields": [_field(field, world) for field in world.fields],
    }


def _objects(clip: Clip) -> list[dict[str, Any]]:
    scene = clip.scene
    objects = []
    bodies = zip(scene.objects, clip.world.bodies, clip.labels, strict=True)
    for item, body, label in bodies:
        objects.append(_object(scene, item, body, label, clip.scale))
    return objects


def _object(
    scene: Scene, item: Object, body: Body, label: str, scale: Scale
) -> dict[str, Any]:
    """Return an object, without mass and moment if it is fixed or scripted."""
    mass = moment = mass_kg = moment_si = None
    # Fixed and scripted bodies have infinite masses, which JSON cannot hold.
    if isfinite(body.mass):
        mass, moment = body.mass, body.moment
        mass_kg = mass / 1000
        if scale.is_known:
            # A moment of inertia contains the square of a length.
            moment_si = moment / 1000 / scale.pixels_per_meter**2
    return {
        "name": item.name,
        "label": label,
        "motion": item.motion.value,
        "solid": body.solid.value,
        "place": body.center.tolist(),
        "radius": body.radius,
        "mass": mass,
        "mass_kg": mass_kg,
        "moment": moment,
        "moment_kg_m2": moment_si,
        "friction": item.friction,
        "elasticity": item.elasticity,
        "rolling": item.rolling,
        "velocity": list(item.velocity),
        "velocity_m_s": list(map(scale.meters, item.velocity)),
        "spin": item.spin,
        **({"ramp": body.ramp} if has_ramp(body) else {}),
        **_select_stated(item, CONTACT_KEYS, (None,)),
        "from": _sources(scene, f"objects.{item.name}", SOURCE_KEYS, item.provenance),
    }


def _boundaries(scene: Scene, world: World) -> list[dict[str, Any]]:
    boundaries = []
    for boundary, wall in zip(scene.boundaries, world.walls, strict=True):
        boundaries.append(_boundary(scene, boundary, wall))
    return boundaries


def _boundary(scene: Scene, boundary: Boundary, wall: Wall) -> dict[str, Any]:
    path, keys = f"boundaries.{boundary.name}", ("friction", "elasticity")
    return {
        "name": boundary.name,
        "lines": [chain.tolist() for chain in wall.chains],
        "friction": boundary.friction,
        "elasticity": boundary.elasticity,
        **_select_stated(boundary, CONTACT_KEYS, (None,)),
        "from": _sources(scene, path, keys, {}),
    }


def _pairing(pairing: Pairing[list[str]]) -> dict[str, Any]:
    return {
        "first": pairing.first,
        "second": pairing.second,
        "friction": pairing.friction,
        "elasticity": pairing.elasticity,
    }


def _field(field: Field, world: World) -> dict[str, Any]:
    return {
        "name": field.name,
        "kind": field.kind.value,
        "objects": [world.bodies[k].name for k in field.bodies],
        "vector": field.vector.tolist(),
        "drag": field.drag,
        "strength": field.strength,
        "soften": field.soften,
        **_select_stated(field, FIELD_KEYS, (0, (0, 0))),
        **_belt(field),
    }


def _belt(field: Field) -> dict[str, Any]:
    """Return the velocity of a belt."""
    if field.kind is not FieldKind.BELT or field.velocity is None:
        return {}
    return {"velocity": field.velocity.tolist()}


def _select_stated(
    item: Field | Object | Boundary, keys: tuple[str, ...], absent: tuple[Any, ...]
) -> dict[str, Any]:
    """Return the values of the keys without those in `absent`."""
    row: dict[str, Any] = {}
    for key in keys:
        value = getattr(item, key, None)
        if value not in absent:
            row[key] = value
    return row


def _sources(
    scene: Scene, path: str, keys: tuple[str, ...], provenance: Mapping[str, Any]
) -> dict[str, str]:
    """Return the source of each key; of mass and density only the given one."""
    sources = {}
    for key in keys:
        if key in provenance:
            sources[key] = str(provenance[key])
        elif f"{path}.{key}" in scene.places:
            sources[key] = "written"
        else:
            sources[key] = "default"
    # Mass and density exclude each other: only one has a source.
    has_density = sources.get("density") != "default"
    if sources.get("mass") == "default" and has_density:
        del sources["mass"]
    elif "density" in sources:
        del sources["density"]
    return sources


def _push(push: Push, world: World) -> dict[str, Any]:
    """Return a push. Its place is its point in the photo."""
    body = world.bodies[push.body]
    row: dict[str, Any] = {"object": body.name, "start": push.start}
    if push.load is Load.TORQUE:
        row["torque"] = push.torque
    else:
        row[push.load.value] = push.vector.tolist()
        row["place"] = (body.center + push.point).tolist()
    if push.profile is not None:
        row["profile"] = {push.profile.kind.value: push.profile.numbers}
    # An impulse acts at one moment and has no end.
    if push.load is not Load.IMPULSE:
        if isfinite(push.end):
            row["end"] = push.end
        else:
            row["end"] = None
    return row


def _joint(joint: Joint, world: World) -> dict[str, Any]:
    row: dict[str, Any]
    if joint.second is None:
        second = None
    else:
        second = world.bodies[joint.second]
    first = world.bodies[joint.first]
    if second is None:
        other = joint.second_at
    else:
        other = second.center + joint.second_at
    row = {
        "name": joint.name,
        "kind": joint.kind.value,
        "objects": [first.name] if second is None else [first.name, second.name],
        "places": [(first.center + joint.first_at).tolist(), other.tolist()],
        "length": joint.length,
        "stiffness": joint.stiffness,
        "damping": joint.damping,
        "speed": degrees(joint.speed),
        # JSON has no infinity: null stands for the lack of a limit.
        "limit": joint.limit if isfinite(joint.limit) else None,
        "collide": joint.collide,
    }
    if joint.kind is JointKind.SLIDER:
        row["rail"] = joint.guide[0].tolist()
        row["drive"] = joint.drive
        if isfinite(joint.force):
            row["force"] = joint.force
        else:
            row["force"] = None
    elif joint.kind is JointKind.PULLEY:
        row["wheels"] = [wheel.tolist() for wheel in joint.guide]
    elif joint.kind is JointKind.GEAR:
        row["ratio"] = joint.ratio
    if joint.knots is not None:
        row["knots"] = joint.knots.tolist()
    if joint.limits is not None:
        row["limits"] = list(map(degrees, joint.limits))
    if joint.friction > 0:
        row["friction"] = joint.friction
    if isfinite(joint.breaks):
        row["breaks"] = joint.breaks
    return row
