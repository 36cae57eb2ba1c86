"""Photos with instance masks, and which of them judge and do not teach."""

from __future__ import annotations

from pathlib import Path

PART = 5
"""Of so many photos, in the order of their numbers, one judges."""


def validation_ids(material: Path) -> set[str]:
    """Numbers of the validation photos of `material`/coco: every fifth by number, the first one included."""
    ids = sorted((path.stem for path in (material / "coco").glob("*.jpg")), key=int)
    return set(ids[::PART])
