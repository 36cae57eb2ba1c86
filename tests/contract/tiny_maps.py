"""Tiny models of the real classes for depth, normals, intrinsic and inpaint, saved as their libraries save them.

Their weights are random numbers: they prove loading, sizes, types and conventions, and nothing of what they say.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

LIGHTING = {
    "target_names": ["albedo", "shading", "residual"],
    "albedo": {"prediction_space": "linear", "up_to_scale": False},
    "shading": {"prediction_space": "linear", "up_to_scale": True},
    "residual": {"prediction_space": "linear", "up_to_scale": True},
}
"""As the training configuration of prs-eth/marigold-iid-lighting-v1-1 has them."""
APPEARANCE = {
    "target_names": ["albedo", "material"],
    "albedo": {"prediction_space": "srgb"},
    "material": {
        "prediction_space": "stack",
        "sub_target_names": ["roughness", "metallicity", None],
    },
    "roughness": {"prediction_space": "linear", "up_to_scale": False},
    "metallicity": {"prediction_space": "linear", "up_to_scale": False},
}
OPTIONS: Mapping[str, Mapping[str, Any]] = {"diffusion": {"steps": 2}}
"""What its factory is told beside its path: a full schedule would take long."""


def _parts(channels: int, out: int) -> dict[str, Any]:
    """What every Stable Diffusion consists of; the network takes `channels` and gives `out`."""
    import torch
    from diffusers import AutoencoderKL, DDIMScheduler, UNet2DConditionModel
    from transformers import CLIPTextConfig, CLIPTextModel

    torch.manual_seed(0)
    text = CLIPTextConfig(
        bos_token_id=0, eos_token_id=1, hidden_size=16, intermediate_size=16, num_attention_heads=2,
        num_hidden_layers=1, pad_token_id=1, vocab_size=len(_words()),
    )  # fmt: skip
    return {
        "unet": UNet2DConditionModel(
            block_out_channels=(16, 32), layers_per_block=1, sample_size=16, in_channels=channels, out_channels=out,
            down_block_types=("DownBlock2D", "CrossAttnDownBlock2D"), cross_attention_dim=16, norm_num_groups=8,
            up_block_types=("CrossAttnUpBlock2D", "UpBlock2D"), attention_head_dim=4,
        ),
        "vae": AutoencoderKL(
            block_out_channels=[8, 16], in_channels=3, out_channels=3, latent_channels=4, norm_num_groups=4,
            down_block_types=["DownEncoderBlock2D"] * 2, up_block_types=["UpDecoderBlock2D"] * 2,
        ),
        "scheduler": DDIMScheduler(
            beta_start=0.00085, beta_end=0.012, beta_schedule="scaled_linear", prediction_type="v_prediction",
            clip_sample=False, set_alpha_to_one=False, steps_offset=1,
        ),
        "text_encoder": CLIPTextModel(text),
    }  # fmt: skip


def _words() -> dict[str, int]:
    letters = [chr(c) for c in range(ord("a"), ord("z") + 1)]
    return {
        word: k
        for k, word in enumerate(
            [
                "<|startoftext|>",
                "<|endoftext|>",
                *letters,
                *(f"{c}</w>" for c in letters),
            ]
        )
    }


def _tokenizer(folder: Path) -> Any:
    from transformers import CLIPTokenizer

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.json").write_text(json.dumps(_words()))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    return CLIPTokenizer(
        vocab=str(folder / "vocab.json"),
        merges=str(folder / "merges.txt"),
        model_max_length=77,
    )


def marigold(role: str, **told: Any) -> Callable[[Path], Path]:
    def build(folder: Path) -> Path:
        import diffusers

        name = {"depth": "Depth", "normals": "Normals", "intrinsic": "Intrinsics"}[role]
        kind = {"depth": "depth", "normals": "normals", "intrinsic": "intrinsics"}[role]
        targets = (
            len(told["target_properties"]["target_names"])
            if "target_properties" in told
            else 1
        )
        pipe = getattr(diffusers, f"Marigold{name}Pipeline")(
            **_parts(4 + 4 * targets, 4 * targets), tokenizer=_tokenizer(folder / "words"), prediction_type=kind,
            default_denoising_steps=2, default_processing_resolution=64, **told,
        )  # fmt: skip
        pipe.save_pretrained(folder)
        return folder

    return build


def stable_diffusion(folder: Path) -> Path:
    from diffusers import StableDiffusionInpaintPipeline

    StableDiffusionInpaintPipeline(
        **_parts(9, 4), tokenizer=_tokenizer(folder / "words"), safety_checker=None, feature_extractor=None,
        requires_safety_checker=False,
    ).save_pretrained(folder)  # fmt: skip
    return folder


class Trap:
    """Leaves a file where it is unpickled."""

    def __init__(self, path: str) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return open, (self.path, "w")


MODELS: Mapping[tuple[str, str], Callable[[Path], Path]] = {
    ("depth", "marigold"): marigold("depth"),
    ("normals", "marigold"): marigold("normals", use_full_z_range=True),
    ("intrinsic", "marigold"): marigold("intrinsic", target_properties=LIGHTING),
    ("inpaint", "diffusion"): stable_diffusion,
}
"""What builds the model of a row in an empty folder and gives the path to name."""
