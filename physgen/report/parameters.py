"""Tables of the report page: parameters of objects with their sources, joints and fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.scene.provenance import Provenance, Source
from physgen.scene.scene import Field, FieldKind, Joint, JointKind, Motion, Scene, Solid

# ----------------------------------------------------------------------
# Scene + World -> joints and fields as the report draws and lists them: data for the template, px.

Array = NDArray[np.float64]

ARROW = 0.1
"""Length of a wind's arrow, of the canvas's diagonal."""
DOT = 0.006
"""Radius of a pin, of the same."""


def constraint_drawing(scene: Scene, world: World) -> dict[str, list[dict[str, Any]]]:
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


def constraint_rows(scene: Scene) -> list[dict[str, str]]:
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


# ----------------------------------------------------------------------
# Scene + World + what was edited -> the table of parameters: each number with who said it, and how sure.


@dataclass(frozen=True)
class Cell:
    """One number of the table; `text` has no unit."""

    text: str
    source: Source


@dataclass(frozen=True)
class Row:
    """What is known of one object or boundary."""

    name: str
    label: str
    kind: str
    """`dynamic`, `static`, `scripted` or `boundary`."""
    cells: Mapping[str, Cell]
    also: str
    """Who said what else."""


COLUMNS = {
    "shape": "",
    "mass": "g",
    "moment": "g·px²",
    "friction": "",
    "elasticity": "",
    "rolling": "",
    "velocity": "px/s",
    "spin": "°/s",
}
"""Of the table, with units."""
WORKED_OUT = Source("worked out", "worked out")


def parameter_rows(scene: Scene, world: World, variant: str | None) -> list[Row]:
    """A row an object, then a row a boundary."""
    said = Provenance(scene, variant)
    rows = [_object(scene, k, body, said) for k, body in enumerate(world.bodies)]
    for wall, item in zip(world.walls, scene.boundaries, strict=True):
        path = f"boundaries.{item.name}"
        corners = sum(len(chain) for chain in wall.chains)
        shape = "mask" if item.mask is not None else "wall"
        cells = {
            "shape": Cell(f"{corners} points", said.of(f"{path}.{shape}", None, near=True)),
            "friction": Cell(f"{item.friction:g}", said.of(f"{path}.friction", None)),
            "elasticity": Cell(f"{item.elasticity:g}", said.of(f"{path}.elasticity", None)),
        }
        rows.append(Row(item.name, "", "boundary", cells, ""))
    return rows


def edits(scene: Scene, overrides: Sequence[str], variant: str | None) -> list[tuple[str, str]]:
    """What the command changed of the file: whence, and what."""
    found = []
    if variant is not None:
        changes = scene.document.get("variants", {}).get(variant, {})
        rows = changes.items() if isinstance(changes, Mapping) else ()
        found += [(f"variant {variant}", f"{key} = {_plain(value)}") for key, value in rows]
        found = found or [(f"variant {variant}", "")]
    return found + [("--set", text) for text in overrides]


def _object(scene: Scene, index: int, body: Body, said: Provenance) -> Row:
    item = scene.objects[index]
    path = f"objects.{item.name}"

    def cell(text: str, key: str) -> Cell:
        told = f"{path}.from.{key}"
        return Cell(text, said.of(f"{path}.{key}", item.provenance.get(key), told=told))

    weight = "mass" if item.mass is not None else "density"
    cells = {
        "shape": cell(_shape(body), "shape"),
        "mass": cell(_grams(body.mass), weight),
        "moment": Cell(f"{body.moment:.3e}", WORKED_OUT),
        "friction": cell(f"{item.friction:g}", "friction"),
        "elasticity": cell(f"{item.elasticity:g}", "elasticity"),
        "rolling": cell(f"{item.rolling:g}", "rolling"),
        "velocity": cell(f"{body.velocity[0]:g}, {body.velocity[1]:g}", "velocity"),
        "spin": cell(f"{degrees(body.spin):g}", "spin"),
    }
    if item.motion is Motion.STATIC:
        cells = {key: value for key, value in cells.items() if key not in ("mass", "moment")}
    also = "; ".join(f"{key}: {who}" for key, who in item.provenance.items() if key not in cells)
    return Row(item.name, item.label, item.motion.value, cells, also)


def _shape(body: Body) -> str:
    if body.radius is not None:
        what = body.solid.value if body.solid is not Solid.DISC else "circle"
        return f"{what}, r {body.radius:.1f} px"
    corners = sum(len(ring) for ring in body.rings)
    pieces = f", {len(body.pieces)} pieces" if len(body.pieces) > 1 else ""
    return f"polygon, {corners} corners{pieces}"


def _grams(mass: float) -> str:
    return f"{mass:,.4g}" if mass < 1e6 else f"{mass:.3e}"


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {_plain(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_plain, value)) + "]"
    return f"{value:g}" if isinstance(value, float) else str(value)
