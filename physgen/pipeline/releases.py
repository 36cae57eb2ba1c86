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
from typing import TYPE_CHECKING

import cv2
import numpy as np

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
    perceived: PerceivedScene, refused: Collection[str]
) -> Iterator[tuple[str, PerceivedScene]]:
    """Yield scenes in which one object is released on a floor, the surest object first.

    Objects that are `refused`, alive or cut off by the photo's border are not released.
    """
    if perceived.document["world"]["view"] != View.SIDE.value:
        return
    ranked = _ranked(perceived, refused)
    for name in ranked[: RELEASE.most]:
        if name not in perceived.document["objects"]:
            continue
        with suppress(InputError):  # its level outline may not be a shape
            whole = _with_parts(perceived, name)
            yield name, _released(whole, name)


def _ranked(perceived: PerceivedScene, refused: Collection[str]) -> list[str]:
    """Return the names of objects that may be released, the surest large one first."""
    labels = perceived.percepts.labels
    areas = np.bincount(labels.ravel())
    weights = {}
    for name, item in perceived.document["objects"].items():
        sure = mask_confidence(item)
        is_cut = "cut off" in perceived.comments.get(f"objects.{name}.motion", "")
        is_unsure = sure < RELEASE.confidence
        if name in refused or is_cut or is_unsure or is_living(item["label"]):
            continue
        weights[name] = sure * sqrt(float(areas[item["mask"]]))
    return sorted(weights, key=lambda name: weights[name], reverse=True)


def _with_parts(perceived: PerceivedScene, name: str) -> PerceivedScene:
    """Return the scene in which small unsure objects that touch one are parts of it.

    A wheel that was detected on its own would block its car.
    """
    percepts, objects = perceived.percepts, dict(perceived.document["objects"])
    number = objects[name]["mask"]
    own = percepts.labels == number
    ring = cv2.dilate(own.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    ids = []
    for other, item in perceived.document["objects"].items():
        part = percepts.labels == item["mask"]
        inner = cv2.erode(part.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        border = part & ~inner
        is_small = part.sum() < RELEASE.part * own.sum()
        is_sure = mask_confidence(item) >= RELEASE.unsure
        touching = np.count_nonzero(border & ring) / max(np.count_nonzero(border), 1)
        if other != name and is_small and not is_sure and touching >= RELEASE.touch:
            ids.append(item["mask"])
            del objects[other]
    if not ids:
        return perceived
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
        for key, text in perceived.comments.items()
        if not key.startswith("objects.") or key.split(".")[1] in objects
    }
    return replace(
        perceived,
        percepts=replace(percepts, labels=labels, shadows=owners),
        document=perceived.document | {"objects": objects},
        comments=comments,
    )


def _released(perceived: PerceivedScene, name: str) -> PerceivedScene:
    """Return the scene with one object free on a floor through its lowest point.

    Raises InputError if its level outline is not a shape.
    """
    from physgen.compile.compile import compile_shapes
    from physgen.compile.shapes import shapes_of

    scene = open_trial(perceived).scene()
    index = [item.name for item in scene.objects].index(name)
    outlines = compile_shapes(scene, shapes_of(scene, None)).outlines
    outline, ground = _level_outline(outlines[index], perceived, name)
    objects = {}
    comments = dict(perceived.comments)
    for other, item in perceived.document["objects"].items():
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
    width = perceived.percepts.labels.shape[1]
    ends = np.array([[-width, ground], [2.0 * width, ground]])
    floor = {
        "segment": corners(ends),
        "friction": RELEASE.friction,
        "from": f"lowest point {RELEASE.floor_confidence:g}",
    }
    walls = perceived.document["boundaries"]
    kept = {key: wall for key, wall in walls.items() if key == "bottom"}
    boundaries = kept | {FLOOR: floor}
    comments[f"boundaries.{FLOOR}"] = f"a guess: through the lowest point of {name}"
    document = perceived.document | {"objects": objects, "boundaries": boundaries}
    return replace(perceived, document=document, comments=comments)


def _level_outline(
    outline: Outline, perceived: PerceivedScene, name: str
) -> tuple[Outline, float]:
    """Return an outline with a level base, and the height of the ground, px."""
    _, top, _, low = bounds(outline)
    if isinstance(outline, Disc):
        return outline, low
    ground = float(np.floor(low * 100) / 100)
    line = Line(0.0, ground)
    level = straighten_foot(outline, line, RELEASE.rag * (low - top))
    number = perceived.document["objects"][name]["mask"]
    foot = find_foot(PhotoObject(number, level))
    based = add_base(foot, line) if needs_base(foot) else None
    return based or level, ground
