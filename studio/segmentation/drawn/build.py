"""Short words for making models: rotations, smooth profiles, outlines, and the model with its kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .canvas import Finish
from .hand import Array, Hand
from .parts import Ellipsoid, Paint, Part, Surface


@dataclass(frozen=True)
class Model:
    """A thing in its own units, about 1 tall or wide, y up, z to the front."""

    parts: tuple[Part, ...]

    @cached_property
    def hull(self) -> Array:
        """(N, 3) points about the model."""
        return np.concatenate([part.hull() for part in self.parts])


@dataclass(frozen=True)
class Kind:
    """A kind of movable thing and how such things lie about."""

    name: str
    make: Callable[[Hand], Model]
    cm: float
    """How large such things usually are."""
    poses: tuple[str, ...] = ("stand",)
    """Of stand, lie (on its side), flat (on its back), lean."""


MATT = Finish()
SATIN = Finish(gloss=0.12, sharpness=18)
GLAZED = Finish(gloss=0.5, sharpness=90)
STEEL = Finish(gloss=0.6, sharpness=60, metal=0.85)
GLASS = Finish(gloss=0.9, sharpness=150, metal=0.08, clear=0.85)


def any_finish(hand: Hand) -> Finish:
    """Matt, satin, glazed or lacquered."""
    return hand.one_of(
        [MATT, SATIN, Finish(0.3, 35), GLAZED, Finish(0.8, 150, 0.06)],
        [0.3, 0.25, 0.2, 0.17, 0.08],
    )


def vec(x: float, y: float, z: float = 0.0) -> Array:
    return np.array([x, y, z], np.float32)


def about(axis: str, degrees: float) -> Array:
    """(3, 3) rotation about x, y or z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn = np.eye(3, dtype=np.float32)
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def egg(
    centre: Array,
    radii: tuple[float, float, float],
    paint: Paint,
    finish: Finish = MATT,
    turn: Array | None = None,
) -> Ellipsoid:
    axes = np.diag(np.array(radii, np.float32))
    return Ellipsoid(
        centre,
        axes if turn is None else (turn @ axes).astype(np.float32),
        paint,
        finish,
    )


def ball(
    centre: Array, radius: float, paint: Paint, finish: Finish = MATT
) -> Ellipsoid:
    return egg(centre, (radius, radius, radius), paint, finish)


def profile(points: Sequence[tuple[float, float]], smooth: int = 0) -> Array:
    """(N, 2) radius and height; `smooth` rounds of corner cutting (Chaikin) soften the outline, its ends kept."""
    line = np.array(points, np.float32)
    for _ in range(smooth):
        a, b = 0.75 * line[:-1] + 0.25 * line[1:], 0.25 * line[:-1] + 0.75 * line[1:]
        line = np.concatenate(
            [line[:1], np.stack([a, b], axis=1).reshape(-1, 2), line[-1:]]
        )
    return line.astype(np.float32)


def loop(points: Sequence[tuple[float, float]], smooth: int = 0) -> Array:
    """(N, 2) a closed outline; `smooth` rounds of corner cutting."""
    line = np.array(points, np.float32)
    for _ in range(smooth):
        after = np.roll(line, -1, axis=0)
        line = np.stack(
            [0.75 * line + 0.25 * after, 0.25 * line + 0.75 * after], axis=1
        ).reshape(-1, 2)
    return line.astype(np.float32)


def circle(
    x: float, y: float, radius: float, count: int = 20, flat: float = 1.0
) -> Array:
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack(
        [x + radius * np.cos(turn), y + radius * flat * np.sin(turn)]
    ).astype(np.float32)


def rounded(width: float, height: float, corner: float) -> Array:
    """(24, 2) a rectangle about the origin with round corners."""
    w, h = width / 2 - corner, height / 2 - corner
    turns = np.linspace(0, np.pi / 2, 6)
    quarters = []
    for k, (x, y) in enumerate([(w, h), (-w, h), (-w, -h), (w, -h)]):
        t = turns + k * np.pi / 2
        quarters.append(
            np.column_stack([x + corner * np.cos(t), y + corner * np.sin(t)])
        )
    return np.concatenate(quarters).astype(np.float32)


def curve(points: Sequence[tuple[float, float, float]], count: int = 20) -> Array:
    """(count, 3) a smooth line through near `points`."""
    line = np.array(points, np.float64)
    for _ in range(3):
        a, b = 0.75 * line[:-1] + 0.25 * line[1:], 0.25 * line[:-1] + 0.75 * line[1:]
        line = np.concatenate(
            [line[:1], np.stack([a, b], axis=1).reshape(-1, 3), line[-1:]]
        )
    at = np.linspace(0, len(line) - 1, count)
    return np.stack(
        [np.interp(at, np.arange(len(line)), line[:, k]) for k in range(3)], axis=1
    ).astype(np.float32)


def wrapped(paint: Paint, turn: float = 0.0) -> Paint:
    """A paint for faces, laid round a solid of revolution: its front third is the face."""

    def lay(s: Surface) -> Array:
        u = (s.u - np.float32(turn) + 1) % 2 - 1
        return paint(Surface(s.own, u * np.float32(2.4), s.v * 2 - 1, s.texel))

    return lay


def shade(colour: Array, factor: float) -> Array:
    return np.clip(colour * np.float32(factor), 0.005, 0.95).astype(np.float32)
