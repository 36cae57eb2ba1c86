"""`physgen evaluate controllability`."""

from __future__ import annotations

import argparse

from physgen.cli.arguments import speeds, turns
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar
from physgen.problems import InputError

ABOUT = "How an object's motion answers to the direction and size of a push."
EXAMPLE = "controllability scenes/curling/scene.yaml --object red-1 --angles 12 -o out/controllability"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scene",
        metavar="SCENE",
        nargs="?",
        default="scenes/curling/scene.yaml",
        help="a scene; default: scenes/curling/scene.yaml",
    )
    parser.add_argument(
        "--object",
        metavar="NAME",
        help="the object that is pushed; default: the one that the scene pushes, or that moves first",
    )
    parser.add_argument(
        "--angles",
        metavar="N",
        type=turns,
        default=8,
        help="directions: all round seen from above, upwards from right to left seen from the side; default: 8",
    )
    parser.add_argument(
        "--sizes",
        metavar="LIST",
        type=speeds,
        default=[],
        help="of the pushes: px/s that they give, e.g. 50,100,200; default: five, up to a third of the canvas",
    )
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="edit a key of the scene"
    )
    parser.add_argument("--variant", metavar="NAME", help="apply a named variant of the file")
    parser.add_argument(
        "--allow-outside", action="store_true", help="files may lie outside the scene's folder"
    )
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
