"""Write a perceived scene: the scene file and its assets."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zlib import crc32

from physgen import __version__
from physgen.compile.shapes import mask_crc
from physgen.files import free_folder, resource, write_atomic, write_with_backup
from physgen.geometry.polygon import Outline
from physgen.geometry.scale import slow_motion
from physgen.maps import Keep, ignore_kept_file, write_assets, write_png
from physgen.perceive.roles import (
    Labels,
    PerceivedScene,
)
from physgen.perceive.shape_entries import (
    shape_entry,
)
from physgen.scene.files import (
    MAPS,
    OUTLINES,
    OVERVIEW,
    RECORD,
    UNKNOWN,
    Record,
    read_recorded,
)
from physgen.scene.provenance import provenance as provenance
from physgen.scene.provenance import stated_scale
from physgen.scene.saving import note_files, note_scene, save_scene
from physgen.scene.schema import schema_at
from physgen.scene.write import scene_text
from physgen.scene.yaml_comments import with_comments, without_comments
from physgen.scene.yaml_edit import mark_values, write, written_anew

USUAL = ("friction", "elasticity")
"""Numbers that the file omits at their defaults, the values of an unknown material."""

SCHEMA = "scene-1.schema.json"
"""A copy in the assets lets editors complete and check the scene offline and at any
path.
"""

BARE = {"mask", "from", "confidence"}
"""Keys of an object that the user took from `doubtful:` or gave by its mask alone; a
refresh adds the other keys.
"""


def write_scene(
    perceived: PerceivedScene,
    photo: Path | None,
    name: str,
    output: Path | None,
    keep: Keep = ignore_kept_file,
    before: str | None = None,
    known: Record = UNKNOWN,
    stdout: Path | None = None,
) -> str:
    """Write the assets, and the scene file if `output` is given; return the scene's
    text.

    `before` is the text of a refreshed scene: its lines, comments and shapes stay
    unless their values are new; `known` is its record.

    Assets go to `OUTPUT-STEM.assets/` beside the scene. Without `output` they go to the
    folder of the file `stdout`, which the caller writes, or to `NAME.assets/` in the
    current folder. Assets of another scene are not overwritten; the new ones then go to
    `OUTPUT-STEM-2.assets/`.

    `photo` is the photo's file, or None if a scene cannot name it. In that case, and if
    the file is outside the scene's folder, its pixels are written as `NAME.png`; a copy
    of the file would contain the place where the photo was taken. Existing files with
    other content are kept as `NAME~`, and `keep` is called with them.
    """
    target = output or stdout or Path(f"{name}.yaml")
    folder = target.parent
    inside = photo is not None and photo.resolve().is_relative_to(folder.resolve())
    # A copy of the pixels does not contain the photo's metadata, such as the place.
    copy = "" if inside else _free_of_maps(f"{name}.png")
    heads = ("physgen", "image", "assets", "maps")
    body = {key: value for key, value in perceived.document.items() if key not in heads}
    old: dict[str, Any] = {} if before is None else mark_values(before).data()
    body["objects"], outlines = short_entries(
        body["objects"],
        perceived.percepts.labels,
        old.get("objects", {}),
        perceived.wholes,
    )

    def written(assets: Path) -> str:
        """Return the scene's text with the assets in this folder."""
        image = assets / copy if copy or photo is None else photo
        head = {
            "physgen": 1,
            "image": _relative(image, folder),
            "assets": _relative(assets, folder),
        }
        modeline = _relative(assets / SCHEMA, folder)
        if before is None:
            return scene_text(head | body, perceived.comments, schema=modeline)
        text = _rewritten(before, old, head | body, perceived, known)
        return re.sub(
            r"\A# yaml-language-server: .*",
            f"# yaml-language-server: $schema={modeline}",
            text,
        )

    # An existing folder may belong to another scene.
    assets, existing_folder = free_folder(target)
    if output is not None:
        is_same_scene = (
            existing_folder
            and output.is_file()
            and written(existing_folder).encode() == output.read_bytes()
        )
        folder.mkdir(parents=True, exist_ok=True)
    else:
        is_same_scene = existing_folder and not any(
            existing_folder.name.encode() in scene_file.read_bytes()
            for scene_file in folder.glob("*.yaml")
        )
    assets = existing_folder if existing_folder and is_same_scene else assets
    file_names = {*(f"{name}.png" for name in MAPS), OUTLINES, OVERVIEW, SCHEMA}
    for file, crc in read_recorded(assets, "files").items():
        if (
            file in file_names
            and (assets / file).is_file()
            and crc32((assets / file).read_bytes()) == crc
        ):
            # Delete only files with unchanged content: users may have painted in a map.
            (assets / file).unlink()
    # The maps come first, because the record lists their ranges.
    ranges = write_assets(perceived.percepts, assets, keep)
    if copy:
        write_png(assets / copy, perceived.percepts.rgb, keep)
    description = perceived.description
    if description is not None:
        write_with_backup(assets / OVERVIEW, description.overview, keep)
    write_with_backup(assets / OUTLINES, outlines.encode(), keep)
    write_with_backup(assets / SCHEMA, resource("schemas", SCHEMA).read_bytes(), keep)
    per_meter = stated_scale(perceived.document)
    slow = slow_motion(max(perceived.percepts.labels.shape), per_meter)
    # The record tells a later refresh which values are perception's.
    record: dict[str, Any] = {
        "physgen": __version__,
        "steps": list(perceived.record),
        "objects": {
            str(item["mask"]): item | perceived.wrote.get(name, {})
            for name, item in perceived.document["objects"].items()
            if "mask" in item
        },
        "world": {"pixels_per_meter": per_meter, "slow": slow}
        | {
            "view": perceived.document["world"].get("view"),
            "view_from": perceived.view_from,
        }
        | {"boundaries": body.get("boundaries", {})}
        | perceived.wrote.get("", {}),
        "maps": ranges,
        "comments": sorted(
            known.comments
            | {
                " ".join(line.split())
                for words in perceived.comments.values()
                for line in words.split("\n")
            }
        ),
    }
    if perceived.full_size is not None:
        name_of_photo = copy if photo is None else copy or photo.name
        record["photo"] = {"image": name_of_photo, "size": list(perceived.full_size)}
    if (suits := perceived.suitability) is not None:
        record["suitability"] = {
            "verdict": suits.verdict,
            "reasons": list(suits.reasons),
        }
    if description is not None:
        record["summary"] = list(description.summary)
    asset_files = sorted(file for file in assets.iterdir() if file.name in file_names)
    # Checksums tell unchanged files from files edited by the user.
    record["files"] = {file.name: crc32(file.read_bytes()) for file in asset_files}
    write_atomic(
        assets / RECORD, json.dumps(record, ensure_ascii=False).encode() + b"\n"
    )
    # The scene file comes last, so that an interrupted run leaves the old scene intact.
    text = written(assets)
    note_files(assets, {*file_names, RECORD, copy} - {""})
    if output is None:
        note_scene(target, text.encode("utf-8"))
    else:
        save_scene(output, text.encode("utf-8"), keep)
    return text


def _rewritten(
    text: str,
    old: Mapping[str, Any],
    new: dict[str, Any],
    perceived: PerceivedScene,
    known: Record,
) -> str:
    """Return the text with new data, and with comments on new values and new reasons.

    Comments of perception on values of the user are removed. Objects that consist of a
    mask alone, and new boundaries, are written as in a new file.
    """
    objects, has_changes = (
        old.get("objects", {}),
        old.get("objects", {}).keys() != new["objects"].keys(),
    )
    bare_names = {
        name for name, old_sources in objects.items() if old_sources.keys() <= BARE
    }
    new_keys = {
        key for key in perceived.comments if value_at(new, key) != value_at(old, key)
    }
    new_keys |= {
        key for key in perceived.comments if bare_names & set(key.split(".")[1:2])
    }
    new_keys -= set() if has_changes else {"objects"}
    removed_keys = (
        ["world.pixels_per_meter"] if perceived.wrote.get("", {}).get("given") else []
    )
    # The file already describes how these objects were found.
    unchanged_keys = []
    for name, item in perceived.document["objects"].items():
        wrote, sources = known.entry(name, item), item.get("from", {})
        old_sources = wrote.get("from", {})
        user_keys = {
            key
            for key in ("label", "mass", "friction")
            if key in old_sources and key not in sources
        }
        removed_keys += [
            f"objects.{name}.{key}"
            for key in user_keys | perceived.wrote.get(name, {}).keys()
        ]
        removed_keys += (
            [] if any(item.get("velocity", ())) else [f"objects.{name}.velocity"]
        )
        if old_sources.get("mask") == sources.get("mask") and wrote.get(
            "label"
        ) == item.get("label"):
            unchanged_keys += [
                key
                for part in ("mask", "mass")
                if (key := f"objects.{name}.{part}") not in new_keys
            ]
        else:
            has_changes = True
    unchanged_keys += [] if has_changes else ["objects"]
    comments = {
        key: words
        for key, words in perceived.comments.items()
        if key not in (*removed_keys, *unchanged_keys)
    }
    for section, names in (
        ("objects", bare_names),
        ("boundaries", old.get("boundaries", {})),
    ):
        for name in names:
            sources = new.get(section, {}).get(name)
            if sources is not None and sources != old[section][name]:
                text = written_anew(text, (section, name), sources)
    text = without_comments(
        write(text, new), [key.split(".") for key in removed_keys], known.comments
    )
    return with_comments(text, comments, known.comments, new_keys)


def value_at(document: Mapping[str, Any], key: str) -> object:
    """Return the value at a dotted key, or None."""
    value: Any = document
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def short_entries(
    objects: Mapping[str, Any],
    labels: Labels,
    written: Mapping[str, Any],
    wholes: Mapping[int, Outline] = MappingProxyType({}),
) -> tuple[dict[str, Any], str]:
    """Return the objects as the file has them, and the text of `outlines.json`.

    `outlines.json` holds shapes, solids and `wholes`, by mask id. The file omits shape,
    solid, `from` and defaults, except if it was `written` with them or the object's
    mask is not an id.
    """
    short, stored_shapes, usual = (
        {},
        [],
        (schema_at(("objects", "")) or {})["properties"],
    )
    for name, item in objects.items():
        written_entry, mask = written.get(name, {}), item.get("mask")
        if "shape" in item and "shape" not in written_entry and isinstance(mask, int):
            shape_keys = ["shape"] if "solid" in written_entry else ["shape", "solid"]
            entry = {"crc": mask_crc(labels, mask)} | {
                key: item[key] for key in shape_keys if key in item
            }
            if mask in wholes:
                entry["whole"] = shape_entry(wholes[mask])
            stored_shapes.append(f"{json.dumps(str(mask))}: {json.dumps(entry)}")
            item = {key: value for key, value in item.items() if key not in shape_keys}
        short[name] = {
            key: value
            for key, value in item.items()
            if key in written_entry
            or (key != "from" and (key not in USUAL or value != usual[key]["default"]))
        }
    return short, "{\n" + ",\n".join(stored_shapes) + "\n}\n"


def _free_of_maps(name: str) -> str:
    """Return a name for the photo, different from all maps of the assets."""
    map_names = {*MAPS, Path(OVERVIEW).stem}
    return f"photo-{name}" if Path(name).stem.lower() in map_names else name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
