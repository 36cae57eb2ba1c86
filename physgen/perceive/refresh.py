"""Refresh of a scene: perceive its photo again and keep the user's values.

A value with an entry in `from` is replaced if it is still as perception wrote it; other
values belong to the user and stay. Labels and names stay. Masks stay, except for
objects with a prompt.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np

from physgen.geometry.scale import PAPER_SCALE
from physgen.perceive import document, scene_files
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Labels,
    Mask,
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
MOTION_KEYS = ("motion", "velocity", "spin")
"""Keys of an object that describe its motion."""
LINES, SAME = {"segment", "polyline"}, 3.0
"""Keys of a boundary's points; largest distance (px) of a boundary found again."""
Entry = Mapping[str, Any]
"""One object or boundary of the scene's data."""


@dataclass(frozen=True)
class RefreshStart:
    """The objects with which perception starts, and the changes to the scene's objects
    by name.
    """

    detections: Detections
    # Objects with pixels from a prompt, old or new.
    prompted_names: frozenset[str]
    # Objects that a new prompt absorbed.
    absorbed_names: tuple[str, ...]


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
            if is_same_photo:
                return (width, height)
            return None
    return None


def list_prompts(objects: Sequence[Object]) -> list[Object]:
    """Return the objects with a prompt: those with a box, then those with a point."""
    boxes = []
    for item in objects:
        if isinstance(item.prompt, BoxPrompt):
            boxes.append(item)
    points = []
    for item in objects:
        if isinstance(item.prompt, PointPrompt):
            points.append(item)
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


@dataclass
class _ObjectDrawing:
    """The masks of objects, while prompts are drawn one after the other."""

    labels: Labels
    owners: dict[int, int]
    """Index of the scene's object by id."""
    confidence: dict[int, float] = field(default_factory=dict)
    """By id, of masks from prompts."""
    prompts: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    """By id."""
    replaced_ids: set[int] = field(default_factory=set)
    """Ids of new prompts; the labels of these objects are estimated again."""
    absorbed_indices: list[int] = field(default_factory=list)
    """Indices of the objects that a new prompt absorbed."""

    def cover(self, id_: int, mask: Mask, confidence: float, prompt: Entry) -> None:
        """Draw the mask of a prompt over the other objects."""
        self.labels[mask] = id_
        self.confidence[id_] = confidence
        self.prompts[id_] = prompt

    def absorb(self, id_: int) -> None:
        """Remove an object in favour of the one that a new prompt selects."""
        self.absorbed_indices.append(self.owners.pop(id_))
        self.confidence.pop(id_, None)
        self.prompts.pop(id_, None)

    def selected_ids(self, mask: Mask, largest_id: int) -> list[int]:
        """Return the ids of objects that a mask selects, the largest overlap first."""
        overlaps = np.bincount(self.labels[mask], minlength=largest_id + 1)
        areas = np.bincount(self.labels.ravel(), minlength=largest_id + 1)
        size = int(mask.sum())
        selected_ids = []
        for i in self.owners:
            smaller_area = min(size, areas[i])
            threshold = max(OVERLAP[0] * smaller_area, OVERLAP[1] * areas[i])
            if overlaps[i] > threshold:
                selected_ids.append(i)
        selected_ids.sort(key=lambda i: -int(overlaps[i]))
        return selected_ids


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
    if frames is None:
        frames = PromptFrames(PromptFrame.from_photo(rgb), PromptFrame.from_photo(rgb))
    new = from_prompts(rgb, boxes, points, segment, frames.new)
    # Stored prompts select whole objects, whatever the choice for the new prompts.
    whole_segmenter = replace(segment, is_smallest_meant=False)
    stored = from_prompts(rgb, *prompts_of(objects), whole_segmenter, frames.old)
    drawing = _draw_present_objects(objects, labels, stored)
    _draw_new_objects(drawing, new, max(_mask_ids(objects), default=0))
    items = {i: objects[k] for i, k in drawing.owners.items()}
    prompted_names = []
    for i in drawing.prompts:
        if i in items:
            prompted_names.append(items[i].name)
    absorbed_names = [objects[k].name for k in drawing.absorbed_indices]
    return RefreshStart(
        _detections(drawing, items, old),
        frozenset(prompted_names),
        tuple(absorbed_names),
    )


def _draw_present_objects(
    objects: Sequence[Object], labels: Labels, detections: Detections
) -> _ObjectDrawing:
    """Draw the objects of a scene; `detections` are the detections of their prompts."""
    ids = _mask_ids(objects)
    owners = {i: k for k, i in enumerate(ids)}
    drawing = _ObjectDrawing(np.zeros(labels.shape, np.uint16), owners)
    # Masks without a prompt stay; masks with a prompt are drawn over them.
    for k, i in enumerate(ids):
        if objects[k].prompt is None:
            drawing.labels[labels == k + 1] = i
    indices = {item.name: k for k, item in enumerate(objects)}
    for n, item in enumerate(list_prompts(objects), 1):
        id_ = ids[indices[item.name]]
        mask = detections.labels == n
        drawing.cover(id_, mask, detections.confidence[n], detections.prompts[n])
    return drawing


def _draw_new_objects(
    drawing: _ObjectDrawing, new: Detections, largest_old_id: int
) -> None:
    """Draw the masks of new prompts in place of the objects that they select."""
    largest_id = largest_old_id + len(new.prompts)
    for n, prompt in new.prompts.items():
        mask = new.labels == n
        # A new prompt selects the old objects under it: the largest overlap keeps its
        # id, the others are absorbed.
        selected_ids = drawing.selected_ids(mask, largest_id)
        drawing.labels[np.isin(drawing.labels, selected_ids)] = 0
        for absorbed_id in selected_ids[1:]:
            drawing.absorb(absorbed_id)
        if selected_ids:
            id_ = selected_ids[0]
        else:
            id_ = largest_old_id + n
        drawing.cover(id_, mask, new.confidence[n], prompt)
        drawing.replaced_ids.add(id_)


def _detections(
    drawing: _ObjectDrawing, items: Mapping[int, Object], old: Entry
) -> Detections:
    """Return the drawn objects with the sources, labels and names of a scene's objects.

    `items`: objects of the scene by id.
    """
    mask_sources: dict[int, str] = {}
    names: dict[int, Name] = {}
    for i, item in items.items():
        sources = old["objects"].get(item.name, {}).get("from", {})
        # Masks with a new prompt have no old source.
        if i not in drawing.prompts:
            mask_sources[i] = sources.get("mask", "")
        is_estimated_again = i in drawing.replaced_ids and "label" in sources
        if item.label and not is_estimated_again:
            names[i] = Name(item.label, label_confidence(item.provenance))
    confidence = dict(drawing.confidence)
    for i, text in mask_sources.items():
        old_confidence = source(text).confidence
        if old_confidence is not None:
            confidence[i] = old_confidence
    return Detections(
        drawing.labels,
        "kept",
        confidence,
        names=names,
        prompts=drawing.prompts,
        object_names={i: item.name for i, item in items.items()},
        mask_sources=mask_sources,
    )


def _mask_ids(objects: Sequence[Object]) -> list[int]:
    """Return an id for each object: its id in `masks.png`, or the next free one."""
    given_ids = []
    for item in objects:
        given_ids.append(item.mask.id if isinstance(item.mask, MaskId) else 0)
    free = iter(range(max(given_ids, default=0) + 1, 65536))
    result: list[int] = []
    for k, i in enumerate(given_ids):
        result.append(i if i and i not in given_ids[:k] else next(free))
    return result


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
    objects = {}
    for name, entry in data["objects"].items():
        objects[name] = (
            {**entry, "from": sources[name]}
            if "from" in entry or sources[name]
            else entry
        )
    return {**data, "objects": objects}


def known_view(scene: Scene) -> BoundaryGuess:
    """Return the scene's view with the recorded confidence and reason, or as the user
    gave it.
    """
    record = scene.record.world
    view = scene.world.view
    wrote = None
    if record.get("view") == view.value:
        wrote = record.get("view_from")
    origin = source(str(wrote or "as given 1"))
    return BoundaryGuess(
        view, 1.0 if origin.confidence is None else origin.confidence, origin.text, ()
    )


def as_before(
    perceived_scene: PerceivedScene, scene: Scene, is_resized: bool = False
) -> PerceivedScene:
    """Return the perceived scene with the boundaries and doubts of the old scene.

    If the photo `is_resized`, its boundaries move to nearby new ones, because the
    objects stand on those in its pixels.
    """
    walls = scene.record.world["boundaries"]
    doubts = read_recorded(scene.assets, "suitability")
    if is_resized:
        anew = perceived_scene.document["boundaries"].values()
        walls = {name: _nearest_wall(wall, anew) for name, wall in walls.items()}
    suits = perceived_scene.suitability
    if doubts:
        suits = Suitability(tuple(map(str, doubts.get("reasons", ()))))
    return replace(
        perceived_scene,
        document={**perceived_scene.document, "boundaries": walls},
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
    comments: Entry, merged_entry: Entry, perceived_entry: Entry, world: Entry
) -> dict[str, str]:
    """Return the still true comments for the `merged_entry` scene.

    A comment is true if its value equals the value in `perceived_entry`, the new scene. Comments
    on whole sections stay; the comment on the view requires a recorded reason in
    `world`.
    """
    value = scene_files.value_at
    has_reason = "view_from" in world
    candidates = {}
    for k, reason in comments.items():
        if has_reason or k != "world.view":
            candidates[k] = reason
    return {
        k: reason
        for k, reason in candidates.items()
        if "." not in k or equal(value(merged_entry, k), value(perceived_entry, k))
    }


def user_layers(scene: Entry) -> dict[str, int]:
    """Return the drawing layers set by the user, by name.

    These are layers without an entry in `from`; an object without `from` belongs to the
    user completely.
    """
    layers = {}
    for name, entry in scene["objects"].items():
        if "from" not in entry or ("layer" in entry and "layer" not in entry["from"]):
            layers[name] = int(entry.get("layer", 0))
    return layers


def merge_documents(
    old: Entry,
    new: Entry,
    start: RefreshStart,
    new_names: Mapping[str, str],
    scale_changed: bool,
    record: Record,
) -> dict[str, Any]:
    """Return the `old` scene with repeated results of the `new` scene and its new
    objects.

    `new_names` are new labels by name, `scale_changed` says whether perception set the scale,
    and `record` belongs to `old`.
    """
    objects: dict[str, Any] = {}
    # Start from the user's entries and replace the values of perception.
    for name, old_entry in old["objects"].items():
        if name in start.absorbed_names:
            continue
        new_entry = new["objects"].get(name)
        is_prompted = name in start.prompted_names
        entry = old_entry
        if new_entry is not None:
            entry = merge_object(old_entry, new_entry, is_prompted)
            # An object with new pixels gets the motion of those pixels.
            if is_prompted and _has_perceived_motion(name, old_entry, record):
                entry = _with_motion(entry, new_entry)
        if name in new_names:
            entry = _with_label(entry, new_names[name], "from" in old_entry)
        objects[name] = entry
    for name, new_entry in new["objects"].items():
        if name not in old["objects"]:
            objects[name] = new_entry
    world = _merge_worlds(old.get("world", {}), new["world"], scale_changed, record)
    # Boundaries are merged by position, since their names may change.
    walls = merge_boundaries(old.get("boundaries", {}), new["boundaries"], record)
    result = {**old, "objects": objects}
    if world:
        result["world"] = world
    if walls or "boundaries" in old:
        result["boundaries"] = walls
    return result


def _has_perceived_motion(name: str, entry: Entry, record: Record) -> bool:
    """Check whether perception wrote the key `motion` of an object."""
    motion = entry.get("motion")
    return bool(motion) and motion == record.entry(name, entry).get("motion")


def _with_motion(entry: Entry, new_entry: Entry) -> dict[str, Any]:
    """Return the entry of an object with the motion of another entry."""
    result = {}
    for key, value in entry.items():
        if key != "motion":
            result[key] = value
    for key in MOTION_KEYS:
        if key in new_entry:
            result[key] = new_entry[key]
    return result


def _with_label(entry: Entry, label: str, has_sources: bool) -> dict[str, Any]:
    """Return the entry of an object with a label of the user, which has no source."""
    result = {**entry, "label": label}
    if has_sources:
        sources = dict(entry.get("from", {}))
        sources.pop("label", None)
        result["from"] = sources
    return result


def _merge_worlds(
    old_world: Entry, new_world: Entry, scale_changed: bool, record: Record
) -> dict[str, Any]:
    """Return the old `world` with the scale and the view's values of the new one."""
    world = dict(old_world)
    new_scale = new_world["pixels_per_meter"]
    if scale_changed and new_scale != world.get("pixels_per_meter", PAPER_SCALE):
        world["pixels_per_meter"] = new_scale
    perceived_tables = document.TABLE, {"friction": 0}
    if "table" not in new_world and world.get("table") in perceived_tables:
        # The new view is from the side, so there is no table.
        del world["table"]
    has_new_view = new_world["view"] != record.world.get("view")
    for key in ("table", "tilt"):
        if has_new_view and key in new_world and key not in world:
            world[key] = new_world[key]
    return world


def merge_boundaries(
    old_entry: Entry, user_entry: Entry, record: Record
) -> dict[str, Any]:
    """Return the boundaries `user_entry`, with those of the user as they were.

    Boundaries that the user changed or deleted are not added again.
    """
    estimates = {}
    for name, wall in old_entry.items():
        if "from" in wall:
            estimates[name] = wall
    wrote = record.world.get("boundaries", estimates)
    walls = {}
    for name, wall in old_entry.items():
        if not equal(wall, wrote.get(name)):
            walls[name] = wall
    known_walls = []
    for name, wall in wrote.items():
        if name in walls or name not in old_entry:
            known_walls.append(wall)
    new_walls = {}
    for name, wall in user_entry.items():
        if not any(
            equal(known_wall.get(kind), wall[kind], SAME)
            for known_wall in known_walls
            for kind in LINES & wall.keys()
        ):
            new_walls[free_name(name, walls)] = wall
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
    world = scene.record.world
    assets = scene.assets
    if (
        assets is None
        or scene.world.view.value != world.get("view")
        or "boundaries" not in world
    ):
        return False
    has_paint = crc32((assets / "masks.png").read_bytes()) != read_recorded(
        assets, "files"
    ).get("masks.png")
    ids = set()
    for item in scene.objects:
        if isinstance(item.mask, MaskId):
            ids.add(str(item.mask.id))
    return (
        not has_paint
        and ids == scene.record.objects.keys()
        and np.array_equal(before, labels)
    )


def merge_object(
    old_entry: Entry, user_entry: Entry, has_prompt: bool = False
) -> dict[str, Any]:
    """Return an object as it `old_entry`, with the values listed in its `from` as they are
    `user_entry`.

    If it is `has_prompt`, its pixels are new as well. An object with only a mask gets all
    values.
    """
    if set(old_entry) <= scene_files.BARE:
        return {
            **user_entry,
            "mask": old_entry["mask"],
            "from": {**user_entry["from"], **old_entry.get("from", {})},
        }
    keys = perceived_keys(old_entry) | (set(PIXEL_KEYS) if has_prompt else set())
    # A label with a source is estimated again.
    keys |= {"label"} & old_entry.get("from", {}).keys() & user_entry["from"].keys()
    keys -= {
        key
        for key in keys
        if isinstance(old_entry.get(key), str)
        and isinstance(user_entry.get(key), int | float)
    }
    if "from" in old_entry:
        # These values are stored in the assets, not in the file.
        keys |= {"shape", "solid", "layer"} - old_entry.keys()
    return rewritten(old_entry, user_entry, keys)


def rewritten(
    old_entry: Entry, user_entry: Entry, keys: Collection[str]
) -> dict[str, Any]:
    """Return an object as it `old_entry`, with the values and sources of `keys` as they are
    `user_entry`.
    """
    result = dict(old_entry)
    sources = dict(old_entry.get("from", {}))
    # In the order of a set, new keys would differ from run to run.
    for key in sorted(keys):
        for values, new in ((result, user_entry), (sources, user_entry["from"])):
            if key in new:
                values[key] = new[key]
            else:
                values.pop(key, None)
    return result | ({"from": sources} if sources else {})


def rescale_document(
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
    scene: Entry, before: Labels, labels: Labels, removed_pixels: Labels
) -> tuple[Labels, dict[str, Any]]:
    """Return the label map with the remaining doubtful regions and `removed_pixels`, and entries.

    Entries are those of the doubtful regions.
    """
    result = labels.copy()
    entries = {}
    for name, entry in scene.get("doubtful", {}).items():
        # The user drew this region.
        if not isinstance(entry["mask"], int):
            entries[name] = entry
            continue
        old_region = before == entry["mask"]
        region = old_region & (result == 0)
        # Otherwise the region has become part of an object.
        if np.count_nonzero(region) > OVERLAP[0] * np.count_nonzero(old_region):
            if (result == entry["mask"]).any():
                id_ = int(result.max()) + 1
            else:
                id_ = entry["mask"]
            result[region], entries[name] = id_, {**entry, "mask": id_}
    free = (result == 0) & (removed_pixels > 0)
    result[free] = np.where(
        np.isin(removed_pixels, result), result.max() + 1, removed_pixels
    )[free]
    return result, entries


def free_name(name: str, names: Collection[str]) -> str:
    """Return the name, or the first of `name-2`, `name-3`, ... that is free."""
    free = name
    k = 2
    while free in names:
        free = f"{name}-{k}"
        k = k + 1
    return free
