"""Rows of objects on a table, seen from above: sliding and spinning pucks, struck
balls, a break.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import cos, degrees, inf, log, radians, sin, sqrt

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
from physgen.evaluate.physics.sliding_disc import Stop, stop
from physgen.evaluate.physics.staging import GRAVITY, box, circle, scene

STILL = 1e-3
"""Maximum remaining speed of a resting object over its first speed."""


def _table(mu: float) -> Document:
    """Return the world of a table with a coefficient of friction."""
    return {"view": "top", "table": {"friction": mu}}


AXIS_Y = 300.0
"""Axis of symmetry of the rack, px."""
RACK_ROWS = 5
BROKEN_CORNERS = ("ball-5-1", "ball-5-5")
"""Balls that move by more than their radius in a break."""
UNBROKEN = 1000.0
"""Error of an untouched rack, px."""


def _rack(distance: float) -> Iterator[tuple[int, int, tuple[float, float]]]:
    """Yield row, number in the row (both from 1) and centre (px) of each ball.

    `distance` is that of two neighbours, px.
    """
    for i in range(RACK_ROWS):
        for j in range(i + 1):
            # Triangles of equal sides: rows are sqrt(3)/2 of the distance apart.
            x = 360 + i * distance * sqrt(0.75)
            yield i + 1, j + 1, (x, AXIS_Y + (j - i / 2) * distance)


def _break(draw: Draw) -> list[Case]:
    """Return the case of a cue ball against a rack of 15 on its axis."""
    # Racks from photos overlap a little, and exact ones touch.
    overlap = 0.5
    if draw.index in (0, 3):
        overlap = 0.0
    has_friction = draw.index % 2 == 0
    radius = draw.number(12, 16, 0)
    mass = draw.number(100, 200, 0)
    elasticity = 0.95
    if draw.index:
        elasticity = draw.number(0.9, 0.98)
    ball = {
        "solid": "sphere",
        "mass": mass,
        "friction": 0.06,
        "elasticity": elasticity,
    }
    velocity = [draw.number(800, 1400, 0), 0]
    objects = {"cue": circle((120, AXIS_Y), radius, velocity=velocity, **ball)}
    mirror_pairs = [("cue", "cue")]
    for row, k, center in _rack(2 * radius - overlap):
        name = f"ball-{row}-{k}"
        objects[name] = circle(center, radius, **ball)
        # Ball k from the left mirrors ball k from the right of its row.
        mirror_pairs.append((name, f"ball-{row}-{row + 1 - k}"))
    world = _table(0.2 if has_friction else 0.0)
    document = scene((1000, 600), 1.0, objects, world=world)
    return [Case(document, partial(_mirror_error, mirror_pairs, radius))]


def _mirror_error(
    mirror_pairs: Sequence[tuple[str, str]], radius: float, run: Run
) -> Errors:
    """Return the largest distance at any time between a ball and the mirror image of
    its partner.
    """
    # A rack that no ball touches would be symmetrical as well.
    for name in BROKEN_CORNERS:
        if np.hypot(*run.track(name).displacements[-1]) <= radius:
            return {"mirror": UNBROKEN}
    error = 0.0
    for name, partner in mirror_pairs:
        track = run.track(name)
        mirror_track = run.track(partner)
        # Each ball mirrors its partner in the axis of the rack; the cue ball is its own
        # partner.
        dx = track.x - mirror_track.x
        dy = track.y + mirror_track.y - 2 * AXIS_Y
        error = max(error, float(np.hypot(dx, dy).max()))
    return {"mirror": error}


def _puck(draw: Draw) -> list[Case]:
    """Return the case of a disc and a plate sliding without spin."""
    mu = draw.number(0.2, 0.5, 3)
    objects, displacements = {}, {}
    for k, name in enumerate(("disc", "plate")):
        angle = radians(draw.number(-70, 70, 0) + 180 * k)
        speed = draw.number(150, 320, 0)
        velocity = [speed * cos(angle), speed * sin(angle)]
        keys = {"mass": draw.mass(), "friction": mu, "velocity": velocity}
        center = (320 + 60 - 120 * k, 270)
        size = draw.number(12, 28)
        if name == "disc":
            objects[name] = circle(center, size, **keys)
        else:
            tilt = draw.number(0, 90, 0)
            objects[name] = box(center, (2 * size, size), tilt, **keys)
        # Without spin, friction acts against the velocity: d = v²/(2 mu g).
        displacements[name] = np.array(velocity) * speed / (2 * mu * GRAVITY)
    # The time until rest, v / (mu g), for the highest speed drawn.
    duration = 320 / (mu * GRAVITY) + 0.1
    document = scene((640, 540), duration, objects, world=_table(mu))
    measure = partial(_puck_error, displacements)
    return [Case(document, measure)]


def _puck_error(displacements: Mapping[str, Array], run: Run) -> Errors:
    """Return the largest distance of an end from its closed form, over the path. A body
    in motion counts as 100 %.
    """
    errors = []
    for name, expected in displacements.items():
        track = run.track(name)
        if track.speed[-1] > STILL * track.speed[0]:
            errors.append(1.0)
        else:
            deviation = np.hypot(*(track.displacements[-1] - expected))
            errors.append(deviation / np.hypot(*expected))
    return {"distance": worst(errors)}


def mean_distance(width: float, height: float) -> float:
    """Return the mean distance (px) of a rectangle's points from its centre.

    Times mu m g, it is the moment of friction, as 2/3 R is for a disc.
    """
    # The integral of the distance over four right triangles, over the area.
    diagonal = sqrt(width**2 + height**2)
    horizontal = width**2 / (2 * height) * log((height + diagonal) / width)
    vertical = height**2 / (2 * width) * log((width + diagonal) / height)
    return (diagonal + horizontal + vertical) / 6


@dataclass(frozen=True)
class _SpinDown:
    """A spin stopped by friction."""

    spin: float
    """rad/s at t = 0."""
    deceleration: float
    """rad/s²."""


def _spinning(draw: Draw) -> list[Case]:
    """Return the case of a disc and a plate spinning in place."""
    mu = draw.number(0.1, 0.3, 3)
    radius = draw.number(16, 32)
    width = draw.number(30, 60)
    height = draw.number(30, 60)
    arm = mean_distance(width, height)
    decelerations = {
        # The moment of even pressure, mu m g times the mean distance, over the moment
        # of inertia.
        "disc": 4 * mu * GRAVITY / (3 * radius),
        "plate": 12 * mu * GRAVITY * arm / (width**2 + height**2),
    }
    objects, spin_downs = {}, {}
    for k, (name, deceleration) in enumerate(decelerations.items()):
        spin = draw.sign() * round(degrees(deceleration * draw.number(0.6, 1.0)), 0)
        keys = {"mass": draw.mass(), "friction": mu, "spin": spin}
        center = (100 + 140 * k, 90)
        if name == "disc":
            objects[name] = circle(center, radius, **keys)
        else:
            objects[name] = box(center, (width, height), **keys)
        spin_downs[name] = _SpinDown(radians(spin), deceleration)
    document = scene((340, 180), 1.1, objects, world=_table(mu))
    return [Case(document, partial(_spin_down_error, spin_downs))]


def _spin_down_error(spin_downs: Mapping[str, _SpinDown], run: Run) -> Errors:
    """Return the largest error of the angle to rest, and of the spin after half
    the time over the first.
    """
    errors = []
    for name, motion in spin_downs.items():
        spin, deceleration = motion.spin, motion.deceleration
        track = run.track(name)
        # At half the time to rest, half of the spin must be left: an error of the law
        # shows there most.
        half_time = track.sample(abs(spin) / deceleration / 2)
        expected = abs(spin) - deceleration * track.times[half_time]
        remaining_spin = abs(track.spin[half_time])
        errors.append(abs(remaining_spin - expected) / abs(spin))
        # An even deceleration turns by w²/(2 a) to rest.
        rotation = track.angle[-1] * 2 * deceleration
        errors.append(abs(rotation / (spin * abs(spin)) - 1))
        is_moving = abs(track.spin[-1]) > STILL * abs(spin)
        errors.append(float(is_moving))
    return {"spin": worst(errors)}


@dataclass(frozen=True)
class _Puck:
    """A sliding and spinning disc."""

    speed: float
    """px/s."""
    spin: float
    """rad/s."""
    radius: float
    """px."""
    angle: float = 0.0
    """Direction, rad."""

    @classmethod
    def random(cls, draw: Draw) -> _Puck:
        """Return a disc with a ratio of sliding speed and surface speed from
        0.3 to 3.
        """
        speed = draw.number(120, 300, 0)
        radius = draw.number(15, 30)
        angle = radians(draw.number(-60, 60, 0))
        return cls(speed, speed / radius / draw.number(0.3, 3), radius, angle)


FARKAS = _Puck(speed=300.0, spin=15.0, radius=20.0)
FARKAS_FRICTION = 0.25
"""The first disc of the first draw slides 234 px."""


@dataclass(frozen=True)
class _CoupledStop:
    """A closed form of a disc, and its direction."""

    angle: float
    """rad."""
    motion: Stop


def _coupled_discs(draw: Draw) -> list[Case]:
    """Return the case of two sliding and spinning discs."""
    is_first = draw.index == 0
    if is_first:
        mu = FARKAS_FRICTION
    else:
        mu = draw.number(0.15, 0.4, 3)
    objects, stops = {}, {}
    for k, name in enumerate(("first", "second")):
        if is_first and k == 0:
            puck = FARKAS
        else:
            puck = _Puck.random(draw)
        # A spin lowers the friction against sliding, since the surface slips in all
        # directions: both motions end at the same time (Farkas et al.).
        spin = draw.sign() * round(degrees(puck.spin), 6)
        velocity = [puck.speed * cos(puck.angle), puck.speed * sin(puck.angle)]
        objects[name] = circle(
            (80, 160 + 240 * k),
            puck.radius,
            mass=draw.mass(),
            friction=mu,
            velocity=velocity,
            spin=spin,
        )
        motion = stop(puck.speed, radians(spin), puck.radius, mu, GRAVITY)
        stops[name] = _CoupledStop(puck.angle, motion)
    duration = max(end.motion.times[-1] for end in stops.values()) + 0.1
    document = scene((560, 540), duration, objects, world=_table(mu))
    return [Case(document, partial(_coupled_error, stops), rate=480)]


def _coupled_error(stops: Mapping[str, _CoupledStop], run: Run) -> Errors:
    """Return the largest error of distance, angle and times to rest, and of
    speed and spin over their first values.
    """
    errors: list[float] = []
    for name, end in stops.items():
        track = run.track(name)
        motion = end.motion
        direction = (cos(end.angle), sin(end.angle))
        # A disc slides straight, in spite of its spin.
        deviation = track.displacements[-1] / motion.distance - direction
        errors.append(np.hypot(*deviation))
        errors.append(abs(track.angle[-1] / motion.rotation - 1))
        speeds = motion.speeds
        spins = np.abs(motion.spins)
        errors += _decay_errors(track.times, track.speed, motion.times, speeds)
        errors += _decay_errors(track.times, np.abs(track.spin), motion.times, spins)
    return {"motion": worst(np.abs(errors).tolist())}


def _decay_errors(
    times: Array, values: Array, exact_times: Array, exact_values: Array
) -> list[float]:
    """Return the error of the common time to rest of speed and spin, and of all values
    over the first.
    """
    time_error = _rest_time(times, values) / exact_times[-1] - 1
    # After the time of rest, both values are 0.
    expected = np.interp(times, exact_times, exact_values, right=0)
    return [time_error, np.abs(values - expected).max() / values[0]]


def _rest_time(times: Array, motion: Array) -> float:
    """Return the time (s) of the end of a motion. Its last decay is linear, so that the
    last two samples give the time.
    """
    last = int(np.flatnonzero(motion > STILL * motion[0])[-1])
    # The samples do not fall on the time of rest.
    step = times[last] - times[last - 1]
    fall = (motion[last - 1] - motion[last]) / step
    if fall > 0:
        return float(times[last] + motion[last] / fall)
    return inf


def _struck_shots(draw: Draw) -> list[Case]:
    """Return the cases of struck balls, and of a follow shot."""
    return [_struck_balls(draw), _follow_shot(draw)]


@dataclass(frozen=True)
class _Strike:
    """The roll of a struck ball, in parts of its speed, and its lane."""

    forward_roll: float
    """Roll along its path."""
    side_roll: float
    """Roll to its side."""
    lane: int


STRIKES = {
    "back-spin": _Strike(forward_roll=-1.0, side_roll=0.0, lane=-1),
    "top-spin": _Strike(forward_roll=1.8, side_roll=0.0, lane=0),
    "masse": _Strike(forward_roll=0.0, side_roll=1.0, lane=1),
}


@dataclass(frozen=True)
class _StruckBall:
    """A ball with a slip that ends in a roll."""

    body: Document
    last_velocity: Array
    """Velocity of the roll, (2,) px/s."""
    slip_time: float
    """s."""


def _strike_ball(
    draw: Draw, strike: _Strike, lane_angle: float, mu: float
) -> _StruckBall:
    """Return a ball in its lane after a strike."""
    angle = lane_angle + radians(draw.number(-8, 8, 0))
    speed = draw.number(100, 250, 0)
    radius = draw.number(12, 24)
    part = draw.number(0.4, 1.0)
    velocity = speed * np.array([cos(angle), sin(angle)])
    sideways = velocity[::-1] * (-1, 1)
    # The velocity of a roll without slip at the ball's spin.
    forward_roll = part * strike.forward_roll * velocity
    roll_velocity = forward_roll + part * strike.side_roll * sideways
    c, s = cos(lane_angle), sin(lane_angle)
    lane = 110 * strike.lane
    body = circle(
        (300 - 90 * c - lane * s, 300 - 90 * s + lane * c),
        radius,
        solid="sphere",
        mass=draw.mass(),
        friction=mu,
        velocity=velocity.tolist(),
        roll=_roll_rates(roll_velocity, radius),
    )
    # Angular momentum about the contact is constant: the roll ends with 5/7 v + 2/7 w
    # R.
    slip = float(np.hypot(*(velocity - roll_velocity)))
    last_velocity = (5 * velocity + 2 * roll_velocity) / 7
    slip_time = 2 * slip / (7 * mu * GRAVITY)
    return _StruckBall(body, last_velocity, slip_time)


def _roll_rates(velocity: Array, radius: float) -> list[float]:
    """Return the roll (2,) in degrees/s of a ball that rolls with a velocity."""
    roll_x = degrees(velocity[1] / radius)
    roll_y = degrees(-velocity[0] / radius)
    return [round(roll_x, 9), round(roll_y, 9)]


def _struck_balls(draw: Draw) -> Case:
    """Return the case of back spin, top spin, and a roll across the path, which bends
    it, in three lanes.
    """
    mu = draw.number(0.15, 0.3, 3)
    lane_angle = draw.angle()
    # All lanes lie in one random direction.
    objects, last_velocities, longest = {}, {}, 0.0
    for name, strike in STRIKES.items():
        ball = _strike_ball(draw, strike, lane_angle, mu)
        objects[name] = ball.body
        last_velocities[name] = ball.last_velocity
        longest = max(longest, ball.slip_time)
    document = scene((600, 600), longest + 0.1, objects, world=_table(mu))
    measure = partial(_roll_error, last_velocities)
    return Case(document, measure, "struck")


def _roll_error(last_velocities: Mapping[str, Array], run: Run) -> Errors:
    """Return the largest deviation of the last velocity, over the first speed."""
    errors = []
    for name, expected in last_velocities.items():
        track = run.track(name)
        deviation = np.hypot(*(track.velocity[-1] - expected))
        errors.append(deviation / track.speed[0])
    return {"roll": worst(errors)}


def _follow_shot(draw: Draw) -> Case:
    """Return the case of a rolling cue ball head-on against another ball.

    A pair's coefficient is a geometric mean, so that a table of 10 and balls of mu²/10
    give mu on the table and a tiny friction between the balls. A larger one would spoil
    the closed form by mu²/10.
    """
    mu = draw.number(0.15, 0.3, 3)
    angle = radians(draw.number(-25, 25, 0))
    speed = draw.number(200, 320, 0)
    radius = draw.number(12, 20)
    ball = {
        "solid": "sphere",
        "mass": draw.mass(),
        "friction": mu**2 / 10,
        "elasticity": 1.0,
    }
    # In the hit the cue ball gives up its velocity and keeps its roll: friction then
    # drives it after the other ball.
    direction = np.array([cos(angle), sin(angle)])
    velocity = speed * direction
    cue_center = (60, 180)
    ball_center = direction * (2 * radius + 40) + cue_center
    objects = {
        "cue": circle(cue_center, radius, velocity=velocity.tolist(), **ball),
        "object-ball": circle(ball_center, radius, **ball),
    }
    # The way to the other ball, and the time of its slip of 2 v/(7 mu g).
    duration = 40 / speed + 2 * speed / (7 * mu * GRAVITY) + 0.1
    document = scene((460, 360), duration, objects, world=_table(10.0))
    measure = partial(_follow_error, speed, direction)
    return Case(document, measure, "follow")


def _follow_error(speed: float, direction: Array, run: Run) -> Errors:
    """Return the largest deviation of a velocity from 2/7 and 5/7 of the cue
    ball's, over its first speed.
    """
    errors = []
    for name, part in (("cue", 2 / 7), ("object-ball", 5 / 7)):
        deviation = run.track(name).velocity[-1] - part * speed * direction
        errors.append(np.hypot(*deviation) / speed)
    return {"follow shot": worst(errors)}


ROWS = (
    Row(
        15, "break", "15-ball break, cue on the axis, rack touching or overlapping by 0.5 px", "mirror symmetry",
        "balls of 12 to 16 px, 800 to 1400 px/s, e 0.9 to 0.98; on a table with friction and rolling, or without",
        "Largest distance at any time within 1 s between a ball and the mirror image of its partner.",
        (Measure("mirror", 0.5, Unit.PX),), _break,
    ),
    Row(
        18, "puck", "from above: puck sliding without spin", "d = v²/(2 mu g)",
        "a disc and a plate of 12 to 28 px, any direction, 150 to 320 px/s, mu 0.2 to 0.5",
        "Distance of the end from where it should be, over the distance.",
        (Measure("distance", 3e-3),), _puck,
    ),
    Row(
        19, "spinning", "from above: disc spinning in place", "spin falls at 4 mu g/(3 R)",
        "a disc of 16 to 32 px and a plate of 30 to 60 px a side, at rest after 0.6 to 1 s, mu 0.1 to 0.3",
        "Angle turned over its closed form; spin after half the time. For a plate, 2/3 R is its points' mean distance "
        "from the middle.",
        (Measure("spin", 1e-2),), _spinning,
    ),
    Row(
        20, "coupled", "from above: disc sliding and spinning",
        "coupled by the elliptic integrals of Farkas et al. 2003; they stop together",
        "two discs of 15 to 30 px, 120 to 300 px/s, v/(R w) 0.3 to 3, mu 0.15 to 0.4; the first: 300 px/s, 15 rad/s, "
        "R = 20, mu = 0.25 slides 234 px",
        "Distance, angle and both times to rest over their closed forms; speed and spin at any time, over the first "
        "ones.",
        (Measure("motion", 2e-2),), _coupled_discs,
    ),
    Row(
        21, "struck-ball", "from above: sphere struck with v0 and spin w0; follow shot", "rolls at (5 v0 + 2 R w0)/7; "
        "cue ends at 2/7 v, object ball at 5/7 v",
        "back spin, top spin and a roll across, any direction, 100 to 320 px/s, 12 to 24 px, mu 0.15 to 0.3",
        "Deviation of the last velocity over the struck ball's first speed.",
        (Measure("roll", 1e-2), Measure("follow shot", 1e-2)), _struck_shots,
    ),
)  # fmt: skip
