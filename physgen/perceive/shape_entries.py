"""Entries of shapes, boundaries, light and view in a scene document."""

from __future__ import annotations

from math import atan2, degrees, floor
from typing import Any

import numpy as np

from physgen.geometry.polygon import Array, Disc, Outline
from physgen.perceive.roles import (
    Shadows,
    Wall,
)
from physgen.perceive.wheels import Vehicle
from physgen.photometry import DistantLight
from physgen.scene.provenance import provenance as provenance
from physgen.scene.scene import Solid
from physgen.scene.schema import schema_at

FACING_CONFIDENCE = 0.6
"""Not measured: buses and bicycles look alike from both ends."""


def vehicle_entry(vehicle: Vehicle) -> dict[str, Any]:
    """Return `wheels:` and `facing:` of an object."""
    wheels = []
    for wheel in vehicle.wheels:
        wheels.append(
            {
                "center": list(map(short, wheel.center)),
                "radius": short(wheel.radius),
            }
        )
    return {"wheels": wheels, "facing": vehicle.facing.value}


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
    if shadows.clean_background is None or not side:
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
            piece["holes"] = list(map(corners, ring.holes))
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
    if is_new.sum() >= 3:
        distinct = grid_points[is_new]
    else:
        distinct = grid_points
    return [[short(x), short(y)] for x, y in distinct]


def short(value: float) -> float:
    """Return the number, as an integer if possible: 18 instead of 18.0."""
    if float(value).is_integer():
        return int(value)
    return float(value)


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
