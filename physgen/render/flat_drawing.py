"""Flat drawings of scenes without a photo: paper, walls as lines, coloured shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.arrays import F32
from physgen.compile.world import Body, World
from physgen.geometry.polygon import Array, Disc, Outline, Region, Ring, bounds
from physgen.geometry.raster import coverage_box
from physgen.maps import U8
from physgen.photometry import decode
from physgen.render.sprites import (
    MARGIN,
    Sprite,
)
from physgen.render.stage import Stage
from physgen.render.vehicle_wheels import add_drawn_wheels


@dataclass(frozen=True)
class FlatTuning:
    """Limits of flat drawings."""

    sprite_area: int = 4_000_000
    """Area of the sprite of one object above which only its visible part is
    drawn, px².
    """
    line_samples: int = 8
    """Sub-pixels per side for lines."""


FLAT = FlatTuning()


PAPER = (244, 242, 238)


INK = (70, 70, 74)


PALETTE = (
    (86, 130, 178), (214, 122, 84), (104, 160, 106), (196, 92, 104), (140, 116, 176),
    (208, 172, 82), (92, 166, 172), (170, 128, 104), (196, 134, 170), (128, 134, 146),
)  # fmt: skip
"""Colours of objects in turn, sRGB: different in hue and close in lightness, so that no
object stands out.
"""


def enlarged_world(
    world: World, outlines: Sequence[Outline], scale: float
) -> tuple[World, list[Outline]]:
    """Enlarge canvas, walls, bodies and outlines by `scale`, for drawing.

    Masses, velocities and other properties stay as they are.
    """

    def enlarge(points: Array) -> Array:
        # Pixel centres are at whole numbers, and the scale is about the picture's
        # corner.
        return (points + 0.5) * scale - 0.5

    def enlarge_body(body: Body) -> Body:
        wheels = [
            replace(w, axle=w.axle * scale, radius=w.radius * scale)
            for w in body.wheels
        ]
        return replace(
            body,
            center=enlarge(body.center),
            radius=None if body.radius is None else body.radius * scale,
            rings=tuple(ring * scale for ring in body.rings),
            wheels=tuple(wheels),
        )

    def enlarge_outline(outline: Outline) -> Outline:
        if isinstance(outline, Disc):
            return Disc(enlarge(outline.center), outline.radius * scale)
        rings = []
        for ring in outline.rings:
            rings.append(Ring(enlarge(ring.outer), tuple(map(enlarge, ring.holes))))
        return Region(tuple(rings))

    walls = []
    for wall in world.walls:
        walls.append(replace(wall, chains=tuple(map(enlarge, wall.chains))))
    width, height = world.size
    larger_world = replace(
        world,
        size=(ceil(width * scale - 1e-6), ceil(height * scale - 1e-6)),
        bodies=tuple(map(enlarge_body, world.bodies)),
        walls=tuple(walls),
    )
    return larger_world, list(map(enlarge_outline, outlines))


def flat_stage(
    world: World, outlines: Sequence[Outline], order: Sequence[int], scale: float
) -> Stage:
    """Draw a stage of flat shapes on a plain background, `scale` times as large."""
    larger_world, larger_outlines = enlarged_world(world, outlines, scale)
    sprites = flat_sprites(larger_world, larger_outlines, order, scale)
    return Stage(flat_background(larger_world, scale), sprites, scale=scale)


SHIFT_BITS = 4
"""Fractional bits of OpenCV's coordinates."""


FARTHEST = 2**24
"""Largest coordinate of OpenCV without overflow, 1 / 2**SHIFT_BITS px."""


def flat_background(world: World, pen: float = 1.0) -> U8:
    """Draw a background (H, W, 3) sRGB: paper, with walls as lines.

    Lines are on the side of the walls away from the objects.
    """
    width, height = world.size
    # Draw small pictures four times as large and reduce them, for smooth lines.
    scale = 4 if width * height <= 4_000_000 else 1
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    canvas[:] = PAPER
    line_width = round(2 * scale * pen)
    for wall in world.walls:
        for chain in wall.chains:
            # OpenCV draws from integers with a fixed number of binary digits.
            points = np.rint((chain + 0.5) * scale * 2**SHIFT_BITS).astype(np.int64)
            corners = np.clip(points, -FARTHEST, FARTHEST).astype(np.int32)
            line_type = cv2.LINE_AA
            cv2.polylines(
                canvas, [corners], False, INK, line_width, line_type, SHIFT_BITS
            )
    small_canvas = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small_canvas, np.uint8)


def flat_sprites(
    world: World, outlines: Sequence[Outline], order: Sequence[int], pen: float = 1.0
) -> list[Sprite]:
    """Draw one sprite per object: its colour with a darker rim, and a spoke in circles.

    Of an object much larger than the canvas, only the part near the canvas is drawn.
    """
    sprites = []
    for k in order:
        alpha, (left, top) = _nearby_coverage(outlines[k], world.size)
        if not alpha.size:
            continue
        # The margin leaves room for interpolation at the border of a sprite.
        alpha = np.pad(alpha, MARGIN)
        corner = (left - MARGIN, top - MARGIN)
        fill = decode(np.array(PALETTE[k % len(PALETTE)], np.uint8))
        lines = _lines(world.bodies[k], corner, alpha.shape, pen)[..., None]
        colour = fill * (1 - lines) + fill * 0.3 * lines
        picture = (alpha[..., None] * colour).astype(np.float32)
        sprite = Sprite(k, corner, picture, alpha)
        sprites.append(add_drawn_wheels(sprite, world, fill))
    return sprites


def _nearby_coverage(
    outline: Outline, size: tuple[int, int]
) -> tuple[F32, tuple[int, int]]:
    """Return the coverage of an outline and its corner, px.

    Of a large outline, only the part near a canvas of `size` (W, H) is drawn.
    """
    x0, y0, x1, y1 = bounds(outline)
    if (x1 - x0) * (y1 - y0) <= FLAT.sprite_area:
        return coverage_box(outline, None)
    width, height = size
    margin = min(max(size), FLAT.sprite_area // max(size))
    window = (-margin, -margin, width + margin, height + margin)
    return coverage_box(outline, window)


def _lines(
    body: Body, corner: tuple[int, int], shape: tuple[int, ...], pen: float
) -> F32:
    """Return the share (h, w) 0..1 of each pixel under the rim and the spoke."""
    height, width = shape
    scale = FLAT.line_samples if height * width < 250_000 else 2
    canvas = np.zeros((height * scale, width * scale), np.uint8)
    line_width = max(1, round(1.5 * scale * pen))

    def pixels(points: Array) -> NDArray[np.int32]:
        return np.rint((points + body.center - corner + 0.5) * scale).astype(np.int32)

    rings = list(map(pixels, body.rings))
    cv2.polylines(canvas, rings, True, 255, 2 * line_width)
    if body.radius is not None:
        spoke = pixels(np.array([[0.0, 0.0], [body.radius, 0.0]]))
        cv2.line(canvas, spoke[0].tolist(), spoke[1].tolist(), 255, line_width)
    small_canvas = cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)
    return (small_canvas / 255.0).astype(np.float32)
