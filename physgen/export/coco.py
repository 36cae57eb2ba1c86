"""COCO JSON: masks as compressed run lengths, boxes and tracks (Lin et al., 2014;
tracks as in TAO).

x and y count from the picture's corner: pixel i covers i to i + 1. Annotations are
written frame by frame. Rows about frames and hidden objects follow at the end.
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
    """Writes `annotations.json` and its pictures `images/00000.jpg` ..."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        super().__init__(folder, clip)
        self._path = folder / "annotations.json"
        self._images: list[str] = []
        self._hidden: list[str] = []
        self._count = 0
        (folder / "images").mkdir()
        info = json.dumps({"description": clip.name, "contributor": "physgen"})
        parts = [f'"info": {info}']
        for key, rows in _clip_rows(clip).items():
            parts.append(f'"{key}": {_format_rows(map(json.dumps, rows))}')
        # The list stays open: annotations are appended frame by frame, so that memory
        # stays small.
        head = ",\n".join([*parts, '"annotations": ['])
        self._path.write_text("{\n" + head, encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """Write visible objects to `annotations`. Completely hidden ones go to their
        own list.
        """
        view, clip = moment.view, self._clip
        name = f"images/{view.index:05d}.jpg"
        (self._folder / name).write_bytes(view.jpeg)
        width, height = view.size
        # Ids of COCO begin at 1, frames at 0.
        image = {
            "id": view.index + 1,
            "file_name": name,
            "width": width,
            "height": height,
            "video_id": 1,
            "video": clip.name,
            "frame_index": view.index,
            "time": round(view.time, 9),
        }
        self._images.append(json.dumps(image))
        with self._path.open("a", encoding="utf-8") as file:
            for presence in view.presences:
                row = _annotation(clip, view, presence)
                # COCO's tools cannot read annotations without pixels.
                if not presence.visible_area:
                    self._hidden.append(json.dumps(row))
                    continue
                self._count += 1
                separator = ""
                if self._count > 1:
                    separator = ","
                file.write(f"{separator}\n" + json.dumps({"id": self._count, **row}))

    def close(self) -> None:
        """Write the frames and the hidden objects."""
        hidden = _format_rows(self._hidden)
        images = _format_rows(self._images)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(
                f'\n],\n"hidden_annotations": {hidden},\n"images": {images}\n}}\n'
            )


def _format_rows(rows: Iterable[str]) -> str:
    """Return a list with one row per line."""
    lines = ",\n".join(rows)
    if lines:
        return f"[\n{lines}\n]"
    return "[]"


def _clip_rows(clip: Clip) -> dict[str, Sequence[dict[str, Any]]]:
    """Return the lists about a clip."""
    width, height = clip.size
    video = {
        "id": 1,
        "name": clip.name,
        "width": width,
        "height": height,
        "length": clip.count,
        "fps": clip.fps,
        # Empty lists: all objects of all categories are annotated.
        "neg_category_ids": [],
        "not_exhaustive_category_ids": [],
    }
    categories = []
    for number, name in enumerate(clip.categories, 1):
        categories.append({"id": number, "name": name, "supercategory": "object"})
    # A track is one object through the whole clip (the extension of TAO), also while it
    # is hidden.
    tracks = []
    names_and_classes = zip(clip.names, clip.classes, strict=True)
    for track, (name, category) in enumerate(names_and_classes, 1):
        row = {"id": track, "video_id": 1, "category_id": category, "name": name}
        tracks.append(row)
    return {
        "licenses": [],
        "categories": categories,
        "videos": [video],
        "tracks": tracks,
    }


def _annotation(clip: Clip, view: View, presence: Presence) -> dict[str, Any]:
    """Return the row of one object in a frame."""
    body = presence.body
    whole_runs = _run_lengths(presence.whole_mask, presence.box, view)
    row: dict[str, Any] = {
        "image_id": view.index + 1,
        "video_id": 1,
        "track_id": body + 1,
        "category_id": clip.classes[body],
    }
    if presence.visible_area:
        runs = whole_runs
        # Most objects are fully visible, and one encoding is enough.
        if presence.visible_area < presence.whole_area:
            runs = _run_lengths(presence.visible_mask, presence.box, view)
        row["segmentation"] = runs
        row["area"] = presence.visible_area
        row["bbox"] = list(presence.visible_box)
        row["iscrowd"] = 0
    row["visible_fraction"] = round(presence.visible_share, SHARE_DIGITS)
    row["amodal_segmentation"] = whole_runs
    row["amodal_area"] = presence.whole_area
    row["amodal_bbox"] = list(presence.box)
    return row


def _run_lengths(mask: NDArray[np.bool_], box: Box, view: View) -> dict[str, Any]:
    """Return the run lengths of a mask (h, w) on a box of a view."""
    from pycocotools import mask as coco

    (width, height), (x, y, w, h) = view.size, box
    # pycocotools needs columns in memory order.
    picture = np.zeros((height, width), np.uint8, order="F")
    picture[y : y + h, x : x + w] = mask
    return {
        "size": [height, width],
        "counts": str(coco.encode(picture)["counts"], "ascii"),
    }
