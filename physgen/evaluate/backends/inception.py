"""Compute the features of published FIDs with a user's own file of the Inception
network.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from physgen.messages import Message
from physgen.perceive.backends.models import Flag, device_of, load_weights, run_note
from physgen.registry import Setup
from physgen.videos import U8

FLAG = "--inception"
FEATURES = 2048
"""Number of features of a picture."""
KEY = "return_features"
BATCH = 16
"""Number of pictures in one call of the network."""
FIX = "name inception-2015-12-05.pt, the TorchScript file that NVIDIA published with StyleGAN2-ADA"


class Inception:
    """The 2048 features of the network of Heusel et al., from a user's own file
    `inception-2015-12-05.pt`.

    The network takes (N, 3, H, W) uint8, 0 to 255, of any size, resizes to 299 x 299 px
    as TensorFlow 1 did, and gives (N, 2048) with `return_features=True`. A TorchScript
    file is a program: loading runs it. Raise InputError for a missing file. The file is
    loaded on first use.
    """

    name = "inception"

    def __init__(self, path: Path) -> None:
        self._path = path.expanduser()
        if not self._path.is_file():
            raise Message.NO_SUCH_FILE.error(FLAG, f'"{path}"', fix=FIX)
        self._device = device_of(Setup())

    @cached_property
    def _model(self) -> Any:
        model = load_weights(
            self._load, str(self._path), "Inception", Flag(FLAG, "PATH")
        )
        if KEY not in [argument.name for argument in model.forward.schema.arguments]:
            raise Message.NOT_INCEPTION.error(
                FLAG, f'"{self._path}"', reason=f"it does not take {KEY}", fix=FIX
            )
        return model

    def _load(self, weights: str) -> Any:
        return torch.jit.load(weights, map_location=self._device).eval()

    def __call__(self, pictures: U8) -> NDArray[np.float64]:
        """Return the features (N, 2048) of pictures (N, H, W, 3) sRGB."""
        features = []
        for k in range(0, len(pictures), BATCH):
            channels_first = pictures[k : k + BATCH].transpose(0, 3, 1, 2)
            batch = torch.from_numpy(np.ascontiguousarray(channels_first))
            features.append(self._run(batch))
        return np.concatenate(features)

    def _run(self, batch: torch.Tensor) -> NDArray[np.float64]:
        """Return the features of a batch. Raise InputError if the network gives
        others.
        """
        with torch.inference_mode():
            answer = self._model(batch.to(self._device), return_features=True)
        expected_shape = (len(batch), FEATURES)
        shape: tuple[int, ...] | str = type(answer).__name__
        if isinstance(answer, torch.Tensor):
            shape = tuple(answer.shape)
        if shape != expected_shape:
            raise Message.NOT_INCEPTION.error(
                FLAG,
                f'"{self._path}"',
                reason=f"it answers {shape}, not {expected_shape}",
                fix=FIX,
            )
        return np.asarray(answer.double().cpu().numpy(), np.float64)

    def note(self) -> Mapping[str, Any]:
        """Return the file's hash and the device."""
        digest = hashlib.sha256(self._path.read_bytes()).hexdigest()
        return run_note(
            self._device, torch.float32, str(self._path), {"sha256": digest}
        )
