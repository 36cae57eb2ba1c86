"""The network: a picture -> what each pixel belongs to, seen at half its size. A residual U-Net; torch."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

WIDTHS = (16, 32, 80, 160, 240)
"""Channels of each level, the finest first: multiples of 16, which processors multiply fastest."""
LAST = 16
"""Channels of the finest part of the way up, where most of the work is."""
OFFSETS = ((3, 0), (0, 3), (9, 0), (0, 9), (9, 9), (9, -9), (27, 0), (0, 27))
"""(rows, columns) px of the output: pairs of pixels of which it says whether they are of one object."""
FOREGROUND, BOUNDARY, PAIRS, NORMALS, SHADOW = 0, 1, slice(2, 10), slice(10, 13), 13
"""Channels of the output. All but the normals are logits: on an object; at the border of one; both pixels on the same
one; unit normals, +x right, +y down, +z to the viewer; in a cast shadow."""
CHANNELS = 14
MEAN, SPREAD = 118.0, 64.0
"""Of 8-bit sRGB codes: what goes in is (code - MEAN) / SPREAD."""


def _conv(into: int, out: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(into, out, size, stride, size // 2, bias=False), nn.BatchNorm2d(out), nn.ReLU(inplace=True)
    )


class Residual(nn.Module):
    """Two 3 x 3 convolutions beside a short cut."""

    def __init__(self, width: int, apart: int = 1) -> None:
        super().__init__()
        self.first = _conv(width, width)
        self.second = nn.Sequential(
            nn.Conv2d(width, width, 3, 1, apart, dilation=apart, bias=False), nn.BatchNorm2d(width)
        )

    def forward(self, x: Tensor) -> Tensor:
        """(N, C, H, W) -> the same."""
        return F.relu(x + self.second(self.first(x)))


class Network(nn.Module):
    """(N, 3, H, W) sRGB, H and W multiples of 32 -> (N, CHANNELS, H / 2, W / 2)."""

    def __init__(self, widths: tuple[int, ...] = WIDTHS) -> None:
        super().__init__()
        a, b, c, d, e = widths
        self.down = nn.ModuleList(
            [
                nn.Sequential(_conv(3, a, 2), Residual(a)),
                nn.Sequential(_conv(a, b, 2), Residual(b)),
                nn.Sequential(_conv(b, c, 2), Residual(c)),
                nn.Sequential(_conv(c, d, 2), Residual(d), Residual(d, 2)),
                nn.Sequential(_conv(d, e, 2), Residual(e), Residual(e, 2)),
            ]
        )
        self.join = nn.ModuleList(
            [_conv(into, out, size=1) for into, out in ((e, d), (d, c), (c, b), (b, LAST))]
        )
        self.side = nn.ModuleList(
            [_conv(into, out, size=1) for into, out in ((d, d), (c, c), (b, b), (a, LAST))]
        )
        self.up = nn.ModuleList([Residual(d), Residual(c), Residual(b), Residual(LAST)])
        self.out = nn.Conv2d(LAST, CHANNELS, 3, 1, 1)

    def forward(self, x: Tensor) -> Tensor:
        """See the class."""
        seen = []
        for stage in self.down:
            x = stage(x)
            seen.append(x)
        for join, side, up, beside in zip(self.join, self.side, self.up, seen[-2::-1], strict=True):
            x = F.interpolate(join(x), scale_factor=2.0, mode="bilinear", align_corners=False)
            x = up(x + side(beside))
        return self.out(x)
