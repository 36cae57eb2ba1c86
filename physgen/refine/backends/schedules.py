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
    """The last `count` of `steps` by DDIM (Song et al. 2021), deterministic; `scheduler` is left as it is.

    The libraries' own step goes 1000 // `steps` levels on, which is where the next begins only if `steps` divides 1000:
    else noise would stay. Here every step ends where the next begins, and the last at the picture itself.
    """
    told, kept = scheduler.config, scheduler.alphas_cumprod.numpy().astype(np.float64)
    times = levels(len(kept), steps, told.timestep_spacing, told.get("steps_offset", 0))[-count:]
    a = np.append(kept[times], 1.0)
    signal, noise_part = np.sqrt(a).astype(np.float32), np.sqrt(1 - a).astype(np.float32)

    def noised(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray(signal[k] * latents + noise_part[k] * noise, np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        s, n = signal[k], noise_part[k]
        if told.prediction_type == "v_prediction":
            z0, noise = s * latents - n * prediction, s * prediction + n * latents
        elif told.prediction_type == "sample":
            z0, noise = prediction, (latents - s * prediction) / n
        else:
            z0, noise = (latents - n * prediction) / s, prediction
        return np.asarray(signal[k + 1] * z0 + noise_part[k + 1] * noise, np.float32)

    return Schedule(type(scheduler).__name__, torch.from_numpy(times), noised, stepped)


def levels(most: int, steps: int, spacing: str, offset: int) -> NDArray[np.int64]:
    """(steps,) of `most` levels, the noisiest first, evenly spread; as diffusers has them where `steps` divides `most`.

    >>> levels(1000, 4, "leading", 1).tolist(), levels(1000, 4, "trailing", 0).tolist()
    ([751, 501, 251, 1], [999, 749, 499, 249])
    """
    down = np.arange(steps)[::-1]
    if spacing == "trailing":
        return np.asarray(np.round((down + 1) * most / steps) - 1, np.int64)
    return np.minimum(np.floor(down * most / steps).astype(np.int64) + offset, most - 1)


def euler(scheduler: Any, steps: int, count: int) -> Schedule:
    """The last `count` of `steps` of a straight flow from noise to data, by Euler's method (Lipman et al. 2023)."""
    scheduler.set_timesteps(steps)
    times, sigmas = scheduler.timesteps[-count:], scheduler.sigmas[-count - 1 :].numpy().astype(np.float32)

    def noised(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray((1 - sigmas[k]) * latents + sigmas[k] * noise, np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        return np.asarray(latents + (sigmas[k + 1] - sigmas[k]) * prediction, np.float32)

    return Schedule(type(scheduler).__name__, times, noised, stepped)
