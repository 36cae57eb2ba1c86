"""What is drawn, and Trajectory -> how it stands at each moment: geometry alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose, rotation
from physgen.render.lit import Lit
from physgen.render.placing import Placement, Slices, placed
from physgen.render.sprites import Sprite
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.turning import matrix as in_space

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]


@dataclass(frozen=True)
class Cover:
    """Where a body is in a picture, what hides it taken away."""

    body: int
    box: Slices
    """Rows and columns of the picture that hold it."""
    mask: NDArray[np.bool_]
    """(h, w) on its box."""


@dataclass(frozen=True)
class Frame:
    """One picture of the video."""

    index: int
    time: float
    """s."""
    rgb: U8
    """(H, W, 3) sRGB."""
    named: Callable[[], U16] = field(repr=False, compare=False)
    """Works out `ids`: few ask."""
    covering: Callable[[], Sequence[Cover]] = field(default=tuple, repr=False, compare=False)
    """Works out `covers`."""

    @cached_property
    def ids(self) -> U16:
        """(H, W): body k shows as k + 1, 0 = background."""
        return self.named()

    @cached_property
    def covers(self) -> Sequence[Cover]:
        """Of things that reach into the picture, the farthest first; a body may be made of several."""
        return self.covering()


@dataclass(frozen=True)
class Actor:
    """What light has to know of a body: as its silhouette, see `shadow.Silhouette`."""

    radius: float | None
    """px, of a sphere."""
    thick: float
    """px."""
    veiled: float = 1.0
    """Share of the shadows of others that is seen on it, 0..1."""


@dataclass(frozen=True)
class Stage:
    """What is drawn: sprites in order, the farthest first, over a background `(H, W, 3)` sRGB."""

    background: U8
    sprites: Sequence[Sprite]
    lit: Lit | None = None
    """Where shadows move: the background taken apart, with a cast for each sprite in turn."""
    actors: Sequence[Actor] = ()
    """One a sprite, where there is `lit`."""
    grounds: Sequence[Array] = ()
    """Side view: (4,) px each, the two ends of what shadows fall on from above."""
    veils: Sequence[F32 | None] | None = None
    """One a sprite, on its box: -log of the light that the others leave on it at t = 0; None: nobody asks."""
    supersample: int = 1
    """Samples a pixel, along each side, of what moves."""
    starts: Sequence[Pose] = ()
    """One a body: the pose in which its sprite was cut out, where some are put elsewhere; empty: as at t = 0."""
    scale: float = 1.0
    """Canvas pixels a photo pixel: a scene without a photo is drawn as large as it is seen."""


@dataclass(frozen=True)
class Stand:
    """How a sprite stands in a frame."""

    k: int
    """Index into the stage's sprites."""
    start: Pose
    pose: Pose
    where: Placement | None
    """None: out of the picture."""


def planned(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[tuple[float, list[Stand]]]:
    """Time, s, of each sample in its `order` and how every sprite stands then: geometry alone."""
    if stage.scale != 1.0:
        trajectory = replace(trajectory, poses=_enlarged(trajectory.poses, stage.scale))
    size = (stage.background.shape[1], stage.background.shape[0])
    starts: Sequence[Pose] = stage.starts
    if not starts and len(trajectory.poses):
        starts = [Pose(*pose) for pose in trajectory.poses[0].tolist()]
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    turned = None if turns is None else (turns != np.eye(3)).any(axis=(2, 3))
    for sample in range(len(trajectory.times)) if order is None else order:
        poses = [Pose(*pose) for pose in trajectory.poses[sample].tolist()]
        stands = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = starts[sprite.body], poses[sprite.body]
            space = None
            if turns is not None and turned is not None and turned[sample, sprite.body]:
                space = turns[sample, sprite.body]
                if start.angle:  # it lies turned by as much at t = 0
                    space = space @ _about(-start.angle)
            stands.append(Stand(k, start, pose, placed(sprite, start, pose, size, space)))
        yield float(trajectory.times[sample]), stands


def _about(angle: float) -> Array:
    """(3, 3): a turn in the picture."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(angle)
    return turn


def _enlarged(poses: Array, scale: float) -> Array:
    """Poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    return np.concatenate([(poses[..., :2] + 0.5) * scale - 0.5, poses[..., 2:]], axis=-1)
