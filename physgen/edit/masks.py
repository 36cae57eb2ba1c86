"""Mask operations: brush, eraser, polygon, box, point, merge, split and relabel.

Each sets the new pixels of objects, or the operations on the scene's text, of a correction, and returns its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from physgen.compile.shapes import fill_polygon
from physgen.edit import object_entries
from physgen.edit.errors import impossible
from physgen.edit.live import CompiledScene, Live
from physgen.edit.map_patches import fitted
from physgen.edit.mask_tools import beyond, stroke
from physgen.edit.object_entries import Before, Data
from physgen.edit.operations import replaced
from physgen.maps import Percepts
from physgen.perceive.document import object_names
from physgen.perceive.roles import SMALLEST_OBJECT, Detections, PhotoObject
from physgen.perceive.segment.prompts import PROMPT_ODDS
from physgen.problems import InputError
from physgen.scene.scene import Scene

Mask = NDArray[np.bool_]

SAME = 0.5, 0.3
"""A box or a point means an existing object where they share this much of the smaller mask, and of the old one."""

Pixels = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
"""px of the photo."""
Point = Annotated[list[Pixels], Field(min_length=2, max_length=2)]
MAX_POINTS = 20_000
"""Of a stroke or a polygon."""


class BoxOp(BaseModel):
    """An object in a box (left, top, width, height); `new`: never one that is there already."""

    kind: Literal["box", "new"]
    box: Annotated[list[Pixels], Field(min_length=4, max_length=4)]
    object: str | None = None


class PointOp(BaseModel):
    kind: Literal["point"]
    point: Point
    object: str | None = None


class PolygonOp(BaseModel):
    kind: Literal["polygon"]
    polygon: Annotated[list[Point], Field(min_length=3, max_length=MAX_POINTS)]
    object: str | None = None


class BrushOp(BaseModel):
    kind: Literal["brush", "eraser"]
    object: str
    strokes: Annotated[list[Point], Field(min_length=1, max_length=MAX_POINTS)]
    radius: Annotated[Pixels, Field(gt=0, le=2000)]


class MergeOp(BaseModel):
    kind: Literal["merge"]
    objects: Annotated[list[str], Field(min_length=2, max_length=2)]


class SplitOp(BaseModel):
    kind: Literal["split"]
    object: str
    line: Annotated[list[Point], Field(min_length=2, max_length=2)]


class RelabelOp(BaseModel):
    kind: Literal["relabel"]
    object: str
    label: Annotated[str, Field(max_length=200, pattern=r"\S")]


MaskOp = BoxOp | PointOp | PolygonOp | BrushOp | MergeOp | SplitOp | RelabelOp
_PARSER: TypeAdapter[MaskOp] = TypeAdapter(Annotated[MaskOp, Field(discriminator="kind")])


def parse_op(op: Mapping[str, Any]) -> MaskOp:
    """A mask operation. Raises EditError."""
    try:
        return _PARSER.validate_python(dict(op))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][1:])
        message = f"{where}: {first['msg']}" if where else f"a mask operation is not known: {first['msg']}"
        raise impossible(message[:300], "see docs/editing.md") from None


@dataclass
class Correction:
    """A correction under way."""

    live: Live
    text: str
    folder: Path | None
    """That stands in for the scene's assets, None for its own."""
    sight: CompiledScene
    maps: Percepts
    known: Before
    masks: dict[str, Mask] = field(default_factory=dict)
    """New pixels of objects that were there."""
    fresh: dict[str, Mask] = field(default_factory=dict)
    """Pixels of new objects."""
    entries: dict[str, Data] = field(default_factory=dict)
    """Their entries, as far as they are known; masks, shapes and numbers come at the end."""
    found: dict[str, tuple[float, Data]] = field(default_factory=dict)
    """How sure a mask is, and the prompt that it was found by."""
    gone: str | None = None
    ops: list[Data] = field(default_factory=list)

    @property
    def scene(self) -> Scene:
        """Before the correction."""
        return self.sight.scene

    def mask(self, name: str) -> Mask:
        """Pixels of an object as they are. Raises EditError."""
        return np.asarray(self.sight.compiled.labels == self.index(name) + 1)

    def set_mask(self, name: str, mask: Mask) -> None:
        """Give an object other pixels. Raises EditError for too few."""
        check_size(mask, name)
        self.masks[name] = mask

    def index(self, name: str) -> int:
        """Of an object. Raises EditError."""
        every = [item.name for item in self.scene.objects]
        if name not in every or name not in self.known.document["objects"]:
            raise impossible(f"no object is called {name!r}", "choose an object")
        return every.index(name)


def begin(live: Live, text: str, maps: Path | None) -> Correction:
    """A correction of a text begins. Raises EditError where the text is wrong, or shows no photo."""
    try:
        sight = live.state(text, maps)
        document = live.document(text, maps)
    except InputError as error:
        raise impossible(f"the scene has an error: {error.problems[0]}", "mend it first") from error
    percepts = sight.percepts
    if percepts is None:
        raise impossible("the scene has no photo, so there is nothing to mask", "draw the object's shape")
    known = object_entries.before(sight.scene, document, sight.compiled, percepts.rgb)
    return Correction(live, text, maps, sight, percepts, known)


def make(work: Correction, op: MaskOp) -> str:
    """Carry out one operation; returns its name. Raises EditError."""
    return _MAKERS[type(op)](work, op)


def _box(work: Correction, op: BoxOp) -> str:
    found = work.live.finder.box(work.maps.rgb, work.sight.key, op.box)
    prompt = {"box": [round(v, 2) for v in op.box]}
    return _prompted(work, op.object, op.kind == "new", (found.mask, found.confidence), prompt)


def _point(work: Correction, op: PointOp) -> str:
    x, y = op.point
    found = work.live.finder.point(work.maps.rgb, work.sight.key, (x, y))
    prompt = {"point": [round(x, 2), round(y, 2)]}
    return _prompted(work, op.object, False, (found.mask, found.confidence), prompt)


def _prompted(
    work: Correction, name: str | None, is_new: bool, found: tuple[Mask, float], prompt: Data
) -> str:
    """Use the mask of a box or a point for an object that is there, or for a new one."""
    labels, count = work.sight.compiled.labels, len(work.scene.objects)
    mask, fit = found
    if name is None and not is_new:
        there, every = (np.bincount(part.ravel(), minlength=count + 1) for part in (labels[mask], labels))
        size = int(mask.sum())
        k = int(there[1:].argmax()) + 1 if count else 0
        if k and there[k] > max(SAME[0] * min(size, int(every[k])), SAME[1] * int(every[k])):
            name = work.scene.objects[k - 1].name
    own = 0 if name is None else work.index(name) + 1
    mask = mask & ((labels == 0) | (labels == own))
    sure = PROMPT_ODDS * fit / (1 + (PROMPT_ODDS - 1) * fit)  # a user has pointed there
    if name is None:
        return _new(work, mask, (sure, prompt))
    work.set_mask(name, mask)
    work.found[name] = sure, prompt
    return f"correct the mask of {name}"


def _polygon(work: Correction, op: PolygonOp) -> str:
    mask = fill_polygon(tuple((x, y) for x, y in op.polygon), work.scene.size)
    if op.object is None:
        return _new(work, mask)
    work.index(op.object)
    work.set_mask(op.object, mask)
    return f"draw the mask of {op.object}"


def _brush(work: Correction, op: BrushOp) -> str:
    was = work.mask(op.object)
    painted = stroke([(x, y) for x, y in op.strokes], op.radius, work.scene.size)
    mask = was | painted if op.kind == "brush" else was & ~painted
    if (mask == was).all():
        raise impossible("the stroke changes nothing", "paint over its border")
    work.set_mask(op.object, mask)
    return f"{'add to' if op.kind == 'brush' else 'erase from'} the mask of {op.object}"


def _new(work: Correction, mask: Mask, found: tuple[float, Data] | None = None) -> str:
    check_size(mask, "the new object")
    id_, size = len(work.scene.objects) + 1, work.scene.size
    labels = np.where(mask, np.uint16(id_), work.sight.compiled.labels)
    outline = fitted(labels, [id_])[id_]
    called = object_entries.named(work.known, labels, object_entries.photo_object(id_, outline, "", size))
    one = object_entries.photo_object(id_, outline, called.label, size)
    name = object_names([one], {k + 1: item.name for k, item in enumerate(work.scene.objects)})[id_]
    drawn = Detections(labels, "drawn", {}, {})
    work.entries[name] = object_entries.entry(work.known, labels, one, name, called, drawn)
    work.fresh[name] = mask
    if found is not None:
        work.found[name] = found
    return f"a new object, {name}"


def _merge(work: Correction, op: MergeOp) -> str:
    kept, other = op.objects
    if kept == other:
        raise impossible("the two objects are one", "choose two objects")
    work.masks[kept] = work.mask(kept) | work.mask(other)
    work.gone = other
    _, gone = replaced(dict(work.known.document), other, kept)
    work.ops = [{"merge": ["objects", other], "to": kept}]
    return f"merge {other} into {kept}" + (f", without {' and '.join(gone)}" if gone else "")


def _split(work: Correction, op: SplitOp) -> str:
    mask = work.mask(op.object)
    if op.line[0] == op.line[1]:
        raise impossible("the line is a point", "draw it across the object")
    (x0, y0), (x1, y1) = op.line
    side = beyond([(x0, y0), (x1, y1)], work.scene.size)
    larger, smaller = sorted((mask & side, mask & ~side), key=lambda part: -count(part))
    check_size(smaller, "one of the halves")
    taken = {item.name for item in work.scene.objects}
    number = 2
    while f"{op.object}-{number}" in taken:
        number += 1
    work.masks[op.object] = larger
    work.fresh[f"{op.object}-{number}"] = smaller
    return f"split {op.object}"


def _relabel(work: Correction, op: RelabelOp) -> str:
    label = op.label.strip()
    work.index(op.object)
    old = work.known.photo_object(op.object)
    one = PhotoObject(old.id, old.outline, label, old.cut)
    made = object_entries.changed(work.known, op.object, one, work.sight.compiled.labels, label)
    work.ops += written(work, op.object, {**made, "label": label})
    return f"call {op.object} {label}"


_MAKERS: dict[type[BaseModel], Callable[[Correction, Any], str]] = {
    BoxOp: _box,
    PointOp: _point,
    PolygonOp: _polygon,
    BrushOp: _brush,
    MergeOp: _merge,
    SplitOp: _split,
    RelabelOp: _relabel,
}


def written(work: Correction, name: str, made: Data) -> list[Data]:
    """Operations for what differs from the entry as it is written."""
    was = work.known.was(name)
    path = ["objects", name]
    ops = [
        {"set": [*path, key], "value": value}
        for key, value in made.items()
        if key not in was or was[key] != value
    ]
    gone = [key for key in was if key not in made and (key != "density" or "mass" not in made)]
    return ops + [{"unset": [*path, key]} for key in gone]  # setting a mass drops the density


def count(mask: Mask) -> int:
    """Pixels."""
    return int(np.count_nonzero(mask))


def check_size(mask: Mask, what: str) -> None:
    """Raises EditError for a mask that is only a speck."""
    if count(mask) < SMALLEST_OBJECT:
        message = f"{what} would have fewer than {SMALLEST_OBJECT} px"
        raise impossible(message, "mark more of it, or delete the object")
