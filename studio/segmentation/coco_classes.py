"""The 80 classes of COCO: which ones physgen moves, and why (`coco_classes.tsv`)."""

from __future__ import annotations

import csv
from pathlib import Path

TABLE = Path(__file__).with_name("coco_classes.tsv")


def _rows() -> list[dict[str, str]]:
    with TABLE.open(newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


CLASSES = tuple(row["class"] for row in _rows())
"""Names in the order of COCO, which is the order of the detector's class scores."""
MOVABLE = frozenset(row["class"] for row in _rows() if row["role"] == "movable")
"""Names of the classes whose objects physgen moves."""
MOVABLE_INDICES = [k for k, name in enumerate(CLASSES) if name in MOVABLE]
"""Places of these classes in CLASSES."""
