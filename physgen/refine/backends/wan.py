"""Backend refine=wan: Wan 2.1 and 2.2 (Wan team 2025), a flow in latents of a VAE.

The weights may be for text to video, for image to video (with the first frame of each
window as a condition), or of Wan 2.2 with two experts or with a noise level per token
(TI2V). In each case the guidance video is the start, and its first frame is held.
"""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import torch
from diffusers import (
    AutoencoderKLWan,
    DiffusionPipeline,
    FlowMatchEulerDiscreteScheduler,
)
from PIL import Image
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

NAME, WHAT = "wan", "Wan"
KNOWN = ("WanPipeline", "WanImageToVideoPipeline", "WanVideoToVideoPipeline")
GUIDANCE = 5.0
"""Weight of the prompt recommended by its authors."""
AREA = 480 * 832
"""Area of its training videos, px."""
FRAMES = 81
"""Length of its training videos, frames."""
TOKENS = 512
"""Length of a text, tokens."""


@dataclass(frozen=True)
class Condition:
    """A first frame for the network."""

    channels: Tensor  # (1, 4 + C, F', h, w): mask of given frames, and their latents
    picture: Tensor | None  # CLIP's embedding, if the weights use CLIP


class Wan:
    """Wan as a `sampling.Network`."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        config = pipe.scheduler.config
        # UniPC, the scheduler of the weights, uses earlier steps, and would undo the
        # fusion.
        self._scheduler = FlowMatchEulerDiscreteScheduler(
            num_train_timesteps=config.num_train_timesteps,
            shift=config.get("flow_shift") or config.shift,
        )
        vae = pipe.vae.config
        # Wan's latents are normalised channel by channel; shape (1, C, 1, 1, 1).
        self._mean, self._spread = (
            torch.tensor(values, dtype=torch.float32, device=device).view(
                1, -1, 1, 1, 1
            )
            for values in (vae.latents_mean, vae.latents_std)
        )
        network = self._network(float("inf"))
        # Image-to-video weights have input channels for a condition besides the
        # latents.
        self._takes_frame = network.config.in_channels > vae.z_dim

    def schedule(self, steps: int, count: int, shape: torch.Size) -> Schedule:
        """Return Euler's steps, shifted."""
        return euler(self._scheduler, steps, count)

    def encode_text(self, text: str) -> Tensor:
        """Return (1, 512, width), zeros behind the text's end.

        The pipeline's own method also repairs wrongly decoded letters, with the library
        ftfy; the prompts here do not need it.
        """
        # The authors' pipeline unescapes twice, for text that was escaped twice.
        words = " ".join(html.unescape(html.unescape(text)).split())
        tokens = self.pipe.tokenizer(
            [words],
            padding="max_length",
            max_length=TOKENS,
            truncation=True,
            add_special_tokens=True,
            return_attention_mask=True,
            return_tensors="pt",
        )
        mask = tokens.attention_mask.to(self._device)
        ids = tokens.input_ids.to(self._device)
        states = self.pipe.text_encoder(ids, mask).last_hidden_state
        # The denoising network takes no mask of the text, so padding must be zero.
        embedding: Tensor = states.to(self._dtype).masked_fill(mask[..., None] == 0, 0)
        return embedding

    def condition(self, frame: Tensor, latents: int) -> Condition | None:
        """Return the condition of a window by its first frame."""
        if not self._takes_frame:
            return None
        stride = self.pipe.vae_scale_factor_temporal
        count = 1 + (latents - 1) * stride
        video = torch.zeros((1, 3, count, *frame.shape[1:]), device=self._device)
        # The network expects a video of the first frame and grey, and a mask of known
        # frames.
        video[0, :, 0] = frame
        encoded = self._encode(video)
        mask = torch.zeros((1, stride, *encoded.shape[2:]), device=self._device)
        mask[:, :, 0] = 1
        channels = torch.cat([mask, encoded], dim=1).to(self._dtype)
        return Condition(channels, self._embed(frame))

    def _embed(self, frame: Tensor) -> Tensor | None:
        network = self._network(float("inf"))
        if network.config.image_dim is None:
            return None
        levels = ((frame / 2 + 0.5) * 255).round().to(torch.uint8)
        picture = Image.fromarray(levels.permute(1, 2, 0).numpy())
        embedding: Tensor = self.pipe.encode_image(picture, self._device)
        return embedding.to(self._dtype)

    def _encode(self, video: Tensor) -> Tensor:
        # The mode, not a sample: encoding must not depend on chance.
        latents: Tensor = self.pipe.vae.encode(video).latent_dist.mode()
        return (latents - self._mean) / self._spread

    def encode(self, video: Tensor) -> Tensor:
        """Return the mean latents, with every channel centred and scaled."""
        latents = self._encode(video.to(self._device).transpose(0, 1)[None])
        return latents[0].transpose(0, 1)

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """Decode all frames at once: each depends on the latent frames before it."""
        z = latents.to(self._device).transpose(0, 1)[None]
        video = self.pipe.vae.decode(z * self._spread + self._mean).sample
        yield from video[0].transpose(0, 1).split(1)

    def predict(
        self, latents: Tensor, time: Tensor, text: Tensor, condition: Condition | None
    ) -> Tensor:
        """Predict (F', C, h, w); the network takes (1, C, F', h, w)."""
        z = latents.to(self._device, self._dtype).transpose(0, 1)[None]
        picture = None
        if condition is not None:
            z = torch.cat([z, condition.channels], dim=1)
            picture = condition.picture
        network = self._network(float(time))
        flow: Tensor = network(
            hidden_states=z,
            timestep=self._timesteps(network, time, z.shape),
            encoder_hidden_states=text,
            encoder_hidden_states_image=picture,
            return_dict=False,
        )[0]
        return flow[0].transpose(0, 1)

    def _timesteps(self, network: Any, time: Tensor, shape: torch.Size) -> Tensor:
        """Return one noise level, or one for each token if the weights require it."""
        time = time.to(self._device).expand(1)
        if not self.pipe.config.get("expand_timesteps"):
            return time
        # The transformer merges latent cells to patches, one token each.
        frames, height, width = (
            side // patch
            for side, patch in zip(shape[2:], network.config.patch_size, strict=True)
        )
        return time.expand(1, frames * height * width)

    def _network(self, time: float) -> Any:
        """Return the network for a noise level: Wan 2.2 has one for high and one for
        low noise.
        """
        first_network, second_network = (
            self.pipe.transformer,
            getattr(self.pipe, "transformer_2", None),
        )
        share = self.pipe.config.get("boundary_ratio")
        if first_network is None or second_network is None or share is None:
            if first_network is not None:
                return first_network
            return second_network
        # The border is given as a share of the noise levels of the training.
        edge = share * self._scheduler.config.num_train_timesteps
        if time >= edge:
            return first_network
        return second_network


def read_training_settings(weights: tuple[str, ...]) -> TrainingSettings:
    """Read the settings of the configurations."""
    (weights_name,) = weights
    index = pipeline_index(weights_name, WHAT)
    check_pipeline_class(weights_name, str(index.get("_class_name")), KNOWN, WHAT)
    # A pipeline may have two networks, for different levels of noise, or only the
    # second.
    has_first = index.get("transformer", [None, None])[1]
    part = "transformer_2"
    if has_first:
        part = "transformer"
    vae, network = (
        part_config(weights_name, "vae", WHAT),
        part_config(weights_name, part, WHAT),
    )
    cell = vae.get("scale_factor_spatial", 8)
    stride = vae.get("scale_factor_temporal", 4)
    side = cell * max(network.get("patch_size", [1, 2, 2])[1:])
    # The first latent frame has one frame, each other one `stride` frames.
    window = 1 + (FRAMES - 1) // stride
    # Positions have a maximum number of latent frames.
    most_frames = 1 + (network.get("rope_max_seq_len", 1024) - 1) * stride
    return TrainingSettings(Grid(cell, side, AREA, window, stride), most_frames)


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> Wan:
    """Load the pipeline."""
    pipe = load_pipeline(DiffusionPipeline, weights[0], dtype, WHAT, AutoencoderKLWan)
    return Wan(pipe, device, dtype)


KIND = Kind(NAME, WHAT, GUIDANCE, read_training_settings, load)


def wan(setup: Setup) -> Sampler:
    """Make the backend `wan`."""
    return Sampler(KIND, setup)
