"""The scene document: entries, names, comments, sources and files."""

from __future__ import annotations

import difflib
import fnmatch
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, degrees, floor
from pathlib import Path
from types import MappingProxyType
from typing import Any
from zlib import crc32

import numpy as np

from physgen import __version__
from physgen.compile.shapes import fill_polygon, mask_crc
from physgen.files import free_folder, resource, write_atomic, write_with_backup
from physgen.geometry.polygon import Array, Disc, Outline, mass_properties
from physgen.geometry.scale import slow_motion
from physgen.maps import Keep, ignore_kept_file, write_assets, write_png
from physgen.materials import kind, nouns
from physgen.messages import Message, Note, did_you_mean
from physgen.perceive.occlusion import drawing_layers, occlusion_orders
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Doubt,
    Labels,
    Matter,
    Name,
    PerceivedScene,
    PhotoObject,
    Shadows,
    Wall,
)
from physgen.perceive.support.viewpoint import DOUBTS
from physgen.perceive.wheels import Vehicle
from physgen.photometry import DistantLight
from physgen.problems import InputError, Place, Problem
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
from physgen.scene.provenance import stated_scale, table_confidences
from physgen.scene.saving import note_files, note_scene, save_scene
from physgen.scene.scene import ADD_OBJECT, Solid, View
from physgen.scene.schema import schema_at
from physgen.scene.write import scene_text
from physgen.scene.yaml_comments import with_comments, without_comments
from physgen.scene.yaml_edit import mark_values, write, written_anew
from physgen.text import counted, listed

GENERIC = ("object", "thing")
"""Labels without information."""
USUAL = ("friction", "elasticity")
"""Numbers that the file omits at their defaults, the values of an unknown material."""
PERHAPS = 0.2
"""Least confidence of a region with an entry."""
LIKELY = 0.1
"""Least probability of an alternative label in a comment."""
TABLE = {"friction": 0.2}
"""The table's entry in new scenes seen from above."""
SCHEMA = "scene-1.schema.json"
"""A copy in the assets lets editors complete and check the scene offline and at any
path.
"""
BARE = {"mask", "from", "confidence"}
"""Keys of an object that the user took from `doubtful:` or gave by its mask alone; a
refresh adds the other keys.
"""
MOTION_BLUR = 0.5
"""Motion blur of new files: the shutter is open for half of a frame's time, as in film
cameras.
"""
HOLD = 10
"""Frames of new files that show the photo before the motion: a third of a second."""


@dataclass(frozen=True)
class Names:
    """Labels and names of the objects, by id."""

    # The objects with their labels.
    objects: Sequence[PhotoObject]
    labels: Mapping[int, Name]
    # Sources of the labels, for `from`; `""` for labels of the user.
    sources: Mapping[int, str]
    confidence: Mapping[int, float]
    # Names without the user's new labels.
    before: Mapping[int, str]
    # Ids of objects with a new label of the user.
    renamed: set[int]


def slug(label: str) -> str:
    """Return a label as the start of a name.

    The result has letters, digits and -, begins with a letter and is at most 48
    characters long.
    """
    text = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")[:48].strip("-")
    if not text:
        return "object"
    return text if text[0].isalpha() else f"object-{text}"


def object_names(
    objects: Sequence[PhotoObject], kept: Mapping[int, str] | None = None
) -> dict[int, str]:
    """Return a name for every object by id, numbered per label from left to right.

    Names in `kept` stay.
    """
    kept = kept or {}
    used_names = set(kept.values())
    objects_by_position = sorted(
        objects,
        key=lambda t: (round(float(mass_properties(t.outline).center[0]), 1), t.id),
    )
    counts: dict[str, int] = {}
    result = {}
    for item in objects_by_position:
        if item.id in kept:
            result[item.id] = kept[item.id]
            continue
        start = slug(item.label)
        counts[start] = counts.get(start, 0) + 1
        while f"{start}-{counts[start]}" in used_names:
            counts[start] += 1
        result[item.id] = f"{start}-{counts[start]}"
    return result


def relabel_objects(
    objects: Sequence[PhotoObject], renames: Sequence[str], called: Mapping[int, str]
) -> tuple[list[PhotoObject], set[int]]:
    """Return the objects with their new labels, and the ids of objects with a new
    label.

    `called` gives the objects' names by id. Raises InputError with every invalid NAME
    of `renames`, each NAME=TEXT.
    """
    labels, problems = renamed_labels(renames, called)
    if problems:
        raise InputError(problems)
    return [
        replace(t, label=labels[t.id]) if t.id in labels else t for t in objects
    ], set(labels)


def renamed_labels(
    renames: Sequence[str], called: Mapping[int, str]
) -> tuple[dict[int, str], list[Problem]]:
    """Return the new labels by object id, and problems with unknown names.

    An exact name takes precedence over a pattern.
    """
    labels: dict[int, str] = {}
    exact: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        exact_ids = [i for i, n in called.items() if name in (n, str(i))]
        hits = exact_ids or [
            i for i, n in called.items() if fnmatch.fnmatchcase(n, name)
        ]
        if not (sign and text and hits):
            matches = difflib.get_close_matches(name, called.values(), 1)
            known_names = ", ".join(list(called.values())[:8]) + (
                ", ..." if len(called) > 8 else ""
            )
            fix = f"the objects are {known_names}"
            if matches and matches[0] != name:
                fix = did_you_mean(matches[0])
            message = Message.LABEL_WITHOUT_NAME
            if sign and text:
                message = Message.LABEL_OF_NO_OBJECT
            problems.append(
                message.problem(Place("--label"), "", f'"{rename}"', fix=fix)
            )
        (exact if exact_ids else labels).update(dict.fromkeys(hits, text))
    return labels | exact, problems


def label_confidences(
    found: Detections,
    named: Mapping[int, Name],
    guessed: Mapping[int, Name],
    renamed: set[int],
) -> dict[int, float]:
    """Return the confidence of each label: 1 if the user gave or changed it."""
    user_names = found.names if found.object_names or found.named_by == "given" else {}
    user_ids = {
        i
        for i in user_names
        if i not in guessed or found.names[i].label != guessed[i].label
    } | renamed
    return {i: 1.0 if i in user_ids else name.confidence for i, name in named.items()}


def unknown_label(label: str) -> Problem | None:
    """Return a warning about a label without an entry in the material table, or
    None.
    """
    label_kind = kind(label)
    if label_kind.noun or label_kind.material.name != "unknown" or label in GENERIC:
        return None
    known_nouns = sorted({word for _, words in nouns() for word in words})
    matches = (
        difflib.get_close_matches(text, known_nouns, 1)
        for text in (label.lower(), label.lower().split()[-1])
    )
    close = next((match for match in matches if match), None)
    fix = "name a material, too, as in: wooden spoon"
    if close:
        fix = did_you_mean(close[0])
    return Message.UNKNOWN_LABEL.warning(Place("--label"), "", f'"{label}"', fix=fix)


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


FACING_CONFIDENCE = 0.6
"""Not measured: buses and bicycles look alike from both ends."""


def vehicle_entry(vehicle: Vehicle) -> dict[str, Any]:
    """Return `wheels:` and `facing:` of an object."""
    wheels = [
        {
            "center": [short(x) for x in wheel.center],
            "radius": short(wheel.radius),
        }
        for wheel in vehicle.wheels
    ]
    return {"wheels": wheels, "facing": vehicle.facing.value}


def _mask_source(found: Detections, i: int) -> str:
    source = "pointed at" if i in found.prompts else found.source
    return found.mask_sources.get(i) or provenance(source, found.confidence.get(i, 1.0))


def light_entry(light: DistantLight) -> dict[str, Any]:
    """Return the scene's `light:`."""
    return {
        "direction": [round(v, 3) for v in light.direction],
        "intensity": round(min(light.intensity, 1000.0), 3),
        "ambient": round(light.ambient, 3),
    }


def view_entry(shadows: Shadows, side: bool) -> dict[str, Any]:
    """Return the entries of `world:` that place shadows; none if no shadow is
    visible.
    """
    if shadows.clean is None or not side:
        return {}
    return {"tilt": shadows.tilt} | (
        {} if shadows.backdrop is None else {"backdrop": shadows.backdrop}
    )


def shape_entry(outline: Outline) -> dict[str, Any]:
    """Return `shape:` of an outline, to 0.01 px.

    Radii are rounded down, so that touching balls do not overlap.
    """
    if isinstance(outline, Disc):
        (center,) = corners(outline.center[None])
        return {
            "circle": {
                "center": center,
                "radius": short(max(0.01, floor(outline.radius * 100) / 100)),
            }
        }
    rings = outline.rings
    if len(rings) == 1 and not rings[0].holes:
        if (box := _box(rings[0].outer)) is not None:
            return {"box": box}
        return {"polygon": corners(rings[0].outer)}
    pieces = []
    for ring in rings:
        piece: dict[str, Any] = {"outline": corners(ring.outer)}
        if ring.holes:
            piece["holes"] = [corners(hole) for hole in ring.holes]
        pieces.append(piece)
    return {"polygons": pieces}


def shape_words(outline: Outline, solid: Solid) -> str:
    """Describe a shape in words, e.g. sphere of radius 20.13; its numbers are in the
    assets.
    """
    if isinstance(outline, Disc):
        return f"{solid.value} of radius {floor(outline.radius * 100) / 100:g}"
    if len(outline.rings) == 1 and (box := _box(outline.rings[0].outer)) is not None:
        return "box of {:g} x {:g}".format(*box["size"])
    return f"outline of {sum(len(ring.outer) for ring in outline.rings)} corners"


def _box(points: Array) -> dict[str, Any] | None:
    """Return `box:` if the points are four corners with right angles, else None."""
    if len(points) != 4:
        return None
    sides = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(*sides.T)
    if (
        np.hypot(*(sides[0] + sides[2])) > 1e-6
        or abs(sides[0] @ sides[1]) > 1e-6 * lengths.max() ** 2
    ):
        return None
    (center, size) = corners(np.array([points.mean(axis=0), lengths[:2]]))
    angle = short(round(degrees(atan2(sides[0][1], sides[0][0])), 3) + 0.0)
    box: dict[str, Any] = {"center": center, "size": size}
    return box | ({"angle": angle} if angle else {})


def corners(points: Array) -> list[list[float]]:
    """Return `(K, 2)` px as [[x, y], ...] to 0.01 px, without repeated points."""
    grid_points = np.round(points, 2) + 0.0
    is_new = np.any(grid_points != np.roll(grid_points, 1, axis=0), axis=1)
    distinct = grid_points[is_new] if is_new.sum() >= 3 else grid_points
    return [[short(x), short(y)] for x, y in distinct]


def short(value: float) -> float:
    """Return the number, as an integer if possible: 18 instead of 18.0."""
    return int(value) if float(value).is_integer() else float(value)


def wall_entry(wall: Wall) -> dict[str, Any]:
    """Return a boundary's entry: a segment of two points, or a polyline of more."""
    points = [[short(x), short(y)] for x, y in wall.points]
    entry: dict[str, Any] = (
        {"segment": points} if len(points) == 2 else {"polyline": points}
    )
    usual = schema_at(("boundaries", wall.name)) or {}
    for key, value in (("friction", wall.friction), ("elasticity", wall.elasticity)):
        entry |= {} if value == usual["properties"][key]["default"] else {key: value}
    return entry | {"from": provenance(wall.source, wall.confidence)}


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


def summary(perceived: PerceivedScene) -> list[str]:
    """Return the results, their confidence and possible corrections as lines.

    The first line is short; one line per subject follows.
    """
    document, comments = perceived.document, perceived.comments
    objects, world = document["objects"], document["world"]
    confidences = {name: mask_confidence(item) for name, item in objects.items()}
    ends = sorted(
        {min(confidences.values(), default=0.0), max(confidences.values(), default=0.0)}
    )
    confidence = (
        f", confidence {' to '.join(f'{end:.2f}' for end in ends)}"
        if confidences
        else ""
    )
    doubtful_names = [
        f"{name} ({value:.2f})"
        for name, value in confidences.items()
        if value < DOUBTS.unsure
    ]
    check = (
        f", but look at {listed([name.split()[0] for name in doubtful_names], 'and')}"
    )
    suits = f"{perceived.suitability}{check if doubtful_names and str(perceived.suitability) == 'good' else ''}"
    first = f"{counted(len(objects), 'object')}{confidence}; suitability: {suits}"
    if not objects:
        lines = [first, f"  objects   {Note.NO_OBJECTS.text(fix=ADD_OBJECT)}"]
        if doubts := _doubtful_row(perceived, doubtful_names):
            lines.append(f"  doubtful  {doubts}")
        return lines
    table = {
        "objects": label_counts(
            {k: item["label"] for k, item in enumerate(objects.values())}
        ),
        "scale": Note.SCALE.text(
            scale=world["pixels_per_meter"],
            reason=comments.get("world.pixels_per_meter", ""),
        ),
        "view": f"{world['view']}: {comments.get('world.view', '').partition(': ')[2]}",
    }
    table["support"] = _support_row(document)
    table["motion"] = _motion_row(perceived)
    if doubts := _doubtful_row(perceived, doubtful_names):
        table["doubtful"] = doubts
    return [
        first,
        *(f"  {name:<9} {' '.join(text.split())}" for name, text in table.items()),
    ]


def _support_row(document: Mapping[str, Any]) -> str:
    """Return the names of the boundaries and of the static objects."""
    walls = [name for name in document["boundaries"] if name != "bottom"]
    row = ", ".join(walls) or Note.NO_BOUNDARY.text()
    static = []
    for name, item in document["objects"].items():
        if item.get("motion") == "static":
            static.append(name)
    if not static:
        return row
    return Note.STATIC.text(boundaries=row, names=", ".join(static))


def _motion_row(perceived: PerceivedScene) -> str:
    """Return the row with the pushes."""
    pushes = []
    for name, item in perceived.document["objects"].items():
        if any(item.get("velocity", ())):
            comment = perceived.comments.get(f"objects.{name}.velocity", ", as before")
            direction = comment.split(", ")[1].partition(";")[0]
            pushes.append(Note.PUSHED.text(name=name, way=direction))
    return "; ".join(pushes) or Note.NOTHING_PUSHED.text()


def _doubtful_row(perceived: PerceivedScene, unsure: Sequence[str]) -> str:
    """Return the row with `unsure` objects and doubtful regions."""
    document, comments = perceived.document, perceived.comments
    doubts: list[str] = []
    if unsure:
        doubts.append(Note.UNSURE.text(names=", ".join(unsure)))
    # Regions drawn by the user have no confidence and are not doubtful.
    regions = [
        name
        for name, entry in document.get("doubtful", {}).items()
        if "confidence" in entry
    ]
    if regions:
        name = regions[0]
        doubt = Note.ONE_REGION.text(name=name)
        if len(regions) > 1:
            doubt = Note.SEVERAL_REGIONS.text(count=len(regions), name=name)
        doubts.append(doubt)
    reasons: dict[str, list[str]] = {}
    for name in regions:
        if reason := comments.get(f"doubtful.{name}"):
            reasons.setdefault(reason, []).append(name)
    for reason, names_of_reason in reasons.items():
        doubts.append(f"{listed(names_of_reason, 'and')}: {reason}")
    if not doubts:
        return ""
    return "; ".join([*doubts, "--box and --point add missing objects"])


def mask_confidence(item: Mapping[str, Any]) -> float:
    """Return the confidence of an object's mask, from its `from`."""
    return float(item["from"]["mask"].rpartition(" ")[2])


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
