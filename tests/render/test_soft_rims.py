"""The rim of a blurred object fades without a bright line beside it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from physgen.photometry import decode, encode_u8
from physgen.render.soft_rims import continue_soft_rims
from physgen.render.sprites import Sprite, anchor_sprites, cut_sprites

SIZE = 100


def dark_object(blur: float) -> tuple[list[Sprite], np.ndarray, np.ndarray]:
    """Return the sprite of a dark square out of focus by `blur` px, the photo's light
    and the ground's.
    """
    square = np.zeros((SIZE, SIZE), np.float32)
    square[35:65, 35:65] = 1
    coverage = np.asarray(cv2.GaussianBlur(square, (0, 0), 0.7), np.float32)
    visible = cv2.GaussianBlur(square, (0, 0), blur)[..., None]
    ground = np.full((SIZE, SIZE, 3), 0.5, np.float32)
    rgb = encode_u8((ground * (1 - visible) + 0.02 * visible).astype(np.float32))
    labels = square.astype(np.uint16)
    absent = np.zeros(labels.shape, bool)
    background = encode_u8(ground)
    photo, behind = decode(rgb), decode(background)
    sprites = cut_sprites(rgb, labels, absent, coverage, background, {0: 0})
    return anchor_sprites(sprites, photo, behind, absent), photo, behind


def first_frame(sprite: Sprite, behind: np.ndarray) -> np.ndarray:
    """Draw a sprite at its place over its halo, (H, W, 3)."""
    canvas = behind.copy()
    assert sprite.halo is not None
    assert sprite.rest is not None
    (x, y), halo, _ = sprite.halo
    canvas[y : y + halo.shape[0], x : x + halo.shape[1]] += halo
    (left, top), (height, width) = sprite.corner, sprite.coverage.shape
    place = np.s_[top : top + height, left : left + width]
    canvas[place] = (1 - sprite.coverage[..., None]) * canvas[place]
    canvas[place] += sprite.light + sprite.rest
    return canvas


def halo_on_photo(sprite: Sprite) -> np.ndarray:
    assert sprite.halo is not None
    (x, y), halo, _ = sprite.halo
    canvas = np.zeros((SIZE, SIZE, 3), np.float32)
    canvas[y : y + halo.shape[0], x : x + halo.shape[1]] = halo
    return canvas


def test_first_frame_stays_the_photo() -> None:
    sprites, photo, behind = dark_object(8.0)
    sprite = continue_soft_rims(sprites, behind)[0]
    assert sprite is not sprites[0]
    # Halos reach 8 px here.
    near = np.s_[30:70, 30:70]
    assert np.abs(first_frame(sprite, behind) - photo)[near].max() < 1e-5


def test_uncovered_ground_is_as_dark_as_the_rim() -> None:
    sprites, _, behind = dark_object(8.0)
    before = halo_on_photo(sprites[0])[50].mean(axis=1)
    after = halo_on_photo(continue_soft_rims(sprites, behind)[0])[50].mean(axis=1)
    outside = after[31]
    assert outside < -0.05
    assert np.abs(before[34:36]).max() < 0.01
    assert (after[34:36] < 0.9 * outside).all()


def test_sharp_objects_stay_unchanged() -> None:
    sprites, _, behind = dark_object(0.7)
    assert continue_soft_rims(sprites, behind)[0] is sprites[0]


def test_contact_shade_below_alone_is_no_blurred_rim() -> None:
    sprites, photo, behind = dark_object(0.7)
    photo = photo.copy()
    photo[66:74, 35:65] *= 0.3
    absent = np.zeros((SIZE, SIZE), bool)
    bare = [replace(sprite, rest=None, halo=None) for sprite in sprites]
    shaded = anchor_sprites(bare, photo, behind, absent)
    assert continue_soft_rims(shaded, behind)[0] is shaded[0]
