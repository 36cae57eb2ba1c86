"""Mask operations: brush, eraser, polygon, box, point, merge, split and relabel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.edit import object_entries
from physgen.edit.errors import impossible
from physgen.edit.live import Live, Sight
from physgen.edit.map_patches import fitted
from physgen.edit.mask_tools import (
    beyond,
    inside,
    large_enough,
    numbers,
    points_of,
    radius_of,
    stroke,
    too_small,
)
from physgen.edit.object_entries import Before, Data
from physgen.edit.operations import replaced
from physgen.maps import Percepts
from physgen.perceive.document import object_names
from physgen.perceive.roles import SMALLEST_OBJECT, Detections, PhotoObject
from physgen.perceive.segment.prompts import PROMPT_ODDS
from physgen.problems import InputError
from physgen.scene.scene import Scene

Mask = NDArray[np.bool_]
Op = Mapping[str, Any]

SAME = 0.5, 0.3
"""A box or a point means an object that is there when they share this much of the smaller mask, and of the old one."""
MOST_LABEL = 200
"""Characters."""


@dataclass
class Work:
    """A correction under way."""

    live: Live
    text: str
    folder: Path | None
    """That stands in for the scene's assets, None for its own."""
    sight: Sight
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
        """As it was."""
        return self.sight.scene

    def mask(self, name: str) -> Mask:
        """Pixels of an object as they are. Raises EditError."""
        return np.asarray(self.sight.compiled.labels == self.index(name) + 1)

    def index(self, name: Any) -> int:
        """Of an object. Raises EditError."""
        every = [item.name for item in self.scene.objects]
        if not isinstance(name, str) or name not in every or name not in self.known.document["objects"]:
            raise impossible(f"no object is called {name!r}", "choose an object")
        return every.index(name)


def begun(live: Live, text: str, maps: Path | None) -> Work:
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
    return Work(live, text, maps, sight, percepts, known)


# What is drawn or pointed at


def _box(work: Work, op: Op) -> str:
    box = numbers(op.get("box"), 4, "box")
    meant = work.live.finder.box(work.maps.rgb, work.sight.key, box)
    return _found(work, op, meant.mask, meant.confidence, {"box": [round(v, 2) for v in box]})


def _point(work: Work, op: Op) -> str:
    x, y = numbers(op.get("point"), 2, "point")
    meant = work.live.finder.point(work.maps.rgb, work.sight.key, (x, y))
    return _found(work, op, meant.mask, meant.confidence, {"point": [round(x, 2), round(y, 2)]})


def _found(work: Work, op: Op, mask: Mask, fit: float, prompt: Data) -> str:
    """What perception takes a box or a point for: an object that is there, or a new one."""
    labels, count = work.sight.compiled.labels, len(work.scene.objects)
    name = op.get("object")
    if name is None and op.get("kind") != "new":
        there, every = (np.bincount(part.ravel(), minlength=count + 1) for part in (labels[mask], labels))
        size = int(mask.sum())
        k = int(there[1:].argmax()) + 1 if count else 0
        if k and there[k] > max(SAME[0] * min(size, int(every[k])), SAME[1] * int(every[k])):
            name = work.scene.objects[k - 1].name
    own = 0 if name is None else work.index(name) + 1
    mask = mask & ((labels == 0) | (labels == own))
    sure = PROMPT_ODDS * fit / (1 + (PROMPT_ODDS - 1) * fit)  # a person has pointed there
    if name is None:
        return _new(work, large_enough(mask, "the new object"), (sure, prompt))
    work.masks[name] = large_enough(mask, name)
    work.found[name] = sure, prompt
    return f"correct the mask of {name}"


def _polygon(work: Work, op: Op) -> str:
    name = op.get("object")
    mask = inside(points_of(op, "polygon", 3), work.scene.size)
    if name is None:
        return _new(work, large_enough(mask, "the new object"))
    work.index(name)
    work.masks[name] = large_enough(mask, name)
    return f"draw the mask of {name}"


def _brush(work: Work, op: Op) -> str:
    name = op.get("object")
    was = work.mask(name)  # type: ignore[arg-type]
    painted = stroke(points_of(op, "strokes", 1), radius_of(op), work.scene.size)
    adds = op["kind"] == "brush"
    mask = was | painted if adds else was & ~painted
    if (mask == was).all():
        raise impossible("the stroke changes nothing", "paint over its border")
    assert isinstance(name, str)
    work.masks[name] = large_enough(mask, name)
    return f"{'add to' if adds else 'erase from'} the mask of {name}"


def _new(work: Work, mask: Mask, found: tuple[float, Data] | None = None) -> str:
    id_ = len(work.scene.objects) + 1
    labels = np.where(mask, np.uint16(id_), work.sight.compiled.labels)
    outline = fitted(labels, [id_])[id_]
    called = object_entries.named(work.known, labels, object_entries.thing(id_, outline, "", work.scene.size))
    one = object_entries.thing(id_, outline, called.label, work.scene.size)
    kept = {k + 1: item.name for k, item in enumerate(work.scene.objects)}
    name = object_names([one], kept)[id_]
    given = Detections(labels, "drawn", {}, {})
    work.entries[name] = object_entries.entry(work.known, labels, one, name, called, given)
    work.fresh[name] = mask
    if found is not None:
        work.found[name] = found
    return f"a new object, {name}"


# Two of one, one of two


def _merge(work: Work, op: Op) -> str:
    told = op.get("objects")
    if not isinstance(told, list) or len(told) != 2 or told[0] == told[1]:
        raise impossible("objects are not two names", "choose two objects")
    kept, other = told
    work.masks[kept] = work.mask(kept) | work.mask(other)
    work.gone = other
    _, gone = replaced(dict(work.known.document), other, kept)
    work.ops = [{"merge": ["objects", other], "to": kept}]
    left = f", without {' and '.join(gone)}" if gone else ""
    return f"merge {other} into {kept}{left}"


def _split(work: Work, op: Op) -> str:
    name = op.get("object")
    mask = work.mask(name)  # type: ignore[arg-type]
    assert isinstance(name, str)
    line = points_of(op, "line", 2, 2)
    if line[0] == line[1]:
        raise impossible("the line is a point", "draw it across the object")
    side = beyond(line, work.scene.size)
    parts = sorted((mask & side, mask & ~side), key=lambda part: -count(part))
    if count(parts[1]) < SMALLEST_OBJECT:
        raise too_small("one of the halves")
    taken = {item.name for item in work.scene.objects}
    number = 2
    while f"{name}-{number}" in taken:
        number += 1
    work.masks[name] = parts[0]
    work.fresh[f"{name}-{number}"] = parts[1]
    return f"split {name}"


def _relabel(work: Work, op: Op) -> str:
    name, label = op.get("object"), op.get("label")
    k = work.index(name)
    assert isinstance(name, str)
    if not isinstance(label, str) or not label.strip() or len(label) > MOST_LABEL:
        raise impossible("the label is not a text", "say in a word or three what it is")
    label = label.strip()
    old = work.known.thing(name)
    one = PhotoObject(old.id, old.outline, label, old.cut)
    made = object_entries.changed(work.known, name, one, work.sight.compiled.labels, label)
    made["label"] = label
    work.ops += written(work, name, made)
    return f"call {work.scene.objects[k].name} {label}"


def written(work: Work, name: str, made: Data) -> list[Data]:
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


KINDS: dict[str, Callable[[Work, Op], str]] = {
    "box": _box,
    "new": _box,
    "point": _point,
    "polygon": _polygon,
    "brush": _brush,
    "eraser": _brush,
    "merge": _merge,
    "split": _split,
    "relabel": _relabel,
}
"""What makes each of them: sets `masks` and `fresh` of the work, or its operations, and says what was done."""
