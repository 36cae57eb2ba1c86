"""New assets for a refresh, if those of a scene are missing or do not fit its photo.

The new assets are written to a temporary folder beside the scene. The refresh of the
scene with these assets then writes the final ones.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.files import partial
from physgen.maps import read_labels, write_png
from physgen.messages import Message
from physgen.perceive.scene_files import write_scene
from physgen.photos import read_channels
from physgen.problems import InputError, Place
from physgen.scene.files import MAPS, OUTLINES, RECORD, read_record
from physgen.scene.load import OpenedScene
from physgen.scene.provenance import stated_scale
from physgen.scene.scaling import scale_part, scale_scene
from physgen.scene.yaml_edit import mark_values, write

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene
    from physgen.scene.checked_tree import Ground

Labels = NDArray[np.uint16]
"""Ids of objects, (H, W), 0 for the background."""
Numbers = tuple[float, ...]
"""A box x, y, w, h, or a point x, y, px."""
PerceiveObjects = Callable[
    [Path, Sequence[Numbers], Sequence[Numbers]], "PerceivedScene"
]
"""Function to perceive the photo at a path, at its size, with boxes and points."""
ID_MAPS = ("masks", "shadows")
"""Maps of ids: they are resized without interpolation."""
MASKED = ("objects", "boundaries", "doubtful")
"""Sections of entries with possible ids in masks.png."""
POINT_RADIUS = 4
"""Half the side, px, of the square for an object with a point, until it is
segmented.
"""
ROUNDING = 1.0
"""Tolerance of the side of a resized photo, px."""


def has_other_shape(ground: Ground) -> bool:
    """Check whether the photo's proportions have changed since it was perceived."""
    if ground.perceived_size is None or ground.size is None:
        return False
    width, height = ground.size
    old_width, old_height = ground.perceived_size
    factor = width / old_width
    return abs(height - old_height * factor) > ROUNDING * max(1.0, factor)


@contextmanager
def with_fitting_assets(
    opened_scene: OpenedScene,
    path: Path,
    output: Path,
    perceive_objects: PerceiveObjects,
) -> Iterator[tuple[OpenedScene, str]]:
    """Yield the scene with assets that fit its photo, and the text of its file.

    Fitting assets are used as they are; a temporary folder is removed at the end of the
    block. Raises InputError if objects are not found again.
    """
    text = path.read_bytes().decode("utf-8-sig")
    ground = opened_scene.ground
    is_resized = ground.perceived_size is not None
    if not is_resized and not _lacks_masks(opened_scene):
        yield opened_scene, text
        return
    check_own_assets(text, path)
    # Write into a temporary folder beside the file, since its paths are relative.
    folder = partial(path.with_name(f"{path.name}.assets"))
    folder.mkdir()
    try:
        if is_resized:
            text = _write_resized(text, ground, folder)
        else:
            text = _write_missing(text, path, ground, folder, perceive_objects)
        yield OpenedScene(path, opened_scene.allow_outside, text), text
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _lacks_masks(opened_scene: OpenedScene) -> bool:
    """Check whether the assets of a scene were deleted, but not its photo."""
    document = opened_scene.document()
    ground = opened_scene.ground
    if ground.image is None or ground.size is None or "assets" not in document:
        return False
    if ground.assets is None:
        return not os.path.lexists(opened_scene.file.parent / str(document["assets"]))
    has_masks = (ground.assets / "masks.png").is_file()
    return not has_masks and bool(_ids(document))


def check_own_assets(text: str, path: Path) -> None:
    """Refuse a scene with `extends`: its base names the photo. Raises InputError."""
    if "extends" in mark_values(text).data():
        raise Message.EXTENDED_SCENE_CHANGED.error(str(path))


def _ids(document: Mapping[str, Any]) -> dict[tuple[str, str], int]:
    """Collect the ids in masks.png, by section and name."""
    ids = {}
    for section in MASKED:
        for name, entry in (document.get(section) or {}).items():
            mask = None
            if isinstance(entry, Mapping):
                mask = entry.get("mask")
            if isinstance(mask, int) and not isinstance(mask, bool):
                ids[section, name] = mask
    return ids


# ---- a photo of another size


def _write_resized(text: str, ground: Ground, folder: Path) -> str:
    """Write all maps at the size of the photo; return the text with scaled lengths."""
    assert ground.size is not None
    assert ground.assets is not None
    assert ground.perceived_size is not None
    factor = max(ground.size) / max(ground.perceived_size)
    for name in MAPS:
        file = ground.assets / f"{name}.png"
        if file.is_file():
            _write_resized_map(file, folder / file.name, ground.size)
    record = _scaled_record(read_record(ground.assets / RECORD), factor)
    _write_record(folder, record)
    old_document = mark_values(text).data()
    new_document = scale_scene(old_document, factor)
    # Lengths in px have changed with the photo, lengths in metres have not.
    world = {**new_document.get("world", {})}
    world.setdefault("pixels_per_meter", stated_scale(old_document) * factor)
    return write(text, {**new_document, "world": world, "assets": folder.name})


def _write_resized_map(source: Path, target: Path, size: tuple[int, int]) -> None:
    """Write a map at another size, (width, height) px."""
    picture = read_channels(source)
    # Averages over areas avoid aliasing in a smaller map.
    is_smaller = size[0] < picture.shape[1]
    if is_smaller:
        smooth_method = cv2.INTER_AREA
    else:
        smooth_method = cv2.INTER_LINEAR
    if source.stem in ID_MAPS:
        method = cv2.INTER_NEAREST_EXACT
    else:
        method = smooth_method
    resized: Any = cv2.resize(picture, size, interpolation=method)
    write_png(target, resized)


def _scaled_record(record: dict[str, Any], factor: float) -> dict[str, Any]:
    """Scale the lengths in pixels of perception's record by a factor."""
    world = dict(record.get("world", {}))
    scale = world.get("pixels_per_meter")
    if isinstance(scale, int | float):
        world["pixels_per_meter"] = scale * factor
    walls = world.get("boundaries")
    world["boundaries"] = scale_part(walls or {}, ("boundaries",), factor)
    objects = {}
    for id_, entry in record.get("objects", {}).items():
        objects[id_] = scale_part(entry, ("objects", "*"), factor)
    return {**record, "objects": objects, "world": world}


def _write_record(folder: Path, record: dict[str, Any]) -> None:
    """Write the record with the checksum of masks.png.

    A later refresh takes masks with another checksum for painted by the user.
    """
    masks = folder / "masks.png"
    files = {masks.name: crc32(masks.read_bytes())}
    text = json.dumps({**record, "files": files}, ensure_ascii=False)
    (folder / RECORD).write_text(text, encoding="utf-8")


# ---- missing assets


def _write_missing(
    text: str,
    path: Path,
    ground: Ground,
    folder: Path,
    perceive_objects: PerceiveObjects,
) -> str:
    """Perceive the photo into the folder, with the ids of the scene; return the text.

    Raises InputError with all objects that are not found again.
    """
    assert ground.image is not None
    data = mark_values(text).data()
    photo_scene, ids = _perceive_prompted(data, ground, perceive_objects)
    scene = folder / "scene.yaml"
    write_scene(photo_scene, ground.image, "photo", scene)
    assets = folder / str(mark_values(scene.read_text("utf-8")).data()["assets"])
    # Without prompts for all objects, names and labels tell which new object is which.
    ids = ids or _matched_ids(data, photo_scene.document, str(path))
    labels = _relabel_map(read_labels(assets / "masks.png"), ids)
    _paint_prompts(labels, data)
    write_png(assets / "masks.png", labels)
    # Backups and outlines belong to the ids before relabelling.
    (assets / "masks.png~").unlink(missing_ok=True)
    (assets / OUTLINES).unlink(missing_ok=True)
    record = read_record(assets / RECORD)
    record["objects"] = {
        str(ids[int(id_)]): {**entry, "mask": ids[int(id_)]}
        for id_, entry in record["objects"].items()
        if int(id_) in ids
    }
    _write_record(assets, record)
    return write(text, {**data, "assets": f"{folder.name}/{assets.name}"})


def _prompts(data: Mapping[str, Any]) -> dict[int, Mapping[str, Any]]:
    """Collect the prompts of the scene by id in masks.png: boxes first, then points."""
    prompts = {}
    for (section, name), id_ in _ids(data).items():
        if section == "objects" and isinstance(data[section][name].get("prompt"), dict):
            prompts[id_] = data[section][name]["prompt"]
    sorted_ids = sorted(prompts, key=lambda id_: "box" not in prompts[id_])
    return {id_: prompts[id_] for id_ in sorted_ids}


def _perceive_prompted(
    data: Mapping[str, Any], ground: Ground, perceive_objects: PerceiveObjects
) -> tuple[PerceivedScene, dict[int, int]]:
    """Perceive the photo; also return the scene's id for each new id.

    The prompts of the scene are used only if they mark all objects, since prompts
    replace the segment backend. Otherwise the refresh finds the marked objects again.
    """
    assert ground.image is not None
    prompts = _prompts(data)
    # Without a prompt for each object, perceive all objects and match them by name.
    if len(prompts) < len(data["objects"]):
        return perceive_objects(ground.image, (), ()), {}
    boxes = []
    for prompt in prompts.values():
        if "box" in prompt:
            boxes.append(tuple(prompt["box"]))
    points = []
    for prompt in prompts.values():
        if "point" in prompt:
            points.append(tuple(prompt["point"]))
    ids = dict(enumerate(prompts, 1))
    return perceive_objects(ground.image, boxes, points), ids


def _matched_ids(
    data: Mapping[str, Any], anew: Mapping[str, Any], file: str
) -> dict[int, int]:
    """Match new ids to the scene's: by name, or else by label.

    Raises InputError with all objects without a match and without a prompt.
    """
    new_ids = _ids(anew)
    labels = {
        id_: anew[section][name].get("label")
        for (section, name), id_ in new_ids.items()
    }
    ids: dict[int, int] = {}
    missing_keys = []
    for (section, name), id_ in _ids(data).items():
        entry = data[section][name]
        has_same_label = id_ in labels and labels[id_] == entry.get("label")
        # The same id with the same name or label is the same object.
        if new_ids.get((section, name)) == id_ or has_same_label:
            ids[id_] = id_
        elif (section, name) in new_ids:
            ids[new_ids[section, name]] = id_
        # A doubtful object may vanish, and a prompt finds its object by itself.
        elif section != "doubtful" and "prompt" not in entry:
            missing_keys.append(f"{section}.{name}")
    if missing_keys:
        raise InputError(
            Message.OBJECT_LOST.problem(Place(file), key) for key in missing_keys
        )
    return ids


def _paint_prompts(labels: Labels, data: Mapping[str, Any]) -> None:
    """Paint the boxes and points of objects without pixels into the map, in place."""
    present_ids = set(np.unique(labels).tolist())
    for id_, prompt in _prompts(data).items():
        if id_ in present_ids:
            continue
        if "box" in prompt:
            x, y, width, height = map(round, prompt["box"])
        else:
            x, y = (round(value) - POINT_RADIUS for value in prompt["point"])
            width = height = 2 * POINT_RADIUS
        rows = slice(max(0, y), max(0, y + height))
        columns = slice(max(0, x), max(0, x + width))
        labels[rows, columns] = id_


def _relabel_map(labels: Labels, ids: Mapping[int, int]) -> Labels:
    """Convert a map to the scene's ids; new objects get ids above all of them."""
    new_ids = np.arange(int(labels.max()) + 1)
    largest_id = max([0, *ids.values(), len(new_ids)])
    table = np.where(new_ids > 0, new_ids + largest_id, 0).astype(np.uint16)
    for new_id, scene_id in ids.items():
        if new_id < len(table):
            table[new_id] = scene_id
    return table[labels]
