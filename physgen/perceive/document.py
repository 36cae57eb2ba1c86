"""The scene document: entries of objects, names, boundaries, light, comments and provenance; written with its
assets.
"""

from __future__ import annotations

import difflib
import fnmatch
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import atan2, degrees, floor
from pathlib import Path
from typing import Any

import numpy as np

from physgen import __version__
from physgen.files import resource, write_atomic, write_with_backup
from physgen.geometry.polygon import Array, Disc, Outline, mass_properties
from physgen.maps import Keep, ignore_kept_file, write_assets, write_png
from physgen.materials import kind, nouns
from physgen.perceive.maps.occlusion import drawing_layers, occlusion_orders
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    BoundaryGuess,
    Detections,
    Doubt,
    LightGuess,
    Matter,
    Name,
    PerceivedScene,
    PhotoObject,
    Shadows,
    Wall,
)
from physgen.photometry import DistantLight
from physgen.problems import InputError, Place, Problem, Severity
from physgen.scene.files import MAPS
from physgen.scene.scene import Solid, View
from physgen.scene.write import scene_text

# ----------------------------------------------------------------------
# Percepts' numbers -> the words and values of a scene document: names, shapes, provenance.

ANY = ("object", "thing")
"""Labels that mean to tell nothing."""
DOUBTFUL = "perhaps objects, too: to have one, take the # and the space behind it away"
"""Above things that are too doubtful to be objects."""


def slug(label: str) -> str:
    """A label as the start of a name: letters, digits and -, beginning with a letter, at most 48 long.

    >>> slug("Billiard ball (red)"), slug("8 ball"), slug("Kugel Übergröße"), slug("")
    ('billiard-ball-red', 'object-8-ball', 'kugel-bergr-e', 'object')
    """
    text = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")[:48].strip("-")
    if not text:
        return "object"
    return text if text[0].isalpha() else f"object-{text}"


def light_entry(found: DistantLight) -> dict[str, Any]:
    """The scene's `light:`."""
    x, y, z = (round(v, 3) for v in found.direction)
    return {
        "direction": [x, y, z],
        "intensity": round(min(found.intensity, 1000.0), 3),
        "ambient": round(found.ambient, 3),
    }


def view_entry(shadows: Shadows, side: bool) -> dict[str, Any]:
    """What `world:` says of where shadows fall; nothing where none are seen."""
    if shadows.clean is None or not side:
        return {}
    wall = {} if shadows.backdrop is None else {"backdrop": shadows.backdrop}
    return {"tilt": shadows.tilt, **wall}


def object_names(things: Sequence[PhotoObject], kept: Mapping[int, str] | None = None) -> dict[int, str]:
    """A name for every thing, by id, from left to right: its label and a number; `kept` are names that stay."""
    kept = kept or {}
    taken = set(kept.values())
    ordered = sorted(things, key=lambda t: (round(float(mass_properties(t.outline).center[0]), 1), t.id))
    counts: dict[str, int] = {}
    result = {}
    for thing in ordered:
        if thing.id in kept:
            result[thing.id] = kept[thing.id]
            continue
        start = slug(thing.label)
        counts[start] = counts.get(start, 0) + 1
        while f"{start}-{counts[start]}" in taken:
            counts[start] += 1
        result[thing.id] = f"{start}-{counts[start]}"
    return result


def shape_entry(outline: Outline) -> dict[str, Any]:
    """`shape:` of an outline, to 0.01 px; radii are rounded down, so that balls that touch do not overlap."""
    if isinstance(outline, Disc):
        x, y = (round(float(c), 2) for c in outline.center)
        return {"circle": {"center": [x, y], "radius": max(0.01, floor(outline.radius * 100) / 100)}}
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


def _box(points: Array) -> dict[str, Any] | None:
    """`box:` of four corners at right angles; None where they are none."""
    if len(points) != 4:
        return None
    sides = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(*sides.T)
    if np.hypot(*(sides[0] + sides[2])) > 1e-6 or abs(sides[0] @ sides[1]) > 1e-6 * lengths.max() ** 2:
        return None
    x, y = (round(float(c), 2) for c in points.mean(axis=0))
    angle = round(degrees(atan2(sides[0][1], sides[0][0])), 3) + 0.0
    said: dict[str, Any] = {"center": [x, y], "size": [round(float(side), 2) for side in lengths[:2]]}
    return said | ({"angle": angle} if angle else {})


def corners(points: Array) -> list[list[float]]:
    """`(K, 2)` px -> [[x, y], ...] to 0.01 px, none twice in a row."""
    rounded = np.round(points, 2) + 0.0
    fresh = np.any(rounded != np.roll(rounded, 1, axis=0), axis=1)
    kept = rounded[fresh] if fresh.sum() >= 3 else rounded
    return [[float(x), float(y)] for x, y in kept]


def wall_entry(found: Wall) -> dict[str, Any]:
    """One boundary: a segment of two points, a polyline of more."""
    points = [[float(x), float(y)] for x, y in found.points]
    said: dict[str, Any] = {"segment": points} if len(points) == 2 else {"polyline": points}
    said |= {"friction": found.friction, "elasticity": found.elasticity}
    return said | {"from": provenance(found.source, found.confidence)}


def provenance(who: str, confidence: float) -> str:
    """Who said it and how sure, as `from` has it.

    >>> source("table", 0.4)
    'table 0.4'
    """
    return f"{who} {round(confidence, 2):g}"


def hides_comment(names: Sequence[str]) -> str:
    """What a thing hides a part of, as a comment on its layer.

    >>> before(["ball-1", "ball-2"])
    'in front: it hides parts of ball-1 and ball-2'
    """
    every = ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
    return f"in front: it hides parts of {every}"


def label_counts(labels: Mapping[int, str]) -> str:
    """How many of each label there are.

    >>> counted({1: "ball", 2: "block", 3: "ball"})
    '2 x ball, 1 x block'
    """
    each: dict[str, int] = {}
    for label in labels.values():
        each[label or "object"] = each.get(label or "object", 0) + 1
    return ", ".join(
        f"{n} x {label}" for label, n in sorted(each.items(), key=lambda item: (-item[1], item[0]))
    )


def can_roll(thing: PhotoObject, solid: Solid, view: View) -> bool:
    """Whether rolling resistance can act on it: circles roll seen from the side, spheres seen from above, too."""
    upright = view is View.SIDE or solid is Solid.SPHERE
    return isinstance(thing.outline, Disc) and not thing.cut and upright


def unknown_label(label: str) -> Problem | None:
    """A warning about a label that nobody knows the matter of; None for one that is known."""
    what = kind(label)
    if what.noun or what.material.name != "unknown" or label in ANY:
        return None
    known = sorted({word for _, every in nouns() for word in every})
    close = difflib.get_close_matches(label.lower(), known, 1) or difflib.get_close_matches(
        label.lower().split()[-1], known, 1
    )
    fix = f"did you mean {close[0]}?" if close else "name a material, too, as in: wooden spoon"
    return Problem(
        Place("--label"),
        "",
        f'"{label}"',
        "is no thing or material that the table has",
        fix,
        Severity.WARNING,
    )


def doubt_comments(doubtful: Sequence[Doubt], who: str) -> str:
    """Lines for the scene's comments: things that a person may take for objects by uncovering a line."""
    lines = [DOUBTFUL]
    for k, doubt in enumerate(doubtful, 1):
        points = ", ".join(f"[{x:g}, {y:g}]" for x, y in doubt.polygon)
        said = provenance(who, doubt.confidence)
        lines.append(f"maybe-{k}: {{mask: {{polygon: [{points}]}}, from: {{mask: {said}}}}}")
    return "\n".join(lines)


# ----------------------------------------------------------------------
# What perception found of each object -> its entry in the scene document, and the comments in it.


def object_entries(
    found: Detections,
    things: Sequence[PhotoObject],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    setting: BoundaryGuess,
    named: Mapping[int, Name],
    label_source: Mapping[int, str],
    table: str,
) -> tuple[dict[str, Any], dict[str, str]]:
    """`objects:`, and comments by dotted path. `table` is who tells matter."""
    layer_of, kept = drawing_layers(
        occlusion_orders(found.labels, [thing.id for thing in things]), found.layers
    )
    objects: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for thing in sorted(things, key=lambda t: list(called).index(t.id)):
        name, it = called[thing.id], matter[thing.id]
        told = {"mask": _masked(found, thing.id)}
        if label_source[thing.id]:
            told["label"] = provenance(label_source[thing.id], named[thing.id].confidence)
        told |= {
            "mass": provenance(table, it.confidence),
            "friction": provenance(table, 0.5 * it.confidence + 0.2),
        }
        told["elasticity"] = told["friction"]
        one: dict[str, Any] = {"label": thing.label, "mask": thing.id, "shape": shape_entry(thing.outline)}
        one |= {
            "solid": it.solid.value,
            "mass": it.mass,
            "friction": max(it.friction, setting.grip.get(thing.id, 0.0)),
            "elasticity": it.elasticity,
        }
        still = thing.cut or thing.id in setting.held
        if can_roll(thing, it.solid, setting.view) and not still:
            one["rolling"] = it.rolling
            told["rolling"] = told["friction"]
        if it.surface:
            comments[f"objects.{name}.friction"] = it.surface
        if thing.cut:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "cut off by the photo's border, so it is held; dynamic lets it go"
            )
        elif thing.id in setting.held:
            one["motion"] = "static"
            comments[f"objects.{name}.motion"] = (
                "nothing that is seen keeps it from falling, so it is held; dynamic lets it go"
            )
        if it.friction < setting.grip.get(thing.id, 0.0):
            told["friction"] = provenance("lies on a slope", 0.5)
            comments[f"objects.{name}.friction"] = "at least this much, since it lies still on a slope"
        if thing.id in layer_of:
            behind = [order for order in kept if order.front == thing.id]
            one["layer"] = layer_of[thing.id]
            told["layer"] = provenance("outlines", max(order.confidence for order in behind))
            comments[f"objects.{name}.layer"] = hides_comment([called[order.behind] for order in behind])
        comments[f"objects.{name}.mass"] = f"g: {it.reason}"
        if not objects and found.doubtful:
            comments[f"objects.{name}"] = doubt_comments(found.doubtful, found.source)
        objects[name] = {**one, "from": told}
        if thing.id in found.prompts:
            objects[name]["prompt"] = dict(found.prompts[thing.id])
    return objects, comments


def _masked(found: Detections, i: int) -> str:
    """Who found an object's mask, and how sure."""
    source = "pointed at" if i in found.prompts else found.source
    return found.said.get(i) or provenance(source, found.confidence.get(i, 1.0))


# ----------------------------------------------------------------------
# What was perceived -> assets on disk and the scene's text, with paths that hold from where it will lie.

RECORD = "perceived.json"
"""Who did each step of perceiving, with what, how long it took and what it cost."""
SCHEMA = "scene-1.schema.json"
"""Copied into the assets, so that editors complete and check the scene wherever it lies, offline too."""


def write_scene(
    perceived: PerceivedScene,
    photo: Path | None,
    name: str,
    output: Path | None,
    assets: Path | None = None,
    keep: Keep = ignore_kept_file,
) -> str:
    """Write the assets, and the scene file where `output` is given; returns the scene's text.

    Assets go to `OUTPUT-STEM.assets/` beside the scene, or `NAME.assets/` in the current folder, unless `assets` says
    otherwise. `photo` is its file, copied into them from outside the scene's folder; None where no scene can name the
    file as it is: it is then written as `NAME.png`. Files that are there and differ are kept as `NAME~`
    (`keep` is told). Raises InputError when the assets would lie outside the scene's folder.
    """
    folder = output.parent if output else Path()
    if assets is None:
        assets = folder / f"{output.stem if output else name}.assets"
    if not assets.resolve().is_relative_to(folder.resolve()):
        where = "beside -o" if output else "in the current folder"
        raise InputError.of(
            "--assets", f'"{assets}"', "lies outside the scene's folder", f"name a folder {where}"
        )
    if output is not None:
        folder.mkdir(parents=True, exist_ok=True)
    ranges = write_assets(perceived.percepts, assets, keep)
    if photo is None:
        photo = assets / _own(f"{name}.png")
        write_png(photo, perceived.percepts.rgb, keep)
    elif not photo.resolve().is_relative_to(folder.resolve()):
        copy = assets / _own(photo.name)
        if not (copy.exists() and copy.samefile(photo)):
            write_with_backup(copy, photo.read_bytes(), keep)
        photo = copy
    placed: dict[str, Any] = {
        "physgen": 1,
        "image": _relative(photo, folder),
        "assets": _relative(assets, folder),
        **{
            key: value
            for key, value in perceived.document.items()
            if key not in ("physgen", "image", "assets", "maps")
        },
    }
    if ranges:
        placed["maps"] = {name: list(bounds) for name, bounds in ranges.items()}
    schema = assets / SCHEMA
    write_with_backup(schema, resource("schemas", SCHEMA).read_bytes(), keep)
    if perceived.record:  # it tells of this run: an earlier one's is not worth keeping
        told = {"physgen": __version__, "steps": list(perceived.record)}
        write_atomic(assets / RECORD, json.dumps(told, indent=1, ensure_ascii=False).encode() + b"\n")
    else:
        (assets / RECORD).unlink(missing_ok=True)  # of an earlier run with models
    text = scene_text(placed, perceived.comments, perceived.header, _relative(schema, folder))
    if output is not None:
        write_with_backup(output, text.encode("utf-8"), keep)
    return text


def _own(name: str) -> str:
    """The photo's name among the assets: none that a map has."""
    return f"photo-{name}" if Path(name).stem.lower() in MAPS else name


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


# ----------------------------------------------------------------------
# What was perceived -> the comments of a scene: where each guess came from, and a push to try.

GRAVITY = 9.8
"""m/s², as a scene has it unless it says something else."""


def scene_comments(
    found: Detections,
    things: Sequence[PhotoObject],
    left_out: int,
    setting: BoundaryGuess,
    light: LightGuess,
    shadows: Shadows,
) -> dict[str, str]:
    """Sentences about where each guess came from."""
    told = {
        "given": "from the masks given",
        "pointed at": "where you pointed",
        "coco": "from the annotations",
        "kept": "as the scene had them, and where you pointed",
    }
    how = told.get(found.source, f"found by {found.source}")
    specks = f"; {left_out} specks of under {SMALLEST_OBJECT} px left out" if left_out else ""
    said = {
        "world.view": f"side or top: {setting.reason} (confidence {setting.confidence:g})",
        "objects": f"{label_counts({t.id: t.label for t in things})}, {how}, counted from left to right{specks}",
        "light": f"{light.reason} (confidence {light.confidence:g})"
        if shadows.clean is None
        else f"{shadows.reason} (confidence {shadows.confidence:g})",
    }
    if setting.view is View.TOP:
        said["world.table"] = "nobody can see friction: 0 lets things glide for ever, 0.2 is cloth"
    for wall in setting.walls:
        said[f"boundaries.{wall.name}"] = wall.reason
    return said


def push_comment(
    found: Detections,
    setting: BoundaryGuess,
    things: Sequence[PhotoObject],
    called: Mapping[int, str],
    matter: Mapping[int, Matter],
    pixels_per_meter: float,
) -> str:
    """A force to try: a sure thing far from the others, pushed towards them as fast as it would fall its size."""
    loose = [t for t in things if not t.cut and t.id not in setting.held] or list(things)
    sure = {t.id: found.confidence.get(t.id, 1.0) for t in loose}
    movable = [t for t in loose if sure[t.id] >= 0.8 * max(sure.values())]
    centers = np.array([mass_properties(t.outline).center for t in movable])
    away = centers - centers.mean(0)
    if setting.view is View.SIDE:
        away[:, 1] = 0
    k = int(np.argmax((away**2).sum(1)))
    length = float(np.hypot(*away[k]))
    towards = -away[k] / length if length > 1 else np.array([1.0, 0.0])
    size = mass_properties(movable[k].outline).area ** 0.5
    speed = float(f"{(2 * GRAVITY * pixels_per_meter * size) ** 0.5:.1g}")
    kick = matter[movable[k].id].mass * speed
    x, y = (float(f"{kick * c:.2g}") if abs(c) > 0.01 else 0.0 for c in towards)
    return (
        f"to set something going, replace [] by a list such as (impulse in g px/s, here {speed:g} px/s):\n"
        f"  - {{object: {called[movable[k].id]}, impulse: [{x:g}, {y:g}]}}"
    )


# ----------------------------------------------------------------------
# `NAME=TEXT` -> things under new labels, and how sure every label is.


def relabel_objects(
    things: Sequence[PhotoObject], renames: Sequence[str], called: Mapping[int, str]
) -> tuple[list[PhotoObject], set[int]]:
    """Things, `called` so, under their new labels, and the ids of those that got one.

    Raises InputError with every wrong NAME.
    """
    said: dict[int, str] = {}
    problems = []
    for rename in renames:
        name, sign, text = (part.strip() for part in rename.partition("="))
        hits = [i for i, n in called.items() if fnmatch.fnmatchcase(n, name) or str(i) == name]
        if not (sign and text and hits):
            near = difflib.get_close_matches(name, called.values(), 1)
            known = ", ".join(list(called.values())[:8]) + (", ..." if len(called) > 8 else "")
            fix = f"did you mean {near[0]}?" if near and near[0] != name else f"the objects are {known}"
            expected = "names no object" if sign and text else "is not NAME=TEXT"
            problems += InputError.of("--label", f'"{rename}"', expected, fix).problems
        said |= dict.fromkeys(hits, text)
    if problems:
        raise InputError(problems)
    return [replace(t, label=said[t.id]) if t.id in said else t for t in things], set(said)


def label_confidences(
    found: Detections, named: Mapping[int, Name], guessed: Mapping[int, Name], renamed: set[int]
) -> dict[int, float]:
    """How sure each label is: 1 where a person said it, or changed what was guessed."""
    people = found.names if found.called or found.named_by == "given" else {}
    said = {i for i in people if i not in guessed or found.names[i].label != guessed[i].label} | renamed
    return {i: 1.0 if i in said else name.confidence for i, name in named.items()}
