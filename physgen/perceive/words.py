"""Percepts' numbers -> the words and values of a scene document: names, shapes, provenance."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from math import atan2, degrees, floor
from typing import Any

import numpy as np

from physgen.geometry import Array
from physgen.materials import kind, nouns
from physgen.outline.outline import Disc, Outline, mass_properties
from physgen.perceive.roles import Doubt, Shadows, Thing, Wall
from physgen.photometry import DistantLight
from physgen.problems import Place, Problem, Severity
from physgen.scene.model import Solid, View

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


def light(found: DistantLight) -> dict[str, Any]:
    """The scene's `light:`."""
    x, y, z = (round(v, 3) for v in found.direction)
    return {
        "direction": [x, y, z],
        "intensity": round(min(found.intensity, 1000.0), 3),
        "ambient": round(found.ambient, 3),
    }


def view(shadows: Shadows, side: bool) -> dict[str, Any]:
    """What `world:` says of where shadows fall; nothing where none are seen."""
    if shadows.clean is None or not side:
        return {}
    wall = {} if shadows.backdrop is None else {"backdrop": shadows.backdrop}
    return {"tilt": shadows.tilt, **wall}


def names(things: Sequence[Thing], kept: Mapping[int, str] | None = None) -> dict[int, str]:
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


def shape(outline: Outline) -> dict[str, Any]:
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


def wall(found: Wall) -> dict[str, Any]:
    """One boundary: a segment of two points, a polyline of more."""
    points = [[float(x), float(y)] for x, y in found.points]
    said: dict[str, Any] = {"segment": points} if len(points) == 2 else {"polyline": points}
    said |= {"friction": found.friction, "elasticity": found.elasticity}
    return said | {"from": source(found.source, found.confidence)}


def source(who: str, confidence: float) -> str:
    """Who said it and how sure, as `from` has it.

    >>> source("table", 0.4)
    'table 0.4'
    """
    return f"{who} {round(confidence, 2):g}"


def before(names: Sequence[str]) -> str:
    """What a thing hides a part of, as a comment on its layer.

    >>> before(["ball-1", "ball-2"])
    'in front: it hides parts of ball-1 and ball-2'
    """
    every = ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
    return f"in front: it hides parts of {every}"


def counted(labels: Mapping[int, str]) -> str:
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


def rolls(thing: Thing, solid: Solid, view: View) -> bool:
    """Whether rolling resistance can act on it: circles roll seen from the side, spheres seen from above, too."""
    upright = view is View.SIDE or solid is Solid.SPHERE
    return isinstance(thing.outline, Disc) and not thing.cut and upright


def unknown(label: str) -> Problem | None:
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


def doubts(doubtful: Sequence[Doubt], who: str) -> str:
    """Lines for the scene's comments: things that a person may take for objects by uncovering a line."""
    lines = [DOUBTFUL]
    for k, doubt in enumerate(doubtful, 1):
        points = ", ".join(f"[{x:g}, {y:g}]" for x, y in doubt.polygon)
        said = source(who, doubt.confidence)
        lines.append(f"maybe-{k}: {{mask: {{polygon: [{points}]}}, from: {{mask: {said}}}}}")
    return "\n".join(lines)
