"""What the measures of properties, controllability and runtime find -> JSON, and parts of docs/benchmarks.md."""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from layout import prose, table
from studio_properties import ask_photos, with_studio

from physgen import pipeline
from physgen.environment import this_machine
from physgen.evaluate.controllability import findings as answered
from physgen.evaluate.controllability import sweep
from physgen.evaluate.measure import Findings, Progress
from physgen.evaluate.properties import MASS, ORDER, SHIPPED, Origin, ask, read_table
from physgen.evaluate.properties import findings as weighed
from physgen.evaluate.runtime import Run, Time, gpu, total
from physgen.evaluate.runtime import findings as timed
from physgen.registry import Backends
from physgen.report.record import TIMING

ROOT = Path(__file__).resolve().parent.parent
PUSHED = ("curling", "billiards", "shelf")
PHOTOS = ("billiards", "kitchen")
REPEAT = 3

SHOWN = {
    "properties": (MASS, ORDER, "Each object, the nearest first"),
    "controllability": ("Each direction",),
    "runtime": ("By the paper's parts", "Every stage"),
}
"""Sections of a page; the JSON's `found` has them all."""


def properties(folder: Path) -> list[dict]:
    """Answers of the material table, with the objects' sizes and without; and about objects on the studio's photos."""
    asked, backends = read_table(SHIPPED), Backends()
    rows = []
    for sized in (True, False):
        found = weighed(
            asked, ask(asked, backends, sized, _quiet), Origin("table", sized)
        )
        if sized:
            found = with_studio(
                found, ask_photos(ROOT / "studio" / "truth", backends, _quiet)
            )
        rows.append(kept(found, "properties", not sized))
    return rows


def controllability(folder: Path) -> list[dict]:
    """Three bundled scenes: stones that slide, a ball that rolls, a ball on books seen from the side."""
    rows = []
    for name in PUSHED:
        scene = pipeline.load(ROOT / "scenes" / name / "scene.yaml")
        rows.append(
            kept(answered(sweep(scene, None, 8, (), _quiet)), "controllability")
        )
        print(name, file=sys.stderr, flush=True)
    return rows


def runtime(folder: Path) -> list[dict]:
    """Two bundled photos, perceived and rendered."""
    runs = [
        run for name in PHOTOS for run in measure(_photo(name, folder), REPEAT, _quiet)
    ]
    return [kept(timed(runs, f"{this_machine()}, {gpu() or 'no GPU'}"), "runtime")]


class TimedBackends(Backends):
    """Backends that also record the CPU time of each role."""

    def __init__(self) -> None:
        super().__init__()
        self.cpu: list[float] = []

    def run(self, role: str, use: Callable[[Any], Any]) -> Any:
        """As `Backends.run`."""
        begun = time.process_time()
        try:
            return super().run(role, use)
        finally:
            self.cpu.append(time.process_time() - begun)


def measure(photo: Path, repeat: int, progress: Progress) -> list[Run]:
    """`repeat` runs made now, offline; the first includes imports."""
    runs = []
    for k in range(repeat):
        with TemporaryDirectory(prefix="physgen-runtime-") as folder:
            progress("perceive and render", k, repeat)
            stages = _timed_perceiving(photo, Path(folder) / "scene.yaml")
            clip = pipeline.render_scene(
                Path(folder) / "scene.yaml", Path(folder) / "out", cached=False
            )
            record = json.loads((clip / TIMING).read_text(encoding="utf-8"))
        stages |= {
            key: (one["wall"], one["cpu"]) for key, one in record["stages"].items()
        }
        runs.append(Run(f"{photo.stem} {k + 1}", stages, str(this_machine())))
    return runs


def _timed_perceiving(photo: Path, scene: Path) -> dict[str, Time]:
    backends = TimedBackends()
    begun = time.perf_counter(), time.process_time()
    pipeline.perceive(photo, scene, crew=backends)
    spent = time.perf_counter() - begun[0], time.process_time() - begun[1]
    stages: dict[str, Time] = {}
    for step, cpu in zip(backends.steps, backends.cpu, strict=True):
        stage = f"perceive {step.role}"
        stages[stage] = total([stages.get(stage, (0.0, 0.0)), (step.seconds, cpu)])
    known = total(list(stages.values()))
    stages["perceive files"] = (
        max(spent[0] - known[0], 0.0),
        max(spent[1] - known[1], 0.0),
    )
    return stages


def _photo(name: str, folder: Path) -> Path:
    """The photo under a name of its own."""
    link = folder / f"{name}.png"
    link.symlink_to(ROOT / "scenes" / name / "photo.png")
    return link


def _quiet(stage: str, done: int, total: int) -> None:
    pass


def kept(found: Findings, measure: str, brief: bool = False) -> dict:
    """Findings as data for the tables; `brief` leaves all but the first section out."""
    shown = [section for section in found.sections if section.title in SHOWN[measure]]
    sections = [
        {
            "title": section.title,
            "tables": [
                {
                    "heads": one.heads,
                    "rows": one.rows,
                    "title": one.title,
                    "note": one.note,
                }
                for one in section.tables
            ],
        }
        for section in (shown[:1] if brief else shown)
    ]
    return {
        "title": found.title,
        "sentences": found.sentences,
        "sections": sections,
        "found": found.as_dict(),
    }


def properties_table(rows: list[dict]) -> list[str]:
    """Masses, and the orders of friction and elasticity."""
    sized, named = rows
    lines = prose(
        "42 objects of the YCB set, their masses measured by others, and published orders of friction and elasticity;",
        "the material table (`physics=table`) is given each name with a silhouette to scale. No blind test: whoever",
        "wrote the table's rows knew what is asked. The paper asks GPT-4V about photos of 20 other objects.",
    )
    lines += ["", *_sentences(sized["sentences"][1:3]), ""]
    lines += [*_table(sized["sections"][0]), ""]
    return [*lines, *prose("Given the name alone:", named["sentences"][0])]


def controllability_table(rows: list[dict]) -> list[str]:
    """A row a scene."""
    body = []
    for found in (row["found"] for row in rows):
        free, side = found["meeting_nobody"], found["sideways"]
        body.append(
            [
                f"{found['object']} of {found['scene']}",
                f"{found['rising']} of {found['steps']}",
                f"{free['rising']} of {free['steps']}",
                f"{side['same']} of {side['of']}",
            ]
        )
    heads = [
        "object",
        "a harder push takes it farther",
        "where it meets no object",
        "goes to the side it is pushed to",
    ]
    return [
        "Pushed in eight directions and five sizes, as in figure 6 of the paper, which gives no number.",
        "",
        *table(heads, body),
    ]


def runtime_table(rows: list[dict]) -> list[str]:
    """Seconds of each part, beside the paper's."""
    row = rows[0]
    (part,) = row["sections"][0]["tables"]
    kept = [k for k, head in enumerate(part["heads"]) if head not in ("runs", "CPU")]
    heads = ["part", "wall, s", "least", "most", "the paper, A40, s"]
    sentences = (tenths(line) for line in row["sentences"][:4])
    body = [[tenths(line[k]) for k in kept] for line in part["rows"]]
    return [*prose(*sentences), "", *table(heads, body)]


def tenths(text: str) -> str:
    """Seconds with three places are written with one.

    >>> tenths("7.226 s of wall time (5.844 to 22.3)")
    '7.2 s of wall time (5.8 to 22.3)'
    """
    return re.sub(r"\d+\.\d{3}", lambda found: f"{float(found[0]):.1f}", text)


def _sentences(lines: Sequence[str]) -> list[str]:
    return [f"- {line}" for line in lines]


def _table(section: dict) -> list[str]:
    (part,) = section["tables"]
    return table(part["heads"], part["rows"])
