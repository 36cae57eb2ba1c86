"""Run `sweep`: render one scene with many values, and write a table of outcomes."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from physgen import batch, pipeline, scene
from physgen.cli.arguments import (
    Command,
    Parser,
    check_folder_name,
    names,
    number_of_clips,
    seed,
)
from physgen.cli.clips import (
    add_clips,
    add_overlays,
    job_maker,
    make_all,
    preview_edits,
)
from physgen.cli.clusters import add_cluster, add_ship, check_cluster
from physgen.cli.output import OK, print_backup, print_line
from physgen.files import check_writable
from physgen.messages import Message, one_of
from physgen.problems import InputError, Place

if TYPE_CHECKING:
    from physgen.batch.run import Job
    from physgen.batch.sweep import Point, Sweep


TABLE = "sweep.csv"
TIMELESS = {"objects", "forces", "joints", "light"}
"""Parts of a scene without influence on the number of frames or a fixed duration."""
MOST_TRACKED = 32
"""Maximum number of objects with outcomes by default, because each has seven
columns.
"""


def sweep(options: argparse.Namespace) -> int:
    # The first argument is often forgotten, and then a key is taken for the scene.
    if "=" in options.scene and not Path(options.scene).exists():
        raise Message.SWEEP_WITHOUT_SCENE.error(options.scene)
    check_folder_name(options.output)
    check_cluster(options)
    scene_file = scene.load.OpenedScene(Path(options.scene), options.allow_outside)
    if options.variant == "all":
        variants = [None, *scene_file.variants]
    else:
        variants = [options.variant]
    plan = batch.sweep.plan_clips(
        batch.axes.read_axes(options.axes), variants, options.samples, options.seed
    )
    objects = batch.sweep.check_values(plan, scene_file, options.set)
    if options.dry_run:
        return _list_clips(plan, options)
    return _make_sweep(plan, objects, options)


def _list_clips(plan: Sweep, options: argparse.Namespace) -> int:
    """Print all clips with their values, and make none."""
    if not options.json:
        keys = [axis.key for axis in plan.axes]
        batch.sweep.write_row(sys.stdout, ["number", "name", "variant", *keys])
    for point in map(plan.__getitem__, range(len(plan))[options.part or slice(None)]):
        if options.json:
            row = {"number": point.number, "name": point.name, "variant": point.variant}
            print_line(json.dumps({**row, "set": point.overrides}, ensure_ascii=False))
        else:
            cells = [value.cell for value in point.values]
            row_cells = [point.number, point.name, point.variant or "", *cells]
            batch.sweep.write_row(sys.stdout, row_cells)
    return OK


def _make_sweep(
    plan: Sweep, objects: tuple[str, ...], options: argparse.Namespace
) -> int:
    variant = None if len(plan.variants) > 1 else plan.variants[0]
    sweep_name = f"{pipeline.output_name(options.scene, variant)}-sweep"
    options.output = options.output or str(Path("out", sweep_name))
    tracked_names = _tracked_names(objects, options.track)
    make = job_maker(options)
    table = batch.sweep.table_columns(plan, batch.outcomes.columns(tracked_names))
    out = Path(options.output)
    check_writable(out)
    if (out / TABLE).is_dir():
        raise Message.TABLE_IS_FOLDER.error("-o", f'"{out}"')
    out.mkdir(parents=True, exist_ok=True)
    # Jobs end in the order of their start, so that a queue matches results and points.
    running: deque[Point] = deque()
    numbers = range(len(plan))[options.part or slice(None)]
    previews = Previews(plan, options)

    def jobs() -> Iterator[Job]:
        for point in map(plan.__getitem__, numbers):
            running.append(point)
            preview = previews.edits(point) if options.preview else ()
            yield make(
                options.scene,
                point.variant,
                point.overrides,
                point.name,
                tracked_names,
                preview,
            )

    if options.part:
        # A run with all clips writes the table, not a run of one part.
        return make_all(jobs(), len(numbers), options, gallery=False)
    with batch.sweep.open_table(out / TABLE, table) as rows:

        def finish() -> Sequence[str]:
            # Only a complete table replaces an older one.
            if rows.count < len(plan):
                return ()
            batch.sweep.keep_other_table(rows.path, rows.part, print_backup)
            rows.publish()
            return [str(rows.path)]

        return make_all(
            jobs(),
            len(plan),
            options,
            on_result=lambda done: rows.add(
                batch.sweep.table_row(plan, running.popleft(), done)
            ),
            finish=finish,
        )


class Previews:
    """Edits for previews of a sweep's points."""

    def __init__(self, plan: Sweep, options: argparse.Namespace) -> None:
        self._options = options
        roots = {re.split(r"[.\[]", axis.key)[0] for axis in plan.axes}
        self._keeps_timing = roots <= TIMELESS
        self._shared: dict[str | None, tuple[str, ...]] = {}

    def edits(self, point: Point) -> tuple[str, ...]:
        """Return the edits of a point. Points of a variant share them if frames and
        duration are equal.
        """
        if point.variant in self._shared:
            return self._shared[point.variant]
        edits = preview_edits(
            self._options.scene, point.variant, self._options, point.overrides
        )
        has_own_duration = any(edit.startswith("world.duration=") for edit in edits)
        # Thousands of points need only one simulation for the length of their previews.
        if self._keeps_timing and edits and not has_own_duration:
            self._shared[point.variant] = edits
        return edits


def _tracked_names(
    objects: tuple[str, ...], requested_names: list[str] | None
) -> tuple[str, ...]:
    if requested_names is None:
        if len(objects) <= MOST_TRACKED:
            return objects
        return ()
    problems = []
    for name in requested_names:
        if name not in objects:
            place = Place("--track")
            fix = one_of(name, objects)
            wrong = Message.NOT_MOVABLE.problem(place, "", f'"{name}"', fix=fix)
            problems.append(wrong)
    if problems:
        raise InputError(problems)
    return tuple(requested_names)


def add(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="a scene file")
    help_text = (
        "start:end:count (count:log for a geometric series), YAML values separated by commas, or a distribution, "
        "quoted: ~uniform(a, b), ~loguniform(a, b), ~normal(mean, sd), ~choice(a, b, ...). "
        "Values of several keys make a grid"
    )
    parser.add_argument("axes", metavar="KEY=VALUES", nargs="*", help=help_text)
    help_text = "draws of the distributions, at each point of the grid"
    parser.option("--samples", "N", number_of_clips, help_text)
    parser.option("--seed", "S", seed, "seed of the draws; default: 0")
    parser.flag(
        "--dry-run",
        "print the clips as CSV, or with --json as lines, and render nothing",
    )
    help_text = "objects with outcomes of their own in the table; default: all, if there are at most 32"
    parser.option("--track", "NAMES", names, help_text)
    parser.option(
        "-o --output", "DIR", str, "folder of the sweep; default: out/<scene>-sweep"
    )
    add_clips(parser)
    parser.flag("--sound", "write the sound tracks that the scene asks for")
    add_cluster(parser)
    add_ship(parser)
    add_overlays(parser)


SWEEP = Command(
    "sweep",
    "Renders a scene at the points of a grid or with random draws: a folder of clips, and a table of their outcomes.",
    "physgen sweep scene.yaml objects.ball.velocity.0=100:900:9 'objects.*.elasticity=0.2,0.9' -o sweep",
    add,
    sweep,
    is_order_free=True,
)
