"""Backends depth, normals and intrinsic by Marigold (Ke et al., CVPR 2024 and 2025).

The same photo, weights and options give the same bytes on one machine, because the
noise is drawn on the CPU from `seed`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import diffusers
import numpy as np
import torch

from physgen.maps import F32
from physgen.messages import Message
from physgen.perceive.backends.from_file import divide_shading, facing
from physgen.perceive.backends.models import ModelBackend, load_pipeline, weight_ids
from physgen.perceive.roles import BoundaryGuess, Intrinsics, Labels, PhotoObject, Rgb
from physgen.photometry import decode, luminance
from physgen.registry import Options, Setup, read_options

OPTIONS: Options = {
    "steps": (None, {"type": "integer", "minimum": 1}),
    "ensemble": (1, {"type": "integer", "minimum": 1}),
    "seed": (0, {"type": "integer", "minimum": 0}),
    "resolution": (None, {"type": "integer", "minimum": 0}),
}
"""Section `[marigold]` of physgen.toml, for all three roles.

`resolution`: longer side, px; 0 keeps the photo's size.
"""
SLIMMEST = 8
"""px: least shorter side of the pipeline's input."""
DARKEST = 0.02
"""Least albedo used as a divisor: the albedo of soot."""
PIPELINES = {
    "depth": "MarigoldDepthPipeline",
    "normals": "MarigoldNormalsPipeline",
    "intrinsic": "MarigoldIntrinsicsPipeline",
}


class _Marigold(ModelBackend):
    """A backend with one of the three pipelines and its options."""

    role = ""

    def __init__(self, setup: Setup) -> None:
        options = read_options(setup, "marigold", OPTIONS)
        (weights,) = weight_ids(self.role, "marigold", setup)
        super().__init__(setup, weights, f"Marigold's {self.role}", options)

    def _number_type(self, setup: Setup) -> torch.dtype:
        is_float16 = setup.dtype == "auto" and self._device.startswith("cuda")
        # bfloat16 has 8 bits of mantissa, which would give maps visible steps.
        if is_float16:
            return torch.float16
        return super()._number_type(setup)

    def _load(self, weights: str) -> Any:
        pipe = load_pipeline(
            diffusers.DiffusionPipeline, weights, self._device, self._dtype
        )
        if not isinstance(pipe, getattr(diffusers, PIPELINES[self.role])):
            is_a = {name: role for role, name in PIPELINES.items()}.get(
                type(pipe).__name__
            )
            fix = f"name a {PIPELINES[self.role]}"
            if is_a:
                fix = f"write {is_a}=marigold:{self._weights}"
            raise Message.WRONG_PIPELINE.error(
                "--backend",
                f'"{self._weights}"',
                name=type(pipe).__name__,
                role=self.role,
                fix=fix,
            )
        if self._options["steps"] is None:
            self._options["steps"] = pipe.default_denoising_steps
        if self._options["resolution"] is None:
            self._options["resolution"] = pipe.default_processing_resolution or 768
        return pipe

    def predicted(self, rgb: Rgb) -> tuple[F32, Rgb]:
        """Return the prediction (N, h, w, C) in the pipeline's conventions and the
        resized photo (h, w, 3).
        """
        pipe = self._model
        small = shrunk(rgb, self._options["resolution"])
        generator = torch.Generator("cpu").manual_seed(self._options["seed"])
        with torch.inference_mode():
            prediction = pipe(
                small,
                num_inference_steps=self._options["steps"],
                ensemble_size=self._options["ensemble"],
                processing_resolution=0,
                match_input_resolution=False,
                generator=generator,
            ).prediction
        if not np.isfinite(prediction).all():
            dtype = str(self._dtype).removeprefix("torch.")
            raise Message.PREDICTION_NOT_FINITE.error(
                "physgen.toml", dtype, role=self.role, device=self._device
            )
        return np.asarray(prediction, np.float32), small


class Depth(_Marigold):
    """The backend `depth=marigold`."""

    role = "depth"

    def __call__(self, rgb: Rgb) -> F32:
        """Return depth (H, W) float32 in 0..1, from the nearest to the farthest
        plane.
        """
        return _resize_to_photo(self.predicted(rgb)[0][0, :, :, 0], rgb)


class Normals(_Marigold):
    """The backend `normals=marigold`."""

    role = "normals"

    def __call__(
        self,
        rgb: Rgb,
        labels: Labels,
        objects: Sequence[PhotoObject],
        setting: BoundaryGuess,
    ) -> F32:
        """Return unit normals (H, W, 3) float32."""
        # The pipeline's axes are +x right, +y up, +z to the viewer; y is flipped below.
        prediction = self.predicted(rgb)[0][0]
        return facing(
            _resize_to_photo(prediction * np.array([1, -1, 1], np.float32), rgb)
        )


class Intrinsic(_Marigold):
    """The backend `intrinsic=marigold`, for weights that predict albedo alone, or
    albedo, shading and residual.
    """

    role = "intrinsic"

    def __call__(self, rgb: Rgb, labels: Labels, normals: F32) -> Intrinsics:
        """Return albedo and shading whose product is the photo.

        The shading has the pipeline's resolution. The albedo is the photo divided by
        it, so that it keeps all details.
        """
        predictions, small = self.predicted(rgb)
        properties = self._model.target_properties or {}
        names = properties.get("target_names") or []
        maps = {}
        for name, target in zip(names, predictions, strict=False):
            maps[name] = linear(target, properties.get(name, {}))
        if "albedo" not in maps:
            raise Message.NO_ALBEDO.error(
                "--backend",
                f'"{self._weights}"',
                outputs=", ".join(names) or "nothing with a name",
            )
        if "shading" in maps:
            shading = divide_albedo(
                decode(small), maps["albedo"], maps["shading"], maps.get("residual")
            )
        else:
            paint = np.maximum(luminance(maps["albedo"]), np.float32(DARKEST))
            shading = np.asarray(luminance(decode(small)) / paint, np.float32)
        return divide_shading(rgb, _resize_to_photo(shading, rgb))


depth, normals, intrinsic = Depth, Normals, Intrinsic
"""The factories named in the registry."""


def linear(values: F32, properties: Mapping[str, Any]) -> F32:
    """Return a predicted target in 0..1 as linear light, by its entry in
    `target_properties`.
    """
    if properties.get("prediction_space", "srgb") == "linear":
        return values
    return decode(np.clip(values, 0, 1))


def divide_albedo(light: F32, albedo: F32, shading: F32, residual: F32 | None) -> F32:
    """Return the shading (h, w) that turns `albedo` into the photo's `light`.

    `light` and `albedo` are (h, w, 3), linear. Shading and residual are known up to
    scale: photo = a albedo shading + b residual, with a and b by least squares. Mirror
    reflections are light rather than paint, so the residual counts as shading.
    """
    paint = luminance(albedo)
    fall = luminance(shading)
    matt = paint * fall
    if residual is None:
        gloss = np.zeros_like(matt)
    else:
        gloss = luminance(residual)
    photo_luminance = luminance(light)
    a, b = np.linalg.lstsq(
        np.stack([matt.ravel(), gloss.ravel()], 1), photo_luminance.ravel(), rcond=None
    )[0]
    # A negative factor has no physical meaning: fit the shading alone.
    if b <= 0 or a <= 0:
        a = float(matt.ravel() @ photo_luminance.ravel()) / max(
            float(matt.ravel() @ matt.ravel()), 1e-9
        )
        b = 0.0
    return np.asarray(a * fall + b * gloss / np.maximum(paint, DARKEST), np.float32)


def shrunk(rgb: Rgb, resolution: int) -> Rgb:
    """Return the photo with a longer side of `resolution` px; 0 leaves it unchanged.

    The shorter side is at least `SLIMMEST`.
    """
    height, width = rgb.shape[:2]
    if resolution:
        scale = resolution / max(height, width)
    else:
        scale = 1.0
    new_height = max(SLIMMEST, round(height * scale))
    new_width = max(SLIMMEST, round(width * scale))
    if (new_height, new_width) == (height, width):
        return rgb
    if scale < 1:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(rgb, (new_width, new_height), interpolation=interpolation), np.uint8
    )


def _resize_to_photo(values: F32, rgb: Rgb) -> F32:
    """Return a map in the photo's size."""
    if values.shape[1] > rgb.shape[1]:
        interpolation = cv2.INTER_AREA
    else:
        interpolation = cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(values, rgb.shape[1::-1], interpolation=interpolation), np.float32
    )
