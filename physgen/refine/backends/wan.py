"""Wan 2.1 and 2.2 (Wan team 2025): a flow in a causal VAE's latents, four frames each but for the first.

Weights that make videos of words, and those that are also shown a first frame; of two experts, the one for the noise.
"""

from __future__ import annotations

import html
from collections.abc import Iterator
from typing import Any

import torch
from diffusers import AutoencoderKLWan, DiffusionPipeline, FlowMatchEulerDiscreteScheduler
from PIL import Image
from torch import Tensor

from physgen.problems import InputError
from physgen.refine.backends.sampling import (
    REFINE,
    Kind,
    Sampler,
    Schedule,
    Trained,
    check_pipeline_class,
    euler,
    load_pipeline,
    part_config,
    pipeline_index,
)
from physgen.refine.denoiser import Grid
from physgen.registry import Setup

WHAT = "Wan"
KNOWN = ("WanPipeline", "WanImageToVideoPipeline", "WanVideoToVideoPipeline")
AREA = 480 * 832
FRAMES = 81
WORDS = 512
"""Tokens of a text."""
SHIFT = 3.0
"""Of the schedule towards noise, where the weights do not say."""
AT_ONCE = 16
"""Decoded frames that are handed on together."""


class Wan:
    """See `sampling.Network`."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        config = pipe.scheduler.config
        # the weights' own UniPC remembers earlier steps, and would undo what is laid over them
        self._scheduler = FlowMatchEulerDiscreteScheduler(
            num_train_timesteps=config.get("num_train_timesteps", 1000),
            shift=config.get("flow_shift", config.get("shift", SHIFT)),
        )
        vae = pipe.vae.config
        self._mean, self._std = (
            torch.tensor(values, dtype=torch.float32, device=device).view(1, -1, 1, 1, 1)
            for values in (vae.latents_mean, vae.latents_std)
        )
        expert = self._expert(torch.tensor(float("inf")))
        self._looks = expert.config.in_channels > vae.z_dim

    def schedule(self, steps: int, count: int) -> Schedule:
        """Euler's, shifted."""
        return euler(self._scheduler, steps, count)

    def encode_text(self, text: str) -> Tensor:
        """(1, 512, width), zeros behind the text's end.

        The pipeline's own reader first mends text whose letters were decoded wrongly, for which it needs ftfy; no
        prompt here is such text.
        """
        clean = " ".join(html.unescape(html.unescape(text)).split())
        read = self.pipe.tokenizer(
            [clean], padding="max_length", max_length=WORDS, truncation=True, add_special_tokens=True,
            return_attention_mask=True, return_tensors="pt",
        )  # fmt: skip
        mask = read.attention_mask.to(self._device)
        found = self.pipe.text_encoder(read.input_ids.to(self._device), mask).last_hidden_state
        encoded: Tensor = found.to(self._dtype).masked_fill(mask[..., None] == 0, 0)
        return encoded

    def shown(self, frame: Tensor, latents: int) -> tuple[Tensor, Tensor | None] | None:
        """(1, 4 + C, F', h, w), which frames are given and what they show; and what CLIP sees in it, where asked."""
        if not self._looks:
            return None
        count = 1 + (latents - 1) * self._stride
        video = torch.zeros((1, 3, count, *frame.shape[1:]), device=self._device)
        video[0, :, 0] = frame
        seen = self._encoded(video)
        given = torch.zeros((1, self._stride, *seen.shape[2:]), device=self._device)
        given[:, :, 0] = 1
        return torch.cat([given, seen], dim=1).to(self._dtype), self._embedded(frame)

    def _embedded(self, frame: Tensor) -> Tensor | None:
        if self.pipe.transformer is None or self.pipe.transformer.config.image_dim is None:
            return None
        picture = ((frame / 2 + 0.5) * 255).round().to(torch.uint8).permute(1, 2, 0).numpy()
        found: Tensor = self.pipe.encode_image(Image.fromarray(picture), self._device)
        return found.to(self._dtype)

    @property
    def _stride(self) -> int:
        return int(2 ** sum(self.pipe.vae.temperal_downsample))

    def _encoded(self, video: Tensor) -> Tensor:
        found: Tensor = self.pipe.vae.encode(video).latent_dist.mode()
        return (found - self._mean) / self._std

    def encode(self, video: Tensor) -> Tensor:
        """The mean, every channel centred and scaled."""
        return self._encoded(video.to(self._device).transpose(0, 1)[None])[0].transpose(0, 1)

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """All at once: what a latent frame shows depends on those before."""
        z = latents.to(self._device).transpose(0, 1)[None] * self._std + self._mean
        yield from self.pipe.vae.decode(z).sample[0].transpose(0, 1).split(AT_ONCE)

    def predict(
        self, latents: Tensor, time: Tensor, text: Tensor, shown: tuple[Tensor, Tensor | None] | None
    ) -> Tensor:
        """(F', C, h, w): the network takes (1, C, F', h, w)."""
        z = latents.to(self._device, self._dtype).transpose(0, 1)[None]
        picture = None
        if shown is not None:
            z, picture = torch.cat([z, shown[0]], dim=1), shown[1]
        found: Tensor = self._expert(time)(
            hidden_states=z,
            timestep=time.to(self._device).expand(1),
            encoder_hidden_states=text,
            encoder_hidden_states_image=picture,
            return_dict=False,
        )[0]
        return found[0].transpose(0, 1)

    def _expert(self, time: Tensor) -> Any:
        """Of Wan 2.2's two networks, that for much noise or that for little."""
        much, little = self.pipe.transformer, getattr(self.pipe, "transformer_2", None)
        edge = self.pipe.config.get("boundary_ratio")
        if much is None or little is None or edge is None:
            return much if much is not None else little
        return much if float(time) >= edge * self._scheduler.config.num_train_timesteps else little


def trained(weights: tuple[str, ...]) -> Trained:
    """What the configurations say."""
    (one,) = weights
    found = pipeline_index(one, WHAT)
    check_pipeline_class(one, str(found.get("_class_name")), KNOWN, WHAT)
    if found.get("expand_timesteps"):
        what = "gives every frame a noise of its own (Wan 2.2 TI2V): not for Wan here"
        raise InputError.of(REFINE.name, f'"{one}"', what, "name Wan 2.1, or Wan 2.2's A14B")
    part = "transformer" if found.get("transformer", [None, None])[1] else "transformer_2"
    vae, network = part_config(one, "vae", WHAT), part_config(one, part, WHAT)
    halves = vae.get("temperal_downsample", [False, True, True])
    cell, stride = 2 ** len(halves), 2 ** sum(halves)
    patch = network.get("patch_size", [1, 2, 2])
    window = 1 + (FRAMES - 1) // stride
    most = 1 + (network.get("rope_max_seq_len", 1024) - 1) * stride
    return Trained(Grid(cell, cell * max(patch[1:]), AREA, stride, window), most)


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> Wan:
    """The pipeline."""
    return Wan(load_pipeline(DiffusionPipeline, weights[0], dtype, WHAT, AutoencoderKLWan), device, dtype)


KIND = Kind("wan", WHAT, 5.0, trained, load)
"""Guided as its authors advise."""


def wan(setup: Setup) -> Sampler:
    """The backend `wan`."""
    return Sampler(KIND, setup)
