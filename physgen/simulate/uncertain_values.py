"""Uncertain values of a scene: their distributions and random draws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from math import atan, exp, inf, log, pi, sqrt
from statistics import NormalDist
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from physgen.scene.provenance import Provenance, Source, source
from physgen.scene.scene import Boundary, Motion, Object, Scene

# ----------------------------------------------------------------------
# A number and how sure somebody is of it -> the distribution that it is drawn from.
#
# The number of the file is the median, and one standard deviation is a power of 1 / confidence: as a factor
# of masses
# and coefficients of friction, as a factor of the odds e / (1 - e) of elasticities. docs/fan.md says why.

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


# ----------------------------------------------------------------------
# Scene -> which of its numbers somebody guessed, and how each is spread; what a person set is certain.

PARAMETERS = ("mass", "density", "friction", "elasticity", "rolling")
"""Of objects, that are drawn."""
OF_WALLS = ("friction", "elasticity")
AT_LEAST = "lies on a slope"
"""Who says so of a friction says that it is no smaller: the thing lies still in the photo."""
VAGUE = ("", "object", "thing")
"""Labels that tell nothing of what is alike."""


@dataclass(frozen=True)
class UncertainValue:
    """One number that somebody guessed."""

    section: str
    """`objects` or `boundaries`."""
    thing: str
    """Name of the object or boundary."""
    parameter: str
    value: float
    """As the file has it."""
    source: Source
    spread: Spread
    label: str = ""
    """What kind of thing it is, for what is alike."""
    alike: float = 0.0
    """0..1: how much of what is open about it is open in the same way about everything of its label."""

    @property
    def path(self) -> str:
        """Where it is written."""
        return f"{self.section}.{self.thing}.{self.parameter}"


@dataclass(frozen=True)
class UncertainLight:
    """A direction of light that somebody guessed."""

    source: Source
    cone: Cone


def uncertain_values(scene: Scene, variant: str | None = None) -> tuple[UncertainValue, ...]:
    """Every number that is drawn, of objects, then of boundaries; `variant` is the one that was applied."""
    said = Provenance(scene, variant)
    of_objects = [one for item in scene.objects for one in _of_object(scene, item, said)]
    return (*of_objects, *(one for item in scene.boundaries for one in _of_wall(scene, item, said)))


def uncertain_light(scene: Scene, variant: str | None = None) -> UncertainLight | None:
    """How sure the light's direction is; None where it is certain, or where there is no light."""
    if scene.light is None or not scene.light.provenance:
        return None
    told = Provenance(scene, variant).of("light.direction", scene.light.provenance, told="light.from")
    found = None if told.sure is None else cone(scene.light.direction, told.sure)
    return None if found is None else UncertainLight(told, found)


def _of_object(scene: Scene, item: Object, said: Provenance) -> Iterator[UncertainValue]:
    path = f"objects.{item.name}"
    alike = _alike(scene, item, said)
    for parameter in PARAMETERS:
        value = getattr(item, parameter)
        weighs = parameter in ("mass", "density")
        if (
            value is None
            or parameter not in item.provenance
            or (weighs and item.motion is not Motion.DYNAMIC)
        ):
            continue
        told = said.of(f"{path}.{parameter}", item.provenance[parameter], told=f"{path}.from.{parameter}")
        if told.sure is None:
            continue
        at_least = parameter == "friction" and told.text == AT_LEAST
        if (found := spread(parameter, value, told.sure, at_least)) is not None:
            kind = item.label.strip().lower()
            yield UncertainValue("objects", item.name, parameter, value, told, found, kind, alike)


def _of_wall(scene: Scene, item: Boundary, said: Provenance) -> Iterator[UncertainValue]:
    who = scene.document["boundaries"][item.name].get("from")
    if who is None:
        return
    path = f"boundaries.{item.name}"
    for parameter in OF_WALLS:
        told = said.of(f"{path}.{parameter}", who, told=f"{path}.from")
        value = getattr(item, parameter)
        if told.sure is not None and (found := spread(parameter, value, told.sure)) is not None:
            yield UncertainValue("boundaries", item.name, parameter, value, told, found)


def _alike(scene: Scene, item: Object, said: Provenance) -> float:
    """As sure as its label is, 1 where a person said it: things of one kind are of one matter."""
    if item.label.strip().lower() in VAGUE:
        return 0.0
    who = item.provenance.get("label")
    told = said.of(f"objects.{item.name}.label", who, told=f"objects.{item.name}.from.label")
    return 1.0 if who is None or told.kind != "guess" else source(who).sure or 0.0


# ----------------------------------------------------------------------
# Doubts and a seed -> draws. A draw depends on the seed, on what is drawn and on its own number, on nothing
# else.
#
# So the k-th draw is the same in a fan of 8 and of 800, and things keep their draws when others are added or
# taken away.

DRAWS_MOST = 2**-54
"""The least share that is drawn: 0 has no quantile."""


def numbers(doubts: Sequence[UncertainValue], seed: int, count: int) -> Array:
    """(count, P): what is drawn of each doubt.

    What is open about things of one label is open in the same way, as far as they are alike: nine dominoes are of one
    wood, whatever wood that is.
    """

    @cache
    def normal(*key: str) -> Array:
        return np.array(
            [NORMAL.inv_cdf(max(share, DRAWS_MOST)) for share in shares(seed, count, *key).tolist()]
        )

    def column(doubt: UncertainValue) -> list[float]:
        z = np.zeros(count)
        if doubt.alike > 0:
            z += sqrt(doubt.alike) * normal("label", doubt.label, doubt.parameter)
        if doubt.alike < 1:
            z += sqrt(1 - doubt.alike) * normal(doubt.section, doubt.thing, doubt.parameter)
        return [doubt.spread.at(value) for value in z.tolist()]

    return np.array([column(doubt) for doubt in doubts]).T.reshape(count, len(doubts))


def directions(doubt: UncertainLight, seed: int, count: int) -> Array:
    """(count, 3) unit vectors towards the light."""
    off, turns = shares(seed, count, "light", "off"), shares(seed, count, "light", "turn")
    return np.array([doubt.cone.at(*pair) for pair in zip(off.tolist(), turns.tolist(), strict=True)])


def shares(seed: int, count: int, *key: str) -> Array:
    """(count,) in 0..1, evenly: a stream of its own for every `key`, of which the first `count` are taken."""
    text = "\0".join((str(seed), *key))
    stream = np.random.Generator(
        np.random.Philox(key=int.from_bytes(sha256(text.encode()).digest()[:16], "big"))
    )
    return stream.random(count)


def drawn(scene: Scene, doubts: Sequence[UncertainValue], values: Array) -> Scene:
    """The scene with its doubtful numbers as one draw `(P,)` has them."""
    edits: dict[tuple[str, str], dict[str, float]] = {}
    for doubt, value in zip(doubts, values.tolist(), strict=True):
        edits.setdefault((doubt.section, doubt.thing), {})[doubt.parameter] = value

    def edited(section: str, item: Any) -> Any:
        changes: Mapping[str, float] = edits.get((section, item.name), {})
        return replace(item, **changes) if changes else item

    return replace(
        scene,
        objects=tuple(edited("objects", item) for item in scene.objects),
        boundaries=tuple(edited("boundaries", item) for item in scene.boundaries),
    )
