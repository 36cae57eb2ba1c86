"""Scene + World + what was edited -> the table of parameters: each number with who said it, and how sure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path
from typing import Any

from physgen.compile.world import Body, World
from physgen.problems import Place
from physgen.scene.model import Motion, Scene, Solid

_SURE = re.compile(r"^(.*?)\s*(?<![\d.])(0(?:\.\d+)?|1(?:\.0+)?)$")
"""Who, and a confidence in 0..1 behind it: `table 0.4`."""


@dataclass(frozen=True)
class Source:
    """Where a number comes from."""

    kind: str
    """`flag`, `variant`, `guess`, `file` or `default`; `worked out` where nobody says it."""
    text: str
    sure: float | None = None
    """0..1."""


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
    said = _Said(scene, variant)
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


def source(said: str) -> Source:
    """What `from` says of a number.

    >>> source("table 0.4")
    Source(kind='guess', text='table', sure=0.4)
    """
    match = _SURE.match(said.strip())
    if match is None or not match[1]:
        return Source("guess", said)
    return Source("guess", match[1], float(match[2]))


class _Said:
    """Who said the value of a key."""

    def __init__(self, scene: Scene, variant: str | None) -> None:
        self._scene = scene
        start = f"variants.{variant}"
        self._edited = {
            place for key, place in scene.places.items() if variant is not None and key.startswith(start)
        }
        self._variant = variant
        root = scene.places.get("", Place(""))
        self._file = Path(root.file).name

    def of(self, path: str, provenance: str | None, near: bool = False) -> Source:
        """Flag before variant before guess before the file's own line; else the default.

        With `near`, a value that is written nowhere by itself stands where what it belongs to does.
        """
        place = self._scene.places.get(path)
        if place is None and near:
            place = self._scene.place(path)
        if place is not None and not place.line:
            return Source("flag", "--set")
        if place is not None and place in self._edited:
            return Source("variant", f"variant {self._variant}")
        if provenance is not None:
            return source(provenance)
        if place is None:
            return Source("default", "default")
        name = Path(place.file).name
        return Source("file", f"line {place.line}" if name == self._file else f"{name}, line {place.line}")


def _object(scene: Scene, index: int, body: Body, said: _Said) -> Row:
    item = scene.objects[index]
    path = f"objects.{item.name}"

    def cell(text: str, key: str) -> Cell:
        return Cell(text, said.of(f"{path}.{key}", item.provenance.get(key)))

    weight = "mass" if item.mass is not None else "density"
    cells = {
        "shape": Cell(_shape(body), said.of(f"{path}.shape", item.provenance.get("shape"))),
        "mass": Cell(_grams(body.mass), said.of(f"{path}.{weight}", item.provenance.get(weight))),
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
