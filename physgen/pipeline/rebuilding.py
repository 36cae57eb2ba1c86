"""Assets that are missing or no longer fit a scene's photo, made anew for a refresh.

They go into a temporary folder beside the scene, and a refresh of the scene with these
assets writes the final ones.
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

import numpy as np
from numpy.typing import NDArray

from physgen.files import partial
from physgen.messages import Message
from physgen.problems import InputError, Place
from physgen.scene.files import MAPS, OUTLINES, RECORD, read_record
from physgen.scene.provenance import stated_scale
from physgen.scene.scaling import scale_part, scale_scene
from physgen.scene.yaml_edit import mark_values, write

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene
    from physgen.scene.load import OpenedScene
    from physgen.scene.rules import Ground

Labels = NDArray[np.uint16]
"""(H, W) ids of objects, 0 for none."""
Numbers = tuple[float, ...]
"""x, y, w, h px of a box, or x, y px of a point."""
PerceiveObjects = Callable[
    [Path, Sequence[Numbers], Sequence[Numbers]], "PerceivedScene"
]
"""Perceives the photo at a path, at its size, with boxes and points on its objects."""
ID_MAPS = ("masks", "shadows")
"""Maps of ids, which have no values in between."""
MASKED = ("objects", "boundaries", "doubtful")
"""Sections whose entries may have an id in masks.png."""
POINT_RADIUS = 4
"""px of the square that stands for an object marked by a point, until it is found."""
ROUNDING = 1.0
"""px by which a side of a resized photo may differ from its exact size."""


def has_other_shape(ground: Ground) -> bool:
    """Return whether the photo has other proportions than when it was perceived."""
    if ground.perceived_size is None or ground.size is None:
        return False
    (width, height), (old_width, old_height) = ground.size, ground.perceived_size
    factor = width / old_width
    return abs(height - old_height * factor) > ROUNDING * max(1.0, factor)


@contextmanager
def with_fitting_assets(
    opened: OpenedScene, path: Path, output: Path, perceive_objects: PerceiveObjects
) -> Iterator[tuple[OpenedScene, str]]:
    """Yield the scene with assets that fit its photo, and the text of its file.

    Assets that fit already are used as they are; the folder of others is removed at the
    end of the block. Raises InputError if objects are not found again.
    """
    from physgen.scene.load import OpenedScene

    text = path.read_bytes().decode("utf-8-sig")
    ground = opened.ground
    is_resized = ground.perceived_size is not None
    if not is_resized and not _lacks_masks(opened):
        yield opened, text
        return
    check_own_assets(text, path)
    folder = partial(path.with_name(f"{path.name}.assets"))
    folder.mkdir()
    try:
        if is_resized:
            text = _write_resized(text, ground, folder)
        else:
            text = _write_missing(text, path, ground, folder, perceive_objects)
        yield OpenedScene(path, opened.allow_outside, text), text
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _lacks_masks(opened: OpenedScene) -> bool:
    """Return whether the assets of a scene were deleted, but not its photo."""
    document, ground = opened.document(), opened.ground
    if ground.image is None or ground.size is None or "assets" not in document:
        return False
    if ground.assets is None:
        return not os.path.lexists(opened.file.parent / str(document["assets"]))
    has_masks = (ground.assets / "masks.png").is_file()
    return not has_masks and bool(_ids(document))


def check_own_assets(text: str, path: Path) -> None:
    """Refuse a scene that inherits: its base names the photo. Raises InputError."""
    if "extends" in mark_values(text).data():
        raise Message.EXTENDED_SCENE_CHANGED.error(str(path))


def _ids(document: Mapping[str, Any]) -> dict[tuple[str, str], int]:
    """Return the ids in masks.png, by section and name."""
    ids = {}
    for section in MASKED:
        for name, entry in (document.get(section) or {}).items():
            mask = entry.get("mask") if isinstance(entry, Mapping) else None
            if isinstance(mask, int) and not isinstance(mask, bool):
                ids[section, name] = mask
    return ids


# ---- a photo of another size


def _write_resized(text: str, ground: Ground, folder: Path) -> str:
    """Write all maps at the size of the photo; return the text with lengths to match."""
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
    old = mark_values(text).data()
    new = scale_scene(old, factor)
    world = {**new.get("world", {})}
    world.setdefault("pixels_per_meter", stated_scale(old) * factor)
    return write(text, {**new, "world": world, "assets": folder.name})


def _write_resized_map(source: Path, target: Path, size: tuple[int, int]) -> None:
    import cv2

    from physgen.maps import write_png
    from physgen.photos import read_channels

    picture = read_channels(source)
    is_smaller = size[0] < picture.shape[1]
    smooth = cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR
    method = cv2.INTER_NEAREST_EXACT if source.stem in ID_MAPS else smooth
    resized: Any = cv2.resize(picture, size, interpolation=method)
    write_png(target, resized)


def _scaled_record(record: dict[str, Any], factor: float) -> dict[str, Any]:
    """Return what perception wrote, with lengths in pixels `factor` times as long."""
    world = dict(record.get("world", {}))
    scale = world.get("pixels_per_meter")
    if isinstance(scale, int | float):
        world["pixels_per_meter"] = scale * factor
    walls = world.get("boundaries")
    world["boundaries"] = scale_part(walls or {}, ("boundaries",), factor)
    objects = {
        id_: scale_part(entry, ("objects", "*"), factor)
        for id_, entry in record.get("objects", {}).items()
    }
    return {**record, "objects": objects, "world": world}


def _write_record(folder: Path, record: dict[str, Any]) -> None:
    """Write the record, with the checksum by which masks count as not painted."""
    masks = folder / "masks.png"
    files = {masks.name: crc32(masks.read_bytes())}
    text = json.dumps({**record, "files": files}, ensure_ascii=False)
    (folder / RECORD).write_text(text, encoding="utf-8")


# ---- assets that are missing


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
    from physgen.maps import read_labels, write_png
    from physgen.perceive.document import write_scene

    assert ground.image is not None
    data = mark_values(text).data()
    perceived, ids = _perceive_prompted(data, ground, perceive_objects)
    scene = folder / "scene.yaml"
    write_scene(perceived, ground.image, "photo", scene)
    assets = folder / str(mark_values(scene.read_text("utf-8")).data()["assets"])
    ids = ids or _matched_ids(data, perceived.document, str(path))
    labels = _relabelled(read_labels(assets / "masks.png"), ids)
    _paint_prompts(labels, data)
    write_png(assets / "masks.png", labels)
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
    """Return the prompts of the scene by id in masks.png: boxes first, then points."""
    prompts = {}
    for (section, name), id_ in _ids(data).items():
        if section == "objects" and isinstance(data[section][name].get("prompt"), dict):
            prompts[id_] = data[section][name]["prompt"]
    order = sorted(prompts, key=lambda id_: "box" not in prompts[id_])
    return {id_: prompts[id_] for id_ in order}


def _perceive_prompted(
    data: Mapping[str, Any], ground: Ground, perceive_objects: PerceiveObjects
) -> tuple[PerceivedScene, dict[int, int]]:
    """Perceive the photo; return the scene's id of each new one, too.

    The prompts of the scene are used if they mark all objects: others are found again
    at the refresh.
    """
    assert ground.image is not None
    prompts = _prompts(data)
    if len(prompts) < len(data["objects"]):
        return perceive_objects(ground.image, (), ()), {}
    boxes = [tuple(one["box"]) for one in prompts.values() if "box" in one]
    points = [tuple(one["point"]) for one in prompts.values() if "point" in one]
    ids = dict(enumerate(prompts, 1))
    return perceive_objects(ground.image, boxes, points), ids


def _matched_ids(
    data: Mapping[str, Any], anew: Mapping[str, Any], file: str
) -> dict[int, int]:
    """Return the scene's id for each new one: of the same name, else the same label.

    Raises InputError with all that is not found and has no prompt.
    """
    new = _ids(anew)
    labels = {
        id_: anew[section][name].get("label") for (section, name), id_ in new.items()
    }
    ids: dict[int, int] = {}
    missing = []
    for (section, name), id_ in _ids(data).items():
        entry = data[section][name]
        has_same_label = id_ in labels and labels[id_] == entry.get("label")
        if new.get((section, name)) == id_ or has_same_label:
            ids[id_] = id_
        elif (section, name) in new:
            ids[new[section, name]] = id_
        elif section != "doubtful" and "prompt" not in entry:
            missing.append(f"{section}.{name}")
    if missing:
        raise InputError(
            Message.OBJECT_LOST.problem(Place(file), key) for key in missing
        )
    return ids


def _paint_prompts(labels: Labels, data: Mapping[str, Any]) -> None:
    """Paint the boxes and points of objects that have no pixels yet into the map."""
    present = set(np.unique(labels).tolist())
    for id_, prompt in _prompts(data).items():
        if id_ in present:
            continue
        if "box" in prompt:
            x, y, width, height = map(round, prompt["box"])
        else:
            x, y = (round(value) - POINT_RADIUS for value in prompt["point"])
            width = height = 2 * POINT_RADIUS
        rows = slice(max(0, y), max(0, y + height))
        columns = slice(max(0, x), max(0, x + width))
        labels[rows, columns] = id_


def _relabelled(labels: Labels, ids: Mapping[int, int]) -> Labels:
    """Return the map with the scene's ids; others are above all of them."""
    numbers = np.arange(int(labels.max()) + 1)
    top = max([0, *ids.values(), len(numbers)])
    table = np.where(numbers > 0, numbers + top, 0).astype(np.uint16)
    for new, old in ids.items():
        if new < len(table):
            table[new] = old
    return table[labels]
