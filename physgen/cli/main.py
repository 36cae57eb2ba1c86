"""The command line: all commands, their dispatch and their exit codes."""

from __future__ import annotations

import argparse
import io
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from physgen import __version__
from physgen.cli.arguments import WRONG_INPUT, Parser, joined, place, positive
from physgen.cli.cache import cache
from physgen.cli.clips import add_clips, add_overlays
from physgen.cli.dataset import add_dataset, dataset
from physgen.cli.edit import add_edit, edit
from physgen.cli.evaluate import evaluate
from physgen.cli.export import add_export, export
from physgen.cli.gallery import add_gallery, gallery
from physgen.cli.output import FAILED, INTERRUPTED, OK, print_error, print_json, print_problems
from physgen.cli.pack import add_pack, add_unpack, pack, unpack
from physgen.cli.perceive import add_backends, add_perceive, import_, list_backends, perceive
from physgen.cli.plot import add_plot, plot
from physgen.cli.refine import add_refine, refine
from physgen.cli.render import render
from physgen.cli.simulate import check, simulate
from physgen.cli.sweep import add_sweep, sweep
from physgen.cli.verify import add_verify, verify
from physgen.files import final_name
from physgen.problems import InputError
from physgen.signals import install_handler

# ----------------------------------------------------------------------
# Command line -> parsed options: every command's flags, with an example each.

MIXED = ("perceive", "check", "render", "sweep", "export", "dataset", "gallery", "verify")
"""Commands that take several arguments, and flags between them."""


def build_parser() -> argparse.ArgumentParser:
    """Every command with its flags and an example."""
    parser = Parser(
        prog="physgen",
        description="One photo becomes an editable scene file; the scene file becomes a physically true video.",
        epilog="example: physgen perceive photo.png > scene.yaml && physgen render scene.yaml",
    )
    parser.add_argument("--version", action="version", version=f"physgen {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def command(name: str, about: str, example: str) -> argparse.ArgumentParser:
        parser.commands[name] = sub = commands.add_parser(
            name, help=about, description=about, epilog=f"example: {example}"
        )
        sub.set_defaults(command=name)
        sub.mixed = name in MIXED
        return sub

    sub = command("perceive", "Photo to scene file and assets.", "physgen perceive photo.png > scene.yaml")
    add_perceive(sub)

    sub = command(
        "import",
        "Somebody else's files to a scene.",
        "physgen import physgen data/pool -o pool.yaml",
    )
    sub.add_argument(
        "kind", choices=("physgen", "coco"), help="physgen: a folder of the paper's code; coco: annotations"
    )
    sub.add_argument("path", metavar="PATH", type=Path, help="the folder or file")
    sub.add_argument(
        "--image", type=Path, help="coco: the photo; default: the file that the annotations name"
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="SCENE",
        type=Path,
        help="write the scene here (assets beside it); default: stdout",
    )

    sub = command(
        "edit",
        "A scene, or a photo that is perceived first, in the browser: push things and watch; see docs/editing.md.",
        "physgen edit scene.yaml",
    )
    add_edit(sub)

    sub = command(
        "check", "Problems and warnings of scene files.", "physgen check scenes/*/scene.yaml --strict"
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument("--strict", action="store_true", help="warnings count as errors")
    sub.add_argument(
        "--resolved", action="store_true", help="print the scene with overlays applied and defaults filled in"
    )
    sub.add_argument("--json", action="store_true", help="print problems as JSON")
    add_overlays(sub)

    sub = command("simulate", "Scene to trajectory.", "physgen simulate scene.yaml -o trajectory.npz")
    sub.add_argument("scene", metavar="SCENE")
    sub.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        type=Path,
        help="write here; .npz, .csv or .json; default: CSV on stdout",
    )
    sub.add_argument(
        "--chaos",
        action="store_true",
        help="run it again a hair apart, with half the step and other sweeps: when do the runs part by a pixel?",
    )
    sub.add_argument("--rate", metavar="HZ", type=positive, help="samples a second; default: the video's")
    sub.add_argument("--json", action="store_true", help="print everything as JSON")
    add_overlays(sub)

    sub = command(
        "render",
        "Scenes to videos, reports and manifests.",
        "physgen render scene.yaml -o out --format mp4,gif",
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+", type=place, help="a file, a pack, or a URL")
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=place,
        default="out",
        help="folder of the results, or its URL; default: out",
    )
    add_clips(sub)
    sub.add_argument(
        "--watch", action="store_true", help="render again whenever the scene or what it reads is saved"
    )
    add_overlays(sub)

    sub = command(
        "sweep",
        "A scene at the points of a grid or with random draws: a folder of clips, and a table of what became of each.",
        "physgen sweep scene.yaml objects.ball.velocity.0=100:900:9 'objects.*.elasticity=0.2,0.9' -o sweep",
    )
    add_sweep(sub)
    add_clips(sub)
    add_overlays(sub)

    sub = command(
        "export",
        "Scenes to ground truth: flow, masks, tracks and events, in the formats that other tools read.",
        "physgen export scene.yaml --format flo,events,conditioning --frames 49 --size 832x480 --fps 16 -o labels",
    )
    add_export(sub)
    add_overlays(sub)

    sub = command(
        "dataset",
        "Clips that are there to a data set for training: a folder, or WebDataset shards; split by photo.",
        "physgen dataset out sweep -o data --layout webdataset",
    )
    add_dataset(sub)

    sub = command(
        "refine",
        "A video and masks of its objects to a video that a diffusion model retouched; see docs/refinement.md.",
        "physgen refine clip.mp4 --masks masks -o clip.refined.mp4",
    )
    add_refine(sub)

    sub = command(
        "gallery",
        "Folders of clips to one page that shows them all; a sweep by its axes.",
        "physgen gallery out sweep -o gallery.html",
    )
    add_gallery(sub)

    sub = command(
        "evaluate",
        "Scorecards: how far physgen is from what is known. Exit code 1 when a bar is missed.",
        "physgen evaluate physics --rows 1,5,12",
    )
    from physgen.cli.evaluate import measures

    measures(sub.add_subparsers(title="measures", metavar="MEASURE", dest="what", required=True))

    sub = command(
        "plot", "Figures for papers, as PNG, SVG or PDF.", "physgen plot strip scene.yaml -o strip.pdf"
    )
    add_plot(sub.add_subparsers(title="kinds", metavar="KIND", dest="what", required=True), add_overlays)

    sub = command(
        "verify",
        "Render clips again and compare: what differs first, and by how much. Exit code 1 when something differs.",
        "physgen verify out --jobs 2",
    )
    add_verify(sub)

    sub = command(
        "pack",
        "A scene with all that it reads to one file.",
        "physgen pack scene.yaml -o scene.physgen",
    )
    add_pack(sub)

    sub = command("unpack", "The files of a pack to a folder.", "physgen unpack scene.physgen -o scene")
    add_unpack(sub)

    sub = command("cache", "What is kept between runs: how much, and clear it.", "physgen cache show")
    sub.add_argument(
        "what",
        choices=("show", "clear"),
        metavar="{show,clear}",
        help="show: where, how much, at most; clear: remove it",
    )
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("backends", "Who can do each step, and what is missing.", "physgen backends --json")
    add_backends(sub)
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("schema", "The JSON Schema of scene files.", "physgen schema > scene.schema.json")
    sub.add_argument("--markdown", action="store_true", help="the reference page instead")
    return parser


# ----------------------------------------------------------------------
# Command line -> exit code. The only room that prints: results to stdout, everything else to stderr.

BATCHES = ("render", "sweep", "export", "verify")
"""Commands that make many things, and that a program reads."""
UNREAD = 141
"""As of a program that nobody reads any more (128 + SIGPIPE): not all was made."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `physgen`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    options = build_parser().parse_args(joined(given))
    options.command_line = ["physgen", *given]
    with suppress(ValueError):  # not the main thread: then nobody stops us that way
        signal.signal(signal.SIGTERM, _stop)
    install_handler()
    try:
        return COMMANDS[options.command](options)
    except InputError as error:
        print_problems(error.problems)
        if getattr(options, "json", False) and options.command in BATCHES:
            print_json({"passed": False, "problems": [problem.as_dict() for problem in error.problems]})
        return WRONG_INPUT
    except KeyboardInterrupt:
        print_error("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return UNREAD if options.command in BATCHES else OK
    except OSError as error:
        where = f"{final_name(str(error.filename))}: " if error.filename else ""
        print_error(f"{where}{error.strerror or error}")
        return FAILED


def _stop(number: int, frame: object) -> None:
    """Ended from outside: leave as by Ctrl-C, with nothing half-written."""
    raise KeyboardInterrupt


def schema(options: argparse.Namespace) -> int:
    if options.markdown:
        from physgen.scene.reference import markdown

        sys.stdout.write(markdown())
    else:
        from physgen.files import resource

        sys.stdout.write(resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8"))
    return OK


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "perceive": perceive,
    "import": import_,
    "edit": edit,
    "check": check,
    "simulate": simulate,
    "render": render,
    "sweep": sweep,
    "export": export,
    "dataset": dataset,
    "refine": refine,
    "gallery": gallery,
    "evaluate": evaluate,
    "plot": plot,
    "verify": verify,
    "pack": pack,
    "unpack": unpack,
    "cache": cache,
    "backends": list_backends,
    "schema": schema,
}
