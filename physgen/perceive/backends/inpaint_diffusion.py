"""Backend inpaint=diffusion: holes filled by Stable Diffusion, SDXL, Flux, Qwen ...

The same photo, weights and options give the same bytes on one machine, because the
noise is drawn on the CPU from `seed`.
"""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import torch
from diffusers import AutoPipelineForInpainting
from numpy.typing import NDArray
from PIL import Image

from physgen.messages import Message
from physgen.perceive.backends.models import ModelBackend, load_pipeline, weight_ids
from physgen.perceive.inpaint.painting import (
    inpaint_windows,
    model_size,
    resize_picture,
    resize_window,
)
from physgen.perceive.roles import Rgb
from physgen.registry import Options, Setup, read_options

Mask = NDArray[np.bool_]
OPTIONS: Options = {
    "prompt": ("", {"type": "string"}),
    "seed": (0, {"type": "integer", "minimum": 0}),
    "steps": (None, {"type": "integer", "minimum": 1}),
    "guidance": (None, {"type": "number", "minimum": 0}),
    "resolution": (None, {"type": "integer", "minimum": 64}),
}
"""Section `[diffusion]` of physgen.toml.

`resolution`: side of the model's pictures, px; by default the native size of the
weights.
"""


class Diffusion(ModelBackend):
    """The backend `diffusion`."""

    def __init__(self, setup: Setup) -> None:
        options = read_options(setup, "diffusion", OPTIONS)
        (weights,) = weight_ids("inpaint", "diffusion", setup)
        super().__init__(setup, weights, "a diffusion model that inpaints", options)

    def _load(self, weights: str) -> Any:
        pipe = load_pipeline(
            AutoPipelineForInpainting, weights, self._device, self._dtype
        )
        self._options["resolution"] = self._options["resolution"] or _native(pipe)
        return pipe

    def __call__(self, rgb: Rgb, hole: Mask) -> Rgb:
        """Return the photo (H, W, 3) uint8 with a filled hole; other pixels are
        unchanged.
        """
        if not hole.any():
            return rgb.copy()
        pipe = self._model
        return inpaint_windows(
            rgb,
            hole,
            lambda part, wanted: self._paint(pipe, part, wanted),
            self._options["resolution"],
        )

    def _arguments(self, pipe: Any) -> dict[str, Any]:
        """Return the options of this pipeline."""
        takes = inspect.signature(type(pipe).__call__).parameters
        options = {
            "prompt": self._options["prompt"],
            "num_inference_steps": self._options["steps"],
            "guidance_scale": self._options["guidance"],
            # Strength 1 starts from pure noise, so that no trace of the objects
            # remains.
            "strength": 1.0,
        }
        return {
            key: value
            for key, value in options.items()
            if value is not None and key in takes
        }

    def _paint(self, pipe: Any, rgb: Rgb, hole: Mask) -> Rgb:
        step = 2 * int(getattr(pipe, "vae_scale_factor", 8))
        height, width = model_size(rgb.shape, self._options["resolution"], step)
        small, mask = resize_window(rgb, hole, (height, width))
        arguments = self._arguments(pipe)
        mask_image = Image.fromarray(mask.astype(np.uint8) * 255)
        # A CPU generator gives the same noise on every device.
        generator = torch.Generator("cpu").manual_seed(self._options["seed"])
        with torch.inference_mode():
            output = pipe(
                image=Image.fromarray(small),
                mask_image=mask_image,
                height=height,
                width=width,
                generator=generator,
                output_type="np",
                **arguments,
            )
        if any(getattr(output, "nsfw_content_detected", None) or ()):
            seed = f"diffusion.seed: {self._options['seed']}"
            raise Message.FILL_WITHHELD.error("physgen.toml", seed)
        picture = np.asarray(output.images[0], np.float32)
        if not np.isfinite(picture).all():
            dtype = str(self._dtype).removeprefix("torch.")
            raise Message.COLOURS_NOT_FINITE.error("physgen.toml", dtype)
        return resize_picture(
            np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8),
            (rgb.shape[0], rgb.shape[1]),
        )


diffusion = Diffusion
"""The factory named in the registry."""


def _native(pipe: Any) -> int:
    """Return the side of a pipeline's training pictures, px."""
    network = getattr(pipe, "unet", None)
    if network is not None:
        side = network.config.sample_size
    else:
        side = getattr(pipe, "default_sample_size", 128)
    side = side if isinstance(side, int) else max(side)
    return side * int(getattr(pipe, "vae_scale_factor", 8))
