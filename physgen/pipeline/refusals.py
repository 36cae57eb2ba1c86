"""Reasons not to push an object of a photo: a person touches it, it floats, it is tiny.

A push of such an object looks absurd: a bowl tumbles through the hands in front of it,
or a boat slides over the sea. The user can still push it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from physgen.materials import kind
from physgen.perceive.segment.detector import box_overlap, detect_boxes
from physgen.perceive.segment.network import run_network
from physgen.perceive.support.view_classifier import view_chances
from physgen.perceive.wheels import may_drive
from physgen.text import listed

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene

Array = NDArray[np.float64]

UNSUITABLE = "it looks like a photo without loose objects at rest"
"""Reason for the whole photo; `judge_suitability` gives it, too, at a higher chance."""
PERSON = 0
"""Index of COCO's class person among the classes of the detector."""
WATERCRAFT = frozenset(["toy boat", "surfboard"])
"""Nouns of floating things."""


@dataclass(frozen=True)
class RefusalLimits:
    """Limits of refusals; lengths are shares of the photo's longer side."""

    unsuitable: float = 0.9
    """Chance of a photo without loose objects above which no object is pushed."""
    outdoors: float = 0.5
    """The same chance above which a boat is not a toy."""
    staged_chance: float = 0.3
    """The same chance below which a person-like object is a figure."""
    person: float = 0.5
    """Smallest score of a person: hands score as high, toys less than 0.4."""
    same_iou: float = 0.6
    """Smallest IoU of two boxes around the same object."""
    touch: float = 0.01
    """Gap below which a person touches an object."""
    reach: float = 0.1
    """Gap below which the hands of a large person may touch an object."""
    large: float = 0.05
    """Share of the photo's area above which a person is large."""
    passenger: float = 0.3
    """Height of a person, by that of a vehicle, below which the person sits inside or
    stands far behind.
    """
    tiny: float = 0.035
    """Longer side below which an object is too small to watch."""


REFUSAL = RefusalLimits()


@dataclass(frozen=True)
class Refusals:
    """Reasons not to push a whole photo or single objects."""

    photo: str = ""
    """Reason for the whole photo; empty if some object may be pushed."""
    objects: Mapping[str, str] = field(default_factory=dict)
    """Reasons by the names of objects."""
    barred_sides: Mapping[str, str] = field(default_factory=dict)
    """Sides, `left` or `right`, towards a person, to which an object is not pushed."""

    @property
    def reasons(self) -> list[str]:
        """Return the reasons as sentences without a full stop."""
        if self.photo:
            return [self.photo]
        by_reason: dict[str, list[str]] = {}
        for name, reason in self.objects.items():
            by_reason.setdefault(reason, []).append(name)
        return [
            f"{listed(names, 'and')}: {reason}, not pushed"
            for reason, names in by_reason.items()
        ]


def find_refusals(photo_scene: PerceivedScene) -> Refusals:
    """Find the reasons not to push objects of a perceived photo."""
    rgb = photo_scene.percepts.rgb
    unsuitable = view_chances(run_network(rgb).features).unsuitable
    # The classifier of views is cheap; the detector runs only for suitable photos.
    if unsuitable >= REFUSAL.unsuitable:
        return Refusals(UNSUITABLE)
    boxes = detect_boxes(rgb)
    people = boxes.corners[boxes.scores[:, 2 + PERSON] >= REFUSAL.person]
    photo = _Photo(people, unsuitable, rgb.shape[0], rgb.shape[1])
    reasons: dict[str, str] = {}
    barred_sides: dict[str, str] = {}
    for name, item in photo_scene.document["objects"].items():
        box = object_box(photo_scene, item)
        if box is None:
            continue
        least_height = 0.0
        if may_drive(item.get("label", ""), None):
            least_height = REFUSAL.passenger * (box[3] - box[1])
        person = photo.person_at(box, least_height)
        reason = photo.reason(item, box)
        if reason:
            reasons[name] = reason
        elif person is not None and photo.is_beside_person(box, person):
            is_right = person[0] + person[2] > box[0] + box[2]
            barred_sides[name] = "right" if is_right else "left"
        elif person is not None:
            reasons[name] = "a person or a hand is at it"
    return Refusals("", reasons, barred_sides)


def object_box(photo_scene: PerceivedScene, item: Mapping[str, Any]) -> Array | None:
    """Return left, top, right and bottom (4,) px of an object's mask; None without a
    mask.
    """
    number = item.get("mask")
    if not isinstance(number, int):
        return None
    mask = (photo_scene.percepts.labels == number).astype(np.uint8)
    x, y, width, height = cv2.boundingRect(mask)
    return np.array([x, y, x + width, y + height], np.float64)


@dataclass(frozen=True)
class _Photo:
    """Evidence of a photo against pushes."""

    people: Array
    """Boxes around people and their hands, (n, 4) px."""
    unsuitable: float
    """Chance of a photo without loose objects at rest."""
    height: int
    width: int

    @property
    def side(self) -> int:
        """Return the longer side, px."""
        return max(self.height, self.width)

    def reason(self, item: Mapping[str, Any], box: Array) -> str:
        """Return the reason not to push an object; empty if only people may be in the
        way.
        """
        is_outdoors = self.unsuitable >= REFUSAL.outdoors
        if kind(item.get("label", "")).noun in WATERCRAFT and is_outdoors:
            return "it floats on water"
        if max(box[2:] - box[:2]) < REFUSAL.tiny * self.side:
            return "it is too small or too far away to be watched"
        return ""

    def person_at(self, box: Array, least_height: float = 0.0) -> Array | None:
        """Find the box (4,) of a person who may touch the object of a box (4,).

        People below `least_height` px do not count.
        """
        for person in self.people:
            if person[3] - person[1] < least_height:
                continue
            is_same = box_overlap(box[None], person[None])[0, 0] >= REFUSAL.same_iou
            # Indoors, a "person" with the object's own box is a figure or a doll.
            if is_same and self.unsuitable < REFUSAL.staged_chance:
                continue
            gaps = np.maximum(box[:2] - person[2:], person[:2] - box[2:])
            gap = float(np.hypot(*np.clip(gaps, 0, None)))
            area = float(np.prod(person[2:] - person[:2]))
            is_large = area >= REFUSAL.large * self.width * self.height
            if is_large:
                limit = REFUSAL.reach
            else:
                limit = REFUSAL.touch
            if gap <= limit * self.side:
                return np.asarray(person)
        return None

    def is_beside_person(self, box: Array, person: Array) -> bool:
        """Check whether an object is beside a person and can be pushed away from the
        person.
        """
        top_left = np.maximum(box[:2], person[:2])
        bottom_right = np.minimum(box[2:], person[2:])
        intersection = float(np.prod(np.clip(bottom_right - top_left, 0, None)))
        share = intersection / max(float(np.prod(box[2:] - box[:2])), 1.0)
        return self.unsuitable < REFUSAL.staged_chance and share < REFUSAL.same_iou
