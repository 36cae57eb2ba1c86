"""`plot`: figures for papers."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import Command, Parser, moments, names, number
from physgen.cli.clips import add_overlays
from physgen.cli.output import OK, Bar
from physgen.problems import InputError


def plot(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.pipeline.plotting import PlotRequest
    from physgen.pipeline.plotting import plot as draw

    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name")
    scenes = options.scenes if options.what == "strip" else [options.scene]
    keys = ("objects", "frames", "width", "variant", "allow_outside")
    chosen = {key: getattr(options, key) for key in keys if hasattr(options, key)}
    request = PlotRequest(overrides=options.set, **chosen)
    name = pipeline.output_name(scenes[0], options.variant) if len(scenes) == 1 else "scenes"
    output = options.output or Path(f"{name}-{options.what}.png")
    bar = Bar()
    try:
        draw(options.what, scenes, output, request, bar.show)
    finally:
        bar.clear()
    print(output)
    return OK


def add(parser: Parser) -> None:
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", dest="what", required=True)

    def kind(name: str, about: str, example: str) -> Parser:
        sub: Parser = kinds.add_parser(
            name, help=about, description=about, epilog=f"example: physgen plot {example}"
        )
        if name == "strip":
            sub.add_argument("scenes", metavar="SCENE", nargs="+")
        else:
            sub.add_argument("scene", metavar="SCENE")
        output = f"write here; .png, .svg or .pdf; default: NAME-{name}.png in this folder"
        sub.option("-o --output", "FILE", Path, output)
        sub.option("--width", "MM", number(20, 2000), "of the figure, mm, e.g. 84 for a column")
        add_overlays(sub)
        return sub

    about = "Kinetic, potential and dissipated energy over time, and their constant sum."
    kind("energy", about, "energy scene.yaml -o energy.pdf")
    about = "Paths of objects over the photo, with time marks."
    sub = kind("trajectory", about, "trajectory scene.yaml --objects cue-ball,ball-1 -o paths.pdf")
    sub.option("--objects", "NAME,...", names, "only these objects", [])
    about = "The photo with red arrows, then frames with their times; a row for each scene."
    sub = kind("strip", about, "strip scenes/*/scene.yaml --frames 6 -o strip.pdf")
    about = "number of frames at even times, or a list of frames, from 0: 0,12,24; default: 5"
    sub.option("--frames", "N", moments, about, 5)


PLOT = Command(
    "plot",
    "Draws figures for papers, as PNG, SVG or PDF.",
    "physgen plot strip scene.yaml -o strip.pdf",
    add,
    plot,
)
