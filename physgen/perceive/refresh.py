"""Refresh of a scene: its photo is perceived again, and what the user set is kept."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from physgen.geometry.polygon import Array
from physgen.geometry.simplify import distances_to_line
from physgen.materials import kind
from physgen.perceive import document
from physgen.perceive.maps.occlusion import drawing_layers, occlusion_orders
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Labels,
    Matter,
    Name,
    PhotoObject,
    Physics,
    Prompted,
    Rgb,
    Segment,
)
from physgen.perceive.scale import DEFAULT_SCALE, MIN_SCALE_CONFIDENCE, photo_scale
from physgen.perceive.segment.prompts import Box, Point, from_prompts
from physgen.scene.scene import BoxPrompt, MaskId, Object

# ----------------------------------------------------------------------
# A scene and its photo -> which of its numbers the table gave, and which a person set.
#
# Nothing in a file says what its numbers were before they were edited. But what the table gives for a label
# can be
# reckoned again. A number is the table's where `from` says so and where it is what the table gives, at the
# scale that
# the scene states or that its things tell, for the label in the file, for the one that the object's name was
# made from,
# or for what its shape was guessed to be. Any other number is a person's, and stays, whatever `from` says.

KEYS = ("mass", "friction", "elasticity", "rolling")
"""Keys that `from` names; `solid` goes with them."""
SAME = 0.01
"""Share by which two numbers may differ and be the same: outlines are written to 0.01 px."""
TUNED = ("forces", "joints", "fields", "camera", "extends", "variants")
"""Sections with numbers in px and s, which a person chose for the scale that the scene had."""


@dataclass(frozen=True)
class TableValues:
    """What nobody has set."""

    keys: Mapping[str, frozenset[str]]
    """Keys of objects, by name: those of `KEYS`, and `solid`."""
    scale: bool
    """Whether the scale is what physgen wrote, and nothing in the scene was made for it."""


def find_table_values(
    scene: Mapping[str, Any],
    rgb: Rgb,
    things: Mapping[str, PhotoObject],
    guessed: Mapping[int, Name],
    physics: Physics,
    table: str,
) -> TableValues:
    """`scene` is the file's data, `things` its objects by name; `table` is how `from` calls the backend `physics`."""
    stated = float(scene.get("world", {}).get("pixels_per_meter", DEFAULT_SCALE))
    objects = {name: scene["objects"][name] for name in things}
    found: list[Mapping[int, Matter]] = []
    ours = stated == DEFAULT_SCALE
    for labels in _labels(objects, things, guessed):
        called = [replace(thing, label=labels[name]) for name, thing in things.items()]
        values = {None if stated == DEFAULT_SCALE else stated, None}
        for sure in (None, _guesses(objects, things, guessed)):
            told = photo_scale(called, {thing.id: kind(thing.label) for thing in called}, sure)
            if told is not None:
                values.add(told.pixels_per_meter)
                ours |= told.confidence >= MIN_SCALE_CONFIDENCE and _same(told.pixels_per_meter, stated)
        found += [physics(rgb, called, value) for value in values]
    keys = {}
    for name, was in objects.items():
        said, gave = was.get("from", {}), [matter[things[name].id] for matter in found]
        by_table = {key for key in KEYS if str(said.get(key, "")).split(" ")[0] == table and key in was}
        own = {key for key in by_table if any(_same(was[key], getattr(matter, key)) for matter in gave)}
        if own and any(was.get("solid") == matter.solid.value for matter in gave):
            own.add("solid")
        keys[name] = frozenset(own)
    return TableValues(keys, ours and not _tuned(scene))


def layers_set_by_user(scene: Mapping[str, Any], labels: Labels, ids: Mapping[str, int]) -> dict[str, int]:
    """Layers that a person set, by name; `labels` (H, W) shows the scene's objects by `ids`.

    One is ours where `from` says so and where it is what `labels` tell; where an object has no `from`, all of it is a
    person's.
    """
    written = {name: was for name, was in scene["objects"].items() if name in ids}
    sure = {name: int(was.get("layer", 0)) for name, was in written.items() if not _layered(was)}
    found = occlusion_orders(labels, list(ids.values()))
    # as they were told at first, or when the scene was last refreshed
    told = [
        drawing_layers(found)[0],
        drawing_layers(found, {ids[name]: layer for name, layer in sure.items()})[0],
    ]
    moved = {
        name: int(was.get("layer", 0)) for name, was in written.items()
        if name not in sure and "layer" in was and all(was["layer"] != of.get(ids[name], 0) for of in told)
    }  # fmt: skip
    return sure | moved


def with_new_layer(was: Mapping[str, Any], now: Mapping[str, Any]) -> dict[str, Any]:
    """An object as it `was`, in the layer that it has `now`."""
    if was.get("layer", 0) == now.get("layer", 0):
        return dict(was)
    said = {key: who for key, who in was["from"].items() if key != "layer"}
    before = {key: value for key, value in was.items() if key not in ("layer", "from", "prompt")}
    if "layer" in now:
        before["layer"], said["layer"] = now["layer"], now["from"]["layer"]
    return {**before, "from": said} | {key: was[key] for key in ("prompt",) if key in was}


def _layered(was: Mapping[str, Any]) -> bool:
    """Whether its layer may be ours: `from` names it, or none is written where `from` names other keys."""
    return "from" in was and ("layer" in was["from"] or "layer" not in was)


def with_new_values(
    was: Mapping[str, Any], now: Mapping[str, Any], keys: frozenset[str], label: str | None
) -> dict[str, Any]:
    """An object as it `was`, with its `keys` as they are `now`; `label` is what a person calls it from now on."""
    said = dict(was.get("from", {}))
    result = dict(was)
    if label is not None:
        result["label"] = label
        said.pop("label", None)
    for key in keys & set(now):
        if not _same(was[key], now[key]):
            result[key] = now[key]
            if key in now["from"]:
                said[key] = now["from"][key]
    return {**result, "from": said} if "from" in was else result


def _labels(
    objects: Mapping[str, Mapping[str, Any]], things: Mapping[str, PhotoObject], guessed: Mapping[int, Name]
) -> Iterator[dict[str, str]]:
    """What objects may have been called when their numbers were reckoned, by name."""
    written = {name: str(was.get("label", "")) for name, was in objects.items()}
    named = {name: re.sub(r"-\d+$", "", name).replace("-", " ") for name in objects}
    guesses = {name: guessed[things[name].id].label for name in objects}
    seen: list[dict[str, str]] = []
    for labels in (written, named, guesses):
        if labels not in seen:
            seen.append(labels)
            yield labels


def _guesses(
    objects: Mapping[str, Mapping[str, Any]], things: Mapping[str, PhotoObject], guessed: Mapping[int, Name]
) -> dict[int, float]:
    """How sure labels are of objects whose `from` says that nobody said them."""
    return {
        things[name].id: guessed[things[name].id].confidence
        for name, was in objects.items() if "label" in was.get("from", {})
    }  # fmt: skip


def _same(was: Any, now: Any) -> bool:
    if isinstance(was, int | float) and isinstance(now, int | float):
        return abs(was - now) <= SAME * max(abs(was), abs(now))
    return bool(was == now)


def _tuned(scene: Mapping[str, Any]) -> bool:
    """Whether a person wrote something that depends on the scale."""
    moving: Sequence[Mapping[str, Any]] = list(scene["objects"].values())
    still = not any(key in was for was in moving for key in ("velocity", "spin", "roll", "density"))
    return any(scene.get(key) for key in TUNED) or "gravity" in scene.get("world", {}) or not still


# ----------------------------------------------------------------------
# A scene's objects -> what perceiving its photo again starts from, and the old scene with what was found
# anew.
#
# Objects without a prompt stay as they are written. Those with one are looked for again, and new prompts take
# the place
# of what they cover.

AGAIN_SAME = 0.5, 0.3
"""A new prompt means an object that is there when they share this much of the smaller mask, and of the old one."""
DERIVED = ("label", "solid", "mass", "friction", "elasticity")
"""Keys of an object that a person may have set: those that its `from` does not name stay."""
FOUND = ("mask", "shape", "prompt", "from")
"""Keys of an object that follow its pixels."""


@dataclass(frozen=True)
class RefreshStart:
    """What perception starts from."""

    found: Detections
    repeated: frozenset[str]
    """Names of objects whose prompt the scene holds."""
    corrected: frozenset[str]
    """Names of those that a new prompt means."""
    gone: tuple[str, ...]
    """Names of objects that a new prompt took in."""


def start_refresh(
    rgb: Rgb,
    objects: Sequence[Object],
    labels: Labels,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segment,
) -> RefreshStart:
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
    once = segment if isinstance(segment, Prompted) else lambda rgb: segmented()
    new = from_prompts(rgb, boxes, points, once)
    repeated = from_prompts(rgb, old_boxes, old_points, once)

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
            i
            for i in owner
            if there[i] > max(AGAIN_SAME[0] * min(size, int(every[i])), AGAIN_SAME[1] * int(every[i]))
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
    found = Detections(result, "kept", sure, names, pointed, called=called, said=said)
    return RefreshStart(found, frozenset(objects[k].name for k in asked), frozenset(corrected), tuple(gone))


def _ids(objects: Sequence[Object]) -> list[int]:
    """An id for each: its own in `masks.png`, or the next that is free."""
    own = [item.mask.id if isinstance(item.mask, MaskId) else 0 for item in objects]
    free = iter(range(max(own, default=0) + 1, 65536))
    return [i if i and i not in own[:k] else next(free) for k, i in enumerate(own)]


def _sure(item: Object) -> float:
    """How sure its label is: what `from` says, or as sure as a person is."""
    said = item.provenance.get("label", "").split(" ")[-1]
    return float(said) if re.fullmatch(r"[01]?\.?\d+", said) else 1.0


def merge_documents(
    old: Mapping[str, Any],
    new: Mapping[str, Any],
    told: RefreshStart,
    ours: TableValues,
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
            objects[name] = with_new_values(objects[name], new["objects"][name], ours.keys[name], known)
        if name not in layered and "from" in objects[name]:
            objects[name] = with_new_layer(objects[name], new["objects"][name])
    objects |= {name: now for name, now in new["objects"].items() if name not in old["objects"]}
    result = {**old, "objects": objects}
    per_meter = new["world"]["pixels_per_meter"]
    if ours.scale and per_meter != old.get("world", {}).get("pixels_per_meter", DEFAULT_SCALE):
        result["world"] = {**old.get("world", {}), "pixels_per_meter": per_meter}
    return result


def doubtful_lines(text: str, names: Collection[str]) -> list[str]:
    """What stands in a scene's text as a comment to switch on and is not among its objects' `names` yet."""
    found = re.findall(r"^ *# ?(maybe-\d+: \{.*\})\s*$", text, re.MULTILINE)
    return [line for line in found if line.partition(":")[0] not in names]


# ----------------------------------------------------------------------
# A scene's boundaries, some of which perception laid -> those it lays now in their place, and those that a
# person set.
#
# Nothing in a file says whether a wall was moved by hand. But what perception lays under the objects as the
# file has
# them can be laid again, for either view: a wall of the file that is one of those is perception's own.

NEAR = 0.5
"""px between two walls that are one: outlines of stored masks are a little rounder than those first found."""


def walls_of_guess(boundaries: Mapping[str, Any], setting: BoundaryGuess) -> set[str]:
    """Names of a scene's `boundaries` that a setting has too."""
    own = {wall.name: document.wall_entry(wall) for wall in setting.walls}
    return {name for name, was in boundaries.items() if name in own and _relaid_same(was, own[name])}


def replace_walls(boundaries: Mapping[str, Any], ours: set[str], new: Mapping[str, Any]) -> dict[str, Any]:
    """The boundaries with `ours` taken out and the `new` ones in, under names that are free."""
    kept = {name: was for name, was in boundaries.items() if name not in ours}
    fresh: dict[str, Any] = {}
    for name, now in new.items():
        if not any(_relaid_same(was, now) for was in kept.values()):
            fresh[free_name(name, {*kept, *fresh})] = now
    return {**fresh, **kept}


def matching_guess(boundaries: Mapping[str, Any], settings: Sequence[BoundaryGuess]) -> BoundaryGuess | None:
    """The setting that most of the boundaries come from; None where none does."""
    counts = [len(walls_of_guess(boundaries, setting)) for setting in settings]
    return settings[int(np.argmax(counts))] if any(counts) else None


def _relaid_same(was: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    alike = all(abs(was.get(key, -1) - now.get(key, -1)) < 1e-6 for key in ("friction", "elasticity"))
    return alike and wall_distance(was, now) <= NEAR


def wall_distance(was: Mapping[str, Any], now: Mapping[str, Any]) -> float:
    """px from one wall to the farthest point of another; infinity where one of them is no line."""
    return max(distance_to_wall(was, now), distance_to_wall(now, was))


def distance_to_wall(was: Mapping[str, Any], now: Mapping[str, Any]) -> float:
    """px from one wall to the farthest point of another that may be a part of it; infinity where one is no line."""
    one, other = _points(was), _points(now)
    return float("inf") if one is None or other is None else float(distances_to_line(other, one, False).max())


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or the first of `name-2`, `name-3`, ... that is not taken."""
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free


def _points(wall: Mapping[str, Any]) -> Array | None:
    points = wall.get("segment") or wall.get("polyline")
    return None if points is None else np.asarray(points, np.float64)
