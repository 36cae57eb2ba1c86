"""Label maps with many things, and how long the role `boundary` takes to find what holds them: s of CPU.

python benchmarks/piles.py                  # all of them
python benchmarks/piles.py wall specks      # some
python benchmarks/piles.py heap -o FOLDER   # heap.png and heap-masks.png, too, for physgen perceive --masks
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from physgen.perceive.backends.boundary_support import support
from physgen.perceive.photo_objects import fit_objects
from physgen.perceive.segment.prompts import from_masks
from physgen.scene.scene import View

SIZE = 512
"""px, both sides."""


def wall(count: int = 300, across: int = 20) -> np.ndarray:
    """Blocks in courses, every second course half a block aside."""
    w, h = SIZE // (across + 1), SIZE // (count // across + 3)
    labels = empty()
    for k in range(count):
        row, column = divmod(k, across)
        x, y = column * w + (row % 2) * (w // 2) + 4, SIZE - 12 - (row + 1) * h
        labels[y : y + h, x : x + w] = k + 1
    return labels


def heap(count: int = 300, seed: int = 1) -> np.ndarray:
    """Blocks of any width and height dropped one after another: each lies on the highest below it."""
    rng = np.random.default_rng(seed)
    labels, top = empty(), np.full(SIZE, SIZE - 12)
    for k in range(count):
        w, h = rng.integers(14, 34), rng.integers(10, 24)
        places = [
            (int(top[x : x + w].min()), x) for x in rng.integers(4, SIZE - w - 4, 24)
        ]
        y, x = max(places)
        if y - h < 4:
            break
        labels[y - h : y, x : x + w] = k + 1
        top[x : x + w] = y - h
    return labels


def cells(count: int = 300, seed: int = 2) -> np.ndarray:
    """Cells of any form that leave no gap: those of the points that they are nearest to."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((4, 120), (SIZE - 4, SIZE - 12), (count, 2)).astype(np.float32)
    rows, columns = np.mgrid[:SIZE, :SIZE]
    gap = (columns[None] - points[:, 0, None, None]) ** 2
    gap += (rows[None] - points[:, 1, None, None]) ** 2
    labels = (gap.argmin(axis=0) + 1).astype(np.uint16)
    labels[:120] = labels[-12:] = 0
    labels[:, :4] = labels[:, -4:] = 0
    return labels


def specks(count: int = 300, seed: int = 3) -> np.ndarray:
    """Small things apart from each other."""
    rng = np.random.default_rng(seed)
    labels = empty()
    taken = empty()
    k = 0
    while k < count:
        w, h = rng.integers(4, 9, 2)
        x, y = rng.integers(4, SIZE - 14, 2)
        if not taken[y - 3 : y + h + 3, x - 3 : x + w + 3].any():
            k += 1
            labels[y : y + h, x : x + w] = taken[y : y + h, x : x + w] = k
    return labels


def balls(count: int = 300) -> np.ndarray:
    """Balls packed as closely as they can lie."""
    r, across = 12.0, 20
    labels = empty()
    rows, columns = np.mgrid[:SIZE, :SIZE]
    for k in range(count):
        row, column = divmod(k, across)
        x = 16 + r + (2 * column + row % 2) * r
        y = SIZE - 12.5 - r - row * np.sqrt(3) * r
        labels[np.hypot(columns - x, rows - y) <= r] = k + 1
    return labels


def empty() -> np.ndarray:
    return np.zeros((SIZE, SIZE), np.uint16)


def photo(labels: np.ndarray) -> np.ndarray:
    """Of what a label map shows, before a wall."""
    rgb = np.full((*labels.shape, 3), (120, 140, 160), np.uint8)
    rgb[7 * len(labels) // 8 :] = (150, 110, 70)
    for i in np.unique(labels[labels > 0]).tolist():
        rgb[labels == i] = np.random.default_rng(i).integers(40, 230, 3)
    return rgb


PILES = {"wall": wall, "heap": heap, "cells": cells, "specks": specks, "balls": balls}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "names", nargs="*", help=f"of {', '.join(PILES)}; all by default"
    )
    parser.add_argument("-n", "--count", type=int, default=300)
    parser.add_argument("-o", "--out", type=Path, help="folder to draw into, too")
    said = parser.parse_args()
    for name in said.names or PILES:
        labels = PILES[name](said.count)
        rgb = photo(labels)
        if said.out:
            said.out.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(said.out / f"{name}.png"), rgb[..., ::-1])
            cv2.imwrite(str(said.out / f"{name}-masks.png"), labels)
        start = time.process_time()
        things, _ = fit_objects(rgb, from_masks(labels))
        drawn = time.process_time()
        setting = support()(rgb, labels, things, View.SIDE)
        end = time.process_time()
        print(
            f"{name:8} {len(things):4} things: outlines {drawn - start:6.2f} s, boundary {end - drawn:6.2f} s,"
            f" {len(setting.walls):4} walls, {len(setting.held_ids):4} held",
            flush=True,
        )


if __name__ == "__main__":
    main()
