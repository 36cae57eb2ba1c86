"""Backend segment=sam3: SAM 3, prompted with one noun after the other.

Its prompts by box need torchvision, so `--box` and `--point` are answered as without a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch.nn.functional import interpolate

from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.backends.segment_grounded import pixels, plain_noun, threshold_of
from physgen.perceive.roles import Category, Rgb, Segments
from physgen.perceive.segment.masks import DOUBTFUL, Cut, segments
from physgen.perceive.segment.proposals import Mask
from physgen.registry import Setup

NAME = "sam3"
HALF = (0.5, 0.5, 0.5)
"""Mean and spread of its colours."""
TEXT_TOKENS = 32
"""Of a noun, at most; the model's own `max_position_embeddings` where that is less."""
CONFIDENT = 0.3
"""Confidence from which a mask is an object: its own processor's value."""
MOST_MASKS = 100


class Sam3(ModelBackend):
    """A segmenter for given nouns."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device or number type."""
        (weights,) = weight_ids("segment", NAME, setup)
        self._threshold = threshold_of(NAME, setup, CONFIDENT)
        super().__init__(setup, weights, "SAM 3", {})

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """The objects and static surfaces of `categories`; everyday nouns where none are given."""
        kinds = {plain_noun(kind.noun): kind for kind in reversed(list(categories) or list(everyday()(rgb)))}
        kinds.pop("", None)
        found = sorted(self._instances(rgb, list(kinds)), key=lambda one: -one[1])[:MOST_MASKS]
        size = rgb.shape[0], rgb.shape[1]
        cuts = (
            Cut.of(_restored(logits, size), kinds[noun].noun, kinds[noun].movable, score, 1.0)
            for noun, score, logits in found
        )
        self._options = {"asked": len(kinds), "masks": len(found)}
        return segments(cuts, size, self._threshold)

    def _load(self, weights: str) -> Any:
        from transformers import AutoTokenizer, Sam3Model

        tokens = AutoTokenizer.from_pretrained(weights, trust_remote_code=False)
        model = Sam3Model.from_pretrained(weights, dtype=torch.float32, use_safetensors=True)
        return tokens, model.eval().to(self._device)

    def _instances(self, rgb: Rgb, nouns: Sequence[str]) -> list[tuple[str, float, torch.Tensor]]:
        """Noun, score and mask, (h, w) logits on the CPU, of all masks that are at least doubtful."""
        tokens, model = self._model
        side = int(model.config.image_size)
        ready = pixels(rgb, (side, side), HALF, HALF).to(self._device)
        length = min(TEXT_TOKENS, int(model.config.text_config.max_position_embeddings))
        half, kind = self._dtype != torch.float32, self._device.partition(":")[0]
        found: list[tuple[str, float, torch.Tensor]] = []
        with torch.inference_mode(), torch.autocast(kind, self._dtype, enabled=half):
            features = model.get_vision_features(ready)
            for noun in nouns:
                text = tokens(
                    noun, return_tensors="pt", padding="max_length", max_length=length, truncation=True
                ).to(self._device)
                output = model(
                    vision_embeds=features, input_ids=text.input_ids, attention_mask=text.attention_mask
                )
                scores = output.pred_logits[0].float().sigmoid() * output.presence_logits[0].float().sigmoid()
                for k in torch.nonzero(scores >= DOUBTFUL)[:, 0].tolist():
                    found.append((noun, float(scores[k]), output.pred_masks[0, k].float().cpu()))
        return found


sam3 = Sam3
"""The factory named in the registry."""


def _restored(logits: torch.Tensor, size: tuple[int, int]) -> Mask:
    """A mask at the photo's size (H, W): probabilities are interpolated, as its own processor does, not logits."""
    whole = interpolate(logits.sigmoid()[None, None], size, mode="bilinear", align_corners=False)[0, 0]
    return np.asarray((whole > 0.5).numpy(), np.bool_)
