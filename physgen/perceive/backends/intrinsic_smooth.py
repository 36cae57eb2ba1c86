"""Photo -> albedo and shading: what changes slowly is shading, what changes fast is albedo."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Intrinsic, Intrinsics, Labels, Rgb
from physgen.photometry import decode, luminance

DARKEST = 1e-3
"""Linear light added before the logarithm is taken."""


def smooth() -> Intrinsic:
    """The backend `smooth`."""
    return _smooth


def _smooth(rgb: Rgb, labels: Labels, normals: NDArray[np.float32]) -> Intrinsics:
    linear = decode(rgb)
    logs = np.log(luminance(linear) + DARKEST)
    slow = cv2.GaussianBlur(logs, (0, 0), 0.1 * max(labels.shape))
    shading = np.exp(slow - float(slow.max())).astype(np.float32)
    albedo = linear / shading[..., None]
    most = max(float(albedo.max()), 1e-6)
    return Intrinsics(np.clip(albedo / most, 0, 1).astype(np.float32), shading * np.float32(most))
