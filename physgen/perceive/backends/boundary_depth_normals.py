"""Backend boundary=depth-normals: view and boundaries from depth and normals (paper, appendix).

The paper ("Boundary extraction") takes background objects within the foreground's range of depth, selects planes by
normals, and fits level and upright edges to their borders. Here the supports come first, as boundary=support lays them
under what rests on them; depth shows how far they reach and what else is solid in the plane in which the objects move;
normals show which of its borders are planes'. Slopes are edges too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from physgen.perceive.backends.boundary_support import (
    CUSHION,
    ELASTICITY,
    FRICTION,
    Photo,
    feet_groups,
    find_cushions,
    lay_floors,
    photo_bottom,
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
    Edge,
    is_floor_edge,
    normalised_depth,
    section_edges,
    side_section,
    solid_reach,
    top_section,
)
from physgen.perceive.support.supports import add_supports, depth_inside, free_parts
from physgen.perceive.support.viewpoint import guess_view
from physgen.scene.scene import View


@dataclass(frozen=True)
class _Limits:
    """Which edges are walls."""

    up: float = 0.6  # -y of a normal from which a surface faces up
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
        small = cv2.resize(facing, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        found, sure, reason = guess_view(
            rgb, labels, np.asarray(small, np.float32), *view_evidence(objects, groups)
        )
    else:
        found, sure, reason = view, 1.0, "as given"
    if not len(objects) or not (labels > 0).any():
        return BoundaryGuess(found, sure, reason, ())
    if found is View.TOP:
        section = top_section(even, labels, objects, scenery)
        cushions = _walls(section_edges(section, facing), objects, [], found)
        cushions = cushions or find_cushions(Photo(rgb, labels), objects)
        return BoundaryGuess(found, sure, reason, tuple(cushions))
    section = side_section(even, facing, labels, objects, groups, scenery)
    stood = lay_floors(rgb, labels, objects, groups, partial(solid_reach, section))
    edges = section_edges(section, facing)
    others = [edge for edge in edges if not any(is_floor_edge(section, edge, wall) for wall in stood.walls)]
    walls = [photo_bottom(labels), *stood.walls]
    more, held = add_supports(stood.objects, walls, stood.grip, FRICTION, ELASTICITY)
    walls += more
    walls += _walls(others, stood.objects, walls, found)
    return BoundaryGuess(found, sure, reason, tuple(walls), stood.outlines, held, stood.grip)


def _walls(
    found: Sequence[Edge], objects: Sequence[PhotoObject], taken: Sequence[Wall], view: View
) -> list[Wall]:
    """Edges as walls, without the parts that run into objects."""
    outlines = [t.outline for t in objects]
    names = {wall.name for wall in taken}
    beyond = "rises above the table" if view is View.TOP else "is farther away"
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
        kind = _kind(edge, view)
        sure = round(min(0.9, 0.3 + 0.6 * edge.seen * edge.plane**2), 2)
        for part in free_parts(chain, outlines):
            if np.hypot(*np.subtract(part[-1], part[0])) < 4:
                continue
            name = next(name for k in range(1, 1000) if (name := f"{kind}-{k}") not in names)
            names.add(name)
            walls.append(
                Wall(
                    name,
                    tuple(part),
                    friction,
                    elasticity,
                    sure,
                    "depth and normals",
                    f"what is beyond {beyond}",
                )
            )
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
