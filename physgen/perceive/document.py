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
from physgen.perceive.occlusion import OcclusionOrder, drawing_layers, occlusion_orders
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


@dataclass(frozen=True)
class _EntryDraft:
    """The entry of one object while its parts are added, with sources and comments."""

    path: str
    entry: dict[str, Any]
    sources: dict[str, str]
    comments: dict[str, str]
    """Comments on all objects, by dotted path."""

    def comment(self, key: str, text: str) -> None:
        """Add the comment on a key of the entry."""
        self.comments[f"{self.path}.{key}"] = text


def object_entries(
    detections: Detections,
    objects: Sequence[PhotoObject],
    names: Mapping[int, str],
    matter: Mapping[int, Matter],
    boundaries: BoundaryGuess,
    labels: ObjectLabels,
    table: str,
    vehicles: Mapping[int, Vehicle] = MappingProxyType({}),
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the entries of `objects:` and the comments by dotted path.

    `table` is the name of the backend of matter.
    """
    layers, orders = drawing_layers(
        occlusion_orders(detections.labels, [item.id for item in objects]),
        detections.layers,
    )
    entries: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for item in sorted(objects, key=lambda t: list(names).index(t.id)):
        name = names[item.id]
        substance = matter[item.id]
        draft = _EntryDraft(f"objects.{name}", {}, {}, comments)
        draft.sources["mask"] = _mask_source(detections, item.id)
        _add_label(draft, item, labels)
        for key, confidence in table_confidences(substance.confidence).items():
            draft.sources[key] = provenance(table, confidence)
        _add_physics(draft, item, substance, vehicles.get(item.id), boundaries)
        # Layers are written only if the order of drawing differs from the default.
        if item.id in layers:
            own_orders = []
            for order in orders:
                if order.front == item.id:
                    own_orders.append(order)
            _add_layer(draft, layers[item.id], own_orders, names)
        shape = shape_words(item.outline, substance.solid)
        draft.comment("mask", f"{draft.sources['mask']}, {shape}")
        draft.comment("mass", f"g, {draft.sources['mass']}: {substance.reason}")
        entries[name] = {**draft.entry, "from": draft.sources}
        if item.id in detections.prompts:
            entries[name]["prompt"] = dict(detections.prompts[item.id])
    return entries, comments


def _add_physics(
    draft: _EntryDraft,
    item: PhotoObject,
    substance: Matter,
    vehicle: Vehicle | None,
    boundaries: BoundaryGuess,
) -> None:
    """Add the matter and the motion of an object."""
    grip = boundaries.grip.get(item.id, 0.0)
    draft.entry.update(_describe_matter(item, substance, grip))
    is_static = item.id in boundaries.held_ids
    if is_static:
        vehicle = None
    _add_rolling(draft, item, substance, vehicle, boundaries)
    if substance.surface:
        draft.comment("friction", substance.surface)
    _add_motion(draft, item, is_static)
    # An object at rest on a slope proves a friction of at least the slope.
    if substance.friction < grip:
        draft.sources["friction"] = provenance("lies on a slope", 0.5)
        draft.comment("friction", "at least this much, since it lies still on a slope")
    if vehicle is not None:
        _add_vehicle(draft, vehicle)


def _add_label(draft: _EntryDraft, item: PhotoObject, labels: ObjectLabels) -> None:
    """Add the source of an object's label, and its alternatives as a comment.

    Only labels of perception have a source and alternatives.
    """
    if not labels.sources[item.id]:
        return
    guess = labels.names[item.id]
    source = provenance(guess.source or labels.sources[item.id], guess.confidence)
    draft.sources["label"] = source
    alternatives = []
    for label, chance in guess.alternatives:
        if chance >= LIKELY and label != item.label:
            alternatives.append(f"{label} {chance:g}")
    conjunction = ""
    if alternatives:
        conjunction = ", or "
    draft.comment("label", source + conjunction + ", ".join(alternatives))


def _describe_matter(
    item: PhotoObject, substance: Matter, grip: float
) -> dict[str, Any]:
    """Return the entry's label, mask, shape and matter; `grip` is the least friction."""
    entry = {
        "label": item.label,
        "mask": item.id,
        "shape": shape_entry(item.outline),
    }
    if isinstance(item.outline, Disc):
        entry["solid"] = substance.solid.value
    return {
        **entry,
        "mass": short(substance.mass),
        "friction": max(substance.friction, grip),
        "elasticity": substance.elasticity,
    }


def _add_rolling(
    draft: _EntryDraft,
    item: PhotoObject,
    substance: Matter,
    vehicle: Vehicle | None,
    boundaries: BoundaryGuess,
) -> None:
    """Add the rolling resistance of an object that rolls."""
    # Circles roll when seen from the side; from above only spheres roll.
    rolls = isinstance(item.outline, Disc) and (
        boundaries.view is View.SIDE or substance.solid is Solid.SPHERE
    )
    can_move = not item.cut and item.id not in boundaries.held_ids
    # Wheels roll even if the object is not a circle.
    if vehicle is not None:
        wheel = kind("wheel").material
        draft.entry["rolling"] = max(substance.rolling, wheel.rolling)
    elif rolls and can_move:
        draft.entry["rolling"] = substance.rolling
    else:
        del draft.sources["rolling"]


def _add_motion(draft: _EntryDraft, item: PhotoObject, is_static: bool) -> None:
    """Add the velocity of an object, or the reason why it is static."""
    if not (item.cut or is_static):
        draft.entry["velocity"] = [0, 0]
        return
    reason = "nothing that is seen keeps it from falling"
    if item.cut:
        reason = "cut off by the photo's border"
    draft.entry["motion"] = "static"
    draft.comment("motion", f"{reason}, so it is held; dynamic lets it go")


def _add_vehicle(draft: _EntryDraft, vehicle: Vehicle) -> None:
    """Add the wheels and the direction of a vehicle."""
    draft.entry.update(vehicle_entry(vehicle))
    draft.sources["wheels"] = provenance("circles", vehicle.confidence)
    draft.sources["facing"] = provenance("cabin", FACING_CONFIDENCE)
    draft.comment(
        "wheels",
        f"circles at its lower edge (confidence {vehicle.confidence:g});"
        " they turn and carry it",
    )
    draft.comment("facing", "a guess: the cabin is behind the middle; left or right")


def _add_layer(
    draft: _EntryDraft,
    layer: int,
    orders: Sequence[OcclusionOrder],
    names: Mapping[int, str],
) -> None:
    """Add the layer of an object that hides parts of others."""
    draft.entry["layer"] = layer
    confidence = max(order.confidence for order in orders)
    draft.sources["layer"] = provenance("outlines", confidence)
    *first_names, last_name = [names[order.back] for order in orders]
    conjunction = ""
    if first_names:
        conjunction = " and "
    hidden_names = ", ".join(first_names) + conjunction + last_name
    draft.comment("layer", f"in front: it hides parts of {hidden_names}")


def _mask_source(detections: Detections, i: int) -> str:
    if i in detections.prompts:
        source = "pointed at"
    else:
        source = detections.source
    confidence = detections.confidence.get(i, 1.0)
    return detections.mask_sources.get(i) or provenance(source, confidence)


# Comments of the document.


def scene_comments(
    detections: Detections,
    objects: Sequence[PhotoObject],
    specks: int,
    boundaries: BoundaryGuess,
) -> dict[str, str]:
    """Return comments on the sources of all estimates, by dotted path."""
    sources = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "kept": "as the scene had them"
        + (", and where you pointed" if detections.prompts else ""),
    }
    origin = sources.get(detections.source, f"found by {detections.source}")
    left_out = ""
    if specks:
        left_out = f"; {specks} specks of under {SMALLEST_OBJECT} px left out"
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
    if detections.doubtful:
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
