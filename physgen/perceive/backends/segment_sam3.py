"""Backend segment=sam3: SAM 3 (Carion et al. 2025), prompted with one noun at a time.
Boxes and points of a user are drawn without a model, because `transformers` implements
them as a second network, SAM 3's tracker.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch.nn.functional import interpolate
from transformers import AutoTokenizer, Sam3Model

from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.backends.segment_grounded import (
    pixels,
    plain_noun,
    read_threshold,
)
from physgen.perceive.roles import Category, Mask, Rgb, Segments
from physgen.perceive.segment.masks import DOUBTFUL, Cut, segments
from physgen.registry import Setup

NAME = "sam3"
HALF = (0.5, 0.5, 0.5)
"""Mean and standard deviation of the colours in the network's input."""
TEXT_TOKENS = 32
"""Largest number of tokens of a noun; the model's own limit may be lower."""
CONFIDENT = 0.3
"""Confidence from which a mask counts as an object: the default of SAM 3's processor.
"""
MOST_MASKS = 100
"""Largest number of masks per photo; the most confident ones are kept."""


@dataclass(frozen=True)
class Instance:
    """A mask that the network predicts for one noun."""

    noun: str
    # 0..1.
    score: float
    # (h, w) of the mask, on the CPU.
    logits: torch.Tensor


class Sam3(ModelBackend):
    """A segmenter for given nouns."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device, number type, option or weights."""
        (weights,) = weight_ids("segment", NAME, setup)
        self._threshold = read_threshold(setup, NAME, CONFIDENT)
        super().__init__(setup, weights, "SAM 3", {})

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """Return the objects and static surfaces of `categories`, by default everyday
        nouns.
        """
        kinds: dict[str, Category] = {}
        for kind in categories or everyday()(rgb):
            kinds.setdefault(plain_noun(kind.noun), kind)
        kinds.pop("", None)
        instances = self._instances(rgb, list(kinds))
        instances.sort(key=lambda one: -one.score)
        del instances[MOST_MASKS:]
        self._options = {"asked": len(kinds), "masks": len(instances)}
        size = rgb.shape[0], rgb.shape[1]
        # A generator: masks of a large photo take much memory.
        cuts = (
            Cut.from_mask(
                _resize_mask(instance.logits, size),
                kinds[instance.noun].noun,
                kinds[instance.noun].movable,
                instance.score,
                1.0,
            )
            for instance in instances
        )
        return segments(cuts, size, self._threshold)

    def _load(self, weights: str) -> Any:
        tokens = AutoTokenizer.from_pretrained(weights, trust_remote_code=False)
        model = Sam3Model.from_pretrained(
            weights, dtype=torch.float32, use_safetensors=True
        )
        return tokens, model.eval().to(self._device)

    def _instances(self, rgb: Rgb, nouns: Sequence[str]) -> list[Instance]:
        """Return all masks of at least doubtful objects; the photo is encoded once."""
        _, model = self._model
        side = int(model.config.image_size)
        pixel_values = pixels(rgb, (side, side), HALF, HALF).to(self._device)
        is_16_bit = self._dtype != torch.float32
        kind = self._device.partition(":")[0]
        instances: list[Instance] = []
        with (
            torch.inference_mode(),
            torch.autocast(kind, self._dtype, enabled=is_16_bit),
        ):
            features = model.get_vision_features(pixel_values)
            for noun in nouns:
                instances += self._instances_of(noun, features)
        return instances

    def _instances_of(self, noun: str, features: Any) -> Iterator[Instance]:
        """Yield the masks of one noun in an encoded photo."""
        tokens, model = self._model
        limit = int(model.config.text_config.max_position_embeddings)
        text = tokens(
            noun,
            return_tensors="pt",
            padding="max_length",
            max_length=min(TEXT_TOKENS, limit),
            truncation=True,
        ).to(self._device)
        output = model(
            vision_embeds=features,
            input_ids=text.input_ids,
            attention_mask=text.attention_mask,
        )
        presence = output.presence_logits[0].float().sigmoid()
        scores = output.pred_logits[0].float().sigmoid() * presence
        for k in torch.nonzero(scores >= DOUBTFUL)[:, 0].tolist():
            logits = output.pred_masks[0, k].float().cpu()
            yield Instance(noun, float(scores[k]), logits)


sam3 = Sam3
"""The factory named in the registry."""


def _resize_mask(logits: torch.Tensor, size: tuple[int, int]) -> Mask:
    """Return a mask at the photo's size (H, W).

    As in SAM 3's own processor, probabilities are interpolated rather than logits.
    """
    probabilities = interpolate(
        logits.sigmoid()[None, None], size, mode="bilinear", align_corners=False
    )
    return np.asarray((probabilities[0, 0] > 0.5).numpy(), np.bool_)
