"""Scene + World -> joints and fields as the report draws and lists them: data for the template, px."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.model import Field, FieldKind, Joint, JointKind, Scene

Array = NDArray[np.float64]

ARROW = 0.1
"""Length of a wind's arrow, of the canvas's diagonal."""
DOT = 0.006
"""Radius of a pin, of the same."""


def drawn(scene: Scene, world: World) -> dict[str, list[dict[str, Any]]]:
    """`lines`, `dots` and `arrows`, each with its `kind`, its `title` and where it lies, at t = 0."""
    diagonal = float(np.hypot(*scene.size))
    centers = {body.name: body.center for body in world.bodies}
    lines, dots, arrows = [], [], []

    def line(kind: str, start: Array, end: Array, title: str) -> dict[str, Any]:
        return {"kind": kind, "title": title, **_ends(start, end)}

    def dot(kind: str, at: Array, part: float, title: str) -> dict[str, Any]:
        r = round(max(part * diagonal, 1.0), 1)
        return {
            "kind": kind,
            "x": round(float(at[0]), 1),
            "y": round(float(at[1]), 1),
            "r": r,
            "title": title,
        }

    for joint in scene.joints:
        title = f"{joint.name}: {joint.kind.value}, {_holds(joint)}"
        points = [np.array(point) for point in joint.points]
        if joint.kind is JointKind.SPRING:
            lines.append(line("spring", points[0], points[1], title))
        else:
            lines += [line("rod", points[0], centers[name], title) for name in joint.objects]
        dots += [dot("pin", point, DOT, title) for point in points]
    winds = [field for field in scene.fields if field.kind is FieldKind.WIND]
    for k, wind in enumerate(winds):
        vector = np.array(wind.vector)
        strength = float(np.hypot(*vector))
        way = vector / strength * ARROW * diagonal if strength else np.zeros(2)
        middle = np.array([0.12 * scene.size[0], scene.size[1] * (0.5 + k) / len(winds)])
        arrows.append(line("wind", middle - way / 2, middle + way / 2, f"{wind.name}: {_strength(wind)}"))
    for field in scene.fields:
        if field.kind is FieldKind.ATTRACTOR:
            title = f"{field.name}: {_strength(field)}"
            dots.append(dot("attractor", np.array(field.vector), 2 * DOT, title))
    return {"lines": lines, "dots": dots, "arrows": arrows}


def listed(scene: Scene) -> list[dict[str, str]]:
    """One row a joint or field: `name`, `kind`, `on`, `at`, `how`."""
    rows = []
    for joint in scene.joints:
        at = " to ".join(f"{x:g}, {y:g}" for x, y in joint.points)
        row = {
            "name": joint.name,
            "kind": joint.kind.value,
            "on": _holds(joint),
            "at": at,
            "how": _how(joint),
        }
        rows.append(row)
    for field in scene.fields:
        on = ", ".join(field.objects[:8]) + (", ..." if len(field.objects) > 8 else "")
        here = field.kind is FieldKind.ATTRACTOR
        at = f"{field.vector[0]:g}, {field.vector[1]:g}" if here else "everywhere"
        on, how = on or "every dynamic object", _strength(field)
        rows.append({"name": field.name, "kind": field.kind.value, "on": on, "at": at, "how": how})
    return rows


def _ends(start: Array, end: Array) -> dict[str, float]:
    x1, y1, x2, y2 = (round(float(v), 1) for v in (*start, *end))
    return {"x1": x1, "y1": y1, "x2": x2, "y2": y2}


def _holds(joint: Joint) -> str:
    return " and ".join([*joint.objects, "the world"][:2])


def _how(joint: Joint) -> str:
    told = []
    if joint.kind is JointKind.SPRING:
        (x1, y1), (x2, y2) = joint.points
        length = float(np.hypot(x2 - x1, y2 - y1)) if joint.length is None else joint.length
        told = [f"{joint.stiffness:g} g/s²", f"damping {joint.damping:g} g/s", f"length {length:.4g} px"]
    elif joint.kind is JointKind.MOTOR:
        told = [f"{joint.speed:g} °/s"]
        told += [] if joint.limit is None else [f"at most {joint.limit:g} g·px²/s²"]
    return ", ".join([*told, *(["the two bump into each other"] if joint.collide else [])])


def _strength(field: Field) -> str:
    if field.kind is FieldKind.WIND:
        return f"{field.vector[0]:g}, {field.vector[1]:g} px/s, drag {field.drag:g} g/px²"
    return f"{field.strength:g} px³/s², softened over {field.soften:g} px"
