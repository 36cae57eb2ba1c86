"""`render`: scenes to clips, once or again on every save."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from physgen.cli.jobs import jobs_of, refuse_twins, refuse_unseen
from physgen.cli.making import make_all

if TYPE_CHECKING:
    from physgen.batch.pool import Job


def render(options: argparse.Namespace) -> int:
    refuse_unseen(options)
    if options.watch:
        from physgen.cli.watching import watch

        return watch(options, lambda: _jobs(options), lambda jobs: make_all(jobs, len(jobs), options))
    jobs = _jobs(options)
    return make_all(jobs, len(jobs), options)


def _jobs(options: argparse.Namespace) -> list[Job]:
    jobs = list(jobs_of(options))
    refuse_twins(jobs)
    return jobs
