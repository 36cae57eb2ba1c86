"""Features that predict the fit of a candidate to an object: the judge's input.

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
"""Features from the network's maps and the mask."""
COLOUR_FEATURES = (
    "colours that go on around", "colour step at the rim", "edge along the rim",
    "edge along its weakest quarter", "edge inside",
)  # fmt: skip
"""Features from the photo's colours and edges."""
BOX_FEATURES = (
    "box overlap", "movable box", "immovable box", "class score", "person", "animal",
    "furniture", "vehicle", "movable in proportion", "immovable in proportion",
    "movable whole around", "immovable whole around", "share of the whole",
    "best part inside", "parts inside", "rank", "best in the photo", "likely in the photo",
    "others alike",
)  # fmt: skip
"""Features from the detector's boxes: the best matching box, larger and smaller
ones.
"""
FEATURES = (*MAP_FEATURES, *COLOUR_FEATURES, *BOX_FEATURES)
CONTEXT_FEATURES = (
    "first fit", "best candidate inside", "best candidate around", "share in parts",
    "number of parts", "best rival", "fitting others alike",
)  # fmt: skip
"""Features from a first judgement of all candidates: wholes against their parts and
piles.
"""

RANGES = (range(0, 2), range(2, 6), range(6, 8))
"""Indices of OFFSETS: near, farther and far pairs."""
# px of the grid: width of a candidate's surroundings.
SURROUNDINGS = 3
PERSON = (0,)
ANIMALS = tuple(range(14, 24))
FURNITURE = (13, 56, 57, 59, 60, 61)
VEHICLES = tuple(range(1, 9))
"""Indices of COCO's classes."""
# Least share of a part's box inside the box of its whole.
WITHIN = 0.85
# Least ratio of the areas of a whole and its part.
LARGER = 1.5
# Least score of a likely movable whole.
LIKELY = 0.3
COLOUR_STEPS = 2**14
"""Number of colours: 16 steps of lightness x 32 x 32 of both hues."""
# Logarithm of a side: scale of the difference between candidates of equal size.
SAME_SIZE = 0.15
# IoU of their boxes below which two candidates are separate.
APART = 0.1
# Largest count of similar candidates; more add no information.
MOST_ALIKE = 6.0
# Largest area of a part over the whole's.
PART = 0.7
# Least first fit of a counted part.
GOOD_PART = 0.35
# Least common share of the smaller box of two equal parts.
COMMON = 0.25
# Least IoU of the boxes of two rivals.
RIVAL = 0.25
# Largest ratio of a colour's frequencies inside and around if it continues around.
RARER = 3.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence about a photo for the judgement of its candidates."""

    maps: NetworkMaps
    # (h, w): the photo's colours on the grid, in steps.
    colours: NDArray[np.int64]
    # (h, w, 3): the same in CIELAB.
    lab: F32
    # (h, w) 0..1: strength of the strongest edge over the noise.
    edges: F32
    boxes: DetectedBoxes
    # (n, 4): the boxes on the grid.
    corners: Array

    @cached_property
    def wide_edges(self) -> F32:
        """Return the strongest edge (h, w) of each cell and its neighbours."""
        return np.asarray(cv2.dilate(self.edges, np.ones((3, 3), np.uint8)), np.float32)


def gather_evidence(
    rgb: NDArray[np.uint8], network_maps: NetworkMaps, boxes: DetectedBoxes
) -> Evidence:
    """Return the evidence of a photo (H, W, 3) sRGB."""
    height, width = network_maps.foreground.shape
    lab = _small_lab(rgb, (height, width))
    colours = colour_steps(rgb, (height, width))
    scale = np.tile([width / rgb.shape[1], height / rgb.shape[0]], 2)
    edges = find_edges(rgb, (height, width))
    corners = boxes.corners * scale
    return Evidence(
        network_maps, colours, lab.astype(np.float32), edges, boxes, corners
    )


def colour_steps(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.int64]:
    """Return the photo's colours on a grid (h, w) in steps below COLOUR_STEPS."""
    steps = _small_lab(rgb, shape).astype(np.int64) // (16, 8, 8)
    return np.asarray((steps[..., 0] * 32 + steps[..., 1]) * 32 + steps[..., 2])


def _small_lab(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the smoothed photo on a grid of `shape` (h, w), in CIELAB levels."""
    small = cv2.resize(rgb, shape[::-1], interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), 1.0)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2LAB), np.uint8)


def find_edges(rgb: NDArray[np.uint8], shape: tuple[int, int]) -> F32:
    """Return the strength 0..1 of the photo's edges on a grid of `shape` (h, w).

    Edges are found on a grid twice as fine; of four cells the strongest counts.
    """
    height, width = shape
    fine_photo = cv2.resize(rgb, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
    fine_photo = cv2.GaussianBlur(fine_photo, (0, 0), 0.8)
    lab = cv2.cvtColor(fine_photo.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    x_gradient = cv2.Sobel(lab, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    down = cv2.Sobel(lab, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    strength = np.sqrt((x_gradient**2 + down**2).sum(axis=2))
    # Half of a photo is below the median: grain and smooth shading.
    noise = max(0.25, float(np.median(strength)))
    strongest = strength.reshape(height, 2, width, 2).max(axis=(1, 3))
    return np.asarray(strongest / (strongest + 3 * noise + 1), np.float32)


def judge_features(candidates: Sequence[Proposal], evidence: Evidence) -> Array:
    """Return the features (n, len(FEATURES)) of candidates on the network's grid."""
    if not candidates:
        return np.zeros((0, len(FEATURES)))
    maps = map_features(candidates, evidence.maps)
    colours = [_colour_features(candidate, evidence) for candidate in candidates]
    boxes = box_features(candidates, evidence)
    return np.hstack([maps, np.array(colours), boxes])


def map_features(candidates: Sequence[Proposal], maps: NetworkMaps) -> Array:
    """Return the features (n, len(MAP_FEATURES)) of candidates."""
    rim = np.asarray(cv2.dilate(maps.boundary, np.ones((3, 3), np.uint8)), np.float32)
    reach = max(max(abs(down), abs(right)) for down, right in OFFSETS)
    return np.array(
        [_map_features(candidate, maps, rim, reach) for candidate in candidates]
    )


@dataclass(frozen=True, eq=False)
class _CandidateView:
    """A candidate and the network's maps around it, in a window of the grid."""

    candidate: Proposal
    # (h, w): mask in the window.
    mask: Mask
    # Slices of the window in the grid.
    window: tuple[slice, slice]
    # Slices, in the window, of the candidate's box and its surroundings.
    surroundings: tuple[slice, slice]


def _crop_candidate(
    candidate: Proposal, shape: tuple[int, ...], reach: int
) -> _CandidateView:
    """Return a candidate in a window `reach` px larger than its box."""
    height, width = shape
    left, top, right, bottom = candidate.box
    x0 = max(left - reach, 0)
    y0 = max(top - reach, 0)
    x1 = min(right + reach, width)
    y1 = min(bottom + reach, height)
    mask = np.zeros((y1 - y0, x1 - x0), bool)
    mask[top - y0 : bottom - y0, left - x0 : right - x0] = candidate.mask
    surroundings = (
        slice(max(top - SURROUNDINGS - y0, 0), bottom + SURROUNDINGS - y0),
        slice(max(left - SURROUNDINGS - x0, 0), right + SURROUNDINGS - x0),
    )
    window = slice(y0, y1), slice(x0, x1)
    return _CandidateView(candidate, mask, window, surroundings)


def _map_features(
    candidate: Proposal, maps: NetworkMaps, rim: F32, reach: int
) -> list[float]:
    """Return the features of one candidate, in the order of MAP_FEATURES."""
    view = _crop_candidate(candidate, maps.foreground.shape, reach)
    window = view.window
    mask = view.mask
    foreground = maps.foreground[window]
    contour = outline(candidate.mask)
    inner_affinities, outer_affinities = _pairs(
        mask, foreground, maps.pairs[(slice(None), *window)]
    )
    return [
        *_measure_foreground(view, foreground),
        *_measure_rim(contour + candidate.box[:2], rim),
        *_measure_inner_border(view, maps.boundary[window]),
        *inner_affinities,
        *outer_affinities,
        *_measure_form(candidate, contour, rim.shape),
        float(maps.normals[window][..., 2][mask].mean()),
        float(maps.movable[window][mask].mean()),
        float(candidate.mask.mean()),
    ]


def _measure_foreground(view: _CandidateView, foreground: F32) -> list[float]:
    """Return the foreground inside a candidate, in its weakest tenth, and around it."""
    small = view.mask[view.surroundings].astype(np.uint8)
    kernel = np.ones((2 * SURROUNDINGS + 1, 2 * SURROUNDINGS + 1), np.uint8)
    ring = (cv2.dilate(small, kernel) > 0) & (small == 0)
    outer_mean = 0.0
    if ring.any():
        outer_mean = float(foreground[view.surroundings][ring].mean())
    inner_foreground = foreground[view.mask]
    return [
        float(inner_foreground.mean()),
        _lowest(inner_foreground, 0.1),
        outer_mean,
    ]


def _is_free(points: NDArray[np.integer], shape: tuple[int, ...]) -> Mask:
    """Return (n,) whether points (n, 2) of an outline are off the photo's border.

    The photo's border is not an edge of an object.
    """
    height, width = shape
    x, y = points.T
    return np.asarray((x > 0) & (y > 0) & (x < width - 1) & (y < height - 1))


def _measure_rim(points: NDArray[np.integer], rim: F32) -> list[float]:
    """Return the border along an outline (n, 2), and along its weakest quarter."""
    values = np.zeros(1, np.float32)
    free = _is_free(points, rim.shape)
    if free.any():
        x, y = points[free].T
        values = np.sort(rim[y, x])
    weakest_values = values[: max(1, len(values) // 4)]
    return [float(values.mean()), float(weakest_values.mean())]


def _measure_inner_border(view: _CandidateView, boundary: F32) -> list[float]:
    """Return the border inside a candidate, and its strongest fiftieth."""
    inner = (
        cv2.erode(
            view.mask[view.surroundings].astype(np.uint8),
            np.ones((5, 5), np.uint8),
            borderType=cv2.BORDER_CONSTANT,
            borderValue=0,
        )
        > 0
    )
    inside = np.zeros(1, np.float32)
    if inner.any():
        inside = boundary[view.surroundings][inner]
    return [float(inside.mean()), -_lowest(-inside, 0.02)]


def _measure_form(
    candidate: Proposal, contour: NDArray[np.int32], shape: tuple[int, ...]
) -> list[float]:
    """Return log size, share cut by the photo, solidity and compactness."""
    area = max(float(candidate.area), 1.0)
    length = max(float(cv2.arcLength(contour, True)), 1.0)
    hull_area = float(cv2.contourArea(cv2.convexHull(contour)))
    return [
        float(np.log(area / (shape[0] * shape[1]))),
        1 - float(_is_free(contour + candidate.box[:2], shape).mean()),
        area / max(hull_area + length / 2 + 1, area),
        float(np.sqrt(4 * np.pi * area) / length),
    ]


def _lowest(values: F32, share: float) -> float:
    """Return the largest of the lowest `share` of some values."""
    k = int(share * (len(values) - 1))
    return float(np.partition(values, k)[k])


def _pairs(mask: Mask, foreground: F32, pairs: F32) -> tuple[list[float], list[float]]:
    """Return mean affinities inside the proposal, and with other foreground.

    There is one value each for near, farther and far pairs.
    """
    height, width = mask.shape
    inner_means, outer_means = [], []
    for indices in RANGES:
        total = _AffinitySums()
        for n in indices:
            down, right = OFFSETS[n]
            if down < height and abs(right) < width:
                total.add(mask, foreground, pairs[n], (down, right))
        inner_means.append((total.inner + 0.5) / (total.inner_count + 1.0))
        outer_means.append(total.outer / (total.outer_count + 1.0))
    return inner_means, outer_means


@dataclass
class _AffinitySums:
    """Sums of affinities inside a proposal, and with other foreground."""

    inner: float = 0.0
    inner_count: float = 0.0
    outer: float = 0.0
    outer_count: float = 0.0

    def add(
        self, mask: Mask, foreground: F32, affinities: F32, offset: tuple[int, int]
    ) -> None:
        """Add the affinities (h, w) of pixel pairs at an offset (rows, columns)."""
        height, width = mask.shape
        down, right = offset
        first_side = np.s_[: height - down, max(-right, 0) : width - max(right, 0)]
        second_side = np.s_[down:, max(right, 0) : width + min(right, 0)]
        first = mask[first_side]
        second = mask[second_side]
        affinity = affinities[first_side]
        is_inside = first & second
        self.inner += float(affinity[is_inside].sum())
        self.inner_count += int(is_inside.sum())
        is_split = first != second
        if is_split.any():
            weight = np.where(first, foreground[second_side], foreground[first_side])
            weight = weight[is_split]
            self.outer += float((affinity[is_split] * weight).sum())
            self.outer_count += float(weight.sum())


def _colour_features(candidate: Proposal, evidence: Evidence) -> list[float]:
    """Return the continued share of a candidate's colours, the colour step, and
    edges.
    """
    reach = max(SURROUNDINGS, round(0.5 * np.sqrt(candidate.area)))
    view = _crop_candidate(candidate, evidence.colours.shape, reach)
    inside = view.mask
    kernel = np.ones((3, 3), np.uint8)
    outside = cv2.dilate(inside.astype(np.uint8), kernel, iterations=2) == 0
    if not outside.any():
        return [0.0] * len(COLOUR_FEATURES)
    colours = evidence.colours[view.window]
    lab = evidence.lab[view.window]
    step = lab[inside].mean(axis=0) - lab[outside].mean(axis=0)
    return [
        _share_colours(colours[inside], colours[outside]),
        float(np.linalg.norm(step)),
        *_edge_features(candidate, evidence),
    ]


def _share_colours(
    inner_colours: NDArray[np.int64], outer_colours: NDArray[np.int64]
) -> float:
    """Return the share of the inner colours (n,) that continue outside."""
    names, counts = np.unique(inner_colours, return_counts=True)
    rank = np.minimum(np.searchsorted(names, outer_colours), len(names) - 1)
    is_common = names[rank] == outer_colours
    outer_counts = np.bincount(rank[is_common], minlength=len(names))
    outer_shares = outer_counts / len(outer_colours)
    inner_shares = counts / counts.sum()
    return float(np.minimum(inner_shares, RARER * outer_shares).sum())


def _edge_features(candidate: Proposal, evidence: Evidence) -> list[float]:
    """Return the photo's edges along a candidate's rim, along its weakest part, and
    inside.
    """
    left, top, right, bottom = candidate.box
    x, y = outline(candidate.mask).T + np.array([[left], [top]])
    height, width = evidence.edges.shape
    free = (x > 0) & (y > 0) & (x < width - 1) & (y < height - 1)
    if not free.any():
        return [0.0, 0.0, 0.0]
    rim_values = np.sort(evidence.wide_edges[y[free], x[free]])
    weakest = rim_values[: max(1, len(rim_values) // 4)]
    mask = np.pad(candidate.mask, 1).astype(np.uint8)
    inner = cv2.erode(mask, np.ones((5, 5), np.uint8))[1:-1, 1:-1] > 0
    edges = evidence.edges[top:bottom, left:right]
    if inner.any():
        inside = float(edges[inner].mean())
    else:
        inside = 0.0
    return [float(rim_values.mean()), float(weakest.mean()), inside]


def box_features(candidates: Sequence[Proposal], evidence: Evidence) -> Array:
    """Return the features (n, len(BOX_FEATURES)) from the boxes around each
    candidate.
    """
    count = len(candidates)
    boxes = evidence.boxes
    corners = evidence.corners
    if not boxes:
        return np.zeros((count, len(BOX_FEATURES)))
    rectangles = np.array([candidate.box for candidate in candidates], np.float64)
    overlap = box_overlap(rectangles, corners)
    # Of boxes with almost equal fits, the better one counts.
    best = (overlap * (0.5 + boxes.scores.max(axis=1))).argmax(axis=1)
    best_scores = boxes.scores[best]
    rows = np.arange(count)
    classes = best_scores[:, 2:]
    groups = []
    for group_classes in (PERSON, ANIMALS, FURNITURE, VEHICLES):
        groups.append(classes[:, list(group_classes)].max(axis=1))
    proportion = overlap**2
    return np.column_stack(
        [
            overlap[rows, best],
            best_scores[:, 0],
            best_scores[:, 1],
            classes.max(axis=1),
            *groups,
            (proportion * boxes.movable).max(axis=1),
            (proportion * boxes.immovable).max(axis=1),
            *_relatives(rectangles, evidence),
            (boxes.movable[None] > best_scores[:, :1]).sum(axis=1),
            np.full(count, boxes.movable.max()),
            np.full(count, (boxes.movable > LIKELY).sum()),
            _count_alike(rectangles, (proportion * boxes.movable).max(axis=1)),
        ]
    )


def _count_alike(rectangles: Array, score: Array) -> Array:
    """Return the number of separate candidates with boxes (n, 4) of equal size, by
    score.

    Objects often come in sets: balls of a rack, dominoes, boxes of a stack.
    """
    sides = np.log(np.maximum(rectangles[:, 2:] - rectangles[:, :2], 1))
    size_difference = np.abs(sides[:, None] - sides[None]).max(axis=2)
    is_apart = box_overlap(rectangles, rectangles) < APART
    similarity = np.exp(-((size_difference / SAME_SIZE) ** 2)) * is_apart
    # Many candidates show one object: the best one at each place counts.
    corner_sums = rectangles[:, :2] + rectangles[:, 2:]
    sizes = np.exp(sides.mean(axis=1))
    place = np.rint(corner_sums / sizes[:, None])
    _, places = np.unique(place, axis=0, return_inverse=True)
    best = np.zeros((len(rectangles), int(places.max()) + 1))
    rows = np.arange(len(rectangles))[:, None]
    np.maximum.at(best, (rows, places.ravel()[None]), similarity * score[None])
    return np.asarray(np.minimum(best.sum(axis=1), MOST_ALIKE))


def _relatives(rectangles: Array, evidence: Evidence) -> list[Array]:
    """Return scores of wholes around candidates' boxes (n, 4) and of parts inside."""
    boxes = evidence.boxes
    corners = evidence.corners
    low = np.maximum(rectangles[:, None, :2], corners[None, :, :2])
    high = np.minimum(rectangles[:, None, 2:], corners[None, :, 2:])
    intersection = np.clip(high - low, 0, None).prod(axis=2)
    area = (rectangles[:, 2:] - rectangles[:, :2]).prod(axis=1)[:, None]
    areas = np.maximum((corners[:, 2:] - corners[:, :2]).prod(axis=1), 1e-6)[None]
    whole_mask = (intersection > WITHIN * area) & (areas > LARGER * area)
    is_part = (intersection > WITHIN * areas) & (area > LARGER * areas)
    whole_scores = np.where(whole_mask, boxes.movable, 0)
    part_scores = np.where(is_part, boxes.movable, 0)
    share = area[:, 0] / areas[0][whole_scores.argmax(axis=1)]
    return [
        whole_scores.max(axis=1),
        np.where(whole_mask, boxes.immovable, 0).max(axis=1),
        np.where(whole_mask.any(axis=1), share, 1.0),
        part_scores.max(axis=1),
        part_scores.sum(axis=1),
    ]


def context_features(candidates: Sequence[Proposal], fit: Array) -> Array:
    """Return features (n, len(CONTEXT_FEATURES)) from the first fit (n,) of all
    candidates.
    """
    if not candidates:
        return np.zeros((0, len(CONTEXT_FEATURES)))
    rectangles = np.array([candidate.box for candidate in candidates], np.float64)
    area = np.array([candidate.area for candidate in candidates], np.float64)
    low = np.maximum(rectangles[:, None, :2], rectangles[None, :, :2])
    high = np.minimum(rectangles[:, None, 2:], rectangles[None, :, 2:])
    intersection = np.clip(high - low, 0, None).prod(axis=2)
    box_area = (rectangles[:, 2:] - rectangles[:, :2]).prod(axis=1)
    is_part = (intersection > WITHIN * box_area[None]) & (
        area[None] < PART * area[:, None]
    )
    overlap = intersection / (box_area[:, None] + box_area[None] - intersection)
    is_rival = (overlap > RIVAL) & ~np.eye(len(fit), dtype=bool)
    common = intersection > COMMON * np.minimum(box_area[:, None], box_area[None])
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
    """Return the share of each candidate filled by good parts without overlap, and
    their number.

    `is_part` (n, n): candidate j is a part of i; `common` (n, n): both are the same
    candidate.
    """
    order = np.argsort(-fit * np.sqrt(area), kind="stable")
    order = order[fit[order] > GOOD_PART]
    share = np.zeros(len(fit))
    count = np.zeros(len(fit))
    for i in range(len(fit)):
        used_parts: list[int] = []
        for j in order[is_part[i, order]].tolist():
            if not common[j, used_parts].any():
                used_parts.append(j)
        share[i] = (area[used_parts] * fit[used_parts]).sum() / area[i]
        count[i] = len(used_parts)
    return share, count
