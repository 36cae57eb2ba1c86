"""Pictures -> the features that published FIDs are made of, by a user's own file of the Inception network."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physgen.perceive.backends.models import Flag, device_of, load_weights, run_note
from physgen.problems import InputError
from physgen.registry import Setup
from physgen.videos import U8

FLAG = "--inception"
WIDE = 2048
KEY = "return_features"
BATCH = 16
GET = "name inception-2015-12-05.pt, the TorchScript file that NVIDIA published with StyleGAN2-ADA"


class Inception:
    """The 2048 features of the network of Heusel et al., by a user's own file `inception-2015-12-05.pt`.

    It takes (N, 3, H, W) uint8, 0 to 255, of any size, resizes to 299 x 299 px as TensorFlow 1 did, and gives
    (N, 2048) where it is called with `return_features=True`. A TorchScript file is a program: loading one runs it.
    Raises InputError where there is no file; it is loaded when first needed.
    """

    name = "inception"

    def __init__(self, path: Path) -> None:
        self._path = path.expanduser()
        if not self._path.is_file():
            raise InputError.of(FLAG, f'"{path}"', "no such file", GET)
        self._device = device_of(Setup())

    @cached_property
    def _model(self) -> Any:
        model = load_weights(
            self._load, str(self._path), "Inception", Flag(FLAG, "PATH")
        )
        if KEY not in [argument.name for argument in model.forward.schema.arguments]:
            raise InputError.of(
                FLAG, f'"{self._path}"', f"takes no {KEY}: is not that network", GET
            )
        return model

    def _load(self, weights: str) -> Any:
        return torch.jit.load(weights, map_location=self._device).eval()

    def __call__(self, pictures: U8) -> NDArray[np.float64]:
        """(N, H, W, 3) sRGB -> (N, 2048)."""
        found = []
        for k in range(0, len(pictures), BATCH):
            batch = torch.from_numpy(
                np.ascontiguousarray(pictures[k : k + BATCH].transpose(0, 3, 1, 2))
            )
            found.append(self._answer(batch))
        return np.concatenate(found)

    def _answer(self, batch: torch.Tensor) -> NDArray[np.float64]:
        with torch.inference_mode():
            answer = self._model(batch.to(self._device), return_features=True)
        shape = (
            tuple(answer.shape)
            if isinstance(answer, torch.Tensor)
            else type(answer).__name__
        )
        wanted = (len(batch), WIDE)
        if shape != wanted or not isinstance(answer, torch.Tensor):
            found = f"answers {shape}, not {wanted}: is not that network"
            raise InputError.of(FLAG, f'"{self._path}"', found, GET)
        return np.asarray(answer.double().cpu().numpy(), np.float64)

    def note(self) -> Mapping[str, Any]:
        """Which file it was, by its content, and where it ran."""
        digest = hashlib.sha256(self._path.read_bytes()).hexdigest()
        return run_note(
            self._device, torch.float32, str(self._path), {"sha256": digest}
        )
