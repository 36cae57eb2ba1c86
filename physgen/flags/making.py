"""Flags of all commands that make clips, and of all that read scenes."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.flags.clusters import add_cluster
from physgen.flags.values import DEVICES, count, draws, formats, labels, seed

REPORTS = ("full", "plain", "none")


def add_clips(sub: argparse.ArgumentParser) -> None:
    """How clips are made."""
    sub.add_argument(
        "--jobs", metavar="N", type=count, default=1, help="scenes rendered at a time; default: 1"
    )
    add_cluster(sub)
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=formats,
        default=["mp4"],
        help="any of mp4,gif,webp,png; default: mp4",
    )
    sub.add_argument(
        "--chaos",
        action="store_true",
        help="tell in the report how long the motion can be foretold; see simulate",
    )
    sub.add_argument(
        "--fan",
        metavar="N",
        type=draws,
        default=0,
        help="simulate N draws of what `from` is unsure of: which outcomes does the photo decide? see docs/fan.md",
    )
    sub.add_argument("--fan-seed", metavar="S", type=seed, default=0, help="of the draws; default: 0")
    sub.add_argument(
        "--device",
        choices=DEVICES,
        default="cpu",
        help="what draws the frames: cuda is an NVIDIA GPU, by way of torch; default: cpu",
    )
    sub.add_argument(
        "--refine",
        metavar="NAME[:WEIGHTS]",
        help="a video diffusion model retouches the clip: animatediff, wan, cogvideox, or none; see physgen backends",
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument(
        "--report",
        choices=REPORTS,
        help="full (the default); plain: without player, charts and what was perceived, which takes less time than a "
        "short clip; none",
    )
    sub.add_argument(
        "--export",
        metavar="LIST",
        type=labels,
        default=(),
        help="ground truth beside the clip, in truth/: any of the formats of physgen export",
    )
    sub.add_argument(
        "--single-file",
        action="store_true",
        help="put the video into report.html, which can then be mailed alone",
    )
    sub.add_argument(
        "--preview",
        action="store_true",
        help="a quick look: at most 24 frames as large as the photo, without a report",
    )
    sub.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="make clips again that are there, and neither read nor keep results of stages",
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON a clip, and one at the end")


def add_overlays(sub: argparse.ArgumentParser) -> None:
    """What is edited of a scene, and what it may read."""
    sub.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="edit a key: objects.ball-1.mass=200; * stands for every object",
    )
    sub.add_argument("--variant", metavar="NAME", help="apply a named variant of the file, or all")
    sub.add_argument(
        "--allow-outside", action="store_true", help="let the scene read files outside its folder"
    )
