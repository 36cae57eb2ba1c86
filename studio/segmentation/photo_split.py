"""The split of the labelled photos: photos that train a network, and photos that only measure it.

The detector, the cut-out head, the judge and the benchmarks use this split, so that
no figure is measured on a photo that a network learned from.
"""

from __future__ import annotations

import hashlib

HELD_OUT_PARTS = 5
"""One part in five of each set that is split is held out."""
SPLIT_SETS = ("trashnet-grabcut", "fruits-nuts", "class5")
"""Sets of which a part is held out; the other sets of the material are for training."""
COCO_TRAINING = (9, 650)
"""First and last number of the photos of coco/ that belong to COCO train2017."""
COCO_EXCEPTIONS = frozenset({632})
"""Numbers in that range whose photos belong to COCO val2017."""


def is_held_out(photo_name: str) -> bool:
    """Return whether a photo of SPLIT_SETS is held out.

    `photo_name` is the file name without folder and suffix, the key in labels.json.
    """
    digest = hashlib.sha256(photo_name.encode()).hexdigest()
    return int(digest, 16) % HELD_OUT_PARTS == 0


def is_coco_training(photo_name: str) -> bool:
    """Return whether a photo of coco/, named by its number, belongs to train2017.

    Networks that start from weights learned on COCO train2017 know these photos, so
    they are for training. The other 60 photos are for validation and figures.
    """
    number = int(photo_name)
    first, last = COCO_TRAINING
    return first <= number <= last and number not in COCO_EXCEPTIONS


def is_training(set_name: str, photo_name: str) -> bool:
    """Return whether a network may learn from a photo of a set of the material."""
    if set_name == "coco":
        return is_coco_training(photo_name)
    return set_name not in SPLIT_SETS or not is_held_out(photo_name)
