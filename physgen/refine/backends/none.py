"""Frames -> themselves: what refines where nothing is to be refined."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from physgen.refine.denoiser import F32, U8, Grid, PromptSettings

ANY = 1 << 30


class Nothing:
    """A model whose latents are the frames, and that changes nothing in any step."""

    grid = Grid(cell=1, side=1, area=ANY, window=ANY)

    def begin(self, frames: Sequence[U8], prompt: PromptSettings, steps: int, count: int) -> F32:
        """(F, 3, H, W), 0..1."""
        return np.stack(frames).transpose(0, 3, 1, 2).astype(np.float32) / np.float32(255)

    def noised(self, latents: F32, noise: F32, k: int) -> F32:
        """`latents`."""
        return latents

    def predict(self, latents: F32, k: int) -> F32:
        """Nothing to change."""
        return np.zeros_like(latents)

    def stepped(self, prediction: F32, latents: F32, k: int) -> F32:
        """`latents`."""
        return latents

    def decode(self, latents: F32) -> Iterator[F32]:
        """The frames, one at a time."""
        for frame in latents:
            yield frame.transpose(1, 2, 0)[None]

    def note(self) -> Mapping[str, Any]:
        """Nothing to record."""
        return {}

    def close(self) -> None:
        """It has no model."""


def none() -> Nothing:
    """The backend `none`."""
    return Nothing()
