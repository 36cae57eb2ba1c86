"""What rooms are built of, none of it an object to be found: panels, boards, fronts, frames, rugs, curtains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studio.segmentation.homes import prints
from studio.segmentation.homes.parts import Part
from studio.segmentation.homes.placement import Support
from studio.segmentation.homes.prints import Rng
from studio.segmentation.homes.solids import Solid, box, join, lathe, sweep


@dataclass(frozen=True)
class Light:
    """A rectangle of light."""

    at: tuple[float, float, float]
    target: tuple[float, float, float]
    size: tuple[float, float]
    """m."""
    radiance: np.ndarray
    """(3,)."""


@dataclass(frozen=True)
class Room:
    """Scenery, light, and where things and the camera go."""

    name: str
    scenery: list[Part]
    supports: list[Support]
    """The first is what the photo is about."""
    lights: list[Light]
    ambient: np.ndarray
    """(3,) radiance from everywhere."""
    elevation: tuple[float, float]
    """degrees above the horizon that the camera looks down from, least and most."""
    azimuth: float = 25.0
    """degrees to either side, at most."""
    aim: float = 0.05
    """m above the support that the camera looks at."""


def papered(solid: Solid, metres: float, grain: int = 0) -> Solid:
    """A box's faces mapped by their places: one repeat of the print every `metres` m, its u along the axis `grain`."""
    uv = np.empty_like(solid.uv)
    for first in range(0, len(solid.vertices), 36):
        piece = solid.vertices[first : first + 36]
        axes = [k for k in range(3) if k != np.argmin(np.ptp(piece, axis=0))]
        if grain in axes:
            axes = [grain, *(k for k in axes if k != grain)]
        uv[first : first + 36] = piece[:, axes] / metres + 0.137 * first
    return Solid(solid.vertices, uv, solid.faces)


def board(
    size: object,
    at: object,
    finish: str,
    skin: np.ndarray,
    metres: float = 0.6,
    edge: float = 0.002,
    grain: int = 0,
) -> Part:
    """A box of `size` m whose bottom's middle is `at`."""
    return Part(papered(box(size, edge), metres, grain).moved(at), finish, skin)


def panel(
    corner: object,
    right: object,
    up: object,
    finish: str,
    skin: np.ndarray,
    metres: float | None = None,
) -> Part:
    """A flat sheet from a corner along two edges (3,) m; one print over it, or one every `metres` m."""
    corner, right, up = (np.asarray(v, float) for v in (corner, right, up))
    points = np.stack([corner, corner + right, corner + right + up, corner + up])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    if metres is not None:
        uv *= [np.linalg.norm(right) / metres, np.linalg.norm(up) / metres]
    else:
        uv[:, 1] = 1 - uv[:, 1]
    return Part(Solid(points, uv, np.array([[0, 1, 2], [0, 2, 3]])), finish, skin)


def wall(
    y: float, finish: str, skin: np.ndarray, metres: float, floor: float = 0.0
) -> Part:
    return panel([-3, y, floor], [6, 0, 0], [0, 0, 3], finish, skin, metres)


def frame(rng: Rng, x: float, y: float, z: float) -> list[Part]:
    """A picture or a mirror on a wall whose face is at `y`; its middle at (x, z)."""
    w, h = rng.uniform(0.12, 0.5, 2)
    bar, deep = rng.uniform(0.01, 0.03), 0.015
    tone = prints.plain(prints.colour(rng))
    bars = [
        box([w, deep, bar], 0.001).moved([x, y - deep / 2, z + s])
        for s in (-h / 2, h / 2 - bar)
    ]
    bars += [
        box([bar, deep, h - 2 * bar], 0.001).moved(
            [x + s, y - deep / 2, z - h / 2 + bar]
        )
        for s in (-w / 2 + bar / 2, w / 2 - bar / 2)
    ]
    mirror = rng.random() < 0.2
    image = prints.plain([225, 228, 228]) if mirror else prints.pattern(rng)
    sheet = panel(
        [x - w / 2, y - 0.004, z - h / 2],
        [w, 0, 0],
        [0, 0, h],
        "mirror" if mirror else "satin",
        image,
    )
    return [Part(join(bars), "satin", tone), sheet]


def socket(x: float, y: float, z: float) -> list[Part]:
    lay = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    plate = box([0.08, 0.01, 0.08], 0.003).moved([x, y - 0.005, z - 0.04])
    ring = lathe([[0, 0], [0.02, 0], [0.02, 0.001], [0, 0.001]], 24).moved(
        [x, y - 0.0105, z], lay
    )
    return [
        Part(plate, "satin", prints.plain([238, 238, 234])),
        Part(ring, "satin", prints.plain([205, 205, 202])),
    ]


def fronts(
    rng: Rng, width: float, height: float, y: float, top: float, skin: np.ndarray
) -> list[Part]:
    """Drawers or doors below a counter, with handles; their faces at `y`, their upper edge at `top`."""
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    w, h = width / columns, height / rows
    metal = prints.plain(rng.choice([[190, 190, 190], [60, 60, 60], [200, 165, 90]]))
    leaves, grips = [], []
    for i in range(columns):
        for j in range(rows):
            x, z = -width / 2 + (i + 0.5) * w, top - (j + 1) * h
            leaves.append(
                papered(box([w - 0.005, 0.018, h - 0.005], 0.002), 0.6, 0).moved(
                    [x, y, z]
                )
            )
            if rows > 1 or rng.random() < 0.5:
                bar = min(0.16, w * 0.5)
                a = np.array([x - bar / 2, y - 0.035, z + h * 0.75])
                grips.append(
                    sweep([a, a + [bar / 2, 0, 0], a + [bar, 0, 0]], 0.005, around=8)
                )
            else:
                grips.append(
                    box([0.025, 0.03, 0.025], 0.006).moved(
                        [x + w * 0.4, y - 0.02, z + h * 0.8]
                    )
                )
    return [Part(join(leaves), "satin", skin), Part(join(grips), "brushed", metal)]


def curtain(
    rng: Rng, x: float, y: float, width: float, low: float, skin: np.ndarray
) -> Part:
    """Folds of cloth hanging down from far above."""
    u = np.linspace(0, 1, 60)
    folds = 0.02 * np.sin(u * rng.uniform(30, 60)) + 0.01 * np.sin(u * 17 + 1)
    points = np.concatenate(
        [
            np.column_stack([x + u * width, y + folds, np.full(60, z)])
            for z in (low, 2.6)
        ]
    )
    uv = np.concatenate([np.column_stack([u * 2, np.full(60, v)]) for v in (0.0, 4.0)])
    i = np.arange(59)
    faces = np.concatenate(
        [np.stack([i, i + 1, i + 61], 1), np.stack([i, i + 61, i + 60], 1)]
    )
    return Part(Solid(points, uv, faces), "matt", skin)


def rug(
    rng: Rng,
    x: float,
    y: float,
    w: float,
    d: float,
    z: float,
    skin: np.ndarray,
    turned: float = 0.0,
) -> Part:
    """A flat cloth or rug with one print over it."""
    a = np.radians(turned)
    right, up = (
        np.array([np.cos(a), np.sin(a), 0]) * w,
        np.array([-np.sin(a), np.cos(a), 0]) * d,
    )
    return panel(np.array([x, y, z]) - right / 2 - up / 2, right, up, "matt", skin)
