"""Steps of DDIM: as diffusers takes them where their count divides 1000, and leaving no noise where it does not."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from diffusers import DDIMScheduler
from pytest import approx

from physgen.refine.backends.sampling import ddim

SCHEDULERS = {
    kind: lambda kind=kind: DDIMScheduler(
        beta_schedule="linear", clip_sample=False, timestep_spacing="leading", steps_offset=1, set_alpha_to_one=True,
        prediction_type=kind,
    )
    for kind in ("epsilon", "v_prediction")
}  # fmt: skip


def told(scheduler: object, z0: np.ndarray, noise: np.ndarray, time: int) -> np.ndarray:
    """What a model says that knows picture and noise."""
    if scheduler.config.prediction_type == "epsilon":
        return noise
    a = float(scheduler.alphas_cumprod[time])
    return (a**0.5 * noise - (1 - a) ** 0.5 * z0).astype(np.float32)


def pictures() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    return random.standard_normal((2, 4, 3, 3), np.float32), random.standard_normal(
        (2, 4, 3, 3), np.float32
    )


@pytest.mark.parametrize("name", SCHEDULERS)
@pytest.mark.parametrize("steps", [4, 7, 30, 50, 60, 150, 600, 1000])
def test_no_noise_is_left(name: str, steps: int) -> None:
    scheduler, (z0, noise) = SCHEDULERS[name](), pictures()
    schedule = ddim(scheduler, steps, steps)
    z = schedule.add_noise(z0, noise, 0)
    for k, time in enumerate(schedule.times.tolist()):
        assert z == approx(schedule.add_noise(z0, noise, k), abs=1e-3)
        z = schedule.step(told(scheduler, z0, noise, time), z, k)
    assert z == approx(z0, abs=1e-3)


@pytest.mark.parametrize("name", SCHEDULERS)
@pytest.mark.parametrize("steps", [4, 50, 500])
def test_steps_are_those_of_diffusers(name: str, steps: int) -> None:
    scheduler, theirs, (z, said) = SCHEDULERS[name](), SCHEDULERS[name](), pictures()
    schedule = ddim(scheduler, steps, steps)
    theirs.set_timesteps(steps)
    assert torch.equal(theirs.timesteps, schedule.times)
    for k, time in enumerate(schedule.times.tolist()):
        expected = theirs.step(
            torch.from_numpy(said), time, torch.from_numpy(z)
        ).prev_sample.numpy()
        assert schedule.step(said, z, k) == approx(expected, abs=2e-5, rel=1e-5)
