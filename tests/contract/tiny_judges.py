"""Tiny models of `evaluate fid`: a TorchScript that is called as the Inception file is, RAFT's weights."""

from __future__ import annotations

from pathlib import Path

import torch


class Judge(torch.nn.Module):
    """As `inception-2015-12-05.pt`: (N, 3, H, W) uint8 in, (N, 2048) features or (N, 1008) logits out."""

    def __init__(self) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(0)
        self.register_buffer("mix", torch.randn(192, 2048, generator=generator) / 14)

    def forward(self, img: torch.Tensor, return_features: bool = False) -> torch.Tensor:
        assert img.dtype == torch.uint8
        small = torch.nn.functional.interpolate(
            img.float() / 255, (8, 8), mode="bilinear", align_corners=False
        )
        features = small.flatten(1) @ self.mix
        return features if return_features else features[:, :1008]


class Plain(torch.nn.Module):
    """TorchScript of something else."""

    def forward(self, img: torch.Tensor) -> torch.Tensor:
        return img


class Narrow(torch.nn.Module):
    """Called the same way, of other features."""

    def forward(self, img: torch.Tensor, return_features: bool = False) -> torch.Tensor:
        return img.float().mean((2, 3))


class Blank(torch.nn.Module):
    """Called the same way, of features that are no numbers."""

    def forward(self, img: torch.Tensor, return_features: bool = False) -> torch.Tensor:
        return torch.full((len(img), 2048), float("nan"))


def scripted(path: Path, network: type[torch.nn.Module] = Judge) -> Path:
    file = path.with_suffix(".pt")
    torch.jit.save(torch.jit.script(network()), str(file))
    return file


TORCHVISION = """
import torch

class Constant(torch.nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.feature_encoder = torch.nn.Module()
        self.feature_encoder.convnormrelu = torch.nn.Sequential(torch.nn.Conv2d(3, channels, 7, bias=False))
        self.shift = torch.nn.Parameter(torch.zeros(2))

    def forward(self, one, other):
        for picture in (one, other):
            assert picture.dtype == torch.float32 and picture.shape[1] == 3
            assert min(picture.shape[2:]) >= 128 and not any(side % 8 for side in picture.shape[2:])
            assert -1 <= picture.min() < -0.5 and 0.2 < picture.max() <= 1
        flow = self.shift[None, :, None, None].expand(len(one), 2, *one.shape[2:])
        return [0 * flow, flow]

def raft_large(weights, progress):
    assert weights is None
    return Constant(64)

def raft_small(weights, progress):
    assert weights is None
    return Constant(32)
"""


def raft(path: Path, channels: int = 32) -> Path:
    """Weights alone, as torchvision publishes them."""
    file = path.with_suffix(".pth")
    names = {"feature_encoder.convnormrelu.0.weight": torch.zeros(channels, 3, 7, 7)}
    torch.save({**names, "shift": torch.tensor([3.0, 1.0])}, file)
    return file


MODELS = {("features", "inception"): scripted, ("flow", "raft"): raft}
