"""Camera, playing order, resampling and motion blur of a clip.

Between two views the camera eases: after a part s of the time it has come 3 s² - 2 s³ of the way. The width of the view
changes by equal factors and its centre moves with the width, so one point of a zoom stays still, and a view between two
that lie in the photo lies in it too. Pictures are resampled by Lanczos with three lobes in linear light (Pillow's exact
weights; OpenCV's warps know no finer step than 1/32 px, and a slow pan would tremble), each value held between the
least and the greatest of the pixels under the middle lobe, against dark lines along bright edges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil, exp, expm1, floor, log, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.compile.world import World
from physgen.geometry.polygon import Array
from physgen.maps import F32, U8
from physgen.photometry import decode, encode_u8
from physgen.render.stage import Cover, Frame, Layers, Slices, SpriteLayer
from physgen.scene.scene import (
    CameraView,
    Play,
    Point,
    Scene,
    affine,
    held,
    magnification,
    room,
)
from physgen.simulate.trajectory import Trajectory

Index = NDArray[np.int64]
Size = tuple[int, int]
"""Width and height, px."""

LOBES = 3
"""Of the kernel, on each side."""
NOTHING = 1e-6
"""px that no picture shows."""


def resample_picture(rgb: U8, matrix: Array, size: Size) -> U8:
    """(h, w, 3) sRGB of `size` (w, h). `matrix` (2, 3) scales and shifts: px of `rgb` -> px of the result.

    What is seen lies in `rgb`. A shift by whole pixels alone returns them as they are.
    """
    scale = float(matrix[0, 0])
    x0, y0, x1, y1 = _seen(rgb, matrix, size)
    left, top = round(x0), round(y0)
    if scale == 1.0 and max(abs(x0 - left), abs(y0 - top)) < NOTHING:
        return np.ascontiguousarray(rgb[top : top + size[1], left : left + size[0]])
    reach = (
        ceil(LOBES * max(1.0, 1.0 / scale)) + 1
    )  # no kernel looks farther than this beyond what is seen
    left, top = max(floor(x0) - reach, 0), max(floor(y0) - reach, 0)
    rgb = rgb[top : ceil(y1) + reach, left : ceil(x1) + reach]
    matrix = np.column_stack([matrix[:, :2], matrix @ [left, top, 1.0]])
    x0, y0, x1, y1 = _seen(rgb, matrix, size)
    light = decode(np.arange(256, dtype=np.uint8))
    wide, rows, columns = _lobes(rgb, matrix, size)
    planes = []
    for codes in cv2.split(rgb):
        plane = Image.fromarray(cv2.LUT(codes, light))
        fine = np.asarray(
            plane.resize(size, Image.Resampling.LANCZOS, box=(x0, y0, x1, y1))
        )
        low, high = (
            morph(codes, wide, anchor=(0, 0)).take(columns, 1).take(rows, 0)
            for morph in (cv2.erode, cv2.dilate)
        )
        planes.append(
            cv2.min(cv2.max(encode_u8(fine), low), high)
        )  # sRGB keeps the order of light
    return np.asarray(cv2.merge(planes), np.uint8)


def nearest(ids: NDArray[np.uint16], matrix: Array, size: Size) -> NDArray[np.uint16]:
    """(h, w) of `size` (w, h): the nearest value to each pixel."""
    rows, columns = sources(matrix, (ids.shape[1], ids.shape[0]), size)
    return np.asarray(ids.take(columns, 1).take(rows, 0))


def nearest_in(
    box: Slices, mask: NDArray[np.bool_], rows: Index, columns: Index
) -> tuple[Slices, NDArray[np.bool_]]:
    """`nearest` of a picture that is True in a `box` alone, by its `sources`: the box and mask of the result."""
    parts, picked = [], []
    for at, own in ((rows, box[0]), (columns, box[1])):
        first, last = np.searchsorted(at, (own.start, own.stop)).tolist()
        parts.append(slice(first, last))
        picked.append(at[first:last] - own.start)
    return (parts[0], parts[1]), np.asarray(mask.take(picked[1], 1).take(picked[0], 0))


def sources(matrix: Array, shown: Size, size: Size) -> tuple[Index, Index]:
    """(h,) rows and (w,) columns of a picture of the size `shown` that are nearest to those of the result."""
    at = (
        np.floor(_sources(matrix, axis, size[axis]) + 0.5).astype(np.int64)
        for axis in (1, 0)
    )
    rows, columns = (
        np.clip(part, 0, side - 1) for part, side in zip(at, shown[::-1], strict=True)
    )
    return rows, columns


def _seen(
    rgb: U8 | F32, matrix: Array, size: Size
) -> tuple[float, float, float, float]:
    """The borders x0, y0, x1, y1 of what is seen, as Pillow counts px: from the corner of the first pixel."""
    scale = float(matrix[0, 0])
    edges = []
    for axis, side in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        low = (-0.5 - float(matrix[axis, 2])) / scale + 0.5
        edges.append((max(low, 0.0), min(low + size[axis] / scale, float(side))))
    (x0, x1), (y0, y1) = edges
    return x0, y0, x1, y1


def _sources(matrix: Array, axis: int, count: int) -> Array:
    """Where the result's columns (axis 0) or rows (axis 1) come from, px."""
    return np.asarray((np.arange(count) - matrix[axis, 2]) / matrix[0, 0])


def _lobes(rgb: U8, matrix: Array, size: Size) -> tuple[U8, Index, Index]:
    """The pixels of `rgb` within the kernel's middle lobe: a square of ones, and its first row and column by pixel."""
    reach = max(1.0, 1.0 / float(matrix[0, 0]))
    wide = ceil(2 * reach - NOTHING)
    first = []
    for axis, side in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        beyond = np.floor(_sources(matrix, axis, size[axis]) - reach + NOTHING)
        first.append(np.clip(beyond.astype(np.int64) + 1, 0, side - 1))
    return np.ones((wide, wide), np.uint8), first[1], first[0]


STEADY = 0.2
"""s of the clip: the standard deviation of the weights with which a followed object's way is smoothed."""
ASTRAY = 0.6
"""Of the way from the picture's middle to its border, within which a followed object stays however it is flung."""
WHOLE_PHOTO = CameraView(0.0, None, None, 1.0)
"""What is seen without a camera."""
MOST_DRAWN = 16_000_000
"""px of the canvas of a flat scene that is drawn as large as it is seen."""


@dataclass(frozen=True)
class Aim:
    """A view that the camera reaches at a time."""

    time: float
    """s."""
    zoom: float
    way: Array
    """(T, 2) px: its centre at the samples' times; (1, 2) where it stays."""


@dataclass(frozen=True)
class Shot:
    """How a clip is filmed and played."""

    photo: Size
    video: Size
    """px of the frames."""
    times: Array
    """(T,) s of the samples."""
    aims: tuple[Aim, ...]
    """In the order of their times; at least one."""
    order: tuple[int, ...]
    """The sample of every frame."""

    def affine(self, time: float) -> Array:
        """(2, 3): photo px -> video px of a frame at `time` (s of the motion, `Frame.time`); pixel centres are whole.

        Anything drawn on the finished frame goes through it: `x, y = shot.affine(frame.time) @ (px, py, 1)`.
        """
        center, zoom = self._view(time)
        large, (x, y) = affine(self.photo, self.video, center, zoom)
        return np.array([[large, 0.0, x], [0.0, large, y]])

    @cached_property
    def moves(self) -> bool:
        """Whether the camera does."""
        first = self.aims[0]
        return any(
            aim.zoom != first.zoom or (aim.way != first.way[:1]).any()
            for aim in self.aims
        )

    @property
    def opens_on_photo(self) -> bool:
        """Whether the first frame shows all of the photo, as it is at t = 0."""
        whole = self.video == self.photo and np.array_equal(
            self.affine(0.0), np.eye(2, 3)
        )
        return whole and self.order[0] == 0

    def samples(self, parts: int) -> list[int]:
        """`order` for a trajectory that has `parts` samples where `times` has one: an exposure's stay in theirs."""
        return [sample * parts + part for sample in self.order for part in range(parts)]

    def _view(self, time: float) -> tuple[Point, float]:
        """Centre, px, and zoom at a time."""
        after = sum(aim.time <= time for aim in self.aims)
        one, other = (
            self.aims[max(after - 1, 0)],
            self.aims[min(after, len(self.aims) - 1)],
        )
        if one is other or time <= one.time:
            return self._center(one, time), one.zoom
        s = (time - one.time) / (other.time - one.time)
        eased = s * s * (3 - 2 * s)
        narrower = log(one.zoom / other.zoom)
        zoom = one.zoom * exp(-narrower * eased)
        part = (
            expm1(narrower * eased) / expm1(narrower) if abs(narrower) > 1e-9 else eased
        )
        (ax, ay), (bx, by) = self._center(one, time), self._center(other, time)
        center = ax + (bx - ax) * part, ay + (by - ay) * part
        return held(
            center, self.photo, self.video, zoom
        ), zoom  # for the last bit alone

    def _center(self, aim: Aim, time: float) -> Point:
        if len(aim.way) == 1:
            return float(aim.way[0, 0]), float(aim.way[0, 1])
        return float(np.interp(time, self.times, aim.way[:, 0])), float(
            np.interp(time, self.times, aim.way[:, 1])
        )


def shot_of(scene: Scene, trajectory: Trajectory) -> Shot:
    """The scene's `render` for a trajectory that has one sample a frame played forward."""
    photo, video = scene.size, scene.video_size
    sights = scene.render.camera or (WHOLE_PHOTO,)
    aims = tuple(
        Aim(
            sight.time,
            sight.zoom,
            _way(sight, photo, video, trajectory, scene.render.fps),
        )
        for sight in sights
    )
    return Shot(
        photo,
        video,
        trajectory.times,
        aims,
        play_order(scene.render.play, len(trajectory.times)),
    )


def play_order(play: Play, count: int) -> tuple[int, ...]:
    """Samples in the order in which a clip shows them.

    >>> play_order(Play.THERE_AND_BACK, 3)
    (0, 1, 2, 1, 0)
    """
    there = tuple(range(count))
    if play is Play.BACKWARD:
        return there[::-1]
    return there + there[-2::-1] if play is Play.THERE_AND_BACK else there


def filmed(
    frames: Iterator[Frame], through: Shot, drawn: float = 1.0
) -> Iterator[Frame]:
    """Frames as the camera sees them; `drawn` canvas pixels a photo pixel.

    Where it sees all of them at their own size, they are the very same. What did not change is not filmed again.
    """
    last: tuple[Frame, Array, Frame] | None = None
    for frame in frames:
        matrix = on_canvas(through.affine(frame.time), drawn)
        height, width = frame.rgb.shape[:2]
        if (width, height) == through.video and np.array_equal(matrix, np.eye(2, 3)):
            yield frame
            continue
        if (
            last is not None
            and np.array_equal(matrix, last[1])
            and np.array_equal(frame.rgb, last[0].rgb)
        ):
            rgb = last[2].rgb
        else:
            rgb = resample_picture(frame.rgb, matrix, through.video)
        through_it = frame, matrix, through.video
        named, covering = partial(_named, *through_it), partial(_covering, *through_it)
        layering = None
        if frame.layering is not None:
            layering = partial(_layers_seen, frame.layering, matrix, through.video)
        seen = Frame(
            frame.index, frame.time, rgb, named, covering, frame.faces, layering
        )
        last = frame, matrix, seen
        yield seen


def _named(frame: Frame, matrix: Array, size: Size) -> NDArray[np.uint16]:
    """(h, w) of `size` (w, h): the ids of the frame as they are seen."""
    return nearest(frame.ids, matrix, size)


def _covering(frame: Frame, matrix: Array, size: Size) -> list[Cover]:
    """Covers of the frame as they are seen, of the very pixels that `_named` takes."""
    height, width = frame.rgb.shape[:2]
    rows, columns = sources(matrix, (width, height), size)
    return [
        Cover(cover.body, *nearest_in(cover.box, cover.mask, rows, columns))
        for cover in frame.covers
    ]


def resample_light(light: F32, matrix: Array, size: Size) -> F32:
    """(h, w, C) of `size` (w, h), 0..1, of linear light as `resample_picture` sees it."""
    box = _seen(light, matrix, size)
    planes = []
    for plane in cv2.split(light):
        picture = Image.fromarray(plane).resize(size, Image.Resampling.LANCZOS, box=box)
        planes.append(np.clip(np.asarray(picture), 0, 1))
    return np.asarray(cv2.merge(planes), np.float32)


def _layers_seen(layering: Callable[[], Layers], matrix: Array, size: Size) -> Layers:
    """The layers of a frame as they are seen."""
    layers = layering()
    whole = np.s_[0 : size[1], 0 : size[0]]
    sprites = []
    for sprite in layers.sprites:
        canvas = np.zeros((*layers.plate.shape[:2], 4), np.float32)
        canvas[sprite.box] = np.dstack([sprite.light, sprite.coverage])
        seen = resample_light(canvas, matrix, size)
        sprites.append(SpriteLayer(sprite.body, whole, seen[..., :3], seen[..., 3]))
    plate = resample_light(layers.plate, matrix, size)
    shaded = resample_light(layers.shaded, matrix, size)
    return Layers(plate, shaded, sprites, layers.order)


def canvas_scale(scene: Scene) -> float:
    """Canvas pixels a photo pixel that a scene without a photo is drawn with, to be sharp wherever the camera goes."""
    zoom = max(sight.zoom for sight in scene.render.camera or (WHOLE_PHOTO,))
    large = max(1.0, magnification(scene.size, scene.video_size, zoom))
    return max(1.0, min(large, sqrt(MOST_DRAWN / (scene.size[0] * scene.size[1]))))


def on_canvas(matrix: Array, drawn: float) -> Array:
    """The matrix from photo px as one from the px of a canvas whose pixels are `drawn` times finer."""
    if drawn == 1.0:
        return matrix
    large = matrix[:, :2] / drawn
    return np.column_stack(
        [large, matrix[:, 2] + large @ [0.5, 0.5] - matrix[:, :2] @ [0.5, 0.5]]
    )


def _way(
    sight: CameraView, photo: Size, video: Size, trajectory: Trajectory, fps: float
) -> Array:
    """The centre of a view, (T, 2) px or (1, 2), where the view lies in the photo."""
    if sight.follow is None:
        middle = (photo[0] - 1) / 2, (photo[1] - 1) / 2
        return np.array([held(sight.center or middle, photo, video, sight.zoom)])
    low, high = room(photo, video, sight.zoom)
    at = np.clip(
        trajectory.poses[:, trajectory.names.index(sight.follow), :2], low, high
    )
    most = ASTRAY * np.array(video) / (2 * magnification(photo, video, sight.zoom))
    behind = _steadied(at, STEADY * fps) - at
    # hardly changed up to half of the most, and never beyond it
    return np.clip(at + behind / (1 + (behind / most) ** 4) ** 0.25, low, high)


def _steadied(way: Array, width: float) -> Array:
    """(T, 2) smoothed by a Gaussian of `width` samples; beyond its ends goes the way itself, turned about them."""
    reach = ceil(3 * width)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    beyond = np.pad(way, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns: Sequence[Array] = [
        np.convolve(c, weights / weights.sum(), mode="valid") for c in beyond.T
    ]
    return np.stack(columns, axis=1)


FEWEST, MOST = 4, 24
"""Moments of an exposure; the fewest divide all numbers of them, and are the views of a moving camera."""
STEP = 2.0
"""px that anything moves between two of them, unless there are the most already."""


def exposure_times(
    trajectory: Trajectory, world: World, part: float
) -> tuple[Array, int]:
    """Moments (T x parts,) s of frames at the trajectory's times, and how many a frame has.

    The shutter is open for a `part` of the time between frames and closes at the frame's own: at t = 0 nothing has
    moved, and the first frame is the photo.
    """
    times = trajectory.times
    if part <= 0 or len(times) < 2 or not world.bodies:
        return times, 1
    open_ = part * float(times[1] - times[0])
    reach = np.array(
        [np.hypot(*np.concatenate(body.rings).T).max() for body in world.bodies]
    )
    vx, vy, spin = np.moveaxis(trajectory.velocities, -1, 0)
    farthest = float((np.hypot(vx, vy) + np.abs(spin) * reach).max()) * open_
    parts = int(np.clip(np.ceil(farthest / STEP / FEWEST) * FEWEST, FEWEST, MOST))
    back = (np.arange(parts) - (parts - 1)) / parts * open_
    return np.maximum((times[:, None] + back).ravel(), 0.0), parts


def ways_seen(trajectory: Trajectory, through: Shot, parts: int) -> Array:
    """(T, N, 3) poses; of what moves, where each `parts` samples are in the camera's view of the last of them."""
    poses = trajectory.poses
    views = np.array([through.affine(time) for time in trajectory.times.tolist()])
    last = np.arange(len(poses)) // parts * parts + parts - 1
    own, final = views[:, None], views[last][:, None]
    at = (poses[..., :2] * own[..., 0, :1] + own[..., 2] - final[..., 2]) / final[
        ..., 0, :1
    ]
    return np.where(poses == poses[last], poses, np.dstack([at, poses[..., 2]]))


def mean_exposures(frames: Iterator[Frame], parts: int) -> Iterator[Frame]:
    """Means of `parts` frames each in linear light, with the time and the ids of the last."""
    for index, first in enumerate(frames):
        group = [first, *(next(frames) for _ in range(parts - 1))]
        last = group[-1]
        light = sum(
            (decode(frame.rgb) for frame in group), np.zeros(last.rgb.shape, np.float32)
        )
        rgb = encode_u8(light / np.float32(parts))
        layering = last.layering
        if layering is not None:  # at once: an exposure's layers take much memory
            layering = partial(_same_layers, _mean_layers(group))
        yield replace(last, index=index, rgb=rgb, layering=layering)


def _same_layers(layers: Layers) -> Layers:
    return layers


def _mean_layers(frames: Sequence[Frame]) -> Layers:
    """Return the mean of the layers of an exposure."""
    parts = [frame.layering() for frame in frames if frame.layering is not None]
    last = parts[-1]
    plate, shaded = np.zeros_like(last.plate), np.zeros_like(last.plate)
    means = {}
    for body in last.order:
        means[body] = np.zeros((*plate.shape[:2], 4), np.float32)
    share = np.float32(1 / len(parts))
    for layers in parts:
        plate += layers.plate * share
        shaded += layers.shaded * share
        for body, picture in layers.pictures().items():
            means[body] += picture * share
    whole = np.s_[0 : plate.shape[0], 0 : plate.shape[1]]
    sprites = []
    for body, mean in means.items():
        sprites.append(SpriteLayer(body, whole, mean[..., :3], mean[..., 3]))
    return Layers(plate, shaded, sprites, last.order)
