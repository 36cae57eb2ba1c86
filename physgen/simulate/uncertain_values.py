"""Uncertain values of a scene: their distributions and random draws.

The value of the file is the median. One standard deviation is a power of 1 / confidence: as a factor of masses and
coefficients of friction, as a factor of the odds e / (1 - e) of elasticities (docs/rendering.md). What a person set is
certain. A draw depends on the seed, the path of the value and the number of the draw only, so that the k-th draw is
the same for 8 and for 800 draws, and objects keep their draws when others are added or removed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from math import exp, inf, log, sqrt
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.scene.provenance import Provenance, Source, source
from physgen.scene.scene import Boundary, Motion, Object, Scene

Array = NDArray[np.float64]

POWERS = {
    "mass": 1.0,
    "density": 1.0,
    "friction": 0.5,
    "rolling": 0.75,
    "elasticity": 1.0,
}
"""Powers of 1 / confidence in one standard deviation: at 0.5 a mass has a factor of 2, a friction of 1.4."""
MIN_CONFIDENCE = 0.05
"""Lower confidences widen nothing further."""
MAX_VALUES = {"mass": 1e15, "density": inf, "friction": 10.0, "rolling": 10.0}
"""As the schema allows."""
CERTAIN_ELASTICITY = 1e-9
"""Elasticities this close to 0 or 1 are exact."""
OBJECT_PARAMETERS = ("mass", "density", "friction", "elasticity", "rolling")
BOUNDARY_PARAMETERS = ("friction", "elasticity")
AT_LEAST = "lies on a slope"
"""Source of a friction that is at least its value: the object lies still in the photo."""
VAGUE_LABELS = ("", "object", "thing")
"""Objects with these labels need not be of one material."""
NORMAL = NormalDist()


@dataclass(frozen=True)
class Spread:
    """Distribution of a positive number up to `most`, or, with `logit`, of one between 0 and 1."""

    median: float  # before truncation
    sigma: float  # standard deviation of the logarithm, or of the logarithm of the odds
    most: float = inf
    at_least: bool = False  # only the part above the median
    logit: bool = False

    def at(self, z: float) -> float:
        """Return the value at a quantile of the standard normal distribution; rises with `z`."""
        if self.logit:
            return 1 / (1 + (1 - self.median) / self.median * exp(-self.sigma * z))
        if self.at_least or self.most < inf:
            low = 0.5 if self.at_least else 0.0
            high = (
                1.0
                if self.most == inf
                else NORMAL.cdf(log(self.most / self.median) / self.sigma)
            )
            share = low + NORMAL.cdf(z) * (high - low)
            z = NORMAL.inv_cdf(min(max(share, 1e-300), 1 - 2**-53))
        value = self.median * exp(self.sigma * z)
        return min(max(value, self.median) if self.at_least else value, self.most)


def spread(
    parameter: str, value: float, confidence: float, at_least: bool = False
) -> Spread | None:
    """Return the distribution of a value with a confidence of 0..1; None if it is certain.

    >>> wide = spread("mass", 100.0, 0.5)
    >>> [round(wide.at(z), 9) for z in (-1, 0, 1)]
    [50.0, 100.0, 200.0]
    """
    sigma = POWERS[parameter] * -log(min(max(confidence, MIN_CONFIDENCE), 1.0))
    if sigma == 0:
        return None
    if parameter == "elasticity":
        certain = not CERTAIN_ELASTICITY < value < 1 - CERTAIN_ELASTICITY
        return None if certain else Spread(value, sigma, logit=True)
    most = MAX_VALUES[parameter]
    return Spread(value, sigma, most, at_least) if 0 < value < most else None


@dataclass(frozen=True)
class UncertainValue:
    """One value that was guessed."""

    section: str  # `objects` or `boundaries`
    name: str  # of the object or boundary
    parameter: str
    value: float  # in the file
    source: Source
    spread: Spread
    label: str = ""
    """Of the object: what values of one label have in common is drawn once."""
    alike: float = (
        0.0  # 0..1: the part of the variance that all objects of the label share
    )

    @property
    def path(self) -> str:
        """Return the key in the scene file."""
        return f"{self.section}.{self.name}.{self.parameter}"


def uncertain_values(
    scene: Scene, variant: str | None = None
) -> tuple[UncertainValue, ...]:
    """Return every uncertain value, of objects, then of boundaries; `variant` is the one that was applied."""
    provenance = Provenance(scene, variant)
    of_objects = [
        value for item in scene.objects for value in _of_object(scene, item, provenance)
    ]
    of_boundaries = [
        value
        for item in scene.boundaries
        for value in _of_boundary(scene, item, provenance)
    ]
    return (*of_objects, *of_boundaries)


def _of_object(
    scene: Scene, item: Object, provenance: Provenance
) -> Iterator[UncertainValue]:
    path = f"objects.{item.name}"
    label = item.label.strip().lower()
    alike = 0.0
    if (
        label not in VAGUE_LABELS
    ):  # as certain as the label is; 1 where a person wrote it
        origin = item.provenance.get("label")
        of_label = provenance.of(
            f"{path}.label", origin, written_at=f"{path}.from.label"
        )
        alike = (
            1.0
            if origin is None or of_label.kind != "guess"
            else source(origin).sure or 0.0
        )
    for parameter in OBJECT_PARAMETERS:
        value = getattr(item, parameter)
        if value is None or parameter not in item.provenance:
            continue
        if parameter in ("mass", "density") and item.motion is not Motion.DYNAMIC:
            continue
        found = provenance.of(
            f"{path}.{parameter}",
            item.provenance[parameter],
            written_at=f"{path}.from.{parameter}",
        )
        at_least = parameter == "friction" and found.text == AT_LEAST
        made = (
            None
            if found.sure is None
            else spread(parameter, value, found.sure, at_least)
        )
        if made is not None:
            yield UncertainValue(
                "objects", item.name, parameter, value, found, made, label, alike
            )


def _of_boundary(
    scene: Scene, item: Boundary, provenance: Provenance
) -> Iterator[UncertainValue]:
    origin = scene.document["boundaries"][item.name].get("from")
    path = f"boundaries.{item.name}"
    for parameter in BOUNDARY_PARAMETERS if origin is not None else ():
        found = provenance.of(f"{path}.{parameter}", origin, written_at=f"{path}.from")
        value = getattr(item, parameter)
        made = None if found.sure is None else spread(parameter, value, found.sure)
        if made is not None:
            yield UncertainValue("boundaries", item.name, parameter, value, found, made)


def draw_values(values: Sequence[UncertainValue], seed: int, count: int) -> Array:
    """Return draws (count, P) of all values; objects of one label are of one material, so theirs are correlated."""

    @cache
    def normal(*key: str) -> Array:
        return np.array(
            [
                NORMAL.inv_cdf(max(share, 2**-54))
                for share in uniform(seed, count, *key).tolist()
            ]
        )

    def column(value: UncertainValue) -> list[float]:
        z = np.zeros(count)
        if value.alike > 0:
            z += sqrt(value.alike) * normal("label", value.label, value.parameter)
        if value.alike < 1:
            z += sqrt(1 - value.alike) * normal(
                value.section, value.name, value.parameter
            )
        return [value.spread.at(each) for each in z.tolist()]

    return np.array([column(value) for value in values]).T.reshape(count, len(values))


def uniform(seed: int, count: int, *key: str) -> Array:
    """Return uniform draws (count,) in 0..1: the first ones of a stream for every `key`."""
    digest = sha256("\0".join((str(seed), *key)).encode()).digest()
    return np.random.Generator(
        np.random.Philox(key=int.from_bytes(digest[:16], "big"))
    ).random(count)


def with_draw(scene: Scene, values: Sequence[UncertainValue], draw: Array) -> Scene:
    """Return the scene with the numbers `(P,)` of one draw."""
    edits: dict[tuple[str, str], dict[str, float]] = {}
    for value, number in zip(values, draw.tolist(), strict=True):
        edits.setdefault((value.section, value.name), {})[value.parameter] = number

    def edited(section: str, item: Any) -> Any:
        changes = edits.get((section, item.name))
        return replace(item, **changes) if changes else item

    return replace(
        scene,
        objects=tuple(edited("objects", item) for item in scene.objects),
        boundaries=tuple(edited("boundaries", item) for item in scene.boundaries),
    )
