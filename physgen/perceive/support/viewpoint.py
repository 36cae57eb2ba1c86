"""Side view or top view: cues from the background and the objects."""

from __future__ import annotations

from math import exp, log
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Labels, Rgb
from physgen.scene.scene import View

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

LEAST = 30
"""Pixels of background from which a part of the photo tells anything."""
FEWEST, MOST_NEEDED = 2, 5
"""Pixels of background that a row or column must show for its mean to tell anything."""
SPREAD = 12.0
"""CIE 1976 Lab: standard deviation of a background from which its layers count in full."""
PRIOR = 0.5
"""Log odds: photos of things that rest are more often taken from the side."""
LAYERED, FACING, SHARP, CHANGED, ALOFT, STANDS = 4.0, 4.0, 1.0, 1.0, 0.6, 0.4
"""Log odds that a unit of each cue adds: round numbers, set by eye on the studio's and the peers' photos. Half or twice
one of them decides at most one of those 20 otherwise, with true masks or found ones."""
MOST = {"layered": 2.5, "faces": 2.5, "sharp": 1.5, "changed": 1.5, "aloft": 2.4, "stands": 1.6}
"""Log odds that one cue gives at most, so that none decides alone against all others."""
CUE_REASONS = {
    "layered": (
        "the background changes from top to bottom",
        "the background has no layers from top to bottom",
    ),
    "faces": ("what is below faces up", "the surface around the things faces the camera"),
    "sharp": ("it is sharper below than above", "it is no sharper below than above"),
    "changed": ("what is below differs from what is above", "above and below look alike"),
    "aloft": ("", "nothing below holds the things where they lie"),
    "stands": ("things stand upright or on each other", ""),
}


def guess_view(rgb: Rgb, labels: Labels, normals: F32, aloft: int, stands: int) -> tuple[View, float, str]:
    """The view, 0.5..0.98 how sure, and the two cues that tell most.

    `normals` (h, w, 3) unit, +y down, of any size. `aloft`: how many things have nothing below them that holds them;
    `stands`: how many stand upright on a level foot or on others.
    """
    odds = {k: float(np.clip(v, -MOST[k], MOST[k])) for k, v in _cues(rgb, labels, normals).items()}
    odds["aloft"] = -min(ALOFT * max(aloft - 2, 0), MOST["aloft"])
    odds["stands"] = min(STANDS * stands, MOST["stands"])
    total = PRIOR + sum(odds.values())
    side = total >= 0
    told = sorted((k for k in odds if (odds[k] > 0) == side and odds[k]), key=lambda k: -abs(odds[k]))
    said = [CUE_REASONS[k][0 if side else 1] for k in told if CUE_REASONS[k][0 if side else 1]][:2]
    reason = " and ".join(said) or "there is little to tell by"
    # the cues are not independent: half the odds
    sure = round(min(1 / (1 + exp(-abs(total) / 2)), 0.98), 2)
    return (View.SIDE if side else View.TOP), sure, reason


def _cues(rgb: Rgb, labels: Labels, normals: F32) -> dict[str, float]:
    """Log odds for the side, of the background alone; 0 where too little of it is seen."""
    h, w = normals.shape[:2]
    colour = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    colour = np.asarray(cv2.resize(colour, (w, h), interpolation=cv2.INTER_AREA), np.float32)
    things = cv2.resize((labels > 0).astype(np.uint8), (w, h), interpolation=cv2.INTER_AREA)
    free = cv2.dilate(things, np.ones((5, 5), np.uint8)) == 0
    if np.count_nonzero(free) < LEAST:
        return {}
    low, high = slice(7 * h // 8, h), slice(0, h // 2)
    # shading alone makes weak layers of one surface
    clear = min(1.0, float(np.sqrt(colour[free].var(0).sum())) / SPREAD)
    cues = {"layered": clear * LAYERED * (_told_by(colour, free, 1) - _told_by(colour, free, 0) - 0.1)}
    if min(np.count_nonzero(free[low]), np.count_nonzero(free[high])) >= LEAST:
        up = -normals[..., 1]
        cues["faces"] = FACING * (float(up[low][free[low]].mean() - up[high][free[high]].mean()) - 0.1)
    thirds = (np.s_[2 * h // 3 :], np.s_[: h // 3], np.s_[:, : w // 3], np.s_[:, 2 * w // 3 :])
    if all(np.count_nonzero(free[part]) >= LEAST for part in thirds):
        below, above, left, right = (np.median(colour[part][free[part]], axis=0) for part in thirds)
        apart = [float(np.linalg.norm((a - b) * (0.5, 1, 1))) for a, b in ((below, above), (left, right))]
        cues["changed"] = CHANGED * (log((apart[0] + 3) / (apart[1] + 3)) - 0.2)
        detail = np.abs(cv2.Laplacian(cv2.GaussianBlur(colour[..., 0], (0, 0), 1), cv2.CV_32F))
        fine = [float(np.percentile(detail[part][free[part]], 90)) + 1e-3 for part in thirds[:2]]
        cues["sharp"] = SHARP * log(fine[0] / fine[1])
    return cues


def _told_by(colour: NDArray[Any], free: Mask, axis: int) -> float:
    """Part of the colours' variance that each row (`axis` 1) or column (0) of its own mean explains, 0..1.

    0 where no row, or column, shows enough of the background to have a mean: a twentieth of it, 2 px to 5 px.
    """
    count = free.sum(axis)
    known = count >= np.clip(free.shape[axis] / 20, FEWEST, MOST_NEEDED)
    if np.count_nonzero(known) < 2:
        return 0.0
    mean = (colour * free[..., None]).sum(axis)[known] / count[known, None]
    middle, total = colour[free].mean(0), colour[free].var(0).sum()
    between = (((mean - middle) ** 2).sum(1) * count[known]).sum() / count[known].sum()
    return float(min(between / max(total, 1e-6), 1.0))
