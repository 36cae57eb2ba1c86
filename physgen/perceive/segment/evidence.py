"""Numbers that tell how well a candidate fits an object: what the judge reads.

Candidates lie on the grid of the segmentation network's output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.detector import DetectedBoxes, box_overlap
from physgen.perceive.segment.network import F32, OFFSETS, NetworkMaps
from physgen.perceive.segment.proposals import Mask, Proposal, outline

Array = NDArray[np.float64]

MAP_FEATURES = (
    "foreground", "foreground, weakest tenth", "foreground around", "border along the rim",
    "border along its weakest quarter", "border inside", "border inside, strongest fiftieth",
    "together, near", "together, farther", "together, far", "with others, near", "with others, farther",
    "with others, far", "log size", "cut by the photo", "solidity", "compactness", "facing the viewer",
    "movable", "share of its box",
)  # fmt: skip
"""From the network's maps and the mask."""
COLOUR_FEATURES = (
    "colours that go on around", "colour step at the rim", "edge along the rim",
    "edge along its weakest quarter", "edge inside",
)  # fmt: skip
"""From the photo's own colours and edges."""
BOX_FEATURES = (
    "box overlap", "movable box", "immovable box", "class score", "person", "animal",
    "furniture", "vehicle", "movable in proportion", "immovable in proportion",
    "movable whole around", "immovable whole around", "share of the whole",
    "best part inside", "parts inside", "rank", "best in the photo", "likely in the photo",
    "others alike",
)  # fmt: skip
"""From the detector's boxes: of the best matching box, of larger and of smaller ones."""
FEATURES = (*MAP_FEATURES, *COLOUR_FEATURES, *BOX_FEATURES)
CONTEXT_FEATURES = (
    "first fit", "best candidate inside", "best candidate around", "share in parts",
    "number of parts", "best rival", "fitting others alike",
)  # fmt: skip
"""From a first judgement of all candidates: wholes against their parts and piles."""

RANGES = (range(0, 2), range(2, 6), range(6, 8))
"""Indices of OFFSETS: near, farther and far pairs."""
SURROUNDINGS = 3  # px of the grid around a candidate that count as its surroundings
PERSON = (0,)
ANIMALS = tuple(range(14, 24))
FURNITURE = (13, 56, 57, 59, 60, 61)
VEHICLES = tuple(range(1, 9))
"""Numbers of COCO's classes."""
WITHIN = 0.85  # share of a box within another from which it is a part of it
LARGER = 1.5  # times as large as a part, at least, is a whole
LIKELY = 0.3  # score of a movable whole from which a box is likely one
COLOUR_STEPS = 2**14
"""Of lightness, and of both hues: 16 x 32 x 32."""
SAME_SIZE = 0.15  # logarithm of a side: so far apart, two candidates are hardly alike
APART = 0.1  # IoU of their boxes below which two candidates are apart
MOST_ALIKE = 6.0  # more of a kind tell no more
PART = 0.7  # of a whole's area: a part is smaller
GOOD_PART = 0.35  # first fit from which a part counts
COMMON = 0.25  # share of the smaller box from which two parts are one
RIVAL = 0.25  # IoU of boxes from which two candidates are rivals
RARER = 3.0  # times a colour may be rarer around a candidate and still go on there


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of a photo when its candidates are judged."""

    seen: NetworkMaps
    colours: NDArray[np.int64]  # (h, w): the photo's colour on the grid, in steps
    lab: F32  # (h, w, 3): the same in CIELAB
    edges: F32  # (h, w) 0..1: how far the strongest edge there stands out of the noise
    boxes: DetectedBoxes
    corners: Array  # (n, 4): the boxes on the grid

    @cached_property
    def wide_edges(self) -> F32:
        """(h, w): the strongest edge of each cell and its neighbours."""
        return np.asarray(cv2.dilate(self.edges, np.ones((3, 3), np.uint8)), np.float32)


def gather_evidence(
    rgb: NDArray[np.uint8], seen: NetworkMaps, boxes: DetectedBoxes
) -> Evidence:
    """Return the evidence of a photo (H, W, 3) sRGB."""
    height, width = seen.foreground.shape
    lab = _small_lab(rgb, (height, width))
    colours = colour_steps(rgb, (height, width))
    scale = np.tile([width / rgb.shape[1], height / rgb.shape[0]], 2)
    edges = find_edges(rgb, (height, width))
    corners = boxes.corners * scale
    return Evidence(seen, colours, lab.astype(np.float32), edges, boxes, corners)


def colour_steps(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.int64]:
    """Return the photo's colours in steps, below COLOUR_STEPS, on a grid (h, w)."""
    steps = _small_lab(rgb, shape).astype(np.int64) // (16, 8, 8)
    return np.asarray((steps[..., 0] * 32 + steps[..., 1]) * 32 + steps[..., 2])


def _small_lab(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the smoothed photo on a grid of `shape` (h, w), in CIELAB codes."""
    small = cv2.resize(rgb, shape[::-1], interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.0)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2LAB), np.uint8)


def find_edges(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> F32:
    """Return the strength 0..1 of the photo's edges on a grid of `shape` (h, w).

    Edges are found on a grid twice as fine, and the strongest of four cells stays.
    """
    height, width = shape
    fine = cv2.resize(rgb, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
    fine = cv2.GaussianBlur(fine, (0, 0), 0.8)
    lab = cv2.cvtColor(fine.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    across = cv2.Sobel(lab, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(lab, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    strength = np.sqrt((across**2 + down**2).sum(axis=2))
    noise = max(0.25, float(np.median(strength)))
    strongest = strength.reshape(height, 2, width, 2).max(axis=(1, 3))
    return np.asarray(strongest / (strongest + 3 * noise + 1), np.float32)


def judge_features(candidates: Sequence[Proposal], evidence: Evidence) -> Array:
    """Return (n, len(FEATURES)) for candidates on the network's grid."""
    if not candidates:
        return np.zeros((0, len(FEATURES)))
    maps = map_features(candidates, evidence.seen)
    colours = [_colour_features(candidate, evidence) for candidate in candidates]
    boxes = box_features(candidates, evidence)
    return np.hstack([maps, np.array(colours), boxes])


def map_features(candidates: Sequence[Proposal], seen: NetworkMaps) -> Array:
    """Return (n, len(MAP_FEATURES))."""
    rim = np.asarray(cv2.dilate(seen.boundary, np.ones((3, 3), np.uint8)), np.float32)
    reach = max(max(abs(down), abs(right)) for down, right in OFFSETS)
    return np.array(
        [_map_features(candidate, seen, rim, reach) for candidate in candidates]
    )


def _map_features(
    candidate: Proposal, seen: NetworkMaps, rim: F32, reach: int
) -> list[float]:
    height, width = seen.foreground.shape
    left, top, right, bottom = candidate.box
    x0, y0 = max(left - reach, 0), max(top - reach, 0)
    box = np.s_[y0 : min(bottom + reach, height), x0 : min(right + reach, width)]
    mask = np.zeros(seen.foreground[box].shape, bool)
    mask[top - y0 : bottom - y0, left - x0 : right - x0] = candidate.mask
    near = np.s_[
        max(top - SURROUNDINGS - y0, 0) : bottom + SURROUNDINGS - y0,
        max(left - SURROUNDINGS - x0, 0) : right + SURROUNDINGS - x0,
    ]
    small = mask[near].astype(np.uint8)
    foreground, boundary = seen.foreground[box], seen.boundary[box]
    on = foreground[mask]
    kernel = np.ones((2 * SURROUNDINGS + 1, 2 * SURROUNDINGS + 1), np.uint8)
    around = (cv2.dilate(small, kernel) > 0) & (small == 0)
    inner = (
        cv2.erode(
            small,
            np.ones((5, 5), np.uint8),
            borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
        > 0
    )
    contour = outline(candidate.mask)
    x, y = contour[:, 0] + left, contour[:, 1] + top
    free = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
    along = np.sort(rim[y[free], x[free]]) if free.any() else np.zeros(1, np.float32)
    inside = boundary[near][inner] if inner.any() else np.zeros(1, np.float32)
    together, others = _pairs(mask, foreground, seen.pairs[(slice(None), *box)])
    hull = cv2.convexHull(contour)
    area, length = (
        max(float(candidate.area), 1.0),
        max(float(cv2.arcLength(contour, True)), 1.0),
    )
    return [
        float(on.mean()),
        _lowest(on, 0.1),
        float(foreground[near][around].mean()) if around.any() else 0.0,
        float(along.mean()),
        float(along[: max(1, len(along) // 4)].mean()),
        float(inside.mean()),
        -_lowest(-inside, 0.02),
        *together,
        *others,
        float(np.log(area / (height * width))),
        1 - float(free.mean()),
        area / max(float(cv2.contourArea(hull)) + length / 2 + 1, area),
        float(np.sqrt(4 * np.pi * area) / length),
        float(seen.normals[box][..., 2][mask].mean()),
        float(seen.movable[box][mask].mean()),
        float(candidate.mask.mean()),
    ]


def _lowest(values: F32, share: float) -> float:
    """The greatest of the lowest `share` of some values."""
    k = int(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def _pairs(mask: Mask, foreground: F32, pairs: F32) -> tuple[list[float], list[float]]:
    """Mean affinity of pixels within the proposal, and with other foreground, for near, farther and far pairs."""
    h, w = mask.shape
    within, across = [], []
    for some in RANGES:
        own = other = own_count = other_count = 0.0
        for n in some:
            down, right = OFFSETS[n]
            if down >= h or abs(right) >= w:
                continue
            here = np.s_[: h - down, max(-right, 0) : w - max(right, 0)]
            there = np.s_[down:, max(right, 0) : w + min(right, 0)]
            a, b, affinity = mask[here], mask[there], pairs[n][here]
            both = a & b
            own += float(affinity[both].sum())
            own_count += int(both.sum())
            is_split = a != b
            if is_split.any():
                weight = np.where(a, foreground[there], foreground[here])[is_split]
                other += float((affinity[is_split] * weight).sum())
                other_count += float(weight.sum())
        within.append((own + 0.5) / (own_count + 1.0))
        across.append(other / (other_count + 1.0))
    return within, across


def _colour_features(candidate: Proposal, evidence: Evidence) -> list[float]:
    """Return how much of a candidate's colours goes on around, and the step there."""
    height, width = evidence.colours.shape
    reach = max(SURROUNDINGS, round(0.5 * np.sqrt(candidate.area)))
    left, top, right, bottom = candidate.box
    x, y = max(left - reach, 0), max(top - reach, 0)
    window = np.s_[y : min(bottom + reach, height), x : min(right + reach, width)]
    inside = np.zeros(evidence.colours[window].shape, bool)
    inside[top - y : bottom - y, left - x : right - x] = candidate.mask
    kernel = np.ones((3, 3), np.uint8)
    outside = cv2.dilate(inside.astype(np.uint8), kernel, iterations=2) == 0
    if not outside.any():
        return [0.0] * len(COLOUR_FEATURES)
    colours, lab = evidence.colours[window], evidence.lab[window]
    names, counts = np.unique(colours[inside], return_counts=True)
    around = colours[outside]
    rank = np.minimum(np.searchsorted(names, around), len(names) - 1)
    common = names[rank] == around
    other = np.bincount(rank[common], minlength=len(names)) / len(around)
    own = counts / counts.sum()
    step = lab[inside].mean(axis=0) - lab[outside].mean(axis=0)
    goes_on = float(np.minimum(own, RARER * other).sum())
    return [goes_on, float(np.linalg.norm(step)), *_edge_features(candidate, evidence)]


def _edge_features(candidate: Proposal, evidence: Evidence) -> list[float]:
    """Return the photo's edges along a candidate's rim, along its weakest part, inside."""
    left, top, right, bottom = candidate.box
    x, y = outline(candidate.mask).T + np.array([[left], [top]])
    height, width = evidence.edges.shape
    free = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
    if not free.any():
        return [0.0, 0.0, 0.0]
    along = np.sort(evidence.wide_edges[y[free], x[free]])
    weakest = along[: max(1, len(along) // 4)]
    mask = np.pad(candidate.mask, 1).astype(np.uint8)
    inner = cv2.erode(mask, np.ones((5, 5), np.uint8))[1:-1, 1:-1] > 0
    edges = evidence.edges[top:bottom, left:right]
    inside = float(edges[inner].mean()) if inner.any() else 0.0
    return [float(along.mean()), float(weakest.mean()), inside]


def box_features(candidates: Sequence[Proposal], evidence: Evidence) -> Array:
    """Return (n, len(BOX_FEATURES)) from the boxes on and about each candidate."""
    count = len(candidates)
    boxes, corners = evidence.boxes, evidence.corners
    if not boxes:
        return np.zeros((count, len(BOX_FEATURES)))
    rectangles = np.array([candidate.box for candidate in candidates], np.float64)
    overlap = box_overlap(rectangles, corners)
    # of boxes that fit almost alike the better one counts
    best = (overlap * (0.5 + boxes.scores.max(axis=1))).argmax(axis=1)
    matched, rows = boxes.scores[best], np.arange(count)
    classes = matched[:, 2:]
    groups = [
        classes[:, list(some)].max(axis=1)
        for some in (PERSON, ANIMALS, FURNITURE, VEHICLES)
    ]
    proportion = overlap**2
    return np.column_stack(
        [
            overlap[rows, best],
            matched[:, 0],
            matched[:, 1],
            classes.max(axis=1),
            *groups,
            (proportion * boxes.movable).max(axis=1),
            (proportion * boxes.immovable).max(axis=1),
            *_relatives(rectangles, evidence),
            (boxes.movable[None] > matched[:, :1]).sum(axis=1),
            np.full(count, boxes.movable.max()),
            np.full(count, (boxes.movable > LIKELY).sum()),
            _count_alike(rectangles, (proportion * boxes.movable).max(axis=1)),
        ]
    )


def _count_alike(rectangles: Array, score: Array) -> Array:
    """Return how many candidates apart have a box (n, 4) of the same size, by score.

    Objects come in sets: balls of a rack, dominoes, boxes of a stack.
    """
    sides = np.log(np.maximum(rectangles[:, 2:] - rectangles[:, :2], 1))
    away = np.abs(sides[:, None] - sides[None]).max(axis=2)
    alike = np.exp(-((away / SAME_SIZE) ** 2)) * (
        box_overlap(rectangles, rectangles) < APART
    )
    # many candidates show one object: the best in each place counts
    place = np.rint(
        (rectangles[:, :2] + rectangles[:, 2:]) / np.exp(sides.mean(axis=1))[:, None]
    )
    _, places = np.unique(place, axis=0, return_inverse=True)
    best = np.zeros((len(rectangles), int(places.max()) + 1))
    rows = np.arange(len(rectangles))[:, None]
    np.maximum.at(best, (rows, places.ravel()[None]), alike * score[None])
    return np.asarray(np.minimum(best.sum(axis=1), MOST_ALIKE))


def _relatives(rectangles: Array, evidence: Evidence) -> list[Array]:
    """Return scores of the wholes around candidates' boxes (n, 4) and of parts inside."""
    boxes, corners = evidence.boxes, evidence.corners
    low = np.maximum(rectangles[:, None, :2], corners[None, :, :2])
    high = np.minimum(rectangles[:, None, 2:], corners[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    area = (rectangles[:, 2:] - rectangles[:, :2]).prod(axis=1)[:, None]
    areas = np.maximum((corners[:, 2:] - corners[:, :2]).prod(axis=1), 1e-6)[None]
    is_whole = (shared > WITHIN * area) & (areas > LARGER * area)
    is_part = (shared > WITHIN * areas) & (area > LARGER * areas)
    whole = np.where(is_whole, boxes.movable, 0)
    part = np.where(is_part, boxes.movable, 0)
    share = area[:, 0] / areas[0][whole.argmax(axis=1)]
    return [
        whole.max(axis=1),
        np.where(is_whole, boxes.immovable, 0).max(axis=1),
        np.where(is_whole.any(axis=1), share, 1.0),
        part.max(axis=1),
        part.sum(axis=1),
    ]


def context_features(candidates: Sequence[Proposal], fit: Array) -> Array:
    """Return (n, len(CONTEXT_FEATURES)) from the first fit (n,) of all candidates."""
    if not candidates:
        return np.zeros((0, len(CONTEXT_FEATURES)))
    rectangles = np.array([candidate.box for candidate in candidates], np.float64)
    area = np.array([candidate.area for candidate in candidates], np.float64)
    low = np.maximum(rectangles[:, None, :2], rectangles[None, :, :2])
    high = np.minimum(rectangles[:, None, 2:], rectangles[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    box_area = (rectangles[:, 2:] - rectangles[:, :2]).prod(axis=1)
    is_part = (shared > WITHIN * box_area[None]) & (area[None] < PART * area[:, None])
    overlap = shared / (box_area[:, None] + box_area[None] - shared)
    is_rival = (overlap > RIVAL) & ~np.eye(len(fit), dtype=bool)
    common = shared > COMMON * np.minimum(box_area[:, None], box_area[None])
    share, count = _parts(is_part, common, area, fit)
    return np.column_stack(
        [
            fit,
            np.where(is_part, fit[None], 0).max(axis=1),
            np.where(is_part.T, fit[None], 0).max(axis=1),
            share,
            count,
            np.where(is_rival, fit[None], 0).max(axis=1),
            _count_alike(rectangles, fit),
        ]
    )


def _parts(
    is_part: NDArray[np.bool_], common: NDArray[np.bool_], area: Array, fit: Array
) -> tuple[Array, Array]:
    """Return the share of each candidate that good parts without overlap fill.

    The second array is their number. `is_part` (n, n): candidate j is a part of i;
    `common` (n, n): the two are candidate.
    """
    order = np.argsort(-fit * np.sqrt(area), kind="stable")
    order = order[fit[order] > GOOD_PART]
    share, count = np.zeros(len(fit)), np.zeros(len(fit))
    for i in range(len(fit)):
        taken: list[int] = []
        for j in order[is_part[i, order]].tolist():
            if not common[j, taken].any():
                taken.append(j)
        share[i] = (area[taken] * fit[taken]).sum() / area[i]
        count[i] = len(taken)
    return share, count
