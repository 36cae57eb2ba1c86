"""Tiny segmenters of the real classes, with random weights, saved as the hub has them: they prove the plumbing only."""

from __future__ import annotations

import json
from pathlib import Path

WORDS = (
    "a",
    "ball",
    "block",
    "book",
    "cup",
    "domino",
    "red",
    "table",
    "wall",
    "floor",
    "toy",
    "car",
    "mug",
)


def grounding_dino(folder: Path) -> Path:
    """Text of at most 64 tokens, so that the everyday nouns need several."""
    import torch
    from transformers import (
        BertConfig,
        BertTokenizerFast,
        GroundingDinoConfig,
        GroundingDinoForObjectDetection,
        SwinConfig,
    )

    # the model looks for BERT's own ids of [CLS], [SEP], the dot and the question mark
    vocabulary = [f"[unused{k}]" for k in range(1100)]
    for place, token in {
        0: "[PAD]",
        100: "[UNK]",
        101: "[CLS]",
        102: "[SEP]",
        103: "[MASK]",
        1012: ".",
        1029: "?",
    }.items():
        vocabulary[place] = token
    vocabulary[200 : 200 + len(WORDS)] = WORDS
    letters = "abcdefghijklmnopqrstuvwxyz"
    vocabulary[300:326] = [f"##{letter}" for letter in letters]
    vocabulary[400:425] = letters[1:]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vocab.txt").write_text("\n".join(vocabulary) + "\n")
    BertTokenizerFast(str(folder / "vocab.txt")).save_pretrained(folder)
    torch.manual_seed(0)
    text = BertConfig(
        vocab_size=1100,
        hidden_size=32,
        num_hidden_layers=1,
        num_attention_heads=2,
        intermediate_size=32,
    )
    eye = SwinConfig(
        image_size=64, embed_dim=16, depths=[1, 1, 1, 1], num_heads=[1, 2, 4, 8], window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )  # fmt: skip
    config = GroundingDinoConfig(
        backbone_config=eye, text_config=text, d_model=32, encoder_layers=1, decoder_layers=2, num_queries=12,
        encoder_attention_heads=2, decoder_attention_heads=2, encoder_ffn_dim=32, decoder_ffn_dim=32, max_text_len=64,
    )  # fmt: skip
    GroundingDinoForObjectDetection(config).save_pretrained(folder)
    images = {
        "image_processor_type": "GroundingDinoImageProcessor",
        "size": {"shortest_edge": 64, "longest_edge": 107},
        "do_pad": True,
    }
    (folder / "preprocessor_config.json").write_text(json.dumps(images))
    return folder


def sam(folder: Path) -> Path:
    import torch
    from transformers import SamConfig, SamModel

    torch.manual_seed(0)
    config = SamConfig(
        vision_config={
            "hidden_size": 32, "num_hidden_layers": 1, "num_attention_heads": 2, "image_size": 64, "patch_size": 8,
            "output_channels": 32, "mlp_dim": 32, "window_size": 4, "global_attn_indexes": [0],
            "num_pos_feats": 16,
        },
        prompt_encoder_config={
            "hidden_size": 32, "image_size": 64, "patch_size": 8, "image_embedding_size": 8, "mask_input_channels": 8,
        },
        mask_decoder_config={
            "hidden_size": 32, "mlp_dim": 32, "num_attention_heads": 2, "num_hidden_layers": 1,
            "iou_head_hidden_dim": 32,
        },
    )  # fmt: skip
    SamModel(config).save_pretrained(folder)
    return folder


MODELS = {
    ("segment", "grounding-dino+sam"): lambda folder: (
        f"{grounding_dino(folder / 'dino')},{sam(folder / 'sam')}"
    ),
}
