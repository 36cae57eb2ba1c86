"""A uniform disc that slides and spins on a table: friction's force and moment, and the motion to rest.

Farkas, Bartels, Unger and Wolf, Frictional coupling between sliding and spinning motion, Phys. Rev. Lett. 90, 248302
(2003). With epsilon = v/(R w), the force is mu m g F(epsilon) against the sliding, the moment mu m g R T(epsilon)
against the spin; F and T come from integrating the direction of slip over the disc, with pressure even all over.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.elliptic import complete, runge_kutta

Array = NDArray[np.float64]


def coupling(epsilon: float) -> tuple[float, float]:
    """F and T of one ratio, between 0 and infinity.

    >>> [tuple(round(f, 6) for f in coupling(e)) for e in (0.0, 1.0, 1e9)]
    [(0.0, 0.666667), (0.848826, 0.282942), (1.0, 0.0)]
    """
    if epsilon < 1e-6:
        return epsilon, 2 / 3
    if epsilon > 1e6:
        return 1.0, 1 / (4 * epsilon)
    squared = epsilon * epsilon
    if epsilon == 1:
        return 8 / (3 * pi), 8 / (9 * pi)
    if epsilon < 1:
        first, second = complete(epsilon)
        return (
            4 / (3 * pi * epsilon) * ((squared + 1) * second + (squared - 1) * first),
            4 / (9 * pi) * ((4 - 2 * squared) * second + (squared - 1) * first),
        )
    first, second = complete(1 / epsilon)
    return (
        4 / (3 * pi) * ((squared + 1) * second - (squared - 1) * first),
        4
        / (9 * pi)
        * epsilon
        * ((4 - 2 * squared) * second + (2 * squared - 5 + 3 / squared) * first),
    )


@dataclass(frozen=True)
class Stop:
    """How a disc comes to rest."""

    times: Array
    """(K,) s, 0 to the end."""
    speeds: Array
    """(K,) px/s."""
    spins: Array
    """(K,) rad/s."""
    way: float
    """px."""
    turned: float
    """rad."""


def stop(speed: float, spin: float, radius: float, mu: float, gravity: float) -> Stop:
    """From `speed` (px/s) and `spin` (rad/s) to rest, with I = m R²/2; exact to about 1e-5.

    Steps shrink with what is left of the motion: both vanish at once, with epsilon tending to 0.653.
    """

    def rate(state: Array) -> Array:
        v, u = max(state[0], 0.0), max(state[1], 0.0)  # u = R w
        force, moment = coupling(v / u if u > 1e-12 * v else 1e12)
        return np.array([-mu * gravity * force, -2 * mu * gravity * moment, v, u])

    state = np.array([speed, abs(spin) * radius, 0.0, 0.0])
    start = left = float(np.hypot(state[0], state[1]))
    times, states = [0.0], [state]
    while left > 1e-5 * start:
        step = 0.01 * left / (mu * gravity)
        state = runge_kutta(rate, state, step, 1)[-1]
        left = float(np.hypot(state[0], state[1]))
        times.append(times[-1] + step)
        states.append(state)
    speeds, surface, ways, turns = np.transpose(states)
    sign = 1 if spin >= 0 else -1
    return Stop(
        np.array(times),
        speeds,
        sign * surface / radius,
        float(ways[-1]),
        sign * float(turns[-1]) / radius,
    )
