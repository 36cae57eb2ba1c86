"""Tiny SAM 2 and SAM 3 of the real classes, with random weights, saved as the hub has them.

They prove the plumbing only.
"""

from __future__ import annotations

import json
import string
from pathlib import Path

import torch
from transformers import (
    CLIPTokenizerFast,
    Sam2Config,
    Sam2Model,
    Sam3Config,
    Sam3Model,
)

_SMALL = {"hidden_size": 32, "num_attention_heads": 2, "intermediate_size": 32}
SAM3 = {
    "vision_config": {
        "backbone_config": {
            "model_type": "sam3_vit_model", **_SMALL, "num_hidden_layers": 1, "image_size": 56, "patch_size": 14,
            "window_size": 2, "global_attn_indexes": [0], "pretrain_image_size": 28,
        },
        "fpn_hidden_size": 32, "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
    },
    "text_config": {
        "vocab_size": 54, **_SMALL, "projection_dim": 32, "num_hidden_layers": 1, "max_position_embeddings": 16,
        "eos_token_id": 53, "bos_token_id": 52, "pad_token_id": 53,
    },
    "geometry_encoder_config": {**_SMALL, "num_layers": 1},
    "detr_encoder_config": {**_SMALL, "num_layers": 1},
    "detr_decoder_config": {**_SMALL, "num_layers": 1, "num_queries": 10},
    "mask_decoder_config": {"hidden_size": 32, "num_attention_heads": 2},
}  # fmt: skip


def sam2(folder: Path) -> Path:
    torch.manual_seed(0)
    config = Sam2Config(
        vision_config={
            "backbone_config": {
                "model_type": "sam2_hiera_det_model", "hidden_size": 16, "image_size": [64, 64],
                "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [16, 32, 64, 128],
                "num_attention_heads_per_stage": [1, 2, 4, 8], "window_size_per_stage": [8, 4, 4, 4],
                "global_attention_blocks": [3], "window_positional_embedding_background_size": [4, 4],
            },
            "backbone_channel_list": [128, 64, 32, 16], "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
        },
        prompt_encoder_config={"hidden_size": 32, "image_size": 64, "patch_size": 16, "mask_input_channels": 8},
        mask_decoder_config={
            "hidden_size": 32, "mlp_dim": 32, "num_attention_heads": 2, "num_hidden_layers": 1,
            "iou_head_hidden_dim": 32,
        },
    )  # fmt: skip
    Sam2Model(config).save_pretrained(folder)
    return folder


def write_letters(folder: Path) -> None:
    """Write a tokenizer whose words are the letters."""
    letters = string.ascii_lowercase
    ends = [f"{letter}</w>" for letter in letters]
    words = [*letters, *ends, "<|startoftext|>", "<|endoftext|>"]
    numbers = {word: k for k, word in enumerate(words)}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.json").write_text(json.dumps(numbers))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    CLIPTokenizerFast(
        str(folder / "vocab.json"), str(folder / "merges.txt")
    ).save_pretrained(folder)


def sam3(folder: Path) -> Path:
    write_letters(folder)
    torch.manual_seed(0)
    Sam3Model(Sam3Config(**SAM3)).save_pretrained(folder)
    return folder


MODELS = {("segment", "sam2"): sam2, ("segment", "sam3"): sam3}
