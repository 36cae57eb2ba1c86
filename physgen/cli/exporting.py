"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from physgen.cli.jobs import refuse_twins, variants_of
from physgen.cli.making import Shown, make_all
from physgen.cli.printing import tell
from physgen.problems import InputError


def export(options: argparse.Namespace) -> int:
    from physgen.batch.pool import Job
    from physgen.pipeline import Page

    exportable(options.format, "--format")
    options.set = [*options.set, *filmed(options)]
    jobs = [
        Job(
            path,
            options.output,
            tuple(options.set),
            variant,
            options.allow_outside,
            (),
            tuple(options.command_line),
            device=options.device,
            cached=options.cache,
            page=Page.NONE,
            export=options.format,
        )
        for path in options.scenes
        for variant in variants_of(path, options)
    ]
    refuse_twins(jobs)
    return make_all(jobs, len(jobs), options, shown=Shown.NOWHERE)


def exportable(formats: Sequence[str], flag: str) -> None:
    """Raises InputError where a format is none, by the `flag`; tells what is left out without an optional library."""
    from physgen.export.writing import kinds
    from physgen.tables import HINT, has_parquet

    kinds(formats, flag)
    if "trajectory" in formats and not has_parquet():
        tell(HINT)


def filmed(options: argparse.Namespace) -> list[str]:
    """What the flags of the film set in every scene, so that every format follows. Raises InputError."""
    edits = [f"render.frames={options.frames}"] if options.frames else []
    if options.size:
        width, height = options.size
        if "conditioning" in options.format and (width % 2 or height % 2):
            even = f"{width + width % 2}x{height + height % 2}"
            expected = "has an odd side, which H.264 with 4:2:0 cannot hold"
            raise InputError.of("--size", f"{width}x{height}", expected, f"write {even}")
        edits.append(f"render.size=[{width}, {height}]")
    if options.fps:
        edits.append(f"render.fps={options.fps:g}")
    if options.frames:
        stays = "the duration of the motion stays as the scene has it"
        if options.fps:
            long = options.frames / options.fps
            true = f"--set world.duration={long:.6g} shows it at its true speed"
            tell(f"{options.frames} frames at {options.fps:g} fps play for {long:.3g} s; {stays}: {true}")
        else:
            tell(f"{options.frames} frames are spread over the motion; {stays}")
    return edits
