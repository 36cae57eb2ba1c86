"""Friction on a table seen from above, and rolling resistance seen from the side.

A disc's sliding and spinning share one friction: both end together (Farkas, Bartels, Unger, Wolf, Phys. Rev. Lett. 90,
248302, 2003). A sphere touches the table at one point: it slides until that point stands still, then rolls.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import atan2, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.scene.scene import Motion, Solid
from physgen.simulate.contacts import Array, Brakes, Order, Pair, impulses_and_normals


class Resistance:
    """Brakes between bodies and what they roll or rock on; solved with the contacts, so that they hold at rest."""

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
        """Of the next step."""
        self.torques: list[float] = []
        """Of the brakes, by the normal forces of the last step, g·px²/s²."""

    def follow(self, order: Order, numbers: bytes, h: float) -> None:
        """Set the next brakes and torques by a step's contacts."""
        if order.brakes is None:
            order.brakes = self._found(order.listed)
        self.brakes, self.torques = order.brakes, []
        if not self.brakes.by:
            return
        normals = [
            abs(ix * nx + iy * ny) for ix, iy, nx, ny in impulses_and_normals(numbers)
        ]
        for lever, rows in self.brakes.by:
            torque = 0.0
            for normal in (
                sorted([normals[k] for k in rows])
                if len(rows) > 1
                else (normals[rows[0]],)
            ):
                torque += lever * normal / h
            self.torques.append(torque)

    def _found(self, listed: NDArray[np.int64]) -> Brakes:
        levers, rows = dict[Pair, float](), dict[Pair, list[int]]()
        partners = listed.tolist()
        for k in np.lexsort(listed.T[2::-1]).tolist():
            a, b, _ = partners[k]
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
"""Of the tables of friction by the ratio of sliding to spinning."""


class Table:
    """Friction on the N bodies of a world; idle seen from the side. Vectors in the plane are complex numbers."""

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        grip = np.array(
            [b.surface.friction * world.table.friction for b in bodies]
        ).reshape(-1)
        rolling = np.array([b.rolling for b in bodies]).reshape(-1)
        on = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        ball = np.array(
            [b.solid is Solid.SPHERE and b.radius is not None for b in bodies], bool
        )
        self.busy = bool(
            world.press > 0 and (on & ((grip > 0) | (ball & (rolling > 0)))).any()
        )
        self._balls = np.flatnonzero(on & ball)
        self._discs = np.flatnonzero(on & ~ball & (grip > 0))
        mass, moment, patch = (
            np.array([(b.mass, b.moment, b.patch) for b in bodies]).reshape(-1, 3).T
        )
        ring = np.array([b.solid is Solid.HOOP for b in bodies], bool).reshape(-1)
        self._of_discs = [
            values[self._discs]
            for values in (grip * world.press, mass, patch, moment, ring)
        ]
        """(D,) each; the first, px/s², is the deceleration of what slides without spinning."""
        k = self._balls
        r = np.array([b.radius or 0.0 for b in bodies]).reshape(-1)[k]
        share = mass[k] * r**2 / np.maximum(moment[k], 1e-300)  # of a solid sphere 5/2
        slow = rolling[k] * world.press / np.maximum(r, 1e-300) * share
        lever = share / np.maximum(r, 1e-300)
        self._of_balls = [
            r,
            lever,
            1 / (1 + share),
            grip[k] * world.press,
            slow,
            slow / (1 + share),
        ]
        """(B,) each; the last, rad/s², are what rolling resistance takes from the roll, sliding and not."""

    def foreseen(
        self, velocity: Array, roll: Array, h: float, steps: int
    ) -> list[tuple[Array, Array]]:
        """Changes of velocity (N, 3) and roll (N, 2) in each of some steps of h seconds, the last first, while nothing
        else acts; velocity holds all other forces' doing already."""
        v, rolls = velocity[:, 0] + 1j * velocity[:, 1], roll[:, 0] + 1j * roll[:, 1]
        motion, out = (
            np.array([v, velocity[:, 2], rolls]),
            np.zeros((steps, 3, len(v)), complex),
        )
        moves = np.asarray(motion.any(axis=0))
        moves[self._roll_on(v, velocity[:, 2], rolls, h, out)] = False
        kinds = (
            (_slide, _slide_one, self._discs, self._of_discs),
            (_roll, _roll_one, self._balls, self._of_balls),
        )
        for several, one, listed, of in kinds:
            mine = np.flatnonzero(moves[listed])
            if len(mine) > 8:  # of fewer, plain numbers are quicker than arrays
                on, values = listed[mine], [v[mine] for v in of]
                out[:, :, on] = _path(several, values, motion[:, on], h, steps)
                continue
            for k in mine.tolist():
                plain: list[float] = [v[k].item() for v in of]
                out[:, :, listed[k]] = one(
                    plain, motion[:, listed[k]].tolist(), h, steps
                )
        change, turn, rolled = out[::-1].swapaxes(0, 1)
        changes = np.stack([change.real, change.imag, turn.real], axis=2)
        return list(
            zip(changes, np.stack([rolled.real, rolled.imag], axis=2), strict=True)
        )

    def _roll_on(
        self, v: Array, spin: Array, roll: Array, h: float, out: Array
    ) -> NDArray[np.int64]:
        """The spheres that roll through all steps, slowing down evenly: their changes are written."""
        r, _, gives, grip, twists, slows = self._of_balls
        v, spin, roll = v[self._balls], spin[self._balls], roll[self._balls]
        slips = abs(v - 1j * r * roll) * gives > 1e-12 * r * abs(roll)
        k = np.flatnonzero(~slips & (grip > 0) & (slows * h * len(out) < abs(roll)))
        part = slows[k] * h / abs(roll[k])
        out[:, 0, self._balls[k]], out[:, 2, self._balls[k]] = (
            -part * v[k],
            -part * roll[k],
        )
        lost = twists[k] * h
        left = abs(spin[k]) - lost * np.arange(len(out))[:, None]
        out[:, 1, self._balls[k]] = -np.sign(spin[k]) * np.clip(left, 0, lost)
        return self._balls[k]


def _path(
    kind: Callable[..., Any], of: list[Array], motion: Array, h: float, steps: int
) -> list[Any]:
    """Changes of velocity, spin and roll in each step, of several bodies."""
    v, spin, roll = motion
    spin, changes = spin.real, []
    for _ in range(steps):
        changes.append(kind(of, v, spin, roll, h))
        v, spin, roll = (
            now + change
            for now, change in zip((v, spin, roll), changes[-1], strict=True)
        )
    return changes


def _slide(
    of: list[Array], v: Array, spin: Array, roll: Array, h: float
) -> tuple[Array, Array, Array]:
    """Changes of discs' velocity, spin and roll, by friction as it is after half the time."""
    half, turn = _slid(of, v, spin, h / 2, v, spin)
    return *_slid(of, v, spin, h, v + half, spin + turn), 0 * roll


def _slid(
    of: list[Array], v: Array, spin: Array, h: float, at: Array, at_spin: Array
) -> tuple[Array, Array]:
    """Changes by friction as it is at other speeds; never beyond rest."""
    grip, mass, patch, moment, ring = of
    pull, twist = _parts(np.arctan2(abs(at), patch * abs(at_spin)), ring)
    now, spins, least = abs(v), abs(spin), grip * h
    # the direction is that of the motion; nothing is turned round by friction
    brake = np.minimum(pull * least, now) / np.maximum(now, 1e-300)
    slowed = np.minimum(twist * grip * mass * patch / moment * h, spins)
    # less than a step before both end, they end
    ends = (spins * moment <= least * mass * patch) & (now + patch * spins <= least)
    return np.where(ends, -v, -brake * v), np.where(
        ends, -spin, np.where(spin > 0, -slowed, slowed)
    )


def _slide_one(
    of: list[float], motion: list[complex], h: float, steps: int
) -> NDArray[np.complex128]:
    """(steps, 3): the same of one disc, in some steps."""
    (grip, mass, patch, moment, ring), (v, spin, _) = of, motion
    _, forces, torques = _listed_shares(bool(ring))
    wide, most = (NODES - 1) / (pi / 2), NODES - 2
    out, turns = np.zeros((steps, 3), complex), spin.real
    for k in range(steps):
        now, spins, sign = abs(v), abs(turns), -1.0 if turns > 0 else 1.0
        change, turn = 0j, 0.0
        for span in (h / 2, h):
            least, place = (
                grip * span,
                atan2(abs(v + change), patch * abs(turns + turn)) * wide,
            )
            node = int(place) if place < most else most
            part = place - node
            pull = forces[node] + part * (forces[node + 1] - forces[node])
            twist = torques[node] + part * (torques[node + 1] - torques[node])
            if now + patch * spins <= least and spins * moment <= least * mass * patch:
                change, turn = -v, -turns
                continue
            change = -(min(pull * least, now) / (now or 1e-300)) * v
            turn = sign * min(twist * grip * mass * patch / moment * span, spins)
        out[k, :2] = change, turn
        v, turns = v + change, turns + turn
        if not (v or turns):
            break
    return out


def _parts(ratio: Array, ring: Any) -> list[Array]:
    """Shares of friction, and of friction x radius, at angles (D,) of discs and rings."""
    (nodes, *disc), (_, *hoop) = _shares(False), _shares(True)
    both = zip(disc, hoop, strict=True)
    return [
        np.where(ring, np.interp(ratio, nodes, b), np.interp(ratio, nodes, a))
        for a, b in both
    ]


def _roll(
    of: list[Array], v: Array, spin: Array, roll: Array, h: float
) -> tuple[Array, Array, Array]:
    """Changes of spheres' velocity, spin and roll."""
    r, lever, gives, grip, lost_sliding, lost_rolling = of
    slip = v - 1j * r * roll  # of the lowest point over the table
    speed = abs(slip)
    stick = speed * gives
    brake = np.minimum(grip * h, stick)
    change = -brake / np.maximum(speed, 1e-300) * slip
    turned = 1j * lever * change
    # a moment of c x normal force x radius; once a ball rolls it slows both motions alike
    rolls, now = brake >= stick * (1 - 1e-12), roll + turned
    stop = np.minimum(
        np.where(rolls, lost_rolling, lost_sliding) * h / np.maximum(abs(now), 1e-300),
        1.0,
    )
    # it brakes a spin on the spot as well: of a billiard ball by 8.6 rad/s², where Alciatore measures 10
    twist = np.where(spin > 0, -1.0, 1.0) * np.minimum(
        np.where(grip > 0, lost_sliding, 0.0) * h, abs(spin)
    )
    return (
        change - np.where(rolls, stop, 0.0) * (v + change),
        twist,
        turned - stop * now,
    )


def _roll_one(
    of: list[float], motion: list[complex], h: float, steps: int
) -> NDArray[np.complex128]:
    """(steps, 3): the same of one sphere, in some steps."""
    (r, lever, gives, grip, lost_sliding, lost_rolling), (v, spin, roll) = of, motion
    out, turns, twists = (
        np.zeros((steps, 3), complex),
        spin.real,
        (lost_sliding if grip > 0 else 0.0) * h,
    )
    across, levers = 1j * r, 1j * lever
    for k in range(steps):
        slip = v - across * roll
        speed = abs(slip)
        stick = speed * gives
        brake = min(grip * h, stick)
        change = -brake / (speed or 1e-300) * slip
        turned = levers * change
        now, rolls = roll + turned, brake >= stick * (1 - 1e-12)
        stop = min(
            (lost_rolling if rolls else lost_sliding) * h / (abs(now) or 1e-300), 1.0
        )
        twist = (-1.0 if turns > 0 else 1.0) * min(twists, abs(turns))
        if rolls:
            change -= stop * (v + change)
        turned -= stop * now
        out[k] = change, twist, turned
        v, turns, roll = v + change, turns + twist, roll + turned
        if not (v or turns or roll):
            break
    return out


@cache
def _listed_shares(ring: bool) -> list[list[float]]:
    return [values.tolist() for values in _shares(ring)]


@cache
def _shares(ring: bool) -> tuple[Array, Array, Array]:
    """Angles atan2(speed, rim speed), and the shares of friction, and of friction x radius, that act at each.

    Averages over the body's area (a uniform disc), or its rim (a hoop), of friction that is against each point's own
    velocity; the disc's are Farkas and others' formulas, in complete elliptic integrals.
    """
    nodes = np.linspace(0, np.pi / 2, NODES)
    if ring:
        turn = (np.arange(720) + 0.5) * (2 * np.pi / 720)
        v, u = np.sin(nodes)[:, None], np.cos(nodes)[:, None]
        vx, vy = v - u * np.sin(turn), u * np.cos(turn)
        size = np.maximum(np.hypot(vx, vy), 1e-300)
        return (
            nodes,
            (vx / size).mean(axis=1),
            ((np.cos(turn) * vy - np.sin(turn) * vx) / size).mean(axis=1),
        )
    ratio = np.tan(nodes[1:-1])
    low = ratio <= 1
    m = np.where(low, ratio, 1 / ratio) ** 2
    K, E = _elliptic(m)
    r2 = ratio**2
    force = (
        4
        / 3
        * np.where(
            low, ((r2 + 1) * E + (r2 - 1) * K) / ratio, (r2 + 1) * E - (r2 - 1) * K
        )
        / np.pi
    )
    inner = (4 - 2 * r2) * E + (r2 - 1) * K
    outer = ratio * ((4 - 2 * r2) * E + (2 * r2 - 5 + 3 / r2) * K)
    torque = 4 / 9 * np.where(low, inner, outer) / np.pi
    return (
        nodes,
        np.concatenate([[0], force, [1]]),
        np.concatenate([[2 / 3], torque, [0]]),
    )


def _elliptic(m: Array) -> tuple[Array, Array]:
    """Complete elliptic integrals K and E of the parameter m < 1, by the arithmetic-geometric mean."""
    a, b = np.ones_like(m), np.sqrt(1 - m)
    lost, power = m / 2, 0.5
    for _ in range(40):
        c = (a - b) / 2
        a, b = (a + b) / 2, np.sqrt(a * b)
        power *= 2
        lost = lost + power * c**2
        if np.all(np.abs(c) <= 1e-16):
            break
    K = np.pi / (2 * a)
    return K, K * (1 - lost)
