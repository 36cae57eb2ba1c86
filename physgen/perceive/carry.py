"""What a user set in a scene, put into the scene of another photo.

Values in pixels belong to the old photo and are left out; masses, names of materials,
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
"""Keys of an object that belong to the pixels of one photo."""
VIEW_KEYS = {"view", "tilt", "backdrop", "table", "pixels_per_meter"}
"""Keys of `world` that follow from one photo."""
PHOTO_SECTIONS = ("forces", "joints", "fields", "variants", "maps")
"""Sections that name places or objects of one photo."""
FREE_SECTIONS = ("refine",)
"""Sections without any length in pixels."""


@dataclass
class Carried:
    """A scene with values of an old one; dotted keys that were kept and left out."""

    perceived: PerceivedScene
    kept: list[str] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)


def carry_over(old: Entry, record: Record, new: PerceivedScene) -> Carried:
    """Put what a user set in the `old` scene into the `new` one.

    Objects are matched by name; `record` is what perception wrote of the old scene.
    """
    carried = Carried(new)
    for name, was in old.get("objects", {}).items():
        _carry_object(name, was, record.entry(name, was), carried)
    wrote = {"world": {}, "render": {"slow": record.world.get("slow")}}
    for section, known in wrote.items():
        _carry_section(section, old.get(section, {}), known, carried)
    for section in FREE_SECTIONS:
        if section in old:
            document = {**carried.perceived.document, section: old[section]}
            carried.perceived = replace(carried.perceived, document=document)
            carried.kept.append(section)
    carried.dropped += [section for section in PHOTO_SECTIONS if old.get(section)]
    walls = record.world.get("boundaries", {})
    for name, wall in old.get("boundaries", {}).items():
        if not equal(wall, walls.get(name)):
            carried.dropped.append(f"boundaries.{name}")
    return carried


def _carry_object(name: str, was: Entry, wrote: Entry, carried: Carried) -> None:
    """Put the values of one object that a user set into the object of the same name."""
    perceived = carried.perceived
    objects = dict(perceived.document["objects"])
    values: dict[str, Any] = {}
    for key, value in was.items():
        if key in PIXEL_KEYS or equal(value, wrote.get(key)):
            continue
        if name in objects and _is_free_of_pixels(value, ("objects", name, key)):
            values[key] = value
            carried.kept.append(f"objects.{name}.{key}")
        else:
            carried.dropped.append(f"objects.{name}.{key}")
    if not values:
        return
    now = objects[name]
    sources = {key: one for key, one in now["from"].items() if key not in values}
    objects[name] = {**now, **values, "from": sources}
    if "density" in values:
        objects[name].pop("mass", None)
    wrote_now = {key: now[key] for key in values if key in now}
    comments = {
        key: words
        for key, words in perceived.comments.items()
        if key not in {f"objects.{name}.{one}" for one in values}
    }
    carried.perceived = replace(
        perceived,
        document={**perceived.document, "objects": objects},
        comments=comments,
        wrote={**perceived.wrote, name: wrote_now},
    )


def _carry_section(section: str, was: Entry, wrote: Entry, carried: Carried) -> None:
    """Put the settings of `world` or `render` that a user set into the new scene."""
    perceived = carried.perceived
    now = dict(perceived.document.get(section, {}))
    for key, value in was.items():
        follows_photo = section == "world" and key in VIEW_KEYS
        if follows_photo or equal(value, now.get(key)) or equal(value, wrote.get(key)):
            continue
        if _is_free_of_pixels(value, (section, key)):
            now[key] = value
            carried.kept.append(f"{section}.{key}")
        else:
            carried.dropped.append(f"{section}.{key}")
    document = {**perceived.document, section: now}
    carried.perceived = replace(perceived, document=document)


def _is_free_of_pixels(value: Any, path: tuple[str, ...]) -> bool:
    """Return whether a value stays as it is if the photo is twice as large."""
    return equal(scale_part(value, path, 2.0), value)
