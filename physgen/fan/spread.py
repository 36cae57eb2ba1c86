"""A number and how sure somebody is of it -> the distribution that it is drawn from.

The number of the file is the median, and one standard deviation is a power of 1 / confidence: as a factor of masses
and coefficients of friction, as a factor of the odds e / (1 - e) of elasticities. docs/fan.md says why.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, exp, inf, log, pi, sqrt
from statistics import NormalDist
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POWERS = {"mass": 1.0, "density": 1.0, "friction": 0.5, "rolling": 0.75, "elasticity": 1.0}
"""Of 1 / confidence in one standard deviation: confidence 0.5 is a factor of 2 of a mass and of 1.4 of a friction."""
LEAST_SURE = 0.05
"""Confidence below which nothing gets wider."""
CONCENTRATION = 10.0
"""Of light's directions where the confidence is 1 / e: directions are 26 degrees off, as root mean square."""
MOST = {"mass": 1e15, "density": inf, "friction": 10.0, "rolling": 10.0}
"""As the schema allows them."""
EDGE = 1e-9
"""Elasticities as near to 0 or 1 as this are meant to be just that."""
NORMAL = NormalDist()


class Spread(Protocol):
    """A distribution on a part of the line."""

    @property
    def name(self) -> str:
        """Of its family."""

    def at(self, z: float) -> float:
        """The value at a quantile of the standard normal distribution; rises with `z`."""

    def below(self, value: float) -> float:
        """0..1: the share of draws that are at most `value`."""


@dataclass(frozen=True)
class LogNormal:
    """exp of a normal distribution, cut off above `most`."""

    median: float
    """Of the distribution without the cut."""
    sigma: float
    """Standard deviation of the logarithm."""
    most: float = inf
    name: str = "log-normal"

    @property
    def _kept(self) -> float:
        return 1.0 if self.most == inf else NORMAL.cdf(log(self.most / self.median) / self.sigma)

    def at(self, z: float) -> float:
        """The value at a quantile of the standard normal distribution."""
        kept = self._kept
        return min(
            self.median * exp(self.sigma * (z if kept == 1 else _normal(NORMAL.cdf(z) * kept))), self.most
        )

    def below(self, value: float) -> float:
        """0..1: the share of draws that are at most `value`."""
        if value <= 0:
            return 0.0
        return min(NORMAL.cdf(log(value / self.median) / self.sigma) / self._kept, 1.0)


@dataclass(frozen=True)
class AtLeast:
    """The upper half of a log-normal distribution: `least` is known to be reached, by how much more is not."""

    least: float
    sigma: float
    most: float = inf
    name: str = "log-normal above its median"

    @property
    def _kept(self) -> float:
        return 1.0 if self.most == inf else 2 * NORMAL.cdf(log(self.most / self.least) / self.sigma) - 1

    def at(self, z: float) -> float:
        """The value at a quantile of the standard normal distribution."""
        above = _normal(0.5 + NORMAL.cdf(z) * self._kept / 2)
        return min(self.least * exp(self.sigma * max(above, 0.0)), self.most)

    def below(self, value: float) -> float:
        """0..1: the share of draws that are at most `value`."""
        if value <= self.least:
            return 0.0
        return min((2 * NORMAL.cdf(log(value / self.least) / self.sigma) - 1) / self._kept, 1.0)


@dataclass(frozen=True)
class LogitNormal:
    """A number between 0 and 1 whose odds are log-normal."""

    median: float
    sigma: float
    """Standard deviation of the logarithm of the odds."""
    name: str = "logit-normal"

    def at(self, z: float) -> float:
        """The value at a quantile of the standard normal distribution."""
        return 1 / (1 + (1 - self.median) / self.median * exp(-self.sigma * z))

    def below(self, value: float) -> float:
        """0..1: the share of draws that are at most `value`."""
        if not 0 < value < 1:
            return float(value >= 1)
        return NORMAL.cdf(log(value / (1 - value) * (1 - self.median) / self.median) / self.sigma)


def spread(parameter: str, value: float, sure: float, at_least: bool = False) -> Spread | None:
    """Of `value`, said with the confidence `sure`, 0..1; None where it is a point.

    >>> wide = spread("mass", 100.0, 0.5)
    >>> [round(wide.at(z), 9) for z in (-1, 0, 1)]
    [50.0, 100.0, 200.0]
    """
    sigma = POWERS[parameter] * -log(min(max(sure, LEAST_SURE), 1.0))
    if sigma == 0:
        return None
    if parameter == "elasticity":
        return LogitNormal(value, sigma) if EDGE < value < 1 - EDGE else None
    most = MOST[parameter]
    if not 0 < value < most:
        return None
    return AtLeast(value, sigma, most) if at_least else LogNormal(value, sigma, most)


@dataclass(frozen=True)
class Cone:
    """Directions about one, as von Mises and Fisher have them (Fisher, Proc. R. Soc. A 217, 295, 1953)."""

    direction: tuple[float, float, float]
    concentration: float

    def at(self, share: float, turn: float) -> Array:
        """(3,) the unit vector as far off that `share` of all are nearer, 0..1, and `turn` of a circle about."""
        k = self.concentration
        c = min(max(1 + np.log1p(-share * -np.expm1(-2 * k)) / k, -1.0), 1.0)
        axis = np.array(self.direction, np.float64)
        first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        about = np.cos(2 * pi * turn) * first + np.sin(2 * pi * turn) * second
        return np.asarray(c * axis + sqrt(1 - c * c) * about)

    def within(self, angle: float) -> float:
        """0..1: the share of directions that are at most `angle` rad off."""
        k = self.concentration
        return float(np.expm1(-k * (1 - np.cos(angle))) / np.expm1(-2 * k))


def cone(direction: tuple[float, float, float], sure: float) -> Cone | None:
    """Of a light's direction, said with the confidence `sure`; None where it is a point."""
    vague = -log(min(max(sure, LEAST_SURE), 1.0))
    return None if vague == 0 else Cone(direction, CONCENTRATION / vague)


def widest(concentration: float, share: float = 0.9) -> float:
    """rad within which `share` of directions lie.

    >>> round(float(np.degrees(widest(100.0))), 1)
    12.3
    """
    c = 1 + np.log1p(-share * -np.expm1(-2 * concentration)) / concentration
    return 2 * atan(sqrt((1 - c) / (1 + c))) if c > -1 else pi


def _normal(share: float) -> float:
    """The quantile of the standard normal distribution, for shares that floats round to 0 and 1, too."""
    return NORMAL.inv_cdf(min(max(share, 1e-300), 1 - 2**-53))
