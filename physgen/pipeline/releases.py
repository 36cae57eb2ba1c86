"""Release of one held object on a floor of its own, if nothing else of a photo can
move.

Perception holds an object if no visible support would keep it from falling: the lower
border of its mask is ragged, or its ground is not recognised. A viewer still sees that
it stands. The object is released on a level floor through its lowest point, and all
other objects are held.
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
    """Limits for released objects and their bases."""

    confidence: float = 0.2
    """Least confidence of an object: below it, the object is rather a part or a
    patch.
    """
    certainty: float = TRIAL.confidence
    """Least confidence that a released object counts with in the choice of a push."""
    most: int = 3
    """Number of objects to try: each takes the time of a search."""
    rag: float = 0.04
    """Share of an object's height within which its lower border is made level."""
    part: float = 0.35
    """Share of an object's area up to which an unsure object beside it is a part."""
    unsure: float = 0.7
    """Confidence below which an object can be such a part."""
    touch: float = 0.1
    """Least share of a part's border that touches its object."""
    friction: float = 0.6
    """Friction of the floor, equal to that of perceived floors."""
    floor_confidence: float = 0.3
    """Confidence of the floor, for `from`."""


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
    sorted_names = _ranked(photo_scene, refused)
    for name in sorted_names[: RELEASE.most]:
        if name not in photo_scene.document["objects"]:
            continue
        # An object whose outline cannot be made level is skipped.
        with suppress(InputError):
            merged_scene = _with_parts(photo_scene, name)
            yield name, _released(merged_scene, name)


def _ranked(photo_scene: PerceivedScene, refused: Collection[str]) -> list[str]:
    """Sort the names of releasable objects, the surest large object first."""
    labels = photo_scene.percepts.labels
    areas = np.bincount(labels.ravel())
    weights = {}
    for name, item in photo_scene.document["objects"].items():
        confidence = mask_confidence(item)
        is_cut = "cut off" in photo_scene.comments.get(f"objects.{name}.motion", "")
        is_unsure = confidence < RELEASE.confidence
        if name in refused or is_cut or is_unsure or is_living(item["label"]):
            continue
        weights[name] = confidence * sqrt(float(areas[item["mask"]]))
    return sorted(weights, key=lambda name: weights[name], reverse=True)


def _with_parts(photo_scene: PerceivedScene, name: str) -> PerceivedScene:
    """Merge small unsure objects into the object that they touch.

    A wheel that was detected as an object of its own would block its car.
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
    # The shadows of the parts become shadows of the object, too.
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
    """Return the names of small unsure objects beside an object."""
    labels, objects = photo_scene.percepts.labels, photo_scene.document["objects"]
    object_mask = labels == objects[name]["mask"]
    dilated_mask = (
        cv2.dilate(object_mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    )
    parts = []
    for other, item in objects.items():
        if other == name or mask_confidence(item) >= RELEASE.unsure:
            continue
        part_mask = labels == item["mask"]
        inner_pixels = (
            cv2.erode(part_mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        )
        border_pixels = part_mask & ~inner_pixels
        is_small = part_mask.sum() < RELEASE.part * object_mask.sum()
        share = float((border_pixels & dilated_mask).sum()) / max(
            float(border_pixels.sum()), 1.0
        )
        if is_small and share >= RELEASE.touch:
            parts.append(other)
    return parts


def _released(photo_scene: PerceivedScene, name: str) -> PerceivedScene:
    """Return the scene with one object free on a floor through its lowest point.

    Raises InputError if its level outline is not a valid shape.
    """
    scene = open_trial(photo_scene).scene()
    index = [item.name for item in scene.objects].index(name)
    outlines = compile_shapes(scene, shapes_of(scene, None)).outlines
    outline, ground = _level_outline(outlines[index], photo_scene, name)
    photo_scene = _with_others_held(photo_scene, name, outline)
    floor = _guessed_floor(photo_scene.percepts.labels.shape[1], ground)
    walls = photo_scene.document["boundaries"]
    other_walls = {key: wall for key, wall in walls.items() if key == "bottom"}
    document = photo_scene.document | {"boundaries": other_walls | {FLOOR: floor}}
    comment = f"a guess: through the lowest point of {name}"
    comments = {**photo_scene.comments, f"boundaries.{FLOOR}": comment}
    return replace(photo_scene, document=document, comments=comments)


def _guessed_floor(width: int, height: float) -> dict[str, Any]:
    """Return the entry of a level floor across a photo, and beyond both sides."""
    ends = np.array([[-width, height], [2.0 * width, height]])
    return {
        "segment": corners(ends),
        "friction": RELEASE.friction,
        "from": f"lowest point {RELEASE.floor_confidence:g}",
    }


def _with_others_held(
    photo_scene: PerceivedScene, name: str, outline: Outline
) -> PerceivedScene:
    """Release one object with this outline, and hold all others."""
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
            comment = f"held, so that {name} can move; dynamic lets it go"
            comments.setdefault(f"objects.{other}.motion", comment)
        objects[other] = item
    document = photo_scene.document | {"objects": objects}
    return replace(photo_scene, document=document, comments=comments)


def _level_outline(
    outline: Outline, photo_scene: PerceivedScene, name: str
) -> tuple[Outline, float]:
    """Return an outline with a level base, and the height of the ground, px."""
    _, top, _, bottom = bounds(outline)
    if isinstance(outline, Disc):
        return outline, bottom
    # Scene files have two decimals: the ground must not be below the written outline.
    ground = float(np.floor(bottom * 100) / 100)
    line = Line(0.0, ground)
    level_foot = straighten_foot(outline, line, RELEASE.rag * (bottom - top))
    number = photo_scene.document["objects"][name]["mask"]
    foot = find_foot(PhotoObject(number, level_foot))
    outline_with_base = add_base(foot, line) if needs_base(foot) else None
    return outline_with_base or level_foot, ground
