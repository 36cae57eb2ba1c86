"""Outlines -> names for things that nobody named: ball, block or object, with little confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from physgen.outline.outline import Disc, Outline, mass_properties
from physgen.perceive.roles import Label, Labels, Name, Rgb, Thing


def shape() -> Label:
    """The backend `shape`."""
    return _shape


def _shape(rgb: Rgb, labels: Labels, things: Sequence[Thing]) -> Mapping[int, Name]:
    return {thing.id: _name(thing.outline) for thing in things}


def _name(outline: Outline) -> Name:
    if isinstance(outline, Disc):
        return Name("ball", 0.5)
    if len(outline.rings) == 1:
        points = outline.rings[0].outer.astype(np.float32)
        (_, (w, h), _) = cv2.minAreaRect(points)
        if w * h > 0 and mass_properties(outline).area / (w * h) > 0.88:
            return Name("block", 0.4)
    return Name("object", 0.2)
