"""What is known exactly about each frame of a clip: views, object ids, poses, scale and optical flow.

A label format (see `formats.py`) is a writer that gets the `Clip` first and then one `Moment` after the other: a view
between its neighbours. Video px are those of the frames, photo px those of the scene; pixel centres are whole numbers.
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
    carried_by_ball,
    is_still,
    similarity,
    spans,
    turns_in_space,
)
from physgen.maps import F32, U8, U16, Percepts, png_bytes
from physgen.render.camera import Shot
from physgen.render.stage import Cover, Frame, Layers, Slices
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory, rotation_matrices

JPEG_QUALITY = 95
"""Errors of about 1 grey level."""


def write_png(path: Path, picture: U8 | U16) -> None:
    """(H, W) or (H, W, 3) in the order R, G, B; 8 or 16 bits. Raises OSError."""
    path.write_bytes(png_bytes(picture))


def write_json(path: Path, data: Any) -> None:
    """Indented, UTF-8; numbers as short as they read back exactly."""
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""First column, first row, width and height, px."""

OMITTED = 65535
"""Id of objects of the photo that the scene leaves out, and of pixels outside a frame: no body has it."""


@dataclass(frozen=True)
class Presence:
    """One body that reaches into a frame."""

    body: int
    box: Box  # the smallest that holds all of the body inside the frame
    whole: Mask  # (h, w) on the box: hidden parts included
    seen: Mask  # (h, w) on the box: the visible part

    @cached_property
    def whole_area(self) -> int:
        """px²."""
        return int(np.count_nonzero(self.whole))

    @cached_property
    def seen_area(self) -> int:
        """px²; 0 where the body is hidden completely."""
        return int(np.count_nonzero(self.seen))

    @property
    def visible(self) -> float:
        """Visible share of what is in the frame, 0..1."""
        return self.seen_area / self.whole_area

    @cached_property
    def seen_box(self) -> Box:
        """The smallest that holds the visible part; width and height are 0 where there is none."""
        x, y, w, h = _bounding_box(self.seen)
        return self.box[0] + x, self.box[1] + y, w, h


def presences(covers: Iterable[Cover], ids: NDArray[np.uint16]) -> list[Presence]:
    """One for each body that covers a pixel, in the order of the ids; visible pixels always belong to their body."""
    parts: dict[int, list[Cover]] = {}
    for cover in covers:
        if cover.mask.size:
            parts.setdefault(cover.body, []).append(cover)
    found = []
    for body, some in sorted(parts.items()):
        (rows, columns), mask = _joined(some)
        seen = ids[rows, columns] == body + 1
        whole = mask | seen
        x, y, w, h = _bounding_box(whole)
        if w:
            own = np.s_[y : y + h, x : x + w]
            found.append(
                Presence(
                    body,
                    (columns.start + x, rows.start + y, w, h),
                    whole[own],
                    seen[own],
                )
            )
    return found


def _joined(covers: Sequence[Cover]) -> tuple[tuple[slice, slice], Mask]:
    """One box and mask (h, w) of all of them."""
    if len(covers) == 1:
        return covers[0].box, covers[0].mask
    top, left = (min(c.box[axis].start for c in covers) for axis in (0, 1))
    bottom, right = (max(c.box[axis].stop for c in covers) for axis in (0, 1))
    mask = np.zeros((bottom - top, right - left), bool)
    for cover in covers:
        rows, columns = cover.box
        mask[
            rows.start - top : rows.stop - top,
            columns.start - left : columns.stop - left,
        ] |= cover.mask
    return np.s_[top:bottom, left:right], mask


def _bounding_box(mask: Mask) -> Box:
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return x, y, w, h


@dataclass(frozen=True)
class View(PosedView):
    """One frame of a clip; N bodies."""

    index: int  # in the order in which the clip is played
    time: float  # s of the motion
    rgb: U8  # (H, W, 3) sRGB
    ids: U16  # (H, W): body k shows as k + 1, 0 = background
    covering: Callable[[], Sequence[Cover]] = field(repr=False, compare=False)
    """Computes the coverage of the bodies, see `Frame.covers`."""
    layering: Callable[[], Layers] | None = field(
        default=None, repr=False, compare=False
    )
    """Computes the layers of the frame, see `Frame.layering`."""

    @cached_property
    def presences(self) -> Sequence[Presence]:
        """The bodies that reach into the frame, hidden ones too, in the order of their ids."""
        return presences(self.covering(), self.ids)

    @cached_property
    def jpeg(self) -> bytes | memoryview:
        """The frame as a JPEG file, encoded once for all formats; colours are as fine as masks."""
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        options += [
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
        ]
        _, data = cv2.imencode(
            ".jpg", cv2.cvtColor(self.rgb, cv2.COLOR_RGB2BGR), options
        )
        return data.data

    @cached_property
    def boxes(self) -> Mapping[int, Slices]:
        """Rows and columns of the visible part, by body; only of visible bodies."""
        found = {}
        for presence in self.presences:
            x, y, w, h = presence.seen_box
            if w:
                found[presence.body] = np.s_[y : y + h, x : x + w]
        return found

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.ids.shape[1], self.ids.shape[0]


@dataclass(frozen=True)
class Scale:
    """SI units of a scene's pixels, grams and seconds."""

    pixels_per_meter: float
    known: bool
    """False: the scene leaves the scale out; 100 px/m is the paper's convention and no measurement."""

    def meters(self, px: float) -> float | None:
        """m, of px; m/s, of px/s; None where the scale is not known."""
        return px / self.pixels_per_meter if self.known else None

    def newton_seconds(self, impulse: float) -> float | None:
        """N·s of g·px/s; N of g·px/s²."""
        return impulse / 1000 / self.pixels_per_meter if self.known else None

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "pixels_per_meter": self.pixels_per_meter,
            "from": "written" if self.known else "assumed",
        }


@dataclass(frozen=True)
class Clip:
    """What is the same for all frames of a clip."""

    name: str
    scene: Scene
    world: World
    trajectory: Trajectory  # a sample a frame, played forward
    maps: Percepts | None  # of the photo; None without one
    size: tuple[int, int]  # width and height of the frames, px
    fps: float  # 1/s at which it plays
    count: int  # frames
    shot: Shot  # the camera at any time, and the order in which the frames show the samples
    source: Mapping[str, str] = field(default_factory=dict)  # inputs: paths and SHA-256
    stood: U16 = field(default_factory=lambda: np.zeros((0, 0), np.uint16), repr=False)
    """(H, W) of the photo at t = 0: ids of the bodies, and `OMITTED`; empty without a photo."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the bodies, in the order of their ids."""
        return tuple(body.name for body in self.world.bodies)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Of the bodies; the name where a label is missing."""
        return tuple(item.label or item.name for item in self.scene.objects)

    @cached_property
    def categories(self) -> tuple[str, ...]:
        """The labels, each once, in alphabetical order."""
        return tuple(sorted(set(self.labels)))

    @cached_property
    def classes(self) -> tuple[int, ...]:
        """The number of each body's label among the categories, from 1 on."""
        return tuple(self.categories.index(label) + 1 for label in self.labels)

    @cached_property
    def scale(self) -> Scale:
        """As the scene has it, by its file, a variant or `--set`."""
        return Scale(
            self.scene.world.pixels_per_meter,
            "world.pixels_per_meter" in self.scene.places,
        )


def starting_labels(labels: U16, photo: U16 | None, scenery: Mask) -> U16:
    """`Clip.stood`, of the scene's labels (H, W), those of the photo, and pixels that show a boundary."""
    if photo is None:
        return labels
    return np.where((photo > 0) & (labels == 0) & ~scenery, np.uint16(OMITTED), labels)


@dataclass(frozen=True)
class Flow:
    """From one view to another; H, W."""

    moved: F32
    """(H, W, 2) px: x and y by which the point shown by a pixel has moved, also where it is then hidden or outside."""
    inside: Mask  # (H, W): it is still in the picture
    visible: Mask  # (H, W): it is in the picture, and nothing hides it


def flow(view: View, other: View, world: World) -> Flow:
    """The motion of each pixel of `view` to `other`."""
    found = _background_flow(view, other)
    still_camera = np.array_equal(view.lens, other.lens)
    for body, box in view.boxes.items():
        if not (still_camera and is_still(body, view, other)):
            _add_body(found, body, box, view, other, world)
    return found


def _background_flow(view: View, other: View) -> Flow:
    """As if every pixel were background, which moves with the camera alone."""
    width, height = view.size
    moved = np.zeros((height, width, 2), np.float32)
    m, n = similarity(-1, view, other)
    if (m, n) == (1, 0):
        return Flow(
            moved, np.ones((height, width), bool), np.asarray(view.ids == other.ids)
        )
    x, y = np.arange(width), np.arange(height)
    to_x, to_y = m.real * x + n.real, m.real * y + n.imag
    moved[..., 0], moved[..., 1] = to_x - x, (to_y - y)[:, None]
    column, row = np.rint(to_x).astype(np.int64), np.rint(to_y).astype(np.int64)
    there = other.ids.take(column.clip(0, width - 1), 1).take(
        row.clip(0, height - 1), 0
    )
    inside = ((row >= 0) & (row < height))[:, None] & (column >= 0) & (column < width)
    return Flow(moved, inside, inside & (there == view.ids))


def _add_body(
    found: Flow, body: int, box: Slices, view: View, other: View, world: World
) -> None:
    """Overwrites the visible pixels of a body in `box`."""
    x, y = spans(box)
    far_side: Mask | None = None
    if turns_in_space(body, view, world) and other.spaces is not None:
        to_x, to_y, far_side = carried_by_ball(x, y, body, view, other, world)
    else:
        m, n = similarity(body, view, other)
        to_x = (m.real * x + n.real) - m.imag * y
        to_y = (m.real * y + n.imag) + m.imag * x
    mine = view.ids[box] == body + 1
    moved = found.moved[box]
    np.copyto(moved[..., 0], to_x - x, where=mine, casting="same_kind")
    np.copyto(moved[..., 1], to_y - y, where=mine, casting="same_kind")
    where = to_x.astype(np.float32), to_y.astype(np.float32)
    there = cv2.remap(
        other.ids,
        *where,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=OMITTED,
    )
    visible = there == body + 1
    if far_side is not None:
        visible &= ~far_side
    np.copyto(found.inside[box], there != OMITTED, where=mine)
    np.copyto(found.visible[box], visible, where=mine)


@dataclass(frozen=True)
class Moment:
    """A view between its neighbours in the clip; None beyond its ends."""

    world: World
    before: View | None
    view: View
    after: View | None

    @cached_property
    def forward(self) -> Flow | None:
        """To the next view."""
        return None if self.after is None else flow(self.view, self.after, self.world)

    @cached_property
    def backward(self) -> Flow | None:
        """To the view before."""
        return None if self.before is None else flow(self.view, self.before, self.world)


class MomentQueue:
    """Frames one after the other -> moments, one frame later; three views are held."""

    def __init__(
        self, world: World, trajectory: Trajectory, samples: Sequence[int], shot: Shot
    ) -> None:
        """`samples`: of each frame, the sample of `trajectory` whose moment it shows."""
        self._world, self._trajectory, self._samples, self._shot = (
            world,
            trajectory,
            samples,
            shot,
        )
        self._spaces = (
            rotation_matrices(trajectory.turns) if trajectory.turns.size else None
        )
        self._count = 0
        self._before: View | None = None
        self._view: View | None = None

    def put(self, frame: Frame) -> Moment | None:
        """The moment of the frame before; None after the first."""
        after = self._seen(frame)
        moment = (
            None
            if self._view is None
            else Moment(self._world, self._before, self._view, after)
        )
        self._before, self._view = self._view, after
        return moment

    def end(self) -> Moment | None:
        """The last moment."""
        view, self._view = self._view, None
        return None if view is None else Moment(self._world, self._before, view, None)

    def _seen(self, frame: Frame) -> View:
        index, self._count = self._count, self._count + 1
        sample = self._samples[index]
        return View(
            self._shot.affine(frame.time),
            self._trajectory.poses[sample],
            None if self._spaces is None else self._spaces[sample],
            frame.faces,
            index,
            float(self._trajectory.times[sample]),
            frame.rgb,
            frame.ids,
            lambda: frame.covers,
            frame.layering,
        )


class Writer:
    """One format of one clip, written into a folder of its own: made of the folder and the `Clip`."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip

    def add(self, moment: Moment) -> None:
        """The next moment of the clip."""

    def close(self) -> None:
        """All moments were added."""
