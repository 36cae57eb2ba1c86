"""Side view or top view, and the suitability of a photo.

The looks of the whole photo (`view_classifier`) have the most weight; cues from the
background and the objects are added. From the side, the background changes more from
top to bottom than from left to right: a wall above a floor, blurred far away and sharp
nearby, and the floor faces up. From above, one surface surrounds all objects, and they
lie anywhere, without supports below them. Every cue adds to the log odds; a mirrored
photo gives the same result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log

import cv2
import numpy as np
from numpy.typing import NDArray

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

LEAST = 30
"""Least px of background in a part of the photo with a cue."""
SPREAD = 12.0
"""CIE 1976 Lab: standard deviation of a background with full weight of its layers."""
PRIOR = 1.0
"""Log odds: photos of objects at rest are more often taken from the side."""


@dataclass(frozen=True)
class _Cue:
    """Log odds per unit of a cue, their limit, and the reasons for either view.

    The limit prevents that a single cue decides. Weights are round numbers, set by eye
    on the studio's and the peers' photos. Half or twice one of them changes at most one
    of those 20 decisions, with true or predicted masks.
    """

    weight: float
    limit: float
    side: str = ""
    top: str = ""


CUES_WEIGHT = 0.5
"""Factor of the log odds of all cues, since they depend on each other."""
BESIDE_LOOKS = 0.5
"""Factor of the cues beside the looks, since both use the same background."""
DRAWING_COLOURS = 256
"""Largest number of colours of a drawing; a photo of 100 px a side has thousands."""
MOST_LOOKS = 6.0
"""Largest log odds of the looks: one in 400 labelled photos gets a confident wrong
view.
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

    `normals` (h, w, 3) are unit, +y down, of any size. `aloft` is the number of objects
    without a visible support; `stands` is the number of objects that stand upright on a
    level foot or on others. `chances` come from the photo's looks; without them, the
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
        odds[name] = float(np.clip(cue.weight * value, -cue.limit, cue.limit))
    total = CUES_WEIGHT * (PRIOR + sum(odds.values()))
    reasons = []
    if chances is not None and not _is_drawing(rgb):
        looks = _log_odds(1 - chances.top)
        total = looks + BESIDE_LOOKS * total
        if (looks >= 0) == (total >= 0):
            reasons.append(_looks_reason(chances))
    if total >= 0:
        view = View.SIDE
    else:
        view = View.TOP
    is_side = view is View.SIDE
    agreeing = []
    for name, log_odds in odds.items():
        if log_odds and (log_odds > 0) == is_side:
            agreeing.append(name)
    for name in sorted(agreeing, key=lambda name: -abs(odds[name])):
        if is_side:
            text = CUES[name].side
        else:
            text = CUES[name].top
        if text:
            reasons.append(text)
    reason = " and ".join(reasons[:2]) or "there are few cues"
    confidence = round(min(1 / (1 + exp(-abs(total))), 0.98), 2)
    return view, confidence, reason


def _is_drawing(rgb: Rgb) -> bool:
    """Return whether a picture has the few colours of a drawing.

    The looks are learnt from photos and say nothing about drawings.
    """
    # A few pixels of a photo have too many colours already; only drawings need all.
    samples = rgb[::8, ::8]
    return all(_count_colours(part) <= DRAWING_COLOURS for part in (samples, rgb))


def _count_colours(rgb: Rgb) -> int:
    codes = rgb.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    return len(np.unique(codes))


def _log_odds(chance: float) -> float:
    low = 1 / (1 + exp(MOST_LOOKS))
    chance = min(max(chance, low), 1 - low)
    return log(chance / (1 - chance))


def _looks_reason(chances: ViewChances) -> str:
    if chances.top > 0.5:
        return LOOKS[View.TOP]
    if chances.tilt is None:
        return LOOKS[View.SIDE]
    return OBLIQUE_LOOKS


@dataclass(frozen=True, eq=False)
class _Background:
    """The visible background of a photo at the size of the network's normals."""

    # (h, w, 3) CIE Lab.
    colour: F32
    # (h, w): pixels away from objects.
    free: Mask

    def is_visible_in(self, *parts: tuple[slice, ...]) -> bool:
        """Return whether enough background is visible in each part."""
        return all(np.count_nonzero(self.free[part]) >= LEAST for part in parts)

    def median_colour(self, part: tuple[slice, ...]) -> NDArray[np.floating]:
        """Return the median colour (3,) of a part."""
        return np.asarray(np.median(self.colour[part][self.free[part]], axis=0))


def _background_cues(rgb: Rgb, labels: Labels, normals: F32) -> dict[str, float]:
    """Return the cues of the background for the side view, if enough of it is
    visible.
    """
    height, width = normals.shape[:2]
    background = _shrink_background(rgb, labels, (width, height))
    if np.count_nonzero(background.free) < LEAST:
        return {}
    cues = {"layered": _measure_layers(background)}
    low = np.s_[7 * height // 8 : height,]
    high = np.s_[0 : height // 2,]
    if background.is_visible_in(low, high):
        upward = -normals[..., 1]
        free = background.free
        difference = upward[low][free[low]].mean() - upward[high][free[high]].mean()
        cues["faces"] = float(difference) - 0.1
    bottom = np.s_[2 * height // 3 :,]
    top = np.s_[: height // 3,]
    left = np.s_[:, : width // 3]
    right = np.s_[:, 2 * width // 3 :]
    if background.is_visible_in(bottom, top, left, right):
        vertical = _compare_colours(background, bottom, top)
        horizontal = _compare_colours(background, left, right)
        cues["changed"] = log((vertical + 3) / (horizontal + 3)) - 0.2
        cues["sharp"] = _compare_detail(background, bottom, top)
    return cues


def _shrink_background(rgb: Rgb, labels: Labels, size: tuple[int, int]) -> _Background:
    """Return the background of a photo at a size (width, height)."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    colour = np.asarray(cv2.resize(lab, size, interpolation=cv2.INTER_AREA), np.float32)
    objects = cv2.resize(
        (labels > 0).astype(np.uint8), size, interpolation=cv2.INTER_AREA
    )
    return _Background(colour, cv2.dilate(objects, np.ones((5, 5), np.uint8)) == 0)


def _measure_layers(background: _Background) -> float:
    """Return the cue of layers: rows explain more of the colours than columns."""
    colour = background.colour
    free = background.free
    # Shading alone makes weak layers on a single surface.
    weight = min(1.0, float(np.sqrt(colour[free].var(0).sum())) / SPREAD)
    row_share = _measure_explained_variance(colour, free, 1)
    column_share = _measure_explained_variance(colour, free, 0)
    return weight * (row_share - column_share - 0.1)


def _compare_colours(
    background: _Background, first: tuple[slice, ...], second: tuple[slice, ...]
) -> float:
    """Return the difference of the colours of two parts; hue counts more."""
    difference = background.median_colour(first) - background.median_colour(second)
    return float(np.linalg.norm(difference * (0.5, 1, 1)))


def _compare_detail(
    background: _Background, first: tuple[slice, ...], second: tuple[slice, ...]
) -> float:
    """Return the log ratio of the detail of two parts."""
    smooth = cv2.GaussianBlur(background.colour[..., 0], (0, 0), 1)
    detail = np.abs(cv2.Laplacian(smooth, cv2.CV_32F))

    def strongest_detail(part: tuple[slice, ...]) -> float:
        free_detail = detail[part][background.free[part]]
        return float(np.percentile(free_detail, 90)) + 1e-3

    return log(strongest_detail(first) / strongest_detail(second))


def _measure_explained_variance(colour: F32, free: Mask, axis: int) -> float:
    """Return the share of colour variance that row means (`axis` 1) or column means (0)
    explain.

    A row or column counts if it shows background over a twentieth of its length, 2 px
    to 5 px.
    """
    count = free.sum(axis)
    is_valid = count >= np.clip(free.shape[axis] / 20, 2, 5)
    if np.count_nonzero(is_valid) < 2:
        return 0.0
    mean = (colour * free[..., None]).sum(axis)[is_valid] / count[is_valid, None]
    middle = colour[free].mean(0)
    total = colour[free].var(0).sum()
    explained = (((mean - middle) ** 2).sum(1) * count[is_valid]).sum() / count[
        is_valid
    ].sum()
    return float(min(explained / max(total, 1e-6), 1.0))


@dataclass(frozen=True)
class _Doubts:
    """Thresholds of doubts; shares are of the photo.

    They were chosen on four fifths of 158 COCO photos and on 24 good ones, with the
    default segmentation: each excludes at most two of the good photos.
    """

    # F measure expected from the confidences of objects and doubtful regions; chosen on
    # 80 photos.
    f_measure: float = 0.66
    # Confidence of an object; below it a third of the objects are wrong.
    object_confidence: float = 0.65
    # Share of doubtful regions larger than the objects.
    unclear: float = 0.1
    # Share of immovable wholes.
    immovable: float = 0.1
    # Share of immovable pixels in the user's selection: holds for 187 of 192 people of
    # COCO and for 3 of 31 cups and bowls.
    immovable_selection: float = 0.5
    # Share of sky in the upper half. This share and the next two are relative to the
    # surroundings of the objects.
    sky: float = 0.125
    foliage: float = 0.1
    # Share of fine detail: clutter, crowds, gravel.
    detail: float = 0.4
    # Confidence of the view.
    view: float = 0.6
    # Probability, by its looks, that the photo shows no loose object at rest.
    unsuitable: float = 0.95
    # Share of objects without a visible support.
    no_support: float = 0.5
    # Share of one object: the largest object of the search.
    filling: float = 0.6
    # px: width of the photo for texture.
    side: int = 256
    # px: side of the patch over which detail is averaged.
    patch: int = 9
    # Mean of |Laplacian|, 8-bit levels, of a patch with fine detail.
    fine_detail: float = 12.0
    # The same at a quarter of the size; the grain of a wall has less.
    coarse_detail: float = 16.0
    # Ratio of the photo's size and the reduced size.
    quarter: int = 4


DOUBTS = _Doubts()


def judge_suitability(
    rgb: Rgb,
    detections: Detections,
    objects: Sequence[PhotoObject],
    boundaries: BoundaryGuess,
) -> Suitability:
    """Return the reasons to doubt that the photo shows loose objects at rest.

    Masks from the user, and masks kept from an earlier scene, are certain.
    """
    labels = detections.labels
    shares = np.bincount(labels.ravel(), minlength=1) / labels.size
    area = {t.id: float(shares[t.id]) for t in objects}
    by_hand = detections.source in ("given", "pointed at")
    if by_hand:
        reasons = []
    else:
        reasons = _detection_doubts(detections, objects, area)
    # A selection by the user does not change the rest of the photo.
    if detections.source != "given":
        reasons += _photo_doubts(rgb, detections)
    if by_hand and _shows_immovable(rgb, labels):
        reasons.append(Note.MARKED_IMMOVABLE.text())
    if any(detections.confidence[i] < RULE.weak_confidence for i in detections.prompts):
        reasons.append(Note.MARKED_FAINT.text())
    largest = max(area.values(), default=0.0)
    if largest > DOUBTS.filling:
        reasons.append(Note.FILLS_PHOTO.text(share=percent(largest)))
    loose_objects = []
    for t in objects:
        if not t.cut:
            loose_objects.append(t)
    count = _count_without_support(loose_objects, boundaries)
    # In an oblique photo the ground around an object is visible.
    is_ground_visible = boundaries.tilt is not None
    if count > DOUBTS.no_support * len(loose_objects) and not is_ground_visible:
        all_objects = counted(len(loose_objects), "object")
        reasons.append(Note.NO_SUPPORT.text(count=count, objects=all_objects))
    if boundaries.confidence < DOUBTS.view:
        reasons.append(Note.VIEW_UNCERTAIN.text())
    return Suitability(tuple(reasons))


def _shows_immovable(rgb: Rgb, labels: Labels) -> bool:
    """Return whether most pixels of the objects belong to immovable things."""
    immovable = _immovable(rgb)
    coverage = cv2.resize((labels > 0).astype(np.float32), immovable.shape[::-1])
    immovable_sum = (coverage * immovable).sum()
    return bool(immovable_sum > DOUBTS.immovable_selection * coverage.sum())


def _count_without_support(
    objects: Sequence[PhotoObject], boundaries: BoundaryGuess
) -> int:
    """Return the number of objects that are held or that invisible walls carry."""
    invisible_walls = []
    for w in boundaries.walls:
        if w.source == SOURCE and w.name.startswith(("nest", "ledge")):
            invisible_walls.append(w)
    support_contacts = contacts(
        [t.outline for t in objects], [np.array(w.points) for w in invisible_walls]
    )
    ids = set()
    for c in support_contacts:
        if c.other < 0:
            ids.add(objects[c.body].id)
    return sum(t.id in boundaries.held_ids | ids for t in objects)


def _small_photo(rgb: Rgb) -> Rgb:
    """Return the photo (h, DOUBTS.side, 3) at the size for texture."""
    height = max(round(DOUBTS.side * rgb.shape[0] / rgb.shape[1]), 2)
    small = cv2.resize(rgb, (DOUBTS.side, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def fine_detail(rgb: Rgb) -> Mask:
    """Return the pixels (h, DOUBTS.side) with fine detail: clutter, crowds, gravel."""
    grey = cv2.cvtColor(_small_photo(rgb), cv2.COLOR_RGB2GRAY).astype(np.float32)
    detail = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
    return np.asarray(
        cv2.blur(detail, (DOUBTS.patch, DOUBTS.patch)) > DOUBTS.fine_detail
    )


def coarse_detail(rgb: Rgb) -> Mask:
    """Return the pixels with detail at a quarter of the size, as `fine_detail`.

    Objects and their edges remain at that size; the grain of a plain wall averages out.
    """
    grey = cv2.cvtColor(_small_photo(rgb), cv2.COLOR_RGB2GRAY).astype(np.float32)
    height, width = grey.shape
    size = max(width // DOUBTS.quarter, 1), max(height // DOUBTS.quarter, 1)
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    patch = DOUBTS.patch // DOUBTS.quarter | 1
    detail = cv2.blur(np.abs(cv2.Laplacian(small, cv2.CV_32F)), (patch, patch))
    return np.asarray(cv2.resize(detail, (width, height)) > DOUBTS.coarse_detail)


def _immovable(rgb: Rgb) -> Mask:
    """Return the pixels (h, w) of people, animals, furniture and the like, by the
    network.
    """
    prediction = run_network(rgb)
    return np.asarray((prediction.foreground >= 0.5) & (prediction.movable < 0.5))


def _detection_doubts(
    detections: Detections, objects: Sequence[PhotoObject], area: Mapping[int, float]
) -> list[str]:
    """Return the doubts about the detections."""
    reasons = []
    right = sum(detections.confidence.get(t.id, 1.0) for t in objects)
    # Confidences are probabilities: their sum is the expected number of true objects.
    true = right + sum(doubt.confidence for doubt in detections.doubtful)
    if 2 * right <= DOUBTS.f_measure * (len(objects) + true):
        reasons.append(Note.FEW_SURE_OBJECTS.text())
    unclear = np.zeros(detections.labels.shape, np.uint8)
    for doubt in detections.doubtful:
        cv2.fillPoly(unclear, [np.rint(doubt.polygon).astype(np.int32)], 1)
    share = float(((unclear > 0) & (detections.labels == 0)).mean())
    if share > max(DOUBTS.unclear, sum(area.values())):
        reasons.append(Note.MAY_BE_OBJECTS.text(share=percent(share)))
    return reasons


def _photo_doubts(rgb: Rgb, detections: Detections) -> list[str]:
    """Return the doubts about immovable content and the texture around objects."""
    reasons: list[str] = []
    if view_chances(run_network(rgb).features).unsuitable > DOUBTS.unsuitable:
        reasons.append(Note.NO_LOOSE_OBJECTS.text())
    immovable_share = float(_immovable(rgb).mean())
    if immovable_share >= DOUBTS.immovable:
        reasons.append(Note.IMMOVABLE.text(share=percent(immovable_share)))
    small = _small_photo(rgb)
    detail_mask = fine_detail(rgb)
    hue, saturation, value = np.moveaxis(
        cv2.cvtColor(small, cv2.COLOR_RGB2HSV).astype(int), 2, 0
    )
    # OpenCV's hues have steps of 2 degrees.
    blue = (hue > 90) & (hue < 130) & (saturation > 30) & (value > 110)
    green = (hue > 25) & (hue < 90) & (saturation > 40)
    blue[len(blue) // 2 :] = False
    surroundings = (
        cv2.resize(
            detections.labels, small.shape[1::-1], interpolation=cv2.INTER_NEAREST
        )
        == 0
    )
    for note, part, limit in (
        (Note.LIKE_SKY, blue, DOUBTS.sky),
        (Note.LIKE_FOLIAGE, green & detail_mask, DOUBTS.foliage),
        (Note.CLUTTERED, detail_mask & coarse_detail(rgb), DOUBTS.detail),
    ):
        share = np.count_nonzero(part & surroundings) / max(int(surroundings.sum()), 1)
        if share > limit:
            return [*reasons, note.text(share=percent(share))]
    return reasons
