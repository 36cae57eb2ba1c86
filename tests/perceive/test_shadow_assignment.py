"""Shadows drawn by known geometry: each belongs to what throws it, and to nothing where light is even."""

from __future__ import annotations

import cv2
import numpy as np

from physgen import registry
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.roles import BoundaryGuess, LightGuess, PhotoObject, Shadows, Wall
from physgen.photometry import DistantLight
from physgen.scene.scene import View

WIDTH, HEIGHT = 480, 320
FLOOR, TILT, THICK = 240.5, 0.12, 40
GUESS = LightGuess(DistantLight((0.0, -0.6, 0.8), 0.8, 0.4), 0.1, "")
BLOCKS = [(90, 119, 180), (230, 259, 190)]
"""First and last column, and the top row; they end on FLOOR."""
SIDE, BACK = 1.3, -0.8
"""px right and towards the viewer for each px of height."""


def srgb(linear: np.ndarray) -> np.ndarray:
    v = np.clip(linear, 0, 1)
    return np.rint(255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.uint8)


def surface() -> np.ndarray:
    """(H, W, 3) linear: an even floor with grain."""
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0)
    return np.array([0.42, 0.36, 0.30]) * np.exp(0.03 * grain / grain.std())[..., None]


def shadow(x0: float, x1: float, top: float, side: float = SIDE) -> np.ndarray:
    """(H, W) 0..1 the floor that a block keeps from a small light: its foot, drawn out along the light."""
    high, middle = FLOOR - top, FLOOR - TILT * THICK / 2
    corners = np.array(
        [
            (x + side * k * high, middle + TILT * (z + BACK * k * high))
            for x in (x0 - 0.5, x1 + 0.5)
            for z in (-THICK / 2, THICK / 2)
            for k in (0, 1)
        ]
    )
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    points = np.rint((corners + 0.5) * 16 - 8).astype(np.int32)
    cv2.fillPoly(mask, [cv2.convexHull(points)], 255, cv2.LINE_AA, 4)
    return cv2.GaussianBlur(mask.astype(np.float32) / 255, (0, 0), 1.0)


def seen(blocks: list[tuple[int, int, int]], shade: np.ndarray, mirror: bool = False) -> Shadows:
    """What the role `shadow` says of blocks before a surface of so much `shade` (H, W)."""
    background = srgb(surface() * (1 - 0.55 * shade)[..., None])
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    things = []
    for k, (x0, x1, top) in enumerate(blocks, 1):
        labels[top:241, x0 : x1 + 1] = k
        a, b = (WIDTH - 1 - x1, WIDTH - 1 - x0) if mirror else (x0, x1)
        ring = [[a - 0.5, top - 0.5], [b + 0.5, top - 0.5], [b + 0.5, FLOOR], [a - 0.5, FLOOR]]
        things.append(PhotoObject(k, Region((Ring(np.array(ring)),)), "wooden block"))
    if mirror:
        background, labels = np.ascontiguousarray(background[:, ::-1]), np.ascontiguousarray(labels[:, ::-1])
    floor = Wall("floor", ((-0.5, FLOOR), (WIDTH - 0.5, FLOOR)), 0.5, 0.5, 0.9, "", "")
    return role(background, labels, things, BoundaryGuess(View.SIDE, 1.0, "", (floor,)))


def role(
    background: np.ndarray, labels: np.ndarray, things: list[PhotoObject], setting: BoundaryGuess
) -> Shadows:
    matter = registry.make("physics")(background, things, None)
    coverage = (labels > 0).astype(np.float32)
    return registry.make("shadow")(background, coverage, labels, things, matter, setting, GUESS)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def free(blocks: list[tuple[int, int, int]]) -> np.ndarray:
    mask = np.ones((HEIGHT, WIDTH), bool)
    for x0, x1, top in blocks:
        mask[top - 2 : 243, x0 - 2 : x1 + 3] = False
    return mask


def test_each_shadow_belongs_to_what_throws_it() -> None:
    each = [shadow(*block) for block in BLOCKS]
    found = seen(BLOCKS, np.maximum(*each))
    assert found.owners is not None
    assert found.owners.dtype == np.uint16
    open_ = free(BLOCKS)
    for k, one in enumerate(each, 1):
        assert overlap(open_ & (found.owners == k), open_ & (one > 0.2)) > 0.6
        core = open_ & (one > 0.9)
        assert (found.owners[core] == k).mean() > 0.95
    assert not found.owners[:200].any(), "the wall behind has none"


def test_a_mirrored_photo_has_mirrored_owners() -> None:
    shade = np.maximum(*(shadow(*block) for block in BLOCKS))
    plain, mirrored = seen(BLOCKS, shade), seen(BLOCKS, shade, mirror=True)
    assert plain.owners is not None
    assert mirrored.owners is not None
    for k in (1, 2):
        assert overlap(plain.owners == k, mirrored.owners[:, ::-1] == k) > 0.9


def test_from_above_each_ball_owns_the_patch_beside_it() -> None:
    """On a table a ball's shadow from 45 degrees is its disc moved by one radius and drawn out along the light."""
    balls = [(120.0, 100.0, 22.0), (260.0, 120.0, 22.0), (190.0, 220.0, 22.0)]
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels, shade, things = np.zeros((HEIGHT, WIDTH), np.uint16), np.zeros((HEIGHT, WIDTH), np.float32), []
    each = []
    for k, (cx, cy, r) in enumerate(balls, 1):
        labels[np.hypot(x - cx, y - cy) <= r] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), r), "ball"))
        each.append(np.hypot((x - cx - r) / 2**0.5, y - cy) <= r)
        np.maximum(shade, cv2.GaussianBlur(each[-1].astype(np.float32), (0, 0), 1.0), out=shade)
    background = srgb(surface() * (1 - 0.55 * shade)[..., None])
    found = role(background, labels, things, BoundaryGuess(View.TOP, 1.0, "", ()))
    assert found.owners is not None
    open_ = cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    for k, one in enumerate(each, 1):
        assert overlap(open_ & (found.owners == k), open_ & one) > 0.6
