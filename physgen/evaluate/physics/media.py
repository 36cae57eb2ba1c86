"""Rows of forces that change with time, of still air, water and magnets, and of a
pulling finger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    worst,
)
from physgen.evaluate.physics.staging import FLOATING, GRAVITY, box, circle, scene

Array = NDArray[np.float64]


def _sine_integral(frequency: float, span: float) -> float:
    """Return the integral of a sine from 0 to `span`, s."""
    # The integral of sin w t is (1 - cos w t)/w.
    rate = 2 * pi * frequency
    return float((1 - np.cos(rate * span)) / rate)


def _pulse_integral(pulse_time: float, pause: float, span: float) -> float:
    """Return the time of the pulses between 0 and `span`, s."""
    # Only whole pulses and the begun one count.
    periods, remainder = divmod(span, pulse_time + pause)
    return periods * pulse_time + min(remainder, pulse_time)


def _table_integral(values: Sequence[float], span: float) -> float:
    """Return the integral of values at 0, 0.3 and 0.6 s from 0 to `span`, s."""
    first, second, last = values
    # Values are linear between the points, so that the mean of two points is exact;
    # after the last point its value stays.
    first_part = 0.15 * (first + second)
    second_part = 0.15 * (second + last)
    return first_part + second_part + last * (span - 0.6)


@dataclass(frozen=True)
class _ForceProfiles:
    """Random parameters of the four profiles of a force over time."""

    ramp: float
    """Time in which the force grows to its full value, s."""
    frequency: float
    """1/s."""
    pulse: float
    """Duration of a pulse, s."""
    pause: float
    """Time between two pulses, s."""
    table: list[list[float]]
    """Rows of time (s) and part of the full force."""

    @classmethod
    def random(cls, draw: Draw) -> _ForceProfiles:
        """Return the profiles of a draw."""
        return cls(
            ramp=draw.number(0.2, 0.6, 3),
            frequency=draw.number(1, 6),
            pulse=draw.number(0.05, 0.2, 3),
            pause=draw.number(0.05, 0.2, 3),
            table=[
                [0, draw.number(-1, 1)],
                [0.3, draw.number(0, 2)],
                [0.6, draw.number(0, 1)],
            ],
        )

    @property
    def entries(self) -> dict[str, Any]:
        """Return the profiles as in a scene file, by name."""
        return {
            "ramp": self.ramp,
            "sine": self.frequency,
            "pulse": [self.pulse, self.pause],
            "table": self.table,
        }

    def integrals(self, span: float) -> dict[str, float]:
        """Return the integral of each profile from 0 to `span` (s), s."""
        # A linear rise counts half of its time.
        return {
            "ramp": self.ramp / 2 + span - self.ramp,
            "sine": _sine_integral(self.frequency, span),
            "pulse": _pulse_integral(self.pulse, self.pause, span),
            "table": _table_integral([row[1] for row in self.table], span),
        }


def _profile_error(run: Run, *, gain: float, exact: dict[str, float]) -> Errors:
    """Return the largest deviation of a final velocity over the greatest one."""
    errors = []
    for name, value in exact.items():
        velocity = float(run.track(name).velocities[-1, 0])
        errors.append(abs(velocity / gain - value))
    largest = max(map(abs, exact.values()))
    return {"velocity": worst(errors) / largest}


def _profiles(draw: Draw) -> list[Case]:
    """Return the case of force profiles. Error: largest deviation of the velocity at
    the end over the greatest one, the integral of the force over the mass.
    """
    duration = 1.0
    start = draw.number(0.05, 0.2, 3)
    gain = draw.number(80, 160, 0)
    profiles = _ForceProfiles.random(draw)
    objects: dict[str, Document] = {}
    forces = []
    for k, (name, profile) in enumerate(profiles.entries.items()):
        mass = draw.mass()
        objects[name] = box((120, 60 + 90 * k), (40, 24), mass=mass)
        # Each force is a multiple of the mass, so that all bodies have one scale.
        force = {
            "object": name,
            "force": [mass * gain, 0],
            "start": start,
            "profile": {name: profile},
        }
        forces.append(force)
    # The change of velocity is the integral of the factor times force over mass; it
    # must not depend on steps between knots.
    exact = profiles.integrals(duration - start)
    measure = partial(_profile_error, gain=gain, exact=exact)
    document = scene((480, 400), duration, objects, world=FLOATING, forces=forces)
    return [Case(document, measure)]


def _terminal_error(run: Run, *, finals: dict[str, float]) -> Errors:
    """Return the largest deviation of a speed over its terminal one."""
    errors = []
    for name, final in finals.items():
        track = run.track(name)
        # g t over the terminal speed is the only variable of both closed forms.
        speed = track.velocities[:, 1]
        late = GRAVITY * track.times / final
        # Both drags together have no such closed form: only their terminal speed is
        # compared, and earlier samples count as exact.
        exact = {
            "linear": final * (1 - np.exp(-late)),
            "square": final * np.tanh(late),
            "both": np.where(late > 12, final, speed),
        }[name]
        errors.append(float(np.abs(speed - exact).max()) / final)
    return {"speed": worst(errors)}


def _terminal(draw: Draw) -> list[Case]:
    """Return the case of falls through air. Error: largest deviation of the speed over
    the terminal one, at any time.

    Linear drag: v = u (1 - e^(-g t/u)), u = m g/(b w). Quadratic drag: v = u tanh(g
    t/u), u² = m g/(c w). With both, u follows from m g = b w u + c w u².
    """
    objects, fields, finals = {}, {}, {}
    for k, name in enumerate(("linear", "square", "both")):
        radius = draw.number(10, 20)
        mass = draw.mass()
        final = draw.number(80, 200, 0)
        objects[name] = circle((100 + 130 * k, 30), radius, mass=mass)
        # The terminal speed is drawn, and the drags follow: each carries its share of
        # the weight.
        shares = {"linear": 1.0, "square": 0.0, "both": draw.number(0.3, 0.7)}
        share = shares[name]
        pull = mass * GRAVITY / (2 * radius)
        fields[f"air-{name}"] = {
            "air": "still",
            "objects": [name],
            "linear": share * pull / final,
            "drag": (1 - share) * pull / final**2,
        }
        finals[name] = final

    measure = partial(_terminal_error, finals=finals)

    # After 12 times u/g, the speed differs from the terminal one by less than 1e-5.
    duration = max(2.0, 12.5 * max(finals.values()) / GRAVITY)
    document = scene((460, 500), duration, objects, fields=fields)
    return [Case(document, measure)]


def _buoyancy_errors(
    run: Run, *, rest: float, swing: float, rate: float, rises: float, lift: float
) -> Errors:
    """Return the errors of the raft's place and of the ball's rise."""
    raft = run.track("raft")
    # The raft starts at rest at the end of its swing: a cosine.
    place = rest + swing * np.cos(rate * raft.times)
    raft_error = float(np.abs(raft.y - place).max()) / abs(swing)
    # The closed form of the rise ends when the ball reaches the surface.
    ball = run.track("ball")
    is_sunken = ball.times < rises
    rise = lift * ball.times[is_sunken] ** 2 / 2
    measured_rise = BALL_DEPTH - ball.y[is_sunken]
    rise_error = np.abs(measured_rise - rise).max() / rise.max()
    return {"raft": raft_error, "rise": float(rise_error)}


SURFACE, BALL_DEPTH = 160.0, 420
"""Heights of the water's surface and of the sunken ball in the picture, px."""
RAFT_HEIGHT = 60.0
"""px."""


def _buoyancy(draw: Draw) -> list[Case]:
    """Return the case of a raft and a sunken ball. Errors: deviation of the raft's
    place over its swing, and of the ball's rise, from their closed forms.

    A box of width w swings with W² = r w g/m about the depth m/(r w). A ball below the
    surface rises with (r A - m) g/m. There is no damping.
    """
    density = draw.number(0.5, 2)
    width = draw.number(120, 180, 0)
    raft_mass = density * width * RAFT_HEIGHT * draw.number(0.35, 0.6)
    swing = draw.sign() * draw.number(4, 15, 1)
    # The raft floats at the depth at which it displaces its own mass.
    rest = SURFACE + raft_mass / (density * width) - RAFT_HEIGHT / 2
    # A deeper raft displaces r w more mass per unit of depth: a spring of the stiffness
    # r w g.
    rate = sqrt(density * width * GRAVITY / raft_mass)
    radius = draw.number(12, 20)
    displaced_mass = density * pi * radius**2
    ball_mass = displaced_mass * draw.number(0.6, 0.85)
    # The ball rises with the surplus of buoyancy over weight.
    lift = (displaced_mass - ball_mass) * GRAVITY / ball_mass
    # Up to this time the whole ball is below the surface: its centre is two radii or
    # more below it.
    rises = sqrt(2 * (BALL_DEPTH - SURFACE - 2 * radius) / lift)
    objects = {
        "raft": box((160, rest + swing), (width, RAFT_HEIGHT), mass=raft_mass),
        "ball": circle((400, BALL_DEPTH), radius, mass=ball_mass),
    }
    fields = {"pool": {"water": [0, SURFACE, 640, 400], "density": density}}
    measure = partial(
        _buoyancy_errors, rest=rest, swing=swing, rate=rate, rises=rises, lift=lift
    )
    document = scene((640, 480), 2.0, objects, fields=fields)
    return [Case(document, measure)]


def _magnet_error(
    run: Run, *, objects: dict[str, Document], period: float, distance: float
) -> Errors:
    """Return the largest distance from the start after one turn, over the distance."""
    errors = []
    for name in objects:
        track = run.track(name)
        # The turn ends between two samples.
        x, y = (
            float(np.interp(period, track.times, track.displacements[:, k]))
            for k in (0, 1)
        )
        errors.append(float(np.hypot(x, y)) / distance)
    return {"place": worst(errors)}


def _magnets(draw: Draw) -> list[Case]:
    """Return the case of magnets. Error: deviation of the places after one turn over
    the distance: T = 2 pi sqrt(r³/(p (1/m1 + 1/m2))).
    """
    apart = draw.number(120, 200, 1)
    masses = [draw.mass(), draw.mass()]
    period = draw.number(0.8, 1.6, 3)
    # The relative motion is that of one body with the reduced mass.
    ease = 1 / masses[0] + 1 / masses[1]
    # Centripetal force of the relative motion: pull / r² = w² r / (1/m1 + 1/m2), solved
    # for the pull.
    pull = (2 * pi / period) ** 2 * apart**3 / ease
    speed = 2 * pi * apart / period * draw.sign()
    total = sum(masses)
    objects = {}
    for k, name in enumerate(("north", "south")):
        # Both circle about the common centre of mass, each at its part of the distance.
        side = (1, -1)[k] * masses[1 - k] / total
        objects[name] = circle(
            (320 + side * apart, 240), 10, mass=masses[k], velocity=[0, side * speed]
        )
    fields = {"pull": {"magnet": ["north", "south"], "pull": pull}}

    measure = partial(_magnet_error, objects=objects, period=period, distance=apart)

    document = scene((640, 480), period + 0.1, objects, world=FLOATING, fields=fields)
    return [Case(document, measure)]


def _finger(draw: Draw) -> list[Case]:
    """Return the case of a finger. Error: largest deviation of the place over the path:
    v t - (v/w) sin w t during the pull, then a straight line.
    """
    mass = draw.mass()
    frequency = draw.number(1.5, 4)
    time = draw.number(0.3, 0.6, 3)
    speed = draw.sign() * draw.number(100, 200, 0)
    # The spring pulls from a point that moves at a constant speed v: x'' = w² (v t -
    # x), which gives x = v t - (v / w) sin w t.
    rate = 2 * pi * frequency
    middle = np.array([320.0, 120.0])
    end = np.array([320 + speed * time, 120.0])
    objects = {"puck": circle(middle, 20, mass=mass)}
    joints = {
        "finger": {
            "objects": ["puck"],
            "finger": [[0, *middle.tolist()], [time, *end.tolist()]],
            "stiffness": mass * rate**2,
        }
    }

    def measure(run: Run) -> Errors:
        track = run.track("puck")
        # After the pull, the puck keeps the speed of the spring's last moment.
        held = np.minimum(track.times, time)
        last = speed * (1 - np.cos(rate * time))
        exact = speed * (held - np.sin(rate * held) / rate)
        exact += last * (track.times - held)
        deviation = np.abs(track.displacements[:, 0] - exact)
        return {"place": float(deviation.max()) / abs(end[0] - 320)}

    document = scene((640, 240), 1.0, objects, world=FLOATING, joints=joints)
    return [Case(document, measure)]


ROWS = (
    Row(
        55, "profiles", "forces that change with time", "v = F/m x integral of the factor",
        "ramps of 0.2 to 0.6 s, sines of 1 to 6 Hz, pulses of 0.05 to 0.2 s, tables of three points",
        "Largest deviation of the velocity over the greatest one. Steps take the exact mean: 1e-4.",
        (Measure("velocity", 1e-4),), _profiles,
    ),
    Row(
        56, "terminal", "terminal speed in still air", "v = u (1 - e to the -g t/u); v = u tanh(g t/u)",
        "discs of 10 to 20 px, 20 to 500 g, terminal speeds of 80 to 200 px/s, linear, by the square, and both",
        "Largest deviation of the speed at any time over the terminal one. Smooth motion: 0.3 %.",
        (Measure("speed", 3e-3),), _terminal,
    ),
    Row(
        57, "buoyancy", "raft that bobs, and a ball that rises", "W² = r w g/m; (r A - m) g/m",
        "rafts of 120 to 180 px in water of 0.5 to 2 g/px², 4 to 15 px from rest; balls of 0.6 to 0.85 of it",
        "Largest deviation of the raft over its swing, and of the rise over itself: 0.3 %; the phase adds up: 1 %.",
        (Measure("raft", 1e-2), Measure("rise", 3e-3)), _buoyancy,
    ),
    Row(
        58, "magnets", "two magnets that circle each other", "T = 2 pi sqrt(r³/(p (1/m1 + 1/m2)))",
        "20 to 500 g, 120 to 200 px apart, turns of 0.8 to 1.6 s in either direction",
        "Distance from the first places after one turn over that between the two. Smooth motion: 0.3 %.",
        (Measure("place", 3e-3),), _magnets,
    ),
    Row(
        59, "finger", "finger that pulls on a spring", "v t - (v/w) sin w t, then straight on",
        "20 to 500 g, 1.5 to 4 swings a second, pulled for 0.3 to 0.6 s at 100 to 200 px/s to either side",
        "Largest deviation of the place over the way. Smooth motion: 0.3 %.",
        (Measure("place", 3e-3),), _finger,
    ),
)  # fmt: skip
