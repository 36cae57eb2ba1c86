"""Tiny models of `evaluate fid`: a TorchScript that is called as the Inception file is."""

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


MODELS: dict = {}
