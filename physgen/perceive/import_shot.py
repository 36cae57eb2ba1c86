"""A scene of the paper's code as a shot: in natural time and forms, where its code has 16 frames and discs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import copysign, degrees, hypot, radians, sqrt
from typing import Any

import cv2
import numpy as np

from physgen.geometry.polygon import (
    Array,
    MassProperties,
    Region,
    Ring,
    mass_properties,
    rotation,
)
from physgen.geometry.scale import scale_entry
from physgen.perceive.document import HOLD, MOTION_BLUR
from physgen.perceive.roles import PerceivedScene
from physgen.perceive.shape_entries import short


@dataclass(frozen=True)
class ShotTuning:
    """What counts as a box and a floor, and the numbers that the paper's scenes lack."""

    rectangle: float = 0.9
    """Share of the least rectangle around an outline that a box fills."""
    upright: float = 4.0
    """degrees by which the outline of a standing box may be off."""
    stands: float = 6.0
    """px between the foot of a box and the floor on which it stands."""
    border: float = 3.0
    """px from the picture's border, where a floor goes on."""
    table: float = 0.2
    """Friction of a table: cloth."""
    cushion: float = 0.8
    """Elasticity of the walls of a table, if it is 0."""
    rolling: float = 0.01
    """Rolling resistance of balls."""
    fastest: float = 3.0
    """Largest speed of a push on a table, longer sides of the photo per second: faster
    balls cannot be followed.
    """
    wall_distance: float = 0.5
    """Distance of a table's unseen walls from the picture's border, sides of the
    photo.
    """
    ramp: str = "0.1 s"
    """Three frames of a push that does not turn an object."""


SHOT = ShotTuning()
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
RENDER = {
    "fps": 30,
    "motion_blur": MOTION_BLUR,
    "grain": "match",
    "hold": HOLD,
    "contact_shade": True,
    "squash": True,
}
"""Settings of the video, as `perceive` writes them."""


def as_shot(scene: PerceivedScene) -> PerceivedScene:
    """Return an imported scene with spheres, boxes, long floors, a table, 30 fps and pushes that take a while."""
    document = dict(scene.document)
    comments = dict(scene.comments)
    height, width = scene.percepts.labels.shape
    floors = [wall["segment"] for wall in document["boundaries"].values()]
    objects = {}
    for name, entry in document["objects"].items():
        objects[name] = _natural_form(entry, floors)
    _push_by_velocity(document["forces"], objects)
    if document["world"]["view"] == "top":
        _limit_speeds(objects, SHOT.fastest * max(width, height))
    world, boundaries = _natural_world(document, comments, (width, height))
    if any(entry.get("spin") for entry in objects.values()):
        # Held against the floor while it turns, an object would be flung away.
        del world["ramp"]
    comments.pop("forces", None)
    comments["objects"] = "--faithful keeps the discs and outlines of the paper's code"
    document |= {
        "world": world,
        "objects": objects,
        "boundaries": boundaries,
        "forces": [],
        "render": RENDER | _entering_tool(objects, world["view"]),
    }
    return replace(scene, document=document, comments=comments)


def _entering_tool(
    objects: Mapping[str, Mapping[str, Any]], view: str
) -> dict[str, str]:
    """Return the setting of the tool that pushes what moves first; empty if nothing
    is pushed: nothing may start by itself.
    """
    pushed = [entry for entry in objects.values() if any(entry.get("velocity", ()))]
    if not pushed:
        return {}
    is_ball_game = view == "top" and all(
        entry.get("solid") == "sphere" for entry in pushed
    )
    return {"enter": "cue" if is_ball_game else "finger"}


def _natural_world(
    document: Mapping[str, Any], comments: dict[str, str], size: tuple[int, int]
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Return world and boundaries for a photo of `size` (W, H), and write their comments."""
    world = dict(document["world"]) | {"duration": "auto", "ramp": SHOT.ramp}
    boundaries = document["boundaries"]
    if world["view"] != "top":
        return world, _with_long_floors(boundaries, size[0])
    world.pop("gravity", None)
    per_meter, reason = scale_entry(max(size), None, None)
    world["pixels_per_meter"] = per_meter
    world["table"] = {"friction": SHOT.table}
    comments["world.pixels_per_meter"] = reason
    comments["world.table"] = "as of cloth"
    comments["world.view"] = "gravity 0: seen from above"
    return world, _with_cushions(boundaries, size, comments)


def _natural_form(
    entry: Mapping[str, Any], floors: Sequence[Sequence[Sequence[float]]]
) -> dict[str, Any]:
    """Return the entry of an object: discs are spheres, and near-rectangles boxes."""
    natural = dict(entry)
    if entry.get("solid") == "disc":
        return natural | {"solid": "sphere", "rolling": SHOT.rolling}
    points = entry["shape"].get("polygon")
    if points is None:
        return natural
    box = _box_around(np.array(points, np.float64), floors)
    if box is not None:
        natural["shape"] = {"box": box}
    return natural


def _box_around(
    points: Array, floors: Sequence[Sequence[Sequence[float]]]
) -> dict[str, Any] | None:
    """Return the box of an outline (N, 2) that nearly fills it; None if it does not."""
    outline = points.astype(np.float32)
    (x, y), (wide, high), angle = cv2.minAreaRect(outline)
    area = float(cv2.contourArea(outline))
    if area < SHOT.rectangle * wide * high:
        return None
    if abs(angle) > 45:
        angle, wide, high = angle - copysign(90, angle), high, wide
    # As large as the outline.
    scale = sqrt(area / (wide * high))
    wide = round(scale * wide, 2)
    high = round(scale * high, 2)
    if abs(angle) < SHOT.upright:
        foot = float(points[:, 1].max())
        for (x0, y0), (x1, y1) in floors:
            is_level = y0 == y1 and min(x0, x1) <= x <= max(x0, x1)
            if is_level and abs(foot - y0) <= SHOT.stands:
                angle = 0.0
                y = y0 - high / 2
    box: dict[str, Any] = {"center": [short(round(x, 2)), short(round(y, 2))]}
    box["size"] = [short(wide), short(high)]
    if angle:
        box["angle"] = short(round(angle, 2))
    return box


def _push_by_velocity(
    forces: Sequence[Mapping[str, Any]], objects: dict[str, dict[str, Any]]
) -> None:
    """Add the paper's changes of velocity, which are impulses here, to velocities, which a ramp reaches."""
    for force in forces:
        entry = objects[force["object"]]
        mass = entry.get("mass")
        if mass is None:
            form = _form(entry["shape"])
            mass = entry["density"] * form.area
            x, y = np.array(force["at"], np.float64) - form.center
            right, down = force["impulse"]
            spin = (x * down - y * right) / (entry["density"] * form.second)
            entry["spin"] = float(f"{degrees(spin):.4g}")
        before = entry.get("velocity", [0.0, 0.0])
        pairs = zip(before, force["impulse"], strict=True)
        entry["velocity"] = [float(f"{v + part / mass:.4g}") for v, part in pairs]


def _form(shape: Mapping[str, Any]) -> MassProperties:
    """Return area, centre and second moment of a shape's entry of polygons or a box."""
    if "box" in shape:
        turn = rotation(radians(shape["box"].get("angle", 0.0)))
        corners = CORNERS * shape["box"]["size"] / 2 @ turn.T
        rings = [Ring(corners + shape["box"]["center"])]
    else:
        pieces = shape.get("polygons") or [{"outline": shape["polygon"]}]
        rings = list(map(_ring, pieces))
    return mass_properties(Region(tuple(rings)))


def _ring(piece: Mapping[str, Any]) -> Ring:
    """Return a piece of `polygons`."""
    holes = [np.array(hole, np.float64) for hole in piece.get("holes", ())]
    return Ring(np.array(piece["outline"], np.float64), tuple(holes))


def _limit_speeds(objects: dict[str, dict[str, Any]], limit: float) -> None:
    """Reduce velocities to a speed of at most `limit`, px/s, in place."""
    for entry in objects.values():
        speed = hypot(*entry.get("velocity", (0.0, 0.0)))
        if speed > limit:
            entry["velocity"] = [
                float(f"{part * limit / speed:.4g}") for part in entry["velocity"]
            ]


def _with_cushions(
    boundaries: Mapping[str, dict[str, Any]],
    size: tuple[int, int],
    comments: dict[str, str],
) -> dict[str, dict[str, Any]]:
    """Return the boundaries of a table, from which objects bounce.

    Walls along the border of a photo of `size` (W, H) are no cushions that it shows:
    they are moved outwards.
    """
    cushions = {}
    remarks = []
    for name, wall in boundaries.items():
        cushions[name] = wall | {"segment": _move_outwards(wall["segment"], size)}
        if not wall["elasticity"]:
            cushions[name]["elasticity"] = SHOT.cushion
            remarks = ["0 in sim.yaml: nothing bounced off them"]
    if any(
        cushions[name]["segment"] != boundaries[name]["segment"] for name in cushions
    ):
        remarks.append(
            "those at the picture's border lie outside, where they are not seen"
        )
    if remarks:
        comments["boundaries"] = "; ".join(remarks)
    return cushions


def _move_outwards(
    segment: Sequence[Sequence[float]], size: tuple[int, int]
) -> list[list[float]]:
    """Return a segment, with ends at the border of a photo of `size` moved outwards.

    A segment that only ends at the border stays.
    """
    ends = np.array(segment, np.float64)
    last = np.array(size, np.float64) - 1
    is_low = ends <= SHOT.border
    is_high = ends >= last - SHOT.border
    is_along_border = bool(is_low.all(axis=0).any() or is_high.all(axis=0).any())
    if is_along_border:
        ends += SHOT.wall_distance * np.array(size) * (is_high.astype(int) - is_low)
    return [[short(x), short(y)] for x, y in ends.tolist()]


def _with_long_floors(
    boundaries: Mapping[str, dict[str, Any]], width: int
) -> dict[str, dict[str, Any]]:
    """Return boundaries whose ends at the picture's sides are a picture's width beyond."""
    longer = {}
    for name, wall in boundaries.items():
        ends = np.array(wall["segment"], np.float64)
        way = ends[1] - ends[0]
        for end, sign in ((0, -1), (1, 1)):
            x = ends[end, 0]
            is_left = x <= SHOT.border and sign * way[0] < 0
            is_right = x >= width - 1 - SHOT.border and sign * way[0] > 0
            if is_left or is_right:
                ends[end] += sign * way * (width / abs(way[0]))
        segment = [[short(x), short(y)] for x, y in ends.tolist()]
        longer[name] = wall | {"segment": segment}
    return longer
