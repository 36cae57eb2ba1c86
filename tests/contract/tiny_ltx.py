"""Tiny LTX-Video models of the real classes, saved as diffusers saves them: those of 0.9, and those of 0.9.5.

Their weights are random numbers: they prove loading, layouts, schedules and arithmetic, and nothing of what they draw.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from diffusers import (
    AutoencoderKLLTXVideo,
    FlowMatchEulerDiscreteScheduler,
    LTXConditionPipeline,
    LTXPipeline,
    LTXVideoTransformer3DModel,
)
from transformers import T5Config, T5EncoderModel

from tests.contract.tiny_wan import tokenizer

SHIFT: Mapping[str, Any] = {
    "use_dynamic_shifting": True, "base_shift": 0.95, "max_shift": 2.05, "base_image_seq_len": 1024,
    "max_image_seq_len": 4096, "shift_terminal": 0.1,
}  # fmt: skip
"""Of the scheduler of 0.9."""


def ltx(folder: Path, conditioned: bool = False) -> str:
    """Weights of 0.9, or (`conditioned`) of 0.9.5, whose decoder knows a noise level and adds noise of its own."""
    torch.manual_seed(0)
    tokens = tokenizer()
    encoder = T5EncoderModel(
        T5Config(vocab_size=len(tokens), d_model=16, d_kv=8, d_ff=16, num_layers=1, num_heads=2)
    )  # fmt: skip
    network = LTXVideoTransformer3DModel(
        in_channels=4, out_channels=4, num_attention_heads=2, attention_head_dim=12, cross_attention_dim=24,
        num_layers=1, caption_channels=16,
    )  # fmt: skip
    kind, shift = (LTXConditionPipeline, {}) if conditioned else (LTXPipeline, SHIFT)
    kind(
        scheduler=FlowMatchEulerDiscreteScheduler(**shift),
        vae=autoencoder(conditioned),
        text_encoder=encoder.eval(),
        tokenizer=tokens,
        transformer=network.eval(),
    ).save_pretrained(folder)
    return str(folder)


def autoencoder(conditioned: bool) -> AutoencoderKLLTXVideo:
    vae = AutoencoderKLLTXVideo(
        latent_channels=4, block_out_channels=(8, 8, 8, 8), decoder_block_out_channels=(8, 8, 8, 8),
        layers_per_block=(1, 1, 1, 1, 1), decoder_layers_per_block=(1, 1, 1, 1, 1), scaling_factor=0.5,
        timestep_conditioning=conditioned, decoder_inject_noise=(conditioned,) * 5,
    ).eval()  # fmt: skip
    vae.latents_mean.copy_(torch.tensor([0.1, -0.2, 0.0, 0.3]))
    vae.latents_std.copy_(torch.tensor([0.5, 0.8, 1.1, 0.9]))
    for name, values in vae.named_parameters():
        if "per_channel_scale" in name:
            values.data.fill_(0.2)
    return vae


MODELS: Mapping[tuple[str, str], Callable[[Path], str]] = {("refine", "ltx-video"): ltx}
"""What builds the model of a row in an empty folder and gives what a choice names."""
VARIANTS: Mapping[str, tuple[str, Callable[[Path], str]]] = {
    "ltx-video": ("ltx-video", ltx),
    "ltx-video-condition": ("ltx-video", partial(ltx, conditioned=True)),
}
"""Kinds of weights that the backend takes: its name, and what builds them."""
