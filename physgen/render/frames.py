"""World + Trajectory + sprites -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose
from physgen.photometry import decode, encode_u8
from physgen.render.lit import Lit, shaded
from physgen.render.placing import HOW, Placement, Slices, drawn, placed, thrice
from physgen.render.sprites import Sprite
from physgen.render.tiles import union
from physgen.render.veils import reaching, veil
from physgen.shadow import Setting, Silhouette
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
    scale: float = 1.0
    """Canvas pixels a photo pixel: a scene without a photo is drawn as large as it is seen."""


@dataclass
class Picture:
    """What a frame shows of one sprite."""

    sprite: int
    where: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    figure: Silhouette | None
    """The same as light sees it, where there is `Stage.lit`."""


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
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None, parts: int = 1
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each is the mean of the light of `parts` samples, with the time and the ids of the last. Each object's own box is
    warped, and only touched pixels are encoded again. What a frame shows does not depend on those before it; the
    photo's own poses are those of sample 0.
    """
    if stage.scale != 1.0:
        trajectory = replace(trajectory, poses=_enlarged(trajectory.poses, stage.scale))
    size = (stage.background.shape[1], stage.background.shape[0])
    behind = decode(stage.background) if stage.lit is None else stage.lit.behind()
    samples = list(range(len(trajectory.times)) if order is None else order)
    drawings = _drawings(stage, trajectory, samples, behind)
    more = np.zeros_like(behind) if parts > 1 else None
    for index, sample in enumerate(samples[parts - 1 :: parts]):
        seen: list[Slices] = []
        for _ in range(parts):
            canvas, ids, touched = next(drawings)
            boxes = union(touched, size)
            seen += boxes
            if more is not None:
                for box in boxes:
                    more[box] += canvas[box] - behind[box]
        rgb = stage.background.copy()
        for box in boxes if more is None else union(seen, size):
            if more is None:
                rgb[box] = encode_u8(canvas[box])
            else:
                rgb[box] = encode_u8(behind[box] + more[box] / np.float32(parts))
                more[box] = 0
        yield Frame(index, float(trajectory.times[sample]), rgb, ids)


def _drawings(
    stage: Stage, trajectory: Trajectory, samples: Sequence[int], behind: F32
) -> Iterator[tuple[F32, U16, list[Slices]]]:
    """Linear light (H, W, 3), ids (H, W) and where they are not `behind`, of each sample; the light is overwritten."""
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    starts = [Pose(*pose) for pose in trajectory.poses[0].tolist()] if len(trajectory.poses) else []
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    dark = None if lit is None else lit.total.copy()
    canvas: F32 = behind.copy()
    touched: list[Slices] = []
    for sample in samples:
        for box in touched:
            canvas[box] = behind[box]
            if dark is not None and lit is not None:
                dark[box] = lit.total[box]
        touched = []
        ids = np.zeros(behind.shape[:2], np.uint16)
        pictures: list[Picture] = []
        changed: list[Slices] = []
        poses = [Pose(*pose) for pose in trajectory.poses[sample].tolist()]
        for k, sprite in enumerate(stage.sprites):
            start, pose = starts[sprite.body], poses[sprite.body]
            where = placed(sprite, start, pose, size, None if turns is None else turns[sample, sprite.body])
            now = None
            if where is not None:
                light, coverage = drawn(sprite, where, stage.supersample)
                if lit is not None:
                    corner = (where.box[1].start, where.box[0].start)
                    now = silhouette(stage.grounds, coverage, corner, pose, stage.actors[k])
                pictures.append(Picture(k, where, light, coverage, now))
            if lit is not None and dark is not None and start != pose:
                changed += _cast(lit, dark, k, now, start, pose)
        if lit is not None and stage.veils is not None and changed:
            _veil(stage, stage.veils, lit.setting, pictures)
        if lit is not None and dark is not None:
            for box in (relit := union(changed, size)):
                canvas[box] = shaded(lit.plate[box], dark[box], lit.tint)
            touched += relit
        for seen in pictures:
            box, body = seen.where.box, stage.sprites[seen.sprite].body
            under = canvas[box]
            cv2.multiply(under, thrice(1 - seen.coverage), dst=under)
            cv2.add(under, seen.light, dst=under)
            np.copyto(ids[box], np.uint16(body + 1), where=seen.coverage >= 0.5)
            touched.append(box)
        yield canvas, ids, touched


def _enlarged(poses: Array, scale: float) -> Array:
    """Poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    return np.concatenate([(poses[..., :2] + 0.5) * scale - 0.5, poses[..., 2:]], axis=-1)


def _cast(lit: Lit, dark: F32, k: int, now: Silhouette | None, start: Pose, pose: Pose) -> list[Slices]:
    """Take the photo's shadow of sprite k away and put today's in its place; returns where anything changed."""
    boxes = []
    if (whole := lit.casts[k].whole) is not None:
        (x0, y0, x1, y1), was = whole
        dark[y0:y1, x0:x1] -= was
        boxes.append(np.s_[y0:y1, x0:x1])
    for (x0, y0, x1, y1), more in lit.moved(k, now, start, pose):
        dark[y0:y1, x0:x1] += more
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def _veil(stage: Stage, veils: Sequence[F32 | None], setting: Setting, pictures: Sequence[Picture]) -> None:
    """Take from each picture the shadows that others threw on it in the photo, and throw today's."""
    figures = [p.figure for p in pictures if p.figure is not None]
    moved = np.array([p.where.own is None for p in pictures])
    near = reaching(figures, setting)
    for k, seen in enumerate(pictures):
        before = veils[seen.sprite]
        others = np.flatnonzero(near[k])
        if not moved[k] and before is None and not moved[others].any():
            continue
        sprite, share = stage.sprites[seen.sprite], stage.actors[seen.sprite].veiled
        now = (
            veil(figures[k], [figures[other] for other in others], setting) if len(others) and share else None
        )
        then: F32 | None = None
        if before is not None and seen.where.own is not None:
            then = before[seen.where.own]
        elif before is not None and sprite.ball is None and seen.where.matrix is not None:
            size = seen.coverage.shape[::-1]
            there = cv2.warpAffine(
                before, seen.where.matrix, size, flags=HOW, borderMode=cv2.BORDER_REPLICATE
            )
            then = np.asarray(there, np.float32)
        if now is None and then is None:
            continue
        more = np.zeros_like(seen.coverage) if then is None else then
        if now is not None:
            more = more - np.float32(share) * now
        seen.light = seen.light * thrice(np.asarray(cv2.exp(more), np.float32))


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
