"""COCO JSON: masks as compressed run lengths, boxes and tracks (Lin et al., 2014)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen.export.labels import Clip, Moment, View
from physgen.export.masks import Box, Presence, compressed

CORNER = 0.5
"""px from COCO's origin, the corner of a picture, to ours, the first pixel's centre."""
DIGITS = 6
"""Behind the point of a share; those of an oriented box are CORNERS."""
CORNERS = 3


class Coco:
    """`annotations.json`, and `images/00000.jpg` ..., which it names."""

    def __init__(self, folder: Path, clip: Clip) -> None:
        self._folder, self._clip = folder, clip
        self._file = folder / "annotations.json"
        self._images: list[str] = []
        self._hidden: list[str] = []
        self._count = 0
        (folder / "images").mkdir()
        head = ",\n".join(
            f'"{key}": {_lines(map(json.dumps, values))}' for key, values in _of_clip(clip).items()
        )
        info = json.dumps({"description": clip.name, "contributor": "physgen"})
        self._file.write_text(f'{{\n"info": {info},\n{head},\n"annotations": [', encoding="utf-8")

    def add(self, moment: Moment) -> None:
        """What is seen goes to `annotations`; what is in the picture and hidden altogether, to a list of its own."""
        view = moment.view
        name = f"images/{view.index:05d}.jpg"
        (self._folder / name).write_bytes(view.jpeg)
        self._images.append(json.dumps(_image(self._clip, view, name)))
        seen = [thing for thing in view.presences if thing.seen_area]
        self._hidden += [
            json.dumps(_hidden(self._clip, view, thing)) for thing in view.presences if not thing.seen_area
        ]
        if seen:
            with self._file.open("a", encoding="utf-8") as file:
                for thing in seen:
                    self._count += 1
                    told = {"id": self._count, **_annotation(self._clip, view, thing)}
                    file.write(("," if self._count > 1 else "") + "\n" + json.dumps(told))

    def close(self) -> None:
        """The pictures, and what is hidden in them."""
        hidden, images = _lines(self._hidden), _lines(self._images)
        with self._file.open("a", encoding="utf-8") as file:
            file.write(f'\n],\n"hidden_annotations": {hidden},\n"images": {images}\n}}\n')


def _lines(told: Iterable[str]) -> str:
    """A list with a line for each."""
    lines = ",\n".join(told)
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
        # everything that is there is told of
        "videos": [video | {"neg_category_ids": [], "not_exhaustive_category_ids": []}],
        "tracks": [
            {"id": body + 1, "video_id": 1, "category_id": number, "name": name}
            for body, (name, number) in enumerate(zip(clip.names, clip.classes, strict=True))
        ],
    }


def _image(clip: Clip, view: View, name: str) -> dict[str, Any]:
    width, height = view.size
    told = {"id": view.index + 1, "file_name": name, "width": width, "height": height}
    return told | {"video_id": 1, "video": clip.name, "frame_index": view.index, "time": round(view.time, 9)}


def _annotation(clip: Clip, view: View, thing: Presence) -> dict[str, Any]:
    whole = _whole(clip, view, thing)
    hides = thing.seen_area < thing.whole_area
    return {
        **_track(clip, view, thing),
        "segmentation": _runs(thing.seen, thing.box, view) if hides else whole["amodal_segmentation"],
        "area": thing.seen_area,
        "bbox": list(thing.seen_box),
        "iscrowd": 0,
        **whole,
    }


def _hidden(clip: Clip, view: View, thing: Presence) -> dict[str, Any]:
    return _track(clip, view, thing) | _whole(clip, view, thing)


def _track(clip: Clip, view: View, thing: Presence) -> dict[str, Any]:
    track, number = thing.body + 1, clip.classes[thing.body]
    return {"image_id": view.index + 1, "video_id": 1, "track_id": track, "category_id": number}


def _whole(clip: Clip, view: View, thing: Presence) -> dict[str, Any]:
    """What holds whether or not something hides it."""
    told: dict[str, Any] = {
        "visible_fraction": round(thing.visible, DIGITS),
        "truncation": round(1 - clip.amodal(view, thing).inside, DIGITS),
        "amodal_segmentation": _runs(thing.whole, thing.box, view),
        "amodal_area": thing.whole_area,
        "amodal_bbox": list(thing.box),
    }
    extent = clip.extents[thing.body]
    if extent is not None:
        corners = extent.corners_at(view.poses[thing.body], view.lens) + CORNER
        told["oriented_bbox"] = [round(value, CORNERS) for value in corners.ravel().tolist()]
    return told


def _runs(mask: NDArray[np.bool_], box: Box, view: View) -> dict[str, Any]:
    width, height = view.size
    return {"size": [height, width], "counts": compressed(mask, box, view.size)}
