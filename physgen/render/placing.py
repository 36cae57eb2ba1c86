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


def placed(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None
) -> Placement | None:
    """Where the sprite falls on a canvas of `size` (W, H); None when outside. `space` (3, 3): a ball's turn so far."""
    height, width = sprite.coverage.shape
    x0, y0 = sprite.corner
    turn = pose.angle - start.angle
    rolled = sprite.ball is not None and space is not None and not (space == np.eye(3)).all()
    if turn == 0.0 and pose[:2] == start[:2] and not rolled:  # at rest: the photo's own pixels
        left, top = max(-x0, 0), max(-y0, 0)
        right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
        if left >= right or top >= bottom:
            return None
        return Placement(np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right], np.s_[top:bottom, left:right])
    if sprite.ball is not None:  # the picture of a ball moves without turning: its skin alone turns
        if space is None:
            space = np.pad(rotation(turn), ((0, 1), (0, 1))) + np.diag([0.0, 0, 1])
        turn = 0.0
    c, s = cos(turn), sin(turn)
    if not sprite.hull:
        return None
    shift = pose.x - start.x, pose.y - start.y
    if turn == 0.0:
        lx, ly = x0 + shift[0], y0 + shift[1]
        hx, hy = lx + width - 1, ly + height - 1
        moved_by = max(abs(shift[0]), abs(shift[1]))
    else:
        moved_by = 0.0
        lx = ly = inf
        hx = hy = -inf
        for x, y in sprite.hull:  # a dozen points: quicker by hand
            dx, dy = x - start.x, y - start.y
            nx, ny = c * dx - s * dy + pose.x, s * dx + c * dy + pose.y
            lx, hx, ly, hy = min(lx, nx), max(hx, nx), min(ly, ny), max(hy, ny)
            moved_by = max(moved_by, abs(nx - x), abs(ny - y))
        lx, hx, ly, hy = lx - SPREAD, hx + SPREAD, ly - SPREAD, hy + SPREAD
    if not isfinite(lx + hx + ly + hy) or hx < 0 or hy < 0 or lx >= size[0] or ly >= size[1]:
        return None
    left, top = max(floor(lx), 0), max(floor(ly), 0)
    right, bottom = min(ceil(hx) + 1, size[0]), min(ceil(hy) + 1, size[1])
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    dx, dy = left - pose.x, top - pose.y
    matrix = np.array([[c, s, c * dx + s * dy + start.x - x0], [-s, c, c * dy - s * dx + start.y - y0]])
    return Placement(
        np.s_[top:bottom, left:right],
        matrix=matrix,
        turn=turn,
        space=space if sprite.ball is not None else None,
        shift=shift,
        rest=max(0.0, 1 - moved_by / FADE),
    )


def drawn(sprite: Sprite, where: Placement, fine: int = 1) -> tuple[F32, F32, F32 | None]:
    """(h, w, 3) linear light times coverage, coverage (h, w), and the share of `Sprite.rest`, on its box.

    Where it moved, each pixel is the mean of `fine` x `fine` samples.
    """
    if where.own is not None:
        own = where.own
        return sprite.light[own], sprite.coverage[own], None if sprite.rest is None else sprite.rest[own]
    assert where.matrix is not None
    rows, columns = where.box
    size = (columns.stop - columns.start, rows.stop - rows.start)
    many = (size[0] * fine, size[1] * fine)
    picture = sprite.fine if sprite.ball is None else sprite.fine_still  # two samples a pixel
    matrix = _finer(where.matrix, fine)
    warped = cv2.warpAffine(picture, 2 * matrix, many, flags=HOW, borderMode=cv2.BORDER_CONSTANT)
    light = np.asarray(cv2.cvtColor(warped, cv2.COLOR_BGRA2BGR), np.float32)  # the first three channels
    coverage = np.asarray(np.clip(cv2.extractChannel(warped, 3), 0.0, 1.0), np.float32)
    if sprite.relief is not None and where.turn != 0.0:
        ratio = sprite.relief.ratio(where.turn)
        there = cv2.warpAffine(ratio, matrix, many, flags=HOW, borderMode=cv2.BORDER_REPLICATE)
        light *= thrice(np.asarray(there, np.float32))
    if sprite.ball is not None and where.space is not None:
        center = sprite.ball.center[0] + where.shift[0], sprite.ball.center[1] + where.shift[1]
        skin = sprite.ball.seen(center, where.space, size, (columns.start, rows.start), fine)
        skin *= thrice(coverage)
        light += skin
    if fine > 1:
        light = np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), np.float32)
        coverage = np.asarray(cv2.resize(coverage, size, interpolation=cv2.INTER_AREA), np.float32)
    rest = None
    if sprite.rest is not None and where.rest > 0:
        border = cv2.warpAffine(sprite.rest, where.matrix, size, flags=HOW, borderMode=cv2.BORDER_CONSTANT)
        rest = np.asarray(np.float32(where.rest) * border, np.float32)
    return light, np.asarray(coverage, np.float32), rest


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
    return np.asarray(np.clip(warped, 0.0, 1.0), np.float32)


def _finer(matrix: Array, fine: int) -> Array:
    """(2, 3) from the pixels of a grid `fine` times as fine, where `matrix` is from the pixels."""
    into = np.array([[1, 0, 0.5 - fine / 2], [0, 1, 0.5 - fine / 2], [0, 0, fine]]) / fine
    return matrix @ into if fine > 1 else matrix


def thrice(values: F32) -> F32:
    """(h, w) -> (h, w, 3): a picture's own shape, which NumPy multiplies far faster than it broadcasts."""
    return np.asarray(cv2.merge((values, values, values)), np.float32)
