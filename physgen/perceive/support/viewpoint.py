"""Side view or top view: cues from the background and the objects.

From the side, the background changes from top to bottom more than from left to right: a wall over a floor, blurred far
away and sharp near by, and the floor faces up. From above, one surface lies all around, and objects lie anywhere,
supported by nothing below them. Every cue adds to the log odds; a mirrored photo gives the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

import cv2
import numpy as np

from physgen.perceive.roles import F32, Labels, Mask, Rgb
from physgen.scene.scene import View

LEAST = 30  # px of background from which a part of the photo counts
SPREAD = 12.0  # CIE 1976 Lab: standard deviation of a background from which its layers count in full
PRIOR = 0.5  # log odds: photos of objects at rest are more often taken from the side


@dataclass(frozen=True)
class _Cue:
    """Log odds per unit of a cue and at most, so that none decides alone; the reasons for either view.

    Weights are round numbers, set by eye on the studio's and the peers' photos. Half or twice one of them decides at
    most one of those 20 otherwise, with true masks or found ones.
    """

    weight: float
    most: float
    side: str = ""
    top: str = ""


CUES = {
    "layered": _Cue(
        4.0, 2.5, "the background changes from top to bottom", "the background has no layers from top to bottom"
    ),
    "faces": _Cue(4.0, 2.5, "what is below faces up", "the surface around the objects faces the camera"),
    "sharp": _Cue(1.0, 1.5, "it is sharper below than above", "it is no sharper below than above"),
    "changed": _Cue(1.0, 1.5, "what is below differs from what is above", "above and below look alike"),
    "aloft": _Cue(0.6, 2.4, top="nothing below holds the objects where they lie"),
    "stands": _Cue(0.4, 1.6, side="objects stand upright or on each other"),
}  # fmt: skip


def guess_view(rgb: Rgb, labels: Labels, normals: F32, aloft: int, stands: int) -> tuple[View, float, str]:
    """The view, its confidence 0.5..0.98, and the two strongest cues.

    `normals` (h, w, 3) unit, +y down, of any size. `aloft`: the number of objects without anything below that holds
    them; `stands`: the number that stand upright on a level foot or on others.
    """
    cues = _background_cues(rgb, labels, normals) | {"aloft": -max(aloft - 2, 0), "stands": stands}
    odds = {k: float(np.clip(CUES[k].weight * v, -CUES[k].most, CUES[k].most)) for k, v in cues.items()}
    total = PRIOR + sum(odds.values())
    side = total >= 0
    agreeing = sorted((k for k in odds if (odds[k] > 0) == side and odds[k]), key=lambda k: -abs(odds[k]))
    reasons = [CUES[k].side if side else CUES[k].top for k in agreeing]
    reason = " and ".join([text for text in reasons if text][:2]) or "there are few cues"
    # the cues are not independent: half the odds
    sure = round(min(1 / (1 + exp(-abs(total) / 2)), 0.98), 2)
    return (View.SIDE if side else View.TOP), sure, reason


def _background_cues(rgb: Rgb, labels: Labels, normals: F32) -> dict[str, float]:
    """Cues for the side view, of the background alone; none where too little of it is seen."""
    h, w = normals.shape[:2]
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    colour: F32 = np.asarray(cv2.resize(lab, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    objects = cv2.resize((labels > 0).astype(np.uint8), (w, h), interpolation=cv2.INTER_AREA)
    free = cv2.dilate(objects, np.ones((5, 5), np.uint8)) == 0
    if np.count_nonzero(free) < LEAST:
        return {}
    low, high = slice(7 * h // 8, h), slice(0, h // 2)
    # shading alone makes weak layers of one surface
    clear = min(1.0, float(np.sqrt(colour[free].var(0).sum())) / SPREAD)
    cues = {"layered": clear * (_explained(colour, free, 1) - _explained(colour, free, 0) - 0.1)}
    if min(np.count_nonzero(free[low]), np.count_nonzero(free[high])) >= LEAST:
        up = -normals[..., 1]
        cues["faces"] = float(up[low][free[low]].mean() - up[high][free[high]].mean()) - 0.1
    thirds = (np.s_[2 * h // 3 :], np.s_[: h // 3], np.s_[:, : w // 3], np.s_[:, 2 * w // 3 :])
    if all(np.count_nonzero(free[part]) >= LEAST for part in thirds):
        below, above, left, right = (np.median(colour[part][free[part]], axis=0) for part in thirds)
        apart = [float(np.linalg.norm((a - b) * (0.5, 1, 1))) for a, b in ((below, above), (left, right))]
        cues["changed"] = log((apart[0] + 3) / (apart[1] + 3)) - 0.2
        detail = np.abs(cv2.Laplacian(cv2.GaussianBlur(colour[..., 0], (0, 0), 1), cv2.CV_32F))
        fine = [float(np.percentile(detail[part][free[part]], 90)) + 1e-3 for part in thirds[:2]]
        cues["sharp"] = log(fine[0] / fine[1])
    return cues


def _explained(colour: F32, free: Mask, axis: int) -> float:
    """Share of the colours' variance that the mean of each row (`axis` 1) or column (0) explains, 0..1.

    A row or column counts where it shows a twentieth of its length of background, 2 px to 5 px.
    """
    count = free.sum(axis)
    known = count >= np.clip(free.shape[axis] / 20, 2, 5)
    if np.count_nonzero(known) < 2:
        return 0.0
    mean = (colour * free[..., None]).sum(axis)[known] / count[known, None]
    middle, total = colour[free].mean(0), colour[free].var(0).sum()
    between = (((mean - middle) ** 2).sum(1) * count[known]).sum() / count[known].sum()
    return float(min(between / max(total, 1e-6), 1.0))
