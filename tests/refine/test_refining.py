"""A whole refinement with a model that is known exactly: sizes, windows, the first frame, seeds, what is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gaussian import Gaussian
from pytest import approx

from physgen.problems import InputError
from physgen.refine.denoiser import Denoiser, Grid, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings, prompt_of

HOW = RefineSettings(
    0.5, 5, 50, 0, PromptSettings("balls", "", None), lock=0.0, detail=1.0, hold=0
)
PLAIN = Grid(4, 8, 10**9, 64)
GRIDS = {
    "plain": PLAIN,
    "windows": replace(PLAIN, window=6),
    "stride": Grid(4, 16, 10**9, 64, 4),
    "small": replace(PLAIN, area=700),
}


def clip(size=(61, 35), count: int = 11) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A grained ramp with a disc that moves, and the disc's coverage."""
    rng = np.random.default_rng(3)
    yy, xx = np.mgrid[: size[1], : size[0]]
    ground = np.stack(
        [60 + xx % 150, 40 + yy % 150, 0 * xx + 120], axis=-1
    ) + rng.integers(-20, 21, (*yy.shape, 3))
    frames, coverage = [], []
    for k in range(count):
        cover = np.clip(9.5 - np.hypot(xx - 12 - 2 * k, yy - 17), 0, 1).astype(
            np.float32
        )
        colour = np.array([220, 210, 60])
        frames.append(
            np.rint(ground + cover[..., None] * (colour - ground)).astype(np.uint8)
        )
        coverage.append(cover)
    return frames, coverage


def refined(
    model: Denoiser,
    how: RefineSettings = HOW,
    size=(61, 35),
    count: int = 11,
    covers=None,
    **more,
) -> list[np.ndarray]:
    frames, coverage = clip(size, count)
    coverage = (
        coverage
        if covers is None
        else [np.full(f.shape[:2], covers, np.float32) for f in frames]
    )
    made = list(Refinement(model, how, size, count, **more).frames(frames, coverage))
    assert [(f.shape, f.dtype) for f in made] == [(f.shape, f.dtype) for f in frames]
    return made


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_objects_stay_nearer_than_the_rest(grid: Grid) -> None:
    frames, coverage = clip()
    made = np.stack(refined(Gaussian(grid)))
    change, cover = np.abs(made.astype(int) - frames).mean(axis=-1), np.stack(coverage)
    assert change[cover == 1].mean() < 0.9 * change[cover == 0].mean()


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_the_first_frame_is_kept_and_what_follows_leaves_it_slowly(grid: Grid) -> None:
    frames, _ = clip(count=20)
    free, eased = (
        np.stack(refined(Gaussian(grid), replace(HOW, hold=h), count=20)).astype(int)
        for h in (0, 9)
    )
    assert np.array_equal(eased[0], frames[0])
    stay = 1 - np.array([s * s * (3 - 2 * s) for s in np.minimum(np.arange(20) / 9, 1)])
    change, most = (
        np.abs(made - frames).mean(axis=(1, 2, 3)) for made in (eased, free)
    )
    assert most[0] > 3
    assert (change <= (1 - stay) * most + 0.5).all()  # half a code of rounding
    assert np.diff(change).max() < 0.3 * most.max()  # no jump anywhere on the way
    assert np.array_equal(eased[13:], free[13:])


class Broken(Gaussian):
    """Half precision that overflows."""

    def predict(self, latents, k, first):
        return super().predict(latents, k, first) * np.float32(np.nan)


def test_a_model_that_overflows_is_told_of() -> None:
    with pytest.raises(InputError, match="gives no finite picture; write dtype = "):
        refined(Broken())


def test_prompts_are_the_labels_most_frequent_first() -> None:
    assert (
        prompt_of(["cue", "ball", "ball", " ball ", "object", "", "thing"])
        == "ball, cue"
    )
    assert prompt_of(["Ball", "ball", "cup", "cup", "cup"]) == "cup, Ball"
    assert prompt_of([]) == ""


def test_what_a_still_picture_becomes_is_what_the_closed_form_says() -> None:
    """One grey video, no objects, no detail: every cell ends where the exact denoiser's steps lead its noise."""
    model = Gaussian(mean=0.2, spread=0.3)
    frames = [np.full((8, 16, 3), 130, np.uint8)] * 3
    how = replace(HOW, detail=0.0)
    made = np.stack(
        list(
            Refinement(model, how, (16, 8), 3).frames(
                frames, [np.zeros((8, 16), np.float32)] * 3
            )
        )
    )
    noise = np.random.default_rng(0).standard_normal((3, 3, 2, 4), np.float32)
    a, b, v, z0 = model.a, model.b, 0.09, 130 / 127.5 - 1
    z = a[0] * z0 + b[0] * noise - a[0] * 0.2
    for k in range(25):
        z = z * (a[k + 1] * a[k] * v + b[k + 1] * b[k]) / (a[k] ** 2 * v + b[k] ** 2)
    wanted = np.clip((z + 1.2) / 2, 0, 1) * 255
    assert made[:, ::4, ::4].transpose(0, 3, 1, 2) == approx(wanted, abs=0.51)
