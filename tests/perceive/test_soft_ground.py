"""Softly shaded ground: its shading is interpolated, its texture copied."""

from __future__ import annotations

import cv2
import numpy as np

from physgen.perceive.backends.inpaint_fill import fill
from physgen.perceive.inpaint.copy_offsets import match_patches
from physgen.perceive.inpaint.shift_map import block_others
from physgen.perceive.inpaint.soft_ground import find_soft_pieces, interpolate_shading

SHAPE = 160, 240


def stripes_in_glare() -> tuple[np.ndarray, np.ndarray]:
    """Return stripes (H, W, 3) in a glare that grows to the right, and the glare."""
    columns = np.arange(SHAPE[1], dtype=np.float32)
    glare = np.broadcast_to(80 + 120 * (columns / SHAPE[1]) ** 2, SHAPE)
    stripes = 12 * np.sign(np.sin(columns * 2 * np.pi / 6))
    picture = np.repeat((glare + stripes)[..., None], 3, axis=2)
    return picture.astype(np.float32), glare


def hole_of(rows: slice, columns: slice) -> np.ndarray:
    hole = np.zeros(SHAPE, np.bool_)
    hole[rows, columns] = True
    return hole


def test_a_glare_is_soft_and_an_edge_is_not() -> None:
    picture, _ = stripes_in_glare()
    hole = hole_of(slice(40, 120), slice(80, 200))
    assert (find_soft_pieces(picture, hole) == hole).all()
    picture[80:] -= 70
    assert not find_soft_pieces(picture, hole).any()


def test_shading_is_interpolated_across_the_hole() -> None:
    picture, glare = stripes_in_glare()
    hole = hole_of(slice(60, 100), slice(100, 150))
    picture[hole] = 0
    shading = interpolate_shading(picture, hole).mean(axis=2)
    assert np.abs(shading - glare)[hole].max() < 12


def test_a_soft_horizon_continues_behind_an_object() -> None:
    rows = np.arange(SHAPE[0], dtype=np.float32)[:, None]
    columns = np.arange(SHAPE[1], dtype=np.float32)
    # A backdrop whose bend is 40 levels darker, and light that grows to the right.
    grey = 180 - 40 / (1 + np.exp((70 - rows) / 6)) + 0.1 * columns
    backdrop = np.repeat(grey[..., None], 3, axis=2).astype(np.float32)
    hole = hole_of(slice(30, 150), slice(60, 180))
    picture = np.where(hole[..., None], np.float32(20), backdrop)
    shading = interpolate_shading(picture, hole)
    assert np.abs(shading - backdrop)[hole].max() < 3


def test_grain_on_a_ramp_of_colours_has_no_steps() -> None:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    ramp = np.stack(
        [
            60 + 0.5 * columns + 0.2 * rows,
            90 + 0.3 * columns - 0.1 * rows,
            190 - 0.4 * columns + 0.2 * rows,
        ],
        axis=-1,
    )
    noise = np.random.default_rng(0).normal(0, 1, SHAPE).astype(np.float32)
    grain = cv2.GaussianBlur(noise, (0, 0), 1.5)
    grain *= 9 / grain.std()
    rgb = np.clip(ramp + grain[..., None], 0, 255).astype(np.uint8)
    hole = np.hypot((columns - 125) / 75, (rows - 85) / 55) < 1
    rgb[hole] = (200, 30, 30)
    result = fill()(rgb, hole).astype(np.float32)
    # Copies of whole colours differ from the ramp by 13 levels.
    error = cv2.GaussianBlur(result - ramp, (0, 0), 8)
    assert np.abs(error[hole]).max() < 10
    assert 7 < (result - ramp)[hole].std() < 11


def test_a_single_thing_is_rare_and_an_edge_is_not() -> None:
    random = np.random.default_rng(3)
    picture = np.full((*SHAPE, 3), 180, np.float32)
    picture[100:] = 60
    picture[85:105, 190:215] = (200, 60, 30)
    picture += random.normal(0, 2, picture.shape).astype(np.float32)
    hole = hole_of(slice(70, 120), slice(60, 120))
    matches = match_patches(picture, hole, hole)
    assert matches is not None
    edge = np.median(matches.rarity[98:103, 20:40])
    assert np.median(matches.rarity[84:106, 189:216]) > 5 * edge


def test_surroundings_of_other_pieces_are_no_sources() -> None:
    piece = hole_of(slice(60, 100), slice(20, 60))
    other = hole_of(slice(60, 100), slice(160, 200))
    blocked = block_others(piece, piece | other)
    assert blocked[80, 145]
    assert not blocked[80, 130]
    assert (blocked[piece | other]).all()
    # Pixels beside the piece itself stay known.
    assert not blocked[80, 62]
    # Too few sources would remain: only the holes themselves are blocked.
    wide = hole_of(slice(0, 160), slice(62, 240))
    assert (block_others(piece, piece | wide) == (piece | wide)).all()
