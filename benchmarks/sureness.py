"""The confidence that perception states, beside its errors: is what `render --fan` draws as wide?"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np
from layout import prose, table

TOLD = ("names and the scale", "names", "nothing")
"""What perception is told of a photo beside its masks."""


def sureness(folder: Path) -> list[dict]:
    """Of every photo and what is given: masses by kind of object."""
    from percepts import labels_of, photos

    from physgen.perceive.perceive import perceive
    from physgen.perceive.segment.prompts import from_masks
    from physgen.scene.provenance import source

    masses = []
    for photo in photos():
        if photo.truth is None:
            continue
        true = {one["id"]: one.get("mass_g") for one in photo.truth["objects"]}
        for told in TOLD:
            extra = {} if told == "nothing" else {"renames": labels_of(photo)}
            if told == TOLD[0]:
                extra["pixels_per_meter"] = photo.truth["pixels_per_meter"]
            document = perceive(photo.rgb, from_masks(photo.labels), **extra).document
            print(photo.name, told, file=sys.stderr, flush=True)
            rows = [
                (
                    one["label"],
                    source(one["from"]["mass"]).confidence,
                    float(np.log(true[one["mask"]] / one["mass"])),
                )
                for one in document["objects"].values()
                if true.get(one["mask"])
            ]
            for (label, sure), group in groupby(sorted(rows), key=lambda row: row[:2]):
                off = float(np.mean([row[2] for row in group]))
                masses.append({"photo": photo.name, "half": photo.half, "told": told, "label": label, "sure": sure,
                               "log_true_by_said": round(off, 4)})  # fmt: skip
    return masses


def tables(masses: list[dict]) -> list[str]:
    """Errors in standard deviations of what is drawn."""
    from physgen.simulate.uncertain_values import spread

    body = []
    for told in TOLD:
        for half in ("tune", "test"):
            rows = [row for row in masses if (row["told"], row["half"]) == (told, half)]
            z = np.array(
                [
                    row["log_true_by_said"] / spread("mass", 1.0, row["sure"]).sigma
                    for row in rows
                ]
            )
            body.append(
                [told, half, len(z), f"{_rms(z):.2f}", _part(z, 1), _part(z, 2)]
            )
    return [
        *prose(
            "Errors of masses in standard deviations of the distributions that `render --fan` draws from. A kind is",
            "the objects of one label in a photo.",
        ),
        "",
        *table(
            ["given", "half", "kinds", "error", "within 1 (68 %)", "within 2 (95 %)"],
            body,
        ),
        "",
        *table(
            [
                "number of the material table",
                "sources with a range",
                "half of it, a factor of",
                "drawn at 0.4, a factor of",
            ],
            list(ranges()),
        ),
    ]


def ranges() -> Iterator[list[object]]:
    """What sources of the material table give as a range, beside how widely an object of that material is drawn."""
    from physgen.materials import materials
    from physgen.simulate.uncertain_values import spread

    for key in ("friction", "rolling"):
        halves = []
        for one in materials():
            said = re.search(
                rf"{key}: [^;]*?([\d.]+)(?: \(\w+\))? to ([\d.]+)", one.surface
            )
            if said:
                halves.append(np.log(float(said[2]) / float(said[1])) / 2)
        drawn = np.exp(spread(key, 0.01, 0.4).sigma)
        yield [key, len(halves), f"{np.exp(_rms(halves)):.2f}", f"{drawn:.2f}"]


def _rms(values: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(values)))))


def _part(z: np.ndarray, most: float) -> str:
    return f"{100 * np.mean(np.abs(z) <= most):.0f} %"
