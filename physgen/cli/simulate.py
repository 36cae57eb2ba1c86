"""Run `show`, `check` and `simulate`: print tables, problems and trajectories of
scenes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import physgen.scene
import physgen.simulate
from physgen import compile, pipeline
from physgen.cli.arguments import WRONG_INPUT, Command, Parser, positive
from physgen.cli.clips import (
    add_overlays,
    other_variants,
    problems_of_variants,
    variants_of,
)
from physgen.cli.output import (
    OK,
    Bar,
    print_backup,
    print_json,
    print_line,
    print_problems,
)
from physgen.files import back_up, check_writable, write_atomic
from physgen.messages import Message
from physgen.problems import InputError, Problem, Severity, variant_named
from physgen.text import value_text

if TYPE_CHECKING:
    from physgen.compile.compile import CompiledScene
    from physgen.scene.scene import Scene


COLUMNS = {
    "name": "name", "label": "label", "mass_g": "mass g", "friction": "friction", "elasticity": "elasticity",
    "speed_m_s": "speed m/s", "support": "support", "confidence": "confidence",
}  # fmt: skip
"""Key of an object's row -> heading."""


def show(options: argparse.Namespace) -> int:
    variant = _one_variant(options)
    scene = pipeline.load(options.scene, options.set, variant, options.allow_outside)
    print_problems(other_variants(options.scene, options))
    with variant_named(variant):
        compilation = pipeline.compile(scene, pipeline.percepts(scene))
    rows = object_rows(scene, compilation)
    if options.json:
        print_json({"objects": rows})
        return OK
    table = [
        list(COLUMNS.values()),
        *([_cell(row[key]) for key in COLUMNS] for row in rows),
    ]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for line in table:
        print_line(
            "  ".join(
                text.ljust(width) for text, width in zip(line, widths, strict=True)
            ).rstrip()
        )
    return OK


def object_rows(scene: Scene, compilation: CompiledScene) -> list[dict[str, Any]]:
    """Return the main values of each object, in the order of names."""
    rows = []
    supports_by_object = compile.warnings.supports(scene, compilation)
    for item, body, under in zip(
        scene.objects, compilation.world.bodies, supports_by_object, strict=True
    ):
        speed = hypot(*body.velocity) / scene.world.pixels_per_meter
        confidence = scene.document["objects"][item.name].get("confidence")
        if "mask" in item.provenance:
            size_text = physgen.scene.provenance.source(
                item.provenance["mask"]
            ).confidence
        else:
            size_text = confidence
        if item.motion.value == "static":
            support = ["static"]
        else:
            support = under
        values = (
            item.name,
            item.label,
            round(body.mass, 4),
            item.friction,
            item.elasticity,
            round(speed, 3),
        )
        rows.append(dict(zip(COLUMNS, (*values, support, size_text), strict=True)))
    return rows


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return (
            ", ".join(value[:3])
            + (f" and {len(value) - 3} more" if len(value) > 3 else "")
            or "-"
        )
    return value_text(value) or "-"


def check(options: argparse.Namespace) -> int:
    report: list[Problem] = []
    lines = []
    for path in options.scenes:
        file_problems = dict.fromkeys(_problems_of_file(path, options))
        # Variants of one file share most problems.
        report += [problem for problem in file_problems if problem not in report]
        lines.append(f"{path}: {_count_text(file_problems)}")
    has_errors = any(p.severity is Severity.ERROR or options.strict for p in report)
    if options.json:
        print_json(
            {"problems": [p.as_dict() for p in report], "passed": not has_errors}
        )
    else:
        print_problems(report)
        for line in lines:
            print_line(line)
    if has_errors:
        return WRONG_INPUT
    return OK


def _problems_of_file(path: str, options: argparse.Namespace) -> Iterator[Problem]:
    """Yield the errors and warnings of a file, and the errors of all its variants."""
    for variant in variants_of(path, options):
        try:
            scene = pipeline.load(path, options.set, variant, options.allow_outside)
            maps = pipeline.percepts(scene)
            with variant_named(variant):
                compilation = pipeline.compile(scene, maps)
            yield from pipeline.lint(scene, compilation, maps)
        except InputError as error:
            yield from error.problems
    yield from problems_of_variants(path, options.allow_outside)


def _count_text(problems: Iterable[Problem]) -> str:
    """Return the counts of problems by severity as text."""
    kinds = [problem.severity for problem in problems]
    parts = []
    for kind in Severity:
        if count := kinds.count(kind):
            parts.append(f"{count} {kind.value}{'s' * (count != 1)}")
    return ", ".join(parts) or "no problems"


def simulate(options: argparse.Namespace) -> int:
    kind = _trajectory_kind(options.output)
    variant = _one_variant(options)
    scene = pipeline.load(options.scene, options.set, variant, options.allow_outside)
    maps = pipeline.percepts(scene)
    with variant_named(variant):
        compilation = pipeline.compile(scene, maps)
    lints = pipeline.lint(scene, compilation, maps)
    print_problems([*other_variants(options.scene, options), *lints])
    bar = Bar()
    with scene.located():
        trajectory = pipeline.simulate(compilation.world, options.rate, bar.show)
    bar.clear()
    print_problems(
        pipeline.clip_warnings.motion_warnings(scene, compilation.world, trajectory)
    )
    # An earlier trajectory is replaced; any other file is kept as a backup.
    if options.output is not None and not physgen.simulate.trajectory.is_trajectory(
        options.output
    ):
        back_up(options.output, print_backup)
    if kind == "npz":
        trajectory.save(options.output)
    if options.output is None or kind != "npz":
        if options.json or kind == "json":
            text = trajectory.as_json()
        else:
            text = trajectory.as_csv()
        if options.output is None:
            sys.stdout.write(text)
        else:
            options.output.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(options.output, text.encode("utf-8"))
    elif options.json:
        sys.stdout.write(trajectory.as_json())
    return OK


def _trajectory_kind(output: Path | None) -> str:
    """Return `npz`, `csv` or `json` by the file's suffix. Raise InputError before
    anything is computed or overwritten.
    """
    if output is None:
        return ""
    if output.suffix not in (".npz", ".csv", ".json") or output.is_dir():
        raise Message.NOT_A_TRAJECTORY_NAME.error("-o", f'"{output}"')
    check_writable(output.parent)
    return output.suffix[1:]


def _one_variant(options: argparse.Namespace) -> str | None:
    if options.variant == "all":
        raise Message.VARIANT_ALL_SIMULATED.error("--variant", "all")
    if options.variant:
        return str(options.variant)
    return None


def add_show(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    parser.flag("--json", "print as JSON")
    add_overlays(parser)


def add_check(parser: Parser) -> None:
    parser.add_argument("scenes", metavar="SCENE", nargs="+")
    parser.flag("--strict", "warnings count as errors")
    parser.flag("--json", "print problems as JSON")
    add_overlays(parser)


def add_simulate(parser: Parser) -> None:
    parser.add_argument("scene", metavar="SCENE")
    parser.option(
        "-o --output",
        "FILE",
        Path,
        "write here; .npz, .csv or .json; default: CSV on stdout",
    )
    parser.option("--rate", "HZ", positive, "samples per second; default: the video's")
    parser.flag("--json", "print everything as JSON")
    add_overlays(parser)


SHOW = Command(
    "show",
    "Prints the objects of a scene: label, mass, friction, elasticity, speed, support and confidence.",
    "physgen show scene.yaml",
    add_show,
    show,
)
CHECK = Command(
    "check",
    "Lists problems and warnings of scene files.",
    "physgen check scenes/*/scene.yaml --strict",
    add_check,
    check,
    is_order_free=True,
)
SIMULATE = Command(
    "simulate",
    "Simulates a scene and writes its trajectory.",
    "physgen simulate scene.yaml -o trajectory.npz",
    add_simulate,
    simulate,
)
