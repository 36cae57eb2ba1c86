"""A photo and nouns -> boxes, each of one noun: Grounding DINO."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from PIL import Image

from physgen.perceive.backends.models import freed, loaded
from physgen.perceive.cleaned import Box, distinct_boxes
from physgen.perceive.roles import Rgb

TOKENS = 256
"""That a text may have; the model's own `max_text_len` where that is less."""
LEAST = 0.2
"""Score below which a box is not worth cutting out."""
MOST = 100
"""Boxes, the surest, that are handed on."""


@dataclass(frozen=True)
class Boxed:
    """Where a noun was found."""

    box: Box
    """px of the photo, within it."""
    noun: int
    """Which of those asked for."""
    score: float
    """0..1."""


class GroundingDino:
    """The detector, in float32: it is small, and its boxes are put off by less."""

    def __init__(self, weights: str, device: str) -> None:
        """Raises InputError where the weights are not here."""
        self.tokens, self.images, model = loaded(_load, weights, "Grounding DINO")
        self.model: Any = model.eval().to(device)
        self.device = device
        self.most = min(TOKENS, int(getattr(model.config, "max_text_len", TOKENS)))
        self.dot = self.tokens.convert_tokens_to_ids(".")

    def __call__(self, rgb: Rgb, nouns: Sequence[str]) -> list[Boxed]:
        """Boxes of any of `nouns`, none twice, the surest first."""
        ready = self.images(images=Image.fromarray(rgb), return_tensors="pt").to(self.device)
        found: list[Boxed] = []
        for some in self.texts(nouns):
            found += self._asked(ready, [plain(nouns[k]) for k in some], some, rgb.shape[:2])
        boxes = np.array([one.box for one in found], np.float64).reshape(-1, 4)
        scores = np.array([one.score for one in found], np.float64)
        return [found[k] for k in distinct_boxes(boxes, scores)[:MOST]]

    def texts(self, nouns: Sequence[str]) -> list[list[int]]:
        """Which nouns go into one text each, so that none is cut off; what is empty or said again is left out."""
        result: list[list[int]] = []
        room = 0
        said: set[str] = set()
        for k, noun in enumerate(map(plain, nouns)):
            length = len(self.tokens(noun, add_special_tokens=False).input_ids) + 1
            if not noun or noun in said or length + 2 > self.most:
                continue
            said.add(noun)
            if length > room:
                result.append([])
                room = self.most - 2
            result[-1].append(k)
            room -= length
        return result

    def close(self) -> None:
        """Let the model go."""
        self.model = None
        freed()

    def _asked(
        self, ready: Any, nouns: Sequence[str], of: Sequence[int], size: tuple[int, ...]
    ) -> list[Boxed]:
        """One text's boxes. A query's noun is that of its strongest token."""
        text = self.tokens(
            " ".join(f"{noun}." for noun in nouns), return_tensors="pt", return_token_type_ids=True
        )
        with torch.inference_mode():
            told = self.model(**ready, **text.to(self.device))
        spans = _spans(text.input_ids[0].tolist(), self.dot)
        if len(spans) != len(nouns):
            raise ValueError(
                f"the tokenizer made {len(spans)} phrases of {len(nouns)} nouns: {', '.join(nouns)}"
            )
        chances = told.logits[0].float().sigmoid().cpu().numpy()
        scores = np.stack([chances[:, first:last].max(1) for first, last in spans], 1)
        best = scores.argmax(1)
        x, y, width, height = told.pred_boxes[0].float().cpu().numpy().T
        corners = np.stack([x - width / 2, y - height / 2, x + width / 2, y + height / 2], 1)
        corners = np.clip(corners, 0, 1) * [size[1], size[0], size[1], size[0]]
        found: list[Boxed] = []
        for k in np.flatnonzero(scores.max(1) >= LEAST).tolist():
            x0, y0, x1, y1 = corners[k].tolist()
            if x1 - x0 >= 1 and y1 - y0 >= 1:
                found.append(Boxed((x0, y0, x1, y1), of[best[k]], float(scores[k, best[k]])))
        return found


def plain(noun: str) -> str:
    """A noun as the model reads it: lower case, without the marks that end a phrase.

    >>> plain(" Mr. Potato-head?")
    'mr potato-head'
    """
    return " ".join(re.sub(r"[^\w\s'-]", " ", noun.lower()).split())


def _spans(ids: Sequence[int], dot: int) -> list[tuple[int, int]]:
    """From where to where the phrases lie between the dots, after the token that begins the text."""
    dots = [k for k, token in enumerate(ids) if token == dot]
    starts = [1, *(k + 1 for k in dots)]
    return [(first, last) for first, last in zip(starts, dots, strict=False) if last > first]


def _load(weights: str) -> tuple[Any, Any, Any]:
    from transformers import AutoTokenizer, GroundingDinoForObjectDetection
    from transformers.models.grounding_dino.image_processing_pil_grounding_dino import (
        GroundingDinoImageProcessorPil,
    )

    tokens = AutoTokenizer.from_pretrained(weights, trust_remote_code=False)
    images = GroundingDinoImageProcessorPil.from_pretrained(weights)
    return (
        tokens,
        images,
        GroundingDinoForObjectDetection.from_pretrained(weights, dtype=torch.float32, use_safetensors=True),
    )
