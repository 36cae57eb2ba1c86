"""Friction on a table seen from above, and rolling resistance seen from the side.

A disc's sliding and spinning share one friction: both end together (Farkas, Bartels, Unger, Wolf, Phys. Rev. Lett. 90,
248302, 2003). A sphere touches the table at one point: it slides until that point stands still, then rolls.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from physgen.compile.world import World
from physgen.scene.scene import Motion, Solid
from physgen.simulate.contacts import Array, Touching

Pair = tuple[int, int]
"""Two bodies; -1 for the world."""


class Resistance:
    """Brakes between round bodies and what they roll on; solved with the contacts, so that they hold at rest."""

    def __init__(self, world: World) -> None:
        self._lever = np.array(
            [
                b.rolling * b.radius if b.radius is not None and b.motion is Motion.DYNAMIC else 0.0
                for b in world.bodies
            ]
            + [0.0] * len(world.walls)
        )
        self._bodies = len(world.bodies)
        self._static = [b.motion is Motion.STATIC for b in world.bodies] + [True] * len(world.walls)
        self.busy = bool(self._lever.any()) and world.press == 0
        self.torques: dict[Pair, float] = {}
        """Of the brakes in the next step, by the normal forces of the last one, g·px²/s²."""

    def settle(self, braked: Mapping[Pair, float], touch: Touching, mean: Array, h: float) -> float:
        """Energy that the brakes took in a step of mean velocities (N, 3), g·px²/s²; sets the next torques.

        `braked`: the size of the angular impulse that each brake gave, g·px²/s.
        """
        lost = 0.0
        for (first, second), impulse in braked.items():
            against = mean[second, 2] if second >= 0 else 0.0
            lost += impulse * abs(float(mean[first, 2] - against))
        self.torques = dict.fromkeys(self.torques, 0.0)
        normal = np.abs((touch.impulse * touch.normal).sum(axis=1))
        order = np.lexsort((normal, touch.second, touch.first))
        for k in order.tolist():
            a, b = int(touch.first[k]), int(touch.second[k])
            lever = self._lever[a] + self._lever[b]
            if lever > 0:
                if self._lever[a] == 0:
                    a, b = b, a
                if self._lever[a] > 0 and b < self._bodies and self._lever[b] > 0:
                    a, b = min(a, b), max(a, b)
                key = (a, -1 if self._static[b] else b)
                self.torques[key] = self.torques.get(key, 0.0) + lever * float(normal[k]) / h
        return lost


NODES = 1024
"""Of the tables of friction by the ratio of sliding to spinning."""


class Table:
    """Friction on the N bodies of a world; idle seen from the side."""

    def __init__(self, world: World) -> None:
        bodies = world.bodies
        grip = np.array([b.surface.friction * world.table.friction for b in bodies]).reshape(-1)
        rolling = np.array([b.rolling for b in bodies]).reshape(-1)
        on = np.array([b.motion is Motion.DYNAMIC for b in bodies], bool)
        ball = np.array([b.solid is Solid.SPHERE and b.radius is not None for b in bodies], bool)
        self.busy = bool(world.press > 0 and (on & ((grip > 0) | (ball & (rolling > 0)))).any())
        self._balls = np.flatnonzero(on & ball)
        self._discs = np.flatnonzero(on & ~ball & (grip > 0))
        mass, moment, patch = np.array([(b.mass, b.moment, b.patch) for b in bodies]).reshape(-1, 3).T
        ring = np.array([b.solid is Solid.HOOP for b in bodies], bool).reshape(-1)
        self._of_discs = tuple(
            values[self._discs] for values in (grip * world.press, mass, patch, moment, ring)
        )
        """(D,) each; the first, px/s², is the deceleration of what slides without spinning."""
        self._ringed = bool(ring[self._discs].any())
        k = self._balls
        m, inertia = mass[k], moment[k]
        r = np.array([b.radius or 0.0 for b in bodies]).reshape(-1)[k]
        share = m * r**2 / np.maximum(inertia, 1e-300)  # of a solid sphere 5/2
        self._r, self._lever, self._yield = r, share / np.maximum(r, 1e-300), 1 / (1 + share)
        self._brake, slow = grip[k] * world.press, rolling[k] * world.press / np.maximum(r, 1e-300)
        self._lost_sliding, self._lost_rolling = slow * share, slow * share / (1 + share)
        self._resists = bool(slow.any())

    def kick(self, velocity: Array, roll: Array, h: float) -> tuple[Array, Array]:
        """Changes of velocity (N, 3) and roll (N, 2) in h seconds; velocity holds all other forces' doing already."""
        change, turned = np.zeros_like(velocity), np.zeros_like(roll)
        if len(self._discs):
            on = self._discs
            half = velocity[on] + self._slide(velocity[on], h / 2)
            full = self._slide(velocity[on], h, half)
            change[on] = full
        if len(self._balls) == len(velocity):
            self._rolled(velocity, roll, h, change, turned)
        elif len(self._balls):
            k = self._balls
            pushed, rolled = change[k], turned[k]
            self._rolled(velocity[k], roll[k], h, pushed, rolled)
            change[k], turned[k] = pushed, rolled
        return change, turned

    def _slide(self, velocity: Array, h: float, at: Array | None = None) -> Array:
        """(D, 3): change by friction as it is at the velocity `at`; never beyond rest."""
        at = velocity if at is None else at
        grip, mass, patch, moment, ring = self._of_discs
        ratio = np.arctan2(np.hypot(at[:, 0], at[:, 1]), patch * np.abs(at[:, 2]))
        nodes, force, torque = _shares(False)
        pull, twist = np.interp(ratio, nodes, force), np.interp(ratio, nodes, torque)
        if self._ringed:
            nodes, force, torque = _shares(True)
            pull = np.where(ring, np.interp(ratio, nodes, force), pull)
            twist = np.where(ring, np.interp(ratio, nodes, torque), twist)
        change = np.empty_like(velocity)
        now, spins = np.hypot(velocity[:, 0], velocity[:, 1]), np.abs(velocity[:, 2])
        # the direction is that of the motion; nothing is turned round by friction
        brake = np.minimum(pull * grip * h, now)
        change[:, :2] = -(brake / np.maximum(now, 1e-300))[:, None] * velocity[:, :2]
        spin = twist * grip * mass * patch / moment * h
        change[:, 2] = -np.sign(velocity[:, 2]) * np.minimum(spin, spins)
        # less than a step before both end, they end
        least = grip * h
        left = now <= least
        if left.any():
            left &= spins * moment <= least * mass * patch
            left &= (now + patch * spins) <= least
            change[left] = -velocity[left]
        return change

    def _rolled(self, velocity: Array, roll: Array, h: float, change: Array, turned: Array) -> None:
        """Write the changes of B spheres' velocities and rolls."""
        vx, vy, wx, wy = velocity[:, 0], velocity[:, 1], roll[:, 0], roll[:, 1]
        sx, sy = vx + self._r * wy, vy - self._r * wx  # of the lowest point over the table
        speed = np.sqrt(sx * sx + sy * sy)
        stick = speed * self._yield
        brake = np.minimum(self._brake * h, stick)
        part = brake / np.maximum(speed, 1e-300)
        dx, dy = -part * sx, -part * sy
        tx, ty = -self._lever * dy, self._lever * dx
        if self._resists:
            # a moment of c x normal force x radius; once a ball rolls it slows both motions alike
            rolls = brake >= stick * (1 - 1e-12)
            nx, ny = wx + tx, wy + ty
            now = np.sqrt(nx * nx + ny * ny)
            lost = np.where(rolls, self._lost_rolling, self._lost_sliding) * h
            stop = np.minimum(lost / np.maximum(now, 1e-300), 1.0)
            tx, ty = tx - stop * nx, ty - stop * ny
            stop = np.where(rolls, stop, 0.0)
            dx, dy = dx - stop * (vx + dx), dy - stop * (vy + dy)
        change[:, 0], change[:, 1] = dx, dy
        turned[:, 0], turned[:, 1] = tx, ty


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
        return nodes, (vx / size).mean(axis=1), ((np.cos(turn) * vy - np.sin(turn) * vx) / size).mean(axis=1)
    ratio = np.tan(nodes[1:-1])
    low = ratio <= 1
    m = np.where(low, ratio, 1 / ratio) ** 2
    K, E = _elliptic(m)
    r2 = ratio**2
    force = 4 / 3 * np.where(low, ((r2 + 1) * E + (r2 - 1) * K) / ratio, (r2 + 1) * E - (r2 - 1) * K) / np.pi
    inner = (4 - 2 * r2) * E + (r2 - 1) * K
    outer = ratio * ((4 - 2 * r2) * E + (2 * r2 - 5 + 3 / r2) * K)
    torque = 4 / 9 * np.where(low, inner, outer) / np.pi
    return nodes, np.concatenate([[0], force, [1]]), np.concatenate([[2 / 3], torque, [0]])


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
