"""An object's normals -> how its shading changes as it turns in the picture's plane (Lambert; the paper, section 3.3).

Albedo need not be known: the photo's light times the ratio of two shadings is albedo times the new one.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.photometry import DistantLight

F32 = NDArray[np.float32]

MOST = 3.0
"""Times brighter or darker than in the photo, at most: beyond, normals or light are in error."""
FACING = 0.02
"""Of the shading, by which it must change somewhere for the normals to be worth keeping."""


@dataclass(frozen=True)
class Relief:
    """Shading of one object on its sprite's box, by how far it has turned: Lambert's law is linear in the light."""

    along: F32
    """(h, w): intensity x (n . l) in the picture's plane, over the photo's shading."""
    across: F32
    """(h, w): the same with the light turned by a quarter from +x to +y."""
    fixed: F32
    """(h, w): the same along the view, which no turn changes."""
    even: F32
    """(h, w): ambient light over the photo's shading."""

    def ratio(self, turn: float) -> F32:
        """(h, w) by which light is multiplied where the object has turned by `turn` rad."""
        facing: F32 = np.asarray(
            cv2.addWeighted(self.along, cos(turn), self.across, -sin(turn), 0.0), np.float32
        )
        facing += self.fixed
        np.maximum(facing, 0, out=facing)
        facing += self.even
        return np.asarray(np.clip(facing, 1 / MOST, MOST, out=facing), np.float32)


def lambert(light: DistantLight, normals: F32) -> F32:
    """(h, w) of normals (h, w, 3)."""
    facing = normals @ np.array(light.direction, np.float32)
    return np.asarray(
        np.float32(light.ambient) + np.float32(light.intensity) * np.maximum(facing, 0), np.float32
    )


def relief(normals: F32, known: NDArray[np.bool_], light: DistantLight) -> Relief | None:
    """`normals` (h, w, 3), of which those `known` (h, w) are the object's; None where turning changes nothing."""
    if not known.any() or light.intensity <= 0:
        return None
    weight = known.astype(np.float32)
    carried = np.where(known[..., None], normals, np.float32(0))
    for sigma in (1.0, 3.0):
        norm = cv2.GaussianBlur(weight, (0, 0), sigma)
        spread = cv2.GaussianBlur(carried * weight[..., None], (0, 0), sigma)
        new = (weight == 0) & (norm > 1e-3)
        carried[new] = spread[new] / norm[new][:, None]
        weight[new] = 1.0
    carried[weight == 0] = (0.0, 0.0, 1.0)
    carried /= np.maximum(np.linalg.norm(carried, axis=2, keepdims=True), 1e-6)
    shade = np.maximum(lambert(light, carried), np.float32(0.05))
    x, y, z = (np.float32(light.intensity * part) / shade for part in light.direction)
    found = Relief(
        along=np.asarray(carried[..., 0] * x + carried[..., 1] * y, np.float32),
        # turned by a quarter, (x, y) is (-y, x)
        across=np.asarray(carried[..., 1] * x - carried[..., 0] * y, np.float32),
        fixed=np.asarray(carried[..., 2] * z, np.float32),
        even=np.asarray(np.float32(light.ambient) / shade, np.float32),
    )
    changes = max(float(np.abs(found.ratio(turn)[known] - 1).mean()) for turn in (0.8, 1.6, 3.1, 4.7))
    return found if changes > FACING else None
