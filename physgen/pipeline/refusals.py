"""Reasons not to push an object of a photo: someone touches it, it floats, it is tiny.

A push of such an object looks absurd: a bowl tumbles through the hands in front of it, or
a boat slides over the sea. The user can push it all the same.
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
from physgen.text import listed

if TYPE_CHECKING:
    from physgen.perceive.roles import PerceivedScene

Array = NDArray[np.float64]

UNSUITABLE = "it looks like a photo without loose objects at rest"
"""The reason that `judge_suitability` gives as well, from a higher chance on."""
PERSON = 0
"""COCO's class among those of the detector."""
WATERCRAFT = frozenset(["toy boat", "surfboard"])
"""Nouns of what floats."""


@dataclass(frozen=True)
class RefusalLimits:
    """Limits from which an object is not pushed; lengths are shares of the longer side."""

    unsuitable: float = 0.9
    """Chance that a photo shows nothing loose, from which nothing is pushed."""
    outdoors: float = 0.5
    """The same, from which a boat is no toy."""
    staged: float = 0.3
    """The same, below which a person-like object is a figure."""
    person: float = 0.5
    """Score of a person: hands score as much, and toys less than 0.4."""
    same: float = 0.6
    """IoU of two boxes of one object."""
    touch: float = 0.01
    """Gap between an object and a person who touches it."""
    reach: float = 0.1
    """Gap to a large person, whose hands may be at the object."""
    large: float = 0.05
    """Share of the photo from which a person is large."""
    tiny: float = 0.035
    """Longer side of an object that is too small to be watched."""


REFUSAL = RefusalLimits()


@dataclass(frozen=True)
class Refusals:
    """Reasons not to push, of a whole photo and of its objects."""

    photo: str = ""
    """Empty if something of the photo may be pushed."""
    objects: Mapping[str, str] = field(default_factory=dict)
    """By the objects' names."""
    barred: Mapping[str, str] = field(default_factory=dict)
    """Sides, `left` or `right`, to which an object is not pushed: someone is there."""

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
    """Return the reasons not to push objects of a perceived photo."""
    rgb = photo_scene.percepts.rgb
    unsuitable = view_chances(run_network(rgb).features).unsuitable
    if unsuitable >= REFUSAL.unsuitable:
        return Refusals(UNSUITABLE)
    boxes = detect_boxes(rgb)
    people = boxes.corners[boxes.scores[:, 2 + PERSON] >= REFUSAL.person]
    photo = _Photo(people, unsuitable, rgb.shape[0], rgb.shape[1])
    reasons: dict[str, str] = {}
    barred: dict[str, str] = {}
    for name, item in photo_scene.document["objects"].items():
        box = object_box(photo_scene, item)
        if box is None:
            continue
        person = photo.person_at(box)
        reason = photo.reason(item, box)
        if reason:
            reasons[name] = reason
        elif person is not None and photo.is_beside(box, person):
            is_right = person[0] + person[2] > box[0] + box[2]
            barred[name] = "right" if is_right else "left"
        elif person is not None:
            reasons[name] = "a person or a hand is at it"
    return Refusals("", reasons, barred)


def object_box(photo_scene: PerceivedScene, item: Mapping[str, Any]) -> Array | None:
    """Return left, top, right and bottom (4,) px of an object's mask; None without one."""
    number = item.get("mask")
    if not isinstance(number, int):
        return None
    own = (photo_scene.percepts.labels == number).astype(np.uint8)
    x, y, width, height = cv2.boundingRect(own)
    return np.array([x, y, x + width, y + height], np.float64)


@dataclass(frozen=True)
class _Photo:
    """Evidence of a photo that speaks against pushes."""

    people: Array
    """(n, 4) px: boxes around people and their hands."""
    unsuitable: float
    """Chance that it shows nothing loose at rest."""
    height: int
    width: int

    @property
    def side(self) -> int:
        """px: its longer side."""
        return max(self.height, self.width)

    def reason(self, item: Mapping[str, Any], box: Array) -> str:
        """Return why an object is not pushed; empty if only people may be in the way."""
        is_outdoors = self.unsuitable >= REFUSAL.outdoors
        if kind(item.get("label", "")).noun in WATERCRAFT and is_outdoors:
            return "it floats on water"
        if max(box[2:] - box[:2]) < REFUSAL.tiny * self.side:
            return "it is too small or too far away to be watched"
        return ""

    def person_at(self, box: Array) -> Array | None:
        """Return the box (4,) of a person who may touch the object of a box (4,)."""
        for person in self.people:
            is_same = box_overlap(box[None], person[None])[0, 0] >= REFUSAL.same
            if is_same and self.unsuitable < REFUSAL.staged:
                continue  # a figure
            gaps = np.maximum(box[:2] - person[2:], person[:2] - box[2:])
            gap = float(np.hypot(*np.clip(gaps, 0, None)))
            area = float(np.prod(person[2:] - person[:2]))
            is_large = area >= REFUSAL.large * self.width * self.height
            limit = REFUSAL.reach if is_large else REFUSAL.touch
            if gap <= limit * self.side:
                return np.asarray(person)
        return None

    def is_beside(self, box: Array, person: Array) -> bool:
        """Return whether an object stands beside a person and can be pushed away."""
        low = np.maximum(box[:2], person[:2])
        high = np.minimum(box[2:], person[2:])
        shared = float(np.prod(np.clip(high - low, 0, None)))
        share = shared / max(float(np.prod(box[2:] - box[:2])), 1.0)
        return self.unsuitable < REFUSAL.staged and share < REFUSAL.same
