"""`refine`: a video and masks to a refined video."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.arguments import Command, Parser, of, positive
from physgen.cli.output import OK, Bar, print_backup, print_error, print_json, print_problem
from physgen.problems import InputError
from physgen.scene.schema import at

if TYPE_CHECKING:
    from physgen.registry import Plan


def refine(options: argparse.Namespace) -> int:
    from physgen.pipeline.refine_video import VideoJob, refine_video
    from physgen.registry import FLAG
    from physgen.scene.load import refinement
    from physgen.scene.schema import with_defaults

    plan = _plan(options)
    given = {key: value for key in KEYS if (value := getattr(options, key)) is not None}
    bar = Bar()
    try:
        job = VideoJob(
            options.video,
            refinement(with_defaults(given, at("refine"))),
            options.masks,
            options.output,
            keep_first=options.keep_first,
            fps=options.fps,
            command=options.command_line,
        )
        done = refine_video(job, plan, bar.show, print_problem, print_backup)
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
    """The plan with one backend: the flag's, else the configuration's, else the default."""
    from physgen.pipeline.refine_video import BACKEND, ROLE
    from physgen.registry import choice, load_plan

    flag = [f"{ROLE}={options.backend.removeprefix(f'{ROLE}=')}"] if options.backend else []
    whole = load_plan(flag, config=options.config, device=options.device, dtype=options.dtype)
    chosen = whole.choices.get(ROLE) or choice(ROLE, BACKEND)
    if ROLE in whole.choices and not options.backend:
        print_error(f"{chosen.place.file}: chooses the backend that refines, unless a flag does")
    if chosen.name == "none":
        fix = "name a backend, e.g. --backend animatediff; physgen backends lists them"
        raise InputError.of(str(chosen.place), '"none"', "leaves the video as it is", fix)
    return replace(whole, choices={ROLE: chosen})


KEYS = ("strength", "stop", "steps", "seed", "prompt", "negative", "guidance", "lock", "detail")
"""Of `refine:`, as flags; the schema has their ranges, defaults and help."""
LETTERS = {"number": "X", "integer": "N", "string": "TEXT"}


def add(parser: Parser) -> None:
    about = "mp4, mov, gif, webp ..., or a folder with one picture for each frame"
    parser.add_argument("video", metavar="VIDEO", type=Path, help=about)
    about = (
        "masks of the objects: a folder with one picture for each frame, or one picture for all frames; grey "
        "of 8 bits is coverage, of 16 bits, palettes and colours distinguish objects; without it all pixels may change"
    )
    parser.option("--masks", "DIR", Path, about)
    about = (
        "the refined video, .mp4, .gif or .webp, or a folder for PNG frames; a record goes beside it as .json; "
        "default: VIDEO-STEM.refined.mp4 in the current folder"
    )
    parser.option("-o --output", "OUT", Path, about)
    about = (
        "the model, and the hub id or path of its weights; see physgen backends; default: animatediff, or the one in "
        "~/.config/physgen/physgen.toml"
    )
    parser.option("--backend", "NAME[:WEIGHTS]", str, about)
    for key in KEYS:
        part = at(f"refine.{key}")
        default = f" Default: {part['default']}." if part.get("default", "") != "" else ""
        # a scene knows its objects' labels, a video does not
        about = "Text prompt for the model. Default: none." if key == "prompt" else part["description"]
        text = f"{about}{default}".replace("%", "%%")
        parser.option(f"--{key}", LETTERS[part["type"]], of(part), text)
    parser.flag("--keep-first", "keep the first frame; the following ones depart from it slowly")
    parser.option("--fps", "RATE", positive, "frames per second of the result; default: as the video's")
    parser.option("--config", "FILE", Path, "read this in place of ~/.config/physgen/physgen.toml")
    parser.option("--device", "DEVICE", str, "where the model runs: auto, cpu, cuda, cuda:1 or mps")
    parser.option("--dtype", "TYPE", str, "its number type: auto, float32, float16 or bfloat16")
    parser.flag("--json", "print the output's path and the record as JSON")


REFINE = Command(
    "refine",
    "Refines a video by a diffusion model, given masks of its objects; see docs/models.md.",
    "physgen refine clip.mp4 --masks masks -o clip.refined.mp4",
    add,
    refine,
)
