"""Maps of a photo, recomputed only where a correction changed them.

All other pixels stay as they are stored, so that what was painted by hand or made by a model elsewhere is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.files import write_atomic
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Outline, translated_outline
from physgen.maps import Percepts
from physgen.perceive.inpaint.poisson import dilate, harmonic_fill
from physgen.perceive.roles import BoundaryGuess, PhotoObject
from physgen.photometry import decode, encode_u8
from physgen.photos import read_channels
from physgen.scene.scene import View

Window = tuple[slice, slice]
"""Rows and columns."""
U16 = NDArray[np.uint16]

AROUND = 128
"""px beside what changes that are looked at, at least; or half its size."""


def window(mask: NDArray[np.bool_]) -> Window:
    """Rows and columns of what a mask (H, W) holds, and of enough around it; all where it holds nothing."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    by = max(AROUND, int(rows[-1] - rows[0]) // 2, int(columns[-1] - columns[0]) // 2)
    return tuple(  # type: ignore[return-value]
        slice(max(0, int(held[0]) - by), min(side, int(held[-1]) + by + 1))
        for held, side in zip((rows, columns), mask.shape, strict=True)
    )


def corner(part: Window) -> NDArray[np.float64]:
    """(2,) px: x and y of its first pixel."""
    return np.array([part[1].start, part[0].start], np.float64)


def fitted(labels: U16, ids: Sequence[int]) -> dict[int, Outline]:
    """As `fit_outlines` of these ids alone, looking at no more of the photo (H, W) than they need."""
    table = np.zeros(2**16, np.bool_)
    table[list(ids)] = True
    part = window(table[labels])
    found = fit_outlines(labels[part], ids)
    return {i: translated_outline(outline, corner(part)) for i, outline in found.items()}


U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

SOFT = 10
"""px from a mask's border within which coverage follows it; see `matte_edge`."""
PATCHED_AROUND = 6
"""px around a mask that its border may have coloured: the background is filled again up to there."""
DARK = 2e-3
"""Of linear light: with less, the share of light that a shadow leaves is not known."""
LARGE = 4_000_000
"""px of a photo beyond which maps are compressed less, in a third of the time."""


@dataclass(frozen=True)
class Change:
    """Label maps before and after a correction."""

    before: U16
    """(H, W) of masks.png; zeros where there is none."""
    after: U16
    touched: Mask
    """(H, W): what the objects that were corrected covered, or cover now."""
    union: Mask
    """(H, W): all that objects, also left-out ones, cover now."""
    was: Mask
    """(H, W): likewise before."""


def write_patched(
    maps: Percepts, folder: Path, change: Change, objects: Sequence[PhotoObject], labels: U16, view: View
) -> Percepts:
    """Write into `folder` those maps that change, and return all of them; it holds them as they were, perhaps as links.

    `objects` are the corrected objects, their ids those of `labels` (H, W).
    """
    result = replace(maps, labels=change.after)
    if (change.before != change.after).any() or not (folder / "masks.png").is_file():
        write_map(folder / "masks.png", change.after)
    if maps.shadows is not None:
        owners = _owners(maps.shadows, change)
        if (owners != maps.shadows).any():
            write_map(folder / "shadows.png", owners)
            result = replace(result, shadows=owners)
    part = window(change.touched | (change.union != change.was))
    near = Change(*(getattr(change, one.name)[part] for one in fields(change)))
    here = _cut(maps, part)
    if maps.coverage is not None and (near.union != near.was).any():
        coverage = _coverage(here, near)
        stored = _put(folder / "coverage.png", part, coverage, _near(near))
        full = np.float32(np.iinfo(stored.dtype).max)
        result = replace(result, coverage=(stored.astype(np.float32) / full).astype(np.float32))
        if maps.background is not None:
            background, clean = _fills(here, near, coverage)
            result = replace(
                result, background=_paste(folder / "background.png", maps.background, part, background)
            )
            if maps.clean is not None and clean is not None:
                result = replace(result, clean=_paste(folder / "clean.png", maps.clean, part, clean))
    if maps.normals is not None and objects:
        by = -corner(part)
        there = [replace(one, outline=translated_outline(one.outline, by)) for one in objects]
        result = replace(result, normals=_normals(maps, folder, near, there, labels[part], view, part))
    return result


def write_map(path: Path, picture: U8 | U16) -> None:
    """(H, W) or (H, W, 3) RGB, whole or not at all; what another name links to stays as it is."""
    bgr = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    level = 1 if picture.shape[0] * picture.shape[1] > LARGE else 4
    done, data = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, level])
    assert done
    write_atomic(path, data.tobytes())


def _cut(maps: Percepts, part: Window) -> Percepts:
    """The same of a part of the photo."""
    known = {one.name: getattr(maps, one.name) for one in fields(maps)}
    cut: dict[str, Any] = {name: None if values is None else values[part] for name, values in known.items()}
    return Percepts(**cut)


def _paste(path: Path, picture: U8, part: Window, new: U8) -> U8:
    """A map with a part of it as it is now, written."""
    result = picture.copy()
    result[part] = new
    write_map(path, result)
    return result


def _owners(shadows: U16, change: Change) -> U16:
    """Shadows of ids that are gone get the id that has their pixels now."""
    before, after = (
        np.bincount(part.reshape(-1), minlength=2**16)
        for part in (change.before[change.touched], change.after)
    )
    gone = np.flatnonzero((before > 0) & (after == 0))
    owners = shadows.copy()
    for identity in gone[gone > 0].tolist():
        heirs = np.bincount(change.after[change.before == identity])
        owners[shadows == identity] = int(heirs.argmax()) if len(heirs) else 0
    return owners


def _near(change: Change) -> Mask:
    """Where coverage may change."""
    return dilate(change.union != change.was, SOFT)


def _coverage(maps: Percepts, change: Change) -> F32:
    """(H, W): from the role `matte` near what changed, as before elsewhere."""
    assert maps.coverage is not None
    made = registry.make("matte")(np.ascontiguousarray(maps.rgb), change.union.astype(np.uint16))
    return np.where(_near(change), made, maps.coverage).astype(np.float32)


def _put(path: Path, part: Window, coverage: F32, near: Mask) -> U8 | U16:
    """Into the stored map, in its own depth; returns its numbers."""
    stored = read_channels(path)
    grey = (stored if stored.ndim == 2 else stored[:, :, 0]).copy()
    new = np.rint(coverage * np.iinfo(grey.dtype).max).astype(grey.dtype)
    grey[part][near] = new[near]
    write_map(path, grey)
    return grey


def _fills(maps: Percepts, change: Change, coverage: F32) -> tuple[U8, U8 | None]:
    """What lies behind, with old shadows and without: filled anew under what was corrected, the photo beside it."""
    assert maps.background is not None
    where = dilate(change.touched, PATCHED_AROUND) | _near(change)
    hole, open_ = where & (coverage > 0), where & (coverage == 0)
    background = _filled(np.where(open_[..., None], maps.rgb, maps.background), hole)
    if maps.clean is None:
        return background, None
    return background, _filled(np.where(open_[..., None], _lifted(maps, open_, coverage), maps.clean), hole)


def _filled(picture: U8, hole: Mask) -> U8:
    """The role `inpaint`, from what lies around."""
    if not hole.any():
        return picture
    made: U8 = registry.make("inpaint")(np.ascontiguousarray(picture), hole)
    return np.where(hole[..., None], made, picture)


def _lifted(maps: Percepts, open_: Mask, coverage: F32) -> U8:
    """(H, W, 3): the photo with as much of shadows lifted as around it, at pixels that nothing covers any more."""
    assert maps.background is not None
    assert maps.clean is not None
    assert maps.coverage is not None
    known = maps.coverage == 0
    share = (decode(maps.clean) + DARK) / (decode(maps.background) + DARK)
    share = harmonic_fill(share.astype(np.float32), ~known & (open_ | (coverage > 0)), 0.01)
    lit = encode_u8(np.clip((decode(maps.rgb) + DARK) * share - DARK, 0, 1))
    # where the photo showed and nothing was lifted, it stays to the bit
    return np.where((known & open_)[..., None], maps.clean, lit).astype(np.uint8)


def _normals(
    maps: Percepts,
    folder: Path,
    change: Change,
    objects: Sequence[PhotoObject],
    labels: U16,
    view: View,
    part: Window,
) -> F32:
    """On the corrected objects, and where they were and nothing is now; all but `maps` and the result of a part."""
    assert maps.normals is not None
    path = folder / "normals.png"
    rgb = np.ascontiguousarray(maps.rgb[part])
    made = registry.make("normals")(
        rgb, np.ascontiguousarray(labels), objects, BoundaryGuess(view, 0.0, "", ())
    )
    where = np.isin(labels, [one.id for one in objects]) | (change.touched & (labels == 0))
    stored = read_channels(path)[:, :, :3]
    middle = (np.iinfo(stored.dtype).max + 1) // 2
    new = np.clip(np.rint(made * (middle - 1)) + middle, 0, np.iinfo(stored.dtype).max).astype(stored.dtype)
    if not (new[where] != stored[part][where]).any():
        return maps.normals
    stored = stored.copy()
    stored[part][where] = new[where]
    write_map(path, stored)
    known = maps.normals.copy()
    known[part][where] = (new[where].astype(np.float32) - np.float32(middle)) / np.float32(middle - 1)
    return known
