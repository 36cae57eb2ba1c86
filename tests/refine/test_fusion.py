"""Algorithm 1 against its own identities, the paper's numbers, and closed forms for Gaussian data."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from gaussian import Gaussian, Straight, ddim
from pytest import approx

from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import (
    fuse_latents,
)

STEPS, COUNT, STOP = 50, 25, 5
MODELS = {"ddim": Gaussian, "flow": Straight}


def model(
    kind: str, count: int = COUNT, steps: int = STEPS, spread: float = 0.5
) -> Gaussian:
    made = MODELS[kind](spread=spread)
    made.begin(
        [np.zeros((8, 8, 3), np.uint8)], PromptSettings("", "", None), steps, count
    )
    return made


def drawn(seed: int, shape=(6, 3, 8, 10), spread: float = 0.5) -> np.ndarray:
    return (spread * np.random.default_rng(seed).standard_normal(shape)).astype(
        np.float32
    )


def refined(
    exact: Gaussian,
    guidance,
    mask,
    noise,
    *,
    count: int = COUNT,
    stop: int = STOP,
    **more,
):
    return fuse_latents(
        guidance,
        mask,
        add_noise=lambda z, k: exact.add_noise(z, noise, k),
        denoise=lambda z, k: exact.step(exact.predict(z, k, 0), z, k),
        count=count,
        stop=stop,
        **more,
    )


def test_the_last_steps_are_free_and_weights_rise() -> None:
    """What is blended in each step, read off latents that the model makes 1 and the guidance leaves 0."""
    shares = []

    def denoised(z: float, k: int) -> float:
        if k:
            shares.append(z)
        return 1.0

    last = fuse_latents(
        0.0, 1.0, add_noise=lambda z, k: z, denoise=denoised, count=COUNT, stop=STOP
    )
    assert [*shares, last] == approx([k / 25 for k in range(20)] + [1.0] * 5)


@pytest.mark.parametrize("kind", MODELS)
def test_all_objects_and_no_weight_is_the_guidance_to_the_bit(kind: str) -> None:
    guidance, noise = drawn(0), drawn(1, spread=1.0)
    z = refined(
        model(kind), guidance, np.float32(1), noise, stop=0, weight=lambda k, count: 0.0
    )
    assert np.array_equal(z, guidance)


@pytest.mark.parametrize("kind", MODELS)
def test_no_objects_is_plain_sdedit(kind: str) -> None:
    """Meng et al. 2022, written out, by the exact flow's coefficients: one number a step for the whole latent."""
    exact, guidance, noise = model(kind), drawn(0), drawn(1, spread=1.0)
    a, b, v = exact.a, exact.b, 0.25
    z = a[0] * guidance.astype(np.float64) + b[0] * noise
    for k in range(COUNT):
        z = z * (a[k + 1] * a[k] * v + b[k + 1] * b[k]) / (a[k] ** 2 * v + b[k] ** 2)
    assert refined(exact, guidance, np.float32(0), noise) == approx(z, abs=2e-5)


@pytest.mark.parametrize("kind", MODELS)
def test_the_chain_is_the_exact_flow_when_steps_are_fine(kind: str) -> None:
    """Of Gaussian data, noise free steps lead z to mean + (z - a mean) spread / sqrt(a^2 spread^2 + b^2)."""
    exact, guidance, noise = model(kind, 2000, 4000), drawn(0), drawn(1, spread=1.0)
    z = exact.add_noise(guidance, noise, 0)
    flow = z * 0.5 / np.hypot(exact.a[0] * 0.5, exact.b[0])
    assert refined(exact, guidance, np.float32(0), noise, count=2000) == approx(
        flow, abs=0.02
    )


def test_what_is_held_stays_in_every_step() -> None:
    guidance, noise = drawn(0), drawn(1, spread=1.0)
    held = np.array([1, 0.5, 0, 0, 0, 0], np.float32)[:, None, None, None]
    z = refined(model("ddim"), guidance, np.float32(0), noise, held_share=held)
    free = refined(model("ddim"), guidance, np.float32(0), noise)
    apart, most = (np.abs(one - guidance).mean(axis=(1, 2, 3)) for one in (z, free))
    assert apart[0] == 0
    assert apart[1] < 0.1 * most[1]
    assert np.array_equal(z[2:], free[2:])


def spread_after(
    fresh: bool, mask: float, spread: float, count: int = COUNT, stop: int = STOP
) -> float:
    """Variance of refined latents of Gaussian data, of the data's own: moments of signal and noise, step by step."""
    a, b = (levels[-count - 1 :] for levels in ddim(STEPS))
    signal, noise = a[0], b[0]  # z = signal x data + noise of this spread
    for k in range(count):
        step = (a[k + 1] * a[k] * spread**2 + b[k + 1] * b[k]) / (
            a[k] ** 2 * spread**2 + b[k] ** 2
        )
        share = mask * (1 - k / count) if k < count - stop else 0.0
        own, laid = (1 - share) * step * noise, share * b[k + 1]
        signal = (1 - share) * step * signal + share * a[k + 1]
        noise = np.hypot(own, laid) if fresh else own + laid
    return float(signal**2 + (noise / spread) ** 2)


def measured(fresh: bool, mask: float, spread: float, draws: int = 200_000) -> float:
    """The same by drawing."""
    exact, rng = model("ddim", spread=spread), np.random.default_rng(7)
    guidance = drawn(5, (1, draws), spread)
    one = rng.standard_normal((1, draws), np.float32)
    noise: Callable[[], np.ndarray] = (
        partial(rng.standard_normal, (1, draws), np.float32) if fresh else lambda: one
    )
    z = fuse_latents(
        guidance,
        mask,
        add_noise=lambda z, k: exact.add_noise(z, noise(), k),
        denoise=lambda z, k: exact.step(exact.predict(z, k, 0), z, k),
        count=COUNT,
        stop=STOP,
    )
    return float(z.var() / spread**2)


@pytest.mark.parametrize("mask", [0.5, 1.0])
@pytest.mark.parametrize("spread", [1.0, 0.5, 0.2])
def test_fresh_noise_in_every_step_loses_what_the_same_keeps(
    mask: float, spread: float
) -> None:
    kept, lost, plain = (
        spread_after(f, m, spread)
        for f, m in ((False, mask), (True, mask), (False, 0.0))
    )
    assert measured(False, mask, spread) == approx(kept, rel=0.02)
    assert measured(True, mask, spread) == approx(lost, rel=0.02)
    assert kept == approx(
        plain, rel=0.02
    )  # what is missing is the sampler's: 25 steps are not infinitely many
    assert lost < 0.92 * kept
    if spread < 1:
        assert lost < 0.7 * kept
