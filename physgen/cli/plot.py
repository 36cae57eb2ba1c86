"""`plot`: figures for papers."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from physgen.cli.arguments import count, curves, moments, names, positive, width
from physgen.cli.output import OK, Bar
from physgen.problems import InputError

# ----------------------------------------------------------------------
# `plot`: figures for papers.


def plot(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.pipeline.plotting import PlotRequest
    from physgen.pipeline.plotting import plot as draw
    from physgen.report.plots.style import PlotStyle

    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name")
    scenes = options.scenes if options.what == "strip" else [options.scene]
    millimetres, pixels = options.width or (None, None)
    look = PlotStyle(millimetres, pixels, options.dpi, options.dark, options.si)
    asked = PlotRequest(
        objects=getattr(options, "objects", ()),
        curves=getattr(options, "curves", ()),
        frames=getattr(options, "frames", 0),
        columns=getattr(options, "columns", None),
        names=getattr(options, "names", False),
        overrides=options.set,
        variant=options.variant,
        allow_outside=options.allow_outside,
        look=look,
    )
    name = pipeline.output_name(scenes[0], options.variant) if len(scenes) == 1 else "scenes"
    output = options.output or Path(f"{name}-{options.what}.png")
    bar = Bar()
    try:
        draw(options.what, scenes, output, asked, bar.show)
    finally:
        bar.clear()
    print(output)
    return OK


# ----------------------------------------------------------------------
# Flags of `plot`, kind by kind.


def add_plot(
    kinds: argparse._SubParsersAction[argparse.ArgumentParser],
    overlays: Callable[[argparse.ArgumentParser], None],
) -> None:
    """What `plot` draws, each with flags of its own."""

    def kind(name: str, about: str, example: str) -> argparse.ArgumentParser:
        sub = kinds.add_parser(name, help=about, description=about, epilog=f"example: physgen plot {example}")
        if name == "strip":
            sub.add_argument("scenes", metavar="SCENE", nargs="+")
        else:
            sub.add_argument("scene", metavar="SCENE")
        sub.add_argument(
            "-o",
            "--output",
            metavar="FILE",
            type=Path,
            help=f"write here; .png, .svg or .pdf; default: NAME-{name}.png in this folder",
        )
        sub.add_argument(
            "--width",
            metavar="WIDTH",
            type=width,
            help="of the figure: 84 or 84mm for a column, or 1600px",
        )
        sub.add_argument("--dpi", metavar="N", type=positive, help="px an inch of a PNG; default: 300")
        sub.add_argument("--si", action="store_true", help="SI units alone")
        sub.add_argument("--dark", action="store_true", help="light ink on dark paper, for slides")
        return sub

    def objects(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--objects", metavar="NAME,...", type=names, default=[], help="of these objects alone"
        )

    sub = kind(
        "energy",
        "Kinetic, potential and dissipated energy over time, and that their sum stays.",
        "energy scene.yaml -o energy.pdf",
    )
    overlays(sub)
    sub = kind(
        "trajectory",
        "Paths of objects over the photo, with marks of time.",
        "trajectory scene.yaml --objects cue-ball,ball-1 --curves x,y -o paths.pdf",
    )
    objects(sub)
    sub.add_argument(
        "--curves",
        metavar="LIST",
        type=curves,
        default=[],
        help="over time, below the paths: any of x,y,speed,angle",
    )
    overlays(sub)
    sub = kind("contacts", "Who touches whom and when, and how hard.", "contacts scene.yaml -o contacts.pdf")
    objects(sub)
    overlays(sub)
    sub = kind(
        "strip",
        "The photo with red arrows, then frames with their times; a row a scene.",
        "strip scenes/*/scene.yaml --frames 6 --names -o strip.pdf",
    )
    sub.add_argument(
        "--frames",
        metavar="N",
        type=moments,
        default=5,
        help="so many at even times, or which, from 0: 0,12,24; default: 5",
    )
    sub.add_argument(
        "--columns", metavar="N", type=count, help="pictures side by side; default: all of a scene's"
    )
    sub.add_argument("--names", action="store_true", help="write each scene's name beside its row")
    overlays(sub)
