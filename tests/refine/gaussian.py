"""A video model whose data is Gaussian, so that its exact denoiser is known: frames <-> latents in closed form.

Every cell of a video is taken for a draw of N(mean, spread^2), by itself. With z = a z0 + b e, e ~ N(0, 1),

    E[z0 | z] = mean + a spread^2 (z - a mean) / (a^2 spread^2 + b^2)

The autoencoder is the mean of a cell's pixels, -1..1, and back: what it loses is all that varies within a cell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.refine.denoiser import Grid, PromptSettings
from physgen.registry import Setup

Array = NDArray[np.float64]
SMALL = Grid(cell=4, side=8, area=10**9, window=64)


def ddim(steps: int) -> tuple[Array, Array]:
    """Signal a and noise b of a schedule's levels, the noisiest first, none at the end: Stable Diffusion's."""
    betas = np.linspace(0.00085**0.5, 0.012**0.5, 1000) ** 2
    kept = np.cumprod(1 - betas)[np.linspace(999, 0, steps).round().astype(int)]
    kept = np.append(kept, 1.0)
    return np.sqrt(kept), np.sqrt(1 - kept)


def flow(steps: int, shift: float = 3.0) -> tuple[Array, Array]:
    """The same of flow matching: z = (1 - s) z0 + s e."""
    s = np.linspace(1, 1e-3, steps)
    s = np.append(shift * s / (1 + (shift - 1) * s), 0.0)
    return 1 - s, s


class Gaussian:
    """A `Denoiser`."""

    def __init__(
        self,
        grid: Grid = SMALL,
        schedule: Callable[[int], tuple[Array, Array]] = ddim,
        mean: float = 0.0,
        spread: float = 0.5,
        most: int = 10**9,
    ) -> None:
        """`most`: latent cells that a device holds."""
        self.grid, self._schedule, self.mean, self.spread, self._most = (
            grid,
            schedule,
            mean,
            spread,
            most,
        )
        self.a = self.b = np.zeros(0)
        self.seen: list[tuple[int, int]] = []
        """First frame and length of every window that was predicted."""
        self.said: PromptSettings | None = None
        self.closed = False

    def begin(
        self,
        frames: Sequence[NDArray[np.uint8]],
        said: PromptSettings,
        steps: int,
        count: int,
    ) -> NDArray[np.float32]:
        """Means over cells, and over the frames of a latent."""
        height, width = frames[0].shape[:2]
        assert height % self.grid.side == width % self.grid.side == 0
        self._room(len(frames) * height * width // self.grid.cell**2)
        a, b = self._schedule(steps)
        self.a, self.b, self.said = a[-count - 1 :], b[-count - 1 :], said
        z = np.stack([self.encoded(frame) for frame in frames])
        if self.grid.stride > 1:
            z = np.stack(
                [
                    z[0],
                    *(
                        z[k : k + self.grid.stride].mean(axis=0)
                        for k in range(1, len(z), self.grid.stride)
                    ),
                ]
            )
        return z

    def encoded(self, frame: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(H, W, 3) -> (3, h, w)."""
        height, width, cell = *frame.shape[:2], self.grid.cell
        blocks = frame.astype(np.float32).reshape(
            height // cell, cell, width // cell, cell, 3
        )
        return (blocks.mean(axis=(1, 3)) / np.float32(127.5) - 1).transpose(2, 0, 1)

    def add_noise(self, latents: Any, noise: Any, k: int) -> Any:
        return np.float32(self.a[k]) * latents + np.float32(self.b[k]) * noise

    def expected(self, latents: Any, k: int) -> Any:
        """E[z0 | z]."""
        a, b, v = self.a[k], self.b[k], self.spread**2
        return self.mean + a * v / (a * a * v + b * b) * (latents - a * self.mean)

    def predict(
        self, latents: NDArray[np.float32], k: int, first: int
    ) -> NDArray[np.float32]:
        """The noise, as DDIM's models say."""
        self.seen.append((first, len(latents)))
        assert len(latents) <= self.grid.window
        return np.asarray(
            (latents - self.a[k] * self.expected(latents, k)) / self.b[k], np.float32
        )

    def step(
        self, prediction: NDArray[np.float32], latents: NDArray[np.float32], k: int
    ) -> NDArray[np.float32]:
        """DDIM's step without fresh noise; for straight paths it is Euler's."""
        z0 = (
            (latents - self.b[k] * prediction) / self.a[k]
            if self.a[k]
            else latents * 0 + self.mean
        )
        return np.asarray(self.a[k + 1] * z0 + self.b[k + 1] * prediction, np.float32)

    def decode(self, latents: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
        """Cells as squares of one colour, two latents at a time."""
        frames = [
            latents[:1],
            *np.repeat(latents[1:], self.grid.stride, axis=0)[:, None],
        ]
        for k in range(0, len(frames), 2):
            z = (
                np.concatenate(frames[k : k + 2])
                .repeat(self.grid.cell, axis=2)
                .repeat(self.grid.cell, axis=3)
            )
            yield np.asarray((z.transpose(0, 2, 3, 1) + 1) / 2, np.float32)

    def _room(self, cells: int) -> None:
        if cells > self._most:
            raise MemoryError

    def note(self) -> Mapping[str, Any]:
        return {"weights": "N(mean, spread^2)", "revision": "exact", "dtype": "float32"}

    def close(self) -> None:
        self.closed = True


class Straight(Gaussian):
    """The same data told as models of flow matching do: a velocity, and Euler's steps along it."""

    def __init__(
        self, grid: Grid = SMALL, mean: float = 0.0, spread: float = 0.5
    ) -> None:
        super().__init__(grid, flow, mean, spread)

    def predict(
        self, latents: NDArray[np.float32], k: int, first: int
    ) -> NDArray[np.float32]:
        """e - z0."""
        self.seen.append((first, len(latents)))
        z0 = self.expected(latents, k)
        return np.asarray((latents - self.a[k] * z0) / self.b[k] - z0, np.float32)

    def step(
        self, prediction: NDArray[np.float32], latents: NDArray[np.float32], k: int
    ) -> NDArray[np.float32]:
        return np.asarray(
            latents + (self.b[k + 1] - self.b[k]) * prediction, np.float32
        )


def made(setup: Setup) -> Gaussian:
    """A row's factory; its table of the configuration may set `mean`, `spread`, `most` and the grid."""
    told = dict(setup.options)
    grid = Grid(
        **{
            **SMALL.__dict__,
            **{key: told.pop(key) for key in list(told) if key in SMALL.__dict__},
        }
    )
    return Gaussian(grid, **told)


def broken(setup: Setup) -> Gaussian:
    """One that fails while it is made, as libraries do: with whatever error."""
    raise RuntimeError("no such luck")
