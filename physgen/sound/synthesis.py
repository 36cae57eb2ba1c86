"""Impacts and friction as stereo pressure at the listener, Pa."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, exp, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F64, Indices
from physgen.export.video_formats import SOUND_RATE
from physgen.sound.impact import pulse_spectrum
from physgen.sound.resonators import AIR_DENSITY, AIR_SPEED, LIMITS, Resonator

Complex = NDArray[np.complex128]

RATE = SOUND_RATE
"""Samples/s."""
BLOCK = 256
"""Number of samples between two updates of the modes' states."""
SILENCE = 1e-5
"""Minimum state of a resonator, over its loudest state. A quieter state ends."""
OVERSAMPLING = 4
"""Finer samples for the click of an impact, because it has only a few samples."""
CLICK_TAIL = 6.0
"""Duration of the click of a sphere, in decay times."""
LARGEST_RADIUS = 0.5
"""Maximum radius for clicks, m. Clicks of larger bodies would be rumbles."""
DIRECTIVITY = 1 / sqrt(3)
"""Mean of a dipole's pressure over all directions, relative to its axis."""


@dataclass(frozen=True)
class Strike:
    """An impulse on one resonator."""

    time: float
    """s of the clip."""
    resonator: int
    """Index of the resonator."""
    impulse: float
    """N·s."""
    contact_time: float
    """s."""
    gains: tuple[float, float]
    """Gains of the left and the right channel."""
    has_contact: bool
    """True if the resonator lies on something else."""
    polarity: float = 1.0
    """1 for an impulse that points down, -1 for up. Clicks of simultaneous impacts then
    add at random, as sounds from many directions do.
    """


def pan(place: float) -> tuple[float, float]:
    """Return the gains of left and right with constant power; `place` is 0 (left) to 1.

    >>> pan(0.0), [round(gain, 3) for gain in pan(0.5)]
    ((1.0, 0.0), [0.707, 0.707])
    """
    angle = min(max(place, 0.0), 1.0) * pi / 2
    return float(np.cos(angle)), float(np.sin(angle)) if place > 0 else 0.0


def ring(resonators: Sequence[Resonator], strikes: Sequence[Strike], count: int) -> F64:
    """Return (count, 2) Pa at 1 m: the decaying modes of all struck resonators."""
    sound = np.zeros((count, 2))
    # Strikes of one resonator share its modes; a touch changes their decay.
    groups: dict[tuple[int, bool], list[Strike]] = {}
    for strike in strikes:
        key = (strike.resonator, strike.has_contact)
        groups.setdefault(key, []).append(strike)
    for (index, has_contact), members in sorted(groups.items()):
        resonator = resonators[index]
        if len(resonator.frequencies):
            _add_modes(sound, resonator, has_contact, members)
    return sound


def _add_modes(
    sound: F64, resonator: Resonator, has_contact: bool, strikes: Sequence[Strike]
) -> None:
    """Add the modes of one resonator to (count, 2) Pa.

    The state of a mode is a rotating and decaying complex number. It is computed block
    by block, and an impact adds to it at once.
    """
    omega = 2 * pi * resonator.frequencies
    rates = resonator.decay_rates(has_contact)
    # One complex factor per sample rotates by the frequency and shrinks by the decay.
    exponents: Complex = ((1j * omega - rates) / RATE).astype(np.complex128)
    waves = np.exp(exponents[:, None] * np.arange(BLOCK))
    per_block = np.exp(exponents * BLOCK)
    block_count = ceil(len(sound) / BLOCK)
    changes = np.zeros((block_count + 1, len(omega), 2), np.complex128)
    for strike in strikes:
        _strike_modes(sound, changes, resonator, exponents, strike)
    states = _continue_states(changes[:block_count], per_block)
    _add_blocks(sound, states, waves)


def _strike_modes(
    sound: F64,
    changes: Complex,
    resonator: Resonator,
    exponents: Complex,
    strike: Strike,
) -> None:
    """Add one strike: the samples of its own block, and the state at the next block."""
    # The centre of the pulse is its mean time.
    start = (strike.time + strike.contact_time / 2) * RATE
    first = ceil(start)
    if first >= len(sound):
        return
    # Each mode takes the impulse with its modal mass, less what the long contact
    # smooths.
    velocity = strike.impulse / (resonator.mass * LIMITS.modal_mass)
    share = pulse_spectrum(resonator.frequencies, strike.contact_time)
    pressure = velocity * share * resonator.radiation()
    # A sine: displacement and pressure start at zero.
    state = -1j * pressure * np.exp(exponents * (first - start))
    gains = np.array(strike.gains)
    block = first // BLOCK
    end = min((block + 1) * BLOCK, len(sound))
    turns = np.exp(exponents[:, None] * np.arange(end - first))
    samples = (state @ turns).real
    sound[first:end] += samples[:, None] * gains
    # Later blocks start from the state at the end of this one.
    remaining = (block + 1) * BLOCK - first
    next_state = state * np.exp(exponents * remaining)
    changes[block + 1] += next_state[:, None] * gains


def _continue_states(changes: Complex, per_block: Complex) -> Complex:
    """Return the states (blocks, M, 2) at the starts of all blocks."""
    states = np.zeros_like(changes)
    loudest = np.abs(changes).max(initial=0.0)
    state = np.zeros(changes.shape[1:], np.complex128)
    # Silent blocks between strikes need no state.
    is_struck = np.abs(changes).max(axis=(1, 2), initial=0.0) > 0
    is_silent = True
    for block, struck in enumerate(is_struck.tolist()):
        if is_silent and not struck:
            continue
        state = state * per_block[:, None] + changes[block]
        states[block] = state
        is_silent = bool(np.abs(state).max() < SILENCE * loudest)
        if is_silent:
            state = np.zeros_like(state)
    return states


def _add_blocks(sound: F64, states: Complex, waves: Complex) -> None:
    """Add the blocks with the start states (blocks, M, 2); `waves` is (M, BLOCK)."""
    # Most blocks of a clip are silent.
    loudness = np.abs(states).max(axis=(1, 2), initial=0.0)
    active: Indices = np.flatnonzero(loudness > 0)
    if not len(active):
        return
    chosen = states[active]
    blocks = np.zeros((len(active), BLOCK, 2))
    for channel in (0, 1):
        part = chosen[:, :, channel]
        blocks[:, :, channel] = part.real @ waves.real - part.imag @ waves.imag
    for block, samples in zip(active.tolist(), blocks, strict=True):
        begin = block * BLOCK
        end = min(begin + BLOCK, len(sound))
        sound[begin:end] += samples[: end - begin]


def click(
    resonators: Sequence[Resonator], strikes: Sequence[Strike], count: int
) -> F64:
    """Return (count, 2) Pa at 1 m: the sound of the displaced air of suddenly
    accelerated bodies.

    The sound is that of a sphere with an acceleration during the contact time (Koss and
    Alfredson, J. Sound Vib. 27, 59, 1973). It is the only audible sound of billiard
    balls.
    """
    sound = np.zeros((count, 2))
    for strike in strikes:
        resonator = resonators[strike.resonator]
        # Scenery does not move, and makes no click.
        if np.isinf(resonator.surface.mass):
            continue
        speed = strike.impulse / resonator.surface.mass
        first = round(strike.time * RATE)
        pulse = speed * click_of_sphere(resonator.radius, strike.contact_time)
        pulse = pulse[: max(count - first, 0)]
        end = first + len(pulse)
        sound[first:end] += strike.polarity * pulse[:, None] * np.array(strike.gains)
    return sound


def click_of_sphere(radius: float, contact_time: float) -> F64:
    """Return Pa at 1 m for 1 m/s of a sphere (m), at RATE, from the start of its
    contact (s).

    A step of speed gives rho c (a / r) e^(-x) (cos x - sin x) with x = c t / a, the far
    field of a moving sphere (Pierce, Acoustics, section 4.2). It is convolved with the
    half-sine of the acceleration.
    """
    rate = RATE * OVERSAMPLING
    radius = min(radius, LARGEST_RADIUS)
    # Time in units of the sound's way over the radius.
    decay = AIR_SPEED / radius / rate
    steps = np.arange(ceil(CLICK_TAIL / decay) + 1)
    # The mean of e^(-x) (cos x - sin x) over each sample, by its integral e^(-x) sin x.
    phases = decay * np.append(steps, steps[-1] + 1)
    response = np.diff(np.exp(-phases) * np.sin(phases)) / decay
    pulse_count = max(ceil(contact_time * rate), 1)
    phases_of_pulse = (np.arange(pulse_count) + 0.5) / pulse_count * pi
    pulse = np.sin(phases_of_pulse)
    # The pulse of the acceleration has the sum 1, so that the speed is reached at its
    # end.
    pressure = np.convolve(pulse / pulse.sum(), response)
    pressure *= AIR_DENSITY * AIR_SPEED * radius * DIRECTIVITY
    missing = -len(pressure) % OVERSAMPLING
    padded = np.pad(pressure, (0, missing))
    return np.asarray(padded.reshape(-1, OVERSAMPLING).mean(axis=1))


ROOM_DECAY = 0.35
"""Time for a fall of the room's sound by 60 dB, s: a furnished room."""
ROOM_LENGTH = 0.3
"""Computed duration of the room's sound, s."""
ROOM_DELAY = 0.008
"""Delay of the first reflection, s: a wall 1.4 m farther than the object."""
ROOM_LEVEL = 0.16
"""Energy of the room's sound over that of the direct sound at 1 m; estimate."""
ROOM_SEED = 20260101


def add_room(sound: F64) -> F64:
    """Return (count, 2) with the reverberation of a small room, equal in both
    channels.
    """
    length = int(ROOM_LENGTH * RATE)
    delay = int(ROOM_DELAY * RATE)
    noise = np.random.default_rng(ROOM_SEED).standard_normal(length)
    # 60 dB are a factor of 1000 in pressure.
    fall = exp(-3 * np.log(10) / (ROOM_DECAY * RATE))
    response = noise * fall ** np.arange(length)
    response *= sqrt(ROOM_LEVEL / float((response**2).sum()))
    # The padding avoids the wrap-around of the circular convolution.
    size = 1 << (len(sound) + length + delay - 1).bit_length()
    spectrum = np.fft.rfft(response, size)
    # A product of spectra is a convolution, and far faster.
    sound_spectrum = np.fft.rfft(sound, size, axis=0)
    reflected_spectrum = sound_spectrum * spectrum[:, None]
    reflected = np.fft.irfft(reflected_spectrum, size, axis=0)
    result = sound.copy()
    result[delay:] += reflected[: len(sound) - delay] if delay else reflected
    return result
