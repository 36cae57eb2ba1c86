"""Transfer the user's settings of a scene to the scene of another photo.

Values in pixels belong to the old photo and are dropped. Masses, materials,
coefficients, speeds in m/s and the settings of the video are kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from physgen.perceive.roles import PerceivedScene
from physgen.scene.files import Record, equal
from physgen.scene.scaling import scale_part

Entry = Mapping[str, Any]
"""One object or section of the scene's data."""
PIXEL_KEYS = {
    "mask",
    "shape",
    "prompt",
    "from",
    "layer",
    "confidence",
    "wheels",
    "facing",
}
"""Keys of an object with values in pixels of one photo."""
VIEW_KEYS = {"view", "tilt", "backdrop", "table", "pixels_per_meter"}
"""Keys of `world` with values of one photo."""
PHOTO_SECTIONS = ("forces", "joints", "fields", "variants", "maps")
"""Sections with places or objects of one photo."""
FREE_SECTIONS = ("refine",)
"""Sections without lengths in pixels."""


@dataclass
class Transfer:
    """A scene with values of an old one, and the kept and dropped dotted keys."""

    scene: PerceivedScene
    kept_keys: list[str] = field(default_factory=list)
    dropped_keys: list[str] = field(default_factory=list)


def carry_over(old: Entry, record: Record, new: PerceivedScene) -> Transfer:
    """Transfer the user's settings in the `old` scene to the `new` one.

    Objects are matched by name; `record` holds the values that perception wrote in the
    old scene.
    """
    result = Transfer(new)
    for name, entry in old.get("objects", {}).items():
        _carry_object(name, entry, record.entry(name, entry), result)
    wrote = {"world": {}, "render": {"slow": record.world.get("slow")}}
    for section, record_section in wrote.items():
        _carry_section(section, old.get(section, {}), record_section, result)
    for section in FREE_SECTIONS:
        if section in old:
            document = {**result.scene.document, section: old[section]}
            result.scene = replace(result.scene, document=document)
            result.kept_keys.append(section)
    result.dropped_keys += [section for section in PHOTO_SECTIONS if old.get(section)]
    walls = record.world.get("boundaries", {})
    for name, wall in old.get("boundaries", {}).items():
        if not equal(wall, walls.get(name)):
            result.dropped_keys.append(f"boundaries.{name}")
    return result


def _carry_object(
    name: str, entry_before: Entry, wrote: Entry, transfer: Transfer
) -> None:
    """Transfer the user's settings of one object to the object of the same name."""
    scene = transfer.scene
    objects = dict(scene.document["objects"])
    values: dict[str, Any] = {}
    for key, value in entry_before.items():
        if key in PIXEL_KEYS or equal(value, wrote.get(key)):
            continue
        if name in objects and _is_free_of_pixels(value, ("objects", name, key)):
            values[key] = value
            transfer.kept_keys.append(f"objects.{name}.{key}")
        else:
            transfer.dropped_keys.append(f"objects.{name}.{key}")
    if not values:
        return
    current = objects[name]
    sources = {}
    for key, origin in current["from"].items():
        if key not in values:
            sources[key] = origin
    objects[name] = {**current, **values, "from": sources}
    # Density and mass exclude each other.
    if "density" in values:
        objects[name].pop("mass", None)
    wrote_now = {}
    for key in values:
        if key in current:
            wrote_now[key] = current[key]
    comments = {}
    for key, words in scene.comments.items():
        if key not in {f"objects.{name}.{origin}" for origin in values}:
            comments[key] = words
    transfer.scene = replace(
        scene,
        document={**scene.document, "objects": objects},
        comments=comments,
        wrote={**scene.wrote, name: wrote_now},
    )


def _carry_section(
    section: str, entry_before: Entry, wrote: Entry, transfer: Transfer
) -> None:
    """Transfer the user's settings of `world` or `render` to the new scene."""
    scene = transfer.scene
    settings = dict(scene.document.get(section, {}))
    for key, value in entry_before.items():
        follows_photo = section == "world" and key in VIEW_KEYS
        if (
            follows_photo
            or equal(value, settings.get(key))
            or equal(value, wrote.get(key))
        ):
            continue
        if _is_free_of_pixels(value, (section, key)):
            settings[key] = value
            transfer.kept_keys.append(f"{section}.{key}")
        else:
            transfer.dropped_keys.append(f"{section}.{key}")
    document = {**scene.document, section: settings}
    transfer.scene = replace(scene, document=document)


def _is_free_of_pixels(value: Any, path: tuple[str, ...]) -> bool:
    """Return whether a value stays the same if the photo is twice as large."""
    return equal(scale_part(value, path, 2.0), value)
