"""World and camera -> maps of the pushes in each frame, for models that are told of forces.

Pushes are those of the scene; and since a still photo shows no motion, what moves when the clip starts is told as the
impulse that would set it moving so.
"""

from __future__ import annotations

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
NEAREST, FARTHEST = 1 / 8, 1 / 2
"""Of the picture's width: how far the blob of no impulse would go, and how far that of the clip's strongest goes."""
ZERO, FULL = 32768, 32767
"""Codes of a map: nothing, and by how much more the clip's largest is."""


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

    def given(self, begin: float, end: float) -> tuple[Array, float]:
        """g·px/s and g·px²/s that it gives from `begin` until `end`, s."""
        if self.end is None:
            part = float(begin <= self.start < end)
        else:
            part = max(0.0, min(self.end, end) - max(self.start, begin))
        return self.vector * part, self.turn * part

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
        self._shoves, self._size = shoves(world), size
        step = float(times[1] - times[0]) if len(times) > 1 else world.duration
        self._step = step
        spans = [(float(time), float(time) + step) for time in times]
        given = [[shove.given(*span) for shove in self._shoves] for span in spans]
        self.most = max((sum(float(np.hypot(*v)) for v, _ in row) for row in given), default=0.0)
        """g·px/s: of all pushes of a frame together, at most."""
        self.most_turn = max((sum(abs(turn) for _, turn in row) for row in given), default=0.0)
        """g·px²/s."""

    def idle(self, time: float) -> bool:
        """Whether nothing pushes in a frame at `time` (s)."""
        given = (shove.given(time, time + self._step) for shove in self._shoves)
        return not any(vector.any() or turn for vector, turn in given)

    def channels(self, time: float, poses: Array, lens: Array) -> NDArray[np.uint16]:
        """(H, W, 3): impulse to the right, impulse down, turn clockwise, of a frame at `time` (s); see ZERO and FULL.

        A push is a Gaussian blob, at its middle as high as what it gives; those of several add up.
        """
        width, height = self._size
        total = np.zeros((height, width, 3), np.float32)
        for shove in self._shoves:
            vector, turn = shove.given(time, time + self._step)
            high = [*(vector / (self.most or 1.0)).tolist(), turn / (self.most_turn or 1.0)]
            if any(high):
                blob = gaussian(lens @ [*shove.place(poses[shove.body]), 1.0], self._size)
                total += blob[..., None] * np.array(high, np.float32)
        return (np.rint(total * FULL) + ZERO).astype(np.uint16)


class Blobs:
    """The moving blob of Force Prompting (Gillman et al. 2025, the local force model), one for each push.

    It starts where the push acts, in the first frame that shows it, and goes straight on in its direction, equally far
    in each frame, to the last one: the farther, the stronger the push.
    """

    def __init__(self, world: World, times: Array, size: tuple[int, int]) -> None:
        """`times` (F,) s of the frames, in the order in which they are played."""
        self._size, self._count = size, len(times)
        pushed = [shove for shove in shoves(world) if shove.vector.any()]
        strong = [float(np.hypot(*_whole(shove))) for shove in pushed]
        self._most = max(strong, default=0.0)
        self._pushed = [
            (shove, int(np.argmax(times >= shove.start - 1e-9)), strength / self._most)
            for shove, strength in zip(pushed, strong, strict=True)
            if strength and (times >= shove.start - 1e-9).any()
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
            total += gaussian(self._starts[n] + way * far * part, self._size)
        return np.asarray(np.rint(np.minimum(total, 1) * 255), np.uint8)


def _whole(shove: Shove) -> Array:
    """(2,) g·px/s that it gives in all."""
    return shove.vector * (1.0 if shove.end is None else shove.end - shove.start)


def gaussian(at: Array, size: tuple[int, int]) -> F32:
    """(H, W): 1 at a place (2,) px."""
    spread = 2 * (size[0] / WIDE) ** 2
    x, y = np.arange(size[0]) - at[0], np.arange(size[1]) - at[1]
    return np.outer(np.exp(-(y**2) / spread), np.exp(-(x**2) / spread)).astype(np.float32)


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
