"""Right told from wrong by `evaluate plausibility`, on seeds that no threshold was chosen on, and our own scenes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from physgen.evaluate.plausibility.judge import judge
from physgen.evaluate.plausibility.proof.confusion import counted
from physgen.evaluate.plausibility.proof.trial import HELD_OUT, trial
from physgen.evaluate.plausibility.reading.clips import from_scene
from physgen.scene.build import written

ROOT = Path(__file__).resolve().parent.parent
SEEDS = 24


def plausibility(folder: Path) -> list[dict]:
    """What was said of the clips of the proof, and of each bundled scene and variant."""
    said = trial(range(HELD_OUT, HELD_OUT + SEEDS), os.cpu_count() or 1)
    rows = [{key: value for key, value in row.items() if key != "scores"} for row in counted(said)]
    return [*rows, *scenes()]


def scenes() -> list[dict]:
    """Bundled scenes with their variants, and the first draws of the physics scorecard."""
    rows = []
    for path, variant in _all():
        verdict = judge(from_scene(path, variant=variant))
        row = {
            "scene": str(path.relative_to(ROOT)),
            "variant": variant,
            "score": verdict.overall,
            "asked": {},
        }
        row["asked"] = {
            name: len(asked.evidence) for name, asked in verdict.answers.items() if asked.evidence
        }
        row["faults"] = [f"{name}: {evidence.text}" for name, evidence in verdict.faults()[:3]]
        rows.append(row | {"score": None if row["score"] is None else round(row["score"], 4)})
    return rows


def _all() -> Iterator[tuple[Path, str | None]]:
    for path in sorted((ROOT / "scenes").glob("*/*.yaml")):
        yield path, None
        for variant in written(path).get("variants") or {}:
            yield path, variant
