"""Pictures -> arrays on disk that training reads at random; several processes fill them, in the order of their seeds."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from picture import Picture

SIDE = 320
"""px of every stored picture."""
UNSAID = 255
"""Stored label of pixels that nobody judges."""
MOST = 127
"""Movable objects of a picture."""
IMMOVABLE = 128
"""First stored label of wholes that are learned but not moved: people, animals, furniture."""


@dataclass(frozen=True)
class Store:
    """Maps of N pictures of SIDE x SIDE pixels."""

    rgb: NDArray[np.uint8]
    """(N, SIDE, SIDE, 3) sRGB."""
    labels: NDArray[np.uint8]
    """(N, SIDE, SIDE) ids, UNSAID where nobody judges."""
    normals: NDArray[np.int8]
    """(N, SIDE, SIDE, 3) times 127; 0 where not known."""
    shadow: NDArray[np.uint8]
    """(N, SIDE, SIDE) share of light that cast shadows keep away, times 255."""
    done: NDArray[np.uint8]
    """(N,) 1: the picture is there."""

    @classmethod
    def at(cls, folder: Path, count: int | None = None) -> Store:
        """Open the store of a folder; with a `count` it is made where it isn't there."""
        folder.mkdir(parents=True, exist_ok=True)
        shapes = {
            "rgb": ((SIDE, SIDE, 3), np.uint8),
            "labels": ((SIDE, SIDE), np.uint8),
            "normals": ((SIDE, SIDE, 3), np.int8),
            "shadow": ((SIDE, SIDE), np.uint8),
            "done": ((), np.uint8),
        }
        found = {}
        for name, (shape, kind) in shapes.items():
            path = folder / f"{name}.npy"
            if path.exists():
                found[name] = np.lib.format.open_memmap(path, mode="r+")
                if count is not None and len(found[name]) != count:
                    raise SystemExit(
                        f"{folder}: holds {len(found[name])} pictures, not {count}; remove it first"
                    )
            elif count is None:
                raise FileNotFoundError(path)
            else:
                found[name] = np.lib.format.open_memmap(
                    path, "w+", kind, (count, *shape)
                )
        return cls(**found)

    def put(self, k: int, picture: Picture) -> None:
        """Keep a picture under number `k`, reduced or enlarged to SIDE x SIDE."""
        labels = np.minimum(picture.labels, MOST).astype(np.uint8)
        labels[picture.unsaid] = UNSAID
        normals = np.where(picture.known[..., None], picture.normals, 0)
        self.put_maps(k, picture.rgb, labels, normals, picture.shadow)

    def put_maps(
        self,
        k: int,
        rgb: NDArray[np.uint8],
        labels: NDArray[np.uint8],
        normals: NDArray[np.float32] | None = None,
        shadow: NDArray[np.float32] | None = None,
    ) -> None:
        """The same, from maps; normals and shadows are 0 where a photo does not know them."""
        size = (SIDE, SIDE)
        self.rgb[k] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        self.labels[k] = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST_EXACT)
        for store, values, most in (
            (self.normals, normals, 127),
            (self.shadow, shadow, 255),
        ):
            if values is not None:
                soft = cv2.resize(
                    values.astype(np.float32), size, interpolation=cv2.INTER_AREA
                )
                store[k] = np.round(soft * most).astype(store.dtype)
        self.done[k] = 1


def fill(
    folder: Path, count: int, first: int, jobs: int, make: Callable[[int], Picture]
) -> Iterator[int]:
    """Pictures `make(first)`, `make(first + 1)` ... into the folder's store; yields how many are there, as they come."""
    store = Store.at(folder, count)
    missing = [k for k in range(count) if not store.done[k]]
    there = count - len(missing)
    yield there
    with multiprocessing.Pool(jobs, _start, (folder, first, make)) as pool:
        for _ in pool.imap_unordered(_put, missing, chunksize=8):
            there += 1
            yield there


def _start(folder: Path, first: int, make: Callable[[int], Picture]) -> None:
    global _work
    cv2.setNumThreads(1)
    _work = Store.at(folder), first, make


def _put(k: int) -> None:
    store, first, make = _work
    store.put(k, make(first + k))


_work: tuple[Store, int, Callable[[int], Picture]]
