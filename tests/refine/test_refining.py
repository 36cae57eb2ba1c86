"""A whole refinement with a model that is known exactly: sizes, windows, the first frame, seeds, what is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gaussian import Gaussian, Straight
from pytest import approx

from physgen.problems import InputError
from physgen.refine.denoiser import Denoiser, Grid, PromptSettings
from physgen.refine.fusion import Refinement, RefineSettings, prompt_of

HOW = RefineSettings(0.5, 5, 50, 0, PromptSettings("balls", "", None), lock=0.0, detail=1.0, hold=0)
PLAIN = Grid(4, 8, 10**9, 1, 1, 64)
GRIDS = {
    "plain": PLAIN,
    "windows": replace(PLAIN, window=6),
    "stride": Grid(4, 16, 10**9, 4, 1, 64),
    "pairs": Grid(4, 16, 10**9, 4, 2, 4),
    "small": replace(PLAIN, area=700),
}


def clip(size=(61, 35), count: int = 11) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """A grained ramp with a disc that moves, and the disc's coverage."""
    rng = np.random.default_rng(3)
    yy, xx = np.mgrid[: size[1], : size[0]]
    ground = np.stack([60 + xx % 150, 40 + yy % 150, 0 * xx + 120], axis=-1) + rng.integers(
        -20, 21, (*yy.shape, 3)
    )
    frames, coverage = [], []
    for k in range(count):
        cover = np.clip(9.5 - np.hypot(xx - 12 - 2 * k, yy - 17), 0, 1).astype(np.float32)
        colour = np.array([220, 210, 60])
        frames.append(np.rint(ground + cover[..., None] * (colour - ground)).astype(np.uint8))
        coverage.append(cover)
    return frames, coverage


def refined(
    model: Denoiser, how: RefineSettings = HOW, size=(61, 35), count: int = 11, covers=None, **more
) -> list[np.ndarray]:
    frames, coverage = clip(size, count)
    coverage = coverage if covers is None else [np.full(f.shape[:2], covers, np.float32) for f in frames]
    made = list(Refinement(model, how, size, count, **more).frames(frames, coverage))
    assert [(f.shape, f.dtype) for f in made] == [(f.shape, f.dtype) for f in frames]
    return made


def apart(one: list[np.ndarray], two: list[np.ndarray]) -> float:
    return float(np.abs(np.stack(one).astype(int) - np.stack(two)).mean())


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
@pytest.mark.parametrize("kind", [Gaussian, Straight])
@pytest.mark.parametrize("count", [1, 2, 11])
def test_all_objects_and_no_weight_give_the_guidance_to_the_byte(grid: Grid, kind, count: int) -> None:
    """At full resolution too, where the model is shown a smaller video."""
    made = refined(kind(grid), replace(HOW, stop=0), count=count, covers=1.0, weight=lambda k, n: 0.0)
    assert np.array_equal(made, clip(count=count)[0])


def test_a_video_larger_than_the_model_knows_is_shown_smaller_and_changes_at_full_size() -> None:
    model = Gaussian(GRIDS["small"])
    refinement = Refinement(model, HOW, (61, 35), 11)
    frames, coverage = clip()
    made = list(refinement.frames(frames, coverage))
    assert refinement.note()["size"] == [35, 20]
    assert made[0].shape == (35, 61, 3)
    assert apart(made, frames) > 5
    # what changes is smooth; the grain that the model never saw is still there
    grain, was = (f[5].astype(float) - np.roll(f[5], 1, axis=1) for f in (made, frames))
    assert np.corrcoef(grain.ravel(), was.ravel())[0, 1] > 0.6
    lost = replace(HOW, detail=0.0)
    grain = np.diff(refined(Gaussian(GRIDS["small"]), lost)[5].astype(float), axis=1)
    assert np.corrcoef(grain.ravel(), np.diff(frames[5].astype(float), axis=1).ravel())[0, 1] < 0.4


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_objects_stay_nearer_than_the_rest(grid: Grid) -> None:
    frames, coverage = clip()
    made = np.stack(refined(Gaussian(grid)))
    change, cover = np.abs(made.astype(int) - frames).mean(axis=-1), np.stack(coverage)
    assert change[cover == 1].mean() < 0.9 * change[cover == 0].mean()


class Moody(Gaussian):
    """Sees another brightness in each window and step."""

    def predict(self, latents, k, first):
        mood = np.random.default_rng((first, k)).standard_normal((1, 3, *latents.shape[2:]), np.float32)
        return super().predict(latents, k, first) + np.float32(0.3) * mood


def test_no_joint_shows_where_windows_disagree_in_every_step() -> None:
    """Frames of one still picture: all change from frame to frame is the windows' doing (noise is the same here).

    Root mean squares over cells of the change at windows' first and last frames, against those in between.
    """
    from physgen.refine.fusion import fused
    from physgen.refine.latents import blend_predictions, window_spans

    total, windows = 45, window_spans(45, 16, 8)
    model = Moody()
    model.begin([np.zeros((160, 160, 3), np.uint8)], HOW.prompt, 50, 25)
    noise = np.random.default_rng(0).standard_normal((1, 3, 40, 40), np.float32).repeat(total, axis=0)
    z = fused(
        np.zeros((total, 3, 40, 40), np.float32),
        np.float32(0.5),
        noised=lambda z, k: model.noised(z, noise, k),
        denoised=lambda z, k: model.stepped(
            blend_predictions(lambda p, f: model.predict(p, k, f), z, windows), z, k
        ),
        count=25,
        stop=5,
    )
    change = np.sqrt(np.mean(np.diff(z, axis=0) ** 2, axis=(1, 2, 3)))
    borders = [at - 1 for first, last in windows for at in (first, last) if 0 < at < total]
    inside = np.delete(change, borders)
    assert max(change[borders]) <= 1.25 * max(inside)
    assert change.max() < 0.25 * z.std()


@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_the_first_frame_is_kept_and_what_follows_leaves_it_slowly(grid: Grid) -> None:
    frames, _ = clip(count=20)
    free, eased = (
        np.stack(refined(Gaussian(grid), replace(HOW, hold=h), count=20)).astype(int) for h in (0, 9)
    )
    assert np.array_equal(eased[0], frames[0])
    stay = 1 - np.array([s * s * (3 - 2 * s) for s in np.minimum(np.arange(20) / 9, 1)])
    change, most = (np.abs(made - frames).mean(axis=(1, 2, 3)) for made in (eased, free))
    assert most[0] > 3
    assert (change <= (1 - stay) * most + 0.5).all()  # half a code of rounding
    assert np.diff(change).max() < 0.3 * most.max()  # no jump anywhere on the way
    assert np.array_equal(eased[13:], free[13:])


def test_one_seed_gives_the_same_bytes_and_another_others() -> None:
    a, b, c = (refined(Gaussian(), replace(HOW, seed=seed)) for seed in (4, 4, 5))
    assert np.array_equal(a, b)
    assert apart(a, c) > 3


def test_lock_gives_objects_back() -> None:
    frames, coverage = clip()
    made, cover = np.stack(refined(Gaussian(), replace(HOW, lock=1.0))), np.stack(coverage)
    assert np.array_equal(made[cover == 1], np.stack(frames)[cover == 1])
    free = np.stack(refined(Gaussian()))
    assert np.array_equal(made[cover == 0], free[cover == 0])


def test_the_record_tells_what_ran() -> None:
    model, told = Gaussian(GRIDS["windows"]), []
    refinement = Refinement(model, HOW, (61, 35), 11, lambda *step: told.append(step))
    list(refinement.frames(*clip()))
    note = refinement.note()
    assert (note["steps_run"], note["steps_fused"], note["seed"], note["prompt"]) == (25, 20, 0, "balls")
    assert note["windows"] == [[0, 6], [2, 8], [5, 11]]
    assert note["revision"] == "exact"
    assert told == [("refine", k, 25) for k in range(26)]
    assert model.said == HOW.prompt


def test_too_little_memory_is_reported() -> None:
    with pytest.raises(InputError, match="refine: 11 latent frames of 64 x 40 px do not fit into the memory"):
        refined(Gaussian(most=1000))


class Broken(Gaussian):
    """Half precision that overflows."""

    def predict(self, latents, k, first):
        return super().predict(latents, k, first) * np.float32(np.nan)


def test_a_model_that_overflows_is_told_of() -> None:
    with pytest.raises(InputError, match="leaves no finite picture; write dtype = "):
        refined(Broken())


def test_prompts_are_the_labels_most_frequent_first() -> None:
    assert prompt_of(["cue", "ball", "ball", " ball ", "object", "", "thing"]) == "ball, cue"
    assert prompt_of(["Ball", "ball", "cup", "cup", "cup"]) == "cup, Ball"
    assert prompt_of([]) == ""


def test_what_a_still_picture_becomes_is_what_the_closed_form_says() -> None:
    """One grey video, no objects, no detail: every cell ends where the exact denoiser's steps lead its noise."""
    model = Gaussian(mean=0.2, spread=0.3)
    frames = [np.full((8, 16, 3), 130, np.uint8)] * 3
    how = replace(HOW, detail=0.0)
    made = np.stack(
        list(Refinement(model, how, (16, 8), 3).frames(frames, [np.zeros((8, 16), np.float32)] * 3))
    )
    noise = np.random.default_rng(0).standard_normal((3, 3, 2, 4), np.float32)
    a, b, v, z0 = model.a, model.b, 0.09, 130 / 127.5 - 1
    z = a[0] * z0 + b[0] * noise - a[0] * 0.2
    for k in range(25):
        z = z * (a[k + 1] * a[k] * v + b[k + 1] * b[k]) / (a[k] ** 2 * v + b[k] ** 2)
    wanted = np.clip((z + 1.2) / 2, 0, 1) * 255
    assert made[:, ::4, ::4].transpose(0, 3, 1, 2) == approx(wanted, abs=0.51)
