"""What a person points at -> the objects to start from: a label map, boxes, or points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.perceive.boxed import boxed
from physgen.perceive.found import SMALLEST, Found
from physgen.perceive.pointed import Proposed, pointed, proposed
from physgen.perceive.roles import Labels, Meant, Name, Prompted, Rgb, Segment, Segments
from physgen.problems import InputError, Place, Problem, Severity

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


def from_masks(labels: NDArray[np.uint16], names: Mapping[int, str] | None = None) -> Found:
    """A label map, `(H, W)`, as it is; `names` tells what some ids are called."""
    known = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Found(labels, "given", {}, known)


def from_prompts(rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment) -> Found:
    """One object a box and one a point, in that order: ids 1, 2, ...

    A `segment` that takes boxes and points answers them. What it does not know, and all without it, is found so:
    in a box, `boxed` tells the object from what is around it. A point takes what `segment` finds there, else
    what looks most like an object that it lies in, else what is of one colour around it. Raises InputError with every
    box or point that is off the photo or shows nothing.
    """
    meant: list[Meant] = []
    problems = []
    known = cache(lambda: proposed(rgb))
    found = cache(lambda: segment(rgb))
    answers = answered(rgb, boxes, points, segment)
    for k, box in enumerate(boxes):
        try:
            meant.append(answers.get(k) or in_box(rgb, box))
        except InputError as error:
            problems += error.problems
    for k, point in enumerate(points, len(boxes)):
        try:
            meant.append(answers.get(k) or at_point(rgb, point, found(), known))
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
    return Found(labels, "pointed at", sure, {}, prompts)


def answered(rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point], segment: Segment) -> dict[int, Meant]:
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
    return {k: one for k, one in enumerate(said) if np.count_nonzero(one.mask) >= SMALLEST}


def weak(found: Found) -> Iterator[Problem]:
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


def likely(segments: Segments) -> Labels:
    """(H, W): the label map without what is more likely no object."""
    keep = np.concatenate([[False], segments.confidence >= LIKELY])
    return np.where(keep[np.minimum(segments.labels, len(keep) - 1)], segments.labels, np.uint16(0))


def in_box(rgb: Rgb, box: Box) -> Meant:
    """The object in a box, in one piece."""
    return boxed(rgb, corners(rgb, box))


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


def at_point(
    rgb: Rgb, point: Point, segments: Segments | None, known: Callable[[], Proposed] | None = None
) -> Meant:
    """The object at a point: of `segments`, else the best of what is proposed, else what is of one colour.

    `known` gives what the photo proposes, worked out once for many points.
    """
    height, width = rgb.shape[:2]
    x, y = pixel(rgb, point)
    flag = f"--point {point[0]:g},{point[1]:g}"
    if segments is not None and (i := int(likely(segments)[y, x])):
        return Meant(segments.labels == i, float(segments.confidence[i - 1]))
    best = pointed(known() if known else proposed(rgb), x, y)
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
    return Meant(filled[8:-8, 8:-8] > 0, FLAT)
