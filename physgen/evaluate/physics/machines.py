"""Rows of rails, ropes, pulleys, gears, and of pins with limits, friction and breaking
forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import atan2, cos, pi, radians, sin, sqrt

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
from physgen.evaluate.physics.staging import GRAVITY, INERTIA, box, circle, scene

Array = NDArray[np.float64]

FLOATING = {"gravity": [0, 0]}
BISECTIONS = 60
"""Halvings of 1 s: the time of a catch is exact to the last bit."""


def _slider_errors(
    run: Run, *, down: Array, angle: float, way: float, time: float, speed: float
) -> Errors:
    """Return the errors of the block's path and end, and of the cart's speed."""
    block = run.track("block")
    cart = run.track("cart")
    moved = block.displacements @ down
    # Without friction, only the part of the weight along the rail accelerates.
    exact = GRAVITY * sin(radians(angle)) * block.times**2 / 2
    # The closed form ends where the block meets the end of its rail.
    slides = exact < way
    # The drive pushes with its full force until the cart has its speed.
    pace = np.minimum(cart.times / time, 1) * speed
    path_error = float(np.abs(moved - exact)[slides].max())
    end_error = float(np.abs(moved - way)[-1])
    pace_error = float(np.abs(cart.velocities[:, 0] - pace).max())
    return {
        "way": path_error / way,
        "end": end_error / way,
        "drive": pace_error / speed,
    }


def _downhill(angle: float, side: int) -> Array:
    """Return the unit vector down a rail of `angle` degrees to the right (1) or left."""
    slope = radians(angle)
    return np.array([side * cos(slope), sin(slope)])


def _slider(draw: Draw) -> list[Case]:
    """Return the case of sliders. Errors: deviation of the path over the path to the
    rail's end, and of the resting place.

    A block slides down a rail by g sin a t²/2 to its end. A cart with a drive of at
    most F moves at F t/m, then at the drive's speed.
    """
    angle = draw.number(15, 60, 1)
    length = draw.number(180, 260, 1)
    mass = draw.mass()
    side = draw.sign()
    top = np.array([320.0 - side * 180, 60.0])
    down = _downhill(angle, side)
    begin = draw.number(20, 50, 1)
    speed = draw.number(120, 220, 0)
    time = draw.number(0.2, 0.5, 3)
    other = draw.mass()
    objects = {
        "block": box(top + begin * down, (36, 20), side * angle, mass=mass),
        "cart": box((60, 360), (40, 20), mass=other),
    }
    joints = {
        "rail": {
            "objects": ["block"],
            "slider": [top.tolist(), (top + length * down).tolist()],
        },
        "track": {
            "objects": ["cart"],
            "slider": [[60.0, 360.0], [600.0, 360.0]],
            "drive": speed,
            "force": other * speed / time,
        },
    }
    # The block stops at the end of its rail, at this distance from its start.
    way = length - begin

    measure = partial(
        _slider_errors, down=down, angle=angle, way=way, time=time, speed=speed
    )

    document = scene((640, 420), 2.0, objects, joints=joints)
    return [Case(document, measure)]


@dataclass(frozen=True)
class _Catch:
    """The end of the free flight of a ball on a rope."""

    time: float
    """Time of the catch, s."""
    height: float
    """y of the ball, px."""
    velocity_before: Array
    """(2,) px/s."""
    velocity_after: Array
    """(2,) px/s."""
    energy_loss: float
    """Kinetic energy of the motion along the rope."""


@dataclass(frozen=True)
class _Rope:
    """A ball that flies until its rope is tight."""

    start: Array
    """First position from the anchor, (2,) px."""
    velocity: Array
    """First velocity, (2,) px/s."""
    anchor: Array
    """(2,) px."""
    length: float
    """px."""
    mass: float
    """Mass of the ball, g."""

    def position(self, time: float) -> Array:
        """Return the position from the anchor during the flight, (2,) px."""
        drop = np.array([0, GRAVITY * time**2 / 2])
        return np.asarray(self.start + self.velocity * time + drop)

    def catch_time(self) -> float:
        """Return the time at which the rope becomes tight, s, by bisection."""
        low, high = 0.0, 1.0
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            # A slack rope: the ball is still within the circle about the anchor.
            if np.hypot(*self.position(middle)) < self.length:
                low = middle
            else:
                high = middle
        return low

    def catch(self) -> _Catch:
        """Return the catch: the rope removes the velocity along itself."""
        time = self.catch_time()
        # The distance at the catch is the rope's length, so that this is a unit vector.
        direction = self.position(time) / self.length
        before = self.velocity + np.array([0, GRAVITY * time])
        radial_speed = float(before @ direction)
        return _Catch(
            time=time,
            height=float((self.anchor + self.position(time))[1]),
            velocity_before=before,
            velocity_after=before - radial_speed * direction,
            energy_loss=self.mass * radial_speed**2 / 2,
        )


def _rope_errors(catch: _Catch, run: Run) -> Errors:
    """Return the errors of the speed after the catch and of the energy loss."""
    track = run.track("ball")
    # Two samples after the catch, the rope is certainly tight.
    sample = track.sample(catch.time + 2 / 240)
    # The speed along the circle follows from the energy since the catch.
    drop = track.y[sample] - catch.height
    square = float(catch.velocity_after @ catch.velocity_after) + 2 * GRAVITY * drop
    speed = sqrt(max(square, 0.0))
    energy = run.trajectory.energy
    loss = energy.dissipated[sample] - energy.dissipated[0]
    speed_before = float(np.hypot(*catch.velocity_before))
    return {
        "speed": abs(track.speed[sample] - speed) / speed_before,
        "lost": abs(loss / catch.energy_loss - 1),
    }


def _rope(draw: Draw) -> list[Case]:
    """Return the case of a ball on a rope. Errors: deviation of the velocity after the
    rope's catch over the velocity before, and of the energy loss over the kinetic
    energy.

    The tight rope of a thrown ball removes the velocity along the rope, m (v·e)²/2 of
    the energy, and keeps the velocity across it.
    """
    mass = draw.mass()
    length = draw.number(120, 170, 1)
    start_x = draw.number(20, 50, 1) * draw.sign()
    start = np.array([start_x, draw.number(10, 40, 1)])
    velocity = np.array([draw.number(-60, 60, 0), draw.number(0, 60, 0)])
    anchor = np.array([320.0, 60.0])
    objects = {
        "ball": circle(anchor + start, 12, mass=mass, velocity=velocity.tolist())
    }
    joints = {
        "rope": {
            "objects": ["ball"],
            "rope": [(anchor + start).tolist(), anchor.tolist()],
            "length": length,
        }
    }

    # The ball flies freely until its distance from the anchor is the length of the
    # rope.
    rope = _Rope(start, velocity, anchor, length, mass)
    measure = partial(_rope_errors, rope.catch())
    document = scene((640, 300), 1.0, objects, joints=joints)
    return [Case(document, measure)]


def _path_error(run: Run, *, pull: float, time: float, path: float) -> Errors:
    """Return the largest deviation of an accelerated path, over the path at the end."""
    track = run.track("right")
    is_before_end = track.times <= time
    exact = pull * track.times[is_before_end] ** 2 / 2
    deviation = np.abs(track.displacements[is_before_end, 1] - exact)
    return {"way": float(deviation.max()) / path}


def _atwood(draw: Draw) -> list[Case]:
    """Return the case of an Atwood machine. Error: largest deviation of the path over
    the path at the end: a = g (m2 - m1)/(m1 + m2).
    """
    light = draw.number(50, 150, 0)
    heavy = draw.number(160, 400, 0)
    side = draw.sign()
    apart = draw.number(60, 120, 0)
    if side > 0:
        left, right = (light, heavy)
    else:
        left, right = (heavy, light)
    x, other = 320 - apart, 320 + apart
    objects = {
        "left": circle((x, 260), 18, mass=left),
        "right": circle((other, 260), 18, mass=right),
    }
    joints = {
        "rope": {
            "objects": ["left", "right"],
            "pulley": [[x, 260], [x, 40], [other, 40], [other, 260]],
        }
    }
    # The difference of the weights accelerates the sum of the masses.
    pull = GRAVITY * (right - left) / (right + left)
    # The run ends after a path of 150 px, before a ball reaches its wheel.
    time = sqrt(2 * 150 / abs(pull))
    document = scene((640, 480), time, objects, joints=joints)
    measure = partial(_path_error, pull=pull, time=time, path=150)
    return [Case(document, measure)]


def _gear_error(run: Run, *, gain: float, ratio: float) -> Errors:
    """Return the larger error of both spins after an acceleration of the driver."""
    driver = run.track("driver")
    wheel = run.track("wheel")
    driver_spin = gain * driver.times[-1]
    wheel_spin = driver_spin / ratio
    errors = [
        abs(driver.spin[-1] / driver_spin - 1),
        abs(wheel.spin[-1] / wheel_spin - 1),
    ]
    return {"spin": worst(errors)}


def _gears(draw: Draw) -> list[Case]:
    """Return the case of gears. Error: deviation of both spins over their closed form.

    M = (I1 + I2/r²) a of the first gear; it turns r times for one turn of the second.
    """
    ratio = draw.sign() * draw.number(0.4, 2.5)
    radius = draw.number(30, 60, 1)
    # Both rims have the same speed, so that the radii have the ratio of the gear.
    other = radius * abs(ratio)
    masses = [draw.mass(), draw.mass()]
    places = [(320 - radius, 200.0), (320 + other, 200.0)]
    objects = {
        "driver": circle(places[0], radius, mass=masses[0]),
        "wheel": circle(places[1], other, mass=masses[1]),
    }
    # A wheel turns r times slower with a torque r times larger, so that its energy (I /
    # r²) w² / 2 counts at the driver.
    moments = [INERTIA["disc"] * masses[0] * radius**2]
    moments.append(INERTIA["disc"] * masses[1] * other**2)
    gain = draw.number(4, 12)
    # Seen from the driver, the wheel's inertia counts by 1/r².
    torque = gain * (moments[0] + moments[1] / ratio**2)
    joints = {
        "axle-1": {"objects": ["driver"], "pivot": list(places[0])},
        "axle-2": {"objects": ["wheel"], "pivot": list(places[1])},
        "teeth": {"objects": ["driver", "wheel"], "gear": ratio},
    }
    forces = [{"object": "driver", "torque": torque}]
    document = scene(
        (640, 400), 2.0, objects, world=FLOATING, joints=joints, forces=forces
    )
    return [Case(document, partial(_gear_error, gain=gain, ratio=ratio))]


def _pins(draw: Draw) -> list[Case]:
    """Return the case of pins with friction and limits. Errors: deviation of a
    flywheel's spin over its first one, and of a rod's resting angle over its limit.

    Dry friction of torque M slows the wheel by M t/I until it stops. The rod falls onto
    the limit of its hinge and rests there.
    """
    radius = draw.number(30, 60, 1)
    mass = draw.mass()
    spin = draw.sign() * draw.number(200, 700, 0)
    time = draw.number(0.5, 1.4, 3)
    # The friction torque is chosen so that the wheel stops within the clip.
    moment = INERTIA["disc"] * mass * radius**2
    limit = draw.number(15, 70, 1)
    arm = draw.number(60, 100, 1)
    objects: dict[str, Document] = {
        "wheel": circle((120, 120), radius, mass=mass, spin=spin),
        "rod": box((300 + arm, 120), (2 * arm, 12), mass=draw.mass()),
    }
    joints = {
        "axle": {
            "objects": ["wheel"],
            "pivot": [120, 120],
            "friction": moment * radians(abs(spin)) / time,
        },
        "hinge": {"objects": ["rod"], "pivot": [300, 120], "limits": [-20, limit]},
    }

    def measure(run: Run) -> Errors:
        wheel = run.track("wheel")
        rod = run.track("rod")
        # Dry friction brakes evenly, and never turns the wheel back.
        left = np.maximum(1 - wheel.times / time, 0)
        spin_errors = np.abs(wheel.spin / radians(spin) - left)
        angle_errors = np.abs(rod.angle / radians(limit) - 1)
        return {
            "spin": float(spin_errors.max()),
            "angle": float(angle_errors[-1]),
        }

    document = scene((560, 340), 2.0, objects, joints=joints)
    return [Case(document, measure)]


@dataclass(frozen=True)
class _BreakingPendulum:
    """A ball on a rod with a pin that breaks."""

    mass: float
    """g."""
    arm: float
    """px."""
    moment: float
    """Moment of inertia about the pin, g·px²."""
    limit: float
    """Breaking force, g·px/s²."""

    def error(self, run: Run) -> Errors:
        """Return the deviation of the force at the break over its limit."""
        spin = float(run.track("ball").spin[-1])
        weight = self.mass * GRAVITY
        # After the break, the spin stays: its energy gives the angle of the break.
        sine = spin**2 * self.moment / (2 * weight * self.arm)
        # Weight and centripetal force along the rod; the rest of the weight across it.
        along = weight * sine + self.mass * self.arm * spin**2
        cosine = sqrt(max(1 - sine**2, 0.0))
        # Without a pin, the weight across the rod would accelerate the centre more: the
        # pin carries the difference.
        across = weight * cosine * (1 - self.mass * self.arm**2 / self.moment)
        force = np.hypot(along, across)
        return {"force": abs(force / self.limit - 1)}


def _breaking(draw: Draw) -> list[Case]:
    """Return the case of a breaking pin. Error: deviation of a pendulum's breaking
    force over the stated one.

    A ball on a rod, with a horizontal start, presses on its pin by m g s + m L w² along
    the rod, with s the sine of the fallen angle and w² = 2 m g L s/J, and by m g c (1 -
    m L²/J) across it. The final spin of the free ball gives s.
    """
    mass = draw.mass()
    arm = draw.number(90, 150, 1)
    radius = draw.number(12, 25, 1)
    side = draw.sign()
    part = draw.number(1.2, 2.6)
    moment = mass * (radius**2 / 2 + arm**2)
    limit = part * (mass * GRAVITY)
    objects = {"ball": circle((320 + side * arm, 120), radius, mass=mass)}
    pin = {"objects": ["ball"], "pivot": [320.0, 120.0], "breaks": limit}
    duration = fall_time(part, arm) + 0.3
    document = scene((640, 460), duration, objects, joints={"pin": pin})
    pendulum = _BreakingPendulum(mass, arm, moment, limit)
    return [Case(document, pendulum.error)]


def fall_time(part: float, arm: float) -> float:
    """Return an upper bound of the time (s) until a falling pendulum of `arm` px, with
    a horizontal start, pulls with `part` weights.
    """
    # A point mass pulls with 3 m g s; the larger moment of the ball delays the break.
    sine = min(part / 3, 0.95)
    angle = atan2(sine, sqrt(1 - sine**2))
    return sqrt(2 * arm / GRAVITY) * angle * 2 / pi * 1.5


ROWS = (
    Row(
        41, "slider", "block on a rail, and a drive with a limit", "s = g sin a t²/2; v = F t/m to its speed",
        "rails of 180 to 260 px at 15 to 60 degrees, 20 to 500 g; a cart at 120 to 220 px/s, reached in 0.2 to 0.5 s",
        "Largest deviation of the way and of the end over the way, and of the speed over the drive's. Smooth motion: "
        "0.3 %, of which a step of the ramp takes most.",
        (Measure("way", 3e-3), Measure("end", 1e-3), Measure("drive", 3e-3)), _slider,
    ),
    Row(
        42, "rope", "rope that catches a ball", "the velocity along the rope is lost: m (v·e)²/2",
        "ropes of 120 to 170 px, thrown at up to 85 px/s from 20 to 50 px beside the anchor",
        "Speed after the catch over that before, and the energy that it took over its closed form. Algebra: 0.3 %.",
        (Measure("speed", 3e-3), Measure("lost", 3e-3)), _rope,
    ),
    Row(
        43, "atwood", "Atwood's machine", "a = g (m2 - m1)/(m1 + m2)",
        "50 to 150 g against 160 to 400 g, on either side",
        "Largest deviation of the way over 150 px. Smooth motion: 0.3 %.",
        (Measure("way", 3e-3),), _atwood,
    ),
    Row(
        44, "gears", "torque on two toothed wheels", "M = (I1 + I2/r²) a; w1 = r w2",
        "ratios of 0.4 to 2.5 in either direction, wheels of 30 to 150 px, 20 to 500 g",
        "Spins after 2 s over their closed forms. Algebra: 0.3 %.",
        (Measure("spin", 3e-3),), _gears,
    ),
    Row(
        45, "pins", "dry friction in a pin, and a hinge with a limit", "w = w0 - M t/I, then 0; rests at the limit",
        "wheels of 30 to 60 px at 200 to 700 degrees/s that stop in 0.5 to 1.4 s; limits of 15 to 70 degrees",
        "Spin at any time over the first one: 0.3 %. The angle at the end over the limit: 0.1 %.",
        (Measure("spin", 3e-3), Measure("angle", 1e-3)), _pins,
    ),
    Row(
        46, "breaking", "pin that breaks", "F² = (m g s + m L w²)² + (m g c (1 - m L²/J))², w² = 2 m g L s/J",
        "20 to 500 g on 90 to 150 px, forces of 1.2 to 2.6 weights",
        "The force at the break, by the spin that is left, over the stated one. The mean over 1/240 s lags: 2 %.",
        (Measure("force", 2e-2),), _breaking,
    ),
)  # fmt: skip
