"""Mask operations: brush, eraser, polygon, box, point, merge, split and relabel.

Each sets the new pixels of objects, or the operations on the scene's text, of a correction, and returns its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from physgen import registry
from physgen.compile.shapes import fill_polygon
from physgen.edit.object_entries import (
    Correction,
    Data,
    Mask,
    changed_entry,
    new_entry,
    written,
)
from physgen.edit.operations import replaced
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.scale import photo_object
from physgen.messages import Message
from physgen.perceive.document import object_names
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    Name,
    PhotoObject,
    PromptedMask,
    Rgb,
    Segments,
)
from physgen.perceive.segment.prompts import Segmenter, segment_box, segment_point
from physgen.pipeline.pushes import NEAR
from physgen.pipeline.stages import Recent
from physgen.problems import InputError
from physgen.registry import Backends
from physgen.text import listed

MAX_STROKE_WORK = 10**9
"""Distances of pixels to segments that are computed for one stroke: about half a minute."""
SAME = 0.5, 0.3
"""A box or a point means an existing object where they share this much of the smaller mask, and of the old one."""

Pixels = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
"""px of the photo."""
Point = Annotated[list[Pixels], Field(min_length=2, max_length=2)]
MAX_POINTS = 20_000
"""Of a stroke or a polygon."""


MAX_MERGED = 1000
"""Objects and regions that one operation makes one."""


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
    objects: Annotated[list[str], Field(min_length=2, max_length=MAX_MERGED)]


class SplitOp(BaseModel):
    kind: Literal["split"]
    object: str
    line: Annotated[list[Point], Field(min_length=2, max_length=2)]


class RelabelOp(BaseModel):
    kind: Literal["relabel"]
    object: str
    label: Annotated[str, Field(max_length=200, pattern=r"\S")]


MaskOp = BoxOp | PointOp | PolygonOp | BrushOp | MergeOp | SplitOp | RelabelOp
_PARSER: TypeAdapter[MaskOp] = TypeAdapter(
    Annotated[MaskOp, Field(discriminator="kind")]
)


def parse_op(op: Mapping[str, Any]) -> MaskOp:
    """A mask operation. Raises EditError."""
    try:
        return _PARSER.validate_python(dict(op))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][1:])
        message = (
            f"{where}: {first['msg']}"
            if where
            else f"a mask operation is not known: {first['msg']}"
        )
        raise Message.OPERATION_MALFORMED.impossible(reason=message[:300]) from None


def make(work: Correction, op: MaskOp, finder: PromptSegmenter) -> str:
    """Carry out one operation; returns its name. Raises EditError."""
    match op:
        case BoxOp():
            prompt = {"box": [round(v, 2) for v in op.box]}
            return _prompted(
                work,
                op.object,
                op.kind == "new",
                finder.box(work.maps.rgb, op.box),
                prompt,
            )
        case PointOp():
            x, y = op.point
            found = finder.point(work.maps.rgb, work.sight.key, (x, y))
            return _prompted(
                work, op.object, False, found, {"point": [round(x, 2), round(y, 2)]}
            )
        case PolygonOp():
            return _polygon(work, op)
        case BrushOp():
            return _brush(work, op)
        case MergeOp():
            return _merge(work, op)
        case SplitOp():
            return _split(work, op)
        case RelabelOp():
            return _relabel(work, op)


def _prompted(
    work: Correction, name: str | None, is_new: bool, found: PromptedMask, prompt: Data
) -> str:
    """Use the mask of a box or a point for an object that is there, or for a new one."""
    labels, number = work.labels, len(work.scene.objects)
    mask = found.mask
    if name is None and not is_new:
        there, every = (
            np.bincount(part.ravel(), minlength=number + 1)
            for part in (labels[mask], labels)
        )
        k = int(there[1:].argmax()) + 1 if number else 0
        if k and there[k] > max(
            SAME[0] * min(count(mask), int(every[k])), SAME[1] * int(every[k])
        ):
            name = work.scene.objects[k - 1].name
    own = 0 if name is None else work.index(name) + 1
    mask = mask & ((labels == 0) | (labels == own))
    if name is None:
        name = _new(work, mask)
        work.found[name] = found.confidence, prompt
        return f"a new object, {name}"
    _set_mask(work, name, mask)
    work.found[name] = found.confidence, prompt
    return f"correct the mask of {name}"


def _set_mask(work: Correction, name: str, mask: Mask) -> None:
    """Give an object other pixels. Raises EditError for too few."""
    work.index(name)
    check_size(mask, name)
    work.masks[name] = mask


def _polygon(work: Correction, op: PolygonOp) -> str:
    mask = fill_polygon(tuple((x, y) for x, y in op.polygon), work.scene.size)
    if op.object is None:
        return f"a new object, {_new(work, mask)}"
    _set_mask(work, op.object, mask)
    return f"draw the mask of {op.object}"


def _brush(work: Correction, op: BrushOp) -> str:
    was = work.mask(op.object)
    painted = stroke(op.strokes, op.radius, work.scene.size)
    mask = was | painted if op.kind == "brush" else was & ~painted
    if (mask == was).all():
        raise Message.STROKE_CHANGES_NOTHING.impossible()
    _set_mask(work, op.object, mask)
    return f"{'add to' if op.kind == 'brush' else 'erase from'} the mask of {op.object}"


def _new(work: Correction, mask: Mask) -> str:
    """The name of a new object, which it gets by its looks."""
    check_size(mask, "the new object")
    id_, size = len(work.scene.objects) + 1, work.scene.size
    labels = np.where(mask, np.uint16(id_), work.labels)
    one = photo_object(id_, fit_outlines(labels, [id_])[id_], "", size)
    guess: Mapping[int, Name] = registry.make("label")(work.maps.rgb, labels, [one])
    one = photo_object(id_, one.outline, guess[id_].label, size)
    name = object_names(
        [one], {k + 1: item.name for k, item in enumerate(work.scene.objects)}
    )[id_]
    work.entries[name] = new_entry(work, labels, one, name, guess[id_])
    work.fresh[name] = mask
    return name


def _merge(work: Correction, op: MergeOp) -> str:
    """Give the first object the pixels of the others, objects or doubtful regions."""
    kept, *names = op.objects
    work.index(kept)
    if len(set(op.objects)) < len(op.objects):
        raise Message.MERGE_WITH_ITSELF.impossible()
    own = work.mask(kept)
    masks = {name: _region(work, name) for name in names}
    document = dict(work.document)
    referring: list[str] = []
    for name in names:
        if name in doubtful_ids(work.document):
            work.ops.append({"remove": ["doubtful", name]})
            continue
        document, changed = replaced(document, name, kept)
        referring += changed
        work.ops.append({"merge": ["objects", name], "to": kept})
        work.gone = (*work.gone, name)
    away = cv2.distanceTransform(
        (~own).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    gap = max(away[mask].min(initial=np.inf) - 1 for mask in masks.values())
    work.masks[kept] = np.logical_or.reduce([own, *masks.values()])
    what = f"merge {listed(names, 'and')} into {kept}"
    if referring:
        what += f", without {' and '.join(dict.fromkeys(referring))}"
    is_far = NEAR * max(away.shape) < gap < np.inf
    return what + (f", {gap:.0f} px away: one rigid body now" if is_far else "")


def doubtful_ids(document: Mapping[str, Any]) -> dict[str, int]:
    """Return the ids in masks.png of the doubtful regions of a scene, by name."""
    regions = document.get("doubtful") or {}
    return {
        name: region["mask"]
        for name, region in regions.items()
        if isinstance(region, Mapping) and isinstance(region.get("mask"), int)
    }


def _region(work: Correction, name: str) -> Mask:
    """Return the pixels of an object or a doubtful region. Raises EditError."""
    regions = doubtful_ids(work.document)
    if name not in regions or name in work.document["objects"]:
        return work.mask(name)
    mask = (work.maps.labels == regions[name]) & (work.labels == 0)
    check_size(mask, name)
    return np.asarray(mask)


def _split(work: Correction, op: SplitOp) -> str:
    mask = work.mask(op.object)
    (x0, y0), (x1, y1) = op.line
    if (x0, y0) == (x1, y1):
        raise Message.SPLIT_AT_POINT.impossible()
    y, x = np.indices(mask.shape)
    side = (x1 - x0) * (y - y0) - (y1 - y0) * (
        x - x0
    ) > 0  # to the right of the extended line
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
    old = work.photo_object(op.object)
    one = PhotoObject(old.id, old.outline, label, old.cut)
    made = changed_entry(work, op.object, op.object, one, work.labels, label)
    work.ops += written(work, op.object, {**made, "label": label})
    return f"call {op.object} {label}"


def count(mask: Mask) -> int:
    """Pixels."""
    return int(np.count_nonzero(mask))


def check_size(mask: Mask, what: str) -> None:
    """Raises EditError for a mask that is only a speck."""
    if count(mask) < SMALLEST_OBJECT:
        raise Message.MASK_TOO_SMALL.impossible(part=what, least=SMALLEST_OBJECT)


# Pixels of what the user draws or points at


class PromptSegmenter:
    """Finds the objects in boxes and at points; segments of a photo are kept for the next point."""

    def __init__(self) -> None:
        self._segmented: Recent[Segments] = Recent(1)

    def box(self, rgb: Rgb, box: Sequence[float]) -> PromptedMask:
        """The object in a box (left, top, width, height). Raises EditError."""
        with _edit_errors():
            x, y, width, height = box
            return segment_box(rgb, (x, y, width, height))

    def point(self, rgb: Rgb, key: str, point: tuple[float, float]) -> PromptedMask:
        """The object at a point. Raises EditError; `key` identifies the photo."""
        with _edit_errors():
            found = self._segmented.of(key, partial(Segmenter(Backends()), rgb))
            return segment_point(rgb, point, found)


@contextmanager
def _edit_errors() -> Iterator[None]:
    """Turn errors of perception into errors of the editor."""
    try:
        yield
    except InputError as error:
        problem = error.problems[0]
        fix = "draw a box close around it" if "--" in problem.fix else problem.fix
        if fix.startswith("write x,y"):
            fix = "mark it on the photo"
        wrong = Message.MARK_REFUSED
        raise wrong.impossible(reason=problem.expected, fix=fix) from error


def stroke(
    points: Sequence[Sequence[float]], radius: float, size: tuple[int, int]
) -> Mask:
    """(H, W): pixels whose centre is within a radius of a line; `size` is width, height. Raises EditError for too many.

    >>> int(stroke([(2, 2)], 1.0, (5, 5)).sum())
    5
    """
    width, height = size
    near = np.zeros((height, width), np.bool_)
    line = np.array(points, np.float64)
    work = 0
    for a, b in zip(
        line[: max(len(line) - 1, 1)], line[1:] if len(line) > 1 else line, strict=True
    ):
        x0, y0 = np.floor(np.minimum(a, b) - radius).astype(int)
        x1, y1 = np.ceil(np.maximum(a, b) + radius).astype(int) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if x1 <= x0 or y1 <= y0 or near[y0:y1, x0:x1].all():
            continue
        work += int((x1 - x0) * (y1 - y0))
        if work > MAX_STROKE_WORK:
            raise Message.STROKE_TOO_LONG.impossible()
        y, x = np.mgrid[y0:y1, x0:x1]
        along, (dx, dy) = b - a, (x - a[0], y - a[1])
        length = float(along @ along)
        part = (
            np.clip((dx * along[0] + dy * along[1]) / length, 0, 1)
            if length > 0
            else np.zeros(x.shape)
        )
        near[y0:y1, x0:x1] |= (dx - part * along[0]) ** 2 + (
            dy - part * along[1]
        ) ** 2 <= radius**2 + 1e-9
    return near
