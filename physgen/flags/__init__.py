"""Command line -> parsed options: every command's flags, with an example each."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from physgen import __version__
from physgen.flags.clusters import clusters
from physgen.flags.exhibiting import exhibit
from physgen.flags.exporting import exports, labels
from physgen.flags.gathering import dataset
from physgen.flags.measures import measures
from physgen.flags.packing import pack, unpack
from physgen.flags.perceiving import perceive, who
from physgen.flags.plots import plots
from physgen.flags.refining import refine
from physgen.flags.sweeping import sweep
from physgen.flags.values import count, draws, formats, four, place, positive, scene_name, seed, two
from physgen.flags.verifying import verify

__all__ = ["WRONG_INPUT", "build_parser", "four", "joined", "scene_name", "two"]

WRONG_INPUT = 2
DEVICES = ("cpu", "cuda")
MIXED = ("sweep",)
"""Commands that take flags between their arguments."""
REPORTS = ("full", "plain", "none")


class Parser(argparse.ArgumentParser):
    """Wrong flags: one line that says what to do, exit code 2."""

    mixed = False
    """Whether flags may stand between arguments."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse does, which by itself takes all arguments of one kind in one go."""
        if not self.mixed:
            return super().parse_known_args(args, namespace)
        self.mixed = False
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self.mixed = True

    def error(self, message: str) -> NoReturn:
        """Print the message and a hint."""
        self.exit(WRONG_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def joined(arguments: list[str]) -> list[str]:
    """`--point -1,3` as `--point=-1,3`: argparse takes a value that begins with - for a flag.

    >>> joined(["perceive", "a.png", "--point", "-1,3"])
    ['perceive', 'a.png', '--point=-1,3']
    """
    result: list[str] = []
    for argument in arguments:
        if (
            result
            and result[-1] in ("--box", "--point")
            and argument[:1] == "-"
            and argument[1:2].isdecimal()
        ):
            result[-1] += f"={argument}"
        else:
            result.append(argument)
    return result


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
        sub = commands.add_parser(name, help=about, description=about, epilog=f"example: {example}")
        sub.set_defaults(command=name)
        sub.mixed = name in MIXED
        return sub

    sub = command("perceive", "Photo to scene file and assets.", "physgen perceive photo.png > scene.yaml")
    perceive(sub)

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
        "check", "Problems and warnings of scene files.", "physgen check scenes/*/scene.yaml --strict"
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument("--strict", action="store_true", help="warnings count as errors")
    sub.add_argument(
        "--resolved", action="store_true", help="print the scene with overlays applied and defaults filled in"
    )
    sub.add_argument("--json", action="store_true", help="print problems as JSON")
    _overlays(sub)

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
    _overlays(sub)

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
    _making(sub)
    sub.add_argument(
        "--watch", action="store_true", help="render again whenever the scene or what it reads is saved"
    )
    _overlays(sub)

    sub = command(
        "sweep",
        "A scene at the points of a grid or with random draws: a folder of clips, and a table of what became of each.",
        "physgen sweep scene.yaml objects.ball.velocity.0=100:900:9 'objects.*.elasticity=0.2,0.9' -o sweep",
    )
    sweep(sub)
    _making(sub)
    _overlays(sub)

    sub = command(
        "export",
        "Scenes to ground truth: flow, masks, tracks and events, in the formats that other tools read.",
        "physgen export scene.yaml --format flo,events,conditioning --frames 49 --size 832x480 --fps 16 -o labels",
    )
    exports(sub)
    _overlays(sub)

    sub = command(
        "dataset",
        "Clips that are there to a data set for training: a folder, or WebDataset shards; split by photo.",
        "physgen dataset out sweep -o data --layout webdataset",
    )
    dataset(sub)

    sub = command(
        "refine",
        "A video and masks of its objects to a video that a diffusion model retouched; see docs/refinement.md.",
        "physgen refine clip.mp4 --masks masks -o clip.refined.mp4",
    )
    refine(sub)

    sub = command(
        "gallery",
        "Folders of clips to one page that shows them all; a sweep by its axes.",
        "physgen gallery out sweep -o gallery.html",
    )
    exhibit(sub)

    sub = command(
        "evaluate",
        "Scorecards: how far physgen is from what is known. Exit code 1 when a bar is missed.",
        "physgen evaluate physics --rows 1,5,12",
    )
    measures(sub.add_subparsers(title="measures", metavar="MEASURE", dest="what", required=True))

    sub = command(
        "plot", "Figures for papers, as PNG, SVG or PDF.", "physgen plot strip scene.yaml -o strip.pdf"
    )
    plots(sub.add_subparsers(title="kinds", metavar="KIND", dest="what", required=True), _overlays)

    sub = command(
        "verify",
        "Render clips again and compare: what differs first, and by how much. Exit code 1 when something differs.",
        "physgen verify out --jobs 2",
    )
    verify(sub)

    sub = command(
        "pack",
        "A scene with all that it reads to one file.",
        "physgen pack scene.yaml -o scene.physgen",
    )
    pack(sub)

    sub = command("unpack", "The files of a pack to a folder.", "physgen unpack scene.physgen -o scene")
    unpack(sub)

    sub = command("cache", "What is kept between runs: how much, and clear it.", "physgen cache show")
    sub.add_argument(
        "what",
        choices=("show", "clear"),
        metavar="{show,clear}",
        help="show: where, how much, at most; clear: remove it",
    )
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("backends", "Who can do each step, and what is missing.", "physgen backends --json")
    who(sub)
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("schema", "The JSON Schema of scene files.", "physgen schema > scene.schema.json")
    sub.add_argument("--markdown", action="store_true", help="the reference page instead")
    return parser


def _making(sub: argparse.ArgumentParser) -> None:
    """How clips are made."""
    sub.add_argument(
        "--jobs", metavar="N", type=count, default=1, help="scenes rendered at a time; default: 1"
    )
    clusters(sub)
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=formats,
        default=["mp4"],
        help="any of mp4,gif,webp,png; default: mp4",
    )
    sub.add_argument(
        "--chaos",
        action="store_true",
        help="tell in the report how long the motion can be foretold; see simulate",
    )
    sub.add_argument(
        "--fan",
        metavar="N",
        type=draws,
        default=0,
        help="simulate N draws of what `from` is unsure of: which outcomes does the photo decide? see docs/fan.md",
    )
    sub.add_argument("--fan-seed", metavar="S", type=seed, default=0, help="of the draws; default: 0")
    sub.add_argument(
        "--device",
        choices=DEVICES,
        default="cpu",
        help="what draws the frames: cuda is an NVIDIA GPU, by way of torch; default: cpu",
    )
    sub.add_argument(
        "--refine",
        metavar="NAME[:WEIGHTS]",
        help="a video diffusion model retouches the clip: animatediff, wan, cogvideox, or none; see physgen backends",
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument(
        "--report",
        choices=REPORTS,
        help="full (the default); plain: without player, charts and what was perceived, which takes less time than a "
        "short clip; none",
    )
    sub.add_argument(
        "--export",
        metavar="LIST",
        type=labels,
        default=(),
        help="ground truth beside the clip, in truth/: any of the formats of physgen export",
    )
    sub.add_argument(
        "--single-file",
        action="store_true",
        help="put the video into report.html, which can then be mailed alone",
    )
    sub.add_argument(
        "--preview",
        action="store_true",
        help="a quick look: at most 24 frames as large as the photo, without a report",
    )
    sub.add_argument(
        "--no-cache",
        dest="cache",
        action="store_false",
        help="make clips again that are there, and neither read nor keep results of stages",
    )
    sub.add_argument("--json", action="store_true", help="print a line of JSON a clip, and one at the end")


def _overlays(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="edit a key: objects.ball-1.mass=200; * stands for every object",
    )
    sub.add_argument("--variant", metavar="NAME", help="apply a named variant of the file, or all")
    sub.add_argument(
        "--allow-outside", action="store_true", help="let the scene read files outside its folder"
    )
