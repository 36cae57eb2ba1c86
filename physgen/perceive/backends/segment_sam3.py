"""Photo and categories -> labels of what moves, and of what stands still: SAM 3, asked for one noun after the
other.

Its prompts by box need torchvision, so a mask in pieces is split without asking again, and `--box` and `--point` are
answered as without a model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch.nn.functional import interpolate

from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.models import device_of, dtype_of, free_memory, load_weights
from physgen.perceive.backends.segment_grounded import pixels, plain, surely, weights_of
from physgen.perceive.roles import Category, Rgb, Segments
from physgen.perceive.segment.masks import DOUBTFUL, Box, Cut, Mask, segments
from physgen.registry import Setup

NAME = "sam3"
HALF = (0.5, 0.5, 0.5)
"""Mean and spread of its colours."""
WORDS = 32
"""Tokens of a text; the model's own `max_position_embeddings` where that is less."""
SURE = 0.3
"""Confidence from which a mask is an object: its own processor's."""
MOST = 100
"""Masks, the surest, that are brought to the photo's size."""


def sam3(setup: Setup) -> Sam3:
    """The backend `sam3`."""
    return Sam3(setup)


class Sam3:
    """A segmenter that finds what it is told to; its model is loaded when it is first needed."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for a device or a type that cannot be."""
        (self.weights,) = weights_of(NAME, setup)
        self.device = device_of(setup)
        self.dtype = dtype_of(setup, self.device)
        self.sure = surely(NAME, setup, SURE)
        self._made: tuple[Any, Any] | None = None
        self._told: dict[str, Any] = {}

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """What of `categories` the photo shows; everyday things where none are named."""
        kinds = {plain(kind.noun): kind for kind in reversed(list(categories) or list(everyday()(rgb)))}
        kinds.pop("", None)
        found = sorted(self._instances(rgb, list(kinds)), key=lambda one: -one[1])[:MOST]
        size = rgb.shape[0], rgb.shape[1]
        cuts = (
            Cut.of(_restored(logits, size), kinds[noun].noun, kinds[noun].movable, score, 1.0)
            for noun, score, logits in found
        )
        self._told = {"asked": len(kinds), "masks": len(found)}

        def nothing(boxes: Sequence[Box]) -> list[tuple[Mask, float]]:
            return [(np.zeros(size, np.bool_), 0.0) for _ in boxes]

        return segments(cuts, size, nothing, self.sure)

    def note(self) -> Mapping[str, Any]:
        """Where and with what it ran, for the record."""
        return {
            "device": self.device,
            "dtype": str(self.dtype).removeprefix("torch."),
            "weights": self.weights,
            **self._told,
        }

    def close(self) -> None:
        """Let the model go."""
        self._made = None
        free_memory()

    def _instances(self, rgb: Rgb, nouns: Sequence[str]) -> list[tuple[str, float, torch.Tensor]]:
        """Noun, score and mask, (h, w) logits on the CPU, of all that is worth a comment."""
        tokens, model = self._model()
        side = int(model.config.image_size)
        ready = pixels(rgb, (side, side), HALF, HALF).to(self.device)
        words = min(WORDS, int(model.config.text_config.max_position_embeddings))
        half = self.dtype != torch.float32
        found: list[tuple[str, float, torch.Tensor]] = []
        with torch.inference_mode(), torch.autocast(self.device.partition(":")[0], self.dtype, enabled=half):
            seen = model.get_vision_features(ready)
            for noun in nouns:
                text = tokens(
                    noun, return_tensors="pt", padding="max_length", max_length=words, truncation=True
                ).to(self.device)
                told = model(vision_embeds=seen, input_ids=text.input_ids, attention_mask=text.attention_mask)
                scores = told.pred_logits[0].float().sigmoid() * told.presence_logits[0].float().sigmoid()
                for k in torch.nonzero(scores >= DOUBTFUL)[:, 0].tolist():
                    found.append((noun, float(scores[k]), told.pred_masks[0, k].float().cpu()))
        return found

    def _model(self) -> tuple[Any, Any]:
        if self._made is None:
            tokens, model = load_weights(_load, self.weights, "SAM 3")
            self._made = tokens, model.eval().to(self.device)
        return self._made


def _restored(logits: torch.Tensor, size: tuple[int, int]) -> Mask:
    """A mask at the photo's size (H, W): chances are brought to it, as its own processor does, not logits."""
    whole = interpolate(logits.sigmoid()[None, None], size, mode="bilinear", align_corners=False)[0, 0]
    return np.asarray((whole > 0.5).numpy(), np.bool_)


def _load(weights: str) -> tuple[Any, Any]:
    from transformers import AutoTokenizer, Sam3Model

    return AutoTokenizer.from_pretrained(weights, trust_remote_code=False), Sam3Model.from_pretrained(
        weights, dtype=torch.float32, use_safetensors=True
    )
