"""Labels of clips whose motion is that of the studio's truth videos, against what the path tracer sees in them.

python benchmarks/label_truth.py                  # a table, of every scene that has a truth video
python benchmarks/label_truth.py curling shelf
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physgen.evaluate.fidelity import TRUTH, Truth, read_ids, replay, truths
from physgen.export.flow import VISIBLE
from physgen.photos import read_image
from physgen.pipeline.clip_labels import Labels
from physgen.pipeline.film import Film
from physgen.pipeline.stages import Keep, Stages
from physgen.progress import silent
from physgen.report.record import RunRecord

Ids = NDArray[np.uint16]
Mask = NDArray[np.bool_]
MOVES = 0.5
"""px from frame to frame."""


@dataclass(frozen=True)
class Row:
    """One truth video; shares 0..1, medians and means of all its frames."""

    scene: str
    frames: int
    differ: float
    """Share of the pixels that show another thing."""
    beyond_1: float
    """Of all pixels, farther than 1 px from where the path tracer sees a border."""
    beyond_2: float
    """The same, 2 px."""
    overlap: float
    """Median intersection over union, of things and frames."""
    lands: float
    """Of pixels that move and are said to be seen in the next frame: the share whose flow ends on the same thing."""
    grey: float
    """Grey levels by which the next frame, warped by the flow, is off, in the mean of all pixels that are seen."""
    moved: float
    """The same of pixels that move."""
    unmoved: float
    """The same of these, not warped."""


def compared(truth: Truth, folder: Path) -> Row:
    """Of labels that are written into `folder`."""
    export(truth, folder)
    numbers = numbering(truth)
    count = len(truth.film["times_s"])
    ours = [
        owners(path) for path in sorted(folder.glob("davis/Annotations/*/*/*.png"))
    ][1:]
    seen = [
        numbers[read_ids(truth.folder / f"ids-{k:02}.png")] for k in range(1, count + 1)
    ]
    rgb = [read_image(truth.folder / f"{k:02}.webp") for k in range(1, count + 1)]
    wrong = [one != other for one, other in zip(ours, seen, strict=True)]
    near = [
        [differ & ~border(ids, px) for differ, ids in zip(wrong, seen, strict=True)]
        for px in (1, 2)
    ]
    landed, off, moved, unmoved = [], [], [], []
    for k in range(count - 1):
        flow = cv2.readOpticalFlow(str(folder / f"flo/forward/{k + 1:05d}.flo"))
        told = (
            cv2.imread(
                str(folder / f"flo/visible/forward/{k + 1:05d}.png"),
                cv2.IMREAD_UNCHANGED,
            )
            == VISIBLE
        )
        moves = told & (np.hypot(*np.moveaxis(flow, 2, 0)) > MOVES)
        apart = np.abs(warped(rgb[k + 1], flow).astype(int) - rgb[k]).mean(axis=2)
        off.append(apart[told].mean())
        inner = moves & ~border(ours[k], 3)  # borders mix what moves with what does not
        moved.append(apart[inner])
        unmoved.append(np.abs(rgb[k + 1].astype(int) - rgb[k]).mean(axis=2)[inner])
        landed.append((warped(seen[k + 1], flow, cv2.INTER_NEAREST) == seen[k])[moves])
    overlaps = [
        np.count_nonzero((one == k) & (other == k))
        / np.count_nonzero((one == k) | (other == k))
        for one, other in zip(ours, seen, strict=True)
        for k in np.unique(other[other > 0])
    ]
    means = (np.concatenate(part).mean() for part in (moved, unmoved))
    return Row(
        truth.name,
        count,
        float(np.mean(wrong)),
        *(float(np.mean(part)) for part in near),
        float(np.median(overlaps)),
        float(np.concatenate(landed).mean()),
        float(np.mean(off)),
        *map(float, means),
    )


def export(truth: Truth, folder: Path) -> None:
    """Masks and flow of the scene, moved as in the truth video; frame 0 is t = 0."""
    record, warm = RunRecord(scene=truth.name, command=[]), Stages(Keep.NOTHING)
    maps = warm.maps(truth.scene)
    compiled = warm.compile(truth.scene, maps)
    labels = Labels.for_clip(("davis", "flo"), truth.scene, maps.percepts)
    filming = Film(truth.scene, compiled, maps, record, warm)
    labels.of_frames(filming, replay(truth, compiled), folder, record, silent)


def numbering(truth: Truth) -> Ids:
    """(256,): an id of the path tracer's -> that of labels; what the scene has not is background."""
    told = json.loads((truth.folder.parent / "truth.json").read_text())
    names = [item.name for item in truth.scene.objects]
    found = np.zeros(256, np.uint16)
    for entry in told["objects"]:
        if entry["name"] in names:
            found[entry["id"]] = names.index(entry["name"]) + 1
    return found


def owners(path: Path) -> Ids:
    """(H, W)."""
    return np.asarray(Image.open(path), np.uint16)


def border(ids: Ids, px: int) -> Mask:
    """(H, W): within so many px there are two things."""
    kernel = np.ones((2 * px + 1, 2 * px + 1), np.uint8)
    return np.asarray(cv2.erode(ids, kernel) != cv2.dilate(ids, kernel))


def warped(
    picture: NDArray[np.generic], flow: NDArray[np.float32], how: int = cv2.INTER_CUBIC
) -> NDArray[np.generic]:
    """What `picture` shows at the places that pixels have moved to."""
    y, x = np.indices(flow.shape[:2], np.float32)
    return cv2.remap(
        picture,
        x + flow[..., 0],
        y + flow[..., 1],
        how,
        borderMode=cv2.BORDER_REPLICATE,
    )


def table(rows: Sequence[Row]) -> str:
    """Markdown."""
    lines = [
        "| " + " | ".join(field.name for field in fields(Row)) + " |",
        "|" + "---|" * len(fields(Row)),
    ]
    for row in rows:
        shares = [
            f"{100 * part:.3f} %" for part in (row.differ, row.beyond_1, row.beyond_2)
        ]
        levels = [f"{part:.2f}" for part in (row.grey, row.moved, row.unmoved)]
        cells = [
            row.scene,
            str(row.frames),
            *shares,
            f"{row.overlap:.3f}",
            f"{100 * row.lands:.2f} %",
            *levels,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    made = []
    for film in truths(TRUTH, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as home:
            made.append(compared(film, Path(home)))
    print(table(made))
