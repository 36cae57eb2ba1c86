"""Weights of another program's RAFT, and of the large network: what a person is told, and what is built."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from physgen import registry
from physgen.problems import InputError
from physgen.registry import Setup
from tests.contract.tiny_judges import raft

FRAME = np.random.default_rng(0).integers(0, 255, (20, 30, 3)).astype(np.uint8)


def test_weights_that_are_not_torchvisions(tmp_path: Path, torchvision_stub: None) -> None:
    file = tmp_path / "raft-things.pth"
    torch.save({"module.fnet.conv1.weight": torch.zeros(2)}, file)
    with pytest.raises(InputError, match="holds no weights of torchvision's RAFT"):
        registry.make("flow", "raft", Setup(str(file), "cpu"))(FRAME, FRAME)
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match="does not load as RAFT"):
        registry.make("flow", "raft", Setup(str(file), "cpu"))(FRAME, FRAME)
    with pytest.raises(InputError, match="no such file"):
        registry.make("flow", "raft", Setup("/nowhere.pth", "cpu"))


@pytest.mark.parametrize("channels", [32, 64])
def test_both_sizes_are_told_apart(tmp_path: Path, torchvision_stub: None, channels: int) -> None:
    moved = registry.make("flow", "raft", Setup(str(raft(tmp_path / "raft", channels)), "cpu"))(FRAME, FRAME)
    assert moved.shape == (20, 30, 2)
    assert (moved == (3, 1)).all()
