"""Solids under a known light, drawn by Lambert's law: what normals, intrinsic and light are held to."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.roles import BoundaryGuess, PhotoObject
from physgen.photometry import DistantLight, encode_u8, sphere_normals
from physgen.scene.scene import View

SIZE = 240, 240
"""px: width, height."""
FRONT = np.array([0.0, 0.0, 1.0], np.float32)


def setting(view: View = View.SIDE) -> BoundaryGuess:
    return BoundaryGuess(view, 1.0, "", ())


def towards(x: float, y: float, z: float) -> tuple[float, float, float]:
    one = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return float(one[0]), float(one[1]), float(one[2])


def rendered(
    normals: np.ndarray, albedo: np.ndarray, light: DistantLight, exposure: float = 1.0
) -> np.ndarray:
    """(H, W, 3) uint8 of normals (H, W, 3) and albedo (H, W, 3)."""
    return encode_u8(np.clip(exposure * albedo * light.shade(normals)[..., None], 0, 1))


def ball(center=(118.0, 121.0), radius=60.0, number=1):
    """A ball's normals before a wall, its labels, and the thing."""
    normals, inside = sphere_normals(SIZE[1], SIZE[0], center, radius)
    thing = PhotoObject(number, Disc(np.array(center), radius), "ball")
    return normals, np.where(inside, number, 0).astype(np.uint16), thing


def can(left=80, right=160, top=60, bottom=190):
    """An upright cylinder before a wall, its labels, and the thing."""
    normals = np.broadcast_to(FRONT, (SIZE[1], SIZE[0], 3)).copy()
    u = (np.arange(left, right) - (left + right - 1) / 2) / ((right - left) / 2)
    across = np.stack([u, 0 * u, np.sqrt(1 - u * u)], -1).astype(np.float32)
    normals[top:bottom, left:right] = across
    return normals, *boxed(left, right, top, bottom)


def boxed(left, right, top, bottom):
    """Labels of a rectangle, and the thing."""
    labels = np.zeros((SIZE[1], SIZE[0]), np.uint16)
    labels[top:bottom, left:right] = 1
    a, b, c, d = left - 0.5, right - 0.5, top - 0.5, bottom - 0.5
    ring = Ring(np.array([[a, c], [b, c], [b, d], [a, d]]))
    return labels, PhotoObject(1, Region((ring,)), "block")


def block(x: float, y: float, w: float, h: float) -> Region:
    """Its lower left corner at x, y."""
    return Region(
        (Ring(np.array([[x, y - h], [x + w, y - h], [x + w, y], [x, y]], float)),)
    )


def plain(colour=(0.5, 0.32, 0.2), wall=(0.12, 0.16, 0.2), labels=None) -> np.ndarray:
    """(H, W, 3) albedo: one colour on the things, another on the wall."""
    albedo = np.broadcast_to(np.array(wall, np.float32), (SIZE[1], SIZE[0], 3)).copy()
    if labels is not None:
        albedo[labels > 0] = colour
    return albedo


def degrees(a, b) -> float:
    """Between two directions."""
    return float(np.degrees(np.arccos(np.clip(np.dot(a, b), -1, 1))))


def apart(said: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(...) degrees between unit normals (..., 3)."""
    return np.degrees(np.arccos(np.clip((said * true).sum(-1), -1, 1)))


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def beyond_halos(coverage: np.ndarray) -> np.ndarray:
    """(H, W): farther from objects than rims and contact shadows reach."""
    away = cv2.distanceTransform((coverage == 0).astype(np.uint8), cv2.DIST_L2, 5)
    return away > 42 / 512 * max(coverage.shape) + 2
