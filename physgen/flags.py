"""Command line -> parsed options: every command's flags, with an example each."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NoReturn

from physgen import __version__
from physgen.problems import InputError

WRONG_INPUT = 2
FORMATS = ("mp4", "gif", "webp", "png")
DEVICES = ("cpu", "cuda")


class Parser(argparse.ArgumentParser):
    """Wrong flags: one line that says what to do, exit code 2."""

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
        return sub

    sub = command("perceive", "Photo to scene file and assets.", "physgen perceive photo.png > scene.yaml")
    sub.add_argument(
        "image", metavar="IMAGE", type=Path, nargs="*", help="the photo; several go into the folder -o"
    )
    sub.add_argument(
        "--refresh",
        metavar="SCENE",
        type=Path,
        help="perceive a scene's photo again: what the scene says stays, boxes and points that it holds are asked "
        "again, new --box and --point correct or add objects",
    )
    sub.add_argument(
        "--allow-outside",
        action="store_true",
        help="with --refresh: the scene may read files outside its folder",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="SCENE",
        type=Path,
        help="write the scene here (assets beside it); default: stdout",
    )
    sub.add_argument(
        "--masks",
        metavar="FILE",
        type=Path,
        help="label map of the photo's size: an id or colour an object, 0 or black for none",
    )
    sub.add_argument("--coco", metavar="FILE", type=Path, help="COCO annotations that hold the photo's masks")
    sub.add_argument(
        "--box",
        metavar="X,Y,W,H",
        action="append",
        default=[],
        help="an object lies in this box; may be repeated",
    )
    sub.add_argument(
        "--point",
        metavar="X,Y",
        action="append",
        default=[],
        help="an object lies at this point; may be repeated",
    )
    sub.add_argument(
        "--label", metavar="NAME=TEXT", action="append", default=[], help="what an object is; may be repeated"
    )
    sub.add_argument(
        "--side",
        metavar="PX",
        type=_side,
        help="longest side of the scene's photo, px; default: at most 1600",
    )
    sub.add_argument("--assets", metavar="DIR", type=Path, help="folder for the maps")
    sub.add_argument(
        "--sheet",
        metavar="FILE.png",
        type=Path,
        help="draw all that was perceived on one picture, to look at",
    )
    sub.add_argument(
        "--find",
        metavar="NOUN,...",
        type=_nouns,
        default=[],
        help='what to look for, for backends that find what they are told to: "ball, wooden block"',
    )
    _who(sub)
    sub.add_argument(
        "--keep-models",
        action="store_true",
        default=None,
        help="keep models in memory after their step; without it, only where there are several photos",
    )

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
    sub.add_argument("--rate", metavar="HZ", type=_positive, help="samples a second; default: the video's")
    sub.add_argument("--json", action="store_true", help="print everything as JSON")
    _overlays(sub)

    sub = command(
        "render",
        "Scenes to videos, reports and manifests.",
        "physgen render scene.yaml -o out --format mp4,gif",
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument(
        "-o", "--output", metavar="DIR", default="out", help="folder of the results; default: out"
    )
    sub.add_argument(
        "--jobs", metavar="N", type=_count, default=1, help="scenes rendered at a time; default: 1"
    )
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=_formats,
        default=["mp4"],
        help="any of mp4,gif,webp,png; default: mp4",
    )
    sub.add_argument(
        "--chaos",
        action="store_true",
        help="tell in the report how long the motion can be foretold; see simulate",
    )
    sub.add_argument(
        "--device",
        choices=DEVICES,
        default="cpu",
        help="what draws the frames: cuda is an NVIDIA GPU, by way of torch; default: cpu",
    )
    sub.add_argument("--json", action="store_true", help="print the folders as JSON")
    _overlays(sub)

    sub = command(
        "evaluate",
        "Scorecards: how far physgen is from what is known. Exit code 1 when a bar is missed.",
        "physgen evaluate physics --rows 1,5,12",
    )
    _measures(sub.add_subparsers(title="measures", metavar="MEASURE", dest="what", required=True))

    sub = command("backends", "Who can do each step, and what is missing.", "physgen backends --json")
    _who(sub)
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("schema", "The JSON Schema of scene files.", "physgen schema > scene.schema.json")
    sub.add_argument("--markdown", action="store_true", help="the reference page instead")
    return parser


def _who(sub: argparse.ArgumentParser) -> None:
    """Flags that say who perceives, and where."""
    sub.add_argument(
        "--backend",
        metavar="ROLE=NAME[:WEIGHTS]",
        action="append",
        default=[],
        help="who does a step, and the hub id or path of what it loads; see physgen backends",
    )
    sub.add_argument(
        "--profile", metavar="NAME", help="a set of backends: offline, models, best, or one of physgen.toml"
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument("--device", metavar="DEVICE", help="where models run: auto, cpu, cuda, cuda:1 or mps")
    sub.add_argument("--dtype", metavar="TYPE", help="their numbers: auto, float32, float16 or bfloat16")
    sub.add_argument(
        "--fallback",
        action="store_true",
        default=None,
        help="where a backend fails, let the offline one take over, and say so",
    )


def _nouns(text: str) -> list[str]:
    """`a red ball, cup` -> its nouns."""
    return [noun for part in text.split(",") if (noun := part.strip())]


def _measures(measures: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """What `evaluate` measures, each with flags of its own."""

    def measure(name: str, about: str, example: str) -> argparse.ArgumentParser:
        sub = measures.add_parser(
            name, help=about, description=about, epilog=f"example: physgen evaluate {example}"
        )
        form = sub.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="print as JSON")
        form.add_argument("--markdown", action="store_true", help="print as a page")
        return sub

    sub = measure("physics", "Motion against closed forms.", "physics --rows 1,5,12")
    sub.add_argument(
        "--rows", metavar="LIST", type=_rows, default=[], help="some rows, e.g. 1,5,12; default: all"
    )
    sub.add_argument(
        "--draws", metavar="N", type=_count, default=5, help="seeded draws of a row's parameters; default: 5"
    )
    sub.add_argument(
        "--no-convergence",
        action="store_true",
        help="only at default settings, not at 240 to 1920 steps a second",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="keep every scene file that is run in this folder",
    )
    sub.add_argument("--jobs", metavar="N", type=_count, help="draws run at a time; default: one a processor")

    sub = measure("fidelity", "Frames against the studio's truth videos.", "fidelity --scenes curling,shelf")
    sub.add_argument(
        "--truth",
        metavar="DIR",
        type=Path,
        default=Path("studio/truth"),
        help="the studio's truth; default: studio/truth",
    )
    sub.add_argument(
        "--scenes",
        metavar="LIST",
        type=lambda t: t.split(","),
        default=[],
        help="some scenes, e.g. curling,shelf",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="only write strips of frames there: the paper's way, ours and the truth",
    )

    sub = measure(
        "segmentation",
        "Objects found in photos against their true masks, as COCO counts them.",
        "segmentation photos -o out/segmentation --recall 0.8",
    )
    sub.add_argument(
        "folder",
        metavar="FOLDER",
        type=Path,
        help="photos with label maps: NAME.png and NAME.labels.png, folders of photo.png and masks.png, "
        "or a COCO file (*.json) with its photos",
    )
    sub.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="who segments: segment=NAME"
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=Path,
        help="write plots, the result as JSON and every photo with what was found in this folder",
    )
    for name, what in (
        ("precision", "the share of what is said that is right"),
        ("recall", "the share of true objects that is found"),
        ("iou", "the mean overlap of what is found"),
    ):
        sub.add_argument(f"--{name}", metavar="BAR", type=_part, help=f"least for {what}, 0 to 1")


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


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0 and up to 1000000")
    return value


def _part(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 0 to 1")
    return value


def _side(text: str) -> int:
    if not text.isdecimal() or not 16 <= int(text) <= 100_000:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 16 to 100000")
    return int(text)


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 1024")
    return int(text)


def _rows(text: str) -> list[int]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and len(part) < 6 for part in parts):
        raise argparse.ArgumentTypeError(f"{text} is not a list of numbers, e.g. 1,5,12")
    return [int(part) for part in parts]


def _formats(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in FORMATS]
    if wrong:
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)} is not among {', '.join(FORMATS)}")
    return list(dict.fromkeys(names))


def _numbers(flag: str, text: str, count: int) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(v) < 1e6 for v in values):
        form = ",".join(("120", "80", "60", "60")[:count])
        raise InputError.of(flag, f'"{text}"', f"is not {count} numbers", f"write e.g. {form}")
    return values


def four(flag: str, text: str) -> tuple[float, float, float, float]:
    """`x,y,w,h` px; raises InputError."""
    a, b, c, d = _numbers(flag, text, 4)
    return a, b, c, d


def two(flag: str, text: str) -> tuple[float, float]:
    """`x,y` px; raises InputError."""
    a, b = _numbers(flag, text, 2)
    return a, b


def scene_name(output: Path | None) -> None:
    """Refuses what would overwrite a photo, or leave a scene that no command reads."""
    if output is not None and (output.suffix not in (".yaml", ".yml") or output.is_dir()):
        raise InputError.of(
            "-o",
            f'"{output}"',
            "is no name for a scene file",
            "end it in .yaml; without -o it goes to stdout",
        )
