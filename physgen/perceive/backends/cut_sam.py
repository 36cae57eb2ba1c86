"""Boxes or points on a photo -> masks, by SAM (v1) or SAM 2: one look at the photo, then an answer a prompt.

The photo is made ready by hand, as the models' own processors do it: SAM 2's needs torchvision, which we do without.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.nn.functional import interpolate

from physgen.perceive.backends.models import freed, loaded
from physgen.perceive.cleaned import Box, Mask
from physgen.perceive.roles import Rgb

MEAN, SPREAD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's."""
BATCH = 16
"""Prompts that are answered together: the decoder holds the photo's features once for each."""


def pixels(
    rgb: Rgb, size: tuple[int, int], mean: Sequence[float] = MEAN, spread: Sequence[float] = SPREAD
) -> torch.Tensor:
    """(1, 3, h, w) float32: the photo stretched to `size` (h, w), its colours about 0."""
    small = np.asarray(Image.fromarray(rgb).resize(size[::-1], Image.Resampling.BILINEAR), np.float32) / 255
    ready = (small - np.asarray(mean, np.float32)) / np.asarray(spread, np.float32)
    return torch.from_numpy(ready.transpose(2, 0, 1)[None].copy())


class Cutter:
    """What SAM and SAM 2 share. The photo is looked at in `dtype`, prompts are answered in float32.

    Half the digits would put a prompt off by pixels.
    """

    what = "SAM"

    def __init__(self, weights: str, device: str, dtype: torch.dtype) -> None:
        """Raises InputError where the weights are not here."""
        self.model: Any = loaded(self._load, weights, self.what).eval().to(device)
        self.device, self.dtype = device, dtype
        self.side = int(self.model.config.prompt_encoder_config.image_size)
        self._seen: Any = None
        self._photo = self._inner = (0, 0)

    def _load(self, weights: str) -> Any:
        from transformers import SamModel

        return SamModel.from_pretrained(weights, dtype=torch.float32, use_safetensors=True)

    def look(self, rgb: Rgb) -> None:
        """Take in a photo; prompts are about it from here on."""
        self._photo = height, width = rgb.shape[0], rgb.shape[1]
        self._inner = self._fitted(height, width)
        ready = pixels(rgb, self._inner)
        ready = torch.nn.functional.pad(ready, (0, self.side - self._inner[1], 0, self.side - self._inner[0]))
        half = self.dtype != torch.float32
        with torch.inference_mode(), torch.autocast(self.device.partition(":")[0], self.dtype, enabled=half):
            seen = self.model.get_image_embeddings(ready.to(self.device))
        self._seen = [part.float() for part in seen] if isinstance(seen, list | tuple) else seen.float()

    def boxes(self, boxes: Sequence[Box]) -> Iterator[tuple[Mask, float]]:
        """For each box, its mask and how well it fits, 0..1."""
        corners = np.asarray(boxes, np.float32).reshape(-1, 4) * np.tile(self._scale(), 2)
        for k in range(0, len(corners), BATCH):
            yield from self._answers(input_boxes=self._tensor(corners[k : k + BATCH]))

    def points(self, points: Sequence[tuple[float, float]]) -> Iterator[tuple[Mask, float]]:
        """For each point, what it most likely means."""
        there = np.asarray(points, np.float32).reshape(-1, 2) * self._scale()
        for k in range(0, len(there), BATCH):
            some = self._tensor(there[k : k + BATCH])[:, :, None]
            ones = torch.ones(some.shape[:3], dtype=torch.int, device=self.device)
            yield from self._answers(input_points=some, input_labels=ones)

    def forget(self) -> None:
        """Let the photo go."""
        self._seen = None

    def close(self) -> None:
        """Let the model go."""
        self.model = self._seen = None
        freed()

    def _answers(self, **prompts: torch.Tensor) -> list[tuple[Mask, float]]:
        """Of three masks a prompt, whole, part and part of a part, the one that the model finds best."""
        with torch.inference_mode():
            told = self.model(image_embeddings=self._seen, multimask_output=True, **prompts)
        fits = told.iou_scores[0].float()
        best = fits.argmax(-1)
        return [
            (self._restored(told.pred_masks[0, k, int(i)].float()), float(fits[k, i].clamp(0, 1)))
            for k, i in enumerate(best)
        ]

    def _restored(self, logits: torch.Tensor) -> Mask:
        """A mask (h, w) of the model at the photo's size: one at a time, since a large photo's are large."""
        square = interpolate(logits[None, None], (self.side, self.side), mode="bilinear", align_corners=False)
        inner = square[..., : self._inner[0], : self._inner[1]]
        whole = interpolate(inner, self._photo, mode="bilinear", align_corners=False)[0, 0]
        return np.asarray((whole > 0).cpu().numpy(), np.bool_)

    def _fitted(self, height: int, width: int) -> tuple[int, int]:
        """The size that the photo gets: SAM keeps its shape, and leaves what is right of and below it black."""
        scale = self.side / max(height, width)
        return max(1, int(height * scale + 0.5)), max(1, int(width * scale + 0.5))

    def _scale(self) -> NDArray[np.float32]:
        return np.divide(self._inner[::-1], self._photo[::-1], dtype=np.float32)

    def _tensor(self, values: NDArray[np.float32]) -> torch.Tensor:
        return torch.from_numpy(values[None].copy()).to(self.device)


class Sam(Cutter):
    """SAM, v1."""


class Sam2(Cutter):
    """SAM 2 and 2.1."""

    what = "SAM 2"

    def _load(self, weights: str) -> Any:
        from transformers import Sam2Model

        return Sam2Model.from_pretrained(weights, dtype=torch.float32, use_safetensors=True)

    def _fitted(self, height: int, width: int) -> tuple[int, int]:
        return self.side, self.side

    def _restored(self, logits: torch.Tensor) -> Mask:
        whole = interpolate(logits[None, None], self._photo, mode="bilinear", align_corners=False)[0, 0]
        return np.asarray((whole > 0).cpu().numpy(), np.bool_)
