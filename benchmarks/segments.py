"""Objects found in photos without masks: by edges and network together, and by either alone."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from physgen import registry
from physgen.evaluate.segmentation import Pair, evaluate, pairs
from physgen.perceive.backends import label_imagenet
from physgen.perceive.roles import Rgb, Segments

ROOT = Path(__file__).resolve().parents[1]
PEERS = ("pool", "domino", "pig_ball", "boxes")


def photos() -> dict[str, list[Pair]]:
    """The sets: the studio's halves, homes made for validation, peers' photos where their folder is told."""
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
    if folder := os.environ.get("PHYSGEN_PEER_SCENES"):
        sets["peers"] = [
            Pair(Path(folder) / name / "original.png", Path(folder) / name / "mask.png", name=name)
            for name in PEERS
        ]
    return sets


def segmentation(folder: Path) -> list[dict]:
    """Rows a photo (`photo`) for both together, and a row a set (`photo` is "") for each way."""
    ways: dict[str, Callable[[Rgb], Segments]] = {"both": registry.make("segment", "learned")}
    rows = []
    for name, some in photos().items():
        for way, find in ways.items():
            before = process_time()
            found = evaluate(some, find)
            cpu = (process_time() - before) / len(some)
            if way == "both":
                rows += [{"set": name, "way": way, **row} for row in found.rows]
            total = {key: value for key, value in found.total.items() if key not in ("ap", "ap_by_iou")}
            rows.append({"set": name, "way": way, "photo": "", **total, "cpu": cpu})
    return rounded(rows)


def names(folder: Path) -> list[dict]:
    """Labels of the validation photos' true masks, by the shipped network and by ImageNet alone, and CPU seconds of 16
    objects; the last run's rows where PHYSGEN_MATERIAL names no photos."""
    if "PHYSGEN_MATERIAL" not in os.environ:
        rows: list[dict] = json.loads((ROOT / "benchmarks/results/names.json").read_text())["rows"]
        return rows
    sys.path.append(str(ROOT / "studio/segmentation"))
    from named import measure, seen  # type: ignore[import-not-found]

    found, heads = seen(True), label_imagenet.heads()
    alone = replace(heads, trust=1.0, own=0 * heads.own, shift=0 * heads.shift)
    rows = [{"by": way, **measure(head, found)} for way, head in (("ImageNet alone", alone), ("both", heads))]
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
