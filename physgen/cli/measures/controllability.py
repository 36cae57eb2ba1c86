"""`physgen evaluate controllability`."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import Parser, speeds, turns
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar
from physgen.problems import InputError

ABOUT = "How an object's motion answers to the direction and size of a push."
EXAMPLE = "controllability scenes/curling/scene.yaml --object red-1 --angles 12 -o out/controllability"


def add(parser: Parser) -> None:
    scene = "scenes/curling/scene.yaml"
    parser.add_argument("scene", metavar="SCENE", nargs="?", default=scene, help=f"a scene; default: {scene}")
    about = "the object that is pushed; default: the one that the scene pushes, or that moves first"
    parser.option("--object", "NAME", str, about)
    about = "directions: all round seen from above, upwards from right to left seen from the side; default: 8"
    parser.option("--angles", "N", turns, about, 8)
    about = "of the pushes: px/s that they give, e.g. 50,100,200; default: five, up to a third of the canvas"
    parser.option("--sizes", "LIST", speeds, about, [])
    parser.option("--set", "KEY=VALUE", str, "edit a key of the scene", [], action="append")
    parser.option("--variant", "NAME", str, "apply a named variant of the file")
    parser.flag("--allow-outside", "files may lie outside the scene's folder")
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.evaluate.controllability import findings, plot, sweep
    from physgen.evaluate.measure import check_folder

    check_folder(options.output, plots=True)
    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name")
    scene = pipeline.load(options.scene, options.set, options.variant, options.allow_outside)
    bar = Bar()
    swept = sweep(scene, options.object, options.angles, options.sizes, bar.show)
    bar.clear()
    found = findings(swept)
    if options.output:
        found = found.with_parts({found.sections[0].title: (plot(swept),)})
    return hand_over(found, options)
