"""Rows of free flight: falls, throws, bounces, and falls through air."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import ceil, cos, pi, radians, sin, sqrt

import numpy as np

from physgen.evaluate.physics.events import find_flights
from physgen.evaluate.physics.scorecard import (
    Array,
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import (
    FLOATING,
    GRAVITY,
    box,
    circle,
    scene,
    segment,
)


def _free_fall(draw: Draw) -> list[Case]:
    """Return the case of a ball, a box and a hoop in free fall."""
    gravity = draw.number(300, 1500, 0)
    # Masses, sizes, spins and mass distributions differ: none of them may change a free
    # fall.
    objects = {
        "ball": circle(
            (80, draw.number(30, 60)),
            draw.number(8, 28),
            mass=draw.mass(),
            spin=draw.number(-400, 400, 0),
        ),
        "box": box(
            (180, draw.number(30, 60)),
            (draw.number(20, 50), draw.number(20, 50)),
            draw.number(0, 90, 0),
            mass=draw.mass(),
            spin=draw.number(-400, 400, 0),
        ),
        "hoop": circle(
            (280, draw.number(30, 60)),
            draw.number(8, 28),
            mass=draw.mass(),
            solid="hoop",
        ),
    }
    # The picture is as high as the fall of g/2 in 1 s.
    size = (360, 100 + ceil(gravity / 2 / 20) * 20)
    document = scene(size, 1.0, objects, world={"gravity": [0, gravity]})
    measure = partial(_fall_error, tuple(objects), gravity)
    return [Case(document, measure)]


def _fall_error(names: tuple[str, ...], gravity: float, run: Run) -> Errors:
    """Return the largest deviation from g t²/2 at any time over the whole fall."""
    errors = []
    for name in names:
        track = run.track(name)
        fall = gravity * track.times**2 / 2
        x, y = track.displacements.T
        deviation = np.hypot(x, y - fall)
        errors.append(deviation.max() / fall[-1])
    return {"fall": worst(errors)}


@dataclass(frozen=True)
class _Throw:
    """The start of a flight."""

    speed: float
    """px/s."""
    degrees: float
    """Angle above the horizontal to the right, degrees."""

    def velocity(self) -> tuple[float, float]:
        """Return the velocity to the right and upwards, px/s."""
        angle = radians(self.degrees)
        return self.speed * cos(angle), self.speed * sin(angle)


def _projectile(draw: Draw) -> list[Case]:
    """Return the case of a thrown ball and a thrown box."""
    throws = {
        "ball": _Throw(draw.number(300, 600, 0), draw.number(35, 75, 0)),
        "box": _Throw(draw.number(300, 600, 0), draw.number(105, 145, 0)),
    }
    # The spin of a body without air must not bend its path.
    objects = {}
    for name, throw in throws.items():
        vx, vy = throw.velocity()
        keys: Document = {
            "mass": draw.mass(),
            "velocity": [vx, -vy],
            "spin": draw.number(-400, 400, 0),
        }
        size = draw.number(10, 20)
        if name == "ball":
            objects[name] = circle((500, 220), size, **keys)
        else:
            objects[name] = box((430, 220), (2 * size, size), **keys)
    document = scene((930, 440), 1.0, objects)
    return [Case(document, partial(_path_error, throws))]


def _path_error(throws: Mapping[str, _Throw], run: Run) -> Errors:
    """Return the largest distance from the parabola over the path so far."""
    errors = []
    for name, throw in throws.items():
        track = run.track(name)
        times = track.times
        vx, vy = throw.velocity()
        # Upwards is negative in the picture.
        drop = GRAVITY * times**2 / 2 - vy * times
        parabola = np.stack([vx * times, drop], axis=1)
        # The chords of the parabola give its length so far.
        steps = np.diff(parabola, axis=0)
        path = np.hypot(*steps.T).cumsum()
        # At t = 0, the path has no length to compare with.
        distance = np.hypot(*(track.displacements - parabola)[1:].T)
        errors.append((distance / path).max())
    return {"path": worst(errors)}


@dataclass(frozen=True)
class _Drop:
    """A ball above a pad of the same elasticity."""

    elasticity: float
    height: float
    """Height of the fall, px."""
    radius: float
    """px."""

    def fall_time(self) -> float:
        """Return the time of the first fall, s."""
        return sqrt(2 * self.height / GRAVITY)


@dataclass(frozen=True)
class _Pads:
    """Places of pads, one per ball."""

    left: int
    """Middle of the first, px."""
    distance: int
    """Distance of neighbours, px."""
    half_width: int
    """px."""
    floor: int
    """Height of the pads, px."""


def _place_drops(
    drops: Mapping[str, _Drop], pads: _Pads, draw: Draw
) -> tuple[Document, Document]:
    """Return the balls of some drops, and the pads below them."""
    objects, boundaries = {}, {}
    for k, (name, drop) in enumerate(drops.items()):
        x = pads.left + pads.distance * k
        surface = {"friction": 0.5, "elasticity": drop.elasticity}
        center = (x, pads.floor - drop.height - drop.radius)
        objects[name] = circle(center, drop.radius, mass=draw.mass(), **surface)
        begin = (x - pads.half_width, pads.floor)
        end = (x + pads.half_width, pads.floor)
        boundaries[name.replace("ball", "pad")] = segment(begin, end, **surface)
    return objects, boundaries


ONE_BOUNCE = _Pads(left=70, distance=130, half_width=55, floor=360)
BOUNCE_ELASTICITIES = (0.3, 0.5, 0.8, 1.0)


def _bounce(draw: Draw) -> list[Case]:
    """Return the case of four bouncing balls."""
    drops = {}
    for elasticity in BOUNCE_ELASTICITIES:
        drop = _Drop(elasticity, draw.number(100, 260, 1), draw.number(8, 26))
        drops[f"ball-{int(elasticity * 10)}"] = drop
    objects, pads = _place_drops(drops, ONE_BOUNCE, draw)
    # The apex after the bounce comes at 1 + e fall times, at most 2.
    highest = max(drops.values(), key=lambda drop: drop.height)
    document = scene((530, 400), 2.1 * highest.fall_time(), objects, pads)
    return [Case(document, partial(_bounce_errors, drops))]


def _bounce_errors(drops: Mapping[str, _Drop], run: Run) -> Errors:
    """Return the errors of speed and height after the first bounce, at the
    height of contact.
    """
    speeds, heights = [], []
    for name, drop in drops.items():
        # A contact takes place with the centre one radius above the pad.
        floor = ONE_BOUNCE.floor - drop.radius
        flights = find_flights(run.track(name), floor, GRAVITY)
        if len(flights) < 2:
            return {"speed": 1.0, "height": 1.0}
        # Newton's law of impact gives the speed; its square gives the height.
        drop_flight, rebound = flights[:2]
        e = drop.elasticity
        speed_ratio = rebound.start_speed / drop_flight.impact_speed
        speeds.append(abs(speed_ratio / e - 1))
        expected_height = e * e * drop.height
        heights.append(abs(rebound.apex / expected_height - 1))
    return {"speed": worst(speeds), "height": worst(heights)}


BOUNCES = 4
SEVERAL_BOUNCES = _Pads(left=80, distance=150, half_width=60, floor=330)
LOWEST_ELASTICITIES = (0.5, 0.6, 0.7)
"""Elasticities of the three balls; each draw adds up to 0.1."""


def _bounces(draw: Draw) -> list[Case]:
    """Return the case of three balls with several bounces."""
    drops = {}
    for k, low in enumerate(LOWEST_ELASTICITIES, 1):
        drops[f"ball-{k}"] = _Drop(
            elasticity=draw.number(low, low + 0.1, 3),
            height=draw.number(150, 250, 1),
            radius=draw.number(8, 26),
        )
    objects, pads = _place_drops(drops, SEVERAL_BOUNCES, draw)
    longest = max(map(_time_of_bounces, drops.values()))
    document = scene((460, 360), longest + 0.05, objects, pads)
    return [Case(document, partial(_bounces_error, drops), rate=480)]


def _time_of_bounces(drop: _Drop) -> float:
    """Return the time to the end of the last counted flight, s."""
    # Flight n lasts two falls from the height that e^n leaves of the first speed.
    flights = sum(drop.elasticity**n for n in range(1, BOUNCES + 1))
    return drop.fall_time() * (1 + 2 * flights)


def _bounces_error(drops: Mapping[str, _Drop], run: Run) -> Errors:
    """Return the largest error of a flight's duration, from landing to landing."""
    errors = []
    for name, drop in drops.items():
        floor = SEVERAL_BOUNCES.floor - drop.radius
        flights = find_flights(run.track(name), floor, GRAVITY)
        if len(flights) <= BOUNCES:
            return {"times": 1.0}
        # Landings bound a flight, so that an error of one bounce does not add up.
        for n in range(1, BOUNCES + 1):
            expected = 2 * drop.fall_time() * drop.elasticity**n
            duration = flights[n].end - flights[n - 1].end
            errors.append(abs(duration / expected - 1))
    return {"times": worst(errors)}


@dataclass(frozen=True)
class _Air:
    """Air as a brake, or a wind as a drive of a body."""

    drag: float
    """Force over width times squared speed, g/px²."""
    wind: float | None
    """Wind in place of gravity, px/s; None for a fall."""

    def motion(self, mass: float, width: float, times: Array) -> tuple[Array, Array]:
        """Return the speeds (px/s) and distances (px) of a body (g, px) from rest."""
        k = self.drag * width / mass
        # For u = wind - v: u' = -k u².
        if self.wind is not None:
            # The solution is u = wind/(1 + wind k t), and its integral a logarithm.
            fading = self.wind * k * times
            speeds = self.wind - self.wind / (1 + fading)
            return speeds, self.wind * times - np.log1p(fading) / k
        # At the terminal speed, drag equals weight; v = u tanh(g t/u) approaches it.
        final = sqrt(GRAVITY / k)
        speeds = final * np.tanh(GRAVITY * times / final)
        # The integral of tanh is ln cosh.
        stretch = np.log(np.cosh(GRAVITY * times / final))
        distances = final**2 / GRAVITY * stretch
        return speeds, distances


def _air(draw: Draw) -> list[Case]:
    """Return the case of a ball and a box in air; in every other draw a wind
    blows in place of gravity.
    """
    has_wind = draw.index % 2 == 1
    wind = draw.number(150, 400, 0)
    drag = draw.number(0.02, 0.08, 4)
    radius = draw.number(10, 25)
    ball_mass = draw.mass()
    side = draw.number(20, 40)
    box_mass = draw.mass()
    # The box is as wide as the disc of the same area.
    bodies = {"ball": (ball_mass, 2 * radius), "box": (box_mass, 2 * side / sqrt(pi))}
    if has_wind:
        air = _Air(drag, wind)
        size = (420, 220)
        box_center = (60, 150)
        field = {"wind": [wind, 0], "drag": drag}
        world = FLOATING
    else:
        air = _Air(drag, None)
        size = (220, 580)
        box_center = (140, 60)
        field = {"wind": [0, 0], "drag": drag}
        world = {}
    # Quadratic drag with the coefficient k per width: a = g - k w v² / m, which tends
    # to a limit speed.
    objects = {
        "ball": circle((60, 60), radius, mass=ball_mass),
        "box": box(box_center, (side, side), mass=box_mass),
    }
    document = scene(size, 1.0, objects, world=world, fields={"air": field})
    return [Case(document, partial(_air_error, air, bodies))]


def _air_error(
    air: _Air, bodies: Mapping[str, tuple[float, float]], run: Run
) -> Errors:
    """Return the largest deviation of speed and distance at any time, over their last
    values.
    """
    # The wind blows along x, and gravity acts along y.
    axis = 0
    if air.wind is None:
        axis = 1
    errors = []
    for name, (mass, width) in bodies.items():
        track = run.track(name)
        speeds, distances = air.motion(mass, width, track.times)
        deviations = np.abs(track.velocities[:, axis] - speeds)
        errors.append(deviations.max() / speeds[-1])
        deviations = np.abs(track.displacements[:, axis] - distances)
        errors.append(deviations.max() / distances[-1])
    return {"motion": worst(errors)}


ROWS = (
    Row(
        1, "free-fall", "free fall", "y = g t²/2",
        "a ball, a box and a hoop; sizes 8 to 28 px, 20 to 500 g, spins to 400 degrees/s, g 300 to 1500 px/s²; 1 s",
        "Largest deviation at any time over the whole fall. Steps of v += g dt, x += v dt are off by dt/t.",
        (Measure("fall", 1e-4),), _free_fall,
    ),
    Row(
        2, "projectile", "projectile, at any time", "x = v t cos a, y = g t²/2 - v t sin a",
        "a ball and a box thrown at 300 to 600 px/s, 35 to 75 degrees, turning; 1 s",
        "Distance from the parabola over the length flown by then, the largest.",
        (Measure("path", 1e-3),), _projectile,
    ),
    Row(
        3, "bounce", "bounce, e = 0.3, 0.5, 0.8, 1", "speed after = e x speed before; height e² h",
        "balls of 8 to 26 px and 20 to 500 g dropped from 100 to 260 px",
        "Speeds are taken at the height of contact, by the energy of free fall from samples beside the bounce.",
        (Measure("speed", 1e-3), Measure("height", 1e-2)), _bounce,
    ),
    Row(
        4, "bounces", "four bounces", "flight n lasts (2 v/g) e^n",
        "three balls, e 0.5 to 0.8, dropped from 150 to 250 px",
        "From landing to landing, each against its own length. A bounce put off to the end of its step adds up.",
        (Measure("times", 1e-2),), _bounces,
    ),
    Row(
        35, "air", "falling through air; a wind from the side", "v = v_t tanh(g t/v_t), v_t = sqrt(m g/(drag x width))",
        "a ball of 10 to 25 px and a box of 20 to 40 px, 20 to 500 g, drag 0.02 to 0.08 g/px²; wind 150 to 400 px/s",
        "Speed and distance over their last values. The force is smooth, so only the integrator can err: 0.3 %, as for "
        "sliding. Width is that of the disc of equal area; the wind's form is w - w/(1 + w k t).",
        (Measure("motion", 3e-3),), _air,
    ),
)  # fmt: skip
