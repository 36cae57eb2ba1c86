"""AnimateDiff (Guo et al. 2024): a motion adapter in a Stable Diffusion 1.5.

Every frame is a latent. Frames should have about 512 x 512 px; the model sees 16 at a
time, and no first frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from diffusers import (
    AnimateDiffVideoToVideoPipeline,
    AutoencoderKL,
    DDIMScheduler,
    MotionAdapter,
)
from torch import Tensor

from physgen.messages import Message
from physgen.perceive.backends.models import as_dtype, load_weights
from physgen.refine.backends.sampling import (
    REFINE,
    Kind,
    Sampler,
    Schedule,
    TrainingSettings,
    ddim,
    load_pipeline,
    part_config,
    pipeline_index,
)
from physgen.refine.denoiser import Grid
from physgen.registry import Setup, find

NAME, WHAT = "animatediff", "AnimateDiff"
GUIDANCE = 8.0
"""Default weight of the texts, as upstream for SEINE."""
FRAMES = 16
"""Number of frames in the adapters' training, although some can take more."""
CHUNK = 8
"""Number of frames per pass of the VAE."""


class AnimateDiff:
    """Loaded weights: tensors in, tensors out, on the device."""

    def __init__(self, pipe: Any, device: str, dtype: torch.dtype) -> None:
        self.pipe, self._device, self._dtype = pipe, device, dtype
        # The network contains the adapter by now, which would take 1.7 GB twice.
        pipe.register_modules(motion_adapter=None)
        # DDIM as in the authors' code: PNDM, the scheduler of most such weights, takes
        # some steps twice. With this spacing every step ends at the begin of the next
        # one, and the last at the picture (with `linspace`, 8 steps of 1000 would end
        # 18 levels early).
        self._scheduler = DDIMScheduler.from_config(
            pipe.scheduler.config, clip_sample=False, timestep_spacing="leading", beta_schedule="linear",
            steps_offset=1, set_alpha_to_one=True,
        )  # fmt: skip

    def schedule(self, steps: int, count: int, shape: torch.Size) -> Schedule:
        """Return the DDIM schedule."""
        return ddim(self._scheduler, steps, count)

    def encode_text(self, text: str) -> Tensor:
        """Encode a text as (1, 77, width)."""
        embedding: Tensor = self.pipe.encode_prompt(text, self._device, 1, False)[0]
        return embedding

    def condition(self, frame: Tensor, latents: int) -> None:
        """Return None: the model is guided only by text."""

    def encode(self, video: Tensor) -> Tensor:
        """Encode (F, 3, H, W) in -1..1 on the processor as mean latents (F, C,
        h, w).
        """
        vae = self.pipe.vae
        latents_by_frame = [
            vae.encode(part.to(self._device)).latent_dist.mode()
            for part in video.split(CHUNK)
        ]
        return torch.cat(latents_by_frame) * vae.config.scaling_factor

    def decode(self, latents: Tensor) -> Iterator[Tensor]:
        """Decode (F, C, h, w) on the processor to (f, 3, H, W) in -1..1, some frames at
        a time.
        """
        vae = self.pipe.vae
        for part in latents.split(CHUNK):
            yield vae.decode(part.to(self._device) / vae.config.scaling_factor).sample

    def predict(
        self, latents: Tensor, time: Tensor, text: Tensor, condition: Any
    ) -> Tensor:
        """Predict (F, C, h, w); the network takes (1, C, F, h, w)."""
        z = latents.to(self._device, self._dtype).transpose(0, 1)[None]
        # The image network sees frames as a batch, each with the text.
        words = text.repeat_interleave(len(latents), dim=0)
        prediction: Tensor = self.pipe.unet(
            z, time.to(self._device), encoder_hidden_states=words
        ).sample
        return prediction[0].transpose(0, 1)


def read_training_settings(weights: tuple[str, ...]) -> TrainingSettings:
    """Read the settings of the configurations."""
    adapter, base = weights
    index, motion = pipeline_index(base, WHAT), part_config(adapter, "", WHAT)
    kind = str(motion.get("_class_name"))
    if kind != "MotionAdapter":
        raise Message.NOT_AN_ADAPTER.error(
            REFINE.name,
            f'"{adapter}"',
            kind=kind,
            example=find("refine", "animatediff").weights[0].id,
        )
    # An adapter fits a base of Stable Diffusion 1 alone: SDXL has a second text
    # encoder.
    base_classes = (
        index.get("unet", ["", ""])[1] == "UNet2DConditionModel"
        and "text_encoder_2" not in index
    )
    if base_classes:
        unet = part_config(base, "unet", WHAT)
    else:
        unet = {}
    # The adapter's layers lie inside the blocks, so both networks need equal widths.
    if list(motion["block_out_channels"]) != list(unet.get("block_out_channels", [])):
        raise Message.BASE_DOES_NOT_FIT.error(
            REFINE.name, f'"{base}"', kind=index.get("_class_name")
        )
    vae, most_frames = (
        part_config(base, "vae", WHAT),
        motion.get("motion_max_seq_length", 32),
    )
    # The autoencoder halves the picture between its levels, and so does the network.
    cell = 2 ** (len(vae["block_out_channels"]) - 1)
    levels = 2 ** (len(unet["block_out_channels"]) - 1)
    # The side of its training pictures in latent cells; 64 cells are 512 px.
    side = unet.get("sample_size") or 64
    return TrainingSettings(
        Grid(cell, cell * levels, (side * cell) ** 2, min(FRAMES, most_frames)),
        most_frames,
    )


def load(weights: tuple[str, ...], device: str, dtype: torch.dtype) -> AnimateDiff:
    """Load the pipeline."""
    adapter, base = weights

    def motion(path: str) -> Any:
        return as_dtype(
            MotionAdapter.from_pretrained(path, dtype=dtype, use_safetensors=True),
            dtype,
        )

    part = load_weights(motion, adapter, WHAT, REFINE)
    kind = AnimateDiffVideoToVideoPipeline
    return AnimateDiff(
        load_pipeline(kind, base, dtype, WHAT, AutoencoderKL, motion_adapter=part),
        device,
        dtype,
    )


KIND = Kind(NAME, WHAT, GUIDANCE, read_training_settings, load)


def animatediff(setup: Setup) -> Sampler:
    """Make the backend `animatediff`; its weights are `ADAPTER,BASE`."""
    return Sampler(KIND, setup)
