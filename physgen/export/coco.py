"""COCO JSON: masks as compressed run lengths, boxes and tracks (Lin et al., 2014; tracks as in TAO).

x and y count from the picture's corner: pixel i covers i to i + 1. Annotations are written frame by frame; only rows
about frames, and hidden objects, wait for the end.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Box, Clip, Moment, Presence, View, Writer

SHARE_DIGITS = 6
"""Decimals of shares."""


class Coco(Writer):
    """`annotations.json`, and `images/00000.jpg` ..., which it names."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        self._file = folder / "annotations.json"
        self._images: list[str] = []
        self._hidden: list[str] = []
        self._count = 0
        (folder / "images").mkdir()
        head = ",\n".join(
            f'"{key}": {_lines(map(json.dumps, values))}'
            for key, values in _of_clip(clip).items()
        )
        info = json.dumps({"description": clip.name, "contributor": "physgen"})
        self._file.write_text(
            f'{{\n"info": {info},\n{head},\n"annotations": [', encoding="utf-8"
        )

    def add(self, moment: Moment) -> None:
        """Visible objects go to `annotations`, those that are hidden completely to a list of their own."""
        view, clip = moment.view, self._clip
        name = f"images/{view.index:05d}.jpg"
        (self._folder / name).write_bytes(view.jpeg)
        image = {
            "id": view.index + 1,
            "file_name": name,
            "width": view.size[0],
            "height": view.size[1],
        }
        image |= {
            "video_id": 1,
            "video": clip.name,
            "frame_index": view.index,
            "time": round(view.time, 9),
        }
        self._images.append(json.dumps(image))
        with self._file.open("a", encoding="utf-8") as file:
            for presence in view.presences:
                row = _annotation(clip, view, presence)
                if not presence.seen_area:
                    self._hidden.append(json.dumps(row))
                    continue
                self._count += 1
                file.write(
                    ("," if self._count > 1 else "")
                    + "\n"
                    + json.dumps({"id": self._count, **row})
                )

    def close(self) -> None:
        """The frames, and the hidden objects."""
        hidden, images = _lines(self._hidden), _lines(self._images)
        with self._file.open("a", encoding="utf-8") as file:
            file.write(
                f'\n],\n"hidden_annotations": {hidden},\n"images": {images}\n}}\n'
            )


def _lines(rows: Iterable[str]) -> str:
    """A list with one row a line."""
    lines = ",\n".join(rows)
    return f"[\n{lines}\n]" if lines else "[]"


def _of_clip(clip: Clip) -> dict[str, Sequence[dict[str, Any]]]:
    width, height = clip.size
    video = {
        "id": 1,
        "name": clip.name,
        "width": width,
        "height": height,
        "length": clip.count,
        "fps": clip.fps,
    }
    return {
        "licenses": [],
        "categories": [
            {"id": number, "name": name, "supercategory": "object"}
            for number, name in enumerate(clip.categories, 1)
        ],
        # all objects of all categories are annotated
        "videos": [video | {"neg_category_ids": [], "not_exhaustive_category_ids": []}],
        "tracks": [
            {"id": body + 1, "video_id": 1, "category_id": number, "name": name}
            for body, (name, number) in enumerate(
                zip(clip.names, clip.classes, strict=True)
            )
        ],
    }


def _annotation(clip: Clip, view: View, presence: Presence) -> dict[str, Any]:
    body = presence.body
    row: dict[str, Any] = {
        "image_id": view.index + 1,
        "video_id": 1,
        "track_id": body + 1,
    }
    row["category_id"] = clip.classes[body]
    whole = _run_lengths(presence.whole, presence.box, view)
    if presence.seen_area:
        partly = presence.seen_area < presence.whole_area
        row["segmentation"] = (
            _run_lengths(presence.seen, presence.box, view) if partly else whole
        )
        row |= {
            "area": presence.seen_area,
            "bbox": list(presence.seen_box),
            "iscrowd": 0,
        }
    row |= {
        "visible_fraction": round(presence.visible, SHARE_DIGITS),
        "amodal_segmentation": whole,
        "amodal_area": presence.whole_area,
        "amodal_bbox": list(presence.box),
    }
    return row


def _run_lengths(mask: NDArray[np.bool_], box: Box, view: View) -> dict[str, Any]:
    from pycocotools import mask as coco

    (width, height), (x, y, w, h) = view.size, box
    picture = np.zeros((height, width), np.uint8, order="F")
    picture[y : y + h, x : x + w] = mask
    return {
        "size": [height, width],
        "counts": str(coco.encode(picture)["counts"], "ascii"),
    }
