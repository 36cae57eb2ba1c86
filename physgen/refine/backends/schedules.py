"""A scheduler and a count of steps -> levels of noise and steps between them, by number, on the processor in float32.

Schedulers of diffusers count for themselves where a run stands. Here every step says where it is, so that windows,
trials and repeated steps cannot disturb one another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Schedule:
    """The steps that run."""

    name: str
    """The scheduler's class."""
    times: torch.Tensor
    """(count,): what the model is told of the noise in each step."""
    noised: Callable[[F32, F32, int], F32]
    """Latents, noise and step k -> latents as noisy as step k begins."""
    stepped: Callable[[F32, F32, int], F32]
    """The model's say, latents and step k -> latents after it."""


def ddim(scheduler: Any, steps: int, count: int) -> Schedule:
    """The last `count` of `steps` by DDIM (Song et al. 2021), deterministic."""
    scheduler.set_timesteps(steps)
    times = scheduler.timesteps[-count:]

    def noised(latents: F32, noise: F32, k: int) -> F32:
        z, n = torch.from_numpy(latents), torch.from_numpy(noise)
        return np.asarray(scheduler.add_noise(z, n, times[k : k + 1]).numpy(), np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        found = scheduler.step(torch.from_numpy(prediction), int(times[k]), torch.from_numpy(latents))
        return np.asarray(found.prev_sample.numpy(), np.float32)

    return Schedule(type(scheduler).__name__, times, noised, stepped)


def euler(scheduler: Any, steps: int, count: int) -> Schedule:
    """The last `count` of `steps` of a straight flow from noise to data, by Euler's method (Lipman et al. 2023)."""
    scheduler.set_timesteps(steps)
    times, sigmas = scheduler.timesteps[-count:], scheduler.sigmas[-count - 1 :].numpy().astype(np.float32)

    def noised(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray((1 - sigmas[k]) * latents + sigmas[k] * noise, np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        return np.asarray(latents + (sigmas[k + 1] - sigmas[k]) * prediction, np.float32)

    return Schedule(type(scheduler).__name__, times, noised, stepped)
