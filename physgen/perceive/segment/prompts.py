"""Objects from user prompts: boxes, points and label maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.messages import Message
from physgen.perceive.roles import (
    SMALLEST_OBJECT,
    Category,
    Detections,
    Mask,
    Name,
    PromptedMask,
    Rgb,
    Segments,
)
from physgen.perceive.segment.network import box_of, mask_at_point, mask_in_box
from physgen.perceive.segment.point_choice import is_meant, object_at_point
from physgen.problems import InputError, Place, Problem, RefusedError
from physgen.registry import Backends

Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""
Point = tuple[float, float]
"""x px, y px."""


@dataclass(frozen=True)
class PromptRule:
    """Constants of prompts, chosen on the validation homes and the tune half."""

    weak: float = (
        0.33  # confidence below which what is pointed at makes the photo doubtful
    )
    likely: float = 0.6  # confidence from which a point takes the segmenter's object
    whole: float = 0.9  # share of the photo from which a mask is the photo and no object: it has nothing behind it
    visible: float = (
        0.3  # share of a prompted object that the others must leave visible
    )
    looks: tuple[float, ...] = (1.4, 0.7, 0.35, 0.175, 0.09)
    """Of the photo's longer side: sides of the squares around a point in which its object is looked for."""
    beyond: float = 0.02
    """Of the photo's longer side: how far a loosely drawn box may reach out of it."""
    least: float = 4.0  # px: the smallest width and height of a box


RULE = PromptRule()


@dataclass(frozen=True)
class PromptFrame:
    """The photo in whose pixels prompts are written, and where they are written."""

    width: float  # px
    height: float  # px
    scale: float = 1.0  # px of the scene's photo for a px of this one
    places: Mapping[int, tuple[Place, str]] = field(default_factory=dict)
    """Place and dotted path of a prompt, by its order; absent: a flag."""

    @classmethod
    def of(cls, rgb: Rgb) -> PromptFrame:
        """Return the frame of prompts in pixels of the photo itself."""
        return cls(rgb.shape[1], rgb.shape[0])

    def boxes_in(self, rgb: Rgb, boxes: Sequence[Box]) -> list[Box]:
        """Convert boxes to pixels of the photo (H, W, 3)."""
        x, y = rgb.shape[1] / self.width, rgb.shape[0] / self.height
        return [(box[0] * x, box[1] * y, box[2] * x, box[3] * y) for box in boxes]

    def points_in(self, rgb: Rgb, points: Sequence[Point]) -> list[Point]:
        """Convert points to pixels of the photo (H, W, 3)."""
        x, y = rgb.shape[1] / self.width, rgb.shape[0] / self.height
        # pixel centres are whole numbers: the last pixel stays on a smaller photo
        return [
            ((point[0] + 0.5) * x - 0.5, (point[1] + 0.5) * y - 0.5) for point in points
        ]

    def problem(
        self, order: int, kind: str, numbers: Sequence[float], refusal: RefusedError
    ) -> Problem:
        """Return a problem at the place where a prompt is written, in its numbers."""
        place, path = self.places.get(order, (Place(_flag(kind, numbers)), ""))
        found = "" if order not in self.places else f"[{_written(numbers)}]"
        return refusal.problem(place, path, found)


def check_prompts(
    boxes: Sequence[Box], points: Sequence[Point], frame: PromptFrame
) -> None:
    """Raise InputError for every box and point that does not lie on the photo.

    A box may reach out of the photo by a few pixels. Boxes and points are in pixels of
    the `frame`.
    """
    problems: list[Problem] = []
    for order, box in enumerate(boxes):
        fault = _box_fault(box, frame)
        if order not in frame.places:
            fault = _share_fault(box, frame) or fault
        if fault is not None:
            problems.append(frame.problem(order, "box", box, fault))
    for order, point in enumerate(points, len(boxes)):
        fault = _point_fault(point, frame)
        if order not in frame.places:
            fault = _share_fault(point, frame) or fault
        if fault is not None:
            problems.append(frame.problem(order, "point", point, fault))
    if problems:
        raise InputError(problems)


BOX_FORM, POINT_FORM = "write x,y,WIDTH,HEIGHT in px", "write x,y in px"


def _share_fault(numbers: Sequence[float], frame: PromptFrame) -> RefusedError | None:
    """Return what is wrong with parts of the photo's sides; None if numbers are px."""
    is_share = all(0 <= number <= 1 for number in numbers)
    if not is_share or all(number in (0, 1) for number in numbers):
        return None
    sides = (frame.width, frame.height, frame.width, frame.height)
    likely = [number * side for number, side in zip(numbers, sides, strict=False)]
    form = BOX_FORM if len(numbers) == len(sides) else POINT_FORM
    fix = f"{form}; did you mean {_whole(likely)}?"
    return Message.PROMPT_IN_SHARES.refusal(fix=fix)


def _box_fault(box: Box, frame: PromptFrame) -> RefusedError | None:
    """Return what is wrong with a box and its fix; None if nothing is wrong."""
    form, least = BOX_FORM, RULE.least / min(frame.scale, 1.0)
    x, y, width, height = box
    if width < 0 or height < 0:
        likely = (min(x, x + width), min(y, y + height), abs(width), abs(height))
        fix = f"{form}; did you mean {_whole(likely)}?"
        return Message.BOX_NEGATIVE.refusal(fix=fix)
    if min(width, height) < least:
        return Message.BOX_TOO_SMALL.refusal(least=least, fix=form)
    if not (_reaches_out(box, frame) or _is_off(box, frame)):
        return None
    size = {"width": frame.width, "height": frame.height}
    likely_box = next(_likely_boxes(box, frame), None)
    fix = form if likely_box is None else f"{form}; did you mean {_whole(likely_box)}?"
    if _is_off(box, frame):
        return Message.PROMPT_OFF_PHOTO.refusal(fix=fix, **size)
    excess = _excess(box, frame)
    return Message.BOX_BEYOND_PHOTO.refusal(excess=excess, fix=fix, **size)


def _likely_boxes(box: Box, frame: PromptFrame) -> Iterator[Box]:
    """Yield boxes that a wrong one may mean: by its corners, else its part on the photo."""
    x, y, right, bottom = box
    by_corners = (x, y, right - x, bottom - y)
    left, top = max(x, 0.0), max(y, 0.0)
    clipped_right = min(x + right, frame.width)
    clipped_bottom = min(y + bottom, frame.height)
    clipped = (left, top, clipped_right - left, clipped_bottom - top)
    for candidate in (by_corners, clipped):
        if min(candidate[2:]) >= RULE.least and not _reaches_out(candidate, frame):
            yield candidate


def _reaches_out(box: Box, frame: PromptFrame) -> bool:
    """Return whether a box reaches farther out of the photo than a loose one."""
    return _excess(box, frame) > RULE.beyond * max(frame.width, frame.height)


def _excess(box: Box, frame: PromptFrame) -> float:
    """Return how far a box reaches out of the photo, px."""
    x, y, width, height = box
    return max(-x, -y, x + width - frame.width, y + height - frame.height, 0.0)


def _is_off(box: Box, frame: PromptFrame) -> bool:
    """Return whether no part of a box is on the photo."""
    x, y, width, height = box
    is_beside = x >= frame.width or x + width <= 0
    return is_beside or y >= frame.height or y + height <= 0


def _point_fault(point: Point, frame: PromptFrame) -> RefusedError | None:
    """Return what is wrong with a point and its fix; None if nothing is wrong."""
    form = POINT_FORM
    if _is_inside(point, frame):
        return None
    swapped = (point[1], point[0])
    if _is_inside(swapped, frame):
        form += f"; did you mean {_whole(swapped)}?"
    size = {"width": frame.width, "height": frame.height}
    return Message.PROMPT_OFF_PHOTO.refusal(fix=form, **size)


def _is_inside(point: Point, frame: PromptFrame) -> bool:
    """Return whether a point is on the photo; pixel centres are whole numbers."""
    return all(
        -0.5 <= number <= side - 0.5
        for number, side in zip(point, (frame.width, frame.height), strict=True)
    )


@dataclass(frozen=True)
class Segmenter:
    """The role `segment` with its nouns; where there are none, the role `categories` finds them."""

    backends: Backends
    nouns: Sequence[str] = ()
    is_smallest_meant: bool = False
    """Whether a point means the smallest object there, and not the whole one."""

    def __call__(self, rgb: Rgb) -> Segments:
        """Objects found in the photo."""
        categories: Sequence[Category] = [Category(noun, True) for noun in self.nouns]
        if "categories" in self.backends.row("segment").uses and not categories:
            categories = self.backends.call("categories", rgb)
            self.backends.release("categories")
        found: Segments = self.backends.call("segment", rgb, categories=categories)
        return found

    def answers(
        self, rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point]
    ) -> dict[int, PromptedMask]:
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
        masks = self.backends.run(
            "segment", lambda backend: backend.meant(rgb, sides, points)
        )
        return {
            k: one
            for k, one in enumerate(masks)
            if np.count_nonzero(one.mask) >= SMALLEST_OBJECT
        }


def from_masks(
    labels: NDArray[np.uint16], names: Mapping[int, str] | None = None
) -> Detections:
    """The objects of a label map (H, W); `names` are known labels by id."""
    known = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Detections(labels, "given", {}, known)


def from_prompts(
    rgb: Rgb,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segmenter,
    frame: PromptFrame | None = None,
) -> Detections:
    """One object for each box and then for each point: ids 1, 2, ...

    A backend that takes prompts answers first; else a box is `segment_box`, and a point `segment_point`.
    Boxes and points are in pixels of the `frame`, or of the photo itself. Where a point means the
    smallest object, the box of that becomes its prompt.
    Raises InputError with every box or point that is off the photo or shows no object.
    """
    masks: list[PromptedMask] = []
    problems: list[Problem] = []
    frame = frame or PromptFrame.of(rgb)
    written: list[tuple[str, Sequence[float]]] = [("box", box) for box in boxes]
    written += [("point", point) for point in points]
    boxes, points = frame.boxes_in(rgb, boxes), frame.points_in(rgb, points)
    found = cache(lambda: segment(rgb))
    answers = segment.answers(rgb, boxes, points)

    def report(order: int, refusal: RefusedError) -> None:
        kind, numbers = written[order]
        problems.append(frame.problem(order, kind, numbers, refusal))

    for k, box in enumerate(boxes):
        try:
            masks.append(answers.get(k) or segment_box(rgb, box))
        except InputError as error:
            report(k, error.problems[0].refusal())
    for k, point in enumerate(points, len(boxes)):
        try:
            masks.append(
                answers.get(k)
                or segment_point(
                    rgb, point, found(), points, smallest=segment.is_smallest_meant
                )
            )
        except InputError as error:
            report(k, error.problems[0].refusal())
    if problems:
        raise InputError(problems)
    labels = np.zeros(rgb.shape[:2], np.uint16)
    for k in sorted(
        range(len(masks)), key=lambda k: -int(masks[k].mask.sum())
    ):  # small objects in front
        labels[masks[k].mask] = k + 1
    places: list[tuple[str, Sequence[float]]] = [("box", box) for box in boxes]
    places += [("point", point) for point in points]
    for k in range(1, len(places) + 1):
        least = max(RULE.visible * np.count_nonzero(masks[k - 1].mask), SMALLEST_OBJECT)
        if np.count_nonzero(labels == k) < least:
            report(k - 1, Message.PROMPT_REPEATED.refusal())
    if problems:
        raise InputError(problems)
    if segment.is_smallest_meant:  # the scene keeps what was chosen, not how
        for k, one in enumerate(masks[len(boxes) :], len(boxes)):
            left, top, right, bottom = box_of(one.mask)
            places[k] = "box", (left, top, right - left, bottom - top)
    prompts = {
        k: {kind: [round(float(v), 2) for v in place]}
        for k, (kind, place) in enumerate(places, 1)
    }
    confidence = {k: one.confidence for k, one in enumerate(masks, 1)}
    return Detections(labels, "pointed at", confidence, {}, prompts)


def segment_box(rgb: Rgb, box: Box) -> PromptedMask:
    """The object in a box, in one piece.

    Raises InputError where the box leaves too little of the photo, or where nothing is seen in it.
    """
    found = mask_in_box(rgb, _corners(rgb, box))
    if not 0 < found.mask.mean() < RULE.whole:
        raise Message.BOX_EMPTY.error(_flag("box", box))
    return found


def segment_point(
    rgb: Rgb,
    point: Point,
    segments: Segments | None,
    points: Sequence[Point] = (),
    *,
    smallest: bool = False,
) -> PromptedMask:
    """Return the object at a point.

    It is that of `segments` if it is likely, or else the best of the candidates and
    the detector's boxes there, or else the surest of what is seen around the point.
    With `smallest`, the smallest candidate comes first. What also holds another of the
    `points` is not meant. Raises InputError where there is none.
    """
    x, y = _pixel(rgb, point)
    others = _other_pixels(rgb, points, (x, y))
    found: list[PromptedMask] = []
    if segments is not None and not smallest:
        known = _known_object(segments, (x, y), others)
        if known is not None:
            found.append(known)
            if known.confidence >= RULE.likely:
                return known
    around = cache(partial(_looks_around, rgb, (x, y), others))

    def look_around() -> list[PromptedMask]:
        return [look for look, _ in around()[0]]

    candidate = object_at_point(rgb, (x, y), others, smallest, look_around)
    if candidate is not None:
        return candidate
    looks, is_contested = around()
    found += [PromptedMask(look.mask, sureness) for look, sureness in looks]
    if not found:
        nothing = (
            Message.PROMPT_REPEATED if is_contested else Message.POINT_SHOWS_NOTHING
        )
        raise nothing.error(_flag("point", point))
    return max(found, key=lambda one: one.confidence)


def _other_pixels(
    rgb: Rgb, points: Sequence[Point], own: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return the columns and rows of points on the photo that are not the own one."""
    height, width = rgb.shape[:2]
    pixels = [(round(u), round(v)) for u, v in points]
    return [
        (u, v)
        for u, v in pixels
        if 0 <= u < width and 0 <= v < height and (u, v) != own
    ]


def _known_object(
    segments: Segments, own: tuple[int, int], others: Sequence[tuple[int, int]]
) -> PromptedMask | None:
    """Return the segmenter's object at a pixel, None where there is none."""
    label = int(segments.labels[own[::-1]])
    mask = segments.labels == label
    if label == 0 or not is_meant(mask, own, others):
        return None
    return PromptedMask(mask, float(segments.confidence[label - 1]))


def _looks_around(
    rgb: Rgb, own: tuple[int, int], others: Sequence[tuple[int, int]]
) -> tuple[list[tuple[PromptedMask, float]], bool]:
    """Return what is seen in squares of several sizes around a pixel, and how surely.

    The last value is whether some of it also holds another point.
    """
    height, width = rgb.shape[:2]
    found = []
    is_contested = False
    for look in RULE.looks:
        first = mask_at_point(rgb, own, look * max(height, width))
        if not first.mask[own[::-1]] or first.mask.mean() >= RULE.whole:
            continue
        part = split(rgb, first.mask, own, others)
        again = PromptedMask(part, 0.0)
        if part.any():
            again = mask_in_box(rgb, box_of(part))
        is_contested |= not is_meant(first.mask, own, others)
        if is_meant(again.mask, own, others) and again.mask.mean() < RULE.whole:
            shared = np.count_nonzero(first.mask & again.mask)
            alike = shared / np.count_nonzero(first.mask | again.mask)
            sure = float(first.confidence * again.confidence * alike)
            found.append((again, sure))
    return found, is_contested


def split(
    rgb: Rgb, mask: Mask, point: tuple[int, int], others: Sequence[tuple[int, int]]
) -> Mask:
    """(H, W): the part of a mask about a point, up to the edges between it and those of the `others` that it holds."""
    inside = [(x, y) for x, y in others if mask[y, x]]
    if not inside:
        return mask
    markers = np.where(
        cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0, 0, 1
    ).astype(np.int32)
    for k, (x, y) in enumerate((point, *inside), 2):
        cv2.circle(markers, (x, y), 2, k, -1)
    own = cv2.watershed(np.ascontiguousarray(rgb), markers) == 2
    return np.asarray(own & mask)


def _flag(kind: str, place: Sequence[float]) -> str:
    return f"--{kind} {_written(place)}"


def _written(numbers: Sequence[float]) -> str:
    """Return numbers as a person writes them, without rounding pixels."""
    return ",".join(f"{number:.10g}" for number in numbers)


def _whole(numbers: Sequence[float]) -> str:
    """Return numbers rounded to pixels."""
    return ",".join(str(round(number)) for number in numbers)


def _corners(rgb: Rgb, box: Box) -> tuple[int, int, int, int]:
    """Left, top, right, bottom px of the part of a box on the photo. Raises InputError where that is too small."""
    height, width = rgb.shape[:2]
    x0, y0 = max(0, round(box[0])), max(0, round(box[1]))
    x1, y1 = min(width, round(box[0] + box[2])), min(height, round(box[1] + box[3]))
    if x1 - x0 < 4 or y1 - y0 < 4:
        is_outside = min(box[2:]) >= 4 and (x1 <= x0 or y1 <= y0)
        wrong = Message.BOX_OFF_PHOTO if is_outside else Message.BOX_TOO_LITTLE
        raise wrong.error(_flag("box", box), width=width, height=height)
    return x0, y0, x1, y1


def _pixel(rgb: Rgb, point: Point) -> tuple[int, int]:
    """Column and row of a point. Raises InputError where it is off the photo."""
    height, width = rgb.shape[:2]
    x, y = round(point[0]), round(point[1])
    if not (0 <= x < width and 0 <= y < height):
        raise Message.POINT_OFF_PHOTO.error(
            _flag("point", point), width=width, height=height
        )
    return x, y
