"""The scene document: entries, names, comments, sources and files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from physgen.compile.shapes import fill_polygon
from physgen.geometry.polygon import Disc
from physgen.materials import kind
from physgen.perceive.occlusion import drawing_layers, occlusion_orders
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Doubt,
    Labels,
    Matter,
    Name,
    PhotoObject,
)
from physgen.perceive.shape_entries import (
    FACING_CONFIDENCE,
    shape_entry,
    shape_words,
    short,
    vehicle_entry,
)
from physgen.perceive.wheels import Vehicle
from physgen.scene.provenance import provenance as provenance
from physgen.scene.provenance import table_confidences
from physgen.scene.scene import Solid, View

PERHAPS = 0.2
"""Least confidence of a region with an entry."""
LIKELY = 0.1
"""Least probability of an alternative label in a comment."""
TABLE = {"friction": 0.2}
"""The table's entry in new scenes seen from above."""
MOTION_BLUR = 0.5
"""Motion blur of new files: the shutter is open for half of a frame's time, as in film
cameras.
"""
HOLD = 10
"""Frames of new files that show the photo before the motion: a third of a second."""


# Entries of the document.


@dataclass(frozen=True)
class ObjectLabels:
    """Labels of objects, by id."""

    names: Mapping[int, Name]
    sources: Mapping[int, str]
    """Sources of the labels, for `from`; `""` for labels of the user."""


def object_entries(
    found: Detections,
    objects: Sequence[PhotoObject],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    labels: ObjectLabels,
    table: str,
    vehicles: Mapping[int, Vehicle] = MappingProxyType({}),
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the entries of `objects:` and the comments by dotted path.

    `table` is the name of the backend of matter.
    """
    layer_of, kept = drawing_layers(
        occlusion_orders(found.labels, [item.id for item in objects]), found.layers
    )
    entries: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for item in sorted(objects, key=lambda t: list(called).index(t.id)):
        name, its = called[item.id], matter[item.id]
        path = f"objects.{name}"
        sources = {"mask": _mask_source(found, item.id)}
        # Only labels of perception have a source and alternatives.
        if labels.sources[item.id]:
            guess = labels.names[item.id]
            sources["label"] = provenance(
                guess.source or labels.sources[item.id], guess.confidence
            )
            alternatives = [
                f"{label} {chance:g}"
                for label, chance in guess.likely
                if chance >= LIKELY and label != item.label
            ]
            comments[f"{path}.label"] = (
                sources["label"]
                + (", or " if alternatives else "")
                + ", ".join(alternatives)
            )
        sources |= {
            key: provenance(table, confidence)
            for key, confidence in table_confidences(its.confidence).items()
        }
        grip = boundaries.grip.get(item.id, 0.0)
        entry: dict[str, Any] = {
            "label": item.label,
            "mask": item.id,
            "shape": shape_entry(item.outline),
            **({"solid": its.solid.value} if isinstance(item.outline, Disc) else {}),
            "mass": short(its.mass),
            "friction": max(its.friction, grip),
            "elasticity": its.elasticity,
        }
        is_static = item.id in boundaries.held
        # Circles roll when seen from the side; from above only spheres roll.
        rolls = isinstance(item.outline, Disc) and (
            boundaries.view is View.SIDE or its.solid is Solid.SPHERE
        )
        vehicle = None if is_static else vehicles.get(item.id)
        # Wheels roll even if the object is not a circle.
        if vehicle is not None:
            entry["rolling"] = max(its.rolling, kind("wheel").material.rolling)
        elif rolls and not (item.cut or is_static):
            entry["rolling"] = its.rolling
        else:
            del sources["rolling"]
        if its.surface:
            comments[f"{path}.friction"] = its.surface
        if not (item.cut or is_static):
            entry["velocity"] = [0, 0]
        else:
            reason = (
                "cut off by the photo's border"
                if item.cut
                else "nothing that is seen keeps it from falling"
            )
            entry["motion"] = "static"
            comments[f"{path}.motion"] = f"{reason}, so it is held; dynamic lets it go"
        # An object at rest on a slope proves a friction of at least the slope.
        if its.friction < grip:
            sources["friction"] = provenance("lies on a slope", 0.5)
            comments[f"{path}.friction"] = (
                "at least this much, since it lies still on a slope"
            )
        if vehicle is not None:
            entry |= vehicle_entry(vehicle)
            sources["wheels"] = provenance("circles", vehicle.confidence)
            sources["facing"] = provenance("cabin", FACING_CONFIDENCE)
            comments[f"{path}.wheels"] = (
                f"circles at its lower edge (confidence {vehicle.confidence:g});"
                " they turn and carry it"
            )
            comments[f"{path}.facing"] = (
                "a guess: the cabin is behind the middle; left or right"
            )
        # Layers are written only if the order of drawing differs from the default.
        if item.id in layer_of:
            orders = [order for order in kept if order.front == item.id]
            entry["layer"] = layer_of[item.id]
            sources["layer"] = provenance(
                "outlines", max(order.confidence for order in orders)
            )
            *names, last = [called[order.behind] for order in orders]
            hidden_names = ", ".join(names) + (" and " if names else "") + last
            comments[f"{path}.layer"] = f"in front: it hides parts of {hidden_names}"
        comments[f"{path}.mask"] = (
            f"{sources['mask']}, {shape_words(item.outline, its.solid)}"
        )
        comments[f"{path}.mass"] = f"g, {sources['mass']}: {its.reason}"
        entries[name] = {**entry, "from": sources}
        if item.id in found.prompts:
            entries[name]["prompt"] = dict(found.prompts[item.id])
    return entries, comments


def _mask_source(found: Detections, i: int) -> str:
    source = "pointed at" if i in found.prompts else found.source
    return found.mask_sources.get(i) or provenance(source, found.confidence.get(i, 1.0))


# Comments of the document.


def scene_comments(
    found: Detections,
    objects: Sequence[PhotoObject],
    specks: int,
    boundaries: BoundaryGuess,
) -> dict[str, str]:
    """Return comments on the sources of all estimates, by dotted path."""
    sources = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "kept": "as the scene had them"
        + (", and where you pointed" if found.prompts else ""),
    }
    origin = sources.get(found.source, f"found by {found.source}")
    left_out = (
        f"; {specks} specks of under {SMALLEST_OBJECT} px left out" if specks else ""
    )
    counts = label_counts({t.id: t.label for t in objects})
    comments = {
        "physgen": "as perceived in a photo: change any number, then physgen render THIS-FILE",
        "world.view": f"side or top: {boundaries.reason.partition(' and ')[0]} (confidence {boundaries.confidence:g})",
        "objects": f"{counts}, {origin}, counted from left to right{left_out}",
    }
    if boundaries.view is View.TOP:
        comments["world.table"] = (
            "friction cannot be seen: 0.2 is cloth, 0 lets objects glide for ever"
        )
    if boundaries.tilt is not None and boundaries.view is View.SIDE:
        comments["world.tilt"] = (
            "degrees by which the camera looks down, by the looks of the photo"
        )
    if found.doubtful:
        comments["doubtful"] = (
            "perhaps objects, too: move a line to objects to have one"
        )
    return comments | {
        f"boundaries.{wall.name}": wall.reason
        for wall in boundaries.walls
        if len(wall.points) == 2
    }


def label_counts(labels: Mapping[int, str]) -> str:
    """Return the number of objects of each label, e.g. 2 x ball, 1 x block."""
    counts: dict[str, int] = {}
    for label in labels.values():
        counts[label or "object"] = counts.get(label or "object", 0) + 1
    sorted_counts = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{n} x {label}" for label, n in sorted_counts)


def with_doubtful(
    labels: Labels, doubtful: Sequence[Doubt]
) -> tuple[Labels, dict[str, Any], dict[str, str]]:
    """Return the label map with ids for doubtful regions, their entries and their
    comments.

    Pixels of objects are excluded from the regions.
    """
    result = labels.copy()
    entries: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for doubt in doubtful:
        free = fill_polygon(
            tuple(doubt.polygon), (labels.shape[1], labels.shape[0])
        ) & (result == 0)
        id_ = int(result.max()) + 1
        if (
            doubt.confidence >= PERHAPS
            and np.count_nonzero(free) >= SMALLEST_OBJECT
            and id_ < 65536
        ):
            result[free] = id_
            name = f"maybe-{len(entries) + 1}"
            entries[name] = {
                "mask": id_,
                "confidence": round(doubt.confidence, 2),
            }
            if doubt.reason:
                comments[f"doubtful.{name}"] = doubt.reason
    return result, entries, comments


# Files of the scene.
