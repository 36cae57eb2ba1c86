"""The protocol of a video diffusion model: arrays in, arrays out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Grid:
    """How a model cuts a video into latents."""

    cell: int  # px: a side of a latent's cells
    side: int  # px: sides of frames are multiples of it
    area: int  # px of the frames that the model was trained on; larger ones are refined at that size
    window: int  # latent frames that the model sees at a time, at most
    stride: int = 1
    """Frames of a latent frame; over 1, the first latent frame still has one frame alone."""


@dataclass(frozen=True)
class PromptSettings:
    """The texts that guide the model."""

    prompt: str
    negative: str
    """What shall not be seen."""
    guidance: float | None
    """How much it listens (classifier-free guidance, Ho and Salimans 2022).

    None: as its authors advise.
    """


@runtime_checkable
class Denoiser(Protocol):
    """A latent video diffusion model with its schedule of noise, and nothing of how it is used.

    Latents are (F', C, h, w) float32, scaled as the model wants them. MemoryError is raised where the device holds too
    little.
    """

    grid: Grid

    def begin(
        self, frames: Sequence[U8], prompt: PromptSettings, steps: int, count: int
    ) -> F32:
        """Latents of `frames` (F of (H, W, 3) sRGB), F and sizes as the grid wants them: the mean, not a draw.

        Of a schedule of `steps`, the last `count` run. Models of image to video keep the frames, for windows.
        """
        ...

    def noised(self, latents: F32, noise: F32, k: int) -> F32:
        """Return latents at the level of noise at which step `k` starts.

        Themselves at k = count.
        """
        ...

    def predict(self, latents: F32, k: int, first: int) -> F32:
        """Return the model's prediction in step `k` for a window of latents from latent frame `first` on."""
        ...

    def stepped(self, prediction: F32, latents: F32, k: int) -> F32:
        """Return latents after step `k`."""
        ...

    def decode(self, latents: F32) -> Iterator[F32]:
        """Decode frames, some at a time: (f, H, W, 3) sRGB, 0..1 but for over- and undershoots."""
        ...

    def note(self) -> Mapping[str, Any]:
        """Return entries of the record: weights, revision, device, dtype, scheduler ..."""
        ...

    def close(self) -> None:
        """Remove the model from memory."""
        ...
