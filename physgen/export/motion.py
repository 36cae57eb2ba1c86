"""Two views -> where each pixel of the one is in the other: optical flow, exact from poses, and what hides it.

A body's pixels move with its pose; those of a ball on a table turn with it in space; the background moves with the
camera alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.export.truth import View
from physgen.scene.model import Solid

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Flow:
    """From one view to another; H, W."""

    moved: NDArray[np.float32]
    """(H, W, 2) px: x and y by which what a pixel shows has moved, also where that is hidden or out of the picture."""
    inside: Mask
    """(H, W): it is still in the picture."""
    visible: Mask
    """(H, W): it is in the picture, and nothing hides it."""


def flow(view: View, other: View, world: World) -> Flow:
    """What each pixel of `view` shows, found again in `other`."""
    width, height = view.size
    moved = np.zeros((height, width, 2), np.float32)
    hidden = np.zeros((height, width), bool)
    for body, box in _boxes(view, other):
        mine = view.ids[box] == body + 1
        rows, columns = np.nonzero(mine)
        points = np.column_stack([columns + box[1].start, rows + box[0].start]).astype(np.float64)
        there, back = carried(points, body, view, other, world)
        # to a multiple of 1/2^20 px, so that what is at rest is at rest
        moved[box][mine] = np.round((there - points) * 2**20) / 2**20
        hidden[box][mine] = back
    y, x = np.arange(height, dtype=np.float32)[:, None], np.arange(width, dtype=np.float32)
    column, row = np.rint(moved[..., 0] + x), np.rint(moved[..., 1] + y)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    place = np.where(inside, row * width + column, 0).astype(np.int64)
    found = other.ids.ravel().take(place)
    return Flow(moved, inside, inside & ~hidden & (found == view.ids))


def _boxes(view: View, other: View) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """Bodies in the picture, -1 the background where the camera moves, and the rows and columns that hold them."""
    for number, box in enumerate(boxes(view.ids)):
        if box is not None:
            yield number, box
    if not np.array_equal(view.lens, other.lens):
        yield -1, (slice(0, view.size[1]), slice(0, view.size[0]))


def boxes(ids: NDArray[np.uint16]) -> list[tuple[slice, slice] | None]:
    """Rows and columns that hold each id from 1 on; None where there is none of it."""
    from cv2 import boundingRect

    found: list[tuple[slice, slice] | None] = []
    for id_ in range(1, int(ids.max(initial=0)) + 1):
        x, y, w, h = boundingRect((ids == id_).astype(np.uint8))
        found.append((slice(y, y + h), slice(x, x + w)) if w else None)
    return found


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


class Line:
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


def carried(points: Array, body: int, view: View, other: View, world: World) -> tuple[Array, Mask]:
    """Points (K, 2) video px of a `body` of `view`, -1 the background, in px of `other`; which are on its back."""
    photo = _undone(view.lens, points)
    hidden = np.zeros(len(points), bool)
    if body >= 0:
        thing = world.bodies[body]
        if view.spaces is not None and other.spaces is not None and is_ball(thing):
            photo, hidden = _rolled(photo, thing, view, other, body)
        else:
            photo = _placed(_unplaced(photo, view.poses[body]), other.poses[body])
    return photo @ other.lens[:, :2].T + other.lens[:, 2], hidden


def is_ball(body: Body) -> bool:
    """Whether it turns in space."""
    return body.radius is not None and body.solid is Solid.SPHERE


def _undone(lens: Array, points: Array) -> Array:
    """Video px -> photo px."""
    return np.asarray(np.linalg.solve(lens[:, :2], (points - lens[:, 2]).T).T)


def _turned(angle: float) -> Array:
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])


def _unplaced(points: Array, pose: Array) -> Array:
    """Photo px -> px in the frame of a body."""
    return np.asarray((points - pose[:2]) @ _turned(pose[2]))


def _placed(points: Array, pose: Array) -> Array:
    """The inverse of `_unplaced`."""
    return np.asarray(points @ _turned(pose[2]).T + pose[:2])


def _rolled(points: Array, ball: Body, view: View, other: View, body: int) -> tuple[Array, Mask]:
    """Points of a ball that turned in space, seen from straight above; and which of them are underneath now."""
    assert ball.radius is not None
    assert view.spaces is not None
    assert other.spaces is not None
    flat = (points - view.poses[body][:2]) / ball.radius
    far = np.hypot(*flat.T)
    flat /= np.maximum(far, 1.0)[:, None]  # what a mask has beyond the rim goes with the rim
    normals = np.column_stack([flat, -np.sqrt(np.maximum(1 - (flat**2).sum(axis=1), 0))])
    turned = normals @ (other.spaces[body] @ view.spaces[body].T).T
    beyond = (points - view.poses[body][:2]) - flat * ball.radius
    return other.poses[body][:2] + ball.radius * turned[:, :2] + beyond, turned[:, 2] > 0
