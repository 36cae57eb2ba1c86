"""Guidance video and its objects' coverage -> refined frames, one at a time, and a record of how."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.crew import why
from physgen.problems import InputError, Place, Problem
from physgen.refine.cells import cells, fitted, frames_held, held, latent_frames, lengthened, over_time
from physgen.refine.fusion import Weight, each_step, fused, rising, steps_fused, steps_run
from physgen.refine.restored import restored
from physgen.refine.roles import Denoiser, Grid, Said
from physgen.refine.windows import Span, blended, spans

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]
Progress = Callable[[str, int, int], None]

HOLD = 0.3
"""s of playing over which the photo turns into the refined video."""
LEAST_HELD = 3
"""Frames over which it does so at least."""


@dataclass(frozen=True)
class How:
    """`refine:` of a scene, or the flags of `physgen refine`."""

    strength: float
    stop: int
    steps: int
    seed: int
    said: Said
    lock: float
    detail: float
    hold: int
    """Frames over which the first gives way; 0: it is refined like all others."""

    @property
    def count(self) -> int:
        """Steps that run."""
        return steps_run(self.steps, self.strength)


def frames_of_hold(fps: float) -> int:
    """Frames over which a first frame that is the photo gives way to the refined video."""
    return max(LEAST_HELD, round(HOLD * fps))


def no_step(how: How, place: Place, path: str) -> Problem | None:
    """What is wrong where no step would run."""
    if how.count:
        return None
    found, least = f"{how.strength:g}", -(-50 // how.steps) / 100
    what = f"leaves none of {how.steps} steps to run"
    instead = ", or refine: {backend: none}" if path else ""  # of a scene, not of a flag
    return Problem(place, path, found, what, f"write at least {least:g}{instead}")


class Refinement:
    """One video's refinement: `frames()` makes it, `note()` tells how it went."""

    def __init__(
        self,
        model: Denoiser,
        how: How,
        size: tuple[int, int],
        count: int,
        progress: Progress = lambda stage, done, total: None,
        weight: Weight = rising,
    ) -> None:
        """`size` (W, H) px and `count` of the frames to come. `weight` is the algorithm's own unless a test asks."""
        self._model, self._how, self._count, self._progress, self._weight = (
            model,
            how,
            count,
            progress,
            weight,
        )
        self._fit = fitted(size, model.grid)
        self._latents = latent_frames(count, model.grid)
        self._windows = self._spans(model.grid)

    def _spans(self, grid: Grid) -> list[Span]:
        return spans(self._latents, grid.window, grid.window // 2, grid.group)

    def frames(self, guidance: Sequence[U8], coverage: Sequence[F32]) -> Iterator[U8]:
        """(H, W, 3) sRGB each. `guidance`: (H, W, 3) sRGB; `coverage`: (H, W) of objects, 0..1.

        Raises InputError where the device holds too little, with what would fit.
        """
        try:
            yield from self._frames(guidance, coverage)
        except MemoryError as error:
            raise InputError([self._too_large()]) from error

    def _frames(self, guidance: Sequence[U8], coverage: Sequence[F32]) -> Iterator[U8]:
        model, how, fit, grid = self._model, self._how, self._fit, self._model.grid
        whole = frames_held(self._latents, grid)
        shown = lengthened([fit.shown(rgb) for rgb in guidance], whole)
        self._progress("refine", 0, how.count)
        z0 = model.begin(shown, how.said, how.steps, how.count)
        del shown
        mask = cells(map(fit.mask, coverage), self._latents, grid)
        stay = held(whole, how.hold)
        noise = np.random.default_rng(how.seed).standard_normal(z0.shape, np.float32)

        def denoised(z: F32, k: int) -> F32:
            said = blended(lambda part, first: model.predict(part, k, first), z, self._windows)
            self._progress("refine", k + 1, how.count)
            return model.stepped(said, z, k)

        z = fused(
            z0,
            mask,
            noised=partial(_noised, model, noise),
            denoised=denoised,
            count=how.count,
            stop=how.stop,
            weight=self._weight,
            held=each_step(over_time(stay, grid), how.count)[:, None, None, None],
        )
        if not np.isfinite(z).all():
            fix = 'write dtype = "float32" in physgen.toml'
            raise InputError.of("refine", str(model.note().get("dtype", "")), "leaves no finite picture", fix)
        for index, (refined, guided) in enumerate(_paired(model.decode(z), model.decode(z0))):
            if index >= self._count:
                return
            yield restored(
                guidance[index],
                fit.back(refined),
                fit.back(guided),
                coverage[index],
                detail=how.detail,
                lock=how.lock,
                held=float(stay[index]),
            )

    def _too_large(self) -> Problem:
        """What is said where the memory does not suffice: the largest that does, found by trying."""
        width, height = self._fit.padded
        frames = self._latents  # some models read and decode a clip as a whole
        found = f"{frames} latent frames of {width} x {height} px"
        side = int((width * height) ** 0.5)
        for part in (3 / 4, 1 / 2, 3 / 8, 1 / 4):
            smaller = max(
                self._model.grid.side, int(side * part) // self._model.grid.side * self._model.grid.side
            )
            if self._model.fits(smaller, frames):
                told = f"write resolution = {smaller} in the backend's table of physgen.toml"
                fix = f"{smaller} x {smaller} px fit: {told}"
                break
        else:
            fix = "not even a quarter of the width fits: choose a smaller model, or refine fewer frames"
        return Problem(Place("refine"), "", found, "do not fit into the memory of the device", fix)

    def note(self) -> Mapping[str, Any]:
        """For the record: what was asked, what ran, what the model says of itself."""
        how = self._how
        return {
            "strength": how.strength,
            "steps": how.steps,
            "steps_run": how.count,
            "steps_fused": steps_fused(how.count, how.stop),
            "seed": how.seed,
            "prompt": how.said.prompt,
            "negative": how.said.negative,
            "lock": how.lock,
            "detail": how.detail,
            "frames_held": how.hold,
            "size": list(self._fit.scaled),
            "windows": [list(span) for span in self._windows],
            **self._model.note(),
        }


@contextmanager
def guarded(flag: str, name: str) -> Iterator[None]:
    """Whatever the libraries of backend `name` raise is one message on the `flag` that chose it."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        fix = "see what failed, or choose another backend"
        raise InputError.of(flag, f'"{name}"', f"failed ({why(error)})", fix) from error


def _noised(model: Denoiser, noise: F32, latents: F32, k: int) -> F32:
    return model.noised(latents, noise, k)


def _paired(refined: Iterator[F32], guided: Iterator[F32]) -> Iterator[tuple[F32, F32]]:
    """Frames of two decodings, one by one."""
    for some, others in zip(refined, guided, strict=True):
        yield from zip(some, others, strict=True)
