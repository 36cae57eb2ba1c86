"""Labelled photos that the cut-out head learns from, by set.

The split is that of `photo_split.py`: no photo teaches that is for figures.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from labelled_photos import (
    BAND,
    CALTECH_EXCLUDED,
    OPEN_LICENCES,
    UNJUDGED,
    LabelledPhoto,
    _is_movable,
    photo_licences,
    photos_of,
)
from numpy.typing import NDArray

SET_SHARES = {
    "coco-minis": 0.4,
    "coco": 0.25,
    "caltech101-part": 0.16,
    "trashnet-grabcut": 0.1,
    "fruits-nuts": 0.05,
    "class5": 0.04,
}
"""Share of the photos' crops that each set gives: sets of many kinds of objects have
most, plain backgrounds least."""
COVERING_CLASSES = frozenset({"dining table", "bed", "couch"})
"""Classes of COCO whose polygons include the things that lie on them."""
OUTLINE_SLACK = {"caltech101-part": 2, "trashnet-grabcut": BAND}
"""Half the width of the unjudged band along outlines that are not exact, px."""
BANDED_SETS = frozenset({"trashnet-grabcut"})
"""Sets whose label maps contain that band."""
IMMOVABLE_SHARE = 0.3
"""Crops of people, animals and furniture, for each crop of a movable object."""


def photo_objects(
    set_name: str, licences: frozenset[int] | None = OPEN_LICENCES
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8], list[int], list[int]]]:
    """Yield rgb (H, W, 3), labels (H, W), movable ids and other ids of each photo.

    `licences` are the photo licences of coco-minis that are used, None for all.
    """
    allowed = photo_licences()
    for photo in photos_of(set_name, training=True):
        is_checked = set_name == "coco-minis" and licences is not None
        if is_checked and allowed[photo.name] not in licences:
            continue
        labels = photo.read_labels()
        movable, fixed = _ids(photo, labels)
        slack = OUTLINE_SLACK.get(set_name, 0)
        if slack and set_name not in BANDED_SETS:
            labels = with_loose_outlines(labels, slack)
        rgb = np.ascontiguousarray(photo.read()[..., ::-1])
        yield rgb, labels, movable, fixed


def _ids(
    photo: LabelledPhoto, labels: NDArray[np.uint8]
) -> tuple[list[int], list[int]]:
    """Return the ids of movable objects of a photo, and of people, animals, furniture."""
    movable, fixed = [], []
    excluded = COVERING_CLASSES | CALTECH_EXCLUDED
    for label in np.unique(labels).tolist():
        name = photo.names.get(label, "")
        if label in (0, UNJUDGED) or name in excluded:
            continue
        group = movable if _is_movable(photo.set_name, name) else fixed
        group.append(label)
    return movable, fixed


def with_loose_outlines(labels: NDArray[np.uint8], slack: int) -> NDArray[np.uint8]:
    """Return labels (H, W) with an unjudged band of `slack` px on both sides of outlines."""
    kernel = np.ones((2 * slack + 1, 2 * slack + 1), np.uint8)
    is_outline = cv2.morphologyEx(labels, cv2.MORPH_GRADIENT, kernel) > 0
    loose = labels.copy()
    loose[is_outline] = UNJUDGED
    return loose
