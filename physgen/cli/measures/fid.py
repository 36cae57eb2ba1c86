"""`evaluate fid`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar, tell_problems
from physgen.problems import InputError, Place, Problem


def fid(options: argparse.Namespace) -> int:
    import cv2

    from physgen.evaluate.fid import told
    from physgen.evaluate.fid.fitted import Fit, Rule
    from physgen.evaluate.fid.measure import IMAGE, MOTION, REFERENCE, Settings, measure
    from physgen.evaluate.fid.motion import Normalise
    from physgen.evaluate.fid.sides import Source, sources
    from physgen.evaluate.page import check_folder

    if options.output:
        from physgen.report.plots.look import needed

        check_folder(options.output)
        needed()
    named = methods(options)
    problems: list[Problem] = []
    clips: dict[str, list[Source]] = {}
    for name, paths in {REFERENCE: options.reference, **named}.items():
        try:
            clips[name] = sources(paths)
        except InputError as error:
            problems += error.problems
    made: dict[str, Any] = {}
    for role in ("features", "flow"):
        try:
            made[role] = backend(role, getattr(options, role), options.device)
        except InputError as error:
            problems += error.problems
    problems += _no_model(options)
    if problems:
        raise InputError(dict.fromkeys(problems))
    colour = options.full_colour
    settings = Settings(
        Rule(options.size, Fit(options.fit), options.frames),
        Normalise(colour) if isinstance(colour, str) else colour,
        (IMAGE, MOTION) if options.only is None else (options.only,),
        options.draws,
        options.seed,
    )
    bar = Bar()
    truth = clips.pop(REFERENCE)
    clips = {name: [replace(one, skip=options.skip) for one in side] for name, side in clips.items()}
    try:
        found = measure(truth, clips, made["features"], made["flow"], settings, bar.show)
    except (MemoryError, cv2.error) as error:
        if isinstance(error, cv2.error) and error.code != cv2.Error.StsNoMem:
            raise
        expected = "makes frames that do not fit into memory"
        fix = "give a smaller --size, or fewer --frames"
        raise InputError.of("--size", str(options.size), expected, fix) from None
    bar.clear()
    tell_problems(found.warnings)
    who = {role: getattr(options, role).partition(":")[0] for role in made}
    notes = {f"{role}_note": dict(one.note()) for role, one in made.items()}
    return hand_over(
        told.findings(
            found, who | notes | {"skipped": options.skip}, made["features"].comparable, bool(options.output)
        ),
        options,
    )


def methods(options: argparse.Namespace) -> dict[str, list[Path]]:
    """Paths of each, in the order given; what has no name is called by its folder. Raises InputError."""
    named: dict[str, list[Path]] = {}
    if options.clips:
        one = options.clips[0]
        named["clips" if len(options.clips) > 1 else one.resolve().name or "clips"] = list(options.clips)
    for name, path in options.method:
        if name in named:
            fix = "give each method a name of its own; of clips in several folders, name one above them"
            raise InputError.of("--method", f'"{name}"', "stands for two methods", fix)
        named[name] = [path]
    if not named:
        fix = "name clips, or methods with --method NAME=DIR"
        raise InputError.of("evaluate fid", "", "has nothing to compare with the reference", fix)
    if "reference" in named:
        raise InputError.of("--method", '"reference"', "is the other side's name", "choose another name")
    return named


def _no_model(options: argparse.Namespace) -> list[Problem]:
    """A device that nobody would run on."""
    from physgen import backends

    names = {role: getattr(options, role).partition(":")[0] for role in ("features", "flow")}
    rows = [row for row in backends.BACKENDS if names.get(row.role) == row.name]
    if options.device in ("auto", "cpu") or any(row.weights or row.told for row in rows):
        return []
    expected = f"has nobody to run there: {' and '.join(names.values())} need no model"
    return [Problem(Place("--device"), "", f'"{options.device}"', expected, "leave it out")]


def backend(role: str, said: str, device: str) -> Any:
    """Who fills a role, as `NAME` or `NAME:WHAT` says. Raises InputError that names the flag."""
    from physgen import backends
    from physgen.backends import Setup
    from physgen.crew import choice

    name, colon, rest = said.partition(":")
    flag = Place(f"--{role}")
    try:
        choice(role, name, rest, flag, bool(colon))
        return backends.make(role, name, Setup(rest, device))
    except InputError as error:
        raise InputError([_of_flag(problem, role, flag) for problem in error.problems]) from None


def _of_flag(problem: Problem, role: str, flag: Place) -> Problem:
    """What `--backend ROLE=NAME` says elsewhere, `--ROLE NAME` says here."""
    found = problem.found.replace(f'"{role}={role}', f'"{role}').replace(f'"{role}=', '"')
    found = found.replace(f"{role}=", "")
    place = flag if problem.place.file == "--backend" else problem.place
    return replace(problem, place=place, found=found, fix=problem.fix.replace(f"{role}=", ""))
