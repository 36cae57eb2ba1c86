"""Uncertain values of a scene: their distributions and random draws.

The value of the file is the median. The standard deviation is a power of 1 /
confidence: as a factor of masses and coefficients of friction, as a factor of the odds
e / (1 - e) of elasticities (docs/rendering.md). A value set by a person is certain. A
draw depends only on the seed, the path of the value and the number of the draw, so that
the k-th draw is the same for 8 and for 800 draws, and objects keep their draws when
others are added or removed.
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
"""Powers of 1 / confidence in one standard deviation: at a confidence of 0.5, a mass
has a factor of 2, a friction of 1.4.
"""
MIN_CONFIDENCE = 0.05
"""Smallest confidence; distributions do not widen below it."""
MAX_VALUES = {"mass": 1e15, "density": inf, "friction": 10.0, "rolling": 10.0}
"""Upper limits of the schema."""
CERTAIN_ELASTICITY = 1e-9
"""Distance from 0 or 1 within which an elasticity is exact."""
OBJECT_PARAMETERS = ("mass", "density", "friction", "elasticity", "rolling")
BOUNDARY_PARAMETERS = ("friction", "elasticity")
AT_LEAST = "lies on a slope"
"""Source of a friction that is a lower limit: the object lies still in the photo."""
VAGUE_LABELS = ("", "object", "thing")
"""Labels of objects that need not be of one material."""
NORMAL = NormalDist()


@dataclass(frozen=True)
class Spread:
    """Distribution of a positive number up to `maximum`, or, with `logit`, of one
    in 0..1.
    """

    median: float  # before truncation
    sigma: float  # standard deviation of the logarithm, or of the logarithm of the odds
    maximum: float = inf
    is_upper_half: bool = False  # only the part above the median
    logit: bool = False

    def quantile(self, z: float) -> float:
        """Return the value at a quantile `z` of the standard normal distribution; rises
        with `z`.
        """
        if self.logit:
            return 1 / (1 + (1 - self.median) / self.median * exp(-self.sigma * z))
        if self.is_upper_half or self.maximum < inf:
            # A truncated distribution: map the quantile to the permitted range of
            # probabilities.
            low_share = 0.0
            if self.is_upper_half:
                low_share = 0.5
            if self.maximum == inf:
                high_share = 1.0
            else:
                high_share = NORMAL.cdf(log(self.maximum / self.median) / self.sigma)
            share = low_share + NORMAL.cdf(z) * (high_share - low_share)
            z = NORMAL.inv_cdf(min(max(share, 1e-300), 1 - 2**-53))
        value = self.median * exp(self.sigma * z)
        return min(
            max(value, self.median) if self.is_upper_half else value, self.maximum
        )


def spread(
    parameter: str, value: float, confidence: float, is_upper_half: bool = False
) -> Spread | None:
    """Return the distribution of a value with a confidence of 0..1; None if it is
    certain.

    >>> wide = spread("mass", 100.0, 0.5)
    >>> [round(wide.quantile(z), 9) for z in (-1, 0, 1)]
    [50.0, 100.0, 200.0]
    """
    # A confidence of 1 gives no spread, and a small one a finite spread.
    sigma = POWERS[parameter] * -log(min(max(confidence, MIN_CONFIDENCE), 1.0))
    if sigma == 0:
        return None
    if parameter == "elasticity":
        # A value at an end of its range is meant: "does not bounce" has no spread.
        is_certain = not CERTAIN_ELASTICITY < value < 1 - CERTAIN_ELASTICITY
        if is_certain:
            return None
        return Spread(value, sigma, logit=True)
    maximum = MAX_VALUES[parameter]
    if 0 < value < maximum:
        return Spread(value, sigma, maximum, is_upper_half)
    return None


@dataclass(frozen=True)
class UncertainValue:
    """One guessed value."""

    section: str  # `objects` or `boundaries`
    name: str  # name of the object or boundary
    parameter: str
    value: float  # value in the file
    source: Source
    spread: Spread
    label: str = ""
    """Label of the object: the common part of all values of one label is drawn once."""
    shared_variance: float = 0.0
    """Part of the variance, 0..1, that all objects of the label share."""

    @property
    def path(self) -> str:
        """Return the key in the scene file."""
        return f"{self.section}.{self.name}.{self.parameter}"


def uncertain_values(
    scene: Scene, variant: str | None = None
) -> tuple[UncertainValue, ...]:
    """List all uncertain values of objects, then of boundaries.

    Values of the applied `variant` are certain.
    """
    provenance = Provenance(scene, variant)
    of_objects: list[UncertainValue] = []
    for item in scene.objects:
        of_objects.extend(_of_object(scene, item, provenance))
    of_boundaries: list[UncertainValue] = []
    for wall in scene.boundaries:
        of_boundaries.extend(_of_boundary(scene, wall, provenance))
    return (*of_objects, *of_boundaries)


def _of_object(
    scene: Scene, item: Object, provenance: Provenance
) -> Iterator[UncertainValue]:
    """Yield the uncertain values of an object."""
    path = f"objects.{item.name}"
    label = item.label.strip().lower()
    shared_part = 0.0
    # Objects of one label are of one material, as surely as the label is right.
    if label not in VAGUE_LABELS:
        shared_part = _label_confidence(item, provenance)
    for parameter in OBJECT_PARAMETERS:
        value = getattr(item, parameter)
        if value is None or parameter not in item.provenance:
            continue
        if parameter in ("mass", "density") and item.motion is not Motion.DYNAMIC:
            continue
        value_source = provenance.of(
            f"{path}.{parameter}",
            item.provenance[parameter],
            text_path=f"{path}.from.{parameter}",
        )
        if value_source.confidence is None:
            continue
        is_lower_limit = parameter == "friction" and value_source.text == AT_LEAST
        distribution = spread(parameter, value, value_source.confidence, is_lower_limit)
        if distribution is not None:
            yield UncertainValue(
                "objects",
                item.name,
                parameter,
                value,
                value_source,
                distribution,
                label,
                shared_part,
            )


def _label_confidence(item: Object, provenance: Provenance) -> float:
    """Return the confidence of an object's label, 1 for a user's."""
    path = f"objects.{item.name}"
    origin = item.provenance.get("label")
    label_source = provenance.of(
        f"{path}.label", origin, text_path=f"{path}.from.label"
    )
    if origin is None or label_source.kind != "guess":
        return 1.0
    return source(origin).confidence or 0.0


def _of_boundary(
    scene: Scene, item: Boundary, provenance: Provenance
) -> Iterator[UncertainValue]:
    """Yield the uncertain values of a boundary."""
    origin = scene.document["boundaries"][item.name].get("from")
    path = f"boundaries.{item.name}"
    for parameter in BOUNDARY_PARAMETERS if origin is not None else ():
        value_source = provenance.of(
            f"{path}.{parameter}", origin, text_path=f"{path}.from"
        )
        value = getattr(item, parameter)
        if value_source.confidence is None:
            distribution = None
        else:
            distribution = spread(parameter, value, value_source.confidence)
        if distribution is not None:
            yield UncertainValue(
                "boundaries", item.name, parameter, value, value_source, distribution
            )


def draw_values(values: Sequence[UncertainValue], seed: int, count: int) -> Array:
    """Return draws (count, P) of all values; those of one label are correlated."""

    @cache
    def normal(*key: str) -> Array:
        return np.array(
            [
                NORMAL.inv_cdf(max(share, 2**-54))
                for share in uniform(seed, count, *key).tolist()
            ]
        )

    def column(value: UncertainValue) -> list[float]:
        # The sum of a shared and an own normal variable has a variance of 1 in any
        # proportion.
        z = np.zeros(count)
        if value.shared_variance > 0:
            z += sqrt(value.shared_variance) * normal(
                "label", value.label, value.parameter
            )
        if value.shared_variance < 1:
            z += sqrt(1 - value.shared_variance) * normal(
                value.section, value.name, value.parameter
            )
        return [value.spread.quantile(each) for each in z.tolist()]

    return np.array(list(map(column, values))).T.reshape(count, len(values))


def uniform(seed: int, count: int, *key: str) -> Array:
    """Return uniform draws (count,) in 0..1: the first numbers of the stream of a
    `key`.
    """
    digest = sha256("\0".join((str(seed), *key)).encode()).digest()
    return np.random.Generator(
        np.random.Philox(key=int.from_bytes(digest[:16], "big"))
    ).random(count)


def with_draw(scene: Scene, values: Sequence[UncertainValue], draw: Array) -> Scene:
    """Return the scene with the numbers `(P,)` of one draw."""
    edits: dict[tuple[str, str], dict[str, float]] = {}
    for value, number in zip(values, draw.tolist(), strict=True):
        # Collect the values by object first: each object is replaced only once.
        edits.setdefault((value.section, value.name), {})[value.parameter] = number

    def edited(section: str, item: Any) -> Any:
        changes = edits.get((section, item.name))
        if changes:
            return replace(item, **changes)
        return item

    return replace(
        scene,
        objects=tuple(edited("objects", item) for item in scene.objects),
        boundaries=tuple(edited("boundaries", item) for item in scene.boundaries),
    )
