"""A uniform disc sliding and spinning on a table: force and moment of friction, and the
motion to rest.

Farkas, Bartels, Unger and Wolf, Frictional coupling between sliding and spinning
motion, Phys. Rev. Lett. 90, 248302 (2003). With epsilon = v/(R w), the force is mu m g
F(epsilon) against the sliding, the moment mu m g R T(epsilon) against the spin. F and T
integrate the direction of slip over the disc, with even pressure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.physics.elliptic import integrate_ellipse, runge_kutta

Array = NDArray[np.float64]

SPIN_ONLY, SLIDE_ONLY = 1e-6, 1e6
"""Ratios with exact limits of F and T: below the first and above the second."""
NO_SPIN = 1e-12
"""Ratio of surface speed to sliding speed at which epsilon is set to the inverse."""
REST = 1e-5
"""Remaining part of the first motion of a resting disc."""
STEP_PART = 0.01
"""Length of a step over the time left to rest."""


def couple(epsilon: float) -> tuple[float, float]:
    """Return F and T of one ratio between 0 and infinity.

    >>> [tuple(round(f, 6) for f in couple(e)) for e in (0.0, 1.0, 1e9)]
    [(0.0, 0.666667), (0.848826, 0.282942), (1.0, 0.0)]
    """
    # At the limits, the elliptic integrals lose all digits to cancellation.
    if epsilon < SPIN_ONLY:
        return epsilon, 2 / 3
    if epsilon > SLIDE_ONLY:
        return 1.0, 1 / (4 * epsilon)
    square = epsilon * epsilon
    if epsilon == 1:
        return 8 / (3 * pi), 8 / (9 * pi)
    # Equations 4 and 5 of the paper, with the modulus epsilon below 1 and its inverse
    # above.
    if epsilon < 1:
        first_kind, second_kind = integrate_ellipse(epsilon)
        force = (square + 1) * second_kind + (square - 1) * first_kind
        moment = (4 - 2 * square) * second_kind + (square - 1) * first_kind
        return 4 / (3 * pi * epsilon) * force, 4 / (9 * pi) * moment
    first_kind, second_kind = integrate_ellipse(1 / epsilon)
    force = (square + 1) * second_kind - (square - 1) * first_kind
    first_factor = 2 * square - 5 + 3 / square
    moment = (4 - 2 * square) * second_kind + first_factor * first_kind
    return 4 / (3 * pi) * force, 4 / (9 * pi) * epsilon * moment


@dataclass(frozen=True)
class Stop:
    """The motion of a disc to rest."""

    times: Array
    """(K,) s, 0 to the end."""
    speeds: Array
    """(K,) px/s."""
    spins: Array
    """(K,) rad/s."""
    distance: float
    """px."""
    rotation: float
    """rad."""


def _deceleration(mu: float, gravity: float) -> Callable[[Array], Array]:
    """Return the rate of change of the state v, R w, distance and R angle."""

    def rate(state: Array) -> Array:
        sliding = max(state[0], 0.0)
        surface = max(state[1], 0.0)
        # Without spin the ratio is infinite: a large number has the same limits.
        ratio = 1 / NO_SPIN
        if surface > NO_SPIN * sliding:
            ratio = sliding / surface
        force, moment = couple(ratio)
        slowing = -mu * gravity * force
        # I = m R²/2 doubles the effect of the moment on R w.
        return np.array([slowing, -2 * mu * gravity * moment, sliding, surface])

    return rate


def stop(speed: float, spin: float, radius: float, mu: float, gravity: float) -> Stop:
    """Return the motion from `speed` (px/s) and `spin` (rad/s) to rest, with I = m
    R²/2; exact to about 1e-5.

    Steps shrink with the remaining motion: speed and spin vanish together, with epsilon
    tending to 0.653.
    """
    rate = _deceleration(mu, gravity)
    state = np.array([speed, abs(spin) * radius, 0.0, 0.0])
    first_motion = motion = float(np.hypot(state[0], state[1]))
    times, states = [0.0], [state]
    while motion > REST * first_motion:
        # The time left to rest is about the motion over mu g.
        step = STEP_PART * motion / (mu * gravity)
        state = runge_kutta(rate, state, step, 1)[-1]
        motion = float(np.hypot(state[0], state[1]))
        times.append(times[-1] + step)
        states.append(state)
    speeds, surface_speeds, _, _ = np.transpose(states)
    sign = 1
    if spin < 0:
        sign = -1
    return Stop(
        times=np.array(times),
        speeds=speeds,
        spins=sign * surface_speeds / radius,
        distance=float(state[2]),
        rotation=sign * float(state[3]) / radius,
    )
