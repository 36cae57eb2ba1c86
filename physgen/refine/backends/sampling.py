"""Loading, options, schedules, guidance and memory shared by the video diffusion models.

Schedulers of diffusers count their own steps. Here every step is given by number, so that windows, trials and repeated
steps cannot disturb one another.
"""

from __future__ import annotations

import importlib.util
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Protocol

import diffusers
import numpy as np
import torch
from diffusers import AutoencoderKL, DiffusionPipeline
from numpy.typing import NDArray
from torch import Tensor

from physgen.messages import Message
from physgen.perceive.backends.models import (
    Flag,
    as_dtype,
    device_of,
    dtype_of,
    free_memory,
    is_out_of_memory,
    load_pipeline_on_cpu,
    load_weights,
    run_note,
    weight_ids,
)
from physgen.problems import collect
from physgen.refine.denoiser import F32, U8, Grid, PromptSettings
from physgen.refine.latents import frames_held, latent_frames
from physgen.registry import Options, Setup, hub_folder, read_options

REFINE = Flag("--refine", "NAME:PATH")
LIBRARIES = ("diffusers", "transformers")
"""Whose classes the parts of a pipeline may be."""
FULL = 0.7
"""Of a GPU's free memory that weights may take before they are moved there in turn only."""


def pipeline_index(weights: str, what: str) -> dict[str, Any]:
    """Return `model_index.json`: which pipeline weights are of, and of which classes its parts are."""
    index = load_weights(
        lambda path: dict(DiffusionPipeline.load_config(path)), weights, what, REFINE
    )
    for part, kind in index.items():
        if isinstance(kind, list) and kind[0] not in (
            None,
            *LIBRARIES,
        ):  # a module of its own: a program
            raise Message.WEIGHTS_RUN_CODE.error(
                REFINE.name, f'"{weights}"', kind=kind[0], part=part
            )
    return index


def part_config(weights: str, part: str, what: str) -> dict[str, Any]:
    """Return `config.json` of a part, `""` for weights that are one."""
    subfolder = {"subfolder": part} if part else {}
    return load_weights(
        lambda path: dict(AutoencoderKL.load_config(path, **subfolder)),
        weights,
        what,
        REFINE,
    )


def load_pipeline(
    kind: Any, weights: str, dtype: torch.dtype, what: str, vae: Any, **parts: Any
) -> Any:
    """Return the pipeline, on the processor, its VAE (of the class `vae`) in float32.

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


def check_pipeline_class(
    weights: str, found: str, known: tuple[str, ...], what: str
) -> None:
    """Raises InputError where the pipeline `found` is none of those `known`."""
    if found not in known:
        raise Message.WRONG_WEIGHTS.error(
            REFINE.name, f'"{weights}"', known=known[0], kind=found, purpose=what
        )


def revision(weights: str) -> str:
    """Return the hub's commit of the weights, `""` for a folder."""
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
    """Return the number of bytes of all weights."""
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
    """Return the last `count` of `steps` by DDIM (Song et al. 2021), deterministic; `scheduler` is left as it is.

    The libraries' own step goes 1000 // `steps` levels on, which is where the next begins only if `steps` divides 1000:
    else noise would stay. Here every step ends where the next begins, and the last at the picture itself.
    """
    config, alphas = (
        scheduler.config,
        scheduler.alphas_cumprod.numpy().astype(np.float64),
    )
    times = levels(len(alphas), steps, config.steps_offset)[-count:]
    a = np.append(alphas[times], 1.0)
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


def euler(scheduler: Any, steps: int, count: int, **settings: Any) -> Schedule:
    """Return the last `count` of `steps` of a straight flow from noise to data, by Euler's method (Lipman et al. 2023).

    `settings` are further arguments of the scheduler's `set_timesteps`.
    """
    scheduler.set_timesteps(steps, **settings)
    times, sigmas = (
        scheduler.timesteps[-count:],
        scheduler.sigmas[-count - 1 :].numpy().astype(np.float32),
    )

    def noised(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray((1 - sigmas[k]) * latents + sigmas[k] * noise, np.float32)

    def stepped(prediction: F32, latents: F32, k: int) -> F32:
        return np.asarray(
            latents + (sigmas[k + 1] - sigmas[k]) * prediction, np.float32
        )

    return Schedule(type(scheduler).__name__, times, noised, stepped)


OPTIONS: Options = {
    "resolution": (None, {"type": "integer", "minimum": 16}),
    "window": (None, {"type": "integer", "minimum": 1}),
}
"""Each backend's section of physgen.toml.

`resolution`: px, the side of the square whose area the model is shown at most; `window`: frames that it sees at a
time; both as it was trained if left out.
"""


class Network(Protocol):
    """Loaded weights: tensors in, tensors out, on the device."""

    pipe: Any

    def schedule(self, steps: int, count: int, shape: torch.Size) -> Schedule:
        """Return the last `count` of `steps` for windows of latents of this shape, (F', C, h, w)."""
        ...

    def encode_text(self, text: str) -> Any:
        """What the model understands of a text, as `predict` takes it."""
        ...

    def condition(self, frame: Tensor, latents: int) -> Any:
        """What a window of so many latent frames gets of its first frame, (3, H, W) in -1..1; None: only words."""
        ...

    def encode(self, video: Tensor) -> Tensor:
        """(F, 3, H, W) in -1..1 on the processor -> (F', C, h, w)."""
        ...

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """(F', C, h, w) on the processor -> (f, 3, H, W) in -1..1, some frames at a time."""
        ...

    def predict(
        self, latents: Tensor, time: Tensor, text: Any, condition: Any
    ) -> Tensor:
        """What the model says of (F', C, h, w) on the processor at a level of noise."""
        ...


@dataclass(frozen=True)
class TrainingSettings:
    """What the weights were trained on, as their configurations say."""

    grid: Grid
    most: int
    """Frames that the model can see at a time."""


@dataclass(frozen=True)
class Kind:
    """What a backend's own file knows."""

    name: str
    what: str
    """In messages."""
    guidance: float
    """How much the model listens to words, as its authors advise."""
    trained: Callable[[tuple[str, ...]], TrainingSettings]
    """Reads configurations alone. Raises InputError for weights of another model."""
    load: Callable[[tuple[str, ...], str, torch.dtype], Network]
    """Weights, the device to come and their type -> the network, on the processor still."""


@dataclass(frozen=True)
class Run:
    """One video under way."""

    schedule: Schedule
    frames: Sequence[U8]
    guidance: float
    text: Any
    negative: Any
    """What shall not be seen; None: the model is not guided."""
    conditions: dict[int, Any] = field(default_factory=dict)
    """By the first latent frame of a window."""


class Sampler:
    """A backend of `refine`; its model is loaded when the first video begins."""

    def __init__(self, kind: Kind, setup: Setup) -> None:
        """Raises InputError for a device, a type, options or weights that cannot be; no weights are loaded yet."""
        self._kind = kind
        self._options = read_options(setup, kind.name, OPTIONS)
        self._weights = weight_ids("refine", kind.name, setup, REFINE)
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        # are they here, or to be had
        collect(
            partial(load_weights, lambda _: None, weights, kind.what, REFINE)
            for weights in self._weights
        )
        self._trained = kind.trained(self._weights)
        self.grid = self._asked()
        self._offload = "none"
        self._tiled = False
        self._run: Run | None = None

    def _asked(self) -> Grid:
        """Return the grid with what the options say."""
        grid, side, window = (
            self._trained.grid,
            self._options["resolution"],
            self._options["window"],
        )
        if side:
            grid = replace(grid, area=side * side)
        if window:
            if window > self._trained.most:
                window_text, most_frames = (
                    f"{self._kind.name}.window: {window}",
                    self._trained.most,
                )
                raise Message.TOO_MANY_FRAMES.error(
                    "physgen.toml", window_text, most=most_frames
                )
            grid = replace(grid, window=latent_frames(window, grid))
        return grid

    @cached_property
    def _network(self) -> Network:
        network = self._kind.load(self._weights, self._device, self._dtype)

        def place(_: str) -> str:
            return place_pipeline(network.pipe, self._device)

        self._offload = load_weights(place, self._weights[0], self._kind.what, REFINE)
        return network

    def begin(
        self, frames: Sequence[U8], prompt: PromptSettings, steps: int, count: int
    ) -> F32:
        """See `Denoiser`."""
        network = self._network
        with memory_errors():
            vae = network.pipe.vae
            self._tiled = (
                frames[0].shape[0] * frames[0].shape[1] > self._trained.grid.area
            )
            vae.enable_tiling() if self._tiled else vae.disable_tiling()
            guidance = (
                self._kind.guidance if prompt.guidance is None else prompt.guidance
            )
            text = network.encode_text(prompt.prompt)
            negative = network.encode_text(prompt.negative) if guidance > 1 else None
            network.pipe.maybe_free_model_hooks()  # what reads text leaves the GPU to what reads frames
            encoded = network.encode(_video(frames))
            window = encoded[: self.grid.window].shape
            schedule = network.schedule(steps, count, window)
            self._run = Run(schedule, frames, guidance, text, negative)
            latents = _array(encoded)
            network.pipe.maybe_free_model_hooks()  # and that to what denoises
        return latents

    def noised(self, latents: F32, noise: F32, k: int) -> F32:
        """See `Denoiser`."""
        schedule = self._at().schedule
        return (
            schedule.noised(latents, noise, k) if k < len(schedule.times) else latents
        )

    def predict(self, latents: F32, k: int, first: int) -> F32:
        """See `Denoiser`."""
        run, network = self._at(), self._network
        with memory_errors():
            if first not in run.conditions:
                frame = _video([run.frames[self._frame(first)]])[0]
                run.conditions[first] = network.condition(frame, len(latents))
            condition = run.conditions[first]
            z, time = torch.from_numpy(latents), run.schedule.times[k]
            guided_prediction = _array(network.predict(z, time, run.text, condition))
            if run.negative is None:
                return guided_prediction
            free = _array(
                network.predict(z, time, run.negative, condition)
            )  # in turn: half the memory of both at once
        return np.asarray(
            free + np.float32(run.guidance) * (guided_prediction - free), np.float32
        )

    def _frame(self, latent: int) -> int:
        """Return the frame from which a window that begins with this latent frame starts."""
        return frames_held(latent, self.grid) if latent else 0

    def stepped(self, prediction: F32, latents: F32, k: int) -> F32:
        """See `Denoiser`."""
        return self._at().schedule.stepped(prediction, latents, k)

    def decode(self, latents: F32) -> Iterator[F32]:
        """See `Denoiser`."""
        parts = self._network.decode(torch.from_numpy(latents))
        while True:
            with memory_errors():
                part = next(parts, None)
                frames = (
                    None
                    if part is None
                    else _array((part / 2 + 0.5).permute(0, 2, 3, 1))
                )
            if frames is None:
                return
            yield frames

    def note(self) -> Mapping[str, Any]:
        """Return the note for the record."""
        run = self._run
        note = {
            **self._options,
            "offload": self._offload,
            "tiling": self._tiled,
            "revision": ",".join(map(revision, self._weights)),
            "scheduler": run.schedule.name if run else "",
            "guidance": run.guidance if run else None,
            "torch": torch.__version__,
            "diffusers": diffusers.__version__,
        }
        return run_note(self._device, self._dtype, ",".join(self._weights), note)

    def load(self) -> None:
        """Load the model now."""
        _ = self._network

    def close(self) -> None:
        """Drop the model."""
        self.__dict__.pop("_network", None)
        self._run = None
        free_memory()

    def _at(self) -> Run:
        assert self._run is not None, "begin comes first"
        return self._run


@contextmanager
def memory_errors() -> Iterator[None]:
    """Inference; where a device's memory does not suffice, all is given back and MemoryError raised."""
    try:
        with (
            torch.no_grad()
        ):  # not inference_mode: offloading puts other tensors into parameters
            yield
    except (RuntimeError, MemoryError) as error:
        if not is_out_of_memory(error):
            raise
        traceback.clear_frames(error.__traceback__)  # what the step held
        free_memory()
        raise MemoryError(str(error)) from None


def _video(frames: Sequence[U8]) -> Tensor:
    """Return the video, (F, 3, H, W) in -1..1."""
    video = torch.empty((len(frames), 3, *frames[0].shape[:2]), dtype=torch.float32)
    for place, frame in zip(
        video, frames, strict=True
    ):  # one by one: the clip is held once
        place.copy_(torch.from_numpy(frame).permute(2, 0, 1)).div_(127.5).sub_(1)
    return video


def _array(values: Tensor) -> F32:
    return np.asarray(values.to("cpu", torch.float32).numpy(), np.float32)
