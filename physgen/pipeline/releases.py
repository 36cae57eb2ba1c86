"""Release of one held object on a floor of its own, if nothing else of a photo can move.

Perception holds an object if nothing visible would keep it from falling: its mask ends
in rags, or its ground is not recognised. A viewer sees where it stands all the same. It is
released on a level floor through its lowest point, and all other objects are held.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from math import sqrt
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physgen.compile.compile import compile_shapes
from physgen.compile.shapes import shapes_of
from physgen.geometry.fitting import fit_outlines
from physgen.geometry.polygon import Disc, Outline, bounds
from physgen.geometry.scale import PhotoObject
from physgen.materials import is_living
from physgen.perceive.document import (
    corners,
    mask_confidence,
    shape_entry,
)
from physgen.perceive.support.ground_contact import (
    Line,
    add_base,
    find_foot,
    needs_base,
    straighten_foot,
)
from physgen.pipeline.push_trials import TRIAL
from physgen.pipeline.trial_scenes import open_trial
from physgen.problems import InputError
from physgen.scene.scene import View

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene


@dataclass(frozen=True)
class ReleaseLimits:
    """Limits of objects that are released, and of their bases."""

    confidence: float = 0.2
    """Least confidence of an object: below it is rather a part or a patch."""
    certainty: float = TRIAL.confidence
    """Confidence that an object counts with at least, once it is released."""
    most: int = 3
    """Objects that are tried: each takes the time of a search."""
    rag: float = 0.04
    """Share of an object's height in which its lower border is made level."""
    part: float = 0.35
    """Share of an object's area up to which an unsure object that touches it is a part."""
    unsure: float = 0.7
    """Confidence below which that counts."""
    touch: float = 0.1
    """Share of a part's border that touches its object, at least."""
    friction: float = 0.6
    """Of the floor, as of those that perception finds."""
    floor_confidence: float = 0.3
    """Of the floor, for `from`."""


RELEASE = ReleaseLimits()
FLOOR = "floor"


def releases(
    photo_scene: PerceivedScene, refused: Collection[str]
) -> Iterator[tuple[str, PerceivedScene]]:
    """Yield scenes in which one object is released on a floor, the surest object first.

    Objects that are `refused`, alive or cut off by the photo's border are not released.
    """
    if photo_scene.document["world"]["view"] != View.SIDE.value:
        return
    ranked = _ranked(photo_scene, refused)
    for name in ranked[: RELEASE.most]:
        if name not in photo_scene.document["objects"]:
            continue
        with suppress(InputError):  # its level outline may not be a shape
            whole = _with_parts(photo_scene, name)
            yield name, _released(whole, name)


def _ranked(photo_scene: PerceivedScene, refused: Collection[str]) -> list[str]:
    """Return the names of objects that may be released, the surest large one first."""
    labels = photo_scene.percepts.labels
    areas = np.bincount(labels.ravel())
    weights = {}
    for name, item in photo_scene.document["objects"].items():
        sure = mask_confidence(item)
        is_cut = "cut off" in photo_scene.comments.get(f"objects.{name}.motion", "")
        is_unsure = sure < RELEASE.confidence
        if name in refused or is_cut or is_unsure or is_living(item["label"]):
            continue
        weights[name] = sure * sqrt(float(areas[item["mask"]]))
    return sorted(weights, key=lambda name: weights[name], reverse=True)


def _with_parts(photo_scene: PerceivedScene, name: str) -> PerceivedScene:
    """Return the scene in which small unsure objects that touch one are parts of it.

    A wheel that was detected on its own would block its car.
    """
    objects = dict(photo_scene.document["objects"])
    parts = _parts(photo_scene, name)
    if not parts:
        return photo_scene
    number = objects[name]["mask"]
    ids = [objects.pop(part)["mask"] for part in parts]
    percepts = photo_scene.percepts
    labels = np.where(np.isin(percepts.labels, ids), number, percepts.labels)
    labels = labels.astype(np.uint16)
    owners = percepts.shadows
    if owners is not None:
        owners = np.where(np.isin(owners, ids), number, owners).astype(np.uint16)
    outline = fit_outlines(labels, [number])[number]
    objects[name] = objects[name] | {"shape": shape_entry(outline)}
    objects[name].pop("solid", None)
    comments = {
        key: text
        for key, text in photo_scene.comments.items()
        if not key.startswith("objects.") or key.split(".")[1] in objects
    }
    return replace(
        photo_scene,
        percepts=replace(percepts, labels=labels, shadows=owners),
        document=photo_scene.document | {"objects": objects},
        comments=comments,
    )


def _parts(photo_scene: PerceivedScene, name: str) -> list[str]:
    """Return the names of small unsure objects that touch one."""
    labels, objects = photo_scene.percepts.labels, photo_scene.document["objects"]
    own = labels == objects[name]["mask"]
    ring = cv2.dilate(own.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    parts = []
    for other, item in objects.items():
        if other == name or mask_confidence(item) >= RELEASE.unsure:
            continue
        part = labels == item["mask"]
        inner = cv2.erode(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        border = part & ~inner
        is_small = part.sum() < RELEASE.part * own.sum()
        share = float((border & ring).sum()) / max(float(border.sum()), 1.0)
        if is_small and share >= RELEASE.touch:
            parts.append(other)
    return parts


def _released(photo_scene: PerceivedScene, name: str) -> PerceivedScene:
    """Return the scene with one object free on a floor through its lowest point.

    Raises InputError if its level outline is not a shape.
    """
    scene = open_trial(photo_scene).scene()
    index = [item.name for item in scene.objects].index(name)
    outlines = compile_shapes(scene, shapes_of(scene, None)).outlines
    outline, ground = _level_outline(outlines[index], photo_scene, name)
    photo_scene = _with_others_held(photo_scene, name, outline)
    floor = _guessed_floor(photo_scene.percepts.labels.shape[1], ground)
    walls = photo_scene.document["boundaries"]
    kept = {key: wall for key, wall in walls.items() if key == "bottom"}
    document = photo_scene.document | {"boundaries": kept | {FLOOR: floor}}
    why = f"a guess: through the lowest point of {name}"
    comments = {**photo_scene.comments, f"boundaries.{FLOOR}": why}
    return replace(photo_scene, document=document, comments=comments)


def _guessed_floor(width: int, height: float) -> dict[str, Any]:
    """Return the entry of a level floor across a photo, and beyond it."""
    ends = np.array([[-width, height], [2.0 * width, height]])
    return {
        "segment": corners(ends),
        "friction": RELEASE.friction,
        "from": f"lowest point {RELEASE.floor_confidence:g}",
    }


def _with_others_held(
    photo_scene: PerceivedScene, name: str, outline: Outline
) -> PerceivedScene:
    """Return the scene in which one object is free, with this outline, and others not."""
    objects = {}
    comments = dict(photo_scene.comments)
    for other, item in photo_scene.document["objects"].items():
        item = {key: value for key, value in item.items() if key != "motion"}
        if other == name:
            item["velocity"] = [0, 0]
            item["shape"] = shape_entry(outline)
            comments.pop(f"objects.{other}.motion", None)
        else:
            item.pop("velocity", None)
            item["motion"] = "static"
            why = f"held, so that {name} can move; dynamic lets it go"
            comments.setdefault(f"objects.{other}.motion", why)
        objects[other] = item
    document = photo_scene.document | {"objects": objects}
    return replace(photo_scene, document=document, comments=comments)


def _level_outline(
    outline: Outline, photo_scene: PerceivedScene, name: str
) -> tuple[Outline, float]:
    """Return an outline with a level base, and the height of the ground, px."""
    _, top, _, low = bounds(outline)
    if isinstance(outline, Disc):
        return outline, low
    ground = float(np.floor(low * 100) / 100)
    line = Line(0.0, ground)
    level = straighten_foot(outline, line, RELEASE.rag * (low - top))
    number = photo_scene.document["objects"][name]["mask"]
    foot = find_foot(PhotoObject(number, level))
    based = add_base(foot, line) if needs_base(foot) else None
    return based or level, ground
