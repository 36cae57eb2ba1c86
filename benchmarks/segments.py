"""Objects found in photos without masks, and their names."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from time import process_time

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pycocotools import mask as coco

from physgen import registry
from physgen.evaluate.segmentation import (
    Pair,
    Photo,
    Scores,
    Truth,
    as_photo,
    evaluate,
    match,
    pairs,
)
from physgen.perceive.backends import label_imagenet
from physgen.perceive.roles import Rgb, Segments

ROOT = Path(__file__).resolve().parents[1]
PEERS = ("pool", "domino", "pig_ball", "boxes")


LEAST = 0.01
"""Of the photo: the smallest object of COCO that counts."""
UNJUDGED = 65535
"""Id in a label map where truth is unknown."""


def photos(folder: Path) -> dict[str, list[Pair]]:
    """The sets: the studio's halves, homes made for validation, peers' photos where PHYSGEN_PEER_SCENES names them, and
    household photos and COCO's validation photos where PHYSGEN_MATERIAL does; label maps are written to `folder`.

    Of COCO, movable objects of 1 % of the photo or more count. What is not labelled, and smaller objects, are not
    judged. People, animals and furniture are background: to find one is wrong.
    """
    split = json.loads((ROOT / "studio/split.json").read_text())
    sets = {
        half: [
            Pair(
                ROOT / "scenes" / name / "photo.png",
                ROOT / "scenes" / name / "photo.assets/masks.png",
                name=name,
            )
            for name in split[half]
        ]
        for half in ("tune", "test")
    }
    sets["homes"] = pairs(ROOT / "studio/segmentation/validation")[0]
    if peers := os.environ.get("PHYSGEN_PEER_SCENES"):
        sets["peers"] = [
            Pair(
                Path(peers) / name / "original.png",
                Path(peers) / name / "mask.png",
                name=name,
            )
            for name in PEERS
        ]
    if material := os.environ.get("PHYSGEN_MATERIAL"):
        household = sorted(
            path.parent for path in (Path(material) / "photos").glob("*/mask.png")
        )
        sets["household"] = [
            Pair(p / "original.png", p / "mask.png", name=p.name) for p in household
        ]
        sets["coco"] = list(_coco(folder))
    return sets


def _coco(folder: Path) -> Iterator[Pair]:
    """COCO's validation photos that hold objects that count.

    No network learned from them: neither the one that finds objects, whose validation
    photos are other ones, nor the detector and the head that cuts out.
    """
    sys.path.append(str(ROOT / "studio/segmentation"))
    from coco import photos as labelled  # type: ignore[import-not-found]
    from photo_split import is_coco_training  # type: ignore[import-not-found]
    from store import IMMOVABLE, UNSAID  # type: ignore[import-not-found]

    for name, rgb, coded in labelled(validation=True):
        if is_coco_training(name):
            continue
        area = np.bincount(coded.ravel(), minlength=256)
        labels = np.where(coded < IMMOVABLE, coded, 0).astype(np.uint16)
        labels[
            (coded == UNSAID) | ((labels > 0) & (area < LEAST * labels.size)[coded])
        ] = UNJUDGED
        if ((labels > 0) & (labels < UNJUDGED)).any():
            photo, truth = (
                folder / f"coco-{name}.png",
                folder / f"coco-{name}.labels.png",
            )
            cv2.imwrite(str(photo), rgb[..., ::-1])
            cv2.imwrite(str(truth), labels)
            yield Pair(photo, truth, name=f"coco-{name}")


OWN = ("tune", "test", "homes")
"""Sets of pictures that belong to the project and may be shown."""
WORST, TILE = 10, (240, 180)
"""So many pictures with the worst F, at most so wide and high, px."""
FOUND, TRUE = (0, 210, 255), (255, 190, 0)
"""sRGB of outlines."""
REAL = ("peers", "household", "coco")
"""Sets of real photos: their confidences are counted together."""
CONFIDENCES = (0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
"""Borders of the bins of the reliability table."""


def segmentation(folder: Path) -> list[dict]:
    """Rows a photo (`photo` is its name), a row a set (`photo` is ""), and a row a bin of confidence (`set` is
    "reliability")."""
    find = registry.make("segment", "learned")
    rows, real, sets = [], [], photos(folder)
    shown: list[tuple[float, NDArray[np.uint8]]] = []
    for name, some in sets.items():
        kept: list[Segments] = []

        def keep(rgb: Rgb, kept: list[Segments] = kept) -> Segments:
            kept.append(find(rgb))
            return kept[-1]

        before = process_time()
        found = evaluate(some, keep)
        cpu = (process_time() - before) / len(some)
        rows += [{"set": name, **row} for row in found.rows]
        rows.append({"set": name, "photo": "", **_total(found), "cpu": cpu})
        if name in OWN:
            rated = zip(found.rows, some, kept, strict=True)
            shown += [
                (row["f"], outlined(pair.read(), one)) for row, pair, one in rated
            ]
        if name in REAL:
            real += [
                as_photo(pair.name, pair.read(), one)
                for pair, one in zip(some, kept, strict=True)
            ]
    tiles = [tile for _, tile in sorted(shown, key=lambda one: one[0])[:WORST]]
    sheet = np.vstack([np.hstack(tiles[k : k + 5]) for k in range(0, WORST, 5)])
    Image.fromarray(sheet).save(ROOT / "docs/segmentation.webp", quality=75, method=6)
    rows += _reliability(real)
    if absent := {name for name in REAL if name not in sets}:  # their former rows stay
        before = json.loads(
            (ROOT / "benchmarks/results/segmentation.json").read_text()
        )["rows"]
        rows = [row for row in rows if row["set"] != "reliability"]
        rows += [row for row in before if row["set"] in absent | {"reliability"}]
    return rounded(rows)


def outlined(truth: Truth, segments: Segments) -> NDArray[np.uint8]:
    """The picture in a tile, outlines of true masks thick and those of what was found thin."""
    width, height = TILE
    scale = min(width / truth.rgb.shape[1], height / truth.rgb.shape[0])
    picture = cv2.resize(
        truth.rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
    )
    masks = [(coco.decode(one), TRUE, 2) for one in truth.masks]
    masks += [
        (segments.labels == k + 1, FOUND, 1) for k in range(len(segments.confidence))
    ]
    for mask, colour, width_ in masks:
        loops, _ = cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        scaled = [np.rint(loop * scale).astype(np.int32) for loop in loops]
        cv2.drawContours(picture, scaled, -1, colour, width_, cv2.LINE_AA)
    tile = np.full((height, width, 3), 255, np.uint8)
    tile[: picture.shape[0], : picture.shape[1]] = picture
    return tile


def _total(found: Scores) -> dict:
    return {
        key: value
        for key, value in found.total.items()
        if key not in ("ap", "ap_by_iou")
    }


def _reliability(real: list[Photo]) -> list[dict]:
    """How many detections are right, by the confidence that perception states."""
    judged = match(real).photos
    stated = np.concatenate([one.confidence for one in judged] or [np.zeros(0)])
    right = np.concatenate([one.is_match for one in judged] or [np.zeros(0, bool)])
    rows = []
    for low, high in pairwise(CONFIDENCES):
        inside = (stated >= low) & ((stated < high) | (high == 1.0))
        if inside.any():
            share, mean = float(right[inside].mean()), float(stated[inside].mean())
            row = {
                "from": low,
                "to": high,
                "found": int(inside.sum()),
                "stated": mean,
                "right": share,
            }
            rows.append({"set": "reliability", "photo": None, **row})
    return rows


def names(folder: Path) -> list[dict]:
    """Labels of the validation photos' true masks, by the shipped network and by ImageNet alone, and CPU seconds of 16
    objects; the last run's rows where PHYSGEN_MATERIAL names no photos."""
    if "PHYSGEN_MATERIAL" not in os.environ:
        rows: list[dict] = json.loads(
            (ROOT / "benchmarks/results/names.json").read_text()
        )["rows"]
        return rows
    sys.path.append(str(ROOT / "studio/segmentation"))
    from named import measure, seen  # type: ignore[import-not-found]

    found, heads = seen(True), label_imagenet.heads()
    alone = replace(
        heads, trust=1.0, regression=0 * heads.regression, shift=0 * heads.shift
    )
    rows = [
        {"by": "ImageNet alone", **measure(alone, found)},
        {"by": "with what is learned", **measure(heads, found)},
        {"by": "with the detector", **measure(heads, found, is_detected=True)},
    ]
    rgb, mask = np.zeros((512, 512, 3), np.uint8), np.zeros((512, 512), bool)
    mask[100:250, 100:250] = True
    before, wall = process_time(), time.perf_counter()
    for _ in range(16):
        heads.chances(label_imagenet.features(label_imagenet.crop(rgb, mask))[None])
    rows[-1] |= {"cpu": process_time() - before, "wall": time.perf_counter() - wall}
    return rounded(rows)


def rounded(value: object) -> object:
    """The same with numbers of three places."""
    if isinstance(value, float):
        return round(value, 3)
    if isinstance(value, dict):
        return {key: rounded(part) for key, part in value.items()}
    return [rounded(part) for part in value] if isinstance(value, list) else value
