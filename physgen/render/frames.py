"""World + Trajectory + sprites -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose
from physgen.photometry import decode, encode_u8
from physgen.render.lit import Lit, shaded
from physgen.render.placing import Placement, Slices, drawn, placed, thrice
from physgen.render.sprites import Sprite
from physgen.render.tiles import union
from physgen.shadow import Silhouette
from physgen.simulate.trajectory import Trajectory
from physgen.simulate.turning import matrix as in_space

F32 = NDArray[np.float32]
Array = NDArray[np.float64]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]


SUNK = 3.0
"""px by which a thing's pixels may reach below the floor that it stands on."""


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
class Stand:
    """A sprite at one moment."""

    k: int
    """Index into the stage's sprites."""
    start: Pose
    """Its body's at t = 0."""
    pose: Pose
    where: Placement | None
    """None: outside the canvas."""


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


def ground_below(grounds: Sequence[Array], x: float, bottom: float) -> float | None:
    """The row, px, of the highest floor below a thing whose lowest point is at `bottom`."""
    rows = []
    for ax, ay, bx, by in grounds:
        if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
            row = ay + (by - ay) * (x - ax) / (bx - ax)
            if row >= bottom - SUNK:
                rows.append(float(row))
    return min(rows, default=None)


def planned(stage: Stage, trajectory: Trajectory) -> Iterator[tuple[float, list[Stand]]]:
    """Time, s, of each frame and how every sprite stands then, in the order of the stage: geometry alone."""
    size = (stage.background.shape[1], stage.background.shape[0])
    centers = trajectory.poses[0] if len(trajectory.poses) else np.zeros((0, 3))
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    for index, time in enumerate(trajectory.times):
        stands = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = Pose(*centers[sprite.body].tolist()), trajectory.pose(index, sprite.body)
            space = None if turns is None else turns[index, sprite.body]
            stands.append(Stand(k, start, pose, placed(sprite, start, pose, size, space)))
        yield float(time), stands


def render_frames(stage: Stage, trajectory: Trajectory) -> Iterator[Frame]:
    """Frames at the trajectory's times. Each object's own box is warped, and only touched pixels are encoded again."""
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    behind = decode(stage.background) if lit is None else lit.behind()
    dark = None if lit is None else lit.total.copy()
    canvas: F32 = behind.copy()
    empty = encode_u8(behind)
    touched: list[Slices] = []
    for index, (time, stands) in enumerate(planned(stage, trajectory)):
        for box in touched:
            canvas[box] = behind[box]
            if dark is not None and lit is not None:
                dark[box] = lit.total[box]
        touched.clear()
        rgb = empty.copy()
        ids = np.zeros(rgb.shape[:2], np.uint16)
        pictures: list[tuple[int, Placement, F32, F32]] = []
        changed: list[Slices] = []
        for stand in stands:
            sprite, where, coverage = stage.sprites[stand.k], stand.where, None
            if where is not None:
                light, coverage = drawn(sprite, where)
                pictures.append((sprite.body, where, light, coverage))
            if lit is not None and dark is not None and stand.start != stand.pose:
                changed += darken(dark, stage, lit, stand, coverage)
        if lit is not None and dark is not None:
            for box in (relit := union(changed, size)):
                canvas[box] = shaded(lit.plate[box], dark[box], lit.tint)
            touched += relit
        for body, where, light, coverage in pictures:
            under = canvas[where.box]
            cv2.multiply(under, thrice(1 - coverage), dst=under)
            cv2.add(under, light, dst=under)
            np.copyto(ids[where.box], np.uint16(body + 1), where=coverage >= 0.5)
            touched.append(where.box)
        for box in union(touched, size):
            rgb[box] = encode_u8(canvas[box])
        yield Frame(index, time, rgb, ids)


def darken(dark: F32, stage: Stage, lit: Lit, stand: Stand, coverage: F32 | None) -> list[Slices]:
    """Take the photo's shadow of a sprite out of `dark` (H, W) and put today's in; returns where anything changed.

    `coverage` (h, w) is the sprite's on its placement's box; a shadow that slides does not need it.
    """
    boxes = []
    k, start, pose, where = stand.k, stand.start, stand.pose, stand.where
    if (whole := lit.casts[k].whole) is not None:
        (x0, y0, x1, y1), was = whole
        dark[y0:y1, x0:x1] -= was
        boxes.append(np.s_[y0:y1, x0:x1])
    now = None
    if where is not None and coverage is not None:
        corner = (where.box[1].start, where.box[0].start)
        now = silhouette(stage.grounds, coverage, corner, pose, stage.actors[k])
    for (x0, y0, x1, y1), more in lit.moved(k, now, start, pose):
        dark[y0:y1, x0:x1] += more
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def silhouette(
    grounds: Sequence[Array], coverage: F32, corner: tuple[int, int], pose: Pose, actor: Actor
) -> Silhouette:
    """A body as light sees it."""
    floor_row = None
    if grounds:
        rows = np.flatnonzero(coverage.max(axis=1) > 0.5) if coverage.size else np.zeros(0, int)
        bottom = float(corner[1] + (int(rows[-1]) if len(rows) else 0))
        if actor.radius is not None:
            bottom = pose.y + actor.radius
        floor_row = ground_below(grounds, pose.x, bottom)
    return Silhouette(coverage, corner, (pose.x, pose.y), actor.radius, actor.thick, floor_row)
