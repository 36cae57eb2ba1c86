"""Objects as they stand -> how much of the light each keeps from the others' faces.

Each thing is a ball, or its silhouette with a thickness; all stand in one plane (side view) or on one table (top view).
A point of one thing's face loses its direct light where the way to the light meets another thing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import hypot, radians, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.shadow.cast import FARTHEST, LOWEST, Setting, Silhouette

F32 = NDArray[np.float32]

CELLS = 16
"""Of the grid on which a veil is worked out, about so many across the thing."""
STOPS = 4
"""On the way through another thing's thickness at which its silhouette is looked at."""
RIM = 0.4
"""Of a ball's normal towards the viewer, from which a veil is seen in full."""
FAINT = 0.01
"""-log of light: what is less everywhere is no veil."""


def middle(thing: Silhouette, top: bool) -> float:
    """px towards the viewer, of its middle: above the table, or from the plane in which all stand."""
    return (thing.thick / 2 if thing.radius is None else thing.radius) if top else 0.0


def face(thing: Silhouette, top: bool) -> float:
    """px towards the viewer, of its nearest point."""
    return middle(thing, top) + (thing.thick / 2 if thing.radius is None else thing.radius)


def reaching(figures: Sequence[Silhouette], setting: Setting) -> dict[int, list[int]]:
    """Of each thing on whose face others' shadows may fall, the others: by their boxes, of balls by their distance."""
    if len(figures) < 2 or not setting.light.intensity:
        return {}
    lx, ly, lz = setting.light.direction
    soft = tan(radians(min(setting.softness, 60.0)))
    high = np.array([face(f, setting.top) for f in figures])
    low = np.array([face(f, setting.top) if f.radius is None else middle(f, setting.top) for f in figures])
    corner = np.array([f.corner for f in figures], np.float64)
    far = corner + [f.coverage.shape[::-1] for f in figures]
    # onto (rows) by (columns): so far along the light a shadow may go, and its box meets the other's
    way = (high[None] - low[:, None]) / max(lz, LOWEST)
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
    x, y, z = (
        part[onto] - part[by]
        for part in (
            *np.array([f.center for f in figures]).T,
            np.array([middle(f, setting.top) for f in figures]),
        )
    )
    along = x * lx + y * ly + z * lz
    miss = np.sqrt(np.maximum(x * x + y * y + z * z - along * along, 0))
    clear = (miss >= radius[onto] + radius[by] + spread[onto, by]) | (along >= radius[onto])
    hit = ~(clear & ~np.isnan(radius[onto] + radius[by]))  # what compares with nan is not clear
    found: dict[int, list[int]] = {}
    for one, other in zip(onto[hit].tolist(), by[hit].tolist(), strict=True):
        found.setdefault(one, []).append(other)
    return found


def veiling(
    figures: Sequence[Silhouette], near: Mapping[int, Sequence[int]], setting: Setting
) -> dict[int, F32]:
    """(h, w) -log of the light that others leave on the face of each thing, on its box, where that is not all.

    `near` as `reaching` has it.
    """
    balls = {
        k: others
        for k, others in near.items()
        if others and all(figures[one].radius is not None for one in (k, *others))
    }
    found = {} if not balls else _on_balls(figures, balls, setting)
    for k, others in near.items():
        if others and k not in balls:
            dark = veil(figures[k], [figures[other] for other in others], setting)
            if dark is not None:
                found[k] = dark
    return found


def _on_balls(
    figures: Sequence[Silhouette], near: Mapping[int, Sequence[int]], setting: Setting
) -> dict[int, F32]:
    """`veiling` of balls by balls: many small pictures at a time."""

    onto = [figures[k] for k in near]
    sizes = [figure.coverage.shape for figure in onto]
    steps = [_step(figure) for figure in onto]
    cells = np.arange(max(-(-max(size) // step) for size, step in zip(sizes, steps, strict=True)))
    x, y = (
        (stacked(f.corner[axis] - 0.5 for f in onto) + stacked(steps) * (cells + np.float32(0.5)))
        for axis in (0, 1)
    )
    y = y.transpose(0, 2, 1)
    radius = stacked(f.radius or 0.0 for f in onto)
    u, v = ((p - stacked(f.center[axis] for f in onto)) / radius for axis, p in enumerate((x, y)))
    z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    direct = _direct(np.maximum(u * lx + v * ly + z * lz, 0), setting)
    toward = stacked(middle(f, setting.top) for f in onto) + radius * z
    whose = np.repeat(np.arange(len(onto)), [len(others) for others in near.values()])
    by = [figures[other] for others in near.values() for other in others]
    points = tuple(np.asarray(part, np.float32)[whose] for part in (x, y, toward))
    blocked = _behind_balls(by, points, setting)
    left = 1 - np.float32(FARTHEST) * direct[whose] * blocked
    left = np.multiply.reduceat(left, np.searchsorted(whose, np.arange(len(onto))), axis=0)
    dark = _seen(left, z)
    found = {}
    for k, (h, w), step, picture in zip(near, sizes, steps, dark, strict=True):
        own = picture[: -(-h // step), : -(-w // step)]
        if own.max(initial=0) >= FAINT:
            found[k] = _enlarged(own, step, h, w)
    return found


def veil(onto: Silhouette, others: Sequence[Silhouette], setting: Setting) -> F32 | None:
    """(h, w) -log of the light that `others` leave on the face of `onto`, on its box; None where that is all."""
    h, w = onto.coverage.shape
    step = _step(onto)
    xs = onto.corner[0] + np.float32(step) * (np.arange(-(-w // step), dtype=np.float32) + 0.5) - 0.5
    ys = onto.corner[1] + np.float32(step) * (np.arange(-(-h // step), dtype=np.float32) + 0.5) - 0.5
    x, y = (np.asarray(part, np.float32) for part in np.meshgrid(xs, ys))
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    z: F32 | None = None
    if onto.radius is None:
        toward = np.full(x.shape, face(onto, setting.top), np.float32)
        facing = np.full(x.shape, max(lz, 0), np.float32)
    else:
        u, v = (x - onto.center[0]) / onto.radius, (y - onto.center[1]) / onto.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        toward = middle(onto, setting.top) + onto.radius * z
        facing = np.maximum(u * lx + v * ly + z * lz, 0)
    direct = _direct(facing, setting)
    left = np.ones(x.shape, np.float32)
    for other in others:
        if other.radius is None:
            blocked = _behind_slab(other, x, y, toward, setting)
        else:
            blocked = _behind_balls([other], (x, y, toward), setting)[0]
        left *= 1 - np.float32(FARTHEST) * direct * blocked
    dark = _seen(left, z)
    return None if dark.max() < FAINT else _enlarged(dark, step, h, w)


def _step(onto: Silhouette) -> int:
    """px a side of the cells of a veil's grid."""
    h, w = onto.coverage.shape
    return max(1, int(np.sqrt(h * w)) // CELLS)


def _direct(facing: F32, setting: Setting) -> F32:
    """Share of a face's light that comes straight, by the cosine of the light's angle to it."""
    light = setting.light
    share = light.intensity * facing / np.maximum(light.intensity * facing + light.ambient, 1e-6)
    return np.asarray(share, np.float32)


def _seen(left: F32, z: F32 | None) -> F32:
    """-log of the light left; on a ball, whose normals face the viewer by `z`, its slanted parts have none.

    They are mixed with what is behind, and the neighbours' light fills them.
    """
    dark = -np.log(np.maximum(left, 1 - FARTHEST))
    return np.asarray(dark if z is None else dark * np.clip(z / np.float32(RIM), 0, 1), np.float32)


def _enlarged(dark: F32, step: int, h: int, w: int) -> F32:
    """(h, w) of cells of `step` px."""
    size = (dark.shape[1] * step, dark.shape[0] * step)
    return np.asarray(cv2.resize(dark, size, interpolation=cv2.INTER_LINEAR)[:h, :w], np.float32)


def stacked(values: Iterable[float]) -> F32:
    """(n, 1, 1)."""
    return np.array(list(values), np.float32)[:, None, None]


def _behind_balls(balls: Sequence[Silhouette], points: tuple[F32, ...], setting: Setting) -> F32:
    """(n, h, w) how much of the light each ball hides from points: columns, rows and px towards the viewer."""
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    px, py, pz = (
        at - stacked(middles)
        for at, middles in zip(
            points,
            (
                [ball.center[0] for ball in balls],
                [ball.center[1] for ball in balls],
                [middle(ball, setting.top) for ball in balls],
            ),
            strict=True,
        )
    )
    radius = stacked(ball.radius or 0.0 for ball in balls)
    along = px * lx + py * ly + pz * lz
    miss = np.sqrt(np.maximum(px * px + py * py + pz * pz - along * along, 0)) - radius
    width = np.maximum(0.6 + np.float32(0.6 * tan(radians(setting.softness))) * np.abs(along), 0.6)
    beyond = np.clip(-along / (np.float32(0.5) * radius), 0, 1)  # the ball is on the light's side
    return np.asarray(beyond / (1 + np.exp(np.clip(miss / (0.6 * width), -30, 30))), np.float32)


def _behind_slab(slab: Silhouette, x: F32, y: F32, toward: F32, setting: Setting) -> F32:
    """The same of anything else, whose silhouette is as thick all over."""
    lx, ly, lz = (float(part) for part in setting.light.direction)
    way = np.maximum(face(slab, setting.top) - toward, 0) / max(lz, LOWEST)
    soft = 0.6 + 0.6 * tan(radians(min(setting.softness, 60.0))) * float(way.max())
    seen = cv2.GaussianBlur(np.pad(slab.coverage, 4), (0, 0), min(soft, 4.0))
    left, top = np.float32(4 - slab.corner[0]), np.float32(4 - slab.corner[1])
    blocked = np.zeros(x.shape, np.float32)
    for stop in range(1, STOPS + 1):
        s = way * np.float32(stop / STOPS)
        there = cv2.remap(
            seen, x + s * np.float32(lx) + left, y + s * np.float32(ly) + top, cv2.INTER_LINEAR, borderValue=0
        )
        np.maximum(blocked, there, out=blocked)
    thin = np.clip(
        way * np.float32(hypot(lx, ly)) / 2, 0, 1
    )  # a face as near as the slab's own sees the light
    return np.asarray(blocked * thin, np.float32)
