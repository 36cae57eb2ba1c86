"""Noise of the photo: measured by brightness, removed from sprites, and added to
frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from math import sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64, Mask
from physgen.maps import U8, Percepts
from physgen.render.camera import Shot
from physgen.render.stage import Frame
from physgen.scene.scene import Noise, Play, Render, Striker


@dataclass(frozen=True)
class GrainTuning:
    """Limits between noise and texture, and sizes of the noise field."""

    block: int = 8
    """Side of the blocks for the measurement of fine detail, px."""
    bins: int = 16
    """Number of ranges of brightness."""
    block_share: float = 0.1
    """Share of the blocks in a range, the flattest ones, that count as free of
    texture.
    """
    low: float = 1.15
    """True deviation over that of the flattest tenth of blocks, which is biased
    downwards.
    """
    blocks: int = 30
    """Minimum number of blocks for a measurement in a range."""
    level_range: tuple[int, int] = (4, 251)
    """Grey levels beyond which a block may be clipped."""
    least_deviation: float = 0.4
    """Smallest deviation, grey levels, beyond that of rounding, 0.29."""
    largest_deviation: float = 6.0
    """Largest deviation of grain, grey levels; a larger one is texture."""
    denoising_limit: float = 6.0
    """Differences in standard deviations, summed over the channels, that denoising
    preserves.
    """
    reach: int = 5
    """Size of the denoised neighbourhood, px."""
    spread: float = 1.5
    """Standard deviation of its weights, px."""
    tile: int = 512
    """Side of the parts of a frame with noise from one place of the field, px."""
    room: int = 128
    """Additional size of the field, px, so that each frame uses another part."""
    steady: float = 1.5
    """Maximum ratio of the deviation at any brightness to the lower quartile of all."""
    correlation: float = 0.35
    """Maximum correlation of neighbouring pixels: above it, the detail is texture."""


GRAIN = GrainTuning()
SEED = 0
FINEST = np.outer((1, -2, 1), (1, -2, 1)).astype(np.float32) / 6
"""Kernel of fine detail: it removes planes, and preserves the deviation of noise."""


@dataclass(frozen=True)
class Grain:
    """Noise of a photo."""

    deviation: F32
    """Standard deviations by level and channel, (256, 3) grey levels."""
    channels: F64
    """Correlation of channels, (3, 3)."""
    neighbours: float
    """Correlation of neighbouring pixels."""


def measure_grain(rgb: U8) -> Grain | None:
    """Measure the noise of a photo (H, W, 3) sRGB; None if rounding hides it.

    The fine detail of the flattest blocks is measured (after Immerkaer, 1996), which
    have little texture.
    """
    picture = rgb.astype(np.float32)
    detail = np.asarray(cv2.filter2D(picture, cv2.CV_32F, FINEST), np.float32)
    blocks, details = _blocks(picture), _blocks(detail)
    means = blocks.mean(axis=(1, 2))
    darkest, brightest = GRAIN.level_range
    # Clipped pixels hide the noise.
    is_open = (means.min(axis=1) > darkest) & (means.max(axis=1) < brightest)
    blocks, details = blocks[is_open], details[is_open]
    curve, is_flat = _measure_curve(details, means[is_open])
    if not curve or np.median([row for _, row in curve]) < GRAIN.least_deviation:
        return None
    channels = _channel_correlation(details[is_flat].reshape(-1, 3))
    return Grain(_curve(curve), channels, _neighbour_correlation(blocks[is_flat]))


def _measure_curve(details: F32, means: F32) -> tuple[list[tuple[F32, F32]], Mask]:
    """Return pairs of the mean light and its deviation, (3,) each, and the flat blocks.

    `details` (n, size, size, 3) and `means` (n, 3) are those of blocks.
    """
    # The mean square of the filtered detail is the variance of noise plus that of
    # texture.
    squares = (details**2).mean(axis=(1, 2))
    texture = squares.sum(axis=1)
    is_flat = np.zeros(len(details), np.bool_)
    curve = []
    # Noise depends on brightness: measure it separately in groups of like brightness.
    for group in _brightness_groups(means.mean(axis=1)):
        limit = np.quantile(texture[group], GRAIN.block_share)
        flattest = group[texture[group] <= limit]
        is_flat[flattest] = True
        # The flattest blocks are below the mean by chance: a factor corrects this bias.
        deviation = GRAIN.low * np.sqrt(squares[flattest].mean(axis=0))
        curve.append((means[group].mean(axis=0), deviation))
    return curve, is_flat


def _channel_correlation(details: F32) -> F64:
    """Return the correlation (3, 3) of the channels; one without noise is
    independent.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        channels = np.corrcoef(details.astype(np.float64).T)
    return np.where(np.isfinite(channels), channels, np.eye(3))


def _blocks(picture: F32) -> F32:
    """Return a picture (H, W, 3) as blocks (n, size, size, 3)."""
    size = GRAIN.block
    height, width = (side // size * size for side in picture.shape[:2])
    shape = height // size, size, width // size, size, 3
    tiles = picture[:height, :width].reshape(shape)
    return np.asarray(tiles.swapaxes(1, 2).reshape(-1, size, size, 3), np.float32)


def _brightness_groups(brightness: F32) -> Iterator[NDArray[np.intp]]:
    """Yield the indices of blocks in each range of brightness that has enough."""
    ranges = (brightness * (GRAIN.bins / 256)).astype(int)
    for number in range(GRAIN.bins):
        group = np.flatnonzero(ranges == number)
        if len(group) >= GRAIN.blocks:
            yield group


def _curve(points: Sequence[tuple[F32, F32]]) -> F32:
    """Interpolate the deviation at each level, (256, 3), from the measured levels."""
    levels = np.array([level for level, _ in points])
    deviations = np.array([deviation for _, deviation in points])
    # Noise changes slowly with brightness: a peak in one range is texture.
    limits = GRAIN.steady * np.quantile(deviations, 0.25, axis=0)
    limits = np.minimum(limits, GRAIN.largest_deviation)
    all_levels = np.arange(256)
    columns = []
    for channel in range(3):
        # Interpolation needs rising levels, and channels may rise in different orders.
        order = np.argsort(levels[:, channel])
        x = levels[order, channel]
        y = deviations[order, channel]
        columns.append(np.interp(all_levels, x, np.minimum(y, limits[channel])))
    return np.stack(columns, axis=1).astype(np.float32)


def _neighbour_correlation(blocks: F32) -> float:
    """Return the correlation of neighbouring pixels in blocks (n, size, size, 3)."""
    steps = []
    for distance in (1, 2, 3):
        horizontal_steps = blocks[:, :, distance:] - blocks[:, :, :-distance]
        vertical_steps = blocks[:, distance:] - blocks[:, :-distance]
        steps.append(
            float((horizontal_steps**2).mean() + (vertical_steps**2).mean()) / 2
        )
    # Noise is correlated only between neighbours, while squared differences by a
    # gradient grow with the square of the distance: solve for both.
    gradient = max(steps[2] - steps[1], 0.0) / 5
    square = max(steps[1] - 4 * gradient, 1e-9)
    share = 1 - (steps[0] - gradient) / square
    return min(max(share, 0.0), GRAIN.correlation)


def remove_map_noise(maps: Percepts, grain: Grain) -> Percepts:
    """Return photo and backgrounds without noise; equal pixels stay equal."""
    photo = remove_noise(maps.rgb, grain)
    pictures: list[U8 | None] = []
    for picture in (maps.background, maps.clean):
        if picture is None:
            pictures.append(None)
            continue
        # Pixels of the background equal to the photo must stay equal to it.
        is_photo = (picture == maps.rgb).all(axis=2, keepdims=True)
        pictures.append(np.where(is_photo, photo, remove_noise(picture, grain)))
    background, clean_photo = pictures
    return replace(maps, rgb=photo, background=background, clean=clean_photo)


def remove_noise(rgb: U8, grain: Grain) -> U8:
    """Return a picture (H, W, 3) sRGB without noise, by an edge-preserving filter.

    Levels are first rescaled such that the noise is 1 everywhere.
    """
    floor = np.maximum(grain.deviation, GRAIN.least_deviation)
    # Scale the levels such that noise has the deviation 1 at every brightness, so that
    # one filter fits all of them. The scale is the sum of the steps between levels.
    scales = np.cumsum(1 / floor, axis=0).astype(np.float32)
    planes = [scales[rgb[..., k], k] for k in range(3)]
    scaled_levels = np.asarray(cv2.merge(planes), np.float32)
    filtered_levels = cv2.bilateralFilter(
        scaled_levels, GRAIN.reach, GRAIN.denoising_limit, GRAIN.spread
    )
    all_levels = np.arange(256)
    result = np.empty_like(rgb)
    for k, plane in enumerate(cv2.split(filtered_levels)):
        levels = np.interp(np.asarray(plane), scales[:, k], all_levels)
        result[..., k] = np.rint(levels)
    return result


class GrainField:
    """Noise for each frame: parts of one field, each from another place."""

    def __init__(self, grain: Grain, share: float = 1.0) -> None:
        """Generate the field.

        `share` of the deviation is visible, less than 1 for a video smaller than the
        photo.
        """
        side = GRAIN.tile + GRAIN.room
        random = np.random.default_rng(SEED)
        white_noise = random.standard_normal((side, side, 3), np.float32)
        factor = _root(grain.channels).astype(np.float32)
        field = white_noise @ factor.T
        # Correlate neighbours by a small kernel, as demosaicing does in a camera.
        weight = _neighbour_weight(grain.neighbours)
        kernel = np.array([weight, 1, weight]) / sqrt(1 + 2 * weight**2)
        correlated_noise = cv2.sepFilter2D(field, cv2.CV_32F, kernel, kernel)
        self._field = np.ascontiguousarray(correlated_noise, np.float32)
        self._table = np.asarray(share * grain.deviation, np.float32)[None]

    def add(self, rgb: U8, number: int) -> U8:
        """Return a frame (H, W, 3) sRGB with the noise of frame `number`."""
        random = np.random.default_rng((SEED, number))
        result = np.empty_like(rgb)
        height, width = rgb.shape[:2]
        for top in range(0, height, GRAIN.tile):
            for left in range(0, width, GRAIN.tile):
                box = np.s_[top : top + GRAIN.tile, left : left + GRAIN.tile]
                result[box] = self._add_noise(rgb[box], random)
        return result

    def _add_noise(self, part: U8, chance: np.random.Generator) -> U8:
        """Return a part of a frame with noise."""
        y, x = chance.integers(0, GRAIN.room, 2).tolist()
        height, width = part.shape[:2]
        noise = self._field[y : y + height, x : x + width]
        part = np.ascontiguousarray(part)
        deviation = cv2.LUT(part, self._table)
        cv2.multiply(deviation, noise, dst=deviation)
        return np.asarray(cv2.add(part, deviation, dtype=cv2.CV_8U), np.uint8)


def _root(correlation: F64) -> F64:
    """Return a matrix (3, 3) such that its product with its transpose is a correlation
    matrix.
    """
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)), np.float64)


def _neighbour_weight(correlation: float) -> float:
    """Return the weight w of a kernel (w, 1, w) for a correlation of neighbours."""
    if correlation <= 0:
        return 0.0
    return (1 - sqrt(max(1 - 2 * correlation**2, 0))) / (2 * correlation)


def hold_frames(frames: Iterator[Frame], count: int) -> Iterator[Frame]:
    """Yield the first frame `count` more times, then all others."""
    for number, frame in enumerate(frames):
        if number == 0:
            yield from repeat(frame, count)
        yield frame


def add_grain(
    frames: Iterator[Frame],
    grain: Grain,
    share: float,
    photos: tuple[U8, U8] | None,
) -> Iterator[Frame]:
    """Yield frames with a share of the noise.

    `photos` (H, W, 3): the photo with and without noise. Pixels of the first frame that
    equal the second are replaced by the first. None: no frame has the photo's size.
    """
    field = GrainField(grain, share)
    for number, frame in enumerate(frames):
        rgb = field.add(frame.rgb, number)
        if number == 0 and photos is not None:
            photo, clean_photo = photos
            is_photo = cv2.absdiff(frame.rgb, clean_photo).max(axis=2) <= 1
            rgb = np.where(is_photo[..., None], photo, rgb)
        yield replace(frame, rgb=rgb)


ENTERING = 8
"""Frames in which a striker comes in, at least."""


class Delivery:
    """Hold, noise, flattened objects and strikers of a video."""

    def __init__(
        self, hold: int, grain: Grain | None, *, squash: bool, enter: Striker
    ) -> None:
        self.hold, self.grain, self.squash, self.enter = hold, grain, squash, enter
        self.first_blur = False
        """Whether the first frame is an exposure, too."""
        self.draws_hold = False
        """Whether the frames of the hold are drawn, as something comes in during them."""
        self._photos: tuple[U8, U8] | None = None

    @classmethod
    def from_scene(cls, settings: Render, photo: U8 | None) -> Delivery:
        """Return the delivery of a scene's settings; without a `photo` there is no
        noise.
        """
        hold, enter = settings.hold, settings.enter
        if photo is None:
            enter = Striker.NONE
        if enter is not Striker.NONE:
            hold = max(hold, ENTERING)
        if settings.play is Play.BACKWARD:
            hold, enter = 0, Striker.NONE
        grain = None
        if settings.grain is Noise.MATCH and photo is not None:
            grain = measure_grain(photo)
        delivery = cls(hold, grain, squash=settings.squash, enter=enter)
        delivery.first_blur = settings.first_blur
        return delivery

    def as_dict(self) -> dict[str, Any]:
        """Return the settings for the manifest; empty without any."""
        parts: dict[str, Any] = {}
        if self.hold:
            parts["hold"] = self.hold
        if self.grain is not None:
            parts["grain"] = Noise.MATCH.value
        if self.squash:
            parts["squash"] = True
        if self.first_blur:
            parts["first_blur"] = True
        if self.enter is not Striker.NONE:
            parts["enter"] = self.enter.value
        return parts

    def remove_noise(self, maps: Percepts) -> Percepts:
        """Return the maps for drawing, without noise; must precede the first frame."""
        if self.grain is None:
            return maps
        clean_maps = remove_map_noise(maps, self.grain)
        self._photos = maps.rgb, clean_maps.rgb
        return clean_maps

    def deliver_frames(self, frames: Iterator[Frame], shot: Shot) -> Iterator[Frame]:
        """Yield the frames of the video."""
        if self.hold and not self.draws_hold:
            frames = hold_frames(frames, self.hold)
        if self.grain is None:
            return frames
        share = min(float(shot.affine(0.0)[0, 0]), 1.0)
        photos = self._photos if shot.opens_on_photo else None
        return add_grain(frames, self.grain, share, photos)
