"""Noise of the photo: measured by brightness, taken from what is drawn, and added afresh to every frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from math import sqrt
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32, F64
from physgen.maps import U8, Percepts
from physgen.render.camera import Shot
from physgen.render.stage import Frame
from physgen.scene.scene import Noise, Play, Render, Striker


@dataclass(frozen=True)
class GrainTuning:
    """How noise differs from texture, and is made."""

    block: int = 8
    """px a side of the blocks whose finest detail is measured."""
    bins: int = 16
    """Ranges of brightness."""
    flat: float = 0.1
    """Share of the blocks in a range that count as free of texture: the flattest."""
    low: float = 1.15
    """True deviation over that of the flattest tenth of blocks, of which it is a low draw."""
    blocks: int = 30
    """Blocks of a range that are needed to measure it."""
    clipped: tuple[int, int] = (4, 251)
    """Grey levels beyond which a block may be clipped."""
    least: float = 0.4
    """Grey levels: rounding makes noise of 0.29."""
    most: float = 6.0
    """Grey levels: more is texture."""
    kept: float = 6.0
    """Standard deviations, added over the channels, of differences that denoising keeps."""
    reach: int = 5
    """px of the denoised neighbourhood."""
    spread: float = 1.5
    """px, standard deviation of its weights."""
    tile: int = 512
    """px a side of the parts of a frame with noise of one place of the field."""
    room: int = 128
    """px by which the field is larger, so that each frame has another part of it."""
    steady: float = 1.5
    """Deviation at any brightness over the lower quartile of all, at most."""
    correlation: float = 0.35
    """Of neighbouring pixels, at most: more is texture."""


GRAIN = GrainTuning()
SEED = 0
FINEST = np.outer((1, -2, 1), (1, -2, 1)).astype(np.float32) / 6
"""Kernel that leaves nothing of planes, and the deviation of noise as it is."""


@dataclass(frozen=True)
class Grain:
    """Noise of a photo."""

    deviation: F32
    """(256, 3) standard deviation by level and channel, grey levels."""
    channels: F64
    """(3, 3) correlation of channels."""
    neighbours: float
    """Correlation of neighbouring pixels."""


def measure_grain(rgb: U8) -> Grain | None:
    """Measure the noise of a photo (H, W, 3) sRGB; None if rounding hides it.

    The finest detail of the flattest blocks counts (after Immerkaer, 1996): texture has little of it there.
    """
    picture = rgb.astype(np.float32)
    detail = np.asarray(cv2.filter2D(picture, cv2.CV_32F, FINEST), np.float32)
    blocks, details = _blocks(picture), _blocks(detail)
    means = blocks.mean(axis=(1, 2))
    low, high = GRAIN.clipped
    is_open = (means.min(axis=1) > low) & (means.max(axis=1) < high)
    blocks, details, means = blocks[is_open], details[is_open], means[is_open]
    squares = (details**2).mean(axis=(1, 2))
    texture = squares.sum(axis=1)
    is_flat = np.zeros(len(blocks), np.bool_)
    curve = []
    for group in _brightness_groups(means.mean(axis=1)):
        flattest = group[texture[group] <= np.quantile(texture[group], GRAIN.flat)]
        is_flat[flattest] = True
        deviation = GRAIN.low * np.sqrt(squares[flattest].mean(axis=0))
        curve.append((means[group].mean(axis=0), deviation))
    if not curve or np.median([row for _, row in curve]) < GRAIN.least:
        return None
    channels = _channel_correlation(details[is_flat].reshape(-1, 3))
    return Grain(_curve(curve), channels, _neighbour_correlation(blocks[is_flat]))


def _channel_correlation(details: F32) -> F64:
    """Return the correlation (3, 3) of the channels; one without noise is independent."""
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
    """Return (256, 3) the deviation at each level, between and beyond the measured ones."""
    levels = np.array([level for level, _ in points])
    deviations = np.array([deviation for _, deviation in points])
    # Noise changes slowly with brightness: more in one range is texture.
    most = GRAIN.steady * np.quantile(deviations, 0.25, axis=0)
    most = np.minimum(most, GRAIN.most)
    every = np.arange(256)
    columns = []
    for channel in range(3):
        order = np.argsort(levels[:, channel])
        x, y = levels[order, channel], deviations[order, channel]
        columns.append(np.interp(every, x, np.minimum(y, most[channel])))
    return np.stack(columns, axis=1).astype(np.float32)


def _neighbour_correlation(blocks: F32) -> float:
    """Return the correlation of neighbouring pixels in blocks (n, size, size, 3)."""
    steps = []
    for distance in (1, 2, 3):
        beside = blocks[:, :, distance:] - blocks[:, :, :-distance]
        below = blocks[:, distance:] - blocks[:, :-distance]
        steps.append(float((beside**2).mean() + (below**2).mean()) / 2)
    # Noise is alike at neighbours alone; a gradient grows with the square of the distance.
    gradient = max(steps[2] - steps[1], 0.0) / 5
    square = max(steps[1] - 4 * gradient, 1e-9)
    share = 1 - (steps[0] - gradient) / square
    return min(max(share, 0.0), GRAIN.correlation)


def remove_map_noise(maps: Percepts, grain: Grain) -> Percepts:
    """Return photo and backgrounds without noise; pixels that were equal stay equal."""
    photo = remove_noise(maps.rgb, grain)
    pictures: list[U8 | None] = []
    for picture in (maps.background, maps.clean):
        if picture is None:
            pictures.append(None)
            continue
        is_photo = (picture == maps.rgb).all(axis=2, keepdims=True)
        pictures.append(np.where(is_photo, photo, remove_noise(picture, grain)))
    background, clean = pictures
    return replace(maps, rgb=photo, background=background, clean=clean)


def remove_noise(rgb: U8, grain: Grain) -> U8:
    """Return a picture (H, W, 3) sRGB without noise, by a filter that keeps edges.

    Levels are spaced by their noise first, so that it is 1 everywhere.
    """
    floor = np.maximum(grain.deviation, GRAIN.least)
    scales = np.cumsum(1 / floor, axis=0).astype(np.float32)
    planes = [scales[rgb[..., k], k] for k in range(3)]
    even = np.asarray(cv2.merge(planes), np.float32)
    smooth = cv2.bilateralFilter(even, GRAIN.reach, GRAIN.kept, GRAIN.spread)
    every = np.arange(256)
    result = np.empty_like(rgb)
    for k, plane in enumerate(cv2.split(smooth)):
        levels = np.interp(np.asarray(plane), scales[:, k], every)
        result[..., k] = np.rint(levels)
    return result


class GrainField:
    """Noise that is new in every frame: parts of one field, each from another place."""

    def __init__(self, grain: Grain, share: float = 1.0) -> None:
        """Make the field; `share` of the deviation is seen, less if the video is smaller."""
        side = GRAIN.tile + GRAIN.room
        chance = np.random.default_rng(SEED)
        white = chance.standard_normal((side, side, 3), np.float32)
        factor = _root(grain.channels).astype(np.float32)
        field = white @ factor.T
        weight = _neighbour_weight(grain.neighbours)
        kernel = np.array([weight, 1, weight]) / sqrt(1 + 2 * weight**2)
        blurred = cv2.sepFilter2D(field, cv2.CV_32F, kernel, kernel)
        self._field = np.ascontiguousarray(blurred, np.float32)
        self._table = np.asarray(share * grain.deviation, np.float32)[None]

    def add(self, rgb: U8, number: int) -> U8:
        """Return a frame (H, W, 3) sRGB with the noise of frame `number`."""
        chance = np.random.default_rng((SEED, number))
        result = np.empty_like(rgb)
        height, width = rgb.shape[:2]
        for top in range(0, height, GRAIN.tile):
            for left in range(0, width, GRAIN.tile):
                box = np.s_[top : top + GRAIN.tile, left : left + GRAIN.tile]
                result[box] = self._add_noise(rgb[box], chance)
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
    """Return (3, 3) a matrix whose product with its transpose is a correlation matrix."""
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)), np.float64)


def _neighbour_weight(correlation: float) -> float:
    """Return the weight w of neighbours in a kernel (w, 1, w) that gives such a correlation."""
    if correlation <= 0:
        return 0.0
    return (1 - sqrt(max(1 - 2 * correlation**2, 0))) / (2 * correlation)


def hold_frames(frames: Iterator[Frame], count: int) -> Iterator[Frame]:
    """Yield the first frame `count` times more."""
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

    `photos` (H, W, 3): the photo, and without noise. Where the first frame is as the second, it
    is as the first. None: no frame shows the photo at its size.
    """
    field = GrainField(grain, share)
    for number, frame in enumerate(frames):
        rgb = field.add(frame.rgb, number)
        if number == 0 and photos is not None:
            photo, clean = photos
            is_photo = cv2.absdiff(frame.rgb, clean).max(axis=2) <= 1
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
        self.draws_hold = False
        """Whether the frames of the hold are drawn, as something comes in during them."""
        self._photos: tuple[U8, U8] | None = None

    @classmethod
    def of(cls, settings: Render, photo: U8 | None) -> Delivery:
        """Return the delivery that a scene asks for; no `photo` has no noise."""
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
        return cls(hold, grain, squash=settings.squash, enter=enter)

    def as_dict(self) -> dict[str, Any]:
        """Return hold, noise and flattening for the manifest; nothing if there are none."""
        parts: dict[str, Any] = {}
        if self.hold:
            parts["hold"] = self.hold
        if self.grain is not None:
            parts["grain"] = Noise.MATCH.value
        if self.squash:
            parts["squash"] = True
        if self.enter is not Striker.NONE:
            parts["enter"] = self.enter.value
        return parts

    def remove_noise(self, maps: Percepts) -> Percepts:
        """Return the maps that are drawn; call it before the first frame."""
        if self.grain is None:
            return maps
        clean = remove_map_noise(maps, self.grain)
        self._photos = maps.rgb, clean.rgb
        return clean

    def deliver_frames(self, frames: Iterator[Frame], shot: Shot) -> Iterator[Frame]:
        """Yield the frames of the video."""
        if self.hold and not self.draws_hold:
            frames = hold_frames(frames, self.hold)
        if self.grain is None:
            return frames
        share = min(float(shot.affine(0.0)[0, 0]), 1.0)
        photos = self._photos if shot.opens_on_photo else None
        return add_grain(frames, self.grain, share, photos)
