"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import Command, Parser, add_device, count, labels, number, two_sides, whole
from physgen.cli.clips import add_overlays, check_formats, check_names, make_all, variants_of
from physgen.cli.output import print_error
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.run import Done


def export(options: argparse.Namespace) -> int:
    from physgen.batch.run import Job
    from physgen.pipeline import Page, RenderOptions

    check_formats(options.format, "--format")
    options.set = [*options.set, *_film_edits(options)]
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
    check_names(jobs)
    lines: dict[str, None] = {}

    def on_done(done: Done) -> None:
        if options.frames and done.folder is not None:
            lines.update(dict.fromkeys(_plays(done.folder, options)))

    code = make_all(jobs, len(jobs), options, on_done, gallery=False)
    for line in lines:
        print_error(line)
    return code


def _plays(folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """How long a clip plays with the requested frames."""
    try:
        manifest = json.loads((folder / "manifest.json").read_bytes())
        count, fps = len(manifest["frames"]), float(manifest["video"]["fps"])
        duration, long = float(manifest["document"]["world"]["duration"]), count / fps
    except (OSError, ValueError, KeyError, TypeError, ZeroDivisionError):
        return
    plays = f"{count} frames at {fps:g} fps play for {long:.3g} s"
    if any(text.startswith("world.duration=") for text in options.set) or abs(long - duration) < 1e-9:
        yield plays
        return
    stays = "the duration of the motion is still that of the scene"
    yield f"{plays}; {stays}: --set world.duration={long:.6g} shows it at its true speed"


def _film_edits(options: argparse.Namespace) -> list[str]:
    """Edits of `--frames`, `--size` and `--fps`, which hold for every format. Raises InputError."""
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


NAMES = (
    "frames", "flo", "kitti", "wheel", "tapvid", "order", "depth", "normals", "albedo", "shading", "coco", "davis",
    "youtubevos", "mot", "mots", "events", "trajectory", "conditioning", "physics",
)  # fmt: skip


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+")
    about = f"any of {','.join(NAMES)}; tapvid:512 tracks 512 points; see docs/ground-truth.md"
    parser.option("--format", "LIST", labels, about, required=True)
    parser.option("-o --output", "DIR", str, "default: labels", "labels")
    about = "number of frames, spread over the scene's duration, as by --set render.frames=N"
    parser.option("--frames", "N", whole(2, 100_000), about)
    about = "size of the frames, px, e.g. 832x480; the photo is cropped to its proportions"
    parser.option("--size", "WxH", two_sides, about)
    parser.option("--fps", "N", number(1, 1000), "frames per second at which they play")
    parser.option("--jobs", "N", count, "scenes at a time; default: 1", 1)
    add_device(parser)
    parser.flag("--no-cache", "simulate again, and overwrite existing labels")
    parser.flag("--json", "print a line of JSON for each scene")
    add_overlays(parser)


EXPORT = Command(
    "export",
    "Exports the ground truth of scenes: flow, masks, tracks and events, in the formats that other tools read.",
    "physgen export scene.yaml --format flo,events,conditioning --frames 49 --size 832x480 --fps 16 -o labels",
    add,
    export,
    mixed=True,
)
