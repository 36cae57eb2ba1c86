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
from physgen.perceive.segment.network import run_network
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

# ----------------------------------------------------------------------
# The role `segment` of a crew, told what to look for: for whole photos, and for boxes and points.


@dataclass(frozen=True)
class Segmenter:
    """A segmenter that knows its nouns, and asks for them where nobody said any."""

    crew: Backends
    nouns: Sequence[str] = ()
    """What to find, for those that find what they are told to."""

    def __call__(self, rgb: Rgb) -> Segments:
        """Objects found in the photo."""
        categories: Sequence[Category] = [Category(noun, True) for noun in self.nouns]
        if "categories" in self.crew.row("segment").uses and not categories:
            categories = self.crew.call("categories", rgb)
            self.crew.release("categories")
        found: Segments = self.crew.call("segment", rgb, categories=categories)
        return found


class PromptedSegmenter(Segmenter):
    """One that takes boxes and points itself."""

    def meant(self, rgb: Rgb, boxes: Sequence[Any], points: Sequence[Any]) -> Sequence[PromptedMask]:
        """See `Prompted`; nothing where another had to take over that takes none."""
        said: Sequence[PromptedMask] = self.crew.run(
            "segment", lambda made: made.meant(rgb, boxes, points) if isinstance(made, Prompted) else ()
        )
        return said


def segmenter(crew: Backends, nouns: Sequence[str] = ()) -> Segment:
    """The crew's segmenter: a `Prompted` one where its backend is."""
    prompted = not crew.fallen("segment") and isinstance(crew.get("segment"), Prompted)
    return PromptedSegmenter(crew, nouns) if prompted else Segmenter(crew, nouns)


# ----------------------------------------------------------------------
# A box drawn around an object -> its mask: what edges, circles and colours propose in and about it, and the
# best.
#
# A box is drawn by hand, so it is loose or cuts a little off: what is proposed is held to it softly. Touching
# neighbours
# of one colour are told apart by edges and shape, things of many colours by the colours that the surroundings
# lack.

Floats = NDArray[np.float64]

SIDE = 100
"""px: geometric mean of the box's sides where it is looked at; smaller boxes are enlarged, up to `LARGEST` times."""
LARGEST = 3.0
MARGIN = 0.35
"""Of the box's sides, that are looked at around it; 8 px at least."""
REACH = 0.25
"""Of the box's sides: what leaves the box farther is not what was meant."""
AREAS = (0.12, 1.4)
"""Of the box, that a proposal may cover."""
SQUARE = 1.6
"""Times one side may be the other for discs to be looked for."""
KEPT = 12
"""Proposals whose variants are looked at."""

BAND = 0.02
"""How far the outline may move at last, in square roots of its area: little, its edges were looked at already."""

# Chosen on the studio's photos for tuning and on peers' photos, boxes 10 % loose and boxes with sides 10 % off.
LOOK, PART = 256, 40
"""px: the longer side of what the network looks at, and the smallest part it may propose on its grid."""

SLACK, FREE, SPREAD = 0.0, 0.09, 0.09
"""Of the box's sides: how far inside of it an object's side lies, the error that is forgiven, the scale of more."""
EDGES, COLOURS, COMPANY, JUDGED = 2.0, 0.25, 1.0, 1.0
"""Exponents: looks; likeness to what GrabCut finds; likeness to what else is proposed; what the network expects."""


def object_in_box(rgb: Rgb, box: tuple[int, int, int, int]) -> PromptedMask:
    """The object in a box (left, top, right, bottom px, within the photo, the last two just outside)."""
    height, width = rgb.shape[:2]
    x0, y0, x1, y1 = box
    across, down = max(8, round(MARGIN * (x1 - x0))), max(8, round(MARGIN * (y1 - y0)))
    left, top = max(0, x0 - across), max(0, y0 - down)
    right, bottom = min(width, x1 + across), min(height, y1 + down)
    part = np.ascontiguousarray(rgb[top:bottom, left:right])
    scale = min(LARGEST, SIDE / float(np.sqrt((x1 - x0) * (y1 - y0))))
    size = max(8, round((right - left) * scale)), max(8, round((bottom - top) * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    small = np.asarray(cv2.resize(part, size, interpolation=method), np.uint8)
    zoom = np.array([size[0] / (right - left), size[1] / (bottom - top)])
    corners = np.array([x0 - left, y0 - top, x1 - left, y1 - top]) * np.tile(zoom, 2)
    best = _best(small, corners)
    mask = np.zeros((height, width), np.bool_)
    if best is None:
        mask[y0:y1, x0:x1] = True
        return PromptedMask(mask, 0.0)
    found, fit = best
    mask[top:bottom, left:right] = tighten(part, [found.on((size[1], size[0]))], BAND) > 0
    return PromptedMask(mask, fit)


def _best(rgb: Rgb, box: Floats) -> tuple[Proposal, float] | None:
    """The object in a box (4,) px of a photo of working size, and how well it is expected to fit.

    None where nothing is proposed.
    """
    shape = rgb.shape[0], rgb.shape[1]
    across, down = box[2] - box[0], box[3] - box[1]
    smallest, largest = (max(20, round(part * across * down)) for part in AREAS)
    colour = smoothed_lab(rgb)
    gradient = colour_gradient(colour)
    by_colour = _by_colour(rgb, box, smallest)
    found = stable_regions(colour, gradient, smallest, largest)
    if max(across / down, down / across) < SQUARE:
        found += discs(gradient, smallest, largest, 60)
    seen = run_network(rgb, (LOOK,))
    own = (
        rescaled(one, seen.foreground.shape, shape)
        for one in network_proposals(seen, PART, seen.foreground.size)
    )
    found += [one for one in own if one is not None and smallest <= one.area <= largest]
    found += guided_proposals(gradient, seen, smallest, largest)
    found = _near(found + by_colour, box)
    if not found:
        return None
    found += _near(
        unions(found, np.maximum(score_proposals(found, colour, gradient).score, 0.5), largest), box
    )[:60]
    found.sort(key=lambda one: float(_misfit([one], box)[0]))
    found = found[:70]
    first = np.log(np.maximum(score_proposals(found, colour, gradient).score, 0.05)) - _misfit(found, box)
    kept = np.argsort(-first, kind="stable")[:KEPT].tolist()
    chosen = [found[k] for k in kept]
    chosen += [one for one in _near(by_colour, box) if all(one is not other for other in chosen)]
    forms = _near([form for one in chosen for form in variants(one, shape)], box)
    worth = EDGES * np.log(np.maximum(score_proposals(forms, colour, gradient).score, 0.02)) - _misfit(
        forms, box
    )
    if by_colour:
        alike = np.array([max(iou(form, other) for other in by_colour) for form in forms])
        worth += COLOURS * np.log(0.15 + alike)
    fit = judged_fit(forms, seen, shape)
    worth += JUDGED * np.log(np.maximum(fit, 0.05))
    k = int((worth + COMPANY * agreement(forms, worth)).argmax())
    return forms[k], float(fit[k])


def _by_colour(rgb: Rgb, box: Floats, smallest: int) -> list[Proposal]:
    """What GrabCut (Rother, Kolmogorov, Blake 2004) makes of the box, and of the ellipse in it."""
    y, x = np.mgrid[: rgb.shape[0], : rgb.shape[1]]
    across, down = box[2] - box[0], box[3] - box[1]
    off_x = np.abs(x - (box[0] + box[2] - 1) / 2) / (across / 2)
    off_y = np.abs(y - (box[1] + box[3] - 1) / 2) / (down / 2)
    square, around = np.maximum(off_x, off_y), np.hypot(off_x, off_y)
    bgr = np.ascontiguousarray(rgb[:, :, ::-1])
    found = []
    none = np.zeros(square.shape, np.bool_)
    for outer, inner, core in (
        (square <= 1.0, square <= 1.0, none),
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


def _sides(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n, 4): how far inside of the box each side lies, in sides of the box."""
    length = np.array([box[2] - box[0], box[3] - box[1]] * 2)
    inward = np.array([1, 1, -1, -1])
    corners = np.array([one.box for one in found], np.float64).reshape(-1, 4)
    return np.asarray((corners - box) * inward / length, np.float64)


def _misfit(found: Sequence[Proposal], box: Floats) -> Floats:
    """(n,): 0 for what fits the box as boxes are drawn, growing with the square of what is off."""
    off = np.maximum(0, np.abs(_sides(found, box) - SLACK) - FREE)
    return np.asarray((off**2).sum(1) / (2 * SPREAD**2), np.float64)


def _near(found: Sequence[Proposal], box: Floats) -> list[Proposal]:
    """Those that leave the box by no more than `REACH`."""
    return [one for one in found if _sides([one], box).min() > -REACH]


# ----------------------------------------------------------------------
# A point on an object -> its mask: of what edges, circles and colour propose there, the best that the point
# is in.

AREA = 512 * 512
"""px that are looked at; larger photos are reduced to it."""
SMALLEST, POINTED_LARGEST = 0.0003, 0.22
"""Parts of the photo that an object may cover."""
POINTED_KEPT = 25
"""Proposals whose variants are looked at."""
LEAST = 0.35
"""Of looks: a worse proposal is no object."""
POINTED_BAND = 0.04
"""How far the outline may move at last, in square roots of its area."""

# Chosen on the studio's photos for tuning and on peers' photos.
POINTED_EDGES, WIDE, DEEP, POINTED_COMPANY, POINTED_JUDGED = 2.0, 0.1, 2.0, 2.0, 1.0
"""Exponents: looks; area, as wholes are meant rather than their parts; how deep inside the point lies; likeness to
what else is proposed; what the network expects."""
POINTED_PART = 14
"""px of the network's grid, of the smallest part that it may propose."""


@dataclass(frozen=True, eq=False)
class PhotoProposals:
    """What a photo proposes, worked out once for all points."""

    rgb: Rgb
    colour: NDArray[np.float32]
    gradient: Gradient
    proposals: list[Proposal]
    fit: NDArray[np.float64]
    """(n,) 0..1: how well the network expects each to fit."""


def photo_proposals(rgb: Rgb) -> PhotoProposals:
    """Of a photo (H, W, 3)."""
    height, width = rgb.shape[:2]
    scale = min(1.0, (AREA / (height * width)) ** 0.5)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA) if scale < 1 else rgb, np.uint8)
    colour = smoothed_lab(small)
    gradient = colour_gradient(colour)
    smallest, largest = (max(12, round(part * size[0] * size[1])) for part in (SMALLEST, POINTED_LARGEST))
    shape, seen = (size[1], size[0]), run_network(rgb)
    found = stable_regions(colour, gradient, smallest, largest) + discs(gradient, smallest, largest)
    own = (
        rescaled(one, seen.foreground.shape, shape)
        for one in network_proposals(seen, POINTED_PART, seen.foreground.size)
    )
    found += [one for one in own if one is not None and smallest <= one.area <= largest]
    found = distinct(found + guided_proposals(gradient, seen, smallest, largest))
    found += distinct(unions(found, score_proposals(found, colour, gradient).score, largest))
    return PhotoProposals(rgb, colour, gradient, found, judged_fit(found, seen, shape))


def object_at_pixel(known: PhotoProposals, x: int, y: int) -> PromptedMask | None:
    """The object at a pixel of the photo; None where nothing that is proposed there looks like one."""
    height, width = known.rgb.shape[:2]
    shape = known.colour.shape[0], known.colour.shape[1]
    at = (
        min(shape[1] - 1, int((x + 0.5) * shape[1] / width)),
        min(shape[0] - 1, int((y + 0.5) * shape[0] / height)),
    )
    some = [k for k, one in enumerate(known.proposals) if _depth(one, at) > 0]
    if not some:
        return None
    holding, expected = (
        [known.proposals[k] for k in some],
        POINTED_JUDGED * np.log(np.maximum(known.fit[some], 0.05)),
    )
    score = score_proposals(holding, known.colour, known.gradient).score
    good = POINTED_EDGES * np.log(np.maximum(score, 0.02)) + expected
    best = np.argsort(-good, kind="stable")[:POINTED_KEPT].tolist()
    pairs = [(form, k) for k in best for form in variants(holding[k], shape) if _depth(form, at) > 0]
    forms, source = [form for form, _ in pairs], [k for _, k in pairs]
    if not forms:
        return None
    depth = np.array([_depth(form, at) for form in forms])
    score = score_proposals(forms, known.colour, known.gradient).score
    area = np.log([form.area for form in forms])
    worth = (
        POINTED_EDGES * np.log(np.maximum(score, 0.02))
        + WIDE * area
        + DEEP * np.log(np.maximum(depth, 0.05))
        + expected[source]
    )
    k = int((worth + POINTED_COMPANY * agreement(forms, worth)).argmax())
    if score[k] < LEAST:
        return None
    mask = tighten(known.rgb, [forms[k].on(shape)], POINTED_BAND) > 0
    return PromptedMask(np.asarray(mask), float(known.fit[some][source[k]]))


def _depth(one: Proposal, at: tuple[int, int]) -> float:
    """How deep in a proposal a pixel of working size lies: 1 where it is deepest, 0 outside."""
    x, y = at[0] - one.x, at[1] - one.y
    if not (0 <= y < one.mask.shape[0] and 0 <= x < one.mask.shape[1] and one.mask[y, x]):
        return 0.0
    depth = cv2.distanceTransform(np.pad(one.mask, 1).astype(np.uint8), cv2.DIST_L2, 5)
    return float(depth[y + 1, x + 1] / depth.max())


# ----------------------------------------------------------------------
# What a person points at -> the objects to start from: a label map, boxes, or points.

Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""
Point = tuple[float, float]
"""x px, y px."""
LEFT = 0.3
"""Of an object pointed at, that others pointed at must leave."""
FLAT = 0.2
"""Confidence in what is nothing but an area of one colour."""
ASKED = 6.0
"""Times by which the odds that there is an object rise when a person points: on the studio's photos and homes, 0.75 of
boxes that the network gives 0.1, and 0.98 of those that it gives 0.6, are cut out by half or more."""
WEAK = 0.25
"""Confidence under which a person is asked to look."""
LIKELY = 0.5
"""Confidence from which on a point takes what the segmenter says is there."""


def from_masks(labels: NDArray[np.uint16], names: Mapping[int, str] | None = None) -> Detections:
    """A label map, `(H, W)`, as it is; `names` tells what some ids are called."""
    known = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Detections(labels, "given", {}, known)


def from_prompts(rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment) -> Detections:
    """One object a box and one a point, in that order: ids 1, 2, ...

    A `segment` that takes boxes and points answers them. What it does not know, and all without it, is found so:
    in a box, `boxed` tells the object from what is around it. A point takes what `segment` finds there, else
    what looks most like an object that it lies in, else what is of one colour around it. Raises InputError with every
    box or point that is off the photo or shows nothing.
    """
    meant: list[PromptedMask] = []
    problems = []
    known = cache(lambda: photo_proposals(rgb))
    found = cache(lambda: segment(rgb))
    answers = prompted_answers(rgb, boxes, points, segment)
    for k, box in enumerate(boxes):
        try:
            meant.append(answers.get(k) or segment_box(rgb, box))
        except InputError as error:
            problems += error.problems
    for k, point in enumerate(points, len(boxes)):
        try:
            meant.append(answers.get(k) or segment_point(rgb, point, found(), known))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    large_first = sorted(range(len(meant)), key=lambda k: -int(meant[k].mask.sum()))
    for k in large_first:  # small things lie before large ones
        labels[meant[k].mask] = k + 1
    said = [("box", box) for box in boxes] + [("point", point) for point in points]
    for k, (kind, place) in enumerate(said, 1):
        if np.count_nonzero(labels == k) < max(LEFT * np.count_nonzero(meant[k - 1].mask), 12):
            flag = f"--{kind} {','.join(f'{v:g}' for v in place)}"
            problems += InputError.of(
                flag, "", "shows what another box or point shows", "leave one out"
            ).problems
    if problems:
        raise InputError(problems)
    prompts = {k: {kind: [round(float(v), 2) for v in place]} for k, (kind, place) in enumerate(said, 1)}
    fits = {k: one.confidence for k, one in enumerate(meant, 1)}
    sure = {k: ASKED * fit / (1 + (ASKED - 1) * fit) for k, fit in fits.items()}
    return Detections(labels, "pointed at", sure, {}, prompts)


def prompted_answers(
    rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment
) -> dict[int, PromptedMask]:
    """What a segmenter that takes prompts says to boxes and points, by their place in the order of both.

    Nothing where one is off the photo: that is told first.
    """
    if not isinstance(segment, Prompted) or not (boxes or points):
        return {}
    try:
        seen = [corners(rgb, box) for box in boxes]
        for point in points:
            pixel(rgb, point)
    except InputError:
        return {}
    said = segment.meant(rgb, [(x0, y0, x1 - x0, y1 - y0) for x0, y0, x1, y1 in seen], points)
    return {k: one for k, one in enumerate(said) if np.count_nonzero(one.mask) >= SMALLEST_OBJECT}


def weak_prompts(found: Detections) -> Iterator[Problem]:
    """What was pointed at and stands out so little that it may be nothing."""
    for i, prompt in found.prompts.items():
        if found.confidence[i] < WEAK:
            (kind, place), *_ = prompt.items()
            flag = Place(f"--{kind} {','.join(f'{v:g}' for v in place)}")
            expected, fix = (
                "shows nothing that stands out",
                "look at its outline, or draw the mask: --masks FILE",
            )
            yield Problem(flag, "", "", expected, fix, Severity.WARNING)


def likely_labels(segments: Segments) -> Labels:
    """(H, W): the label map without what is more likely no object."""
    keep = np.concatenate([[False], segments.confidence >= LIKELY])
    return np.where(keep[np.minimum(segments.labels, len(keep) - 1)], segments.labels, np.uint16(0))


def segment_box(rgb: Rgb, box: Box) -> PromptedMask:
    """The object in a box, in one piece."""
    return object_in_box(rgb, corners(rgb, box))


def corners(rgb: Rgb, box: Box) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of what the photo shows of a box. Raises InputError where that is too little."""
    height, width = rgb.shape[:2]
    x0, y0 = max(0, round(box[0])), max(0, round(box[1]))
    x1, y1 = min(width, round(box[0] + box[2])), min(height, round(box[1] + box[3]))
    flag = f"--box {','.join(f'{v:g}' for v in box)}"
    if x1 - x0 < 4 or y1 - y0 < 4:
        raise InputError.of(
            flag, "", f"leaves under 4 px of the {width} x {height} photo", "write x,y,width,height in px"
        )
    return x0, y0, x1, y1


def pixel(rgb: Rgb, point: Point) -> tuple[int, int]:
    """Column and row of a point. Raises InputError where it is off the photo."""
    height, width = rgb.shape[:2]
    x, y = round(point[0]), round(point[1])
    if not (0 <= x < width and 0 <= y < height):
        flag = f"--point {point[0]:g},{point[1]:g}"
        raise InputError.of(flag, "", f"is off the {width} x {height} photo", "write x,y in px")
    return x, y


def segment_point(
    rgb: Rgb, point: Point, segments: Segments | None, known: Callable[[], PhotoProposals] | None = None
) -> PromptedMask:
    """The object at a point: of `segments`, else the best of what is proposed, else what is of one colour.

    `known` gives what the photo proposes, worked out once for many points.
    """
    height, width = rgb.shape[:2]
    x, y = pixel(rgb, point)
    flag = f"--point {point[0]:g},{point[1]:g}"
    if segments is not None and (i := int(likely_labels(segments)[y, x])):
        return PromptedMask(segments.labels == i, float(segments.confidence[i - 1]))
    best = object_at_pixel(known() if known else photo_proposals(rgb), x, y)
    if best is not None:
        return best
    lab = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB), (0, 0), 1.0)
    area = np.zeros((height + 2, width + 2), np.uint8)
    flags = 4 | cv2.FLOODFILL_MASK_ONLY | cv2.FLOODFILL_FIXED_RANGE | (1 << 8)
    cv2.floodFill(lab, area, (x, y), 0, (40, 18, 18), (40, 18, 18), flags)
    mask = area[1:-1, 1:-1] > 0
    if not 12 <= mask.sum() <= 0.4 * mask.size:
        raise InputError.of(
            flag, "", "shows no object that ends somewhere", "draw a box around it: --box x,y,w,h"
        )
    filled = cv2.morphologyEx(np.pad(mask, 8).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return PromptedMask(filled[8:-8, 8:-8] > 0, FLAT)
