"""Backend refine=ltx-video: LTX-Video (HaCohen et al. 2024), a flow in the latents of a strongly compressing VAE.

Weights of `LTXPipeline` and `LTXImageToVideoPipeline` (0.9, 0.9.1) and of `LTXConditionPipeline` (0.9.5 to 0.9.8). The
guidance video is the start, its first frame is held, and no frame conditions the network.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from diffusers import (
    AutoencoderKLLTXVideo,
    DiffusionPipeline,
    FlowMatchEulerDiscreteScheduler,
)
from diffusers.pipelines.ltx.pipeline_ltx import calculate_shift
from diffusers.pipelines.ltx.pipeline_ltx_condition import linear_quadratic_schedule
from torch import Tensor

from physgen.refine.backends.sampling import (
    Kind,
    Sampler,
    Schedule,
    TrainingSettings,
    check_pipeline_class,
    euler,
    load_pipeline,
    part_config,
    pipeline_index,
)
from physgen.refine.denoiser import Grid
from physgen.registry import Setup

NAME, WHAT = "ltx-video", "LTX-Video"
CONDITION = "LTXConditionPipeline"
KNOWN = ("LTXPipeline", "LTXImageToVideoPipeline", CONDITION)
GUIDANCE = 3.0
"""Default weight of the prompt in its pipelines."""
AREA = 512 * 768
"""Area of the videos recommended by its authors, px."""
FRAMES = 161
"""Length of these videos, frames."""
MOST_FRAMES = 257
"""Maximum number of frames recommended by its authors."""
RATE = 25.0
"""Frames per second assumed by its pipelines."""
Text = tuple[Tensor, Tensor]
"""States of a text (1, tokens, width), and the mask of valid ones (1, tokens)."""


class LtxVideo:
    """LTX-Video as a `sampling.Network`."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        self._is_condition = type(pipe).__name__ == CONDITION
        self._scheduler = FlowMatchEulerDiscreteScheduler.from_config(
            pipe.scheduler.config
        )

    def schedule(self, steps: int, count: int, shape: torch.Size) -> Schedule:
        """Return Euler's steps; the more tokens a window has, the longer they stay
        noisy.
        """
        frames, _, height, width = shape
        config = self._scheduler.config
        # Noise hides a large picture less than a small one: the shift moves the levels
        # towards noise, as in the training of the model.
        mu = calculate_shift(
            frames * height * width,
            config.base_image_seq_len,
            config.max_image_seq_len,
            config.base_shift,
            config.max_shift,
        )
        scheduler = self._scheduler
        if steps == 1:
            # A single level, 1, cannot be stretched to end at another level.
            scheduler = FlowMatchEulerDiscreteScheduler.from_config(
                config, shift_terminal=None
            )
        if self._is_condition:
            # These pipelines take small steps near full noise, and growing ones
            # afterwards.
            sigmas = linear_quadratic_schedule(steps).numpy()
            times = config.num_train_timesteps * sigmas
            return euler(scheduler, steps, count, sigmas=sigmas, timesteps=times, mu=mu)
        sigmas = np.linspace(1.0, 1 / steps, steps)
        return euler(scheduler, steps, count, sigmas=sigmas, mu=mu)

    def encode_text(self, text: str) -> Text:
        """Encode a text by T5."""
        states, mask, *_ = self.pipe.encode_prompt(
            text, do_classifier_free_guidance=False, device=self._device
        )
        return states.to(self._dtype), mask

    def condition(self, frame: Tensor, latents: int) -> None:
        """Return None: the network gets no frame."""

    def encode(self, video: Tensor) -> Tensor:
        """Return the mean latents, with every channel centred and scaled."""
        vae = self.pipe.vae
        latents = vae.encode(video.to(self._device).transpose(0, 1)[None]).latent_dist
        mean, spread = self._statistics()
        return ((latents.mode() - mean) / spread)[0].transpose(0, 1)

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """Decode all frames at once: each depends on latent frames before and
        after it.
        """
        vae = self.pipe.vae
        mean, spread = self._statistics()
        z = latents.to(self._device).transpose(0, 1)[None] * spread + mean
        time = None
        if vae.config.timestep_conditioning:
            time = torch.zeros(1, device=self._device)  # nothing is left to denoise
        # Some decoders add noise: equal noise leaves an unchanged video unchanged.
        with torch.random.fork_rng():
            torch.manual_seed(0)
            video = vae.decode(z, time).sample
        yield from video[0].transpose(0, 1).split(1)

    def _statistics(self) -> Text:
        """Return the mean and the spread of the VAE's channels, (1, C, 1, 1, 1)."""
        vae = self.pipe.vae
        mean, spread = (
            values.view(1, -1, 1, 1, 1).to(self._device)
            for values in (vae.latents_mean, vae.latents_std)
        )
        return mean, spread / vae.config.scaling_factor

    def predict(
        self, latents: Tensor, time: Tensor, text: Text, condition: None
    ) -> Tensor:
        """Predict (F', C, h, w); the network takes tokens (1, F' h w, C)."""
        frames, channels, height, width = latents.shape
        z = latents.to(self._device, self._dtype).permute(0, 2, 3, 1)
        states, mask = text
        flow: Tensor = self.pipe.transformer(
            hidden_states=z.reshape(1, -1, channels),
            encoder_hidden_states=states,
            timestep=time.to(self._device).expand(1, 1),
            encoder_attention_mask=mask,
            video_coords=self._positions(frames, height, width),
            return_dict=False,
        )[0]
        flow = flow.float().reshape(frames, height, width, channels)
        return flow.permute(0, 3, 1, 2)

    def _positions(self, frames: int, height: int, width: int) -> Tensor:
        """Return (1, 3, F' h w): the time, s, and the place, px, of each token."""
        stride = self.pipe.vae_temporal_compression_ratio
        cell = self.pipe.vae_spatial_compression_ratio
        # Positions are in frames and pixels of the video, not in latent cells, so that
        # the model knows speed and size.
        times = torch.arange(frames, device=self._device) * stride
        # The first latent frame has only one frame.
        if self._is_condition:
            times = (times + 1 - stride).clamp(min=0)
        y = torch.arange(height, device=self._device) * cell
        x = torch.arange(width, device=self._device) * cell
        grid = torch.meshgrid(times / RATE, y.float(), x.float(), indexing="ij")
        return torch.stack(grid).reshape(1, 3, -1)


def read_training_settings(weights: tuple[str, ...]) -> TrainingSettings:
    """Read the settings of the configurations."""
    (weights_name,) = weights
    index = pipeline_index(weights_name, WHAT)
    check_pipeline_class(weights_name, str(index.get("_class_name")), KNOWN, WHAT)
    vae = part_config(weights_name, "vae", WHAT)
    halvings = sum(vae.get("spatio_temporal_scaling", [True, True, True]))
    # Older configurations list only the levels; each of them halves the picture once.
    cell = vae.get("spatial_compression_ratio") or vae["patch_size"] * 2**halvings
    stride = vae.get("temporal_compression_ratio") or vae["patch_size_t"] * 2**halvings
    window = 1 + (FRAMES - 1) // stride
    return TrainingSettings(Grid(cell, cell, AREA, window, stride), MOST_FRAMES)


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> LtxVideo:
    """Load the pipeline."""
    pipe = load_pipeline(
        DiffusionPipeline, weights[0], dtype, WHAT, AutoencoderKLLTXVideo
    )
    return LtxVideo(pipe, device, dtype)


KIND = Kind(NAME, WHAT, GUIDANCE, read_training_settings, load)


def ltx_video(setup: Setup) -> Sampler:
    """Make the backend `ltx-video`."""
    return Sampler(KIND, setup)
