"""Vehicles: bodies on wheels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

import numpy as np
import shapely
from numpy.typing import NDArray

from physgen.compile.shapes import carrying_lines, stand_on_lines
from physgen.compile.world import Body, Wheel
from physgen.geometry.convex import convex_pieces
from physgen.geometry.polygon import (
    Array,
    Disc,
    Outline,
    Region,
    Ring,
    mass_properties,
    rotation,
)
from physgen.messages import Message
from physgen.problems import InputError
from physgen.scene.scene import Motion, Object, Scene, View


@dataclass(frozen=True)
class VehicleConstants:
    """Constants of bodies with wheels."""

    # Gap between a wheel and the body around it, in wheel radii.
    gap: float = 0.06
    # Minimum height of the body over the road, in wheel radii.
    clearance: float = 0.35
    # Corners of the circle cut out of the body.
    corners: int = 24
    # Minimum area of a part of the body, in areas of the body.
    speck: float = 0.01


VEHICLE = VehicleConstants()


def with_wheels(
    body: Body, item: Object, outline: Outline, photo_outline: Outline, scene: Scene
) -> Body:
    """Return the body on its wheels, or unchanged without wheels that can turn.

    `outline` is the object at its place, `photo_outline` the object in the photo. Raise
    InputError for a wheel outside the object.
    """
    if not item.wheels:
        return body
    check_wheels(item, photo_outline, scene)
    if item.motion is not Motion.DYNAMIC or scene.world.view is View.TOP:
        return body
    wheels = place_wheels(body, item, photo_outline, scene)
    pieces = chassis_pieces(outline, body.center, wheels, scene)
    return replace(body, wheels=wheels, pieces=pieces or body.pieces)


def check_wheels(item: Object, photo_outline: Outline, scene: Scene) -> None:
    """Raise InputError for wheels outside the object, and for a round object."""
    problems = []
    if isinstance(photo_outline, Disc):
        path = f"objects.{item.name}.wheels"
        raise Message.WHEELS_ON_CIRCLE.error_at(scene.place(path), path, "the wheels")
    # A wheel must overlap the outline of its vehicle, or touch it.
    body = _polygon(photo_outline)
    for index, wheel in enumerate(item.wheels):
        path = f"objects.{item.name}.wheels[{index}]"
        circle = shapely.Point(wheel.center).buffer(wheel.radius)
        if body.distance(shapely.Point(wheel.center)) <= wheel.radius:
            others = item.wheels[:index]
            # Two wheels within a pixel are one wheel written twice.
            if any(np.hypot(*np.subtract(o.center, wheel.center)) < 1 for o in others):
                value_text = f"the wheel at {wheel.center[0]:g}, {wheel.center[1]:g}"
                problems.append(
                    Message.WHEEL_TWICE.problem(scene.place(path), path, value_text)
                )
            continue
        x0, y0, x1, y1 = body.bounds
        value_text = f"a wheel at {wheel.center[0]:g}, {wheel.center[1]:g}"
        problems.append(
            Message.WHEEL_FAR.problem(
                scene.place(path),
                path,
                value_text,
                x0=x0,
                x1=x1,
                y0=y0,
                y1=y1,
                distance=body.distance(circle),
            )
        )
    if problems:
        raise InputError(problems)


def place_wheels(
    body: Body, item: Object, photo_outline: Outline, scene: Scene
) -> tuple[Wheel, ...]:
    """Return the wheels in the body's frame, on the ground if it is within reach."""
    # The scene has wheels in the photo's frame; the vehicle may be placed and turned
    # elsewhere.
    middle = mass_properties(photo_outline).center
    lines = carrying_lines(scene)
    if item.place is not None:
        turn = rotation(radians(item.place[2]))
    else:
        turn = np.eye(2)
    wheels = []
    for wheel in item.wheels:
        disc = Disc(np.array(wheel.center, np.float64), wheel.radius)
        # A wheel of a mask is a bit off its road; a written place is meant.
        if item.place is None and lines:
            new_disc = stand_on_lines(disc, lines)
            assert isinstance(new_disc, Disc)
            disc = new_disc
        axle = (disc.center - middle) @ turn.T
        wheels.append(Wheel(axle, disc.radius, wheel.turns))
    return tuple(wheels)


def chassis_pieces(
    outline: Outline, center: Array, wheels: tuple[Wheel, ...], scene: Scene
) -> tuple[Array, ...]:
    """Return the convex pieces of the body above the road and without its wheels.

    The lowest part of a mask is often a shadow or a far wheel, which would scrape.
    """
    body = _polygon(outline)
    for wheel in wheels:
        # The wheel needs room to turn.
        radius = wheel.radius * (1 + VEHICLE.gap)
        middle = shapely.Point(center + wheel.axle)
        body = body.difference(middle.buffer(radius, quad_segs=VEHICLE.corners // 4))
    body = body.difference(_road(center, wheels, scene, body.bounds))
    # Cutting out the wheels leaves splinters of the mask, too small to matter in a
    # collision.
    smallest_area = VEHICLE.speck * body.area
    parts = []
    for part in getattr(body, "geoms", [body]):
        if isinstance(part, shapely.Polygon) and part.area > smallest_area:
            parts.append(part)
    if not parts:
        return ()
    rings = tuple(Ring(_corners(part.exterior), ()) for part in parts)
    return tuple(piece - center for piece in convex_pieces(Region(rings)))


def _road(
    center: Array,
    wheels: tuple[Wheel, ...],
    scene: Scene,
    bounds: tuple[float, float, float, float],
) -> shapely.Polygon:
    """Return the region below the clearance over the line through the wheels' lowest
    points.
    """
    # Down is the direction of gravity, or of the picture without gravity; the road runs
    # across it.
    gravity = np.array(scene.world.gravity, np.float64)
    strength = float(np.hypot(*gravity))
    down = np.array([0.0, 1.0])
    if strength > 0:
        down = gravity / strength
    direction = np.array([down[1], -down[0]])
    lowest_points = [center + wheel.axle + wheel.radius * down for wheel in wheels]
    lowest_points.sort(key=lambda point: float(point @ direction))
    first, last = lowest_points[0], lowest_points[-1]
    length = float(np.hypot(*(last - first)))
    # A single wheel has no line: the road is level.
    if length > 1:
        direction = (last - first) / length
    # The chassis stays so far above the road that it does not scrape on bumps.
    lift = VEHICLE.clearance * min(wheel.radius for wheel in wheels)
    # The polygon must be larger than the body in every direction.
    distance = 4 * float(np.hypot(bounds[2] - bounds[0], bounds[3] - bounds[1])) + 100
    middle = (first + last) / 2 - lift * down
    corners = [
        middle - distance * direction,
        middle + distance * direction,
        middle + distance * direction + distance * down,
        middle - distance * direction + distance * down,
    ]
    return shapely.Polygon(np.array(corners))


def _polygon(outline: Outline) -> shapely.Geometry:
    if isinstance(outline, Disc):
        return shapely.Point(outline.center).buffer(outline.radius)
    rings = [shapely.Polygon(ring.outer, ring.holes) for ring in outline.rings]
    return shapely.union_all([ring.buffer(0) for ring in rings])


def _corners(ring: shapely.LinearRing) -> NDArray[np.float64]:
    return np.asarray(ring.coords, np.float64)[:-1]
