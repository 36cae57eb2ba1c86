"""Two frames -> flow by RAFT (Teed and Deng, ECCV 2020), torchvision's network with a person's own file of its
weights.

The size of the network follows from its weights. Nothing is fetched: torchvision's files are
`raft_large_C_T_SKHT_V2-ff5fadd5.pth` and `raft_small_C_T_V2-01064c6d.pth`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from physgen.evaluate.fid import F32, U8, Flow
from physgen.perceive.backends.models import Flag, device_of, free_memory, load_weights, run_note
from physgen.problems import InputError
from physgen.registry import Setup

FLAG = Flag("--flow", "raft:PATH")
GET = "write --flow raft:PATH, the path of torchvision's raft_large_C_T_SKHT_V2-ff5fadd5.pth"
FIRST = "feature_encoder.convnormrelu.0.weight"
"""Of 64 channels in the large network, and of 32 in the small one."""
LARGE = 64
MULTIPLE, LEAST = 8, 128
"""px: the sides that it takes."""


class Raft:
    """The backend `raft`; the file is looked for when it is named, and loaded when first needed."""

    def __init__(self, setup: Setup) -> None:
        if not setup.weights:
            raise InputError.of(FLAG.name, '"raft"', "names no file of weights", GET)
        self._path = Path(setup.weights).expanduser()
        if not self._path.is_file():
            raise InputError.of(FLAG.name, f'"{setup.weights}"', "no such file", GET)
        self._device = device_of(setup)

    @cached_property
    def _model(self) -> Any:
        return load_weights(self._load, str(self._path), "RAFT", FLAG)

    def _load(self, path: str) -> Any:
        from torchvision.models.optical_flow import raft_large, raft_small

        weights = torch.load(path, map_location="cpu", weights_only=True)
        if not isinstance(weights, dict) or FIRST not in weights:
            raise InputError.of(FLAG.name, f'"{self._path}"', "holds no weights of torchvision's RAFT", GET)
        build = raft_large if weights[FIRST].shape[0] == LARGE else raft_small
        model = build(weights=None, progress=False)
        model.load_state_dict(weights)
        return model.to(self._device).eval()

    def __call__(self, one: U8, other: U8) -> F32:
        """(H, W, 2) px."""
        height, width = one.shape[:2]
        edge = [(0, max(LEAST, side + -side % MULTIPLE) - side) for side in (height, width)]
        pair = [self._tensor(np.pad(frame, [*edge, (0, 0)], mode="edge")) for frame in (one, other)]
        with torch.inference_mode():
            found = self._model(*pair)[-1][0]  # the last of its guesses
        return np.asarray(found.float().cpu().numpy().transpose(1, 2, 0)[:height, :width], np.float32)

    def _tensor(self, frame: U8) -> torch.Tensor:
        """(1, 3, H, W), -1 to 1, as it was trained."""
        scaled = frame.transpose(2, 0, 1)[None].astype(np.float32) / 127.5 - 1
        return torch.from_numpy(scaled).to(self._device)

    def close(self) -> None:
        """The model goes."""
        self.__dict__.pop("_model", None)
        free_memory()

    def note(self) -> Mapping[str, Any]:
        """For the record."""
        return run_note(self._device, torch.float32, str(self._path), {})


def raft(setup: Setup) -> Flow:
    """The backend `raft`."""
    return Raft(setup)
