"""Run `export`: write the ground truth of scenes, without a video or a page."""

from __future__ import annotations

import argparse

import physgen.export
from physgen import batch, pipeline
from physgen.cli.arguments import (
    Command,
    Parser,
    check_folder_name,
    count,
    names,
    refuse_settings,
)
from physgen.cli.clips import add_overlays, check_names, make_all, variants_of


def export(options: argparse.Namespace) -> int:
    refuse_settings(options.scenes)

    check_folder_name(options.output)
    physgen.export.formats.choose_formats(options.format)
    # Labels are made by the same jobs as clips, without a video.
    jobs = []
    for path in options.scenes:
        for variant in variants_of(path, options):
            jobs.append(
                batch.run.Job(
                    path,
                    pipeline.RenderOptions(
                        overrides=tuple(options.set),
                        variant=variant,
                        allow_outside=options.allow_outside,
                        formats=(),
                        command=tuple(options.command_line),
                        cached=options.cache,
                        page=pipeline.Page.NONE,
                        export=tuple(options.format),
                    ),
                    options.output,
                )
            )
    check_names(jobs)
    return make_all(jobs, len(jobs), options, gallery=False)


NAMES = (
    "frames", "flo", "kitti", "depth", "normals", "coco", "davis", "mot", "tapvid", "events", "trajectory",
    "physics", "layers", "layers-prores", "layers-vp9",
)  # fmt: skip


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+")
    help_text = f"any of {','.join(NAMES)}; see docs/labels.md"
    parser.option("--format", "LIST", names, help_text, required=True)
    parser.option("-o --output", "DIR", str, "default: labels", "labels")
    parser.option("--jobs", "N", count, "scenes at a time; default: 1", 1)
    parser.flag("--no-cache", "simulate again, and overwrite existing labels")
    parser.flag("--json", "print a line of JSON for each scene")
    add_overlays(parser)


EXPORT = Command(
    "export",
    "Exports the ground truth of scenes: flow, masks, tracks and events, in the formats that other tools read.",
    "physgen export scene.yaml --format flo,davis,events --set render.frames=49 --set render.size=[832,480] -o labels",
    add,
    export,
    is_order_free=True,
)
