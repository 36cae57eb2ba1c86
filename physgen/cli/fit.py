"""Run `fit`: estimate the physics of a scene from a filmed clip or tracks."""

from __future__ import annotations

import argparse
from pathlib import Path

import physgen.fit
from physgen.cli.arguments import Command, Parser, names, positive, seed
from physgen.cli.output import OK, Bar, print_error, print_line, print_problem
from physgen.messages import Message

REPORTS = ("full", "none")


def fit(options: argparse.Namespace) -> int:
    _check_files(options)
    # Without --output the scene itself stays unchanged, so that both can be compared.
    output = options.output
    if not output:
        output = options.scene.with_name(f"{options.scene.stem}-fitted.yaml")
    bar = Bar()
    request = physgen.fit.run.FitOptions(
        scene=options.scene,
        output=output,
        clip=options.clip,
        tracks=options.tracks,
        kinds=physgen.fit.run.kinds_of(options.free),
        slowdown=options.slow,
        seed=options.seed,
        allow_outside=options.allow_outside,
        has_report=options.report != "none",
    )
    with bar.ticking():
        result = physgen.fit.run.fit_files(request, bar.aside(print_problem), bar.show)
        bar.clear()
    for line in physgen.fit.run.interval_lines(result):
        print_error(f"  {line}")
    if result.fit.flat_directions:
        print_error("this clip cannot determine:")
    for line in result.fit.flat_directions:
        print_error(f"  {line}")
    if result.report is not None:
        print_error(f"report: {result.report}")
    print_line(str(output))
    return OK


def _check_files(options: argparse.Namespace) -> None:
    """Raise InputError unless there is a scene, and either a clip or tracks."""
    if (options.clip is None) == (options.tracks is None):
        raise Message.FIT_NEEDS_FILM.error("fit")
    for path in (options.scene, options.clip, options.tracks):
        if path is not None and not path.exists():
            raise Message.FIT_FILE_MISSING.error(str(path))
    if options.tracks is not None and options.slow != 1.0:
        raise Message.FIT_SLOW_TRACKS.error("--slow", f"{options.slow:g}")


def add(parser: Parser) -> None:
    help_text = "the scene file of the clip's first frame"
    parser.add_argument("scene", metavar="SCENE", type=Path, help=help_text)
    help_text = "a film of the scene, whose first frame is the photo"
    parser.add_argument("clip", metavar="CLIP", type=Path, nargs="?", help=help_text)
    help_text = (
        "a table with time, object, x, y and angle (s, px, degrees), in place of a clip"
    )
    parser.option("--tracks", "FILE", Path, help_text)
    help_text = "the fitted scene; its report goes into a folder of that name; default: SCENE-fitted.yaml"
    parser.option("-o --output", "FILE", Path, help_text)
    help_text = (
        "what is estimated: velocity, spin, friction, elasticity, rolling, mass, table, "
        "direction (of gravity), gravity (its size, too); default: all but gravity"
    )
    parser.option("--free", "LIST", names, help_text, ())
    help_text = "how many times slower than life the clip plays; default: 1"
    parser.option("--slow", "N", positive, help_text, 1.0)
    parser.option("--seed", "N", seed, "seed of the random starts; default: 0", 0)
    help_text = "full (the default), or none"
    parser.add_argument("--report", choices=REPORTS, default="full", help=help_text)
    help_text = "read files outside the scene's folder"
    parser.flag("--allow-outside", help_text)


FIT = Command(
    "fit",
    "Estimates a scene's physics from a filmed clip or from tracks.",
    "physgen fit scene.yaml clip.mp4 -o fitted.yaml",
    add,
    fit,
)
