"""Backend depth=depth-anything: Depth Anything V2 (Yang et al. 2024), relative or
metric.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch
from transformers import DepthAnythingForDepthEstimation, DPTImageProcessorPil

from physgen.maps import F32
from physgen.messages import Message
from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.roles import Rgb
from physgen.registry import Options, Setup, read_options

NAME = "depth-anything"


@dataclass(frozen=True)
class DepthConstants:
    """Constants of the network's input and of the depth scale."""

    farthest: float = 50.0
    """Distance of points without parallax (the sky), relative to the nearest point."""
    patch: int = 14
    """px: the sides of the network's input are multiples of it."""
    longest: float = 3.0
    """Largest ratio of the input's longer side to `resolution`, since the cost of
    attention grows with the square of the area.
    """


DEPTH = DepthConstants()
OPTIONS: Options = {"resolution": (518, {"type": "integer", "minimum": DEPTH.patch})}
"""`resolution`: the shorter side of the network's input, px; the weights were trained
at 518 px.
"""


class DepthAnything(ModelBackend):
    """The backend `depth-anything`."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device, number type, option or weights."""
        options = read_options(setup, NAME, OPTIONS)
        (weights,) = weight_ids("depth", NAME, setup)
        super().__init__(setup, weights, "Depth Anything", options | {"unit": ""})

    def _number_type(self, setup: Setup) -> torch.dtype:
        # The model is small, and 16-bit numbers would quantise depth visibly.
        if setup.dtype == "auto":
            return torch.float32
        return super()._number_type(setup)

    def _load(self, weights: str) -> Any:
        self._processor = DPTImageProcessorPil.from_pretrained(weights)
        model = DepthAnythingForDepthEstimation.from_pretrained(
            weights, dtype=self._dtype, use_safetensors=True
        )
        is_metric = model.config.depth_estimation_type == "metric"
        self._options["unit"] = "m" if is_metric else "relative"
        return model.to(self._device).eval()

    def __call__(self, rgb: Rgb) -> F32:
        """Return depth (H, W) float32, larger = farther, in m or relative to the
        nearest point.
        """
        model = self._model
        height, width = input_size(rgb.shape[:2], self._options["resolution"])
        if width < rgb.shape[1]:
            interpolation = cv2.INTER_AREA
        else:
            interpolation = cv2.INTER_CUBIC
        small = cv2.resize(rgb, (width, height), interpolation=interpolation)
        inputs = self._processor(images=small, do_resize=False, return_tensors="pt")
        pixel_values = inputs["pixel_values"].to(self._device, self._dtype)
        with torch.inference_mode():
            prediction = model(pixel_values).predicted_depth
        raw = prediction[0].float().cpu().numpy()
        if not np.isfinite(raw).all():
            dtype = str(self._dtype).removeprefix("torch.")
            raise Message.DEPTH_NOT_FINITE.error("physgen.toml", dtype)
        if self._options["unit"] == "m":
            depth = raw
        else:
            depth = invert_depth(raw)
        size = rgb.shape[1], rgb.shape[0]
        return np.asarray(
            cv2.resize(depth, size, interpolation=cv2.INTER_LINEAR), np.float32
        )


depth = DepthAnything
"""The factory named in the registry."""


def invert_depth(inverse: F32) -> F32:
    """Return depth from inverse depth >= 0 with unknown scale and shift.

    The nearest point gets depth 1, and points without parallax get `DEPTH.farthest`.
    Between them the result is the reciprocal, so that ratios of small depths are
    correct if the shift is small. The order of depths is kept strictly. A map without
    any parallax becomes 1 everywhere.
    """
    nearest = float(inverse.max())
    if nearest <= 0:
        return np.ones_like(inverse)
    share = np.clip(inverse / nearest, 0, 1)
    farthest = 1 / DEPTH.farthest
    return np.asarray(1 / (share * (1 - farthest) + farthest), np.float32)


def input_size(shape: tuple[int, ...], resolution: int) -> tuple[int, int]:
    """Return the size (h, w) of the network's input for a photo of `shape` (H, W).

    >>> input_size((1080, 1920), 518)
    (518, 924)
    """
    scale = min(resolution / min(shape), DEPTH.longest * resolution / max(shape))
    height, width = (
        max(1, round(side * scale / DEPTH.patch)) * DEPTH.patch for side in shape[:2]
    )
    return height, width
