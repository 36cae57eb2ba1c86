"""World without a photo -> sprites of flat shapes and a plain background with the boundaries drawn in.

Lines are as wide as on a canvas of the scene's own size, `pen` times as wide on one that was `enlarged` so many times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.compile.world import Body, World
from physgen.outline.outline import Disc, Outline, Region, Ring, bounds
from physgen.outline.raster import coverage_box
from physgen.photometry import decode
from physgen.render.sprites import MARGIN, Sprite

U8 = NDArray[np.uint8]
F32 = NDArray[np.float32]

PAPER = (244, 242, 238)
INK = (70, 70, 74)
PALETTE = (
    (86, 130, 178), (214, 122, 84), (104, 160, 106), (196, 92, 104), (140, 116, 176),
    (208, 172, 82), (92, 166, 172), (170, 128, 104), (196, 134, 170), (128, 134, 146),
)  # fmt: skip
"""sRGB, one an object in turn: apart in hue and close in lightness, so that no object shouts."""
LARGE = 4_000_000
"""px² that the sprite of one object may take in full."""
FINE = 8
"""Sub-pixels a side when lines are drawn."""


def enlarged(world: World, outlines: Sequence[Outline], scale: float) -> tuple[World, list[Outline]]:
    """Canvas, walls, bodies and outlines as large as they are on a canvas with `scale` pixels a photo pixel.

    For drawing alone: masses, velocities and the like stay as they are.
    """

    def at(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points + 0.5) * scale - 0.5

    bodies = tuple(
        replace(
            body,
            center=at(body.center),
            radius=None if body.radius is None else body.radius * scale,
            rings=tuple(ring * scale for ring in body.rings),
        )
        for body in world.bodies
    )
    walls = tuple(replace(wall, chains=tuple(map(at, wall.chains))) for wall in world.walls)
    width, height = (ceil(side * scale - 1e-6) for side in world.size)
    shapes: list[Outline] = [
        Disc(at(shape.center), shape.radius * scale)
        if isinstance(shape, Disc)
        else Region(tuple(Ring(at(ring.outer), tuple(map(at, ring.holes))) for ring in shape.rings))
        for shape in outlines
    ]
    return replace(world, size=(width, height), bodies=bodies, walls=walls), shapes


def flat_background(world: World, pen: float = 1.0) -> U8:
    """(H, W, 3) sRGB: paper, with walls as lines on the side away from the objects."""
    width, height = world.size
    scale = 4 if width * height <= 4_000_000 else 1
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    canvas[:] = PAPER
    for wall in world.walls:
        for chain in wall.chains:
            points = np.rint((chain + 0.5) * scale * 16).astype(np.int64)
            points = np.clip(points, -(2**24), 2**24).astype(np.int32)
            cv2.polylines(canvas, [points], False, INK, round(2 * scale * pen), cv2.LINE_AA, shift=4)
    return np.asarray(cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def flat_sprites(
    world: World, outlines: Sequence[Outline], order: Sequence[int], pen: float = 1.0
) -> list[Sprite]:
    """One sprite an object: its colour, a darker rim, and for circles a spoke that shows how it turns.

    Of an object much larger than the canvas, only what lies in it and around is drawn.
    """
    sprites = []
    width, height = world.size
    around = min(max(width, height), LARGE // max(width, height))
    for k in order:
        x0, y0, x1, y1 = bounds(outlines[k])
        window = (-around, -around, width + around, height + around)
        alpha, (x0, y0) = coverage_box(outlines[k], window if (x1 - x0) * (y1 - y0) > LARGE else None)
        if not alpha.size:
            continue
        alpha = np.pad(alpha, MARGIN)
        corner = (x0 - MARGIN, y0 - MARGIN)
        fill = decode(np.array(PALETTE[k % len(PALETTE)], np.uint8))
        lines = _lines(world.bodies[k], corner, alpha.shape, pen)[..., None]
        colour = fill * (1 - lines) + fill * 0.3 * lines
        sprites.append(Sprite(k, corner, (alpha[..., None] * colour).astype(np.float32), alpha))
    return sprites


def _lines(body: Body, corner: tuple[int, int], shape: tuple[int, ...], pen: float) -> F32:
    """(h, w) in 0..1: how much of a pixel the rim and spoke cover."""
    height, width = shape
    fine = FINE if height * width < 250_000 else 2
    canvas = np.zeros((height * fine, width * fine), np.uint8)
    thick = max(1, round(1.5 * fine * pen))

    def pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.rint((points + body.center - corner + 0.5) * fine).astype(np.int32)

    cv2.polylines(canvas, [pixels(ring) for ring in body.rings], True, 255, 2 * thick)
    if body.radius is not None:
        spoke = pixels(np.array([[0.0, 0.0], [body.radius, 0.0]]))
        cv2.line(canvas, spoke[0].tolist(), spoke[1].tolist(), 255, thick)
    return (cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA) / 255.0).astype(np.float32)
