"""The frozen split of the scenes into `tune` and `test`, and statistics of both: studio/split.json, studio/scenes.md.

    python studio/split.py        # needs no Mitsuba; refuses to change what `test` was

Whatever is chosen by looking at results (constants, thresholds, training) looks at `tune` only; accuracy is claimed on
`test` and on real photographs.
"""

import hashlib
import json
import sys
from pathlib import Path

from measures import HALVES, MEANS, halves, measure

ROOT = Path(__file__).resolve().parent.parent
TUNE = (
    "billiards",
    "dominoes",
    "toy-car",
    "wall-ball",
    "bottle-book",
    "seesaw",
    "rubber-balls",
    "pyramid",
)
TEST = ("curling", "shelf", "pendulum", "marbles", "kitchen", "ramp", "cans", "cups")
HEADS = {
    "objects": "objects",
    "touching_pairs": "touching pairs",
    "size_px": "median size, px",
    "smallest_px": "smallest, px",
    "outline_contrast": "contrast at outlines",
    "faint_outline": "faint outline",
    "clutter": "clutter",
    "brightness": "brightness",
    "hardness": "hardness of light",
}


def digest(name: str) -> str:
    """Of the photo and its masks."""
    parts = [
        ROOT / "scenes" / name / "photo.png",
        ROOT / "scenes" / name / "photo.assets/masks.png",
    ]
    return hashlib.sha256(b"".join(path.read_bytes() for path in parts)).hexdigest()


def page(split: dict) -> str:
    """studio/scenes.md from split.json."""
    half = {name: key for key in HALVES for name in split[key]}
    lines = [
        "# The studio's scenes",
        "",
        "Written by `python studio/split.py` from `studio/split.json`; do not edit. Pictures: [gallery](../docs/gallery.md);",
        "how they are made: [README](README.md).",
        "",
        "Scenes of `tune` may be looked at while choosing constants or training. Claims of accuracy are made on `test`,",
        "which is frozen by hash, and on real photographs.",
        "",
        "| scene | half | " + " | ".join(HEADS.values()) + " |",
        "|---|---|" + "---|" * len(HEADS),
    ]
    for key in HALVES:
        for name in split[key]:
            row = split["scenes"][name]
            lines.append(
                f"| {name} | {half[name]} | "
                + " | ".join(f"{row[k]:g}" for k in HEADS)
                + " |"
            )
    for key in HALVES:
        mean = split["means"][key]
        lines.append(
            f"| **mean** | **{key}** | "
            + " | ".join(f"{mean[k]:g}" if k in MEANS else "" for k in HEADS)
            + " |"
        )
    lines += [
        "",
        "Size is the root of an object's visible area. Contrast is the median colour difference (CIE 1976) 2.5 px to",
        "either side of the outlines; faint is the share of outline with less than 10. Clutter is the share of background",
        "pixels on a Canny edge. Brightness is the median L*. Hardness is the share of directional light in all light that",
        "falls on the objects.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    path = ROOT / "studio/split.json"
    frozen = json.loads(path.read_text())["sha256"] if path.exists() else {}
    now = {name: digest(name) for name in TEST}
    changed = [name for name in frozen if frozen[name] != now.get(name)]
    if changed:
        raise SystemExit(
            f"test is frozen, yet {', '.join(changed)} changed; take the photos back from the history"
        )
    split: dict = {"tune": list(TUNE), "test": list(TEST), "sha256": now}
    split["scenes"] = {
        n: measure(ROOT / "scenes" / n, ROOT / "studio/truth" / n)
        for n in (*TUNE, *TEST)
    }
    split["means"] = halves(split, split["scenes"])
    path.write_text(json.dumps(split, indent=2) + "\n")
    (ROOT / "studio/scenes.md").write_text(page(split))
    print(json.dumps(split["means"], indent=2), file=sys.stderr)


if __name__ == "__main__":
    main()
