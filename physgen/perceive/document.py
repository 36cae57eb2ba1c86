"""The scene document: entries of objects, names, boundaries, light, comments and
provenance; its files.
"""

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
    recorded,
)
from physgen.scene.provenance import provenance as provenance
from physgen.scene.provenance import stated_scale, table_confidences
from physgen.scene.saving import note_files, note_scene, save_scene
from physgen.scene.scene import ADD_OBJECT, Solid, View
from physgen.scene.schema import schema_at
from physgen.scene.write import scene_text
from physgen.scene.yaml_edit import (
    marked,
    with_comments,
    without_comments,
    write,
    written_anew,
)
from physgen.text import counted, listed

GENERIC = ("object", "thing")
"""Labels without meaning."""
USUAL = ("friction", "elasticity")
"""Numbers that the file leaves out at their defaults, which are those of an unknown
material.
"""
PERHAPS = 0.2
"""Confidence from which a region is worth a line."""
LIKELY = 0.1
"""Chance from which another label is named."""
TABLE = {"friction": 0.2}  # what is written where it is seen from above
SCHEMA = "scene-1.schema.json"
"""Copied into the assets, so that editors complete and check the scene wherever it
lies, offline too.
"""
BARE = {"mask", "from", "confidence"}
"""Keys of an object that the user took from `doubtful:`, or gave by its mask alone: a
refresh fills in the rest.
"""
MOTION_BLUR = 0.5
"""Of new files: a shutter that is open for half of a frame's time, as film cameras
have.
"""
HOLD = 10
"""Frames of new files that show the photo before the motion: a third of a second."""


@dataclass(frozen=True)
class Names:
    """Labels and names of the objects, by id."""

    objects: Sequence[PhotoObject]  # with their labels
    labels: Mapping[int, Name]
    # sources of the labels, for `from`; `""` where they are the user's
    sources: Mapping[int, str]
    confidence: Mapping[int, float]
    before: Mapping[int, str]  # names without the user's new labels
    renamed: set[int]  # ids of objects that the user gave a new label


def slug(label: str) -> str:
    """Return a label as the start of a name: letters, digits and -, beginning with a
    letter, at most 48 long.
    """
    text = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")[:48].strip("-")
    if not text:
        return "object"
    return text if text[0].isalpha() else f"object-{text}"


def object_names(
    objects: Sequence[PhotoObject], kept: Mapping[int, str] | None = None
) -> dict[int, str]:
    """Return a name for every object, by id, from left to right: its label and a
    number; names in `kept` stay.
    """
    kept = kept or {}
    taken = set(kept.values())
    ordered = sorted(
        objects,
        key=lambda t: (round(float(mass_properties(t.outline).center[0]), 1), t.id),
    )
    counts: dict[str, int] = {}
    result = {}
    for item in ordered:
        if item.id in kept:
            result[item.id] = kept[item.id]
            continue
        start = slug(item.label)
        counts[start] = counts.get(start, 0) + 1
        while f"{start}-{counts[start]}" in taken:
            counts[start] += 1
        result[item.id] = f"{start}-{counts[start]}"
    return result


def relabel_objects(
    objects: Sequence[PhotoObject], renames: Sequence[str], called: Mapping[int, str]
) -> tuple[list[PhotoObject], set[int]]:
    """Objects, named as in `called`, under their new labels, and the ids of those that
    got one.

    Raises InputError with every wrong NAME of `renames`, each NAME=TEXT.
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
    """Return the new label of each object that one of `renames` names, by id, a name
    before a pattern; and what is wrong.
    """
    labels: dict[int, str] = {}
    exact: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        own = [i for i, n in called.items() if name in (n, str(i))]
        hits = own or [i for i, n in called.items() if fnmatch.fnmatchcase(n, name)]
        if not (sign and text and hits):
            near = difflib.get_close_matches(name, called.values(), 1)
            known = ", ".join(list(called.values())[:8]) + (
                ", ..." if len(called) > 8 else ""
            )
            fix = f"the objects are {known}"
            if near and near[0] != name:
                fix = did_you_mean(near[0])
            wrong = Message.LABEL_WITHOUT_NAME
            if sign and text:
                wrong = Message.LABEL_OF_NO_OBJECT
            problems.append(wrong.problem(Place("--label"), "", f'"{rename}"', fix=fix))
        (exact if own else labels).update(dict.fromkeys(hits, text))
    return labels | exact, problems


def label_confidences(
    found: Detections,
    named: Mapping[int, Name],
    guessed: Mapping[int, Name],
    renamed: set[int],
) -> dict[int, float]:
    """Confidence of each label: 1 where the user gave it, or changed what was guessed."""
    given = found.names if found.object_names or found.named_by == "given" else {}
    own = {
        i for i in given if i not in guessed or found.names[i].label != guessed[i].label
    } | renamed
    return {i: 1.0 if i in own else name.confidence for i, name in named.items()}


def unknown_label(label: str) -> Problem | None:
    """Return a warning about a label that the material table does not know; None for
    one that it knows.
    """
    what = kind(label)
    if what.noun or what.material.name != "unknown" or label in GENERIC:
        return None
    known = sorted({word for _, every in nouns() for word in every})
    matches = (
        difflib.get_close_matches(text, known, 1)
        for text in (label.lower(), label.lower().split()[-1])
    )
    close = next((match for match in matches if match), None)
    fix = "name a material, too, as in: wooden spoon"
    if close:
        fix = did_you_mean(close[0])
    return Message.UNKNOWN_LABEL.warning(Place("--label"), "", f'"{label}"', fix=fix)


# entries


@dataclass(frozen=True)
class ObjectLabels:
    """Labels of objects, by id."""

    names: Mapping[int, Name]
    sources: Mapping[int, str]
    """Sources of the labels, for `from`; `""` for those of the user."""


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
    """`objects:`, and comments by dotted path. `table` is the backend of matter."""
    layer_of, kept = drawing_layers(
        occlusion_orders(found.labels, [item.id for item in objects]), found.layers
    )
    entries: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for item in sorted(objects, key=lambda t: list(called).index(t.id)):
        name, its = called[item.id], matter[item.id]
        at = f"objects.{name}"
        sources = {"mask": _mask_source(found, item.id)}
        if labels.sources[item.id]:
            guess = labels.names[item.id]
            sources["label"] = provenance(
                guess.source or labels.sources[item.id], guess.confidence
            )
            likely = [
                f"{label} {chance:g}"
                for label, chance in guess.likely
                if chance >= LIKELY and label != item.label
            ]
            comments[f"{at}.label"] = (
                sources["label"] + (", or " if likely else "") + ", ".join(likely)
            )
        sources |= {
            key: provenance(table, sure)
            for key, sure in table_confidences(its.confidence).items()
        }
        grip = boundaries.grip.get(item.id, 0.0)
        one: dict[str, Any] = {
            "label": item.label,
            "mask": item.id,
            "shape": shape_entry(item.outline),
            **({"solid": its.solid.value} if isinstance(item.outline, Disc) else {}),
            "mass": short(its.mass),
            "friction": max(its.friction, grip),
            "elasticity": its.elasticity,
        }
        held = item.id in boundaries.held
        # circles roll seen from the side, spheres seen from above, too
        rolls = isinstance(item.outline, Disc) and (
            boundaries.view is View.SIDE or its.solid is Solid.SPHERE
        )
        vehicle = None if held else vehicles.get(item.id)
        if vehicle is not None:
            one["rolling"] = max(its.rolling, kind("wheel").material.rolling)
        elif rolls and not (item.cut or held):
            one["rolling"] = its.rolling
        else:
            del sources["rolling"]
        if its.surface:
            comments[f"{at}.friction"] = its.surface
        if not (item.cut or held):
            one["velocity"] = [0, 0]
        else:
            why = (
                "cut off by the photo's border"
                if item.cut
                else "nothing that is seen keeps it from falling"
            )
            one["motion"] = "static"
            comments[f"{at}.motion"] = f"{why}, so it is held; dynamic lets it go"
        if its.friction < grip:
            sources["friction"] = provenance("lies on a slope", 0.5)
            comments[f"{at}.friction"] = (
                "at least this much, since it lies still on a slope"
            )
        if vehicle is not None:
            one |= vehicle_entry(vehicle)
            sources["wheels"] = provenance("circles", vehicle.confidence)
            sources["facing"] = provenance("cabin", FACING_CONFIDENCE)
            comments[f"{at}.wheels"] = (
                f"circles at its lower edge (confidence {vehicle.confidence:g});"
                " they turn and carry it"
            )
            comments[f"{at}.facing"] = (
                "a guess: the cabin is behind the middle; left or right"
            )
        if item.id in layer_of:
            behind = [order for order in kept if order.front == item.id]
            one["layer"] = layer_of[item.id]
            sources["layer"] = provenance(
                "outlines", max(order.confidence for order in behind)
            )
            *names, last = [called[order.behind] for order in behind]
            hidden = ", ".join(names) + (" and " if names else "") + last
            comments[f"{at}.layer"] = f"in front: it hides parts of {hidden}"
        comments[f"{at}.mask"] = (
            f"{sources['mask']}, {shape_words(item.outline, its.solid)}"
        )
        comments[f"{at}.mass"] = f"g, {sources['mass']}: {its.reason}"
        entries[name] = {**one, "from": sources}
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
    """Return the part of `world:` that places shadows; empty where none are seen."""
    if shadows.clean is None or not side:
        return {}
    return {"tilt": shadows.tilt} | (
        {} if shadows.backdrop is None else {"backdrop": shadows.backdrop}
    )


def shape_entry(outline: Outline) -> dict[str, Any]:
    """`shape:` of an outline, to 0.01 px; radii are rounded down, so that balls that
    touch do not overlap.
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
    """Return a shape in words, whose numbers lie in the assets: sphere of radius 20.13."""
    if isinstance(outline, Disc):
        return f"{solid.value} of radius {floor(outline.radius * 100) / 100:g}"
    if len(outline.rings) == 1 and (box := _box(outline.rings[0].outer)) is not None:
        return "box of {:g} x {:g}".format(*box["size"])
    return f"outline of {sum(len(ring.outer) for ring in outline.rings)} corners"


def _box(points: Array) -> dict[str, Any] | None:
    """`box:` of four corners at right angles, else None."""
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
    """`(K, 2)` px -> [[x, y], ...] to 0.01 px, none twice in a row."""
    rounded = np.round(points, 2) + 0.0
    fresh = np.any(rounded != np.roll(rounded, 1, axis=0), axis=1)
    kept = rounded[fresh] if fresh.sum() >= 3 else rounded
    return [[short(x), short(y)] for x, y in kept]


def short(value: float) -> float:
    """Return the number, as a whole one where it is one: 18, not 18.0."""
    return int(value) if float(value).is_integer() else float(value)


def wall_entry(wall: Wall) -> dict[str, Any]:
    """One boundary: a segment of two points, a polyline of more."""
    points = [[short(x), short(y)] for x, y in wall.points]
    entry: dict[str, Any] = (
        {"segment": points} if len(points) == 2 else {"polyline": points}
    )
    usual = schema_at(("boundaries", wall.name)) or {}
    for key, value in (("friction", wall.friction), ("elasticity", wall.elasticity)):
        entry |= {} if value == usual["properties"][key]["default"] else {key: value}
    return entry | {"from": provenance(wall.source, wall.confidence)}


# comments


def scene_comments(
    found: Detections,
    objects: Sequence[PhotoObject],
    specks: int,
    boundaries: BoundaryGuess,
) -> dict[str, str]:
    """Sentences about the source of each guess, by dotted path."""
    sources = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "kept": "as the scene had them"
        + (", and where you pointed" if found.prompts else ""),
    }
    how = sources.get(found.source, f"found by {found.source}")
    left_out = (
        f"; {specks} specks of under {SMALLEST_OBJECT} px left out" if specks else ""
    )
    counts = label_counts({t.id: t.label for t in objects})
    comments = {
        "physgen": "as perceived in a photo: change any number, then physgen render THIS-FILE",
        "world.view": f"side or top: {boundaries.reason.partition(' and ')[0]} (confidence {boundaries.confidence:g})",
        "objects": f"{counts}, {how}, counted from left to right{left_out}",
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
    """Return the number of objects of each label: 2 x ball, 1 x block."""
    counts: dict[str, int] = {}
    for label in labels.values():
        counts[label or "object"] = counts.get(label or "object", 0) + 1
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{n} x {label}" for label, n in ordered)


def summary(perceived: PerceivedScene) -> list[str]:
    """What was found, how sure it is, and how to correct it: the first line in short,
    then a line for each subject.
    """
    document, comments = perceived.document, perceived.comments
    objects, world = document["objects"], document["world"]
    sure = {name: mask_confidence(item) for name, item in objects.items()}
    ends = sorted({min(sure.values(), default=0.0), max(sure.values(), default=0.0)})
    confidence = (
        f", confidence {' to '.join(f'{end:.2f}' for end in ends)}" if sure else ""
    )
    unsure = [
        f"{name} ({one:.2f})" for name, one in sure.items() if one < DOUBTS.unsure
    ]
    check = f", but look at {listed([name.split()[0] for name in unsure], 'and')}"
    suits = f"{perceived.suitability}{check if unsure and str(perceived.suitability) == 'good' else ''}"
    first = f"{counted(len(objects), 'object')}{confidence}; suitability: {suits}"
    if not objects:
        lines = [first, f"  objects   {Note.NO_OBJECTS.text(fix=ADD_OBJECT)}"]
        if doubts := _doubtful_row(perceived, unsure):
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
    if doubts := _doubtful_row(perceived, unsure):
        table["doubtful"] = doubts
    return [
        first,
        *(f"  {name:<9} {' '.join(text.split())}" for name, text in table.items()),
    ]


def _support_row(document: Mapping[str, Any]) -> str:
    """Return the names of the boundaries, and of the objects that do not move."""
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
    """Return the pushes of the summary."""
    pushes = []
    for name, item in perceived.document["objects"].items():
        if any(item.get("velocity", ())):
            comment = perceived.comments.get(f"objects.{name}.velocity", ", as before")
            direction = comment.split(", ")[1].partition(";")[0]
            pushes.append(Note.PUSHED.text(name=name, way=direction))
    return "; ".join(pushes) or Note.NOTHING_PUSHED.text()


def _doubtful_row(perceived: PerceivedScene, unsure: Sequence[str]) -> str:
    """Return what the summary says of `unsure` objects and of doubtful regions."""
    document, comments = perceived.document, perceived.comments
    doubts: list[str] = []
    if unsure:
        doubts.append(Note.UNSURE.text(names=", ".join(unsure)))
    # a user's regions have no confidence
    regions = [
        name
        for name, one in document.get("doubtful", {}).items()
        if "confidence" in one
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
    """Confidence of an object's mask, from its `from`."""
    return float(item["from"]["mask"].rpartition(" ")[2])


def with_doubtful(
    labels: Labels, doubtful: Sequence[Doubt]
) -> tuple[Labels, dict[str, Any], dict[str, str]]:
    """Return the label map with ids for regions that may be objects, `doubtful:`, and
    its comments.

    A region ends where an object is.
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


# files


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
    """Writes the assets, and the scene file where `output` is given; returns the
    scene's text.

    `before` is the text of a scene that was perceived again: lines, comments and shapes
    stay where nothing is new; `known` is the record beside it.

    Assets go to `OUTPUT-STEM.assets/` beside the scene; without `output`, to those of
    the file `stdout` that the caller writes the text to, or to `NAME.assets/` in the
    current folder. Assets of another scene in the way stay, and the new ones go to
    `OUTPUT-STEM-2.assets/`. `photo` is its file; None where no scene can name the file
    as it is. Of that, and of a file outside the scene's folder, the pixels are written
    as `NAME.png`: a copy of the file would keep where the photo was taken. Existing
    files that differ are kept as `NAME~` (`keep` is called with them).
    """
    target = output or stdout or Path(f"{name}.yaml")
    folder = target.parent
    inside = photo is not None and photo.resolve().is_relative_to(folder.resolve())
    copy = "" if inside else _free_of_maps(f"{name}.png")
    heads = ("physgen", "image", "assets", "maps")
    body = {key: value for key, value in perceived.document.items() if key not in heads}
    old: dict[str, Any] = {} if before is None else marked(before).data()
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

    # a folder that is there may be another scene's
    assets, there = free_folder(target)
    if output is not None:
        same = (
            there
            and output.is_file()
            and written(there).encode() == output.read_bytes()
        )
        folder.mkdir(parents=True, exist_ok=True)
    else:
        same = there and not any(
            there.name.encode() in one.read_bytes() for one in folder.glob("*.yaml")
        )
    assets = there if there and same else assets
    ours = {*(f"{name}.png" for name in MAPS), OUTLINES, OVERVIEW, SCHEMA}
    for file, crc in recorded(assets, "files").items():
        if (
            file in ours
            and (assets / file).is_file()
            and crc32((assets / file).read_bytes()) == crc
        ):
            (assets / file).unlink()  # as it was written: nobody painted in it
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
    made = sorted(file for file in assets.iterdir() if file.name in ours)
    record["files"] = {file.name: crc32(file.read_bytes()) for file in made}
    write_atomic(
        assets / RECORD, json.dumps(record, ensure_ascii=False).encode() + b"\n"
    )
    text = written(assets)
    note_files(assets, {*ours, RECORD, copy} - {""})
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
    """Return the text with new data, and with comments on the values that are new, or
    whose reason is.

    Comments of perception on values that are the user's go. Objects of nothing but a
    mask, and boundaries that are new, are written as in a new file.
    """
    objects, changed = (
        old.get("objects", {}),
        old.get("objects", {}).keys() != new["objects"].keys(),
    )
    bare = {name for name, was in objects.items() if was.keys() <= BARE}
    fresh = {
        key for key in perceived.comments if value_at(new, key) != value_at(old, key)
    }
    fresh |= {key for key in perceived.comments if bare & set(key.split(".")[1:2])}
    fresh -= set() if changed else {"objects"}
    stale = (
        ["world.pixels_per_meter"] if perceived.wrote.get("", {}).get("given") else []
    )
    same = []  # the file says how they were found first
    for name, item in perceived.document["objects"].items():
        wrote, now = known.entry(name, item), item.get("from", {})
        was = wrote.get("from", {})
        theirs = {
            key
            for key in ("label", "mass", "friction")
            if key in was and key not in now
        }
        stale += [
            f"objects.{name}.{key}"
            for key in theirs | perceived.wrote.get(name, {}).keys()
        ]
        stale += [] if any(item.get("velocity", ())) else [f"objects.{name}.velocity"]
        if was.get("mask") == now.get("mask") and wrote.get("label") == item.get(
            "label"
        ):
            same += [
                key
                for part in ("mask", "mass")
                if (key := f"objects.{name}.{part}") not in fresh
            ]
        else:
            changed = True
    same += [] if changed else ["objects"]
    comments = {
        key: words
        for key, words in perceived.comments.items()
        if key not in (*stale, *same)
    }
    for section, names in (
        ("objects", bare),
        ("boundaries", old.get("boundaries", {})),
    ):
        for name in names:
            now = new.get(section, {}).get(name)
            if now is not None and now != old[section][name]:
                text = written_anew(text, (section, name), now)
    text = without_comments(
        write(text, new), [key.split(".") for key in stale], known.comments
    )
    return with_comments(text, comments, known.comments, fresh)


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
    """Return the objects as the file has them, and `outlines.json` with their shapes
    and solids, and their `wholes` by id.

    The file has no shape, solid, `from` or default but where it was `written`, or where
    the object's mask is no id.
    """
    short, stored, usual = {}, [], (schema_at(("objects", "")) or {})["properties"]
    for name, item in objects.items():
        kept, mask = written.get(name, {}), item.get("mask")
        if "shape" in item and "shape" not in kept and isinstance(mask, int):
            ours = ["shape"] if "solid" in kept else ["shape", "solid"]
            entry = {"crc": mask_crc(labels, mask)} | {
                key: item[key] for key in ours if key in item
            }
            if mask in wholes:
                entry["whole"] = shape_entry(wholes[mask])
            stored.append(f"{json.dumps(str(mask))}: {json.dumps(entry)}")
            item = {key: value for key, value in item.items() if key not in ours}
        short[name] = {
            key: value
            for key, value in item.items()
            if key in kept
            or (key != "from" and (key not in USUAL or value != usual[key]["default"]))
        }
    return short, "{\n" + ",\n".join(stored) + "\n}\n"


def _free_of_maps(name: str) -> str:
    """Return the photo's name among the assets: no other picture has it."""
    taken = {*MAPS, Path(OVERVIEW).stem}
    return f"photo-{name}" if Path(name).stem.lower() in taken else name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
