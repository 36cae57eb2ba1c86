"""A folder of photos and what is true of them -> pairs: label maps beside photos, folders of both, or COCO files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physgen.evaluate.matching import Mask, Patch, patches
from physgen.maps import read_labels
from physgen.perceive.import_coco import CocoImage, coco_photos, coco_strays, decode_segmentation
from physgen.photos import read_photo
from physgen.problems import InputError, Place, Problem, Severity

ENDINGS = (".png", ".jpg", ".jpeg", ".webp")
"""Of photos."""
LABELS = ".labels.png"
"""Ends the name of a label map beside its photo."""
PHOTOS, MAPS, ASSETS = ("photo", "original"), ("masks.png", "mask.png"), "photo.assets"
"""Names in a folder that holds one photo."""
UNJUDGED = 65535
"""Id of a 16-bit label map where nobody judges."""
MOST_OBJECTS = 10_000
"""On a photo."""
HOW = "put NAME.labels.png beside each NAME.png, masks.png beside each photo.png in folders, or a COCO file with them"


@dataclass(frozen=True)
class Truth:
    """A photo and the true masks."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB, upright."""
    masks: tuple[Patch, ...]
    ids: tuple[int, ...]
    """What the label map, or COCO, calls each."""
    unjudged: Mask
    """(H, W): where nobody says what is true."""
    labels: tuple[str, ...] = ()
    """What COCO's categories call each; none of a label map."""

    @property
    def size(self) -> tuple[int, int]:
        """W, H px."""
        return self.rgb.shape[1], self.rgb.shape[0]


@dataclass(frozen=True)
class Pair:
    """A photo's file and what tells its truth: a label map, or the annotations of a COCO file."""

    photo: Path
    truth: Path
    coco: CocoImage | None = None
    name: str = ""
    """Unlike that of every other pair of the folder, and fit for a file."""

    def read(self) -> Truth:
        """Both; raises InputError where one cannot be read, or their sizes differ."""
        rgb = read_photo(self.photo).rgb
        size = rgb.shape[1], rgb.shape[0]
        if self.coco is not None:
            return self._annotated(rgb, size)
        labels = read_labels(self.truth)
        if labels.shape != rgb.shape[:2]:
            found = f"{labels.shape[1]} x {labels.shape[0]} px"
            expected = f"differs from the {size[0]} x {size[1]} px of {self.photo.name}"
            raise InputError.of(str(self.truth), found, expected, "make it the photo's size")
        unjudged = labels == UNJUDGED
        found_ids = patches(np.where(unjudged, np.uint16(0), labels))
        self._refuse_many(len(found_ids))
        return Truth(rgb, tuple(found_ids.values()), tuple(found_ids), unjudged)

    def _annotated(self, rgb: NDArray[np.uint8], size: tuple[int, int]) -> Truth:
        assert self.coco is not None
        self._refuse_many(len(self.coco.annotations))
        if self.coco.size is not None and self.coco.size != size:
            found = f"{self.coco.size[0]} x {self.coco.size[1]} px"
            expected = f"are told of {self.photo.name}, which has {size[0]} x {size[1]}"
            raise InputError.of(str(self.truth), found, expected, "annotate the photo as it is")
        unjudged = np.zeros(rgb.shape[:2], np.bool_)
        masks, labels, problems = [], list[str](), list[Problem]()
        for crowd, regions in ((False, self.coco.annotations), (True, self.coco.crowds)):
            for number, annotation in enumerate(regions):
                known = annotation.get("id", number)
                try:
                    mask = decode_segmentation(annotation.get("segmentation"), size)
                except ValueError as error:
                    found = f"annotation {known}"
                    problems.append(
                        Problem(Place(str(self.truth)), self.name, found, str(error), "export it again")
                    )
                    continue
                if crowd:
                    unjudged |= mask
                elif not mask.any() and _outside(annotation.get("segmentation"), size):
                    problems.append(
                        Problem(
                            Place(str(self.truth)), self.name, f"annotation {known}", "lies outside the photo",
                            "leave it out, or mend its outline",
                        )
                    )  # fmt: skip
                else:
                    masks.append((known if isinstance(known, int) else number, Patch.of(mask)))
                    labels.append(self.coco.label(annotation))
        if problems:
            raise InputError(problems)
        ids, shapes = tuple(known for known, _ in masks), tuple(patch for _, patch in masks)
        return Truth(rgb, shapes, ids, unjudged, tuple(labels))

    def _refuse_many(self, count: int) -> None:
        if count > MOST_OBJECTS:
            fix = "give each object one id, without smoothing"
            raise InputError.of(str(self.truth), f"{count:,} objects", "are more than a scene holds", fix)


def pairs(folder: Path) -> tuple[list[Pair], list[Problem]]:
    """By name, and warnings of photos and label maps that stand alone. Raises InputError where there is no pair."""
    if not folder.exists():
        raise InputError.of(str(folder), "", "no such folder", "check the path")
    if folder.is_file() and folder.suffix.lower() == ".json":
        return _named(list(_coco(folder)), folder.parent), _strays(folder)
    if not folder.is_dir():
        raise InputError.of(str(folder), "", "is not a folder", "name the folder that holds the photos")
    found: list[Pair] = []
    alone: list[Path] = []
    for place in (folder, *sorted(p for p in folder.rglob("*") if p.is_dir() and not _hidden(p, folder))):
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
    warnings = [
        Problem(Place(str(path)), "", "", "is passed over: nothing tells its truth", HOW, Severity.WARNING)
        if not path.name.endswith(LABELS)
        else Problem(Place(str(path)), "", "", "has no photo", "name both alike", Severity.WARNING)
        for path in alone
        if path not in taken
    ]
    return _named(found, folder), [*warnings, *strays]


def _hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def _photos(folder: Path, stem: str) -> list[Path]:
    """Photos of a name, whatever their ending."""
    return [p for p in sorted(folder.glob(f"{_literal(stem)}.*")) if p.stem == stem and _is_photo(p)]


def _literal(text: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", text)


def _is_photo(path: Path) -> bool:
    return path.suffix.lower() in ENDINGS and not path.name.endswith(LABELS) and path.is_file()


def _beside(folder: Path) -> tuple[list[Pair], list[Path]]:
    """`NAME.png` with `NAME.labels.png`, and what of a folder that has such pairs stands alone."""
    found, alone = [], []
    maps = [p for p in sorted(folder.glob(f"*{LABELS}")) if p.is_file()]
    for path in maps:
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


def _outside(outline: object, size: tuple[int, int]) -> bool:
    """Whether polygons have no point within a photo of `size` (W, H); what is smaller than a pixel may lie within."""
    points = [part for polygon in outline for part in polygon] if isinstance(outline, list) else []
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    return not ((xy >= 0) & (xy <= size)).all(axis=1).any()


def _strays(file: Path) -> list[Problem]:
    """A warning of annotations that belong to no photo: whoever finds those objects would be told to be wrong."""
    count = coco_strays(file)
    if not count:
        return []
    found = f"{count} annotation{'s' * (count > 1)}"
    fix = "give each the image_id of a photo"
    return [Problem(Place(str(file)), "", found, "of no photo in it: passed over", fix, Severity.WARNING)]


def _named(found: list[Pair], folder: Path) -> list[Pair]:
    """The pairs by name: a photo's way from the folder, or its own folder's where that holds one photo."""
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
