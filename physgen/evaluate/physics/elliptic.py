"""Complete elliptic integrals by the arithmetic-geometric mean, and an
integrator of fourth order.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEAN_TOLERANCE = 1e-9
"""Maximum difference of equal means; each iteration squares it."""


def integrate_ellipse(k: float) -> tuple[float, float]:
    """Return K(k) and E(k) of the modulus 0 <= k < 1 (Abramowitz and Stegun 17.6); at 1, infinity and 1.

    >>> [round(value, 12) for value in integrate_ellipse(0.5)]
    [1.685750354813, 1.467462209339]
    """
    if k >= 1:
        return np.inf, 1.0
    # The means of 1 and k' = sqrt(1 - k²) converge to pi/(2 K).
    arithmetic = 1.0
    geometric = sqrt(1 - k * k)
    difference = k
    # E = K (1 - sum of 2^(n-1) c_n²), with the half differences c_n of the means.
    total, power = difference * difference / 2, 0.5
    while difference > MEAN_TOLERANCE:
        mean = (arithmetic + geometric) / 2
        difference = (arithmetic - geometric) / 2
        geometric = sqrt(arithmetic * geometric)
        arithmetic = mean
        power *= 2
        total += power * difference * difference
    first_kind = pi / (2 * arithmetic)
    return first_kind, first_kind * (1 - total)


def runge_kutta(
    rate: Callable[[Array], Array], start: Array, duration: float, steps: int
) -> Array:
    """Return the solution of y' = rate(y) from `start` (D,) at even times, (steps + 1,
    D), by the classical method of fourth order.
    """
    h = duration / steps
    states = [np.asarray(start, np.float64)]
    for _ in range(steps):
        y = states[-1]
        # One slope at the start, two at the middle and one at the end of a step.
        a = rate(y)
        b = rate(y + h / 2 * a)
        c = rate(y + h / 2 * b)
        d = rate(y + h * c)
        slope_sum = a + 2 * b + 2 * c + d
        states.append(y + h / 6 * slope_sum)
    return np.array(states)
