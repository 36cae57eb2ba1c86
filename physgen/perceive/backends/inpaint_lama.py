"""Photo and hole -> the photo with the hole filled by LaMa (Suvorov et al., WACV 2022), from its TorchScript file.

A TorchScript file is a program: loading one runs it. Name only a file whose source you trust.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physgen.perceive.backends.models import (
    ModelBackend,
    check_torchscript,
    read_options,
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


class Lama(ModelBackend):
    """The backend `lama`; windows of more than `resolution` px squared are reduced to it."""

    def __init__(self, setup: Setup) -> None:
        options = read_options(setup, "lama", {"resolution": whole_number(1024, SMALLEST)})
        if not setup.weights:
            raise InputError.of("--backend", '"inpaint=lama"', "names no file of weights", GET)
        super().__init__(setup, setup.weights, "LaMa", options)

    def _number_type(self, setup: Setup) -> torch.dtype:
        return torch.float32  # Fourier transforms in half precision are limited to powers of two

    def _check(self, weights: str) -> None:
        check_torchscript(Path(weights), "--backend", GET)

    def _load(self, weights: str) -> Any:
        return torch.jit.load(weights, map_location=self._device).eval()

    def __call__(self, rgb: Rgb, hole: Mask) -> Rgb:
        """(H, W, 3) uint8; equals `rgb` outside the hole."""
        return inpaint_windows(rgb, hole, self._paint, self._options["resolution"])

    def _paint(self, rgb: Rgb, wanted: Mask) -> Rgb:
        size, native = rgb.shape[:2], self._options["resolution"]
        large = size[0] * size[1] > native**2
        small, mask = resize_window(rgb, wanted, model_size(size, native, MULTIPLE) if large else size)
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


lama = Lama
"""The factory named in the registry."""
