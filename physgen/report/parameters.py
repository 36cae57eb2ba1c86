"""Scene + World + what was edited -> the table of parameters: each number with who said it, and how sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from physgen.compile.world import Body, World
from physgen.scene.model import Motion, Scene, Solid
from physgen.scene.said import Said, Source


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
    said = Said(scene, variant)
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


def _object(scene: Scene, index: int, body: Body, said: Said) -> Row:
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
