"""`export`: scenes to ground truth, without a video or a page."""

from __future__ import annotations

import argparse

from physgen.cli.rendering import Shown, make_all, refuse_twins, variants_of


def export(options: argparse.Namespace) -> int:
    from physgen.batch.pool import Job
    from physgen.export.writing import kinds
    from physgen.pipeline import Page

    kinds(options.format)
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
