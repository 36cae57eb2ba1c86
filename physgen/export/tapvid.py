"""Point tracks in the TAP-Vid format (Doersch et al., NeurIPS 2022), an npz without a pickle.

`video` (T, H, W, 3) uint8; `points` (N, T, 2) float32, x and y, 0 at the left and upper edge of the picture and 1 at
the other, so that the first pixel's centre is at half a pixel; `occluded` (N, T) bool, true also out of the picture;
`query_points` (N, 3) float32, frame, y and x in px from the picture's corner: where each point is first visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any
from zlib import compress, decompress

import cv2
import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.correspondence import is_ball
from physgen.export.labels import Clip, Mask, Moment, Writer
from physgen.geometry.polygon import Array
from physgen.maps import U16

Complex = NDArray[np.complex128]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class PointLimits:
    """How points are drawn."""

    points: int = 256
    """Of a clip by default, as in TAP-Vid's Kubric set; more where each object would not get `least`."""
    least: int = 4
    """Of each object that is ever visible."""
    background: float = 0.25
    """Share of the points on the background."""
    margin: int = 2
    """px between a point and the border of its object where it is drawn; less on objects that are thinner."""
    far_side: float = 1e-9
    """Ball radii behind the rim from which on a point is on the far side."""


LIMITS = PointLimits()


@dataclass(frozen=True)
class CameraPath:
    """T views."""

    lenses: Array
    """(T, 2, 3): photo px -> video px."""
    poses: Array
    """(T, N, 3): x px, y px, angle rad, of bodies in the photo."""
    spaces: Array | None
    """(T, N, 3, 3): rotations in space; None: bodies turn in the picture alone."""


@dataclass(frozen=True)
class Points:
    """K points as they were drawn."""

    body: Index
    """(K,); -1 is the background."""
    frame: Index
    """(K,): the view in which they were drawn."""
    at: Array
    """(K, 2) px of that view."""


class Tapvid(Writer):
    """Tracks of points; of each view only the poses and the compressed ids are kept."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip
        self._lenses: list[Array] = []
        self._poses: list[Array] = []
        self._spaces: list[Array] = []
        self._ids: list[bytes] = []
        self._areas: list[Array] = []
        width, height = clip.size
        self._frames = folder / "video.npy"
        self._video = open_memmap(
            self._frames, "w+", np.uint8, (clip.count, height, width, 3)
        )

    def add(self, moment: Moment) -> None:
        """Write the frame; keep poses and ids."""
        view = moment.view
        self._video[view.index] = view.rgb
        self._ids.append(compress(view.ids.tobytes(), 1))
        self._areas.append(
            np.bincount(view.ids.ravel(), minlength=len(self._clip.names) + 1).astype(
                np.float64
            )
        )
        self._lenses.append(view.lens)
        self._poses.append(view.poses)
        if view.spaces is not None:
            self._spaces.append(view.spaces)

    def close(self) -> None:
        """Draw points, and write their tracks."""
        spaces = np.stack(self._spaces) if self._spaces else None
        camera = CameraPath(np.stack(self._lenses), np.stack(self._poses), spaces)
        points = self._drawn()
        places, far_side = tracked(points, camera, self._clip.world)
        occluded = far_side | ~self._visible(places, points)
        first = np.argmin(occluded, axis=1)
        x, y = (places[np.arange(len(first)), first] + 0.5).T
        arrays: dict[str, NDArray[Any]] = {
            "points": ((places + 0.5) / self._clip.size).astype(np.float32),
            "occluded": occluded,
            "query_points": np.column_stack([first, y, x]).astype(np.float32),
            "object": (points.body + 1).astype(np.int32),
            "names": np.array(["background", *self._clip.names]),
            "fps": np.array(self._clip.fps),
        }
        np.savez(
            self._folder / "tapvid.npz", video=self._video, allow_pickle=False, **arrays
        )
        del self._video
        self._frames.unlink()

    def _map(self, frame: int) -> U16:
        """(H, W) ids of a frame."""
        width, height = self._clip.size
        return np.frombuffer(decompress(self._ids[frame]), np.uint16).reshape(
            height, width
        )

    def _drawn(self) -> Points:
        """Random points, in each frame in proportion to the visible area; the seed is the clip's name."""
        rng = np.random.default_rng(
            int.from_bytes(sha256(self._clip.name.encode()).digest()[:8], "big")
        )
        areas = np.stack(self._areas)
        totals = areas.sum(axis=0)
        numbers = point_counts(totals, LIMITS.points)
        owners = np.repeat(np.arange(len(totals)), numbers)
        frames = np.concatenate(
            [
                rng.choice(len(areas), n, p=areas[:, k] / totals[k])
                for k, n in enumerate(numbers)
                if n
            ]
        )
        at = np.empty((len(owners), 2))
        for frame in np.unique(frames):
            here = [
                (int(k), np.flatnonzero((frames == frame) & (owners == k)))
                for k in np.unique(owners[frames == frame])
            ]
            found = draw_points(
                self._map(int(frame)), [(k, len(which)) for k, which in here], rng
            )
            for (_, which), places in zip(here, found, strict=True):
                at[which] = places
        return Points(owners - 1, frames, at)

    def _visible(self, places: Array, points: Points) -> Mask:
        """(K, T): the pixel at a point (K, T, 2) shows the point's object."""
        width, height = self._clip.size
        column, row = (np.rint(places[..., k]).astype(np.int64) for k in (0, 1))
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        place = np.where(inside, row * width + column, 0)
        seen = np.stack(
            [self._map(t).ravel()[place[:, t]] for t in range(len(self._ids))], axis=1
        )
        return np.asarray(inside & (seen == points.body[:, None] + 1))


def tracked(points: Points, camera: CameraPath, world: World) -> tuple[Array, Mask]:
    """(K, T, 2) px in each view, also where they are hidden or outside; and (K, T) points on a ball's far side."""
    scale = camera.lenses[:, 0, 0]
    shift = camera.lenses[:, 0, 2] + 1j * camera.lenses[:, 1, 2]
    photo = (points.at[:, 0] + 1j * points.at[:, 1] - shift[points.frame]) / scale[
        points.frame
    ]
    there = np.empty((len(photo), len(scale)), np.complex128)
    far_side = np.zeros(there.shape, bool)
    for index in np.unique(points.body).tolist():
        own = points.body == index
        frame, place = points.frame[own], photo[own]
        if index < 0:
            there[own] = place[:, None]
            continue
        poses, body = camera.poses[:, index], world.bodies[index]
        center = poses[:, 0] + 1j * poses[:, 1]
        if camera.spaces is not None and is_ball(body) and body.radius is not None:
            moved, far_side[own] = _rolled(
                (place - center[frame]) / body.radius, frame, camera.spaces[:, index]
            )
            there[own] = center + body.radius * moved
        else:
            turn = np.exp(1j * poses[:, 2])
            there[own] = (
                center + ((place - center[frame]) / turn[frame])[:, None] * turn
            )
    seen = scale * there + shift
    return np.stack([seen.real, seen.imag], axis=-1), far_side


def _rolled(place: Complex, frame: Index, spaces: Array) -> tuple[Complex, Mask]:
    """Points of a ball, radii from its centre in their views -> (K, T) in all views; which are on the far side.

    Points of the mask beyond the rim move with the rim, as in `correspondence.BallTurn`.
    """
    rim = place / np.maximum(np.abs(place), 1)
    towards = np.sqrt(np.maximum(1 - np.abs(rim) ** 2, 0))
    normals = np.stack([rim.real, rim.imag, -towards], axis=-1)
    first = np.einsum("kij,ki->kj", spaces[frame], normals)  # at t = 0
    turned = np.einsum("tij,kj->kti", spaces, first)
    return turned[..., 0] + 1j * turned[..., 1] + (place - rim)[:, None], turned[
        ..., 2
    ] > LIMITS.far_side


def point_counts(areas: Array, most: int) -> Index:
    """(N + 1,) points of each body, of `most`, by areas (N + 1,) px, the background's first.

    The background gets its share, each visible object LEAST, and the rest goes by area.
    """
    objects = areas[1:]
    seen = objects > 0
    counts = np.zeros(len(areas), np.int64)
    counts[0] = (
        0 if areas[0] == 0 else round(most * LIMITS.background) if seen.any() else most
    )
    counts[1:][seen] = LIMITS.least
    rest = most - int(counts.sum())
    if rest > 0 and seen.any():
        exact = rest * objects / objects.sum()
        counts[1:] += np.floor(exact).astype(np.int64)
        short = rest - int(np.floor(exact).sum())
        counts[1:][np.argsort(np.floor(exact) - exact, kind="stable")[:short]] += 1
    return counts


def draw_points(
    ids: U16, wanted: Sequence[tuple[int, int]], rng: np.random.Generator
) -> list[Array]:
    """(k, 2) px in a view, for each id and number k of `wanted`; away from borders where there is room."""
    kernel = np.ones((2 * LIMITS.margin + 1, 2 * LIMITS.margin + 1), np.uint8)
    inner = cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)
    found = []
    for id_, count in wanted:
        own = ids == id_
        where = np.flatnonzero(own & inner)
        where = where if len(where) else np.flatnonzero(own)
        picked = rng.choice(where, count)
        pixels = np.column_stack([picked % ids.shape[1], picked // ids.shape[1]])
        found.append(pixels + rng.uniform(-0.5, 0.5, (count, 2)))
    return found
