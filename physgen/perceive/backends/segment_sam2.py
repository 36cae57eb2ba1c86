"""Backend segment=sam2: masks of SAM 2.1 (Ravi et al. 2025) for detections and prompts.

Without a prompt the default segmenter detects the objects, and SAM 2 redraws each in
its bounding box. SAM 2's own image processor requires torchvision; this module prepares
pictures in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import torch
from torch.nn.functional import interpolate
from transformers import Sam2Model

from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.backends.segment_grounded import Sam, read_threshold
from physgen.perceive.backends.segment_learned import (
    better_mask,
    learned,
    left_to_right,
)
from physgen.perceive.roles import Mask, PromptedMask, Rgb, Segments
from physgen.perceive.segment.masks import Box, smooth_outline
from physgen.registry import Setup

NAME = "sam2"
LEAST_FIT = 0.5
"""Least expected IoU at which SAM's mask replaces the default segmenter's mask.

Below it SAM 2 expects its mask to be more wrong than right.
"""


class Sam2(ModelBackend):
    """A segmenter for boxes, points and the detections of the default segmenter."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device, number type, option or weights."""
        (weights,) = weight_ids("segment", NAME, setup)
        self._threshold = read_threshold(setup, NAME, LEAST_FIT)
        super().__init__(setup, weights, "SAM 2", {})

    def __call__(self, rgb: Rgb) -> Segments:
        """Return the objects of the default segmenter, with masks by SAM 2."""
        detections = learned()(rgb)
        masks = []
        for k in range(1, len(detections.confidence) + 1):
            masks.append(detections.labels == k)
        model = self._model
        model.encode(rgb)
        sam_masks = list(model.boxes(list(map(_box, masks))))
        model.forget()
        labels = np.zeros_like(detections.labels)
        # The most confident object is drawn last, so that it gets the pixels of
        # overlapping masks.
        for k in np.argsort(detections.confidence, kind="stable").tolist():
            mask, fit = sam_masks[k]
            is_reliable = fit >= self._threshold
            if is_reliable:
                final_mask = better_mask(masks[k], smooth_outline(mask))
            else:
                final_mask = masks[k]
            labels[final_mask] = k + 1
        self._options = {"boxes": len(masks)}
        return left_to_right(replace(detections, labels=labels))

    def segment_meant_objects(
        self,
        rgb: Rgb,
        boxes: Sequence[Box],
        points: Sequence[tuple[float, float]],
    ) -> list[PromptedMask]:
        """Return masks of boxes (left, top, width, height px), then of points."""
        model = self._model
        model.encode(rgb)
        corners = [(x, y, x + width, y + height) for x, y, width, height in boxes]
        masks = []
        for mask, fit in (*model.boxes(corners), *model.points(points)):
            masks.append(PromptedMask(mask, fit))
        model.forget()
        return masks

    def _load(self, weights: str) -> Any:
        return StretchedSam(weights, self._device, self._dtype)


sam2 = Sam2
"""The factory named in the registry."""


class StretchedSam(Sam):
    """SAM 2 and 2.1: the photo is stretched to a square, and there are three feature
    maps.
    """

    what = "SAM 2"

    def _load(self, weights: str) -> Any:
        return Sam2Model.from_pretrained(
            weights, dtype=torch.float32, use_safetensors=True
        )

    def _input_size(self, height: int, width: int) -> tuple[int, int]:
        return self.side, self.side

    def _encode(self, ready: torch.Tensor) -> Any:
        return [part.float() for part in self.model.get_image_embeddings(ready)]

    def _restore_size(self, logits: torch.Tensor) -> Mask:
        photo_logits = interpolate(
            logits[None, None], self._photo, mode="bilinear", align_corners=False
        )
        return np.asarray((photo_logits[0, 0] > 0).cpu().numpy(), np.bool_)


def _box(mask: Mask) -> Box:
    """Return the left, top, right and bottom of a mask (H, W), px."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    return x, y, x + width, y + height
