"""Refresh of a scene: its photo is perceived again, and what the user set is kept.

The rule: a value that `from` names, and that is still as perception wrote it, is
written anew; any other is the user's and stays. Labels and names stay. Masks stay, but
for objects with a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np

from physgen.geometry.scale import PAPER_SCALE
from physgen.perceive import document
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Labels,
    Name,
    PerceivedScene,
    Rgb,
    Suitability,
)
from physgen.perceive.segment.prompts import (
    Box,
    Point,
    PromptFrame,
    Segmenter,
    from_prompts,
)
from physgen.scene.files import Record, equal, recorded
from physgen.scene.provenance import (
    label_confidence,
    perceived_keys,
    provenance,
    scale_is_given,
    scaled_values,
    source,
    stated_scale,
)
from physgen.scene.scene import BoxPrompt, MaskId, Object, PointPrompt, Scene

OVERLAP = (0.5, 0.3)
"""Share of the smaller mask, and of the old one, from which a new prompt means an
existing object.
"""
PIXEL_KEYS = ("mask", "shape", "prompt")
"""Keys of an object that follow its pixels."""
LINES, SAME = {"segment", "polyline"}, 3.0
"""Keys of a boundary's points; px up to which those that are found again differ."""
Entry = Mapping[str, Any]
"""One object or boundary of the scene's data."""


@dataclass(frozen=True)
class RefreshStart:
    """The objects that perception starts from, and what became of those in the scene,
    by name.
    """

    found: Detections
    # objects whose pixels a prompt of the scene, or a new one, gives
    prompted: frozenset[str]
    gone: tuple[str, ...]  # objects that a new prompt took in


@dataclass(frozen=True)
class PromptFrames:
    """The photos in whose pixels prompts are written."""

    new: PromptFrame  # of new boxes and points
    old: PromptFrame  # of those in the scene


def full_size(scene: Scene) -> tuple[int, int] | None:
    """Return width and height, px, of the photo that was made smaller for a scene.

    None if the scene shows the photo as it was given, or another one.
    """
    photo = recorded(scene.assets, "photo")
    if scene.image is None or scene.image.name != photo.get("image"):
        return None
    match photo.get("size"):
        case [int(width), int(height)] if width > 0 and height > 0:
            scaled_height = height * scene.size[0] / width
            is_same_photo = abs(scaled_height - scene.size[1]) <= 1
            return (width, height) if is_same_photo else None
    return None


def prompted(objects: Sequence[Object]) -> list[Object]:
    """Return the objects with a prompt: those with a box, then those with a point."""
    boxes = [item for item in objects if isinstance(item.prompt, BoxPrompt)]
    points = [item for item in objects if isinstance(item.prompt, PointPrompt)]
    return boxes + points


def prompts_of(objects: Sequence[Object]) -> tuple[list[Box], list[Point]]:
    """Return the boxes and points of objects, in the order of `prompted`."""
    boxes: list[Box] = []
    points: list[Point] = []
    for item in objects:
        if isinstance(item.prompt, BoxPrompt):
            boxes.append(item.prompt.box)
        elif isinstance(item.prompt, PointPrompt):
            points.append(item.prompt.point)
    return boxes, points


def start_refresh(
    rgb: Rgb,
    objects: Sequence[Object],
    old: Entry,
    labels: Labels,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segmenter,
    frames: PromptFrames | None = None,
) -> RefreshStart:
    """Keeps objects without a prompt, segments those with one again; new boxes and
    points replace what they cover.

    `old` is the scene's data with its sources. `labels` (H, W): id k + 1 is the k-th of
    `objects`. Ids of masks stay. Raises InputError as `from_prompts`.
    """
    ids = _mask_ids(objects)
    by_box = [k for k, item in enumerate(objects) if isinstance(item.prompt, BoxPrompt)]
    by_point = [
        k
        for k, item in enumerate(objects)
        if item.prompt is not None and k not in by_box
    ]
    frames = frames or PromptFrames(PromptFrame.of(rgb), PromptFrame.of(rgb))
    new = from_prompts(rgb, boxes, points, segment, frames.new)
    whole = replace(segment, is_smallest_meant=False)
    again = from_prompts(rgb, *prompts_of(objects), whole, frames.old)

    result = np.zeros(labels.shape, np.uint16)
    owner = {i: k for k, i in enumerate(ids)}  # id -> index in objects
    confidence: dict[int, float] = {}
    prompts: dict[int, Mapping[str, Any]] = {}
    for k, i in enumerate(ids):
        if objects[k].prompt is None:
            result[labels == k + 1] = i
    for n, k in enumerate([*by_box, *by_point], 1):
        result[again.labels == n] = ids[k]
        confidence[ids[k]], prompts[ids[k]] = again.confidence[n], again.prompts[n]
    gone: list[str] = []
    replaced = set()  # their labels are guessed again
    most = max(ids, default=0) + len(new.prompts)
    for n, prompt in new.prompts.items():
        mask = new.labels == n
        shared, every = (
            np.bincount(part.ravel(), minlength=most + 1)
            for part in (result[mask], result)
        )
        size = int(mask.sum())
        meant = [
            i
            for i in owner
            if shared[i] > max(OVERLAP[0] * min(size, every[i]), OVERLAP[1] * every[i])
        ]
        meant.sort(key=lambda i: -int(shared[i]))
        result[np.isin(result, meant)] = 0
        for i in meant[1:]:
            gone.append(objects[owner.pop(i)].name)
            confidence.pop(i, None)
            prompts.pop(i, None)
        i = meant[0] if meant else max(ids, default=0) + n
        result[mask] = i
        confidence[i], prompts[i] = new.confidence[n], prompt
        replaced.add(i)
    named = {i: objects[k] for i, k in owner.items()}
    sources = {
        i: old["objects"].get(item.name, {}).get("from", {})
        for i, item in named.items()
    }
    masks = {i: one.get("mask", "") for i, one in sources.items() if i not in prompts}
    confidence |= {
        i: sure for i, text in masks.items() if (sure := source(text).sure) is not None
    }
    found = Detections(
        result,
        "kept",
        confidence,
        names={
            i: Name(item.label, label_confidence(item.provenance))
            for i, item in named.items()
            if item.label and not (i in replaced and "label" in sources[i])
        },
        prompts=prompts,
        object_names={i: item.name for i, item in named.items()},
        mask_sources=masks,
    )
    return RefreshStart(
        found, frozenset(named[i].name for i in prompts if i in named), tuple(gone)
    )


def _mask_ids(objects: Sequence[Object]) -> list[int]:
    """Return an id for each: its own in `masks.png`, or the next that is free."""
    own = [item.mask.id if isinstance(item.mask, MaskId) else 0 for item in objects]
    free = iter(range(max(own, default=0) + 1, 65536))
    return [i if i and i not in own[:k] else next(free) for k, i in enumerate(own)]


def with_sources(data: Entry, scene: Scene) -> dict[str, Any]:
    """Return a scene's data, in which `from` of each object names what is still as
    perception wrote it.
    """
    sources = {item.name: dict(item.provenance) for item in scene.objects}
    for name, own in data["objects"].items():
        if own.keys() <= document.BARE and "confidence" in own:
            sources[name].setdefault("mask", provenance("doubtful", own["confidence"]))
    objects = {
        name: {**own, "from": sources[name]} if "from" in own or sources[name] else own
        for name, own in data["objects"].items()
    }
    return {**data, "objects": objects}


def known_view(scene: Scene) -> BoundaryGuess:
    """Return the scene's view, with the confidence and reason that perception wrote, or
    as the user gave it.
    """
    record, view = scene.record.world, scene.world.view
    wrote = record.get("view_from") if record.get("view") == view.value else None
    why = source(str(wrote or "as given 1"))
    return BoundaryGuess(view, 1.0 if why.sure is None else why.sure, why.text, ())


def as_before(
    perceived: PerceivedScene, scene: Scene, is_resized: bool = False
) -> PerceivedScene:
    """What is perceived, with the boundaries and the doubts that the scene has.

    Boundaries of a photo that `is_resized` move to those found near them, on which the
    objects stand in its pixels.
    """
    walls, doubts = (
        scene.record.world["boundaries"],
        recorded(scene.assets, "suitability"),
    )
    if is_resized:
        anew = perceived.document["boundaries"].values()
        walls = {name: _nearest_wall(wall, anew) for name, wall in walls.items()}
    suits = (
        Suitability(tuple(map(str, doubts.get("reasons", ()))))
        if doubts
        else perceived.suitability
    )
    return replace(
        perceived,
        document={**perceived.document, "boundaries": walls},
        suitability=suits,
    )


def _nearest_wall(wall: Entry, others: Iterable[Entry]) -> Entry:
    """Return the boundary with the points of another one within `SAME` px, if any."""
    for other in others:
        for kind in LINES & wall.keys() & other.keys():
            if equal(wall[kind], other[kind], SAME):
                return {**wall, kind: other[kind]}
    return wall


def true_comments(
    comments: Entry, merged: Entry, seen: Entry, world: Entry
) -> dict[str, str]:
    """Return the comments on values of the `merged` scene that are as they are `seen`
    now, and on whole sections; on its view where the record of its `world` says why.
    """
    value, known = document.value_at, "view_from" in world
    own = {k: why for k, why in comments.items() if known or k != "world.view"}
    return {
        k: why
        for k, why in own.items()
        if "." not in k or equal(value(merged, k), value(seen, k))
    }


def user_layers(scene: Entry) -> dict[str, int]:
    """Layers that the user set, by name: those without a `from`.

    An object without `from` is all the user's.
    """
    return {
        name: int(was.get("layer", 0))
        for name, was in scene["objects"].items()
        if "from" not in was or ("layer" in was and "layer" not in was["from"])
    }


def merge_documents(
    old: Entry,
    new: Entry,
    start: RefreshStart,
    renamed: Mapping[str, str],
    scaled: bool,
    record: Record,
) -> dict[str, Any]:
    """Return the `old` scene as it was written, with what perception found again of the
    `new` scene, and new objects.

    `renamed` are new labels by name; `scaled`: whether the scale is perception's;
    `record` is that of `old`.
    """
    objects: dict[str, Any] = {}
    for name, was in old["objects"].items():
        if name not in start.gone:
            now = new["objects"].get(name)
            objects[name] = (
                was if now is None else merge_object(was, now, name in start.prompted)
            )
            held = was.get("motion")
            held = held and held == record.entry(name, was).get("motion")
            if now is not None and name in start.prompted and held:
                # the new pixels' own
                moves = {key: now[key] for key in ("motion", "velocity") if key in now}
                objects[name] = {
                    key: v for key, v in objects[name].items() if key != "motion"
                } | moves
        if name in renamed and name in objects:
            sources = {
                key: one
                for key, one in objects[name].get("from", {}).items()
                if key != "label"
            }
            objects[name] |= {"label": renamed[name]} | (
                {"from": sources} if "from" in was else {}
            )
    objects |= {
        name: now for name, now in new["objects"].items() if name not in old["objects"]
    }
    world, seen = dict(old.get("world", {})), new["world"]
    if scaled and seen["pixels_per_meter"] != world.get(
        "pixels_per_meter", PAPER_SCALE
    ):
        world["pixels_per_meter"] = seen["pixels_per_meter"]
    if "table" not in seen and world.get("table") in (document.TABLE, {"friction": 0}):
        del world["table"]  # seen from the side now
    is_turned = seen["view"] != record.world.get("view")
    for key in ("table", "tilt"):
        if is_turned and key in seen and key not in world:
            world[key] = seen[key]
    walls = merge_boundaries(old.get("boundaries", {}), new["boundaries"], record)
    result = {**old, "objects": objects} | ({"world": world} if world else {})
    return result | ({"boundaries": walls} if walls or "boundaries" in old else {})


def merge_boundaries(was: Entry, now: Entry, record: Record) -> dict[str, Any]:
    """Those that are `now`, with those of the user as they were; what the user changed
    or took out is not new.
    """
    guessed = {name: wall for name, wall in was.items() if "from" in wall}
    wrote = record.world.get("boundaries", guessed)
    walls = {
        name: wall for name, wall in was.items() if not equal(wall, wrote.get(name))
    }
    known = [wall for name, wall in wrote.items() if name in walls or name not in was]
    fresh = {
        free_name(name, walls): wall
        for name, wall in now.items()
        if not any(
            equal(one.get(kind), wall[kind], SAME)
            for one in known
            for kind in LINES & wall.keys()
        )
    }
    return fresh | walls


def taken_out(objects: Sequence[Object], before: Labels, labels: Labels) -> Labels:
    """(H, W) ids of the map `before` that the scene no longer has, where no object is
    now; 0 elsewhere.
    """
    return np.where(
        np.isin(before, _mask_ids(objects)) | (labels > 0), np.uint16(0), before
    )


def same_objects(scene: Scene, before: Labels, labels: Labels) -> bool:
    """Return whether objects, their pixels and the view are as when boundaries were
    perceived: these are so, too, then.
    """
    world, assets = scene.record.world, scene.assets
    if (
        assets is None
        or scene.world.view.value != world.get("view")
        or "boundaries" not in world
    ):
        return False
    painted = crc32((assets / "masks.png").read_bytes()) != recorded(
        assets, "files"
    ).get("masks.png")
    ids = {str(item.mask.id) for item in scene.objects if isinstance(item.mask, MaskId)}
    return (
        not painted
        and ids == scene.record.objects.keys()
        and np.array_equal(before, labels)
    )


def merge_object(was: Entry, now: Entry, prompted: bool = False) -> dict[str, Any]:
    """Return an object as it `was`, with what its `from` names as it is `now`; pixels
    follow where it is `prompted`.

    An object of nothing but a mask is filled in.
    """
    if set(was) <= document.BARE:
        return {
            **now,
            "mask": was["mask"],
            "from": {**now["from"], **was.get("from", {})},
        }
    keys = perceived_keys(was) | (set(PIXEL_KEYS) if prompted else set())
    keys |= {"label"} & was.get("from", {}).keys() & now["from"].keys()  # guessed again
    keys -= {
        key
        for key in keys
        if isinstance(was.get(key), str) and isinstance(now.get(key), int | float)
    }
    if "from" in was:
        keys |= {"shape", "solid", "layer"} - was.keys()  # which lie in the assets
    return rewritten(was, now, keys)


def rewritten(was: Entry, now: Entry, keys: Collection[str]) -> dict[str, Any]:
    """Return an object as it `was`, with its `keys` and their sources as they are
    `now`.
    """
    result, sources = dict(was), dict(was.get("from", {}))
    for key in keys:
        for values, new in ((result, now), (sources, now["from"])):
            if key in new:
                values[key] = new[key]
            else:
                values.pop(key, None)
    return result | ({"from": sources} if sources else {})


def rescaled(
    old: Entry, new: dict[str, Any], record: Record, side: int
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Return the `new` data with speeds and playback for its scale, and what perception
    wrote where the user of `old` differs.

    The second as `PerceivedScene.wrote`.
    """
    result = new
    for path, value in scaled_values(old, record, stated_scale(new), side).items():
        part = result = {**result}
        for key in path[:-1]:
            part[key] = part = {**part.get(key, {})}
        part[path[-1]] = value
    wrote: dict[str, dict[str, Any]] = {
        "": {"given": True} if scale_is_given(old, record, side) else {}
    }
    for name, was in old["objects"].items():
        velocity = record.entry(name, was).get("velocity", [0, 0])
        wrote[name] = (
            {}
            if equal(was.get("velocity", [0, 0]), velocity)
            else {"velocity": velocity}
        )
    return result, wrote


def kept_doubtful(
    scene: Entry, before: Labels, labels: Labels, gone: Labels
) -> tuple[Labels, dict[str, Any]]:
    """Return the new label map with the regions that are doubtful still, and those
    `gone`; entries of the former.
    """
    result, entries = labels.copy(), {}
    for name, entry in scene.get("doubtful", {}).items():
        if not isinstance(entry["mask"], int):  # drawn by the user
            entries[name] = entry
            continue
        whole = before == entry["mask"]
        region = whole & (result == 0)
        if np.count_nonzero(region) > OVERLAP[0] * np.count_nonzero(
            whole
        ):  # else it is part of an object now
            id_ = (
                int(result.max()) + 1
                if (result == entry["mask"]).any()
                else entry["mask"]
            )
            result[region], entries[name] = id_, {**entry, "mask": id_}
    free = (result == 0) & (gone > 0)
    result[free] = np.where(np.isin(gone, result), result.max() + 1, gone)[free]
    return result, entries


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, or the first of `name-2`, `name-3`, ... that is not taken."""
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free
