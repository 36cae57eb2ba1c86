"""Frames and coverage on a model's latent grid, and overlapping windows of a long clip.

All windows take each step together, so that they agree in their overlap at every noise
level, and no joint is visible (MultiDiffusion, Bar-Tal et al. 2023, along time).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import ceil, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import decode, encode_u8
from physgen.refine.denoiser import F32, U8, Grid

Size = tuple[int, int]
"""Width and height, px."""
MOST = 1.5
"""Maximum area after padding, in areas of the training frames."""


@dataclass(frozen=True)
class Fit:
    """The conversion of frames between the video's size and the model's."""

    size: Size
    """Size of the video."""
    scaled_size: Size
    """Size for the model: smaller if the video has more pixels than the training
    frames.
    """
    padded_size: Size
    """Size with a mirrored border, up to multiples of the grid."""

    def to_model(self, rgb: U8) -> U8:
        """Resize (H, W, 3) of `size` to `padded_size`, in linear light."""
        if self.scaled_size != self.size:
            # Area averaging prevents aliasing, and only linear light has true averages.
            rgb = encode_u8(
                cv2.resize(decode(rgb), self.scaled_size, interpolation=cv2.INTER_AREA)
            )
        return np.asarray(self._pad(rgb), np.uint8)

    def mask(self, coverage: F32) -> F32:
        """Resize (H, W) of `size` to `padded_size`."""
        if self.scaled_size != self.size:
            coverage = np.asarray(
                cv2.resize(coverage, self.scaled_size, interpolation=cv2.INTER_AREA),
                np.float32,
            )
        return np.asarray(self._pad(coverage), np.float32)

    def from_model(self, picture: F32) -> F32:
        """Resize (H, W, 3) of `padded_size` to `size`."""
        width, height = self.scaled_size
        # The mirrored border is at the right and bottom only: cut it off first.
        picture = picture[:height, :width]
        if self.scaled_size != self.size:
            picture = np.asarray(
                cv2.resize(picture, self.size, interpolation=cv2.INTER_CUBIC),
                np.float32,
            )
        return picture

    def _pad(self, picture: NDArray[np.generic]) -> NDArray[np.generic]:
        """Pad a picture by its mirrored border to `padded_size`."""
        right, bottom = (
            p - s for p, s in zip(self.padded_size, self.scaled_size, strict=True)
        )
        if not right and not bottom:
            return picture
        # A side of one pixel has no second pixel to mirror.
        if min(self.scaled_size) > 1:
            edge = cv2.BORDER_REFLECT_101
        else:
            edge = cv2.BORDER_REPLICATE
        return np.asarray(
            cv2.copyMakeBorder(np.asarray(picture), 0, bottom, 0, right, edge)
        )


def fit_to_grid(size: Size, grid: Grid) -> Fit:
    """Return the conversion of frames of `size` for a model with this grid."""
    # Small videos are never enlarged: this would add no detail.
    scale = min(1.0, sqrt(grid.area / (size[0] * size[1])))
    width, height = (max(1, round(side * scale)) for side in size)
    most_pixels = max(MOST * grid.area, grid.side**2)
    # Padding makes a very narrow video much larger: reduce it further.
    while (padded_size := grid_size(width, height, grid))[0] * padded_size[
        1
    ] > most_pixels:
        width, height = max(1, round(width * 0.9)), max(1, round(height * 0.9))
    return Fit(size, (width, height), padded_size)


def grid_size(width: int, height: int, grid: Grid) -> Size:
    """Return width and height as multiples of the grid, px."""
    return ceil(width / grid.side) * grid.side, ceil(height / grid.side) * grid.side


def latent_frames(frames: int, grid: Grid) -> int:
    """Return the number of latent frames for these frames.

    >>> latent_frames(16, Grid(8, 16, 480 * 832, 21, 4))
    5
    """
    if grid.stride == 1:
        return frames
    # Causal video encoders give the first frame a latent frame of its own, and each
    # later group of `stride` frames one.
    return 1 + ceil((frames - 1) / grid.stride)


def frames_held(latents: int, grid: Grid) -> int:
    """Return the number of frames of these latent frames."""
    if grid.stride == 1:
        return latents
    return 1 + (latents - 1) * grid.stride


def pad_frames(frames: Sequence[U8], count: int) -> list[U8]:
    """Return `count` frames; the last one is repeated."""
    return [*frames, *[frames[-1]] * (count - len(frames))]


def cell_coverage(coverage: Iterable[F32], latents: int, grid: Grid) -> F32:
    """Compute the mean coverage (F', 1, h, w) 0..1 of each latent cell, over pixels and
    frames.

    `coverage`: (H, W) of each frame in sizes of the grid; the last one is repeated.
    """
    smaller = []
    for mask in coverage:
        height, width = mask.shape[0] // grid.cell, mask.shape[1] // grid.cell
        # Split both axes into cells, and average within each cell.
        blocks = mask.reshape(height, grid.cell, width, grid.cell)
        smaller.append(blocks.mean(axis=(1, 3), dtype=np.float32))
    smaller += [smaller[-1]] * (frames_held(latents, grid) - len(smaller))
    return over_time(np.stack(smaller)[:, None], grid)


def over_time(values: F32, grid: Grid) -> F32:
    """Average values (F, ...) of frames to (F', ...) of latent frames."""
    if grid.stride == 1:
        return values
    # The first frame has its own latent frame, so groups begin at the second one.
    rest = values[1:].reshape(-1, grid.stride, *values.shape[1:])
    means: F32 = np.concatenate([values[:1], rest.mean(axis=1, dtype=np.float32)])
    return means


def hold_weights(frames: int, held_frames: int) -> F32:
    """Return the share of the guidance in each frame, (F,).

    It is 1 in the first frame, and falls smoothly to 0 over `held_frames` frames.

    >>> hold_weights(6, 4).tolist()
    [1.0, 0.84375, 0.5, 0.15625, 0.0, 0.0]
    """
    if held_frames <= 0:
        return np.zeros(frames, np.float32)
    s = np.minimum(np.arange(frames) / held_frames, 1.0)
    # Smoothstep: the slope is 0 at both ends, so the change has no visible start or
    # end.
    return np.asarray(1 - s * s * (3 - 2 * s), np.float32)


Span = tuple[int, int]
"""First latent frame, and last + 1."""


def window_spans(total: int, window: int, overlap: int) -> list[Span]:
    """Return windows of `window` latent frames that cover `total`.

    Neighbours share at least `overlap` latent frames.

    >>> window_spans(30, 16, 8)
    [(0, 16), (7, 23), (14, 30)]
    """
    if total <= window:
        return [(0, total)]
    # Each further window adds at most its length minus the overlap.
    count = 1 + ceil((total - window) / (window - min(overlap, window - 1)))
    # Even spacing, so that the last window ends with the clip at full length.
    starts = np.floor(np.linspace(0, total - window, count)).astype(int).tolist()
    return [(start, start + window) for start in starts]


def weights(span: Span, total: int) -> F32:
    """Return the weights (last - first,) of a window's predictions.

    They decrease towards an end inside the clip. They are constant towards the clip's
    own ends, where the weight of a neighbour's first frame would otherwise jump.

    >>> weights((2, 6), 8).tolist(), weights((0, 4), 8).tolist()
    ([1.0, 2.0, 2.0, 1.0], [4.0, 3.0, 2.0, 1.0])
    """
    first, last = span
    frame_numbers = np.arange(first, last)
    if first:
        rising = frame_numbers - first + 1
    else:
        rising = np.full(len(frame_numbers), total)
    if last < total:
        falling = last - frame_numbers
    else:
        falling = np.full(len(frame_numbers), total)
    return np.asarray(np.minimum(rising, falling), np.float32)


def blend_predictions(
    predict: Callable[[F32, int], F32], z: F32, windows: Sequence[Span]
) -> F32:
    """Return the mean of `predict(z[first:last], first)` over the windows, (F', C, h,
    w).

    The windows have the weights of `weights`.
    """
    if len(windows) == 1:
        return predict(z, 0)
    total, sums = np.zeros_like(z), np.zeros((len(z), 1, 1, 1), np.float32)
    for first, last in windows:
        weight = weights((first, last), len(z))[:, None, None, None]
        total[first:last] += weight * predict(z[first:last], first)
        sums[first:last] += weight
    return total / sums
