"""World and camera -> maps of the pushes in each frame, for models that are told of forces.

Pushes are those of the scene; and since a still photo shows no motion, what moves when the clip starts is told as the
impulse that would set it moving so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.geometry import rotation
from physgen.scene.model import Load, Motion

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

WIDE = 36
"""Widths of the picture by standard deviations of a blob: that of Force Prompting, 20 px of 720."""
REACH = 6.0
"""Standard deviations beyond which a blob is nothing: 1.5e-8 of its middle."""
NEAREST, FARTHEST = 1 / 8, 1 / 2
"""Of the picture's width: how far the blob of no impulse would go, and how far that of the clip's strongest goes."""
ZERO, FULL = 32768, 32767
"""Codes of a map: nothing, and by how much more the clip's largest is."""
NOTHING = 1e-9
"""s: a push at a frame's moment is that frame's, though 3 x 0.1 is more than 0.3."""


@dataclass(frozen=True)
class Shove:
    """One push."""

    body: int
    what: str
    """`impulse`, `force`, `torque`, or `velocity`: the motion that the clip starts with, as an impulse."""
    vector: Array
    """(2,) g·px/s, of a force g·px/s²."""
    turn: float
    """g·px²/s, of a force or torque g·px²/s²: about the centre of mass, what the vector does by its arm not counted."""
    at: Array
    """(2,) px in the body's frame."""
    start: float
    """s of the motion."""
    end: float | None
    """s; None: it is given at once."""

    def parts(self, times: Array) -> Array:
        """(T,): where an impulse is given 1, of a force s that it acts, from each of `times` (T + 1,) to the next.

        Each moment of it counts once; before the first and after the last there is nothing.
        """
        if self.end is None:
            at = int(np.searchsorted(times, self.start + NOTHING, side="right")) - 1
            return np.asarray(np.arange(len(times) - 1) == at, np.float64)
        return np.diff(np.clip(times, self.start, self.end))

    def place(self, pose: Array) -> Array:
        """(2,) px of the photo where it acts on a body at a pose (3,)."""
        return np.asarray(pose[:2] + rotation(float(pose[2])) @ self.at)


def shoves(world: World) -> list[Shove]:
    """In the order of the scene, the motion at t = 0 last."""
    found = []
    for push in world.pushes:
        if world.bodies[push.body].motion is Motion.DYNAMIC and push.start < world.duration:
            once = push.load is Load.IMPULSE
            end = None if once else min(push.end, world.duration)
            what = push.load.value
            found.append(Shove(push.body, what, push.vector, push.torque, push.at, push.start, end))
    for k, body in enumerate(world.bodies):
        if body.motion is Motion.DYNAMIC and (body.velocity.any() or body.spin) and isfinite(body.mass):
            found.append(_started(k, body))
    return found


def _started(k: int, body: Body) -> Shove:
    return Shove(k, "velocity", body.mass * body.velocity, body.moment * body.spin, np.zeros(2), 0.0, None)


class ForceMaps:
    """Of each frame: what the pushes give until the next one, drawn where they act."""

    def __init__(self, world: World, times: Array, size: tuple[int, int]) -> None:
        """`times` (T,) s of the motion at which frames can be; `size` of the picture, px."""
        self._shoves, self._size, self._times = shoves(world), size, times
        step = float(times[1] - times[0]) if len(times) > 1 else world.duration
        edges = np.append(times, times[-1] + step)
        parts = [shove.parts(edges).tolist() for shove in self._shoves]
        given = [
            [(s.vector * part, s.turn * part) for s, part in zip(self._shoves, row, strict=True)]
            for row in zip(*parts, strict=True)
        ] or [[] for _ in times]
        self._given: list[list[tuple[Array, float]]] = given
        self.most = max((sum(float(np.hypot(*v)) for v, _ in row) for row in given), default=0.0)
        """g·px/s: of all pushes of a frame together, at most."""
        self.most_turn = max((sum(abs(turn) for _, turn in row) for row in given), default=0.0)
        """g·px²/s."""

    def idle(self, time: float) -> bool:
        """Whether nothing pushes in a frame at `time` (s)."""
        return not any(vector.any() or turn for vector, turn in self._at(time))

    def channels(self, time: float, poses: Array, lens: Array) -> NDArray[np.uint16]:
        """(H, W, 3): impulse to the right, impulse down, turn clockwise, of a frame at `time` (s); see ZERO and FULL.

        A push is a Gaussian blob, at its middle as high as what it gives; those of several add up.
        """
        width, height = self._size
        total = np.zeros((height, width, 3), np.float32)
        for shove, (vector, turn) in zip(self._shoves, self._at(time), strict=True):
            high = [*(vector / (self.most or 1.0)).tolist(), turn / (self.most_turn or 1.0)]
            if any(high):
                blot(total, lens @ [*shove.place(poses[shove.body]), 1.0], np.array(high, np.float32))
        return (np.rint(total * FULL) + ZERO).astype(np.uint16)

    def _at(self, time: float) -> list[tuple[Array, float]]:
        """What each push gives from the frame at a time (s) to the next sample: g·px/s and g·px²/s."""
        sample = int(np.searchsorted(self._times, time + NOTHING, side="right")) - 1
        return self._given[max(sample, 0)]


class Blobs:
    """The moving blob of Force Prompting (Gillman et al. 2025, the local force model), one for each push.

    It starts where the push acts, in the first frame that shows it, and goes straight on in its direction, equally far
    in each frame, to the last one: the farther, the stronger the push.
    """

    def __init__(
        self, world: World, frame: Callable[[float], int], count: int, size: tuple[int, int]
    ) -> None:
        """`frame` tells which of the clip's `count` frames shows what begins at a time (s of the motion)."""
        self._size, self._count = size, count
        pushed = [shove for shove in shoves(world) if shove.vector.any()]
        strong = [float(np.hypot(*_whole(shove))) for shove in pushed]
        self._most = max(strong, default=0.0)
        self._pushed = [
            (shove, frame(shove.start), strength / self._most)
            for shove, strength in zip(pushed, strong, strict=True)
            if strength
        ]
        self._starts: dict[int, Array] = {}

    @property
    def most(self) -> float:
        """g·px/s: of the strongest push, whose blob goes half of the picture's width."""
        return self._most

    def picture(self, frame: int, poses: Array, lens: Array) -> NDArray[np.uint8]:
        """(H, W) of a frame; to be asked for one after the other, since a blob begins where things are then."""
        width, height = self._size
        total = np.zeros((height, width), np.float32)
        for n, (shove, first, share) in enumerate(self._pushed):
            if frame < first:
                continue
            if n not in self._starts:
                self._starts[n] = lens @ [*shove.place(poses[shove.body]), 1.0]
            way = shove.vector / np.hypot(*shove.vector)
            far = width * (NEAREST + (FARTHEST - NEAREST) * share)
            part = (frame - first) / max(self._count - 1 - first, 1)
            blot(total, self._starts[n] + way * far * part)
        return np.asarray(np.rint(np.minimum(total, 1) * 255), np.uint8)


def _whole(shove: Shove) -> Array:
    """(2,) g·px/s that it gives in all."""
    return shove.vector * (1.0 if shove.end is None else shove.end - shove.start)


def blot(picture: F32, at: Array, high: float | F32 = 1.0) -> None:
    """Adds a Gaussian to (H, W), or (H, W, C) with `high` (C,): at its middle, a place (2,) px, it is `high`."""
    height, width = picture.shape[:2]
    sigma = width / WIDE
    first = np.clip(np.floor(at - REACH * sigma), 0, (width, height)).astype(np.int64)
    last = np.clip(np.ceil(at + REACH * sigma) + 1, 0, (width, height)).astype(np.int64)
    across, down = (
        np.exp(-((np.arange(*span) - middle) ** 2) / (2 * sigma**2))
        for *span, middle in zip(first, last, at, strict=True)
    )
    blob = np.outer(down, across).astype(np.float32)
    box = picture[first[1] : last[1], first[0] : last[0]]
    box += blob * high if picture.ndim == 2 else blob[..., None] * high


def told(shove: Shove, world: World) -> dict[str, Any]:
    """As JSON."""
    about: dict[str, Any] = {"object": world.bodies[shove.body].name, "is": shove.what, "start": shove.start}
    if shove.end is not None:
        about["end"] = shove.end
    unit = "impulse" if shove.end is None else "force"
    if shove.vector.any():
        about[unit] = shove.vector.tolist()
    if shove.turn:
        about["turn" if shove.end is None else "torque"] = shove.turn
    return about | {"place": (world.bodies[shove.body].center + shove.at).tolist()}
