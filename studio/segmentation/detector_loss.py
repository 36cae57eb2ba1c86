"""Loss of the detector: dynamic assignment, varifocal scores, GIoU and bins of boxes.

As PicoDet learns (Yu et al. 2021), with two more scores: movable and immovable wholes.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from detector import BINS, WHOLES, decode_boxes
from detector_views import IGNORED
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

CANDIDATES = 10
"""Best boxes whose overlaps are summed to the number of cells of an object."""
CENTRE_RADIUS = 2.5
"""Cells this near to the centre of an object may learn it, strides."""
OVERLAP_COST = 6.0
"""Weight of overlap against score when cells are chosen, as in TOOD (Feng et al. 2021).
The cost of SimOTA prefers cells with worse boxes while all scores are low."""
NEGATIVE_SHARE = 0.75
"""Weight of background against objects (alpha of varifocal loss)."""
FOCUS = 2.0
"""Exponent by which clear background counts less (gamma)."""
BOX_WEIGHT, BIN_WEIGHT, CLASS_WEIGHT = 2.0, 0.25, 0.5
"""Weights of the losses against that of wholes."""

DISTILLED_WEIGHT = 2.0
"""Weight of the loss that keeps the class scores of the given network."""


@dataclass(frozen=True)
class Target:
    """The objects of one view, as tensors."""

    boxes: Tensor
    """(G, 4) px."""
    roles: Tensor
    """(G,)"""
    classes: Tensor
    """(G,) -1 if unknown."""
    weights: Tensor
    """(N,) of each cell as background of wholes."""
    class_weights: Tensor
    """(N,) the same for classes."""


@dataclass(frozen=True)
class Assignment:
    """Cells that learn an object."""

    cells: Tensor
    """(P,)"""
    objects: Tensor
    """(P,) places in Target."""
    overlaps: Tensor
    """(P,) IoU of the predicted box."""


def losses(
    scores: Tensor,
    bins: Tensor,
    targets: list[Target],
    centres: Tensor,
    strides: Tensor,
) -> dict[str, Tensor]:
    """Return the parts of the loss; `scores` (B, N, 82) and `bins` (B, N, 32) are
    logits."""
    boxes = decode_boxes(bins, centres, strides)
    sums: dict[str, list[Tensor]] = {
        "wholes": [],
        "classes": [],
        "boxes": [],
        "bins": [],
    }
    mass = scores.new_zeros(())
    for k, target in enumerate(targets):
        chosen = assign(scores[k].detach(), boxes[k].detach(), target, centres, strides)
        sums["wholes"].append(
            _whole_loss(scores[k, :, :WHOLES], chosen, target, centres)
        )
        sums["classes"].append(
            _class_loss(scores[k, :, WHOLES:], chosen, target, centres)
        )
        truth = target.boxes[chosen.objects]
        quality = chosen.overlaps
        mass = mass + quality.sum()
        overlap = 1 - generalised_iou(boxes[k, chosen.cells], truth)
        sums["boxes"].append((overlap * quality).sum())
        sums["bins"].append(_bin_loss(bins[k], chosen, truth, centres, strides))
    mass = mass.clamp(min=1.0)
    factors = {
        "wholes": 1.0,
        "classes": CLASS_WEIGHT,
        "boxes": BOX_WEIGHT,
        "bins": BIN_WEIGHT,
    }
    return {
        name: factors[name] * torch.stack(parts).sum() / mass
        for name, parts in sums.items()
    }


def assign(
    scores: Tensor, boxes: Tensor, target: Target, centres: Tensor, strides: Tensor
) -> Assignment:
    """Choose the cells that learn each object, as many as SimOTA does (Ge et al. 2021)."""
    valid = torch.nonzero(target.roles != IGNORED).flatten()
    empty = torch.zeros(0, dtype=torch.long, device=scores.device)
    if not len(valid):
        return Assignment(empty, empty, scores.new_zeros(0))
    truth = target.boxes[valid]
    x, y = centres[:, :1], centres[:, 1:]
    is_inside = (x > truth[:, 0]) & (x < truth[:, 2])
    is_inside &= (y > truth[:, 1]) & (y < truth[:, 3])
    middle = (truth[:, :2] + truth[:, 2:]) / 2
    distance = (centres[:, None] - middle[None]).abs().amax(-1)
    is_central = distance < CENTRE_RADIUS * strides[:, None]
    overlaps = iou(boxes, truth)
    predicted = scores[:, target.roles[valid]].sigmoid()
    cost = -torch.log(predicted + 1e-7)
    cost = cost - OVERLAP_COST * torch.log(overlaps + 1e-7)
    cost = cost + 100.0 * ~(is_inside & is_central) + 1e5 * ~(is_inside | is_central)
    top = overlaps.masked_fill(~(is_inside | is_central), 0).topk(CANDIDATES, dim=0)
    counts = top.values.sum(0).int().clamp(min=1)
    order = cost.argsort(0)
    owner_cost = torch.full((len(centres),), torch.inf, device=scores.device)
    owner = torch.full((len(centres),), -1, dtype=torch.long, device=scores.device)
    for k in range(len(valid)):
        cells = order[: counts[k], k]
        better = cells[cost[cells, k] < owner_cost[cells]]
        owner[better] = k
        owner_cost[better] = cost[better, k]
    cells = torch.nonzero(owner >= 0).flatten()
    objects = owner[cells]
    return Assignment(cells, valid[objects], overlaps[cells, objects])


def _varifocal(logits: Tensor, wanted: Tensor, weights: Tensor) -> Tensor:
    """Return the varifocal loss (Zhang et al. 2021, equation 2) of (N, C) logits."""
    predicted = logits.detach().sigmoid()
    background = NEGATIVE_SHARE * predicted.pow(FOCUS) * weights
    share = torch.where(wanted > 0, wanted, background)
    loss = F.binary_cross_entropy_with_logits(logits, wanted, reduction="none")
    return (loss * share).sum()


def _whole_loss(
    logits: Tensor, chosen: Assignment, target: Target, centres: Tensor
) -> Tensor:
    wanted = torch.zeros_like(logits)
    roles = target.roles[chosen.objects]
    wanted[chosen.cells, roles] = chosen.overlaps.clamp(min=0.05)
    weights = target.weights * ~_in_ignored(target, centres)
    weights = weights[:, None].repeat(1, WHOLES)
    weights[chosen.cells] = 1.0
    return _varifocal(logits, wanted, weights)


def _class_loss(
    logits: Tensor, chosen: Assignment, target: Target, centres: Tensor
) -> Tensor:
    wanted = torch.zeros_like(logits)
    classes = target.classes[chosen.objects]
    has_class = classes >= 0
    cells = chosen.cells[has_class]
    wanted[cells, classes[has_class]] = chosen.overlaps[has_class].clamp(min=0.05)
    weights = target.class_weights * ~_in_ignored(target, centres)
    weights = weights[:, None].repeat(1, logits.shape[1])
    weights[cells] = 1.0
    return _varifocal(logits, wanted, weights)


def distillation(logits: Tensor, taught: Tensor) -> Tensor:
    """Return the distance (quality focal loss, Li et al. 2020, equation 4) of logits of
    classes from the scores of the given network."""
    loss = F.binary_cross_entropy_with_logits(logits, taught, reduction="none")
    gap = (logits.detach().sigmoid() - taught).square()
    return DISTILLED_WEIGHT * (loss * gap).sum() / taught.amax(-1).sum().clamp(min=1)


def _in_ignored(target: Target, centres: Tensor) -> Tensor:
    """Return (N,) cells whose centre is on an ignored object."""
    boxes = target.boxes[target.roles == IGNORED]
    x, y = centres[:, :1], centres[:, 1:]
    inside = (x > boxes[:, 0]) & (x < boxes[:, 2])
    inside &= (y > boxes[:, 1]) & (y < boxes[:, 3])
    return inside.any(1)


def _bin_loss(
    bins: Tensor,
    chosen: Assignment,
    truth: Tensor,
    centres: Tensor,
    strides: Tensor,
) -> Tensor:
    """Return the distribution focal loss (Li et al. 2020, equation 6)."""
    middle = centres[chosen.cells]
    distances = torch.cat([middle - truth[:, :2], truth[:, 2:] - middle], dim=1)
    distances = distances / strides[chosen.cells, None]
    distances = distances.clamp(0, BINS - 1 - 0.01).flatten()
    lower = distances.long()
    upper_share = distances - lower
    logits = bins[chosen.cells].reshape(-1, BINS)
    loss = F.cross_entropy(logits, lower, reduction="none") * (1 - upper_share)
    loss = loss + F.cross_entropy(logits, lower + 1, reduction="none") * upper_share
    return (loss.reshape(-1, 4).sum(1) * chosen.overlaps).sum()


def iou(first: Tensor, second: Tensor) -> Tensor:
    """Return the IoU (N, M) of boxes (N, 4) and (M, 4)."""
    top_left = torch.maximum(first[:, None, :2], second[None, :, :2])
    bottom_right = torch.minimum(first[:, None, 2:], second[None, :, 2:])
    common = (bottom_right - top_left).clamp(min=0).prod(-1)
    union = _areas(first)[:, None] + _areas(second)[None] - common
    return common / union.clamp(min=1e-6)


def generalised_iou(first: Tensor, second: Tensor) -> Tensor:
    """Return the GIoU (N,) of pairs of boxes (Rezatofighi et al. 2019)."""
    top_left = torch.maximum(first[:, :2], second[:, :2])
    bottom_right = torch.minimum(first[:, 2:], second[:, 2:])
    common = (bottom_right - top_left).clamp(min=0).prod(-1)
    union = (_areas(first) + _areas(second) - common).clamp(min=1e-6)
    hull_start = torch.minimum(first[:, :2], second[:, :2])
    hull_end = torch.maximum(first[:, 2:], second[:, 2:])
    hull = (hull_end - hull_start).prod(-1).clamp(min=1e-6)
    return common / union - (hull - union) / hull


def _areas(boxes: Tensor) -> Tensor:
    return (boxes[:, 2:] - boxes[:, :2]).clamp(min=0).prod(-1)
