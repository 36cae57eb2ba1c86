"""Shade of the floor along a base that touches the floor for the first time.

The photo shows the shade at a base that already stands on its floor; that shade moves
with the object. An object that lands, or stands on another side, needs a new one: light
does not reach the gap between base and floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from physgen.arrays import F32
from physgen.geometry.shadows import (
    Silhouette,
    floor_contact,
)
from physgen.render.contact_shade import SHADE
from physgen.render.shadow_decomposition import LitBackground
from physgen.render.stage import Slices, SpritePose
from physgen.render.standing_shade import STANDING

GAP_DEPTH = 0.55
"""Share of all light lost in the gap between a base and its floor; by eye on the
bundled scenes."""
FloorShade = tuple[Slices, F32]
"""Box on the canvas, and the factors (h, w) of the light in it."""


def floor_contact_shades(
    background: LitBackground,
    depth: float,
    stands: Sequence[SpritePose],
    figures: Mapping[int, Silhouette],
) -> list[FloorShade]:
    """Return the shades of the floor at new contacts.

    `depth`: share of light lost at a contact; `figures`: silhouettes by index of sprite.
    """
    shades: list[FloorShade] = []
    if not depth or background.setting.top:
        return shades
    for stand in stands:
        figure = figures.get(stand.k)
        if figure is None or stand.start == stand.pose:
            continue
        shade = _contact_shade(background, depth, stand, figure)
        if shade is not None:
            shades.append(shade)
    return shades


def _contact_shade(
    background: LitBackground, depth: float, stand: SpritePose, figure: Silhouette
) -> FloorShade | None:
    """Return the shade of the floor below one object; None without a new contact."""
    tilt = background.setting.tilt
    contact = floor_contact(figure, tilt)
    if contact is None:
        return None
    turn = abs(stand.pose.angle - stand.start.angle)
    strength = _new_share(background.casts[stand.k].start, turn, tilt)
    strength *= max(1 - contact.low / SHADE.reach, 0.0)
    if strength < SHADE.least_share:
        return None
    (left, top), darkness = _base_shade(figure, depth)
    width, height = background.setting.size
    # A margin of the darkness may be outside the canvas.
    part = darkness[max(-top, 0) : max(height - top, 0)]
    part = part[:, max(-left, 0) : max(width - left, 0)]
    if not part.size:
        return None
    top, left = max(top, 0), max(left, 0)
    box = np.s_[top : top + part.shape[0], left : left + part.shape[1]]
    factor = 1 - strength * part * _floor_share(figure, contact.row, box)
    return box, np.asarray(factor, np.float32)


def _floor_share(figure: Silhouette, floor: float, box: Slices) -> F32:
    """Return the share (h, w) of a box that shows the floor, which begins at a row."""
    rows = np.arange(box[0].start, box[0].stop)[:, None]
    columns = np.arange(box[1].start, box[1].stop)
    inside = np.minimum(columns - figure.ends[0], figure.ends[1] - columns)
    share = np.clip(inside + 0.5, 0, 1) * np.clip(rows - floor + 1, 0, 1)
    return np.asarray(share, np.float32)


def _new_share(start: Silhouette, turn: float, tilt: float) -> float:
    """Return the share of a contact with the floor that the photo does not show.

    0 for an object that stands on its floor in the photo; it rises with the rotation.
    """
    contact = floor_contact(start, tilt)
    if contact is None or contact.low > SHADE.reach:
        return 1.0
    if start.radius is not None:
        return 0.0
    low, high = STANDING.turns
    return min(max((turn - low) / (high - low), 0.0), 1.0)


def _base_shade(figure: Silhouette, depth: float) -> tuple[tuple[int, int], F32]:
    """Return the corner and the darkness (h, w) around the lowest rows of an object."""
    rows = figure.rows
    last = int(rows[-1]) if len(rows) else 0
    first = max(last + 1 - SHADE.reach, 0)
    margin = SHADE.reach
    cover = np.pad(figure.coverage[first : last + 1], margin)
    gap_shade = cv2.GaussianBlur(cover, (0, 0), SHADE.spread / 2)
    wide_shade = cv2.GaussianBlur(cover, (0, 0), SHADE.spread)
    # An edge of a plane hides half of the blur's weight.
    darkness = GAP_DEPTH * np.minimum(2 * gap_shade, 1)
    darkness += depth * np.minimum(2 * wide_shade, 1)
    corner = (figure.corner[0] - margin, figure.corner[1] + first - margin)
    return corner, np.asarray(darkness, np.float32)
