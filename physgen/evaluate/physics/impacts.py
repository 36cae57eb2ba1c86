"""Rows of collisions with bodies and walls, without gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import cos, degrees, sin, sqrt
from typing import Any

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Array,
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
    worst,
)
from physgen.evaluate.physics.staging import (
    FLOATING,
    INERTIA,
    Point,
    circle,
    scene,
    segment,
)

ORIGIN = (0.0, 0.0)
SOLIDS = ("disc", "sphere", "hoop")


def place_along(
    start: Point, angle: float, distance: float, offset: float = 0.0
) -> Point:
    """Return the point at a distance (px) from `start` along a direction (rad), and at an offset to its side.

    The side is the direction turned by 90 degrees from +x towards +y.
    """
    c, s = cos(angle), sin(angle)
    x, y = start
    return x + distance * c - offset * s, y + distance * s + offset * c


def vector(angle: float, length: float) -> Point:
    """Return the vector of a direction (rad) and a length."""
    return place_along(ORIGIN, angle, length)


def _four_centers(distance: float) -> list[Point]:
    """Return the centres (px) of four fields, two beside two."""
    first = distance / 2
    places = (first, first + distance)
    centers = []
    for y in places:
        for x in places:
            centers.append((x, y))
    return centers


@dataclass(frozen=True)
class _Collision:
    """A light ball against a resting ball of three times its mass."""

    angle: float
    """Direction, rad."""
    speed: float
    """px/s."""
    elasticity: float

    def velocities(self) -> dict[str, Point]:
        """Return the velocities after the collision, px/s."""
        # Momentum and Newton's law of impact give both speeds for the masses 1 and 3.
        light = (1 - 3 * self.elasticity) / 4
        heavy = (1 + self.elasticity) / 4
        return {
            "light": vector(self.angle, light * self.speed),
            "heavy": vector(self.angle, heavy * self.speed),
        }


def _head_on(draw: Draw) -> list[Case]:
    """Return the case of four head-on collisions in any direction."""
    objects, collisions = {}, []
    elasticities = (0.0, 0.3, draw.number(0.4, 0.9), 1.0)
    for k, center in enumerate(_four_centers(260.0)):
        angle = draw.angle()
        speed = draw.number(150, 300, 0)
        mass = draw.number(20, 200, 0)
        # Momentum and Newton's rule determine both velocities: masses in the ratio 1 to
        # 3 leave neither of them at its old speed in general.
        collision = _Collision(angle, speed, elasticities[k])
        # In a central hit without spin nothing slides: friction must change nothing.
        surface = {
            "friction": draw.number(0, 0.6),
            "elasticity": collision.elasticity,
        }
        objects[f"light-{k}"] = circle(
            place_along(center, angle, -85),
            draw.number(8, 18),
            mass=mass,
            velocity=list(vector(angle, speed)),
            **surface,
        )
        objects[f"heavy-{k}"] = circle(
            center, draw.number(12, 28), mass=3 * mass, **surface
        )
        collisions.append(collision)
    document = scene((520, 520), 0.8, objects, world=FLOATING)
    measure = partial(_head_on_error, collisions)
    return [Case(document, measure)]


def _head_on_error(collisions: Sequence[_Collision], run: Run) -> Errors:
    """Return the largest deviation of a velocity, over the first speed."""
    errors = []
    for k, collision in enumerate(collisions):
        for name, expected in collision.velocities().items():
            deviation = run.track(f"{name}-{k}").velocity[-1] - expected
            errors.append(np.hypot(*deviation) / collision.speed)
    return {"velocity": worst(errors)}


GAPS = {"touching": 0.0, "apart": 1e-6, "pressed": -1e-6, "overlapping": -0.5}
DIRECTIONS = (0.0, 90.0, 37.0)
"""Directions in degrees. The last two draws take a random one, and 0 again."""
CUE_DISTANCE = 40
"""Distance from the row to the cue ball, beyond its place in the row, px."""


def _lane_point(distance: float, *, offset: float, direction: Point) -> Point:
    """Return the point of a lane at a distance from the middle of the lane, px."""
    c, s = direction
    x = 260 + distance * c - offset * s
    return x, 260 + distance * s + offset * c


def _row_of_balls(draw: Draw) -> list[Case]:
    """Return the case of rows of balls in four lanes, one per gap.

    Three draws send a ball into a row of five at rest. In two draws, the first of the
    five has the speed at t = 0.
    """
    has_cue = draw.index < len(DIRECTIONS)
    direction = _row_direction(draw)
    speed = draw.number(200, 350, 0)
    radius = draw.number(12, 16, 0)
    mass = draw.mass()
    objects: dict[str, Document] = {}
    for j, (lane, gap) in enumerate(GAPS.items()):
        # The result must not depend on the gap: whether balls touch, nearly touch or
        # overlap by rounding, the last one leaves with the speed of the first.
        distances = _lane_distances(lane, 2 * radius + gap, has_cue)
        lane_point = partial(_lane_point, offset=(j - 1.5) * 70, direction=direction)
        places = dict(zip(distances, map(lane_point, distances.values()), strict=True))
        velocity = [speed * direction[0], speed * direction[1]]
        objects.update(_lane_balls(places, radius, mass, velocity))
    document = scene((520, 520), 0.5, objects, world=FLOATING)
    measure = partial(_row_error, tuple(objects), np.array(direction), speed)
    return [Case(document, measure)]


def _lane_balls(
    places: dict[str, Point], radius: float, mass: float, velocity: list[float]
) -> dict[str, Document]:
    """Return the balls of a lane; the first of them moves."""
    balls = {}
    for name, place in places.items():
        balls[name] = circle(
            place, radius, solid="sphere", mass=mass, friction=0.0, elasticity=1.0
        )
    balls[next(iter(places))]["velocity"] = velocity
    return balls


def _row_direction(draw: Draw) -> Point:
    """Return the unit vector along the rows of a draw."""
    if draw.index < len(DIRECTIONS):
        angle = DIRECTIONS[draw.index]
    else:
        last_angles = (float(draw.count(0, 359)), 0.0)
        angle = last_angles[draw.index - len(DIRECTIONS)]
    # With whole px along an axis, a gap of 0 is 0 to the last bit.
    cosine = round(float(np.cos(np.radians(angle))), 15)
    sine = round(float(np.sin(np.radians(angle))), 15)
    return cosine, sine


def _lane_distances(lane: str, step: float, has_cue: bool) -> dict[str, float]:
    """Return the places of the balls of a lane along it, px; the moving one first."""
    distances = {}
    if has_cue:
        # The cue ball would touch the row one step before the first ball, and starts
        # farther away.
        distances[f"{lane}-cue"] = -100 - step - CUE_DISTANCE
    for k in range(1, 6):
        distances[f"{lane}-{k}"] = -100 + (k - 1) * step
    return distances


def _row_error(
    names: Sequence[str], direction: Array, speed: float, run: Run
) -> Errors:
    """Return the largest deviation of a ball's velocity, over the first speed. The last
    ball takes all of the speed.
    """
    errors = []
    for name in names:
        expected = direction * (speed if name.endswith("-5") else 0)
        deviation = run.track(name).velocity[-1] - expected
        errors.append(np.hypot(*deviation) / speed)
    return {"velocity": worst(errors)}


def _oblique(draw: Draw) -> list[Case]:
    """Return the case of four off-centre collisions of equal balls."""
    objects, center_lines = {}, []
    for k, center in enumerate(_four_centers(300.0)):
        angle = draw.angle()
        speed = draw.number(250, 400, 0)
        radius = draw.number(10, 20)
        # The offset is a part of the sum of both radii: the balls always meet.
        offset = draw.sign() * 2 * radius * draw.number(0.15, 0.85)
        ball = {"mass": draw.mass(), "friction": 0.0, "elasticity": 1.0}
        start = place_along(center, angle, -90, offset)
        velocity = list(vector(angle, speed))
        objects[f"cue-{k}"] = circle(start, radius, velocity=velocity, **ball)
        objects[f"struck-{k}"] = circle(center, radius, **ball)
        # At the hit, the centres are two radii apart: the offset gives the direction.
        distance = sqrt(4 * radius**2 - offset**2)
        center_lines.append(place_along(ORIGIN, angle, distance, -offset))
    document = scene((600, 600), 0.5, objects, world=FLOATING)
    measure = partial(_oblique_errors, center_lines)
    return [Case(document, measure)]


def _oblique_errors(center_lines: Sequence[Point], run: Run) -> Errors:
    """Return the deviation of the angle between the paths from a right angle, and of
    the struck ball's path from the line of centres, degrees.
    """
    right_angles, lines = [], []
    for k, center_line in enumerate(center_lines):
        cue_velocity = run.track(f"cue-{k}").velocity[-1]
        struck_velocity = run.track(f"struck-{k}").velocity[-1]
        # Equal masses without a loss: momentum and energy together leave a right angle.
        right_angles.append(abs(abs(_angle(cue_velocity, struck_velocity)) - 90))
        lines.append(abs(_angle(struck_velocity, center_line)))
    return {"paths": worst(right_angles), "line of centres": worst(lines)}


def _angle(first: Any, second: Any) -> float:
    """Return the angle from one vector to another, degrees."""
    cross = first[0] * second[1] - first[1] * second[0]
    dot = first[0] * second[0] + first[1] * second[1]
    return degrees(np.arctan2(cross, dot))


@dataclass(frozen=True)
class _RoundBody:
    """A round body in contact with another body or a wall."""

    mass: float
    """g."""
    radius: float
    """px."""
    solid: str

    @classmethod
    def random(cls, draw: Draw) -> _RoundBody:
        """Return a body of a draw."""
        mass = draw.mass()
        radius = draw.number(12, 24)
        return cls(mass, radius, SOLIDS[draw.count(0, 2)])

    @property
    def inertia(self) -> float:
        """Return k of I = k m r²."""
        return INERTIA[self.solid]

    def keys(self) -> Document:
        """Return mass and solid in the scene file's form."""
        return {"solid": self.solid, "mass": self.mass}


@dataclass(frozen=True)
class _Change:
    """Change of a body's motion by friction in a hit."""

    name: str
    speed: float
    """px/s along the surface."""
    spin: float
    """rad/s."""


@dataclass(frozen=True)
class _Hit:
    """Impulses of a hit with friction. Friction may or may not stop the sliding."""

    body: _RoundBody
    partner: _RoundBody | None
    """None for a wall."""
    friction: float
    elasticity: float
    speed: float
    """px/s towards the partner."""

    def tangential_mass(self) -> float:
        """Return the impulse for a change of the sliding speed by 1 px/s, g."""
        m = self.body.mass
        k = self.body.inertia
        if self.partner is None:
            # A wall does not move. The contact point of the body moves by J/m with its
            # centre and by J R²/I = J/(k m) with its turn.
            return m / (1 + 1 / k)
        m2 = self.partner.mass
        k2 = self.partner.inertia
        # Both bodies move and turn, and each of the four parts adds to the sliding
        # speed.
        return 1 / (1 / m + 1 / m2 + 1 / (k * m) + 1 / (k2 * m2))

    def friction_limit(self) -> float:
        """Return the largest impulse of friction, g·px/s."""
        m = self.body.mass
        reduced_mass = m
        if self.partner is not None:
            reduced_mass = m * self.partner.mass / (m + self.partner.mass)
        # Coulomb's limit: mu times the normal impulse, (1 + e) m_red v.
        return self.friction * (1 + self.elasticity) * reduced_mass * self.speed

    def friction_impulse(self, spin: float) -> float:
        """Return the impulse of friction (g·px/s) at a spin (degrees/s)."""
        sliding_speed = np.radians(spin) * self.body.radius
        # Friction stops the slip if its limit allows; otherwise the contact slides
        # throughout.
        stop_impulse = abs(sliding_speed) * self.tangential_mass()
        return float(-np.sign(sliding_speed) * min(self.friction_limit(), stop_impulse))


def _spin_transfer(draw: Draw) -> list[Case]:
    """Return the case of a ball against a wall, and of two spinning balls head-on.

    In one hit, the sliding speed u at the contact is too high for friction to stop it;
    in the other, it is low enough.
    """
    objects: dict[str, Document] = {}
    walls: dict[str, Document] = {}
    changes: dict[str, list[_Change]] = {}
    for kind, y in (("sliding", 100.0), ("sticking", 300.0)):
        if kind == "sliding":
            part = draw.number(1.5, 3)
        else:
            part = draw.number(0.2, 0.8)
        changes[kind] = []
        for has_partner in (False, True):
            hit = _draw_hit(draw, has_partner)
            body = hit.body
            # At a slip of limit over tangential mass, both cases meet.
            slip = part * hit.friction_limit() / hit.tangential_mass()
            # The slip at the contact is spin * radius: choose the spin that gives it.
            spin = draw.sign() * round(degrees(slip / body.radius), 1)
            changes[kind] += _stage_hit(kind, y, hit, spin, objects, walls)
    document = scene((640, 400), 0.9, objects, walls, world=FLOATING)
    measure = partial(_transfer_errors, changes)
    return [Case(document, measure)]


def _draw_hit(draw: Draw, has_partner: bool) -> _Hit:
    friction = draw.number(0.1, 0.4, 3)
    elasticity = draw.number(0.3, 1.0)
    speed = draw.number(150, 300, 0)
    body = _RoundBody.random(draw)
    if has_partner:
        partner = _RoundBody.random(draw)
    else:
        partner = None
    return _Hit(body, partner, friction, elasticity, speed)


def _stage_hit(
    kind: str,
    y: float,
    hit: _Hit,
    spin: float,
    objects: dict[str, Document],
    walls: dict[str, Document],
) -> list[_Change]:
    """Add the bodies of a hit at the height `y` (px), and return their changes
    of motion; spin in degrees/s.
    """
    body, partner = hit.body, hit.partner
    surface = {"friction": hit.friction, "elasticity": hit.elasticity}
    # The impulse along the surface changes both the sideways velocity and the spin.
    impulse = hit.friction_impulse(spin)
    x = 410
    if partner is None:
        x = 110
    if partner is None:
        name = f"{kind}-ball"
    else:
        name = f"{kind}-first"
    objects[name] = circle(
        (x - 70, y),
        body.radius,
        **body.keys(),
        velocity=[hit.speed, 0],
        spin=spin,
        **surface,
    )
    changes = [_change(name, body, impulse, impulse)]
    if partner is None:
        wall = segment((x + 50, y - 90), (x + 50, y + 90), **surface)
        walls[f"{kind}-wall"] = wall
        return changes
    name = f"{kind}-second"
    objects[name] = circle((x, y), partner.radius, **partner.keys(), **surface)
    # The partner gets the opposite impulse; both impulses turn in the same sense.
    return [*changes, _change(name, partner, -impulse, impulse)]


def _change(name: str, body: _RoundBody, push: float, twist: float) -> _Change:
    """Return the change by an impulse at the edge, g·px/s: `push` moves the body and
    `twist` turns it.
    """
    # I/R: the impulse acts at the arm R.
    moment = body.inertia * body.mass * body.radius
    return _Change(name, push / body.mass, twist / moment)


def _transfer_errors(changes: Mapping[str, Sequence[_Change]], run: Run) -> Errors:
    """Return the largest error of a change of spin or of speed along the surface, for
    each kind of hit.
    """
    errors: dict[str, float] = {}
    for kind, kind_changes in changes.items():
        deviations = []
        for change in kind_changes:
            track = run.track(change.name)
            # The hit is along x, so that friction acts along y.
            speed_change = track.velocities[-1, 1] - track.velocities[0, 1]
            deviations.append(abs(speed_change / change.speed - 1))
            spin_change = track.spin[-1] - track.spin[0]
            deviations.append(abs(spin_change / change.spin - 1))
        errors[kind] = worst(deviations)
    return errors


ROWS = (
    Row(
        11, "head-on", "head-on, masses 1:3", "v1 = (1 - 3 e) v/4, v2 = (1 + e) v/4",
        "e 0, 0.3, 1 and one between; any direction, 150 to 300 px/s, radii 8 to 28 px",
        "Deviation of each velocity over the first speed.",
        (Measure("velocity", 1e-3),), _head_on,
    ),
    Row(
        12, "row-of-balls", "row of 5 touching equal balls, e = 1", "the last takes all",
        "gaps 0, 1e-6, -1e-6 and -0.5 px in each draw; directions 0, 90, 37 degrees and at random; struck by a sixth "
        "ball, or the first moving at t = 0",
        "Deviation of every ball's velocity over the first speed.",
        (Measure("velocity", 1e-2),), _row_of_balls,
    ),
    Row(
        13, "oblique", "oblique hit of equal balls, e = 1, no friction", "paths part at 90 degrees, the struck ball "
        "leaves along the line of centres",
        "four pairs: aside by 0.15 to 0.85 diameters, any direction, 250 to 400 px/s, radii 10 to 20 px",
        "Angles between the velocities after the hit.",
        (Measure("paths", 0.5, Unit.DEGREES), Measure("line of centres", 0.5, Unit.DEGREES)), _oblique,
    ),
    Row(
        30, "spin-transfer", "spin in a hit with friction", "sliding: impulse mu (1 + e) m_red v_n; sticking: u m_t",
        "ball at a wall and two balls head-on; u 1.5 to 3 and 0.2 to 0.8 of the limit; mu 0.1 to 0.4, e 0.3 to 1",
        "Changes of spin (impulse x R/I) and of speed along the surface over themselves. Algebra, as for row 11; 0.3 % "
        "leaves room for where in a step the hit falls. m_t = 1/(1/m1 + 1/m2 + R1²/I1 + R2²/I2).",
        (Measure("sliding", 3e-3), Measure("sticking", 3e-3)), _spin_transfer,
    ),
)  # fmt: skip
