"""Refinement against a second implementation: diffusers' own pipelines, run whole, on tiny models of the real classes.

Where they take a video and a strength, from half the noise; where they take one picture only, from noise alone.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import diffusers
import numpy as np
import pytest
import torch
from PIL import Image

from physgen.refine.denoiser import PromptSettings
from physgen.refine.fusion import fuse_latents
from tests.contract.tiny_ltx import SHIFT

STEPS = 8
WORDS, NOT = "a red ball,  &amp; a cup", "blur"


@dataclass(frozen=True)
class Theirs:
    """A pipeline that does the same."""

    kind: str
    module: str
    size: tuple[int, int]
    """Width and height, px."""
    frames: int
    strength: float = 0.5
    parts: tuple[str, ...] = ()
    """Of the weights' pipeline, beside those of all."""


SETTINGS = ("boundary_ratio", "expand_timesteps")
"""Of a pipeline's configuration."""
_ANIMATED = (
    "AnimateDiffVideoToVideoPipeline",
    "animatediff.pipeline_animatediff_video2video",
    (24, 16),
    5,
)
_WAN = ("WanVideoToVideoPipeline", "wan.pipeline_wan_video2video", (48, 32), 9)
THEIRS = {
    "animatediff": Theirs(*_ANIMATED, parts=("unet", "motion_adapter")),
    "wan": Theirs(*_WAN, parts=("transformer",)),
    "wan-experts": Theirs(
        "WanPipeline", "wan.pipeline_wan", (48, 32), 9, 1.0, ("transformer", "transformer_2", "boundary_ratio")
    ),
    "wan-framed": Theirs(
        "WanImageToVideoPipeline", "wan.pipeline_wan_i2v", (48, 32), 9, 1.0,
        ("transformer", "image_encoder", "image_processor"),
    ),
    "wan-framed-experts": Theirs(
        "WanImageToVideoPipeline", "wan.pipeline_wan_i2v", (48, 32), 9, 1.0,
        ("transformer", "transformer_2", "boundary_ratio"),
    ),
    "wan-ti2v": Theirs(
        "WanPipeline", "wan.pipeline_wan", (48, 32), 9, 1.0, ("transformer", "expand_timesteps")
    ),
    "ltx-video": Theirs("LTXPipeline", "ltx.pipeline_ltx", (96, 64), 17, 1.0, ("transformer",)),
    "ltx-video-condition": Theirs(
        "LTXConditionPipeline", "ltx.pipeline_ltx_condition", (96, 64), 17, parts=("transformer",)
    ),
}  # fmt: skip


def scheduler(variant: str) -> Any:
    """Built from numbers, not from the weights' own."""
    if variant.startswith("wan"):
        return diffusers.FlowMatchEulerDiscreteScheduler(shift=3.0)
    if variant == "ltx-video":
        return diffusers.FlowMatchEulerDiscreteScheduler(**SHIFT)
    if variant.startswith("ltx-video"):
        return diffusers.FlowMatchEulerDiscreteScheduler()
    return diffusers.DDIMScheduler(
        beta_start=0.00085, beta_end=0.012, beta_schedule="linear", clip_sample=False, steps_offset=1,
        prediction_type="v_prediction",
    )  # fmt: skip


def clip(theirs: Theirs) -> list[np.ndarray]:
    width, height = theirs.size
    y, x = np.mgrid[:height, :width]
    frames = [
        np.stack([5 * x + 9 * k, 7 * y, 3 * x + 3 * y], axis=-1) % 256
        for k in range(theirs.frames)
    ]
    return [frame.astype(np.uint8) for frame in frames]


class Both:
    """A model of ours and a pipeline of theirs over the same weights, and the noise of both."""

    def __init__(
        self, variant: str, model: Any, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.theirs, self.model, self.frames = (
            THEIRS[variant],
            model,
            clip(THEIRS[variant]),
        )
        self.count = round(STEPS * self.theirs.strength)
        self.z0 = model.begin(
            self.frames, PromptSettings(WORDS, NOT, 3.0), STEPS, self.count
        )
        self.noise = np.random.default_rng(0).standard_normal(self.z0.shape, np.float32)
        self.scheduler = scheduler(variant)
        mine, module = (
            model._network.pipe,
            importlib.import_module(f"diffusers.pipelines.{self.theirs.module}"),
        )
        own = ("vae", "text_encoder", "tokenizer")
        parts = {
            name: getattr(mine, name, None)
            for name in (*own, *self.theirs.parts)
            if name not in SETTINGS
        }
        parts |= {
            name: mine.config[name] for name in SETTINGS if name in self.theirs.parts
        }
        self.pipe = getattr(diffusers, self.theirs.kind)(
            **parts, scheduler=self.scheduler
        )
        self.pipe.set_progress_bar_config(disable=True)
        # means where they draw, our noise where they make theirs, and no ftfy, which has nothing to mend
        monkeypatch.setattr(
            module,
            "retrieve_latents",
            lambda found, *_, **__: found.latent_dist.mode(),
            raising=False,
        )
        monkeypatch.setattr(module, "randn_tensor", self._drawn)
        monkeypatch.setattr(
            module, "ftfy", SimpleNamespace(fix_text=lambda text: text), raising=False
        )

    def _drawn(self, shape: Any, **_: Any) -> torch.Tensor:
        noise = torch.from_numpy(self.noise)[None]
        return noise if noise.shape == tuple(shape) else noise.transpose(1, 2)

    def run(self, step: Callable[..., Any] | None = None, **more: Any) -> np.ndarray:
        """Their latents, laid out as ours."""
        (width, height), pictures = (
            self.theirs.size,
            [Image.fromarray(frame) for frame in self.frames],
        )
        more |= {"height": height, "width": width}
        if "VideoToVideo" in self.theirs.kind:
            more |= {"video": pictures, "strength": self.theirs.strength}
        elif "Condition" in self.theirs.kind:
            more |= {"num_frames": len(pictures), "latents": self.laid_out(self.z0, 5)}
            more["denoise_strength"] = self.theirs.strength
        else:
            tokens = 3 if "LTX" in self.theirs.kind else 5
            more |= {"num_frames": len(pictures)}
            more["latents"] = self.laid_out(self.noise, tokens)
        if "Image" in self.theirs.kind:
            more["image"] = pictures[0]
        found = self.pipe(
            prompt=[WORDS], negative_prompt=[NOT], num_inference_steps=STEPS, guidance_scale=3.0, output_type="latent",
            callback_on_step_end=step, **more,
        ).frames  # fmt: skip
        return self.ours(found).numpy()

    def ours(self, latents: torch.Tensor) -> torch.Tensor:
        if latents.ndim == 3:  # tokens
            f, c, h, w = self.z0.shape
            return latents[0].reshape(f, h, w, c).permute(0, 3, 1, 2)
        return latents[0].transpose(0, 1)

    def laid_out(self, latents: Any, dimensions: int) -> torch.Tensor:
        """Ours as theirs: (1, C, F', h, w), or tokens."""
        z = torch.as_tensor(latents)
        if dimensions == 3:
            return z.permute(0, 2, 3, 1).reshape(1, -1, z.shape[1])
        return z.transpose(0, 1)[None]

    def run_ours(self, mask: Any, stop: int) -> np.ndarray:
        model = self.model

        def denoised(z: np.ndarray, k: int) -> np.ndarray:
            return model.step(model.predict(z, k, 0), z, k)

        def add_noise(z: np.ndarray, k: int) -> np.ndarray:
            return model.add_noise(z, self.noise, k)

        return fuse_latents(
            self.z0,
            mask,
            add_noise=add_noise,
            denoise=denoised,
            count=self.count,
            stop=stop,
        )


@pytest.fixture
def both(
    request: pytest.FixtureRequest, video: Any, monkeypatch: pytest.MonkeyPatch
) -> Both:
    return Both(request.param, video(request.param), monkeypatch)


@pytest.mark.parametrize("both", THEIRS, indirect=True)
def test_without_objects_it_is_their_own_video_to_video(both: Both):
    ours, theirs = both.run_ours(np.float32(0), 0), both.run()
    assert ours.shape == theirs.shape
    assert np.abs(theirs - both.z0).mean() > 0.1  # something happens
    assert np.allclose(ours, theirs, rtol=0, atol=2e-4 * np.abs(theirs).max())


@pytest.mark.parametrize("both", THEIRS, indirect=True)
def test_with_objects_it_is_the_algorithm_in_their_callback(both: Both):
    random = np.random.default_rng(1)
    mask = random.random((both.z0.shape[0], 1, *both.z0.shape[2:]), np.float32)
    stop, guidance, noise = 1, torch.from_numpy(both.z0), torch.from_numpy(both.noise)
    steps = []

    def step(pipe: Any, i: int, t: Any, told: dict[str, Any]) -> dict[str, Any]:
        steps.append(i)
        n = pipe.num_timesteps
        times, z = both.scheduler.timesteps[-n:], both.ours(told["latents"])
        m = torch.from_numpy(mask)
        if i < n - stop:
            if i + 1 == n:
                ref = guidance
            elif hasattr(both.scheduler, "scale_noise"):
                ref = both.scheduler.scale_noise(guidance, times[i + 1 : i + 2], noise)
            else:
                ref = both.scheduler.add_noise(guidance, noise, times[i + 1 : i + 2])
            z = (1 - m) * z + m * (i / n * z + (1 - i / n) * ref)
            told["latents"] = both.laid_out(z, told["latents"].ndim)
        return told

    theirs, ours = both.run(step), both.run_ours(mask, stop)
    assert steps == list(range(both.count))
    assert np.allclose(ours, theirs, rtol=0, atol=2e-4 * np.abs(theirs).max())
    distance = np.abs(both.run_ours(np.float32(0), 0) - both.z0).mean()
    assert np.abs(ours - both.z0).mean() < distance


@pytest.mark.parametrize("both", THEIRS, indirect=True)
def test_latents_become_the_frames_that_theirs_become(both: Both):
    latents = both.run_ours(np.float32(0), 0)
    ours = np.concatenate(list(both.model.decode(latents)))
    z = torch.from_numpy(latents)[None]
    pipe = both.pipe
    with torch.inference_mode():
        if both.theirs.kind.startswith("Wan"):
            told = pipe.vae.config
            mean, std = (
                torch.tensor(v).view(1, -1, 1, 1, 1)
                for v in (told.latents_mean, told.latents_std)
            )
            video = pipe.vae.decode(z.transpose(1, 2) * std + mean).sample
        elif both.theirs.kind.startswith("LTX"):
            vae = pipe.vae
            known = vae.latents_mean, vae.latents_std, vae.config.scaling_factor
            time = torch.zeros(1) if vae.config.timestep_conditioning else None
            torch.manual_seed(0)
            video = vae.decode(
                pipe._denormalize_latents(z.transpose(1, 2), *known), time
            ).sample
        else:
            video = pipe.decode_latents(z.transpose(1, 2))
        theirs = pipe.video_processor.postprocess_video(video, output_type="np")[0]
    assert (
        ours.shape == theirs.shape == (both.theirs.frames, *both.theirs.size[::-1], 3)
    )
    assert np.allclose(np.clip(ours, 0, 1), theirs, rtol=0, atol=1e-5)
