"""A corrected mask: the maps, shapes and numbers that follow from it, written as one edit.

What a user set stays. Maps are computed again only around what changed: all other pixels stay as they are stored, so
that what was painted by hand or made by a model elsewhere is kept. Boundaries stay where they are.
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
from physgen.compile.shapes import U16, mask_crc, snapped_to_boundaries
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
    written,
)
from physgen.edit.operations import edited
from physgen.files import free_folder, write_atomic
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import translated_outline
from physgen.geometry.scale import photo_object
from physgen.maps import U8, Percepts, png_bytes
from physgen.messages import Message
from physgen.perceive import document
from physgen.perceive.inpaint.poisson import dilate
from physgen.perceive.roles import SMALLEST_OBJECT, BoundaryGuess, PhotoObject
from physgen.photos import read_channels
from physgen.problems import InputError
from physgen.scene.files import OUTLINES, OVERVIEW, RECORD, read_record
from physgen.scene.scene import MaskId
from physgen.scene.yaml_comments import without_comments

Window = tuple[slice, slice]
"""Rows and columns."""

AROUND = 128
"""px beside what changes that are looked at, at least; or half its size."""
SOFT = 10
"""px from a mask's border within which coverage follows it; see `matte_edge`."""
PATCHED_AROUND = 6
"""px around a mask that its border may have coloured: the background is filled again up to there."""
LARGE = 4_000_000
"""px of a photo beyond which maps are compressed less, in a third of the time."""


@dataclass(frozen=True)
class Corrected:
    """A correction: the new text, its name for the history, the new object, and the folder of its maps, if any."""

    text: str
    what: str
    made: str | None = None
    folder: Path | None = None
    corrected: str | None = None
    """The object whose mask is another now, if none is new."""


@dataclass(frozen=True)
class Painted:
    """The pixels of all objects after a correction, and those of masks.png before and after."""

    labels: U16  # (H, W): ids as `ids` has them, 0 for none
    ids: Mapping[str, int]
    stored: Mapping[str, int]
    """By name, ids in masks.png of the objects whose mask is stored there from now on."""
    before: U16  # (H, W) of masks.png, without doubtful regions, which stay there; zeros where there is none
    after: U16
    touched: Mask  # (H, W): what the corrected objects covered, or cover now
    union: Mask  # (H, W): all that objects, also left-out ones, cover now
    union_before: Mask


def correct(
    live: Live,
    text: str,
    op: Mapping[str, Any],
    segmenter: PromptSegmenter | None = None,
) -> Corrected:
    """One operation on masks; see docs/editor.md. Where maps change, the new text names a new folder for all of them.

    Unchanged maps are linked. Raises EditError where it is impossible; then nothing is left behind.
    """
    parsed = parse_op(op)
    out: Path | None = None
    try:
        work = begin(live, text)
        what = make(work, parsed, segmenter or PromptSegmenter())
        if work.masks or work.fresh:
            out = _linked_maps(work.scene.assets, live.path)
            _finish(work, out)
        new = edited(work.text, work.ops).text
        ours = work.scene.record.comments
        stale = [op["set"] for op in work.ops if "set" in op]
        stale += [["objects", name, "mask"] for name in work.masks]
        new = without_comments(new, stale, ours)
        bodies = live.state(new).compiled.world.bodies
        if work.gone:
            what += "".join(
                f" ({one.mass:,.4g} g)" for one in bodies if one.name in work.masks
            )
    except BaseException as error:
        if out is not None:
            shutil.rmtree(out, ignore_errors=True)
        if isinstance(error, InputError):
            problem = error.problems[0]
            message = (
                f"{problem.path or 'the scene'} {problem.found} {problem.expected}"
            )
            raise Message.EDIT_MAKES_PROBLEM.impossible(
                reason=message, fix=problem.fix
            ) from error
        raise
    made, changed = next(iter(work.fresh), None), next(iter(work.masks), None)
    return Corrected(new, what, made, out, changed if made is None else None)


def _linked_maps(assets: Path | None, path: Path) -> Path:
    """A new folder beside the scene with all files of its assets under a second name, or copied to another disk.

    The overview stays behind: it shows the masks as perception found them.
    """
    out = free_folder(path)[0]
    out.mkdir()
    for file in assets.iterdir() if assets is not None and assets.is_dir() else ():
        if file.is_file() and file.name != OVERVIEW:
            try:
                os.link(os.path.realpath(file), out / file.name)
            except OSError:
                shutil.copyfile(file, out / file.name)
    return out


def _finish(work: Correction, out: Path) -> None:
    """Write the maps, and add the operations on the text that follow."""
    painted = _paint(work)
    work.ops.append({"set": ["assets"], "value": out.name})
    objects = _photo_objects(work, painted)
    entries: dict[str, Data] = {}
    for name, one in objects.items():
        made = _entry(work, name, one, painted.labels)
        _set_provenance(work, name, made)
        made["mask"] = painted.stored[name]
        entries[name] = {**made, "shape": document.shape_entry(one.outline)}
        work.ops += (
            [{"add": ["objects", name], "value": made}]
            if name in work.fresh
            else written(work, name, made)
        )
    for name in painted.stored.keys() - objects.keys():
        work.ops.append(
            {"set": ["objects", name, "mask"], "value": painted.stored[name]}
        )
    _write_maps(work, out, painted, list(objects.values()))
    _write_record(out, entries, painted.after)


def _write_record(folder: Path, entries: Mapping[str, Data], labels: U16) -> None:
    """Write the corrected objects, as they are now, into the outlines and the record of perception, where these are."""
    for file in (OUTLINES, RECORD):
        found = read_record(folder / file)
        known = found if file == OUTLINES else found.get("objects")
        if not isinstance(known, dict) or not known:
            continue
        for entry in entries.values():
            id_ = str(entry["mask"])
            was: Data = known[id_] if isinstance(known.get(id_), dict) else {}
            if file == RECORD:  # a velocity is the user's where it differs
                known[id_] = {"velocity": [0, 0], **was, **entry} | {
                    "velocity": was.get("velocity", [0, 0])
                }
            else:
                solid = {"solid": entry["solid"]} if "solid" in entry else {}
                stored = {
                    "crc": mask_crc(labels, entry["mask"]),
                    "shape": entry["shape"],
                }
                known[id_] = {
                    **{key: was[key] for key in was.keys() & {"solid"}},
                    **solid,
                    **stored,
                }
        write_atomic(
            folder / file, json.dumps(found, ensure_ascii=False).encode() + b"\n"
        )


def _paint(work: Correction) -> Painted:
    """The label maps after the correction. Raises EditError."""
    scene, labels, before = work.scene, work.labels, work.maps.cut_out
    ids = {item.name: k + 1 for k, item in enumerate(scene.objects)}
    ids |= {name: len(scene.objects) + 1 + k for k, name in enumerate(work.fresh)}
    corrected = (*work.masks, *work.fresh)
    cleared = [ids[name] for name in (*work.masks, *work.gone)]
    after = labels.copy()
    after[np.isin(labels, cleared)] = 0
    for name, mask in (*work.masks.items(), *work.fresh.items()):
        after[mask] = ids[name]
    moved = list(corrected)
    for item in scene.objects:
        if item.name in corrected or item.name in work.gone:
            continue
        was, now = (part == ids[item.name] for part in (labels, after))
        if was.any() and count(now) < min(count(was), SMALLEST_OBJECT):
            raise Message.NOTHING_LEFT.impossible(name=item.name)
        if not isinstance(item.mask, MaskId) and (was != now).any():
            moved.append(
                item.name
            )  # an outline in the file would be drawn over what was painted
    own = {
        item.name: item.mask.id
        for item in scene.objects
        if isinstance(item.mask, MaskId)
    }
    used = {
        item.mask.id for item in scene.boundaries if isinstance(item.mask, MaskId)
    } | set(own.values())
    free = iter(range(max({int(work.maps.labels.max()), *used}) + 1, 65536))
    new = before.copy()
    new[
        np.isin(before, [own[name] for name in (*moved, *work.gone) if name in own])
    ] = 0
    stored: dict[str, int] = {}
    for name in moved:
        identity = own[name] if name in own else next(free, None)
        if identity is None:
            raise Message.NO_ID_LEFT.impossible()
        new[after == ids[name]] = stored[name] = identity
    scenery = work.sight.compiled.scenery
    touched = np.isin(labels, cleared) | np.isin(
        after, [ids[name] for name in corrected]
    )
    union_before = (labels > 0) | ((before > 0) & ~scenery)
    union = (after > 0) | ((new > 0) & ~scenery)
    return Painted(after, ids, stored, before, new, touched, union, union_before)


def _photo_objects(work: Correction, painted: Painted) -> dict[str, PhotoObject]:
    """The corrected objects by name with their new outlines, set on what supports them."""
    names = (*work.masks, *work.fresh)
    ids = [painted.ids[name] for name in names]
    fits = fit_outlines(painted.labels, ids)
    placed = snapped_to_boundaries(
        work.scene, tuple(fits[i] for i in ids), [True] * len(ids)
    )
    return {
        name: photo_object(i, outline, _label(work, name), work.scene.size)
        for name, i, outline in zip(names, ids, placed, strict=True)
    }


def _label(work: Correction, name: str) -> str:
    """The label of an object, or of the one that a new one was split from."""
    if name in work.entries:
        return str(work.entries[name]["label"])
    source = name if name in work.masks else next(iter(work.masks))
    return work.scene.objects[work.index(source)].label


def _entry(work: Correction, name: str, one: PhotoObject, labels: U16) -> Data:
    """The entry of a corrected object with the numbers that follow: halves share a mass, joined ones add up."""
    if name in work.entries:
        return dict(work.entries[name]) | {"shape": document.shape_entry(one.outline)}
    source = name if name in work.masks else next(iter(work.masks))
    made = changed_entry(work, source, name, one, labels)
    written_as = work.was(source)
    if "mass" in written_as and "mass" not in table_keys(
        written_as
    ):  # a mass that is not the table's
        if work.gone:
            made["mass"] = float(f"{joined_mass(work, source, *work.gone):.4g}")
        elif work.fresh:
            share = count(labels == one.id) / max(count(work.mask(source)), 1)
            made["mass"] = float(f"{joined_mass(work, source) * share:.4g}")
    return made


def _set_provenance(work: Correction, name: str, made: Data) -> None:
    """`from` and `prompt` name the source of the mask; a mask that a user drew has none."""
    sources = {
        key: value
        for key, value in (made.pop("from", None) or {}).items()
        if key != "mask"
    }
    made.pop("prompt", None)
    if name in work.found:
        sure, prompt = work.found[name]
        sources = {"mask": document.provenance("pointed at", sure), **sources}
        made["prompt"] = prompt
    if sources:
        made["from"] = sources


# Maps


def _write_maps(
    work: Correction, folder: Path, painted: Painted, objects: Sequence[PhotoObject]
) -> None:
    """Write into `folder`, which holds all maps as they were, those that change."""
    maps = work.maps
    if (painted.before != painted.after).any() or not (folder / "masks.png").is_file():
        doubtful = np.where(painted.before == 0, maps.labels, np.uint16(0))
        _write_map(
            folder / "masks.png", np.where(painted.after == 0, doubtful, painted.after)
        )
    part = _window(painted.touched | (painted.union != painted.union_before))
    touched, union = painted.touched[part], painted.union[part]
    near = dilate(union != painted.union_before[part], SOFT)
    known = {one.name: getattr(maps, one.name) for one in fields(maps)}
    cut: dict[str, Any] = {
        name: None if values is None else values[part] for name, values in known.items()
    }
    here = Percepts(**cut)
    if here.coverage is not None and near.any():
        made = registry.make("matte")(
            np.ascontiguousarray(here.rgb), union.astype(np.uint16)
        )
        coverage = np.where(near, made, here.coverage)
        _patch(folder / "coverage.png", part, near, coverage)
        where = dilate(touched, PATCHED_AROUND) | near
        for name, picture in (("background", here.background), ("clean", here.clean)):
            if picture is not None:
                filled = np.where((coverage == 0)[..., None], here.rgb, picture)
                # what a shadow was lifted from stays so, where nothing covered it before
                filled = np.where((here.coverage == 0)[..., None], picture, filled)
                hole = where & (coverage > 0)
                if hole.any():
                    made = registry.make("inpaint")(np.ascontiguousarray(filled), hole)
                    filled = np.where(hole[..., None], made, filled)
                _patch(folder / f"{name}.png", part, where, filled / np.float32(255))
    if here.normals is not None and objects:
        by = -np.array([part[1].start, part[0].start], np.float64)
        labels = np.ascontiguousarray(painted.labels[part])
        there = [
            replace(one, outline=translated_outline(one.outline, by)) for one in objects
        ]
        guess = BoundaryGuess(work.scene.world.view, 0.0, "", ())
        normals = registry.make("normals")(
            np.ascontiguousarray(here.rgb), labels, there, guess
        )
        where = np.isin(labels, [one.id for one in objects]) | (touched & (labels == 0))
        _patch(folder / "normals.png", part, where, normals, signed=True)


def _window(mask: Mask) -> Window:
    """Rows and columns of what a mask (H, W) holds, and of enough around it; all where it holds nothing."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    by = max(AROUND, int(rows[-1] - rows[0]) // 2, int(columns[-1] - columns[0]) // 2)
    return tuple(  # type: ignore[return-value]
        slice(max(0, int(held[0]) - by), min(side, int(held[-1]) + by + 1))
        for held, side in zip((rows, columns), mask.shape, strict=True)
    )


def _write_map(path: Path, picture: U8 | U16) -> None:
    """(H, W) or (H, W, 3) RGB, whole or not at all; what another name links to stays as it is."""
    write_atomic(
        path,
        png_bytes(picture, 1 if picture.shape[0] * picture.shape[1] > LARGE else 4),
    )


def _patch(
    path: Path, part: Window, where: Mask, values: NDArray[Any], *, signed: bool = False
) -> None:
    """Write values of 0..1 (-1..1 where `signed`) into a window of a stored map, in its own depth."""
    stored = read_channels(path)
    if stored.ndim == 3:
        stored = stored[:, :, :3] if values.ndim == 3 else stored[:, :, 0]
    stored = stored.copy()
    full = np.iinfo(stored.dtype).max
    middle = (full + 1) // 2 if signed else 0
    new = np.clip(
        np.rint(values * (middle - 1 if signed else full)) + middle, 0, full
    ).astype(stored.dtype)
    if (new[where] != stored[part][where]).any():
        stored[part][where] = new[where]
        _write_map(path, stored)
