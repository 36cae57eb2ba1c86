"""Frames, trajectory and camera -> views: what is true of each picture of a clip, one at a time.

Video px are those of the frames, photo px those of the scene; pixel centres are whole numbers in both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.percepts.maps import Percepts
from physgen.render.placing import covered
from physgen.render.resample import nearest
from physgen.render.shot import Shot, on_canvas
from physgen.render.stage import Frame, Stage, Stand, planned
from physgen.scene.model import Scene
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.turning import matrix as in_space

if TYPE_CHECKING:
    from physgen.export.telling.story import Story

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]


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
    covering: Callable[[], Mapping[int, Mask]] = field(repr=False, compare=False)
    """Works out `amodal`."""

    @cached_property
    def amodal(self) -> Mapping[int, Mask]:
        """Body -> (H, W) where it is, what hides it taken away; those alone that reach into the picture."""
        return self.covering()

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
    size: tuple[int, int]
    """Width and height of the frames, px."""
    fps: float
    """1/s at which it plays."""
    count: int
    """Frames."""
    shot: Shot
    """Where the camera is at any time, and in which order the frames show the samples."""
    owners: U16
    """(H, W) of the photo: body k is k + 1, 0 = background; all 0 without a photo."""
    source: Mapping[str, str] = field(default_factory=dict)
    """What it was made of: paths and SHA-256."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the bodies, in the order of their ids."""
        return tuple(body.name for body in self.world.bodies)

    @property
    def labels(self) -> tuple[str, ...]:
        """What each body is called in words; its name where nobody said."""
        return tuple(item.label or item.name for item in self.scene.objects)

    @cached_property
    def story(self) -> Story:
        """What happens in it; worked out once for all formats that tell it."""
        from physgen.export.telling.story import story

        return story(self)

    @property
    def categories(self) -> tuple[str, ...]:
        """The labels, each once, in the order of the alphabet."""
        return tuple(sorted(set(self.labels)))


class Eye:
    """Frames one after the other -> their views."""

    def __init__(self, stage: Stage, trajectory: Trajectory, samples: Sequence[int], shot: Shot) -> None:
        """`samples` tells of each frame the sample of `trajectory` whose moment it shows."""
        self._stage, self._trajectory, self._samples, self._shot = stage, trajectory, samples, shot
        self._spaces = in_space(trajectory.turns) if trajectory.turns.size else None
        self._stood = planned(stage, trajectory, samples)
        self._count = 0

    def seen(self, frame: Frame) -> View:
        """The view of the next frame."""
        index, self._count = self._count, self._count + 1
        sample = self._samples[index]
        _, stands = next(self._stood)
        lens = self._shot.affine(frame.time)
        return View(
            index,
            float(self._trajectory.times[sample]),
            frame.rgb,
            frame.ids,
            lens,
            self._trajectory.poses[sample],
            None if self._spaces is None else self._spaces[sample],
            partial(_amodal, self._stage, stands, on_canvas(lens, self._stage.scale), frame),
        )


def _amodal(stage: Stage, stands: Sequence[Stand], matrix: Array, frame: Frame) -> dict[int, Mask]:
    """What is seen of a body belongs to it in any case."""
    height, width = stage.background.shape[:2]
    same = frame.ids.shape == (height, width) and np.array_equal(matrix, np.eye(2, 3))
    whole: dict[int, Mask] = {}
    for stand in stands:
        if stand.where is None:
            continue
        sprite = stage.sprites[stand.k]
        drawn = np.zeros((height, width), np.uint16)
        drawn[stand.where.box] = covered(sprite, stand.where) >= 0.5
        seen = drawn if same else nearest(drawn, matrix, (frame.ids.shape[1], frame.ids.shape[0]))
        whole[sprite.body] = (seen > 0) | whole.get(sprite.body, False)
    shown = np.unique(frame.ids)
    for body in (int(i) - 1 for i in shown if i):
        whole[body] = (frame.ids == body + 1) | whole.get(body, False)
    return {body: mask for body, mask in sorted(whole.items()) if mask.any()}
