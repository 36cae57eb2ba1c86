"""Backend label=shape: labels from outlines alone, with low confidence.

An outline can suggest `ball`, `block`, `stick`, `object`, and `bottle` if it has a
distinct neck.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from physgen.geometry.polygon import Disc, Outline, Region, mass_properties
from physgen.geometry.scale import box_sides
from physgen.perceive.roles import Label, Labels, Name, PhotoObject, Rgb
from physgen.perceive.spheres import is_shaded_as_sphere


@dataclass(frozen=True)
class ShapeConstants:
    """Constants of the labels."""

    # Least share of its smallest bounding box that a block covers.
    boxy: float = 0.88
    # Least ratio of length to width of a stick.
    long: float = 8.0
    # Least overlap of a bottle's outline and its mirror image.
    symmetry: float = 0.9


SHAPE = ShapeConstants()


def shape() -> Label:
    """Return the backend `shape`."""
    return _shape


def _shape(
    rgb: Rgb, labels: Labels, objects: Sequence[PhotoObject]
) -> Mapping[int, Name]:
    return {item.id: _name(rgb, item.outline, item.cut) for item in objects}


def _name(rgb: Rgb, outline: Outline, cut: bool) -> Name:
    if isinstance(outline, Disc):
        is_ball = is_shaded_as_sphere(rgb, outline)
        if is_ball:
            return Name("ball", 0.5)
        return Name("object", 0.2)
    long, short = box_sides(outline)
    if len(outline.rings) == 1:
        if mass_properties(outline).area / (long * short) > SHAPE.boxy:
            if long > SHAPE.long * short and not cut:
                return Name("stick", 0.3)
            return Name("block", 0.4)
        if not cut and _detect_narrow_neck(outline):
            return Name("bottle", 0.35)
    return Name("object", 0.2)


def _detect_narrow_neck(outline: Region) -> bool:
    """Return whether an outline is an upright, symmetric body with a narrow neck."""
    left, right = _profile(outline)
    widths = right - left
    height = float(np.ptp(outline.rings[0].outer[:, 1]))
    body = float(np.median(widths[30:58]))
    neck = float(np.median(widths[2:12]))
    if not (1.8 < height / max(body, 1e-6) < 5 and 0.15 < neck / body < 0.6):
        return False
    # The halves left and right of the middle line must be equal.
    middle = float(np.median((left + right) / 2))
    common = 2 * np.minimum(middle - left, right - middle).clip(0)
    # From the neck downwards the width may not fall noticeably.
    narrowing = np.diff(
        np.array([float(np.median(widths[k : k + 6])) for k in range(2, 40, 6)])
    )
    return bool(
        common.sum() > SHAPE.symmetry * widths.sum()
        and (narrowing > -0.08 * body).all()
    )


def _profile(outline: Region) -> tuple[np.ndarray, np.ndarray]:
    """Return the left and right ends (60,) of an outline in 60 slices from the
    top, px.
    """
    border = outline.rings[0].outer
    low = border[:, 1].min()
    high = border[:, 1].max()
    ends = np.roll(border, -1, axis=0)
    left = np.zeros(60)
    right = np.zeros(60)
    for k, y in enumerate(low + (np.arange(60) + 0.5) / 60 * (high - low)):
        # Edges that cross the height y have one end above and one below.
        meets = (border[:, 1] <= y) != (ends[:, 1] <= y)
        (x0, y0), (x1, y1) = border[meets].T, ends[meets].T
        x = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        left[k], right[k] = x.min(), x.max()
    return left, right
