"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import DEVICES, count, labels, of, two_sides
from physgen.cli.clips import Shown, check_formats, make_all, refuse_twins, variants_of
from physgen.cli.output import print_error
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.run import Done


# ----------------------------------------------------------------------
# `export`: scenes to ground truth, without a video or a page.


def export(options: argparse.Namespace) -> int:
    from physgen.batch.run import Job
    from physgen.pipeline import Page, RenderOptions

    check_formats(options.format, "--format")
    options.set = [*options.set, *filmed(options)]
    jobs = [
        Job(
            path,
            RenderOptions(
                overrides=tuple(options.set),
                variant=variant,
                allow_outside=options.allow_outside,
                formats=(),
                command=tuple(options.command_line),
                device=options.device,
                cached=options.cache,
                page=Page.NONE,
                export=tuple(options.format),
            ),
            options.output,
        )
        for path in options.scenes
        for variant in variants_of(path, options)
    ]
    refuse_twins(jobs)
    lines: dict[str, None] = {}

    def heard(done: Done) -> None:
        if options.frames and done.folder is not None:
            lines.update(dict.fromkeys(_plays(done.folder, options)))

    code = make_all(jobs, len(jobs), options, heard, shown=Shown.NOWHERE)
    for line in lines:
        print_error(line)
    return code


def _plays(folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """How long a clip plays with the frames that were asked for."""
    try:
        told = json.loads((folder / "manifest.json").read_bytes())
        count, fps = len(told["frames"]), float(told["video"]["fps"])
        duration, long = float(told["document"]["world"]["duration"]), count / fps
    except (OSError, ValueError, KeyError, TypeError, ZeroDivisionError):
        return
    plays = f"{count} frames at {fps:g} fps play for {long:.3g} s"
    if any(text.startswith("world.duration=") for text in options.set) or abs(long - duration) < 1e-9:
        yield plays
        return
    stays = "the duration of the motion stays as the scene has it"
    yield f"{plays}; {stays}: --set world.duration={long:.6g} shows it at its true speed"


def filmed(options: argparse.Namespace) -> list[str]:
    """What the flags of the film set in every scene, so that every format follows. Raises InputError."""
    edits = [f"render.frames={options.frames}"] if options.frames else []
    if options.size:
        width, height = options.size
        if "conditioning" in options.format and (width % 2 or height % 2):
            even = f"{width + width % 2}x{height + height % 2}"
            expected = "has an odd side, which H.264 with 4:2:0 cannot hold"
            raise InputError.of("--size", f"{width}x{height}", expected, f"write {even}")
        edits.append(f"render.size=[{width}, {height}]")
    if options.fps:
        edits.append(f"render.fps={options.fps:g}")
    return edits


# ----------------------------------------------------------------------
# Flags of `export`.

NAMES = (
    "frames", "flo", "kitti", "wheel", "tapvid", "order", "depth", "normals", "albedo", "shading", "coco", "davis",
    "youtubevos", "mot", "mots", "events", "trajectory", "conditioning", "physics",
)  # fmt: skip


def add_export(sub: argparse.ArgumentParser) -> None:
    """Of the whole command."""
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=labels,
        required=True,
        help="any of " + ",".join(NAMES) + "; tapvid:512 has so many points; see docs/ground-truth.md",
    )
    sub.add_argument("-o", "--output", metavar="DIR", default="labels", help="default: labels")
    sub.add_argument(
        "--frames",
        metavar="N",
        type=of({"type": "integer", "minimum": 2, "maximum": 100_000}),
        help="so many frames, spread over the scene's duration, which stays: as --set render.frames=N",
    )
    sub.add_argument(
        "--size",
        metavar="WxH",
        type=two_sides,
        help="of the frames, px; what does not fit is cut off, e.g. 832x480",
    )
    sub.add_argument(
        "--fps",
        metavar="N",
        type=of({"type": "number", "minimum": 1, "maximum": 1000}),
        help="at which they play",
    )
    sub.add_argument("--jobs", metavar="N", type=count, default=1, help="scenes at a time; default: 1")
    sub.add_argument("--device", choices=DEVICES, default="cpu", help="what draws the frames; default: cpu")
    sub.add_argument(
        "--no-cache", dest="cache", action="store_false", help="simulate again, and make what is there again"
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON a scene")
