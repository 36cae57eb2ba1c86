"""The closed forms that are more than a line, against slow and plain numerical integration."""

from __future__ import annotations

import numpy as np
import pytest
from pytest import approx

from physgen.evaluate.physics.elliptic import integrate_ellipse, runge_kutta
from physgen.evaluate.physics.forces import kepler
from physgen.evaluate.physics.sliding_disc import couple
from physgen.evaluate.physics.tabletop import mean_distance
from physgen.geometry.polygon import Region, Ring
from physgen.geometry.polygon import mean_distance as of_outline

G = 980.0


@pytest.mark.parametrize("k", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_elliptic_integrals(k: float) -> None:
    angle = (
        (np.arange(20_000) + 0.5) * np.pi / 40_000
    )  # the midpoint rule converges fast on periodic functions
    root = np.sqrt(1 - (k * np.sin(angle)) ** 2)
    first, second = integrate_ellipse(k)
    assert first == approx((1 / root).mean() * np.pi / 2, rel=1e-12)
    assert second == approx(root.mean() * np.pi / 2, rel=1e-12)


@pytest.mark.parametrize("swing", [0.1, 1.0, 2.5])
def test_pendulum_period(swing: float) -> None:
    length, ratio = 80.0, 1.3  # J/(m L²)
    period = 4 * np.sqrt(ratio * length / G) * integrate_ellipse(np.sin(swing / 2))[0]

    def rate(state: np.ndarray) -> np.ndarray:
        return np.array([state[1], -G / (ratio * length) * np.sin(state[0])])

    angle, spin = runge_kutta(rate, np.array([swing, 0.0]), period, 4000)[-1]
    assert (angle, spin) == (approx(swing, rel=1e-8), approx(0, abs=1e-6))
    assert runge_kutta(rate, np.array([swing, 0.0]), period / 4, 1000)[-1][0] == approx(
        0, abs=1e-8
    )


def over_the_disc(epsilon: float, count: int = 1500) -> tuple[float, float]:
    """Mean of the slip's direction along the sliding, and of its moment about the middle, on a disc of radius 1."""
    radius = (np.arange(count) + 0.5) / count
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    x, y = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    vx, vy = epsilon - y, x
    slip = np.hypot(vx, vy)
    weight = 2 * radius[:, None] / count**2
    return float((vx / slip * weight).sum()), float(
        ((x * vy - y * vx) / slip * weight).sum()
    )


@pytest.mark.parametrize("epsilon", [0.05, 0.3, 0.653, 0.99, 1.0, 1.01, 2.0, 20.0])
def test_sliding_and_spinning_disc(epsilon: float) -> None:
    assert couple(epsilon) == approx(over_the_disc(epsilon), rel=1e-5, abs=1e-7)


def test_mean_distance_of_a_rectangle() -> None:
    width, height = 57.0, 31.0
    x, y = (
        ((np.arange(2000) + 0.5) / 2000 - 0.5) * width,
        ((np.arange(2000) + 0.5) / 2000 - 0.5) * height,
    )
    assert mean_distance(width, height) == approx(
        np.hypot(x[:, None], y).mean(), rel=1e-6
    )
    corners = (
        np.array(
            [[-width, -height], [width, -height], [width, height], [-width, height]]
        )
        / 2
    )
    assert mean_distance(width, height) == approx(
        of_outline(Region((Ring(corners),)), np.zeros(2)), rel=1e-12
    )


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.6])
def test_kepler(eccentricity: float) -> None:
    axis, strength = 90.0, 3.0e7

    def rate(state: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [state[2:], -strength * state[:2] / np.hypot(*state[:2]) ** 3]
        )

    far = axis * (1 + eccentricity)
    speed = np.sqrt(strength * (2 / far - 1 / axis))
    period = 2 * np.pi * np.sqrt(axis**3 / strength)
    states = runge_kutta(rate, np.array([far, 0.0, 0.0, speed]), 1.3 * period, 13_000)[
        ::100
    ]
    assert (
        np.abs(
            states[:, :2]
            - kepler(axis, eccentricity, strength, np.linspace(0, 1.3 * period, 131))
        ).max()
        < 1e-4
    )


def test_falling_through_air_and_wind() -> None:
    k, wind = 0.004, 250.0  # drag x width / m, 1/px
    final = np.sqrt(G / k)
    speed, way = runge_kutta(
        lambda s: np.array([G - k * s[0] ** 2, s[0]]), np.zeros(2), 1.0, 2000
    )[-1]
    assert speed == approx(final * np.tanh(G / final), rel=1e-10)
    assert way == approx(final**2 / G * np.log(np.cosh(G / final)), rel=1e-10)
    speed, way = runge_kutta(
        lambda s: np.array([k * (wind - s[0]) ** 2, s[0]]), np.zeros(2), 1.0, 2000
    )[-1]
    assert speed == approx(wind - wind / (1 + wind * k), rel=1e-10)
    assert way == approx(wind - np.log1p(wind * k) / k, rel=1e-10)


def test_damped_spring_goes_round_a_shrinking_circle() -> None:
    stiffness, damping, mass = 9000.0, 30.0, 20.0
    decay = damping / (2 * mass)
    omega = np.sqrt(stiffness / mass - decay**2)
    x, v = runge_kutta(
        lambda s: np.array([s[1], -(stiffness * s[0] + damping * s[1]) / mass]),
        np.array([30.0, 0.0]),
        2.0,
        20_000,
    ).T
    aside = (v + decay * x) / omega
    phase = np.unwrap(np.arctan2(-aside, x))
    assert (phase[-1] - phase[0]) / 2.0 == approx(omega, rel=1e-8)
    assert np.hypot(x[-1], aside[-1]) / np.hypot(x[0], aside[0]) == approx(
        np.exp(-2 * decay), rel=1e-8
    )


def test_plank_falling_over_on_ice() -> None:
    """Newton's laws with the floor's force, against the energy of a body that glides on its corner."""
    a, b, per_mass = 8.0, 50.0, (16.0**2 + 100.0**2) / 12  # half sizes px, I/m px²

    def lever(angle: float) -> float:
        return a * np.cos(angle) - b * np.sin(angle)

    def rate(state: np.ndarray) -> np.ndarray:
        angle, spin = state
        bend = -a * np.sin(angle) - b * np.cos(angle)
        # the floor's force per mass is g + y'', and turns the body by its lever
        return np.array(
            [
                spin,
                -lever(angle) * (G + bend * spin**2) / (per_mass + lever(angle) ** 2),
            ]
        )

    start = 0.3
    states = runge_kutta(rate, np.array([start, 0.0]), 0.45, 20_000)
    angle, spin = states[states[:, 0] < 1.4][-1]
    assert angle > 1.2
    drop = b * np.cos(start) + a * np.sin(start) - b * np.cos(angle) - a * np.sin(angle)
    assert spin == approx(
        np.sqrt(2 * G * drop / (per_mass + lever(angle) ** 2)), rel=1e-7
    )
