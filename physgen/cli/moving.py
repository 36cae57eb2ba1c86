"""`check` and `simulate`: scenes to problems and motion."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from physgen.cli.printing import OK, Bar, print_json, tell, tell_problems
from physgen.cli.rendering import variants_of
from physgen.flags import WRONG_INPUT
from physgen.problems import InputError, Problem, Severity
from physgen.whole import write_whole


def check(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.compile.pairs import pair_header
    from physgen.scene.write import scene_text

    report: list[Problem] = []
    resolved = []
    for path in options.scenes:
        try:
            for variant in variants_of(path, options):
                scene = pipeline.load(path, options.set, variant, options.allow_outside)
                maps = pipeline.percepts(scene)
                compiled = pipeline.compile(scene, maps)
                report += [p for p in pipeline.lint(scene, compiled, maps) if p not in report]
                if options.resolved:
                    resolved.append(scene_text(scene.document, header=pair_header(compiled.world)))
        except InputError as error:
            report += [p for p in error.problems if p not in report]
    failed = any(p.severity is Severity.ERROR or options.strict for p in report)
    if options.json:
        print_json(
            {"problems": [p.as_dict() for p in report], "passed": not failed, "resolved": resolved or None}
        )
    else:
        tell_problems(report)
        sys.stdout.write("---\n".join(resolved))
        if not failed and not options.resolved and sys.stderr.isatty():
            tell(f"{len(options.scenes)} scene{'s' * (len(options.scenes) != 1)} checked")
    return WRONG_INPUT if failed else OK


def simulate(options: argparse.Namespace) -> int:
    from physgen import pipeline

    kind = _trajectory_kind(options.output)
    scene = pipeline.load(options.scene, options.set, _one_variant(options), options.allow_outside)
    maps = pipeline.percepts(scene)
    compiled = pipeline.compile(scene, maps)
    tell_problems(pipeline.lint(scene, compiled, maps))
    bar = Bar()
    if options.chaos:
        found = pipeline.chaos(compiled.world, bar.show)
        bar.clear()
        if options.json:
            print_json(found.as_dict())
        else:
            print("\n".join((*found.lines(), "", found.verdict())))
        if options.output is None:
            return OK
    trajectory = pipeline.simulate(compiled.world, options.rate, bar.show)
    bar.clear()
    if kind == "npz":
        trajectory.save(options.output)
    if options.output is None or kind != "npz":
        text = trajectory.as_json() if options.json or kind == "json" else trajectory.as_csv()
        if options.output is None:
            sys.stdout.write(text)
        else:
            write_whole(options.output, text.encode("utf-8"))
    elif options.json and not options.chaos:
        sys.stdout.write(trajectory.as_json())
    return OK


def _trajectory_kind(output: Path | None) -> str:
    """`npz`, `csv` or `json` by the file's ending; refused before anything is computed or overwritten."""
    if output is None:
        return ""
    if output.suffix not in (".npz", ".csv", ".json") or output.is_dir():
        raise InputError.of(
            "-o", f'"{output}"', "is no name for a trajectory", "end it in .npz, .csv or .json"
        )
    return output.suffix[1:]


def _one_variant(options: argparse.Namespace) -> str | None:
    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name, or use render")
    return str(options.variant) if options.variant else None
