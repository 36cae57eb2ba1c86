"""Objects as they stand -> how much of the light each keeps from the others' faces.

Each thing is a ball, or its silhouette with a thickness; all stand in one plane (side view) or on one table (top view).
A point of one thing's face loses its direct light where the way to the light meets another thing.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, radians, sqrt, tan

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.shadow import Box, Setting, Silhouette
from physgen.shadow.cast import FARTHEST, LOWEST

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
    """Of each thing on whose face others' shadows may fall, the others: by their boxes, of balls by their distance.

    Things are met in the order of their left ends, so that few pairs are looked at where things are far apart.
    """
    lx, _, lz = setting.light.direction
    soft = tan(radians(min(setting.softness, 60.0)))
    high = [face(figure, setting.top) for figure in figures]
    low = [face(f, setting.top) if f.radius is None else middle(f, setting.top) for f in figures]
    farthest = max(max(high, default=0.0) - min(low, default=0.0), 0.0) / max(lz, LOWEST)
    reach = farthest * (abs(lx) + soft) + 1
    boxes = [
        (f.corner[0], f.corner[1], f.corner[0] + f.coverage.shape[1], f.corner[1] + f.coverage.shape[0])
        for f in figures
    ]
    order = sorted(range(len(figures)), key=lambda k: boxes[k][0])
    found: dict[int, list[int]] = {}
    open_: list[int] = []
    for k in order:
        open_ = [other for other in open_ if boxes[other][2] + reach > boxes[k][0]]
        for other in open_:
            for onto, by in ((k, other), (other, k)):
                way = (high[by] - low[onto]) / max(lz, LOWEST)
                if way > 0 and _met(figures[onto], figures[by], boxes[onto], boxes[by], way, soft, setting):
                    found.setdefault(onto, []).append(by)
        open_.append(k)
    return {onto: sorted(others) for onto, others in found.items()}


def _met(
    onto: Silhouette, by: Silhouette, box: Box, other: Box, way: float, soft: float, setting: Setting
) -> bool:
    """Whether the shadow of `by` may fall on `onto`, `way` px along the light."""
    lx, ly, lz = setting.light.direction
    spread = 1 + way * soft
    for k, part in enumerate((lx, ly)):
        shift = -part * way
        if (
            other[k] + min(0.0, shift) - spread >= box[k + 2]
            or other[k + 2] + max(0.0, shift) + spread <= box[k]
        ):
            return False
    if onto.radius is None or by.radius is None:
        return True
    # balls: how far the middle of one is from the line of the other's shadow
    x, y = onto.center[0] - by.center[0], onto.center[1] - by.center[1]
    z = middle(onto, setting.top) - middle(by, setting.top)
    along = x * lx + y * ly + z * lz
    miss = sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    return miss < onto.radius + by.radius + spread and along < onto.radius


def veil(onto: Silhouette, others: Sequence[Silhouette], setting: Setting) -> F32 | None:
    """(h, w) -log of the light that `others` leave on the face of `onto`, on its box; None where that is all."""
    h, w = onto.coverage.shape
    step = max(1, int(np.sqrt(h * w)) // CELLS)
    xs = onto.corner[0] + np.float32(step) * (np.arange(-(-w // step), dtype=np.float32) + 0.5) - 0.5
    ys = onto.corner[1] + np.float32(step) * (np.arange(-(-h // step), dtype=np.float32) + 0.5) - 0.5
    x, y = (np.asarray(part, np.float32) for part in np.meshgrid(xs, ys))
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    if onto.radius is None:
        toward = np.full(x.shape, face(onto, setting.top), np.float32)
        facing = np.full(x.shape, max(lz, 0), np.float32)
    else:
        u, v = (x - onto.center[0]) / onto.radius, (y - onto.center[1]) / onto.radius
        z = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        toward = middle(onto, setting.top) + onto.radius * z
        facing = np.maximum(u * lx + v * ly + z * lz, 0)
    light = setting.light
    direct = light.intensity * facing / np.maximum(light.intensity * facing + light.ambient, 1e-6)
    left = np.ones(x.shape, np.float32)
    for other in others:
        blocked = _behind_ball if other.radius is not None else _behind_slab
        left *= 1 - np.float32(FARTHEST) * direct * blocked(other, x, y, toward, setting)
    dark = -np.log(np.maximum(left, 1 - FARTHEST)).astype(np.float32)
    if (
        onto.radius is not None
    ):  # slanted faces are mixed with what is behind, and the neighbours' light fills them
        dark *= np.clip(z / np.float32(RIM), 0, 1)
    if dark.max() < FAINT:
        return None
    fine = cv2.resize(dark, (dark.shape[1] * step, dark.shape[0] * step), interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine[:h, :w], np.float32)


def _behind_ball(ball: Silhouette, x: F32, y: F32, toward: F32, setting: Setting) -> F32:
    """How much of the light a ball hides from points `toward` px nearer to the viewer than the plane."""
    assert ball.radius is not None
    lx, ly, lz = (np.float32(part) for part in setting.light.direction)
    px, py = x - np.float32(ball.center[0]), y - np.float32(ball.center[1])
    pz = toward - np.float32(middle(ball, setting.top))
    along = px * lx + py * ly + pz * lz
    miss = np.sqrt(np.maximum(px * px + py * py + pz * pz - along * along, 0)) - np.float32(ball.radius)
    width = np.maximum(0.6 + np.float32(0.6 * tan(radians(setting.softness))) * np.abs(along), 0.6)
    beyond = np.clip(-along / np.float32(0.5 * ball.radius), 0, 1)  # the ball is on the light's side
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
