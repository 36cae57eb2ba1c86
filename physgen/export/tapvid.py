"""Write point tracks in the TAP-Vid format (Doersch et al., NeurIPS 2022), an npz without a pickle.

`video` (T, H, W, 3) uint8; `points` (N, T, 2) float32, x and y, 0 at the left and upper edge of the picture and 1 at
the other, so that the first pixel's centre is at half a pixel; `occluded` (N, T) bool, true also out of the picture;
`query_points` (N, 3) float32, frame, y and x in px from the picture's corner, at which each point is first visible.
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
    """Of a clip by default, as in TAP-Vid's Kubric set; more if an object would not get `min_points`."""
    min_points: int = 4
    """Of each object that is ever visible."""
    background: float = 0.25
    """Share of the points on the background."""
    margin: int = 2
    """px between a point and the border of its object in the frame of its choice; less on thinner objects."""
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
    """K random points."""

    body: Index
    """(K,); -1 is the background."""
    frame: Index
    """(K,): the view in which each was chosen."""
    places: Array
    """(K, 2) px of that view."""


class Tapvid(Writer):
    """Writes tracks of points; of each view it keeps only the poses and the compressed ids."""

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
        """Write the frame, and keep poses and ids."""
        view = moment.view
        self._video[view.index] = view.rgb
        self._ids.append(compress(view.ids.tobytes(), 1))
        areas = np.bincount(view.ids.ravel(), minlength=len(self._clip.names) + 1)
        self._areas.append(areas.astype(np.float64))
        self._lenses.append(view.lens)
        self._poses.append(view.poses)
        if view.spaces is not None:
            self._spaces.append(view.spaces)

    def close(self) -> None:
        """Choose points, and write their tracks."""
        spaces = np.stack(self._spaces) if self._spaces else None
        camera = CameraPath(np.stack(self._lenses), np.stack(self._poses), spaces)
        points = self._choose_points()
        places, far_side = track_points(points, camera, self._clip.world)
        occluded = far_side | ~self._find_visible(places, points)
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

    def _read_ids(self, frame: int) -> U16:
        """Return the ids (H, W) of a frame."""
        width, height = self._clip.size
        ids = np.frombuffer(decompress(self._ids[frame]), np.uint16)
        return ids.reshape(height, width)

    def _choose_points(self) -> Points:
        """Return random points, in each frame in proportion to the visible area; the seed is the clip's name."""
        digest = sha256(self._clip.name.encode()).digest()
        rng = np.random.default_rng(int.from_bytes(digest[:8], "big"))
        areas = np.stack(self._areas)
        totals = areas.sum(axis=0)
        counts = point_counts(totals, LIMITS.points)
        owners = np.repeat(np.arange(len(totals)), counts)
        frame_choices = []
        for k, count in enumerate(counts):
            if count:
                shares = areas[:, k] / totals[k]
                frame_choices.append(rng.choice(len(areas), count, p=shares))
        frames = np.concatenate(frame_choices)
        places = np.empty((len(owners), 2))
        for frame in np.unique(frames):
            is_here = frames == frame
            ids = self._read_ids(int(frame))
            groups = []
            for k in np.unique(owners[is_here]):
                groups.append((int(k), np.flatnonzero(is_here & (owners == k))))
            requests = [(k, len(numbers)) for k, numbers in groups]
            choices = choose_places(ids, requests, rng)
            for (_, numbers), group_places in zip(groups, choices, strict=True):
                places[numbers] = group_places
        return Points(owners - 1, frames, places)

    def _find_visible(self, places: Array, points: Points) -> Mask:
        """Return whether the pixel at a point (K, T, 2) shows the point's object, (K, T)."""
        width, height = self._clip.size
        columns, rows = (np.rint(places[..., k]).astype(np.int64) for k in (0, 1))
        has_column = (columns >= 0) & (columns < width)
        is_inside = has_column & (rows >= 0) & (rows < height)
        pixels = np.where(is_inside, rows * width + columns, 0)
        ids = []
        for t in range(len(self._ids)):
            ids.append(self._read_ids(t).ravel()[pixels[:, t]])
        is_own = np.stack(ids, axis=1) == points.body[:, None] + 1
        return np.asarray(is_inside & is_own)


def track_points(
    points: Points, camera: CameraPath, world: World
) -> tuple[Array, Mask]:
    """Return places (K, T, 2) px in each view, hidden ones too, and which (K, T) are on a ball's far side."""
    scale = camera.lenses[:, 0, 0]
    shift = camera.lenses[:, 0, 2] + 1j * camera.lenses[:, 1, 2]
    choices = points.places[:, 0] + 1j * points.places[:, 1]
    photo_places = (choices - shift[points.frame]) / scale[points.frame]
    places = np.empty((len(photo_places), len(scale)), np.complex128)
    far_side = np.zeros(places.shape, bool)
    for index in np.unique(points.body).tolist():
        is_own = points.body == index
        frame = points.frame[is_own]
        place = photo_places[is_own]
        if index < 0:
            places[is_own] = place[:, None]
            continue
        poses = camera.poses[:, index]
        body = world.bodies[index]
        center = poses[:, 0] + 1j * poses[:, 1]
        offset = place - center[frame]
        if camera.spaces is not None and is_ball(body) and body.radius is not None:
            spaces = camera.spaces[:, index]
            rolled, far_side[is_own] = _roll(offset / body.radius, frame, spaces)
            places[is_own] = center + body.radius * rolled
        else:
            turn = np.exp(1j * poses[:, 2])
            places[is_own] = center + (offset / turn[frame])[:, None] * turn
    video_places = scale * places + shift
    return np.stack([video_places.real, video_places.imag], axis=-1), far_side


def _roll(place: Complex, frame: Index, spaces: Array) -> tuple[Complex, Mask]:
    """Return points of a ball in all views, (K, T), and which are on the far side.

    Points are in radii from the ball's centre in their views. Points of the mask beyond the rim move with the rim, as
    in `correspondence.follow_ball`.
    """
    rim = place / np.maximum(np.abs(place), 1)
    depth = np.sqrt(np.maximum(1 - np.abs(rim) ** 2, 0))
    normals = np.stack([rim.real, rim.imag, -depth], axis=-1)
    start_normals = np.einsum("kij,ki->kj", spaces[frame], normals)  # at t = 0
    x, y, z = np.moveaxis(np.einsum("tij,kj->kti", spaces, start_normals), -1, 0)
    return x + 1j * y + (place - rim)[:, None], z > LIMITS.far_side


def point_counts(areas: Array, points: int) -> Index:
    """Return the number of points of each body, (N + 1,), by areas (N + 1,) px, the background's first.

    The background gets its share, each visible object `min_points`, and the rest goes by area.
    """
    objects = areas[1:]
    is_visible = objects > 0
    counts = np.zeros(len(areas), np.int64)
    if areas[0] > 0:
        share = LIMITS.background if is_visible.any() else 1
        counts[0] = round(points * share)
    counts[1:][is_visible] = LIMITS.min_points
    rest = points - int(counts.sum())
    if rest > 0 and is_visible.any():
        exact = rest * objects / objects.sum()
        whole = np.floor(exact)
        counts[1:] += whole.astype(np.int64)
        missing = rest - int(whole.sum())
        order = np.argsort(whole - exact, kind="stable")
        counts[1:][order[:missing]] += 1
    return counts


def choose_places(
    ids: U16, requests: Sequence[tuple[int, int]], rng: np.random.Generator
) -> list[Array]:
    """Return places (k, 2) px in a view for each id and number k; away from borders if there is room."""
    side = 2 * LIMITS.margin + 1
    kernel = np.ones((side, side), np.uint8)
    is_inner = cv2.erode(ids, kernel) == cv2.dilate(ids, kernel)
    choices = []
    for number, count in requests:
        is_own = ids == number
        pixels = np.flatnonzero(is_own & is_inner)
        if not len(pixels):
            pixels = np.flatnonzero(is_own)
        chosen_pixels = rng.choice(pixels, count)
        rows, columns = np.divmod(chosen_pixels, ids.shape[1])
        offsets = rng.uniform(-0.5, 0.5, (count, 2))
        choices.append(np.column_stack([columns, rows]) + offsets)
    return choices
