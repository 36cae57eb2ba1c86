"""Camera, playing order, resampling and motion blur of a clip.

Between two views the camera eases: after a share s of the time it has covered 3 s² - 2
s³ of the path. The width of the view changes by equal factors, and its centre moves
with the width: one point of a zoom stays still, and a view between two views within the
photo is within it, too. Pictures are resampled by Lanczos with three lobes in linear
light, with Pillow's exact weights: OpenCV's warps have steps of 1/32 px, and a slow pan
would tremble. Each value is limited to the range of the pixels under the middle lobe,
against dark lines along bright edges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil, exp, expm1, floor, log, pi, sin, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.arrays import Mask
from physgen.compile.world import World
from physgen.geometry.polygon import Array
from physgen.maps import F32, U8
from physgen.photometry import decode, encode_u8
from physgen.render.stage import Cover, Frame, Layers, Slices, SpriteLayer
from physgen.scene.framing import affine, confine_center, magnification, room
from physgen.scene.scene import CameraView, Play, Point, Scene
from physgen.simulate.trajectory import START_TIME, Trajectory

Index = NDArray[np.int64]
Size = tuple[int, int]
"""Width and height, px."""

LOBES = 3
"""Lobes of the kernel on each side."""
NOTHING = 1e-6
"""Largest invisible displacement, px."""


def resample_picture(rgb: U8, matrix: Array, size: Size) -> U8:
    """Resample a picture as (h, w, 3) sRGB of `size` (w, h).

    `matrix` (2, 3) scales and shifts from px of `rgb` to px of the result, which lies
    within `rgb`. A shift by whole pixels only copies them.
    """
    scale = float(matrix[0, 0])
    x0, y0, x1, y1 = _visible_borders(rgb, matrix, size)
    left, top = round(x0), round(y0)
    # Copied pixels stay exact, and cost nothing.
    is_whole_shift = max(abs(x0 - left), abs(y0 - top)) < NOTHING
    if scale == 1.0 and is_whole_shift:
        visible_part = rgb[top : top + size[1], left : left + size[0]]
        return np.ascontiguousarray(visible_part)
    # Crop to the pixels that the kernel can reach: large photos are much slower.
    reach = ceil(LOBES * max(1.0, 1.0 / scale)) + 1
    left = max(floor(x0) - reach, 0)
    top = max(floor(y0) - reach, 0)
    rgb = rgb[top : ceil(y1) + reach, left : ceil(x1) + reach]
    shift = matrix @ [left, top, 1.0]
    matrix = np.column_stack([matrix[:, :2], shift])
    return _resample_within_limits(rgb, matrix, size)


def _resample_within_limits(rgb: U8, matrix: Array, size: Size) -> U8:
    """Resample by Lanczos, between the darkest and the brightest pixel nearby."""
    box = _visible_borders(rgb, matrix, size)
    kernel, rows, columns = _lobes(rgb, matrix, size)
    light = decode(np.arange(256, dtype=np.uint8))
    planes = []
    for codes in cv2.split(rgb):
        plane = Image.fromarray(cv2.LUT(codes, light))
        plane_part = plane.resize(size, Image.Resampling.LANCZOS, box=box)
        lowest = cv2.erode(codes, kernel, anchor=(0, 0))
        highest = cv2.dilate(codes, kernel, anchor=(0, 0))
        # The limits can be taken in sRGB, which has the same order as linear light.
        resampled_codes = encode_u8(np.asarray(plane_part))
        limited_codes = cv2.max(resampled_codes, lowest.take(columns, 1).take(rows, 0))
        limited_codes = cv2.min(limited_codes, highest.take(columns, 1).take(rows, 0))
        planes.append(limited_codes)
    return np.asarray(cv2.merge(planes), np.uint8)


def nearest(ids: NDArray[np.uint16], matrix: Array, size: Size) -> NDArray[np.uint16]:
    """Return (h, w) of `size` (w, h): the nearest value to each pixel."""
    rows, columns = sources(matrix, (ids.shape[1], ids.shape[0]), size)
    return np.asarray(ids.take(columns, 1).take(rows, 0))


def nearest_in(
    box: Slices, mask: Mask, rows: Index, columns: Index
) -> tuple[Slices, Mask]:
    """Resample a mask that is True only in a `box`, like `nearest`, by its
    `sources`.
    """
    row_edges = (box[0].start, box[0].stop)
    first_row, last_row = np.searchsorted(rows, row_edges).tolist()
    column_edges = (box[1].start, box[1].stop)
    first_column, last_column = np.searchsorted(columns, column_edges).tolist()
    own_rows = rows[first_row:last_row] - box[0].start
    own_columns = columns[first_column:last_column] - box[1].start
    result = mask.take(own_columns, 1).take(own_rows, 0)
    place = slice(first_row, last_row), slice(first_column, last_column)
    return place, np.asarray(result)


def sources(matrix: Array, view_size: Size, size: Size) -> tuple[Index, Index]:
    """Return the nearest rows (h,) and columns (w,) in a picture of the size
    `view_size`.
    """
    width, height = view_size
    rows = np.floor(_sources(matrix, 1, size[1]) + 0.5).astype(np.int64)
    columns = np.floor(_sources(matrix, 0, size[0]) + 0.5).astype(np.int64)
    return np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)


def _visible_borders(
    rgb: U8 | F32, matrix: Array, size: Size
) -> tuple[float, float, float, float]:
    """Return the borders x0, y0, x1, y1 of the visible part, px from the first pixel's
    corner.
    """
    scale = float(matrix[0, 0])
    edges = []
    for axis, side in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        first = (-0.5 - float(matrix[axis, 2])) / scale + 0.5
        last = first + size[axis] / scale
        edges.append((max(first, 0.0), min(last, float(side))))
    (x0, x1), (y0, y1) = edges
    return x0, y0, x1, y1


def _sources(matrix: Array, axis: int, count: int) -> Array:
    """Return the source of the result's columns (axis 0) or rows (axis 1), px."""
    return np.asarray((np.arange(count) - matrix[axis, 2]) / matrix[0, 0])


def _lobes(rgb: U8, matrix: Array, size: Size) -> tuple[U8, Index, Index]:
    """Return the kernel's middle lobe as a square of ones, with its first row and
    column.
    """
    reach = max(1.0, 1.0 / float(matrix[0, 0]))
    side = ceil(2 * reach - NOTHING)
    firsts = []
    for axis, length in ((0, rgb.shape[1]), (1, rgb.shape[0])):
        # The middle lobe reaches one source pixel, or one result pixel if that is
        # larger.
        lower_bounds = np.floor(_sources(matrix, axis, size[axis]) - reach + NOTHING)
        first_places = lower_bounds.astype(np.int64) + 1
        firsts.append(np.clip(first_places, 0, length - 1))
    kernel = np.ones((side, side), np.uint8)
    return kernel, firsts[1], firsts[0]


STEADY = 0.2
"""Standard deviation of the smoothing of a followed object's path, s of the clip."""
ASTRAY = 0.6
"""Share of the distance from the picture's centre to its border within which a followed
object stays, however fast it moves.
"""
WHOLE_PHOTO = CameraView(0.0, None, None, 1.0)
"""The view without a camera."""
MOST_DRAWN = 16_000_000
"""Maximum number of pixels of a flat scene's canvas."""


@dataclass(frozen=True)
class Hand:
    """Motion of a handheld camera."""

    rise: float = 0.7
    """Time until the drift has its full size, s of the video."""
    rates: tuple[float, ...] = (0.31, 0.73, 1.37)
    """Frequencies of slow sway and tremor, Hz, without a common period."""
    phases: tuple[float, float] = (0.4, 2.1)
    """Phases of the drift to the right and down, rad."""
    drift_limit: float = 2.5
    """Maximum drift in standard deviations."""


HAND = Hand()


def _sway(time: float, phase: float) -> float:
    """Return a drift of standard deviation 1 at a time of the video."""
    waves = [
        sin(2 * pi * rate * time + (k + 1) * phase) for k, rate in enumerate(HAND.rates)
    ]
    return sum(waves) * sqrt(2 / len(waves))


@dataclass(frozen=True)
class Aim:
    """A view at a time, which the camera reaches."""

    time: float
    """Time, s."""
    zoom: float
    way: Array
    """Centre of the view at the samples' times, (T, 2) px; (1, 2) for a fixed view."""


@dataclass(frozen=True)
class Shot:
    """The camera and the playing order of a clip."""

    photo: Size
    video: Size
    """Size of the frames, px."""
    times: Array
    """Times of the samples, (T,) s."""
    aims: tuple[Aim, ...]
    """Views in the order of their times; at least one."""
    order: tuple[int, ...]
    """Sample of every frame."""
    handheld: float = 0.0
    """Standard deviation of the drift, px of the video."""
    pace: float = 1.0
    """Seconds of the video for a second of the motion."""

    def affine(self, time: float) -> Array:
        """Return the matrix (2, 3) from photo px to video px of a frame at `time`.

        `time` is that of the motion, s, as `Frame.time`. All marks on the finished
        frame use this matrix: `x, y = shot.affine(frame.time) @ (px, py, 1)`.
        """
        center, zoom = self._view(time)
        if self.handheld:
            center, zoom = self._drift_view(center, zoom, time * self.pace)
        scale, (x, y) = affine(self.photo, self.video, center, zoom)
        return np.array([[scale, 0.0, x], [0.0, scale, y]])

    @cached_property
    def moves(self) -> bool:
        """Return whether the camera moves."""
        first = self.aims[0]
        zooms = any(aim.zoom != first.zoom for aim in self.aims)
        return zooms or any((aim.way != first.way[:1]).any() for aim in self.aims)

    @property
    def opens_on_photo(self) -> bool:
        """Return whether the first frame shows all of the photo, as it is at t = 0."""
        if self.video != self.photo or self.order[0] != 0:
            return False
        return np.array_equal(self.affine(0.0), np.eye(2, 3))

    def samples(self, parts: int) -> list[int]:
        """Return `order` for a trajectory with `parts` samples for each of `times`.

        The samples of an exposure keep their order in time.
        """
        return [sample * parts + part for sample in self.order for part in range(parts)]

    def _view(self, time: float) -> tuple[Point, float]:
        """Return centre, px, and zoom at a time."""
        # The view is between the last aim before the time and the first one after it.
        following = sum(aim.time <= time for aim in self.aims)
        start = self.aims[max(following - 1, 0)]
        end = self.aims[min(following, len(self.aims) - 1)]
        if start is end or time <= start.time:
            return self._center(start, time), start.zoom
        s = (time - start.time) / (end.time - start.time)
        eased_share = s * s * (3 - 2 * s)
        # Equal factors of the zoom look even: the logarithm is eased.
        narrowing = log(start.zoom / end.zoom)
        zoom = start.zoom * exp(-narrowing * eased_share)
        share = eased_share
        if abs(narrowing) > 1e-9:
            # With this share the centre moves with the width, so that one point stays
            # still.
            share = expm1(narrowing * eased_share) / expm1(narrowing)
        ax, ay = self._center(start, time)
        bx, by = self._center(end, time)
        center = ax + (bx - ax) * share, ay + (by - ay) * share
        # Rounding may lead out of the photo by a bit.
        return confine_center(center, self.photo, self.video, zoom), zoom

    def _drift_view(
        self, center: Point, zoom: float, time: float
    ) -> tuple[Point, float]:
        """Return centre and zoom of a handheld view at a time of the video."""
        start = min(time / HAND.rise, 1.0)
        share = start * start * (3 - 2 * start)
        # Zoom in, so that the drift stays within the photo.
        extra_zoom = 2 * HAND.drift_limit * self.handheld / min(self.video)
        zoom *= 1 + share * extra_zoom
        amount = share * self.handheld / magnification(self.photo, self.video, zoom)
        x, y = (amount * _sway(time, phase) for phase in HAND.phases)
        center = center[0] + x, center[1] + y
        return confine_center(center, self.photo, self.video, zoom), zoom

    def _center(self, aim: Aim, time: float) -> Point:
        """Return the centre of an aim at a time, px."""
        if len(aim.way) == 1:
            return float(aim.way[0, 0]), float(aim.way[0, 1])
        x = np.interp(time, self.times, aim.way[:, 0])
        y = np.interp(time, self.times, aim.way[:, 1])
        return float(x), float(y)


def shot_of(scene: Scene, trajectory: Trajectory) -> Shot:
    """Return the shot of a scene's `render` for a trajectory with one sample
    per frame.
    """
    photo, video = scene.size, scene.video_size
    aims = []
    for sight in scene.render.camera or (WHOLE_PHOTO,):
        way = _way(sight, photo, video, trajectory, scene.render.fps)
        aims.append(Aim(sight.time, sight.zoom, way))
    times = trajectory.times
    order = play_order(scene.render.play, len(times))
    # Seconds of video per second of motion: a hand trembles in the time of the video.
    pace = 1.0
    if len(times) > 1 and times[-1] > times[0]:
        rate = (len(times) - 1) / float(times[-1] - times[0])
        pace = rate / scene.render.fps
    handheld = scene.render.handheld
    return Shot(photo, video, times, tuple(aims), order, handheld, pace)


def play_order(play: Play, count: int) -> tuple[int, ...]:
    """Return the samples in the playing order of a clip.

    >>> play_order(Play.THERE_AND_BACK, 3)
    (0, 1, 2, 1, 0)
    """
    forward = tuple(range(count))
    if play is Play.BACKWARD:
        return forward[::-1]
    if play is Play.THERE_AND_BACK:
        return forward + forward[-2::-1]
    return forward


def film_frames(
    frames: Iterator[Frame], shot: Shot, canvas_scale: float = 1.0
) -> Iterator[Frame]:
    """Yield frames as the camera sees them; `canvas_scale`: canvas pixels per photo pixel.

    A frame that the camera shows as a whole at its own size is returned as it is. A
    view without a change since the last frame is not resampled again.
    """
    last: tuple[Frame, Array, Frame] | None = None
    for frame in frames:
        matrix = on_canvas(shot.affine(frame.time), canvas_scale)
        height, width = frame.rgb.shape[:2]
        if (width, height) == shot.video and np.array_equal(matrix, np.eye(2, 3)):
            yield frame
            continue
        if last is not None and _is_same(frame, matrix, last):
            rgb = last[2].rgb
        else:
            rgb = resample_picture(frame.rgb, matrix, shot.video)
        # Ids, covers and layers are resampled only if someone reads them.
        view = frame, matrix, shot.video
        load_ids = partial(_sample_visible_ids, *view)
        load_covers = partial(_covering, *view)
        load_layers = None
        if frame.layering is not None:
            load_layers = partial(_layers_seen, frame.layering, matrix, shot.video)
        result = Frame(
            frame.index,
            frame.time,
            rgb,
            load_ids,
            load_covers,
            frame.faces,
            load_layers,
        )
        last = frame, matrix, result
        yield result


def _is_same(frame: Frame, matrix: Array, last: tuple[Frame, Array, Frame]) -> bool:
    """Check that neither the view nor the picture has changed since the last frame."""
    last_frame, last_matrix, _ = last
    is_same_view = np.array_equal(matrix, last_matrix)
    return is_same_view and np.array_equal(frame.rgb, last_frame.rgb)


def _sample_visible_ids(frame: Frame, matrix: Array, size: Size) -> NDArray[np.uint16]:
    """Return the visible ids of a frame, (h, w) of `size` (w, h)."""
    return nearest(frame.ids, matrix, size)


def _covering(frame: Frame, matrix: Array, size: Size) -> list[Cover]:
    """Return the visible covers of a frame, at the same pixels as `_sample_visible_ids`."""
    height, width = frame.rgb.shape[:2]
    rows, columns = sources(matrix, (width, height), size)
    covers = []
    for cover in frame.covers:
        box, mask = nearest_in(cover.box, cover.mask, rows, columns)
        covers.append(Cover(cover.body, box, mask))
    return covers


def resample_light(light: F32, matrix: Array, size: Size) -> F32:
    """Resample linear light 0..1 as (h, w, C) of `size` (w, h), like
    `resample_picture`.
    """
    box = _visible_borders(light, matrix, size)
    planes = []
    for plane in cv2.split(light):
        picture = Image.fromarray(plane).resize(size, Image.Resampling.LANCZOS, box=box)
        planes.append(np.clip(np.asarray(picture), 0, 1))
    return np.asarray(cv2.merge(planes), np.float32)


def _layers_seen(layering: Callable[[], Layers], matrix: Array, size: Size) -> Layers:
    """Return the layers of a frame as the camera sees them."""
    layers = layering()
    whole_picture = np.s_[0 : size[1], 0 : size[0]]
    sprites = []
    # A layer covers only its box before the camera; afterwards it may lie anywhere.
    for sprite in layers.sprites:
        canvas = np.zeros((*layers.plate.shape[:2], 4), np.float32)
        canvas[sprite.box] = np.dstack([sprite.light, sprite.coverage])
        visible = resample_light(canvas, matrix, size)
        sprites.append(
            SpriteLayer(sprite.body, whole_picture, visible[..., :3], visible[..., 3])
        )
    plate = resample_light(layers.plate, matrix, size)
    background = resample_light(layers.shaded_plate, matrix, size)
    return Layers(plate, background, sprites, layers.order)


def canvas_scale(scene: Scene) -> float:
    """Return the canvas pixels per photo pixel for sharp views of a scene without a
    photo.
    """
    zoom = max(sight.zoom for sight in scene.render.camera or (WHOLE_PHOTO,))
    largest_scale = max(1.0, magnification(scene.size, scene.video_size, zoom))
    scale_limit = sqrt(MOST_DRAWN / (scene.size[0] * scene.size[1]))
    return max(1.0, min(largest_scale, scale_limit))


def on_canvas(matrix: Array, canvas_scale: float) -> Array:
    """Convert a matrix from photo px to one from px of a canvas, `canvas_scale` times
    finer.
    """
    if canvas_scale == 1.0:
        return matrix
    linear_part = matrix[:, :2] / canvas_scale
    shift = matrix[:, 2] + linear_part @ [0.5, 0.5] - matrix[:, :2] @ [0.5, 0.5]
    return np.column_stack([linear_part, shift])


def _way(
    sight: CameraView, photo: Size, video: Size, trajectory: Trajectory, fps: float
) -> Array:
    """Return the centre of a view, (T, 2) px or (1, 2), within the photo."""
    if sight.follow is None:
        middle = (photo[0] - 1) / 2, (photo[1] - 1) / 2
        return np.array(
            [confine_center(sight.center or middle, photo, video, sight.zoom)]
        )
    lower_limit, upper_limit = room(photo, video, sight.zoom)
    body = trajectory.names.index(sight.follow)
    # The camera follows the body as far as the photo reaches: beyond it, there is no
    # picture to show.
    places = np.clip(trajectory.poses[:, body, :2], lower_limit, upper_limit)
    largest_offset = (
        ASTRAY * np.array(video) / (2 * magnification(photo, video, sight.zoom))
    )
    offsets = _smooth_camera_path(places, STEADY * fps) - places
    # A soft limit: offsets change little up to half of the limit, and never exceed it.
    limited_offsets = offsets / (1 + (offsets / largest_offset) ** 4) ** 0.25
    return np.clip(places + limited_offsets, lower_limit, upper_limit)


def _smooth_camera_path(way: Array, width: float) -> Array:
    """Smooth a path (T, 2) by a Gaussian of `width` samples.

    Beyond its ends the path is continued by point reflection.
    """
    reach = ceil(3 * width)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    weights = weights / weights.sum()
    margin = ((reach, reach), (0, 0))
    padded_path = np.pad(way, margin, mode="reflect", reflect_type="odd")
    columns = [np.convolve(column, weights, mode="valid") for column in padded_path.T]
    return np.stack(columns, axis=1)


FEWEST, MOST = 4, 24
"""Moments of an exposure: their number is a multiple of the minimum, which is also the
number of views of a moving camera."""
STEP = 2.0
"""Displacement between two moments, px, below the maximum number of moments."""


def exposure_times(
    trajectory: Trajectory, world: World, part: float
) -> tuple[Array, int]:
    """Return the moments (T x parts,) s of exposures at the trajectory's times, and
    `parts`.

    The shutter is open for a `part` of the time between frames and closes at the
    frame's time: at t = 0 no object has moved, and the first frame is the photo.
    """
    times = trajectory.times
    if part <= 0 or len(times) < 2 or not world.bodies:
        return times, 1
    # The shutter angle as a share of the time between two frames; film cameras have
    # 0.5.
    exposure = part * float(times[1] - times[0])
    reaches = []
    for body in world.bodies:
        reaches.append(np.hypot(*np.concatenate(body.rings).T).max())
    vx, vy, spin = np.moveaxis(trajectory.velocities, -1, 0)
    speed = np.hypot(vx, vy) + np.abs(spin) * np.array(reaches)
    # The fastest point of any body decides the number of samples of an exposure.
    farthest = float(speed.max()) * exposure
    # Samples must be so close that a moving edge shows no steps. Their number is a
    # multiple of the fewest, within limits of time.
    count = np.ceil(farthest / STEP / FEWEST) * FEWEST
    parts = int(np.clip(count, FEWEST, MOST))
    before = (np.arange(parts) - (parts - 1)) / parts * exposure
    return np.maximum((times[:, None] + before).ravel(), 0.0), parts


def blur_first_frame(
    trajectory: Trajectory, world: World, parts: int, share: float
) -> Trajectory:
    """Return samples of exposures, `parts` per frame, in which the first frame is blurred, too.

    What moves and touches nothing at t = 0 came with its velocity. `share` of the time between frames is exposed.
    """
    times, contacts = trajectory.times, trajectory.contacts
    if parts < 2 or len(times) <= parts:
        return trajectory
    # A body that touches something at t = 0 gets its velocity just then, from rest. A
    # free body has flown before, and has a trail in the first frame too.
    begins = contacts.touch_times[:, 0] <= START_TIME
    touching = set(contacts.touch_pairs[begins].ravel().tolist())
    exposure = share * float(times[2 * parts - 1] - times[parts - 1])
    before = (np.arange(parts) - (parts - 1)) / parts * exposure
    poses = trajectory.poses.copy()
    for k, body in enumerate(world.bodies):
        velocity = trajectory.velocities[0, k, :2]
        if k in touching or body.ramp > 0 or not velocity.any():
            continue
        poses[:parts, k, :2] = poses[0, k, :2] + before[:, None] * velocity
    return replace(trajectory, poses=poses)


def ways_seen(trajectory: Trajectory, shot: Shot, parts: int) -> Array:
    """Return poses (T, N, 3) as seen by a moving camera within an exposure.

    Each group of `parts` samples is moved into the camera's view of its last sample.
    """
    poses = trajectory.poses
    views = np.array(list(map(shot.affine, trajectory.times.tolist())))
    last = np.arange(len(poses)) // parts * parts + parts - 1
    own_views = views[:, None]
    last_views = views[last][:, None]
    in_video = poses[..., :2] * own_views[..., 0, :1] + own_views[..., 2]
    places = (in_video - last_views[..., 2]) / last_views[..., 0, :1]
    return np.where(poses == poses[last], poses, np.dstack([places, poses[..., 2]]))


def mean_exposures(frames: Iterator[Frame], parts: int) -> Iterator[Frame]:
    """Yield means of `parts` frames in linear light, with time and ids of the
    last one.
    """
    for index, first in enumerate(frames):
        light = np.zeros(first.rgb.shape, np.float32) + decode(first.rgb)
        group = [first]
        for _ in range(parts - 1):
            group.append(next(frames))
            light = light + decode(group[-1].rgb)
        last = group[-1]
        rgb = encode_u8(light / np.float32(parts))
        layering = last.layering
        # Compute the layers now, since all layers of an exposure take much memory.
        if layering is not None:
            layering = partial(_same_layers, _mean_layers(group))
        yield replace(last, index=index, rgb=rgb, layering=layering)


def _same_layers(layers: Layers) -> Layers:
    """Return the layers."""
    return layers


def _mean_layers(frames: Sequence[Frame]) -> Layers:
    """Return the mean of the layers of an exposure."""
    parts = [frame.layering() for frame in frames if frame.layering is not None]
    last = parts[-1]
    plate = np.zeros_like(last.plate)
    background = np.zeros_like(last.plate)
    means = {}
    for body in last.order:
        means[body] = np.zeros((*plate.shape[:2], 4), np.float32)
    # Light and coverage are averages over the exposure, since both are linear.
    share = np.float32(1 / len(parts))
    for layers in parts:
        plate += layers.plate * share
        background += layers.shaded_plate * share
        for body, picture in layers.pictures().items():
            means[body] += picture * share
    whole_picture = np.s_[0 : plate.shape[0], 0 : plate.shape[1]]
    sprites = []
    for body, mean in means.items():
        sprites.append(SpriteLayer(body, whole_picture, mean[..., :3], mean[..., 3]))
    return Layers(plate, background, sprites, last.order)
