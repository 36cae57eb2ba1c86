"""Masses, coefficients, forces and joints that the motion follows from, as JSON."""

from __future__ import annotations

from math import degrees, isfinite
from typing import Any

from physgen.compile.world import Body, Field, Joint, Push, World, pairings
from physgen.export.labels import Clip, Scale, Writer, write_json
from physgen.scene.scene import Boundary, JointKind, Load, Object, Scene

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
SOURCED = (
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
"""Keys of an object whose sources are given."""


class Physics(Writer):
    """One file."""

    def close(self) -> None:
        """Write it."""
        write_json(self._folder / "physics.json", physics(self._clip))


def physics(clip: Clip) -> dict[str, Any]:
    """As JSON. `from`: `written` in the scene file, `default` where it leaves a key out, or the source of a guess."""
    scene, world, scale = clip.scene, clip.world, clip.scale
    gravity = world.gravity.tolist()
    return {
        "version": 1,
        "clip": clip.name,
        "units": UNITS,
        "scale": scale.as_dict(),
        "view": world.view.value,
        "size": list(world.size),
        "duration": world.duration,
        "steps_per_second": world.steps_per_second,
        "combine": world.combine.value,
        "gravity": gravity,
        "gravity_m_s2": [scale.meters(value) for value in gravity],
        "table": {"friction": scene.world.table_friction, "press": world.press}
        if world.press > 0
        else None,
        "objects": [
            _object(scene, item, body, label, scale)
            for item, body, label in zip(
                scene.objects, world.bodies, clip.labels, strict=True
            )
        ],
        "boundaries": [
            {
                "name": item.name,
                "lines": [chain.tolist() for chain in wall.chains],
                "friction": item.friction,
                "elasticity": item.elasticity,
                **_stated(item, CONTACT_KEYS, (None,)),
                "from": _sources(
                    scene, f"boundaries.{item.name}", ("friction", "elasticity"), {}
                ),
            }
            for item, wall in zip(scene.boundaries, world.walls, strict=True)
        ],
        "pairs": [
            {
                "first": p.first,
                "second": p.second,
                "friction": p.friction,
                "elasticity": p.elasticity,
            }
            for p in pairings(world)
        ],
        "forces": [_push(push, world) for push in world.pushes],
        "joints": [_joint(joint, world) for joint in world.joints],
        "fields": [
            {
                "name": field.name,
                "kind": field.kind.value,
                "objects": [world.bodies[k].name for k in field.bodies],
                "vector": field.vector.tolist(),
                "drag": field.drag,
                "strength": field.strength,
                "soften": field.soften,
                **_stated(field, FIELD_KEYS, (0, (0, 0))),
            }
            for field in world.fields
        ],
    }


def _object(
    scene: Scene, item: Object, body: Body, label: str, scale: Scale
) -> dict[str, Any]:
    per = scale.pixels_per_meter
    moves = isfinite(body.mass)
    return {
        "name": item.name,
        "label": label,
        "motion": item.motion.value,
        "solid": body.solid.value,
        "place": body.center.tolist(),
        "radius": body.radius,
        "mass": body.mass if moves else None,
        "mass_kg": body.mass / 1000 if moves else None,
        "moment": body.moment if moves else None,
        "moment_kg_m2": body.moment / 1000 / per**2 if moves and scale.known else None,
        "friction": item.friction,
        "elasticity": item.elasticity,
        "rolling": item.rolling,
        "velocity": list(item.velocity),
        "velocity_m_s": [scale.meters(value) for value in item.velocity],
        "spin": item.spin,
        **_stated(item, CONTACT_KEYS, (None,)),
        "from": _sources(scene, f"objects.{item.name}", SOURCED, item.provenance),
    }


FIELD_KEYS = ("linear", "density", "pull", "extent")
"""Numbers of air, water and magnets."""
CONTACT_KEYS = (
    "static_friction",
    "conveyor",
    "one_way",
    "collision_group",
    "collides_with",
    "damping",
    "gravity_scale",
    "center_of_mass",
)
"""Keys by which an object or a boundary differs from most others."""


def _stated(
    item: Field | Object | Boundary, keys: tuple[str, ...], absent: tuple[Any, ...]
) -> dict[str, Any]:
    """Return the values of those keys that are not `absent`."""
    row: dict[str, Any] = {}
    for key in keys:
        value = getattr(item, key, None)
        if value not in absent:
            row[key] = value
    return row


def _sources(scene: Scene, path: str, keys: tuple[str, ...], by: Any) -> dict[str, str]:
    """Of each key."""
    found = {
        key: str(by[key])
        if key in by
        else "written"
        if f"{path}.{key}" in scene.places
        else "default"
        for key in keys
    }
    if found.get("mass") == "default" and found.get("density") != "default":
        del found["mass"]  # it follows from the density
    elif "density" in found:
        del found["density"]
    return found


def _push(push: Push, world: World) -> dict[str, Any]:
    row: dict[str, Any] = {"object": world.bodies[push.body].name, "start": push.start}
    if push.load is Load.TORQUE:
        row["torque"] = push.torque
    else:
        row[push.load.value] = push.vector.tolist()
        row["place"] = (world.bodies[push.body].center + push.at).tolist()
    if push.profile is not None:
        row["profile"] = {push.profile.kind.value: push.profile.numbers}
    if push.load is not Load.IMPULSE:
        row["end"] = push.end if isfinite(push.end) else None
    return row


def _joint(joint: Joint, world: World) -> dict[str, Any]:
    row: dict[str, Any]
    second = None if joint.second is None else world.bodies[joint.second]
    first = world.bodies[joint.first]
    other = joint.second_at if second is None else second.center + joint.second_at
    row = {
        "name": joint.name,
        "kind": joint.kind.value,
        "objects": [first.name] if second is None else [first.name, second.name],
        "places": [(first.center + joint.first_at).tolist(), other.tolist()],
        "length": joint.length,
        "stiffness": joint.stiffness,
        "damping": joint.damping,
        "speed": degrees(joint.speed),
        "limit": joint.limit if isfinite(joint.limit) else None,
        "collide": joint.collide,
    }
    if joint.kind is JointKind.SLIDER:
        row["rail"] = joint.guide[0].tolist()
        row["drive"] = joint.drive
        row["force"] = joint.force if isfinite(joint.force) else None
    elif joint.kind is JointKind.PULLEY:
        row["wheels"] = [wheel.tolist() for wheel in joint.guide]
    elif joint.kind is JointKind.GEAR:
        row["ratio"] = joint.ratio
    if joint.knots is not None:
        row["knots"] = joint.knots.tolist()
    if joint.limits is not None:
        row["limits"] = [degrees(limit) for limit in joint.limits]
    if joint.friction > 0:
        row["friction"] = joint.friction
    if isfinite(joint.breaks):
        row["breaks"] = joint.breaks
    return row
