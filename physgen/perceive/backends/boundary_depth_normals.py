"""Backend boundary=depth-normals: view and boundaries from depth and normals (paper, appendix).

The paper ("Boundary extraction") takes background objects within the foreground's range of depth, selects planes by
normals, and fits level and upright edges to their borders. Here the supports come first, as boundary=support lays them
under what rests on them; depth shows how far they reach and what else is solid in the plane in which the objects move;
normals show which of its borders are planes'. Slopes are edges too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log

import cv2
import numpy as np

from physgen.perceive.backends.boundary_support import (
    CUSHION,
    ELASTICITY,
    FRICTION,
    Groups,
    feet_groups,
    lay_floors,
    photo_frame,
    view_evidence,
)
from physgen.perceive.roles import (
    F32,
    Boundary,
    BoundaryGuess,
    Labels,
    PhotoObject,
    Rgb,
    Scenery,
    Wall,
)
from physgen.perceive.support.section import (
    LEAST_FACING,
    Edge,
    above_below,
    extend_floors,
    hidden_by_objects,
    normalised_depth,
    section_edges,
    side_section,
    top_section,
)
from physgen.perceive.support.supports import add_supports, depth_inside, free_parts
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View

DEEPER, FLOOR, FACING = 2.5, 2.0, 1.5
"""Log odds at most of the side view: the background above objects is farther than below; a surface faces up; and of the
top view: all faces the viewer."""


@dataclass(frozen=True)
class _Limits:
    """Cues of the view, and which edges are walls."""

    # of how far objects stand out: up to so much farther above than below is as far, from a rim or a tilt
    even: float = 0.25
    up: float = 0.6  # -y of a normal from which a surface faces up
    enough: float = 0.02  # of the background that faces up, from which there is a floor
    # px that an edge may run within an outline: an error of the mask, or of the depth beside it
    through: float = 2.0
    # cosine between the way an edge's surface faces and the way out of it, from which it is its section
    section: float = 0.9
    slope: float = 8.0  # degrees from level where slopes begin


LIMITS = _Limits()


def depth_normals() -> Boundary:
    """The backend `depth-normals`."""
    return _depth_normals


def _depth_normals(
    rgb: Rgb,
    labels: Labels,
    objects: Sequence[PhotoObject],
    view: View | None,
    *,
    depth: F32 | None = None,
    normals: F32 | None = None,
    scenery: Scenery | None = None,
) -> BoundaryGuess:
    """`depth` (H, W) up to scale and shift; without `normals`, everything counts as a plane that faces the viewer.

    Raises InputError where there is no depth.
    """
    even = normalised_depth(depth)
    if normals is None:
        facing = np.zeros((*labels.shape, 3), np.float32)
        facing[..., 2] = 1
    else:
        facing = np.asarray(cv2.blur(normals, (3, 3)), np.float32)
    groups = feet_groups(labels, objects)
    if view is None:
        found, sure, reason = _guess_view(rgb, labels, objects, groups, even, facing)
    else:
        found, sure, reason = view, 1.0, "as given"
    border = photo_frame(labels, found)
    if not len(objects) or not (labels > 0).any():
        return BoundaryGuess(found, sure, reason, (border,))
    if found is View.TOP:
        section = top_section(even, labels, objects, scenery)
        cushions = _walls(section_edges(section, facing), objects, scenery, [border], found)
        return BoundaryGuess(found, sure, reason, (border, *cushions))
    stood = lay_floors(rgb, labels, objects, groups)
    section = side_section(even, facing, labels, objects, groups, scenery)
    floors, others = extend_floors(stood.walls, section_edges(section, facing), section, stood.objects)
    walls = [border, *floors]
    more, held = add_supports(stood.objects, walls, stood.grip, FRICTION, ELASTICITY)
    walls += more
    walls += _walls(others, stood.objects, scenery, walls, found)
    return BoundaryGuess(found, sure, reason, tuple(walls), stood.outlines, held, stood.grip)


def _guess_view(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject], groups: Groups, depth: F32, normals: F32
) -> tuple[View, float, str]:
    """View, confidence and reason, from the photo, the normals, and the depth above and below objects."""
    away = hidden_by_objects(labels)
    alone, upright = view_evidence(objects, groups)
    small = cv2.resize(normals, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    view, sure, reason = guess_view(rgb, labels, np.asarray(small, np.float32), alone, upright)
    odds = {reason: (1 if view is View.SIDE else -1) * log(sure / (1 - sure))}
    deeper = above_below(depth, labels, objects, away)
    if len(objects):
        farther = (
            "farther away than what is below" if deeper > LIMITS.even else "as far away as what is below"
        )
        shift = float(np.clip(2 * DEEPER * (deeper - LIMITS.even), -DEEPER, DEEPER))
        odds[f"what is above the objects is {farther}"] = shift
    if not away.all():
        up = float((normals[..., 1] < -LIMITS.up)[~away].mean())
        if up >= LIMITS.enough:
            odds["there is a floor that faces up"] = FLOOR
        elif float((normals[..., 2] > LEAST_FACING)[~away].mean()) > 0.9:
            odds["the background faces the viewer"] = -FACING
    total = sum(odds.values())
    side = total >= 0
    agree = sorted((why for why in odds if (odds[why] >= 0) == side), key=lambda why: -abs(odds[why]))
    sure = round(min(1 / (1 + exp(-abs(total) / 1.5)), 0.98), 2)
    return (View.SIDE if side else View.TOP), sure, " and ".join(agree[:2])


def _walls(
    found: Sequence[Edge],
    objects: Sequence[PhotoObject],
    scenery: Scenery | None,
    taken: Sequence[Wall],
    view: View,
) -> list[Wall]:
    """Edges as walls, without the parts that run into objects."""
    outlines = [t.outline for t in objects]
    names = {wall.name for wall in taken}
    friction, elasticity = (0.2, CUSHION) if view is View.TOP else (FRICTION, ELASTICITY)
    walls: list[Wall] = []
    for edge in found:
        count = max(2, int(edge.length))
        along = edge.start + np.linspace(0, 1, count)[:, None] * (edge.end - edge.start)
        within = max((float(depth_inside(o, along).max()) for o in outlines), default=0.0)
        behind = edge.out[1] < -0.7 and within > LIMITS.through  # objects stand lower than this
        if view is View.SIDE and (behind or _is_rim(edge)):
            continue
        chain = [(round(float(x), 2), round(float(y), 2)) for x, y in (edge.start, edge.end)]
        kind = _scenery_name(edge, scenery) or _kind(edge, view)
        sure = round(min(0.9, 0.3 + 0.6 * edge.seen * edge.plane**2), 2)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < 4:
                continue
            name = next(name for k in range(1, 1000) if (name := f"{kind}-{k}") not in names)
            names.add(name)
            reason = _reason(edge, view)
            walls.append(Wall(name, tuple(part), friction, elasticity, sure, "depth and normals", reason))
    return walls


def _is_rim(edge: Edge) -> bool:
    """Whether it ends a plane nearer than the objects' that faces elsewhere, as the side rim of a table's top."""
    assert edge.facing is not None
    across = edge.facing[:2]
    return bool(np.hypot(*across) > LIMITS.up and across @ edge.out < LIMITS.section * np.hypot(*across))


def _kind(edge: Edge, view: View) -> str:
    if view is View.TOP:
        return "cushion"
    if abs(edge.angle) <= LIMITS.slope:
        return "ledge"
    return "slope" if edge.out[1] < -0.35 else "underside" if edge.out[1] > 0.35 else "side"


def _reason(edge: Edge, view: View) -> str:
    if view is View.TOP:
        return "what is beyond rises above the table, as high as the objects"
    assert edge.facing is not None
    x, y, z = np.abs(edge.facing)
    plane = "upright face" if z >= max(x, y) else "level face" if y > x else "side"
    return f"the end of a flat {plane} that is as near as the objects; what is beyond is farther away"


def _scenery_name(edge: Edge, scenery: Scenery | None) -> str:
    """The noun of the scenery on its solid side, as a name; `""` where it is unknown."""
    if scenery is None:
        return ""
    middle = edge.start + np.linspace(0.1, 0.9, 20)[:, None] * (edge.end - edge.start) - 4 * edge.out
    height, width = scenery.labels.shape
    columns, rows = np.rint(middle).astype(int).T
    ids = scenery.labels[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    most = int(np.bincount(ids).argmax())
    noun = scenery.nouns.get(most, "") if most else ""
    return re.sub(r"[^a-z0-9]+", "-", noun.lower()).strip("-")
