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
    """The latent grid of a model."""

    cell: int  # side of a latent cell, px
    side: int  # divisor of the sides of frames, px
    area: int
    """Area of the training frames, px; larger frames are refined at this size."""
    window: int  # maximum number of latent frames in one pass of the model
    stride: int = 1
    """Frames per latent frame; if over 1, the first latent frame still has one
    frame.
    """


@dataclass(frozen=True)
class PromptSettings:
    """The texts that guide the model."""

    prompt: str
    negative: str
    """Description of content to avoid."""
    guidance: float | None
    """Weight of the texts (classifier-free guidance, Ho and Salimans 2022); None: the
    authors' default.
    """


@runtime_checkable
class Denoiser(Protocol):
    """A latent video diffusion model with its noise schedule, independent of its use.

    Latents are (F', C, h, w) float32, in the model's own scale. MemoryError is raised
    if the memory of the device does not suffice.
    """

    grid: Grid

    def begin(
        self, frames: Sequence[U8], prompt: PromptSettings, steps: int, count: int
    ) -> F32:
        """Encode `frames`, F of (H, W, 3) sRGB in sizes of the grid, as mean latents.

        Of a schedule of `steps`, the last `count` run. Models of image to video keep
        the frames for their windows.
        """
        ...

    def add_noise(self, latents: F32, noise: F32, k: int) -> F32:
        """Return latents at the noise level at the start of step `k`; unchanged at k =
        count.
        """
        ...

    def predict(self, latents: F32, k: int, first: int) -> F32:
        """Predict step `k` for a window of latents that begins at latent frame
        `first`.
        """
        ...

    def step(self, prediction: F32, latents: F32, k: int) -> F32:
        """Return latents after step `k`."""
        ...

    def decode(self, latents: F32) -> Iterator[F32]:
        """Decode parts of the video: (f, H, W, 3) sRGB, 0..1 except for overshoots."""
        ...

    def note(self) -> Mapping[str, Any]:
        """Return entries of the record: weights, revision, device, dtype,
        scheduler ...
        """
        ...

    def close(self) -> None:
        """Remove the model from memory."""
        ...
