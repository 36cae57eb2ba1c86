"""Algorithm 1 of the paper: refined frames from a guidance video and its objects.

| paper (section 3.4 and supplement) | here | meaning |
|---|---|---|
| z~0 | `guidance` | latents of the relit video |
| m | `mask` | coverage of the objects: 0 outside, 1 inside, here also in between |
| T (line 1: nint(T s)) | `steps_run(steps, strength)` | number of denoising steps: 25 of 50 at s = 0.5 |
| t = T .. 1 | `k = 0 .. count - 1`, k = T - t | steps run so far |
| z_T, z~_T ~ q(z_T given z~0) (line 2) | `add_noise(guidance, 0)` | the guidance at the first step's noise |
| p(z_t-1 given z_t) (lines 6, 12) | `denoise(z, k)` | one step of the model |
| z~_t-1 ~ q(z_t-1 given z~0) (line 5) | `add_noise(guidance, k + 1)` | the guidance, as noisy as the step leaves z |
| w = (T - t) / T (line 7) | `rising(k, count)` | share of the model's own in the objects: 0, 1/T .. (T - 1)/T |
| delta (line 4) | `stop` | number of the last steps, without guidance |

Line 4 is printed as `t <= T - delta`. Since t counts down, this would leave the *first*
delta steps free. The paper's text and public code leave the *last* delta steps free, and
so does this module: the guidance places the objects at high noise, and the model then
adapts their borders and light. Lines 2 and 5 draw new noise in every step. A blend of
independent noises has less noise than the model expects (half its variance at w = 1/2),
and objects lose texture. `add_noise` must therefore add the same noise every time;
docs/models.md has the figures.

A frame is the guidance plus the change by the model, D(z) - D(z~0), because the decoder
loses fine texture even without such a change.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from math import floor
from typing import Any, TypeVar

import numpy as np

from physgen.messages import Message
from physgen.photometry import decode, encode_u8
from physgen.problems import InputError, Place, Problem
from physgen.progress import Progress, silent
from physgen.refine.denoiser import F32, U8, Denoiser, PromptSettings
from physgen.refine.latents import (
    blend_predictions,
    cell_coverage,
    fit_to_grid,
    frames_held,
    hold_weights,
    latent_frames,
    over_time,
    pad_frames,
    window_spans,
)
from physgen.registry import describe_error

Latent = TypeVar("Latent")
"""An array, or a number."""

Weight = Callable[[int, int], float]
"""Step and count of steps -> fusion weight w."""


def steps_run(steps: int, strength: float) -> int:
    """Return the number of steps that run, nint(T s), with halves rounded upwards (line
    1).

    >>> steps_run(50, 0.5), steps_run(50, 0.009)
    (25, 0)
    """
    return floor(steps * strength + 0.5)


def steps_fused(count: int, stop: int) -> int:
    """Return the number of steps with guidance (line 4).

    >>> steps_fused(25, 5)
    20
    """
    return max(0, count - stop)


def rising(k: int, count: int) -> float:
    """Return the fusion weight w of step k (line 7).

    >>> rising(0, 25), rising(19, 25)
    (0.0, 0.76)
    """
    return k / count


def each_step(share: Any, count: int) -> Any:
    """Return the share of the guidance to restore in each of `count` steps.

    The share `share` then remains at the end. Blends multiply: with 0.15 in each of 25
    steps, only 0.85^25 = 0.02 of the model's changes would remain.

    >>> each_step(1.0, 25), each_step(0.0, 25), round(each_step(0.75, 2), 6)
    (1.0, 0.0, 0.5)
    """
    return 1 - (1 - share) ** (1 / count)


def fuse_latents(
    guidance: Latent,
    mask: Any,
    *,
    add_noise: Callable[[Latent, int], Latent],
    denoise: Callable[[Latent, int], Latent],
    count: int,
    stop: int,
    weight: Weight = rising,
    held_share: Any = 0.0,
) -> Latent:
    """Fuse the guidance with the model's latents; return refined latents of equal
    shape.

    `mask` 0..1 broadcasts against latents. `add_noise(z0, k)` is z0 at the noise level
    at the start of step k, and z0 itself at k = count; `denoise(z, k)` is step k.
    `held_share` 0..1 is the share of the guidance in every step, also in free ones. It
    broadcasts, too, and is 1 on the first frame, the photo; see `each_step`.
    """
    # The same noise is used again in every later call, so that blends keep its
    # variance.
    z = add_noise(guidance, 0)
    fusing = steps_fused(count, stop)
    for k in range(count):
        # The model's latents are now at noise level k + 1, so the guidance is blended
        # in at the same level below.
        z = denoise(z, k)
        if k < fusing:
            share = mask * (1 - weight(k, count))
        else:
            share = 0 * mask
        # Line 8; the held share applies in free steps, too.
        share = np.maximum(share, held_share)
        # With a share of 1, this form equals z~ to the last bit; z + share (z~ - z)
        # would not.
        z = (1 - share) * z + share * add_noise(guidance, k + 1)
    return z


EMPTY_LABELS = frozenset({"", "object", "thing"})
"""Labels without a meaning."""


def prompt_of(labels: Iterable[str]) -> str:
    """Join the labels, the most frequent first, each once.

    >>> prompt_of(["billiard ball", "billiard ball", "cue", "object"])
    'billiard ball, cue'
    """
    # Labels that differ in case only count as one; the prompt keeps the first spelling.
    spelling: dict[str, str] = {}  # the first spelling of each label
    counts = Counter(
        spelling.setdefault(label.strip().lower(), label.strip()).lower()
        for label in labels
    )
    return ", ".join(
        spelling[label]
        for label, _ in counts.most_common()
        if label not in EMPTY_LABELS
    )


def restore_detail(
    guidance: U8,
    refined_frame: F32,
    guidance_frame: F32,
    coverage: F32,
    *,
    detail: float,
    lock: float,
    held_share: float,
) -> U8:
    """Restore detail of the guidance in a refined frame, (H, W, 3) sRGB.

    `refined_frame` and `guidance_frame` (H, W, 3) sRGB 0..1: the decoded latents of the
    refined video and of the guidance; `coverage` (H, W) of objects. Shares 0..1:
    `detail`, of the detail lost by the decoder; `lock`, of the guidance at objects;
    `held_share`, of the guidance everywhere.
    """
    before = guidance.astype(np.float32) / np.float32(255)
    # Autoencoders lose detail. The loss in the guidance is known: add it to the result.
    after = refined_frame + np.float32(detail) * (before - guidance_frame)
    # The held share fades the first frames from the exact photo to the refined video.
    after = before + np.float32(1 - held_share) * (after - before)
    refined_rgb: U8 = np.rint(np.clip(after, 0, 1) * 255).astype(np.uint8)
    # Where objects are locked, blend the guidance over the result in linear light.
    share = np.float32(lock) * coverage
    if not share.any():
        return refined_rgb
    # Objects are usually small: decode and encode their box instead of the frame.
    box = _bounding_slices(share)
    share_there = share[box][..., None]
    blend = encode_u8(
        (1 - share_there) * decode(refined_rgb[box])
        + share_there * decode(guidance[box])
    )
    # Pixels with no share keep their bytes; encoding again could change them by
    # rounding.
    refined_rgb[box] = np.where(share_there > 0, blend, refined_rgb[box])
    return refined_rgb


def _bounding_slices(values: F32) -> tuple[slice, slice]:
    """Return the box of all pixels above 0."""
    rows, columns = (
        np.flatnonzero(values.any(axis=1)),
        np.flatnonzero(values.any(axis=0)),
    )
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


HOLD = 0.3
"""Playing time over which the photo changes to the refined video, s."""
LEAST_HELD = 3
"""Minimum number of frames for this change."""


@dataclass(frozen=True)
class RefineSettings:
    """`refine:` of a scene."""

    strength: float
    stop: int
    steps: int
    seed: int
    prompt: PromptSettings
    lock: float
    detail: float
    hold: int
    """Frames over which the first frame fades; 0: it is refined like all others."""

    @property
    def count(self) -> int:
        """Return the number of steps that run."""
        return steps_run(self.steps, self.strength)


def hold_frames(fps: float) -> int:
    """Return the number of frames over which the photo changes to the refined video."""
    return max(LEAST_HELD, round(HOLD * fps))


class Refinement:
    """The refinement of one video: `frames()` computes it, `note()` describes it."""

    def __init__(
        self,
        model: Denoiser,
        settings: RefineSettings,
        size: tuple[int, int],
        count: int,
        progress: Progress = silent,
        weight: Weight = rising,
    ) -> None:
        """Prepare for `count` frames of `size` (W, H) px.

        `weight` is the algorithm's own, except in tests.
        """
        self._model, self._how, self._count, self._progress, self._weight = (
            model,
            settings,
            count,
            progress,
            weight,
        )
        self._fit = fit_to_grid(size, model.grid)
        self._latents = latent_frames(count, model.grid)
        window = model.grid.window
        # Neighbours overlap by half a window, over which their weights fade.
        self._windows = window_spans(self._latents, window, window // 2)

    def frames(self, guidance: Sequence[U8], coverage: Sequence[F32]) -> Iterator[U8]:
        """Yield refined frames, (H, W, 3) sRGB.

        `guidance`: (H, W, 3) sRGB; `coverage`: (H, W) of objects, 0..1. Raises
        InputError if the memory of the device does not suffice.
        """
        try:
            yield from self._frames(guidance, coverage)
        except MemoryError as error:
            raise InputError([self._too_large()]) from error

    def _frames(self, guidance: Sequence[U8], coverage: Sequence[F32]) -> Iterator[U8]:
        """Yield refined frames; raises MemoryError."""
        settings, fit = self._how, self._fit
        z0 = self._encode(guidance)
        frame_total = frames_held(self._latents, self._model.grid)
        held_shares = hold_weights(frame_total, settings.hold)
        z = self._fuse(z0, coverage, held_shares)
        pairs = enumerate(self._decoded_pairs(z, z0))
        for index, (refined_frame, guidance_frame) in pairs:
            yield restore_detail(
                guidance[index],
                fit.from_model(refined_frame),
                fit.from_model(guidance_frame),
                coverage[index],
                detail=settings.detail,
                lock=settings.lock,
                held_share=float(held_shares[index]),
            )

    def _encode(self, guidance: Sequence[U8]) -> F32:
        """Return the latents of the guidance frames."""
        settings = self._how
        frame_total = frames_held(self._latents, self._model.grid)
        # A latent frame covers several frames, so the last one may need frames past the
        # end.
        padded_guidance = pad_frames(
            [self._fit.to_model(rgb) for rgb in guidance], frame_total
        )
        self._progress("refine", 0, settings.count)
        return self._model.begin(
            padded_guidance, settings.prompt, settings.steps, settings.count
        )

    def _fuse(self, z0: F32, coverage: Sequence[F32], held_shares: F32) -> F32:
        """Return the refined latents. Raises InputError if they are not finite."""
        model, settings, grid = self._model, self._how, self._model.grid
        mask = cell_coverage(map(self._fit.mask, coverage), self._latents, grid)
        # NumPy's generator, and not the backend's: the noise of a seed is the same on
        # any device.
        noise = np.random.default_rng(settings.seed).standard_normal(
            z0.shape, np.float32
        )

        def denoise(z: F32, k: int) -> F32:
            prediction = blend_predictions(
                lambda part, first: model.predict(part, k, first), z, self._windows
            )
            self._progress("refine", k + 1, settings.count)
            return model.step(prediction, z, k)

        # Hold weights are per frame; the blend needs them per latent frame and per
        # step.
        held_share = each_step(over_time(held_shares, grid), settings.count)
        z = fuse_latents(
            z0,
            mask,
            add_noise=lambda latents, k: model.add_noise(latents, noise, k),
            denoise=denoise,
            count=settings.count,
            stop=settings.stop,
            weight=self._weight,
            held_share=held_share[:, None, None, None],
        )
        # Half precision overflows in some models, and NaN has no grey level.
        if not np.isfinite(z).all():
            raise Message.REFINED_NOT_FINITE.error(
                "refine", str(model.note().get("dtype", ""))
            )
        return z

    def _decoded_pairs(self, z: F32, z0: F32) -> Iterator[tuple[F32, F32]]:
        """Yield each refined frame with its decoded guidance frame.

        `z` and `z0` are the latents with and without refinement. The additional frames
        at the end of the last latent frame are left out.
        """
        parts = zip(self._model.decode(z), self._model.decode(z0), strict=True)
        # Both decoders yield parts of some frames: pair them part by part, then frame
        # by frame.
        pairs = (pair for part in parts for pair in zip(*part, strict=True))
        return islice(pairs, self._count)

    def _too_large(self) -> Problem:
        """Return the problem of a video too large for the device."""
        width, height = self._fit.padded_size
        size_text = f"{self._count} frames of {width} x {height} px"
        return Message.REFINING_TOO_LARGE.problem(Place("refine"), "", size_text)

    def note(self) -> Mapping[str, Any]:
        """Return the entries of the record: settings, number of steps, and the model's
        note.
        """
        settings = self._how
        return {
            "strength": settings.strength,
            "steps": settings.steps,
            "steps_run": settings.count,
            "steps_fused": steps_fused(settings.count, settings.stop),
            "seed": settings.seed,
            "prompt": settings.prompt.prompt,
            "negative": settings.prompt.negative,
            "lock": settings.lock,
            "detail": settings.detail,
            "frames_held": settings.hold,
            "size": list(self._fit.scaled_size),
            "windows": list(map(list, self._windows)),
            **self._model.note(),
        }


@contextmanager
def backend_errors(flag: str, name: str) -> Iterator[None]:
    """Report errors of a backend's libraries as one message on the `flag` that chose
    it.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise Message.REFINER_FAILED.error(
            flag, f'"{name}"', error=describe_error(error)
        ) from error
