"""Selection of the best set of proposals without overlap, and fitting of outlines to the photo's edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.segment.gradient import Gradient, colour_gradient, smoothed_lab
from physgen.perceive.segment.proposals import (
    Mask,
    Proposal,
    Scores,
    contour_normals,
    distinct,
    outline,
    overlap,
    score_proposals,
)
from physgen.perceive.segment.regions import discs, stable_regions


@dataclass(frozen=True)
class SelectionConstants:
    """Constants of the selection by edges, chosen on photos."""

    threshold: float = 0.58
    """Score below which a proposal is dropped. This and the following values were chosen on photos."""
    area_power: float = 0.7
    """Exponent of the area in a proposal's gain, which balances wholes against their parts."""
    set_bonus: float = 0.1
    """Bonus where three selected proposals have the same size and compactness: objects come in sets."""
    gap_penalty: float = 0.4
    """Penalty of a small proposal between larger selected ones: a gap, or a face of an object."""
    outlier: float = 0.7  # least score of a selected proposal, relative to the upper quartile of all
    working_area: int = 512 * 512
    """px searched; larger photos are reduced to it, and only outlines are fitted at full size."""
    working_side: int = 4096  # px: the longest side searched, of a panorama
    areas: tuple[float, ...] = (0.0012, 0.22)
    """Of the photo: bounds of an object's area in the selection by edges."""


SELECTION = SelectionConstants()

SHARED = 0.12
"""Common share of the smaller of two proposals above which they exclude each other."""

Flags = NDArray[np.bool_]
Values = NDArray[np.float64]


WIDEST_AREAS = (0.0005, 0.6)
"""Of the photo: bounds of the area of all proposals."""


@dataclass(frozen=True, eq=False)
class EdgeSearch:
    """Proposals from edges and circles, on a grid of `shape` (h, w)."""

    shape: tuple[int, int]
    gradient: Gradient
    proposals: Sequence[Proposal]  # All of them, also larger and smaller ones than are selected from
    chosen: Sequence[Proposal]  # The best set of them
    scores: NDArray[np.float64]  # (n,) of the chosen ones


def search_edges(rgb: NDArray[np.uint8]) -> EdgeSearch:
    """The proposals of a photo (H, W, 3) uint8 sRGB, and the best set of them."""
    height, width = rgb.shape[:2]
    scale = min(
        1.0, (SELECTION.working_area / (height * width)) ** 0.5, SELECTION.working_side / max(height, width)
    )
    size = max(1, round(width * scale)), max(1, round(height * scale))
    reduced = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb
    shape = size[1], size[0]
    least, most, smallest, largest = (
        round(part * size[0] * size[1]) for part in (*WIDEST_AREAS, *SELECTION.areas)
    )
    least, smallest = max(12, least), max(12, smallest)
    colour = smoothed_lab(np.asarray(reduced, np.uint8))
    gradient = colour_gradient(colour)
    regions = stable_regions(colour, gradient, least, most)
    circles = discs(gradient, smallest, largest)
    proposals = distinct([one for one in regions if smallest <= one.area <= largest] + circles)
    scores = score_proposals(proposals, colour, gradient)
    chosen, final = select(proposals, scores, shape)
    return EdgeSearch(shape, gradient, distinct(regions + circles), chosen, final)


def select(
    proposals: Sequence[Proposal], looks: Scores, shape: tuple[int, int]
) -> tuple[list[Proposal], NDArray[np.float64]]:
    """The set without overlap of the largest gain on a grid of `shape` (h, w), with final scores.

    There are two rounds, since the scores depend on the selection.
    """
    worth = np.flatnonzero(looks.score > SELECTION.threshold - SELECTION.set_bonus)
    pool = [proposals[i] for i in worth.tolist()]
    if not pool:
        return [], np.zeros(0)
    score, compactness = looks.score[worth], looks.compactness[worth]
    area = np.array([proposal.area for proposal in pool], np.float64)
    weight = (area / (shape[0] * shape[1])) ** SELECTION.area_power
    excludes = exclusions(pool)
    final, gap = score, np.zeros(len(pool))
    chosen = best_set((final - SELECTION.threshold) * weight, excludes)
    for _ in range(2):
        gap = np.maximum(gap, _gaps(pool, area, chosen, shape))
        final = score + _sets(score, area, compactness, chosen, excludes) - gap
        chosen = best_set((final - SELECTION.threshold) * weight, excludes)
    if chosen.any():
        chosen &= final > max(
            SELECTION.threshold, SELECTION.outlier * float(np.quantile(final[chosen], 0.75))
        )
    return [pool[i] for i in np.flatnonzero(chosen).tolist()], final[chosen]


def exclusions(proposals: Sequence[Proposal]) -> Flags:
    """(n, n): which proposals share too much to be chosen together; false on the diagonal."""
    boxes = np.array([proposal.box for proposal in proposals], np.float64)
    area = np.array([proposal.area for proposal in proposals], np.float64)
    low, high = np.maximum(boxes[:, None, :2], boxes[:, :2]), np.minimum(boxes[:, None, 2:], boxes[:, 2:])
    meeting = np.clip(high - low, 0, None).prod(-1) > SHARED * np.minimum(area[:, None], area)
    excludes = np.zeros(meeting.shape, np.bool_)
    for i, j in np.argwhere(np.triu(meeting, 1)).tolist():
        excludes[i, j] = excludes[j, i] = overlap(proposals[i], proposals[j]) > SHARED * min(area[i], area[j])
    return excludes


def best_set(gain: Values, excludes: Flags) -> Flags:
    """(n,): the independent set of the largest gain, by local search.

    Proposals are taken by falling gain; then one is added or removed, the free place is refilled, and improvements
    are kept.
    """
    by_gain = np.argsort(-gain, kind="stable")
    by_gain = by_gain[gain[by_gain] > 0]
    chosen = _fill(np.zeros(len(gain), np.bool_), by_gain, excludes)
    for _ in range(12):
        before = float(gain[chosen].sum())
        for i in by_gain:
            trial, out = chosen.copy(), chosen & excludes[i]
            if chosen[i]:
                trial[i], out = False, np.arange(len(gain)) == i
            elif gain[out].sum() > 1.7 * gain[i]:
                continue
            else:
                trial[out], trial[i] = False, True
            room = excludes[out].any(0)
            trial = _fill(trial, by_gain[room[by_gain]], excludes)
            if gain[trial].sum() > gain[chosen].sum() + 1e-9:
                chosen = trial
        if gain[chosen].sum() <= before + 1e-9:
            break
    return chosen


def _fill(chosen: Flags, order: NDArray[np.intp], excludes: Flags) -> Flags:
    chosen = chosen.copy()
    blocked = excludes[chosen].any(0) | chosen
    for i in order:
        if not blocked[i]:
            chosen[i] = True
            blocked |= excludes[i]
    return chosen


def _sets(score: Values, area: Values, compactness: Values, chosen: Flags, excludes: Flags) -> Values:
    """(n,): the bonus of proposals with the size and compactness of several selected ones."""
    size = np.log(area[:, None] / area[chosen]) / 0.12
    round_ = np.log(compactness[:, None] / compactness[chosen]) / 0.15
    alike = np.exp(-(size**2) - round_**2) * np.clip((score[chosen] - SELECTION.threshold) / 0.2, 0, 1)
    alike[(excludes | np.eye(len(area), dtype=np.bool_))[:, chosen]] = 0
    bonus: Values = SELECTION.set_bonus * np.minimum(alike.sum(1), 3) / 3
    return bonus


def _gaps(proposals: Sequence[Proposal], area: Values, chosen: Flags, shape: tuple[int, int]) -> Values:
    """(n,): the penalty of selected proposals next to larger selected ones along much of the outline."""
    reach = 3
    labels = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), np.int32)
    members = np.flatnonzero(chosen).tolist()
    for i in members:
        left, top, right, bottom = (edge + reach for edge in proposals[i].box)
        labels[top:bottom, left:right][proposals[i].mask] = i + 1
    penalty = np.zeros(len(proposals))
    for i in members:
        left, top, right, bottom = proposals[i].box
        around = labels[top : bottom + 2 * reach, left : right + 2 * reach]
        others = (around > 0) & (around != i + 1)
        if not others.any():
            continue
        near = cv2.dilate(others.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
        x, y = (outline(proposals[i].mask) + reach).T
        enclosed = max(0.0, float(near[y, x].mean()) - 0.3) / 0.7
        beside = float(np.median(area[np.unique(around[others]) - 1]))
        penalty[i] = SELECTION.gap_penalty * enclosed * np.clip(1 - area[i] / (0.6 * beside), 0, 1)
    return penalty


BAND = 0.08
"""Movement of an outline at most, in square roots of its area; at least 1.5 px of the rough mask."""


@dataclass(frozen=True)
class TightenConstants:
    """Constants of the outlines."""

    bend: float = 0.2  # cost of one step sideways, against an edge support of 0..1
    round: float = 0.025  # relative deviation from its circle below which an outline becomes that circle
    side: int = 16_384  # px: longer objects keep the rough outline, since OpenCV samples no larger images


TIGHTEN = TightenConstants()


Points = NDArray[np.float64]
"""(n, 2): x, y px along a closed outline."""


def tighten(rgb: NDArray[np.uint8], masks: Sequence[Mask], band: float = BAND) -> NDArray[np.uint16]:
    """(H, W) uint16: k + 1 where mask k (h, w), of a smaller or equal size than the photo (H, W, 3), ends up.

    Every label is one connected region; of two masks with a common pixel the later one gets it. `band`: see `BAND`.
    """
    labels = np.zeros(rgb.shape[:2], np.uint16)
    boxes: list[tuple[slice, slice]] = []
    for k, mask in enumerate(masks):
        scale = rgb.shape[1] / mask.shape[1], rgb.shape[0] / mask.shape[0]
        reach = max(1.5, band * float(np.sqrt(mask.sum()))) * max(scale)
        points, normal = _outline_at(mask, np.array(scale))
        low = np.maximum(np.floor(points.min(0) - reach - 6), 0).astype(int)
        high = np.ceil(points.max(0) + reach + 7).astype(int)
        if max(high - low) < TIGHTEN.side:
            gradient = colour_gradient(smoothed_lab(rgb[low[1] : high[1], low[0] : high[0]]))
            points = points + _path(gradient, points - low, normal, reach)[:, None] * normal
        rim = _rounded(points)
        left, top = (max(0, int(v) - 2) for v in rim.min(0))
        box = np.s_[top : max(top, int(rim[:, 1].max()) + 3), left : max(left, int(rim[:, 0].max()) + 3)]
        filled = np.zeros(labels[box].shape, np.uint8)
        if filled.size:
            cv2.fillPoly(filled, [np.rint(16 * (rim - (left, top))).astype(np.int32)], 1, shift=4)
            labels[box][filled > 0] = k + 1
        boxes.append(box)
    return _connected(labels, boxes)


def _outline_at(mask: Mask, scale: Points) -> tuple[Points, Points]:
    """The outline of a mask on a photo `scale` times as large, a point a px, and its outward normals."""
    contour = outline(mask)
    normal = contour_normals(contour)
    # From pixel centres out to the pixels' edge, where scaling is exact, and back to centres.
    points = (contour + 0.5 + 0.5 * normal) * scale - 0.5 - 0.5 * normal
    count = int(np.clip(len(contour) * scale.max(), 16, 1500))
    at, knots = np.linspace(0, len(contour), count, endpoint=False), np.arange(len(contour) + 1)
    rows = np.vstack([np.hstack([points, normal]), np.hstack([points[:1], normal[:1]])])
    even = np.stack([np.interp(at, knots, column) for column in rows.T], 1)
    return _smooth(even[:, :2], 1.5), even[:, 2:] / np.linalg.norm(even[:, 2:], axis=1, keepdims=True)


def _path(gradient: Gradient, points: Points, normal: Points, band: float) -> NDArray[np.float64]:
    """(n,) px: movement of each point along its normal, so that the outline follows edges and bends little.

    By Viterbi's algorithm, twice around so that the ends meet.
    """
    steps = np.linspace(-band, band, 2 * int(np.clip(2 * band, 4, 16)) + 1)
    edge = points[:, None] + (steps[:, None] + 0.5) * normal[:, None]  # half a px outside the last pixel
    angle = np.arctan2(normal[:, 1], normal[:, 0])[:, None]
    strength = gradient.across(edge[..., 0], edge[..., 1], angle)
    crest = strength.max(1, keepdims=True)
    peaked = (
        gradient.support(crest) * strength / np.maximum(crest, 1e-6)
    )  # support alone is flat about strong edges
    value = np.tile(peaked * (1 - 0.2 * (steps / band) ** 2), (2, 1))
    total, came = np.zeros(len(steps)), np.zeros(value.shape, np.int64)
    ways = np.full((3, len(steps)), -np.inf)
    for i, here in enumerate(value):
        ways[0, 1:], ways[1], ways[2, :-1] = total[:-1] - TIGHTEN.bend, total, total[1:] - TIGHTEN.bend
        came[i] = ways.argmax(0)
        total = ways.max(0) + here
    at, path = int(total.argmax()), np.zeros(len(value), np.int64)
    for i in reversed(range(len(value))):
        path[i] = at
        at += came[i, at] - 1
    half = len(points) // 2
    return _smooth(steps[np.roll(path[half : half + len(points)], half)], 1.5)


def _smooth(values: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Closed sequences (n,) or (n, k), blurred along n."""
    ends = 4 * int(np.ceil(sigma))
    closed = np.pad(values.reshape(len(values), -1), ((ends, ends), (0, 0)), mode="wrap")
    blurred = cv2.GaussianBlur(closed, (1, 2 * ends + 1), sigmaX=0.1, sigmaY=sigma)
    return blurred[ends:-ends].reshape(values.shape).astype(np.float64)


def _rounded(points: Points) -> Points:
    """The circle through an outline where it is one, else the outline."""
    weight = np.ones(len(points))
    for _ in range(4):  # least squares on x² + y² = 2 a x + 2 b y + c, outliers weighed down
        centre = points.mean(0)
        rows = np.column_stack([2 * (points - centre), np.ones(len(points))])
        right = ((points - centre) ** 2).sum(1)
        a, b, c = np.linalg.lstsq(rows * weight[:, None], right * weight, rcond=None)[0]
        radius = float(np.sqrt(max(c + a * a + b * b, 1e-9)))
        off = np.hypot(*(points - centre - [a, b]).T) - radius
        weight = 1 / (1 + (off / (0.01 * radius + 0.3)) ** 2)
    if np.sqrt(np.mean(off**2)) > TIGHTEN.round * radius + 0.3:
        return points
    turn = np.linspace(0, 2 * np.pi, len(points), endpoint=False)
    rim: Points = centre + [a, b] + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    return rim


def _connected(labels: NDArray[np.uint16], boxes: Sequence[tuple[slice, slice]]) -> NDArray[np.uint16]:
    """Labels 1.. in their boxes, of each its largest connected part."""
    kept = np.zeros_like(labels)
    for k, box in enumerate(boxes, 1):
        here = (labels[box] == k).astype(np.uint8)
        if not here.any():
            continue
        _, parts, stats, _ = cv2.connectedComponentsWithStats(here, connectivity=4)
        kept[box][parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())] = k
    return kept
