"""Faces beside the front of a box, closed to both ends behind other objects.

The top of a box behind its front is a parallelogram along an edge of the front. Its
thickness, slant and light are measured in its visible part, and hold all along the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from physgen.arrays import F32, F64, U16, Mask
from physgen.compile.world import Body
from physgen.render.sprites import Sprite


@dataclass(frozen=True)
class FaceTuning:
    """Limits of visible faces."""

    inside: int = 9
    """Depth of the sampled strip inside an edge, px."""
    edge_width: int = 2
    """Width of the rounded edge, px. A shape is halfway between front and back, so the
    front begins as far inside as the face reaches outside.
    """
    reach: float = 0.35
    """Largest thickness of a face, shares of its edge's length."""
    shortest: int = 12
    """Least length of an edge with a face, px."""
    least_thickness: float = 1.5
    """Least thickness of a face, px."""
    spread: float = 2.0
    """Largest difference of a face's thickness between its quartiles, px."""
    level: float = 0.1
    """Slope up to which an edge is level: the rows of the photo continue its face."""
    visible: float = 0.06
    """Least visible share of a face's length."""
    hidden_share: float = 0.1
    """Least hidden share of it; less is no gap."""
    corner: float = 0.05
    """Share of the length at each end that is rounded."""
    blend_width: float = 1.0
    """Width over which a completed face blends into the visible one, px."""
    slant: float = 1.5
    """Largest slant of a face's ends, px along the edge per px of thickness."""


FACE = FaceTuning()


@dataclass(frozen=True)
class _Edge:
    """An edge of a front, in px of the sprite."""

    start: F64
    direction: F64
    """Unit vector along the edge, (2,)."""
    outward: F64
    """Unit vector away from the front, (2,)."""
    length: float


@dataclass(frozen=True)
class _Band:
    """The strip beside an edge: rows lead outwards, columns along the edge."""

    light: F32
    """Linear light over coverage, (rows, columns, 3)."""
    pixels: Mask
    """Pixels of the box in the photo, (rows, columns)."""
    other: Mask
    """Pixels of other objects in the photo, (rows, columns)."""


@dataclass(frozen=True)
class _Face:
    """A face beside an edge."""

    thickness: float
    slant: float
    """Displacement along the edge per px outwards."""
    light: F32
    """Light by distance from `-inside` outwards, and along the edge, (rows, columns,
    3).
    """
    inside: int
    """Distance inside the edge at which the front begins, px."""


def with_closed_faces(
    sprite: Sprite, body: Body, labels: U16, bodies: Sequence[int] = ()
) -> Sprite:
    """Return a box's sprite with the hidden parts of the faces beside its front.

    `labels` (H, W): id k + 1 is body k; `bodies`: those that may hide it, and itself;
    all if empty.
    """
    if body.radius is not None or len(body.rings) != 1 or len(body.rings[0]) != 4:
        return sprite
    numbers = labels_on_box(sprite, labels, bodies)
    own = numbers == sprite.body + 1
    other = numbers > 0
    other &= ~own
    if not other.any():
        return sprite
    for edge in _edges(body, sprite):
        if not _may_have_face(edge):
            continue
        # The face beside an edge may be partly hidden: its visible part gives height
        # and slant.
        band = _band(sprite, edge, own, other)
        face = _visible_face(band)
        if face is not None:
            sprite = _paint(sprite, edge, face, other)
    return sprite


def _may_have_face(edge: _Edge) -> bool:
    """Check whether an edge is tilted, long enough, and on the upper side: the camera
    sees no face below a box.
    """
    is_tilted = np.abs(edge.direction).min() >= FACE.level
    return bool(is_tilted and edge.length >= FACE.shortest and edge.outward[1] < 0)


def labels_on_box(sprite: Sprite, labels: U16, bodies: Sequence[int]) -> U16:
    """Return the labels (h, w) of `bodies`, or of all if empty, on a sprite's box.

    They are 0 outside the photo.
    """
    height, width = sprite.coverage.shape
    x, y = sprite.corner
    numbers = np.zeros((height, width), labels.dtype)
    top = max(y, 0)
    left = max(x, 0)
    bottom = min(y + height, labels.shape[0])
    right = min(x + width, labels.shape[1])
    numbers[top - y : bottom - y, left - x : right - x] = labels[top:bottom, left:right]
    if bodies:
        numbers[~np.isin(numbers, np.add(bodies, 1))] = 0
    return numbers


def _edges(body: Body, sprite: Sprite) -> list[_Edge]:
    """Return the four edges of a box's front."""
    corners = body.rings[0] + body.center - np.asarray(sprite.corner)
    middle = corners.mean(axis=0)
    edges = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        direction = (end - start) / max(length, 1e-6)
        outward = np.array([direction[1], -direction[0]])
        if outward @ (start - middle) < 0:
            outward = -outward
        edges.append(_Edge(start, direction, outward, length))
    return edges


def _band(sprite: Sprite, edge: _Edge, own_mask: Mask, other: Mask) -> _Band:
    """Sample the strip beside an edge, one column and one row a pixel."""
    columns = np.arange(round(edge.length)) + 0.5
    rows = np.arange(-FACE.inside, max(round(FACE.reach * edge.length), 3)) + 0.5
    # A grid along the edge and outwards from it, in pixels of the photo.
    points = (
        edge.start
        + columns[None, :, None] * edge.direction
        + rows[:, None, None] * edge.outward
    ).astype(np.float32)
    x = points[..., 0]
    y = points[..., 1]
    colour = sprite.light / np.maximum(sprite.coverage, 1e-3)[..., None]
    light = cv2.remap(colour.astype(np.float32), x, y, cv2.INTER_LINEAR)
    masks = []
    for mask in (own_mask, other):
        picture = cv2.remap(mask.astype(np.uint8), x, y, cv2.INTER_NEAREST)
        masks.append(np.asarray(picture > 0, np.bool_))
    return _Band(np.asarray(light, np.float32), masks[0], masks[1])


def _visible_face(band: _Band) -> _Face | None:
    """Measure a face; None if too little of it is visible, or nothing is hidden."""
    heights = _visible_heights(band)
    is_hidden = band.other[FACE.inside : FACE.inside + 2].any(axis=0)
    visible_share = np.isfinite(heights).mean()
    if visible_share < FACE.visible or is_hidden.mean() < FACE.hidden_share:
        return None
    # A real face has one height along the edge; a shadow or a neighbour has not.
    lower, thickness, upper = np.nanpercentile(heights, (25, 50, 75))
    if upper - lower > FACE.spread:
        return None
    height = round(thickness)
    inside = min(height + FACE.edge_width, FACE.inside)
    face_light = band.light[FACE.inside - inside : FACE.inside + height]
    is_visible = np.abs(heights - thickness) <= FACE.spread
    light = _repeat_neighbours(face_light, is_visible)
    outer_rows = slice(FACE.inside, FACE.inside + height)
    slant = _slant(band.pixels[outer_rows], band.other[outer_rows])
    return _Face(float(thickness), slant, light, inside)


def _visible_heights(band: _Band) -> F64:
    """Return the thickness of a face by column, px; NaN if another object hides its
    end.
    """
    outside = band.pixels[FACE.inside :]
    rows, columns = outside.shape
    # The first pixel that is not the box's ends the face in each column.
    ends = np.where(outside.all(axis=0), rows, (~outside).argmax(axis=0))
    last_row = np.minimum(ends, rows - 1) + FACE.inside
    is_open = ~band.other[last_row, np.arange(columns)] & (ends < rows)
    margin = max(round(FACE.corner * columns), 1)
    is_open[:margin] = is_open[columns - margin :] = False
    is_face = is_open & (ends >= FACE.least_thickness)
    return np.where(is_face, ends, np.nan)


def _repeat_neighbours(light: F32, visible: Mask) -> F32:
    """Return light (rows, columns, 3) whose other columns repeat their `visible`
    neighbours.

    Both neighbours are mirrored at the ends of a gap, and blend into each other.
    """
    columns = np.arange(len(visible))
    places = np.flatnonzero(visible)
    after = np.searchsorted(places, columns).clip(0, len(places) - 1)
    before = (np.searchsorted(places, columns, side="right") - 1).clip(0)
    left, right = places[before], places[after]
    sources, weights = [], []
    for end in (left, right):
        mirror_columns = np.clip(2 * end - columns, 0, len(visible) - 1)
        # A neighbour that is narrower than the gap repeats its last column.
        sources.append(np.where(visible[mirror_columns], mirror_columns, end))
        weights.append(1 / (np.abs(columns - end) + 1.0))
    share = (weights[0] / (weights[0] + weights[1]))[:, None]
    blended_light = share * light[:, sources[0]] + (1 - share) * light[:, sources[1]]
    result = np.where(visible[:, None], light, blended_light)
    return np.asarray(result, np.float32)


def _slant(own_mask: Mask, other: Mask) -> float:
    """Return how far a face's visible end moves along the edge per px outwards."""
    slants = []
    last = own_mask.shape[1] - 1
    # Both ends of the face give a slant; the visible one counts.
    for mask, others, sign in (
        (own_mask, other, 1),
        (own_mask[:, ::-1], other[:, ::-1], -1),
    ):
        first = mask.argmax(axis=1)
        is_seen = mask.any(axis=1) & (first < last // 2)
        is_seen &= ~others[: len(mask)][np.arange(len(mask)), np.maximum(first - 1, 0)]
        if is_seen.sum() >= 3:
            rows = np.flatnonzero(is_seen)
            slants.append(sign * float(np.polyfit(rows, first[rows], 1)[0]))
    if not slants:
        return 0.0
    return float(np.clip(slants[0], -FACE.slant, FACE.slant))


def _paint(sprite: Sprite, edge: _Edge, face: _Face, other: Mask) -> Sprite:
    """Return the sprite with the hidden part of a face."""
    rows, columns = np.indices(sprite.coverage.shape)
    offset = np.stack([columns, rows], axis=2) - edge.start
    u = offset @ edge.direction
    v = offset @ edge.outward
    u = u - face.slant * np.maximum(v, 0)
    # The distance to the nearest side of the parallelogram softens its border.
    inside = np.minimum(np.minimum(u, edge.length - u), face.thickness - v) + 0.5
    share = np.clip(inside, 0, 1) * (v > -face.inside)
    hidden_mask = cv2.dilate(other.astype(np.uint8), np.ones((3, 3), np.uint8))
    # The face blends into the visible part beside it.
    share *= cv2.GaussianBlur(hidden_mask.astype(np.float32), (0, 0), FACE.blend_width)
    share = np.asarray(share, np.float32)
    last_row, last_column = np.subtract(face.light.shape[:2], 1)
    row = np.clip(v + face.inside - 0.5, 0, last_row).astype(np.float32)
    column = np.clip(u - 0.5, 0, last_column).astype(np.float32)
    colour = cv2.remap(face.light, column, row, cv2.INTER_LINEAR)
    light = colour * share[..., None]
    cover = sprite.coverage
    return replace(
        sprite,
        light=np.asarray(sprite.light * (1 - share[..., None]) + light, np.float32),
        coverage=np.asarray(cover * (1 - share) + share, np.float32),
    )
