"""Shapes of overlays: arrows, arcs, rings, circles and plates, as outlines in px or inked on a layer."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from physgen.render.ink import CASING, Layer

Array = NDArray[np.float64]
U8 = NDArray[np.uint8]

SHAFT = 1.5
"""Pens: the width of an arrow's shaft."""
HEAD = 4.6
"""Widths of its shaft that an arrow's head is long."""


def arrow(tail: Array, tip: Array, width: float) -> Array:
    """(7, 2) px: the outline of an arrow whose point is at `tip`; a short one is a small head on a short shaft."""
    way = tip - tail
    length = float(np.hypot(*way))
    across = np.array([-way[1], way[0]]) / length
    point = head(tip, way, min(HEAD * width, 0.62 * length))
    root = (point[0] + point[2]) / 2
    neck = root + 0.1 * (tip - root)  # barbs point back a little
    half = min(width / 2, 0.15 * float(np.hypot(*(point[2] - point[0])))) * across
    return np.array([tail + half, neck + half, *point[::-1], neck - half, tail - half])


def head(tip: Array, way: Array, length: float) -> Array:
    """(3, 2) px: barb, point and barb of an arrow's head that looks along `way`."""
    along = way / float(np.hypot(*way))
    across = 0.46 * length * np.array([-along[1], along[0]])
    return np.array([tip - length * along - across, tip, tip - length * along + across])


def circle(center: Sequence[float] | Array, radius: float) -> Array:
    """(K, 2) px of a circle, close enough that no chord shows."""
    count = min(max(16, ceil(pi * np.sqrt(max(radius, 1.0) * 10))), 720)
    angles = np.arange(count) * (2 * pi / count)
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), np.float64)


def arc(center: Array, radius: float, sweep: float) -> Array:
    """(K, 2) px of an arc with its middle at the top, that sweeps rad from +x towards +y where positive."""
    angles = -pi / 2 + np.linspace(-sweep / 2, sweep / 2, max(3, ceil(24 * abs(sweep))))
    return np.asarray(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), np.float64)


def straight_arrow(
    layer: Layer, tail: Array, tip: Array, pen: float, strength: float = 1.0, *, struck: bool = False
) -> None:
    """An arrow from a dot; from a ring where something was struck: an impulse, no lasting force."""
    if struck:
        layer.line(circle(tail, 2.6 * pen), pen, strength, closed=True)
    layer.area(circle(tail, min(1.1 * pen, 0.15 * float(np.hypot(*(tip - tail))))), strength)
    layer.area(arrow(tail, tip, SHAFT * pen), strength)


def curved_arrow(layer: Layer, path: Array, pen: float, strength: float = 1.0) -> None:
    """An arrow along a path (K, 2) px, K >= 3; its point is at the path's end."""
    steps = np.hypot(*np.diff(path, axis=0).T)
    length = min(HEAD * SHAFT * pen, 0.62 * float(steps.sum()))
    # the head looks along its own chord of the path, and the shaft ends within it
    left = np.cumsum(steps[::-1])[::-1]
    root = int(np.flatnonzero(left >= 0.8 * length)[-1])
    layer.line(path[: root + 1], SHAFT * pen, strength)
    layer.area(head(path[-1], path[-1] - path[root], length), strength)


def ring(layer: Layer, center: Array, radius: float, pen: float, strength: float = 1.0) -> None:
    """A ring with a dot in its middle: a blow."""
    layer.line(circle(center, radius), 0.8 * pen, strength, closed=True)
    layer.area(circle(center, min(1.5 * pen, radius / 2)), strength)


def plate(rgb: U8, box: tuple[float, float, float, float], radius: float, opaque: float) -> None:
    """Darken a box x0, y0, x1, y1 px with round corners in a picture (H, W, 3), for words to stand on."""
    layer = Layer((rgb.shape[1], rgb.shape[0]), 0.0)
    x0, y0, x1, y1 = box
    turns = np.linspace(0, 2 * pi, 33)
    rounds = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    right, left, low, high = x1 - radius, x0 + radius, y1 - radius, y0 + radius
    middles = ((right, low), (left, low), (left, high), (right, high))
    layer.area(
        np.concatenate([rounds[8 * k : 8 * k + 9] + middle for k, middle in enumerate(middles)]), opaque
    )
    layer.onto(rgb, CASING)
