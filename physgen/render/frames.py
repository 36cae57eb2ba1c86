"""World + Trajectory + sprites -> Frames, one at a time; blending and warping happen in linear light."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import Pose
from physgen.photometry import decode
from physgen.render.encoding import encoded
from physgen.render.lit import Lit, shaded
from physgen.render.placing import HOW, Placement, Slices, covered, drawn, placed, thrice
from physgen.render.sprites import Sprite
from physgen.render.threads import one_thread
from physgen.render.tiles import union
from physgen.render.veils import reaching, veil
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


@dataclass(frozen=True)
class Stand:
    """How a sprite stands in a frame."""

    k: int
    """Index into the stage's sprites."""
    start: Pose
    pose: Pose
    where: Placement | None
    """None: out of the picture."""


@dataclass
class Picture:
    """What a frame shows of one sprite."""

    stand: Stand
    where: Placement
    light: F32
    """(h, w, 3) linear, times coverage."""
    coverage: F32
    """(h, w)."""
    rest: F32 | None
    """(h, w, 3): what the photo shows at its border beyond light and background; as bright as the background is."""


def ground_below(grounds: Sequence[Array], x: float, bottom: float) -> float | None:
    """The row, px, of the highest floor below a thing whose lowest point is at `bottom`."""
    rows = []
    for ax, ay, bx, by in grounds:
        if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
            row = ay + (by - ay) * (x - ax) / (bx - ax)
            if row >= bottom - SUNK:
                rows.append(float(row))
    return min(rows, default=None)


def planned(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None
) -> Iterator[tuple[float, list[Stand]]]:
    """Time, s, of each sample in its `order` and how every sprite stands then: geometry alone."""
    if stage.scale != 1.0:
        trajectory = replace(trajectory, poses=_enlarged(trajectory.poses, stage.scale))
    size = (stage.background.shape[1], stage.background.shape[0])
    starts = [Pose(*pose) for pose in trajectory.poses[0].tolist()] if len(trajectory.poses) else []
    turns = in_space(trajectory.turns) if trajectory.turns.size else None
    for sample in range(len(trajectory.times)) if order is None else order:
        poses = [Pose(*pose) for pose in trajectory.poses[sample].tolist()]
        stands = []
        for k, sprite in enumerate(stage.sprites):
            start, pose = starts[sprite.body], poses[sprite.body]
            space = None if turns is None else turns[sample, sprite.body]
            stands.append(Stand(k, start, pose, placed(sprite, start, pose, size, space)))
        yield float(trajectory.times[sample]), stands


def render_frames(
    stage: Stage, trajectory: Trajectory, order: Sequence[int] | None = None, parts: int = 1
) -> Iterator[Frame]:
    """Frames of the trajectory's samples in their `order`, all one after the other unless given.

    Each is the mean of the light of `parts` samples, with the time and the ids of the last. Each object's own box is
    warped, and only touched tiles are encoded again. What a frame shows does not depend on those before it; the
    photo's own poses are those of sample 0.
    """
    size = (stage.background.shape[1], stage.background.shape[0])
    behind = decode(stage.background) if stage.lit is None else stage.lit.behind()
    empty = encoded(behind)
    with one_thread():
        drawings = _drawings(stage, planned(stage, trajectory, order), behind)
        more = np.zeros_like(behind) if parts > 1 else None
        index = 0
        while group := list(islice(_parted(drawings, behind, more, size), parts)):
            time, canvas, ids, boxes = group[-1]
            rgb = empty.copy()
            if more is None:
                for box in boxes:
                    rgb[box] = encoded(canvas[box])
            else:
                for box in union([box for drawing in group for box in drawing[3]], size):
                    rgb[box] = encoded(behind[box] + more[box] / np.float32(parts))
                    more[box] = 0
            yield Frame(index, time, rgb, ids)
            index += 1


def _parted(
    drawings: Iterator[tuple[float, F32, U16, list[Slices]]],
    behind: F32,
    more: F32 | None,
    size: tuple[int, int],
) -> Iterator[tuple[float, F32, U16, list[Slices]]]:
    """The same with boxes that do not overlap; what is there beyond `behind` is added to `more`."""
    for time, canvas, ids, touched in drawings:
        boxes = union(touched, size)
        if more is not None:
            for box in boxes:
                more[box] += canvas[box] - behind[box]
        yield time, canvas, ids, boxes


def _drawings(
    stage: Stage, moments: Iterable[tuple[float, list[Stand]]], behind: F32
) -> Iterator[tuple[float, F32, U16, list[Slices]]]:
    """Time, light (H, W, 3), ids (H, W) and where they are not `behind`, of each moment; the light is overwritten."""
    lit, size = stage.lit, (stage.background.shape[1], stage.background.shape[0])
    dark = None if lit is None else lit.total.copy()
    canvas: F32 = behind.copy()
    touched: list[Slices] = []
    for time, stands in moments:
        for box in touched:
            canvas[box] = behind[box]
            if dark is not None and lit is not None:
                dark[box] = lit.total[box]
        touched = []
        ids = np.zeros(behind.shape[:2], np.uint16)
        pictures = [
            Picture(stand, stand.where, *drawn(stage.sprites[stand.k], stand.where, stage.supersample))
            for stand in stands
            if stand.where is not None
        ]
        if lit is not None and dark is not None:
            figures = {}
            for p in pictures:  # shadows do not ask how finely a thing is drawn
                cover = p.coverage if stage.supersample == 1 else covered(stage.sprites[p.stand.k], p.where)
                figures[p.stand.k] = figured(stage, p.stand, p.where, cover)
            changed: list[Slices] = []
            for stand in stands:
                if stand.start != stand.pose:
                    changed += darken(dark, lit, stand, figures.get(stand.k))
            for box in (relit := union(changed, size)):
                canvas[box] = shaded(lit.plate[box], dark[box], lit.tint)
            touched += relit
            factors = veiled(stage, [p.stand for p in pictures], figures)
            for picture in pictures:
                if (factor := factors.get(picture.stand.k)) is not None:
                    picture.light = picture.light * thrice(factor)
        for picture in pictures:
            box, body = picture.where.box, stage.sprites[picture.stand.k].body
            under = canvas[box]
            cv2.multiply(under, thrice(1 - picture.coverage), dst=under)
            cv2.add(under, picture.light, dst=under)
            if picture.rest is not None:
                under += (
                    picture.rest if dark is None or lit is None else brightened(picture.rest, lit, dark, box)
                )
            np.copyto(ids[box], np.uint16(body + 1), where=picture.coverage >= 0.5)
            touched.append(box)
        yield time, canvas, ids, touched


def _enlarged(poses: Array, scale: float) -> Array:
    """Poses (..., 3) on a canvas with `scale` pixels a photo pixel."""
    return np.concatenate([(poses[..., :2] + 0.5) * scale - 0.5, poses[..., 2:]], axis=-1)


def figured(stage: Stage, stand: Stand, where: Placement, coverage: F32) -> Silhouette:
    """A sprite as light sees it; `coverage` (h, w) is on its placement's box."""
    corner = (where.box[1].start, where.box[0].start)
    return silhouette(stage.grounds, coverage, corner, stand.pose, stage.actors[stand.k])


def darken(dark: F32, lit: Lit, stand: Stand, now: Silhouette | None) -> list[Slices]:
    """Take the photo's shadow of a sprite out of `dark` (H, W) and put today's in; returns where anything changed.

    A shadow that slides does not ask how the sprite looks `now`.
    """
    boxes = []
    if (whole := lit.casts[stand.k].whole) is not None:
        (x0, y0, x1, y1), was = whole
        dark[y0:y1, x0:x1] -= was
        boxes.append(np.s_[y0:y1, x0:x1])
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
    found: dict[int, F32] = {}
    for k, stand in enumerate(stands):
        before, where = stage.veils[stand.k], stand.where
        others = near.get(k, [])
        if where is None or (not moved[k] and before is None and not moved[others].any()):
            continue
        sprite, share = stage.sprites[stand.k], stage.actors[stand.k].veiled
        now = None
        if others and share:
            now = veil(there[k], [there[other] for other in others], stage.lit.setting)
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
            more = more - np.float32(share) * now
        found[stand.k] = np.asarray(cv2.exp(more), np.float32)
    return found


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
