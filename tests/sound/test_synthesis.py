"""Sound of single strikes against what it is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physgen.materials import kind
from physgen.sound.friction import Rubbing, band_noise, friction_noise
from physgen.sound.impact import Surface
from physgen.sound.resonators import Resonator
from physgen.sound.synthesis import (
    RATE,
    Strike,
    add_room,
    click,
    click_of_sphere,
    pan,
    ring,
)

STEEL = kind("steel bar").material
BAR = Resonator(
    "bar",
    STEEL,
    np.array([1000.0, 2756.0]),
    0.2,
    0.01,
    Surface(0.2, 0.003, 205e9, 0.29),
    0.004,
)
STRIKE = Strike(0.1, 0, 0.02, 1e-4, (1.0, 0.5), False)


def test_decay_follows_loss_factor() -> None:
    resonator = replace(BAR, frequencies=BAR.frequencies[:1])
    sound = ring([resonator], [STRIKE], RATE)[:, 0]
    windows = sound[RATE // 5 : RATE // 5 + 24_000].reshape(-1, 480)
    levels = np.log(np.sqrt((windows**2).mean(axis=1)))
    slope = np.polyfit(np.arange(len(levels)) * 480 / RATE, levels, 1)[0]
    assert -slope == pytest.approx(np.pi * 1000 * 0.004, rel=0.03)


def test_spectrum_has_the_modes() -> None:
    sound = ring([BAR], [STRIKE], RATE)[:, 0]
    spectrum = np.abs(np.fft.rfft(sound))
    peaks = [int(spectrum[:2000].argmax()), 2000 + int(spectrum[2000:].argmax())]
    assert peaks == pytest.approx([1000, 2756], abs=2)


@pytest.mark.parametrize("synthesise", [ring, click])
def test_amplitude_is_proportional_to_impulse(synthesise: object) -> None:
    assert callable(synthesise)
    quiet = synthesise([BAR], [STRIKE], RATE)
    loud = synthesise([BAR], [replace(STRIKE, impulse=0.06)], RATE)
    assert loud == pytest.approx(3 * quiet)


@pytest.mark.parametrize("synthesise", [ring, click])
@pytest.mark.parametrize("time", [0.1, 0.23456])
def test_onset_is_at_the_contact(synthesise: object, time: float) -> None:
    assert callable(synthesise)
    sound = synthesise([BAR], [replace(STRIKE, time=time)], RATE)[:, 0]
    first = int(np.flatnonzero(np.abs(sound) > 1e-3 * np.abs(sound).max())[0])
    assert first / RATE == pytest.approx(time, abs=0.001)


def test_two_strikes_add() -> None:
    later = replace(STRIKE, time=0.3, gains=(0.2, 0.9))
    together = ring([BAR], [STRIKE, later], RATE)
    apart = ring([BAR], [STRIKE], RATE) + ring([BAR], [later], RATE)
    assert together == pytest.approx(apart, abs=1e-4 * np.abs(apart).max())


def test_touch_shortens_the_ring() -> None:
    def late(strike: Strike) -> float:
        return float(np.abs(ring([BAR], [strike], RATE)[RATE // 2 :]).max())

    assert late(replace(STRIKE, has_contact=True)) < 0.01 * late(STRIKE)


def test_slow_click_is_the_dipole_of_the_jerk() -> None:
    # far longer than a / c, a sphere gives rho a³ / (2 r c) times the change of acceleration
    radius, time = 0.01, 0.004
    pulse = click_of_sphere(radius, time)
    # of 1 m/s by a half-sine, at its start
    jerk = np.pi**2 / (2 * time**2)
    expected = 1.2 * radius**3 / (2 * 343) * jerk / np.sqrt(3)
    assert pulse[8] == pytest.approx(expected, rel=0.05)
    assert abs(pulse.sum()) < 0.05 * np.abs(pulse).sum()


def test_pan_keeps_power_and_mirrors() -> None:
    for place in np.linspace(0, 1, 7).tolist():
        left, right = pan(place)
        assert left**2 + right**2 == pytest.approx(1)
        assert pan(1 - place) == pytest.approx((right, left), abs=1e-12)


def test_room_is_the_same_for_both_channels() -> None:
    sound = np.zeros((RATE, 2))
    sound[100] = 1.0, 0.5
    heard = add_room(sound)
    assert heard[:, 1] == pytest.approx(heard[:, 0] / 2)
    assert float((heard[101:, 0] ** 2).sum()) == pytest.approx(0.16, rel=0.05)


def test_friction_noise_has_its_power_and_place() -> None:
    times = np.array([0.0, 1.0])
    rubbing = Rubbing(times, np.full(2, 1e-6), np.full(2, 0.84), np.zeros(2))
    sound = friction_noise([rubbing], RATE)
    assert not sound[:, 1].any()
    # at 0.84 m/s over bumps of 0.6 mm nearly all is in the band about 1,400 Hz
    power = float((sound[:, 0] ** 2).mean()) * 4 * np.pi / (1.2 * 343)
    assert power == pytest.approx(1e-6, rel=0.25)


def test_band_noise_lies_in_its_band() -> None:
    noise = band_noise(RATE, 1400, 1)
    spectrum = np.abs(np.fft.rfft(noise)) ** 2
    assert spectrum[500:4000].sum() > 0.95 * spectrum.sum()
