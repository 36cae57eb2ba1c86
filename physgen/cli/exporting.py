"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from physgen.cli.jobs import check_formats, refuse_twins, variants_of
from physgen.cli.making import Shown, make_all
from physgen.cli.printing import tell
from physgen.problems import InputError

if TYPE_CHECKING:
    from physgen.batch.pool import Done


def export(options: argparse.Namespace) -> int:
    from physgen.batch.pool import Job
    from physgen.pipeline import Page

    check_formats(options.format, "--format")
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
    lines: dict[str, None] = {}

    def heard(done: Done) -> None:
        if options.frames and done.folder is not None:
            lines.update(dict.fromkeys(_plays(done.folder, options)))

    code = make_all(jobs, len(jobs), options, heard, shown=Shown.NOWHERE)
    for line in lines:
        tell(line)
    return code


def _plays(folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """How long a clip plays with the frames that were asked for."""
    try:
        told = json.loads((folder / "manifest.json").read_bytes())
        count, fps = len(told["frames"]), float(told["video"]["fps"])
        duration, long = float(told["document"]["world"]["duration"]), count / fps
    except (OSError, ValueError, KeyError, TypeError, ZeroDivisionError):
        return
    plays = f"{count} frames at {fps:g} fps play for {long:.3g} s"
    if any(text.startswith("world.duration=") for text in options.set) or abs(long - duration) < 1e-9:
        yield plays
        return
    stays = "the duration of the motion stays as the scene has it"
    yield f"{plays}; {stays}: --set world.duration={long:.6g} shows it at its true speed"


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
    return edits
