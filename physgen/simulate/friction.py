"""Friction on a table seen from above, and rolling resistance seen from the side.

Sliding and spinning of a disc share one friction, and end at the same time (Farkas,
Bartels, Unger, Wolf, Phys. Rev. Lett. 90, 248302, 2003). A sphere touches the table at
one point: it slides until that point is at rest, then rolls.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import atan2, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.scene.scene import Motion, Solid
from physgen.simulate.contacts import Array, Brakes, Order, Pair, impulses_and_normals


class Resistance:
    """Brakes of rolling and rocking, solved with the contacts to keep bodies at
    rest.
    """

    def __init__(self, world: World) -> None:
        levers = [
            (b.rolling * (b.radius or 0.0) + b.rocking) * (b.motion is Motion.DYNAMIC)
            for b in world.bodies
        ]
        self._lever = levers + [0.0] * len(world.walls)
        self._static = [b.motion is Motion.STATIC for b in world.bodies] + [True] * len(
            world.walls
        )
        self.busy = any(levers) and world.press == 0
        self.brakes = Brakes([], np.zeros((0, 2), np.int64), [])
        """The brakes of the next step."""
        self.torques: list[float] = []
        """Torques of the brakes by the last step's normal forces, g·px²/s²."""

    def follow(self, order: Order, numbers: bytes, h: float) -> None:
        """Set the next brakes and torques by a step's contacts."""
        if order.brakes is None:
            order.brakes = self._find_brakes(order.contacts)
        self.brakes, self.torques = order.brakes, []
        if not self.brakes.levers:
            return
        normal_impulses = [
            abs(ix * nx + iy * ny) for ix, iy, nx, ny in impulses_and_normals(numbers)
        ]
        for lever, rows in self.brakes.levers:
            # The torque of rolling resistance is the normal force times a lever, the
            # shift of the force in front of the wheel. An impulse by the length of the
            # step is the mean force.
            torque = 0.0
            # Sum in sorted order: the result must not depend on the order of contacts.
            for normal in (
                sorted([normal_impulses[k] for k in rows])
                if len(rows) > 1
                else (normal_impulses[rows[0]],)
            ):
                torque += lever * normal / h
            self.torques.append(torque)

    def _find_brakes(self, contacts: NDArray[np.int64]) -> Brakes:
        """Return the brakes of contacts (K, 3): one for each pair of bodies."""
        levers = dict[Pair, float]()
        rows = dict[Pair, list[int]]()
        partners = contacts.tolist()
        # Sort the contacts, so that the brakes of equal contacts are equal in any
        # order.
        for k in np.lexsort(contacts.T[2::-1]).tolist():
            a, b, _ = partners[k]
            # The first body of a pair has rolling resistance.
            if (self._lever[a] == 0, a) > (self._lever[b] == 0, b):
                a, b = b, a
            if self._lever[a] > 0:
                pair = a, -1 if self._static[b] else b
                levers[pair] = self._lever[a] + self._lever[b]
                rows.setdefault(pair, []).append(k)
        pairs = list(rows)
        by = [(levers[pair], rows[pair]) for pair in pairs]
        return Brakes(pairs, np.array(pairs, np.int64).reshape(-1, 2), by)


NODES = 1024
"""Number of nodes in the tables of friction by the ratio of sliding to spinning."""


def _ball_properties(
    radii: Array, mass: Array, moment: Array, grip: Array, rolling: Array
) -> list[Array]:
    """Return the properties of B balls, (B,) each: radius (px), inverse lever (1/px),
    the share of a mass in the inertia of a rolling ball, deceleration of pure sliding
    (px/s²), and the decelerations by rolling resistance of a sliding and of a rolling
    ball (rad/s²).

    `grip` and `rolling` (B,) px/s² are the coefficients times the pressure.
    """
    # The ratio of a solid sphere is 5/2.
    inertia_ratio = mass * radii**2 / np.maximum(moment, 1e-300)
    deceleration = rolling / np.maximum(radii, 1e-300) * inertia_ratio
    return [
        radii,
        inertia_ratio / np.maximum(radii, 1e-300),
        1 / (1 + inertia_ratio),
        grip,
        deceleration,
        deceleration / (1 + inertia_ratio),
    ]


class TableMotion(NamedTuple):
    """The functions of one kind of motion on the table."""

    array_changes: Callable[..., Any]
    """Changes of several bodies in one step, as arrays."""
    body_changes: Callable[..., Any]
    """Changes of one body in all steps, in plain numbers."""


def _is_ball(body: Body) -> bool:
    return body.solid is Solid.SPHERE and body.radius is not None


class Table:
    """Friction of a table seen from above on the N bodies of a world.

    Vectors in the plane are complex numbers.
    """

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        friction = world.table.friction
        grip = np.array([b.surface.friction * friction for b in bodies]).reshape(-1)
        rolling = np.array([b.rolling for b in bodies]).reshape(-1)
        is_dynamic = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        is_ball = np.array(list(map(_is_ball, bodies)), bool)
        # Spheres may also roll with resistance but without friction; discs only slide.
        has_friction = is_dynamic & ((grip > 0) | (is_ball & (rolling > 0)))
        self.busy = bool(world.press > 0 and has_friction.any())
        self._balls = np.flatnonzero(is_dynamic & is_ball)
        self._discs = np.flatnonzero(is_dynamic & ~is_ball & (grip > 0))
        mass, moment, patch = (
            np.array([(b.mass, b.moment, b.patch) for b in bodies]).reshape(-1, 3).T
        )
        is_ring = np.array([b.solid is Solid.HOOP for b in bodies], bool).reshape(-1)
        self._of_discs = [
            values[self._discs]
            for values in (grip * world.press, mass, patch, moment, is_ring)
        ]
        """Properties of discs, (D,) each; the first is the deceleration of pure
        sliding, px/s²."""
        radii = np.array([b.radius or 0.0 for b in bodies]).reshape(-1)
        properties = (radii, mass, moment, grip * world.press, rolling * world.press)
        self._of_balls = _ball_properties(*(v[self._balls] for v in properties))

    def predict(
        self, velocity: Array, roll: Array, h: float, steps: int
    ) -> list[tuple[Array, Array]]:
        """Return the changes of velocity (N, 3) and roll (N, 2) in the next steps.

        Each of the `steps` takes h seconds; the last comes first. Nothing else acts:
        `velocity` contains the effects of all other forces.
        """
        # Complex numbers x + iy turn directions by a product.
        linear_velocity = velocity[:, 0] + 1j * velocity[:, 1]
        rolls = roll[:, 0] + 1j * roll[:, 1]
        motion = np.array([linear_velocity, velocity[:, 2], rolls])
        changes = np.zeros((steps, 3, len(linear_velocity)), complex)
        is_moving = np.asarray(motion.any(axis=0))
        rolling = self._roll_on(linear_velocity, velocity[:, 2], rolls, h, changes)
        is_moving[rolling] = False
        for kind, bodies, properties in (
            (TableMotion(_slide, _slide_one), self._discs, self._of_discs),
            (TableMotion(_roll, _roll_one), self._balls, self._of_balls),
        ):
            moving_rows = np.flatnonzero(is_moving[bodies])
            _add_changes(kind, bodies, properties, moving_rows, motion, h, changes)
        # Callers take the next step from the end of the list: the order is reversed.
        velocity_change, spin_change, roll_change = changes[::-1].swapaxes(0, 1)
        velocity_changes = np.stack(
            [velocity_change.real, velocity_change.imag, spin_change.real], axis=2
        )
        roll_changes = np.stack([roll_change.real, roll_change.imag], axis=2)
        return list(zip(velocity_changes, roll_changes, strict=True))

    def _roll_on(
        self, v: Array, spin: Array, roll: Array, h: float, out: Array
    ) -> NDArray[np.int64]:
        """Write the changes of spheres that roll in all steps; return the spheres.

        Their deceleration is constant.
        """
        r, _, gives, grip, twists, slows = self._of_balls
        v = v[self._balls]
        spin = spin[self._balls]
        roll = roll[self._balls]
        # The lowest point of a rolling sphere is at rest: its velocity v - i r roll is
        # zero up to rounding errors. Such spheres slow down evenly until they stop.
        is_sliding = abs(v - 1j * r * roll) * gives > 1e-12 * r * abs(roll)
        k = np.flatnonzero(
            ~is_sliding & (grip > 0) & (slows * h * len(out) < abs(roll))
        )
        # Rolling resistance takes an equal change from speed and roll in every step.
        share_per_step = slows[k] * h / abs(roll[k])
        out[:, 0, self._balls[k]], out[:, 2, self._balls[k]] = (
            -share_per_step * v[k],
            -share_per_step * roll[k],
        )
        spin_loss = twists[k] * h
        remaining_spin = abs(spin[k]) - spin_loss * np.arange(len(out))[:, None]
        out[:, 1, self._balls[k]] = -np.sign(spin[k]) * np.clip(
            remaining_spin, 0, spin_loss
        )
        return self._balls[k]


def _add_changes(
    kind: TableMotion,
    bodies: NDArray[np.int64],
    properties: list[Array],
    moving_rows: NDArray[np.int64],
    motion: Array,
    h: float,
    changes: Array,
) -> None:
    """Write the changes (S, 3, N) of the moving ones of some bodies, in S steps."""
    steps = len(changes)
    # For few bodies, plain numbers are faster than arrays.
    if len(moving_rows) > 8:
        moving = bodies[moving_rows]
        values = [column[moving_rows] for column in properties]
        changes[:, :, moving] = _path(
            kind.array_changes, values, motion[:, moving], h, steps
        )
        return
    for k in moving_rows.tolist():
        body = bodies[k]
        plain_values: list[float] = [column[k].item() for column in properties]
        changes[:, :, body] = kind.body_changes(
            plain_values, motion[:, body].tolist(), h, steps
        )


def _path(
    kind: Callable[..., Any],
    properties: list[Array],
    motion: Array,
    h: float,
    steps: int,
) -> list[Any]:
    """Return the changes of velocity, spin and roll of several bodies in each step."""
    # Spins are real numbers in an array of complex velocities.
    v, spin, roll = motion
    spin, changes = spin.real, []
    for _ in range(steps):
        changes.append(kind(properties, v, spin, roll, h))
        v, spin, roll = (
            value + change
            for value, change in zip((v, spin, roll), changes[-1], strict=True)
        )
    return changes


def _slide(
    properties: list[Array], v: Array, spin: Array, roll: Array, h: float
) -> tuple[Array, Array, Array]:
    """Return the changes of discs' velocity, spin and roll, by the midpoint rule."""
    half_change, half_turn = _friction_changes(properties, v, spin, h / 2, v, spin)
    return *_friction_changes(
        properties, v, spin, h, v + half_change, spin + half_turn
    ), 0 * roll


def _friction_changes(
    properties: list[Array],
    v: Array,
    spin: Array,
    h: float,
    mid_velocity: Array,
    at_spin: Array,
) -> tuple[Array, Array]:
    """Return the changes by friction at other speeds; never beyond rest."""
    grip, mass, patch, moment, ring = properties
    # The ratio of sliding to spinning decides how friction is shared between both.
    slip_angle = np.arctan2(abs(mid_velocity), patch * abs(at_spin))
    force_share, torque_share = _parts(slip_angle, ring)
    speed = abs(v)
    rim_spin = abs(spin)
    stopping_speed = grip * h
    # The force acts against the motion at the step's start: friction never reverses it.
    lost_speed = np.minimum(force_share * stopping_speed, speed)
    brake = lost_speed / np.maximum(speed, 1e-300)
    torque_loss = torque_share * grip * mass * patch / moment * h
    spin_loss = np.minimum(torque_loss, rim_spin)
    # Less than a step before the end, both motions end at once.
    comes_to_rest = (rim_spin * moment <= stopping_speed * mass * patch) & (
        speed + patch * rim_spin <= stopping_speed
    )
    spin_change = np.where(spin > 0, -spin_loss, spin_loss)
    return (
        np.where(comes_to_rest, -v, -brake * v),
        np.where(comes_to_rest, -spin, spin_change),
    )


def _slide_one(
    properties: list[float], motion: list[complex], h: float, steps: int
) -> NDArray[np.complex128]:
    """Return the changes (steps, 3) of one disc, as `_slide` for several."""
    (grip, mass, patch, moment, ring), (v, spin, _) = properties, motion
    _, forces, torques = _listed_shares(bool(ring))
    nodes_per_radian = (NODES - 1) / (pi / 2)
    last_node = NODES - 2
    changes = np.zeros((steps, 3), complex)
    spin_now = spin.real
    for k in range(steps):
        speed = abs(v)
        spin_size = abs(spin_now)
        # Friction acts against the spin.
        sign = -1.0 if spin_now > 0 else 1.0
        change = 0j
        spin_change = 0.0
        # The midpoint method: the forces at the middle of the step determine the whole
        # step.
        for span in (h / 2, h):
            stopping_speed = grip * span
            surface_speed = patch * abs(spin_now + spin_change)
            position = atan2(abs(v + change), surface_speed) * nodes_per_radian
            # Interpolate the shares of force and torque linearly between tabulated
            # angles.
            if position < last_node:
                node = int(position)
            else:
                node = last_node
            fraction = position - node
            force_share = forces[node] + fraction * (forces[node + 1] - forces[node])
            torque_share = torques[node] + fraction * (
                torques[node + 1] - torques[node]
            )
            # A disc that friction can stop within the step stops, and does not turn
            # back.
            if (
                speed + patch * spin_size <= stopping_speed
                and spin_size * moment <= stopping_speed * mass * patch
            ):
                change = -v
                spin_change = -spin_now
                continue
            lost_speed = min(force_share * stopping_speed, speed)
            change = -(lost_speed / (speed or 1e-300)) * v
            lost_spin = torque_share * grip * mass * patch / moment * span
            spin_change = sign * min(lost_spin, spin_size)
        changes[k, :2] = change, spin_change
        v += change
        spin_now += spin_change
        if not (v or spin_now):
            break
    return changes


def _parts(ratio: Array, ring: Any) -> list[Array]:
    """Return the shares of force and torque at angles (D,), of discs and rings."""
    (nodes, *disc_shares), (_, *hoop_shares) = _shares(False), _shares(True)
    share_pairs = zip(disc_shares, hoop_shares, strict=True)
    return [
        np.where(ring, np.interp(ratio, nodes, b), np.interp(ratio, nodes, a))
        for a, b in share_pairs
    ]


def _roll(
    properties: list[Array], v: Array, spin: Array, roll: Array, h: float
) -> tuple[Array, Array, Array]:
    """Return the changes of spheres' velocity, spin and roll."""
    r, lever, gives, grip, lost_sliding, lost_rolling = properties
    # Velocity of the lowest point relative to the table.
    slip = v - 1j * r * roll
    slip_speed = abs(slip)
    sticking_change = slip_speed * gives
    brake = np.minimum(grip * h, sticking_change)
    change = -brake / np.maximum(slip_speed, 1e-300) * slip
    roll_change = 1j * lever * change
    # Rolling resistance is a torque of c x normal force x radius; it slows the velocity
    # of a rolling ball in proportion to its roll.
    is_rolling = brake >= sticking_change * (1 - 1e-12)
    new_roll = roll + roll_change
    loss = np.where(is_rolling, lost_rolling, lost_sliding) * h
    loss = np.minimum(loss / np.maximum(abs(new_roll), 1e-300), 1.0)
    # The same torque brakes a spin about the vertical axis: that of a billiard ball by
    # 8.6 rad/s² (Alciatore measured 10).
    spin_loss = np.minimum(np.where(grip > 0, lost_sliding, 0.0) * h, abs(spin))
    return (
        change - np.where(is_rolling, loss, 0.0) * (v + change),
        np.where(spin > 0, -1.0, 1.0) * spin_loss,
        roll_change - loss * new_roll,
    )


def _roll_one(
    properties: list[float], motion: list[complex], h: float, steps: int
) -> NDArray[np.complex128]:
    """Return the changes (steps, 3) of one sphere, as `_roll` for several."""
    r, lever, gives, grip, lost_sliding, lost_rolling = properties
    v, spin, roll = motion
    changes = np.zeros((steps, 3), complex)
    spin_now = spin.real
    spin_loss = (lost_sliding if grip > 0 else 0.0) * h
    lever_to_slip = 1j * r
    complex_lever = 1j * lever
    for k in range(steps):
        # The slip is the velocity of the sphere's lowest point on the table.
        slip = v - lever_to_slip * roll
        slip_speed = abs(slip)
        sticking_change = slip_speed * gives
        # Sliding friction changes the velocity by at most grip * h, and never past
        # rolling.
        brake = min(grip * h, sticking_change)
        change = -brake / (slip_speed or 1e-300) * slip
        roll_change = complex_lever * change
        roll_now = roll + roll_change
        is_rolling = brake >= sticking_change * (1 - 1e-12)
        # Rolling resistance may stop the roll, but not turn it back.
        roll_loss = (lost_rolling if is_rolling else lost_sliding) * h
        rolling_loss = min(roll_loss / (abs(roll_now) or 1e-300), 1.0)
        spin_change = (-1.0 if spin_now > 0 else 1.0) * min(spin_loss, abs(spin_now))
        if is_rolling:
            change -= rolling_loss * (v + change)
        roll_change -= rolling_loss * roll_now
        changes[k] = change, spin_change, roll_change
        v += change
        spin_now += spin_change
        roll += roll_change
        if not (v or spin_now or roll):
            break
    return changes


@cache
def _listed_shares(ring: bool) -> list[list[float]]:
    """Return `_shares` as lists of plain numbers."""
    return [values.tolist() for values in _shares(ring)]


@cache
@cache
def _shares(ring: bool) -> tuple[Array, Array, Array]:
    """Return angles atan2(speed, rim speed), with the shares of force and torque.

    They are averages over the area of a uniform disc, or over the rim of a hoop, of
    friction against each point's own velocity.
    """
    nodes = np.linspace(0, np.pi / 2, NODES)
    if ring:
        return nodes, *_shares_of_rim(nodes)
    force, torque = _shares_of_disc(np.tan(nodes[1:-1]))
    return (
        nodes,
        np.concatenate([[0], force, [1]]),
        np.concatenate([[2 / 3], torque, [0]]),
    )


def _shares_of_rim(nodes: Array) -> tuple[Array, Array]:
    """Return the shares of force and torque of a hoop at angles (K,)."""
    angles_on_rim = (np.arange(720) + 0.5) * (2 * np.pi / 720)
    v = np.sin(nodes)[:, None]
    u = np.cos(nodes)[:, None]
    vx = v - u * np.sin(angles_on_rim)
    vy = u * np.cos(angles_on_rim)
    point_speed = np.maximum(np.hypot(vx, vy), 1e-300)
    torque = np.cos(angles_on_rim) * vy - np.sin(angles_on_rim) * vx
    return (vx / point_speed).mean(axis=1), (torque / point_speed).mean(axis=1)


def _shares_of_disc(ratio: Array) -> tuple[Array, Array]:
    """Return the shares of force and torque of a disc; `ratio` (K,): speed / rim speed.

    The formulas of Farkas et al. in complete elliptic integrals. They differ for a
    centre of rotation inside the disc (slow) and outside.
    """
    is_slow = ratio <= 1
    # At the parameter m = 1 both formulas agree: the centre of rotation is on the rim.
    m = np.where(is_slow, ratio, 1 / ratio) ** 2
    K, E = _elliptic(m)
    square_ratio = ratio**2
    force = (
        4
        / 3
        * np.where(
            is_slow,
            ((square_ratio + 1) * E + (square_ratio - 1) * K) / ratio,
            (square_ratio + 1) * E - (square_ratio - 1) * K,
        )
        / np.pi
    )
    inner = (4 - 2 * square_ratio) * E + (square_ratio - 1) * K
    outer = ratio * (
        (4 - 2 * square_ratio) * E + (2 * square_ratio - 5 + 3 / square_ratio) * K
    )
    torque = 4 / 9 * np.where(is_slow, inner, outer) / np.pi
    return force, torque


def _elliptic(m: Array) -> tuple[Array, Array]:
    """Return the complete elliptic integrals K and E of the parameter m < 1.

    The arithmetic-geometric mean converges quadratically.
    """
    a = np.ones_like(m)
    b = np.sqrt(1 - m)
    # The sum of 2^(n-1) c_n² over the steps of the mean leads from K to E (Abramowitz
    # and Stegun 17.6.4).
    series_sum, power = m / 2, 0.5
    for _ in range(40):
        c = (a - b) / 2
        a, b = (a + b) / 2, np.sqrt(a * b)
        power *= 2
        series_sum = series_sum + power * c**2
        if np.all(np.abs(c) <= 1e-16):
            break
    K = np.pi / (2 * a)
    return K, K * (1 - series_sum)
