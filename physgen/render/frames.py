"""World + Trajectory + sprites -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose, rotation
from physgen.photometry import decode, encode_u8
from physgen.render.lit import Lit, shaded
from physgen.render.sprites import Sprite
from physgen.shadow import Silhouette
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.turning import matrix as in_space

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]


FADE = 3.0
"""px of motion over which the photo's own border pixels give way to the object's clean ones."""


SUNK = 3.0
"""px by which a thing's pixels may reach below the floor that it stands on."""
TILE = 32
"""px a side of the tiles in which touched pixels are counted."""

Slices = tuple[slice, slice]


@dataclass(frozen=True)
class Frame:
    """One picture of the video."""

    index: int
    time: float
    """s."""
    rgb: U8
    """(H, W, 3) sRGB."""
    ids: U16
    """(H, W): body k shows as k + 1, 0 = background."""


@dataclass(frozen=True)
class Actor:
    """What light has to know of a body: as its silhouette, see `shadow.Silhouette`."""

    radius: float | None
    """px, of a sphere."""
    thick: float
    """px."""


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
    supersample: int = 1
    """Samples a pixel, along each side, of what moves."""
    scale: float = 1.0
    """Canvas pixels a photo pixel: a scene without a photo is drawn as large as it is seen."""


def ground_below(grounds: Sequence[Array], x: float, bottom: float) -> float | None:
    """The row, px, of the highest floor below a thing whose lowest point is at `bottom`."""
    rows = []
    for ax, ay, bx, by in grounds:
        if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
            row = ay + (by - ay) * (x - ax) / (bx - ax)
            if row >= bottom - SUNK:
                rows.append(float(row))
    return min(rows, default=None)


def render_frames(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each object's own box is warped, and only touched pixels are encoded again. What a frame shows does not depend on
    those before it; the photo's own poses are those of sample 0.
    """
    if stage.scale != 1.0:
        trajectory = replace(trajectory, poses=_enlarged(trajectory.poses, stage.scale))
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    centers = trajectory.poses[0] if len(trajectory.poses) else np.zeros((0, 3))
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    behind = decode(stage.background) if lit is None else lit.behind()
    dark = None if lit is None else lit.total.copy()
    canvas: F32 = behind.copy()
    touched: list[Slices] = []
    for index, sample in enumerate(range(len(trajectory.times)) if order is None else order):
        for box in touched:
            canvas[box] = behind[box]
            if dark is not None and lit is not None:
                dark[box] = lit.total[box]
        touched.clear()
        rgb = stage.background.copy()
        ids = np.zeros(rgb.shape[:2], np.uint16)
        placed = []
        changed: list[Slices] = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = Pose(*centers[sprite.body].tolist()), trajectory.pose(sample, sprite.body)
            turn = None if turns is None else turns[sample, sprite.body]
            there = _place(sprite, start, pose, size, turn, stage.supersample)
            still = start == pose and (turn is None or bool((turn == np.eye(3)).all()))
            placed.append((sprite, there))
            if lit is not None and dark is not None and not still:
                changed += _cast(stage, lit, dark, k, there, pose, start)
                changed.append(_own_box(sprite, size))
        if lit is not None and dark is not None and changed:
            for box in (union := _runs(changed, size)):
                canvas[box] = shaded(lit.plate[box], dark[box], lit.tint)
            touched += union
        for sprite, there in placed:
            if there is None:
                continue
            box, light, coverage = there
            canvas[box] = light + (1 - coverage[..., None]) * canvas[box]
            ids[box][coverage >= 0.5] = sprite.body + 1
            touched.append(box)
        for box in _runs(touched, size):
            rgb[box] = encode_u8(canvas[box])
        yield Frame(index, float(trajectory.times[sample]), rgb, ids)


def _enlarged(poses: Array, scale: float) -> Array:
    """Poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    return np.concatenate([(poses[..., :2] + 0.5) * scale - 0.5, poses[..., 2:]], axis=-1)


def _cast(
    stage: Stage, lit: Lit, dark: F32, k: int, there: tuple[Slices, F32, F32] | None, pose: Pose, start: Pose
) -> list[Slices]:
    """Take the photo's shadow of sprite k away and put today's in its place; returns where anything changed."""
    boxes = []
    cast, actor = lit.casts[k], stage.actors[k]
    for part in (cast.first, cast.own):
        if part is not None and part[1].size:
            (x0, y0, x1, y1), was = part
            dark[y0:y1, x0:x1] -= was
            boxes.append(np.s_[y0:y1, x0:x1])
    now = None
    if there is not None:
        box, _, coverage = there
        corner = (box[1].start, box[0].start)
        now = silhouette(stage.grounds, coverage, corner, pose, actor)
    for (x0, y0, x1, y1), more, strength in lit.moved(k, now, pose.angle - start.angle):
        dark[y0:y1, x0:x1] += more if strength == 1.0 else np.float32(strength) * more
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def silhouette(
    grounds: Sequence[Array], coverage: F32, corner: tuple[int, int], pose: Pose, actor: Actor
) -> Silhouette:
    """A body as light sees it."""
    rows = np.flatnonzero(coverage.max(axis=1) > 0.5) if coverage.size else np.zeros(0, int)
    bottom = float(corner[1] + (int(rows[-1]) if len(rows) else 0))
    if actor.radius is not None:
        bottom = pose.y + actor.radius
    floor_row = ground_below(grounds, pose.x, bottom) if grounds else None
    return Silhouette(coverage, corner, (pose.x, pose.y), actor.radius, actor.thick, floor_row)


def _own_box(sprite: Sprite, size: tuple[int, int]) -> Slices:
    """Where the sprite is at t = 0."""
    height, width = sprite.coverage.shape
    x0, y0 = sprite.corner
    return np.s_[
        max(y0, 0) : max(min(y0 + height, size[1]), 0), max(x0, 0) : max(min(x0 + width, size[0]), 0)
    ]


def _runs(boxes: Sequence[Slices], size: tuple[int, int]) -> list[Slices]:
    """Boxes that do not overlap and cover the given ones: rows of tiles."""
    marked = np.zeros((-(-size[1] // TILE), -(-size[0] // TILE)), bool)
    for rows, columns in boxes:
        if rows.stop > rows.start and columns.stop > columns.start:
            marked[
                rows.start // TILE : (rows.stop - 1) // TILE + 1,
                columns.start // TILE : (columns.stop - 1) // TILE + 1,
            ] = True
    found = []
    for row in np.flatnonzero(marked.any(axis=1)).tolist():
        edges = np.flatnonzero(np.diff(np.concatenate([[False], marked[row], [False]]).astype(np.int8)))
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            found.append(
                np.s_[row * TILE : min((row + 1) * TILE, size[1]), first * TILE : min(last * TILE, size[0])]
            )
    return found


def _place(
    sprite: Sprite, start: Pose, pose: Pose, size: tuple[int, int], space: Array | None, fine: int = 1
) -> tuple[Slices, F32, F32] | None:
    """The sprite's light and coverage where they fall on a canvas of `size` (W, H); None when outside.

    Where it moved, each pixel is the mean of `fine` x `fine` samples.
    """
    height, width = sprite.coverage.shape
    corner = np.array(sprite.corner, np.float64)
    turn = pose.angle - start.angle
    rolled = space is not None and not (space == np.eye(3)).all()
    if (
        turn == 0.0 and pose[:2] == start[:2] and not (rolled and sprite.ball)
    ):  # at rest: the photo's own pixels
        x0, y0 = sprite.corner
        left, top = max(-x0, 0), max(-y0, 0)
        right, bottom = min(width, size[0] - x0), min(height, size[1] - y0)
        if left >= right or top >= bottom:
            return None
        own = np.s_[top:bottom, left:right]
        light = sprite.light[own] if sprite.rest is None else sprite.light[own] + sprite.rest[own]
        return np.s_[y0 + top : y0 + bottom, x0 + left : x0 + right], light, sprite.coverage[own]
    if sprite.ball is not None:  # the picture of a ball moves without turning: its skin alone turns
        in_picture = np.pad(rotation(turn), ((0, 1), (0, 1))) + np.diag([0.0, 0, 1])
        space, turn = in_picture if space is None else space, 0.0
    forward = rotation(turn)
    here = np.array(start[:2])
    corners = corner + np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    moved = (corners - here) @ forward.T + pose[:2]
    if not np.isfinite(moved).all():
        return None
    low, high = moved.min(axis=0), moved.max(axis=0)
    if (high < 0).any() or low[0] >= size[0] or low[1] >= size[1]:
        return None
    x0, y0 = max(floor(low[0]), 0), max(floor(low[1]), 0)
    x1, y1 = min(ceil(high[0]) + 1, size[0]), min(ceil(high[1]) + 1, size[1])
    # canvas pixel p (from the box's corner) comes from sprite pixel R^-1 (p + box - pose) + start - corner
    back = forward.T
    shift = back @ (np.array([x0, y0]) - pose[:2]) + here - corner
    matrix = 2 * np.concatenate([back, shift[:, None]], axis=1)  # the fine grid has two samples a pixel
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped: F32 = cv2.warpAffine(  # type: ignore[assignment]  # OpenCV keeps float32
        sprite.fine if sprite.ball is None else sprite.fine_still,
        _finer(matrix, fine),
        ((x1 - x0) * fine, (y1 - y0) * fine),
        flags=how,
        borderMode=cv2.BORDER_CONSTANT,
    )
    light = warped[..., :3]
    if sprite.ball is not None and space is not None:
        center = sprite.ball.center[0] + pose.x - start.x, sprite.ball.center[1] + pose.y - start.y
        skin = sprite.ball.seen(center, space, (x1 - x0, y1 - y0), (x0, y0), fine)
        light = light + skin * np.clip(warped[..., 3:], 0, 1)
    coverage = np.clip(warped[..., 3], 0.0, 1.0)
    if fine > 1:
        both: F32 = cv2.resize(  # type: ignore[assignment]  # OpenCV keeps float32
            np.dstack([light, coverage]), (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA
        )
        light, coverage = both[..., :3], both[..., 3]
    left_behind = float(np.abs(moved - corners).max()) / FADE
    if sprite.rest is not None and left_behind < 1:
        light = light + (1 - left_behind) * cv2.warpAffine(
            sprite.rest, matrix / 2, (x1 - x0, y1 - y0), flags=how, borderMode=cv2.BORDER_CONSTANT
        )
    return np.s_[y0:y1, x0:x1], light, coverage


def _finer(matrix: Array, fine: int) -> Array:
    """(2, 3) from the pixels of a grid `fine` times as fine, where `matrix` is from the pixels."""
    into = np.array([[1, 0, 0.5 - fine / 2], [0, 1, 0.5 - fine / 2], [0, 0, fine]]) / fine
    return matrix @ into if fine > 1 else matrix
