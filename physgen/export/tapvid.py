"""Write point tracks in the TAP-Vid format (Doersch et al., NeurIPS 2022), an npz
without a pickle.

`video` (T, H, W, 3) uint8; `points` (N, T, 2) float32, x and y from 0 at the left and
upper edge of the picture to 1 at the other edge, with the first pixel's centre at half
a pixel; `occluded` (N, T) bool, also true outside the picture; `query_points` (N, 3)
float32, frame, y and x of each point's first visible position, in px from the picture's
corner.
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
    """Numbers and places of points."""

    points: int = 256
    """Default number per clip, as in TAP-Vid's Kubric set; more if an object would get
    fewer than `min_points`.
    """
    min_points: int = 4
    """Minimum number for each object with visible pixels."""
    background: float = 0.25
    """Share of the points on the background."""
    margin: int = 2
    """Distance of a point from the border of its object in the frame of its choice, px;
    less on thinner objects.
    """
    far_side: float = 1e-9
    """Minimum depth of the far side behind the rim, in ball radii."""


LIMITS = PointLimits()


@dataclass(frozen=True)
class CameraPath:
    """Camera and poses of T views."""

    lenses: Array
    """(T, 2, 3): photo px -> video px."""
    poses: Array
    """(T, N, 3): x px, y px, angle rad, of bodies in the photo."""
    spaces: Array | None
    """(T, N, 3, 3): rotations in space; None: bodies turn only in the picture."""


@dataclass(frozen=True)
class Points:
    """K random points."""

    body: Index
    """(K,); -1 is the background."""
    frame: Index
    """(K,): the view of each point's choice."""
    places: Array
    """(K, 2) px of that view."""


class Tapvid(Writer):
    """Writes tracks of points. It stores only the poses and the compressed ids of each
    view.
    """

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
        """Write the frame, and store poses and ids."""
        view = moment.view
        self._video[view.index] = view.rgb
        # Points are chosen at the end: until then, only compressed ids fit the memory.
        self._ids.append(compress(view.ids.tobytes(), 1))
        count = len(self._clip.names) + 1
        areas = np.bincount(view.ids.ravel(), minlength=count)
        self._areas.append(areas.astype(np.float64))
        self._lenses.append(view.lens)
        self._poses.append(view.poses)
        if view.spaces is not None:
            self._spaces.append(view.spaces)

    def close(self) -> None:
        """Choose points, and write their tracks."""
        if self._spaces:
            spaces = np.stack(self._spaces)
        else:
            spaces = None
        camera = CameraPath(np.stack(self._lenses), np.stack(self._poses), spaces)
        points = self._choose_points()
        # A point is hidden on the far side of a ball, or if another object shows at its
        # pixel.
        places, far_side = track_points(points, camera, self._clip.world)
        # Every point is visible in the frame of its choice, so that a first visible
        # frame exists.
        occluded = far_side | ~self._find_visible(places, points)
        first = np.argmin(occluded, axis=1)
        first_places = places[np.arange(len(first)), first]
        # The format counts from the picture's corner, half a pixel before the first
        # centre.
        x, y = (first_places + 0.5).T
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

    def _read_ids(self, frame: int) -> U16:
        """Return the ids (H, W) of a frame."""
        width, height = self._clip.size
        ids = np.frombuffer(decompress(self._ids[frame]), np.uint16)
        return ids.reshape(height, width)

    def _choose_points(self) -> Points:
        """Return random points, in each frame in proportion to the visible area. The
        seed depends on the clip's name.
        """
        rng = np.random.default_rng(_seed(self._clip.name))
        # Each object gets its number of points by its visible area in all frames, and
        # each of its points begins in a frame by its area there.
        areas = np.stack(self._areas)
        counts = point_counts(areas.sum(axis=0), LIMITS.points)
        owners = np.repeat(np.arange(len(counts)), counts)
        frames = _choose_frames(areas, counts, rng)
        places = np.empty((len(owners), 2))
        # The ids of a frame are decompressed once for all its points.
        for frame in np.unique(frames):
            is_here = frames == frame
            groups = []
            for k in np.unique(owners[is_here]):
                numbers = np.flatnonzero(is_here & (owners == k))
                groups.append((int(k), numbers))
            requests = [(k, len(numbers)) for k, numbers in groups]
            choices = choose_places(self._read_ids(int(frame)), requests, rng)
            for (_, numbers), group_places in zip(groups, choices, strict=True):
                places[numbers] = group_places
        return Points(owners - 1, frames, places)

    def _find_visible(self, places: Array, points: Points) -> Mask:
        """Return whether the pixel at a point (K, T, 2) shows the point's object, (K,
        T).
        """
        width, height = self._clip.size
        columns = np.rint(places[..., 0]).astype(np.int64)
        rows = np.rint(places[..., 1]).astype(np.int64)
        has_column = (columns >= 0) & (columns < width)
        is_inside = has_column & (rows >= 0) & (rows < height)
        # Points outside the picture read pixel 0, and are masked afterwards.
        pixels = np.where(is_inside, rows * width + columns, 0)
        # Ids are stored compressed: unpack one frame at a time.
        ids = []
        for t in range(len(self._ids)):
            frame_ids = self._read_ids(t).ravel()
            ids.append(frame_ids[pixels[:, t]])
        is_own = np.stack(ids, axis=1) == points.body[:, None] + 1
        return np.asarray(is_inside & is_own)


def _seed(name: str) -> int:
    """Return the seed of a clip's name."""
    digest = sha256(name.encode()).digest()
    return int.from_bytes(digest[:8], "big")


def _choose_frames(areas: Array, counts: Index, rng: np.random.Generator) -> Index:
    """Return a frame for each point, (K,), from visible areas (T, N + 1) px and numbers
    of points (N + 1,).
    """
    totals = areas.sum(axis=0)
    choices = []
    for k, count in enumerate(counts):
        if count:
            # A frame with more visible pixels of an object gets more of its points.
            shares = areas[:, k] / totals[k]
            choices.append(rng.choice(len(areas), count, p=shares))
    return np.concatenate(choices)


def track_points(
    points: Points, camera: CameraPath, world: World
) -> tuple[Array, Mask]:
    """Return places (K, T, 2) px in each view, also of hidden points, and a mask (K, T)
    of points on a ball's far side.
    """
    # Complex numbers x + iy: rotations are products, and shifts are sums.
    scale = camera.lenses[:, 0, 0]
    shift_x = camera.lenses[:, 0, 2]
    shift_y = camera.lenses[:, 1, 2]
    shift = shift_x + 1j * shift_y
    choices = points.places[:, 0] + 1j * points.places[:, 1]
    # Places in the photo do not depend on the camera of their frame.
    photo_places = (choices - shift[points.frame]) / scale[points.frame]
    places = np.empty((len(photo_places), len(scale)), np.complex128)
    far_side = np.zeros(places.shape, bool)
    for index in np.unique(points.body).tolist():
        is_own = points.body == index
        frame = points.frame[is_own]
        place = photo_places[is_own]
        if index < 0:
            places[is_own] = place[:, None]
        else:
            tracks = _track_body(place, frame, index, camera, world)
            places[is_own], far_side[is_own] = tracks
    # Back from the photo to the video of each frame.
    video_places = scale * places + shift
    return np.stack([video_places.real, video_places.imag], axis=-1), far_side


def _track_body(
    place: Complex, frame: Index, index: int, camera: CameraPath, world: World
) -> tuple[Complex, Mask]:
    """Return places (K, T) photo px of points of a body, and a mask of points on a
    ball's far side.
    """
    poses = camera.poses[:, index]
    body = world.bodies[index]
    center = poses[:, 0] + 1j * poses[:, 1]
    offset = place - center[frame]
    if camera.spaces is not None and is_ball(body) and body.radius is not None:
        spaces = camera.spaces[:, index]
        rolled, far_side = _roll(offset / body.radius, frame, spaces)
        return center + body.radius * rolled, far_side
    # Each point keeps its offset in the body's own frame.
    turn = np.exp(1j * poses[:, 2])
    own_offset = offset / turn[frame]
    places = center + own_offset[:, None] * turn
    return places, np.zeros(places.shape, bool)


def _roll(place: Complex, frame: Index, spaces: Array) -> tuple[Complex, Mask]:
    """Return points of a ball in all views, (K, T), and a mask of points on the far
    side.

    Points are in radii from the ball's centre in their views. Mask points beyond the
    rim move with the rim, as in `correspondence.follow_ball`.
    """
    # The depth of a point on the front of the unit sphere gives its normal.
    rim = place / np.maximum(np.abs(place), 1)
    depth = np.sqrt(np.maximum(1 - np.abs(rim) ** 2, 0))
    normals = np.stack([rim.real, rim.imag, -depth], axis=-1)
    # Normals at t = 0.
    start_normals = np.einsum("kij,ki->kj", spaces[frame], normals)
    turned_normals = np.einsum("tij,kj->kti", spaces, start_normals)
    x, y, z = np.moveaxis(turned_normals, -1, 0)
    # Points beyond the rim keep their distance from the rim.
    return x + 1j * y + (place - rim)[:, None], z > LIMITS.far_side


def point_counts(areas: Array, points: int) -> Index:
    """Return the number of points of each body, (N + 1,), from areas (N + 1,) px, the
    background first.

    The background gets its share, each visible object `min_points`. The rest is divided
    by area.
    """
    objects = areas[1:]
    is_visible = objects > 0
    counts = np.zeros(len(areas), np.int64)
    if areas[0] > 0:
        share = 1.0
        if is_visible.any():
            share = LIMITS.background
        counts[0] = round(points * share)
    counts[1:][is_visible] = LIMITS.min_points
    # Every object gets its minimum first, and the remaining points go by area.
    rest = points - int(counts.sum())
    if rest > 0 and is_visible.any():
        exact = rest * objects / objects.sum()
        whole = np.floor(exact)
        counts[1:] += whole.astype(np.int64)
        # Largest remainders get the last points, so that the sum is exact.
        missing = rest - int(whole.sum())
        order = np.argsort(whole - exact, kind="stable")
        counts[1:][order[:missing]] += 1
    return counts


def choose_places(
    ids: U16, requests: Sequence[tuple[int, int]], rng: np.random.Generator
) -> list[Array]:
    """Return places (k, 2) px in a view for each id and number k, away from borders if
    possible.
    """
    side = 2 * LIMITS.margin + 1
    kernel = np.ones((side, side), np.uint8)
    # Both are equal only if the whole neighbourhood has one id.
    is_inner = cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)
    choices = []
    for number, count in requests:
        is_own = ids == number
        pixels = np.flatnonzero(is_own & is_inner)
        if not len(pixels):
            pixels = np.flatnonzero(is_own)
        # A uniform offset within the pixel, since points are not on a grid.
        chosen_pixels = rng.choice(pixels, count)
        rows, columns = np.divmod(chosen_pixels, ids.shape[1])
        centers = np.column_stack([columns, rows])
        choices.append(centers + rng.uniform(-0.5, 0.5, (count, 2)))
    return choices
