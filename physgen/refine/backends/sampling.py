"""Loading of pipelines, and steps of the schedule, for video diffusion models.

Schedulers of diffusers count their own steps. Here every step is given by number, so that windows, trials and repeated
steps cannot disturb one another.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from diffusers import AutoencoderKL, DiffusionPipeline
from numpy.typing import NDArray

from physgen.perceive.backends.models import (
    Flag,
    as_dtype,
    load_pipeline_on_cpu,
    load_weights,
)
from physgen.problems import InputError
from physgen.refine.denoiser import F32
from physgen.registry import hub_folder

REFINE = Flag("--refine", "NAME:PATH")
LIBRARIES = ("diffusers", "transformers")
"""Whose classes the parts of a pipeline may be."""
FULL = 0.7
"""Of a GPU's free memory that weights may take before they are moved there in turn only."""


def pipeline_index(weights: str, what: str) -> dict[str, Any]:
    """`model_index.json`: which pipeline weights are of, and of which classes its parts are."""
    found = load_weights(
        lambda path: dict(DiffusionPipeline.load_config(path)), weights, what, REFINE
    )
    for part, kind in found.items():
        if isinstance(kind, list) and kind[0] not in (
            None,
            *LIBRARIES,
        ):  # a module of its own: a program
            reason = f"would run {kind[0]} for its {part}"
            raise InputError.of(
                REFINE.name, f'"{weights}"', reason, "name weights of plain parts"
            )
    return found


def part_config(weights: str, part: str, what: str) -> dict[str, Any]:
    """`config.json` of a part, `""` for weights that are one."""
    at = {"subfolder": part} if part else {}
    return load_weights(
        lambda path: dict(AutoencoderKL.load_config(path, **at)), weights, what, REFINE
    )


def load_pipeline(
    kind: Any, weights: str, dtype: torch.dtype, what: str, vae: Any, **parts: Any
) -> Any:
    """The pipeline, on the processor, its VAE (of the class `vae`) in float32.

    In a VAE of bfloat16 a grey level is as much as its numbers' last bit, and what is shown are differences.
    """

    def load(path: str) -> Any:
        fine = vae.from_pretrained(
            path, subfolder="vae", dtype=torch.float32, use_safetensors=True
        )
        return load_pipeline_on_cpu(
            kind, path, dtype, vae=as_dtype(fine, torch.float32), **parts
        )

    return load_weights(load, weights, what, REFINE)


def revision(weights: str) -> str:
    """Which weights exactly: the hub's commit; `""` of a folder."""
    main = hub_folder(weights) / "refs" / "main"
    return main.read_text(encoding="utf-8").strip() if main.is_file() else ""


def place_pipeline(pipe: Any, device: str) -> str:
    """Moves a pipeline to where it runs, and says how: `none`, all of it now.

    `model`, each part when it is needed.
    """
    if device.startswith("cuda") and importlib.util.find_spec("accelerate"):
        free, _ = torch.cuda.mem_get_info(device)
        if _bytes(pipe) > FULL * free:
            pipe.enable_model_cpu_offload(device=device)
            return "model"
    pipe.to(device)
    return "none"


def _bytes(pipe: Any) -> int:
    """Of all weights."""
    parts = [
        part for part in pipe.components.values() if isinstance(part, torch.nn.Module)
    ]
    return sum(
        p.numel() * p.element_size() for part in parts for p in part.parameters()
    )


@dataclass(frozen=True)
class Schedule:
    """The steps that run."""

    name: str
    """The scheduler's class."""
    times: torch.Tensor
    """(count,): the level of noise that each step passes to the model."""
    noised: Callable[
        [F32, F32, int], F32
    ]  # latents, noise and step k -> latents as noisy as step k begins
    stepped: Callable[
        [F32, F32, int], F32
    ]  # the model's say, latents and step k -> latents after it


def ddim(scheduler: Any, steps: int, count: int) -> Schedule:
    """The last `count` of `steps` by DDIM (Song et al. 2021), deterministic; `scheduler` is left as it is.

    The libraries' own step goes 1000 // `steps` levels on, which is where the next begins only if `steps` divides 1000:
    else noise would stay. Here every step ends where the next begins, and the last at the picture itself.
    """
    config, kept = scheduler.config, scheduler.alphas_cumprod.numpy().astype(np.float64)
    times = levels(len(kept), steps, config.steps_offset)[-count:]
    a = np.append(kept[times], 1.0)
    signal, noise_part = (
        np.sqrt(a).astype(np.float32),
        np.sqrt(1 - a).astype(np.float32),
    )

    def noised(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray(signal[k] * latents + noise_part[k] * noise, np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        s, n = signal[k], noise_part[k]
        if config.prediction_type == "v_prediction":
            z0, noise = s * latents - n * prediction, s * prediction + n * latents
        else:
            z0, noise = (latents - n * prediction) / s, prediction
        return np.asarray(signal[k + 1] * z0 + noise_part[k + 1] * noise, np.float32)

    return Schedule(type(scheduler).__name__, torch.from_numpy(times), noised, stepped)


def levels(most: int, steps: int, offset: int) -> NDArray[np.int64]:
    """(steps,) of `most` levels, the noisiest first; diffusers' `leading` where `steps` divides `most`.

    >>> levels(1000, 4, 1).tolist()
    [751, 501, 251, 1]
    """
    down = np.arange(steps)[::-1]
    return np.minimum(np.floor(down * most / steps).astype(np.int64) + offset, most - 1)
