"""`plot`: figures for papers."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.printing import OK, Bar
from physgen.problems import InputError


def plot(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.pipeline.plotting import Asked
    from physgen.pipeline.plotting import plot as draw
    from physgen.report.plots.look import Look

    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name")
    scenes = options.scenes if options.what == "strip" else [options.scene]
    millimetres, pixels = options.width or (None, None)
    look = Look(millimetres, pixels, options.dpi, options.dark, options.si)
    asked = Asked(
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
