"""Photo and hole -> the photo with the hole painted by a diffusion model: Stable Diffusion, SDXL, Flux, Qwen ...

The same photo, weights and options give the same bytes on one machine: the noise is drawn on the CPU from `seed`.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from diffusers import AutoPipelineForInpainting
from numpy.typing import NDArray
from PIL import Image

from physgen.backends import Setup, find
from physgen.perceive.backends.models import device_of, dtype_of, freed, loaded
from physgen.perceive.backends.options import Option, Real, Text, Whole, read
from physgen.perceive.backends.pipelines import opened
from physgen.perceive.painted import back, frame, painted, shown
from physgen.perceive.roles import Inpaint, Rgb
from physgen.problems import InputError

Mask = NDArray[np.bool_]
OPTIONS: dict[str, Option] = {
    "prompt": Text(""),
    "negative": Text(""),
    "seed": Whole(0),
    "steps": Whole(None, 1),
    "guidance": Real(None),
    "resolution": Whole(None, 64),
}
"""`[diffusion]` of physgen.toml; `resolution`: px squared that the model paints best, the weights' own if left out."""
TRIES = 3
"""Seeds to try where the weights' safety checker withholds a picture."""


class Diffusion:
    """The backend `diffusion`."""

    def __init__(self, setup: Setup) -> None:
        self._options = read(setup, "diffusion", OPTIONS)
        self._weights = setup.weights or find("inpaint", "diffusion").weights[0].id
        self._device = device_of(setup)
        self._dtype = dtype_of(setup, self._device)
        self._pipe = loaded(self._load, self._weights, "a diffusion model that inpaints")
        takes = inspect.signature(type(self._pipe).__call__).parameters
        self._step = 2 * int(getattr(self._pipe, "vae_scale_factor", 8))
        self._options["resolution"] = self._options["resolution"] or _native(self._pipe)
        said = {
            "prompt": self._options["prompt"],
            "negative_prompt": self._options["negative"] or None,
            "num_inference_steps": self._options["steps"],
            "guidance_scale": self._options["guidance"],
            "strength": 1.0,  # nothing of the objects is to be kept
        }
        self._said = {key: value for key, value in said.items() if value is not None and key in takes}
        self._withheld = 0

    def _load(self, weights: str) -> Any:
        return opened(AutoPipelineForInpainting, weights, self._device, self._dtype)

    def __call__(self, rgb: Rgb, hole: Mask) -> Rgb:
        """(H, W, 3) uint8; `rgb` outside the hole."""
        return painted(rgb, hole, self._paint, self._options["resolution"])

    def _paint(self, rgb: Rgb, wanted: Mask) -> Rgb:
        height, width = frame(rgb.shape, self._options["resolution"], self._step)
        small, mask = shown(rgb, wanted, (height, width))
        where = Image.fromarray(mask.astype(np.uint8) * 255)
        for k in range(TRIES):
            generator = torch.Generator("cpu").manual_seed(self._options["seed"] + k)
            with torch.inference_mode():
                found = self._pipe(
                    image=Image.fromarray(small),
                    mask_image=where,
                    height=height,
                    width=width,
                    generator=generator,
                    output_type="np",
                    **self._said,
                )
            if not any(getattr(found, "nsfw_content_detected", None) or ()):
                picture = np.asarray(found.images[0], np.float32)
                if not np.isfinite(picture).all():
                    dtype = str(self._dtype).removeprefix("torch.")
                    raise InputError.of("--dtype", dtype, "paints no finite colours", "write --dtype float32")
                small = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
                return back(small, (rgb.shape[0], rgb.shape[1]))
            self._withheld += 1
        raise InputError.of(
            "physgen.toml",
            f"diffusion.seed: {self._options['seed']}",
            f"and the {TRIES - 1} after it paint what the weights' safety checker withholds",
            "choose another seed or prompt, or inpaint=fill",
        )

    def close(self) -> None:
        """The model goes."""
        del self._pipe
        freed()

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        dtype = str(self._dtype).removeprefix("torch.")
        told = {"device": self._device, "dtype": dtype, "weights": self._weights, **self._options}
        return told | ({"withheld": self._withheld} if self._withheld else {})


def diffusion(setup: Setup) -> Inpaint:
    """The backend `diffusion`."""
    return Diffusion(setup)


def _native(pipe: Any) -> int:
    """px: the side of the squares that a pipeline was trained on."""
    network = getattr(pipe, "unet", None)
    side = network.config.sample_size if network is not None else getattr(pipe, "default_sample_size", 128)
    side = side if isinstance(side, int) else max(side)
    return side * int(getattr(pipe, "vae_scale_factor", 8))
