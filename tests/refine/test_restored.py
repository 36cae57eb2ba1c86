"""How changes come back to the frames: identities to the byte, and blends in linear light written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physgen.photometry import decode, encode
from physgen.refine.fusion import restore_detail

CODES = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
NOTHING = np.zeros((16, 16), np.float32)
rng = np.random.default_rng(0)
REFINED = rng.normal(0.5, 0.6, CODES.shape).astype(np.float32)
GUIDED = rng.normal(0.5, 0.6, CODES.shape).astype(np.float32)
KEEP = {"detail": 1.0, "lock": 0.0, "held_share": 0.0}


@pytest.mark.parametrize("held", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("lock", [0.0, 0.4, 1.0])
def test_what_the_model_leaves_alone_is_the_guidance_to_the_byte(
    lock: float, held: float
) -> None:
    cover = rng.random((16, 16)).astype(np.float32)
    made = restore_detail(
        CODES, GUIDED, GUIDED.copy(), cover, detail=1.0, lock=lock, held_share=held
    )
    assert np.array_equal(made, CODES)


def test_with_detail_it_is_the_guidance_and_what_changed() -> None:
    wanted = np.clip(CODES / 255 + REFINED.astype(np.float64) - GUIDED, 0, 1) * 255
    made = restore_detail(CODES, REFINED, GUIDED, NOTHING, **KEEP)
    assert np.abs(made - wanted).max() <= 0.5 + 1e-4


@given(detail=st.floats(0, 1), lock=st.floats(0, 1))
def test_a_frame_that_is_held_is_the_guidance_to_the_byte(
    detail: float, lock: float
) -> None:
    assert np.array_equal(
        restore_detail(
            CODES, REFINED, GUIDED, NOTHING, detail=detail, lock=lock, held_share=1.0
        ),
        CODES,
    )


def test_locked_objects_are_the_guidance_to_the_byte_and_borders_mix_light() -> None:
    cover = np.zeros((16, 16), np.float32)
    cover[4:10, 4:10], cover[10, 4:10] = 1, 0.5
    made = restore_detail(
        CODES, REFINED, GUIDED, cover, detail=1.0, lock=1.0, held_share=0.0
    )
    free = restore_detail(CODES, REFINED, GUIDED, NOTHING, **KEEP)
    assert np.array_equal(made[cover == 1], CODES[cover == 1])
    assert np.array_equal(made[cover == 0], free[cover == 0])
    half = 255 * encode((decode(free[10, 4:10]) + decode(CODES[10, 4:10])) / 2)
    assert (
        np.abs(made[10, 4:10] - half).max() <= 1.0
    )  # at most one code off the rounded curve
    assert (
        np.abs(
            made[10, 4:10].astype(int)
            - (free[10, 4:10].astype(int) + CODES[10, 4:10]) / 2
        ).max()
        > 10
    )


def test_codes_that_neither_side_changes_survive_the_mixing() -> None:
    """Guidance and refined equal: mixing in light gives each of the 256 codes back."""
    cover = np.full((16, 16), 0.37, np.float32)
    made = restore_detail(
        CODES,
        CODES / np.float32(255),
        CODES / np.float32(255),
        cover,
        detail=0.0,
        lock=0.8,
        held_share=0.0,
    )
    assert np.array_equal(made, CODES)
