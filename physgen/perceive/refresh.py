"""Refresh of a scene: perceive its photo again and keep the user's values.

A value with an entry in `from` is replaced if it is still as perception wrote it; other
values belong to the user and stay. Labels and names stay. Masks stay, except for
objects with a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np

from physgen.geometry.scale import PAPER_SCALE
from physgen.perceive import document, scene_files
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
from physgen.scene.files import Record, equal, read_recorded
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
"""Share of the smaller mask, and of the old mask, above which a new prompt selects an
existing object.
"""
PIXEL_KEYS = ("mask", "shape", "prompt")
"""Keys of an object that depend on its pixels."""
LINES, SAME = {"segment", "polyline"}, 3.0
"""Keys of a boundary's points; largest distance (px) of a boundary found again."""
Entry = Mapping[str, Any]
"""One object or boundary of the scene's data."""


@dataclass(frozen=True)
class RefreshStart:
    """The objects with which perception starts, and the changes to the scene's objects
    by name.
    """

    found: Detections
    # Objects with pixels from a prompt, old or new.
    prompted: frozenset[str]
    # Objects that a new prompt absorbed.
    gone: tuple[str, ...]


@dataclass(frozen=True)
class PromptFrames:
    """The photos of the prompts' pixels."""

    # Photo of new boxes and points.
    new: PromptFrame
    # Photo of the scene's prompts.
    old: PromptFrame


def full_size(scene: Scene) -> tuple[int, int] | None:
    """Return width and height, px, of the photo before it was reduced for a scene.

    Returns None if the scene shows the original photo, or another photo.
    """
    photo = read_recorded(scene.assets, "photo")
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
    """Keep objects without a prompt, segment objects with a prompt again, and add new
    ones.

    New boxes and points replace the covered objects. `old` is the scene's data with its
    sources. `labels` (H, W): id k + 1 is the k-th of `objects`. Ids of masks stay.
    Raises InputError as `from_prompts`.
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
    # Stored prompts select whole objects, whatever the choice for the new prompts.
    whole_segmenter = replace(segment, is_smallest_meant=False)
    new_detections = from_prompts(
        rgb, *prompts_of(objects), whole_segmenter, frames.old
    )

    result = np.zeros(labels.shape, np.uint16)
    # Maps ids to indices of `objects`.
    owner = {i: k for k, i in enumerate(ids)}
    confidence: dict[int, float] = {}
    prompts: dict[int, Mapping[str, Any]] = {}
    # Masks without a prompt stay; masks with a prompt are drawn over them.
    for k, i in enumerate(ids):
        if objects[k].prompt is None:
            result[labels == k + 1] = i
    for n, k in enumerate([*by_box, *by_point], 1):
        result[new_detections.labels == n] = ids[k]
        confidence[ids[k]], prompts[ids[k]] = (
            new_detections.confidence[n],
            new_detections.prompts[n],
        )
    absorbed_names: list[str] = []
    # Labels of these objects are estimated again.
    replaced_ids = set()
    largest_id = max(ids, default=0) + len(new.prompts)
    for n, prompt in new.prompts.items():
        mask = new.labels == n
        common, areas = (
            np.bincount(part.ravel(), minlength=largest_id + 1)
            for part in (result[mask], result)
        )
        size = int(mask.sum())
        # A new prompt selects the old objects under it: the largest overlap keeps its
        # id, the others are absorbed.
        selected_ids = [
            i
            for i in owner
            if common[i] > max(OVERLAP[0] * min(size, areas[i]), OVERLAP[1] * areas[i])
        ]
        selected_ids.sort(key=lambda i: -int(common[i]))
        result[np.isin(result, selected_ids)] = 0
        for i in selected_ids[1:]:
            absorbed_names.append(objects[owner.pop(i)].name)
            confidence.pop(i, None)
            prompts.pop(i, None)
        i = selected_ids[0] if selected_ids else max(ids, default=0) + n
        result[mask] = i
        confidence[i], prompts[i] = new.confidence[n], prompt
        replaced_ids.add(i)
    items = {i: objects[k] for i, k in owner.items()}
    sources = {
        i: old["objects"].get(item.name, {}).get("from", {})
        for i, item in items.items()
    }
    # Masks with a new prompt have no old source.
    masks = {
        i: origins.get("mask", "") for i, origins in sources.items() if i not in prompts
    }
    confidence |= {
        i: value
        for i, text in masks.items()
        if (value := source(text).sure) is not None
    }
    detections = Detections(
        result,
        "kept",
        confidence,
        names={
            i: Name(item.label, label_confidence(item.provenance))
            for i, item in items.items()
            if item.label and not (i in replaced_ids and "label" in sources[i])
        },
        prompts=prompts,
        object_names={i: item.name for i, item in items.items()},
        mask_sources=masks,
    )
    return RefreshStart(
        detections,
        frozenset(items[i].name for i in prompts if i in items),
        tuple(absorbed_names),
    )


def _mask_ids(objects: Sequence[Object]) -> list[int]:
    """Return an id for each object: its id in `masks.png`, or the next free one."""
    given_ids = [
        item.mask.id if isinstance(item.mask, MaskId) else 0 for item in objects
    ]
    free = iter(range(max(given_ids, default=0) + 1, 65536))
    return [
        i if i and i not in given_ids[:k] else next(free)
        for k, i in enumerate(given_ids)
    ]


def with_sources(data: Entry, scene: Scene) -> dict[str, Any]:
    """Return a scene's data in which `from` lists only values that the user has not
    changed.
    """
    sources = {item.name: dict(item.provenance) for item in scene.objects}
    for name, entry in data["objects"].items():
        if entry.keys() <= scene_files.BARE and "confidence" in entry:
            sources[name].setdefault(
                "mask", provenance("doubtful", entry["confidence"])
            )
    objects = {
        name: {**entry, "from": sources[name]}
        if "from" in entry or sources[name]
        else entry
        for name, entry in data["objects"].items()
    }
    return {**data, "objects": objects}


def known_view(scene: Scene) -> BoundaryGuess:
    """Return the scene's view with the recorded confidence and reason, or as the user
    gave it.
    """
    record, view = scene.record.world, scene.world.view
    wrote = record.get("view_from") if record.get("view") == view.value else None
    origin = source(str(wrote or "as given 1"))
    return BoundaryGuess(
        view, 1.0 if origin.sure is None else origin.sure, origin.text, ()
    )


def as_before(
    perceived: PerceivedScene, scene: Scene, is_resized: bool = False
) -> PerceivedScene:
    """Return the perceived scene with the boundaries and doubts of the old scene.

    If the photo `is_resized`, its boundaries move to nearby new ones, because the
    objects stand on those in its pixels.
    """
    walls, doubts = (
        scene.record.world["boundaries"],
        read_recorded(scene.assets, "suitability"),
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
    """Return the still true comments for the `merged` scene.

    A comment is true if its value equals the value in `seen`, the new scene. Comments
    on whole sections stay; the comment on the view requires a recorded reason in
    `world`.
    """
    value, has_reason = scene_files.value_at, "view_from" in world
    candidates = {
        k: reason for k, reason in comments.items() if has_reason or k != "world.view"
    }
    return {
        k: reason
        for k, reason in candidates.items()
        if "." not in k or equal(value(merged, k), value(seen, k))
    }


def user_layers(scene: Entry) -> dict[str, int]:
    """Return the drawing layers set by the user, by name.

    These are layers without an entry in `from`; an object without `from` belongs to the
    user completely.
    """
    return {
        name: int(entry.get("layer", 0))
        for name, entry in scene["objects"].items()
        if "from" not in entry or ("layer" in entry and "layer" not in entry["from"])
    }


def merge_documents(
    old: Entry,
    new: Entry,
    start: RefreshStart,
    renamed: Mapping[str, str],
    scaled: bool,
    record: Record,
) -> dict[str, Any]:
    """Return the `old` scene with repeated results of the `new` scene and its new
    objects.

    `renamed` are new labels by name, `scaled` says whether perception set the scale,
    and `record` belongs to `old`.
    """
    objects: dict[str, Any] = {}
    # Start from the user's entries and replace the values of perception.
    for name, old_entry in old["objects"].items():
        if name not in start.gone:
            new_entry = new["objects"].get(name)
            objects[name] = (
                old_entry
                if new_entry is None
                else merge_object(old_entry, new_entry, name in start.prompted)
            )
            static_motion = old_entry.get("motion")
            static_motion = static_motion and static_motion == record.entry(
                name, old_entry
            ).get("motion")
            if new_entry is not None and name in start.prompted and static_motion:
                # An object with new pixels gets the motion of those pixels.
                moves = {
                    key: new_entry[key]
                    for key in ("motion", "velocity", "spin")
                    if key in new_entry
                }
                objects[name] = {
                    key: v for key, v in objects[name].items() if key != "motion"
                } | moves
        if name in renamed and name in objects:
            sources = {
                key: origin
                for key, origin in objects[name].get("from", {}).items()
                if key != "label"
            }
            objects[name] |= {"label": renamed[name]} | (
                {"from": sources} if "from" in old_entry else {}
            )
    objects |= {
        name: new_entry
        for name, new_entry in new["objects"].items()
        if name not in old["objects"]
    }
    world, new_world = dict(old.get("world", {})), new["world"]
    if scaled and new_world["pixels_per_meter"] != world.get(
        "pixels_per_meter", PAPER_SCALE
    ):
        world["pixels_per_meter"] = new_world["pixels_per_meter"]
    if "table" not in new_world and world.get("table") in (
        document.TABLE,
        {"friction": 0},
    ):
        # The new view is from the side, so there is no table.
        del world["table"]
    has_new_view = new_world["view"] != record.world.get("view")
    for key in ("table", "tilt"):
        if has_new_view and key in new_world and key not in world:
            world[key] = new_world[key]
    # Boundaries are merged by position, since their names may change.
    walls = merge_boundaries(old.get("boundaries", {}), new["boundaries"], record)
    result = {**old, "objects": objects} | ({"world": world} if world else {})
    return result | ({"boundaries": walls} if walls or "boundaries" in old else {})


def merge_boundaries(was: Entry, now: Entry, record: Record) -> dict[str, Any]:
    """Return the boundaries `now`, with those of the user as they were.

    Boundaries that the user changed or deleted are not added again.
    """
    estimates = {name: wall for name, wall in was.items() if "from" in wall}
    wrote = record.world.get("boundaries", estimates)
    walls = {
        name: wall for name, wall in was.items() if not equal(wall, wrote.get(name))
    }
    known_walls = [
        wall for name, wall in wrote.items() if name in walls or name not in was
    ]
    new_walls = {
        free_name(name, walls): wall
        for name, wall in now.items()
        if not any(
            equal(known_wall.get(kind), wall[kind], SAME)
            for known_wall in known_walls
            for kind in LINES & wall.keys()
        )
    }
    return new_walls | walls


def taken_out(objects: Sequence[Object], before: Labels, labels: Labels) -> Labels:
    """Return the ids (H, W) of deleted objects in the map `before`, 0 elsewhere.

    Pixels of present objects are 0.
    """
    return np.where(
        np.isin(before, _mask_ids(objects)) | (labels > 0), np.uint16(0), before
    )


def same_objects(scene: Scene, before: Labels, labels: Labels) -> bool:
    """Return whether objects, pixels and view are as they were when boundaries were
    perceived.

    In that case the boundaries are the same, too.
    """
    world, assets = scene.record.world, scene.assets
    if (
        assets is None
        or scene.world.view.value != world.get("view")
        or "boundaries" not in world
    ):
        return False
    has_paint = crc32((assets / "masks.png").read_bytes()) != read_recorded(
        assets, "files"
    ).get("masks.png")
    ids = {str(item.mask.id) for item in scene.objects if isinstance(item.mask, MaskId)}
    return (
        not has_paint
        and ids == scene.record.objects.keys()
        and np.array_equal(before, labels)
    )


def merge_object(was: Entry, now: Entry, prompted: bool = False) -> dict[str, Any]:
    """Return an object as it `was`, with the values listed in its `from` as they are
    `now`.

    If it is `prompted`, its pixels are new as well. An object with only a mask gets all
    values.
    """
    if set(was) <= scene_files.BARE:
        return {
            **now,
            "mask": was["mask"],
            "from": {**now["from"], **was.get("from", {})},
        }
    keys = perceived_keys(was) | (set(PIXEL_KEYS) if prompted else set())
    # A label with a source is estimated again.
    keys |= {"label"} & was.get("from", {}).keys() & now["from"].keys()
    keys -= {
        key
        for key in keys
        if isinstance(was.get(key), str) and isinstance(now.get(key), int | float)
    }
    if "from" in was:
        # These values are stored in the assets, not in the file.
        keys |= {"shape", "solid", "layer"} - was.keys()
    return rewritten(was, now, keys)


def rewritten(was: Entry, now: Entry, keys: Collection[str]) -> dict[str, Any]:
    """Return an object as it `was`, with the values and sources of `keys` as they are
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
    """Return the `new` data with speeds and playback for its scale, and changed values.

    The second result has the form of `PerceivedScene.wrote`: values of perception that
    the user of `old` has changed.
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
    for name, entry in old["objects"].items():
        velocity = record.entry(name, entry).get("velocity", [0, 0])
        wrote[name] = (
            {}
            if equal(entry.get("velocity", [0, 0]), velocity)
            else {"velocity": velocity}
        )
    return result, wrote


def kept_doubtful(
    scene: Entry, before: Labels, labels: Labels, gone: Labels
) -> tuple[Labels, dict[str, Any]]:
    """Return the label map with the remaining doubtful regions and `gone`, and entries.

    Entries are those of the doubtful regions.
    """
    result, entries = labels.copy(), {}
    for name, entry in scene.get("doubtful", {}).items():
        # The user drew this region.
        if not isinstance(entry["mask"], int):
            entries[name] = entry
            continue
        old_region = before == entry["mask"]
        region = old_region & (result == 0)
        # Otherwise the region has become part of an object.
        if np.count_nonzero(region) > OVERLAP[0] * np.count_nonzero(old_region):
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
    """Return the name, or the first of `name-2`, `name-3`, ... that is free."""
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free
