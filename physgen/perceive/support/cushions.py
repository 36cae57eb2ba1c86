"""Rails of a table seen from above: the innermost straight edges outside all objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Array, bounds, cross
from physgen.maps import F32
from physgen.perceive.roles import PhotoObject, Wall
from physgen.perceive.support.floor_surface import MAJORITY, Photo
from physgen.perceive.working_size import working_size

Rail = tuple[float, float]
"""Slope, and height at x = 0, of a rail, turned to the photo's top; px."""


@dataclass(frozen=True)
class _RailLimits:
    """Limits of rails seen from above."""

    # Elasticity of a pool cushion: 0.6 to 0.9 (Mathavan et al. 2010).
    bounce: float = 0.75
    # Friction of a cushion.
    friction: float = 0.2
    # Confidence of a rail.
    confidence: float = 0.5
    # Least number of sides with rails; with fewer the table continues outside the
    # photo.
    sides: int = 2
    # Least contrast along most of a rail, CIE 1976 Lab.
    contrast: float = 3.0
    # px between an edge and the compared colours on both sides.
    distance: int = 3
    # Largest slope of a rail relative to the photo's side.
    slope: float = 0.04
    # Number of candidate slopes.
    slopes: int = 17
    # Number of columns with compared colours; more change nothing.
    columns: int = 256
    # Contrast relative to the sharpest edge from which an edge competes by its level.
    sharpness: float = 0.9
    # Width of the shadow of a rail on its table, as a share of the photo's longer side.
    shade: float = 0.015


RAIL = _RailLimits()
BORDER: Rail = (0.0, -0.5)
"""The photo's border in place of a rail."""


def find_cushions(photo: Photo, objects: Sequence[PhotoObject]) -> list[Wall]:
    """Return the rails of a table seen from above.

    On each side the rail is the innermost straight edge outside all objects. There are
    none if fewer than two sides have an edge, because the table then continues outside
    the photo. Billiard balls always have rails: the photo's border replaces invisible
    ones.
    """
    if not objects:
        return []
    rails = _find_rails(photo, _measure_free_rows(photo, objects))
    if any("billiard" in t.label for t in objects):
        rails = [rail or BORDER for rail in rails]
    if sum(rail is not None for rail in rails) < RAIL.sides:
        return []
    lines = []
    for turn, rail in enumerate(rails):
        lines.append(_turn_line_back(rail or BORDER, turn, photo.labels.shape))
    corners = [_find_crossing(lines[k - 1], lines[k]) for k in range(4)]
    cushions = []
    for k, rail in enumerate(rails):
        if rail is not None:
            cushions.append(
                Wall(
                    f"cushion-{k + 1}",
                    (corners[k], corners[(k + 1) % 4]),
                    RAIL.friction,
                    RAIL.bounce,
                    RAIL.confidence,
                    "edges",
                    "the table's rail",
                )
            )
    return cushions


def _measure_free_rows(photo: Photo, objects: Sequence[PhotoObject]) -> list[float]:
    """Return the width of the strip without objects on each side, px.

    The sides are top, right, bottom and left.
    """
    boxes = np.array([bounds(t.outline) for t in objects])
    height, width = photo.labels.shape
    return [
        float(boxes[:, 1].min()),
        float(width - 1 - boxes[:, 2].max()),
        float(height - 1 - boxes[:, 3].max()),
        float(boxes[:, 0].min()),
    ]


def _turn_line_back(rail: Rail, turn: int, shape: tuple[int, ...]) -> Array:
    """Return two points (2, 2) of a rail that `turn` calls of rot90 turned to the
    top.
    """
    height, width = shape
    slope, height_at_zero = rail
    points = np.array([[0.0, height_at_zero], [1.0, height_at_zero + slope]])
    # rot90 turned the right side to the top; turn the points back.
    for back in range(turn, 0, -1):
        if back % 2 == 0:
            size = height
        else:
            size = width
        points = np.stack([size - 1 - points[:, 1], points[:, 0]], 1)
    return points


def _find_rails(photo: Photo, free_rows: Sequence[float]) -> list[Rail | None]:
    """Return the rail on each side, turned to the top.

    A large photo is searched at reduced size.
    """
    size = working_size(photo.labels.shape)
    lab = photo.lab
    scale = 1.0
    if size is not None:
        scale = max(photo.labels.shape) / max(size)
        lab = np.asarray(cv2.resize(lab, size, interpolation=cv2.INTER_AREA))
    rails: list[Rail | None] = []
    for turn in range(4):
        rail = _find_rail(np.rot90(lab, turn), float(free_rows[turn]) / scale)
        if rail is not None and scale > 1:
            slope, row = rail
            # Pixel centres lie at whole numbers, hence the offsets of one half.
            rail = slope, (row + 0.5 - 0.5 * slope) * scale - 0.5 + 0.5 * slope
        rails.append(rail)
    return rails


@dataclass(frozen=True, order=True)
class _Edge:
    """A straight edge along the photo's top."""

    # CIE 1976 Lab.
    contrast: float
    slope: float
    # px: row at the photo's middle.
    row: float


def _find_rail(lab: F32, free_rows: float) -> Rail | None:
    """Return the lowest straight edge along the photo's top, or None.

    The edge is above row `free_rows`.
    """
    height, width = lab.shape[:2]
    edges = _find_level_edges(lab, free_rows)
    if not edges:
        return None
    # Among the innermost edges, prefer the most level of the sharp ones.
    innermost = max(edge.row for edge in edges)
    least_row = innermost - RAIL.shade * max(height, width)
    edges = [edge for edge in edges if edge.row >= least_row]
    least_contrast = RAIL.sharpness * max(edges).contrast
    best = min(
        (edge for edge in edges if edge.contrast >= least_contrast),
        key=lambda edge: (abs(edge.slope), -edge.contrast),
    )
    return best.slope, best.row - best.slope * width / 2


def _find_level_edges(lab: F32, free_rows: float) -> list[_Edge]:
    """Return the edges of nearly level slopes above row `free_rows`."""
    height = len(lab)
    distance = RAIL.distance
    rows = np.arange(2 * distance, int(min(free_rows, height / 2)) - distance)
    if len(rows) < 3:
        return []
    smooth_lab = np.asarray(
        cv2.blur(np.ascontiguousarray(lab), (1, distance)), np.float32
    )
    edges: list[_Edge] = []
    for slope in np.linspace(-RAIL.slope, RAIL.slope, RAIL.slopes):
        contrasts = _measure_contrasts(smooth_lab, rows, float(slope))
        peaks = (contrasts[1:-1] >= np.maximum(contrasts[:-2], contrasts[2:])) & (
            contrasts[1:-1] >= RAIL.contrast
        )
        edges += [
            _Edge(float(contrasts[k]), float(slope), float(rows[k]))
            for k in np.flatnonzero(peaks) + 1
        ]
    return edges


def _measure_contrasts(
    lab: F32, rows: NDArray[np.signedinteger], slope: float
) -> NDArray[np.float64]:
    """Return the contrast (n,) along lines of a slope through `rows` (n,) at the
    photo's middle.
    """
    height, width = lab.shape[:2]
    columns = np.arange(width // 5, width - width // 5, max(1, width // RAIL.columns))
    row_indices = rows[:, None] + np.rint(slope * (columns - width / 2)).astype(int)
    upper_rows = np.clip(row_indices - RAIL.distance, 0, height - 1)
    lower_rows = np.clip(row_indices + RAIL.distance, 0, height - 1)
    upper_colours = lab[upper_rows, columns]
    lower_colours = lab[lower_rows, columns]
    change = lower_colours - upper_colours
    # Project the change of colour at each column on its median direction.
    direction = np.median(change, axis=1)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-6)
    # Most of the length of an edge must have the contrast.
    return np.asarray(
        np.percentile(
            np.einsum("rcl,rl->rc", change, direction), 100 * (1 - MAJORITY), axis=1
        )
    )


def _find_crossing(first: Array, second: Array) -> tuple[float, float]:
    """Return the crossing of two lines, each through two points (2, 2)."""
    (p, q), (a, b) = first, second
    share = cross(a - p, b - a) / cross(q - p, b - a)
    x, y = p + share * (q - p)
    return round(float(x), 2), round(float(y), 2)
