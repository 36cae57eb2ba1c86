"""Refresh of a scene: its photo is perceived again, and what the user set is kept.

A file does not record what its numbers were before they were edited. But the table's values for a label can be computed
again: a number is the table's where `from` says so and where the table gives it, for the label in the file, for the one
that the object's name was made from, or for the guess from its shape, at the scale that the scene states or that its
objects show. Any other number is the user's, and stays. Likewise, walls that perception lays under the objects as the
file has them are perception's own.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from physgen.geometry.polygon import Array
from physgen.geometry.simplify import distances_to_line
from physgen.materials import kind
from physgen.perceive.document import wall_entry
from physgen.perceive.maps.occlusion import drawing_layers, occlusion_orders
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Labels,
    Matter,
    Name,
    PhotoObject,
    Physics,
    Rgb,
)
from physgen.perceive.scale import DEFAULT_SCALE, MIN_SCALE_CONFIDENCE, photo_scale
from physgen.perceive.segment.prompts import Box, Point, Segmenter, from_prompts
from physgen.scene.scene import BoxPrompt, MaskId, Object

# share of the smaller mask, and of the old one, from which a new prompt means an existing object
OVERLAP = (0.5, 0.3)
EQUAL = 0.01  # relative difference of equal numbers: outlines are written to 0.01 px
# px between walls that are one: outlines of stored masks are a little rounder than those first found
NEAR = 0.5
LABELLED_KEYS = ("label", "solid", "mass", "friction", "elasticity")
"""Keys of an object that the user may have set: those that its `from` does not name stay."""
PIXEL_KEYS = ("mask", "shape", "prompt", "from")
"""Keys of an object that follow its pixels."""
TABLE_KEYS = ("mass", "friction", "elasticity", "rolling")
"""Keys that `from` names; `solid` goes with them."""
SCALED_SECTIONS = ("forces", "joints", "fields", "camera", "extends", "variants")
"""Sections with numbers in px and s, which the user chose for the scale that the scene had."""

Entry = Mapping[str, Any]
"""One object or boundary of the scene's data."""


@dataclass(frozen=True)
class RefreshStart:
    """The objects that perception starts from, and what became of those in the scene, by name."""

    found: Detections
    repeated: frozenset[str]
    """Objects with a prompt in the scene."""
    corrected: frozenset[str]
    """Objects that a new prompt means."""
    gone: tuple[str, ...]
    """Objects that a new prompt took in."""


def start_refresh(
    rgb: Rgb,
    objects: Sequence[Object],
    labels: Labels,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segmenter,
) -> RefreshStart:
    """Keeps objects without a prompt, segments those with one again; new boxes and points replace what they cover.

    `labels` (H, W): id k + 1 is the k-th of `objects`. Ids of masks stay. Raises InputError as `from_prompts`.
    """
    ids = _mask_ids(objects)
    prompted = [k for k, item in enumerate(objects) if item.prompt is not None]
    # boxes first, as from_prompts has them
    prompted.sort(key=lambda k: not isinstance(objects[k].prompt, BoxPrompt))
    prompts = [objects[k].prompt for k in prompted]
    old_boxes = [one.box for one in prompts if isinstance(one, BoxPrompt)]
    old_points = [one.point for one in prompts if one is not None and not isinstance(one, BoxPrompt)]
    new = from_prompts(rgb, boxes, points, segment)
    again = from_prompts(rgb, old_boxes, old_points, segment)

    result = np.zeros(labels.shape, np.uint16)
    owner: dict[int, int] = {}  # id -> index in objects
    sure: dict[int, float] = {}
    given: dict[int, Mapping[str, Any]] = {}
    for k in range(len(objects)):
        if k not in prompted:
            result[labels == k + 1] = ids[k]
            owner[ids[k]] = k
    for n, k in enumerate(prompted, 1):
        result[again.labels == n] = ids[k]
        owner[ids[k]] = k
        sure[ids[k]], given[ids[k]] = again.confidence[n], again.prompts[n]
    corrected: set[str] = set()
    gone: list[str] = []
    most = max(ids, default=0) + len(new.prompts)
    for n, prompt in new.prompts.items():
        mask = new.labels == n
        shared, every = (np.bincount(part.ravel(), minlength=most + 1) for part in (result[mask], result))
        size = int(mask.sum())
        meant = [i for i in owner if shared[i] > max(OVERLAP[0] * min(size, every[i]), OVERLAP[1] * every[i])]
        meant.sort(key=lambda i: -int(shared[i]))
        result[np.isin(result, meant)] = 0
        for i in meant[1:]:
            gone.append(objects[owner.pop(i)].name)
            sure.pop(i, None), given.pop(i, None)
        i = meant[0] if meant else max(ids, default=0) + n
        if meant:
            corrected.add(objects[owner[i]].name)
        result[mask] = i
        sure[i], given[i] = new.confidence[n], prompt
    found = Detections(
        result, "kept", sure,
        names={i: Name(objects[k].label, _label_confidence(objects[k])) for i, k in owner.items() if objects[k].label},
        prompts=given,
        object_names={i: objects[k].name for i, k in owner.items()},
        mask_sources={i: objects[k].provenance.get("mask", "") for i, k in owner.items() if i not in given},
    )  # fmt: skip
    return RefreshStart(
        found, frozenset(objects[k].name for k in prompted), frozenset(corrected), tuple(gone)
    )


def _mask_ids(objects: Sequence[Object]) -> list[int]:
    """An id for each: its own in `masks.png`, or the next that is free."""
    own = [item.mask.id if isinstance(item.mask, MaskId) else 0 for item in objects]
    free = iter(range(max(own, default=0) + 1, 65536))
    return [i if i and i not in own[:k] else next(free) for k, i in enumerate(own)]


def _label_confidence(item: Object) -> float:
    """The confidence that `from` gives its label, 1 where it gives none."""
    text = item.provenance.get("label", "").split(" ")[-1]
    return float(text) if re.fullmatch(r"[01]?\.?\d+", text) else 1.0


@dataclass(frozen=True)
class TableValues:
    """Values that no user has set."""

    keys: Mapping[str, frozenset[str]]
    """Keys of objects, by name: those of `TABLE_KEYS`, and `solid`."""
    scale: bool
    """Whether the scale is physgen's, and no number in the scene was made for it."""


def find_table_values(
    scene: Entry,
    rgb: Rgb,
    objects: Mapping[str, PhotoObject],
    guessed: Mapping[int, Name],
    physics: Physics,
    table: str,
) -> TableValues:
    """`scene` is the file's data, `objects` its objects by name; `table` is the backend `physics` as in `from`."""
    stated = float(scene.get("world", {}).get("pixels_per_meter", DEFAULT_SCALE))
    entries = {name: scene["objects"][name] for name in objects}
    found: list[Mapping[int, Matter]] = []
    own_scale = stated == DEFAULT_SCALE
    guesses = {  # confidence of labels that no user gave
        objects[name].id: guessed[objects[name].id].confidence
        for name, was in entries.items() if "label" in was.get("from", {})
    }  # fmt: skip
    for labels in _possible_labels(entries, objects, guessed):
        called = [replace(item, label=labels[name]) for name, item in objects.items()]
        values = {None if stated == DEFAULT_SCALE else stated, None}
        for sure in (None, guesses):
            scale = photo_scale(called, {item.id: kind(item.label) for item in called}, sure)
            if scale is not None:
                values.add(scale.pixels_per_meter)
                own_scale |= scale.confidence >= MIN_SCALE_CONFIDENCE and _equal(
                    scale.pixels_per_meter, stated
                )
        found += [physics(rgb, called, value) for value in values]
    keys = {}
    for name, was in entries.items():
        sources, values_of = was.get("from", {}), [matter[objects[name].id] for matter in found]
        by_table = {
            key for key in TABLE_KEYS if str(sources.get(key, "")).split(" ")[0] == table and key in was
        }
        own = {key for key in by_table if any(_equal(was[key], getattr(matter, key)) for matter in values_of)}
        if own and any(was.get("solid") == matter.solid.value for matter in values_of):
            own.add("solid")
        keys[name] = frozenset(own)
    return TableValues(keys, own_scale and not _depends_on_scale(scene))


def _possible_labels(
    entries: Mapping[str, Entry], objects: Mapping[str, PhotoObject], guessed: Mapping[int, Name]
) -> Iterator[dict[str, str]]:
    """Labels, by name, that the objects may have had when their numbers were computed."""
    written = {name: str(was.get("label", "")) for name, was in entries.items()}
    named = {name: re.sub(r"-\d+$", "", name).replace("-", " ") for name in entries}
    guesses = {name: guessed[objects[name].id].label for name in entries}
    seen: list[dict[str, str]] = []
    for labels in (written, named, guesses):
        if labels not in seen:
            seen.append(labels)
            yield labels


def _depends_on_scale(scene: Entry) -> bool:
    """Whether the user wrote a number that depends on the scale."""
    moving = any(
        key in was for was in scene["objects"].values() for key in ("velocity", "spin", "roll", "density")
    )
    return any(scene.get(key) for key in SCALED_SECTIONS) or "gravity" in scene.get("world", {}) or moving


def layers_set_by_user(scene: Entry, labels: Labels, ids: Mapping[str, int]) -> dict[str, int]:
    """Layers that the user set, by name; `labels` (H, W) shows the scene's objects by `ids`.

    A layer is perception's where `from` says so and `labels` gives it. An object without `from` is all the user's.
    """
    written = {name: was for name, was in scene["objects"].items() if name in ids}
    own = {}
    for name, was in written.items():
        # perception's where from names it, or where none is written though from names other keys
        if not ("from" in was and ("layer" in was["from"] or "layer" not in was)):
            own[name] = int(was.get("layer", 0))
    found = occlusion_orders(labels, list(ids.values()))
    # as they were at first, or when the scene was last refreshed
    possible = [
        drawing_layers(found)[0],
        drawing_layers(found, {ids[name]: layer for name, layer in own.items()})[0],
    ]
    moved = {
        name: int(was.get("layer", 0)) for name, was in written.items()
        if name not in own and "layer" in was and all(was["layer"] != of.get(ids[name], 0) for of in possible)
    }  # fmt: skip
    return own | moved


def with_new_layer(was: Entry, now: Entry) -> dict[str, Any]:
    """An object as it `was`, in the layer that it has `now`."""
    if was.get("layer", 0) == now.get("layer", 0):
        return dict(was)
    sources = {key: source for key, source in was["from"].items() if key != "layer"}
    before = {key: value for key, value in was.items() if key not in ("layer", "from", "prompt")}
    if "layer" in now:
        before["layer"], sources["layer"] = now["layer"], now["from"]["layer"]
    return {**before, "from": sources} | {key: was[key] for key in ("prompt",) if key in was}


def with_new_values(was: Entry, now: Entry, keys: frozenset[str], label: str | None) -> dict[str, Any]:
    """An object as it `was`, with its `keys` as they are `now`; `label` is the user's new one."""
    sources = dict(was.get("from", {}))
    result = dict(was)
    if label is not None:
        result["label"] = label
        sources.pop("label", None)
    for key in keys & set(now):
        if not _equal(was[key], now[key]):
            result[key] = now[key]
            if key in now["from"]:
                sources[key] = now["from"][key]
    return {**result, "from": sources} if "from" in was else result


def _equal(was: Any, now: Any) -> bool:
    if isinstance(was, int | float) and isinstance(now, int | float):
        return abs(was - now) <= EQUAL * max(abs(was), abs(now))
    return bool(was == now)


def merge_documents(
    old: Entry,
    new: Entry,
    start: RefreshStart,
    ours: TableValues,
    labels: Mapping[str, str],
    layered: Collection[str] = (),
) -> dict[str, Any]:
    """The `old` scene as it was written, with objects as they were found again, and new ones, of the `new` scene.

    A repeated prompt gives a mask and a shape. A corrected one gives new numbers, too, where `from` has a source of the
    old ones. An object of nothing but a mask is filled in. Values of the table (`ours`) follow the labels, those in the
    file and the new `labels`, by name. Layers are perception's but for the objects `layered` by the user.
    """
    objects: dict[str, Any] = {}
    for name, was in old["objects"].items():
        if name not in start.gone:
            objects[name] = _merge_object(name, was, new["objects"].get(name), start)
    for name in set(objects) & set(new["objects"]):
        now = new["objects"][name]
        if name in ours.keys:
            objects[name] = with_new_values(objects[name], now, ours.keys[name], labels.get(name))
        if name not in layered and "from" in objects[name]:
            objects[name] = with_new_layer(objects[name], now)
    objects |= {name: now for name, now in new["objects"].items() if name not in old["objects"]}
    result = {**old, "objects": objects}
    per_meter = new["world"]["pixels_per_meter"]
    if ours.scale and per_meter != old.get("world", {}).get("pixels_per_meter", DEFAULT_SCALE):
        result["world"] = {**old.get("world", {}), "pixels_per_meter": per_meter}
    return result


def _merge_object(name: str, was: Entry, now: Entry | None, start: RefreshStart) -> Entry:
    sources = was.get("from", {})
    if now is None:
        return was
    if set(was) <= {"mask", "from"}:
        return {**now, **was, "from": {**now["from"], **sources}}
    if name in start.corrected:
        own = {
            key for key in was if key not in PIXEL_KEYS and (key not in LABELLED_KEYS or key not in sources)
        }
        kept = {key: was[key] for key in own | {"label"} if key in was}
        return {
            **now,
            **kept,
            "from": {k: source for k, source in now["from"].items() if k == "mask" or k in sources},
        }
    if name in start.repeated:
        pixels = {key: now[key] for key in PIXEL_KEYS if key in now}
        return {**was, **pixels, "from": {**sources, "mask": now["from"]["mask"]}}
    return was


def doubtful_lines(text: str, names: Collection[str]) -> list[str]:
    """Doubtful objects in a scene's comments, to be uncovered, that are not among its objects' `names` yet."""
    found = re.findall(r"^ *# ?(maybe-\d+: \{.*\})\s*$", text, re.MULTILINE)
    return [line for line in found if line.partition(":")[0] not in names]


def walls_of_guess(boundaries: Mapping[str, Any], guess: BoundaryGuess) -> set[str]:
    """Names of a scene's `boundaries` that the guess has too."""
    own = {wall.name: wall_entry(wall) for wall in guess.walls}
    return {name for name, was in boundaries.items() if name in own and _same_wall(was, own[name])}


def replace_walls(boundaries: Mapping[str, Any], ours: set[str], new: Mapping[str, Any]) -> dict[str, Any]:
    """The boundaries without `ours` and with the `new` ones, under names that are free."""
    kept = {name: was for name, was in boundaries.items() if name not in ours}
    fresh: dict[str, Any] = {}
    for name, now in new.items():
        if not any(_same_wall(was, now) for was in kept.values()):
            fresh[free_name(name, {*kept, *fresh})] = now
    return {**fresh, **kept}


def matching_guess(boundaries: Mapping[str, Any], guesses: Sequence[BoundaryGuess]) -> BoundaryGuess | None:
    """The guess that most of the boundaries come from; None where none does."""
    counts = [len(walls_of_guess(boundaries, guess)) for guess in guesses]
    return guesses[int(np.argmax(counts))] if any(counts) else None


def _same_wall(was: Entry, now: Entry) -> bool:
    alike = all(abs(was.get(key, -1) - now.get(key, -1)) < 1e-6 for key in ("friction", "elasticity"))
    return alike and wall_distance(was, now) <= NEAR


def wall_distance(was: Entry, now: Entry) -> float:
    """px from one wall to the farthest point of another, both ways; infinity where one of them is no line."""
    return max(distance_to_wall(was, now), distance_to_wall(now, was))


def distance_to_wall(was: Entry, now: Entry) -> float:
    """px from one wall to the farthest point of another that may be a part of it; infinity where one is no line."""
    one, other = _points(was), _points(now)
    return float("inf") if one is None or other is None else float(distances_to_line(other, one, False).max())


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or the first of `name-2`, `name-3`, ... that is not taken."""
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free


def _points(wall: Entry) -> Array | None:
    points = wall.get("segment") or wall.get("polyline")
    return None if points is None else np.asarray(points, np.float64)
