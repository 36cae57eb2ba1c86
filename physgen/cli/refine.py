"""`refine`: a video and masks to a refined video."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import of, positive
from physgen.cli.output import OK, Bar, print_backup, print_error, print_json, print_problem
from physgen.problems import InputError
from physgen.registry import FLAG, choice
from physgen.scene.schema import at

if TYPE_CHECKING:
    from physgen.registry import Plan


# ----------------------------------------------------------------------
# `refine`: a video and masks to a refined video.


def refine(options: argparse.Namespace) -> int:
    from physgen.pipeline.refine_video import refine_video
    from physgen.scene.load import refinement
    from physgen.scene.schema import at, with_defaults

    plan = _plan(options)
    said = {key: value for key in KEYS if (value := getattr(options, key)) is not None}
    bar = Bar()
    try:
        done = refine_video(
            options.video,
            options.masks,
            options.output,
            refinement(with_defaults(said, at("refine"))),
            plan,
            keep_first=options.keep_first,
            fps=options.fps,
            command=options.command_line,
            progress=bar.show,
            warn=print_problem,
            keep=print_backup,
        )
    except InputError as error:  # what render calls --refine is --backend here
        raise InputError(
            [replace(p, place=FLAG) if p.place.file == "--refine" else p for p in error.problems]
        ) from None
    finally:
        bar.clear()
    if options.json:
        print_json({"output": str(done.output), "record_path": str(done.record_path), "record": done.record})
    else:
        print(done.output)
    return OK


def _plan(options: argparse.Namespace) -> Plan:
    """Who refines: the flag's, else the configuration's, else the default; nobody else is asked for anything."""
    from physgen.pipeline.refine_video import BACKEND, ROLE
    from physgen.registry import load_plan

    flag = [f"{ROLE}={options.backend.removeprefix(f'{ROLE}=')}"] if options.backend else []
    whole = load_plan(flag, config=options.config, device=options.device, dtype=options.dtype)
    who = whole.choices.get(ROLE) or choice(ROLE, BACKEND)
    if ROLE in whole.choices and not options.backend:
        print_error(f"{who.place.file}: says who refines, where no flag does")
    if who.name == "none":
        fix = "name who refines, e.g. --backend animatediff; physgen backends lists them"
        raise InputError.of(str(who.place), '"none"', "leaves the video as it is", fix)
    return replace(whole, choices={ROLE: who}, fallback=False)


# ----------------------------------------------------------------------
# Flags of `refine`; what a scene's `refine:` says is told by the schema, ranges and defaults too.

KEYS = ("strength", "stop", "steps", "seed", "prompt", "negative", "guidance", "lock", "detail")
"""Of `refine:`, as flags."""
LETTERS = {"number": "X", "integer": "N", "string": "TEXT"}


def add_refine(sub: argparse.ArgumentParser) -> None:
    """Those of the command."""
    sub.add_argument(
        "video",
        metavar="VIDEO",
        type=Path,
        help="mp4, mov, gif, webp ..., or a folder of one picture a frame",
    )
    sub.add_argument(
        "--masks",
        metavar="DIR",
        type=Path,
        help="where objects are: a folder of one picture a frame, a video, or one picture for all frames; grey of 8 "
        "bits is coverage, of 16 bits, palettes and colours tell objects apart; without it everything may change",
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        type=Path,
        help="the refined video, .mp4, .gif or .webp, or a folder for PNG frames; a record goes beside it as .json; "
        "default: VIDEO-STEM.refined.mp4 in the current folder",
    )
    sub.add_argument(
        "--backend",
        metavar="NAME[:WEIGHTS]",
        help="who refines, and the hub id or path of what it loads; see physgen backends; default: animatediff, or "
        "what physgen.toml says",
    )
    for key in KEYS:
        part = at(f"refine.{key}")
        default = f" Default: {part['default']}." if part.get("default", "") != "" else ""
        about = NO_LABELS if key == "prompt" else part["description"]
        sub.add_argument(
            f"--{key}",
            metavar=LETTERS[part["type"]],
            type=of(part),
            help=f"{about}{default}".replace("%", "%%"),
        )
    sub.add_argument(
        "--keep-first",
        action="store_true",
        help="the first frame stays as it is; what follows leaves it slowly",
    )
    sub.add_argument(
        "--fps", metavar="RATE", type=positive, help="frames a second of the result; default: as the video's"
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument(
        "--device", metavar="DEVICE", help="where the model runs: auto, cpu, cuda, cuda:1 or mps"
    )
    sub.add_argument("--dtype", metavar="TYPE", help="its numbers: auto, float32, float16 or bfloat16")
    sub.add_argument("--json", action="store_true", help="print the output's path and the record as JSON")


NO_LABELS = "What the model is told that the video shows. Default: nothing."
"""A scene knows its objects' labels, a video does not."""
