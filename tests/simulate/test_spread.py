"""Distributions beside those of scipy, which has its own: draws, bounds, and how width follows confidence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from physgen.scene.provenance import Source
from physgen.simulate.uncertain_values import (
    POWERS,
    UncertainValue,
    draw_values,
    spread,
    uniform,
)

MANY = 3000
SOURCE = Source("guess", "table", 0.5)


def truth(parameter: str, value: float, sure: float) -> stats.rv_continuous:
    """By scipy: what a number is distributed as."""
    sigma = -np.log(sure) * POWERS[parameter]
    if parameter == "elasticity":  # the log of the odds is normal
        return stats.norm(np.log(value / (1 - value)), sigma)
    return stats.truncnorm(
        -np.inf, (np.log(10) - np.log(value)) / sigma, np.log(value), sigma
    )


def of(parameter: str, value: float, sure: float, **more: object) -> UncertainValue:
    found = spread(parameter, value, sure)
    assert found is not None
    return UncertainValue("objects", "a", parameter, value, SOURCE, found, **more)


def unbounded(parameter: str, values: np.ndarray) -> np.ndarray:
    return (
        np.log(values / (1 - values)) if parameter == "elasticity" else np.log(values)
    )


@pytest.mark.parametrize(
    ("parameter", "value", "sure"),
    [
        ("friction", 0.45, 0.4),
        ("friction", 3.0, 0.1),
        ("elasticity", 0.7, 0.3),
        ("rolling", 0.02, 0.5),
    ],
)
def test_draws_are_distributed_as_scipy_has_it(
    parameter: str, value: float, sure: float
) -> None:
    """Kolmogorov and Smirnov; one in a thousand such tests would fail by chance, and the seed is fixed."""
    drawn = draw_values([of(parameter, value, sure)], 5, MANY)[:, 0]
    known = truth(parameter, value, sure)
    assert stats.kstest(unbounded(parameter, drawn), known.cdf).pvalue > 1e-3
    found = spread(parameter, value, sure)
    for z in (-2.0, -0.5, 0.0, 1.0, 3.0):
        at = unbounded(parameter, np.array(found.quantile(z)))
        assert known.cdf(at) == pytest.approx(stats.norm.cdf(z), abs=1e-9)


def test_what_is_known_to_be_reached_is() -> None:
    """A half-normal distribution of the logarithm."""
    found = spread("friction", 0.67, 0.5, is_upper_half=True)
    drawn = np.array([found.quantile(z) for z in stats.norm.ppf(uniform(0, MANY, "x"))])
    assert drawn.min() >= 0.67
    sigma = -np.log(0.5) / 2
    assert (
        stats.kstest(np.log(drawn / 0.67), stats.halfnorm(scale=sigma).cdf).pvalue
        > 1e-3
    )


@pytest.mark.parametrize("value", [1e-6, 0.02, 0.5, 0.999, 9.9])
def test_bounds_hold_however_unsure(value: float) -> None:
    for parameter in ("friction", "rolling", "elasticity"):
        for at_least in (False, True):
            found = spread(parameter, value, 0.0, at_least)
            if found is None:
                assert parameter == "elasticity"
                assert value > 1
                continue
            ends = [found.quantile(z) for z in (-8.0, -3.0, 0.0, 3.0, 8.0)]
            assert ends == sorted(ends)
            assert 0 <= ends[0] <= ends[-1] <= (1 if parameter == "elasticity" else 10)


@pytest.mark.parametrize("parameter", sorted(POWERS))
def test_less_sure_is_wider_and_sure_is_a_point(parameter: str) -> None:
    widths = []
    for sure in (0.05, 0.2, 0.5, 0.8, 0.99):
        found = spread(parameter, 0.1, sure)
        assert found.quantile(0.0) == pytest.approx(0.1, rel=0.2), (
            "the file's number is the median"
        )
        widths.append(found.quantile(1.645) - found.quantile(-1.645))
    assert widths == sorted(widths, reverse=True)
    assert len(set(widths)) == len(widths)
    assert spread(parameter, 0.1, 1.0) is None
    assert spread(parameter, 0.0, 0.3) is None, "nothing is a factor of 0"


def test_what_is_half_alike_keeps_its_own_distribution() -> None:
    """Shared doubts change what two things have in common, not what each of them is."""
    doubts = [
        UncertainValue(
            "objects",
            name,
            "mass",
            10.0,
            SOURCE,
            spread("mass", 10.0, 0.5),
            "block",
            0.5,
        )
        for name in "ab"
    ]
    drawn = np.log2(
        draw_values(doubts, 3, MANY) / 10
    )  # sure 0.5: a factor of 2 is one standard deviation
    for column in drawn.T:
        assert stats.kstest(column, stats.norm.cdf).pvalue > 1e-3
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.5, abs=0.05)
