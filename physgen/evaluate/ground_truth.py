"""Photos with true masks: label maps beside photos, photos with their assets as `perceive` writes them, COCO files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.maps import read_labels
from physgen.perceive.import_coco import CocoImage, coco_photos, decode_segmentation
from physgen.photos import read_photo
from physgen.problems import InputError, Place, Problem, Severity

Mask = NDArray[np.bool_]

ENDINGS = (".png", ".jpg", ".jpeg", ".webp")
"""Of photos."""
LABELS = ".labels.png"
"""Ends the name of a label map beside its photo."""
ASSETS = "photo.assets/masks.png"
"""The label map of a folder that holds one `photo.*`."""
UNJUDGED = 65535
"""Id in a 16-bit label map where truth is unknown."""
HOW = f"put NAME{LABELS} beside each NAME.png, or {ASSETS} beside each photo.png in folders, or name a COCO file"


@dataclass(frozen=True, eq=False)
class Patch:
    """A mask, kept as the cut-out that bounds it."""

    x: int
    y: int
    mask: Mask
    """(h, w), its top-left pixel at (x, y) of the photo."""

    @classmethod
    def of(cls, mask: Mask, x: int = 0, y: int = 0) -> Patch:
        """Of a mask (h, w) whose top-left pixel lies at (x, y); an empty one has no rows and columns."""
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        if not len(rows):
            return cls(x, y, np.zeros((0, 0), np.bool_))
        top, left = int(rows[0]), int(columns[0])
        return cls(x + left, y + top, mask[top : rows[-1] + 1, left : columns[-1] + 1].copy())

    @property
    def area(self) -> int:
        """px."""
        return int(np.count_nonzero(self.mask))

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right, bottom px; the last two just outside."""
        return self.x, self.y, self.x + self.mask.shape[1], self.y + self.mask.shape[0]

    def part(self, where: Mask) -> Mask:
        """(h, w): the pixels of a whole photo's `where` (H, W) below the cut-out."""
        left, top, right, bottom = self.box
        return where[top:bottom, left:right]

    def shared(self, other: Patch) -> int:
        """Pixels that two masks share."""
        left, top = max(self.x, other.x), max(self.y, other.y)
        right, bottom = min(self.box[2], other.box[2]), min(self.box[3], other.box[3])
        if right <= left or bottom <= top:
            return 0
        one, two = (p.mask[top - p.y : bottom - p.y, left - p.x : right - p.x] for p in (self, other))
        return int(np.count_nonzero(one & two))


def patches(labels: NDArray[np.integer]) -> dict[int, Patch]:
    """The mask of every id above 0 of a label map (H, W), by id."""
    rows, columns = np.nonzero(labels)
    known, inverse = np.unique(labels[rows, columns], return_inverse=True)
    low = np.full((len(known), 2), max(labels.shape))
    high = np.zeros((len(known), 2), np.int64)
    for axis, values in enumerate((columns, rows)):
        np.minimum.at(low[:, axis], inverse, values)
        np.maximum.at(high[:, axis], inverse, values)
    return {
        i: Patch(x, y, labels[y : bottom + 1, x : right + 1] == i)
        for i, (x, y), (right, bottom) in zip(known.tolist(), low.tolist(), high.tolist(), strict=True)
    }


@dataclass(frozen=True)
class Truth:
    """A photo and the true masks."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB, upright."""
    masks: tuple[Patch, ...]
    unjudged: Mask
    """(H, W): where truth is unknown."""


@dataclass(frozen=True)
class Pair:
    """A photo's file and its truth: a label map, or the annotations of a COCO file."""

    photo: Path
    truth: Path
    coco: CocoImage | None = None
    name: str = ""
    """Unique in the folder, and fit for a file."""

    def read(self) -> Truth:
        """Raises InputError where one of the files cannot be read, or their sizes differ."""
        rgb = read_photo(self.photo).rgb
        if self.coco is not None:
            return self._annotated(self.coco, rgb)
        labels = read_labels(self.truth)
        if labels.shape != rgb.shape[:2]:
            raise self._size(labels.shape[1], labels.shape[0], rgb)
        unjudged = labels == UNJUDGED
        return Truth(rgb, tuple(patches(np.where(unjudged, np.uint16(0), labels)).values()), unjudged)

    def _size(self, width: int, height: int, rgb: NDArray[np.uint8]) -> InputError:
        expected = f"differs from the {rgb.shape[1]} x {rgb.shape[0]} px of {self.photo.name}"
        return InputError.of(str(self.truth), f"{width} x {height} px", expected, "make it the photo's size")

    def _annotated(self, coco: CocoImage, rgb: NDArray[np.uint8]) -> Truth:
        size = rgb.shape[1], rgb.shape[0]
        if coco.size is not None and coco.size != size:
            raise self._size(*coco.size, rgb)
        unjudged, masks, problems = np.zeros(rgb.shape[:2], np.bool_), list[Patch](), list[Problem]()
        for crowd, regions in ((False, coco.annotations), (True, coco.crowds)):
            for number, annotation in enumerate(regions):
                try:
                    mask = decode_segmentation(annotation.get("segmentation"), size)
                except ValueError as error:
                    found = f"annotation {annotation.get('id', number)}"
                    place = Place(str(self.truth))
                    problems.append(Problem(place, self.name, found, str(error), "export it again"))
                    continue
                if crowd:
                    unjudged |= mask
                else:
                    masks.append(Patch.of(mask))
        if problems:
            raise InputError(problems)
        return Truth(rgb, tuple(masks), unjudged)


def pairs(folder: Path) -> tuple[list[Pair], list[Problem]]:
    """By name, with warnings of photos and label maps without a partner. Raises InputError where there is no pair."""
    if not folder.exists():
        raise InputError.of(str(folder), "", "no such folder", "check the path")
    if folder.is_file() and folder.suffix.lower() == ".json":
        return _named([Pair(image.file, folder, image) for image in coco_photos(folder)], folder.parent), []
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is not a folder", "name the folder that holds the photos")
    found, warnings = list[Pair](), list[Problem]()
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and not _hidden(path, folder)]
    photos = [path for path in files if path.suffix.lower() in ENDINGS and not path.name.endswith(LABELS)]
    for path in photos:
        beside, assets = path.with_name(path.stem + LABELS), path.parent / ASSETS
        truth = beside if beside.is_file() else assets if path.stem == "photo" else None
        if truth is not None and truth.is_file():
            found.append(Pair(path, truth))
        else:
            expected = "is left out: it has no label map"
            warnings.append(Problem(Place(str(path)), "", "", expected, HOW, Severity.WARNING))
    if not found:
        raise InputError.of(str(folder), "", "holds no photo with a label map", HOW)
    matched: dict[Path, Path] = {}
    for one in found:
        other = matched.setdefault(one.truth, one.photo)
        if other != one.photo:
            names = f"{other.name} and {one.photo.name}"
            raise InputError.of(str(one.truth), names, "could both be its photo", "keep one of them")
    for path in files:
        if path.name.endswith(LABELS) and path not in matched:
            place = Place(str(path))
            warnings.append(Problem(place, "", "", "has no photo", "name both alike", Severity.WARNING))
    return _named(found, folder), warnings


def _hidden(path: Path, folder: Path) -> bool:
    """Whether it lies in a hidden folder, or among the maps of a scene."""
    parts = path.relative_to(folder).parts
    return any(part.startswith(".") or part.endswith(".assets") for part in parts)


def _named(found: list[Pair], folder: Path) -> list[Pair]:
    """The pairs by name: a photo's path in the folder, or its own folder's where that holds one photo."""
    return sorted(_names(found, folder), key=lambda pair: pair.name)


def _names(found: list[Pair], folder: Path) -> Iterator[Pair]:
    used: dict[str, int] = {}
    for pair in found:
        way = pair.photo.relative_to(folder) if pair.photo.is_relative_to(folder) else Path(pair.photo.name)
        alone = pair.truth == pair.photo.parent / ASSETS
        parts = way.parent.parts or (folder.resolve().name,) if alone else way.with_suffix("").parts
        name = re.sub(r"[^\w.-]+", "-", "-".join(parts)).strip(".-") or "photo"
        used[name] = used.get(name, 0) + 1
        yield replace(pair, name=name if used[name] == 1 else f"{name}-{used[name]}")
