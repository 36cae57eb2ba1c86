"""Backend inpaint=lama: LaMa (Suvorov et al., WACV 2022), from its TorchScript file.

A TorchScript file is a program: loading one runs it. Name only a file that you trust.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from physgen.messages import Message
from physgen.perceive.backends.models import ModelBackend, weight_ids
from physgen.perceive.inpaint.painting import (
    Mask,
    inpaint_windows,
    model_size,
    resize_picture,
    resize_window,
)
from physgen.perceive.roles import Rgb
from physgen.problems import InputError
from physgen.registry import Options, Setup, read_options

NAME = "lama"
MULTIPLE = 8
"""px: the sides of the network's input are multiples of this."""
SMALLEST = 64
"""px: least side of the input, since the coarsest level is padded by mirroring."""
OPTIONS: Options = {"resolution": (1024, {"type": "integer", "minimum": SMALLEST})}
"""`resolution`: windows with more pixels than its square are reduced to it, px."""
GET = "write inpaint=lama:PATH, the path of big-lama.pt"


class Lama(ModelBackend):
    """The backend `lama`."""

    def __init__(self, setup: Setup) -> None:
        """Raises InputError for an unknown device or option and for a missing file."""
        options = read_options(setup, NAME, OPTIONS)
        (weights,) = weight_ids("inpaint", NAME, setup)
        if not Path(weights).expanduser().is_file():
            raise Message.LAMA_NOT_A_FILE.error("--backend", f'"{weights}"')
        super().__init__(setup, weights, "LaMa", options)

    def _number_type(self, setup: Setup) -> torch.dtype:
        # Fourier transforms of 16-bit numbers require sides that are powers of two.
        return torch.float32

    def _load(self, weights: str) -> Any:
        return torch.jit.load(weights, map_location=self._device).eval()

    def __call__(self, rgb: Rgb, hole: Mask) -> Rgb:
        """Return the photo (H, W, 3) uint8 with a filled hole; other pixels are
        unchanged.
        """
        return inpaint_windows(rgb, hole, self._paint, self._options["resolution"])

    def _paint(self, rgb: Rgb, mask: Mask) -> Rgb:
        size = (rgb.shape[0], rgb.shape[1])
        resolution = self._options["resolution"]
        inner = size
        if size[0] * size[1] > resolution**2:
            inner = model_size(size, resolution, MULTIPLE)
        inputs = _network_inputs(*resize_window(rgb, mask, inner))
        with torch.inference_mode():
            answer = self._model(*(tensor.to(self._device) for tensor in inputs))
        if not isinstance(answer, torch.Tensor) or answer.shape != inputs[0].shape:
            raise self._refusal("does not answer with a picture: it is not LaMa")
        colours = answer[0].float().cpu().numpy().transpose(1, 2, 0)
        colours = colours[: inner[0], : inner[1]]
        if not np.isfinite(colours).all():
            raise self._refusal("paints no finite colours")
        levels = np.rint(np.clip(colours, 0, 1) * 255).astype(np.uint8)
        return resize_picture(levels, size)

    def _refusal(self, fault: str) -> InputError:
        return Message.LAMA_UNREADABLE.error(
            "--backend", f'"{self._weights}"', reason=fault
        )


lama = Lama
"""The factory named in the registry."""


def _round_up_side(side: int) -> int:
    """Return the next larger side that the network accepts, px."""
    return max(SMALLEST, side + -side % MULTIPLE)


def _network_inputs(rgb: Rgb, mask: Mask) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the picture (1, 3, h, w) in 0..1 and the hole (1, 1, h, w).

    Both are extended by mirroring to sides that the network accepts.
    """
    margins = [(0, _round_up_side(side) - side) for side in mask.shape]
    mirrored = (
        np.pad(rgb, [*margins, (0, 0)], mode="symmetric").astype(np.float32) / 255
    )
    image = torch.from_numpy(mirrored.transpose(2, 0, 1)[None].copy())
    hole = np.pad(mask, margins, mode="symmetric").astype(np.float32)
    return image, torch.from_numpy(hole[None, None])
