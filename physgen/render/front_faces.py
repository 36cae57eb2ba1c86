"""Front faces of objects, and the visible upper sides of blocks behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from physgen.arrays import F32
from physgen.compile.world import Body
from physgen.photometry import DistantLight
from physgen.render.block_tops import TOPS, top_of_book
from physgen.render.sprites import (
    CUT,
    Sides,
    Sprite,
)


@dataclass(frozen=True)
class FrontFaceTuning:
    """Visible heights of faces and tops."""

    face_height: float = 0.7
    """Height of an object's picture above and below its shape, px, that is not just a
    ragged border.
    """
    side_share: float = 0.8
    """Share of a visible top that the sides show, since edges are rounded; by tune."""


FACE = FrontFaceTuning()


def add_front_face(
    sprite: Sprite, body: Body, light: DistantLight, has_pages: bool
) -> Sprite:
    """Return the sprite with its `face`: the height of its picture below its shape.

    It counts only if the picture also reaches as far above the shape. A block with a
    visible top also gets its `sides`; one that may have pages (`has_pages`), the
    photo's.
    """
    is_solid = sprite.coverage >= 0.5
    rows = np.flatnonzero(is_solid.any(axis=1))
    if body.radius is not None or not len(rows):
        return sprite
    shape = np.concatenate(body.rings)[:, 1] + body.center[1] - sprite.corner[1]
    face = float(min(shape.min() - rows[0], rows[-1] - shape.max())) + 0.5
    if face < FACE.face_height:
        return sprite
    # The top of a block is the band of its picture above the front.
    first = float(rows[0] - 0.5 + 2 * face)
    is_above = np.arange(len(is_solid)) < first - 0.5
    top = (sprite.coverage >= 1) & is_above[:, None]
    has_four_corners = len(body.rings) == 1 and len(body.rings[0]) == 4
    top_rows = is_solid.argmax(axis=0)[is_solid.any(axis=0)]
    is_level = np.ptp(np.percentile(top_rows, (25, 75))) <= CUT.top_variation
    if not (has_four_corners and top.any() and is_level):
        return replace(sprite, face=face)
    colour = np.median(sprite.light[top], axis=0)
    depth = FACE.side_share * 2 * face
    columns = _columns(sprite, body)
    pages = None
    if has_pages:
        pages = top_of_book(sprite.light, sprite.coverage, first, columns, light)
    if pages is not None:
        first = pages.edge
        depth = max(2 * face, first - rows[0])
        colour = _cover_colour(sprite, first, columns)
    sides = Sides(first, depth, colour, light, pages)
    return replace(sprite, face=face, sides=sides)


def _columns(sprite: Sprite, body: Body) -> tuple[int, int]:
    """Return the first and the last column of a body's shape, px of its sprite."""
    x = np.concatenate(body.rings)[:, 0] + body.center[0] - sprite.corner[0]
    return max(round(x.min()), 0), min(round(x.max()), sprite.coverage.shape[1] - 1)


def _cover_colour(sprite: Sprite, first: float, columns: tuple[int, int]) -> F32:
    """Return the linear light (3,) of a book's covers above the first row of
    its front.
    """
    band = np.zeros_like(sprite.coverage, np.bool_)
    left, right = columns
    width = max(round(TOPS.cover * (right - left)), 1)
    for start in (left, right + 1 - width):
        band[: ceil(first), start : start + width] = True
    is_cover = band & (sprite.coverage >= 1)
    if not is_cover.any():
        is_cover = sprite.coverage >= 1
    return np.asarray(np.median(sprite.light[is_cover], axis=0), np.float32)
