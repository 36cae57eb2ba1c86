"""Views -> tapvid.npz: point tracks as TAP-Vid has them (Doersch et al., NeurIPS 2022), without a pickle.

`video` (T, H, W, 3) uint8; `points` (N, T, 2) float32, x and y, 0 at the left and upper edge of the picture and 1 at
the other, so that the first pixel's centre is at half a pixel; `occluded` (N, T) bool, true also out of the picture;
`query_points` (N, 3) float32, frame, y and x in px from the picture's corner: where each point is first seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from physgen.export.idmap import Runs
from physgen.export.motion import Moment
from physgen.export.tracks import Filmed, Points, drawn, shares, tracked
from physgen.export.truth import Clip

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

POINTS = 256
"""Of a clip unless told, as of one of TAP-Vid's Kubric; more where things are so many that each would not get LEAST."""
LEAST = 4
"""Of each thing that is ever seen."""
GROUND = 0.25
"""Share of the background."""


class Tapvid:
    """The video goes into the file as it comes; of each view no more is kept than poses, and ids as runs."""

    def __init__(self, folder: Path, clip: Clip, points: int = POINTS) -> None:
        self._clip, self._most = clip, points
        self._lenses: list[Array] = []
        self._poses: list[Array] = []
        self._spaces: list[Array] = []
        self._ids: list[Runs] = []
        width, height = clip.size
        self._zip = _Archive(folder / "tapvid.npz", "w")
        self._video = _begun(self._zip, "video", np.dtype(np.uint8), (clip.count, height, width, 3))

    def add(self, moment: Moment) -> None:
        """A view's picture, and what tells where points are in it."""
        view = moment.view
        self._video.write(np.ascontiguousarray(view.rgb).data)
        self._ids.append(Runs.of(view.ids))
        self._lenses.append(view.lens)
        self._poses.append(view.poses)
        if view.spaces is not None:
            self._spaces.append(view.spaces)

    def close(self) -> None:
        """Points are drawn, and their tracks written."""
        self._video.close()
        spaces = np.stack(self._spaces) if self._spaces else None
        filmed = Filmed(np.stack(self._lenses), np.stack(self._poses), spaces)
        points = _points(self._ids, len(self._clip.names), self._most, _drawing(self._clip.name))
        places, under = tracked(points, filmed, self._clip.world)
        occluded = under | ~_shown(places, points, self._ids)
        for name, array in self._arrays(points, places, occluded).items():
            with _begun(self._zip, name, array.dtype, array.shape) as file:
                file.write(np.ascontiguousarray(array).tobytes())
        self._zip.close()

    def _arrays(self, points: Points, places: Array, occluded: Mask) -> Mapping[str, NDArray[Any]]:
        """What is in the file beside the video."""
        first = np.argmin(occluded, axis=1)
        x, y = (places[np.arange(len(first)), first] + 0.5).T
        return {
            "points": ((places + 0.5) / self._clip.size).astype(np.float32),
            "occluded": occluded,
            "query_points": np.column_stack([first, y, x]).astype(np.float32),
            "object": (points.body + 1).astype(np.int32),
            "names": np.array(["background", *self._clip.names]),
            "fps": np.array(self._clip.fps),
        }


class _Archive(ZipFile):
    """One that may be left half-way, as where a clip fails: its folder goes, and nobody is told of the file."""

    def __del__(self) -> None:
        """Whoever is done has closed it."""


def _begun(archive: ZipFile, name: str, kind: np.dtype[Any], shape: tuple[int, ...]) -> IO[bytes]:
    """An array of an npz, to be written piece by piece; without the time of day, so that bytes stay the same."""
    entry = ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
    entry.file_size = (
        int(np.prod(shape, dtype=np.int64)) * kind.itemsize + 1024
    )  # at most: 4 GB ask for zip64
    file = archive.open(entry, "w")
    npy.write_array_header_1_0(file, {"descr": kind.str, "fortran_order": False, "shape": shape})
    return file


def _drawing(name: str) -> np.random.Generator:
    """Of a clip's name: the same every time, and in clips of one photo not the same places again."""
    return np.random.default_rng(int.from_bytes(sha256(name.encode()).digest()[:8], "big"))


def _points(ids: list[Runs], count: int, most: int, rng: np.random.Generator) -> Points:
    """Points drawn in views at random: of each owner, as likely in each as it is seen there."""
    areas = np.stack([runs.areas(count + 1) for runs in ids])
    totals = areas.sum(axis=0)
    numbers = shares(totals, most, LEAST, GROUND)
    owners = np.repeat(np.arange(count + 1), numbers)
    frames = np.concatenate(
        [rng.choice(len(ids), n, p=areas[:, k] / totals[k]) for k, n in enumerate(numbers) if n]
    )
    at = np.empty((len(owners), 2))
    for frame in np.unique(frames):
        here = [
            (k, np.flatnonzero((frames == frame) & (owners == k))) for k in np.unique(owners[frames == frame])
        ]
        picked = drawn(ids[frame].map(), [(int(k), len(which)) for k, which in here], rng)
        for (_, which), places in zip(here, picked, strict=True):
            at[which] = places
    return Points(owners - 1, frames, at)


def _shown(places: Array, points: Points, ids: list[Runs]) -> Mask:
    """(K, T): the pixel that a point (K, T, 2) is in shows the thing that it is on."""
    height, width = ids[0].shape
    column, row = (np.rint(places[..., k]).astype(np.int64) for k in (0, 1))
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place = np.where(inside, row * width + column, 0)
    seen = np.stack([runs.map().ravel()[place[:, frame]] for frame, runs in enumerate(ids)], axis=1)
    return np.asarray(inside & (seen == points.body[:, None] + 1))
