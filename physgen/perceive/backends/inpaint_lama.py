"""Photo and hole -> the photo with the hole filled by LaMa (Suvorov et al., WACV 2022), from its TorchScript file.

A TorchScript file is a program: loading one runs it. Name only a file whose source you trust.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physgen.perceive.backends.models import (
    check_torchscript,
    device_of,
    free_memory,
    load_weights,
    read_options,
    run_note,
    whole_number,
)
from physgen.perceive.inpaint.painting import inpaint_windows, model_size, resize_picture, resize_window
from physgen.perceive.roles import Rgb
from physgen.problems import InputError
from physgen.registry import Setup

Mask = NDArray[np.bool_]
MULTIPLE = 8
"""px: the sides of the network's input are multiples of it."""
SMALLEST = 64
"""px: least side, since its coarsest level mirrors the borders."""
GET = "write inpaint=lama:PATH, the path of big-lama.pt"


class Lama:
    """The backend `lama`; windows of more than `resolution` px squared are reduced to it.

    The file is checked at once, and loaded when first needed.
    """

    def __init__(self, setup: Setup) -> None:
        self._resolution = read_options(setup, "lama", {"resolution": whole_number(1024, SMALLEST)})[
            "resolution"
        ]
        if not setup.weights:
            raise InputError.of("--backend", '"inpaint=lama"', "names no file of weights", GET)
        self._weights = setup.weights
        self._device = device_of(setup)
        load_weights(lambda path: check_torchscript(Path(path), "--backend", GET), self._weights, "LaMa")

    @cached_property
    def _model(self) -> Any:
        return load_weights(self._load, self._weights, "LaMa")

    def _load(self, weights: str) -> Any:
        # always float32: Fourier transforms in half precision are limited to powers of two
        return torch.jit.load(weights, map_location=self._device).eval()

    def __call__(self, rgb: Rgb, hole: Mask) -> Rgb:
        """(H, W, 3) uint8; equals `rgb` outside the hole."""
        return inpaint_windows(rgb, hole, self._paint, self._resolution)

    def _paint(self, rgb: Rgb, wanted: Mask) -> Rgb:
        size = rgb.shape[:2]
        large = size[0] * size[1] > self._resolution**2
        small, mask = resize_window(
            rgb, wanted, model_size(size, self._resolution, MULTIPLE) if large else size
        )
        height, width = mask.shape
        edge = [(0, max(SMALLEST, -side % MULTIPLE + side) - side) for side in (height, width)]
        image = np.pad(small, [*edge, (0, 0)], mode="symmetric").transpose(2, 0, 1).astype(np.float32) / 255
        where = np.pad(mask, edge, mode="symmetric").astype(np.float32)
        with torch.inference_mode():
            found = self._model(*(torch.from_numpy(a)[None].to(self._device) for a in (image, where[None])))
        if not isinstance(found, torch.Tensor) or tuple(found.shape) != (1, *image.shape):
            shape = tuple(found.shape) if isinstance(found, torch.Tensor) else type(found).__name__
            raise InputError.of(
                "--backend", f'"{self._weights}"', f"answers {shape} to {(1, *image.shape)}: is no LaMa", GET
            )
        picture = found[0].float().cpu().numpy().transpose(1, 2, 0)[:height, :width]
        if not np.isfinite(picture).all():
            raise InputError.of("--backend", f'"{self._weights}"', "paints no finite colours", GET)
        return resize_picture(np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8), (size[0], size[1]))

    def close(self) -> None:
        """Free the model."""
        self.__dict__.pop("_model", None)
        free_memory()

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        return run_note(self._device, torch.float32, self._weights, {"resolution": self._resolution})


lama = Lama
"""The factory named in the registry."""
