"""A models run measured where weights are: seconds of each step, first photo and later ones, objects against truth.

    python benchmarks/models.py --profile models          # the studio's photos, and peers' with PHYSGEN_PEER_SCENES
    python benchmarks/models.py --backend segment=grounding-dino+sam kitchen cups --out results.json

Takes the flags of `perceive` that say who does what. Photos come in turn to one crew that keeps its models, as in
`physgen perceive A B C -o DIR`. Truth is used to judge the objects found, never told. Prints a table, and the raw
figures with --out; nothing here is part of `run.py`, which needs no weights.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from percepts import photos

from physgen.cli.arguments import Parser
from physgen.cli.perceive import add_backends
from physgen.perceive.perceive import perceive
from physgen.registry import Backends, load_plan

MODELS = {
    "segment",
    "categories",
    "label",
    "physics",
    "depth",
    "normals",
    "intrinsic",
    "inpaint",
}
"""Roles that a models run gives away; the rest is ours, and has half a second."""


def measure(crew: Backends, names: list[str]) -> list[dict]:
    """One row a photo."""
    rows = []
    for photo in photos(names or None):
        crew.begin()
        started = time.perf_counter()
        perceived = perceive(photo.rgb, backends=crew)
        seconds = time.perf_counter() - started
        steps: dict[str, float] = defaultdict(float)
        for step in crew.steps:
            steps[step.role] += step.seconds
        found = perceived.percepts.labels
        masks = [found == i for i in np.unique(found) if i]
        true = [photo.labels == i for i in np.unique(photo.labels) if i]
        hits = sum(any(overlap(mask, one) >= 0.5 for mask in masks) for one in true)
        right = sum(any(overlap(mask, one) >= 0.5 for one in true) for mask in masks)
        rows.append({
            "photo": photo.name, "seconds": seconds, "steps": dict(steps), "objects": len(masks),
            "precision": right / max(len(masks), 1), "recall": hits / max(len(true), 1),
            "ours": seconds - sum(s for role, s in steps.items() if role in MODELS and crew.row(role).extra),
            "record": crew.record(),
        })  # fmt: skip
        print(line(rows[-1]), flush=True)
    return rows


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def line(row: dict) -> str:
    """One row as text."""
    steps = "  ".join(
        f"{role} {seconds:.2f}"
        for role, seconds in row["steps"].items()
        if seconds >= 0.005
    )
    head = f"{row['photo']:<14} {row['seconds']:6.2f} s  P {row['precision']:.2f}  R {row['recall']:.2f}"
    return f"{head}  ours {row['ours']:.2f} s   {steps}"


def main() -> None:
    parser = Parser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="photos; default: all")
    parser.add_argument("--out", type=Path, help="raw figures as JSON")
    add_backends(parser)
    options = parser.parse_args()
    told = load_plan(options.backend, profile=options.profile, config=options.config)
    rows = measure(Backends(replace(told, keep=True)), options.names)
    if rows:
        mean = {
            key: float(np.mean([row[key] for row in rows]))
            for key in ("precision", "recall")
        }
        later = [row["seconds"] for row in rows[1:]] or [rows[0]["seconds"]]
        print(f"first photo {rows[0]['seconds']:.2f} s, later {np.median(later):.2f} s")
        print(
            f"precision {mean['precision']:.2f}, recall {mean['recall']:.2f} at IoU 0.5"
        )
    if options.out:
        options.out.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
