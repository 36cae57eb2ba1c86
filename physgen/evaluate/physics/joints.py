"""Rows of bodies on pins, springs, welds and motors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import cos, exp, pi, radians, sin, sqrt

import numpy as np

from physgen.evaluate.physics.elliptic import integrate_ellipse, runge_kutta
from physgen.evaluate.physics.events import find_crossings
from physgen.evaluate.physics.scorecard import (
    Array,
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Track,
    Unit,
    worst,
)
from physgen.evaluate.physics.staging import (
    FLOATING,
    GRAVITY,
    INERTIA,
    Point,
    box,
    circle,
    scene,
)

PASSES = 3
"""Number of counted passes of a pendulum through its lowest point."""


@dataclass(frozen=True)
class _Swing:
    """A pendulum with a start at rest."""

    period: float
    """s."""
    angle: float
    """Angle at the start, rad."""


def _hang(
    draw: Draw, name: str, x: float, angles: tuple[int, int]
) -> tuple[Document, Document, _Swing]:
    """Return a ball `bob` or a rod on a pin, its pin, and its swing.

    `angles` are the limits of its first angle, degrees.
    """
    degrees = draw.number(*angles, 1)
    side = draw.sign()
    pivot = np.array([x, 190.0])
    arm = draw.number(50, 90, 1)
    mass = draw.mass()
    angle = radians(degrees)
    # At an angle of 0 the body hangs straight below its pin; y points down.
    center = pivot + arm * np.array([side * sin(angle), cos(angle)])
    if name == "bob":
        radius = draw.number(14, 26)
        body = circle(center, radius, mass=mass)
        moment = mass * radius**2 / 2
    else:
        width = draw.number(10, 20)
        # The rod reaches 5 px past its pin.
        height = round(2 * arm + 10, 1)
        body = box(center, (width, height), -side * degrees, mass=mass)
        moment = mass * (width**2 + height**2) / 12
    # A physical pendulum: the moment about the pin follows from that about the centre
    # (Steiner), and the period of a large swing needs an elliptic integral.
    pin_moment = moment + mass * arm**2
    period = _pendulum_period(pin_moment, mass * GRAVITY * arm, angle)
    pin = {"objects": [name], "pivot": pivot.tolist()}
    return body, pin, _Swing(period, side * angle)


def _pendulum_period(moment: float, weight_moment: float, angle: float) -> float:
    """Return the period (s) of a pendulum of any amplitude `angle` (rad).

    `moment` is that of inertia about the pin, `weight_moment` the weight times its arm.
    """
    # T = 4 sqrt(J/(m g d)) K(sin(a/2)).
    first_kind, _ = integrate_ellipse(sin(angle / 2))
    return 4 * sqrt(moment / weight_moment) * first_kind


def _pendulum(draw: Draw) -> list[Case]:
    """Return the case of a ball and a rod, each on a pin."""
    objects: dict[str, Document] = {}
    joints, swings = {}, {}
    pendulums = (("bob", 130.0, (20, 80)), ("rod", 440.0, (80, 130)))
    for name, x, angles in pendulums:
        body, pin, swing = _hang(draw, name, x, angles)
        objects[name] = body
        joints[f"{name}-pin"] = pin
        swings[name] = swing
    # The third pass comes after 5/4 of the period.
    duration = 1.3 * max(swing.period for swing in swings.values())
    document = scene((640, 390), duration, objects, joints=joints)
    return [Case(document, partial(_period_error, swings))]


def _period_error(swings: Mapping[str, _Swing], run: Run) -> Errors:
    """Return the largest error of the time of a pass through the lowest point, over the
    period.
    """
    errors = []
    for name, swing in swings.items():
        track = run.track(name)
        # At the lowest point, a pendulum has turned back by its swing.
        angle = track.angle - swing.angle
        passes = find_crossings(track.times, angle, track.spin)
        if len(passes) < PASSES:
            return {"period": 1.0}
        # The first pass comes after a quarter of a period, and then one each half.
        expected = (np.arange(PASSES) + 0.5) * swing.period / 2
        deviation = np.abs(passes[:PASSES] - expected)
        errors.append(deviation.max() / swing.period)
    return {"period": worst(errors)}


ANCHOR_X = 60.0
"""Fixed ends of springs, px."""


@dataclass(frozen=True)
class _Spring:
    """A swing on a spring."""

    length: float
    """Length at rest, px."""
    decay: float
    """d = c/(2 m), 1/s."""
    omega: float
    """w = sqrt(k/m - d²), rad/s."""


def _spring_lane(
    draw: Draw, lane: str, y: float, damping_part: float
) -> tuple[dict[str, Document], Document, _Spring]:
    """Return the bodies of a lane, their spring, and its closed form.

    The lane `pair` has a body at both ends.
    """
    mass = draw.mass()
    length = draw.number(120, 160, 0)
    stretch = draw.sign() * draw.number(20, 50, 0)
    frequency = draw.number(1.5, 3)
    anchor = [ANCHOR_X, y]
    center = [ANCHOR_X + length + stretch, y]
    partner_mass = None
    swinging_mass = mass
    # Two bodies on a spring swing like one with the reduced mass m1 m2 / (m1 + m2).
    if lane == "pair":
        partner_mass = draw.mass()
        swinging_mass = mass * partner_mass / (mass + partner_mass)
    # The stiffness follows from the frequency, and the damping from its critical value.
    stiffness = round(swinging_mass * (2 * pi * frequency) ** 2, 2)
    damping = round(2 * damping_part * sqrt(stiffness * swinging_mass), 3)
    objects = {lane: circle(center, draw.number(12, 22), mass=mass)}
    if partner_mass is not None:
        objects["partner"] = box(anchor, (30, 30), mass=partner_mass)
    spring = {
        "objects": list(objects),
        "spring": [center, anchor],
        "stiffness": stiffness,
        "damping": damping,
        "length": length,
    }
    # x'' + 2 d x' + (k/m) x = 0, with d = c/(2 m).
    decay = damping / (2 * swinging_mass)
    omega = sqrt(stiffness / swinging_mass - decay**2)
    return objects, spring, _Spring(length, decay, omega)


def _springs(draw: Draw) -> list[Case]:
    """Return the case of three lanes of springs; in the lowest, two bodies swing
    against each other.

    Their reduced mass m1 m2/(m1 + m2) is the mass of the closed form.
    """
    objects: dict[str, Document] = {}
    joints = {}
    springs = {}
    lanes = {"free": 0.0, "damped": draw.number(0.03, 0.1, 3), "pair": 0.0}
    for k, (lane, damping_part) in enumerate(lanes.items()):
        bodies, joint, spring = _spring_lane(draw, lane, 80.0 + 110 * k, damping_part)
        objects |= bodies
        joints[f"{lane}-spring"] = joint
        springs[lane] = spring
    document = scene((360, 380), 2.0, objects, world=FLOATING, joints=joints)
    measure = partial(_spring_errors, springs)
    return [Case(document, measure)]


def _spring_errors(springs: Mapping[str, _Spring], run: Run) -> Errors:
    """Return the errors of frequency and amplitude at the end.

    With the stretch x, the pair x and (x' + d x)/w moves on a spiral that shrinks with
    e^(-d t): its angle is the phase and its radius the amplitude, at any time.
    """
    frequencies, amplitudes = [], []
    for lane, spring in springs.items():
        track = run.track(lane)
        # The stretch: the distance from the anchor less the length at rest.
        x = track.x - ANCHOR_X - spring.length
        rate = track.velocities[:, 0]
        if lane == "pair":
            partner = run.track("partner")
            # The partner is at the place of the anchor, and moves.
            x = x + ANCHOR_X - partner.x
            rate = rate - partner.velocities[:, 0]
        # The phase and amplitude of this pair need no search for zeros and maxima.
        y = (rate + spring.decay * x) / spring.omega
        time = track.times[-1]
        phase = np.unwrap(np.arctan2(-y, x))
        phase_change = phase[-1] - phase[0]
        frequencies.append(abs(phase_change / (spring.omega * time) - 1))
        amplitude = np.hypot(x, y)
        # The exact amplitude shrinks by e^(-d t).
        remainder = amplitude[-1] / amplitude[0] * exp(spring.decay * time)
        amplitudes.append(abs(remainder - 1))
    return {"frequency": worst(frequencies), "amplitude": worst(amplitudes)}


SEESAW_TIME = 0.4
"""Time of the comparison of angle and spin, s."""


@dataclass(frozen=True)
class _Weight:
    """A box on one arm of a see-saw."""

    arm: float
    """Distance from the pin to the left or right, px."""
    height: float
    """Height of its centre above the pin, px."""
    side: float
    """px."""
    mass: float
    """g."""

    def moment(self) -> float:
        """Return the moment of inertia about the pin, g·px²."""
        # A square of side s has the moment m s²/6 about its own centre.
        return self.mass * (self.arm**2 + self.height**2 + self.side**2 / 6)


@dataclass(frozen=True)
class _Tilt:
    """Equation of a see-saw's angle: a'' = torque cos a + tilting sin a."""

    torque: float
    """1/s²: g (m2 d2 - m1 d1)/J."""
    tilting: float
    """1/s²: g (m1 h1 + m2 h2)/J."""

    def rate(self, state: Array) -> Array:
        """Return the rates of angle and spin."""
        angle, spin = state
        # The arms shorten by cos a; weights above the pin lean out by sin a.
        acceleration = self.torque * cos(angle) + self.tilting * sin(angle)
        return np.array([spin, acceleration])


@dataclass(frozen=True)
class _Seesaw:
    """A plank with two weights on a pin."""

    objects: dict[str, Document]
    """Plank, left and right weight."""
    pin: list[float]
    """px."""
    tilt: _Tilt
    """The closed form."""


def _draw_seesaw(draw: Draw, x: float, part: float) -> _Seesaw:
    """Return a see-saw with its pin at `x`, px.

    `part` is the moment of the right weight over that of the left one.
    """
    # Rough and inelastic, so that the weights stay in place on the plank.
    surface = {"friction": 0.9, "elasticity": 0.0}
    pin = np.array([x, 150.0])
    plank = (draw.number(220, 260, 0), draw.number(8, 14, 0))
    mass = draw.mass()
    left, right = _draw_weights(draw, plank[1], part)
    objects = {"plank": box(pin, plank, mass=mass, **surface)}
    for label, weight, weight_x in (
        ("left", left, pin[0] - left.arm),
        ("right", right, pin[0] + right.arm),
    ):
        center = (weight_x, pin[1] - weight.height)
        size = (weight.side, weight.side)
        objects[label] = box(center, size, mass=weight.mass, **surface)
    # The beginning of the tilt follows from the torque of both weights over the total
    # moment about the pin.
    plank_moment = mass * (plank[0] ** 2 + plank[1] ** 2) / 12
    moment = plank_moment + left.moment() + right.moment()
    return _Seesaw(objects, pin.tolist(), _tilt(left, right, moment))


def _seesaw(draw: Draw) -> list[Case]:
    """Return the case of three see-saws: one far from balance, two with moments of
    0.99 and 1.01.

    Moment x angular acceleration = torque: J a'' = g (m2 d2 - m1 d1) cos a + g (m1 h1 +
    m2 h2) sin a, for weights at d to the left and right of the pin and h above it, J
    with all parallel axes.
    """
    objects: dict[str, Document] = {}
    joints, tilts = {}, {}
    for k, name in enumerate(("light", "heavy", "far")):
        # Drawn for each see-saw, so that all have the same number of draws.
        parts = (0.99, 1.01, draw.number(1.1, 1.25))
        seesaw = _draw_seesaw(draw, 180.0 + 320 * k, parts[k])
        for part, body in seesaw.objects.items():
            objects[f"{name}-{part}"] = body
        joints[f"{name}-pin"] = {"objects": [f"{name}-plank"], "pivot": seesaw.pin}
        tilts[name] = seesaw.tilt
    document = scene((1000, 300), 1.0, objects, joints=joints)
    measure = partial(_seesaw_errors, tilts["far"])
    return [Case(document, measure)]


def _draw_weights(draw: Draw, thickness: float, part: float) -> tuple[_Weight, _Weight]:
    """Return the weights at the left and right of a plank. The right torque is `part`
    times the left one.
    """
    left_arm = draw.number(60, 90, 1)
    left_side = draw.number(22, 34, 0)
    right_side = draw.number(22, 34, 0)
    left_mass = draw.number(60, 200, 0)
    right_arm = draw.number(60, 90, 1)
    right_mass = part * left_mass * left_arm / right_arm
    return (
        _Weight(left_arm, thickness / 2 + left_side / 2, left_side, left_mass),
        _Weight(right_arm, thickness / 2 + right_side / 2, right_side, right_mass),
    )


def _tilt(left: _Weight, right: _Weight, moment: float) -> _Tilt:
    torque = GRAVITY * (right.mass * right.arm - left.mass * left.arm)
    tilting = GRAVITY * (left.mass * left.height + right.mass * right.height)
    return _Tilt(torque / moment, tilting / moment)


def _seesaw_errors(tilt: _Tilt, run: Run) -> Errors:
    """Return the error of angle and spin against one rigid body, and whether a balance
    tips to the wrong side.
    """
    # The equation has no elementary solution: integrate it in fine steps.
    angle, spin = runge_kutta(tilt.rate, np.zeros(2), SEESAW_TIME, 400)[-1]
    track = run.track("far-plank")
    end = track.sample(SEESAW_TIME)
    angle_error = abs(track.angle[end] / angle - 1)
    spin_error = abs(track.spin[end] / spin - 1)
    light = run.track("light-plank")
    heavy = run.track("heavy-plank")
    # A positive angle tips to the right, where the heavier moment of 1.01 is.
    tips_rightly = light.angle[-1] < 0 < heavy.angle[-1]
    return {
        "acceleration": worst([angle_error, spin_error]),
        "balance": float(not tips_rightly),
    }


@dataclass(frozen=True)
class _Ramp:
    """A spin with a linear rise to the motor's speed."""

    speed: float
    """rad/s."""
    time: float
    """Time to the full speed, s."""


MOTOR_SOLIDS = ("disc", "hoop", "sphere")


def _drive(
    draw: Draw, name: str, x: float
) -> tuple[dict[str, Document], Document, _Ramp]:
    """Return a wheel, for a `fan` also its base, its motor and its start-up."""
    center = [x, 110.0]
    radius = draw.number(30, 55)
    mass = draw.mass()
    solid = MOTOR_SOLIDS[draw.count(0, 2)]
    objects = {name: circle(center, radius, solid=solid, mass=mass)}
    # The torque limit gives the acceleration speed/time: M = (speed/time) I.
    inverse_moment = 1 / (INERTIA[solid] * mass * radius**2)
    if name == "fan":
        width = draw.number(30, 60)
        height = draw.number(90, 140)
        base_mass = draw.mass()
        objects["base"] = box(center, (width, height), mass=base_mass)
        # A free base turns the other way: both bodies together yield with the sum of
        # their inverse moments.
        inverse_moment += 12 / (base_mass * (width**2 + height**2))
    speed = draw.sign() * draw.number(300, 900, 0)
    time = draw.number(0.4, 0.8, 3)
    motor = {
        "objects": list(objects),
        "motor": center,
        "speed": speed,
        "limit": radians(abs(speed)) / time / inverse_moment,
    }
    return objects, motor, _Ramp(radians(speed), time)


def _motor(draw: Draw) -> list[Case]:
    """Return the case of two motors: one wheel on the world, the other on a turning
    base.

    The second motor's torque acts on wheel and base, with 1/I = 1/I1 + 1/I2.
    """
    objects: dict[str, Document] = {}
    joints = {}
    ramps = {}
    for name, x in (("wheel", 110.0), ("fan", 310.0)):
        bodies, motor, ramp = _drive(draw, name, x)
        objects |= bodies
        joints[f"{name}-motor"] = motor
        ramps[name] = ramp
    document = scene((420, 220), 1.0, objects, world=FLOATING, joints=joints)
    return [Case(document, partial(_ramp_error, ramps))]


def _ramp_error(ramps: Mapping[str, _Ramp], run: Run) -> Errors:
    """Return the largest deviation of the spin at any time, over the speed of the
    motor.
    """
    errors = []
    for name, ramp in ramps.items():
        track = run.track(name)
        spin = track.spin
        if name == "fan":
            # A motor acts on the spin of its wheel relative to the base.
            spin = spin - run.track("base").spin
        # A constant torque gives a linear rise up to the speed of the motor.
        expected = np.minimum(track.times / ramp.time, 1)
        errors.append(np.abs(spin / ramp.speed - expected).max())
    return {"spin": worst(errors)}


WELD_X, SEAM_Y = 260.0, 180.0
"""The flush side of the welded boxes, and the seam between them, px."""
BALL_DISTANCE = 120
"""Distance of the ball's centre from the flush side at t = 0, px."""


@dataclass(frozen=True)
class _WeldedPair:
    """Two boxes welded above each other, with one flush side."""

    sizes: tuple[Point, Point]
    """px."""
    masses: tuple[float, float]
    """g."""
    side: int
    """1 for a flush side at the left, -1 at the right."""

    @property
    def mass(self) -> float:
        """Return the mass of both, g."""
        return sum(self.masses)

    def centers(self) -> tuple[Array, Array]:
        """Return the centres of the boxes, (2,) px each."""
        (upper_width, upper_height), (lower_width, lower_height) = self.sizes
        # Both boxes end at x = WELD_X, so that the ball meets a flush side.
        upper_x = WELD_X + self.side * upper_width / 2
        lower_x = WELD_X + self.side * lower_width / 2
        upper = np.array([upper_x, SEAM_Y - upper_height / 2])
        return upper, np.array([lower_x, SEAM_Y + lower_height / 2])

    def center(self) -> Array:
        """Return the common centre of mass, (2,) px."""
        upper, lower = self.centers()
        mass_moment: Array = self.masses[0] * upper + self.masses[1] * lower
        return mass_moment / self.mass

    def moment(self) -> float:
        """Return the moment of inertia about the common centre by the
        parallel-axis theorem, g·px².
        """
        moment = 0.0
        bodies = zip(self.masses, self.sizes, self.centers(), strict=True)
        for mass, (width, height), center in bodies:
            # Steiner: each box adds its mass times the squared distance of its centre.
            arm = center - self.center()
            own_moment = (width * width + height * height) / 12
            moment += mass * (own_moment + float(arm @ arm))
        return moment

    def motion_after_impact(
        self, y: float, speed_change: float, ball_mass: float
    ) -> tuple[float, float]:
        """Return the velocity (px/s) and the spin (rad/s) after a ball's impact at the
        height y, which changes the relative speed by `speed_change` (px/s).
        """
        offset = y - self.center()[1]
        moment = self.moment()
        # The change of speed at the hit point by one unit of impulse, with the turn.
        softness = 1 / ball_mass + 1 / self.mass + offset**2 / moment
        impulse = speed_change / softness
        # An impulse J to the right at b below the centre has the moment -b J.
        return impulse / self.mass, -offset * impulse / moment

    def seam_center(self) -> list[float]:
        """Return the middle of the common surface of both boxes, px."""
        width = min(self.sizes[0][0], self.sizes[1][0])
        return [WELD_X + self.side * width / 2, SEAM_Y]


@dataclass(frozen=True)
class _WeldHit:
    """Motion of the welded boxes after the hit."""

    time: float
    """Time after the hit and before a second contact of the swinging boxes with the
    ball, s.
    """
    velocity: float
    """Velocity of the common centre to the right, px/s."""
    spin: float
    """rad/s."""


def _draw_impact_height(draw: Draw, upper_height: float, lower_height: float) -> float:
    """Return the y of the impact, px, beside the upper or the lower box."""
    if draw.sign() > 0:
        return SEAM_Y - draw.number(0.4, 0.9) * upper_height
    return SEAM_Y + draw.number(0.4, 0.9) * lower_height


def _weld(draw: Draw) -> list[Case]:
    """Return the case of a ball against the flush side of two welded boxes, off-centre
    and without friction.

    A ball of mass m at v hits boxes of M at b beside their centre: the impulse is (1 +
    e) v/(1/m + 1/M + b²/I).
    """
    elasticity = draw.number(0.2, 1.0)
    speed = draw.number(150, 300, 0)
    ball_mass = draw.mass()
    radius = draw.number(10, 18)
    upper_size = (draw.number(24, 60, 0), draw.number(50, 80, 0))
    lower_size = (draw.number(24, 60, 0), draw.number(50, 80, 0))
    masses = (draw.mass(), draw.mass())
    side = draw.sign()
    # Two welded boxes are one rigid body, with a common centre of mass and a moment by
    # Steiner's theorem.
    pair = _WeldedPair((upper_size, lower_size), masses, side)
    y = _draw_impact_height(draw, upper_size[1], lower_size[1])
    ball = circle(
        (WELD_X - side * BALL_DISTANCE, y),
        radius,
        mass=ball_mass,
        velocity=[side * speed, 0],
        friction=0.0,
        elasticity=elasticity,
    )
    motion = pair.motion_after_impact(y, side * (1 + elasticity) * speed, ball_mass)
    # A turning box may hit the ball again: the comparison is soon after the hit.
    hit = _WeldHit((BALL_DISTANCE - radius) / speed + 0.1, *motion)
    document = scene(
        (520, 360),
        1.1,
        {"ball": ball, **_welded_boxes(pair, elasticity)},
        world=FLOATING,
        joints={"weld": {"objects": ["upper", "lower"], "weld": pair.seam_center()}},
    )
    measure = partial(_weld_errors, pair, hit)
    return [Case(document, measure)]


def _welded_boxes(pair: _WeldedPair, elasticity: float) -> dict[str, Document]:
    """Return the boxes of a welded pair, without friction."""
    boxes = {}
    parts = zip(pair.centers(), pair.sizes, pair.masses, strict=True)
    for name, (center, size, mass) in zip(("upper", "lower"), parts, strict=True):
        boxes[name] = box(center, size, mass=mass, friction=0.0, elasticity=elasticity)
    return boxes


def _weld_errors(pair: _WeldedPair, hit: _WeldHit, run: Run) -> Errors:
    """Return the errors of both spins, and of the velocity of the common centre, over
    one rigid body's.
    """
    upper = run.track("upper")
    lower = run.track("lower")
    sample = upper.sample(hit.time)
    first, second = pair.masses
    # The common centre moves with the sum of the momenta over the mass of both.
    momentum = first * upper.velocity[sample] + second * lower.velocity[sample]
    expected = np.array([hit.velocity, 0.0])
    deviation = momentum / pair.mass - expected
    spin_errors = [
        _spin_error(upper, sample, hit.spin),
        _spin_error(lower, sample, hit.spin),
    ]
    return {
        "spin": worst(spin_errors),
        "velocity": float(np.hypot(*deviation) / np.hypot(*expected)),
    }


def _spin_error(track: Track, sample: int, spin: float) -> float:
    return float(abs(track.spin[sample] / spin - 1))


ROWS = (
    Row(
        28, "pendulum", "pendulum on a pivot, any swing", "T = 4 sqrt(J/(m g L)) K(sin(a/2)), J = I + m L²",
        "a ball released at 20 to 80 degrees and a rod at 80 to 130, 50 to 90 px below the pin",
        "Times of the first three passes through the lowest point, over the period. Smooth motion, so 0.3 %. K by the "
        "arithmetic-geometric mean.",
        (Measure("period", 3e-3),), _pendulum,
    ),
    Row(
        29, "springs", "masses on springs, damped or not", "w² = k/m - (c/(2 m))², amplitude e to the -c t/(2 m)",
        "20 to 500 g, 1.5 to 3 swings a second, stretched by 20 to 50 px, damping 0 and 3 to 10 % of critical; one "
        "pair of bodies on one spring",
        "Phase and amplitude after 2 s over their closed forms. Smooth motion, so 0.3 %.",
        (Measure("frequency", 3e-3), Measure("amplitude", 3e-3)), _springs,
    ),
    Row(
        33, "see-saw", "see-saw with two weights",
        "angular acceleration = torque / moment of all; tips at 1.01, back at 0.99",
        "planks of 220 to 260 px, boxes of 22 to 34 px at 60 to 90 px, moments of 0.99, 1.01 and 1.1 to 1.25",
        "Angle and spin after 0.4 s over those of one rigid body. As for rolling: 0.3 %.",
        (Measure("acceleration", 3e-3), Measure("balance", 0, Unit.SWITCH)), _seesaw,
    ),
    Row(
        34, "motor", "motor with a limit", "spin = limit x t/I up to its speed, then constant",
        "wheels of 30 to 55 px on the world and on a base that turns too, 300 to 900 degrees/s reached in 0.4 to 0.8 s",
        "Largest deviation at any time over the speed. 0.3 %: one step of the ramp is that much.",
        (Measure("spin", 3e-3),), _motor,
    ),
    Row(
        37, "weld", "two welded boxes hit off-centre", "one rigid body with the parallel-axis moment",
        "boxes of 24 to 60 x 50 to 80 px, ball of 10 to 18 px at 150 to 300 px/s, e 0.2 to 1, from either side",
        "Spins of both and velocity of their middle over their closed forms. Algebra, as for rows 11 and 30: 0.3 %.",
        (Measure("spin", 3e-3), Measure("velocity", 3e-3)), _weld,
    ),
)  # fmt: skip
