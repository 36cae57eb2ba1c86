"""Proposals: masks of possible objects; cutting out, comparing, joining and scoring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import Doubt
from physgen.perceive.segment.gradient import Gradient, sample

Mask = NDArray[np.bool_]
Array = NDArray[np.float64]
STRAIGHT = 0.01
"""Tolerance of a doubtful object's polygon over the outline's length."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mask, stored as its bounding cut-out, because many masks of a large photo would
    fill the memory.
    """

    x: int
    y: int
    # (h, w), with its top-left pixel at (x, y) of the photo.
    mask: Mask
    # px.
    area: int

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Return left, top, right, bottom; the last two are just outside."""
        return self.x, self.y, self.x + self.mask.shape[1], self.y + self.mask.shape[0]

    def on(self, shape: tuple[int, int]) -> Mask:
        """Return the mask (H, W) on the whole photo."""
        canvas = np.zeros(shape, np.bool_)
        left, top, right, bottom = self.box
        canvas[top:bottom, left:right] = self.mask
        return canvas


def disc(radius: int) -> NDArray[np.uint8]:
    """Return the structuring element of a radius in px."""
    return cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)
    ).astype(np.uint8)


def outline(mask: Mask) -> NDArray[np.int32]:
    """Return x, y (n, 2) int32 of the pixels along the longest outer contour of a
    mask.
    """
    contours, _ = cv2.findContours(
        mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    return max(contours, key=len)[:, 0].astype(np.int32)


def polygons(contour: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Return polygons of 4 to 6 corners (k, 2) close to a contour (n, 2).

    They are the tightest rectangle and simplified hulls.
    """
    result = [np.rint(cv2.boxPoints(cv2.minAreaRect(contour))).astype(np.int32)]
    hull = cv2.convexHull(contour)
    length = cv2.arcLength(contour, True)
    for tolerance in (0.02, 0.035, 0.06):
        corners = cv2.approxPolyDP(hull, tolerance * length, True)[:, 0].astype(
            np.int32
        )
        if 4 <= len(corners) <= 6:
            result.append(corners)
    return result


def cut_out(
    mask: Mask, x: int, y: int, smallest: int, opening: int = 0
) -> Proposal | None:
    """Return the largest part of a mask with its corner at (x, y), or None.

    The mask is opened by a disc and its holes are filled. None means fewer than
    `smallest` px.
    """
    image = np.pad(mask, opening + 1).astype(np.uint8)
    if opening:
        image = cv2.morphologyEx(image, cv2.MORPH_OPEN, disc(opening)).astype(np.uint8)
    count, parts, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=4)
    if count < 2:
        return None
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    left, top, width, height, _ = (int(value) for value in stats[largest])
    filled_part = np.zeros((height, width), np.uint8)
    part = parts[top : top + height, left : left + width] == largest
    cv2.fillPoly(filled_part, [outline(part)], 1)
    area = int(filled_part.sum())
    if area < smallest:
        return None
    return Proposal(
        x + left - opening - 1, y + top - opening - 1, filled_part > 0, area
    )


def common(a: Proposal, b: Proposal) -> tuple[slice, slice]:
    """Return the part of the mask of `a` in the box of `b`; empty if they do not
    meet.
    """
    left, top, right, bottom = b.box
    return (
        slice(max(top - a.y, 0), max(bottom - a.y, 0)),
        slice(max(left - a.x, 0), max(right - a.x, 0)),
    )


def overlap(a: Proposal, b: Proposal) -> int:
    """Return the number of common pixels of two proposals."""
    part = a.mask[common(a, b)]
    if part.size:
        return int(np.count_nonzero(part & b.mask[common(b, a)]))
    return 0


def doubt_about(
    proposal: Proposal, confidence: float, scale: tuple[float, float] = (1.0, 1.0)
) -> list[Doubt]:
    """Return a doubtful object with few corners, or none if its outline is too thin.

    The photo is `scale` (horizontal, vertical) times as large as the proposal's grid.
    """
    contour = outline(proposal.mask)
    corners = cv2.approxPolyDP(contour, STRAIGHT * cv2.arcLength(contour, True), True)[
        :, 0
    ] + [proposal.x, proposal.y]
    if len(corners) < 3:
        return []
    points = np.round((corners + 0.5) * scale - 0.5, 1)
    return [Doubt([(float(x), float(y)) for x, y in points], round(confidence, 3))]


def distinct(proposals: Sequence[Proposal], least_iou: float = 0.96) -> list[Proposal]:
    """Return proposals by area, without those whose IoU with a smaller one exceeds
    `least_iou`.
    """
    distinct_proposals: list[Proposal] = []
    # From this index, proposals are large enough to equal the current one.
    first = 0
    for candidate in sorted(proposals, key=lambda proposal: proposal.area):
        while (
            first < len(distinct_proposals)
            and distinct_proposals[first].area < least_iou * candidate.area
        ):
            first += 1
        slack = 4 + 0.12 * sum(candidate.mask.shape)
        for other in distinct_proposals[first:]:
            if (
                sum(abs(p - q) for p, q in zip(candidate.box, other.box, strict=True))
                <= slack
            ):
                intersection = overlap(candidate, other)
                if intersection > least_iou * (
                    candidate.area + other.area - intersection
                ):
                    break
        else:
            distinct_proposals.append(candidate)
    return distinct_proposals


def iou(a: Proposal, b: Proposal) -> float:
    """Return the intersection over union."""
    common = overlap(a, b)
    return common / max(a.area + b.area - common, 1)


POINTS = 96
"""Samples along an outline."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores and compactness (n,) float64."""

    # About 0.6 for a doubtful object, 1 for a perfect one.
    score: NDArray[np.float64]
    # Isoperimetric quotient: 1 for a disc, less for longer outlines.
    compactness: NDArray[np.float64]


def contour_normals(contour: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the outward unit normals (n, 2) of a closed contour (n, 2) of pixels.

    The staircase of the pixels is smoothed.
    """
    sigma = max(1.0, 0.012 * len(contour))
    ends = int(3 * sigma) + 3
    indices = np.arange(-ends, len(contour) + ends) % len(contour)
    periodic = contour[indices].astype(np.float64)
    smooth_contour = cv2.GaussianBlur(
        periodic, (1, 2 * ends - 3), sigmaX=0.1, sigmaY=sigma
    )
    tangents = (smooth_contour[4:] - smooth_contour[:-4])[
        ends - 2 : ends - 2 + len(contour)
    ]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True) + 1e-6
    x, y = contour.T.astype(np.float64)
    if (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() >= 0:
        turn = 1
    else:
        turn = -1
    return turn * np.stack([tangents[:, 1], -tangents[:, 0]], 1)


EXPONENTS = {
    "cover": 1.2,  # edges along the whole outline
    "weakest": 0.6,  # and along its weakest quarter
    "contrast": 0.6,  # between the two sides of the outline
    "solidity": 2.0,
    "likeness": 1.0,  # to an ellipse or a polygon of few corners
    "compactness": 0.5,
    "free": 1.5,  # share of the outline that the photo's border does not cut off
}
"""Exponents of the terms of a score, chosen on photos."""
EXPONENT_SUM = 2.4
"""Divisor of the sum of their logarithms, chosen on photos."""
HIGHEST = {"cover": 1.001, "weakest": 1.05, "contrast": 1.01, "likeness": 1.001}
"""Largest values of the costly terms."""
# Rounding error of the highest possible score.
ROUNDING = 1e-6
CROSSING = 0.6
"""Factor of the score of a proposal across the photo from border to border."""
# px from the photo's border within which an outline has no edge.
BORDER = 2.5
Terms = dict[str, Array]
"""Values (n,) by the name of their exponent."""


def score_proposals(
    proposals: Sequence[Proposal],
    colour: NDArray[np.float32],
    gradient: Gradient,
    least_score: float = 0.0,
) -> Scores:
    """Return the scores of proposals from their outlines and shapes.

    A score is a weighted geometric mean of the terms in EXPONENTS. Scores that cannot
    exceed `least_score` are 0, and their costly terms are not computed.
    """
    if not proposals:
        return Scores(np.zeros(0), np.zeros(0))
    contours = [outline(proposal.mask) for proposal in proposals]
    terms, compactness = _outline_terms(proposals, contours, gradient.strength.shape)
    is_crossing = _crosses(proposals, gradient.strength.shape)
    factor = np.where(is_crossing, CROSSING, 1)
    places = _in_reach(terms, factor, least_score)
    candidates = [proposals[k] for k in places.tolist()]
    loops = [contours[k] for k in places.tolist()]
    terms = {name: values[places] for name, values in terms.items()}
    terms |= _edge_terms(candidates, loops, colour, gradient)
    remaining = _in_reach(terms, factor[places], least_score)
    terms = {name: values[remaining] for name, values in terms.items()}
    likenesses = [_likeness(candidates[k].mask, loops[k]) for k in remaining.tolist()]
    terms["likeness"] = np.array(likenesses) + 1e-3
    places = places[remaining]
    score = np.zeros(len(proposals))
    score[places] = factor[places] * _mean_score(terms)
    return Scores(score, compactness)


def _mean_score(terms: Mapping[str, Array | float]) -> Array:
    """Return the weighted geometric mean (n,) of all terms."""
    total = sum(power * np.log(terms[name]) for name, power in EXPONENTS.items())
    return np.asarray(np.exp(total / EXPONENT_SUM))


def _in_reach(terms: Terms, factor: Array, least_score: float) -> NDArray[np.intp]:
    """Return the indices of proposals with a possible score above `least_score`."""
    highest = factor * _mean_score({**HIGHEST, **terms})
    return np.flatnonzero(highest > least_score - ROUNDING)


def _crosses(
    proposals: Sequence[Proposal], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return (n,) whether proposals reach from one border of the photo to the other."""
    left, top, right, bottom = np.array([proposal.box for proposal in proposals]).T
    crosses_width = (left <= 2) & (right >= shape[1] - 2)
    crosses_height = (top <= 2) & (bottom >= shape[0] - 2)
    return np.asarray(crosses_width | crosses_height)


def _outline_terms(
    proposals: Sequence[Proposal],
    contours: Sequence[NDArray[np.int32]],
    shape: tuple[int, int],
) -> tuple[Terms, Array]:
    """Return the terms from outlines alone, and the compactness (n,)."""
    free = np.zeros((len(proposals), POINTS), np.bool_)
    forms = np.zeros((len(proposals), 2))
    for k, (proposal, contour) in enumerate(zip(proposals, contours, strict=True)):
        free[k] = _is_free(
            contour[_sample_places(contour)] + (proposal.x, proposal.y), shape
        )
        area = cv2.contourArea(contour)
        length = cv2.arcLength(contour, True)
        hull = cv2.contourArea(cv2.convexHull(contour))
        forms[k, 0] = (area + length / 2 + 1) / (hull + length / 2 + 1)
        forms[k, 1] = 4 * np.pi * area / max(length, 1) ** 2
    solidity, compactness = forms.T
    terms = {
        "solidity": solidity,
        "compactness": np.clip(5 * compactness, 0.01, 1),
        "free": np.maximum(free.mean(1), 0.01),
    }
    return terms, compactness


def _sample_places(contour: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the indices (POINTS,) of samples along an outline."""
    return np.linspace(0, len(contour), POINTS, endpoint=False).astype(int)


def _is_free(
    points: NDArray[np.integer] | Array, shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return whether points (..., 2) of an outline are away from the photo's border."""
    x, y = np.moveaxis(points, -1, 0)
    low = BORDER
    right = shape[1] - 1
    bottom = shape[0] - 1
    is_inside = (x >= low) & (y >= low) & (x <= right - low) & (y <= bottom - low)
    return np.asarray(is_inside)


def _edge_terms(
    proposals: Sequence[Proposal],
    contours: Sequence[NDArray[np.int32]],
    colour: NDArray[np.float32],
    gradient: Gradient,
) -> Terms:
    """Return the terms from edges and colours along outlines."""
    rim = _sample_rims(proposals, contours)
    free = _is_free(rim[..., :2], gradient.strength.shape)
    count = np.maximum(free.sum(1), 1)
    areas = np.array([proposal.area for proposal in proposals]).reshape(-1, 1)
    reach = np.clip(0.03 * np.sqrt(areas), 1.5, 4)
    edge = _search_edges_along(rim, reach, gradient)
    support = np.where(free, gradient.support(edge), np.inf)
    cover = np.where(free, support, 0).sum(1) / count
    weakest = _weakest_quarters(support, count)
    weakest[free.sum(1) <= 8] = 0
    contrast = (_contrasts(rim, np.maximum(3, reach), colour) * free).sum(1) / count
    return {
        "cover": cover + 1e-3,
        "weakest": weakest + 0.05,
        "contrast": contrast + 0.01,
    }


def _sample_rims(
    proposals: Sequence[Proposal], contours: Sequence[NDArray[np.int32]]
) -> Array:
    """Return x, y and normal (n, POINTS, 4) of samples along outlines."""
    rim = np.zeros((len(proposals), POINTS, 4))
    for k, (proposal, contour) in enumerate(zip(proposals, contours, strict=True)):
        places = _sample_places(contour)
        rim[k, :, :2] = contour[places] + (proposal.x, proposal.y)
        rim[k, :, 2:] = contour_normals(contour)[places]
    return rim


def _search_edges_along(rim: Array, reach: Array, gradient: Gradient) -> Array:
    """Return the strongest edge (n, POINTS) at most `reach` (n, 1) px from samples.

    The edge may lie a little inside or outside the mask's outline.
    """
    x, y, nx, ny = np.moveaxis(rim, 2, 0)
    angle = np.arctan2(ny, nx)
    edge = np.zeros_like(x)
    for step in np.linspace(-1, 1, 7):
        strength = gradient.measure_across(
            x + step * reach * nx, y + step * reach * ny, angle
        )
        edge = np.maximum(edge, strength * (1 - 0.25 * step * step))
    return np.asarray(edge)


def _weakest_quarters(support: Array, count: NDArray[np.int64]) -> Array:
    """Return the mean support (n,) of the weakest quarter of `count` (n,) samples."""
    rising = np.sort(support, 1)
    quarters = []
    for row, n in zip(rising, count, strict=True):
        quarters.append(row[: max(1, n // 4)].mean())
    return np.array(quarters)


def _contrasts(rim: Array, side: Array, colour: NDArray[np.float32]) -> Array:
    """Return the colour steps (n, POINTS) 0..1 between both sides of outlines.

    Colours are compared `side` px from the outline.
    """
    blurred_colour = cv2.GaussianBlur(colour, (0, 0), 1.5).astype(np.float32)
    x, y, nx, ny = np.moveaxis(rim, 2, 0)
    inside = sample(blurred_colour, x - side * nx, y - side * ny)
    outside = sample(blurred_colour, x + side * nx, y + side * ny)
    step = np.linalg.norm(inside - outside, axis=2)
    return np.asarray(step / (step + 8))


def _likeness(mask: Mask, contour: NDArray[np.int32]) -> float:
    """Return the IoU with the best fitting ellipse or polygon of few corners."""
    y, x = np.nonzero(mask)
    spread = np.cov(x, y) + 0.08 * np.eye(2)
    x_offset = np.arange(mask.shape[1]) - x.mean()
    y_offset = np.arange(mask.shape[0])[:, None] - y.mean()
    form = np.linalg.inv(spread)
    distance = (
        form[0, 0] * x_offset**2
        + 2 * form[0, 1] * x_offset * y_offset
        + form[1, 1] * y_offset**2
    )
    shapes = [distance <= 4]
    blank = np.zeros(mask.shape, np.uint8)
    shapes += [
        cv2.fillPoly(blank.copy(), [corners], 1) > 0 for corners in polygons(contour)
    ]
    return max(float((shape & mask).sum() / (shape | mask).sum()) for shape in shapes)
