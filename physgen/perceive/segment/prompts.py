"""Objects from a user's prompts: boxes, points and label maps."""

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
from physgen.perceive.segment.point_choice import contains_prompt, object_at_point
from physgen.problems import InputError, Place, Problem, RefusedError
from physgen.registry import Backends

Box = tuple[float, float, float, float]
"""Left, top, width, height, px."""
Point = tuple[float, float]
"""x px, y px."""


@dataclass(frozen=True)
class PromptRule:
    """Constants of prompts, chosen on the validation homes and the tune half."""

    # Confidence of a selected object below which the photo is doubtful.
    weak_confidence: float = 0.33
    # Confidence above which a point selects the segmenter's object.
    point_confidence: float = 0.6
    # Share of the photo above which a mask is the photo rather than an object, since
    # nothing lies behind it.
    photo_share: float = 0.9
    # Least share of a selected object that the others leave visible.
    visible: float = 0.3
    looks: tuple[float, ...] = (1.4, 0.7, 0.35, 0.175, 0.09)
    """Sides of the squares around a point for the search of its object, over the
    photo's longer side.
    """
    overhang: float = 0.02
    """Largest overhang of a loosely drawn box over the photo's longer side."""
    # px: least width and height of a box.
    least_size: float = 4.0


RULE = PromptRule()


@dataclass(frozen=True)
class PromptFrame:
    """The photo of the prompts' pixels, and the places in the input."""

    # px.
    width: float
    # px.
    height: float
    # px of the scene's photo per px of this one.
    scale: float = 1.0
    places: Mapping[int, tuple[Place, str]] = field(default_factory=dict)
    """Place and dotted path of a prompt, by its order; a missing entry means a flag."""

    @classmethod
    def from_photo(cls, rgb: Rgb) -> PromptFrame:
        """Return the frame of prompts in pixels of the photo itself."""
        return cls(rgb.shape[1], rgb.shape[0])

    def boxes_in(self, rgb: Rgb, boxes: Sequence[Box]) -> list[Box]:
        """Convert boxes to pixels of the photo (H, W, 3)."""
        x = rgb.shape[1] / self.width
        y = rgb.shape[0] / self.height
        return [(box[0] * x, box[1] * y, box[2] * x, box[3] * y) for box in boxes]

    def points_in(self, rgb: Rgb, points: Sequence[Point]) -> list[Point]:
        """Convert points to pixels of the photo (H, W, 3)."""
        x = rgb.shape[1] / self.width
        y = rgb.shape[0] / self.height
        # Pixel centres are whole numbers: the last pixel must stay on a smaller photo.
        result: list[Point] = []
        for point in points:
            result.append(((point[0] + 0.5) * x - 0.5, (point[1] + 0.5) * y - 0.5))
        return result

    def problem(
        self, order: int, kind: str, numbers: Sequence[float], refusal: RefusedError
    ) -> Problem:
        """Return a problem at the place of a prompt, in the prompt's own numbers."""
        place, path = self.places.get(order, (Place(_flag(kind, numbers)), ""))
        if order not in self.places:
            quoted_value = ""
        else:
            quoted_value = f"[{_write_numbers(numbers)}]"
        return refusal.problem(place, path, quoted_value)


def check_prompts(
    boxes: Sequence[Box], points: Sequence[Point], frame: PromptFrame
) -> None:
    """Raise InputError with every box and point that is not on the photo.

    A box may overhang the photo by a few pixels. Boxes and points are in pixels of the
    `frame`.
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
    """Return the fault of numbers that are shares of the photo's sides, or None
    for px.
    """
    is_share = all(0 <= number <= 1 for number in numbers)
    if not is_share or all(number in (0, 1) for number in numbers):
        return None
    sides = (frame.width, frame.height, frame.width, frame.height)
    pixels = [number * side for number, side in zip(numbers, sides, strict=False)]
    if len(numbers) == len(sides):
        form = BOX_FORM
    else:
        form = POINT_FORM
    fix = f"{form}; did you mean {_round_numbers(pixels)}?"
    return Message.PROMPT_IN_SHARES.refusal(fix=fix)


def _box_fault(box: Box, frame: PromptFrame) -> RefusedError | None:
    """Return the fault of a box with its fix, or None."""
    form = BOX_FORM
    least_side = RULE.least_size / min(frame.scale, 1.0)
    x, y, width, height = box
    if width < 0 or height < 0:
        corrected_box = (min(x, x + width), min(y, y + height), abs(width), abs(height))
        fix = f"{form}; did you mean {_round_numbers(corrected_box)}?"
        return Message.BOX_NEGATIVE.refusal(fix=fix)
    if min(width, height) < least_side:
        return Message.BOX_TOO_SMALL.refusal(least=least_side, fix=form)
    if not (_reaches_out(box, frame) or _is_outside_frame(box, frame)):
        return None
    size = {"width": frame.width, "height": frame.height}
    likely_box = next(_likely_boxes(box, frame), None)
    if likely_box is None:
        fix = form
    else:
        fix = f"{form}; did you mean {_round_numbers(likely_box)}?"
    if _is_outside_frame(box, frame):
        return Message.PROMPT_OFF_PHOTO.refusal(fix=fix, **size)
    excess = _excess(box, frame)
    return Message.BOX_BEYOND_PHOTO.refusal(excess=excess, fix=fix, **size)


def _likely_boxes(box: Box, frame: PromptFrame) -> Iterator[Box]:
    """Yield the probable meanings of a wrong box: by its corners, or its part on the
    photo.
    """
    x, y, right, bottom = box
    by_corners = (x, y, right - x, bottom - y)
    left = max(x, 0.0)
    top = max(y, 0.0)
    clipped_right = min(x + right, frame.width)
    clipped_bottom = min(y + bottom, frame.height)
    visible_box = (left, top, clipped_right - left, clipped_bottom - top)
    for candidate in (by_corners, visible_box):
        if min(candidate[2:]) >= RULE.least_size and not _reaches_out(candidate, frame):
            yield candidate


def _reaches_out(box: Box, frame: PromptFrame) -> bool:
    """Return whether a box overhangs the photo more than a loosely drawn one."""
    return _excess(box, frame) > RULE.overhang * max(frame.width, frame.height)


def _excess(box: Box, frame: PromptFrame) -> float:
    """Return the overhang of a box outside the photo, px."""
    x, y, width, height = box
    return max(-x, -y, x + width - frame.width, y + height - frame.height, 0.0)


def _is_outside_frame(box: Box, frame: PromptFrame) -> bool:
    """Return whether no part of a box is on the photo."""
    x, y, width, height = box
    lies_beside = x >= frame.width or x + width <= 0
    return lies_beside or y >= frame.height or y + height <= 0


def _point_fault(point: Point, frame: PromptFrame) -> RefusedError | None:
    """Return the fault of a point with its fix, or None."""
    form = POINT_FORM
    if _is_inside(point, frame):
        return None
    swapped_point = (point[1], point[0])
    if _is_inside(swapped_point, frame):
        form += f"; did you mean {_round_numbers(swapped_point)}?"
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
    """The role `segment` with its nouns; without nouns, the role `categories` finds
    them.
    """

    backends: Backends
    nouns: Sequence[str] = ()
    is_smallest_meant: bool = False
    """Whether a point selects the smallest object rather than the whole one."""

    def __call__(self, rgb: Rgb) -> Segments:
        """Return the objects of the photo."""
        categories: Sequence[Category] = [Category(noun, True) for noun in self.nouns]
        if "categories" in self.backends.row("segment").uses and not categories:
            categories = self.backends.call("categories", rgb)
            self.backends.release("categories")
        segments: Segments = self.backends.call("segment", rgb, categories=categories)
        return segments

    def answers(
        self, rgb: Rgb, boxes: Sequence[Box], points: Sequence[Point]
    ) -> dict[int, PromptedMask]:
        """Return the masks of a backend that takes prompts itself, by the order of
        prompts.

        The result is empty if a prompt is off the photo, which is reported later.
        """
        segmenter = self.backends.get("segment")
        takes_prompts = hasattr(segmenter, "segment_meant_objects")
        if not (boxes or points) or not takes_prompts:
            return {}
        try:
            corners = [_corners(rgb, box) for box in boxes]
            for point in points:
                _pixel(rgb, point)
        except InputError:
            return {}
        sides = [(x0, y0, x1 - x0, y1 - y0) for x0, y0, x1, y1 in corners]
        masks = self.backends.run(
            "segment", lambda backend: backend.segment_meant_objects(rgb, sides, points)
        )
        return {
            k: answer
            for k, answer in enumerate(masks)
            if np.count_nonzero(answer.mask) >= SMALLEST_OBJECT
        }


def from_masks(
    labels: NDArray[np.uint16], names: Mapping[int, str] | None = None
) -> Detections:
    """Return the objects of a label map (H, W); `names` are known labels by id."""
    labels_by_id = {i: Name(text, 1.0) for i, text in (names or {}).items()}
    return Detections(labels, "given", {}, labels_by_id)


def from_prompts(
    rgb: Rgb,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segmenter,
    frame: PromptFrame | None = None,
) -> Detections:
    """Return one object per box and then per point, with ids 1, 2, ...

    A backend that takes prompts answers first; otherwise `segment_box` and
    `segment_point` are used. Boxes and points are in pixels of the `frame`, or of the
    photo itself. If a point selects the smallest object, the box of that object becomes
    its prompt. Raises InputError with every box or point that is off the photo or shows
    no object.
    """
    frame = frame or PromptFrame.from_photo(rgb)
    problems = _PromptProblems(frame, _list_prompts(boxes, points))
    boxes = frame.boxes_in(rgb, boxes)
    points = frame.points_in(rgb, points)
    masks = _cut_prompts(rgb, boxes, points, segment, problems)
    labels = _draw_in_front(masks, rgb.shape[:2])
    _check_visible(masks, labels, problems)
    places = _list_prompts(boxes, points)
    if segment.is_smallest_meant:
        # The scene stores the chosen region rather than the click.
        for k in range(len(boxes), len(masks)):
            places[k] = "box", _box_prompt(masks[k].mask)
    prompts = {}
    for k, (kind, place) in enumerate(places, 1):
        prompts[k] = {kind: [round(float(v), 2) for v in place]}
    confidence = {k: prompt_mask.confidence for k, prompt_mask in enumerate(masks, 1)}
    return Detections(labels, "pointed at", confidence, {}, prompts)


def _box_prompt(mask: NDArray[np.bool_]) -> Box:
    """Return x, y, width and height of a mask (H, W), px."""
    left, top, right, bottom = box_of(mask)
    return left, top, right - left, bottom - top


def _check_visible(
    masks: Sequence[PromptedMask],
    labels: NDArray[np.uint16],
    problems: _PromptProblems,
) -> None:
    """Raise InputError if the others hide the object of a prompt.

    Such a prompt repeats one of the others.
    """
    for k, prompt_mask in enumerate(masks, 1):
        area = np.count_nonzero(prompt_mask.mask)
        least_area = max(RULE.visible * area, SMALLEST_OBJECT)
        if np.count_nonzero(labels == k) < least_area:
            problems.add(k - 1, Message.PROMPT_REPEATED.refusal())
    problems.raise_all()


def _list_prompts(
    boxes: Sequence[Box], points: Sequence[Point]
) -> list[tuple[str, Sequence[float]]]:
    """Return the kind and the numbers of each prompt in order."""
    prompts: list[tuple[str, Sequence[float]]] = [("box", box) for box in boxes]
    return [*prompts, *(("point", point) for point in points)]


@dataclass
class _PromptProblems:
    """The problems of prompts, in the user's pixels."""

    frame: PromptFrame
    prompts: Sequence[tuple[str, Sequence[float]]]
    problems: list[Problem] = field(default_factory=list)

    def add(self, order: int, refusal: RefusedError) -> None:
        """Add the problem of the prompt at a place in the order."""
        kind, numbers = self.prompts[order]
        self.problems.append(self.frame.problem(order, kind, numbers, refusal))

    def raise_all(self) -> None:
        """Raise InputError with all problems, if there are any."""
        if self.problems:
            raise InputError(self.problems)


def _cut_prompts(
    rgb: Rgb,
    boxes: Sequence[Box],
    points: Sequence[Point],
    segment: Segmenter,
    problems: _PromptProblems,
) -> list[PromptedMask]:
    """Return the masks of boxes and points in the photo, or raise InputError."""
    masks: list[PromptedMask] = []
    segments_once = cache(lambda: segment(rgb))
    answers = segment.answers(rgb, boxes, points)
    for k, box in enumerate(boxes):
        try:
            masks.append(answers.get(k) or segment_box(rgb, box))
        except InputError as error:
            problems.add(k, error.problems[0].refusal())
    is_smallest = segment.is_smallest_meant
    for k, point in enumerate(points, len(boxes)):
        try:
            mask = answers.get(k) or segment_point(
                rgb, point, segments_once(), points, smallest=is_smallest
            )
            masks.append(mask)
        except InputError as error:
            problems.add(k, error.problems[0].refusal())
    problems.raise_all()
    return masks


def _draw_in_front(
    masks: Sequence[PromptedMask], shape: tuple[int, ...]
) -> NDArray[np.uint16]:
    """Return the label map (H, W) of masks with ids 1, 2, ...

    Small objects are drawn last, in front.
    """
    labels = np.zeros(shape, np.uint16)
    for k in sorted(range(len(masks)), key=lambda k: -int(masks[k].mask.sum())):
        labels[masks[k].mask] = k + 1
    return labels


def segment_box(rgb: Rgb, box: Box) -> PromptedMask:
    """Return the object in a box, in one piece.

    Raises InputError if the box has too little of the photo or no visible object.
    """
    result = mask_in_box(rgb, _corners(rgb, box))
    if not 0 < result.mask.mean() < RULE.photo_share:
        raise Message.BOX_EMPTY.error(_flag("box", box))
    return result


def segment_point(
    rgb: Rgb,
    point: Point,
    segments: Segments | None,
    points: Sequence[Point] = (),
    *,
    smallest: bool = False,
) -> PromptedMask:
    """Return the object at a point.

    It is the segmenter's object if that is likely, else the best of the candidates and
    boxes there, else the most confident cut-out around the point. With `smallest`, the
    smallest candidate comes first. Masks that contain another of the `points` are
    excluded. Raises InputError if there is no object.
    """
    x, y = _pixel(rgb, point)
    others = _other_pixels(rgb, points, (x, y))
    alternatives: list[PromptedMask] = []
    if segments is not None and not smallest:
        segmented_object = _known_object(segments, (x, y), others)
        if segmented_object is not None:
            alternatives.append(segmented_object)
            if segmented_object.confidence >= RULE.point_confidence:
                return segmented_object
    cached_looks = cache(partial(_looks_around, rgb, (x, y), others))

    def look_around() -> list[PromptedMask]:
        return [look for look, _ in cached_looks()[0]]

    candidate = object_at_point(rgb, (x, y), others, smallest, look_around)
    if candidate is not None:
        return candidate
    looks, has_other_point = cached_looks()
    alternatives += [PromptedMask(look.mask, sureness) for look, sureness in looks]
    if not alternatives:
        if has_other_point:
            message = Message.PROMPT_REPEATED
        else:
            message = Message.POINT_SHOWS_NOTHING
        raise message.error(_flag("point", point))
    return max(alternatives, key=lambda one: one.confidence)


def _other_pixels(
    rgb: Rgb, points: Sequence[Point], pixel: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return columns and rows of the other points on the photo."""
    height, width = rgb.shape[:2]
    pixels = [(round(u), round(v)) for u, v in points]
    return [
        (u, v)
        for u, v in pixels
        if 0 <= u < width and 0 <= v < height and (u, v) != pixel
    ]


def _known_object(
    segments: Segments, pixel: tuple[int, int], others: Sequence[tuple[int, int]]
) -> PromptedMask | None:
    """Return the segmenter's object at a pixel, or None."""
    label = int(segments.labels[pixel[::-1]])
    mask = segments.labels == label
    if label == 0 or not contains_prompt(mask, pixel, others):
        return None
    return PromptedMask(mask, float(segments.confidence[label - 1]))


def _looks_around(
    rgb: Rgb, pixel: tuple[int, int], others: Sequence[tuple[int, int]]
) -> tuple[list[tuple[PromptedMask, float]], bool]:
    """Return cut-outs in squares of several sizes around a pixel, with their
    confidences.

    The last value says whether one of them also contains another point.
    """
    height, width = rgb.shape[:2]
    results = []
    has_other_point = False
    for look in RULE.looks:
        first = mask_at_point(rgb, pixel, look * max(height, width))
        if not first.mask[pixel[::-1]] or first.mask.mean() >= RULE.photo_share:
            continue
        part = split(rgb, first.mask, pixel, others)
        # A second cut-out in the box of the first one should agree with it.
        second = PromptedMask(part, 0.0)
        if part.any():
            second = mask_in_box(rgb, box_of(part))
        has_other_point |= not contains_prompt(first.mask, pixel, others)
        if (
            contains_prompt(second.mask, pixel, others)
            and second.mask.mean() < RULE.photo_share
        ):
            intersection = np.count_nonzero(first.mask & second.mask)
            agreement = intersection / np.count_nonzero(first.mask | second.mask)
            confidence = float(first.confidence * second.confidence * agreement)
            results.append((second, confidence))
    return results, has_other_point


def split(
    rgb: Rgb, mask: Mask, point: tuple[int, int], others: Sequence[tuple[int, int]]
) -> Mask:
    """Return the part (H, W) of a mask around a point, up to the edges towards the
    `others`.
    """
    inside = []
    for x, y in others:
        if mask[y, x]:
            inside.append((x, y))
    if not inside:
        return mask
    # The watershed grows one region from each point; outside the mask is region 1.
    markers = np.where(
        cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0, 0, 1
    ).astype(np.int32)
    for k, (x, y) in enumerate((point, *inside), 2):
        cv2.circle(markers, (x, y), 2, k, -1)
    region = cv2.watershed(np.ascontiguousarray(rgb), markers) == 2
    return np.asarray(region & mask)


def _flag(kind: str, place: Sequence[float]) -> str:
    return f"--{kind} {_write_numbers(place)}"


def _write_numbers(numbers: Sequence[float]) -> str:
    """Return numbers as a user writes them, without rounding of pixels."""
    return ",".join(f"{number:.10g}" for number in numbers)


def _round_numbers(numbers: Sequence[float]) -> str:
    """Return numbers rounded to pixels."""
    return ",".join(str(round(number)) for number in numbers)


def _corners(rgb: Rgb, box: Box) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of the part of a box on the photo, px.

    Raises InputError if that part is too small.
    """
    height, width = rgb.shape[:2]
    x0 = max(0, round(box[0]))
    y0 = max(0, round(box[1]))
    x1 = min(width, round(box[0] + box[2]))
    y1 = min(height, round(box[1] + box[3]))
    if x1 - x0 < 4 or y1 - y0 < 4:
        is_outside = min(box[2:]) >= 4 and (x1 <= x0 or y1 <= y0)
        if is_outside:
            wrong = Message.BOX_OFF_PHOTO
        else:
            wrong = Message.BOX_TOO_LITTLE
        raise wrong.error(_flag("box", box), width=width, height=height)
    return x0, y0, x1, y1


def _pixel(rgb: Rgb, point: Point) -> tuple[int, int]:
    """Return column and row of a point, or raise InputError if it is off the photo."""
    height, width = rgb.shape[:2]
    x = round(point[0])
    y = round(point[1])
    if not (0 <= x < width and 0 <= y < height):
        raise Message.POINT_OFF_PHOTO.error(
            _flag("point", point), width=width, height=height
        )
    return x, y
