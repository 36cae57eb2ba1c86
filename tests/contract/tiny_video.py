"""Tiny video diffusion models of the real classes, saved as their libraries save them: rows' weights, and variants.

Their weights are random numbers: they prove loading, layouts, schedules and arithmetic, and nothing of what they draw.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tests.contract.tiny_maps import _parts, _tokenizer

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def animatediff(folder: Path, length: int = 32) -> str:
    """An adapter and a base, as a choice names them."""
    from diffusers import MotionAdapter, StableDiffusionPipeline

    parts = _parts(4, 4)
    MotionAdapter(
        block_out_channels=(16, 32), motion_layers_per_block=1, motion_norm_num_groups=4, motion_num_attention_heads=2,
        motion_max_seq_length=length,
    ).save_pretrained(folder / "adapter")  # fmt: skip
    StableDiffusionPipeline(
        **parts, tokenizer=_tokenizer(folder / "words"), safety_checker=None, feature_extractor=None,
        requires_safety_checker=False,
    ).save_pretrained(folder / "base")  # fmt: skip
    return f"{folder / 'adapter'},{folder / 'base'}"


def _t5() -> dict[str, Any]:
    """A text encoder and its tokenizer."""
    import torch
    from transformers import T5Tokenizer, UMT5Config, UMT5EncoderModel

    torch.manual_seed(0)
    pieces = ["<pad>", "</s>", "<unk>", "▁", *LETTERS, *(f"▁{letter}" for letter in LETTERS), ","]
    size: dict[str, Any] = {
        "vocab_size": len(pieces), "d_model": 16, "d_kv": 8, "d_ff": 16, "num_layers": 1, "num_heads": 2,
    }  # fmt: skip
    encoder = UMT5EncoderModel(UMT5Config(**size))
    tokens = T5Tokenizer(vocab=[(piece, -1.0) for piece in pieces], extra_ids=0)
    return {"text_encoder": encoder.eval(), "tokenizer": tokens}


def wan(folder: Path, looks: bool = False, experts: bool = False, ti2v: bool = False) -> str:
    """Wan 2.1 (shown a first frame where it `looks`, through CLIP as well), or the two experts of 2.2."""
    import torch
    from diffusers import (
        AutoencoderKLWan,
        UniPCMultistepScheduler,
        WanImageToVideoPipeline,
        WanPipeline,
        WanTransformer3DModel,
    )

    parts: dict[str, Any] = _t5()
    clip = looks and not experts

    def network() -> WanTransformer3DModel:
        return WanTransformer3DModel(
            patch_size=(1, 2, 2), num_attention_heads=2, attention_head_dim=12, in_channels=12 if looks else 4,
            out_channels=4, text_dim=16, freq_dim=16, ffn_dim=16, num_layers=1, cross_attn_norm=True,
            qk_norm="rms_norm_across_heads", rope_max_seq_len=32, image_dim=8 if clip else None,
            added_kv_proj_dim=24 if clip else None,
        ).eval()  # fmt: skip

    torch.manual_seed(1)
    parts["transformer"] = network()
    parts["vae"] = AutoencoderKLWan(
        base_dim=4, z_dim=4, dim_mult=[1, 1, 1, 1], num_res_blocks=1, temperal_downsample=[False, True, True],
        latents_mean=[0.1, -0.2, 0.0, 0.3], latents_std=[0.5, 0.8, 1.1, 0.9],
    ).eval()  # fmt: skip
    parts["vae"].decoder.conv_out.weight.data *= 8  # else all that it draws is grey
    parts["scheduler"] = UniPCMultistepScheduler(
        prediction_type="flow_prediction", use_flow_sigmas=True, flow_shift=3.0
    )
    if clip:
        parts |= _clip()
    if experts:
        parts |= {"transformer_2": network(), "boundary_ratio": 0.5}
    if ti2v:
        parts["expand_timesteps"] = True
    (WanImageToVideoPipeline if looks else WanPipeline)(**parts).save_pretrained(folder)
    return str(folder)


def _clip() -> dict[str, Any]:
    from transformers import CLIPImageProcessorPil, CLIPVisionConfig, CLIPVisionModel

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


MODELS: Mapping[tuple[str, str], Callable[[Path], str]] = {
    ("refine", "animatediff"): animatediff,
    ("refine", "wan"): wan,
}
"""What builds the model of a row in an empty folder and gives what a choice names."""
VARIANTS: Mapping[str, tuple[str, Callable[[Path], str]]] = {
    "animatediff": ("animatediff", animatediff),
    "wan": ("wan", wan),
    "wan-looks": ("wan", lambda folder: wan(folder, looks=True)),
    "wan-experts": ("wan", lambda folder: wan(folder, experts=True)),
    "wan-looks-experts": ("wan", lambda folder: wan(folder, looks=True, experts=True)),
}
"""Kinds of weights that a backend takes: its name, and what builds them."""
