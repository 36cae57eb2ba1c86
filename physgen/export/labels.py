"""Exact data of each frame of a clip: views, object ids, poses, scale and optical flow.

A label format (see `formats.py`) is a writer. It gets the `Clip` first, and then one
`Moment` after the other: a view between its neighbours. Video px belong to the frames,
photo px to the scene; pixel centres are integers.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.correspondence import (
    PosedView,
    follow_ball,
    is_still,
    similarity,
    spans,
    turns_in_space,
)
from physgen.geometry.polygon import Array
from physgen.maps import F32, U8, U16, Percepts, png_bytes
from physgen.render.camera import Shot
from physgen.render.stage import Cover, Frame, Layers, Slices
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, rotation_matrices

JPEG_QUALITY = 95
"""Quality of JPEG, with errors of about 1 grey level."""


def write_png(path: Path, picture: U8 | U16) -> None:
    """Write a picture (H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raise
    OSError.
    """
    path.write_bytes(png_bytes(picture))


def write_json(path: Path, data: Any) -> None:
    """Write JSON, indented, UTF-8, with the shortest exact numbers."""
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""First column, first row, width and height, px."""

OMITTED = 65535
"""Id of omitted objects of the photo, and of pixels outside a frame. No body has this
id.
"""


@dataclass(frozen=True)
class Presence:
    """A body with pixels in a frame."""

    body: int
    box: Box
    """Smallest box around the body inside the frame."""
    whole_mask: Mask
    """(h, w) on the box, with hidden parts."""
    visible_mask: Mask
    """(h, w) on the box: the visible part."""

    @cached_property
    def whole_area(self) -> int:
        """Return the area inside the frame, px²."""
        return int(np.count_nonzero(self.whole_mask))

    @cached_property
    def visible_area(self) -> int:
        """Return the visible area, px²; 0 for a completely hidden body."""
        return int(np.count_nonzero(self.visible_mask))

    @property
    def visible_share(self) -> float:
        """Return the visible share of the body's part in the frame, 0..1."""
        return self.visible_area / self.whole_area

    @cached_property
    def visible_box(self) -> Box:
        """Return the smallest box around the visible part, with width and height 0 if
        it is empty.
        """
        x, y, w, h = _bounding_box(self.visible_mask)
        return self.box[0] + x, self.box[1] + y, w, h


def presences(covers: Iterable[Cover], ids: NDArray[np.uint16]) -> list[Presence]:
    """Return one presence for each body with pixels, in the order of the ids.

    Visible pixels always belong to their body.
    """
    covers_by_body: dict[int, list[Cover]] = {}
    for cover in covers:
        if cover.mask.size:
            covers_by_body.setdefault(cover.body, []).append(cover)
    found = []
    for body, body_covers in sorted(covers_by_body.items()):
        presence = _presence(body, body_covers, ids)
        if presence is not None:
            found.append(presence)
    return found


def _presence(
    body: int, covers: Sequence[Cover], ids: NDArray[np.uint16]
) -> Presence | None:
    """Return the presence of a body, or None if its covers have no pixel in
    the frame.
    """
    (rows, columns), mask = _join_covers(covers)
    visible_mask = ids[rows, columns] == body + 1
    # The threshold of coverage may lose visible pixels at the border.
    whole_mask = mask | visible_mask
    x, y, w, h = _bounding_box(whole_mask)
    if not w:
        return None
    box = (columns.start + x, rows.start + y, w, h)
    part = np.s_[y : y + h, x : x + w]
    return Presence(body, box, whole_mask[part], visible_mask[part])


def _join_covers(covers: Sequence[Cover]) -> tuple[tuple[slice, slice], Mask]:
    """Return one box and mask (h, w) of all covers."""
    # Most bodies have one sprite.
    if len(covers) == 1:
        return covers[0].box, covers[0].mask
    top = min(cover.box[0].start for cover in covers)
    bottom = max(cover.box[0].stop for cover in covers)
    left = min(cover.box[1].start for cover in covers)
    right = max(cover.box[1].stop for cover in covers)
    mask = np.zeros((bottom - top, right - left), bool)
    for cover in covers:
        rows, columns = cover.box
        cover_rows = slice(rows.start - top, rows.stop - top)
        cover_columns = slice(columns.start - left, columns.stop - left)
        mask[cover_rows, cover_columns] |= cover.mask
    return np.s_[top:bottom, left:right], mask


def _bounding_box(mask: Mask) -> Box:
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return x, y, w, h


@dataclass(frozen=True)
class View(PosedView):
    """One frame of a clip with N bodies."""

    index: int
    """Index in the order of playback."""
    time: float
    """Time of the motion, s."""
    rgb: U8
    """(H, W, 3) sRGB."""
    ids: U16
    """(H, W): body k is k + 1, 0 = background."""
    find_covers: Callable[[], Sequence[Cover]] = field(repr=False, compare=False)
    """Computes the coverage of the bodies, see `Frame.covers`."""
    find_layers: Callable[[], Layers] | None = field(
        default=None, repr=False, compare=False
    )
    """Computes the layers of the frame, see `Frame.layering`."""

    @cached_property
    def presences(self) -> Sequence[Presence]:
        """Return the bodies with pixels in the frame, also hidden ones, in the order of
        their ids.
        """
        return presences(self.find_covers(), self.ids)

    @cached_property
    def jpeg(self) -> bytes | memoryview:
        """Return the frame as a JPEG file, encoded once for all formats. Colours have
        full resolution, as masks do.
        """
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        # Without subsampling: colours at borders of masks must not bleed.
        options += [
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ]
        bgr = cv2.cvtColor(self.rgb, cv2.COLOR_RGB2BGR)
        _, data = cv2.imencode(".jpg", bgr, options)
        return data.data

    @cached_property
    def boxes(self) -> Mapping[int, Slices]:
        """Return rows and columns of the visible part, by body, only for visible
        bodies.
        """
        boxes = {}
        for presence in self.presences:
            x, y, w, h = presence.visible_box
            if w:
                boxes[presence.body] = np.s_[y : y + h, x : x + w]
        return boxes

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height, px."""
        return self.ids.shape[1], self.ids.shape[0]


@dataclass(frozen=True)
class Scale:
    """SI units of a scene's pixels, grams and seconds."""

    pixels_per_meter: float
    is_known: bool
    """False without a scale in the scene; 100 px/m is the paper's convention, not a
    measurement.
    """

    def meters(self, px: float) -> float | None:
        """Return m of px, or m/s of px/s; None without a known scale."""
        if self.is_known:
            return px / self.pixels_per_meter
        return None

    def newton_seconds(self, impulse: float) -> float | None:
        """Return N·s of g·px/s, or N of g·px/s²; None without a known scale."""
        if self.is_known:
            return impulse / 1000 / self.pixels_per_meter
        return None

    def as_dict(self) -> dict[str, object]:
        """Return the scale for JSON."""
        return {
            "pixels_per_meter": self.pixels_per_meter,
            "from": "written" if self.is_known else "assumed",
        }


@dataclass(frozen=True)
class Clip:
    """Common data of all frames of a clip."""

    name: str
    scene: Scene
    world: World
    trajectory: Trajectory
    """One sample per frame, in forward order."""
    maps: Percepts | None
    """Maps of the photo; None without a photo."""
    size: tuple[int, int]
    """Width and height of the frames, px."""
    fps: float
    """Frame rate of playback, 1/s."""
    count: int
    """Number of frames."""
    shot: Shot
    """The camera at any time, and the order of the samples in the frames."""
    source: Mapping[str, str] = field(default_factory=dict)
    """Paths and SHA-256 of the inputs."""
    photo_ids: U16 = field(
        default_factory=lambda: np.zeros((0, 0), np.uint16), repr=False
    )
    """(H, W) of the photo at t = 0: ids of the bodies, and `OMITTED`; empty without a
    photo.
    """

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of the bodies, in the order of their ids."""
        return tuple(body.name for body in self.world.bodies)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Return the labels of the bodies, or the name for a missing label."""
        return tuple(item.label or item.name for item in self.scene.objects)

    @cached_property
    def categories(self) -> tuple[str, ...]:
        """Return the labels without repetitions, in alphabetical order."""
        return tuple(sorted(set(self.labels)))

    @cached_property
    def classes(self) -> tuple[int, ...]:
        """Return the number of each body's label among the categories, from 1."""
        return tuple(self.categories.index(label) + 1 for label in self.labels)

    @cached_property
    def scale(self) -> Scale:
        """Return the scale of the scene, from its file, a variant or `--set`."""
        return Scale(
            self.scene.world.pixels_per_meter,
            "world.pixels_per_meter" in self.scene.places,
        )


def starting_labels(labels: U16, photo: U16 | None, scenery: Mask) -> U16:
    """Return `Clip.photo_ids` from the scene's labels (H, W), the photo's labels, and
    boundary pixels.
    """
    if photo is None:
        return labels
    # An object removed from the scene is not background: its map values are the
    # object's.
    is_omitted = (photo > 0) & (labels == 0) & ~scenery
    return np.where(is_omitted, np.uint16(OMITTED), labels)


@dataclass(frozen=True)
class Flow:
    """Optical flow from one view to another; H, W."""

    motion: F32
    """(H, W, 2) px: motion of the point at a pixel in x and y, also for points that
    become hidden or leave the picture.
    """
    inside: Mask
    """(H, W): the point is still in the picture."""
    visible: Mask
    """(H, W): the point is in the picture, and visible."""


def flow(view: View, other: View, world: World) -> Flow:
    """Return the motion of each pixel of `view` to `other`."""
    result = _background_flow(view, other)
    # Resting bodies under a still camera have the flow of the background already.
    has_still_camera = np.array_equal(view.lens, other.lens)
    for body, box in view.boxes.items():
        if not (has_still_camera and is_still(body, view, other)):
            _add_body(result, body, box, view, other, world)
    return result


def _background_flow(view: View, other: View) -> Flow:
    """Return the flow of a picture with background only, which moves with the
    camera.
    """
    width, height = view.size
    motion = np.zeros((height, width, 2), np.float32)
    # A similarity z -> m z + n of complex numbers; the body -1 is the background.
    m, n = similarity(-1, view, other)
    # A still camera is the common case.
    if (m, n) == (1, 0):
        inside = np.ones((height, width), bool)
        return Flow(motion, inside, np.asarray(view.ids == other.ids))
    x = np.arange(width)
    y = np.arange(height)
    new_x = m.real * x + n.real
    new_y = m.real * y + n.imag
    motion[..., 0] = new_x - x
    motion[..., 1] = (new_y - y)[:, None]
    # The camera does not turn, so that rows and columns move separately.
    columns = np.rint(new_x).astype(np.int64)
    rows = np.rint(new_y).astype(np.int64)
    other_ids = other.ids.take(columns.clip(0, width - 1), 1)
    other_ids = other_ids.take(rows.clip(0, height - 1), 0)
    has_row = ((rows >= 0) & (rows < height))[:, None]
    inside = has_row & (columns >= 0) & (columns < width)
    return Flow(motion, inside, inside & (other_ids == view.ids))


def _add_body(
    result: Flow, body: int, box: Slices, view: View, other: View, world: World
) -> None:
    """Overwrite the visible pixels of a body in `box`."""
    x, y = spans(box)
    far_side: Mask | None = None
    if turns_in_space(body, view, world) and other.spaces is not None:
        new_x, new_y, far_side = follow_ball(x, y, body, view, other, world)
    else:
        m, n = similarity(body, view, other)
        # The real and imaginary parts of m z + n, for z = x + i y.
        new_x = (m.real * x + n.real) - m.imag * y
        new_y = (m.real * y + n.imag) + m.imag * x
    # Only visible pixels of the body get its flow; other objects keep theirs.
    own_mask = view.ids[box] == body + 1
    motion = result.motion[box]
    np.copyto(motion[..., 0], new_x - x, where=own_mask, casting="same_kind")
    np.copyto(motion[..., 1], new_y - y, where=own_mask, casting="same_kind")
    other_ids = cv2.remap(
        other.ids,
        new_x.astype(np.float32),
        new_y.astype(np.float32),
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=OMITTED,
    )
    # A point is visible if its pixel in the other view shows the same body.
    is_visible = other_ids == body + 1
    if far_side is not None:
        is_visible &= ~far_side
    np.copyto(result.inside[box], other_ids != OMITTED, where=own_mask)
    np.copyto(result.visible[box], is_visible, where=own_mask)


@dataclass(frozen=True)
class Moment:
    """A view between its neighbours in the clip; None at the ends."""

    world: World
    before: View | None
    view: View
    after: View | None

    @cached_property
    def forward(self) -> Flow | None:
        """Return the flow to the next view."""
        if self.after is None:
            return None
        return flow(self.view, self.after, self.world)

    @cached_property
    def backward(self) -> Flow | None:
        """Return the flow to the previous view."""
        if self.before is None:
            return None
        return flow(self.view, self.before, self.world)


class MomentQueue:
    """Makes moments of frames with a delay of one frame. It holds three views."""

    def __init__(
        self, world: World, trajectory: Trajectory, samples: Sequence[int], shot: Shot
    ) -> None:
        """Set the clip. `samples` has the index of each frame's sample in
        `trajectory`.
        """
        self._world = world
        self._trajectory = trajectory
        self._samples = samples
        self._shot = shot
        self._spaces: Array | None = None
        if trajectory.turns.size:
            self._spaces = rotation_matrices(trajectory.turns)
        self._count = 0
        self._before: View | None = None
        self._view: View | None = None

    def put(self, frame: Frame) -> Moment | None:
        """Add a frame, and return the moment of the previous frame; None after the
        first.
        """
        after = self._view_of(frame)
        moment = None
        if self._view is not None:
            moment = Moment(self._world, self._before, self._view, after)
        self._before, self._view = self._view, after
        return moment

    def end(self) -> Moment | None:
        """Return the last moment."""
        view, self._view = self._view, None
        if view is None:
            return None
        return Moment(self._world, self._before, view, None)

    def _view_of(self, frame: Frame) -> View:
        index = self._count
        self._count += 1
        sample = self._samples[index]
        return View(
            lens=self._shot.affine(frame.time),
            poses=self._trajectory.poses[sample],
            spaces=None if self._spaces is None else self._spaces[sample],
            faces=frame.faces,
            index=index,
            time=float(self._trajectory.times[sample]),
            rgb=frame.rgb,
            ids=frame.ids,
            find_covers=lambda: frame.covers,
            find_layers=frame.layering,
        )


class Writer:
    """Writes one format of one clip into its own folder; made from the folder and the
    `Clip`.
    """

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip

    def add(self, moment: Moment) -> None:
        """Add the next moment of the clip."""

    def close(self) -> None:
        """Finish after the last moment."""
