"""COCO with tracks (as TAO and our own have it) -> tracks: centroids of masks, else middles of boxes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physgen.evaluate.plausibility.reading.asked import FPS, Asked, Row, from_rows, title
from physgen.evaluate.plausibility.reading.masks import SHAKE, disc_about
from physgen.evaluate.plausibility.tracks import Tracks
from physgen.perceive.import_coco import decode_segmentation
from physgen.problems import InputError

BOXES = 0.15
"""px that middles of boxes shake, at least."""
MOST_BYTES = 256 * 2**20
SEEN = 0.9
"""Share of a thing that must be seen, where its whole mask is not told."""


def from_coco(path: Path, asked: Asked) -> Iterator[Tracks]:
    """A clip a video. Raises InputError: unreadable, without tracks, of different sizes."""
    data = _data(path)
    images = {image["id"]: image for image in data["images"] if isinstance(image, dict) and "id" in image}
    names = {track["id"]: track.get("name") for track in data.get("tracks") or [] if isinstance(track, dict)}
    videos: dict[Any, list[Mapping[str, Any]]] = {}
    for one in data["annotations"]:
        if isinstance(one, dict) and one.get("track_id", one.get("instance_id")) is not None:
            videos.setdefault(images.get(one.get("image_id"), {}).get("video_id"), []).append(one)
    if not videos:
        raise InputError.of(str(path), "", "has no tracks", "give annotations a track_id")
    told = {video.get("id"): video for video in data.get("videos") or [] if isinstance(video, dict)}
    for video, mine in videos.items():
        own = [image for image in images.values() if image.get("video_id") == video]
        name = str(told.get(video, {}).get("name") or title(path))
        yield _clip(path, name, own, mine, names, told.get(video, {}), asked)


def _data(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError.of(
                str(path), f"{path.stat().st_size:,} bytes", "are too many", "split the file by video"
            )
        data = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise InputError.of(
            str(path), "", f"is no JSON that can be read: {error}", "export it again"
        ) from None
    lists = isinstance(data, dict) and all(
        isinstance(data.get(key), list) for key in ("images", "annotations")
    )
    if not lists:
        raise InputError.of(
            str(path), "", "has no lists of images and annotations", "give a COCO file with tracks"
        )
    return dict(data)


def _clip(
    path: Path,
    name: str,
    images: Sequence[Mapping[str, Any]],
    annotations: Sequence[Mapping[str, Any]],
    names: Mapping[Any, Any],
    video: Mapping[str, Any],
    asked: Asked,
) -> Tracks:
    sizes = {(image.get("width"), image.get("height")) for image in images}
    if len(sizes) > 1:
        found = " and ".join(f"{w} x {h}" for w, h in sorted(sizes, key=str)[:3])
        raise InputError.of(str(path), found, f"are sizes of frames of {name}", "give frames of one size")
    order = {image["id"]: int(image.get("frame_index", k)) for k, image in enumerate(images)}
    first = min(order.values(), default=0)
    frames, rows, masks = [], [], 0
    for one in annotations:
        track = one.get("track_id", one.get("instance_id"))
        row, masked = _row(path, str(names.get(track) or track), one, next(iter(sizes)))
        if row is not None and one.get("image_id") in order:
            masks += masked
            frames.append(order[one["image_id"]] - first)
            rows.append(row)
    fps = asked.fps or video.get("fps")
    said = "" if fps else ", 30 frames a second assumed"
    what, floor = ("centroids of masks", SHAKE) if masks == len(rows) else ("middles of boxes", BOXES)
    return from_rows(name, frames, rows, float(fps or FPS), floor, f"{what}, COCO{said}", asked)


def _row(path: Path, name: str, one: Mapping[str, Any], size: tuple[Any, Any]) -> tuple[Row | None, bool]:
    told = one.get("amodal_segmentation") or one.get("segmentation")
    whole = "amodal_segmentation" in one or one.get("visible_fraction", 1.0) >= SEEN
    if told and whole and one.get("truncation", 0.0) <= 1 - SEEN and None not in size:
        try:
            mask = decode_segmentation(told, (int(size[0]), int(size[1])))
        except (ValueError, TypeError) as error:
            raise InputError.of(
                str(path), f"annotation {one.get('id')}", str(error), "export it again"
            ) from None
        found = disc_about(mask)
        if found is not None:
            (x, y), core, reach, _ = found
            return Row(name, x, y, core=core, reach=reach), True
        return None, True
    box = one.get("bbox")
    if told or not isinstance(box, list) or len(box) != 4:
        return None, bool(told)
    left, top, width, height = map(float, box)
    middle = left + width / 2 - 0.5, top + height / 2 - 0.5
    return Row(name, *middle, core=min(width, height) / 2, reach=float(np.hypot(width, height)) / 2), False
