"""Objects from user prompts: boxes, points and label maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import log

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    Category,
    Detections,
    Labels,
    Name,
    PromptedMask,
    Rgb,
    Segments,
)
from physgen.perceive.segment.candidates import guided_proposals, judged_fit, network_proposals, rescaled
from physgen.perceive.segment.gradient import Gradient, colour_gradient, smoothed_lab
from physgen.perceive.segment.network import NetworkMaps, run_network
from physgen.perceive.segment.proposals import (
    Floats,
    Proposal,
    agreement,
    cut_out,
    distinct,
    iou,
    score_proposals,
    variants,
)
from physgen.perceive.segment.regions import discs, stable_regions
from physgen.perceive.segment.selection import tighten
from physgen.problems import InputError, Place, Problem, Severity
from physgen.registry import Backends

Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""
Point = tuple[float, float]
"""x px, y px."""
PROMPT_ODDS = 6.0
"""Factor by which a prompt raises the odds of an object: on the studio's photos and homes, 0.75 of the boxes that the
network gives 0.1, and 0.98 of those that it gives 0.6, are cut out with an IoU of half or more."""


@dataclass(frozen=True)
class PromptSearch:
    """Constants of the search for prompted objects, chosen on the studio's photos for tuning, homes and peers' photos.

    Boxes were 10 % loose or had sides 10 % off.
    """

    weak: float = 0.33  # confidence below which the user is asked to check the object
    likely: float = 0.6  # confidence from which a point takes the segmenter's object
    visible: float = 0.3  # share of a prompted object that the others must leave visible
    kept: int = 25  # proposals whose variants are scored
    score_power: float = 2.0
    colour_power: float = 0.25  # of the IoU with GrabCut's result
    agreement_power: float = 1.0
    box_side: float = 100
    """px: geometric mean of a box's sides at working size; smaller boxes are enlarged, up to `zoom` times."""
    zoom: float = 3.0
    margin: float = 0.35  # of a box's sides: searched around it, 8 px at least
    reach: float = 0.25  # of a box's sides, that a proposal may lie outside
    box_areas: tuple[float, float] = (0.12, 1.4)  # of a box's area: bounds of a proposal's
    box_band: float = 0.02
    """Movement of the final outline, in square roots of its area: small, since edges were fitted before."""
    network_side: int = 256  # px: the longer side of a box's surroundings in the network's look
    forgiven: float = 0.09  # of a box's sides: distance of an object's side from the box's without a penalty
    spread: float = 0.09  # of a box's sides: scale of the penalty beyond
    photo_area: int = 512 * 512  # px searched for points; larger photos are reduced to it
    point_areas: tuple[float, float] = (0.0003, 0.6)
    """Of the photo's area: bounds of the area of an object at a point."""
    point_band: float = 0.04  # as `box_band`
    least_score: float = 0.2  # below which a proposal at a point is no object
    area_power: float = 0.1  # users mean wholes rather than parts
    depth_power: float = 2.0  # of how deep inside the object a point lies


SEARCH = PromptSearch()


@dataclass(frozen=True)
class Segmenter:
    """The role `segment` with its nouns; where there are none, the role `categories` finds them."""

    backends: Backends
    nouns: Sequence[str] = ()

    def __call__(self, rgb: Rgb) -> Segments:
        """Objects found in the photo."""
        categories: Sequence[Category] = [Category(noun, True) for noun in self.nouns]
        if "categories" in self.backends.row("segment").uses and not categories:
            categories = self.backends.call("categories", rgb)
            self.backends.release("categories")
        found: Segments = self.backends.call("segment", rgb, categories=categories)
        return found

    def answers(self, rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point]) -> dict[int, PromptedMask]:
        """The masks of a backend that takes prompts itself, by their place in the order of boxes and points.

        Empty where one is off the photo, which is reported later.
        """
        if not (boxes or points) or not hasattr(self.backends.get("segment"), "meant"):
            return {}
        try:
            corners = [_corners(rgb, box) for box in boxes]
            for point in points:
                _pixel(rgb, point)
        except InputError:
            return {}
        sides = [(x0, y0, x1 - x0, y1 - y0) for x0, y0, x1, y1 in corners]
        masks = self.backends.run("segment", lambda backend: backend.meant(rgb, sides, points))
        return {k: one for k, one in enumerate(masks) if np.count_nonzero(one.mask) >= SMALLEST_OBJECT}


def from_masks(labels: NDArray[np.uint16], names: Mapping[int, str] | None = None) -> Detections:
    """The objects of a label map (H, W); `names` are known labels by id."""
    known = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Detections(labels, "given", {}, known)


def from_prompts(rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segmenter) -> Detections:
    """One object for each box and then for each point: ids 1, 2, ...

    A backend that takes prompts answers first. The rest is searched among proposals: a box by `object_in_box`; a
    point takes the object that `segment` finds there, unless another point lies on it too and asks for less, else
    `object_at_pixel`.
    Raises InputError with every box or point that is off the photo or shows no object.
    """
    masks: list[PromptedMask] = []
    problems: list[Problem] = []
    known = cache(lambda: photo_proposals(rgb))
    found = cache(lambda: segment(rgb))
    answers = segment.answers(rgb, boxes, points)
    for k, box in enumerate(boxes):
        try:
            masks.append(answers.get(k) or segment_box(rgb, box))
        except InputError as error:
            problems += error.problems
    for k, point in enumerate(points, len(boxes)):
        try:
            masks.append(answers.get(k) or segment_point(rgb, point, found(), known, points))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    for k in sorted(range(len(masks)), key=lambda k: -int(masks[k].mask.sum())):  # small objects in front
        labels[masks[k].mask] = k + 1
    places = [("box", box) for box in boxes] + [("point", point) for point in points]
    for k, (kind, place) in enumerate(places, 1):
        least = max(SEARCH.visible * np.count_nonzero(masks[k - 1].mask), SMALLEST_OBJECT)
        if np.count_nonzero(labels == k) < least:
            expected = "shows what another box or point shows"
            problems += InputError.of(_flag(kind, place), "", expected, "leave one out").problems
    if problems:
        raise InputError(problems)
    prompts = {k: {kind: [round(float(v), 2) for v in place]} for k, (kind, place) in enumerate(places, 1)}
    fits = {k: one.confidence for k, one in enumerate(masks, 1)}
    confidence = {k: PROMPT_ODDS * fit / (1 + (PROMPT_ODDS - 1) * fit) for k, fit in fits.items()}
    return Detections(labels, "pointed at", confidence, {}, prompts)


def weak_prompts(found: Detections) -> Iterator[Problem]:
    """A warning for each prompt whose object hardly stands out."""
    for i, prompt in found.prompts.items():
        if found.confidence[i] < SEARCH.weak:
            (kind, place), *_ = prompt.items()
            expected, fix = (
                "shows nothing that stands out",
                "look at its outline, or draw the mask: --masks FILE",
            )
            yield Problem(Place(_flag(kind, place)), "", "", expected, fix, Severity.WARNING)


def likely_labels(segments: Segments) -> Labels:
    """(H, W): the label map without unlikely objects."""
    keep = np.concatenate([[False], segments.confidence >= SEARCH.likely])
    return np.where(keep[np.minimum(segments.labels, len(keep) - 1)], segments.labels, np.uint16(0))


def segment_box(rgb: Rgb, box: Box) -> PromptedMask:
    """The object in a box, in one piece. Raises InputError where the box leaves too little of the photo."""
    return object_in_box(rgb, _corners(rgb, box))


def segment_point(
    rgb: Rgb,
    point: Point,
    segments: Segments | None,
    known: Callable[[], PhotoProposals] | None = None,
    points: Sequence[Point] = (),
) -> PromptedMask:
    """The object at a point: of `segments`, else the best proposal. Raises InputError where there is none.

    `known` returns the photo's proposals, computed once for many points. What also holds another of the `points`
    is not meant.
    """
    height, width = rgb.shape[:2]
    x, y = _pixel(rgb, point)
    others = [(round(u), round(v)) for u, v in points if (u, v) != tuple(point)]
    others = [(u, v) for u, v in others if 0 <= u < width and 0 <= v < height]
    i = int(likely_labels(segments)[y, x]) if segments is not None else 0
    if segments is not None and i and not any(segments.labels[v, u] == i for u, v in others):
        return PromptedMask(segments.labels == i, float(segments.confidence[i - 1]))
    best = object_at_pixel(rgb, known() if known else photo_proposals(rgb), x, y, others)
    if best is not None:
        return best
    fix = "draw a box around it: --box x,y,w,h"
    raise InputError.of(_flag("point", point), "", "shows no object that ends somewhere", fix)


def _flag(kind: str, place: Sequence[float]) -> str:
    return f"--{kind} {','.join(f'{v:g}' for v in place)}"


def _corners(rgb: Rgb, box: Box) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of the part of a box on the photo. Raises InputError where that is too small."""
    height, width = rgb.shape[:2]
    x0, y0 = max(0, round(box[0])), max(0, round(box[1]))
    x1, y1 = min(width, round(box[0] + box[2])), min(height, round(box[1] + box[3]))
    if x1 - x0 < 4 or y1 - y0 < 4:
        expected = f"leaves under 4 px of the {width} x {height} photo"
        raise InputError.of(_flag("box", box), "", expected, "write x,y,width,height in px")
    return x0, y0, x1, y1


def _pixel(rgb: Rgb, point: Point) -> tuple[int, int]:
    """Column and row of a point. Raises InputError where it is off the photo."""
    height, width = rgb.shape[:2]
    x, y = round(point[0]), round(point[1])
    if not (0 <= x < width and 0 <= y < height):
        raise InputError.of(
            _flag("point", point), "", f"is off the {width} x {height} photo", "write x,y in px"
        )
    return x, y


def object_in_box(rgb: Rgb, box: tuple[int, int, int, int]) -> PromptedMask:
    """The object in a box (left, top, right, bottom px, within the photo, the last two just outside).

    Boxes drawn by hand are loose or cut a little off, so a proposal's distance from the box has a soft penalty.
    Confidence 0 and the whole box where there is no proposal.
    """
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box
    across, down = max(8, round(SEARCH.margin * (x1 - x0))), max(8, round(SEARCH.margin * (y1 - y0)))
    left, top = max(0, x0 - across), max(0, y0 - down)
    right, bottom = min(width, x1 + across), min(height, y1 + down)
    part = np.ascontiguousarray(rgb[top:bottom, left:right])
    area = (x1 - x0) * (y1 - y0)
    scale = min(SEARCH.zoom, SEARCH.box_side / float(np.sqrt(area)))
    size = max(8, round((right - left) * scale)), max(8, round((bottom - top) * scale))
    zoom = np.array([size[0] / (right - left), size[1] / (bottom - top)])
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = np.asarray(cv2.resize(part, size, interpolation=method), np.uint8)
    smallest, largest = (max(20, round(share * area * zoom.prod())) for share in SEARCH.box_areas)
    sides = np.array([x0 - left, y0 - top, x1 - left, y1 - top]) * np.tile(zoom, 2)
    by_colour = _grabcut_proposals(small, sides, smallest)
    look = _photo_proposals(small, run_network(small, (SEARCH.network_side,)), smallest, largest, by_colour)

    def prior(one: Proposal) -> float:
        alike = max((iou(one, other) for other in by_colour), default=0.0)
        return SEARCH.colour_power * log(0.15 + alike) - _misfit(one, sides)

    best = _best(look, prior)
    mask = np.zeros((height, width), np.bool_)
    if best is None:
        mask[y0:y1, x0:x1] = True
        return PromptedMask(mask, 0.0)
    mask[top:bottom, left:right] = tighten(part, [best.proposal.on(size[::-1])], SEARCH.box_band) > 0
    return PromptedMask(mask, best.fit)


def _grabcut_proposals(rgb: Rgb, box: Floats, smallest: int) -> list[Proposal]:
    """Proposals of GrabCut (Rother, Kolmogorov, Blake 2004) from the box, and from the ellipse in it."""
    y, x = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
    off_x = np.abs(x - (box[0] + box[2] - 1) / 2) / ((box[2] - box[0]) / 2)
    off_y = np.abs(y - (box[1] + box[3] - 1) / 2) / ((box[3] - box[1]) / 2)
    square, around = np.maximum(off_x, off_y), np.hypot(off_x, off_y)
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    found = []
    for outer, inner, core in (
        (square <= 1.0, square <= 1.0, np.zeros(square.shape, np.bool_)),
        (square <= 1.2, square < 0.84, around < 0.45),
        (square <= 1.2, around < 0.85, around < 0.5),
    ):
        state = np.where(outer, np.uint8(cv2.GC_PR_BGD), np.uint8(cv2.GC_BGD))
        state[inner] = cv2.GC_PR_FGD
        state[core] = cv2.GC_FGD
        if (state == cv2.GC_BGD).sum() < 16 or not inner.any():
            continue
        cv2.setRNGSeed(0)
        models = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.grabCut(bgr, state, (0, 0, 1, 1), *models, 2, cv2.GC_INIT_WITH_MASK)
        one = cut_out(np.isin(state, (cv2.GC_FGD, cv2.GC_PR_FGD)), 0, 0, smallest, opening=1)
        if one is not None:
            found.append(one)
    return found


def _misfit(one: Proposal, box: Floats) -> float:
    """Quadratic penalty of the distance between a proposal's sides and the box's; infinite far outside it."""
    length = np.array([box[2] - box[0], box[3] - box[1]] * 2)
    inside = (np.array(one.box) - box) * [1, 1, -1, -1] / length
    if inside.min() <= -SEARCH.reach:
        return float("inf")
    off = np.maximum(0, np.abs(inside) - SEARCH.forgiven)
    return float((off**2).sum() / (2 * SEARCH.spread**2))


@dataclass(frozen=True, eq=False)
class PhotoProposals:
    """The proposals of a photo, computed once for all points."""

    rgb: Rgb  # (h, w, 3) at working size
    colour: NDArray[np.float32]  # (h, w, 3) CIELAB
    gradient: Gradient
    seen: NetworkMaps
    proposals: list[Proposal]
    fit: Floats  # (n,) 0..1: the network's expected fit of each


def photo_proposals(rgb: Rgb) -> PhotoProposals:
    """The proposals of a photo (H, W, 3)."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (SEARCH.photo_area / (height * width)) ** 0.5)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb, np.uint8)
    least, most = (max(SMALLEST_OBJECT, round(share * size[0] * size[1])) for share in SEARCH.point_areas)
    return _photo_proposals(small, run_network(rgb), least, most)


def _photo_proposals(
    rgb: Rgb, seen: NetworkMaps, smallest: int, largest: int, more: Sequence[Proposal] = ()
) -> PhotoProposals:
    """From edges, circles and the network, of areas within bounds, px, and `more`."""
    colour = smoothed_lab(rgb)
    gradient = colour_gradient(colour)
    shape, grid = (rgb.shape[0], rgb.shape[1]), seen.foreground
    least = max(SMALLEST_OBJECT, round(smallest * grid.size / (shape[0] * shape[1])))
    found = stable_regions(colour, gradient, smallest, largest) + discs(gradient, smallest, largest)
    parts, wholes = network_proposals(seen, least, grid.size)
    own = (rescaled(one, grid.shape, shape) for one in parts + wholes)
    found += [one for one in own if one is not None and smallest <= one.area <= largest]
    found = distinct([*found, *guided_proposals(gradient, seen, smallest, largest), *more])
    return PhotoProposals(rgb, colour, gradient, seen, found, judged_fit(found, seen, shape))


@dataclass(frozen=True)
class _Best:
    """The proposal that a prompt means, its expected fit, and the score of its looks."""

    proposal: Proposal
    fit: float
    score: float


def _best(look: PhotoProposals, prior: Callable[[Proposal], float]) -> _Best | None:
    """The proposal, or variant of one, of the best looks, fit and `prior`, a logarithm; None where all are -inf."""
    priors = np.array([prior(one) for one in look.proposals])
    some = np.flatnonzero(priors > -np.inf)
    around = [look.proposals[k] for k in some.tolist()]
    if not around:
        return None
    score = score_proposals(around, look.colour, look.gradient).score
    good = _worth(score, look.fit[some]) + priors[some]
    best = np.argsort(-good, kind="stable")[: SEARCH.kept].tolist()
    shape = look.rgb.shape[0], look.rgb.shape[1]
    forms = [form for k in best for form in variants(around[k], shape) if prior(form) > -np.inf]
    fit, score = judged_fit(forms, look.seen, shape), score_proposals(forms, look.colour, look.gradient).score
    worth = _worth(score, fit) + [prior(form) for form in forms]
    k = int((worth + SEARCH.agreement_power * agreement(forms, worth)).argmax())
    return _Best(forms[k], float(fit[k]), float(score[k]))


def _worth(score: Floats, fit: Floats) -> Floats:
    """(n,): the logarithm of how good proposals are by looks and by fit, (n,) each."""
    return SEARCH.score_power * np.log(np.maximum(score, 0.02)) + np.log(np.maximum(fit, 0.05))


def object_at_pixel(
    rgb: Rgb, known: PhotoProposals, x: int, y: int, others: Sequence[tuple[int, int]] = ()
) -> PromptedMask | None:
    """The best of the `known` proposals at a pixel of the photo, and at none of the `others`; None where none scores
    like an object."""
    shape = known.rgb.shape[0], known.rgb.shape[1]
    at, *off = (
        (
            min(shape[1] - 1, int((u + 0.5) * shape[1] / rgb.shape[1])),
            min(shape[0] - 1, int((v + 0.5) * shape[0] / rgb.shape[0])),
        )
        for u, v in ((x, y), *others)
    )

    def prior(one: Proposal) -> float:
        depth = _depth(one, at)
        if depth == 0 or any(_depth(one, other) for other in off):
            return -float("inf")
        return SEARCH.area_power * log(one.area) + SEARCH.depth_power * log(max(depth, 0.05))

    best = _best(known, prior)
    if best is None or best.score < SEARCH.least_score:
        return None
    mask = tighten(rgb, [best.proposal.on(shape)], SEARCH.point_band) > 0
    return PromptedMask(np.asarray(mask), best.fit)


def _depth(one: Proposal, at: tuple[int, int]) -> float:
    """How deep inside a proposal a pixel of working size lies: 1 at the deepest pixel, 0 outside."""
    x, y = at[0] - one.x, at[1] - one.y
    if not (0 <= y < one.mask.shape[0] and 0 <= x < one.mask.shape[1] and one.mask[y, x]):
        return 0.0
    depth = cv2.distanceTransform(np.pad(one.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    return float(depth[y + 1, x + 1] / depth.max())
