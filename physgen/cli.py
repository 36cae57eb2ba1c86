"""Command line -> exit code. The only module that prints: results to stdout, everything else to stderr."""

from __future__ import annotations

import argparse
import io
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.flags import WRONG_INPUT, build_parser, four, joined, scene_name, two
from physgen.problems import InputError, Problem, Severity
from physgen.whole import meant, write_whole

if TYPE_CHECKING:
    from physgen.batch.pool import Job
    from physgen.crew import Plan

OK, FAILED, INTERRUPTED = 0, 1, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `physgen`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name need not be text
            stream.reconfigure(errors="backslashreplace")
    options = build_parser().parse_args(joined(given))
    options.command_line = ["physgen", *given]
    with suppress(ValueError):  # not the main thread: then nobody stops us that way
        signal.signal(signal.SIGTERM, _stop)
    try:
        return COMMANDS[options.command](options)
    except InputError as error:
        tell_problems(error.problems)
        return WRONG_INPUT
    except KeyboardInterrupt:
        tell("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return OK
    except OSError as error:
        where = f"{meant(str(error.filename))}: " if error.filename else ""
        tell(f"{where}{error.strerror or error}")
        return FAILED


def _stop(number: int, frame: object) -> None:
    """Ended from outside: leave as by Ctrl-C, with nothing half-written."""
    raise KeyboardInterrupt


# ---- commands ----------------------------------------------------------------------------------------------------


def perceive(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.crew import Crew

    if options.refresh is None and len(options.image) > 1:
        return _perceive_many(options)
    scene_name(options.output)
    bar = Bar()
    told: dict[str, Any] = {
        "boxes": [four("--box", text) for text in options.box],
        "points": [two("--point", text) for text in options.point],
        "assets": options.assets,
        "crew": Crew(_plan(options)),
        "progress": bar.show,
        "warn": tell_one,
        "keep": tell_kept,
    }
    if options.refresh:
        _refuse_beside_refresh(options)
        if options.output is None:
            fix = "say where the new scene goes, with its maps beside it: -o NEW.yaml"
            raise InputError.of("perceive", "--refresh", "needs -o", fix)
        from physgen.refresh import refresh

        told |= {"allow_outside": options.allow_outside, "sheet": options.sheet}
        told["labels"] = options.label
        text = refresh(options.refresh, options.output, **told)
    elif not options.image:
        raise InputError.of("perceive", "", "was given no photo", "name one, or a scene: --refresh SCENE")
    else:
        told |= {
            "masks": options.masks,
            "coco": options.coco,
            "side": options.side,
            "sheet": options.sheet,
            "labels": options.label,
            "asked": options.find,
        }
        text = pipeline.perceive(options.image[0], options.output, **told)
    bar.clear()
    _hand_over(text, options.output)
    return OK


def _perceive_many(options: argparse.Namespace) -> int:
    """Several photos into one folder, with models loaded once; what is wrong with one leaves the others be."""
    from physgen import pipeline
    from physgen.crew import Crew

    alone = {"--masks": options.masks, "--coco": options.coco, "--box": options.box, "--point": options.point,
             "--label": options.label, "--assets": options.assets, "--sheet": options.sheet}  # fmt: skip
    fix = "leave it out, or name one photo"
    said = [
        InputError.of("perceive", flag, "tells of one photo", fix) for flag, value in alone.items() if value
    ]
    problems = [problem for error in said for problem in error.problems]
    if options.output is None or options.output.suffix in (".yaml", ".yml"):
        fix = "say where: -o FOLDER"
        problems += InputError.of(
            "perceive", f"{len(options.image)} photos", "go into a folder", fix
        ).problems
    stems = [image.stem for image in options.image]
    for twin in sorted({stem for stem in stems if stems.count(stem) > 1}):
        problems += InputError.of("perceive", f'"{twin}"', "is the name of two photos", "rename one").problems
    if problems:
        raise InputError(problems)
    crew = Crew(_plan(options, keep=True))
    failed: list[Problem] = []
    bar = Bar()
    for k, image in enumerate(options.image):
        output = options.output / f"{image.stem}.yaml"

        def step(stage: str, done: int, total: int, k: int = k, name: str = image.name) -> None:
            bar.show(f"{name}: {stage}", k * total + done, len(options.image) * total)

        try:
            pipeline.perceive(
                image, output, crew=crew, asked=options.find, side=options.side,
                progress=step, warn=tell_one, keep=tell_kept,
            )  # fmt: skip
            _hand_over("", output)
        except InputError as error:
            failed += error.problems
    bar.clear()
    if failed:
        raise InputError(failed)
    return OK


def _plan(options: argparse.Namespace, keep: bool | None = None) -> Plan:
    from physgen.configured import plan

    kept = getattr(options, "keep_models", None)
    return plan(
        options.backend,
        profile=options.profile,
        config=options.config,
        device=options.device,
        dtype=options.dtype,
        fallback=options.fallback,
        keep=kept if kept is not None else keep,
    )


def _refuse_beside_refresh(options: argparse.Namespace) -> None:
    """A scene tells its photo and its masks."""
    beside = {
        "IMAGE": options.image[0] if options.image else None,
        "--masks": options.masks,
        "--coco": options.coco,
        "--side": options.side,
    }
    for flag, value in beside.items():
        if value is not None:
            fix = f"leave {flag} or --refresh out"
            raise InputError.of("perceive", f'"{value}"', "cannot be told beside --refresh", fix)


def import_(options: argparse.Namespace) -> int:
    from physgen import pipeline

    scene_name(options.output)
    bar = Bar()
    if options.kind == "physgen":
        text = pipeline.import_physgen(options.path, options.output, bar.show, tell_one, tell_kept)
    else:
        text = pipeline.import_coco(options.path, options.image, options.output, bar.show, tell_kept)
    bar.clear()
    _hand_over(text, options.output)
    return OK


def check(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.compile.pairs import pair_header
    from physgen.scene.write import scene_text

    report: list[Problem] = []
    resolved = []
    for path in options.scenes:
        try:
            for variant in _variants(path, options):
                scene = pipeline.load(path, options.set, variant, options.allow_outside)
                compiled = pipeline.compile(scene, pipeline.percepts(scene))
                report += [p for p in pipeline.lint(scene, compiled) if p not in report]
                if options.resolved:
                    resolved.append(scene_text(scene.document, header=pair_header(compiled.world)))
        except InputError as error:
            report += [p for p in error.problems if p not in report]
    failed = any(p.severity is Severity.ERROR or options.strict for p in report)
    if options.json:
        _print_json(
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
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    tell_problems(pipeline.lint(scene, compiled))
    bar = Bar()
    if options.chaos:
        found = pipeline.chaos(compiled.world, bar.show)
        bar.clear()
        if options.json:
            _print_json(found.as_dict())
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


def render(options: argparse.Namespace) -> int:
    from physgen.batch.pool import Job, run_all
    from physgen.report.video import Format

    formats = tuple(Format(name) for name in options.format)
    jobs = [
        Job(
            path,
            options.output,
            tuple(options.set),
            variant,
            options.allow_outside,
            formats,
            tuple(options.command_line),
            options.chaos,
            options.device,
        )
        for path in options.scenes
        for variant in _variants(path, options)
    ]
    _refuse_twins(jobs)
    bar = Bar()
    folders = []
    told: set[str] = set()
    for done in run_all(jobs, options.jobs, lambda job: bar.of(Path(job.path).name if len(jobs) > 1 else "")):
        bar.clear()
        tell_problems([p for p in done.problems if str(p) not in told])
        told.update(map(str, done.problems))
        if done.folder is not None:
            folders.append(done.folder)
            if not options.json:
                print(done.folder, flush=True)
    root = Path(options.output)
    index = root / "index.html" if len(folders) > 1 or (root / "index.html").exists() else None
    if index is not None:
        from physgen.report.page import gallery_page

        write_whole(index, gallery_page(root).encode("utf-8"))
        if not options.json and len(folders) > 1:
            print(index)
    if options.json:
        _print_json(
            {
                "folders": list(map(str, folders)),
                "index": str(index) if index else None,
                "passed": len(folders) == len(jobs),
            }
        )
    return OK if len(folders) == len(jobs) else WRONG_INPUT


def evaluate(options: argparse.Namespace) -> int:
    import os

    if options.what != "physics":
        return {"fidelity": _fidelity, "segmentation": _segmentation}[options.what](options)

    from physgen.evaluate import physics, table

    bar = Bar()
    scores = physics.evaluate(
        physics.choose(options.rows),
        options.draws,
        () if options.no_convergence else physics.STEPS,
        options.jobs or os.cpu_count() or 1,
        options.output,
        bar.show,
        tell_kept,
    )
    bar.clear()
    result = {"rows": [score.as_dict() for score in scores], "passed": all(score.passed for score in scores)}
    if options.json:
        _print_json(result)
    else:
        sys.stdout.write(table.markdown(result) if options.markdown else table.text(result))
    return OK if result["passed"] else FAILED


def _fidelity(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity

    bar = Bar()
    if options.output:
        from physgen.evaluate.strips import write_strip

        for truth in fidelity.truths(options.truth, options.scenes):
            bar.show(f"{truth.name}: strip", 0, 1)
            path = write_strip(truth, options.output)
            bar.clear()
            print(path)
        return OK
    result = fidelity.evaluate(options.truth, options.scenes, bar.show)
    bar.clear()
    if options.json:
        _print_json(result)
    else:
        sys.stdout.write(fidelity.markdown(result))
    if result["passed"] is None:
        print("no bar: none of these scenes is of the test half", file=sys.stderr)
        return OK if options.scenes else FAILED
    found = f"{result['ahead']:.2f} dB better than the paper's way, relit, over objects and shadows of the test half"
    print(f"{found}; the bar is {fidelity.BAR:g} dB", file=sys.stderr)
    return OK if result["passed"] else FAILED


def _segmentation(options: argparse.Namespace) -> int:
    from physgen.crew import Crew, Plan, choices
    from physgen.evaluate import segmentation, segmentation_table
    from physgen.evaluate.photos import pairs
    from physgen.evaluate.shown import Shown

    chosen = choices(options.backend)
    if set(chosen) - {"segment"}:
        role = f'"{", ".join(sorted(set(chosen) - {"segment"}))}"'
        raise InputError.of("--backend", role, "has no part in this", "write segment=NAME")
    bars = {name: bar for name in segmentation.BARS if (bar := getattr(options, name)) is not None}
    found, warnings = pairs(options.folder)
    tell_problems(warnings)
    shown = None if options.output is None else Shown(options.output, found)
    bar = Bar()
    result = segmentation.evaluate(
        found, Crew(Plan(chosen)).get("segment"), shown.photo if shown else lambda photo: None, bar.show
    )
    bar.clear()
    record = result.as_dict(bars)
    if shown:
        shown.totals(result, record)
    if options.json:
        _print_json(record)
    else:
        form = segmentation_table.markdown if options.markdown else segmentation_table.text
        sys.stdout.write(form(record))
    return OK if record["passed"] else FAILED


def list_backends(options: argparse.Namespace) -> int:
    from physgen import roster

    rows = roster.listing(_plan(options))
    if options.json:
        _print_json({"backends": rows})
        return OK
    for line in roster.text(rows):
        print(line)
    print("\n* does its step unless --backend, --profile or physgen.toml says otherwise", file=sys.stderr)
    return OK


def schema(options: argparse.Namespace) -> int:
    if options.markdown:
        from physgen.scene.reference import markdown

        sys.stdout.write(markdown())
    else:
        from physgen.resources import resource

        sys.stdout.write(resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8"))
    return OK


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "perceive": perceive,
    "import": import_,
    "check": check,
    "simulate": simulate,
    "render": render,
    "evaluate": evaluate,
    "backends": list_backends,
    "schema": schema,
}


# ---- values of flags ---------------------------------------------------------------------------------------------


def _hand_over(text: str, output: Path | None) -> None:
    """The scene on stdout, or the path of the file that it went to."""
    sys.stdout.write(text if output is None else f"{output}\n")


def _one_variant(options: argparse.Namespace) -> str | None:
    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name, or use render")
    return str(options.variant) if options.variant else None


def _variants(path: str, options: argparse.Namespace) -> list[str | None]:
    """None for the file itself; with `all`, it and every variant."""
    if options.variant != "all":
        return [options.variant]
    from physgen import pipeline

    return [None, *pipeline.load(path, options.set, None, options.allow_outside).variants]


def _refuse_twins(jobs: Sequence[Job]) -> None:
    from physgen import pipeline

    seen: dict[str, str] = {}
    problems = []
    for job in jobs:
        name = pipeline.output_name(job.path, job.variant)
        if name in seen:
            expected = f"would be written over {seen[name]}: both are called {name}"
            problems += InputError.of(job.path, "", expected, "render them into two folders").problems
        seen.setdefault(name, job.path)
    if problems:
        raise InputError(problems)


# ---- what is printed ---------------------------------------------------------------------------------------------


def tell(text: str) -> None:
    """One line to stderr."""
    print(text, file=sys.stderr, flush=True)


def tell_problems(problems: Sequence[Problem]) -> None:
    """One line each to stderr."""
    for problem in problems:
        tell(str(problem))


def tell_one(problem: Problem) -> None:
    """One line to stderr."""
    tell(str(problem))


def tell_kept(kept: Path) -> None:
    """One line to stderr for a file that stood in the way."""
    tell(f"{str(kept).rpartition('~')[0]}: was there already and differed; kept as {kept.name}")


def _print_json(data: Any) -> None:
    import json

    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


class Bar:
    """Progress on one line of a terminal; silent in pipes."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._wide = 0

    def of(self, name: str) -> Callable[[str, int, int], None]:
        """Progress of one scene."""
        return lambda stage, done, total: self.show(f"{name} {stage}".strip(), done, total)

    def show(self, stage: str, done: int, total: int) -> None:
        """Draw, at most."""
        if self._live:
            text = f"{stage} {done}/{total}" if total > 1 else stage
            print("\r" + text.ljust(self._wide), end="", file=sys.stderr, flush=True)
            self._wide = len(text)

    def clear(self) -> None:
        """Leave an empty line for what is printed next."""
        if self._live and self._wide:
            print("\r" + " " * self._wide + "\r", end="", file=sys.stderr, flush=True)
            self._wide = 0


if __name__ == "__main__":
    sys.exit(main())
