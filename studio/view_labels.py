"""Photos whose view was labelled by hand, and which half of them a model may learn from.

`view_labels.csv` names each photo and its view: `side`, `oblique` (the camera looks down
by 30 to 60 degrees) or `top`, and whether it shows loose objects at rest, which can be
animated. The photos are not part of the project: MATERIAL names their folder.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

LABELS = Path(__file__).with_name("view_labels.csv")
MATERIAL = "PHYSGEN_MATERIAL"
"""Environment variable: the folder of coco/, photos/, peer-scenes/ and material/."""
SCENES = Path(__file__).parents[1] / "scenes"
SEEN_FROM_ABOVE = ("billiards", "curling")
"""Bundled scenes that are seen from above."""
PATTERNS = {
    "coco": "coco/{}.jpg",
    "strangers": "photos/strangers/{}.jpg",
    "photos": "photos/{}/original.png",
    "peer-scenes": "peer-scenes/{}/original.png",
}
"""Files of photos, from the folder of MATERIAL; those of other sets are in
material/SET/images."""


@dataclass(frozen=True)
class LabelledPhoto:
    """A photo with its view."""

    name: str
    """`SET/STEM`."""
    view: str
    """side, oblique or top."""
    can_animate: bool

    @property
    def set(self) -> str:
        """The set that the photo is from."""
        return self.name.partition("/")[0]

    @property
    def is_for_training(self) -> bool:
        """Whether the photo is in the half to learn from; the other half measures."""
        return crc32(self.name.encode()) % 2 == 0

    def file(self, material: Path) -> Path:
        """Return the photo's file."""
        pattern = PATTERNS.get(self.set, f"material/{self.set}/images/{{}}.jpg")
        return material / pattern.format(self.name.partition("/")[2])


def labelled_photos() -> list[LabelledPhoto]:
    """Return all labelled photos, in the order of the file."""
    with LABELS.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    photos = []
    for row in rows:
        can_animate = row["can_animate"] == "yes"
        photos.append(LabelledPhoto(row["photo"], row["view"], can_animate))
    return photos


def bundled_photos() -> Iterator[tuple[str, Path, str]]:
    """Yield name, file and view of the bundled scenes' photos."""
    for file in sorted(SCENES.glob("*/photo.png")):
        name = file.parent.name
        yield f"scenes/{name}", file, "top" if name in SEEN_FROM_ABOVE else "side"


def material_folder() -> Path | None:
    """Return the folder of the photos, if MATERIAL names one."""
    named = os.environ.get(MATERIAL)
    return Path(named) if named else None
