"""The segmentation network: maps of a photo, and a head that cuts out objects.

The maps are foreground, borders, pixel affinities, normals, shadows and movability. The
head cuts out the object in a box or at a point. The weights come from
`studio/segmentation`; OpenCV runs them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import SMALLEST_OBJECT, PromptedMask
from physgen.perceive.segment.proposals import Proposal, cut_out
from physgen.photometry import channel_sum

F32 = NDArray[np.float32]
LOCK = Lock()

WEIGHTS = "segmentation.onnx"
OFFSETS = ((3, 0), (0, 3), (9, 0), (0, 9), (9, 9), (9, -9), (27, 0), (0, 27))
"""(rows, columns) px of the output: offsets of pixel pairs with a predicted affinity
(same object).
"""
# px: side of the head's crop.
SIDE = 192
# Width of the surroundings in the crop over a box's sides.
MARGIN = 0.25
LARGEST_LOGIT = 30
"""Logits are clipped to this, against overflow."""
LOOKS = 24
"""Number of crops with cached first results: those of a photo's candidates."""
OUTPUTS = "seen", "level-32", "level-16", "level-8", "level-4", "level-2"
POOLED = {"level-32": 32, "level-16": 16}
"""Levels of the encoder that describe the whole photo, and their strides in px: finer
levels describe texture.
"""
BANDS = 3
"""Rows into which a photo is pooled, because its upper and lower parts differ."""
MEAN, SPREAD = 118.0, 64.0
"""Mean and standard deviation of 8-bit levels: the input is (level - MEAN) / SPREAD."""
STRIDE = 32
"""px: the input's sides are multiples of this."""
LEAST = 160
"""px: shortest side of the input.

If the coarsest maps are smaller than the kernels, OpenCV reads foreign memory.
"""
PASSES = 256, 512
"""px: longer side of the photo in each pass.

Large objects are found in the first pass, small ones in the second; the outputs of the
photo and of its mirror image are averaged. Of a few tried pairs, this one finds most
objects in the validation homes.
"""


@dataclass(frozen=True, eq=False)
class NetworkMaps:
    """Maps (h, w) of half the size of the largest pass."""

    # 0..1: on an object.
    foreground: F32
    # 0..1: at the border of an object.
    boundary: F32
    # (8, h, w) 0..1: the pixel and the one at OFFSETS belong to one object.
    pairs: F32
    # (h, w, 3) unit: +x right, +y down, +z to the viewer.
    normals: F32
    # 0..1: in a cast shadow.
    shadow: F32
    # 0..1: on a movable object, if on an object; people, animals and furniture are
    # immovable.
    movable: F32
    features: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    """(D,) description of the whole photo, equal for its mirror image; see `pool`."""


def run_network(rgb: NDArray[np.uint8]) -> NetworkMaps:
    """Return the network's maps of a photo (H, W, 3) sRGB, from `PASSES`.

    The last maps are cached, since several roles use them; the arrays are read-only.
    """
    return _predict_maps(rgb.tobytes(), rgb.shape[0], rgb.shape[1])


@lru_cache(maxsize=1)
def _predict_maps(codes: bytes, height: int, width: int) -> NetworkMaps:
    """Return the maps of a photo given as bytes."""
    rgb = np.frombuffer(codes, np.uint8).reshape(height, width, 3)
    passes, features = _run_passes(rgb)
    mean = _average_passes(passes)
    chances = np.asarray(_sigmoid(mean), np.float32).transpose(2, 0, 1)
    normals = mean[..., 10:13]
    normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
    # Offsets mean longer distances in smaller passes: affinities come from the largest
    # pass only.
    pairs = _sigmoid(passes[-1][2:10])
    maps = NetworkMaps(
        foreground=chances[0],
        boundary=chances[1],
        pairs=np.asarray(pairs, np.float32),
        normals=np.asarray(normals, np.float32),
        shadow=chances[13],
        movable=chances[14],
        features=features,
    )
    for array in vars(maps).values():
        array.setflags(write=False)
    return maps


def _run_passes(rgb: NDArray[np.uint8]) -> tuple[list[F32], F32]:
    """Return the raw maps (15, h, w) of each pass, and the photo's features.

    The errors of photo and mirror image differ, so that their mean is more accurate.
    """
    mirror = np.ascontiguousarray(rgb[:, ::-1])
    passes: list[F32] = []
    features = np.zeros(0, np.float32)
    for side in PASSES:
        photo_pass = _pass(rgb, side)
        mirror_pass = _pass(mirror, side)
        mean_maps = (photo_pass.maps + mirror_maps(mirror_pass.maps)) / 2
        passes.append(np.asarray(mean_maps, np.float32))
        if side == PASSES[0]:
            pairs_of_levels = zip(photo_pass.levels, mirror_pass.levels, strict=True)
            features = pool([*pairs_of_levels, (passes[0],)])
    return passes, features


def _average_passes(passes: Sequence[F32]) -> F32:
    """Return the mean (h, w, 15) of the passes at the size of the last one."""
    height, width = passes[-1].shape[1:]
    resized_maps = []
    for maps in passes:
        resized_maps.append(
            cv2.resize(
                maps.transpose(1, 2, 0), (width, height), interpolation=cv2.INTER_LINEAR
            )
        )
    return np.asarray(np.mean(resized_maps, axis=0), np.float32)


def _sigmoid(logits: F32) -> NDArray[Any]:
    """Return the probabilities of logits."""
    return 1 / (1 + np.exp(-np.clip(logits, -LARGEST_LOGIT, LARGEST_LOGIT)))


def mirror_maps(maps: F32) -> F32:
    """Return the raw output (15, h, w) of a mirror image, mapped to the photo."""
    result = np.array(maps[:, :, ::-1])
    # The x component of the normals changes its sign.
    result[10] *= -1
    for n, (down, right) in enumerate(OFFSETS, 2):
        # The other end of the pair comes first; pairs across the border stay.
        if down == 0:
            result[n, :, :-right] = result[n, :, right:]
        elif right:
            result[n] = maps[2 + OFFSETS.index((down, -right)), :, ::-1]
    return result


def pool(levels: Sequence[Sequence[F32]]) -> F32:
    """Return one vector for levels, each the maps (C, h, w) of a photo and its mirror
    image.

    Each channel gives its mean in BANDS rows of equal height, and its spread.
    """
    parts = []
    for maps in levels:
        profile = np.mean([channel_maps.mean(axis=2) for channel_maps in maps], axis=0)
        rows = np.arange(profile.shape[1])
        borders = np.linspace(0, profile.shape[1], BANDS + 1)
        for top, bottom in pairwise(borders):
            # A row on a border belongs to both bands in part.
            share = np.minimum(rows + 1, bottom) - np.maximum(rows, top)
            share = np.maximum(share, 0)
            parts.append(profile @ share / share.sum())
        spreads = []
        for channel_maps in maps:
            spreads.append(channel_maps.reshape(len(channel_maps), -1).std(axis=1))
        parts.append(np.mean(spreads, axis=0))
    return np.concatenate(parts).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Pass:
    """The raw outputs for one size of a photo."""

    # (15, h, w); h, w are half of the size.
    maps: F32
    # The levels of POOLED, (C, h, w) each.
    levels: Sequence[F32]


def _pass(rgb: NDArray[np.uint8], side: int) -> _Pass:
    """Return the raw output for the photo with `side` px along its longer side."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    size = max(round(width * scale / 2), 1) * 2, max(round(height * scale / 2), 1) * 2
    if scale < 1:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    small = cv2.resize(rgb, size, interpolation=interpolation)
    right, bottom = (max(-part % STRIDE, LEAST - part) for part in size)
    padded_photo = cv2.copyMakeBorder(small, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
    outputs = dict(zip(OUTPUTS, _outputs(as_input(padded_photo)), strict=True))
    levels = []
    for name, stride in POOLED.items():
        width, height = (-(-part // stride) for part in size)
        levels.append(outputs[name][0, :, :height, :width])
    return _Pass(outputs["seen"][0, :, : size[1] // 2, : size[0] // 2], levels)


def as_input(rgb: NDArray[Any]) -> F32:
    """Return sRGB levels (H, W, 3) as the network's input (1, 3, H, W)."""
    codes = rgb.astype(np.float32)
    return np.ascontiguousarray(
        ((codes - np.float32(MEAN)) / np.float32(SPREAD)).transpose(2, 0, 1)[None]
    )


def _outputs(blob: F32) -> list[F32]:
    """Return the outputs of the network for an input."""
    network = _network()
    # An OpenCV network holds state between the calls.
    with LOCK:
        network.setInput(blob)
        return [np.array(output, np.float32) for output in network.forward(OUTPUTS)]


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(WEIGHTS)))


def crop(
    image: NDArray[np.uint8], box: Sequence[float], side: int, fill: int = round(MEAN)
) -> NDArray[np.uint8]:
    """Return a box (left, top, right, bottom px) with its margin, resized to (side,
    side[, 3]).

    Pixels outside the photo have the value `fill`.
    """
    left, top, right, bottom = bounds(box)
    height, width = image.shape[:2]
    result = np.full((side, side, *image.shape[2:]), fill, np.uint8)
    part = image[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]
    x0 = round((max(left, 0) - left) / (right - left) * side)
    x1 = round((min(right, width) - left) / (right - left) * side)
    y0 = round((max(top, 0) - top) / (bottom - top) * side)
    y1 = round((min(bottom, height) - top) / (bottom - top) * side)
    if part.size and x1 > x0 and y1 > y0:
        # Reduce first, then enlarge: INTER_AREA cannot enlarge.
        size = min(part.shape[1], x1 - x0), min(part.shape[0], y1 - y0)
        part = np.asarray(
            cv2.resize(part, size, interpolation=cv2.INTER_AREA), np.uint8
        )
        result[y0:y1, x0:x1] = cv2.resize(
            part, (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR
        )
    return result


def bounds(box: Sequence[float]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of a box's crop, px.

    The crop may reach outside the photo and is at least 1 px wide and high.
    """
    x_margin = MARGIN * (box[2] - box[0])
    y_margin = MARGIN * (box[3] - box[1])
    left = round(box[0] - x_margin)
    top = round(box[1] - y_margin)
    return (
        left,
        top,
        max(round(box[2] + x_margin), left + 1),
        max(round(box[3] + y_margin), top + 1),
    )


def mask_in_box(rgb: NDArray[np.uint8], box: Sequence[float]) -> PromptedMask:
    """Return the object in a box (left, top, right, bottom px), in one piece.

    The mask is empty if no object is visible. The confidence is the IoU that the head
    expects.
    """
    return _segment(rgb, box, at_point=False)


def mask_at_point(
    rgb: NDArray[np.uint8], point: tuple[float, float], side: float
) -> PromptedMask:
    """Return the object at a point (x, y px), in a square with sides of `side` px
    around it.
    """
    half_side = side / (1 + 2 * MARGIN) / 2
    x, y = point
    return _segment(
        rgb, (x - half_side, y - half_side, x + half_side, y + half_side), at_point=True
    )


def rough_mask_in_box(
    rgb: NDArray[np.uint8], box: Sequence[float], shape: tuple[int, int]
) -> Proposal | None:
    """Return the object in a box of the photo on a grid of `shape` (h, w), or None.

    This uses one crop, without its mirror image and the photo's edges, in half the time
    of `mask_in_box`.
    """
    edges = np.array(bounds(box))
    chances = _first_chances(crop(rgb, box, SIDE).tobytes(), at_point=False)
    scale = np.array([shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]])
    low = np.floor(edges[:2] * scale).astype(int)
    high = np.ceil(edges[2:] * scale).astype(int)
    x0, y0 = np.maximum(low, 0).tolist()
    x1, y1 = np.minimum(high, shape[::-1]).tolist()
    if x1 <= x0 or y1 <= y0:
        return None
    # Maps centres of the grid's cells to those of the head's output.
    step = (edges[2:] - edges[:2]) / np.array(chances.shape[::-1])
    factor = 1 / (scale * step)
    first = (np.array([x0, y0]) + 0.5) * factor - edges[:2] / step - 0.5
    matrix = np.array([[factor[0], 0, first[0]], [0, factor[1], first[1]]])
    grid_chances = cv2.warpAffine(
        chances,
        matrix,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return cut_out(grid_chances >= 0.5, x0, y0, 4)


def object_chances(
    rgb: NDArray[np.uint8], box: Sequence[float]
) -> tuple[F32, tuple[int, int, int, int]]:
    """Return the probability (h, w) of the object in a box, and the map's own box.

    Boxes are left, top, right, bottom px; the map's box may reach outside the photo.
    """
    return _mean_chances(crop(rgb, box, SIDE), at_point=False), bounds(box)


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of a mask (H, W), px; the last two are just
    outside.
    """
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return x, y, x + width, y + height


def _segment(
    rgb: NDArray[np.uint8], box: Sequence[float], *, at_point: bool
) -> PromptedMask:
    """Return the object in a box or, if `at_point`, at the centre of a box."""
    mask = np.zeros(rgb.shape[:2], np.bool_)
    x, y, end, foot = _photo_window(box, mask.shape)
    if end <= x or foot <= y:
        return PromptedMask(mask, 0.0)
    view = crop(rgb, box, SIDE)
    edge_weights = follow_edges(view, _mean_chances(view, at_point))
    weights = _move_to_window(edge_weights, box, (x, y, end, foot))
    colour_terms = weights[..., :3] * rgb[y:foot, x:end]
    chances = np.clip(channel_sum(colour_terms) + weights[..., 3], 0, 1)
    piece = cut_out(chances >= 0.5, 0, 0, SMALLEST_OBJECT)
    if piece is None:
        return PromptedMask(mask, 0.0)
    inner_mask = piece.on(chances.shape)
    mask[y:foot, x:end] = inner_mask
    return PromptedMask(mask, _expected_iou(chances, inner_mask))


def _photo_window(
    box: Sequence[float], shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of a box inside a photo of `shape` (H, W), px."""
    height, width = shape
    left, top, right, bottom = bounds(box)
    return max(left, 0), max(top, 0), min(right, width), min(bottom, height)


def _expected_iou(chances: NDArray[Any], mask: NDArray[np.bool_]) -> float:
    """Return the expected overlap of a mask (h, w) with an object of given chances."""
    inner_sum = float(chances[mask].sum())
    union = float(mask.sum()) + float(chances.sum()) - inner_sum
    return inner_sum / union


def _move_to_window(
    weights: NDArray[Any], box: Sequence[float], window: tuple[int, int, int, int]
) -> NDArray[Any]:
    """Return the map (SIDE, SIDE, n) of a box's crop on the pixels of a window.

    The window is left, top, right, bottom px of the photo.
    """
    left, top, right, bottom = bounds(box)
    x, y, end, foot = window
    x_scale = SIDE / (right - left)
    y_scale = SIDE / (bottom - top)
    transform = np.array(
        [
            [x_scale, 0, (x - left + 0.5) * x_scale - 0.5],
            [0, y_scale, (y - top + 0.5) * y_scale - 0.5],
        ]
    )
    return cv2.warpAffine(
        weights,
        transform,
        (end - x, foot - y),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def follow_edges(
    rgb: NDArray[np.uint8], chances: F32, radius: int = 3, noise: float = 4.0
) -> F32:
    """Return (SIDE, SIDE, 4) weights of red, green, blue and a constant that give the
    chances.

    The result follows the photo's edges: coefficients of a guided filter (He and Sun
    2015, Fast guided filter). Around each pixel of the crop (SIDE, SIDE, 3) they define
    the linear function of colours nearest to the chances (h, w). `radius` is in px,
    `noise` in levels of the colours.
    """

    def mean(values: NDArray[Any]) -> F32:
        return np.asarray(
            cv2.blur(values, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT),
            np.float32,
        )

    colours = rgb.astype(np.float32)
    large_chances = cv2.resize(chances, rgb.shape[1::-1])
    middle = mean(colours)
    level = mean(large_chances)
    covariance = mean(colours * large_chances[..., None]) - middle * level[..., None]
    # Channels in the order green, blue, red.
    other = np.roll(colours, -1, axis=-1)
    squares = mean(colours * colours) - middle * middle + np.float32(noise**2)
    products = mean(colours * other) - middle * np.roll(middle, -1, axis=-1)
    weights = _solve_symmetric(squares, products, covariance)
    return mean(np.dstack([weights, level - (weights * middle).sum(-1)]))


def _solve_symmetric(diagonal: F32, off_diagonal: F32, right: F32) -> F32:
    """Return the solutions (h, w, 3) of symmetric systems of three equations.

    `off_diagonal` (h, w, 3) has the elements 01, 12 and 20 of the matrices; `right` is the
    right side. The solution uses cofactors: a general solver takes four times as long.
    """
    first, second, third = _cofactors(diagonal, off_diagonal)
    row = np.dstack([diagonal[..., 0], off_diagonal[..., 0], off_diagonal[..., 2]])
    x, y, z = np.moveaxis(right.astype(np.float64), -1, 0)
    products = row.astype(np.float64) * np.stack(first, axis=-1)
    factor = 1 / products.sum(axis=-1)
    parts = []
    for cofactor_row in (first, second, third):
        parts.append(cofactor_row[0] * x + cofactor_row[1] * y + cofactor_row[2] * z)
    return np.stack([part * factor for part in parts], axis=-1).astype(np.float32)


def _cofactors(diagonal: F32, off_diagonal: F32) -> list[list[NDArray[np.float64]]]:
    """Return the rows of cofactors (h, w) of symmetric matrices."""
    a, b, c = np.moveaxis(diagonal.astype(np.float64), -1, 0)
    d, e, f = np.moveaxis(off_diagonal.astype(np.float64), -1, 0)
    aa = b * c - e * e
    bb = a * c - f * f
    cc = a * b - d * d
    ab = e * f - c * d
    bc = d * f - a * e
    ac = d * e - b * f
    return [[aa, ab, ac], [ab, bb, bc], [ac, bc, cc]]


def _mean_chances(view: NDArray[np.uint8], at_point: bool) -> F32:
    """Return the mean of `_chances` of a crop and of its mirror image.

    The errors of the mirror image differ from those of the crop.
    """
    first = _first_chances(view.tobytes(), at_point)
    other = _chances(np.ascontiguousarray(view[:, ::-1]), at_point)
    return np.asarray((first + other[:, ::-1]) / 2, np.float32)


@lru_cache(maxsize=LOOKS)
def _first_chances(codes: bytes, at_point: bool) -> F32:
    """Return `_chances` of a crop given as bytes, read-only and cached."""
    view = np.frombuffer(codes, np.uint8).reshape(SIDE, SIDE, 3)
    chances = _chances(view, at_point)
    chances.setflags(write=False)
    return chances


def _chances(rgb: NDArray[np.uint8], at_point: bool) -> F32:
    """Return the probability (SIDE / 2, SIDE / 2) of the prompted object in a crop."""
    levels = _outputs(as_input(rgb))[1:]
    head = _head()
    with LOCK:
        for name, level in zip(OUTPUTS[1:], levels, strict=True):
            head.setInput(level, name)
        head.setInput(np.full((1, 1, 1, 1), at_point, np.float32), "at-point")
        logits = np.clip(head.forward()[0], -30, 30)
    return np.asarray(1 / (1 + np.exp(-logits)), np.float32)


@cache
def _head() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name("cutout.onnx")))
