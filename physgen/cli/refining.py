"""`refine`: a video and masks to a refined video."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from physgen.cli.printing import OK, Bar, print_json, tell, tell_kept, tell_one
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.crew import Plan


def refine(options: argparse.Namespace) -> int:
    from physgen.crew import Crew
    from physgen.flags.refining import KEYS
    from physgen.refine_video import ROLE, refine_video
    from physgen.scene.freeze import refinement
    from physgen.scene.schema import at, with_defaults

    said = {key: value for key in KEYS if (value := getattr(options, key)) is not None}
    plan = _plan(options)
    said["backend"] = plan.choices[ROLE].name
    crew = Crew(plan)
    bar = Bar()
    try:
        done = refine_video(
            options.video,
            options.masks,
            options.output,
            refinement(with_defaults(said, at("refine"))),
            crew,
            keep_first=options.keep_first,
            fps=options.fps,
            command=options.command_line,
            progress=bar.show,
            warn=tell_one,
            keep=tell_kept,
        )
    finally:
        crew.close()
        bar.clear()
    if options.json:
        print_json({"output": str(done.output), "record_path": str(done.record_path), "record": done.record})
    else:
        print(done.output)
    return OK


def _plan(options: argparse.Namespace) -> Plan:
    """Who refines: the flag's, else the configuration's, else the default; nobody else is asked for anything."""
    from dataclasses import replace

    from physgen.configured import found, plan
    from physgen.crew import choice
    from physgen.refine_video import BACKEND, ROLE

    if options.config is None:
        for path in found():
            tell(f"{path}: says who refines, where no flag does")
    flag = [f"{ROLE}={options.backend.removeprefix(f'{ROLE}=')}"] if options.backend else []
    whole = plan(flag, config=options.config, device=options.device, dtype=options.dtype)
    who = whole.choices.get(ROLE) or choice(ROLE, BACKEND)
    if who.name == "none":
        fix = "name who refines, e.g. --backend animatediff; physgen backends lists them"
        raise InputError.of(str(who.place), '"none"', "leaves the video as it is", fix)
    return replace(whole, choices={ROLE: who}, fallback=False)
