"""CogVideoX (Yang et al. 2025): a transformer over text and a causal VAE's latents, four frames each but for the
first.

Weights of 1.0 and 1.5 that make videos of words, and those that are also shown a first frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from diffusers import AutoencoderKLCogVideoX, CogVideoXDDIMScheduler, DiffusionPipeline
from torch import Tensor

from physgen.problems import InputError
from physgen.refine.backends.sampling import (
    REFINE,
    Kind,
    Sampler,
    Schedule,
    Trained,
    check_pipeline_class,
    ddim,
    load_pipeline,
    part_config,
    pipeline_index,
)
from physgen.refine.denoiser import Grid
from physgen.refine.latents import latent_frames
from physgen.registry import Setup

WHAT = "CogVideoX"
KNOWN = ("CogVideoXPipeline", "CogVideoXImageToVideoPipeline", "CogVideoXVideoToVideoPipeline")
LARGEST = 768 * 1360
"""px that 1.5 was trained on; some of its configurations name the largest that it can take."""
OFS = 2.0
"""What those of 1.5 that are shown a frame are given besides."""
MOST = 1 << 20
"""Frames: nothing in the network ends."""
AT_ONCE = 16
"""Decoded frames that are handed on together."""


class CogVideoX:
    """See `sampling.Network`."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        self._scheduler = CogVideoXDDIMScheduler.from_config(pipe.scheduler.config)
        self._scale = pipe.vae.config.scaling_factor

    def schedule(self, steps: int, count: int) -> Schedule:
        """DDIM."""
        return ddim(self._scheduler, steps, count)

    def encode_text(self, text: str) -> Tensor:
        """(1, 226, width)."""
        length = self.pipe.transformer.config.max_text_seq_length
        found: Tensor = self.pipe.encode_prompt(
            text, do_classifier_free_guidance=False, max_sequence_length=length, device=self._device,
            dtype=self._dtype,
        )[0]  # fmt: skip
        return found

    def shown(self, frame: Tensor, latents: int) -> Tensor | None:
        """(1, F', C, h, w): the first frame's latents, and nothing of the others."""
        vae, network = self.pipe.vae.config, self.pipe.transformer.config
        if network.in_channels == vae.latent_channels:
            return None
        seen = self._encoded(frame[None, :, None].to(self._device))
        # these were trained with the scale forgotten, as the pipeline has it, too
        seen = seen / self._scale if vae.invert_scale_latents else seen * self._scale
        rest = seen.new_zeros((1, latents - 1, *seen.shape[2:]))
        return torch.cat([seen, rest], dim=1).to(self._dtype)

    def _encoded(self, video: Tensor) -> Tensor:
        """(1, 3, F, H, W) -> (1, F', C, h, w), unscaled."""
        found: Tensor = self.pipe.vae.encode(video).latent_dist.mode()
        return found.transpose(1, 2)

    def encode(self, video: Tensor) -> Tensor:
        """The mean."""
        return self._encoded(video.to(self._device).transpose(0, 1)[None])[0] * self._scale

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """All at once: what a latent frame shows depends on those before.

        The VAE takes latents in pairs, the first of an odd number for one frame, the first two of an even number for
        eight. So an even number is made odd; nothing before the end sees that.
        """
        z = latents.to(self._device)
        if len(z) % 2 == 0:
            z = torch.cat([z, z[-1:]])
        frames = 1 + (len(latents) - 1) * self.pipe.vae.config.temporal_compression_ratio
        found = self.pipe.vae.decode(z.transpose(0, 1)[None] / self._scale).sample
        yield from found[0].transpose(0, 1)[:frames].split(AT_ONCE)

    def predict(self, latents: Tensor, time: Tensor, text: Tensor, shown: Tensor | None) -> Tensor:
        """(F', C, h, w): the network takes (1, F', C, h, w)."""
        z = latents.to(self._device, self._dtype)[None]
        network, vae = self.pipe.transformer, self.pipe.vae.config
        cell = 2 ** (len(vae.block_out_channels) - 1)
        height, width = (side * cell for side in latents.shape[2:])
        turns = None
        if network.config.use_rotary_positional_embeddings:
            turns = self.pipe._prepare_rotary_positional_embeddings(height, width, len(latents), self._device)
        found: Tensor = network(
            hidden_states=z if shown is None else torch.cat([z, shown], dim=2),
            encoder_hidden_states=text,
            timestep=time.to(self._device).expand(1),
            ofs=z.new_full((1,), OFS) if network.config.ofs_embed_dim is not None else None,
            image_rotary_emb=turns,
            return_dict=False,
        )[0]
        return found[0]


def trained(weights: tuple[str, ...]) -> Trained:
    """What the configurations say."""
    (one,) = weights
    check_pipeline_class(one, str(pipeline_index(one, WHAT).get("_class_name")), KNOWN, WHAT)
    vae, network = part_config(one, "vae", WHAT), part_config(one, "transformer", WHAT)
    if network.get("use_learned_positional_embeddings"):
        what = "has learnt frames of one size alone: not for videos of any size"
        fix = "choose CogVideoX-2b, -5b, or one of CogVideoX1.5"
        raise InputError.of(REFINE.name, f'"{one}"', what, fix)
    cell = 2 ** (len(vae["block_out_channels"]) - 1)
    stride, patch = int(vae.get("temporal_compression_ratio", 4)), network.get("patch_size", 2)
    area = network.get("sample_height", 60) * network.get("sample_width", 90) * cell * cell
    group = network.get("patch_size_t") or 1
    grid = Grid(cell, cell * patch, min(area, LARGEST), stride, group, 1)
    window = latent_frames(network.get("sample_frames", 49), grid)
    return Trained(Grid(cell, grid.side, grid.area, stride, group, window), MOST)


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> CogVideoX:
    """The pipeline."""
    pipe = load_pipeline(DiffusionPipeline, weights[0], dtype, WHAT, AutoencoderKLCogVideoX)
    return CogVideoX(pipe, device, dtype)


KIND = Kind("cogvideox", WHAT, 6.0, trained, load)
"""Guided as its authors advise."""


def cogvideox(setup: Setup) -> Sampler:
    """The backend `cogvideox`."""
    return Sampler(KIND, setup)
