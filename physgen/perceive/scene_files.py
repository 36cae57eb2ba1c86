"""Write a perceived scene: the scene file and its assets."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
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

HEAD_KEYS = ("physgen", "image", "assets", "maps")
"""Keys at the head of a file, with paths."""

BARE = {"mask", "from", "confidence"}
"""Keys of an object that the user took from `doubtful:` or gave by its mask alone; a
refresh adds the other keys.
"""


def write_scene(
    scene: PerceivedScene,
    photo: Path | None,
    name: str,
    output: Path | None,
    keep: Keep = ignore_kept_file,
    old_text: str | None = None,
    record: Record = UNKNOWN,
    stdout: Path | None = None,
) -> str:
    """Write the assets, and the scene file if `output` is given; return the scene's
    text.

    `old_text` is the text of a refreshed scene: its lines, comments and shapes stay
    unless their values are new; `record` is the record of that scene.

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
    draft = _SceneDraft.of(scene, photo, name, target.parent, old_text, record)
    if output is not None:
        target.parent.mkdir(parents=True, exist_ok=True)
    assets = _choose_assets(draft, target, output)
    asset_names = {*(f"{name}.png" for name in MAPS), OUTLINES, OVERVIEW, SCHEMA}
    _remove_unchanged_files(assets, asset_names)
    ranges = _write_asset_files(draft, assets, keep)
    _write_record(draft, assets, ranges, asset_names)
    # The scene file comes last, so that an interrupted run leaves the old scene intact.
    text = draft.text(assets)
    note_files(assets, {*asset_names, RECORD, draft.photo_copy} - {""})
    if output is None:
        note_scene(target, text.encode("utf-8"))
    else:
        save_scene(output, text.encode("utf-8"), keep)
    return text


@dataclass(frozen=True)
class _SceneDraft:
    """A perceived scene before the choice of its assets folder."""

    scene: PerceivedScene
    folder: Path
    """Folder of the scene file."""
    photo: Path | None
    photo_copy: str
    """Name of the copy of the photo in the assets, or `""`."""
    body: dict[str, Any]
    """The scene's data, without the paths at its head."""
    outlines: str
    """Text of `outlines.json`."""
    old_text: str | None
    old_data: dict[str, Any]
    record: Record
    """The record of the refreshed scene."""

    @classmethod
    def of(
        cls,
        scene: PerceivedScene,
        photo: Path | None,
        name: str,
        folder: Path,
        old_text: str | None,
        record: Record,
    ) -> _SceneDraft:
        """Return the draft of a scene file in a folder."""
        is_inside = photo is not None and photo.resolve().is_relative_to(
            folder.resolve()
        )
        # A copy of the pixels does not contain the photo's metadata, such as the place.
        if is_inside:
            photo_copy = ""
        else:
            photo_copy = _free_of_maps(f"{name}.png")
        body = {}
        for key, value in scene.document.items():
            if key not in HEAD_KEYS:
                body[key] = value
        old_data: dict[str, Any] = {}
        if old_text is not None:
            old_data = mark_values(old_text).data()
        body["objects"], outlines = short_entries(
            body["objects"],
            scene.percepts.labels,
            old_data.get("objects", {}),
            scene.wholes,
        )
        return cls(
            scene,
            folder,
            photo,
            photo_copy,
            body,
            outlines,
            old_text,
            old_data,
            record,
        )

    def text(self, assets: Path) -> str:
        """Return the scene's text with the assets in this folder."""
        image = self.photo
        if image is None or self.photo_copy:
            image = assets / self.photo_copy
        head = {
            "physgen": 1,
            "image": _relative(image, self.folder),
            "assets": _relative(assets, self.folder),
        }
        schema = _relative(assets / SCHEMA, self.folder)
        data = head | self.body
        if self.old_text is None:
            return scene_text(data, self.scene.comments, schema=schema)
        text = _rewrite_text(
            self.old_text, self.old_data, data, self.scene, self.record
        )
        return re.sub(
            r"\A# yaml-language-server: .*",
            f"# yaml-language-server: $schema={schema}",
            text,
        )


def _choose_assets(draft: _SceneDraft, target: Path, output: Path | None) -> Path:
    """Return the folder for the assets of a scene file.

    An existing folder may belong to another scene; then the result is a new folder.
    """
    free_assets, existing_assets = free_folder(target)
    if not existing_assets:
        return free_assets
    if output is not None:
        if not output.is_file():
            return free_assets
        is_same_scene = draft.text(existing_assets).encode() == output.read_bytes()
        if is_same_scene:
            return existing_assets
        return free_assets
    # The text goes to the standard output, so that no scene file tells whose they are.
    for scene_file in target.parent.glob("*.yaml"):
        if existing_assets.name.encode() in scene_file.read_bytes():
            return free_assets
    return existing_assets


def _remove_unchanged_files(assets: Path, file_names: Collection[str]) -> None:
    """Delete old files of an assets folder.

    Files with other content stay: users may have painted in a map.
    """
    for file_name, crc in read_recorded(assets, "files").items():
        file = assets / file_name
        if file_name not in file_names or not file.is_file():
            continue
        if crc32(file.read_bytes()) == crc:
            file.unlink()


def _write_asset_files(draft: _SceneDraft, assets: Path, keep: Keep) -> dict[str, Any]:
    """Write the maps and the other assets; return the ranges of the maps."""
    perceived = draft.scene
    ranges = write_assets(perceived.percepts, assets, keep)
    if draft.photo_copy:
        write_png(assets / draft.photo_copy, perceived.percepts.rgb, keep)
    if perceived.description is not None:
        write_with_backup(assets / OVERVIEW, perceived.description.overview, keep)
    write_with_backup(assets / OUTLINES, draft.outlines.encode(), keep)
    write_with_backup(assets / SCHEMA, resource("schemas", SCHEMA).read_bytes(), keep)
    return ranges


def _write_record(
    draft: _SceneDraft,
    assets: Path,
    ranges: Mapping[str, Any],
    file_names: Collection[str],
) -> None:
    """Write the record of the results.

    The record tells a later refresh which values are perception's.
    """
    perceived = draft.scene
    record: dict[str, Any] = {
        "physgen": __version__,
        "steps": list(perceived.record),
        "objects": _object_records(perceived),
        "world": _world_record(draft),
        "maps": ranges,
        "comments": sorted(draft.record.comments | _comment_lines(perceived)),
    }
    if perceived.full_size is not None:
        image = draft.photo_copy
        if not image and draft.photo is not None:
            image = draft.photo.name
        record["photo"] = {"image": image, "size": list(perceived.full_size)}
    suitability = perceived.suitability
    if suitability is not None:
        record["suitability"] = {
            "verdict": suitability.verdict,
            "reasons": list(suitability.reasons),
        }
    if perceived.description is not None:
        record["summary"] = list(perceived.description.summary)
    # Checksums tell unchanged files from files edited by the user.
    checksums = {}
    for file in sorted(assets.iterdir()):
        if file.name in file_names:
            checksums[file.name] = crc32(file.read_bytes())
    record["files"] = checksums
    text = json.dumps(record, ensure_ascii=False)
    write_atomic(assets / RECORD, text.encode() + b"\n")


def _object_records(scene: PerceivedScene) -> dict[str, Any]:
    """Return perception's entries of the objects, by mask id."""
    records = {}
    for name, item in scene.document["objects"].items():
        if "mask" in item:
            records[str(item["mask"])] = item | scene.wrote.get(name, {})
    return records


def _world_record(draft: _SceneDraft) -> dict[str, Any]:
    """Return perception's scale, view and boundaries."""
    perceived = draft.scene
    per_meter = stated_scale(perceived.document)
    record = {
        "pixels_per_meter": per_meter,
        "slow": slow_motion(max(perceived.percepts.labels.shape), per_meter),
        "view": perceived.document["world"].get("view"),
        "view_from": perceived.view_from,
        "boundaries": draft.body.get("boundaries", {}),
    }
    return record | perceived.wrote.get("", {})


def _comment_lines(scene: PerceivedScene) -> set[str]:
    """Return the lines of all comments, with single spaces."""
    lines = set()
    for comment in scene.comments.values():
        for line in comment.split("\n"):
            lines.add(" ".join(line.split()))
    return lines


def _rewrite_text(
    text: str,
    old_data: Mapping[str, Any],
    new_data: dict[str, Any],
    scene: PerceivedScene,
    record: Record,
) -> str:
    """Return the text with new data, and with comments on new values and new reasons.

    Comments of perception on values of the user are removed. Objects that consist of a
    mask alone, and new boundaries, are written as in a new file.
    """
    old_objects = old_data.get("objects", {})
    bare_names = set()
    for name, entry in old_objects.items():
        if entry.keys() <= BARE:
            bare_names.add(name)
    changes = _comment_changes(old_data, new_data, bare_names, scene, record)
    sections = {
        "objects": bare_names,
        "boundaries": old_data.get("boundaries", {}),
    }
    for section, names in sections.items():
        for name in names:
            entry = new_data.get(section, {}).get(name)
            if entry is not None and entry != old_data[section][name]:
                text = written_anew(text, (section, name), entry)
    removed_paths = [key.split(".") for key in changes.removed_keys]
    text = without_comments(write(text, new_data), removed_paths, record.comments)
    return with_comments(text, changes.comments, record.comments, changes.new_keys)


@dataclass(frozen=True)
class _CommentChanges:
    """Changes to the comments of a refreshed scene."""

    comments: dict[str, str]
    """Comments to write, by dotted path."""
    new_keys: set[str]
    """Dotted paths of new values."""
    removed_keys: list[str]
    """Dotted paths of values of the user."""


def _comment_changes(
    old_data: Mapping[str, Any],
    new_data: Mapping[str, Any],
    bare_names: Collection[str],
    scene: PerceivedScene,
    record: Record,
) -> _CommentChanges:
    """Return the changes to the comments by the values of old and new data."""
    old_objects = old_data.get("objects", {})
    has_changes = old_objects.keys() != new_data["objects"].keys()
    new_keys = _new_comment_keys(old_data, new_data, bare_names, scene.comments)
    if not has_changes:
        new_keys.discard("objects")
    removed_keys = []
    if scene.wrote.get("", {}).get("given"):
        removed_keys.append("world.pixels_per_meter")
    unchanged_keys = []
    for name, item in scene.document["objects"].items():
        old_item = record.entry(name, item)
        removed_keys += _user_keys(name, item, old_item, scene)
        # The file already describes the detection of these objects.
        if _has_same_detection(item, old_item):
            for part in ("mask", "mass"):
                key = f"objects.{name}.{part}"
                if key not in new_keys:
                    unchanged_keys.append(key)
        else:
            has_changes = True
    if not has_changes:
        unchanged_keys.append("objects")
    comments = {}
    for key, comment in scene.comments.items():
        if key not in removed_keys and key not in unchanged_keys:
            comments[key] = comment
    return _CommentChanges(comments, new_keys, removed_keys)


def _new_comment_keys(
    old_data: Mapping[str, Any],
    new_data: Mapping[str, Any],
    bare_names: Collection[str],
    comments: Mapping[str, str],
) -> set[str]:
    """Return the dotted paths of comments on new values or on bare objects."""
    new_keys = set()
    for key in comments:
        object_name = key.split(".")[1:2]
        is_bare = bool(object_name) and object_name[0] in bare_names
        if is_bare or value_at(new_data, key) != value_at(old_data, key):
            new_keys.add(key)
    return new_keys


def _user_keys(
    name: str,
    item: Mapping[str, Any],
    old_item: Mapping[str, Any],
    scene: PerceivedScene,
) -> list[str]:
    """Return the dotted paths of an object's values that belong to the user."""
    sources = item.get("from", {})
    old_sources = old_item.get("from", {})
    keys = set(scene.wrote.get(name, {}))
    for key in ("label", "mass", "friction"):
        if key in old_sources and key not in sources:
            keys.add(key)
    paths = [f"objects.{name}.{key}" for key in keys]
    if not any(item.get("velocity", ())):
        paths.append(f"objects.{name}.velocity")
    return paths


def _has_same_detection(item: Mapping[str, Any], old_item: Mapping[str, Any]) -> bool:
    """Return whether an object has the mask and the label of its old record."""
    sources = item.get("from", {})
    old_sources = old_item.get("from", {})
    has_same_mask = old_sources.get("mask") == sources.get("mask")
    return has_same_mask and old_item.get("label") == item.get("label")


def value_at(document: Mapping[str, Any], key: str) -> object:
    """Return the value at a dotted key, or None."""
    value: Any = document
    for part in key.split("."):
        if isinstance(value, Mapping):
            value = value.get(part)
        else:
            value = None
    return value


def short_entries(
    objects: Mapping[str, Any],
    labels: Labels,
    entries: Mapping[str, Any],
    wholes: Mapping[int, Outline] = MappingProxyType({}),
) -> tuple[dict[str, Any], str]:
    """Return the objects as the file has them, and the text of `outlines.json`.

    `outlines.json` holds shapes, solids and `wholes`, by mask id. The file omits shape,
    solid, `from` and defaults, except if it was `entries` with them or the object's
    mask is not an id.
    """
    short_objects = {}
    stored_shapes = []
    for name, item in objects.items():
        written_entry = entries.get(name, {})
        mask = item.get("mask")
        has_new_shape = "shape" in item and "shape" not in written_entry
        if has_new_shape and isinstance(mask, int):
            if "solid" in written_entry:
                shape_keys = ["shape"]
            else:
                shape_keys = ["shape", "solid"]
            entry: dict[str, Any] = {"crc": mask_crc(labels, mask)}
            for key in shape_keys:
                if key in item:
                    entry[key] = item[key]
            if mask in wholes:
                entry["whole"] = shape_entry(wholes[mask])
            stored_shapes.append(f"{json.dumps(str(mask))}: {json.dumps(entry)}")
            item = {key: value for key, value in item.items() if key not in shape_keys}
        short_objects[name] = _without_defaults(item, written_entry)
    return short_objects, "{\n" + ",\n".join(stored_shapes) + "\n}\n"


def _without_defaults(
    item: Mapping[str, Any], written_entry: Mapping[str, Any]
) -> dict[str, Any]:
    """Return an object without `from` and defaults, unless the file contained them."""
    properties = (schema_at(("objects", "")) or {})["properties"]
    result = {}
    for key, value in item.items():
        is_default = key in USUAL and value == properties[key]["default"]
        if key in written_entry or not (key == "from" or is_default):
            result[key] = value
    return result


def _free_of_maps(name: str) -> str:
    """Return a name for the photo, different from all maps of the assets."""
    map_names = {*MAPS, Path(OVERVIEW).stem}
    if Path(name).stem.lower() in map_names:
        return f"photo-{name}"
    return name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
