"""Sprites as they stand -> their silhouettes, how dark they make the background, and each other's faces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose
from physgen.render.lit import Lit
from physgen.render.placing import HOW, Placement, Slices, thrice
from physgen.render.stage import Actor, Stage, Stand
from physgen.render.veils import reaching, veiling
from physgen.shadow.cast import Silhouette

F32 = NDArray[np.float32]
Array = NDArray[np.float64]

SUNK = 3.0
"""px by which a thing's pixels may reach below the floor that it stands on."""


def ground_below(grounds: Sequence[Array], x: float, bottom: float) -> float | None:
    """The row, px, of the highest floor below a thing whose lowest point is at `bottom`."""
    rows = []
    for ax, ay, bx, by in grounds:
        if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
            row = ay + (by - ay) * (x - ax) / (bx - ax)
            if row >= bottom - SUNK:
                rows.append(float(row))
    return min(rows, default=None)


def figured(stage: Stage, stand: Stand, where: Placement, coverage: F32) -> Silhouette:
    """A sprite as light sees it; `coverage` (h, w) is on its placement's box."""
    corner = (where.box[1].start, where.box[0].start)
    return silhouette(stage.grounds, coverage, corner, stand.pose, stage.actors[stand.k])


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


def lifted(dark: F32, lit: Lit, stand: Stand) -> list[Slices]:
    """Take the photo's shadow of a sprite out of `dark` (H, W); returns where anything changed."""
    if (whole := lit.casts[stand.k].whole) is None:
        return []
    (x0, y0, x1, y1), was = whole
    dark[y0:y1, x0:x1] -= was
    return [np.s_[y0:y1, x0:x1]]


def thrown(dark: F32, lit: Lit, stand: Stand, now: Silhouette | None) -> list[Slices]:
    """Put the shadow that a sprite throws today into `dark` (H, W); returns where anything changed.

    A shadow that slides does not ask how the sprite looks `now`.
    """
    boxes = []
    for (x0, y0, x1, y1), more in lit.moved(stand.k, now, stand.start, stand.pose):
        dark[y0:y1, x0:x1] += more
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def brightened(rest: F32, lit: Lit, dark: F32, box: Slices) -> F32:
    """(h, w, 3) a border's rest in the light that the background behind it has now: no black where a shadow passes."""
    more = lit.total[box] - dark[box]
    if not more.any():
        return rest
    return np.asarray(rest * thrice(np.asarray(cv2.exp(np.minimum(more, 1)), np.float32)), np.float32)


def veiled(stage: Stage, stands: Sequence[Stand], figures: Mapping[int, Silhouette]) -> dict[int, F32]:
    """(h, w) by which light is multiplied on the box of each sprite whose shadows by others differ from the photo's.

    Those of the photo are taken from it, and today's thrown; `stands` are in the picture.
    """
    if stage.veils is None or stage.lit is None:
        return {}
    moved = np.array([stand.where is None or stand.where.own is None for stand in stands])
    if not moved.any():
        return {}
    there = [figures[stand.k] for stand in stands]
    near = reaching(there, stage.lit.setting)
    asked = [
        k
        for k, stand in enumerate(stands)
        if moved[k] or stage.veils[stand.k] is not None or moved[near.get(k, [])].any()
    ]
    shares = {k: stage.actors[stands[k].k].veiled for k in asked}
    today = veiling(there, {k: near[k] for k in asked if shares[k] and k in near}, stage.lit.setting)
    found: dict[int, F32] = {}
    for k in asked:
        stand, now = stands[k], today.get(k)
        before, where, sprite = stage.veils[stand.k], stand.where, stage.sprites[stand.k]
        if where is None:
            continue
        then: F32 | None = None
        if before is not None and where.own is not None:
            then = before[where.own]
        elif before is not None and sprite.ball is None and where.matrix is not None:
            size = there[k].coverage.shape[::-1]
            old = cv2.warpAffine(before, where.matrix, size, flags=HOW, borderMode=cv2.BORDER_REPLICATE)
            then = np.asarray(old, np.float32)
        if now is None and then is None:
            continue
        more = np.zeros_like(there[k].coverage) if then is None else then
        if now is not None:
            more = more - np.float32(shares[k]) * now
        found[stand.k] = np.asarray(cv2.exp(more), np.float32)
    return found
