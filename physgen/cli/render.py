"""`render`: scenes to clips."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import Command, Parser
from physgen.cli.clips import add_clips, add_overlays, check_names, jobs_of, make_all


def render(options: argparse.Namespace) -> int:
    jobs = list(jobs_of(options))
    check_names(jobs)
    return make_all(jobs, len(jobs), options)


def add(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help="a file or a pack")
    parser.option("-o --output", "DIR", str, "folder of the results; default: out", "out")
    add_clips(parser)
    add_overlays(parser)


RENDER = Command(
    "render",
    "Renders scenes to videos, reports and manifests.",
    "physgen render scene.yaml -o out --format mp4,gif",
    add,
    render,
    mixed=True,
)
