"""Import of COCO annotations: polygons and run-length masks of one photo."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.geometry.polygon import Region, Ring
from physgen.geometry.raster import coverage
from physgen.perceive.roles import Detections, Name
from physgen.problems import InputError, Place, Problem

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CocoImage:
    """One photo of a COCO file."""

    file: Path
    """Its name in the file, resolved beside the file."""
    annotations: tuple[Mapping[str, Any], ...]
    categories: Mapping[str, str]
    """By id, as text."""
    crowds: tuple[Mapping[str, Any], ...] = ()
    """Annotations of crowds: regions in which objects are not separated."""
    size: tuple[int, int] | None = None
    """W, H px, None where the file gives none."""

    def label(self, annotation: Mapping[str, Any]) -> str:
        """The name of its category; empty where it has none."""
        return self.categories.get(str(annotation.get("category_id")), "")


def coco_photos(path: Path) -> list[CocoImage]:
    """Every photo of a COCO file, in its order, those without objects too. Raises InputError: unreadable, no photos."""
    annotations, images, categories = _lists(path)
    if not images:
        fix = "give a COCO instances file with a list of images"
        raise InputError.of(str(path), "", "names no photos", fix)
    found = []
    for image in images:
        mine = [one for one in annotations if one.get("image_id") == image["id"]]
        objects, crowds = (
            tuple(a for a in mine if bool(a.get("iscrowd")) == crowd) for crowd in (False, True)
        )
        width, height = image.get("width"), image.get("height")
        size = (width, height) if isinstance(width, int) and isinstance(height, int) else None
        file = path.parent / str(image.get("file_name", ""))
        found.append(CocoImage(file, objects, categories, crowds, size))
    names = [one.file for one in found]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise InputError.of(str(path), f'"{twice[0].name}"', "is listed twice", "list each photo once")
    return found


def read_coco(path: Path, image: Path | None = None) -> CocoImage:
    """The photo called as `image`, or the only one. Raises InputError: unreadable, no such photo, nothing annotated."""
    photos = coco_photos(path)
    named = [photo for photo in photos if image is not None and photo.file.name == image.name]
    if not named and len(photos) > 1:
        wanted = f'"{image.name}"' if image is not None else f"{len(photos)} photos"
        known = ", ".join(photo.file.name for photo in photos[:5]) + (", ..." if len(photos) > 5 else "")
        expected = "is not among its photos" if image is not None else "are in it and none was named"
        raise InputError.of(str(path), wanted, expected, f"it has {known}")
    chosen = (named or photos)[0]
    if not chosen.annotations:
        fix = "annotate one, or take another photo"
        raise InputError.of(str(path), f'"{chosen.file.name}"', "has no annotated object", fix)
    return chosen


def _lists(path: Path) -> tuple[list[Mapping[str, Any]], list[Mapping[str, Any]], dict[str, str]]:
    """Annotations, images and categories' names of a COCO file. Raises InputError."""
    data = _read(path)
    if not isinstance(data, dict) or not isinstance(data.get("annotations"), list):
        raise InputError.of(str(path), "", "has no list of annotations", "give a COCO instances file")
    lists: list[list[Mapping[str, Any]]] = []
    for key in ("annotations", "images", "categories"):
        part = data.get(key)
        lists.append([one for one in part if isinstance(one, dict)] if isinstance(part, list) else [])
    annotations, images, categories = lists
    names = {str(one.get("id")): str(one.get("name", "")) for one in categories}
    return annotations, [one for one in images if "id" in one], names


def coco_objects(path: Path, coco: CocoImage, size: tuple[int, int]) -> Detections:
    """Label map and names of the objects on a photo of `size` (W, H); where masks overlap the smaller lies on top.

    COCO measures from the photo's corner, where pixel i covers i to i + 1; ours covers i - 0.5 to i + 0.5.
    """
    masks: list[tuple[int, NDArray[np.uint8], Name]] = []
    problems = []
    for number, annotation in enumerate(coco.annotations):
        try:
            mask = decode_segmentation(annotation.get("segmentation"), size)
        except ValueError as error:
            path_in = f"annotations[{number}].segmentation"
            known = annotation.get("id", number)
            problems.append(
                Problem(Place(str(path)), path_in, f"annotation {known}", str(error), "export it again")
            )
            continue
        label = coco.label(annotation)
        score = annotation.get("score", 1.0)
        sure = float(score) if isinstance(score, int | float) and 0 <= score <= 1 else 1.0
        masks.append((int(mask.sum()), np.packbits(mask), Name(label or "object", sure)))
    if problems:
        raise InputError(problems)
    labels = np.zeros((size[1], size[0]), np.uint16)
    for k in sorted(range(len(masks)), key=lambda k: -masks[k][0]):
        labels[np.unpackbits(masks[k][1], count=labels.size).reshape(labels.shape) > 0] = k + 1
    return Detections(
        labels, "coco", {k + 1: name.confidence for k, (_, _, name) in enumerate(masks)},
        {k + 1: name for k, (_, _, name) in enumerate(masks) if name.label != "object"},
    )  # fmt: skip


def decode_segmentation(segmentation: Any, size: tuple[int, int]) -> Mask:
    """The mask (H, W) of polygons, plain or compressed run lengths. Raises ValueError with the fault."""
    width, height = size
    if isinstance(segmentation, list):
        mask = np.zeros((height, width), bool)
        for polygon in segmentation:
            try:
                points = np.asarray(polygon, np.float64).reshape(-1, 2) - 0.5
            except (TypeError, ValueError):
                raise ValueError("is not a list of x, y pairs") from None
            if len(points) < 3 or not np.isfinite(points).all() or np.abs(points).max() > 1e6:
                raise ValueError("has a polygon of fewer than 3 points, or points at no finite place")
            mask |= coverage(Region((Ring(points),)), size) >= 0.5
        return mask
    if not isinstance(segmentation, dict) or "counts" not in segmentation:
        raise ValueError("is neither polygons nor run lengths")
    named = segmentation.get("size")
    if named != [height, width]:
        raise ValueError(f"is of size {named}, the photo is [{height}, {width}]")
    counts = segmentation["counts"]
    return run_lengths(uncompressed(counts) if isinstance(counts, str | bytes) else counts, size)


def run_lengths(counts: Sequence[Any], size: tuple[int, int]) -> Mask:
    """The mask (H, W) of run lengths down the columns, background first. Raises ValueError unless they fill it."""
    width, height = size
    if not isinstance(counts, list) or not all(
        isinstance(n, int) and 0 <= n <= width * height for n in counts
    ):
        raise ValueError("has run lengths that are not counts of pixels")
    if sum(counts) != width * height:
        raise ValueError(f"has run lengths of {sum(counts)} px in all, the photo has {width * height}")
    values = np.arange(len(counts)) % 2 == 1
    return np.ascontiguousarray(np.repeat(values, counts).reshape(width, height).T)


def uncompressed(text: str | bytes) -> list[int]:
    """COCO's compressed run lengths -> counts: 5 bits a character from "0" on, each count less the last but one.

    >>> uncompressed("626")
    [6, 2, 6]
    """
    codes = text.encode("ascii", "replace") if isinstance(text, str) else text
    counts: list[int] = []
    value = shift = 0
    for code in codes:
        bits = code - 48
        if not 0 <= bits < 64 or shift > 50:
            raise ValueError("has compressed run lengths that cannot be read")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        value = shift = 0
    if shift:
        raise ValueError("has compressed run lengths that end too early")
    return counts


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError.of(str(path), "", "no such file", "check the path") from None
    except (OSError, RecursionError, ValueError) as error:
        reason = str(error).partition("\n")[0][:80]
        raise InputError.of(str(path), "", f"is no JSON ({reason})", "give a COCO instances file") from None
