"""Loading, options, schedules, guidance and memory of all video diffusion models.

Schedulers of diffusers count their own steps. Here every step has its number, so that
windows, trials and repeated steps do not disturb each other.
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
from physgen.registry import Options, Setup, read_options
from physgen.weights import hub_folder

REFINE = Flag("--refine", "NAME:PATH")
LIBRARIES = ("diffusers", "transformers")
"""Libraries with the permitted classes of a pipeline's parts."""
FULL = 0.7
"""Share of a GPU's free memory above which weights are moved there part by part."""


def pipeline_index(weights: str, title: str) -> dict[str, Any]:
    """Read `model_index.json`: the pipeline of weights, and the classes of its
    parts.
    """
    index = load_weights(
        lambda path: dict(DiffusionPipeline.load_config(path)), weights, title, REFINE
    )
    # A part's entry is [library, class]. A class in the weights' own folder would be
    # imported from there, and run its code.
    for part, kind in index.items():
        if isinstance(kind, list) and kind[0] not in (
            None,
            *LIBRARIES,
        ):  # a module of its own: a program
            raise Message.WEIGHTS_RUN_CODE.error(
                REFINE.name, f'"{weights}"', kind=kind[0], part=part
            )
    return index


def part_config(weights: str, part: str, title: str) -> dict[str, Any]:
    """Read `config.json` of a part; `""` for weights that are a single part."""
    if part:
        subfolder = {"subfolder": part}
    else:
        subfolder = {}
    return load_weights(
        lambda path: dict(AutoencoderKL.load_config(path, **subfolder)),
        weights,
        title,
        REFINE,
    )


def load_pipeline(
    kind: Any, weights: str, dtype: torch.dtype, title: str, vae: Any, **parts: Any
) -> Any:
    """Load the pipeline on the processor, with its VAE (of the class `vae`) in float32.

    In bfloat16 a grey level is about the resolution of a VAE's numbers, and the result
    is a difference of two decoded videos.
    """

    def load(path: str) -> Any:
        fine = vae.from_pretrained(
            path, subfolder="vae", dtype=torch.float32, use_safetensors=True
        )
        return load_pipeline_on_cpu(
            kind, path, dtype, vae=as_dtype(fine, torch.float32), **parts
        )

    return load_weights(load, weights, title, REFINE)


def check_pipeline_class(
    weights: str, class_name: str, known_classes: tuple[str, ...], title: str
) -> None:
    """Raise InputError if the pipeline class is not among `known_classes`."""
    if class_name not in known_classes:
        raise Message.WRONG_WEIGHTS.error(
            REFINE.name,
            f'"{weights}"',
            known=known_classes[0],
            kind=class_name,
            purpose=title,
        )


def revision(weights: str) -> str:
    """Return the hub's commit of the weights; `""` for a folder."""
    main = hub_folder(weights) / "refs" / "main"
    # The hub's cache keeps the commit of a branch in a file of its own.
    if main.is_file():
        return main.read_text(encoding="utf-8").strip()
    return ""


def place_pipeline(pipe: Any, device: str) -> str:
    """Move a pipeline to its device; return the way: `none` for all at once.

    `model`: each part is moved when it is needed.
    """
    # Activations need the rest of the memory, so weights may take only a share of it.
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
    """The steps of a run."""

    name: str
    """Class of the scheduler."""
    times: torch.Tensor
    """Noise level of each step for the model, (count,)."""
    add_noise: Callable[[F32, F32, int], F32]
    """From latents, noise and k to latents at the noise level of step k's start."""
    step: Callable[[F32, F32, int], F32]
    """From prediction, latents and k to the latents after step k."""


def ddim(scheduler: Any, steps: int, count: int) -> Schedule:
    """Return the last `count` of `steps` by deterministic DDIM (Song et al. 2021).

    `scheduler` is not changed. The libraries' own step leads 1000 // `steps` levels on,
    which is the begin of the next one only if `steps` divides 1000; otherwise noise
    would remain. Here every step ends at the begin of the next one, and the last at the
    picture.
    """
    config, alphas = (
        scheduler.config,
        scheduler.alphas_cumprod.numpy().astype(np.float64),
    )
    times = levels(len(alphas), steps, config.steps_offset)[-count:]
    # The schedule ends at the picture itself, which is signal without noise.
    a = np.append(alphas[times], 1.0)
    # Variance-preserving noise: x = sqrt(a) picture + sqrt(1 - a) noise.
    signal, noise_part = (
        np.sqrt(a).astype(np.float32),
        np.sqrt(1 - a).astype(np.float32),
    )

    def add_noise(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray(signal[k] * latents + noise_part[k] * noise, np.float32)

    def step(prediction: F32, latents: F32, k: int) -> F32:
        s = signal[k]
        n = noise_part[k]
        # Recover picture and noise from the prediction, whichever of both it contains.
        if config.prediction_type == "v_prediction":
            z0 = s * latents - n * prediction
            noise = s * prediction + n * latents
        else:
            z0 = (latents - n * prediction) / s
            noise = prediction
        return np.asarray(signal[k + 1] * z0 + noise_part[k + 1] * noise, np.float32)

    # The last `count` levels only: the refinement begins in the middle of the schedule
    # (Algorithm 1 of the paper).
    return Schedule(type(scheduler).__name__, torch.from_numpy(times), add_noise, step)


def levels(count: int, steps: int, offset: int) -> NDArray[np.int64]:
    """Return (steps,) of `count` noise levels, the noisiest first.

    They equal diffusers' `leading` spacing if `steps` divides `count`.

    >>> levels(1000, 4, 1).tolist()
    [751, 501, 251, 1]
    """
    down = np.arange(steps)[::-1]
    return np.minimum(
        np.floor(down * count / steps).astype(np.int64) + offset, count - 1
    )


def euler(scheduler: Any, steps: int, count: int, **settings: Any) -> Schedule:
    """Return the last `count` of `steps` of a straight flow from noise to data.

    Euler's method (Lipman et al. 2023). `settings` are further arguments of the
    scheduler's `set_timesteps`.
    """
    scheduler.set_timesteps(steps, **settings)
    # The noise levels have one more entry than the steps: the end of the last.
    times, sigmas = (
        scheduler.timesteps[-count:],
        scheduler.sigmas[-count - 1 :].numpy().astype(np.float32),
    )

    def add_noise(latents: F32, noise: F32, k: int) -> F32:
        return np.asarray((1 - sigmas[k]) * latents + sigmas[k] * noise, np.float32)

    # The network predicts the velocity noise - data of a straight path, on which
    # Euler's step is exact.
    def step(prediction: F32, latents: F32, k: int) -> F32:
        return np.asarray(
            latents + (sigmas[k + 1] - sigmas[k]) * prediction, np.float32
        )

    return Schedule(type(scheduler).__name__, times, add_noise, step)


OPTIONS: Options = {
    "resolution": (None, {"type": "integer", "minimum": 16}),
    "window": (None, {"type": "integer", "minimum": 1}),
}
"""Each backend's section of physgen.toml.

`resolution`: side, px, of a square with the largest area of a frame in the model;
`window`: number of frames in the model at a time. Both are those of its training by
default.
"""


class Network(Protocol):
    """Loaded weights: tensors in, tensors out, on the device."""

    pipe: Any

    def schedule(self, steps: int, count: int, shape: torch.Size) -> Schedule:
        """Return the last `count` of `steps` for windows of latents of this shape, (F',
        C, h, w).
        """
        ...

    def encode_text(self, text: str) -> Any:
        """Encode a text for `predict`."""
        ...

    def condition(self, frame: Tensor, latents: int) -> Any:
        """Encode the first frame of a window, (3, H, W) in -1..1; None for models
        without frames.

        `latents`: number of latent frames of the window.
        """
        ...

    def encode(self, video: Tensor) -> Tensor:
        """Encode (F, 3, H, W) in -1..1 on the processor as (F', C, h, w)."""
        ...

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """Decode (F', C, h, w) on the processor to (f, 3, H, W) in -1..1, in parts."""
        ...

    def predict(
        self, latents: Tensor, time: Tensor, text: Any, condition: Any
    ) -> Tensor:
        """Predict for latents (F', C, h, w) on the processor at a noise level."""
        ...


@dataclass(frozen=True)
class TrainingSettings:
    """Limits of the training, from the configurations of the weights."""

    grid: Grid
    max_frames: int
    """Maximum number of frames in one pass of the model."""


@dataclass(frozen=True)
class Kind:
    """The description of a backend by its own file."""

    name: str
    title: str
    """Name in messages."""
    guidance: float
    """Weight of the texts recommended by the authors."""
    read_training: Callable[[tuple[str, ...]], TrainingSettings]
    """Reads only configurations. Raises InputError for weights of another model."""
    load: Callable[[tuple[str, ...], str, torch.dtype], Network]
    """From weights, the future device and the type to the network on the processor."""


@dataclass(frozen=True)
class Run:
    """The state of one video."""

    schedule: Schedule
    frames: Sequence[U8]
    guidance: float
    text: Any
    negative: Any
    """Encoded description of content to avoid; None without guidance."""
    conditions: dict[int, Any] = field(default_factory=dict)
    """Conditions by the first latent frame of a window."""


class Sampler:
    """A backend of `refine`; it loads its model for the first video."""

    def __init__(self, kind: Kind, setup: Setup) -> None:
        """Check device, type, options and weights. Raises InputError; loads no weights
        yet.
        """
        self._kind = kind
        self._options = read_options(setup, kind.name, OPTIONS)
        self._weights = weight_ids("refine", kind.name, setup, REFINE)
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        # Check that the weights are on the disk or can be downloaded.
        collect(
            partial(load_weights, lambda _: None, weights, kind.title, REFINE)
            for weights in self._weights
        )
        self._trained = kind.read_training(self._weights)
        self.grid = self._apply_grid_options()
        self._offload = "none"
        self._tiled = False
        self._run: Run | None = None

    def _apply_grid_options(self) -> Grid:
        """Return the grid, changed by the options."""
        grid, side, window = (
            self._trained.grid,
            self._options["resolution"],
            self._options["window"],
        )
        if side:
            grid = replace(grid, area=side * side)
        if window:
            if window > self._trained.max_frames:
                window_text, most_frames = (
                    f"{self._kind.name}.window: {window}",
                    self._trained.max_frames,
                )
                raise Message.TOO_MANY_FRAMES.error(
                    "physgen.toml", window_text, most=most_frames
                )
            grid = replace(grid, window=latent_frames(window, grid))
        return grid

    @cached_property
    def _network(self) -> Network:
        """Load the network and place it on the device."""
        network = self._kind.load(self._weights, self._device, self._dtype)

        def place(_: str) -> str:
            return place_pipeline(network.pipe, self._device)

        self._offload = load_weights(place, self._weights[0], self._kind.title, REFINE)
        return network

    def begin(
        self, frames: Sequence[U8], prompt: PromptSettings, steps: int, count: int
    ) -> F32:
        """Encode the frames; see `Denoiser`."""
        network = self._network
        with memory_errors():
            vae = network.pipe.vae
            self._tiled = (
                frames[0].shape[0] * frames[0].shape[1] > self._trained.grid.area
            )
            vae.enable_tiling() if self._tiled else vae.disable_tiling()
            if prompt.guidance is None:
                guidance = self._kind.guidance
            else:
                guidance = prompt.guidance
            text = network.encode_text(prompt.prompt)
            # A weight of 1 or less needs no second prediction: the prompt alone counts.
            if guidance > 1:
                negative = network.encode_text(prompt.negative)
            else:
                negative = None
            # Free the GPU of the text encoder before the VAE runs.
            network.pipe.maybe_free_model_hooks()
            encoded = network.encode(_video(frames))
            # Schedules of some models depend on the number of tokens in a window.
            window = encoded[: self.grid.window].shape
            schedule = network.schedule(steps, count, window)
            self._run = Run(schedule, frames, guidance, text, negative)
            latents = _array(encoded)
            # Free the GPU of the VAE before the denoiser runs.
            network.pipe.maybe_free_model_hooks()
        return latents

    def add_noise(self, latents: F32, noise: F32, k: int) -> F32:
        """Return noisy latents; see `Denoiser`."""
        schedule = self._at().schedule
        # After the last step there is no noise: the guidance is added as it is.
        if k < len(schedule.times):
            return schedule.add_noise(latents, noise, k)
        return latents

    def predict(self, latents: F32, k: int, first: int) -> F32:
        """Predict a step with guidance; see `Denoiser`."""
        run, network = self._at(), self._network
        with memory_errors():
            # The condition of a window is the same in every step.
            if first not in run.conditions:
                frame = _video([run.frames[self._frame(first)]])[0]
                run.conditions[first] = network.condition(frame, len(latents))
            condition = run.conditions[first]
            z, time = torch.from_numpy(latents), run.schedule.times[k]
            guided_prediction = _array(network.predict(z, time, run.text, condition))
            if run.negative is None:
                return guided_prediction
            # One after the other: both together would take twice the memory.
            free = _array(network.predict(z, time, run.negative, condition))
        # Classifier-free guidance: move away from the unwanted description, in the
        # direction of the prompt.
        return np.asarray(
            free + np.float32(run.guidance) * (guided_prediction - free), np.float32
        )

    def _frame(self, latent: int) -> int:
        """Return the first frame of a window that begins with this latent frame."""
        if latent:
            return frames_held(latent, self.grid)
        return 0

    def step(self, prediction: F32, latents: F32, k: int) -> F32:
        """Return the latents after a step; see `Denoiser`."""
        return self._at().schedule.step(prediction, latents, k)

    def decode(self, latents: F32) -> Iterator[F32]:
        """Decode latents; see `Denoiser`."""
        parts = self._network.decode(torch.from_numpy(latents))
        # A generator cannot hold `memory_errors` open across a yield: errors of the
        # caller would pass through it.
        while True:
            with memory_errors():
                part = next(parts, None)
                if part is None:
                    frames = None
                else:
                    # From -1..1, channels first, to 0..1, channels last.
                    frames = _array((part / 2 + 0.5).permute(0, 2, 3, 1))
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
        """Return the present run."""
        assert self._run is not None, "begin comes first"
        return self._run


@contextmanager
def memory_errors() -> Iterator[None]:
    """Run inference; if the device's memory does not suffice, free it and raise
    MemoryError.
    """
    try:
        # inference_mode is impossible, since offloading replaces parameters' tensors.
        with torch.no_grad():
            yield
    except (RuntimeError, MemoryError) as error:
        if not is_out_of_memory(error):
            raise
        # The frames of the traceback refer to the tensors of the failed step.
        traceback.clear_frames(error.__traceback__)
        free_memory()
        raise MemoryError(str(error)) from None


def _video(frames: Sequence[U8]) -> Tensor:
    """Return the video, (F, 3, H, W) in -1..1."""
    video = torch.empty((len(frames), 3, *frames[0].shape[:2]), dtype=torch.float32)
    # Convert frame by frame, so that the clip is in memory only once.
    for place, frame in zip(video, frames, strict=True):
        place.copy_(torch.from_numpy(frame).permute(2, 0, 1)).div_(127.5).sub_(1)
    return video


def _array(values: Tensor) -> F32:
    """Convert a tensor to float32 on the processor."""
    return np.asarray(values.to("cpu", torch.float32).numpy(), np.float32)
