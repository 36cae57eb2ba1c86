"""Sizes, counts and coverage on a model's grid, against loops written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from physgen.refine.denoiser import Grid
from physgen.refine.latents import (
    cell_coverage,
    fit_to_grid,
    frames_held,
    hold_weights,
    latent_frames,
)

ANIMATEDIFF = Grid(8, 8, 512 * 512, 16)
WAN = Grid(8, 16, 832 * 480, 21, 4)


@pytest.mark.parametrize("grid", [ANIMATEDIFF, WAN])
@given(frames=st.integers(1, 300))
def test_latent_frames_are_just_enough(grid: Grid, frames: int) -> None:
    count = latent_frames(frames, grid)
    assert frames_held(count, grid) >= frames
    assert count == 1 or frames_held(count - 1, grid) < frames


@pytest.mark.parametrize("grid", [ANIMATEDIFF, WAN])
@pytest.mark.parametrize("size", [(64, 48), (61, 35), (17, 1), (1, 1)])
@pytest.mark.parametrize("count", [1, 6, 9])
def test_cells_hold_the_mean_coverage_of_their_pixels_and_frames(
    grid: Grid, size, count: int
) -> None:
    rng = np.random.default_rng(count)
    fit = fit_to_grid(size, grid)
    masks = [fit.mask(rng.random(size[::-1]).astype(np.float32)) for _ in range(count)]
    latents = latent_frames(count, grid)
    found = cell_coverage(iter(masks), latents, grid)
    width, height = fit.padded_size
    assert found.shape == (latents, 1, height // 8, width // 8)
    for f in range(latents):
        if grid.stride == 1:
            shown = [f]
        else:
            shown = [0] if f == 0 else [4 * f - 3, 4 * f - 2, 4 * f - 1, 4 * f]
        for y in range(height // 8):
            for x in range(width // 8):
                block = [
                    masks[min(k, count - 1)][
                        8 * y : 8 * y + 8, 8 * x : 8 * x + 8
                    ].mean()
                    for k in shown
                ]
                assert found[f, 0, y, x] == approx(np.mean(block), abs=1e-6)


@given(width=st.integers(1, 3000), height=st.integers(1, 3000))
def test_sizes_are_multiples_and_no_larger_than_a_model_knows(
    width: int, height: int
) -> None:
    fit = fit_to_grid((width, height), WAN)
    (sw, sh), (pw, ph) = fit.scaled_size, fit.padded_size
    assert pw % 16 == ph % 16 == 0
    assert 0 <= pw - sw < 16
    assert 0 <= ph - sh < 16
    if width * height <= WAN.area:
        assert fit.scaled_size == (width, height)
    else:
        assert sw * sh <= WAN.area + (sw + sh) / 2 + 1  # sides are rounded
        assert sw / width == approx(sh / height, abs=max(1 / width, 1 / height))


@pytest.mark.parametrize("size", [(61, 35), (64, 48), (1, 1), (1, 40), (7, 5)])
def test_frames_come_back_as_they_were_shown(size: tuple[int, int]) -> None:
    rgb = (
        np.random.default_rng(0)
        .integers(0, 256, (size[1], size[0], 3))
        .astype(np.uint8)
    )
    fit = fit_to_grid(size, WAN)
    shown = fit.to_model(rgb)
    assert shown.shape == (*fit.padded_size[::-1], 3)
    back = fit.from_model(shown.astype(np.float32))
    assert np.array_equal(back, rgb)
    grey = rgb[..., 0] / np.float32(255)
    assert np.array_equal(fit.mask(grey)[: size[1], : size[0]], grey)


@pytest.mark.parametrize("over", [1, 3, 9, 30])
def test_what_is_held_falls_smoothly_from_all_to_nothing(over: int) -> None:
    stay = hold_weights(40, over)
    assert stay[0] == 1
    assert not stay[over:].any()
    assert (np.diff(stay) <= 0).all()
    assert stay[: over + 1] == approx(
        1 - stay[: over + 1][::-1], abs=1e-6
    )  # as slow at its end as at its start
    assert np.abs(np.diff(stay)).max() <= 1.5 / over + 1e-6
    assert not hold_weights(40, 0).any()
