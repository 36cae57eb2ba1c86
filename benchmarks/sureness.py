"""How sure perception says it is, beside how far off it is: are the distributions of `render --fan` as wide as errors?

python benchmarks/sureness.py           # perceives the studio's photos, some minutes; writes results and docs/fan.md
python benchmarks/sureness.py --page    # docs/fan.md alone, from the results
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks/results/sureness.json"
PAGE = ROOT / "docs/fan.md"
MARKS = "<!-- figures: benchmarks/sureness.py -->", "<!-- end -->"
TOLD = ("names and the scale", "names", "nothing")
"""What perception is told of a photo beside its masks."""


def measure() -> dict:
    """Of every photo and what is told: masses by kind of object."""
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
                    source(one["from"]["mass"]).sure,
                    float(np.log(true[one["mask"]] / one["mass"])),
                )
                for one in document["objects"].values()
                if true.get(one["mask"])
            ]
            for (label, sure), group in groupby(sorted(rows), key=lambda row: row[:2]):
                off = float(np.mean([row[2] for row in group]))
                masses.append({"photo": photo.name, "half": photo.half, "told": told, "label": label, "sure": sure,
                               "log_true_by_said": round(off, 4)})  # fmt: skip
    return {"masses": masses}


def table(found: dict) -> str:
    """As docs/fan.md shows it: errors in standard deviations of what is drawn."""
    from physgen.simulate.uncertain_values import spread

    lines = [
        "| mass, given | half | kinds of objects | error, standard deviations | within 1 (68 %) | within 2 (95 %) |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for told in TOLD:
        for half in ("tune", "test"):
            rows = [row for row in found["masses"] if (row["told"], row["half"]) == (told, half)]
            z = np.array([row["log_true_by_said"] / spread("mass", 1.0, row["sure"]).sigma for row in rows])
            lines.append(f"| {told} | {half} | {len(z)} | {_rms(z):.2f} | {_part(z, 1)} | {_part(z, 2)} |")
    lines += [
        "",
        "| number of the table | sources with a range | half of it | drawn at 0.4 |",
        "| --- | ---: | ---: | ---: |",
        *ranges(),
    ]
    return "\n".join(lines)


def ranges() -> Iterator[str]:
    """What sources of the material table give as a range, beside how widely a thing of that material is drawn."""
    from physgen.materials import materials
    from physgen.simulate.uncertain_values import spread

    for key, words in (("friction", "a factor of"), ("rolling", "a factor of")):
        halves = []
        for one in materials():
            said = re.search(rf"{key}: [^;]*?([\d.]+)(?: \(\w+\))? to ([\d.]+)", one.surface)
            if said:
                halves.append(np.log(float(said[2]) / float(said[1])) / 2)
        drawn = np.exp(spread(key, 0.01, 0.4).sigma)
        yield f"| {key} | {len(halves)} | {words} {np.exp(_rms(halves)):.2f} | {words} {drawn:.2f} |"


def _rms(values: Iterable[float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(values)))))


def _part(z: np.ndarray, most: float) -> str:
    return f"{100 * np.mean(np.abs(z) <= most):.0f} %"


def page(text: str, found: dict) -> str:
    """The page with the tables that the results give."""
    before, _, rest = text.partition(MARKS[0])
    _, _, after = rest.partition(MARKS[1])
    return f"{before}{MARKS[0]}\n\n{table(found)}\n\n{MARKS[1]}{after}"


if __name__ == "__main__":
    if "--page" not in sys.argv:
        RESULT.write_text(json.dumps(measure(), indent=1) + "\n")
    PAGE.write_text(page(PAGE.read_text(), json.loads(RESULT.read_text())))
