"""A corrected mask: the maps, shapes and numbers that follow from it, written as one
edit.

Values of the user stay. Maps are computed again only around the changed pixels: all
other pixels stay as they are stored, so that paint by hand or by a model elsewhere is
preserved. Boundaries stay at their places.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.arrays import F32
from physgen.compile.shapes import U16, mask_crc, snapped_to_boundaries
from physgen.compile.world import Body
from physgen.edit.live import Live
from physgen.edit.masks import PromptSegmenter, count, make, parse_op
from physgen.edit.object_entries import (
    Correction,
    Data,
    Mask,
    begin,
    changed_entry,
    joined_mass,
    table_keys,
    write_operations,
)
from physgen.edit.operations import apply_operations
from physgen.files import free_folder, write_atomic
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import translated_outline
from physgen.geometry.scale import photo_object
from physgen.maps import U8, Percepts, png_bytes
from physgen.messages import Message
from physgen.perceive import document, shape_entries
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import SMALLEST_OBJECT, BoundaryGuess, PhotoObject
from physgen.photos import read_channels
from physgen.problems import EditError, InputError
from physgen.scene.files import OUTLINES, OVERVIEW, RECORD, read_record
from physgen.scene.scene import MaskId
from physgen.scene.yaml_comments import without_comments

Window = tuple[slice, slice]
"""Slices of rows and columns."""

AROUND = 128
"""Margin around the changed pixels, px; for larger changes, half their size."""
SOFT = 10
"""Distance from a mask's border within which coverage changes, px; see `matte_edge`."""
PATCHED_AROUND = 6
"""Margin around a mask, px, within which the background is filled again: its border may
have coloured these pixels.
"""
LARGE = 4_000_000
"""Number of pixels of a photo above which maps are compressed less, in a third of the
time.
"""


@dataclass(frozen=True)
class CorrectionResult:
    """The result of a correction: the new text and its name in the history.

    `new_name` is the name of a new object, `folder` the folder of new maps, if any.
    """

    text: str
    title: str
    new_name: str | None = None
    folder: Path | None = None
    changed_name: str | None = None
    """The object with a changed mask, if no object is new."""


@dataclass(frozen=True)
class PaintedMaps:
    """The pixels of all objects after a correction, and masks.png before and
    after it.
    """

    labels: U16  # (H, W): ids of `ids`, 0 for the background
    ids: Mapping[str, int]
    stored_ids: Mapping[str, int]
    """Ids in masks.png by name, for the objects with a mask stored there from
    now on.
    """
    before: U16
    """(H, W): masks.png without its doubtful regions, which stay; zeros without
    file.
    """
    after: U16
    changed_mask: Mask  # (H, W): pixels of the corrected objects before or after
    union: Mask  # (H, W): pixels of all objects after, also of those left out
    union_before: Mask


def correct(
    live: Live,
    text: str,
    op: Mapping[str, Any],
    segmenter: PromptSegmenter | None = None,
) -> CorrectionResult:
    """Apply one operation on masks; docs/editor.md describes the operations.

    If maps change, the new text names a new folder for all maps, in which unchanged
    maps are linked. Raises EditError if the operation is impossible; no file is left
    behind then.
    """
    mask_op = parse_op(op)
    map_folder: Path | None = None
    try:
        correction = begin(live, text)
        title = make(correction, mask_op, segmenter or PromptSegmenter())
        if correction.masks or correction.new_masks:
            map_folder = _linked_maps(correction.scene.assets, live.path)
            _finish(correction, map_folder)
        new_text = _corrected_text(correction)
        bodies = live.state(new_text).compiled_scene.world.bodies
        if correction.merged_names:
            title += _masses(correction, bodies)
    except BaseException as error:
        # The folder is new and no text names it yet.
        if map_folder is not None:
            shutil.rmtree(map_folder, ignore_errors=True)
        if isinstance(error, InputError):
            raise _impossible_edit(error) from error
        raise
    new_name = next(iter(correction.new_masks), None)
    changed_name = next(iter(correction.masks), None)
    return CorrectionResult(
        new_text,
        title,
        new_name,
        map_folder,
        changed_name if new_name is None else None,
    )


def _corrected_text(correction: Correction) -> str:
    """Return the text of the scene after a correction."""
    text = apply_operations(correction.text, correction.ops).text
    # Comments of perception about values that changed are no longer true: remove them.
    own_comments = correction.scene.record.comments
    changed_paths = []
    for op in correction.ops:
        if "set" in op:
            changed_paths.append(op["set"])
    changed_paths += [["objects", name, "mask"] for name in correction.masks]
    return without_comments(text, changed_paths, own_comments)


def _masses(correction: Correction, bodies: Sequence[Body]) -> str:
    """Return the masses of merged objects as a part of a title."""
    texts = []
    for body in bodies:
        if body.name in correction.masks:
            texts.append(f" ({body.mass:,.4g} g)")
    return "".join(texts)


def _impossible_edit(error: InputError) -> EditError:
    """Return the error of an edit that would make a problem."""
    problem = error.problems[0]
    reason = f"{problem.path or 'the scene'} {problem.found} {problem.expected}"
    return Message.EDIT_MAKES_PROBLEM.impossible(reason=reason, fix=problem.fix)


def _linked_maps(assets: Path | None, path: Path) -> Path:
    """Create a folder beside the scene with hard links to all files of its assets.

    On another disk, files are copied. The overview is left out, since it shows the
    masks of perception.
    """
    folder = free_folder(path)[0]
    folder.mkdir()
    for file in assets.iterdir() if assets is not None and assets.is_dir() else ():
        if file.is_file() and file.name != OVERVIEW:
            try:
                # A hard link to a symbolic link would depend on the old folder.
                os.link(os.path.realpath(file), folder / file.name)
            except OSError:
                shutil.copyfile(file, folder / file.name)
    return folder


def _finish(work: Correction, out: Path) -> None:
    """Write the maps, and add the operations on the text that follow from the new
    masks.
    """
    painting = _paint(work)
    work.ops.append({"set": ["assets"], "value": out.name})
    objects = _photo_objects(work, painting)
    entries: dict[str, Data] = {}
    for name, new_object in objects.items():
        entry = _entry(work, name, new_object, painting.labels)
        _set_provenance(work, name, entry)
        entry["mask"] = painting.stored_ids[name]
        entries[name] = {
            **entry,
            "shape": shape_entries.shape_entry(new_object.outline),
        }
        work.ops += (
            [{"add": ["objects", name], "value": entry}]
            if name in work.new_masks
            else write_operations(work, name, entry)
        )
    # The paint of a correction would be hidden by an outline in the file: such objects
    # get a mask in masks.png, too.
    for name in painting.stored_ids.keys() - objects.keys():
        work.ops.append(
            {"set": ["objects", name, "mask"], "value": painting.stored_ids[name]}
        )
    _write_maps(work, out, painting, list(objects.values()))
    _write_record(out, entries, painting.after)


def _write_record(folder: Path, entries: Mapping[str, Data], labels: U16) -> None:
    """Write the corrected objects into the outlines and the record of perception, if
    present.

    Both files tell a later run of perception which values are its own: without the
    correction, it would take the new values for the user's.
    """
    for file in (OUTLINES, RECORD):
        content = read_record(folder / file)
        records: Any = content
        if file != OUTLINES:
            records = content.get("objects")
        if not isinstance(records, dict) or not records:
            continue
        for entry in entries.values():
            id_ = str(entry["mask"])
            old_record: Data
            if isinstance(records.get(id_), dict):
                old_record = records[id_]
            else:
                old_record = {}
            # A velocity that differs from the record counts as the user's.
            if file == RECORD:
                records[id_] = {"velocity": [0, 0], **old_record, **entry} | {
                    "velocity": old_record.get("velocity", [0, 0])
                }
            else:
                if "solid" in entry:
                    solid = {"solid": entry["solid"]}
                else:
                    solid = {}
                outline_record = {
                    "crc": mask_crc(labels, entry["mask"]),
                    "shape": entry["shape"],
                }
                records[id_] = {
                    **{key: old_record[key] for key in old_record.keys() & {"solid"}},
                    **solid,
                    **outline_record,
                }
        write_atomic(
            folder / file, json.dumps(content, ensure_ascii=False).encode() + b"\n"
        )


def _paint(work: Correction) -> PaintedMaps:
    """Paint the label maps after the correction. Raises EditError."""
    labels = work.labels
    before = work.maps.cut_out
    # Ids count from 1, as in the compiled label map.
    ids = {item.name: k + 1 for k, item in enumerate(work.scene.objects)}
    for name in work.new_masks:
        ids[name] = len(ids) + 1
    after = _paint_labels(work, ids)
    repainted_names = [*work.masks, *work.new_masks, *_covered_names(work, ids, after)]
    stored_ids = _stored_ids(work, repainted_names)
    cleared_names = [*repainted_names, *work.merged_names]
    masks_png = _clear_masks(before, work, cleared_names)
    for name, id_ in stored_ids.items():
        masks_png[after == ids[name]] = id_
    # Boundaries in masks.png are part of the background, not of the union of objects.
    is_movable = ~work.sight.compiled_scene.scenery
    old_ids = [ids[name] for name in (*work.masks, *work.merged_names)]
    new_ids = [ids[name] for name in (*work.masks, *work.new_masks)]
    return PaintedMaps(
        labels=after,
        ids=ids,
        stored_ids=stored_ids,
        before=before,
        after=masks_png,
        changed_mask=np.isin(labels, old_ids) | np.isin(after, new_ids),
        union=(after > 0) | ((masks_png > 0) & is_movable),
        union_before=(labels > 0) | ((before > 0) & is_movable),
    )


def _clear_masks(masks_png: U16, work: Correction, names: Sequence[str]) -> U16:
    """Return masks.png (H, W) without the masks of these objects."""
    mask_ids = _mask_ids(work)
    cleared_ids = []
    for name in names:
        if name in mask_ids:
            cleared_ids.append(mask_ids[name])
    result = masks_png.copy()
    result[np.isin(masks_png, cleared_ids)] = 0
    return result


def _paint_labels(work: Correction, ids: Mapping[str, int]) -> U16:
    """Return the label map (H, W) after the correction."""
    # Clear all changed objects first: a pixel belongs to the object painted last.
    cleared_ids = [ids[name] for name in (*work.masks, *work.merged_names)]
    labels = work.labels.copy()
    labels[np.isin(work.labels, cleared_ids)] = 0
    for name, mask in (*work.masks.items(), *work.new_masks.items()):
        labels[mask] = ids[name]
    return labels


def _covered_names(work: Correction, ids: Mapping[str, int], after: U16) -> list[str]:
    """Return the other objects with an outline of which paint covers a part.

    Raises EditError if too little of an object is left.
    """
    names = []
    for item in work.scene.objects:
        if item.name in work.masks or item.name in work.merged_names:
            continue
        old_pixels = work.labels == ids[item.name]
        new_pixels = after == ids[item.name]
        smallest_size = min(count(old_pixels), SMALLEST_OBJECT)
        if old_pixels.any() and count(new_pixels) < smallest_size:
            raise Message.NOTHING_LEFT.impossible(name=item.name)
        # An outline in the file would be drawn over the new paint: store the
        # remaining pixels of the object as a mask.
        has_mask = isinstance(item.mask, MaskId)
        if not has_mask and (old_pixels != new_pixels).any():
            names.append(item.name)
    return names


def _mask_ids(work: Correction) -> dict[str, int]:
    """Return the ids of objects in masks.png, by name."""
    ids = {}
    for item in work.scene.objects:
        if isinstance(item.mask, MaskId):
            ids[item.name] = item.mask.id
    return ids


def _stored_ids(work: Correction, names: Sequence[str]) -> dict[str, int]:
    """Return the ids in masks.png of repainted objects: their own, or free ones.

    Raises EditError if no id is left.
    """
    mask_ids = _mask_ids(work)
    # Ids of boundaries count, too: masks.png stores them with those of objects.
    used_ids = {int(work.maps.labels.max()), *mask_ids.values()}
    for boundary in work.scene.boundaries:
        if isinstance(boundary.mask, MaskId):
            used_ids.add(boundary.mask.id)
    free_ids = iter(range(max(used_ids) + 1, 65536))
    stored_ids: dict[str, int] = {}
    for name in names:
        id_ = mask_ids.get(name)
        if id_ is None:
            id_ = next(free_ids, None)
        if id_ is None:
            raise Message.NO_ID_LEFT.impossible()
        stored_ids[name] = id_
    return stored_ids


def _photo_objects(
    work: Correction, painted_maps: PaintedMaps
) -> dict[str, PhotoObject]:
    """Fit new outlines to the corrected objects by name, and set them on their
    supports.
    """
    names = (*work.masks, *work.new_masks)
    ids = [painted_maps.ids[name] for name in names]
    fits = fit_outlines(painted_maps.labels, ids)
    outlines = snapped_to_boundaries(
        work.scene, tuple(fits[i] for i in ids), [True] * len(ids)
    )
    return {
        name: photo_object(i, outline, _label(work, name), work.scene.size)
        for name, i, outline in zip(names, ids, outlines, strict=True)
    }


def _label(work: Correction, name: str) -> str:
    """Return the label of an object; a new part has the label of the divided object."""
    if name in work.entries:
        return str(work.entries[name]["label"])
    if name in work.masks:
        source = name
    else:
        source = next(iter(work.masks))
    return work.scene.objects[work.index(source)].label


def _entry(work: Correction, name: str, photo_object: PhotoObject, labels: U16) -> Data:
    """Return the entry of a corrected object with the numbers that follow from its
    shape.

    Halves share a mass in proportion to their areas; the masses of merged objects add
    up.
    """
    if name in work.entries:
        return dict(work.entries[name]) | {
            "shape": shape_entries.shape_entry(photo_object.outline)
        }
    if name in work.masks:
        source = name
    else:
        source = next(iter(work.masks))
    entry = changed_entry(work, source, name, photo_object, labels)
    old_entry = work.old_entry(source)
    # Only a mass of the user is shared or added: one of the table follows from the
    # area.
    if "mass" in old_entry and "mass" not in table_keys(old_entry):
        if work.merged_names:
            entry["mass"] = float(
                f"{joined_mass(work, source, *work.merged_names):.4g}"
            )
        elif work.new_masks:
            share = count(labels == photo_object.id) / max(count(work.mask(source)), 1)
            entry["mass"] = float(f"{joined_mass(work, source) * share:.4g}")
    return entry


def _set_provenance(work: Correction, name: str, entry: Data) -> None:
    """Set `from` and `prompt` to the source of the mask; a mask drawn by a user has no
    source.
    """
    sources = {}
    for key, value in (entry.pop("from", None) or {}).items():
        if key != "mask":
            sources[key] = value
    # The old prompt found the old mask.
    entry.pop("prompt", None)
    if name in work.prompts:
        confidence, prompt = work.prompts[name]
        sources = {"mask": document.provenance("pointed at", confidence), **sources}
        entry["prompt"] = prompt
    if sources:
        entry["from"] = sources


# Maps


@dataclass(frozen=True)
class _ChangedPart:
    """The window of the maps that a correction changes, (h, w)."""

    window: Window
    percepts: Percepts
    """Previous maps."""
    changed_mask: Mask
    """Pixels of the corrected objects before or after."""
    union: Mask
    """Pixels of all objects after."""
    border_band: Mask
    """Pixels around the changed border of the union."""


def _write_maps(
    work: Correction,
    folder: Path,
    painted_maps: PaintedMaps,
    objects: Sequence[PhotoObject],
) -> None:
    """Write the maps that change into `folder`, which contains links to the previous
    maps.
    """
    _write_masks(folder, painted_maps, work.maps.labels)
    part = _changed_part(work.maps, painted_maps)
    if part.percepts.coverage is not None and part.border_band.any():
        _write_colours(folder, part, part.percepts.coverage)
    if part.percepts.normals is not None and objects:
        guess = BoundaryGuess(work.scene.world.view, 0.0, "", ())
        _write_normals(folder, part, painted_maps.labels[part.window], objects, guess)


def _write_masks(folder: Path, painted_maps: PaintedMaps, labels: U16) -> None:
    """Write masks.png if it changes; `labels`: the previous one with its doubtful
    regions.
    """
    path = folder / "masks.png"
    if path.is_file() and not (painted_maps.before != painted_maps.after).any():
        return
    doubtful_labels = np.where(painted_maps.before == 0, labels, np.uint16(0))
    _write_map(
        path, np.where(painted_maps.after == 0, doubtful_labels, painted_maps.after)
    )


def _changed_part(maps: Percepts, painted_maps: PaintedMaps) -> _ChangedPart:
    """Return the window of the maps that a correction changes."""
    window = _window(
        painted_maps.changed_mask | (painted_maps.union != painted_maps.union_before)
    )
    map_parts: dict[str, Any] = {}
    for one in fields(maps):
        values = getattr(maps, one.name)
        if values is None:
            map_parts[one.name] = None
        else:
            map_parts[one.name] = values[window]
    union = painted_maps.union[window]
    # A matte is slow and soft: it is computed only in a band around the changed border.
    border_band = dilate(union != painted_maps.union_before[window], SOFT)
    percepts = Percepts(**map_parts)
    return _ChangedPart(
        window, percepts, painted_maps.changed_mask[window], union, border_band
    )


def _write_colours(folder: Path, part: _ChangedPart, old_coverage: F32) -> None:
    """Write the coverage around the changed border, and the backgrounds behind it."""
    percepts = part.percepts
    new_values = registry.make("matte")(
        np.ascontiguousarray(percepts.rgb), part.union.astype(np.uint16)
    )
    coverage = np.where(part.border_band, new_values, old_coverage)
    _patch(folder / "coverage.png", part.window, part.border_band, coverage)
    changed_pixels = dilate(part.changed_mask, PATCHED_AROUND) | part.border_band
    hole = changed_pixels & (coverage > 0)
    pictures = {"background": percepts.background, "clean": percepts.clean}
    for name, picture in pictures.items():
        if picture is None:
            continue
        # The fill sees only the window: pixels that no object covers now are
        # background.
        filled_picture = np.where((coverage == 0)[..., None], percepts.rgb, picture)
        # Pixels that no object covered before keep their values: in the clean
        # background, their shadows have been removed.
        filled_picture = np.where(
            (old_coverage == 0)[..., None], picture, filled_picture
        )
        if hole.any():
            fill = registry.make("inpaint")(np.ascontiguousarray(filled_picture), hole)
            filled_picture = np.where(hole[..., None], fill, filled_picture)
        values = filled_picture / np.float32(255)
        _patch(folder / f"{name}.png", part.window, changed_pixels, values)


def _write_normals(
    folder: Path,
    part: _ChangedPart,
    labels: U16,
    objects: Sequence[PhotoObject],
    guess: BoundaryGuess,
) -> None:
    """Write the normals of the corrected objects; `labels` (h, w) after the
    correction.
    """
    # The backend of normals sees only the window, hence the outlines move into its
    # frame.
    rows, columns = part.window
    offset = -np.array([columns.start, rows.start], np.float64)
    labels = np.ascontiguousarray(labels)
    shifted_objects = []
    for one in objects:
        shifted_objects.append(
            replace(one, outline=translated_outline(one.outline, offset))
        )
    normals = registry.make("normals")(
        np.ascontiguousarray(part.percepts.rgb), labels, shifted_objects, guess
    )
    is_uncovered = part.changed_mask & (labels == 0)
    changed_pixels = np.isin(labels, [one.id for one in objects]) | is_uncovered
    _patch(folder / "normals.png", part.window, changed_pixels, normals, is_signed=True)


def _window(mask: Mask) -> Window:
    """Return the slices of a mask's (H, W) bounding box with a margin; of all for no
    pixel.
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    # The surroundings grow with the object, since its shadow and reflections do.
    margin = max(
        AROUND, int(rows[-1] - rows[0]) // 2, int(columns[-1] - columns[0]) // 2
    )
    return tuple(  # type: ignore[return-value]
        slice(
            max(0, int(indices[0]) - margin), min(side, int(indices[-1]) + margin + 1)
        )
        for indices, side in zip((rows, columns), mask.shape, strict=True)
    )


def _write_map(path: Path, picture: U8 | U16) -> None:
    """Write a picture, (H, W) or (H, W, 3) RGB, as a new file under its name.

    The new file replaces the link; the linked file of the previous assets stays.
    """
    write_atomic(
        path,
        png_bytes(picture, 1 if picture.shape[0] * picture.shape[1] > LARGE else 4),
    )


def _patch(
    path: Path,
    part: Window,
    mask: Mask,
    values: NDArray[Any],
    *,
    is_signed: bool = False,
) -> None:
    """Write values into a window of a stored map, in the depth of its file.

    `values`: 0..1, or -1..1 if `is_signed`; `mask` (h, w): the pixels to change.
    """
    old_values = read_channels(path)
    if old_values.ndim == 3:
        if values.ndim == 3:
            old_values = old_values[:, :, :3]
        else:
            old_values = old_values[:, :, 0]
    old_values = old_values.copy()
    largest_value = np.iinfo(old_values.dtype).max
    middle = 0
    if is_signed:
        middle = (largest_value + 1) // 2
    encoded_values = np.clip(
        np.rint(values * (middle - 1 if is_signed else largest_value)) + middle,
        0,
        largest_value,
    ).astype(old_values.dtype)
    # A file without changes stays a link to the previous one.
    if (encoded_values[mask] != old_values[part][mask]).any():
        old_values[part][mask] = encoded_values[mask]
        _write_map(path, old_values)
