"""Open-vocabulary segmentation: Grounding DINO boxes, SAM masks (paper section 3.1).
`segment=grounding-dino+sam:DINO,SAM` names both weights, `:DINO` or `:,SAM` only one of
them, as hub ids or paths. This module prepares pictures for SAM in the same way as
SAM's own processor.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.nn.functional import interpolate, pad
from transformers import AutoTokenizer, GroundingDinoForObjectDetection, SamModel
from transformers.models.grounding_dino.image_processing_pil_grounding_dino import (
    GroundingDinoImageProcessorPil,
)

from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.models import (
    device_of,
    dtype_of,
    free_memory,
    load_weights,
    run_note,
    weight_ids,
)
from physgen.perceive.roles import Category, PromptedMask, Rgb, Segments
from physgen.perceive.segment.masks import CONFIDENT, Box, Cut, distinct_boxes, segments
from physgen.perceive.segment.proposals import Mask
from physgen.registry import Setup, read_options

MEAN, SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's."""


@dataclass(frozen=True)
class GroundedConstants:
    """Constants of boxes and prompts."""

    # Prompts decoded together: the decoder copies the photo's features for each.
    batch: int = 16
    # Longest text of Grounding DINO; the model's own `max_text_len` may be lower.
    tokens: int = 256
    # Least score of a box for SAM.
    least_score: float = 0.2
    # Largest number of boxes for SAM per photo.
    boxes: int = 100


GROUNDED = GroundedConstants()


NAME = "grounding-dino+sam"


class NounSegmenter:
    """A segmenter for given nouns; it loads its models at their first use."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device, number type or weights."""
        self._weights = weight_ids("segment", NAME, setup)
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        self._threshold = read_threshold(setup, NAME, CONFIDENT)
        self._counts: dict[str, Any] = {}

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """Return the objects and static surfaces of `categories`, by default everyday
        nouns.
        """
        kinds = list(categories) or list(everyday()(rgb))
        detections = self._dino(rgb, [kind.noun for kind in kinds])
        sam = self._sam
        sam.encode(rgb)
        masks = sam.boxes([detection.box for detection in detections])
        # A generator: masks of a large photo take much memory.
        cuts = (
            Cut.from_mask(
                mask,
                kinds[detection.noun].noun,
                kinds[detection.noun].movable,
                detection.score,
                fit,
            )
            for detection, (mask, fit) in zip(detections, masks, strict=True)
        )
        size = rgb.shape[0], rgb.shape[1]
        result = segments(cuts, size, self._threshold)
        sam.forget()
        self._counts = {"asked": len(kinds), "boxes": len(detections)}
        return result

    def segment_meant_objects(
        self,
        rgb: Rgb,
        boxes: Sequence[tuple[float, float, float, float]],
        points: Sequence[tuple[float, float]],
    ) -> list[PromptedMask]:
        """Return SAM's masks for boxes (left, top, width, height px), then for
        points.
        """
        sam = self._sam
        sam.encode(rgb)
        corners = [(x, y, x + width, y + height) for x, y, width, height in boxes]
        masks = []
        for mask, fit in (*sam.boxes(corners), *sam.points(points)):
            masks.append(PromptedMask(mask, fit))
        sam.forget()
        return masks

    def note(self) -> Mapping[str, Any]:
        """Return the device, number type, weights and counts for the record."""
        return run_note(
            self._device, self._dtype, ",".join(self._weights), self._counts
        )

    def load(self) -> None:
        """Load the models now."""
        _ = self._dino, self._sam

    def close(self) -> None:
        """Free the models."""
        for name in ("_dino", "_sam"):
            self.__dict__.pop(name, None)
        free_memory()

    @cached_property
    def _dino(self) -> GroundingDino:
        return GroundingDino(self._weights[0], self._device)

    @cached_property
    def _sam(self) -> Sam:
        return Sam(self._weights[1], self._device, self._dtype)


grounded = NounSegmenter
"""The factory named in the registry."""


def read_threshold(setup: Setup, name: str, default: float) -> float:
    """Return the option `threshold`: the least confidence 0..1 of an object's mask.

    Raises InputError for other options and values.
    """
    option = default, {"type": "number", "minimum": 0, "maximum": 1}
    return float(read_options(setup, name, {"threshold": option})["threshold"])


def pixels(
    rgb: Rgb,
    size: tuple[int, int],
    mean: Sequence[float] = MEAN,
    spread: Sequence[float] = SPREAD,
) -> torch.Tensor:
    """Return the photo stretched to `size` (h, w), normalised, (1, 3, h, w) float32."""
    small = (
        np.asarray(
            Image.fromarray(rgb).resize(size[::-1], Image.Resampling.BILINEAR),
            np.float32,
        )
        / 255
    )
    ready = (small - np.asarray(mean, np.float32)) / np.asarray(spread, np.float32)
    return torch.from_numpy(ready.transpose(2, 0, 1)[None].copy())


class Sam:
    """One encoding of the photo in `dtype`, then float32 masks for each prompt.

    Prompts with 16 bits would be wrong by pixels. The photo keeps its proportions, and
    the rest of the input is black.
    """

    what = "SAM"
    """The model's name in messages."""

    def __init__(self, weights: str, device: str, dtype: torch.dtype) -> None:
        """Raises InputError if the weights are missing."""
        self.model: Any = load_weights(self._load, weights, self.what)
        self.model.eval().to(device)
        self._device, self._dtype = device, dtype
        self.side = int(self.model.config.prompt_encoder_config.image_size)
        self._features: Any = None
        self._photo = self._inner = (0, 0)

    def _load(self, weights: str) -> Any:
        return SamModel.from_pretrained(
            weights, dtype=torch.float32, use_safetensors=True
        )

    def encode(self, rgb: Rgb) -> None:
        """Encode a photo for the following prompts."""
        self._photo = height, width = rgb.shape[0], rgb.shape[1]
        self._inner = self._input_size(height, width)
        ready = pad(
            pixels(rgb, self._inner),
            (0, self.side - self._inner[1], 0, self.side - self._inner[0]),
        )
        is_16_bit = self._dtype != torch.float32
        kind = self._device.partition(":")[0]
        with (
            torch.inference_mode(),
            torch.autocast(kind, self._dtype, enabled=is_16_bit),
        ):
            self._features = self._encode(ready.to(self._device))

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        """Return the photo's size (h, w) in the model's input."""
        scale = self.side / max(height, width)
        return max(1, int(height * scale + 0.5)), max(1, int(width * scale + 0.5))

    def _encode(self, ready: torch.Tensor) -> Any:
        return self.model.get_image_embeddings(ready).float()

    def boxes(self, boxes: Sequence[Box]) -> Iterator[tuple[Mask, float]]:
        """Yield the mask of each box and its expected IoU, 0..1."""
        corners = np.asarray(boxes, np.float32).reshape(-1, 4) * np.tile(
            self._scale(), 2
        )
        for k in range(0, len(corners), GROUNDED.batch):
            yield from self._decode_masks(
                input_boxes=self._tensor(corners[k : k + GROUNDED.batch])
            )

    def points(
        self, points: Sequence[tuple[float, float]]
    ) -> Iterator[tuple[Mask, float]]:
        """Yield the most likely mask of each point and its expected IoU."""
        input_points = np.asarray(points, np.float32).reshape(-1, 2) * self._scale()
        for k in range(0, len(input_points), GROUNDED.batch):
            batch = self._tensor(input_points[k : k + GROUNDED.batch])[:, :, None]
            point_labels = torch.ones(
                batch.shape[:3], dtype=torch.int, device=self._device
            )
            yield from self._decode_masks(input_points=batch, input_labels=point_labels)

    def forget(self) -> None:
        """Free the photo's features."""
        self._features = None

    def _decode_masks(self, **prompts: torch.Tensor) -> list[tuple[Mask, float]]:
        """Return, per prompt, the mask with the best expected IoU.

        The model proposes three: whole, part, and part of a part.
        """
        with torch.inference_mode():
            output = self.model(
                image_embeddings=self._features, multimask_output=True, **prompts
            )
        fits = output.iou_scores[0].float()
        best = fits.argmax(-1)
        result: list[tuple[Mask, float]] = []
        for k, i in enumerate(best):
            result.append(
                (
                    self._restore_size(output.pred_masks[0, k, int(i)].float()),
                    float(fits[k, i].clamp(0, 1)),
                )
            )
        return result

    def _restore_size(self, logits: torch.Tensor) -> Mask:
        """Return a mask (h, w) of the model at the photo's size."""
        square = interpolate(
            logits[None, None],
            (self.side, self.side),
            mode="bilinear",
            align_corners=False,
        )
        inner = square[..., : self._inner[0], : self._inner[1]]
        photo_logits = interpolate(
            inner, self._photo, mode="bilinear", align_corners=False
        )[0, 0]
        return np.asarray((photo_logits > 0).cpu().numpy(), np.bool_)

    def _scale(self) -> NDArray[np.float32]:
        return np.divide(self._inner[::-1], self._photo[::-1], dtype=np.float32)

    def _tensor(self, values: NDArray[np.float32]) -> torch.Tensor:
        return torch.from_numpy(values[None].copy()).to(self._device)


@dataclass(frozen=True)
class NounBox:
    """A box with its noun."""

    # px, within the photo.
    box: Box
    # Index of the noun.
    noun: int
    # 0..1.
    score: float


class GroundingDino:
    """Boxes for nouns, in float32: the model is small."""

    def __init__(self, weights: str, device: str) -> None:
        """Raises InputError if the weights are missing."""
        self.tokens, self._images, model = load_weights(
            _load_dino, weights, "Grounding DINO"
        )
        self.model: Any = model.eval().to(device)
        self._device = device
        self._most = min(
            GROUNDED.tokens, int(getattr(model.config, "max_text_len", GROUNDED.tokens))
        )
        self.dot = self.tokens.convert_tokens_to_ids(".")

    def __call__(self, rgb: Rgb, nouns: Sequence[str]) -> list[NounBox]:
        """Return boxes of any of `nouns` without duplicates, the best score first."""
        ready = self._images(images=Image.fromarray(rgb), return_tensors="pt").to(
            self._device
        )
        detections: list[NounBox] = []
        for indices in self.texts(nouns):
            detections += self._boxes(
                ready, [plain_noun(nouns[k]) for k in indices], indices, rgb.shape[:2]
            )
        boxes = np.array(
            [detection.box for detection in detections], np.float64
        ).reshape(-1, 4)
        scores = np.array([detection.score for detection in detections], np.float64)
        return [detections[k] for k in distinct_boxes(boxes, scores)[: GROUNDED.boxes]]

    def texts(self, nouns: Sequence[str]) -> list[list[int]]:
        """Return the indices of the nouns of each text, as many per text as fit.

        Empty and repeated nouns are left out.
        """
        result: list[list[int]] = []
        room = 0
        earlier_nouns: set[str] = set()
        for k, noun in enumerate(map(plain_noun, nouns)):
            length = len(self.tokens(noun, add_special_tokens=False).input_ids) + 1
            if not noun or noun in earlier_nouns or length + 2 > self._most:
                continue
            earlier_nouns.add(noun)
            if length > room:
                result.append([])
                room = self._most - 2
            result[-1].append(k)
            room -= length
        return result

    def _boxes(
        self,
        ready: Any,
        nouns: Sequence[str],
        indices: Sequence[int],
        size: tuple[int, ...],
    ) -> list[NounBox]:
        """Return the boxes of one text.

        The noun of a query is the noun of its strongest token.
        """
        text = self.tokens(
            " ".join(f"{noun}." for noun in nouns),
            return_tensors="pt",
            return_token_type_ids=True,
        )
        with torch.inference_mode():
            output = self.model(**ready, **text.to(self._device))
        spans = self._find_phrases(text.input_ids[0].tolist(), nouns)
        chances = output.logits[0].float().sigmoid().cpu().numpy()
        scores = np.stack([chances[:, first:last].max(1) for first, last in spans], 1)
        corners = _find_corners(output.pred_boxes[0].float().cpu().numpy(), size)
        return _choose_noun_boxes(scores, corners, indices)

    def _find_phrases(
        self, tokens: Sequence[int], nouns: Sequence[str]
    ) -> list[tuple[int, int]]:
        """Return the first token of each noun, and the one after its last.

        Phrases lie between the dots, after the first token of the text.
        """
        dots = []
        for k, token in enumerate(tokens):
            if token == self.dot:
                dots.append(k)
        starts = [1, *(k + 1 for k in dots)]
        spans = []
        for a, b in zip(starts, dots, strict=False):
            if b > a:
                spans.append((a, b))
        if len(spans) != len(nouns):
            names = ", ".join(nouns)
            raise ValueError(
                f"the tokenizer made {len(spans)} phrases of {len(nouns)} nouns: {names}"
            )
        return spans


def _choose_noun_boxes(
    scores: NDArray[Any], corners: NDArray[Any], indices: Sequence[int]
) -> list[NounBox]:
    """Return the boxes of at least one pixel with a confident noun.

    `scores` is (queries, nouns), `corners` (queries, 4); `indices` are those of the
    nouns.
    """
    best_nouns = scores.argmax(1)
    boxes: list[NounBox] = []
    for k in np.flatnonzero(scores.max(1) >= GROUNDED.least_score).tolist():
        x0, y0, x1, y1 = corners[k].tolist()
        if x1 - x0 >= 1 and y1 - y0 >= 1:
            noun = best_nouns[k]
            boxes.append(
                NounBox((x0, y0, x1, y1), indices[noun], float(scores[k, noun]))
            )
    return boxes


def _find_corners(
    boxes: NDArray[np.float32], size: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return left, top, right and bottom (n, 4) of boxes in the photo, px.

    `boxes` (n, 4) are centre x, centre y, width and height, shares of the photo's
    size.
    """
    x, y, width, height = boxes.T
    corners = np.stack(
        [x - width / 2, y - height / 2, x + width / 2, y + height / 2], 1
    )
    return np.asarray(np.clip(corners, 0, 1) * [size[1], size[0], size[1], size[0]])


def plain_noun(noun: str) -> str:
    """Return a noun in lower case, without punctuation.

    >>> plain_noun(" Mr. Potato-head?")
    'mr potato-head'
    """
    return " ".join(re.sub(r"[^\w\s'-]", " ", noun.lower()).split())


def _load_dino(weights: str) -> tuple[Any, Any, Any]:
    """Return the tokenizer, the image processor and the model of Grounding DINO."""
    tokens = AutoTokenizer.from_pretrained(weights, trust_remote_code=False)
    images = GroundingDinoImageProcessorPil.from_pretrained(weights)
    load = GroundingDinoForObjectDetection.from_pretrained
    return tokens, images, load(weights, dtype=torch.float32, use_safetensors=True)
