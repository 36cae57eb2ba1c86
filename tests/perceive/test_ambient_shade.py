"""Soft light from all sides leaves it dark about feet and rims: found where drawn, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physgen import registry
from physgen.geometry.polygon import Disc, Region, Ring
from physgen.perceive.roles import BoundaryGuess, LightGuess, PhotoObject, Shadows, Wall
from physgen.perceive.shadow.ambient_shade import contrast_over_chance, missing_light
from physgen.photometry import DistantLight
from physgen.scene.scene import View

WIDTH, HEIGHT, FLOOR = 480, 320, 240.5
GUESS = LightGuess(DistantLight((0.0, -0.6, 0.8), 0.8, 0.4), 0.1, "")
DISCS = [(100.0, 90.0, 24.0), (250.0, 80.0, 24.0), (380.0, 150.0, 24.0), (160.0, 220.0, 24.0)]


def srgb(linear: np.ndarray) -> np.ndarray:
    v = np.clip(linear, 0, 1)
    return np.rint(255 * np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)).astype(np.uint8)


def ice() -> np.ndarray:
    """(H, W, 3) linear: two colours in wide stripes, and grain."""
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0)
    stripe = (np.arange(WIDTH) // 120 % 2 == 0)[None, :, None]
    picture = np.where(stripe, np.array([0.5, 0.55, 0.6]), np.array([0.15, 0.2, 0.5]))
    return picture * np.exp(0.03 * grain / grain.std())[..., None]


def stones(dark: float, moved: tuple[int, int] = (0, 0)) -> tuple[Shadows, np.ndarray, np.ndarray]:
    """What the role says of stones on ice, (H, W) how far each pixel is from their rims, and the ice in the light.

    Light at a rim falls by `dark` and comes back with distance; `moved`: the dark rims lie elsewhere.
    """
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    labels, things = np.zeros((HEIGHT, WIDTH), np.uint16), []
    away = np.full((HEIGHT, WIDTH), 1e3)
    for k, (cx, cy, r) in enumerate(DISCS, 1):
        labels[np.hypot(x - cx, y - cy) <= r] = k
        things.append(PhotoObject(k, Disc(np.array([cx, cy]), r), "curling stone"))
        away = np.minimum(away, np.abs(np.hypot(x - cx - moved[0], y - cy - moved[1]) - r))
    lit = ice()
    background = srgb(lit * np.exp(-dark * np.exp(-away / 6))[..., None])
    found = role(background, labels, things, BoundaryGuess(View.TOP, 1.0, "", ()))
    return found, np.where(labels > 0, -1.0, away), srgb(lit)


def role(
    background: np.ndarray, labels: np.ndarray, things: list[PhotoObject], setting: BoundaryGuess
) -> Shadows:
    matter = registry.make("physics")(background, things, None)
    coverage = (labels > 0).astype(np.float32)
    return registry.make("shadow")(background, coverage, labels, things, matter, setting, GUESS)


def test_rims_of_stones_are_found_and_lifted() -> None:
    found, away, lit = stones(0.35)
    assert found.clean is not None
    assert found.faint, "little was lifted: the first fill is kept"
    near = (away > 2) & (away < 8)
    before = np.abs(srgb(ice() * np.exp(-0.35 * np.exp(-away / 6))[..., None]).astype(int) - lit)[near].mean()
    after = np.abs(found.clean.astype(int) - lit)[near].mean()
    assert after < 0.5 * before
    assert found.owners is not None
    told = found.owners > 0
    assert told[(away > 2) & (away < 5)].mean() > 0.8
    assert not told[away > 25].any()
    assert np.unique(found.owners[told]).tolist() == [1, 2, 3, 4]


def test_no_rims_none_found() -> None:
    assert stones(0.0)[0].clean is None
    assert stones(0.0)[0].owners is None


def test_dark_rings_that_lie_beside_the_stones_are_paint() -> None:
    assert stones(0.35, moved=(0, -70))[0].clean is None


def plank(dark: float) -> tuple[Shadows, np.ndarray]:
    """What the role says of a plank on two feet under an even sky, and (H, W) where it must be dark: below it."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint16)
    ring = [(150, 214), (330, 214), (330, 241), (310, 241), (310, 226), (170, 226), (170, 241), (150, 241)]
    cv2.fillPoly(labels, [np.array(ring, np.int32)], 1)
    labels[241:] = 0
    outline = Region((Ring(np.array(ring, float) - [0, 0.5]),))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    below = np.exp(-(((y - 237) / 5.0) ** 2)) / (1 + np.exp((np.abs(x - 240) - 85) / 6.0))
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(0, 1, (HEIGHT, WIDTH)), (0, 0), 1.0)
    picture = np.array([0.42, 0.36, 0.30]) * np.exp(0.03 * grain / grain.std() - dark * below)[..., None]
    floor = Wall("floor", ((-0.5, FLOOR), (WIDTH - 0.5, FLOOR)), 0.5, 0.5, 0.9, "", "")
    found = role(
        srgb(picture), labels, [PhotoObject(1, outline, "board")], BoundaryGuess(View.SIDE, 1.0, "", (floor,))
    )
    open_ = cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    return found, open_ & (below > 0.3)


def test_it_is_dark_under_a_plank() -> None:
    found, below = plank(0.6)
    assert found.owners is not None
    assert (found.owners[below] > 0).mean() > 0.7
    assert not found.owners[:200].any()


def test_a_plank_in_the_light_throws_nothing() -> None:
    found, _ = plank(0.0)
    assert found.clean is None
    assert found.owners is None


def test_missing_light_is_measured_across_paint() -> None:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    spot = np.hypot(x - 120, y - 160) < 30
    background = srgb(ice() * np.exp(-0.3 * spot)[..., None])
    suspect = np.hypot(x - 120, y - 160) < 40
    free = np.ones((HEIGHT, WIDTH), np.float32)
    dark = missing_light(background, free, suspect, 50.0, from_above=True)
    inner = np.hypot(x - 120, y - 160) < 22
    assert np.median(dark[inner]) == pytest.approx(0.3, abs=0.05)
    contrast, times = contrast_over_chance(
        dark, free > 0, inner, suspect & ~spot, [(90, 0), (180, 60), (240, -60)]
    )
    assert contrast == pytest.approx(0.3, abs=0.05)
    assert times > 6
    elsewhere = np.roll(inner, 240, 1), np.roll(suspect & ~spot, 240, 1)
    _, times = contrast_over_chance(dark, free > 0, *elsewhere, [(-240, 0)])
    assert times == 0, "the spot is darker"
