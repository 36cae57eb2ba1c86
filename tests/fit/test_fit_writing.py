"""Intervals as confidences, flat directions in words, and where they are written."""

from __future__ import annotations

from math import exp, log

import numpy as np
import pytest

from physgen.fit.parameters import Kind, Parameter, Scale, odds
from physgen.fit.solve import Estimate, flat_directions
from physgen.fit.writing import confidence
from physgen.simulate.uncertain_values import spread


def parameter(path: str, kind: Kind, scale: Scale) -> Parameter:
    return Parameter(path, kind, 0, 0, scale, 0.0, 1.0)


@pytest.mark.parametrize(
    ("kind", "scale", "value"),
    [(Kind.FRICTION, Scale.LOGARITHM, 0.4), (Kind.ELASTICITY, Scale.ODDS, 0.7)],
)
def test_draws_by_the_confidence_fill_the_interval(
    kind: Kind, scale: Scale, value: float
) -> None:
    one = parameter(f"objects.a.{kind.value}", kind, scale)
    transform = log if scale is Scale.LOGARITHM else odds
    low, high = (one.value(transform(value) + side * 0.2) for side in (-1, 1))
    sure = confidence(Estimate(one, value, low, high, True))
    assert sure is not None
    distribution = spread(kind.value, value, sure)
    assert distribution is not None
    assert distribution.at(-1.645) == pytest.approx(low, rel=0.01)
    assert distribution.at(1.645) == pytest.approx(high, rel=0.01)


def test_velocities_have_no_confidence() -> None:
    one = parameter("objects.a.velocity.0", Kind.VELOCITY, Scale.LINEAR)
    assert confidence(Estimate(one, 5.0, 4.0, 6.0, True)) is None


def test_flat_directions_name_single_values_and_combinations() -> None:
    names = ["a.friction", "b.friction", "a.mass", "a.rolling"]
    parameters = [parameter(name, Kind.FRICTION, Scale.LOGARITHM) for name in names]
    slopes = np.array([[30.0, 30.0, 0, 0], [0, 0, 50.0, 0]])
    covariance = np.linalg.inv(slopes.T @ slopes + np.eye(4))
    sentences = flat_directions(parameters, covariance, np.ones(4))
    assert set(sentences) == {
        "a.rolling",
        "a.friction against b.friction: only their combination",
    } or set(sentences) == {
        "a.rolling",
        "b.friction against a.friction: only their combination",
    }


@pytest.mark.parametrize("value", [0.02, 0.5, 0.97])
def test_odds_and_values_are_inverse(value: float) -> None:
    one = parameter("objects.a.elasticity", Kind.ELASTICITY, Scale.ODDS)
    assert one.value(odds(value)) == pytest.approx(value)
    assert one.value(0.0) == pytest.approx(1 / (1 + exp(0)))
