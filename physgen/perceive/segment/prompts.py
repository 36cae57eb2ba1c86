"""Objects from user prompts: boxes, points and label maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    Category,
    Detections,
    Labels,
    Name,
    Prompted,
    PromptedMask,
    Rgb,
    Segment,
    Segments,
)
from physgen.perceive.segment.candidates import guided_proposals, judged_fit, network_proposals, rescaled
from physgen.perceive.segment.gradient import Gradient, colour_gradient, smoothed_lab
from physgen.perceive.segment.network import NetworkMaps, run_network
from physgen.perceive.segment.proposals import (
    Proposal,
    agreement,
    cut_out,
    distinct,
    iou,
    score_proposals,
    unions,
    variants,
)
from physgen.perceive.segment.regions import discs, stable_regions
from physgen.perceive.segment.selection import tighten
from physgen.problems import InputError, Place, Problem, Severity
from physgen.registry import Backends

Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""
Point = tuple[float, float]
"""x px, y px."""
PROMPT_ODDS = 6.0
"""Factor by which a prompt raises the odds of an object: on the studio's photos and homes, 0.75 of the boxes that the
network gives 0.1, and 0.98 of those that it gives 0.6, are cut out with an IoU of half or more."""
WEAK = 0.25
"""Confidence below which the user is asked to check the object."""
LIKELY = 0.5
"""Confidence from which a point takes the segmenter's object."""
VISIBLE_SHARE = 0.3
"""Of a prompted object, that the others must leave visible."""
COLOUR_CONFIDENCE = 0.2
"""Of an area of one colour without an outline of its own."""
COLOUR_RANGE = (40, 18, 18)
"""8-bit CIELAB units around a point's colour that belong to its area."""


@dataclass(frozen=True)
class BoxSearch:
    """Constants of the search in a box.

    Chosen on the studio's photos for tuning and on peers' photos, with boxes 10 % loose and with sides 10 % off.
    """

    side: float = 100
    """px: geometric mean of the box's sides at working size; smaller boxes are enlarged, up to `largest_zoom` times."""
    largest_zoom: float = 3.0
    margin: float = 0.35
    """Of the box's sides: searched around it, 8 px at least."""
    reach: float = 0.25
    """Of the box's sides, that a proposal may lie outside."""
    areas: tuple[float, float] = (0.12, 1.4)
    """Of the box's area: bounds of a proposal's."""
    square: float = 1.6
    """Ratio of sides up to which discs are searched."""
    near: int = 70
    """Proposals that fit the box best and are scored; of unions 60."""
    kept: int = 12
    """Proposals whose variants are scored."""
    band: float = 0.02
    """Movement of the final outline, in square roots of its area: small, since edges were fitted before."""
    network_side: int = 256
    """px: the longer side in the network's look."""
    network_part: int = 40
    """px of the network's grid: its smallest proposal."""
    forgiven: float = 0.09
    """Of the box's sides: distance of an object's side from the box's without a penalty."""
    spread: float = 0.09
    """Of the box's sides: scale of the penalty beyond."""
    score_power: float = 2.0
    colour_power: float = 0.25
    """Of the IoU with GrabCut's result."""


@dataclass(frozen=True)
class PointSearch:
    """Constants of the search at a point. Chosen on the studio's photos for tuning and on peers' photos."""

    area: int = 512 * 512
    """px searched; larger photos are reduced to it."""
    areas: tuple[float, float] = (0.0003, 0.22)
    """Of the photo's area: bounds of an object's."""
    kept: int = 25
    """Proposals whose variants are scored."""
    least_score: float = 0.35
    """Below which a proposal is no object."""
    band: float = 0.04
    """Movement of the final outline, in square roots of its area."""
    network_part: int = 14
    """px of the network's grid: its smallest proposal."""
    score_power: float = 2.0
    area_power: float = 0.1
    """Users mean wholes rather than parts."""
    depth_power: float = 2.0
    """Of how deep inside the object the point lies."""
    agreement_power: float = 2.0


BOX, POINT = BoxSearch(), PointSearch()


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


class PromptedSegmenter(Segmenter):
    """A segmenter that takes boxes and points itself."""

    def meant(self, rgb: Rgb, boxes: Sequence[Any], points: Sequence[Any]) -> Sequence[PromptedMask]:
        """See `Prompted`; empty where the fallback takes no prompts."""
        masks: Sequence[PromptedMask] = self.backends.run(
            "segment",
            lambda backend: backend.meant(rgb, boxes, points) if isinstance(backend, Prompted) else (),
        )
        return masks


def segmenter(backends: Backends, nouns: Sequence[str] = ()) -> Segment:
    """The segmenter of a run: a `Prompted` one where its backend is."""
    prompted = not backends.failed("segment") and isinstance(backends.get("segment"), Prompted)
    return PromptedSegmenter(backends, nouns) if prompted else Segmenter(backends, nouns)


def from_masks(labels: NDArray[np.uint16], names: Mapping[int, str] | None = None) -> Detections:
    """The objects of a label map (H, W); `names` are known labels by id."""
    known = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Detections(labels, "given", {}, known)


def from_prompts(rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment) -> Detections:
    """One object for each box and then for each point: ids 1, 2, ...

    A `segment` that takes prompts answers first. The rest is searched among proposals: a box by `object_in_box`; a
    point takes the object that `segment` finds there, else `object_at_pixel`, else the area of one colour around it.
    Raises InputError with every box or point that is off the photo or shows no object.
    """
    masks: list[PromptedMask] = []
    problems: list[Problem] = []
    known = cache(lambda: photo_proposals(rgb))
    found = cache(lambda: segment(rgb))
    answers = prompted_answers(rgb, boxes, points, segment)
    for k, box in enumerate(boxes):
        try:
            masks.append(answers.get(k) or segment_box(rgb, box))
        except InputError as error:
            problems += error.problems
    for k, point in enumerate(points, len(boxes)):
        try:
            masks.append(answers.get(k) or segment_point(rgb, point, found(), known))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    for k in sorted(range(len(masks)), key=lambda k: -int(masks[k].mask.sum())):  # small objects in front
        labels[masks[k].mask] = k + 1
    places = [("box", box) for box in boxes] + [("point", point) for point in points]
    for k, (kind, place) in enumerate(places, 1):
        least = max(VISIBLE_SHARE * np.count_nonzero(masks[k - 1].mask), SMALLEST_OBJECT)
        if np.count_nonzero(labels == k) < least:
            expected = "shows what another box or point shows"
            problems += InputError.of(_flag(kind, place), "", expected, "leave one out").problems
    if problems:
        raise InputError(problems)
    prompts = {k: {kind: [round(float(v), 2) for v in place]} for k, (kind, place) in enumerate(places, 1)}
    fits = {k: one.confidence for k, one in enumerate(masks, 1)}
    confidence = {k: PROMPT_ODDS * fit / (1 + (PROMPT_ODDS - 1) * fit) for k, fit in fits.items()}
    return Detections(labels, "pointed at", confidence, {}, prompts)


def prompted_answers(
    rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment
) -> dict[int, PromptedMask]:
    """The masks of a segmenter that takes prompts, by their place in the order of boxes and points.

    Empty where one is off the photo, which is reported later.
    """
    if not isinstance(segment, Prompted) or not (boxes or points):
        return {}
    try:
        corners = [_corners(rgb, box) for box in boxes]
        for point in points:
            _pixel(rgb, point)
    except InputError:
        return {}
    masks = segment.meant(rgb, [(x0, y0, x1 - x0, y1 - y0) for x0, y0, x1, y1 in corners], points)
    return {k: one for k, one in enumerate(masks) if np.count_nonzero(one.mask) >= SMALLEST_OBJECT}


def weak_prompts(found: Detections) -> Iterator[Problem]:
    """A warning for each prompt whose object hardly stands out."""
    for i, prompt in found.prompts.items():
        if found.confidence[i] < WEAK:
            (kind, place), *_ = prompt.items()
            expected, fix = (
                "shows nothing that stands out",
                "look at its outline, or draw the mask: --masks FILE",
            )
            yield Problem(Place(_flag(kind, place)), "", "", expected, fix, Severity.WARNING)


def likely_labels(segments: Segments) -> Labels:
    """(H, W): the label map without objects below `LIKELY`."""
    keep = np.concatenate([[False], segments.confidence >= LIKELY])
    return np.where(keep[np.minimum(segments.labels, len(keep) - 1)], segments.labels, np.uint16(0))


def segment_box(rgb: Rgb, box: Box) -> PromptedMask:
    """The object in a box, in one piece. Raises InputError where the box leaves too little of the photo."""
    return object_in_box(rgb, _corners(rgb, box))


def segment_point(
    rgb: Rgb, point: Point, segments: Segments | None, known: Callable[[], PhotoProposals] | None = None
) -> PromptedMask:
    """The object at a point: of `segments`, else the best proposal, else the area of one colour.

    `known` returns the photo's proposals, computed once for many points.
    """
    height, width = rgb.shape[:2]
    x, y = _pixel(rgb, point)
    if segments is not None and (i := int(likely_labels(segments)[y, x])):
        return PromptedMask(segments.labels == i, float(segments.confidence[i - 1]))
    best = object_at_pixel(known() if known else photo_proposals(rgb), x, y)
    if best is not None:
        return best
    lab = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB), (0, 0), 1.0)
    area = np.zeros((height + 2, width + 2), np.uint8)
    flags = 4 | cv2.FLOODFILL_MASK_ONLY | cv2.FLOODFILL_FIXED_RANGE | (1 << 8)
    cv2.floodFill(lab, area, (x, y), 0, COLOUR_RANGE, COLOUR_RANGE, flags)
    mask = area[1:-1, 1:-1] > 0
    if not SMALLEST_OBJECT <= mask.sum() <= 0.4 * mask.size:
        fix = "draw a box around it: --box x,y,w,h"
        raise InputError.of(_flag("point", point), "", "shows no object that ends somewhere", fix)
    filled = cv2.morphologyEx(np.pad(mask, 8).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return PromptedMask(filled[8:-8, 8:-8] > 0, COLOUR_CONFIDENCE)


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
    Neighbours of one colour are separated by edges and shape, objects of many colours by GrabCut. Confidence 0 and
    the whole box where there is no proposal.
    """
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box
    across, down = max(8, round(BOX.margin * (x1 - x0))), max(8, round(BOX.margin * (y1 - y0)))
    left, top = max(0, x0 - across), max(0, y0 - down)
    right, bottom = min(width, x1 + across), min(height, y1 + down)
    part = np.ascontiguousarray(rgb[top:bottom, left:right])
    scale = min(BOX.largest_zoom, BOX.side / float(np.sqrt((x1 - x0) * (y1 - y0))))
    size = max(8, round((right - left) * scale)), max(8, round((bottom - top) * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = np.asarray(cv2.resize(part, size, interpolation=method), np.uint8)
    zoom = np.array([size[0] / (right - left), size[1] / (bottom - top)])
    best = _best_in_box(small, np.array([x0 - left, y0 - top, x1 - left, y1 - top]) * np.tile(zoom, 2))
    mask = np.zeros((height, width), np.bool_)
    if best is None:
        mask[y0:y1, x0:x1] = True
        return PromptedMask(mask, 0.0)
    found, fit = best
    mask[top:bottom, left:right] = tighten(part, [found.on((size[1], size[0]))], BOX.band) > 0
    return PromptedMask(mask, fit)


def _best_in_box(rgb: Rgb, box: Floats) -> tuple[Proposal, float] | None:
    """The best proposal for a box (4,) px of a photo of working size, and its expected fit; None without proposals."""
    shape = rgb.shape[0], rgb.shape[1]
    across, down = box[2] - box[0], box[3] - box[1]
    smallest, largest = (max(20, round(part * across * down)) for part in BOX.areas)
    colour = smoothed_lab(rgb)
    gradient = colour_gradient(colour)
    by_colour = _grabcut_proposals(rgb, box, smallest)
    found = stable_regions(colour, gradient, smallest, largest)
    if max(across / down, down / across) < BOX.square:
        found += discs(gradient, smallest, largest, 60)
    seen = run_network(rgb, (BOX.network_side,))
    found += _network_parts(seen, shape, BOX.network_part, smallest, largest)
    found += guided_proposals(gradient, seen, smallest, largest)
    found = _near(found + by_colour, box)
    if not found:
        return None
    joined = unions(found, np.maximum(score_proposals(found, colour, gradient).score, 0.5), largest)
    found += _near(joined, box)[:60]
    found.sort(key=lambda one: float(_misfit([one], box)[0]))
    found = found[: BOX.near]
    first = np.log(np.maximum(score_proposals(found, colour, gradient).score, 0.05)) - _misfit(found, box)
    chosen = [found[k] for k in np.argsort(-first, kind="stable")[: BOX.kept].tolist()]
    chosen += [one for one in _near(by_colour, box) if all(one is not other for other in chosen)]
    forms = _near([form for one in chosen for form in variants(one, shape)], box)
    score = score_proposals(forms, colour, gradient).score
    worth = BOX.score_power * np.log(np.maximum(score, 0.02)) - _misfit(forms, box)
    if by_colour:
        overlap = np.array([max(iou(form, other) for other in by_colour) for form in forms])
        worth += BOX.colour_power * np.log(0.15 + overlap)
    fit = judged_fit(forms, seen, shape)
    worth += np.log(np.maximum(fit, 0.05))
    k = int((worth + agreement(forms, worth)).argmax())
    return forms[k], float(fit[k])


def _network_parts(
    seen: NetworkMaps, shape: tuple[int, int], part: int, smallest: int, largest: int
) -> list[Proposal]:
    """The network's own proposals of at least `part` px of its grid, on a grid of `shape` within bounds of area."""
    grid = seen.foreground
    found = (rescaled(one, grid.shape, shape) for one in network_proposals(seen, part, grid.size))
    return [one for one in found if one is not None and smallest <= one.area <= largest]


def _grabcut_proposals(rgb: Rgb, box: Floats, smallest: int) -> list[Proposal]:
    """Proposals of GrabCut (Rother, Kolmogorov, Blake 2004) from the box, and from the ellipse in it."""
    y, x = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
    across, down = box[2] - box[0], box[3] - box[1]
    off_x = np.abs(x - (box[0] + box[2] - 1) / 2) / (across / 2)
    off_y = np.abs(y - (box[1] + box[3] - 1) / 2) / (down / 2)
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


def _sides_inside(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n, 4): how far inside the box each side lies, as a share of the box's sides."""
    length = np.array([box[2] - box[0], box[3] - box[1]] * 2)
    inward = np.array([1, 1, -1, -1])
    corners = np.array([one.box for one in found], np.float64).reshape(-1, 4)
    return np.asarray((corners - box) * inward / length, np.float64)


def _misfit(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n,): quadratic penalty of the distance between the proposals' sides and the box's."""
    off = np.maximum(0, np.abs(_sides_inside(found, box)) - BOX.forgiven)
    return np.asarray((off**2).sum(1) / (2 * BOX.spread**2), np.float64)


def _near(found: Sequence[Proposal], box: Floats) -> list[Proposal]:
    """Proposals that leave the box by no more than `BOX.reach`."""
    return [one for one in found if _sides_inside([one], box).min() > -BOX.reach]


@dataclass(frozen=True, eq=False)
class PhotoProposals:
    """The proposals of a photo, computed once for all points."""

    rgb: Rgb
    colour: NDArray[np.float32]
    """(h, w, 3) CIELAB at working size."""
    gradient: Gradient
    proposals: list[Proposal]
    fit: Floats
    """(n,) 0..1: the network's expected fit of each."""


def photo_proposals(rgb: Rgb) -> PhotoProposals:
    """The proposals of a photo (H, W, 3)."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (POINT.area / (height * width)) ** 0.5)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb, np.uint8)
    colour = smoothed_lab(small)
    gradient = colour_gradient(colour)
    smallest, largest = (max(SMALLEST_OBJECT, round(part * size[0] * size[1])) for part in POINT.areas)
    shape, seen = (size[1], size[0]), run_network(rgb)
    found = stable_regions(colour, gradient, smallest, largest) + discs(gradient, smallest, largest)
    found += _network_parts(seen, shape, POINT.network_part, smallest, largest)
    found = distinct(found + guided_proposals(gradient, seen, smallest, largest))
    found += distinct(unions(found, score_proposals(found, colour, gradient).score, largest))
    return PhotoProposals(rgb, colour, gradient, found, judged_fit(found, seen, shape))


def object_at_pixel(known: PhotoProposals, x: int, y: int) -> PromptedMask | None:
    """The best proposal at a pixel of the photo; None where none scores like an object."""
    height, width = known.rgb.shape[:2]
    shape = known.colour.shape[0], known.colour.shape[1]
    at = (
        min(shape[1] - 1, int((x + 0.5) * shape[1] / width)),
        min(shape[0] - 1, int((y + 0.5) * shape[0] / height)),
    )
    some = [k for k, one in enumerate(known.proposals) if _depth(one, at) > 0]
    if not some:
        return None
    around, expected = [known.proposals[k] for k in some], np.log(np.maximum(known.fit[some], 0.05))
    score = score_proposals(around, known.colour, known.gradient).score
    good = POINT.score_power * np.log(np.maximum(score, 0.02)) + expected
    best = np.argsort(-good, kind="stable")[: POINT.kept].tolist()
    pairs = [(form, k) for k in best for form in variants(around[k], shape) if _depth(form, at) > 0]
    forms, source = [form for form, _ in pairs], [k for _, k in pairs]
    if not forms:
        return None
    depth = np.array([_depth(form, at) for form in forms])
    score = score_proposals(forms, known.colour, known.gradient).score
    worth = (
        POINT.score_power * np.log(np.maximum(score, 0.02))
        + POINT.area_power * np.log([form.area for form in forms])
        + POINT.depth_power * np.log(np.maximum(depth, 0.05))
        + expected[source]
    )
    k = int((worth + POINT.agreement_power * agreement(forms, worth)).argmax())
    if score[k] < POINT.least_score:
        return None
    mask = tighten(known.rgb, [forms[k].on(shape)], POINT.band) > 0
    return PromptedMask(np.asarray(mask), float(known.fit[some][source[k]]))


def _depth(one: Proposal, at: tuple[int, int]) -> float:
    """How deep inside a proposal a pixel of working size lies: 1 at the deepest pixel, 0 outside."""
    x, y = at[0] - one.x, at[1] - one.y
    if not (0 <= y < one.mask.shape[0] and 0 <= x < one.mask.shape[1] and one.mask[y, x]):
        return 0.0
    depth = cv2.distanceTransform(np.pad(one.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    return float(depth[y + 1, x + 1] / depth.max())
