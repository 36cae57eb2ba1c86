"""`render`: scenes to clips."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import Command, Parser, refuse_split_values
from physgen.cli.clips import add_clips, add_overlays, check_names, jobs_of, make_all


def render(options: argparse.Namespace) -> int:
    refuse_split_values(options.command_line, options.scenes)
    options.output = options.output or ("out/preview" if options.preview else "out")
    jobs = list(jobs_of(options))
    check_names(jobs)
    jobs = jobs[options.part or slice(None)]
    return make_all(jobs, len(jobs), options, gallery=options.part is None)


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help="a scene file")
    parser.option(
        "-o --output",
        "DIR",
        str,
        "folder of the results; default: out, or out/preview for previews",
    )
    about = (
        "push an object: ball-1=right, ball-1=up-left, ball-1=30@2 m/s (degrees, 90 is down), in place of the push "
        "that perceive wrote; velocities that you wrote stay. May be repeated"
    )
    parser.option("--push", "NAME=DIRECTION", str, about, [], action="append")
    about = "lift an object by its own height and let it fall; may be repeated"
    parser.option("--drop", "NAME", str, about, [], action="append")
    about = "strike what is at a point of the photo (px, or e.g. 6 cm,4 cm); X,Y@SPEED says how hard. May be repeated"
    parser.option("--kick", "X,Y", str, about, [], action="append")
    add_clips(parser)
    add_overlays(parser)


RENDER = Command(
    "render",
    "Renders scenes to videos, reports and manifests.",
    "physgen render scene.yaml --push ball-1=right --format mp4,gif",
    add,
    render,
    mixed=True,
)
