"""What `evaluate properties`, `controllability` and `runtime` find -> kept as JSON, and pages of the docs from it."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from studio_properties import ask_photos, with_studio

from physgen import pipeline
from physgen.batch.clips import MANIFEST
from physgen.environment import gpu, this_machine
from physgen.evaluate.controllability import findings as answered
from physgen.evaluate.controllability import sweep
from physgen.evaluate.measure import Findings, Progress, Section, Table, markdown
from physgen.evaluate.properties import MASS, ORDER, SHIPPED, Asked, ask, read_table
from physgen.evaluate.properties import findings as weighed
from physgen.evaluate.runtime import Run, Time, total
from physgen.evaluate.runtime import findings as timed
from physgen.registry import Backends

ROOT = Path(__file__).resolve().parent.parent
PUSHED = ("curling", "billiards", "shelf")
PHOTOS = ("billiards", "kitchen")
REPEAT = 3

ABOUT = {
    "properties": """\
Written by `python benchmarks/run.py properties` from `benchmarks/results/properties.json`; do not edit.

    physgen evaluate properties                                        # 42 objects, and published comparisons
    physgen evaluate properties --backend physics=vlm -o out/vlm       # where a model is configured; see models.md
    physgen evaluate properties mine.yaml                              # a table of your own

The paper asks GPT-4V for mass, friction and elasticity and compares (appendix): masses of 20 objects, the order of 13
pairs by friction and of 7 by elasticity. Here it is whoever fills the role `physics`: the material table below.

**The objects** (`physgen/evaluate/objects.yaml`) were weighed and measured by others, the authors of the YCB
set, and compared by others: cargo standards, a textbook, a collection of drops. `physgen/materials.yaml`, which
the backend `table` reads, has no number from there. **It is no blind test any more**: once 12 of the 42 masses came out
to within 30 %, kinds that the table lacked got rows (cans of tuna, meat, coffee and crisps; boxes of crackers, sugar
and
powder; racquetballs), copies of fruit in plastic became hollow, and outlines that cover more of their box than
such objects do count as coarse. The numbers are net weights, bulk densities and rules as the rows name them, but
whoever wrote
them knew what is asked and what the answers are. Less independent, too: weights
that rules fix (the line without them says how much they help), and the studio's photos, whose masses,
frictions and elasticities were set by this project.

**What is asked.** A photo shows two dimensions, and its scale makes metres of them. A table has no photo, so a bare
silhouette stands for it: a ball's disc, the rectangle of what is turned on a lathe, the two longest sides of a box, at
a known scale. The third dimension is not given, as a photo would not give it; waists, handles and holes are not
given either, and a photo would show them. The material table knows ordinary objects besides.
`--hide-size` gives the name alone. A model's answers are cached, so a
second run asks nothing.

**A table** is YAML, as the one that ships:

    objects:
      soup:  {label: can of tomato soup, form: turned, size: [101, 66], mass: 349}
      crate: {label: wooden crate, form: box, size: [600, 400, 300]}
    rankings:
      friction:
        - {about: on wood, source: my own, values: {soup: 0.3, crate: 0.4}}

Sizes in mm: a ball's diameter; height and diameter of what is `turned`; three sides of a `box`. Mass in g. Of
friction and elasticity only the order counts, each ranking within itself.
""",
    "controllability": """\
Written by `python benchmarks/run.py controllability` from `benchmarks/results/controllability.json`; do not edit.

    physgen evaluate controllability scenes/curling/scene.yaml -o out/controllability
    physgen evaluate controllability scene.yaml --object ball --angles 12 --sizes 50,100,200

The paper varies the direction and size of the initial force and shows what comes of it (figure 6). Here one object is
pushed by an impulse at t = 0 through its centre of mass (the paper's F0), in so many directions and sizes; its own
velocity and forces are taken away, all else stays as the scene has it. A push counts in px/s, the speed that it gives.
The answer is where the object is at the end, from where it is without a push.

- **Harder, farther**: from a push to the next harder one of its direction, does it end farther away? With Spearman's
  rank correlation over each direction.
- **Off the push**: the angle between push and answer, until it meets an object.
- **Without a push**: how far it moves. A scene at rest stays at rest.

That sliding and rolling are as far as closed forms say is measured in [physics.md](physics.md).

Seen from the side, directions go from right over up to left: down is the ground. What is pushed up comes down again, so
that only its way to the side stays: there it is counted whether that is the side it was pushed to.
""",
    "runtime": """\
Written by `python benchmarks/run.py runtime` from `benchmarks/results/runtime.json`; do not edit.

    physgen evaluate runtime out/                # records of clips: what render, sweep and refine left in manifest.json

Every clip's `manifest.json` has wall and CPU seconds of each stage and names the machine: processor, cores, memory;
`device` names the GPU where one drew. Perceiving with models leaves its times in `perceived.json` among a scene's
assets, and they are read with the clip's. Clips of different machines are never mixed. The first of the runs below
also pays for what is imported once. Other work ran on the machine meanwhile: wall times show it, CPU times hardly.
""",
}  # fmt: skip
SHOWN = {
    "properties": (MASS, ORDER, "Each object, the nearest first"),
    "controllability": ("Each direction",),
    "runtime": ("By the paper's parts", "Every stage"),
}
"""Sections of a page; the JSON's `found` has them all."""


def properties(folder: Path) -> list[dict]:
    """Answers of the material table, with the objects' sizes and without; and about objects on the studio's photos."""
    table, backends = read_table(SHIPPED), Backends()
    rows = []
    for sized in (True, False):
        found = weighed(table, ask(table, backends, sized, _quiet), Asked("table", sized))
        if sized:
            found = with_studio(found, ask_photos(ROOT / "studio" / "truth", backends, _quiet))
        rows.append(kept(found, "properties", not sized))
    return rows


def controllability(folder: Path) -> list[dict]:
    """Three bundled scenes: stones that slide, a ball that rolls, a ball on books seen from the side."""
    rows = []
    for name in PUSHED:
        scene = pipeline.load(ROOT / "scenes" / name / "scene.yaml")
        rows.append(kept(answered(sweep(scene, None, 8, (), _quiet)), "controllability"))
        print(name, file=sys.stderr, flush=True)
    return rows


def runtime(folder: Path) -> list[dict]:
    """Two bundled photos, perceived and rendered."""
    runs = [run for name in PHOTOS for run in measure(_photo(name, folder), REPEAT, _quiet)]
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
            clip = pipeline.render_scene(Path(folder) / "scene.yaml", Path(folder) / "out", cached=False)
            record = json.loads((clip / MANIFEST).read_text(encoding="utf-8"))
        stages |= {key: (one["wall"], one["cpu"]) for key, one in record["stages"].items()}
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
    stages["perceive files"] = max(spent[0] - known[0], 0.0), max(spent[1] - known[1], 0.0)
    return stages


def _photo(name: str, folder: Path) -> Path:
    """The photo under a name of its own."""
    link = folder / f"{name}.png"
    link.symlink_to(ROOT / "scenes" / name / "photo.png")
    return link


def _quiet(stage: str, done: int, total: int) -> None:
    pass


def kept(found: Findings, measure: str, brief: bool = False) -> dict:
    """Findings as data from which `page` makes them again; `brief` leaves all but the first section out."""
    shown = [section for section in found.sections if section.title in SHOWN[measure]]
    sections = [
        {
            "title": section.title,
            "tables": [
                {"heads": part.heads, "rows": part.rows, "title": part.title, "note": part.note}
                for part in section.parts
                if isinstance(part, Table)
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


def page(measure: str) -> str:
    """docs/<measure>.md, from the JSON that is kept."""
    path = Path(__file__).resolve().parent / "results" / f"{measure}.json"
    result = json.loads(path.read_text())
    first, *rest = result["rows"]
    parts = [_body(one, measure) for one in (first, *rest)]
    title = {"properties": "Mass, friction and elasticity", "runtime": "Runtime"}.get(
        measure, "Controllability"
    )
    machine = [] if measure == "runtime" else [f"Measured on {result['machine']}."]
    return "\n".join([f"# {title}", "", ABOUT[measure], *parts, *machine]).rstrip() + "\n"


def _body(row: dict, measure: str) -> str:
    sections = tuple(
        Section(one["title"], (), tuple(_table(part) for part in one["tables"])) for one in row["sections"]
    )
    title = row["title"]
    if measure == "properties":
        title = "With the size" if row["found"]["size_told"] else "With the name alone"
    found = Findings(measure, title, tuple(row["sentences"]), sections, ())
    text = markdown(found)
    return text.replace("\n## ", "\n### ").replace("# ", "## ", 1)


def _table(part: dict) -> Table:
    rows: Sequence[Sequence[str]] = part["rows"]
    return Table(tuple(part["heads"]), tuple(map(tuple, rows)), part["title"], part["note"])
