"""The segmentation network: foreground, borders, pixel affinities, normals, shadows and movability of a photo; and its
head, which cuts out the object in a box or at a point.

The weights come from `studio/segmentation`; OpenCV runs them.
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

F32 = NDArray[np.float32]
LOCK = Lock()

WEIGHTS = "segmentation.onnx"
OFFSETS = ((3, 0), (0, 3), (9, 0), (0, 9), (9, 9), (9, -9), (27, 0), (0, 27))
"""(rows, columns) px of the output: offsets of the pixel pairs whose affinity (same object) is predicted."""
SIDE = 192  # px of the crop that the head looks at
MARGIN = 0.25  # of a box's sides: seen around it
LOOKS = 24
"""Crops whose first look is cached: those of a photo's candidates."""
OUTPUTS = "seen", "level-32", "level-16", "level-8", "level-4", "level-2"
POOLED = {"level-32": 32, "level-16": 16}
"""Levels of the encoder that describe the whole photo, and their strides in px: finer ones describe texture."""
BANDS = 3
"""Rows into which a photo is pooled: what is above differs from what is below."""
MEAN, SPREAD = 118.0, 64.0
"""Of 8-bit codes: the input is (code - MEAN) / SPREAD."""
STRIDE = 32
"""px: the input's sides are multiples of it."""
LEAST = 160
"""px: the input's shortest side. Where the coarsest maps are smaller than the kernels, OpenCV reads foreign memory."""
PASSES = 256, 512
"""px, the longer side of the photo in each pass: large objects are found in the first, small ones in the second; the
outputs, of the photo and of its mirror image, are averaged. Of a few pairs tried, this one finds most in the
validation homes."""


@dataclass(frozen=True, eq=False)
class NetworkMaps:
    """Maps (h, w) of half the size of the largest pass."""

    foreground: F32  # 0..1: on an object
    boundary: F32  # 0..1: at the border of an object
    pairs: F32  # (8, h, w) 0..1: the pixel and the one at OFFSETS belong to one object
    normals: F32  # (h, w, 3) unit: +x right, +y down, +z to the viewer
    shadow: F32  # 0..1: in a cast shadow
    movable: F32  # 0..1: if on an object, on one that may be moved: no person, animal or piece of furniture
    features: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    """(D,) description of the whole photo, the same for its mirror image; see `pool`."""


def run_network(rgb: NDArray[np.uint8]) -> NetworkMaps:
    """The network's maps of a photo (H, W, 3) sRGB, from `PASSES`.

    The last photo's maps are cached, since several roles of perception need them; the arrays are read-only.
    """
    return _seen(rgb.tobytes(), rgb.shape[0], rgb.shape[1])


@lru_cache(maxsize=1)
def _seen(codes: bytes, height: int, width: int) -> NetworkMaps:
    rgb = np.frombuffer(codes, np.uint8).reshape(height, width, 3)
    mirror = np.ascontiguousarray(rgb[:, ::-1])
    # their errors differ, and the mean of both is nearer to the truth
    passes, features = [], np.zeros(0, np.float32)
    for side in PASSES:
        one, other = _pass(rgb, side), _pass(mirror, side)
        mean_maps = (one.maps + mirrored(other.maps)) / 2
        passes.append(np.asarray(mean_maps, np.float32))
        if side == PASSES[0]:
            pairs_of_levels = zip(one.levels, other.levels, strict=True)
            features = pool([*pairs_of_levels, (passes[0],)])
    h, w = passes[-1].shape[1:]
    same = [
        cv2.resize(one.transpose(1, 2, 0), (w, h), interpolation=cv2.INTER_LINEAR)
        for one in passes
    ]
    mean = np.asarray(np.mean(same, axis=0), np.float32)
    chances = np.asarray(
        1 / (1 + np.exp(-np.clip(mean, -30, 30))), np.float32
    ).transpose(2, 0, 1)
    normals = mean[..., 10:13]
    normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-6)
    # offsets mean longer distances in smaller passes: affinities come from the largest pass alone
    pairs = 1 / (1 + np.exp(-np.clip(passes[-1][2:10], -30, 30)))
    maps = (
        chances[0], chances[1], np.asarray(pairs, np.float32), np.asarray(normals, np.float32),
        chances[13], chances[14], features,
    )  # fmt: skip
    for part in maps:
        part.setflags(write=False)
    return NetworkMaps(*maps)


def mirrored(maps: F32) -> F32:
    """Raw output (15, h, w) for the mirror image of a photo, as it lies in the photo."""
    there = np.array(maps[:, :, ::-1])
    there[10] *= -1  # x of the normals
    for n, (down, right) in enumerate(OFFSETS, 2):
        if (
            down == 0
        ):  # the other end of the pair comes first; pairs past the border stay as they are
            there[n, :, :-right] = there[n, :, right:]
        elif right:
            there[n] = maps[2 + OFFSETS.index((down, -right)), :, ::-1]
    return there


def pool(levels: Sequence[Sequence[F32]]) -> F32:
    """Pool levels, each the maps (C, h, w) of a photo and of its mirror image, to one vector.

    Each channel gives its mean in BANDS rows of equal height, and its spread.
    """
    parts = []
    for maps in levels:
        profile = np.mean([one.mean(axis=2) for one in maps], axis=0)
        rows = np.arange(profile.shape[1])
        borders = np.linspace(0, profile.shape[1], BANDS + 1)
        for top, bottom in pairwise(borders):
            # a row on a border belongs to both bands in part
            share = np.minimum(rows + 1, bottom) - np.maximum(rows, top)
            share = np.maximum(share, 0)
            parts.append(profile @ share / share.sum())
        spreads = [one.reshape(len(one), -1).std(axis=1) for one in maps]
        parts.append(np.mean(spreads, axis=0))
    return np.concatenate(parts).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Pass:
    """Raw outputs for one size of a photo."""

    maps: F32  # (15, h, w); h, w half of the size
    levels: Sequence[F32]  # those of POOLED, (C, h, w) each


def _pass(rgb: NDArray[np.uint8], side: int) -> _Pass:
    """Raw output for the photo with `side` px along its longer side."""
    height, width = rgb.shape[:2]
    scale = side / max(height, width)
    size = max(round(width * scale / 2), 1) * 2, max(round(height * scale / 2), 1) * 2
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(rgb, size, interpolation=how)
    right, below = (max(-part % STRIDE, LEAST - part) for part in size)
    padded = cv2.copyMakeBorder(small, 0, below, 0, right, cv2.BORDER_REPLICATE)
    outputs = dict(zip(OUTPUTS, _outputs(as_input(padded)), strict=True))
    levels = []
    for name, stride in POOLED.items():
        width, height = (-(-part // stride) for part in size)
        levels.append(outputs[name][0, :, :height, :width])
    return _Pass(outputs["seen"][0, :, : size[1] // 2, : size[0] // 2], levels)


def as_input(rgb: NDArray[Any]) -> F32:
    """(H, W, 3) sRGB codes as the network takes them, (1, 3, H, W)."""
    codes = rgb.astype(np.float32)
    return np.ascontiguousarray(
        ((codes - np.float32(MEAN)) / np.float32(SPREAD)).transpose(2, 0, 1)[None]
    )


def _outputs(blob: F32) -> list[F32]:
    network = _network()
    with LOCK:  # a net holds state between the calls
        network.setInput(blob)
        return [np.array(one, np.float32) for one in network.forward(OUTPUTS)]


@cache
def _network() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name(WEIGHTS)))


def crop(
    image: NDArray[np.uint8], box: Sequence[float], side: int, beyond: int = round(MEAN)
) -> NDArray[np.uint8]:
    """A box (left, top, right, bottom px) and its margin, squeezed to (side, side[, 3]); `beyond` is off the photo."""
    left, top, right, bottom = bounds(box)
    height, width = image.shape[:2]
    found = np.full((side, side, *image.shape[2:]), beyond, np.uint8)
    part = image[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)]
    x0, x1 = (
        round((x - left) / (right - left) * side)
        for x in (max(left, 0), min(right, width))
    )
    y0, y1 = (
        round((y - top) / (bottom - top) * side)
        for y in (max(top, 0), min(bottom, height))
    )
    if part.size and x1 > x0 and y1 > y0:
        less = min(part.shape[1], x1 - x0), min(part.shape[0], y1 - y0)
        part = np.asarray(
            cv2.resize(part, less, interpolation=cv2.INTER_AREA), np.uint8
        )
        found[y0:y1, x0:x1] = cv2.resize(
            part, (x1 - x0, y1 - y0), interpolation=cv2.INTER_LINEAR
        )
    return found


def bounds(box: Sequence[float]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of a box's crop, which may reach beyond the photo; 1 px across and down at least."""
    across, down = MARGIN * (box[2] - box[0]), MARGIN * (box[3] - box[1])
    left, top = round(box[0] - across), round(box[1] - down)
    return (
        left,
        top,
        max(round(box[2] + across), left + 1),
        max(round(box[3] + down), top + 1),
    )


def mask_in_box(rgb: NDArray[np.uint8], box: Sequence[float]) -> PromptedMask:
    """The object in a box (left, top, right, bottom px), in one piece; an empty mask where none is seen.

    The confidence is the overlap (IoU) that the head expects.
    """
    return _segment(rgb, box, at_point=False)


def mask_at_point(
    rgb: NDArray[np.uint8], point: tuple[float, float], side: float
) -> PromptedMask:
    """The same for the object at a point (x, y px), looked for in a square around it with sides of `side` px."""
    half = side / (1 + 2 * MARGIN) / 2
    x, y = point
    return _segment(rgb, (x - half, y - half, x + half, y + half), at_point=True)


def rough_mask_in_box(
    rgb: NDArray[np.uint8], box: Sequence[float], shape: tuple[int, int]
) -> Proposal | None:
    """Return the object in a box of the photo, on a grid of `shape` (h, w).

    One look without its mirror image and without the photo's edges, in half the time of
    `mask_in_box`. None where nothing is seen.
    """
    left, top, right, bottom = bounds(box)
    chances = _first_chances(crop(rgb, box, SIDE).tobytes(), at_point=False)
    scale = np.array([shape[1] / rgb.shape[1], shape[0] / rgb.shape[0]])
    low = np.floor(np.array([left, top]) * scale).astype(int)
    high = np.ceil(np.array([right, bottom]) * scale).astype(int)
    x0, y0 = np.maximum(low, 0).tolist()
    x1, y1 = np.minimum(high, shape[::-1]).tolist()
    if x1 <= x0 or y1 <= y0:
        return None
    # centres of the grid's cells -> those of the head's output
    step = np.array([right - left, bottom - top]) / np.array(chances.shape[::-1])
    factor = 1 / (scale * step)
    first = (np.array([x0, y0]) + 0.5) * factor - np.array([left, top]) / step - 0.5
    matrix = np.array([[factor[0], 0, first[0]], [0, factor[1], first[1]]])
    there = cv2.warpAffine(
        chances,
        matrix,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return cut_out(there >= 0.5, x0, y0, 4)


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of a mask (H, W); the last two just outside."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return x, y, x + width, y + height


def _segment(
    rgb: NDArray[np.uint8], box: Sequence[float], *, at_point: bool
) -> PromptedMask:
    height, width = rgb.shape[:2]
    mask = np.zeros((height, width), np.bool_)
    left, top, right, bottom = bounds(box)
    x, y, end, foot = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if end <= x or foot <= y:
        return PromptedMask(mask, 0.0)
    view = crop(rgb, box, SIDE)
    small = _first_chances(view.tobytes(), at_point)
    # errors of the mirror image differ
    other = _chances(np.ascontiguousarray(view[:, ::-1]), at_point)
    affine: NDArray[Any] = follow_edges(
        view, np.asarray((small + other[:, ::-1]) / 2, np.float32)
    )
    across, down = SIDE / (right - left), SIDE / (bottom - top)
    there = np.array(
        [
            [across, 0, (x - left + 0.5) * across - 0.5],
            [0, down, (y - top + 0.5) * down - 0.5],
        ]
    )
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    affine = cv2.warpAffine(
        affine, there, (end - x, foot - y), flags=how, borderMode=cv2.BORDER_REPLICATE
    )
    chances = np.clip(
        (affine[..., :3] * rgb[y:foot, x:end]).sum(-1) + affine[..., 3], 0, 1
    )
    piece = cut_out(chances >= 0.5, 0, 0, SMALLEST_OBJECT)
    if piece is None:
        return PromptedMask(mask, 0.0)
    mask[y:foot, x:end] = inside = piece.on(chances.shape)
    on = float(chances[inside].sum())
    return PromptedMask(mask, on / (float(inside.sum()) + float(chances.sum()) - on))


def follow_edges(
    rgb: NDArray[np.uint8], chances: F32, radius: int = 3, noise: float = 4.0
) -> F32:
    """(SIDE, SIDE, 4) that gives chances (h, w) at the photo's own edges: weights of red, green and blue and a sum.

    Coefficients of a guided filter (He and Sun 2015, Fast guided filter): around each pixel of the crop (SIDE, SIDE, 3)
    the linear function of colours nearest to the chances. `radius` px; `noise` levels of the colours.
    """

    def mean(values: NDArray[Any]) -> F32:
        return np.asarray(
            cv2.blur(values, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT),
            np.float32,
        )

    colours, known = rgb.astype(np.float32), cv2.resize(chances, rgb.shape[1::-1])
    middle, level = mean(colours), mean(known)
    shared = mean(colours * known[..., None]) - middle * level[..., None]
    other = np.roll(colours, -1, axis=-1)  # green, blue, red
    squares = mean(colours * colours) - middle * middle + np.float32(noise**2)
    products = mean(colours * other) - middle * np.roll(middle, -1, axis=-1)
    weights = _solve_symmetric(squares, products, shared)
    return mean(np.dstack([weights, level - (weights * middle).sum(-1)]))


def _solve_symmetric(diagonal: F32, beside: F32, right: F32) -> F32:
    """Return the solutions (h, w, 3) of symmetric systems of three equations.

    `beside` (h, w, 3) has the elements 01, 12 and 20 of the matrices; `right` is the
    right side. By cofactors: a general solver takes four times as long.
    """
    first, second, third = _cofactors(diagonal, beside)
    row = np.dstack([diagonal[..., 0], beside[..., 0], beside[..., 2]])
    x, y, z = np.moveaxis(right.astype(np.float64), -1, 0)
    factor = 1 / (row.astype(np.float64) * np.stack(first, axis=-1)).sum(axis=-1)
    parts = [one[0] * x + one[1] * y + one[2] * z for one in (first, second, third)]
    return np.stack([part * factor for part in parts], axis=-1).astype(np.float32)


def _cofactors(diagonal: F32, beside: F32) -> list[list[NDArray[np.float64]]]:
    """Return the rows of cofactors (h, w) of symmetric matrices."""
    a, b, c = np.moveaxis(diagonal.astype(np.float64), -1, 0)
    d, e, f = np.moveaxis(beside.astype(np.float64), -1, 0)
    ab, bc, ac = e * f - c * d, d * f - a * e, d * e - b * f
    return [[b * c - e * e, ab, ac], [ab, a * c - f * f, bc], [ac, bc, a * b - d * d]]


@lru_cache(maxsize=LOOKS)
def _first_chances(codes: bytes, at_point: bool) -> F32:
    """Return `_chances` of the codes of a crop, read-only; a photo's last are cached."""
    view = np.frombuffer(codes, np.uint8).reshape(SIDE, SIDE, 3)
    chances = _chances(view, at_point)
    chances.setflags(write=False)
    return chances


def _chances(rgb: NDArray[np.uint8], at_point: bool) -> F32:
    """(SIDE / 2, SIDE / 2) 0..1 of a crop (SIDE, SIDE, 3): on the object meant."""
    levels, head = _outputs(as_input(rgb))[1:], _head()
    with LOCK:
        for name, level in zip(OUTPUTS[1:], levels, strict=True):
            head.setInput(level, name)
        head.setInput(np.full((1, 1, 1, 1), at_point, np.float32), "at-point")
        logits = np.clip(head.forward()[0], -30, 30)
    return np.asarray(1 / (1 + np.exp(-logits)), np.float32)


@cache
def _head() -> cv2.dnn.Net:
    return cv2.dnn.readNetFromONNX(str(Path(__file__).with_name("cutout.onnx")))
