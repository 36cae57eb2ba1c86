"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import Command, Parser, add_device, count, labels, number, two_sides, whole
from physgen.cli.clips import add_overlays, check_formats, check_names, make_all, variants_of


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
    return make_all(jobs, len(jobs), options, gallery=False)


def _film_edits(options: argparse.Namespace) -> list[str]:
    """Edits of `--frames`, `--size` and `--fps`, which hold for every format."""
    edits = [f"render.frames={options.frames}"] if options.frames else []
    if options.size:
        edits.append("render.size=[{}, {}]".format(*options.size))
    if options.fps:
        edits.append(f"render.fps={options.fps:g}")
    return edits


NAMES = (
    "frames", "flo", "kitti", "tapvid", "order", "depth", "normals", "albedo", "shading", "coco", "davis",
    "youtubevos", "mot", "mots", "events", "trajectory", "physics",
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
    "physgen export scene.yaml --format flo,davis,events --frames 49 --size 832x480 --fps 16 -o labels",
    add,
    export,
    mixed=True,
)
