"""AnimateDiff (Guo et al. 2024): a motion adapter within a Stable Diffusion 1.5, every frame a latent.

Its frames are to be of about 512 x 512 px, and 16 of them seen at a time.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import diffusers
import numpy as np
import torch
from diffusers import (
    AnimateDiffVideoToVideoPipeline,
    AutoencoderKL,
    DDIMScheduler,
    MotionAdapter,
)
from torch import Tensor

from physgen.perceive.backends.models import (
    as_dtype,
    device_of,
    dtype_of,
    free_memory,
    is_out_of_memory,
    load_weights,
    run_note,
    weight_ids,
)
from physgen.problems import InputError, collect
from physgen.refine.backends.sampling import (
    REFINE,
    Schedule,
    ddim,
    load_pipeline,
    part_config,
    pipeline_index,
    place_pipeline,
    revision,
)
from physgen.refine.denoiser import F32, U8, Grid, PromptSettings
from physgen.registry import Options, Setup, find, read_options

NAME, WHAT = "animatediff", "AnimateDiff"
GUIDANCE = 8.0
"""How much it listens to words unless the scene says so: as upstream guides SEINE."""
FRAMES = 16
"""That its adapters were trained on, whatever they can take."""
CHUNK = 8
"""Frames that its VAE takes at a time."""


OPTIONS: Options = {
    "resolution": (None, {"type": "integer", "minimum": 16}),
    "window": (None, {"type": "integer", "minimum": 1}),
}
"""Each backend's section of physgen.toml.

`resolution`: px, the side of the square whose area the model is shown at most; `window`: frames that it sees at a
time; both as it was trained if left out.
"""


@dataclass(frozen=True)
class Trained:
    """What the weights were trained on, as their configurations say."""

    grid: Grid
    most: int
    """Frames that the model can see at a time."""


class AnimateDiff:
    """Loaded weights: tensors in, tensors out, on the device."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        pipe.register_modules(
            motion_adapter=None
        )  # the network has it now: 1.7 GB twice
        # the authors' own: PNDM, which most such weights bring, takes steps twice. Spaced so, every step ends where the
        # next begins (with `linspace` 8 steps of 1000 end 18 early), and the last at the picture itself
        self._scheduler = DDIMScheduler.from_config(
            pipe.scheduler.config, clip_sample=False, timestep_spacing="leading", beta_schedule="linear",
            steps_offset=1, set_alpha_to_one=True,
        )  # fmt: skip

    def schedule(self, steps: int, count: int) -> Schedule:
        """Return the DDIM schedule."""
        return ddim(self._scheduler, steps, count)

    def encode_text(self, text: str) -> Tensor:
        """Encode a text as (1, 77, width)."""
        found: Tensor = self.pipe.encode_prompt(text, self._device, 1, False)[0]
        return found

    def encode(self, video: Tensor) -> Tensor:
        """Encode (F, 3, H, W) in -1..1 on the processor as (F, C, h, w): the mean of each frame, some at a time."""
        vae = self.pipe.vae
        found = [
            vae.encode(part.to(self._device)).latent_dist.mode()
            for part in video.split(CHUNK)
        ]
        return torch.cat(found) * vae.config.scaling_factor

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """Decode (F, C, h, w) on the processor to (f, 3, H, W) in -1..1, some frames at a time."""
        vae = self.pipe.vae
        for part in latents.split(CHUNK):
            yield vae.decode(part.to(self._device) / vae.config.scaling_factor).sample

    def predict(self, latents: Tensor, time: Tensor, text: Tensor) -> Tensor:
        """(F, C, h, w): the network takes (1, C, F, h, w)."""
        z = latents.to(self._device, self._dtype).transpose(0, 1)[None]
        words = text.repeat_interleave(len(latents), dim=0)
        found: Tensor = self.pipe.unet(
            z, time.to(self._device), encoder_hidden_states=words
        ).sample
        return found[0].transpose(0, 1)


def trained(weights: tuple[str, ...]) -> Trained:
    """What the configurations say."""
    adapter, base = weights
    found, motion = pipeline_index(base, WHAT), part_config(adapter, "", WHAT)
    kind = str(motion.get("_class_name"))
    if kind != "MotionAdapter":
        fix = f"name a motion adapter first, e.g. {find('refine', 'animatediff').weights[0].id}"
        raise InputError.of(
            REFINE.name, f'"{adapter}"', f"is a {kind}: no motion adapter", fix
        )
    plain = (
        found.get("unet", ["", ""])[1] == "UNet2DConditionModel"
        and "text_encoder_2" not in found
    )
    unet = part_config(base, "unet", WHAT) if plain else {}
    if list(motion["block_out_channels"]) != list(unet.get("block_out_channels", [])):
        what = f"is a {found.get('_class_name')} that the adapter does not fit"
        fix = "name weights of Stable Diffusion 1.5 after the comma"
        raise InputError.of(REFINE.name, f'"{base}"', what, fix)
    vae, most = part_config(base, "vae", WHAT), motion.get("motion_max_seq_length", 32)
    cell = 2 ** (len(vae["block_out_channels"]) - 1)
    levels = 2 ** (len(unet["block_out_channels"]) - 1)
    side = unet.get("sample_size") or 64
    return Trained(
        Grid(cell, cell * levels, (side * cell) ** 2, min(FRAMES, most)), most
    )


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> AnimateDiff:
    """The pipeline."""
    adapter, base = weights

    def motion(path: str) -> Any:
        return as_dtype(
            MotionAdapter.from_pretrained(path, dtype=dtype, use_safetensors=True),
            dtype,
        )

    part = load_weights(motion, adapter, WHAT, REFINE)
    kind = AnimateDiffVideoToVideoPipeline
    return AnimateDiff(
        load_pipeline(kind, base, dtype, WHAT, AutoencoderKL, motion_adapter=part),
        device,
        dtype,
    )


@dataclass(frozen=True)
class Run:
    """One video under way."""

    schedule: Schedule
    guidance: float
    text: Tensor
    negative: Tensor | None
    """What shall not be seen; None: the model is not guided."""


class Sampler:
    """The backend `animatediff`.

    Its weights are `ADAPTER,BASE`, loaded when the first video begins.
    """

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for a device, a type, options or weights that cannot be.

        No weights are loaded yet.
        """
        self._options = read_options(setup, NAME, OPTIONS)
        self._weights = weight_ids("refine", NAME, setup, REFINE)
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        # are they here, or to be had
        collect(
            partial(load_weights, lambda _: None, weights, WHAT, REFINE)
            for weights in self._weights
        )
        self._trained = trained(self._weights)
        self.grid = self._asked()
        self._offload = "none"
        self._tiled = False
        self._run: Run | None = None

    def _asked(self) -> Grid:
        """The grid with what the options say."""
        grid, side, window = (
            self._trained.grid,
            self._options["resolution"],
            self._options["window"],
        )
        if side:
            grid = replace(grid, area=side * side)
        if window:
            if window > self._trained.most:
                found, most = f"{NAME}.window: {window}", self._trained.most
                fix = f"write at most {most}"
                raise InputError.of(
                    "physgen.toml",
                    found,
                    f"is more than the {most} frames that the model can see",
                    fix,
                )
            grid = replace(grid, window=window)
        return grid

    @cached_property
    def _network(self) -> AnimateDiff:
        network = load(self._weights, self._device, self._dtype)

        def place(_: str) -> str:
            return place_pipeline(network.pipe, self._device)

        self._offload = load_weights(place, self._weights[0], WHAT, REFINE)
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
            guidance = GUIDANCE if prompt.guidance is None else prompt.guidance
            text = network.encode_text(prompt.prompt)
            negative = network.encode_text(prompt.negative) if guidance > 1 else None
            network.pipe.maybe_free_model_hooks()  # what reads text leaves the GPU to what reads frames
            self._run = Run(network.schedule(steps, count), guidance, text, negative)
            latents = _array(network.encode(_video(frames)))
            network.pipe.maybe_free_model_hooks()  # and that to what denoises
        return latents

    def noised(self, latents: F32, noise: F32, k: int) -> F32:
        """See `Denoiser`."""
        schedule = self._at().schedule
        return (
            schedule.noised(latents, noise, k) if k < len(schedule.times) else latents
        )

    def predict(self, latents: F32, k: int) -> F32:
        """See `Denoiser`."""
        run, network = self._at(), self._network
        with memory_errors():
            z, time = torch.from_numpy(latents), run.schedule.times[k]
            guided = _array(network.predict(z, time, run.text))
            if run.negative is None:
                return guided
            free = _array(
                network.predict(z, time, run.negative)
            )  # in turn: half the memory of both at once
        return np.asarray(free + np.float32(run.guidance) * (guided - free), np.float32)

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
        """For the record."""
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

    def close(self) -> None:
        """The model goes."""
        self.__dict__.pop("_network", None)
        self._run = None
        free_memory()

    def _at(self) -> Run:
        assert self._run is not None, "begin comes first"
        return self._run


@contextmanager
def memory_errors() -> Iterator[None]:
    """Inference.

    Where a device's memory does not suffice, all is given back and MemoryError raised.
    """
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
    """(F, 3, H, W) in -1..1."""
    shown = torch.empty((len(frames), 3, *frames[0].shape[:2]), dtype=torch.float32)
    for place, frame in zip(
        shown, frames, strict=True
    ):  # one by one: the clip is held once
        place.copy_(torch.from_numpy(frame).permute(2, 0, 1)).div_(127.5).sub_(1)
    return shown


def _array(values: Tensor) -> F32:
    return np.asarray(values.to("cpu", torch.float32).numpy(), np.float32)


animatediff = Sampler
"""The factory named in the registry."""
