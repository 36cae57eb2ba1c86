"""Outlines -> normals: round things as spheres, all else facing the viewer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.outline.outline import Disc
from physgen.perceive.roles import Labels, Normals, Rgb, Setting, Thing
from physgen.photometry import sphere_normals


def shape() -> Normals:
    """The backend `shape`."""
    return _shape


def _shape(rgb: Rgb, labels: Labels, things: Sequence[Thing], setting: Setting) -> NDArray[np.float32]:
    height, width = labels.shape
    normals = np.zeros((height, width, 3), np.float32)
    normals[..., 2] = 1
    for thing in things:
        if isinstance(thing.outline, Disc):
            x, y = (float(c) for c in thing.outline.center)
            own = labels == thing.id
            normals[own] = sphere_normals(height, width, (x, y), thing.outline.radius)[0][own]
    return normals
