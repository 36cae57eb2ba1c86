"""What a thing is made of: solids with surfaces, a footprint to stand on, what it can carry or hold."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.solids import Solid

FINISHES = ("matt", "satin", "glossy", "brushed", "steel", "glass")
"""Surfaces there are: paper and cloth, wood and plastic, glaze, dull and bright metal, thin clear walls."""


@dataclass(frozen=True)
class Part:
    """One solid with one finish and one print."""

    solid: Solid
    finish: str
    """One of FINISHES."""
    print: np.ndarray
    """(H, W, 3) float32 linear reflectance over uv 0..1; row 0 lies at v = 0."""
    repeat: tuple[float, float] = (1.0, 1.0)
    """How often the print repeats over uv 0..1; scenery only."""

    def moved(self, by: object = (0, 0, 0), turn: np.ndarray | None = None) -> Part:
        return Part(self.solid.moved(by, turn), self.finish, self.print, self.repeat)


@dataclass(frozen=True)
class Thing:
    """One movable object in its own frame: it stands on z = 0 about the origin."""

    kind: str
    parts: list[Part]
    foot: np.ndarray
    """(K, 2) m, convex, counter-clockwise: what nothing else may stand on."""
    height: float
    """m."""
    top: tuple[float, float] | None = None
    """m, (x, y) of a flat top that carries others, None if it carries nothing."""
    well: tuple[float, float] | None = None
    """m, (inner radius, depth) of an opening that long things can stand in."""
    rod: float | None = None
    """m: the length of a long thing that can stand in a well; its parts lie along x from -rod/2 to rod/2."""
    faces: bool = False
    """It has a front (-y) that shall look at the viewer."""
    leans: bool = False
    """A slab (thin along y) that can lean on a wall."""
    extra: dict = field(default_factory=dict)

    def moved(
        self, by: object = (0, 0, 0), turn: np.ndarray | None = None
    ) -> list[Part]:
        return [part.moved(by, turn) for part in self.parts]


def disc(radius: float, sides: int = 14) -> np.ndarray:
    """(sides, 2) about a circle."""
    angle = np.arange(sides) / sides * 2 * np.pi
    return radius / np.cos(np.pi / sides) * np.stack([np.cos(angle), np.sin(angle)], 1)


def rectangle(width: float, depth: float) -> np.ndarray:
    """(4, 2) about the origin."""
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, depth / 2]


def extent(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """(3,) m lowest and highest corner."""
    points = np.concatenate([part.solid.vertices for part in parts])
    return points.min(0), points.max(0)


def standing(
    kind: str, parts: list[Part], round_foot: bool = False, **more: object
) -> Thing:
    """A thing of parts, shifted to stand on z = 0 over the origin, with its footprint: its box seen from above, or
    with `round_foot` its disc about the axis."""
    low, high = extent(parts)
    if round_foot:
        shift = np.array([0, 0, -low[2]])
        points = np.concatenate([part.solid.vertices for part in parts])
        foot = disc(float(np.hypot(points[:, 0], points[:, 1]).max()))
    else:
        shift = np.array([*(-(low + high)[:2] / 2), -low[2]])
        foot = rectangle(*(high - low)[:2])
    return Thing(
        kind,
        [part.moved(shift) for part in parts],
        foot,
        float(high[2] - low[2]),
        **more,
    )


def flat(rng: np.random.Generator) -> np.ndarray:
    """A print of one colour."""
    return prints.plain(prints.colour(rng))
