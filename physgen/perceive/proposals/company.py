"""Proposals -> how alike they are: what many good ones agree on is trusted more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from physgen.perceive.proposals.proposal import Proposal, overlap

Floats = NDArray[np.float64]

SHARP = 8.0
"""How much more the better ones' company counts; chosen as the constants of `boxed` and `pointed`."""


def iou(a: Proposal, b: Proposal) -> float:
    """Intersection over union."""
    common = overlap(a, b)
    return common / max(a.area + b.area - common, 1)


def company(forms: Sequence[Proposal], worth: Floats) -> Floats:
    """(n,): logarithm of the mean likeness (IoU) of each to all, those of larger `worth` (n,) weighing more."""
    weight = np.exp(SHARP * (worth - worth.max()))
    low = np.min([one.box[:2] for one in forms], axis=0)
    high = np.max([one.box[2:] for one in forms], axis=0)
    flat = np.zeros((len(forms), int(high[1] - low[1]), int(high[0] - low[0])), np.float32)
    for k, one in enumerate(forms):
        left, top = one.x - int(low[0]), one.y - int(low[1])
        flat[k, top : top + one.mask.shape[0], left : left + one.mask.shape[1]] = one.mask
    rows = flat.reshape(len(forms), -1)
    common = (rows @ rows.T).astype(np.float64)
    area = np.diag(common)
    alike = common / (area[:, None] + area - common)
    return np.asarray(np.log(np.maximum(alike @ weight / weight.sum(), 1e-12)), np.float64)
