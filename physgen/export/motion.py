"""Two views -> where each pixel of the one is in the other: optical flow, exact from poses, and what hides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import World
from physgen.export.places import Ball, is_still, similarity, spans, turns_in_space
from physgen.export.truth import LEFT_OUT, View
from physgen.render.placing import Slices

Array = NDArray[np.float64]
F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

NOWHERE = LEFT_OUT
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
