"""Stored pictures -> batches for training: crops of several sizes, mirrored, in other light, with noise; and their targets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import cv2
import numpy as np
from network import MEAN, OFFSETS, SPREAD
from numpy.typing import NDArray
from store import IMMOVABLE, SIDE, UNSAID, Store

CROP = 192
"""px of the pictures that the network learns from."""
HALF = CROP // 2
"""px of its output."""


LOOK = 100
"""Batches after which it is looked up again what stores hold."""


@dataclass(frozen=True)
class Batch:
    """N crops; maps of HALF x HALF."""

    x: NDArray[np.float32]
    """(N, 3, CROP, CROP)."""
    foreground: NDArray[np.float32]
    """(N, HALF, HALF)."""
    boundary: NDArray[np.float32]
    """(N, HALF, HALF): pixels beside a pixel of something else."""
    pairs: NDArray[np.float32]
    """(N, pairs, HALF, HALF): the pixel and the one at the offset are of one object."""
    asked: NDArray[np.float32]
    """(N, pairs, HALF, HALF): either is on an object, and neither is unsaid."""
    normals: NDArray[np.float32]
    """(N, 3, HALF, HALF)."""
    shadow: NDArray[np.float32]
    """(N, HALF, HALF)."""
    movable: NDArray[np.float32]
    """(N, HALF, HALF): on an object that physgen moves."""
    rendered: NDArray[np.float32]
    """(N,): shadows are known."""
    said: NDArray[np.float32]
    """(N, HALF, HALF): 0 where nobody judges."""
    weight: NDArray[np.float32]
    """(N, HALF, HALF): small objects count as much as large ones."""


def batches(
    stores: Sequence[Store], shares: Sequence[float], size: int, seed: int
) -> Iterator[Batch]:
    """Batches of `size` for ever; each picture from a store with the probability of its share."""
    rng = np.random.default_rng(seed)
    there = [np.flatnonzero(store.done) for store in stores]
    for number in count():
        if number % LOOK == 0:  # stores may still be filled
            there = [np.flatnonzero(store.done) for store in stores]
        picked = []
        for _ in range(size):
            which = int(rng.choice(len(stores), p=np.array(shares) / sum(shares)))
            picked.append(_sample(stores[which], int(rng.choice(there[which])), rng))
        yield Batch(*(np.stack(part) for part in zip(*picked, strict=True)))


def _sample(
    store: Store, k: int, rng: np.random.Generator
) -> tuple[NDArray[np.float32], ...]:
    side = int(rng.integers(112, SIDE + 1))
    y, x = (int(rng.integers(0, SIDE - side + 1)) for _ in range(2))
    box = np.s_[y : y + side, x : x + side]
    tall = (
        side if rng.random() < 0.5 else int(side * rng.uniform(0.8, 1.0))
    )  # a little squeezed
    box = np.s_[y : y + tall, x : x + side]
    how = cv2.INTER_AREA if side > CROP else cv2.INTER_LINEAR
    rgb = cv2.resize(store.rgb[k][box], (CROP, CROP), interpolation=how)
    labels = cv2.resize(
        np.ascontiguousarray(store.labels[k][box]),
        (HALF, HALF),
        interpolation=cv2.INTER_NEAREST_EXACT,
    )
    normals = cv2.resize(store.normals[k][box].astype(np.float32) / 127, (HALF, HALF))
    shadow = cv2.resize(store.shadow[k][box].astype(np.float32) / 255, (HALF, HALF))
    if rng.random() < 0.5:
        rgb, labels, normals, shadow = (
            np.ascontiguousarray(part[:, ::-1])
            for part in (rgb, labels, normals, shadow)
        )
        normals[..., 0] *= -1
    x_in = developed(rgb.astype(np.float32), rng)
    return (
        (x_in.transpose(2, 0, 1) - np.float32(MEAN)) / np.float32(SPREAD),
        *targets(labels),
        *_rest(labels, normals, shadow),
    )


def developed(
    rgb: NDArray[np.float32], rng: np.random.Generator
) -> NDArray[np.float32]:
    """The same crop as another camera would have it."""
    if rng.random() < 0.2:
        rgb = rgb[..., rng.permutation(3)]
    if rng.random() < 0.5:
        rgb = (
            (rgb - 128) * np.float32(rng.uniform(0.5, 1.4))
            + 128
            + np.float32(rng.uniform(-40, 40))
        )
    if rng.random() < 0.3:
        rgb = rgb * rng.uniform(0.8, 1.2, 3).astype(np.float32)
    if rng.random() < 0.3:
        rgb = 255 * np.power(
            np.clip(rgb / 255, 0, 1), np.float32(rng.uniform(0.6, 1.6))
        )
    if rng.random() < 0.15:
        rgb = np.repeat(rgb.mean(2, keepdims=True), 3, 2)
    if rng.random() < 0.2:
        rgb = cv2.GaussianBlur(rgb, (0, 0), rng.uniform(0.4, 1.5))
    if rng.random() < 0.3:
        rgb = rgb + rng.standard_normal(rgb.shape).astype(np.float32) * np.float32(
            rng.uniform(2, 12)
        )
    return np.clip(rgb, 0, 255).astype(np.float32)


def targets(labels: NDArray[np.uint8]) -> tuple[NDArray[np.float32], ...]:
    """Foreground, boundary, pairs and asked of a label map (h, w)."""
    said = labels != UNSAID
    ids = np.where(said, labels, 0).astype(np.int16)
    boundary = np.zeros(ids.shape, bool)
    for axis in (0, 1):
        ahead, behind = [slice(None)] * 2, [slice(None)] * 2
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        differ = (
            (ids[tuple(ahead)] != ids[tuple(behind)])
            & said[tuple(ahead)]
            & said[tuple(behind)]
        )
        boundary[tuple(ahead)] |= differ
        boundary[tuple(behind)] |= differ
    pairs = np.zeros((len(OFFSETS), *ids.shape), np.float32)
    asked = np.zeros_like(pairs)
    h, w = ids.shape
    for n, (down, right) in enumerate(OFFSETS):
        here = np.s_[: h - down, max(-right, 0) : w - max(right, 0)]
        there = np.s_[down:, max(right, 0) : w + min(right, 0)]
        a, b = ids[here], ids[there]
        pairs[n][here] = (a == b) & (a > 0)
        asked[n][here] = ((a > 0) | (b > 0)) & said[here] & said[there]
    return (ids > 0).astype(np.float32), boundary.astype(np.float32), pairs, asked


def _rest(
    labels: NDArray[np.uint8], normals: NDArray[np.float32], shadow: NDArray[np.float32]
) -> tuple[NDArray[np.float32], ...]:
    count = np.bincount(labels.ravel(), minlength=256).astype(np.float32)
    radius = np.sqrt(np.maximum(count, 1) / np.pi)
    weight = np.clip(8 / radius, 0.4, 2.5)
    weight[[0, UNSAID]] = 1
    said = (labels != UNSAID).astype(np.float32)
    movable = ((labels > 0) & (labels < IMMOVABLE)).astype(np.float32)
    rendered = np.float32(normals.any())
    return (
        normals.transpose(2, 0, 1),
        shadow,
        movable,
        rendered,
        said,
        weight[labels].astype(np.float32),
    )
