"""benchmarks/results/*.json -> docs/benchmarks.md and docs/accuracy.md. A test fails when they differ.

python benchmarks/tables.py              # writes both pages
"""

from __future__ import annotations

import json
from pathlib import Path
from statistics import median

import accuracy
import batch_tables
import cluster_previews
import editor
import fid_table
import fills
import paper
import plausibility.table
import sound
import sureness
import views
from colour_steps import ALLOWED_STEP, FAR, summarise_steps
from first_motions import motions_table
from ghosts import RING
from growth import KINDS, exponent
from layout import number, prose, table
from strangers import strangers_table

from physgen.evaluate import fidelity

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
SMALL = ("domino", "pig_ball")
RENDERED = ("billiards", "dominoes", "pool")
STAGES = ("simulate", "cut out", "render", "encode")
MACHINE = "2 cores, x86_64, Python 3.11.7"
"""Of all parts that name no other."""
HEAD = f"""\
# Benchmarks

<!-- Written by `python benchmarks/tables.py` from benchmarks/results/; do not edit. -->

`python benchmarks/run.py PART` measures a part again. One run each unless stated; times are CPU seconds on
{MACHINE}, which other work shared.
[Accuracy](accuracy.md) sums up the accuracy; [evaluation](evaluation.md) measures your own data.
"""


def page() -> str:
    """docs/benchmarks.md."""
    parts = [HEAD]
    for title, (name, section) in SECTIONS.items():
        result = json.loads((RESULTS / f"{name}.json").read_text())
        machine = (
            ""
            if result.get("machine", MACHINE) == MACHINE
            else f", {result['machine']}"
        )
        parts += [
            f"## {title}",
            "",
            *section(result["rows"]),
            "",
            f"Part `{name}`{machine}.",
            "",
        ]
    return "\n".join(parts)


def write() -> None:
    """Both pages, from the results."""
    (ROOT / "docs" / "benchmarks.md").write_text(page())
    (ROOT / "docs" / "accuracy.md").write_text(accuracy.page())


def _render(rows: list[dict]) -> list[str]:
    body = [
        [
            row["scene"],
            row["objects"],
            row["frames"],
            *(f"{row['cpu'].get(stage, 0):.2f}" for stage in STAGES),
            f"{row['wall']:.1f}",
            number(row["peak_mib"]),
        ]
        for row in rows
        if row["scene"] in RENDERED and row["frames"] > 16
    ]
    return [
        "CPU seconds of the longest stages, wall seconds of all, peak memory. `pool` is the paper's.",
        "",
        *table(["scene", "objects", "frames", *STAGES, "wall", "MiB"], body),
    ]


def _frames(rows: list[dict]) -> list[str]:
    shown = [
        row
        for row in rows
        if row["bar"] is not None
        and not (row["measure"].startswith("drawing") and row["scene"] in SMALL)
        and not row["measure"].startswith("simulate")
        and "times as fast" not in row["measure"]
        and "30 frames" not in row["scene"]
    ]
    solver = sorted(
        (row for row in rows if row["measure"].startswith("simulate")),
        key=lambda row: row["found"],
    )
    work = next(row["found"] for row in rows if row["measure"].startswith("fixed"))
    middle, most = solver[len(solver) // 2]["found"], solver[-1]
    within = sum(row["found"] <= row["bar"] for row in solver)
    faster = ", ".join(
        f"{row['scene']} {number(row['found'])}"
        for row in rows
        if "times as fast" in row["measure"]
    )
    return [
        *prose(
            "Relighting and shadows on; CPU time of drawing without encoding, wall time on both cores; the least of",
            f"three runs. Simulating takes {number(middle)} times the time of Chipmunk's own steps (median of",
            f"{len(solver)} scenes; {within} within 3, at most",
            f"{number(most['found'])}, in {most['scene']}; bar 3). Times as fast, cold, as the paper's code on",
            f"two other cores: {faster} (bar 10); fixed NumPy and OpenCV work took {number(work)} s here.",
        ),
        "",
        *table(
            ["measure", "scene", "result", "bar"],
            [
                [
                    row["measure"],
                    row["scene"],
                    number(row["found"]),
                    f"{row['bar']:g}",
                ]
                for row in shown
            ],
        ),
    ]


def _growth(rows: list[dict]) -> list[str]:
    powers = ", ".join(
        f"{kind} as bodies^{exponent([row for row in rows if row['kind'] == kind]):.2f}"
        for kind in KINDS
    )
    most = max(rows, key=lambda row: row["bodies"])
    return [
        *prose(
            "Heaps of balls and boxes that fall into a trough, and columns of boxes at rest; 2 s, 960 steps a second.",
            f"Cost grows: {powers}. {most['bodies']:,} bodies ({most['kind']}) take {number(most['cpu'])} s.",
        ),
        "",
        "![CPU seconds over the number of bodies](growth.svg)",
    ]


def _labels(rows: list[dict]) -> list[str]:
    keys = ("ms", "encoding", "times", "files", "mb")
    body = [[row["format"], *(row.get(key, "") for key in keys)] for row in rows]
    return [
        *prose(
            "All formats of one clip in one pass: 16 balls that roll, 60 frames of 512 x 512 px; CPU ms a frame, and",
            "what the encoders of the files take of it. What several formats read (flow, ids, poses) is shared.",
        ),
        "",
        *table(["format", "CPU, ms", "encoders, ms", "ratio", "files", "MB"], body),
    ]


def _gallery(rows: list[dict]) -> list[str]:
    heads = ["clips", "view", "pictures", "page, MB", "painted, s", "opened, s"]
    body = [
        [f"{row['clips']:,}", row["view"], row["pictures"], row["mb"], f"{row['painted']:.2f}", f"{row['opened']:.2f}"]
        for row in rows
    ]  # fmt: skip
    return [
        *prose(
            "Pages of many clips, opened from disk in headless Chromium, 1280 x 900; wall seconds, medians of five.",
            f"A poster takes {rows[0]['poster_kb']:g} kB. Painted: the first of it; opened: all that is in view.",
        ),
        "",
        *table(heads, body),
    ]


def _start(rows: list[dict]) -> list[str]:
    return table(
        ["command", "CPU s"],
        [[f"`{row['command']}`", f"{row['cpu']:.2f}"] for row in rows],
    )


def _refine(rows: list[dict]) -> list[str]:
    *models, ours = rows
    keys = ("guidance_off", "photo_off", "again_off", "seed_off")
    body = [
        [row["backend"], *(row[key] for key in keys), f"{row['cpu']:.1f}"]
        for row in models
    ]
    small, (wide, high) = models[0]["size"], ours["size"]
    return [
        *prose(
            "Tiny models of the real classes with random weights show which pixels must stay. They show no quality,",
            f"which is not measured yet. {models[0]['frames']} frames of {small[0]} x {small[1]} px, 25 of 50 steps.",
            "Grey levels by which frames differ, at most: all from the guidance, where all is object; the first from",
            "the photo; a second run from the first; and on average another seed from it. All but the network, for",
            f"{ours['frames']} frames of {wide} x {high} px in 25 steps: {ours['cpu']:.1f} s of one core.",
        ),
        "",
        *table(
            ["backend", "guidance", "photo", "second run", "another seed", "CPU s"],
            body,
        ),
    ]


def _names(rows: list[dict]) -> list[str]:
    shares = ("first", "three", "first_of_all", "three_of_all")
    body = [
        [
            row["by"],
            *(f"{row[key]:.2f}" for key in shares),
            row["sure"],
            f"{row['sure_right']:.2f}",
        ]
        for row in rows
    ]
    heads = [
        "by",
        "first",
        "of three",
        "first, all",
        "of three, all",
        "confident labels",
        "right",
    ]
    return [
        *prose(
            f"True masks of COCO's validation photos: {rows[0]['objects']} objects of 1 % of the photo or more,",
            f"{rows[0]['known']} of them of classes that ImageNet has; the share named correctly first, and among",
            "three. Confident labels are written into the scene, with the detector from 0.7 on: from 0.6 on 5 glasses",
            "were phones and 3 tins cups.",
        ),
        "",
        *table(heads, body),
    ]


def _segmentation(rows: list[dict]) -> list[str]:
    def cells(row: dict) -> list[object]:
        shares = (
            "-" if row[key] is None else f"{row[key]:.2f}"
            for key in ("precision", "recall", "iou")
        )
        return [row["hit"], row["said"], row["true"], *shares]

    sets = [
        [
            row["set"],
            *cells(row),
            "-" if row["ap50"] is None else f"{row['ap50']:.2f}",
            f"{row['error']:.2f}",
        ]
        for row in rows
        if row["photo"] == ""
    ]
    counts = ["hit", "found", "true", "precision", "recall", "mean IoU"]
    return [
        *prose(
            "Without masks, at an intersection over union of 0.5 ([evaluation](evaluation.md#segmentation)). Tune and",
            "test are halves of the studio's photos, homes those of `studio/segmentation/validation`, peers and",
            "household real photos, coco photos that nothing learned from (movable objects of 1 % of the photo or",
            "more). Error: expected calibration error.",
        ),
        "",
        *table(["set", *counts, "AP50", "error"], sets),
    ]


def _objects(rows: list[dict]) -> list[str]:
    keys = ("precision", "recall", "f", "iou", "error")
    sets = [row for row in rows if row["photo"] == "" and "without" not in row]
    sets = [row for row in sets if row["set"] != "reliability"]
    body = [
        [
            row["set"],
            row["said"],
            row["true"],
            *(_share(row[key]) for key in keys),
            f"{row['cpu']:.1f}",
        ]
        for row in sets
    ]
    reliability = [row for row in rows if row["set"] == "reliability"]
    bins = [
        [
            f"{row['from']:.2f} to {row['to']:.2f}",
            row["found"],
            _share(row.get("stated")),
            _share(row.get("right")),
        ]
        for row in reliability
        if "from" in row
    ]
    (error,) = (row["error"] for row in reliability if "from" not in row)
    heads = ["set", "found", "true", "precision", "recall", "F1", "mean IoU"]
    return [
        *prose(
            "What `perceive` writes under `objects:`, at an intersection over union of 0.5; regions under `doubtful:`",
            "do not count. Coco are the 60 photos of COCO val2017 in the material, as far as they show movable",
            "objects of 1 % of the photo or more; of trashnet-grabcut, fruits-nuts and class5 a fifth is held out,",
            "of the drawings of flat shapes a half. The segmentation network learned from 48 of the 60 photos, the",
            "detector and the judge from none; the judge from the tune half. Error: expected calibration error.",
            "Tune, test, peers, photos, coco and class5 were measured with the present judge and the present head that",
            "cuts objects out; the other sets, the CPU times and the tables below with the former ones.",
        ),
        "",
        *table([*heads, "error", "CPU s a photo"], body),
        "",
        f"Reliability on the real photos; expected calibration error {error:.3f}.",
        "",
        *table(["confidence", "found", "stated", "right"], bins),
        *_objects_without(rows),
    ]


def _objects_without(rows: list[dict]) -> list[str]:
    """Return the table of F1 with parts taken away, where there is one."""
    some = [row for row in rows if "without" in row]
    if not some:
        return []
    sets = list(dict.fromkeys(row["set"] for row in some))
    parts = dict.fromkeys(row["without"] for row in some)
    f1 = {(row["without"], row["set"]): _share(row["f"]) for row in some}
    body = [[part, *(f1.get((part, name), "-") for name in sets)] for part in parts]
    lines = prose(
        "F1 without one part of the search. The judge is the same in every row: it has not learned without the part,",
        "so the last rows state how much it relies on boxes, not how good a search without a detector can be (the",
        "former finder without detector and trees reached 0.44 on coco and 0.90 on photos).",
    )
    return ["", *lines, "", *table(["without", *sets], body)]


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


PROMPT_BARS = {
    "household": (0.93, 0.87),
    "coco": (0.74, 0.65),
    "coco-minis": (0.74, 0.65),
}
"""Mean IoU by loose box and by point that is asked of prompts on photos from elsewhere."""


def _prompts(rows: list[dict]) -> list[str]:
    kinds = ("box", "jitter", "point")
    body: list[list[object]] = []
    asked: list[bool] = []
    for half in dict.fromkeys(row["half"] for row in rows):
        mine = [row for row in rows if row["half"] == half]
        count = sum(row["objects"] for row in mine)

        def mean(key: str, mine: list[dict] = mine, count: int = count) -> float:
            return float(sum(row[key] * row["objects"] for row in mine) / count)

        body.append(
            [half, count, *(f"{mean(k):.2f} / {mean(f'{k}_good'):.0%}" for k in kinds)]
        )
        if half in PROMPT_BARS:
            by_box, by_point = PROMPT_BARS[half]
            asked += [mean("box") >= by_box, mean("point") >= by_point]
    missed = f"{asked.count(False)} of {len(asked)} are missed"
    bars = "; ".join(
        f"{half} {by_box} by loose box, {by_point} by point"
        for half, (by_box, by_point) in PROMPT_BARS.items()
    )
    return [
        *prose(
            "`perceive --box` and `--point`: mean IoU with the true mask / the share that reaches 0.85. Loose: boxes",
            "10 % larger on every side; off: every side of the tight box moved by up to 10 % at random; point: the",
            "pixel farthest from the outline. The photos are those of finding objects, and photos of coco-minis whose",
            "licence forbids learning from them; the head that cuts out learned from none of them, and its constants",
            "were chosen on the homes made for validation.",
            "Points of household and coco were measured with the present choice among boxes, on which its",
            "constants were chosen; the other points with the former choice.",
            f"Bars: {bars}; {missed}.",
        ),
        "",
        *table(["photos", "objects", "box, loose", "box, off", "point"], body),
    ]


def _perceive(rows: list[dict]) -> list[str]:
    body = []
    for row in (row for row in rows if row["width"] > 1000):
        finding = row["stages"]["segment"]
        rest = sum(row["stages"].values()) - finding
        size = f"{row['width']} x {row['height']}"
        body.append(
            [
                row["photo"],
                size,
                row["objects"],
                f"{finding:.1f}",
                f"{rest:.1f}",
                row["memory"],
            ]
        )
    return [
        "`perceive --side 4096` on a photo enlarged to a size: wall seconds, and peak memory.",
        "",
        *table(
            ["photo", "px", "objects", "finding objects", "all the rest", "MiB"], body
        ),
    ]


PERCEIVE_STAGES = (
    "segment",
    "inpaint",
    "shadow",
    "matte",
    "normals",
    "boundary",
    "push",
)
"""The stages that take most, in the order in which they run."""


def _stages(rows: list[dict]) -> list[str]:
    """CPU seconds of perception by stage and size, before and now where both are known."""
    body = []
    for row in rows:
        costs = row["stages"]
        rest = row["cpu"] - sum(costs.get(name, 0.0) for name in PERCEIVE_STAGES)
        cells = [f"{costs.get(name, 0.0):.1f}" for name in PERCEIVE_STAGES]
        total = f"{row['cpu']:.1f}"
        names = [row["photo"], row["side"], row["code"]]
        body.append([*names, total, *cells, f"{rest:.1f}", row["memory"]])
    head = ["photo", "px", "code", "all", *PERCEIVE_STAGES, "others", "MiB"]
    return [
        "`perceive` of photos whose longer side has so many px: CPU seconds by stage, and",
        "peak memory in MiB.",
        "`before`: the code of the checkout that `PHYSGEN_BASELINE` names. Other work",
        "slowed all rows about 1.4 times, but `before` of 3,840 px.",
        "",
        *table(head, body),
    ]


def _first(rows: list[dict]) -> list[str]:
    """What a first clip shows, against its bars."""
    peers = sum(row["photo"].startswith("peer-") for row in rows)
    body = [
        ["px moved, least", f"{min(row['moved'] for row in rows):.0f}", "30"],
        [
            "px moved with `--still`, most",
            f"{max(row['still'] for row in rows):.2g}",
            "1",
        ],
        [
            "lines an object, most",
            f"{max(row['lines'] / row['objects'] for row in rows):.2g}",
            "10",
        ],
    ]
    head = f"`perceive`, then `render`: {len(rows) - peers} bundled photos, {peers} of peers."
    return [head, "", *table(["of a clip", "measured", "bar"], body)]


def _percepts(rows: list[dict]) -> list[str]:
    def mean(part: list[dict], key: str, places: int) -> str:
        values = [row[key] for row in part if row.get(key) is not None]
        return f"{sum(values) / len(values):.{places}f}" if values else "-"

    def total(part: list[dict], key: str, of: str) -> str:
        return f"{sum(row.get(key, 0) for row in part)} of {sum(row.get(of, 0) for row in part)}"

    def share(part: list[dict], key: str) -> str:
        values = [row[key] for row in part if row.get(key) is not None]
        return f"{sum(values)} of {len(values)}"

    halves = {
        half: [row for row in rows if row["half"] == half]
        for half in ("tune", "test", "real")
    }
    lines = (
        ("view is right, masks given", lambda part: share(part, "view")),
        ("view is right, masks found", lambda part: share(part, "view_found")),
        (
            "floor found under objects on one, to 3 px",
            lambda part: total(part, "supported", "standing"),
        ),
        ("light, error in degrees", lambda part: mean(part, "light", 0)),
        (
            "masses within a factor of 2, names given",
            lambda part: total(part, "mass", "weighed"),
        ),
        (
            "masses, names and scale given",
            lambda part: total(part, "mass_scaled", "weighed"),
        ),
        ("normals, mean error in degrees", lambda part: mean(part, "normals", 0)),
        ("albedo, relative RMS error", lambda part: mean(part, "albedo", 2)),
        ("shading, relative RMS error", lambda part: mean(part, "shading", 2)),
        ("shadows, IoU", lambda part: mean(part, "shadow", 2)),
        (
            "background behind removed objects, PSNR in dB",
            lambda part: mean(part, "psnr", 1),
        ),
        (
            "background without shadows, PSNR in dB",
            lambda part: mean(part, "psnr_clean", 1),
        ),
        (
            "the same, outside shadows",
            lambda part: mean(part, "psnr_fill", 1),
        ),
    )
    known = {half: part for half, part in halves.items() if part}
    return [
        "Means over photos with known truth (tune, test: studio; real: photos measured by others).",
        "",
        *table(
            ["measure", *known],
            [
                [title, *(value(part) for part in known.values())]
                for title, value in lines
            ],
        ),
    ]


def _shadows(rows: list[dict]) -> list[str]:
    lifted = [row for row in rows if row["lifted"]]
    before, after, elsewhere = (
        sum(row[key] for row in lifted) / len(lifted)
        for key in ("before", "after", "elsewhere")
    )
    return prose(
        f"`perceive`, given the true masks, removes the shadows of {len(lifted)} of {len(rows)} studio photos. Mean",
        f"error of the logarithm of light where a shadow falls: {before:.2f} before, {after:.2f} after; what was",
        f"changed elsewhere: {elsewhere:.2f}.",
    )


def _ghosts(rows: list[dict]) -> list[str]:
    steps = [row for row in rows if "photo" in row]
    rows = [row for row in rows if "scene" in row]
    true = [row for row in rows if row["outline_true"] is not None]
    off = [abs(row["outline"] - row["outline_true"]) for row in true]
    off += [
        abs(row["shadow"] - row["shadow_true"])
        for row in true
        if row["shadow"] and row["shadow_true"]
    ]
    worst = max(
        row[key]
        for row in rows
        if row not in true
        for key in ("outline", "shadow")
        if row[key]
    )
    lines = prose(
        f"Slope across old outlines and shadows over that {RING} px beside: on {len(true)}",
        f"scenes at most {max(off):.2f} from the true empty place's (median {median(off):.2f}); on peers' scenes at",
        f"most {worst:.2f}.",
    )
    indices = summarise_steps(steps)
    right = sum(row["index"] <= ALLOWED_STEP for row in steps)
    lines += [
        "",
        *prose(
            f"Step of colour across old outlines over that {FAR:g} px outside, given true masks:",
            *(f"{index:.2f} on {group}," for group, index in indices.items()),
            f"at most {ALLOWED_STEP} for {right} of {len(steps)} objects.",
        ),
    ]
    return lines


def _fidelity(rows: list[dict]) -> list[str]:
    means = [row for row in fidelity.means(rows) if row["half"] == "test"]
    ahead = fidelity.ahead(means)
    assert ahead is not None
    keys = (
        ("psnr_objects", 2),
        ("psnr_shadows", 2),
        ("psnr_both", 2),
        ("psnr_rest", 2),
        ("ssim_both", 3),
    )
    return [
        *prose(
            "Frames of the studio's truth videos (Mitsuba) against frames drawn from the photo at the same poses;",
            "means over frames and the scenes held out. `ours` uses the maps that `perceive` makes, given the true",
            "masks; the paper's way pastes hard cut-outs over the true background and relights with the true light.",
            f"`ours` is nearer than the paper's way, relit, by {ahead}; the project's own bar, {fidelity.BAR:g} dB on",
            f"shadows and no worse on objects, is {'met' if ahead.is_enough else 'missed'}.",
            "Flicker: grey levels by which the error changes by frame.",
        ),
        "",
        *table(
            [
                "way",
                "objects, dB",
                "shadows, dB",
                "both, dB",
                "rest, dB",
                "both, SSIM",
                "flicker",
            ],
            [
                [
                    row["way"],
                    *(f"{row[key]:.{places}f}" for key, places in keys),
                    f"{row['flicker']:.2f}",
                ]
                for row in means
            ],
        ),
    ]


SECTIONS = {
    "From photo to video": ("runtime", paper.runtime_table),
    "Rendering": ("render", _render),
    "Frames": ("frames", _frames),
    "Starting": ("start", _start),
    "Perceiving large photos": ("perceive", _perceive),
    "Perceiving by stage": ("stages", _stages),
    "First clips": ("first", _first),
    "Clips of unknown photos": ("strangers", strangers_table),
    "Motion in photos of COCO": ("motions", motions_table),
    "Growth with bodies": ("growth", _growth),
    "Ground truth": ("labels", _labels),
    "Editor": ("editor", editor.table),
    "Gallery": ("gallery", _gallery),
    "Batches": ("batch", batch_tables.batch_table),
    "Clusters": ("cluster", cluster_previews.cluster_table),
    "Interrupted batches": ("kills", batch_tables.kills_table),
    "Hostile input": ("attack", batch_tables.attack_table),
    "Objects of a photo": ("objects", _objects),
    "Finding objects": ("segmentation", _segmentation),
    "Naming objects": ("names", _names),
    "Pointing at objects": ("prompts", _prompts),
    "Views": ("views", views.tables),
    "Perception against truth": ("percepts", _percepts),
    "Removing shadows": ("shadows", _shadows),
    "Ghosts": ("ghosts", _ghosts),
    "Background fills": ("fills", fills.table),
    "Mass, friction and elasticity": ("properties", paper.properties_table),
    "Confidence of masses": ("sureness", sureness.tables),
    "Sound": ("sound", sound.section),
    "Fidelity": ("fidelity", _fidelity),
    "Control": ("controllability", paper.controllability_table),
    "Plausibility": ("plausibility", plausibility.table.section),
    "Estimated against random physics": ("fid", fid_table.tables),
    "Refinement": ("refine", _refine),
}


if __name__ == "__main__":
    write()
