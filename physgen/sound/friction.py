"""Noise of sliding and rolling, from friction power and speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from physgen.arrays import F64
from physgen.sound.resonators import AIR_DENSITY, AIR_SPEED
from physgen.sound.synthesis import RATE


@dataclass(frozen=True)
class FrictionTuning:
    """Loudness and colour of friction noise; estimates, by ear."""

    sliding_efficiency: float = 3e-7
    """Sound power over friction power."""
    rolling_efficiency: float = 3e-6
    """Sound power over the power of rolling resistance."""
    roughness: float = 0.0006
    """Distance of a surface's bumps, m. The middle frequency is the speed divided by
    it.
    """
    bands: tuple[float, ...] = (350.0, 1400.0, 5600.0)
    """Middle frequencies of the bands of noise, Hz."""
    octaves: float = 1.2
    """Half width of a band."""
    seed: int = 7


TUNING = FrictionTuning()


@dataclass(frozen=True)
class Rubbing:
    """Friction of one pair of surfaces over the clip."""

    times: F64
    """(T,) s of the clip, rising."""
    power: F64
    """(T,) W of sound."""
    speed: F64
    """(T,) relative speed of the surfaces, m/s."""
    place: F64
    """(T,) position from 0 (left) to 1 (right)."""


def friction_noise(rubbings: Sequence[Rubbing], count: int) -> F64:
    """Return (count, 2) Pa at 1 m. Powers of different pairs add, because their noises
    are independent.
    """
    sound = np.zeros((count, 2))
    if not rubbings:
        return sound
    moments = np.arange(count) / RATE
    # A few fixed bands with changing loudness replace one noise with a moving middle
    # frequency.
    for band, center in enumerate(TUNING.bands):
        times, powers = _band_powers(rubbings, center)
        if not powers.any():
            continue
        noise = band_noise(count, center, TUNING.seed + band)
        for channel in (0, 1):
            # A point source of power P has the mean square pressure P rho c / (4 pi) at
            # 1 m.
            squares = powers[:, channel] * AIR_DENSITY * AIR_SPEED / (4 * pi)
            pressure = np.sqrt(squares)
            loudness = np.interp(moments, times, pressure, right=0.0)
            sound[:, channel] += noise * loudness
    return sound


def _band_powers(rubbings: Sequence[Rubbing], center: float) -> tuple[F64, F64]:
    """Return times (T,) and the power (T, 2) of both channels in the band around
    `center` Hz.
    """
    times = rubbings[0].times
    powers = np.zeros((len(times), 2))
    low = TUNING.bands[0]
    high = TUNING.bands[-1]
    for rubbing in rubbings:
        # Bumps at a distance d pass with the frequency v/d.
        frequency = np.clip(rubbing.speed / TUNING.roughness, low, high)
        distance = np.log2(frequency / center) / TUNING.octaves
        share = np.exp(-(distance**2))
        # Constant power panning: the squares of sine and cosine add up to 1.
        angle = np.clip(rubbing.place, 0, 1) * pi / 2
        powers[:, 0] += rubbing.power * share * np.cos(angle) ** 2
        powers[:, 1] += rubbing.power * share * np.sin(angle) ** 2
    return times, powers


def band_noise(count: int, center: float, seed: int) -> F64:
    """Return noise (count,) with mean square 1 in a band around `center` Hz."""
    # A power of two keeps the Fourier transform fast.
    size = 1 << max(count - 1, 1).bit_length()
    noise = np.random.default_rng(seed).standard_normal(size)
    frequencies = np.fft.rfftfreq(size, 1 / RATE)
    # Ears hear ratios of frequencies: the band is a Gaussian in octaves.
    distance = np.log2(np.maximum(frequencies, 1.0) / center) / TUNING.octaves
    spectrum = np.fft.rfft(noise) * np.exp(-(distance**2))
    filtered = np.fft.irfft(spectrum, size)[:count]
    mean_square = float((filtered**2).mean())
    return np.asarray(filtered / sqrt(mean_square))
