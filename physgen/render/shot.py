"""Scene and trajectory -> how the clip is filmed and played; frames of the photo's size -> frames of the video's.

Between two views the camera eases: after a part s of the time it has come 3 s² - 2 s³ of the way, so it leaves and
reaches each view at rest. The width of what it sees changes by equal factors, and its centre moves with the width: that
keeps one point of a zoom still, and a view between two that lie in the photo lies in it too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import ceil, exp, expm1, log, sqrt

import numpy as np
from numpy.typing import NDArray

from physgen.framing import Point, Size, affine, held, magnification, room
from physgen.render.resample import nearest, nearest_in, resampled, sources
from physgen.render.stage import Cover, Frame
from physgen.scene.model import Play, Scene, Sight
from physgen.simulate.trajectory import Trajectory

Array = NDArray[np.float64]

STEADY = 0.2
"""s of the clip: the standard deviation of the weights with which a followed object's way is smoothed."""
ASTRAY = 0.6
"""Of the way from the picture's middle to its border, within which a followed object stays however it is flung."""
ALL = Sight(0.0, None, None, 1.0)
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
        return any(aim.zoom != first.zoom or (aim.way != first.way[:1]).any() for aim in self.aims)

    @property
    def opens_on_photo(self) -> bool:
        """Whether the first frame shows all of the photo, as it is at t = 0."""
        whole = self.video == self.photo and np.array_equal(self.affine(0.0), np.eye(2, 3))
        return whole and self.order[0] == 0

    def samples(self, parts: int) -> list[int]:
        """`order` for a trajectory that has `parts` samples where `times` has one: an exposure's stay in theirs."""
        return [sample * parts + part for sample in self.order for part in range(parts)]

    def _view(self, time: float) -> tuple[Point, float]:
        """Centre, px, and zoom at a time."""
        after = sum(aim.time <= time for aim in self.aims)
        one, other = self.aims[max(after - 1, 0)], self.aims[min(after, len(self.aims) - 1)]
        if one is other or time <= one.time:
            return self._center(one, time), one.zoom
        s = (time - one.time) / (other.time - one.time)
        eased = s * s * (3 - 2 * s)
        narrower = log(one.zoom / other.zoom)
        zoom = one.zoom * exp(-narrower * eased)
        part = expm1(narrower * eased) / expm1(narrower) if abs(narrower) > 1e-9 else eased
        (ax, ay), (bx, by) = self._center(one, time), self._center(other, time)
        center = ax + (bx - ax) * part, ay + (by - ay) * part
        return held(center, self.photo, self.video, zoom), zoom  # for the last bit alone

    def _center(self, aim: Aim, time: float) -> Point:
        if len(aim.way) == 1:
            return float(aim.way[0, 0]), float(aim.way[0, 1])
        return float(np.interp(time, self.times, aim.way[:, 0])), float(
            np.interp(time, self.times, aim.way[:, 1])
        )


def shot(scene: Scene, trajectory: Trajectory) -> Shot:
    """The scene's `render` for a trajectory that has one sample a frame played forward."""
    photo, video = scene.size, scene.video_size
    sights = scene.render.camera or (ALL,)
    aims = tuple(
        Aim(sight.time, sight.zoom, _way(sight, photo, video, trajectory, scene.render.fps))
        for sight in sights
    )
    return Shot(photo, video, trajectory.times, aims, played(scene.render.play, len(trajectory.times)))


def played(play: Play, count: int) -> tuple[int, ...]:
    """Samples in the order in which a clip shows them.

    >>> played(Play.THERE_AND_BACK, 3)
    (0, 1, 2, 1, 0)
    """
    there = tuple(range(count))
    if play is Play.BACKWARD:
        return there[::-1]
    return there + there[-2::-1] if play is Play.THERE_AND_BACK else there


def filmed(frames: Iterator[Frame], through: Shot, drawn: float = 1.0) -> Iterator[Frame]:
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
        if last is not None and np.array_equal(matrix, last[1]) and np.array_equal(frame.rgb, last[0].rgb):
            rgb = last[2].rgb
        else:
            rgb = resampled(frame.rgb, matrix, through.video)
        through_it = frame, matrix, through.video
        named, covering = partial(_named, *through_it), partial(_covering, *through_it)
        seen = Frame(frame.index, frame.time, rgb, named, covering)
        last = frame, matrix, seen
        yield seen


def _named(frame: Frame, matrix: Array, size: Size) -> NDArray[np.uint16]:
    """(h, w) of `size` (w, h): the ids of the frame as they are seen."""
    return nearest(frame.ids, matrix, size)


def _covering(frame: Frame, matrix: Array, size: Size) -> list[Cover]:
    """Covers of the frame as they are seen, of the very pixels that `_named` takes."""
    height, width = frame.rgb.shape[:2]
    rows, columns = sources(matrix, (width, height), size)
    return [Cover(cover.body, *nearest_in(cover.box, cover.mask, rows, columns)) for cover in frame.covers]


def drawn_large(scene: Scene) -> float:
    """Canvas pixels a photo pixel that a scene without a photo is drawn with, to be sharp wherever the camera goes."""
    zoom = max(sight.zoom for sight in scene.render.camera or (ALL,))
    large = max(1.0, magnification(scene.size, scene.video_size, zoom))
    return max(1.0, min(large, sqrt(MOST_DRAWN / (scene.size[0] * scene.size[1]))))


def on_canvas(matrix: Array, drawn: float) -> Array:
    """The matrix from photo px as one from the px of a canvas whose pixels are `drawn` times finer."""
    if drawn == 1.0:
        return matrix
    large = matrix[:, :2] / drawn
    return np.column_stack([large, matrix[:, 2] + large @ [0.5, 0.5] - matrix[:, :2] @ [0.5, 0.5]])


def _way(sight: Sight, photo: Size, video: Size, trajectory: Trajectory, fps: float) -> Array:
    """The centre of a view, (T, 2) px or (1, 2), where the view lies in the photo."""
    if sight.follow is None:
        middle = (photo[0] - 1) / 2, (photo[1] - 1) / 2
        return np.array([held(sight.center or middle, photo, video, sight.zoom)])
    low, high = room(photo, video, sight.zoom)
    at = np.clip(trajectory.poses[:, trajectory.names.index(sight.follow), :2], low, high)
    most = ASTRAY * np.array(video) / (2 * magnification(photo, video, sight.zoom))
    behind = _steadied(at, STEADY * fps) - at
    # hardly changed up to half of the most, and never beyond it
    return np.clip(at + behind / (1 + (behind / most) ** 4) ** 0.25, low, high)


def _steadied(way: Array, width: float) -> Array:
    """(T, 2) smoothed by a Gaussian of `width` samples; beyond its ends goes the way itself, turned about them."""
    reach = ceil(3 * width)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    beyond = np.pad(way, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns: Sequence[Array] = [np.convolve(c, weights / weights.sum(), mode="valid") for c in beyond.T]
    return np.stack(columns, axis=1)
