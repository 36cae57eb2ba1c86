"""Tiny Wan models of the real classes, saved as diffusers saves them: one for each kind of weights.

Their weights are random numbers: they prove loading, layouts, schedules and arithmetic, and nothing of what they draw.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from diffusers import (
    AutoencoderKLWan,
    UniPCMultistepScheduler,
    WanImageToVideoPipeline,
    WanPipeline,
    WanTransformer3DModel,
)
from transformers import (
    CLIPImageProcessorPil,
    CLIPVisionConfig,
    CLIPVisionModel,
    T5Tokenizer,
    UMT5Config,
    UMT5EncoderModel,
)

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def tokenizer() -> T5Tokenizer:
    """One of single letters."""
    pieces = [
        "<pad>",
        "</s>",
        "<unk>",
        "▁",
        *LETTERS,
        *(f"▁{letter}" for letter in LETTERS),
        ",",
    ]
    return T5Tokenizer(vocab=[(piece, -1.0) for piece in pieces], extra_ids=0)


def _t5() -> dict[str, Any]:
    """A text encoder and its tokenizer."""
    torch.manual_seed(0)
    tokens = tokenizer()
    size: dict[str, Any] = {
        "vocab_size": len(tokens), "d_model": 16, "d_kv": 8, "d_ff": 16, "num_layers": 1, "num_heads": 2,
    }  # fmt: skip
    encoder = UMT5EncoderModel(UMT5Config(**size))
    return {"text_encoder": encoder.eval(), "tokenizer": tokens}


def wan(
    folder: Path, framed: bool = False, experts: bool = False, ti2v: bool = False
) -> str:
    """Wan 2.1 (`framed`: of image to video, with CLIP), or the two experts or TI2V of 2.2."""
    uses_clip = framed and not experts
    sizes = {"in_channels": 4}
    if framed:
        sizes["in_channels"] = 12
    if uses_clip:
        sizes |= {"image_dim": 8, "added_kv_proj_dim": 24}
    parts: dict[str, Any] = _t5()
    torch.manual_seed(1)
    parts |= {"transformer": network(**sizes), "vae": autoencoder()}
    parts["scheduler"] = UniPCMultistepScheduler(
        prediction_type="flow_prediction", use_flow_sigmas=True, flow_shift=3.0
    )
    if uses_clip:
        parts |= _clip()
    if experts:
        parts |= {"transformer_2": network(**sizes), "boundary_ratio": 0.5}
    if ti2v:
        parts["expand_timesteps"] = True
    kinds = {False: WanPipeline, True: WanImageToVideoPipeline}
    kinds[framed](**parts).save_pretrained(folder)
    return str(folder)


def network(**sizes: int) -> WanTransformer3DModel:
    return WanTransformer3DModel(
        patch_size=(1, 2, 2), num_attention_heads=2, attention_head_dim=12, out_channels=4, text_dim=16, freq_dim=16,
        ffn_dim=16, num_layers=1, cross_attn_norm=True, qk_norm="rms_norm_across_heads", rope_max_seq_len=32, **sizes,
    ).eval()  # fmt: skip


def autoencoder() -> AutoencoderKLWan:
    vae = AutoencoderKLWan(
        base_dim=4, z_dim=4, dim_mult=[1, 1, 1, 1], num_res_blocks=1, temperal_downsample=[False, True, True],
        latents_mean=[0.1, -0.2, 0.0, 0.3], latents_std=[0.5, 0.8, 1.1, 0.9],
    ).eval()  # fmt: skip
    vae.decoder.conv_out.weight.data *= 8  # else all that it draws is grey
    return vae


def _clip() -> dict[str, Any]:
    size = {"shortest_edge": 8}
    return {
        "image_encoder": CLIPVisionModel(
            CLIPVisionConfig(
                hidden_size=8, projection_dim=8, num_hidden_layers=2, num_attention_heads=2, image_size=8,
                intermediate_size=8, patch_size=4,
            )
        ).eval(),
        "image_processor": CLIPImageProcessorPil(size=size, crop_size={"height": 8, "width": 8}),
    }  # fmt: skip


MODELS: Mapping[tuple[str, str], Callable[[Path], str]] = {("refine", "wan"): wan}
"""What builds the model of a row in an empty folder and gives what a choice names."""
VARIANTS: Mapping[str, tuple[str, Callable[[Path], str]]] = {
    "wan": ("wan", wan),
    "wan-framed": ("wan", partial(wan, framed=True)),
    "wan-experts": ("wan", partial(wan, experts=True)),
    "wan-framed-experts": ("wan", partial(wan, framed=True, experts=True)),
    "wan-ti2v": ("wan", partial(wan, ti2v=True)),
}
"""Kinds of weights that the backend takes: its name, and what builds them."""
