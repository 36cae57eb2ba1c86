"""Tiny video diffusion models of the real classes, saved as their libraries save them: rows' weights, and variants.

Their weights are random numbers: they prove loading, layouts, schedules and arithmetic, and nothing of what they draw.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from tests.contract.tiny_maps import _parts, _tokenizer


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


MODELS: Mapping[tuple[str, str], Callable[[Path], str]] = {
    ("refine", "animatediff"): animatediff,
}
"""What builds the model of a row in an empty folder and gives what a choice names."""
VARIANTS: Mapping[str, tuple[str, Callable[[Path], str]]] = {
    "animatediff": ("animatediff", animatediff)
}
"""Kinds of weights that the backend takes: its name, and what builds them."""
