"""An object's normals -> how its shading changes as it turns in the picture's plane (Lambert; the paper, section 3.3).

Albedo need not be known: the photo's light times the ratio of two shadings is albedo times the new one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.geometry import rotation
from physgen.photometry import DistantLight

F32 = NDArray[np.float32]

MOST = 3.0
"""Times brighter or darker than in the photo, at most: beyond, normals or light are in error."""
FACING = 0.02
"""Of the shading, by which it must change somewhere for the normals to be worth keeping."""


@dataclass(frozen=True)
class Relief:
    """Normals of one object on its sprite's box."""

    normals: F32
    """(h, w, 3) unit: +x right, +y down, +z to the viewer, as in the photo."""
    light: DistantLight
    shade: F32
    """(h, w): the shading in the photo."""

    def ratio(self, turn: float) -> F32:
        """(h, w) by which light is multiplied where the object has turned by `turn` rad."""
        x, y, z = self.light.direction
        # the light as the object sees it: turned back
        bx, by = (rotation(turn).T @ np.array([x, y])).tolist()
        seen = DistantLight((bx, by, z), self.light.intensity, self.light.ambient)
        return np.asarray(np.clip(lambert(seen, self.normals) / self.shade, 1 / MOST, MOST), np.float32)


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
    found = Relief(carried, light, np.asarray(shade, np.float32))
    changes = max(float(np.abs(found.ratio(turn)[known] - 1).mean()) for turn in (0.8, 1.6, 3.1, 4.7))
    return found if changes > FACING else None
