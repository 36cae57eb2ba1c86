"""The detector of whole objects: PicoDet-S with an output of its own for whole objects.

The architecture is PicoDet-S of PaddleDetection (Yu et al. 2021, arXiv:2111.00902;
Apache-2.0): an ESNet backbone, a CSP-PAN neck of four levels and a light head. Batch
norms are folded into the convolutions. `given.py` reads the published weights;
`train_detector.py` trains all of them further together with the added branch that
scores whole objects.

The trained network ships as physgen/perceive/segment/detector.onnx (`export.py`):

Input `photo` (1, 3, 416, 416) float32: the photo scaled so that its longer side is 416
px, at the top left of black, BGR, minus (103.53, 116.28, 123.675), divided by
(57.375, 57.12, 58.395). The black border is black before this normalisation.

Outputs, for the strides 8, 16, 32 and 64 (N = 52 * 52, 26 * 26, 13 * 13, 7 * 7 cells,
row by row):

- `scores-8`, `scores-16`, `scores-32`, `scores-64` (1, N, 82) in 0..1: column 0 is the
  score of "a whole rigid object that a person could move", column 1 that of "a whole,
  but not movable" (people, animals, furniture, buildings, signs), columns 2 to 81 are
  those of the 80 classes of COCO in the order of `coco_classes.tsv`.
- `boxes-8`, `boxes-16`, `boxes-32`, `boxes-64` (1, N, 32): logits of 4 x 8 bins. The
  softmax over the 8 bins times 0..7, summed, times the stride, is the distance in px of
  the left, top, right and bottom side of the box from the centre of the cell,
  (column + 0.5, row + 0.5) * stride.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

SIDE = 416
"""Side of the square input, px."""
MEAN = (103.53, 116.28, 123.675)
"""Mean of blue, green and red in the training photos of PicoDet, 0..255."""
DEVIATION = (57.375, 57.12, 58.395)
"""Standard deviation of blue, green and red in the same photos."""
STRIDES = (8, 16, 32, 64)
"""Size of a cell of each level, px."""
BINS = 8
"""Bins of the distribution of a distance, of 0 to 7 strides."""
CLASSES = 80
"""Classes of COCO."""
WHOLES = 2
"""Scores of whole objects: movable, immovable."""
EXCLUDED_LOGIT = -100.0
"""Added to the logits of classes of the other role, so that they are never the best."""
SCORE_NAMES = tuple(f"scores-{stride}" for stride in STRIDES)
BOX_NAMES = tuple(f"boxes-{stride}" for stride in STRIDES)


class Convolution(nn.Sequential):
    """A convolution with its folded batch norm, and a hard swish if `has_swish`."""

    def __init__(
        self,
        inputs: int,
        outputs: int,
        kernel: int = 1,
        stride: int = 1,
        groups: int = 1,
        has_swish: bool = True,
    ) -> None:
        padding = kernel // 2
        layers: list[nn.Module] = [
            nn.Conv2d(inputs, outputs, kernel, stride, padding, groups=groups)
        ]
        if has_swish:
            layers.append(nn.Hardswish())
        super().__init__(*layers)


class Excitation(nn.Module):
    """Squeeze and excitation: channels are weighted by the mean of all channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.reduce = nn.Conv2d(channels, channels // 4, 1)
        self.expand = nn.Conv2d(channels // 4, channels, 1)

    def forward(self, features: Tensor) -> Tensor:
        mean = features.mean((2, 3), keepdim=True)
        return features * F.hardsigmoid(self.expand(F.relu(self.reduce(mean))))


class ShuffleUnit(nn.Module):
    """Unit of stride 1 of ESNet: one half of the channels passes, then all shuffle."""

    def __init__(self, channels: int, middle: int) -> None:
        super().__init__()
        half = channels // 2
        self.pointwise = Convolution(half, middle // 2)
        self.depthwise = Convolution(
            middle // 2, middle // 2, 3, groups=middle // 2, has_swish=False
        )
        self.excitation = Excitation(middle)
        self.project = Convolution(middle, half)

    def forward(self, features: Tensor) -> Tensor:
        passed, changed = features.chunk(2, dim=1)
        changed = self.pointwise(changed)
        changed = torch.cat([changed, self.depthwise(changed)], dim=1)
        changed = self.project(self.excitation(changed))
        return shuffle(torch.cat([passed, changed], dim=1))


class DownUnit(nn.Module):
    """Unit of stride 2 of ESNet: two branches, joined by a depthwise convolution."""

    def __init__(self, inputs: int, outputs: int, middle: int) -> None:
        super().__init__()
        half = outputs // 2
        self.short_depthwise = Convolution(
            inputs, inputs, 3, 2, groups=inputs, has_swish=False
        )
        self.short_project = Convolution(inputs, half)
        self.pointwise = Convolution(inputs, middle // 2)
        self.depthwise = Convolution(
            middle // 2, middle // 2, 3, 2, groups=middle // 2, has_swish=False
        )
        self.excitation = Excitation(middle // 2)
        self.project = Convolution(middle // 2, half)
        self.join_depthwise = Convolution(outputs, outputs, 3, groups=outputs)
        self.join_project = Convolution(outputs, outputs)

    def forward(self, features: Tensor) -> Tensor:
        short = self.short_project(self.short_depthwise(features))
        changed = self.depthwise(self.pointwise(features))
        changed = self.project(self.excitation(changed))
        joined = torch.cat([short, changed], dim=1)
        return self.join_project(self.join_depthwise(joined))


def shuffle(features: Tensor) -> Tensor:
    """Return the channels of two halves in turn: 0, n/2, 1, n/2 + 1, ..."""
    count, channels, height, width = features.shape
    halves = features.reshape(count, 2, channels // 2, height, width)
    return halves.transpose(1, 2).reshape(count, channels, height, width)


STAGES = (
    (96, (88, 48, 48)),
    (192, (96, 120, 96, 120, 96, 96, 96)),
    (384, (192, 192, 192)),
)
"""Of each stage of ESNet: its channels, and the middle channels of its units."""


class Backbone(nn.Module):
    """ESNet-S: photo -> features of stride 8, 16 and 32."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = Convolution(3, 24, 3, 2)
        inputs = 24
        self.stages = nn.ModuleList()
        for channels, middles in STAGES:
            units: list[nn.Module] = [DownUnit(inputs, channels, middles[0])]
            for middle in middles[1:]:
                units.append(ShuffleUnit(channels, middle))
            self.stages.append(nn.Sequential(*units))
            inputs = channels

    def forward(self, photo: Tensor) -> list[Tensor]:
        features = F.max_pool2d(self.stem(photo), 3, 2, 1)
        levels = []
        for stage in self.stages:
            features = stage(features)
            levels.append(features)
        return levels


class Depthwise(nn.Sequential):
    """A depthwise convolution of 5 x 5 and a pointwise one, with hard swishes."""

    def __init__(self, channels: int, stride: int = 1) -> None:
        super().__init__(
            Convolution(channels, channels, 5, stride, groups=channels),
            Convolution(channels, channels),
        )


class CrossStage(nn.Module):
    """Cross stage partial layer of the neck: two levels -> one."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        half = channels // 2
        self.short = Convolution(2 * channels, half)
        self.main = Convolution(2 * channels, half)
        self.pointwise = Convolution(half, half)
        self.depthwise = Depthwise(half)
        self.final = Convolution(channels, channels)

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        features = torch.cat([first, second], dim=1)
        changed = self.depthwise(self.pointwise(self.main(features)))
        return self.final(torch.cat([changed, self.short(features)], dim=1))


class Neck(nn.Module):
    """CSP-PAN: features of stride 8, 16 and 32 -> 96 channels of stride 8 to 64."""

    def __init__(self, channels: int = 96) -> None:
        super().__init__()
        self.reduce = nn.ModuleList(
            Convolution(inputs, channels) for inputs, _ in STAGES
        )
        self.down_to_16 = CrossStage(channels)
        self.down_to_8 = CrossStage(channels)
        self.shrink_8 = Depthwise(channels, 2)
        self.up_to_16 = CrossStage(channels)
        self.shrink_16 = Depthwise(channels, 2)
        self.up_to_32 = CrossStage(channels)
        self.shrink_reduced = Depthwise(channels, 2)
        self.shrink_32 = Depthwise(channels, 2)

    def forward(self, levels: Sequence[Tensor]) -> list[Tensor]:
        reduced_8, reduced_16, reduced_32 = [
            reduce(level) for reduce, level in zip(self.reduce, levels, strict=True)
        ]
        down_16 = self.down_to_16(enlarged(reduced_32), reduced_16)
        level_8 = self.down_to_8(enlarged(down_16), reduced_8)
        level_16 = self.up_to_16(self.shrink_8(level_8), down_16)
        level_32 = self.up_to_32(self.shrink_16(level_16), reduced_32)
        level_64 = self.shrink_reduced(reduced_32) + self.shrink_32(level_32)
        return [level_8, level_16, level_32, level_64]


def enlarged(features: Tensor) -> Tensor:
    """Return features of twice the size, each cell repeated."""
    return F.interpolate(features, scale_factor=2.0, mode="nearest")


class Head(nn.Module):
    """One level's head: features -> logits of classes and boxes, and of wholes.

    PicoDet has two convolutions and one output. The branch of wholes repeats the second
    convolution with weights of its own, and reads the scores of the classes: a cup is
    movable and a person is not.
    """

    def __init__(self, channels: int = 96) -> None:
        super().__init__()
        self.first = Depthwise(channels)
        self.second = Depthwise(channels)
        self.out = nn.Conv2d(channels, CLASSES + 4 * BINS, 1)
        self.wholes = Depthwise(channels)
        self.wholes_out = nn.Conv2d(channels, WHOLES, 1)
        self.class_roles = nn.Conv2d(WHOLES, WHOLES, 1, bias=False)
        excluded = torch.zeros(WHOLES, CLASSES, 1, 1)
        self.register_buffer("excluded", excluded)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of scores (B, 82, h, w) and of boxes (B, 32, h, w)."""
        features = self.first(features)
        known = self.out(self.second(features))
        classes = known[:, :CLASSES]
        wholes = self.wholes_out(self.wholes(features))
        wholes = wholes + self.class_roles(self.best_classes(classes))
        scores = torch.cat([wholes, classes], dim=1)
        return scores, known[:, CLASSES:]

    def best_classes(self, classes: Tensor) -> Tensor:
        """Return the best logit of movable and of immovable classes (B, 2, h, w).

        Class scores are learned from their own labels only, hence detached.
        """
        best = []
        for excluded in self.excluded:
            best.append((classes.detach() + excluded).amax(1, keepdim=True))
        return torch.cat(best, dim=1)

    def start_wholes(self, movable_classes: Sequence[int]) -> None:
        """Start the branch of wholes: its convolutions from those of classes, its scores
        as the best scores of movable and of immovable classes."""
        self.wholes.load_state_dict(self.second.state_dict())
        nn.init.zeros_(self.wholes_out.weight)
        nn.init.zeros_(self.wholes_out.bias)
        nn.init.dirac_(self.class_roles.weight)
        is_movable = torch.zeros(CLASSES, dtype=torch.bool)
        is_movable[list(movable_classes)] = True
        self.excluded[0, ~is_movable] = EXCLUDED_LOGIT
        self.excluded[1, is_movable] = EXCLUDED_LOGIT


class Detector(nn.Module):
    """The whole network."""

    def __init__(self) -> None:
        super().__init__()
        self.backbone = Backbone()
        self.neck = Neck()
        self.heads = nn.ModuleList(Head() for _ in STRIDES)

    def logits(self, photo: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits of scores (B, N, 82) and boxes (B, N, 32) of all levels."""
        scores, boxes = [], []
        for head, level in zip(
            self.heads, self.neck(self.backbone(photo)), strict=True
        ):
            level_scores, level_boxes = head(level)
            scores.append(level_scores.flatten(2).transpose(1, 2))
            boxes.append(level_boxes.flatten(2).transpose(1, 2))
        return torch.cat(scores, dim=1), torch.cat(boxes, dim=1)

    def forward(self, photo: Tensor) -> tuple[Tensor, ...]:
        """Return the eight outputs of the shipped file; see the module."""
        scores, boxes = [], []
        for head, level in zip(
            self.heads, self.neck(self.backbone(photo)), strict=True
        ):
            level_scores, level_boxes = head(level)
            scores.append(level_scores.sigmoid().flatten(2).transpose(1, 2))
            boxes.append(level_boxes.flatten(2).transpose(1, 2))
        return (*scores, *boxes)


def cells(side: int = SIDE) -> tuple[Tensor, Tensor]:
    """Return the centres (N, 2), x and y in px, and strides (N,) of all cells."""
    centres, strides = [], []
    for stride in STRIDES:
        count = -(-side // stride)
        middle = (torch.arange(count) + 0.5) * stride
        y, x = torch.meshgrid(middle, middle, indexing="ij")
        centres.append(torch.stack([x.reshape(-1), y.reshape(-1)], dim=1))
        strides.append(torch.full((count * count,), float(stride)))
    return torch.cat(centres), torch.cat(strides)


def decode_boxes(logits: Tensor, centres: Tensor, strides: Tensor) -> Tensor:
    """Return boxes (..., N, 4), left, top, right, bottom in px, of bins (..., N, 32)."""
    shares = logits.unflatten(-1, (4, BINS)).softmax(-1)
    values = torch.arange(BINS, dtype=logits.dtype, device=logits.device)
    distances = (shares * values).sum(-1) * strides[:, None]
    return torch.cat(
        [centres - distances[..., :2], centres + distances[..., 2:]], dim=-1
    )
