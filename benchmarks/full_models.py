"""Video models of the published sizes, filled with random numbers where they run: figures of speed and memory alone."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import diffusers
import torch
from diffusers import (
    AnimateDiffVideoToVideoPipeline,
    AutoencoderKL,
    DDIMScheduler,
    MotionAdapter,
    UNet2DConditionModel,
)
from transformers import CLIPTextConfig, CLIPTextModel, CLIPTokenizer

from physgen.perceive.backends.models import device_of, dtype_of
from physgen.refine.backends import animatediff
from physgen.refine.backends.sampling import Sampler
from physgen.registry import Setup

diffusers.logging.set_verbosity_error()  # it warns of casts that change nothing
LETTERS = "abcdefghijklmnopqrstuvwxyz"


def made(build: Callable[[], Any], folder: Path, setup: Setup) -> Sampler:
    """AnimateDiff on the parts that `build` makes: configurations go through the folder, weights are made in place."""
    device = device_of(setup)
    dtype = dtype_of(setup, device)
    torch.manual_seed(0)
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        with unfilled(), torch.device(device):
            pipe = build()
    finally:
        torch.set_default_dtype(before)
    pipe.vae.to(torch.float32)
    pipe.set_progress_bar_config(disable=True)
    index = {"_class_name": type(pipe).__name__}
    for name, part in pipe.components.items():
        index[name] = ["diffusers", type(part).__name__]
        if isinstance(part, torch.nn.Module):
            part.eval().requires_grad_(False)
            for weight in part.parameters():
                weight.uniform_(-0.02, 0.02)
        if hasattr(part, "save_config") and not (folder / name).exists():
            part.save_config(folder / name)
    # as weights have it: the pipeline puts the adapter into it
    index["unet"] = ["diffusers", "UNet2DConditionModel"]
    (folder / "model_index.json").write_text(json.dumps(index))
    network = animatediff.AnimateDiff(pipe, device, dtype)
    kind = replace(animatediff.KIND, load=lambda *_: network)
    weights = f"{folder}/motion_adapter,{folder}"
    return Sampler(kind, replace(setup, weights=weights, device=device))


@contextmanager
def unfilled() -> Iterator[None]:
    """Weights are left as they are found: the libraries would draw them with care, twice."""
    names = [
        name
        for name in dir(torch.nn.init)
        if name.endswith("_") and not name.startswith("_")
    ]
    kept = {name: getattr(torch.nn.init, name) for name in names}
    for name in names:
        setattr(torch.nn.init, name, lambda tensor, *_, **__: tensor)
    try:
        yield
    finally:
        for name, fill in kept.items():
            setattr(torch.nn.init, name, fill)


def _clip_text(folder: Path) -> dict[str, Any]:
    words = [
        "<|startoftext|>",
        "<|endoftext|>",
        *LETTERS,
        *(f"{letter}</w>" for letter in LETTERS),
    ]
    (folder / "vocab.json").write_text(
        json.dumps({word: k for k, word in enumerate(words)})
    )
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokens = CLIPTokenizer(
        vocab=str(folder / "vocab.json"),
        merges=str(folder / "merges.txt"),
        model_max_length=77,
    )
    config = CLIPTextConfig(
        hidden_size=768, intermediate_size=3072, num_attention_heads=12, num_hidden_layers=12,
        bos_token_id=0, eos_token_id=1, pad_token_id=1,
    )  # fmt: skip
    return {"text_encoder": CLIPTextModel(config), "tokenizer": tokens}


def stable_diffusion(folder: Path, setup: Setup) -> Sampler:
    """Stable Diffusion 1.5 with a motion adapter v1-5-3."""

    def build() -> Any:
        unet = UNet2DConditionModel(
            sample_size=64, cross_attention_dim=768, attention_head_dim=8
        )
        unet.save_config(folder / "unet")
        vae = AutoencoderKL(
            block_out_channels=[128, 256, 512, 512], latent_channels=4, sample_size=512,
            down_block_types=["DownEncoderBlock2D"] * 4, up_block_types=["UpDecoderBlock2D"] * 4, layers_per_block=2,
        )  # fmt: skip
        return AnimateDiffVideoToVideoPipeline(
            unet=unet, vae=vae, motion_adapter=MotionAdapter(use_motion_mid_block=False),
            scheduler=DDIMScheduler(beta_start=0.00085, beta_end=0.012), **_clip_text(folder),
        )  # fmt: skip

    return made(build, folder, setup)


FULL: Mapping[str, Callable[[Path, Setup], Sampler]] = {
    "animatediff": stable_diffusion,
}  # fmt: skip
"""A folder for configurations and a setup -> the backend."""
