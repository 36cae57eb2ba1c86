"""Silhouettes of sprites, their shadows on the background and on each other.

Each object is a ball, or its silhouette with a thickness; all stand in one plane (side view) or on one table (top
view). A point of one object loses its direct light where the way to the light meets another object.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, radians, tan
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array
from physgen.geometry.shadows import (
    F32,
    LEAST_LIGHT_HEIGHT,
    MOST_BLOCKED,
    ShadowSetting,
    Silhouette,
)
from physgen.render.shadow_decomposition import LitBackground
from physgen.render.stage import (
    WARP_FLAGS,
    Placement,
    ShadowBody,
    Slices,
    SpritePose,
    Stage,
    three_channels,
)


@dataclass(frozen=True)
class OcclusionTuning:
    """Resolution and thresholds of shadows on other objects."""

    cells: int = 16
    """Of the grid on which a veil is worked out, about so many across the figure."""
    stops: int = 4
    """On the way through another object's thickness at which its silhouette is looked at."""
    rim: float = 0.4
    """Of a ball's normal towards the viewer, from which a veil is seen in full."""
    floor: float = 1.0
    """-log of light that a floor keeps from a ball where they touch; by tune."""
    near: float = 0.09
    """Of a ball's radius: the height over a floor in which that falls to a third; by tune."""
    faint: float = 0.01
    """-log of light: what is less everywhere is no veil."""


OCCLUSION = OcclusionTuning()


def middle(figure: Silhouette, top: bool) -> float:
    """px towards the viewer, of its middle: above the table, or from the plane in which all stand."""
    return (
        (figure.thick / 2 if figure.radius is None else figure.radius) if top else 0.0
    )


def face(figure: Silhouette, top: bool) -> float:
    """px towards the viewer, of its nearest point."""
    return middle(figure, top) + (
        figure.thick / 2 if figure.radius is None else figure.radius
    )


def occluders(
    figures: Sequence[Silhouette], setting: ShadowSetting
) -> dict[int, list[int]]:
    """Of each object on whose face others' shadows may fall, the others: by their boxes, of balls by their distance."""
    if len(figures) < 2 or not setting.light.intensity:
        return {}
    lx, ly, lz = setting.light.direction
    soft = tan(radians(min(setting.softness, 60.0)))
    high = np.array([face(f, setting.top) for f in figures])
    low = np.array(
        [
            face(f, setting.top) if f.radius is None else middle(f, setting.top)
            for f in figures
        ]
    )
    corner = np.array([f.corner for f in figures], np.float64)
    far = corner + [f.coverage.shape[::-1] for f in figures]
    # onto (rows) by (columns): so far along the light a shadow may go, and its box meets the other's
    way = (high[None] - low[:, None]) / max(lz, LEAST_LIGHT_HEIGHT)
    spread = 1 + way * soft
    met = way > 0
    np.fill_diagonal(met, False)
    for k, part in enumerate((lx, ly)):
        shift = -part * way
        met &= corner[:, k][None] + np.minimum(shift, 0) - spread < far[:, k][:, None]
        met &= far[:, k][None] + np.maximum(shift, 0) + spread > corner[:, k][:, None]
    onto, by = np.nonzero(met)
    # balls: how far the middle of one is from the line of the other's shadow
    radius = np.array([np.nan if f.radius is None else f.radius for f in figures])
    middles = np.array([(*f.center, middle(f, setting.top)) for f in figures]).T
    x, y, z = middles[:, onto] - middles[:, by]
    along = x * lx + y * ly + z * lz
    miss = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0))
    clear = (miss >= radius[onto] + radius[by] + spread[onto, by]) | (
        along >= radius[onto]
    )
    hit = ~(
        clear & ~np.isnan(radius[onto] + radius[by])
    )  # what compares with nan is not clear
    found: dict[int, list[int]] = {}
    for one, other in zip(onto[hit].tolist(), by[hit].tolist(), strict=True):
        found.setdefault(one, []).append(other)
    return found


def occlusions(
    figures: Sequence[Silhouette],
    near: Mapping[int, Sequence[int]],
    setting: ShadowSetting,
) -> dict[int, F32]:
    """(h, w) -log of the light that others leave on the face of each object, on its box, where that is not all.

    `near` as `reaching` has it.
    """
    found = {}
    for k, others in near.items():
        dark = occlusion_of(figures[k], [figures[other] for other in others], setting)
        if dark is not None:
            found[k] = dark
    return found


def occlusion_of(
    onto: Silhouette, others: Sequence[Silhouette], setting: ShadowSetting
) -> F32 | None:
    """(h, w) -log of the light that `others` leave on the face of `onto`, on its box; None where that is all."""
    if not others and (onto.radius is None or onto.floor is None):
        return None
    h, w = onto.coverage.shape
    step = max(
        1, int(np.sqrt(onto.area)) // OCCLUSION.cells
    )  # a box of what leans is mostly empty
    kind: Any = (
        np.float64
        if all(one.radius is not None for one in (onto, *others))
        else np.float32
    )
    xs = onto.corner[0] + step * (np.arange(-(-w // step)) + 0.5) - 0.5
    ys = onto.corner[1] + step * (np.arange(-(-h // step)) + 0.5) - 0.5
    # balls on balls are worked out more finely
    x, y = (np.asarray(part, kind) for part in np.meshgrid(xs, ys))
    toward: NDArray[Any]
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    z = None
    if onto.radius is None:
        toward = np.full(x.shape, face(onto, setting.top), np.float32)
        facing = np.full(x.shape, max(lz, 0), np.float32)
    else:
        cx, cy, radius = (np.float32(part) for part in (*onto.center, onto.radius))
        u, v = (x - cx) / radius, (y - cy) / radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        toward = np.float32(middle(onto, setting.top)) + radius * z
        facing = np.maximum(u * lx + v * ly + z * lz, 0)
    straight = setting.light.intensity * facing
    direct = np.asarray(
        straight / np.maximum(straight + setting.light.ambient, 1e-6), np.float32
    )
    balls = [other for other in others if other.radius is not None]
    points = x.astype(np.float32), y.astype(np.float32), toward.astype(np.float32)
    behind = iter(_behind_balls(balls, points, setting) if balls else ())
    left = np.ones(x.shape, np.float32)
    for other in others:
        blocked = (
            _behind_slab(other, *points, step, setting)
            if other.radius is None
            else next(behind)
        )
        left *= 1 - np.float32(MOST_BLOCKED) * direct * blocked
    dark = _seen(left, z)
    if (
        onto.radius and onto.floor is not None
    ):  # a floor close below lies in the ball's own shadow
        height = np.maximum(onto.floor - y, 0) / np.float32(onto.radius)
        dark = dark + OCCLUSION.floor * np.clip(v, 0, 1) ** 2 * np.exp(
            -height / OCCLUSION.near
        )
    if dark.max() < OCCLUSION.faint:
        return None
    size = (dark.shape[1] * step, dark.shape[0] * step)
    return np.asarray(
        cv2.resize(dark, size, interpolation=cv2.INTER_LINEAR)[:h, :w], np.float32
    )


def _seen(left: F32, z: NDArray[Any] | None) -> F32:
    """-log of the light left; on a ball, whose normals face the viewer by `z`, its slanted parts have none.

    They are mixed with what is behind, and the neighbours' light fills them.
    """
    dark = -np.log(np.maximum(left, 1 - MOST_BLOCKED))
    return np.asarray(
        dark if z is None else dark * np.clip(z / np.float32(OCCLUSION.rim), 0, 1),
        np.float32,
    )


def stacked(values: Iterable[float]) -> F32:
    """(n, 1, 1)."""
    return np.array(list(values), np.float32)[:, None, None]


def _behind_balls(
    balls: Sequence[Silhouette], points: tuple[F32, ...], setting: ShadowSetting
) -> F32:
    """(n, h, w) how much of the light each ball hides from points: columns, rows and px towards the viewer."""
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    middles = zip(
        *((*ball.center, middle(ball, setting.top)) for ball in balls), strict=True
    )
    px, py, pz = (at - stacked(part) for at, part in zip(points, middles, strict=True))
    radius = stacked(ball.radius or 0.0 for ball in balls)
    along = px * lx + py * ly + pz * lz
    miss = np.sqrt(np.maximum(px * px + py * py + pz * pz - along * along, 0)) - radius
    width = np.maximum(
        0.6 + np.float32(0.6 * tan(radians(setting.softness))) * np.abs(along), 0.6
    )
    beyond = np.clip(
        -along / (np.float32(0.5) * radius), 0, 1
    )  # the ball is on the light's side
    return np.asarray(
        beyond / (1 + np.exp(np.clip(miss / (0.6 * width), -30, 30))), np.float32
    )


def _behind_slab(
    slab: Silhouette, x: F32, y: F32, toward: F32, step: int, setting: ShadowSetting
) -> F32:
    """The same of anything else, whose silhouette is as thick all over; points are `step` px apart."""
    lx, ly, lz = (float(part) for part in setting.light.direction)
    way = np.maximum(face(slab, setting.top) - toward, 0) / max(lz, LEAST_LIGHT_HEIGHT)
    soft = min(
        0.6 + 0.6 * tan(radians(min(setting.softness, 60.0))) * float(way.max()), 4.0
    )
    seen = cv2.GaussianBlur(
        np.pad(slab.coverage, pad := 8 + step), (0, 0), max(soft, step / 2)
    )
    left, top = np.float32(pad - slab.corner[0]), np.float32(pad - slab.corner[1])
    blocked = np.zeros(x.shape, np.float32)
    for stop in range(1, OCCLUSION.stops + 1):
        s = way * np.float32(stop / OCCLUSION.stops)
        there = cv2.remap(
            seen,
            x + s * np.float32(lx) + left,
            y + s * np.float32(ly) + top,
            cv2.INTER_LINEAR,
            borderValue=0,
        )
        np.maximum(blocked, there, out=blocked)
    # a face as near as the slab's own sees the light
    thin = np.clip(way * np.float32(hypot(lx, ly)) / 2, 0, 1)
    return np.asarray(blocked * thin, np.float32)


SUNK = 3.0
"""px by which an object's pixels may reach below the floor that it stands on."""


def ground_below(
    grounds: Sequence[Array], x: float, y: float
) -> tuple[float, Array] | None:
    """The highest floor below a point; first its row, px."""
    found: tuple[float, Array] | None = None
    for ground in grounds:
        ax, ay, bx, by = ground[:4]
        if min(ax, bx) <= x <= max(ax, bx) and ax != bx:
            row = float(ay + (by - ay) * (x - ax) / (bx - ax))
            if row >= y and (found is None or row < found[0]):
                found = row, ground
    return found


def sprite_silhouette(
    stage: Stage, stand: SpritePose, where: Placement, coverage: F32
) -> Silhouette:
    """A sprite as light sees it; `coverage` (h, w) is on its placement's box."""
    corner = (where.box[1].start, where.box[0].start)
    tilt = 0.0 if stage.lit is None else stage.lit.setting.tilt
    return silhouette(
        stage.grounds, coverage, corner, stand.pose[:2], stage.actors[stand.k], tilt
    )


def silhouette(
    grounds: Sequence[Array],
    coverage: F32,
    corner: tuple[int, int],
    center: Sequence[float] | Array,
    actor: ShadowBody,
    tilt: float,
) -> Silhouette:
    """A body as light sees it; from above, by `tilt`, its near edge is seen below the floor's line."""
    x, y = map(float, center)
    below = None
    if grounds:
        # its middle, as an impact presses it into the floor for a while; a thin one may be seen below the floor's line
        rows = (
            np.flatnonzero(coverage.max(axis=1) > 0.5)
            if coverage.size
            else np.zeros(0, int)
        )
        bottom = float(corner[1] + (int(rows[-1]) if len(rows) else 0))
        below = ground_below(grounds, x, min(y, bottom - SUNK - tilt * actor.thick / 2))
    shape = Silhouette(coverage, corner, (x, y), actor.radius, actor.thick, None)
    if below is None:
        return shape
    left, right, *walls = below[1][4:].tolist()
    return replace(
        shape, floor=below[0], ends=(left, right), walls=(walls[0] > 0, walls[1] > 0)
    )


def add_shadow(
    dark: F32,
    lit: LitBackground,
    stand: SpritePose,
    now: Silhouette | None,
    weight: float = 1.0,
) -> list[Slices]:
    """Put the shadow that a sprite throws today, times a `weight`, into `dark` (H, W); returns where that is.

    A shadow that slides does not ask how the sprite looks `now`.
    """
    boxes = []
    for (x0, y0, x1, y1), more in lit.moved(stand.k, now, stand.start, stand.pose):
        dark[y0:y1, x0:x1] += more if weight == 1 else np.float32(weight) * more
        boxes.append(np.s_[y0:y1, x0:x1])
    return boxes


def relit_border(rest: F32, lit: LitBackground, dark: F32, box: Slices) -> F32:
    """(h, w, 3) a border's rest in the light that the background behind it has now: no black where a shadow passes."""
    more = lit.total[box] - dark[box]
    if not more.any():
        return rest
    change = three_channels(np.asarray(cv2.exp(np.minimum(more, 1)), np.float32))
    # what is taken away may lie on another object, which has no more to give
    return np.asarray(np.maximum(rest * change, np.minimum(rest, 0)), np.float32)


def occlusion_factors(
    stage: Stage, stands: Sequence[SpritePose], figures: Mapping[int, Silhouette]
) -> dict[int, F32]:
    """(h, w) by which light is multiplied on the box of each sprite whose shadows by others differ from the photo's.

    Those of the photo are taken from it, and today's thrown; `stands` are in the picture.
    """
    if stage.veils is None or stage.lit is None:
        return {}
    moved = np.array(
        [stand.where is None or stand.where.own is None for stand in stands]
    )
    if not moved.any():
        return {}
    there = [figures[stand.k] for stand in stands]
    near = occluders(there, stage.lit.setting)
    asked = [
        k
        for k, stand in enumerate(stands)
        if moved[k] or stage.veils[stand.k] is not None or moved[near.get(k, [])].any()
    ]
    shares = {k: stage.actors[stands[k].k].veiled for k in asked}
    today = occlusions(
        there, {k: near.get(k, []) for k in asked if shares[k]}, stage.lit.setting
    )
    found: dict[int, F32] = {}
    for k in asked:
        stand, now = stands[k], today.get(k)
        before, where, sprite = (
            stage.veils[stand.k],
            stand.where,
            stage.sprites[stand.k],
        )
        if where is None:
            continue
        then: F32 | None = None
        if before is not None and where.own is not None:
            then = before[where.own]
        elif before is not None and sprite.ball is None and where.matrix is not None:
            size = there[k].coverage.shape[::-1]
            old = cv2.warpAffine(
                before,
                where.matrix,
                size,
                flags=WARP_FLAGS,
                borderMode=cv2.BORDER_REPLICATE,
            )
            then = np.asarray(old, np.float32)
        if now is None and then is None:
            continue
        more = np.zeros_like(there[k].coverage) if then is None else then
        if now is not None:
            more = more - np.float32(shares[k]) * now
        found[stand.k] = np.asarray(cv2.exp(more), np.float32)
    return found
