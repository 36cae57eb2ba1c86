"""Side view or top view, and whether a photo suits: its looks, and cues from the
background and the objects.

How a photo looks as a whole (`view_classifier`) has the most weight.

From the side, the background changes from top to bottom more than from left to right: a
wall over a floor, blurred far away and sharp near by, and the floor faces up. From
above, one surface lies all around, and objects lie anywhere, supported by nothing below
them. Every cue adds to the log odds; a mirrored photo gives the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log

import cv2
import numpy as np

from physgen.maps import F32
from physgen.messages import Note
from physgen.perceive.roles import (
    BoundaryGuess,
    Detections,
    Labels,
    Mask,
    PhotoObject,
    Rgb,
    Suitability,
)
from physgen.perceive.segment.network import run_network
from physgen.perceive.segment.plain_ground import shade_below
from physgen.perceive.segment.prompts import RULE
from physgen.perceive.support.equilibrium import contacts
from physgen.perceive.support.supports import SOURCE
from physgen.perceive.support.view_classifier import ViewChances, view_chances
from physgen.scene.scene import View
from physgen.text import counted, percent

LEAST = 30  # px of background from which a part of the photo counts
# CIE 1976 Lab: standard deviation of a background from which its layers count in full
SPREAD = 12.0
PRIOR = 1.0  # log odds: photos of objects at rest are more often taken from the side


@dataclass(frozen=True)
class _Cue:
    """Log odds per unit of a cue and at most, so that none decides alone; the reasons
    for either view.

    Weights are round numbers, set by eye on the studio's and the peers' photos. Half or
    twice one of them decides at most one of those 20 otherwise, with true masks or
    found ones.
    """

    weight: float
    most: float
    side: str = ""
    top: str = ""


CUES_WEIGHT = 0.5
"""Of the log odds of all cues: they depend on each other."""
BESIDE_LOOKS = 0.5
"""Of what cues tell, if the looks tell something, too: both see the same background."""
DRAWING_COLOURS = 256
"""Colours of a drawing at most; a photo of 100 px a side has thousands."""
MOST_LOOKS = 6.0
"""Log odds of the looks at most: one in 400 labelled photos is seen wrongly for sure.
"""
LOOKS = {
    View.SIDE: "it looks like a photo from the side",
    View.TOP: "it looks like a photo from above",
}
OBLIQUE_LOOKS = "it looks down on the ground at an angle"

CUES = {
    "layered": _Cue(
        4.0, 2.5, "the background changes from top to bottom", "the background has no layers from top to bottom"
    ),
    "faces": _Cue(4.0, 2.5, "what is below faces up", "the surface around the objects faces the camera"),
    "sharp": _Cue(1.0, 1.5, "it is sharper below than above", "it is no sharper below than above"),
    "changed": _Cue(1.0, 1.5, "what is below differs from what is above", "above and below look alike"),
    "aloft": _Cue(0.6, 2.4, top="nothing below holds the objects where they lie"),
    "shade": _Cue(0.5, 5.0, side="plain ground is shaded below the objects alone"),
    "stands": _Cue(0.4, 1.6, side="objects stand upright or on each other"),
}  # fmt: skip


def guess_view(
    rgb: Rgb,
    labels: Labels,
    normals: F32,
    aloft: int,
    stands: int,
    chances: ViewChances | None = None,
) -> tuple[View, float, str]:
    """Return the view, its confidence 0.5..0.98, and the two strongest reasons.

    `normals` (h, w, 3) unit, +y down, of any size. `aloft`: the number of objects
    without anything below that holds them; `stands`: the number that stand upright on a
    level foot or on others. `chances` are those of the photo's looks; without them, the
    cues alone decide.
    """
    cues = _background_cues(rgb, labels, normals) | {
        "aloft": -max(aloft - 2, 0),
        "stands": stands,
        "shade": shade_below(rgb, labels),
    }
    odds = {}
    for name, value in cues.items():
        cue = CUES[name]
        odds[name] = float(np.clip(cue.weight * value, -cue.most, cue.most))
    total = CUES_WEIGHT * (PRIOR + sum(odds.values()))
    reasons = []
    if chances is not None and not _is_drawing(rgb):
        looks = _log_odds(1 - chances.top)
        total = looks + BESIDE_LOOKS * total
        if (looks >= 0) == (total >= 0):
            reasons.append(_looks_reason(chances))
    view = View.SIDE if total >= 0 else View.TOP
    is_side = view is View.SIDE
    agreeing = [name for name, odd in odds.items() if odd and (odd > 0) == is_side]
    for name in sorted(agreeing, key=lambda name: -abs(odds[name])):
        text = CUES[name].side if is_side else CUES[name].top
        if text:
            reasons.append(text)
    reason = " and ".join(reasons[:2]) or "there are few cues"
    sure = round(min(1 / (1 + exp(-abs(total))), 0.98), 2)
    return view, sure, reason


def _is_drawing(rgb: Rgb) -> bool:
    """Return whether a picture has the few colours of a drawing; looks are of photos."""
    packed = rgb.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    return len(np.unique(packed)) <= DRAWING_COLOURS


def _log_odds(chance: float) -> float:
    low = 1 / (1 + exp(MOST_LOOKS))
    chance = min(max(chance, low), 1 - low)
    return log(chance / (1 - chance))


def _looks_reason(chances: ViewChances) -> str:
    if chances.top > 0.5:
        return LOOKS[View.TOP]
    return LOOKS[View.SIDE] if chances.tilt is None else OBLIQUE_LOOKS


def _background_cues(rgb: Rgb, labels: Labels, normals: F32) -> dict[str, float]:
    """Cues for the side view, of the background alone; none where too little of it is
    seen.
    """
    h, w = normals.shape[:2]
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    colour: F32 = np.asarray(
        cv2.resize(lab, (w, h), interpolation=cv2.INTER_AREA), np.float32
    )
    objects = cv2.resize(
        (labels > 0).astype(np.uint8), (w, h), interpolation=cv2.INTER_AREA
    )
    free = cv2.dilate(objects, np.ones((5, 5), np.uint8)) == 0
    if np.count_nonzero(free) < LEAST:
        return {}
    low, high = slice(7 * h // 8, h), slice(0, h // 2)
    # shading alone makes weak layers of one surface
    clear = min(1.0, float(np.sqrt(colour[free].var(0).sum())) / SPREAD)
    cues = {
        "layered": clear
        * (_explained(colour, free, 1) - _explained(colour, free, 0) - 0.1)
    }
    if min(np.count_nonzero(free[low]), np.count_nonzero(free[high])) >= LEAST:
        up = -normals[..., 1]
        cues["faces"] = (
            float(up[low][free[low]].mean() - up[high][free[high]].mean()) - 0.1
        )
    thirds = (
        np.s_[2 * h // 3 :],
        np.s_[: h // 3],
        np.s_[:, : w // 3],
        np.s_[:, 2 * w // 3 :],
    )
    if all(np.count_nonzero(free[part]) >= LEAST for part in thirds):
        below, above, left, right = (
            np.median(colour[part][free[part]], axis=0) for part in thirds
        )
        apart = [
            float(np.linalg.norm((a - b) * (0.5, 1, 1)))
            for a, b in ((below, above), (left, right))
        ]
        cues["changed"] = log((apart[0] + 3) / (apart[1] + 3)) - 0.2
        detail = np.abs(
            cv2.Laplacian(cv2.GaussianBlur(colour[..., 0], (0, 0), 1), cv2.CV_32F)
        )
        fine = [
            float(np.percentile(detail[part][free[part]], 90)) + 1e-3
            for part in thirds[:2]
        ]
        cues["sharp"] = log(fine[0] / fine[1])
    return cues


def _explained(colour: F32, free: Mask, axis: int) -> float:
    """Share of the colours' variance that the mean of each row (`axis` 1) or column (0)
    explains, 0..1.

    A row or column counts where it shows a twentieth of its length of background, 2 px
    to 5 px.
    """
    count = free.sum(axis)
    known = count >= np.clip(free.shape[axis] / 20, 2, 5)
    if np.count_nonzero(known) < 2:
        return 0.0
    mean = (colour * free[..., None]).sum(axis)[known] / count[known, None]
    middle, total = colour[free].mean(0), colour[free].var(0).sum()
    between = (((mean - middle) ** 2).sum(1) * count[known]).sum() / count[known].sum()
    return float(min(between / max(total, 1e-6), 1.0))


@dataclass(frozen=True)
class _Doubts:
    """Where a photo is doubtful; shares are of the photo.

    Chosen on four fifths of 158 photos of COCO, and on 24 that are good, with the
    core's segmentation: of the good ones each leaves out two at most.
    """

    # F that confidences of objects and doubtful regions state; chosen on 80 photos
    expected: float = 0.66
    unsure: float = 0.65  # confidence of an object; a third of such are none
    unclear: float = 0.1  # doubtful regions, where they cover more than the objects do
    fixed: float = 0.1  # wholes that nobody moves
    # of what is pointed at: 187 of 192 people of COCO, 3 of 31 cups and bowls
    pointed: float = 0.5
    # in the upper half; this and the next two of what is around the objects
    sky: float = 0.125
    foliage: float = 0.1
    detail: float = 0.4  # fine detail: clutter, crowds, gravel
    view: float = 0.6  # confidence of the view
    unsuitable: float = 0.95  # that it shows nothing loose at rest, by its looks
    unheld: float = 0.5  # of the objects, under which nothing is seen
    filling: float = 0.6  # one object, as large as the largest that is looked for
    side: int = 256  # px, the photo's width as its texture is judged
    patch: int = 9  # px, over which detail is averaged
    fine: float = 12.0  # mean of |Laplacian|, 8-bit codes, of a patch of fine detail
    coarse: float = 16.0  # the same at a quarter of the size: grain of a wall has less
    quarter: int = 4  # px of a photo that are one of it there


DOUBTS = _Doubts()


def judge_suitability(
    rgb: Rgb,
    found: Detections,
    objects: Sequence[PhotoObject],
    boundaries: BoundaryGuess,
) -> Suitability:
    """Reasons to doubt that the photo shows loose objects at rest, from what perception
    knows of it.

    Masks that the user gave are sure, and so are those that are kept.
    """
    size, view = (
        np.bincount(found.labels.ravel(), minlength=1) / found.labels.size,
        boundaries.confidence,
    )
    area = {t.id: float(size[t.id]) for t in objects}
    by_hand = found.source in ("given", "pointed at")
    reasons = [] if by_hand else _detection_doubts(found, objects, area)
    if found.source != "given":  # pointing at an object does not change its street
        reasons += _photo_doubts(rgb, found)
    fixed = _immovable(rgb)
    own = cv2.resize((found.labels > 0).astype(np.float32), fixed.shape[::-1])
    if by_hand and (own * fixed).sum() > DOUBTS.pointed * own.sum():
        reasons.append(Note.MARKED_IMMOVABLE.text())
    if any(found.confidence[i] < RULE.weak for i in found.prompts):
        reasons.append(Note.MARKED_FAINT.text())
    if (largest := max(area.values(), default=0.0)) > DOUBTS.filling:
        reasons.append(Note.FILLS_PHOTO.text(share=percent(largest)))
    loose = [t for t in objects if not t.cut]
    unseen = [
        w
        for w in boundaries.walls
        if w.source == SOURCE and w.name.startswith(("nest", "ledge"))
    ]
    on = contacts([t.outline for t in loose], [np.array(w.points) for w in unseen])
    beneath = boundaries.held | {loose[c.body].id for c in on if c.other < 0}
    unheld = sum(t.id in beneath for t in loose)
    # at an angle, the ground is seen around what stands on it
    is_ground_visible = boundaries.tilt is not None
    if unheld > DOUBTS.unheld * len(loose) and not is_ground_visible:
        every = counted(len(loose), "object")
        reasons.append(Note.NO_SUPPORT.text(count=unheld, objects=every))
    if view < DOUBTS.view:
        reasons.append(Note.VIEW_UNCERTAIN.text())
    return Suitability(tuple(reasons))


def _small_photo(rgb: Rgb) -> Rgb:
    """Return the photo (h, DOUBTS.side, 3) at the size at which texture is judged."""
    height = max(round(DOUBTS.side * rgb.shape[0] / rgb.shape[1]), 2)
    small = cv2.resize(rgb, (DOUBTS.side, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def fine_detail(rgb: Rgb) -> Mask:
    """Return where a photo shows fine detail, (h, DOUBTS.side): clutter, crowds,
    gravel.
    """
    grey = cv2.cvtColor(_small_photo(rgb), cv2.COLOR_RGB2GRAY).astype(np.float32)
    detail = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
    return np.asarray(cv2.blur(detail, (DOUBTS.patch, DOUBTS.patch)) > DOUBTS.fine)


def coarse_detail(rgb: Rgb) -> Mask:
    """Return where a photo shows detail at a quarter of the size, as `fine_detail`.

    Objects and their edges remain there; the grain of a plain wall averages out.
    """
    grey = cv2.cvtColor(_small_photo(rgb), cv2.COLOR_RGB2GRAY).astype(np.float32)
    height, width = grey.shape
    size = max(width // DOUBTS.quarter, 1), max(height // DOUBTS.quarter, 1)
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    patch = DOUBTS.patch // DOUBTS.quarter | 1
    detail = cv2.blur(np.abs(cv2.Laplacian(small, cv2.CV_32F)), (patch, patch))
    return np.asarray(cv2.resize(detail, (width, height)) > DOUBTS.coarse)


def _immovable(rgb: Rgb) -> Mask:
    """(h, w), of the network's size: where it sees people, animals, furniture or the
    like.
    """
    seen = run_network(rgb)
    return np.asarray((seen.foreground >= 0.5) & (seen.movable < 0.5))


def _detection_doubts(
    found: Detections, objects: Sequence[PhotoObject], area: Mapping[int, float]
) -> list[str]:
    """Return the doubts about what was found."""
    reasons, right = [], sum(found.confidence.get(t.id, 1.0) for t in objects)
    true = right + sum(doubt.confidence for doubt in found.doubtful)
    if 2 * right <= DOUBTS.expected * (len(objects) + true):
        reasons.append(Note.FEW_SURE_OBJECTS.text())
    unclear = np.zeros(found.labels.shape, np.uint8)
    for doubt in found.doubtful:
        cv2.fillPoly(unclear, [np.rint(doubt.polygon).astype(np.int32)], 1)
    share = float(((unclear > 0) & (found.labels == 0)).mean())
    if share > max(DOUBTS.unclear, sum(area.values())):
        reasons.append(Note.MAY_BE_OBJECTS.text(share=percent(share)))
    return reasons


def _photo_doubts(rgb: Rgb, found: Detections) -> list[str]:
    """Return the doubts about what does not move, and the texture around objects."""
    reasons: list[str] = []
    if view_chances(run_network(rgb).features).unsuitable > DOUBTS.unsuitable:
        reasons.append(Note.NO_LOOSE_OBJECTS.text())
    fixed = float(_immovable(rgb).mean())
    if fixed >= DOUBTS.fixed:
        reasons.append(Note.IMMOVABLE.text(share=percent(fixed)))
    small = _small_photo(rgb)
    detailed = fine_detail(rgb)
    hue, saturation, value = np.moveaxis(
        cv2.cvtColor(small, cv2.COLOR_RGB2HSV).astype(int), 2, 0
    )
    # hues in steps of 2 degrees
    blue = (hue > 90) & (hue < 130) & (saturation > 30) & (value > 110)
    green = (hue > 25) & (hue < 90) & (saturation > 40)
    blue[len(blue) // 2 :] = False
    around = (
        cv2.resize(found.labels, small.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        == 0
    )
    for note, part, most in (
        (Note.LIKE_SKY, blue, DOUBTS.sky),
        (Note.LIKE_FOLIAGE, green & detailed, DOUBTS.foliage),
        (Note.CLUTTERED, detailed & coarse_detail(rgb), DOUBTS.detail),
    ):
        share = np.count_nonzero(part & around) / max(int(around.sum()), 1)
        if share > most:
            return [*reasons, note.text(share=percent(share))]
    return reasons
