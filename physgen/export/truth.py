"""Frames, trajectory and camera -> views: what is true of each picture of a clip, one at a time.

Video px are those of the frames, photo px those of the scene; pixel centres are whole numbers in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.extent import Extent
from physgen.export.pictures import jpeg, png
from physgen.export.presence import Presence, presences
from physgen.export.uncut import Uncut, uncut
from physgen.percepts.maps import Percepts
from physgen.render.placing import Slices
from physgen.render.shot import Shot
from physgen.render.stage import Cover, Frame
from physgen.scene.model import Scene
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.turning import matrix as in_space

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
T = TypeVar("T")


LEFT_OUT = 65535
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

    def amodal(self, view: View, thing: Presence) -> Uncut:
        """All of a body as if the picture went on beyond its borders."""
        return uncut(self.extents[thing.body], view.poses[thing.body], view.lens, view.size, thing)

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


def stood(labels: U16, photo: U16 | None, scenery: Mask) -> U16:
    """`Clip.stood`, of the scene's labels (H, W), those of the photo, and pixels that show a boundary."""
    if photo is None:
        return labels
    return np.where((photo > 0) & (labels == 0) & ~scenery, np.uint16(LEFT_OUT), labels)


class Eye:
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
