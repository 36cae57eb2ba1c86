"""What is known exactly about each frame of a clip: views, object ids, poses, scale and optical flow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.correspondence import Ball, is_still, similarity, spans, turns_in_space
from physgen.export.files import jpeg, png
from physgen.export.masks import AmodalBox, Extent, Presence, amodal_box, presences
from physgen.maps import Percepts
from physgen.render.camera import Shot
from physgen.render.stage import Cover, Frame, Slices
from physgen.scene.scene import Scene
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.trajectory import rotation_matrices as in_space

# ----------------------------------------------------------------------
# Frames, trajectory and camera -> views: what is true of each picture of a clip, one at a time.
#
# Video px are those of the frames, photo px those of the scene; pixel centres are whole numbers in both.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
T = TypeVar("T")


OMITTED = 65535
"""Stands for things of the photo that the scene leaves out."""


@dataclass(frozen=True)
class View:
    """One picture of a clip; N bodies."""

    index: int
    """In the order in which the clip is played."""
    time: float
    """s of the motion."""
    rgb: U8
    """(H, W, 3) sRGB."""
    ids: U16
    """(H, W): body k shows as k + 1, 0 = background."""
    lens: Array
    """(2, 3): photo px -> video px."""
    poses: Array
    """(N, 3): x px, y px, angle rad, of the centre of mass, in the photo."""
    spaces: Array | None
    """(N, 3, 3): how bodies have turned in space since t = 0, +z into the photo; None: in the picture alone."""
    covering: Callable[[], Sequence[Cover]] = field(repr=False, compare=False)
    """Works out where things are, see `Frame.covers`."""

    @cached_property
    def presences(self) -> Sequence[Presence]:
        """The bodies that reach into the picture, those too that are hidden; in the order of their ids."""
        return presences(self.covering(), self.ids)

    @cached_property
    def jpeg(self) -> bytes | memoryview:
        """The picture as a JPEG file: several formats hold it, and it is encoded once."""
        return jpeg(self.rgb)

    @cached_property
    def png(self) -> bytes | memoryview:
        """The picture as a PNG file, to the last bit."""
        return png(self.rgb)

    @cached_property
    def boxes(self) -> Mapping[int, Slices]:
        """Body -> the rows and columns that hold all that is seen of it; those alone that are seen."""
        found = {}
        for thing in self.presences:
            x, y, w, h = thing.seen_box
            if w:
                found[thing.body] = np.s_[y : y + h, x : x + w]
        return found

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.ids.shape[1], self.ids.shape[0]


@dataclass(frozen=True)
class Clip:
    """What is true of all of a clip."""

    name: str
    scene: Scene
    world: World
    trajectory: Trajectory
    """A sample a frame, played forward."""
    maps: Percepts | None
    """Of the photo; None without one."""
    extents: Sequence[Extent | None]
    """Of the bodies; None where nothing is drawn of one."""
    size: tuple[int, int]
    """Width and height of the frames, px."""
    fps: float
    """1/s at which it plays."""
    count: int
    """Frames."""
    shot: Shot
    """Where the camera is at any time, and in which order the frames show the samples."""
    source: Mapping[str, str] = field(default_factory=dict)
    """What it was made of: paths and SHA-256."""
    sampled: Callable[[Array], Trajectory] | None = field(default=None, repr=False)
    """The same motion at other times (T,) s, rising; None: it is simulated again."""
    stood: U16 = field(default_factory=lambda: np.zeros((0, 0), np.uint16), repr=False)
    """(H, W) of the photo, at t = 0: who stands where by ids, and `LEFT_OUT`; empty without a photo."""

    _shared: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    def shared(self, make: Callable[[Clip], T]) -> T:
        """`make(self)`, computed once for all formats that need it."""
        if make not in self._shared:
            self._shared[make] = make(self)
        found: T = self._shared[make]
        return found

    def amodal(self, view: View, thing: Presence) -> AmodalBox:
        """All of a body as if the picture went on beyond its borders."""
        return amodal_box(self.extents[thing.body], view.poses[thing.body], view.lens, view.size, thing)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the bodies, in the order of their ids."""
        return tuple(body.name for body in self.world.bodies)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """What each body is called in words; its name where nobody said."""
        return tuple(item.label or item.name for item in self.scene.objects)

    @cached_property
    def categories(self) -> tuple[str, ...]:
        """The labels, each once, in the order of the alphabet."""
        return tuple(sorted(set(self.labels)))

    @cached_property
    def classes(self) -> tuple[int, ...]:
        """Of each body the place of its label among the categories, from 1 on."""
        numbers = {name: number for number, name in enumerate(self.categories, 1)}
        return tuple(numbers[label] for label in self.labels)


def starting_labels(labels: U16, photo: U16 | None, scenery: Mask) -> U16:
    """`Clip.stood`, of the scene's labels (H, W), those of the photo, and pixels that show a boundary."""
    if photo is None:
        return labels
    return np.where((photo > 0) & (labels == 0) & ~scenery, np.uint16(OMITTED), labels)


class ViewBuilder:
    """Frames one after the other -> their views."""

    def __init__(self, trajectory: Trajectory, samples: Sequence[int], shot: Shot) -> None:
        """`samples` tells of each frame the sample of `trajectory` whose moment it shows."""
        self._trajectory, self._samples, self._shot = trajectory, samples, shot
        self._spaces = in_space(trajectory.turns) if trajectory.turns.size else None
        self._count = 0

    def seen(self, frame: Frame) -> View:
        """The view of the next frame."""
        index, self._count = self._count, self._count + 1
        sample = self._samples[index]
        return View(
            index,
            float(self._trajectory.times[sample]),
            frame.rgb,
            frame.ids,
            self._shot.affine(frame.time),
            self._trajectory.poses[sample],
            None if self._spaces is None else self._spaces[sample],
            lambda: frame.covers,
        )


# ----------------------------------------------------------------------
# Two views -> where each pixel of the one is in the other: optical flow, exact from poses, and what hides it.

F32 = NDArray[np.float32]

NOWHERE = OMITTED
"""Stands for what is out of the picture: no body has this id."""


@dataclass(frozen=True)
class Flow:
    """From one view to another; H, W."""

    moved: F32
    """(H, W, 2) px: x and y by which what a pixel shows has moved, also where that is hidden or out of the picture."""
    inside: Mask
    """(H, W): it is still in the picture."""
    visible: Mask
    """(H, W): it is in the picture, and nothing hides it."""
    moving: Sequence[Slices] | None = None
    """Beyond these boxes nothing moves; None: nobody has looked."""


def flow(view: View, other: View, world: World) -> Flow:
    """What each pixel of `view` shows, found again in `other`."""
    found = _background(view, other)
    if not np.array_equal(view.lens, other.lens):
        for body, box in view.boxes.items():
            _fill(found, body, box, view, other, world)
        return found
    moving = {body: box for body, box in view.boxes.items() if not is_still(body, view, other)}
    for body, box in moving.items():
        _fill(found, body, box, view, other, world)
    return replace(found, moving=tuple(moving.values()))


def _background(view: View, other: View) -> Flow:
    """As if all were background, which moves with the camera alone: rows and columns apart."""
    width, height = view.size
    moved = np.zeros((height, width, 2), np.float32)
    m, n = similarity(-1, view, other)
    if (m, n) == (1, 0):
        return Flow(moved, np.ones((height, width), bool), np.asarray(view.ids == other.ids))
    x, y = np.arange(width), np.arange(height)
    to_x, to_y = m.real * x + n.real, m.real * y + n.imag
    moved[..., 0], moved[..., 1] = to_x - x, (to_y - y)[:, None]
    column, row = np.rint(to_x).astype(np.int64), np.rint(to_y).astype(np.int64)
    there = other.ids.take(column.clip(0, width - 1), 1).take(row.clip(0, height - 1), 0)
    inside = ((row >= 0) & (row < height))[:, None] & (column >= 0) & (column < width)
    return Flow(moved, inside, inside & (there == view.ids))


def _fill(found: Flow, body: int, box: Slices, view: View, other: View, world: World) -> None:
    """What is seen of a body in `box` is the body's."""
    x, y = spans(box)
    hidden: Mask | None = None
    if turns_in_space(body, view, world) and other.spaces is not None:
        to_x, to_y, hidden = Ball.between(body, view, other, world).carried(x, y)
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
        other.ids, *where, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=NOWHERE
    )
    inside, visible = there != NOWHERE, there == body + 1
    if hidden is not None:
        visible &= ~hidden
    np.copyto(found.inside[box], inside, where=mine)
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
    """Views one after the other -> each between its neighbours, a view later; three are held."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._before: View | None = None
        self._view: View | None = None

    def put(self, after: View) -> Moment | None:
        """The view before the one that is put, with its neighbours; None after the first."""
        moment = None if self._view is None else Moment(self._world, self._before, self._view, after)
        self._before, self._view = self._view, after
        return moment

    def end(self) -> Moment | None:
        """The last one."""
        view, self._view = self._view, None
        return None if view is None else Moment(self._world, self._before, view, None)


# ----------------------------------------------------------------------
# A scene -> what its pixels, grams and seconds are in SI units, where somebody has said how large it is.

ASSUMED = "assumed"
"""Nobody has said; 100 px/m, which gravity is reckoned with, is the paper's convention and no measurement."""


@dataclass(frozen=True)
class Scale:
    """Pixels by metres."""

    pixels_per_meter: float
    source: str
    """Who said so: `written`, or `ASSUMED`."""

    @classmethod
    def of(cls, scene: Scene) -> Scale:
        """As the scene has it, by its file, a variant or `--set`."""
        written = "world.pixels_per_meter" in scene.places
        return cls(scene.world.pixels_per_meter, "written" if written else ASSUMED)

    @property
    def known(self) -> bool:
        """Whether lengths in metres mean something."""
        return self.source != ASSUMED

    def meters(self, px: float) -> float | None:
        """m, of px; m/s, of px/s; None where the scale is not known."""
        return px / self.pixels_per_meter if self.known else None

    def newton_seconds(self, impulse: float) -> float | None:
        """N·s of g·px/s; N of g·px/s²."""
        return impulse / 1000 / self.pixels_per_meter if self.known else None

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {"pixels_per_meter": self.pixels_per_meter, "from": self.source}
