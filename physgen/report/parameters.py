"""Tables of the report page: parameters with their sources, joints and fields; outlines
and arrows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.report.assumptions import is_scaled
from physgen.scene.provenance import Provenance, Source
from physgen.scene.scene import (
    Field,
    FieldKind,
    Joint,
    JointKind,
    Load,
    Motion,
    Scene,
    Solid,
)
from physgen.text import name_ranges, rounded, value_text

Array = NDArray[np.float64]

LONGEST_ARROW = 0.14
"""Length of the longest arrow over the canvas's diagonal."""
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
"""Columns of the table of parameters, with units."""
METRIC = {"moment": "g·cm²", "velocity": "m/s"}
"""Units of columns in a scene with a scale."""
METRIC_DIGITS = 2
"""Digits of values with metric units."""
CENTIMETERS = 100
"""Centimetres in a metre."""


def svg_points(points: Array) -> str:
    """Return points as `x,y x,y`."""
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def outlines(world: World, labels: dict[str, str]) -> list[dict[str, str]]:
    """Return the outlines of the bodies for the templates."""
    return [
        {
            "name": body.name,
            "label": labels.get(body.name, ""),
            "motion": body.motion.value,
            "path": " ".join(
                f"M{svg_points(ring + body.center)}Z" for ring in body.rings
            ),
        }
        for body in world.bodies
    ]


def arrows(world: World) -> list[tuple[str, Array, Array, str]]:
    """Return kind (`velocity` or `force`), tail, tip (px) and title at t = 0.

    Each kind has its own scale.
    """
    arrow_list: dict[str, list[tuple[Array, Array, str]]] = {
        "velocity": [],
        "force": [],
    }
    for body in world.bodies:
        if body.velocity.any():
            title = f"{body.name}: {value_text(body.velocity)} px/s"
            arrow_list["velocity"].append((body.center, body.velocity, title))
    for push in world.pushes:
        if push.load is not Load.TORQUE and push.vector.any():
            body, unit = (
                world.bodies[push.body],
                "g·px/s" if push.load is Load.IMPULSE else "g·px/s²",
            )
            title = (
                f"{push.load.value} on {body.name}: {value_text(push.vector)} {unit}"
            )
            arrow_list["force"].append(
                (
                    body.center + push.point,
                    push.vector,
                    f"{title} from {value_text(push.start)} s",
                )
            )
    # Velocities and forces have different units: only lengths of one kind compare.
    longest = LONGEST_ARROW * float(np.hypot(*world.size))
    rows = []
    for kind, vectors in arrow_list.items():
        max_size = max(
            (float(np.hypot(*vector)) for _, vector, _ in vectors), default=0.0
        )
        rows += [
            (kind, tail, tail + vector / max_size * longest, title)
            for tail, vector, title in vectors
        ]
    return rows


def line(kind: str, start: Array, end: Array, title: str) -> dict[str, Any]:
    """Return a line of the template."""
    x1, y1, x2, y2 = (round(float(v), 1) for v in (*start, *end))
    return {"kind": kind, "title": title, "x1": x1, "y1": y1, "x2": x2, "y2": y2}


PLACED = (
    FieldKind.ATTRACTOR,
    FieldKind.WATER,
    FieldKind.BELT,
    FieldKind.TURNTABLE,
)
"""Fields with a position."""


def constraint_rows(scene: Scene) -> list[dict[str, str]]:
    """Return a row for each joint and field: `name`, `kind`, `on`, `at`, `how`."""
    rows = []
    for joint in scene.joints:
        place = " to ".join(map(value_text, joint.points))
        rows.append(
            (
                joint.name,
                joint.kind.value,
                " and ".join([*joint.objects, "the world"][:2]),
                place,
                _settings(joint),
            )
        )
    for field in scene.fields:
        names = ", ".join(field.objects[:8])
        if len(field.objects) > 8:
            names += ", ..."
        has_place = field.kind in PLACED
        place = "everywhere"
        if has_place:
            place = value_text(field.vector)
        if field.kind is FieldKind.MAGNET:
            place = "between each two"
        rows.append(
            (
                field.name,
                field.kind.value,
                names or "every dynamic object",
                place,
                _strength(field),
            )
        )
    return [
        dict(zip(("name", "kind", "on", "at", "how"), row, strict=True)) for row in rows
    ]


def _settings(joint: Joint) -> str:
    parts = []
    make_parts = _SETTINGS.get(joint.kind)
    if make_parts is not None:
        parts += make_parts(joint)
    if joint.limits is not None:
        least, most = map(value_text, joint.limits)
        parts.append(f"from {least}° to {most}°")
    if joint.friction > 0:
        parts.append(f"friction {value_text(joint.friction)} g·px²/s²")
    if joint.breaks is not None:
        parts.append(f"breaks at {value_text(joint.breaks)} g·px/s²")
    if joint.collide:
        parts.append("the two bump into each other")
    return ", ".join(parts)


def _spring_settings(joint: Joint) -> list[str]:
    length = joint.length
    if length is None:
        (x1, y1), (x2, y2) = joint.points
        length = float(np.hypot(x2 - x1, y2 - y1))
    return [
        f"{value_text(joint.stiffness)} g/s²",
        f"damping {value_text(joint.damping)} g/s",
        f"length {rounded(length, 4)} px",
    ]


def _gear_settings(joint: Joint) -> list[str]:
    return [f"{value_text(joint.gear)} turns for one"]


def _rope_settings(joint: Joint) -> list[str]:
    if joint.length is None:
        return []
    return [f"length {value_text(joint.length)} px"]


def _slider_settings(joint: Joint) -> list[str]:
    parts = []
    if joint.drive is not None:
        parts.append(f"{value_text(joint.drive)} px/s")
    if joint.force is not None:
        parts.append(f"at most {value_text(joint.force)} g·px/s²")
    return parts


def _motor_settings(joint: Joint) -> list[str]:
    parts = [f"{value_text(joint.speed)} °/s"]
    if joint.limit is not None:
        parts.append(f"at most {value_text(joint.limit)} g·px²/s²")
    return parts


_SETTINGS: dict[JointKind, Callable[[Joint], list[str]]] = {
    JointKind.SPRING: _spring_settings,
    JointKind.GEAR: _gear_settings,
    JointKind.ROPE: _rope_settings,
    JointKind.PULLEY: _rope_settings,
    JointKind.SLIDER: _slider_settings,
    JointKind.MOTOR: _motor_settings,
}
"""Texts of the settings of each kind of joint; other kinds have none."""


def _strength(field: Field) -> str:
    if field.kind is FieldKind.WIND:
        return f"{value_text(field.vector)} px/s, drag {value_text(field.drag)} g/px²"
    if field.drag:
        drag = [f"drag {value_text(field.drag)} g/px²"]
    else:
        drag = []
    if field.linear:
        drag.append(f"{value_text(field.linear)} g/px/s")
    if field.kind is FieldKind.AIR:
        return ", ".join(drag)
    if field.kind is FieldKind.WATER:
        size = f"{value_text(field.extent)} px, {value_text(field.density)} g/px²"
        return ", ".join([size, *drag])
    if field.kind is FieldKind.MAGNET:
        return f"{value_text(field.pull)} g·px³/s²"
    if field.kind is FieldKind.BELT:
        return f"{value_text(field.extent)} px, {value_text(field.velocity)} px/s"
    if field.kind is FieldKind.TURNTABLE:
        radius = value_text(field.extent[0])
        return f"radius {radius} px, {value_text(field.spin)} °/s"
    return f"{value_text(field.strength)} px³/s², softened over {value_text(field.soften)} px"


BOUNDARY = "boundary"
"""Kind of a boundary's row."""


@dataclass(frozen=True)
class Cell:
    """A number of the table; `text` has no unit."""

    text: str
    source: Source
    small: str = ""
    """The same number in px."""


@dataclass(frozen=True)
class Row:
    """Parameters of one object or boundary."""

    name: str
    label: str
    kind: str
    """`dynamic`, `static`, `scripted` or `boundary`."""
    cells: Mapping[str, Cell]
    other_sources: str
    """Sources of other keys."""
    names: tuple[str, ...] = ()
    """Objects of a merged row."""


def units_of(scene: Scene) -> dict[str, str]:
    """Return the columns with their units: metric ones for a scene with a scale."""
    return COLUMNS | (METRIC if is_scaled(scene) else {})


def parameter_rows(scene: Scene, world: World, variant: str | None) -> list[Row]:
    """Return rows of objects, then of boundaries."""
    sources = Provenance(scene, variant)
    rows = [_object(scene, k, body, sources) for k, body in enumerate(world.bodies)]
    for wall, item in zip(world.walls, scene.boundaries, strict=True):
        path = f"boundaries.{item.name}"
        corners = sum(map(len, wall.chains))
        shape = "wall"
        if item.mask is not None:
            shape = "mask"
        cells = {
            "shape": Cell(
                f"{corners} points",
                sources.of(f"{path}.{shape}", None, uses_parent=True),
            ),
            "friction": Cell(
                value_text(item.friction), sources.of(f"{path}.friction", None)
            ),
            "elasticity": Cell(
                value_text(item.elasticity), sources.of(f"{path}.elasticity", None)
            ),
        }
        rows.append(Row(item.name, "", BOUNDARY, cells, ""))
    return rows


def shared_cells(rows: Sequence[Row]) -> dict[str, Cell]:
    """Return the common cells of all objects. They may differ in their lines of the
    file.

    Return an empty mapping for fewer than two objects. Boundaries do not count.
    """
    objects = []
    for row in rows:
        if row.kind != BOUNDARY:
            objects.append(row)
    # A single object has no common values.
    if len(objects) < 2:
        return {}
    shared = {}
    for name, cell in objects[0].cells.items():
        cells = [row.cells.get(name) for row in objects]
        if all(other is not None and _is_equal(cell, other) for other in cells):
            shared[name] = _merge_cells(cell, objects[-1].cells[name])
    return shared


def differing(rows: Sequence[Row], common_cells: Mapping[str, Cell]) -> list[Row]:
    """Return rows of objects without the shared cells. Boundaries keep all cells."""
    result = []
    for row in rows:
        cells = row.cells
        if row.kind != BOUNDARY:
            cells = {
                name: cell for name, cell in cells.items() if name not in common_cells
            }
        result.append(replace(row, cells=cells))
    return result


def _is_equal(first: Cell, second: Cell) -> bool:
    """Return whether two cells are equal without regard to lines of the file."""
    one, other = first.source, second.source
    if (first.text, one.kind, one.confidence) != (
        second.text,
        other.kind,
        other.confidence,
    ):
        return False
    # Lines of the file differ for each object: they are merged to a range.
    return one.kind == "file" or one.text == other.text


def merge_equal_rows(rows: Sequence[Row]) -> list[Row]:
    """Merge rows with equal values at the place of the first. Names and lines of the
    file may differ.
    """
    # The key of a row contains everything that must be equal, but no lines of the
    # file.
    equal_rows: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        cells = []
        for name, cell in row.cells.items():
            cells.append(
                (
                    name,
                    cell.text,
                    replace(cell.source, text="")
                    if cell.source.kind == "file"
                    else cell.source,
                )
            )
        equal_rows.setdefault(
            (row.label, row.kind, row.other_sources, *cells), []
        ).append(row)
    return [
        rows[0] if len(rows) == 1 else _merge_rows(rows) for rows in equal_rows.values()
    ]


def _merge_rows(rows: Sequence[Row]) -> Row:
    first, last = rows[0], rows[-1]
    cells = {}
    for name, cell in first.cells.items():
        cells[name] = _merge_cells(cell, last.cells[name])
    names = [row.name for row in rows]
    return replace(first, name=name_ranges(names), cells=cells, names=tuple(names))


def _merge_cells(cell: Cell, last: Cell) -> Cell:
    """Return a cell with a source from its own lines to those of `last`."""
    text, end = cell.source.text, last.source.text
    if text != end:
        text = f"{text} to {end}".replace("line ", "lines ", 1)
        # The word is written once: lines 3 to 7.
        text = text.replace(" to line ", " to ")
    return replace(cell, source=replace(cell.source, text=text))


def _object(scene: Scene, index: int, body: Body, sources: Provenance) -> Row:
    item = scene.objects[index]
    path = f"objects.{item.name}"

    def cell(text: str, key: str, small: str = "") -> Cell:
        return Cell(
            text,
            sources.of(
                f"{path}.{key}",
                item.provenance.get(key),
                text_path=f"{path}.from.{key}",
            ),
            small,
        )

    moment, small_moment = rounded(body.moment, 4), ""
    speed, small_speed = value_text(body.velocity), ""
    if is_scaled(scene):
        meter = scene.world.pixels_per_meter
        # A moment of inertia contains the square of a length.
        in_centimeters = body.moment * (CENTIMETERS / meter) ** 2
        moment, small_moment = (
            rounded(in_centimeters, METRIC_DIGITS),
            f"{moment} g·px²",
        )
        speed, small_speed = _metric_pair(body.velocity / meter), f"{speed} px/s"
    shape, small_shape = _shape(scene, body)
    cells = {
        "shape": cell(shape, "shape", small_shape),
        "mass": cell(
            rounded(body.mass, 4), "mass" if item.mass is not None else "density"
        ),
        "moment": Cell(moment, Source("computed", "computed"), small_moment),
        **{
            key: cell(value_text(getattr(item, key)), key)
            for key in ("friction", "elasticity", "rolling")
        },
        "velocity": cell(speed, "velocity", small_speed if body.velocity.any() else ""),
        "spin": cell(value_text(degrees(body.spin)), "spin"),
    }
    # The mass of a fixed object has no effect.
    if item.motion is Motion.STATIC:
        cells = {
            key: value for key, value in cells.items() if key not in ("mass", "moment")
        }
    other_sources = "; ".join(
        f"{key}: {source}"
        for key, source in item.provenance.items()
        if key not in cells
    )
    return Row(item.name, item.label, item.motion.value, cells, other_sources)


def _metric_pair(vector: Array) -> str:
    """Return a vector in m/s, with two digits for each component."""
    x, y = (rounded(float(part), METRIC_DIGITS) for part in vector)
    return f"({x}, {y})"


def _shape(scene: Scene, body: Body) -> tuple[str, str]:
    """Return a body's shape in words, and its size in px if the words have cm."""
    if body.radius is None:
        corners = sum(map(len, body.rings))
        pieces = ""
        if len(body.pieces) > 1:
            pieces = f", {len(body.pieces)} pieces"
        return f"polygon, {corners} corners{pieces}", ""
    shape_name = "circle"
    if body.solid is not Solid.DISC:
        shape_name = body.solid.value
    pixels = f"r {rounded(body.radius, 4)} px"
    if not is_scaled(scene):
        return f"{shape_name}, {pixels}", ""
    in_centimeters = CENTIMETERS * body.radius / scene.world.pixels_per_meter
    return f"{shape_name}, r {rounded(in_centimeters, METRIC_DIGITS)} cm", pixels
