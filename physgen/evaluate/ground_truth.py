"""Photos with true masks: label maps beside photos, folders of both, or COCO files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.maps import read_labels
from physgen.perceive.import_coco import CocoImage, coco_photos, coco_strays, decode_segmentation
from physgen.photos import read_photo
from physgen.problems import InputError, Place, Problem, Severity

Mask = NDArray[np.bool_]

ENDINGS = (".png", ".jpg", ".jpeg", ".webp")
"""Of photos."""
LABELS = ".labels.png"
"""Ends the name of a label map beside its photo."""
PHOTOS, MAPS, ASSETS = ("photo", "original"), ("masks.png", "mask.png"), "photo.assets"
"""Names in a folder that holds one photo."""
UNJUDGED = 65535
"""Id in a 16-bit label map where truth is unknown."""
MOST_OBJECTS = 10_000
"""On a photo."""
HOW = "put NAME.labels.png beside each NAME.png, masks.png beside each photo.png in folders, or a COCO file with them"


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

    def cut_by(self, size: tuple[int, int]) -> bool:
        """Whether it touches the border of a photo of `size` (W, H), which then probably cuts the object off."""
        left, top, right, bottom = self.box
        return bool(self.mask.size) and (left <= 0 or top <= 0 or right >= size[0] or bottom >= size[1])

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
    labels: tuple[str, ...] = ()
    """COCO's category of each; none of a label map."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H px."""
        return self.rgb.shape[1], self.rgb.shape[0]


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
            found = f"{labels.shape[1]} x {labels.shape[0]} px"
            expected = f"differs from the {rgb.shape[1]} x {rgb.shape[0]} px of {self.photo.name}"
            raise InputError.of(str(self.truth), found, expected, "make it the photo's size")
        unjudged = labels == UNJUDGED
        masks = tuple(patches(np.where(unjudged, np.uint16(0), labels)).values())
        self._refuse_many(len(masks))
        return Truth(rgb, masks, unjudged)

    def _annotated(self, coco: CocoImage, rgb: NDArray[np.uint8]) -> Truth:
        size = rgb.shape[1], rgb.shape[0]
        self._refuse_many(len(coco.annotations))
        if coco.size is not None and coco.size != size:
            found = f"{coco.size[0]} x {coco.size[1]} px"
            expected = f"are given for {self.photo.name}, which has {size[0]} x {size[1]}"
            raise InputError.of(str(self.truth), found, expected, "annotate the photo as it is")
        unjudged = np.zeros(rgb.shape[:2], np.bool_)
        masks, labels, problems = list[Patch](), list[str](), list[Problem]()

        def wrong(number: object, expected: str, fix: str) -> None:
            problems.append(Problem(Place(str(self.truth)), self.name, f"annotation {number}", expected, fix))

        for crowd, regions in ((False, coco.annotations), (True, coco.crowds)):
            for number, annotation in enumerate(regions):
                number = annotation.get("id", number)
                try:
                    mask = decode_segmentation(annotation.get("segmentation"), size)
                except ValueError as error:
                    wrong(number, str(error), "export it again")
                    continue
                if crowd:
                    unjudged |= mask
                elif not mask.any() and _outside(annotation.get("segmentation"), size):
                    wrong(number, "lies outside the photo", "leave it out, or mend its outline")
                else:
                    masks.append(Patch.of(mask))
                    labels.append(coco.label(annotation))
        if problems:
            raise InputError(problems)
        return Truth(rgb, tuple(masks), unjudged, tuple(labels))

    def _refuse_many(self, count: int) -> None:
        if count > MOST_OBJECTS:
            fix = "give each object one id, without smoothing"
            raise InputError.of(str(self.truth), f"{count:,} objects", "are more than a scene holds", fix)


def _outside(outline: object, size: tuple[int, int]) -> bool:
    """Whether polygons have no point within a photo of `size` (W, H); one smaller than a pixel may lie within."""
    points = [part for polygon in outline for part in polygon] if isinstance(outline, list) else []
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    return not ((xy >= 0) & (xy <= size)).all(axis=1).any()


def pairs(folder: Path) -> tuple[list[Pair], list[Problem]]:
    """By name, with warnings of photos and label maps without a partner. Raises InputError where there is no pair."""
    if not folder.exists():
        raise InputError.of(str(folder), "", "no such folder", "check the path")
    if folder.is_file() and folder.suffix.lower() == ".json":
        return _named(list(_coco(folder)), folder.parent), _strays(folder)
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is not a folder", "name the folder that holds the photos")
    found: list[Pair] = []
    alone: list[Path] = []
    inner = (p for p in folder.rglob("*") if p.is_dir() and not _hidden(p, folder))
    for place in (folder, *sorted(inner)):
        if place.suffix != ".assets":  # a scene's maps
            more, lonely = _beside(place)
            found, alone = found + more, alone + lonely
        found += [pair for pair in _of_folder(place) if pair.photo not in {other.photo for other in found}]
    strays: list[Problem] = []
    for file in sorted(folder.glob("*.json")):
        if _is_coco(file):
            found += _coco(file)
            strays += _strays(file)
    if not found:
        raise InputError.of(str(folder), "", "holds no photo with a label map", HOW)
    taken = {pair.photo for pair in found} | {pair.truth for pair in found}
    warnings = []
    for path in alone:
        if path not in taken:
            no_photo = path.name.endswith(LABELS)
            expected = "has no photo" if no_photo else "is left out: it has no label map"
            fix = "name both alike" if no_photo else HOW
            warnings.append(Problem(Place(str(path)), "", "", expected, fix, Severity.WARNING))
    return _named(found, folder), [*warnings, *strays]


def _hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def _photos(folder: Path, stem: str) -> list[Path]:
    """Photos of a name, whatever their ending."""
    literal = re.sub(r"([*?[])", r"[\1]", stem)
    return [p for p in sorted(folder.glob(f"{literal}.*")) if p.stem == stem and _is_photo(p)]


def _is_photo(path: Path) -> bool:
    return path.suffix.lower() in ENDINGS and not path.name.endswith(LABELS) and path.is_file()


def _beside(folder: Path) -> tuple[list[Pair], list[Path]]:
    """`NAME.png` with `NAME.labels.png`, and the files of such a folder without a partner."""
    found, alone = [], []
    for path in [p for p in sorted(folder.glob(f"*{LABELS}")) if p.is_file()]:
        photos = _photos(folder, path.name.removesuffix(LABELS))
        if len(photos) > 1:
            names = " and ".join(p.name for p in photos)
            raise InputError.of(str(path), names, "could both be its photo", "keep one of them")
        if photos:
            found.append(Pair(photos[0], path))
        else:
            alone.append(path)
    matched = {pair.photo for pair in found}
    alone += [p for p in sorted(folder.iterdir()) if _is_photo(p) and p not in matched and p.name not in MAPS]
    return found, alone


def _of_folder(folder: Path) -> list[Pair]:
    """`photo.png` or `original.png` with `masks.png` or `mask.png`, there or in `photo.assets/`."""
    photos = [p for stem in PHOTOS for p in _photos(folder, stem)]
    maps = [folder / inner / name for inner in ("", ASSETS) for name in MAPS]
    truth = next((p for p in maps if p.is_file()), None)
    return [Pair(photos[0], truth)] if photos and truth else []


def _is_coco(file: Path) -> bool:
    """Whether a JSON file, which may be anything, lists photos and annotations."""
    try:
        data = json.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(data, dict) and isinstance(data.get("annotations"), list) and bool(data.get("images"))


def _coco(file: Path) -> Iterator[Pair]:
    for image in coco_photos(file):
        yield Pair(image.file, file, image)


def _strays(file: Path) -> list[Problem]:
    """A warning of annotations without a photo: detections of those objects would count as false."""
    count = coco_strays(file)
    if not count:
        return []
    found = f"{count} annotation{'s' * (count > 1)}"
    fix = "give each the image_id of a photo"
    return [Problem(Place(str(file)), "", found, "of no photo in it: left out", fix, Severity.WARNING)]


def _named(found: list[Pair], folder: Path) -> list[Pair]:
    """The pairs by name: a photo's path in the folder, or its own folder's where that holds one photo."""
    used: dict[str, int] = {}
    result = []
    for pair in found:
        way = pair.photo.relative_to(folder) if pair.photo.is_relative_to(folder) else Path(pair.photo.name)
        alone = pair.photo.stem in PHOTOS and pair.coco is None and not pair.truth.name.endswith(LABELS)
        parts = way.parent.parts or (folder.resolve().name,) if alone else way.with_suffix("").parts
        name = re.sub(r"[^\w.-]+", "-", "-".join(parts)).strip(".-") or "photo"
        used[name] = used.get(name, 0) + 1
        result.append(replace(pair, name=name if used[name] == 1 else f"{name}-{used[name]}"))
    return sorted(result, key=lambda pair: pair.name)
