"""`refine`: a video and masks to a refined video."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from physgen.cli.printing import OK, Bar, print_json, tell, tell_kept, tell_one
from physgen.crew import FLAG, choice
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.crew import Plan


def refine(options: argparse.Namespace) -> int:
    from physgen.flags.refining import KEYS
    from physgen.refine_video import refine_video
    from physgen.scene.freeze import refinement
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
            warn=tell_one,
            keep=tell_kept,
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
    from physgen.configured import plan
    from physgen.refine_video import BACKEND, ROLE

    flag = [f"{ROLE}={options.backend.removeprefix(f'{ROLE}=')}"] if options.backend else []
    whole = plan(flag, config=options.config, device=options.device, dtype=options.dtype)
    who = whole.choices.get(ROLE) or choice(ROLE, BACKEND)
    if ROLE in whole.choices and not options.backend:
        tell(f"{who.place.file}: says who refines, where no flag does")
    if who.name == "none":
        fix = "name who refines, e.g. --backend animatediff; physgen backends lists them"
        raise InputError.of(str(who.place), '"none"', "leaves the video as it is", fix)
    return replace(whole, choices={ROLE: who}, fallback=False)
