"""Open-vocabulary segmentation: Grounding DINO boxes, SAM or SAM 2 masks (paper section 3.1)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch.nn.functional import interpolate

from physgen.perceive.backends.categories_everyday import everyday
from physgen.perceive.backends.models import (
    RealNumber,
    device_of,
    dtype_of,
    free_memory,
    load_weights,
    read_options,
)
from physgen.perceive.roles import Category, PromptedMask, Rgb, Segments
from physgen.perceive.segment.masks import SURE, Box, Cut, Mask, distinct_boxes, segments
from physgen.problems import InputError
from physgen.registry import Setup, find

# ----------------------------------------------------------------------
# Boxes or points on a photo -> masks, by SAM (v1) or SAM 2: one look at the photo, then an answer a prompt.
#
# The photo is made ready by hand, as the models' own processors do it: SAM 2's needs torchvision, which we do
# without.

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
        self.model: Any = load_weights(self._load, weights, self.what).eval().to(device)
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
        free_memory()

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


# ----------------------------------------------------------------------
# A photo and nouns -> boxes, each of one noun: Grounding DINO.

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
        self.tokens, self.images, model = load_weights(_load, weights, "Grounding DINO")
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
        free_memory()

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


# ----------------------------------------------------------------------
# Photo and categories -> labels of what moves, and of what stands still: Grounding DINO boxes, SAM cuts
# (section 3.1).
#
# `segment=grounding-dino+sam:DINO,SAM` names both weights, `:DINO` or `:,SAM` one of them, as hub ids or
# paths.


def with_sam(setup: Setup) -> Grounded:
    """The backend `grounding-dino+sam`."""
    return Grounded("grounding-dino+sam", Sam, setup)


def with_sam2(setup: Setup) -> Grounded:
    """The backend `grounding-dino+sam2`."""
    return Grounded("grounding-dino+sam2", Sam2, setup)


class Grounded:
    """A segmenter that finds what it is told to; its models are loaded when they are first needed."""

    def __init__(self, name: str, cutter: Callable[..., Cutter], setup: Setup) -> None:
        """Raises InputError for a device, a type or weights that cannot be."""
        self.weights = weights_of(name, setup)
        self.device = device_of(setup)
        self.dtype = dtype_of(setup, self.device)
        self.sure = surely(name, setup)
        self._cutter = cutter
        self._detector_made: GroundingDino | None = None
        self._cutter_made: Cutter | None = None
        self._told: dict[str, Any] = {}

    def __call__(self, rgb: Rgb, categories: Sequence[Category] = ()) -> Segments:
        """What of `categories` the photo shows; everyday things where none are named."""
        kinds = list(categories) or list(everyday()(rgb))
        found = self._detector()(rgb, [kind.noun for kind in kinds])
        cutter = self._cutting()
        cutter.look(rgb)
        masks = cutter.boxes([one.box for one in found])
        cuts = (  # one at a time: a large photo's masks are large
            Cut.of(mask, kinds[one.noun].noun, kinds[one.noun].movable, one.score, fit)
            for one, (mask, fit) in zip(found, masks, strict=True)
        )
        result = segments(
            cuts, (rgb.shape[0], rgb.shape[1]), lambda boxes: list(cutter.boxes(boxes)), self.sure
        )
        cutter.forget()
        self._told = {"asked": len(kinds), "boxes": len(found)}
        return result

    def meant(
        self,
        rgb: Rgb,
        boxes: Sequence[tuple[float, float, float, float]],
        points: Sequence[tuple[float, float]],
    ) -> list[PromptedMask]:
        """What SAM cuts out for boxes (left, top, width, height px) and for points, in that order."""
        cutter = self._cutting()
        cutter.look(rgb)
        corners = [(x, y, x + width, y + height) for x, y, width, height in boxes]
        said = [PromptedMask(mask, fit) for mask, fit in (*cutter.boxes(corners), *cutter.points(points))]
        cutter.forget()
        return said

    def note(self) -> Mapping[str, Any]:
        """Where and with what it ran, for the record."""
        return {
            "device": self.device,
            "dtype": str(self.dtype).removeprefix("torch."),
            "weights": ",".join(self.weights),
            **self._told,
        }

    def close(self) -> None:
        """Let the models go."""
        for part in (self._detector_made, self._cutter_made):
            if part is not None:
                part.close()
        self._detector_made = self._cutter_made = None
        free_memory()

    def _detector(self) -> GroundingDino:
        if self._detector_made is None:
            self._detector_made = GroundingDino(self.weights[0], self.device)
        return self._detector_made

    def _cutting(self) -> Cutter:
        if self._cutter_made is None:
            self._cutter_made = self._cutter(self.weights[1], self.device, self.dtype)
        return self._cutter_made


def weights_of(name: str, setup: Setup) -> tuple[str, ...]:
    """One id or path for each that the row has: `A,B` names both, `A` and `,B` one. Raises InputError for more."""
    own = [weights.id for weights in find("segment", name).weights]
    said = [part.strip() for part in setup.weights.split(",")]
    if len(said) > len(own):
        fix = f"write at most {len(own)}, with a comma between"
        raise InputError.of("--backend", f'"{setup.weights}"', f"names {len(said)} weights for {name}", fix)
    said += [""] * (len(own) - len(said))
    return tuple(text or default for text, default in zip(said, own, strict=True))


def surely(name: str, setup: Setup, default: float = SURE) -> float:
    """The option `threshold`: confidence, 0..1, from which a mask is an object. Raises InputError."""
    return float(read_options(setup, name, {"threshold": RealNumber(default)})["threshold"])
