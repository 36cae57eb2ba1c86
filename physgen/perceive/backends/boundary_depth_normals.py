"""Backend boundary=depth-normals: view and boundaries from depth and normals (paper, appendix)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import exp, log

import cv2
import numpy as np
from numpy.typing import NDArray

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
from physgen.perceive.roles import Boundary, BoundaryGuess, Labels, PhotoObject, Rgb, Scenery, Wall
from physgen.perceive.support.motion_plane import (
    LEAST_FACING,
    above_below,
    hidden_by_objects,
    normalised_depth,
    side_section,
    top_section,
)
from physgen.perceive.support.section_edges import Edge, extend_floors, section_edges
from physgen.perceive.support.supports import add_supports, depth_inside, free_parts
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

DEEPER, FLOOR, FACING = 2.5, 2.0, 1.5
"""Log odds at most, that it is seen from the side: what is above things is farther than below; something faces up;
from above: all faces the viewer."""
EVEN = 0.25
"""Of how far things stand out: up to so much farther above than below is as far, from a rim or a tilted camera."""
UP = 0.6
"""-y of a normal from which a surface faces up."""
ENOUGH = 0.02
"""Of the background that faces up, from which there is a floor."""
THROUGH = 2.0
"""px that an edge may run within an outline: an error of the mask, or of the depth beside it."""
ASIDE = 0.9
"""Cosine between the way an edge's surface faces and the way out of it, from which it is that surface's section."""
SLOPE = 8.0
"""degrees from level where slopes begin."""


def depth_normals() -> Boundary:
    """The backend `depth-normals`."""
    return _found


def _found(
    rgb: Rgb,
    labels: Labels,
    things: Sequence[PhotoObject],
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
    away = hidden_by_objects(labels)
    groups = feet_groups(labels, things)
    if view is None:
        found, sure, reason = _view(rgb, labels, things, groups, even, facing, away)
    else:
        found, sure, reason = view, 1.0, "as told"
    border = photo_frame(labels, found)
    if not len(things) or not (labels > 0).any():
        return BoundaryGuess(found, sure, reason, (border,))
    if found is View.TOP:
        section = top_section(even, facing, labels, things, scenery)
        cushions = _walls(section_edges(section, facing), things, scenery, [border], found)
        return BoundaryGuess(found, sure, reason, (border, *cushions))
    stood = lay_floors(rgb, labels, things, groups)
    section = side_section(even, labels, things, groups, scenery)
    floors, others = extend_floors(stood.walls, section_edges(section, facing), section, stood.things)
    walls = [border, *floors]
    more, held = add_supports(stood.things, walls, stood.grip, FRICTION, ELASTICITY)
    walls += more
    walls += _walls(others, stood.things, scenery, walls, found)
    return BoundaryGuess(found, sure, reason, tuple(walls), stood.outlines, held, stood.grip)


def _view(
    rgb: Rgb,
    labels: Labels,
    things: Sequence[PhotoObject],
    groups: Groups,
    depth: F32,
    normals: F32,
    away: Mask,
) -> tuple[View, float, str]:
    """What the photo and the normals tell, and the depth above and below things."""
    alone, upright = view_evidence(things, groups)
    small = cv2.resize(normals, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    view, sure, reason = guess_view(rgb, labels, np.asarray(small, np.float32), alone, upright)
    odds = (1 if view is View.SIDE else -1) * log(sure / (1 - sure))
    said = {reason: odds}
    deeper = above_below(depth, labels, things, away)
    if len(things):
        told = "what is above things is farther away than what is below" if deeper > EVEN else (
            "what is above things is as far away as what is below"
        )  # fmt: skip
        said[told] = float(np.clip(2 * DEEPER * (deeper - EVEN), -DEEPER, DEEPER))
    if not away.all():
        up = float((normals[..., 1] < -UP)[~away].mean())
        if up >= ENOUGH:
            said["there is a floor that faces up"] = FLOOR
        elif float((normals[..., 2] > LEAST_FACING)[~away].mean()) > 0.9:
            said["the background faces the viewer"] = -FACING
    total = sum(said.values())
    side = total >= 0
    agree = sorted((why for why in said if (said[why] >= 0) == side), key=lambda why: -abs(said[why]))
    return (View.SIDE if side else View.TOP), round(min(1 / (1 + exp(-abs(total) / 1.5)), 0.98), 2), (
        " and ".join(agree[:2])
    )  # fmt: skip


def _walls(
    found: Sequence[Edge],
    things: Sequence[PhotoObject],
    scenery: Scenery | None,
    taken: Sequence[Wall],
    view: View,
) -> list[Wall]:
    """Edges as walls, without the parts that run into things."""
    outlines = [t.outline for t in things]
    names = {wall.name for wall in taken}
    friction, elasticity = (0.2, CUSHION) if view is View.TOP else (FRICTION, ELASTICITY)
    walls: list[Wall] = []
    for edge in found:
        count = max(2, int(edge.length))
        along = edge.start + np.linspace(0, 1, count)[:, None] * (edge.end - edge.start)
        within = max((float(depth_inside(o, along).max()) for o in outlines), default=0.0)
        if view is View.SIDE and edge.out[1] < -0.7 and within > THROUGH:
            continue  # things stand lower than this: it is behind them
        if view is View.SIDE and _rim(edge):
            continue
        chain = [(round(float(x), 2), round(float(y), 2)) for x, y in (edge.start, edge.end)]
        noun = _noun(edge, scenery)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < 4:
                continue
            kind = noun or _kind(edge, view)
            k = next(k for k in range(1, 1000) if f"{kind}-{k}" not in names)
            names.add(f"{kind}-{k}")
            sure = round(min(0.9, 0.3 + 0.6 * edge.seen * edge.plane**2), 2)
            walls.append(
                Wall(
                    f"{kind}-{k}",
                    tuple(part),
                    friction,
                    elasticity,
                    sure,
                    "depth and normals",
                    _why(edge, view),
                )
            )
    return walls


def _rim(edge: Edge) -> bool:
    """Whether it ends a plane that is before the things' and faces elsewhere, as the side rim of a table's top."""
    across = edge.facing[:2]
    return bool(np.hypot(*across) > UP and across @ edge.out < ASIDE * np.hypot(*across))


def _kind(edge: Edge, view: View) -> str:
    if view is View.TOP:
        return "cushion"
    if abs(edge.angle) <= SLOPE:
        return "ledge"
    return "slope" if edge.out[1] < -0.35 else "underside" if edge.out[1] > 0.35 else "side"


def _why(edge: Edge, view: View) -> str:
    if view is View.TOP:
        return "what is beyond rises above the table, as high as the things"
    facing = np.abs(edge.facing)
    plane = (
        "upright face" if facing[2] >= max(facing[:2]) else "level face" if facing[1] > facing[0] else "side"
    )
    return f"the end of a flat {plane} that is as near as the things; what is beyond is farther away"


def _noun(edge: Edge, scenery: Scenery | None) -> str:
    """What the scenery on its solid side is called, as a name; `""` where nobody knows."""
    if scenery is None:
        return ""
    middle = edge.start + np.linspace(0.1, 0.9, 20)[:, None] * (edge.end - edge.start) - 4 * edge.out
    height, width = scenery.labels.shape
    columns, rows = np.rint(middle).astype(int).T
    ids = scenery.labels[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    most = int(np.bincount(ids).argmax())
    return re.sub(r"[^a-z0-9]+", "-", _nouns(scenery.nouns).get(most, "").lower()).strip("-")


def _nouns(nouns: Mapping[int, str]) -> dict[int, str]:
    return {int(i): noun for i, noun in nouns.items() if i}
