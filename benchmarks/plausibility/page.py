"""What `plausible` found -> docs/plausibility.md."""

from __future__ import annotations

from physgen.evaluate.measure import Findings, Section, Table, markdown
from physgen.evaluate.plausibility.judge import EVEN, QUESTIONS

from .confusion import findings
from .run import SEEDS
from .trial import HELD_OUT

HEAD = """\
# Plausibility

Written by `python benchmarks/run.py plausibility` from `benchmarks/results/plausibility.json`; do not edit.

```bash
physgen evaluate plausibility out                             # every clip that was rendered into out
physgen evaluate plausibility scenes/billiards/scene.yaml     # a scene, simulated
physgen evaluate plausibility tracks.csv --fps 30 --skip overlap -o page  # tracks of any video
python benchmarks/run.py plausibility                         # right and wrong clips, as below
```

Is the motion in a clip physically possible? There is no truth to compare with: only where bodies were in each
frame. Each question below gives a score from 0 to 1 with its evidence: who, in which frame, how much. Below 0.5 a clip
is called wrong; its score is that of its worst question, and the command exits with 1. A question that a clip shows
nothing of is not asked, and a clip of which nothing can be asked is neither right nor wrong.

## What it reads

| given | places | outlines |
|---|---|---|
| a folder that `render` made, or a scene file | centres of mass | the scene's |
| CSV: `frame`, `name`, `x`, `y`, and if known `radius` | as given | discs |

px, image axes, s. Of clips of ours nothing but places, outlines and masses is taken, and from the scene what acts from
outside: pushes, joints, wind, scripts, boundaries. Of other tracks, name with `--held` what a hand or a rope moves; masses
are areas there, and any ratio up to 12 times that will do. Bodies are taken to move in one plane: where they pass
before each other, give `--skip overlap`.

## What is asked

The noise of a track is estimated from its fifth or third differences. Each track is cut into
stretches of constant acceleration, least squares and as few as the noise allows; blows lie where two meet, between
frames, at the time at which both ways come nearest. What noise may explain (2.5 standard deviations) is taken off before
anything is called a deviation.

| question | deviation | 0.5 at |
|---|---|---|
| gravity | of a flight's acceleration from the median of all flights', or its change within one, over gravity. A flight is plumb or curved, smooth and touches nothing known; so is what is pulled upwards by over half as much. What changes its acceleration again and again hangs on something. Side only | {gravity} |
| momentum | what is missing of the momentum that two pass to each other, where nothing else is near: seen from above, or both in flight | {momentum} |
| energy | how much faster something parts than it came along the change of its velocity, seen from what it hit, less a tenth that spin may give. Round bodies only | {energy} |
| overlap | how deep two outlines lie in each other, more than at the start, over the smaller one's width; of discs between frames too | {overlap} |
| jumps | how far a step is from all that the velocities before and after allow, over the usual step | {jumps} |

A score is 1/(1 + (deviation/middle)³).

What it does not see: what starts or speeds up by itself, masses that change, spins that go wrong, what is wrong while three or more touch, what happens in
fewer than four frames between two blows; a clip in which everything falls upwards or sideways; gravity that ends
midway, since what rests in the air or goes straight on may lie on something unseen; a blow at what never moves, which
may be nailed down. What falls in air for long (a feather) is called wrong, and so is what unseen hands push or hold and
no one stated.

"""


EARLIER = (
    " The figures are of the judge before it was shortened, when it asked two questions more. On the clips of seeds 1000 and 1001 "
    "both call as many rightly, exact and at 1 px of noise."
)
"""To be removed with the next run of the benchmark."""


def page(rows: list[dict], machine: str) -> str:
    """All rows of the result: the proof's, then scenes'."""
    said = [row for row in rows if "fault" in row]
    seeds = range(HELD_OUT, HELD_OUT + SEEDS)
    found = findings(said, seeds, plots=False)
    body = markdown(found).partition("\n")[2].strip()
    head = HEAD.format(**{name: f"{question.middle:g}" for name, question in QUESTIONS.items()})
    told = markdown(_scenes([row for row in rows if "scene" in row])).partition("\n")[2].strip()
    studio = _studio([row for row in rows if "studio" in row])
    return (
        f"{head}## Right and wrong clips\n\n{body}\n\n{told}\n\n{studio}\n\nMeasured on {machine}.{EARLIER}\n"
    )


def _studio(rows: list[dict]) -> str:
    clips, wrong = (sum(row[key] for row in rows) for key in ("clips", "called_wrong"))
    least = min(row["least"] for row in rows if row["least"] is not None)
    return (
        f"The studio's truth, 12 to 14 frames of eight scenes and 8 frames of each "
        f"of 50 clips of one: {wrong} of {clips} are called wrong, the least score is {least:.2f}."
    )


def _scenes(rows: list[dict]) -> Findings:
    wrong = [row for row in rows if row["score"] is not None and row["score"] < EVEN]
    unasked = sum(row["score"] is None for row in rows)
    sentence = (
        f"Our scenes, with what each says of pushes, joints and boundaries: {len(rows) - len(wrong) - unasked} of "
        f"{len(rows)} are called right, {len(wrong)} wrong; of {unasked} nothing can be asked."
    )
    lines = tuple(
        (
            row["scene"].removeprefix("scenes/").removesuffix("/scene.yaml").removesuffix(".yaml")
            + (f", {row['variant']}" if row["variant"] else ""),
            "not asked" if row["score"] is None else "wrong" if row["score"] < EVEN else "right",
            "-" if row["score"] is None else f"{row['score']:.2f}",
            ", ".join(f"{name} {count}" for name, count in row["asked"].items()) or "-",
        )
        for row in rows
    )
    table = Table(("scene", "verdict", "score", "asked"), lines)
    return Findings("plausibility", "", (), (Section("Our scenes", (sentence,), (table,)),), [])
