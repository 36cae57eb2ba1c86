"""A kind of model and a setup -> a `refine.roles.Denoiser`: loading, options, guidance by words, memory, the record."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import diffusers
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from physgen.backends import Setup
from physgen.perceive.backends.models import device_of, dtype_of, freed, loaded, noted, of_memory
from physgen.perceive.backends.options import OneOf, Option, Whole, read, switched
from physgen.problems import InputError, Problem
from physgen.refine.backends.loading import REFINE, may_offload, named, placed, revision
from physgen.refine.backends.schedules import Schedule
from physgen.refine.cells import frames_held, latent_frames
from physgen.refine.roles import Grid, Said

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
OPTIONS: dict[str, Option] = {
    "resolution": Whole(None, 16),
    "window": Whole(None, 1),
    "tiling": OneOf("auto", ("on", "off")),
    "offload": OneOf("auto", ("none", "model", "sequential")),
}
"""Each backend's table of physgen.toml.

`resolution`: px, the side of the square whose area the model is shown at most; `window`: frames that it sees at a
time; both as it was trained if left out. `tiling`: whether its VAE goes through frames in pieces; auto: where they are
larger than it was trained on. `offload`: whether its parts are on the GPU only while they are needed (model, by parts
of parts: sequential); auto: where they fill most of its memory.
"""


class Network(Protocol):
    """Loaded weights: tensors in, tensors out, on the device."""

    pipe: Any

    def schedule(self, steps: int, count: int) -> Schedule:
        """The last `count` of `steps`."""
        ...

    def told(self, text: str) -> Tensor:
        """What the model understands of a text."""
        ...

    def shown(self, frame: Tensor, latents: int) -> Any:
        """What a window of so many latent frames is told of its first, (3, H, W) in -1..1; None: only words."""
        ...

    def encode(self, video: Tensor) -> Tensor:
        """(F, 3, H, W) in -1..1 on the processor -> (F', C, h, w)."""
        ...

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """(F', C, h, w) on the processor -> (f, 3, H, W) in -1..1, some frames at a time."""
        ...

    def predict(self, latents: Tensor, time: Tensor, told: Tensor, shown: Any) -> Tensor:
        """What the model says of (F', C, h, w) on the processor at a level of noise."""
        ...


@dataclass(frozen=True)
class Trained:
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
    trained: Callable[[tuple[str, ...]], Trained]
    """Reads configurations alone. Raises InputError for weights of another model."""
    load: Callable[[tuple[str, ...], str, torch.dtype], Network]
    """Weights, the device to come and their type -> the network, on the processor still."""


@dataclass(frozen=True)
class Run:
    """One video under way."""

    schedule: Schedule
    frames: Sequence[U8]
    guidance: float
    told: Tensor
    untold: Tensor | None
    """What shall not be seen; None: the model is not guided."""
    shown: dict[int, Any] = field(default_factory=dict)
    """By the first latent frame of a window."""


class Sampler:
    """A backend of `refine`; its model is loaded when the first video begins."""

    def __init__(self, kind: Kind, setup: Setup) -> None:
        """Raises InputError for a device, a type, options or weights that cannot be; no weights are loaded yet."""
        self._kind = kind
        self._options = read(setup, kind.name, OPTIONS)
        self._options["tiling"] = switched(self._options["tiling"])
        self._weights = named(kind.name, setup.weights)
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        may_offload(kind.name, self._options["offload"], self._device)
        problems: list[Problem] = []
        for weights in self._weights:
            try:
                loaded(lambda _: None, weights, kind.what, REFINE)  # is it here, or to be had
            except InputError as error:
                problems += error.problems
        if problems:
            raise InputError(problems)
        self._trained = kind.trained(self._weights)
        self.grid = self._asked()
        self._offload = ""
        self._tiled = False
        self._run: Run | None = None

    def _asked(self) -> Grid:
        """The grid with what the options say."""
        grid, side, window = self._trained.grid, self._options["resolution"], self._options["window"]
        if side:
            grid = replace(grid, area=side * side)
        if window:
            if window > self._trained.most:
                found, most = f"{self._kind.name}.window: {window}", self._trained.most
                fix = f"write at most {most}"
                raise InputError.of(
                    "physgen.toml", found, f"is more than the {most} frames that the model can see", fix
                )
            grid = replace(grid, window=latent_frames(window, grid))
        return grid

    @cached_property
    def _network(self) -> Network:
        network = self._kind.load(self._weights, self._device, self._dtype)

        def place(_: str) -> str:
            return placed(network.pipe, self._options["offload"], self._device)

        self._offload = loaded(place, self._weights[0], self._kind.what, REFINE)
        return network

    def begin(self, frames: Sequence[U8], said: Said, steps: int, count: int) -> F32:
        """See `Denoiser`."""
        network = self._network
        with held_to_memory():
            self._tile(network.pipe.vae, frames[0].shape[0] * frames[0].shape[1])
            guidance = self._kind.guidance if said.guidance is None else said.guidance
            told = network.told(said.prompt)
            untold = network.told(said.negative) if guidance > 1 else None
            network.pipe.maybe_free_model_hooks()  # what reads text leaves the GPU to what reads frames
            self._run = Run(network.schedule(steps, count), frames, guidance, told, untold)
            latents = _array(network.encode(_video(frames)))
            network.pipe.maybe_free_model_hooks()  # and that to what denoises
        return latents

    def _tile(self, vae: Any, area: int) -> None:
        said = self._options["tiling"]
        self._tiled = area > self._trained.grid.area if said == "auto" else said == "on"
        if self._tiled:
            vae.enable_tiling()
        else:
            vae.disable_tiling()

    def noised(self, latents: F32, noise: F32, k: int) -> F32:
        """See `Denoiser`."""
        schedule = self._at().schedule
        return schedule.noised(latents, noise, k) if k < len(schedule.times) else latents

    def predict(self, latents: F32, k: int, first: int) -> F32:
        """See `Denoiser`."""
        run, network = self._at(), self._network
        with held_to_memory():
            if first not in run.shown:
                frame = frames_held(first, self.grid) if first else 0
                run.shown[first] = network.shown(_video(run.frames[frame : frame + 1])[0], len(latents))
            z, time, shown = torch.from_numpy(latents), run.schedule.times[k], run.shown[first]
            said = _array(network.predict(z, time, run.told, shown))
            if run.untold is None:
                return said
            free = _array(
                network.predict(z, time, run.untold, shown)
            )  # in turn: half the memory of both at once
        return np.asarray(free + np.float32(run.guidance) * (said - free), np.float32)

    def stepped(self, prediction: F32, latents: F32, k: int) -> F32:
        """See `Denoiser`."""
        return self._at().schedule.stepped(prediction, latents, k)

    def decode(self, latents: F32) -> Iterator[F32]:
        """See `Denoiser`."""
        parts = self._network.decode(torch.from_numpy(latents))
        while True:
            with held_to_memory():
                part = next(parts, None)
                frames = None if part is None else _array((part / 2 + 0.5).permute(0, 2, 3, 1))
            if frames is None:
                return
            yield frames

    def fits(self, side: int, frames: int) -> bool:
        """See `Denoiser`: a video of nothing is begun, stepped once and decoded."""
        freed()
        under_way, nothing = self._run, np.zeros((side, side, 3), np.uint8)
        try:
            latents = self.begin([nothing] * frames_held(frames, self.grid), Said("", "", None), 1, 1)
            self.predict(latents[: self.grid.window], 0, 0)
            for _ in self.decode(latents):
                pass
        except MemoryError:
            return False
        finally:
            self._run = under_way
        return True

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        run = self._run
        told = {
            **self._options,
            "offload": self._offload or self._options["offload"],
            "tiling": self._tiled,
            "revision": ",".join(self._revisions),
            "scheduler": run.schedule.name if run else "",
            "guidance": run.guidance if run else None,
            "torch": torch.__version__,
            "diffusers": diffusers.__version__,
        }
        return noted(self._device, self._dtype, ",".join(self._weights), told)

    @cached_property
    def _revisions(self) -> list[str]:
        return [revision(weights) for weights in self._weights]

    def close(self) -> None:
        """The model goes."""
        self.__dict__.pop("_network", None)
        self._run = None
        freed()

    def _at(self) -> Run:
        assert self._run is not None, "begin comes first"
        return self._run


@contextmanager
def held_to_memory() -> Iterator[None]:
    """Inference; where a device's memory does not suffice, all is given back and MemoryError raised."""
    try:
        with torch.no_grad():  # not inference_mode: offloading puts other tensors into parameters
            yield
    except (RuntimeError, MemoryError) as error:
        if not of_memory(error):
            raise
        traceback.clear_frames(error.__traceback__)  # what the step held
        freed()
        raise MemoryError(str(error)) from None


def _video(frames: Sequence[U8]) -> Tensor:
    """(F, 3, H, W) in -1..1."""
    shown = torch.empty((len(frames), 3, *frames[0].shape[:2]), dtype=torch.float32)
    for place, frame in zip(shown, frames, strict=True):  # one by one: the clip is held once
        place.copy_(torch.from_numpy(frame).permute(2, 0, 1)).div_(127.5).sub_(1)
    return shown


def _array(values: Tensor) -> F32:
    return np.asarray(values.to("cpu", torch.float32).numpy(), np.float32)
