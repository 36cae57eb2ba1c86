"""Flags of `evaluate`, measure by measure."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.values import count, part, rows


def measures(measures: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """What `evaluate` measures, each with flags of its own."""

    def measure(name: str, about: str, example: str) -> argparse.ArgumentParser:
        sub = measures.add_parser(
            name, help=about, description=about, epilog=f"example: physgen evaluate {example}"
        )
        form = sub.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="print as JSON")
        form.add_argument("--markdown", action="store_true", help="print as a page")
        return sub

    sub = measure("physics", "Motion against closed forms.", "physics --rows 1,5,12")
    sub.add_argument(
        "--rows", metavar="LIST", type=rows, default=[], help="some rows, e.g. 1,5,12; default: all"
    )
    sub.add_argument(
        "--draws", metavar="N", type=count, default=5, help="seeded draws of a row's parameters; default: 5"
    )
    sub.add_argument(
        "--no-convergence",
        action="store_true",
        help="only at default settings, not at 240 to 1920 steps a second",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="keep every scene file that is run in this folder",
    )
    sub.add_argument("--jobs", metavar="N", type=count, help="draws run at a time; default: one a processor")

    sub = measure("fidelity", "Frames against the studio's truth videos.", "fidelity --scenes curling,shelf")
    sub.add_argument(
        "--truth",
        metavar="DIR",
        type=Path,
        default=Path("studio/truth"),
        help="the studio's truth; default: studio/truth",
    )
    sub.add_argument(
        "--scenes",
        metavar="LIST",
        type=lambda t: t.split(","),
        default=[],
        help="some scenes, e.g. curling,shelf",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="only write strips of frames there: the paper's way, ours and the truth",
    )

    sub = measure(
        "segmentation",
        "Objects found in photos against their true masks, as COCO counts them.",
        "segmentation photos -o out/segmentation --recall 0.8",
    )
    sub.add_argument(
        "folder",
        metavar="FOLDER",
        type=Path,
        help="photos with label maps: NAME.png and NAME.labels.png, folders of photo.png and masks.png, "
        "or a COCO file (*.json) with its photos",
    )
    sub.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="who segments: segment=NAME"
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write plots, the result as JSON and every photo with what was found in this folder",
    )
    for name, what in (
        ("precision", "the share of what is said that is right"),
        ("recall", "the share of true objects that is found"),
        ("iou", "the mean overlap of what is found"),
    ):
        sub.add_argument(f"--{name}", metavar="BAR", type=part, help=f"least for {what}, 0 to 1")
