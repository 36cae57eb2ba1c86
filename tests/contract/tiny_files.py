"""Maps of the contract's photo, as another program would leave them: what the rows `file` read."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 160, 120


def _numbers(path: Path, values: np.ndarray) -> Path:
    np.save(path.with_suffix(".npy"), values)
    return path.with_suffix(".npy")


def depth(path: Path) -> Path:
    return _numbers(path, np.mgrid[:HEIGHT, :WIDTH][0][::-1] / 50.0)


def normals(path: Path) -> Path:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    u, v = (x - 45) / 20, (y - 75) / 20
    ball = np.stack([u, v, np.sqrt(np.clip(1 - u * u - v * v, 0, 1))], -1)
    return _numbers(path, np.where((np.hypot(u, v) <= 1)[..., None], ball, [0, 0, 1]))


def intrinsic(path: Path) -> Path:
    return _numbers(path, np.linspace(1, 3, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH))


def inpaint(path: Path) -> Path:
    file = path.with_suffix(".png")
    cv2.imwrite(str(file), np.full((HEIGHT, WIDTH, 3), 120, np.uint8))
    return file


MODELS = {
    (build.__name__, "file"): build for build in (depth, normals, intrinsic, inpaint)
}  # fmt: skip
