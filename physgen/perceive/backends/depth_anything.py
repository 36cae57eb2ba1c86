"""A photo -> its depth by Depth Anything V2: relative, or in m with weights of the metric kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from transformers import DepthAnythingForDepthEstimation, DPTImageProcessorPil

from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.roles import Rgb
from physgen.problems import InputError
from physgen.registry import Options, Setup, read_options


@dataclass(frozen=True)
class DepthConstants:
    """Constants of the depth."""

    farthest: float = 50.0
    """Distance of points without parallax (the sky), relative to the nearest point."""
    patch: int = 14
    """px: the sides of the network's input are multiples of it."""
    longest: float = 3.0
    """The longer side of the input at most, as a multiple of `resolution`: the cost of attention is quadratic."""


DEPTH = DepthConstants()
OPTIONS: Options = {"resolution": (518, {"type": "integer", "minimum": DEPTH.patch})}


class Depth(ModelBackend):
    """The backend `depth-anything`; `resolution` is the shorter side of the network's input, px."""

    def __init__(self, setup: Setup) -> None:
        options = read_options(setup, "depth-anything", OPTIONS)
        (weights,) = weight_ids("depth", "depth-anything", setup)
        super().__init__(setup, weights, "Depth Anything", options | {"unit": ""})

    def _number_type(self, setup: Setup) -> torch.dtype:
        # the model is small, and 16 bits would give depth in steps
        return torch.float32 if setup.dtype == "auto" else super()._number_type(setup)

    def _load(self, weights: str) -> Any:
        self._processor = DPTImageProcessorPil.from_pretrained(weights)
        load = DepthAnythingForDepthEstimation.from_pretrained
        model = load(weights, dtype=self._dtype, use_safetensors=True).to(self._device).eval()
        self._options["unit"] = "m" if model.config.depth_estimation_type == "metric" else "relative"
        return model

    def __call__(self, rgb: Rgb) -> NDArray[np.float32]:
        """(H, W) float32, larger = farther: m with metric weights, else 1 = nearest, see `receding`."""
        model = self._model
        height, width = input_size(rgb.shape[:2], self._options["resolution"])
        how = cv2.INTER_AREA if width < rgb.shape[1] else cv2.INTER_CUBIC
        small = cv2.resize(rgb, (width, height), interpolation=how)
        inputs = self._processor(images=small, do_resize=False, return_tensors="pt")
        with torch.inference_mode():
            found = model(inputs["pixel_values"].to(self._device, self._dtype)).predicted_depth
        raw = found[0].float().cpu().numpy()
        if not np.isfinite(raw).all():
            raise InputError.of("--dtype", str(self._dtype), "gives no finite depth", "write --dtype float32")
        depth = raw if self._options["unit"] == "m" else receding(raw)
        return np.asarray(cv2.resize(depth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.float32)


depth = Depth
"""The factory named in the registry."""


def receding(nearness: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth from inverse depth >= 0, larger = nearer, with unknown scale and shift.

    The nearest point gets 1, points without parallax `DEPTH.farthest`; between them depth is the inverse, so that
    ratios of near depths are right if the shift is small. The order is kept strictly. A map without any parallax is
    all 1.
    """
    most = float(nearness.max())
    if most <= 0:
        return np.ones_like(nearness)
    share = np.clip(nearness / most, 0, 1)
    return np.asarray(1 / (share * (1 - 1 / DEPTH.farthest) + 1 / DEPTH.farthest), np.float32)


def input_size(shape: tuple[int, ...], resolution: int) -> tuple[int, int]:
    """The size of the network's input for a photo of `shape` (H, W): its shorter side is about `resolution`.

    >>> input_size((1080, 1920), 518)
    (518, 924)
    """
    scale = min(resolution / min(shape), DEPTH.longest * resolution / max(shape))
    tall, wide = (max(1, round(side * scale / DEPTH.patch)) * DEPTH.patch for side in shape[:2])
    return tall, wide
