"""Sprite + pose -> where on the canvas its pixels come from, and those pixels; geometry apart from pixels."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, floor, inf, isfinite, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose, rotation
from physgen.render.sprites import Sprite

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
Slices = tuple[slice, slice]

FADE = 3.0
"""px of motion over which the photo's own border pixels give way to the object's clean ones."""
SPREAD = 1.5
"""px beyond its pixels that a warped picture may reach."""
HOW = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Placement:
    """Where a sprite falls on the canvas."""

    box: Slices
    """Rows and columns of the canvas."""
    own: Slices | None = None
    """At rest: the same on the sprite, whose pixels are then the photo's."""
    matrix: Array | None = None
    """(2, 3) Moved: pixel of the box -> pixel of the sprite."""
    turn: float = 0.0
    """rad by which the sprite's picture turns."""
    space: Array | None = None
    """(3, 3) A ball: how its skin has turned."""
    shift: tuple[float, float] = (0.0, 0.0)
    """px by which the centre has moved."""
    rest: float = 0.0
    """Share of the photo's own border pixels that still shows."""
    border: Slices | None = None
    """The box of those, where it is wider than `box`."""


def placed(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None
) -> Placement | None:
    """Where the sprite falls on a canvas of `size` (W, H); None when outside.

    `space` (3, 3): a ball's turn so far; None where it has none, or only the angle tells.
    """
    x0, y0 = sprite.corner
    turn = pose.angle - start.angle
    if turn == 0.0 and pose[:2] == start[:2] and (sprite.ball is None or space is None):
        height, width = sprite.coverage.shape  # at rest: the photo's own pixels
        left, top = max(-x0, 0), max(-y0, 0)
        right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
        if left >= right or top >= bottom:
            return None
        return Placement(np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right], np.s_[top:bottom, left:right])
    if not sprite.hull:
        return None
    if sprite.ball is not None:
        return _rolled(sprite, start, pose, size, space)
    c, s = cos(turn), sin(turn)
    moved_by = 0.0
    lx = ly = inf
    hx = hy = -inf
    for x, y in sprite.hull:  # a dozen points: quicker by hand
        dx, dy = x - start.x, y - start.y
        nx, ny = c * dx - s * dy + pose.x, s * dx + c * dy + pose.y
        lx, hx, ly, hy = min(lx, nx), max(hx, nx), min(ly, ny), max(hy, ny)
        moved_by = max(moved_by, abs(nx - x), abs(ny - y))
    box = _boxed(lx - SPREAD, ly - SPREAD, hx + SPREAD, hy + SPREAD, size)
    if box is None:
        return None
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    dx, dy = box[1].start - pose.x, box[0].start - pose.y
    matrix = np.array([[c, s, c * dx + s * dy + start.x - x0], [-s, c, c * dy - s * dx + start.y - y0]])
    return Placement(box, matrix=matrix, turn=turn, rest=max(0.0, 1 - moved_by / FADE))


def _rolled(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None
) -> Placement | None:
    """`placed` of a ball: its picture moves without turning, its skin alone turns."""
    if space is None:
        space = np.eye(3)
        space[:2, :2] = rotation(pose.angle - start.angle)
    dx, dy = pose.x - start.x, pose.y - start.y
    lx, ly, hx, hy = sprite.within
    x, y = sprite.corner[0] + dx, sprite.corner[1] + dy
    box = _boxed(x + lx - 1, y + ly - 1, x + hx, y + hy, size)
    if box is None:
        return None
    matrix = np.array([[1.0, 0, box[1].start - x], [0, 1, box[0].start - y]])
    rest = max(0.0, 1 - max(abs(dx), abs(dy)) / FADE)
    height, width = sprite.coverage.shape
    border = _boxed(x, y, x + width - 1, y + height - 1, size) if rest > 0 else None
    return Placement(box, None, matrix, 0.0, space, (dx, dy), rest, border)


def _boxed(lx: float, ly: float, hx: float, hy: float, size: tuple[int, int]) -> Slices | None:
    """The pixels of a canvas of `size` (W, H) between two corners; None where there are none."""
    if not isfinite(lx + hx + ly + hy) or hx < 0 or hy < 0 or lx >= size[0] or ly >= size[1]:
        return None
    rows = slice(max(floor(ly), 0), min(ceil(hy) + 1, size[1]))
    return rows, slice(max(floor(lx), 0), min(ceil(hx) + 1, size[0]))


def drawn(sprite: Sprite, where: Placement, fine: int = 1) -> tuple[F32, F32]:
    """(h, w, 3) linear light times coverage, and coverage (h, w), on its box; of anything but a ball that moved.

    Where it moved, each pixel is the mean of `fine` x `fine` samples.
    """
    if where.own is not None:
        return sprite.light[where.own], sprite.coverage[where.own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    many = (size[0] * fine, size[1] * fine)
    matrix = _finer(where.matrix, fine)
    warped = cv2.warpAffine(sprite.fine, 2 * matrix, many, flags=HOW, borderMode=cv2.BORDER_CONSTANT)
    light = np.asarray(cv2.cvtColor(warped, cv2.COLOR_BGRA2BGR), np.float32)  # the first three channels
    coverage = np.asarray(cv2.extractChannel(warped, 3), np.float32)
    if sprite.relief is not None and where.turn != 0.0:
        ratio = sprite.relief.ratio(where.turn)
        there = cv2.warpAffine(ratio, matrix, many, flags=HOW, borderMode=cv2.BORDER_REPLICATE)
        light *= thrice(np.asarray(there, np.float32))
    if fine > 1:
        light = np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), np.float32)
        coverage = np.asarray(cv2.resize(coverage, size, interpolation=cv2.INTER_AREA), np.float32)
    return light, coverage


def resting(sprite: Sprite, where: Placement) -> tuple[Slices, F32] | None:
    """A box and (h, w, 3) the share of `Sprite.rest` that still shows there; None: nothing."""
    if sprite.rest is None:
        return None
    if where.own is not None:
        return where.box, sprite.rest[where.own]
    if where.rest <= 0 or where.matrix is None:
        return None
    rows, columns = box = where.border or where.box
    matrix = where.matrix.copy()
    matrix[:, 2] += matrix[:, 0] * (columns.start - where.box[1].start)
    matrix[:, 2] += matrix[:, 1] * (rows.start - where.box[0].start)
    size = (columns.stop - columns.start, rows.stop - rows.start)
    border = cv2.warpAffine(sprite.rest, matrix, size, flags=HOW, borderMode=cv2.BORDER_CONSTANT)
    return box, np.asarray(np.float32(where.rest) * border, np.float32)


def covered(sprite: Sprite, where: Placement) -> F32:
    """(h, w) the coverage of `drawn` alone."""
    if where.own is not None:
        return sprite.coverage[where.own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    warped = cv2.warpAffine(
        sprite.fine_coverage, 2 * where.matrix, size, flags=HOW, borderMode=cv2.BORDER_CONSTANT
    )
    return np.asarray(warped, np.float32)


def _finer(matrix: Array, fine: int) -> Array:
    """(2, 3) from the pixels of a grid `fine` times as fine, where `matrix` is from the pixels."""
    into = np.array([[1, 0, 0.5 - fine / 2], [0, 1, 0.5 - fine / 2], [0, 0, fine]]) / fine
    return matrix @ into if fine > 1 else matrix


def thrice(values: F32) -> F32:
    """(h, w) -> (h, w, 3): a picture's own shape, which NumPy multiplies far faster than it broadcasts."""
    return np.asarray(cv2.merge((values, values, values)), np.float32)
