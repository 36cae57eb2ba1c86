"""A scene's objects -> what perceiving its photo again starts from, and the old scene with what was found anew.

Objects without a prompt stay as they are written. Those with one are looked for again, and new prompts take the place
of what they cover.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from physgen.perceive.derived import Derived, anew, relayered
from physgen.perceive.found import Found
from physgen.perceive.given import Box, Point, from_prompts
from physgen.perceive.roles import Labels, Name, Rgb, Segment
from physgen.perceive.scale import DEFAULT
from physgen.scene.model import BoxPrompt, MaskId, Object

SAME = 0.5, 0.3
"""A new prompt means an object that is there when they share this much of the smaller mask, and of the old one."""
DERIVED = ("label", "solid", "mass", "friction", "elasticity")
"""Keys of an object that a person may have set: those that its `from` does not name stay."""
FOUND = ("mask", "shape", "prompt", "from")
"""Keys of an object that follow its pixels."""


@dataclass(frozen=True)
class Again:
    """What perception starts from."""

    found: Found
    repeated: frozenset[str]
    """Names of objects whose prompt the scene holds."""
    corrected: frozenset[str]
    """Names of those that a new prompt means."""
    gone: tuple[str, ...]
    """Names of objects that a new prompt took in."""


def again(
    rgb: Rgb,
    objects: Sequence[Object],
    labels: Labels,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segment,
) -> Again:
    """`labels` (H, W): id k + 1 is the k-th of `objects`; `boxes` and `points` are new ones. Ids of masks stay.

    Raises InputError as `from_prompts`.
    """
    ids = _ids(objects)
    asked = [k for k, item in enumerate(objects) if item.prompt is not None]
    asked.sort(
        key=lambda k: not isinstance(objects[k].prompt, BoxPrompt)
    )  # boxes first, as from_prompts has them
    prompts = [objects[k].prompt for k in asked]
    old_boxes = [one.box for one in prompts if isinstance(one, BoxPrompt)]
    old_points = [one.point for one in prompts if one is not None and not isinstance(one, BoxPrompt)]
    segmented = cache(lambda: segment(rgb))
    new = from_prompts(rgb, boxes, points, lambda rgb: segmented())
    repeated = from_prompts(rgb, old_boxes, old_points, lambda rgb: segmented())

    result = np.zeros(labels.shape, np.uint16)
    owner: dict[int, int] = {}  # id -> which of the objects
    sure: dict[int, float] = {}
    pointed: dict[int, Mapping[str, Any]] = {}
    for k in range(len(objects)):
        if k not in asked:
            result[labels == k + 1] = ids[k]
            owner[ids[k]] = k
    for n, k in enumerate(asked, 1):
        result[repeated.labels == n] = ids[k]
        owner[ids[k]] = k
        sure[ids[k]], pointed[ids[k]] = repeated.confidence[n], repeated.prompts[n]
    corrected: set[str] = set()
    gone: list[str] = []
    most = max(ids, default=0) + len(new.prompts)
    for n, prompt in new.prompts.items():
        mask = new.labels == n
        there, every = (np.bincount(part.ravel(), minlength=most + 1) for part in (result[mask], result))
        size = int(mask.sum())
        meant = [
            i for i in owner if there[i] > max(SAME[0] * min(size, int(every[i])), SAME[1] * int(every[i]))
        ]
        meant.sort(key=lambda i: -int(there[i]))
        result[np.isin(result, meant)] = 0
        for i in meant[1:]:
            gone.append(objects[owner.pop(i)].name)
            sure.pop(i, None), pointed.pop(i, None)
        i = meant[0] if meant else max(ids, default=0) + n
        if meant:
            corrected.add(objects[owner[i]].name)
        result[mask] = i
        sure[i], pointed[i] = new.confidence[n], prompt
    said = {i: objects[k].provenance.get("mask", "") for i, k in owner.items() if i not in pointed}
    names = {i: Name(objects[k].label, _sure(objects[k])) for i, k in owner.items() if objects[k].label}
    called = {i: objects[k].name for i, k in owner.items()}
    found = Found(result, "kept", sure, names, pointed, called=called, said=said)
    return Again(found, frozenset(objects[k].name for k in asked), frozenset(corrected), tuple(gone))


def _ids(objects: Sequence[Object]) -> list[int]:
    """An id for each: its own in `masks.png`, or the next that is free."""
    own = [item.mask.id if isinstance(item.mask, MaskId) else 0 for item in objects]
    free = iter(range(max(own, default=0) + 1, 65536))
    return [i if i and i not in own[:k] else next(free) for k, i in enumerate(own)]


def _sure(item: Object) -> float:
    """How sure its label is: what `from` says, or as sure as a person is."""
    said = item.provenance.get("label", "").split(" ")[-1]
    return float(said) if re.fullmatch(r"[01]?\.?\d+", said) else 1.0


def merged(
    old: Mapping[str, Any],
    new: Mapping[str, Any],
    told: Again,
    ours: Derived,
    labels: Mapping[str, str],
    layered: Collection[str] = (),
) -> dict[str, Any]:
    """The old scene as it was written, with objects as they were found anew, and new ones, of the `new` scene.

    A repeated prompt gives a mask and a shape. One that is corrected gets new numbers, too, where its `from` names who
    said the old ones. An object of nothing but a mask is filled in. What is `ours`, the table's, follows the labels,
    those in the file and the new `labels`, by name. Layers are as they are now, but for the
    objects `layered` by a person.
    """
    objects: dict[str, Any] = {}
    for name, was in old["objects"].items():
        now = new["objects"].get(name)
        if name in told.gone:
            continue
        said = was.get("from", {})
        if now is None or set(was) <= {"mask", "from"}:
            objects[name] = {**(now or {}), **was} if now else was
            if now:
                objects[name]["from"] = {**now["from"], **said}
        elif name in told.corrected:
            own = {key for key in was if key not in FOUND and (key not in DERIVED or key not in said)} | {
                "label"
            }
            objects[name] = {**now, **{key: was[key] for key in own if key in was}}
            objects[name]["from"] = {k: who for k, who in now["from"].items() if k == "mask" or k in said}
        elif name in told.repeated:
            objects[name] = {**was, **{key: now[key] for key in FOUND if key in now}}
            objects[name]["from"] = {**said, "mask": now["from"]["mask"]}
        else:
            objects[name] = was
    for name in set(objects) & set(new["objects"]):
        if name in ours.keys:
            known = labels.get(name)
            objects[name] = anew(objects[name], new["objects"][name], ours.keys[name], known)
        if name not in layered and "from" in objects[name]:
            objects[name] = relayered(objects[name], new["objects"][name])
    objects |= {name: now for name, now in new["objects"].items() if name not in old["objects"]}
    result = {**old, "objects": objects}
    per_meter = new["world"]["pixels_per_meter"]
    if ours.scale and per_meter != old.get("world", {}).get("pixels_per_meter", DEFAULT):
        result["world"] = {**old.get("world", {}), "pixels_per_meter": per_meter}
    return result


def doubts(text: str, names: Collection[str]) -> list[str]:
    """What stands in a scene's text as a comment to switch on and is not among its objects' `names` yet."""
    found = re.findall(r"^ *# ?(maybe-\d+: \{.*\})\s*$", text, re.MULTILINE)
    return [line for line in found if line.partition(":")[0] not in names]
