"""Mask operations: brush, eraser, polygon, box, point, merge, split and relabel.

Each operation sets the new pixels of objects, or the operations on the scene's text, of
a correction, and returns its name for the history.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from physgen import registry
from physgen.compile.shapes import fill_polygon
from physgen.edit.object_entries import (
    Correction,
    Data,
    Mask,
    changed_entry,
    new_entry,
    write_operations,
)
from physgen.edit.operations import replace_name
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.scale import photo_object
from physgen.messages import Message
from physgen.perceive.naming import object_names
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
"""Limit on the distances of pixels to segments for one stroke: about half a minute."""
SAME = 0.5, 0.3
"""Overlap above which a box or a point selects an existing object: shares of the
smaller mask, and of the object's mask.
"""

Pixels = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e6, le=1e6)]
"""Length or coordinate, px of the photo."""
Point = Annotated[list[Pixels], Field(min_length=2, max_length=2)]
MAX_POINTS = 20_000
"""Points of a stroke or a polygon."""


MAX_MERGED = 1000
"""Objects and regions that one operation merges."""


class BoxOp(BaseModel):
    """An object in a box (left, top, width, height); `new` never selects an existing
    object.
    """

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
    """Parse a mask operation. Raises EditError."""
    try:
        return _PARSER.validate_python(dict(op))
    except ValidationError as error:
        first_error = error.errors()[0]
        location = ".".join(map(str, first_error["loc"][1:]))
        if location:
            message = f"{location}: {first_error['msg']}"
        else:
            message = f"a mask operation is not known: {first_error['msg']}"
        raise Message.OPERATION_MALFORMED.impossible(reason=message[:300]) from None


def make(work: Correction, op: MaskOp, finder: PromptSegmenter) -> str:
    """Apply one operation and return its name. Raises EditError."""
    match op:
        case BoxOp():
            prompt = {"box": [round(v, 2) for v in op.box]}
            return _apply_prompted_mask(
                work,
                op.object,
                op.kind == "new",
                finder.box(work.maps.rgb, op.box),
                prompt,
            )
        case PointOp():
            x, y = op.point
            prompted_mask = finder.point(work.maps.rgb, work.sight.key, (x, y))
            return _apply_prompted_mask(
                work,
                op.object,
                False,
                prompted_mask,
                {"point": [round(x, 2), round(y, 2)]},
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


def _apply_prompted_mask(
    work: Correction,
    name: str | None,
    is_new: bool,
    prompted_mask: PromptedMask,
    prompt: Data,
) -> str:
    """Use the mask of a box or a point for an existing object, or for a new one."""
    labels = work.labels
    number = len(work.scene.objects)
    mask = prompted_mask.mask
    # Without a name, the mask corrects the object with the largest overlap, unless the
    # overlap is so small that another object is meant.
    if name is None and not is_new:
        # Pixels of each object inside the new mask, and in the whole photo.
        overlaps, areas = (
            np.bincount(part.ravel(), minlength=number + 1)
            for part in (labels[mask], labels)
        )
        best_id = 0
        if number:
            best_id = int(overlaps[1:].argmax()) + 1
        # The overlap must be a large share of the smaller area, and some share of the
        # object.
        if best_id and overlaps[best_id] > max(
            SAME[0] * min(count(mask), int(areas[best_id])),
            SAME[1] * int(areas[best_id]),
        ):
            name = work.scene.objects[best_id - 1].name
    if name is None:
        own_id = 0
    else:
        own_id = work.index(name) + 1
    # A new mask never takes pixels of other objects.
    mask = mask & ((labels == 0) | (labels == own_id))
    if name is None:
        name = _new(work, mask)
        work.prompts[name] = prompted_mask.confidence, prompt
        return f"a new object, {name}"
    _set_mask(work, name, mask)
    work.prompts[name] = prompted_mask.confidence, prompt
    return f"correct the mask of {name}"


def _set_mask(work: Correction, name: str, mask: Mask) -> None:
    """Set the pixels of an object. Raises EditError for too few."""
    work.index(name)
    check_size(mask, name)
    work.masks[name] = mask


def _polygon(work: Correction, op: PolygonOp) -> str:
    """Draw the mask of a new or an existing object as a polygon."""
    mask = fill_polygon(tuple((x, y) for x, y in op.polygon), work.scene.size)
    if op.object is None:
        return f"a new object, {_new(work, mask)}"
    _set_mask(work, op.object, mask)
    return f"draw the mask of {op.object}"


def _brush(work: Correction, op: BrushOp) -> str:
    """Add a stroke to an object's mask, or erase it from the mask."""
    old_mask = work.mask(op.object)
    painted_mask = stroke(op.strokes, op.radius, work.scene.size)
    if op.kind == "brush":
        mask = old_mask | painted_mask
    else:
        mask = old_mask & ~painted_mask
    if (mask == old_mask).all():
        raise Message.STROKE_CHANGES_NOTHING.impossible()
    _set_mask(work, op.object, mask)
    return f"{'add to' if op.kind == 'brush' else 'erase from'} the mask of {op.object}"


def _new(work: Correction, mask: Mask) -> str:
    """Create a new object and return its name, derived from its label."""
    check_size(mask, "the new object")
    id_ = len(work.scene.objects) + 1
    size = work.scene.size
    labels = np.where(mask, np.uint16(id_), work.labels)
    new_object = photo_object(id_, fit_outlines(labels, [id_])[id_], "", size)
    guess: Mapping[int, Name] = registry.make("label")(
        work.maps.rgb, labels, [new_object]
    )
    # The label is known only now, and the object is described again with it.
    new_object = photo_object(id_, new_object.outline, guess[id_].label, size)
    name = object_names(
        [new_object], {k + 1: item.name for k, item in enumerate(work.scene.objects)}
    )[id_]
    work.entries[name] = new_entry(work, labels, new_object, name, guess[id_])
    work.new_masks[name] = mask
    return name


def _merge(work: Correction, op: MergeOp) -> str:
    """Add the pixels of the other objects or doubtful regions to the first object."""
    target_name, *names = op.objects
    work.index(target_name)
    if len(set(op.objects)) < len(op.objects):
        raise Message.MERGE_WITH_ITSELF.impossible()
    target_mask = work.mask(target_name)
    masks = {name: _region(work, name) for name in names}
    document = dict(work.document)
    all_removed_parts: list[str] = []
    # A doubtful region has no entry to merge; objects also may be named by joints and
    # forces.
    for name in names:
        if name in doubtful_ids(work.document):
            work.ops.append({"remove": ["doubtful", name]})
            continue
        document, removed_parts = replace_name(document, name, target_name)
        all_removed_parts += removed_parts
        work.ops.append({"merge": ["objects", name], "to": target_name})
        work.merged_names = (*work.merged_names, name)
    # Distances of all pixels from the target, px: parts that lie apart become one rigid
    # body, and the title says so.
    distances = cv2.distanceTransform(
        (~target_mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE
    )
    # Centres of adjacent pixels are 1 px apart, without a gap between them.
    gap = max(distances[mask].min(initial=np.inf) - 1 for mask in masks.values())
    work.masks[target_name] = np.logical_or.reduce([target_mask, *masks.values()])
    title = f"merge {listed(names, 'and')} into {target_name}"
    if all_removed_parts:
        title += f", without {' and '.join(dict.fromkeys(all_removed_parts))}"
    is_far = NEAR * max(distances.shape) < gap < np.inf
    return title + (f", {gap:.0f} px away: one rigid body now" if is_far else "")


def doubtful_ids(document: Mapping[str, Any]) -> dict[str, int]:
    """Return the ids in masks.png of the doubtful regions of a scene, by name."""
    regions = document.get("doubtful") or {}
    ids = {}
    for name, region in regions.items():
        if isinstance(region, Mapping) and isinstance(region.get("mask"), int):
            ids[name] = region["mask"]
    return ids


def _region(work: Correction, name: str) -> Mask:
    """Return the pixels of an object or a doubtful region. Raises EditError."""
    regions = doubtful_ids(work.document)
    if name not in regions or name in work.document["objects"]:
        return work.mask(name)
    mask = (work.maps.labels == regions[name]) & (work.labels == 0)
    check_size(mask, name)
    return np.asarray(mask)


def _split(work: Correction, op: SplitOp) -> str:
    """Split an object along a line; the larger part keeps the name."""
    mask = work.mask(op.object)
    (x0, y0), (x1, y1) = op.line
    if (x0, y0) == (x1, y1):
        raise Message.SPLIT_AT_POINT.impossible()
    y, x = np.indices(mask.shape)
    # The sign of the cross product tells the sides of the extended line apart.
    is_right_side = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0
    larger, smaller = sorted(
        (mask & is_right_side, mask & ~is_right_side), key=lambda part: -count(part)
    )
    check_size(smaller, "one of the halves")
    used_names = {item.name for item in work.scene.objects}
    number = 2
    while f"{op.object}-{number}" in used_names:
        number += 1
    work.masks[op.object] = larger
    work.new_masks[f"{op.object}-{number}"] = smaller
    return f"split {op.object}"


def _relabel(work: Correction, op: RelabelOp) -> str:
    """Set the label of an object, and the values that follow from the label."""
    label = op.label.strip()
    old_object = work.photo_object(op.object)
    new_object = PhotoObject(old_object.id, old_object.outline, label, old_object.cut)
    entry = changed_entry(work, op.object, op.object, new_object, work.labels, label)
    work.ops += write_operations(work, op.object, {**entry, "label": label})
    return f"call {op.object} {label}"


def count(mask: Mask) -> int:
    """Count the pixels of a mask."""
    return int(np.count_nonzero(mask))


def check_size(mask: Mask, part: str) -> None:
    """Check the size of a mask. Raises EditError if it is only a speck."""
    if count(mask) < SMALLEST_OBJECT:
        raise Message.MASK_TOO_SMALL.impossible(part=part, least=SMALLEST_OBJECT)


# Pixels at the strokes and points of the user


class PromptSegmenter:
    """Finds objects in boxes and at points; stores the segments of the latest photo."""

    def __init__(self) -> None:
        self._segmented: Recent[Segments] = Recent(1)

    def box(self, rgb: Rgb, box: Sequence[float]) -> PromptedMask:
        """Segment the object in a box (left, top, width, height). Raises EditError."""
        with _edit_errors():
            x, y, width, height = box
            return segment_box(rgb, (x, y, width, height))

    def point(self, rgb: Rgb, key: str, point: tuple[float, float]) -> PromptedMask:
        """Segment the object at a point; `key` identifies the photo. Raises
        EditError.
        """
        with _edit_errors():
            segments = self._segmented.of(key, partial(Segmenter(Backends()), rgb))
            return segment_point(rgb, point, segments)


@contextmanager
def _edit_errors() -> Iterator[None]:
    """Convert errors of perception to errors of the editor."""
    try:
        yield
    except InputError as error:
        problem = error.problems[0]
        # The fixes of perception name flags and coordinates, which the page has not.
        if "--" in problem.fix:
            fix = "draw a box close around it"
        else:
            fix = problem.fix
        if fix.startswith("write x,y"):
            fix = "mark it on the photo"
        wrong = Message.MARK_REFUSED
        raise wrong.impossible(reason=problem.expected, fix=fix) from error


def stroke(
    points: Sequence[Sequence[float]], radius: float, size: tuple[int, int]
) -> Mask:
    """Return the mask (H, W) of pixels with a centre within a radius of a line.

    `size` is width, height in px. Raises EditError for a stroke that is too long.

    >>> int(stroke([(2, 2)], 1.0, (5, 5)).sum())
    5
    """
    width, height = size
    is_painted = np.zeros((height, width), np.bool_)
    line = np.array(points, np.float64)
    # A single point is a segment without length.
    ends = line[1:] if len(line) > 1 else line
    distance_count = 0
    for start, end in zip(line, ends, strict=False):
        # Only the bounding box of the segment is looked at, clipped to the photo.
        x0, y0 = np.floor(np.minimum(start, end) - radius).astype(int)
        x1, y1 = np.ceil(np.maximum(start, end) + radius).astype(int) + 1
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if x1 <= x0 or y1 <= y0 or is_painted[y0:y1, x0:x1].all():
            continue
        distance_count += int((x1 - x0) * (y1 - y0))
        if distance_count > MAX_STROKE_WORK:
            raise Message.STROKE_TOO_LONG.impossible()
        y, x = np.mgrid[y0:y1, x0:x1]
        squares = _square_distances(x - start[0], y - start[1], end - start)
        is_painted[y0:y1, x0:x1] |= squares <= radius**2 + 1e-9
    return is_painted


def _square_distances(
    dx: NDArray[np.float64], dy: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the squares of distances to a segment, px², of points at dx, dy from its
    start.
    """
    length = float(direction @ direction)
    # Parameter of the nearest point on the segment, 0 at its start and 1 at its end; a
    # single point has no direction.
    fraction = np.zeros(dx.shape)
    if length > 0:
        fraction = np.clip((dx * direction[0] + dy * direction[1]) / length, 0, 1)
    return np.asarray(
        (dx - fraction * direction[0]) ** 2 + (dy - fraction * direction[1]) ** 2
    )
