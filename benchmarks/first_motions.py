"""`physgen clip` on COCO's photos: how many of them move, and how the clips end.

    PHYSGEN_MATERIAL=DIR python benchmarks/run.py motions      # DIR/coco, DIR/material

With `PHYSGEN_BASELINE`, the code of another checkout is measured beside this one.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from subprocess import run
from typing import Any

import cv2
import numpy as np
from layout import prose, table
from perceiving import BASELINE
from strangers import LEAST_PATH, LEAST_TIME, ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]
LIVING = {
    *("person", "dog", "cat", "horse", "sheep", "cow", "elephant", "bear", "zebra"),
    *("giraffe", "bird"),
}
FIXED = {
    *("train", "bed", "couch", "dining table", "toilet", "chair", "refrigerator"),
    *("oven", "sink", "tv", "stop sign", "fire hydrant", "parking meter"),
    *("traffic light", "kite", "boat", "airplane"),
}
"""Classes that stand still in a clip: fixed, floating or flying."""
WHOLE_AREAS = (0.02, 0.6)
"""Area of a movable object away from the border, by the photo's."""


def first_motions(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each photo and checkout."""
    checkouts = {"now": str(ROOT)}
    if baseline := os.environ.get(BASELINE):
        checkouts["before"] = baseline
    photos = list(find_photos(Path(os.environ["PHYSGEN_MATERIAL"])))
    rows = []
    for code, checkout in checkouts.items():
        out = folder / code
        out.mkdir()
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for row in pool.map(partial(_measure, out, checkout), photos):
                rows.append({"code": code} | row)
                print(rows[-1], file=sys.stderr, flush=True)
    return rows


def find_photos(material: Path) -> Iterator[Path]:
    """Yield photos with a whole movable object and hardly any people or animals."""
    minis = material / "material/coco-minis"
    sets = (
        (material / "coco", material / "coco", material / "coco/labels.json"),
        (minis / "images", minis / "masks", minis / "labels.json"),
    )
    for photos, masks, labels_file in sets:
        names = json.loads(labels_file.read_text())
        for name, classes in sorted(names.get("labels", names).items()):
            labels = cv2.imread(str(masks / f"{name}.png"), cv2.IMREAD_UNCHANGED)
            if labels is not None and _suits(labels, classes):
                yield photos / f"{name}.jpg"


def _suits(labels: np.ndarray, classes: dict[str, str]) -> bool:
    """Check whether a photo with a label map (H, W) and its classes by id suits."""
    living_share = 0.0
    whole_count = 0
    for number, name in classes.items():
        mask = labels == int(number)
        if name in LIVING:
            living_share += float(mask.mean())
        if name in LIVING | FIXED:
            continue
        borders = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
        low, high = WHOLE_AREAS
        whole_count += not borders.any() and low < mask.mean() < high
    # Hardly any people or animals: at most 5 % of the photo.
    return whole_count > 0 and living_share <= 1 / 20


def _measure(folder: Path, checkout: str, photo: Path) -> dict[str, Any]:
    """Return the measures of a photo's clip, or that there is no clip."""
    command = [sys.executable, str(ROOT / "benchmarks/strangers.py"), "--photo"]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": checkout}
    done = run(
        [*command, str(photo), str(folder)],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
    )
    if done.returncode:
        return {"photo": photo.stem, "end": "no clip"}
    row = json.loads(done.stdout.splitlines()[-1])
    return {"photo": photo.stem, "end": _name_end(row), "cpu": row["cpu"]}


def _name_end(row: dict[str, Any]) -> str:
    """Return how a clip ends, in words."""
    if row["travel"] < LEAST_PATH:
        return "nothing moves visibly"
    if not row["inside"]:
        return "outside"
    if not row["rests"] or row["seconds"] < LEAST_TIME:
        return "moving, or too short"
    return "moves, and rests inside"


def motions_table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the lines of the table."""
    codes = sorted({row["code"] for row in rows})
    counts = {code: Counter(_ends(rows, code)) for code in codes}
    ends = sorted({row["end"] for row in rows})
    body = [[end, *(counts[code][end] for code in codes)] for end in ends]
    return [
        *prose(
            f"`physgen clip` on {len(_ends(rows, 'now'))} photos of COCO that show a",
            "whole movable object and hardly any people or animals: number of photos",
            "by the end of their clips. Many show streets and heaps, in which nothing",
            f"can be pushed. A visible path has {100 * LEAST_PATH:.0f} % of the longer",
            "side. `before`: the checkout that `PHYSGEN_BASELINE` names. Most of these",
            "photos were looked at while the pushes of vehicles were changed.",
        ),
        "",
        *table(["end", *codes], body),
    ]


def _ends(rows: list[dict[str, Any]], code: str) -> list[str]:
    return [row["end"] for row in rows if row["code"] == code]
