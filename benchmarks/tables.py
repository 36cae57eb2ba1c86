"""benchmarks/results/*.json -> docs/benchmarks.md and its like; the material table -> docs/materials.md.

Tests fail when they differ.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import physics.page
import plausibility.page
from batch_tables import batch_table, kills_table
from growth import KINDS, exponent

from physgen.evaluate import fidelity
from physgen.evaluate.measure import Findings
from physgen.evaluate.measure import markdown as told
from physgen.materials import materials, nouns

RESULTS = Path(__file__).resolve().parent / "results"
STAGES = ("load", "compile", "simulate", "cut out", "render", "encode", "report")


ABOUT_MATERIALS = """\
# Materials and objects

Written by `python benchmarks/tables.py` from `physgen/materials.yaml`; do not edit.

A label names an object, a material or both: `billiard ball`, `steel ball`, `tin of tomatoes`. The object gives a
form, an ordinary size and mass; the material density, friction, elasticity and rolling. Mass is the volume that
outline and form imply at the photo's scale, times the density; where an object is about as large as the ordinary
one, the mean (geometric) with the ordinary mass; the ordinary mass alone where sizes hardly differ.

- A `ball` is as deep as it is wide. What is `turned` is cut into slices, each as deep as it is wide, and of
  each what lies alike on both sides of its axis, so that a handle is left out. Of a `slab`, `lump`, `disc` or
  `hoop` the two sides of the ordinary object that fit the outline best are seen, and the third is the depth.
- Another material: a steel ball is solid, a steel mug has thinner walls than one of ceramic, a plastic fork is
  a fork of plastic, a plastic apple is hollow. `empty bottle` holds nothing, `cup of tea` holds tea. Words for colours
  stay colours
  (`silver phone`), unless the object is of metal.
- Objects of known size give the photo's scale (`world.pixels_per_meter`), and gravity follows. Only labels that
  a person gave count, of objects that are whole and of ordinary proportions. A scene takes the scale from a
  confidence of 0.5 on, which is good to about 24 %.
- `physgen perceive --refresh scene.yaml -o new.yaml` reckons anew after labels were edited, or given with
  `--label ball-1="steel ball"`. A number is reckoned where `from` says that the table gave it and it is what
  the table gives for the old label: the one in the file, in the object's name, or guessed from its shape. Any
  other number is yours and stays. The scale stays, too, where forces, velocities, joints, fields, a camera or
  variants were written for it.

## Materials

Density in g/cm³. Friction: of two surfaces, the geometric mean counts. Rolling: moment = rolling x normal force
x radius. Gloss: share mirrored at 60°, against polished black glass (ISO 2813 gloss units / 100). What no source
is named for is an estimate: friction to a factor of about 1.5, rolling to a factor of 2.
"""
"""What docs/materials.md says above its tables."""


def page() -> str:
    parts = [
        "# Benchmarks",
        "",
        "Written by `make bench` from `benchmarks/results/`; do not edit. One run each; CPU seconds.",
        "",
    ]
    for name, table in (
        ("render", _render),
        ("frames", _frames),
        ("encoder", _encoder),
        ("labels", _labels),
        ("datasets", _datasets),
        ("start", _start),
        ("check", _check),
        ("gallery", _gallery),
        ("batch", batch_table),
        ("cluster", _cluster),
        ("kills", kills_table),
        ("growth", _growth),
        ("segmentation", _segmentation),
        ("names", _names),
        ("prompts", _prompts),
        ("perceive", _perceive),
        ("percepts", _percepts),
        ("shadows", _shadows),
        ("refine", _refine),
    ):
        path = RESULTS / f"{name}.json"
        if path.exists():
            result = json.loads(path.read_text())
            parts += [*table(result["rows"]), "", f"Measured on {result['machine']}.", ""]
    return "\n".join(parts)


def physics_page() -> str:
    result = json.loads((RESULTS / "physics.json").read_text())
    return physics.page.page(result["rows"], result["machine"])


def plausibility_page() -> str:
    result = json.loads((RESULTS / "plausibility.json").read_text())
    return plausibility.page.page(result["rows"], result["machine"])


def _ahead(rows: list[dict]) -> list[str]:
    """How the headline stands to its bar, which decides the command's exit code."""
    better = fidelity.ahead(fidelity.means(rows)) or 0.0
    state = "is met" if better >= fidelity.BAR else "is missed, so that the command ends with 1"
    return [
        f"On the test half, `ours` is {better:.2f} dB better than the paper's way, relit, over objects and shadows.",
        f"The bar that this project set itself, {fidelity.BAR:g} dB, {state}.",
    ]


def _plain(rows: list[dict]) -> Findings:
    """The tables alone."""
    told = fidelity.findings({"rows": rows, "means": fidelity.means(rows), "ahead": None})
    return replace(told, sentences=())


def fidelity_page() -> str:
    result = json.loads((RESULTS / "fidelity.json").read_text())
    return "\n".join(
        [
            "# Fidelity",
            "",
            "Written by `python benchmarks/run.py fidelity` from `benchmarks/results/fidelity.json`; do not edit.",
            "",
            "Frames of the studio's truth videos (Mitsuba) against frames drawn from the photo at the same poses,",
            "by `physgen evaluate fidelity`, and with parts taken away. `ours` uses the maps that `perceive` makes",
            "of the photo, given the true masks; `true maps` are the studio's. The paper's way pastes hard cut-outs",
            "over the true background, with the old shadows or without, and relights with the true light. PSNR in",
            "dB and SSIM, means over",
            "frames, then scenes:",
            "over objects, over shadows and reflections (where truth differs from the empty background by more",
            "than 6 grey levels), and over the rest. Flicker: grey levels by which the error changes between frames.",
            "",
            *_ahead(result["rows"]),
            "",
            told(_plain(result["rows"])).partition("\n\n")[2].lstrip(),
            f"Measured on {result['machine']}.",
            "",
        ]
    )


def materials_page() -> str:
    """docs/materials.md, from the material table itself."""
    rows = [
        [row.name, row.density, row.friction, row.elasticity, row.rolling, row.gloss, row.source, row.surface]
        for row in materials()
    ]
    things = [
        [
            what.noun,
            ", ".join(word for word in words if word != what.noun),
            what.material.name,
            what.form,
            " x ".join(f"{side:g}" for side in what.size),
            "" if not what.size else f"{100 * what.spread:g}",
            "" if what.mass is None else f"{what.mass:g}",
            what.source,
        ]
        for what, words in nouns()
    ]
    properties = [
        "material",
        "density",
        "friction",
        "elasticity",
        "rolling",
        "gloss",
        "density from",
        "the rest from",
    ]
    head = ["noun", "also", "material", "form", "size, mm", "differs by, %", "mass, g", "source"]
    return "\n".join(
        [
            ABOUT_MATERIALS,
            *_table(properties, rows),
            "",
            "## Objects",
            "",
            "EST: estimated from ordinary objects in shops and homes, good to a factor of about 1.5 in mass.",
            "",
            *_table(head, things),
            "",
        ]
    )


def _growth(rows: list[dict]) -> list[str]:
    table = [
        "## Growth",
        "",
        "Heaps of balls and boxes that fall into a trough, and columns of boxes at rest; 2 s, 960 steps a second, 60",
        "samples. MB: trajectory.npz. bounces: closing speed below which contacts did not bounce, at most.",
        "",
        *_table(
            ["bodies", "CPU, s", "MB", "blows", "sweeps, at most", "bounces above, px/s"],
            [
                [
                    f"{row['kind']}, {row['bodies']:,}",
                    row["cpu"],
                    row["mb"],
                    f"{row['impacts']:,}",
                    row["iterations"],
                    row["still"],
                ]
                for row in rows
            ],
        ),
        "",
    ]
    powers = ", ".join(
        f"{kind} as bodies^{exponent([row for row in rows if row['kind'] == kind]):.2f}" for kind in KINDS
    )
    return [*table, f"Cost grows: {powers}.", "", "![CPU seconds over bodies](growth.svg)"]


def _table(head: list[str], rows: list[list[object]]) -> list[str]:
    numbers = ["---" if k == 0 else "---:" for k in range(len(head))]
    return ["| " + " | ".join(map(str, row)) + " |" for row in (head, numbers, *rows)]


def _render(rows: list[dict]) -> list[str]:
    body = [
        [
            r["scene"],
            r["objects"],
            r["frames"],
            *(f"{r['cpu'].get(s, 0):.2f}" for s in STAGES),
            f"{r['wall']:.1f}",
            r["peak_mib"],
        ]
        for r in rows
    ]
    growth = []
    for name in dict.fromkeys(r["scene"] for r in rows):
        own = [r for r in rows if r["scene"] == name]
        growth.append(f"{name} {own[-1]['peak_mib'] / own[0]['peak_mib'] - 1:+.1%}")
    return [
        "## Rendering",
        "",
        "CPU seconds of each stage, the wall time of all, and the most memory the process held. `encode` is H.264.",
        "",
        *_table(["scene", "objects", "frames", *STAGES, "wall", "MiB"], body),
        "",
        f"Memory from the fewest to the most frames: {', '.join(growth)}.",
    ]


def _frames(rows: list[dict]) -> list[str]:
    head = [
        "## Frames",
        "",
        "Relighting and shadows on; CPU time of drawing without encoding, wall time on both cores; the least of",
        "three runs. Balls are drawn by formula, on a table seen from above, and all move.",
        "",
        "| measure | scene | found | bar |",
        "| --- | --- | ---: | ---: |",
    ]
    return head + [
        f"| {r['measure']} | {r['scene']} | {r['found']:,} | {'' if r['bar'] is None else r['bar']} |"
        for r in rows
    ]


def _encoder(rows: list[dict]) -> list[str]:
    head = [
        "## The encoder",
        "",
        "x264 at CRF 17 on 90 frames of billiards, one run: ms a frame, size, and what comes back. The preset in use",
        "is the last one before time grows faster than size falls; one thread: what more of",
        "them write differs by chance where the height is no multiple of 16.",
        "",
        "| preset | threads | CPU, ms | wall, ms | KiB | PSNR, dB |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    return head + [
        f"| {r['preset']} | {r['threads']} | {r['cpu']} | {r['wall']} | {r['kib']:,} | {r['psnr']} |"
        for r in rows
    ]


def _labels(rows: list[dict]) -> list[str]:
    keys = ("ms", "encoding", "times", "bar", "files", "mb")
    body = [[row["format"], *(row.get(key, "") for key in keys)] for row in rows]
    alone = []
    if "alone" in (whole := rows[-1]):
        alone = [
            "What several files hold alike (the frame as PNG and as JPEG, flow, depth) is encoded once. If each file",
            f"had its encoder alone, these would take {whole['alone']} ms a frame: all together take",
            f"{whole['times_alone']} times that, with a bar of {whole['bar']}.",
            "",
        ]
    return [
        "## Ground truth",
        "",
        "All formats of one clip in one pass: 16 balls that roll, 60 frames of 512 x 512 px; CPU ms a frame, and what",
        "the encoders of the files take of it, on the very arrays that they are handed, with the writing of the files.",
        "What several formats read (flow, ids, where objects are), and what is filled in behind objects once for the",
        "clip, is shared.",
        "",
        *alone,
        *_table(["format", "CPU, ms", "encoders, ms", "times", "bar", "files", "MB"], body),
        "",
    ]


def _datasets(rows: list[dict]) -> list[str]:
    keys = ("clips", "files", "shards", "mb", "written", "unchanged", "mib", "idle_mib")
    heads = ["clips", "files", "shards", "MB", "written, ms a clip", "there already", "MiB", "MiB before"]
    return [
        "## Data sets",
        "",
        "Tiny clips with events and masks gathered into WebDataset shards, and once more when they are there: CPU",
        "ms a clip, and the most memory that the process held.",
        "",
        *_table(heads, [[row[key] for key in keys] for row in rows]),
        "",
    ]


def _cluster(rows: list[dict]) -> list[str]:
    local, handing, killed = (next(iter(row.values())) for row in rows)
    ways = [
        [r["way"], r["wall"], r["cpu"], *(" ".join(map(str, r[k])) for k in ("rate", "load"))] for r in local
    ]
    return [
        "## Clusters",
        "",
        f"{local[0]['clips']} variants of a bundled scene, 16 frames of 256 px: with two processes (`--jobs 2`), and",
        "with two workers of a local Dask cluster. Medians of runs that took turns, starting and the gallery included.",
        "Throughput and CPU are relative to processes in the same turn: least, median, most.",
        "",
        *_table(["", "wall, s", "CPU, s", "throughput", "CPU"], ways),
        "",
        f"Handing out a clip costs the process that does it {handing} ms of CPU, with Dask's client, scheduler and",
        "workers' loops in it.",
        "",
        f"A scheduler with two workers, one of which is killed (SIGKILL) after {killed['after']} of {killed['clips']}",
        f"clips: {killed['there']} clips are there, {killed['equal']} of their {killed['files']} videos and",
        f"trajectories equal to this machine's, byte for byte; {killed['left'] or 'nothing'} half-written is left.",
    ]


def _gallery(rows: list[dict]) -> list[str]:
    first = rows[0]
    return [
        "## Gallery",
        "",
        "Pages of many clips, opened from disk in headless Chromium, 1280 x 900; wall seconds, medians of five. A",
        f"clip's poster takes {first['poster_kb']:g} kB; posters lie",
        "beside the page, or inside it. opened: all that is in view is drawn; painted: the first of it.",
        "made: CPU seconds to write the page where the pictures are there; making them takes about 0.2 s a clip.",
        "",
        *_table(
            [
                "clips",
                "view",
                "pictures",
                "page, MB",
                "made, s",
                "painted, s",
                "opened, s",
                "search, s",
                "sort, s",
            ],
            [
                [
                    f"{row['clips']:,}",
                    row["view"],
                    row["pictures"],
                    row["mb"],
                    row["made"],
                    f"{row['painted']:.2f}",
                    f"{row['opened']:.2f}",
                    f"{row['search']:.2f}" if "search" in row else "",
                    f"{row['sort']:.2f}" if "sort" in row else "",
                ]
                for row in rows
            ],
        ),
    ]


def _start(rows: list[dict]) -> list[str]:
    return [
        "## Starting",
        "",
        *_table(["command", "CPU s"], [[f"`{r['command']}`", f"{r['cpu']:.2f}"] for r in rows]),
    ]


def _check(rows: list[dict]) -> list[str]:
    return [
        "## Checking",
        "",
        "After imports.",
        "",
        *_table(["scene", "ms"], [[r["scene"], r["ms"]] for r in rows]),
    ]


def _refine(rows: list[dict]) -> list[str]:
    *models, ours = rows
    keys = ("guidance_off", "photo_off", "again_off", "seed_off")
    body = [[r["backend"], *(r[key] for key in keys), f"{r['cpu']:.1f}"] for r in models]
    small, (wide, high) = models[0]["size"], ours["size"]
    return [
        "## Refining",
        "",
        "Tiny models of the real classes with random weights prove what must stay, and nothing of quality, which is",
        f"not measured yet. {models[0]['frames']} frames of {small[0]} x {small[1]} px, 25 of 50 steps. Grey "
        "levels by which frames differ, at most: all from the",
        "guidance, where all is object and nothing of the model's enters; the first from the photo; a second run from",
        "the first; and on average another seed from it. CPU seconds of a run. All but the network, for "
        f"{ours['frames']} frames of",
        f"{wide} x {high} px in 25 steps: {ours['cpu']:.1f} s of one core.",
        "",
        *_table(["backend", "guidance", "photo", "again", "another seed", "CPU s"], body),
    ]


def _names(rows: list[dict]) -> list[str]:
    body = [
        [
            row["by"], *(f"{row[key]:.2f}" for key in ("first", "three", "first_of_all", "three_of_all")),
            row["sure"], f"{row['sure_right']:.2f}", f"{row['cpu']:.2f}" if "cpu" in row else "-",
        ]
        for row in rows
    ]  # fmt: skip
    heads = [
        "by",
        "first",
        "of three",
        "first, all",
        "of three, all",
        "sure labels",
        "right",
        "CPU s, 16 objects",
    ]
    return [
        "## Naming objects",
        "",
        f"True masks of COCO's validation photos: {rows[0]['objects']} objects of 1 % of the photo or more,",
        f"{rows[0]['known']} of them of classes that ImageNet has; the share named rightly first and among three.",
        "Sure: labels that are written, of objects of any size, but for people's;",
        "see [how](segmentation-model.md#names).",
        "",
        *_table(heads, body),
    ]


def _segmentation(rows: list[dict]) -> list[str]:
    def cells(row: dict) -> list[object]:
        shares = [row[key] for key in ("precision", "recall", "iou")]
        return [
            row["hit"],
            row["said"],
            row["true"],
            *("-" if one is None else f"{one:.2f}" for one in shares),
        ]

    sets = [
        [
            row["set"], *cells(row),
            "-" if row["ap50"] is None else f"{row['ap50']:.2f}", f"{row['error']:.2f}", f"{row['cpu']:.1f}",
        ]
        for row in rows
        if row["photo"] == ""
    ]  # fmt: skip
    reliability = [
        [f"{row['from']:.2f} to {row['to']:.2f}", row["found"], f"{row['stated']:.2f}", f"{row['right']:.2f}"]
        for row in rows
        if row["set"] == "reliability"
    ]
    without = [[row["without"], row["set"], *cells(row)] for row in rows if "without" in row]
    photos = [[row["photo"], row["set"], *cells(row)] for row in rows if row["photo"]]
    counts = ["hit", "found", "true", "precision", "recall", "mean IoU"]
    return [
        "## Finding objects",
        "",
        "Without masks, at an intersection over union of 0.5, see [segmentation.md](segmentation.md). Tune and",
        "test are halves of the studio's photos, homes those of `studio/segmentation/validation`, peers real photos.",
        "Household are four more real photos; COCO's are those that nothing learned from, movable objects of 1 % of",
        "the photo or more. Error: of confidences. CPU: seconds a photo.",
        "",
        *_table(["set", *counts, "AP50", "error", "CPU"], sets),
        "",
        "Reliability on the real photos (peers, household, COCO): the confidence stated, and the share that is right.",
        "",
        *_table(["confidence", "found", "stated", "right"], reliability),
        "",
        "The same with one part taken away; without the judge the network's mean foreground ranks proposals.",
        "",
        *_table(["without", "set", *counts], without),
        "",
        "Each photo:",
        "",
        *_table(["photo", "set", *counts], photos),
    ]


def _perceive(rows: list[dict]) -> list[str]:
    def cells(row: dict) -> list[object]:
        finding = row["stages"]["segment"]
        rest = sum(row["stages"].values()) - finding
        return [f"{finding:.1f}", f"{rest:.1f}", row["memory"]]

    sizes = [f"{row['width']} x {row['height']}" for row in rows]
    return [
        "## Perceiving",
        "",
        "`perceive --side 4096` on a photo stretched to a size: wall seconds, and MiB of memory at the peak.",
        "",
        *_table(
            ["photo", "px", "objects", "finding objects", "all the rest", "memory"],
            [
                [row["photo"], size, row["objects"], *cells(row)]
                for row, size in zip(rows, sizes, strict=True)
            ],
        ),
    ]


def _percepts(rows: list[dict]) -> list[str]:
    def two(row: dict, key: str) -> str:
        values = [row.get(key), row.get(f"{key}_found")]
        said = [
            ("yes" if v else "NO") if isinstance(v, bool) else "-" if v is None else f"{v:g}" for v in values
        ]
        return " / ".join(said)

    def one(row: dict, key: str, places: int) -> str:
        return "-" if row.get(key) is None else f"{row[key]:.{places}f}"

    def beside(row: dict, key: str, other: str, places: int = 2) -> str:
        return "-" if key not in row else f"{row[key]:.{places}f} ({row[other]:.{places}f})"

    def mean(part: list[dict], key: str) -> float | None:
        values = [row[key] for row in part if row.get(key) is not None]
        return sum(values) / len(values) if values else None

    held = [
        [
            r["photo"], r["half"], two(r, "still"), two(r, "view"),
            f"{r['supported']} of {r['standing']}" if r["standing"] else "-", two(r, "light"),
            f"{r['mass']} / {r['mass_scaled']} of {r['weighed']}" if "mass" in r else "-",
        ]
        for r in rows
    ]  # fmt: skip
    with_truth = [row for row in rows if "psnr" in row]
    for half in dict.fromkeys(row["half"] for row in with_truth):
        part = [row for row in with_truth if row["half"] == half]
        keys = [key for key, value in part[0].items() if not isinstance(value, str | bool)]
        with_truth.append(
            {"photo": f"mean of {half}", "half": half, **{key: mean(part, key) for key in keys}}
        )
    seen = [
        [
            r["photo"], r["half"], beside(r, "normals", "normals_flat", 0), one(r, "balls", 0),
            beside(r, "albedo", "albedo_grey"), beside(r, "shading", "shading_grey"),
            one(r, "shadow", 2), one(r, "psnr", 1), one(r, "psnr_clean", 1), beside(r, "texture", "texture_true"),
        ]
        for r in with_truth
    ]  # fmt: skip
    return [
        "## What perception says beside what is true",
        "",
        "Given the true masks / with those that it finds. Still: px by which anything moves in 2 s without a push.",
        "Stands: under how many of the objects that stand on a true floor one was found within 3 px. Light: degrees",
        "between the found light and the true one. Mass: how many of the objects weigh within a factor of 2 of the",
        "truth, given their names / and the photo's scale, too.",
        "",
        *_table(["photo", "half", "still", "view", "stands", "light", "mass"], held),
        "",
        "Given the true masks. Normals: mean degrees off over objects (were all to face the viewer), and over balls.",
        "Albedo, shading: root mean square error after the best factor, over the truth's (those of a grey albedo).",
        "Shadow: intersection over union. PSNR: dB behind removed objects, blurred by 6 px, of `background.png`, which",
        "holds the darkness under objects that touch the ground, and of `clean.png`. Texture: in the fill over that",
        "around it (the truth's).",
        "",
        *_table(
            ["photo", "half", "normals", "balls", "albedo", "shading", "shadow", "PSNR", "clean", "texture"],
            seen,
        ),
    ]


def _prompts(rows: list[dict]) -> list[str]:
    def cell(row: dict, kind: str) -> str:
        return f"{row[kind]:.3f} / {row[f'{kind}_least']:.2f} / {row[f'{kind}_good']:.0%}"

    kinds = ("box", "jitter", "point")
    body = [
        [row["photo"], row["half"], row["objects"], *(cell(row, kind) for kind in kinds), row["ms"]]
        for row in rows
        if row["half"] != "coco"
    ]
    for half in dict.fromkeys(row["half"] for row in rows):
        mine = [row for row in rows if row["half"] == half]
        count = sum(row["objects"] for row in mine)
        whole: dict[str, float] = {}
        for kind in kinds:
            for key in (kind, f"{kind}_good"):
                whole[key] = sum(row[key] * row["objects"] for row in mine) / count
            whole[f"{kind}_least"] = min(row[f"{kind}_least"] for row in mine)
        body.append([f"all of {half}", half, count, *(cell(whole, kind) for kind in kinds), ""])
    return [
        "## Pointing at objects",
        "",
        "`perceive --box` and `--point`: mean IoU with the true mask / the least / the share that reaches 0.85.",
        "loose: boxes 10 % larger on every side than the object; off: every side of the tight box moved by up to 10 %,",
        "in or out, at random, twice; point: the pixel farthest from the outline. ms: wall time a box, median, on a",
        "machine shared with others.",
        "",
        *_table(["photo", "half", "objects", "box, loose", "box, off", "point", "ms"], body),
    ]


def _shadows(rows: list[dict]) -> list[str]:
    body = [
        [
            r["scene"],
            "yes" if r["lifted"] else "no",
            *(f"{r[k]:.3f}" for k in ("before", "after", "elsewhere")),
        ]
        for r in rows
    ]
    return [
        "## Lifting shadows",
        "",
        "By `perceive`, given the true masks. Root mean square error of the logarithm of light where a shadow",
        "truly falls, before and after, and what was lifted where there is none.",
        "",
        *_table(["photo", "lifted", "before", "after", "elsewhere"], body),
    ]


if __name__ == "__main__":
    (RESULTS.parents[1] / "docs" / "materials.md").write_text(materials_page())
