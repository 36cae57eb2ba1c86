"""Refinement against diffusers' own pipeline, run whole from half the noise, on a tiny model of the real classes."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import diffusers
import numpy as np
import pytest
import torch
from PIL import Image

from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import fused

STEPS = 8
WORDS, NOT = "a red ball,  &amp; a cup", "blur"


SIZE, FRAMES, STRENGTH = (24, 16), 5, 0.5
"""Width and height, px, of a clip, and how much of the schedule runs."""


def scheduler() -> Any:
    """Built from numbers, not from the weights' own."""
    return diffusers.DDIMScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="linear", clip_sample=False, steps_offset=1,
        prediction_type="v_prediction",
    )  # fmt: skip


def clip() -> list[np.ndarray]:
    width, height = SIZE
    y, x = np.mgrid[:height, :width]
    frames = [
        np.stack([5 * x + 9 * k, 7 * y, 3 * x + 3 * y], axis=-1) % 256
        for k in range(FRAMES)
    ]
    return [frame.astype(np.uint8) for frame in frames]


class Both:
    """A model of ours and a pipeline of theirs over the same weights, and the noise of both."""

    def __init__(self, model: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.model, self.frames = model, clip()
        self.count = round(STEPS * STRENGTH)
        self.z0 = model.begin(
            self.frames, PromptSettings(WORDS, NOT, 3.0), STEPS, self.count
        )
        self.noise = np.random.default_rng(0).standard_normal(self.z0.shape, np.float32)
        self.scheduler = scheduler()
        mine = model._network.pipe
        own = ("vae", "text_encoder", "tokenizer", "unet", "motion_adapter")
        parts = {name: getattr(mine, name, None) for name in own}
        self.pipe = diffusers.AnimateDiffVideoToVideoPipeline(
            **parts, scheduler=self.scheduler
        )
        self.pipe.set_progress_bar_config(disable=True)
        # means where they draw, and our noise where they make theirs
        module = importlib.import_module(type(self.pipe).__module__)
        monkeypatch.setattr(
            module, "retrieve_latents", lambda found, *_, **__: found.latent_dist.mode()
        )
        monkeypatch.setattr(module, "randn_tensor", self._drawn)

    def _drawn(self, shape: Any, **_: Any) -> torch.Tensor:
        noise = torch.from_numpy(self.noise)[None]
        return noise if noise.shape == tuple(shape) else noise.transpose(1, 2)

    def run(self, step: Callable[..., Any] | None = None, **more: Any) -> np.ndarray:
        """Their latents, laid out as ours."""
        width, height = SIZE
        more |= {
            "video": [Image.fromarray(frame) for frame in self.frames],
            "strength": STRENGTH,
        }
        more |= {"height": height, "width": width}
        found = self.pipe(
            prompt=[WORDS], negative_prompt=[NOT], num_inference_steps=STEPS, guidance_scale=3.0, output_type="latent",
            callback_on_step_end=step, **more,
        ).frames  # fmt: skip
        return self.ours(found).numpy()

    def ours(self, latents: torch.Tensor) -> torch.Tensor:
        return latents[0].transpose(0, 1)

    def run_ours(self, mask: Any, stop: int) -> np.ndarray:
        model = self.model

        def denoised(z: np.ndarray, k: int) -> np.ndarray:
            return model.stepped(model.predict(z, k), z, k)

        def noised(z: np.ndarray, k: int) -> np.ndarray:
            return model.noised(z, self.noise, k)

        return fused(
            self.z0, mask, noised=noised, denoised=denoised, count=self.count, stop=stop
        )


@pytest.fixture
def both(video: Any, monkeypatch: pytest.MonkeyPatch) -> Both:
    return Both(video(), monkeypatch)


def test_without_objects_it_is_their_own_video_to_video(both: Both):
    ours, theirs = both.run_ours(np.float32(0), 0), both.run()
    assert ours.shape == theirs.shape
    assert np.abs(theirs - both.z0).mean() > 0.1  # something happens
    assert np.allclose(ours, theirs, rtol=0, atol=2e-4 * np.abs(theirs).max())


def test_with_objects_it_is_the_algorithm_in_their_callback(both: Both):
    random = np.random.default_rng(1)
    mask = random.random((both.z0.shape[0], 1, *both.z0.shape[2:]), np.float32)
    stop, guidance, noise = 1, torch.from_numpy(both.z0), torch.from_numpy(both.noise)
    steps = []

    def step(pipe: Any, i: int, t: Any, told: dict[str, Any]) -> dict[str, Any]:
        steps.append(i)
        n = pipe.num_timesteps
        times, z, m = (
            both.scheduler.timesteps[-n:],
            both.ours(told["latents"]),
            torch.from_numpy(mask),
        )
        if i < n - stop:
            if i + 1 == n:
                ref = guidance
            else:
                ref = both.scheduler.add_noise(guidance, noise, times[i + 1 : i + 2])
            w = i / n
            z = (1 - m) * z + m * (w * z + (1 - w) * ref)
            told["latents"] = z.transpose(0, 1)[None]
        return told

    theirs, ours = both.run(step), both.run_ours(mask, stop)
    assert steps == list(range(both.count))
    assert np.allclose(ours, theirs, rtol=0, atol=2e-4 * np.abs(theirs).max())
    free = both.run_ours(np.float32(0), 0)
    assert np.abs(ours - both.z0).mean() < np.abs(free - both.z0).mean()


def test_latents_become_the_frames_that_theirs_become(both: Both):
    latents = both.run_ours(np.float32(0), 0)
    ours = np.concatenate(list(both.model.decode(latents)))
    z = torch.from_numpy(latents)[None]
    pipe = both.pipe
    with torch.inference_mode():
        video = pipe.decode_latents(z.transpose(1, 2))
        theirs = pipe.video_processor.postprocess_video(video, output_type="np")[0]
    assert ours.shape == theirs.shape == (FRAMES, *SIZE[::-1], 3)
    assert np.allclose(np.clip(ours, 0, 1), theirs, rtol=0, atol=1e-5)
