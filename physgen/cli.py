"""Command line -> exit code. The only module that prints: results to stdout, everything else to stderr."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from physgen import __version__
from physgen.problems import InputError, Problem, Severity

if TYPE_CHECKING:
    from physgen.batch.pool import Job

OK, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130
FORMATS = ("mp4", "gif", "webp", "png")


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `physgen`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = build_parser()
    options = parser.parse_args(given)
    options.command_line = ["physgen", *given]
    run: Callable[[argparse.Namespace], int] = options.run
    try:
        return run(options)
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
        where = f"{error.filename}: " if error.filename else ""
        tell(f"{where}{error.strerror or error}")
        return FAILED


# ---- commands ----------------------------------------------------------------------------------------------------


def perceive(options: argparse.Namespace) -> int:
    from physgen import backends, pipeline

    bar = Bar()
    text = pipeline.perceive(
        options.image,
        options.output,
        masks=options.masks,
        coco=options.coco,
        boxes=[_four("--box", text) for text in options.box],
        points=[_two("--point", text) for text in options.point],
        labels=options.label,
        assets=options.assets,
        backends=backends.chosen(options.backend),
        progress=bar.show,
    )
    bar.clear()
    if options.output is None:
        sys.stdout.write(text)
    return OK


def import_(options: argparse.Namespace) -> int:
    from physgen import pipeline

    bar = Bar()
    if options.kind == "physgen":
        text = pipeline.import_physgen(options.path, options.output, bar.show, lambda p: tell_problems([p]))
    else:
        text = pipeline.import_coco(options.path, options.image, options.output, bar.show)
    bar.clear()
    if options.output is None:
        sys.stdout.write(text)
    return OK


def check(options: argparse.Namespace) -> int:
    from physgen import pipeline
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
                    resolved.append(scene_text(scene.document, header=_pair_header(compiled.world)))
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

    scene = pipeline.load(options.scene, options.set, _one_variant(options), options.allow_outside)
    compiled = pipeline.compile(scene, pipeline.percepts(scene))
    tell_problems(pipeline.lint(scene, compiled))
    trajectory = pipeline.simulate(compiled.world, options.rate)
    if options.output is not None:
        trajectory.save(options.output)
    if options.json:
        _print_json({name: array.tolist() for name, array in trajectory.as_arrays().items()})
    elif options.output is None:
        sys.stdout.write("time_s,name,x_px,y_px,angle_rad,vx_px_s,vy_px_s,spin_rad_s\n")
        for t, time in enumerate(trajectory.times):
            for n, name in enumerate(trajectory.names):
                row = (*trajectory.poses[t, n], *trajectory.velocities[t, n])
                sys.stdout.write(f"{float(time)!r},{name}," + ",".join(repr(float(v)) for v in row) + "\n")
    return OK


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
        )
        for path in options.scenes
        for variant in _variants(path, options)
    ]
    _refuse_twins(jobs)
    bar = Bar()
    folders = []
    for done in run_all(jobs, options.jobs, lambda job: bar.of(Path(job.path).name if len(jobs) > 1 else "")):
        bar.clear()
        tell_problems(done.problems)
        if done.folder is not None:
            folders.append(done.folder)
            if not options.json:
                print(done.folder, flush=True)
    index = None
    if len(folders) > 1:
        from physgen.report.page import gallery_page

        root = Path(options.output)
        index = root / "index.html"
        index.write_text(
            gallery_page(sorted(p.parent for p in root.glob("*/manifest.json")), root), encoding="utf-8"
        )
        if not options.json:
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


def list_backends(options: argparse.Namespace) -> int:
    from physgen import backends

    rows = backends.listing()
    if options.json:
        _print_json({"backends": rows})
        return OK
    wide = max(len(f"{row['role']}={row['name']}") for row in rows)
    for row in rows:
        state = "" if row["installed"] else f"  [missing: {', '.join(row['missing'])}; {row['install']}]"
        mark = "*" if row["default"] else " "
        print(f"{mark} {row['role'] + '=' + row['name']:<{wide}}  {row['about']}{state}")
    return OK


def schema(options: argparse.Namespace) -> int:
    if options.markdown:
        from physgen.scene.reference import markdown

        sys.stdout.write(markdown())
    else:
        from physgen.resources import resource

        sys.stdout.write(resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8"))
    return OK


# ---- flags -------------------------------------------------------------------------------------------------------


class Parser(argparse.ArgumentParser):
    """Wrong flags: one line that says what to do, exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print the message and a hint."""
        self.exit(WRONG_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")


def build_parser() -> argparse.ArgumentParser:
    """Every command with its flags and an example."""
    parser = Parser(
        prog="physgen",
        description="One photo becomes an editable scene file; the scene file becomes a physically true video.",
        epilog="example: physgen perceive photo.png > scene.yaml && physgen render scene.yaml",
    )
    parser.add_argument("--version", action="version", version=f"physgen {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def command(
        name: str, run: Callable[[argparse.Namespace], int], about: str, example: str
    ) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=about, description=about, epilog=f"example: {example}")
        sub.set_defaults(run=run)
        return sub

    sub = command(
        "perceive", perceive, "Photo to scene file and assets.", "physgen perceive photo.png > scene.yaml"
    )
    sub.add_argument("image", metavar="IMAGE", type=Path, help="the photo")
    sub.add_argument(
        "-o",
        "--output",
        metavar="SCENE",
        type=Path,
        help="write the scene here (assets beside it); default: stdout",
    )
    sub.add_argument(
        "--masks",
        metavar="FILE",
        type=Path,
        help="label map of the photo's size: an id or colour an object, 0 or black for none",
    )
    sub.add_argument("--coco", metavar="FILE", type=Path, help="COCO annotations that hold the photo's masks")
    sub.add_argument(
        "--box",
        metavar="X,Y,W,H",
        action="append",
        default=[],
        help="an object lies in this box; may be repeated",
    )
    sub.add_argument(
        "--point",
        metavar="X,Y",
        action="append",
        default=[],
        help="an object lies at this point; may be repeated",
    )
    sub.add_argument(
        "--label", metavar="NAME=TEXT", action="append", default=[], help="what an object is; may be repeated"
    )
    sub.add_argument("--assets", metavar="DIR", type=Path, help="folder for the maps")
    sub.add_argument(
        "--backend",
        metavar="ROLE=NAME",
        action="append",
        default=[],
        help="who does a step; see physgen backends",
    )

    sub = command(
        "import",
        import_,
        "Somebody else's files to a scene.",
        "physgen import physgen data/pool -o pool.yaml",
    )
    sub.add_argument(
        "kind", choices=("physgen", "coco"), help="physgen: a folder of the paper's code; coco: annotations"
    )
    sub.add_argument("path", metavar="PATH", type=Path, help="the folder or file")
    sub.add_argument(
        "--image", type=Path, help="coco: the photo; default: the file that the annotations name"
    )
    sub.add_argument(
        "-o",
        "--output",
        metavar="SCENE",
        type=Path,
        help="write the scene here (assets beside it); default: stdout",
    )

    sub = command(
        "check", check, "Problems and warnings of scene files.", "physgen check scenes/*/scene.yaml --strict"
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument("--strict", action="store_true", help="warnings count as errors")
    sub.add_argument(
        "--resolved", action="store_true", help="print the scene with overlays applied and defaults filled in"
    )
    sub.add_argument("--json", action="store_true", help="print problems as JSON")
    _overlays(sub)

    sub = command(
        "simulate", simulate, "Scene to trajectory.", "physgen simulate scene.yaml -o trajectory.npz"
    )
    sub.add_argument("scene", metavar="SCENE")
    sub.add_argument(
        "-o", "--output", metavar="FILE", type=Path, help="write a NumPy archive; default: CSV on stdout"
    )
    sub.add_argument("--rate", metavar="HZ", type=_positive, help="samples a second; default: the video's")
    sub.add_argument("--json", action="store_true", help="print everything as JSON")
    _overlays(sub)

    sub = command(
        "render",
        render,
        "Scenes to videos, reports and manifests.",
        "physgen render scene.yaml -o out --format mp4,gif",
    )
    sub.add_argument("scenes", metavar="SCENE", nargs="+")
    sub.add_argument(
        "-o", "--output", metavar="DIR", default="out", help="folder of the results; default: out"
    )
    sub.add_argument(
        "--jobs", metavar="N", type=_count, default=1, help="scenes rendered at a time; default: 1"
    )
    sub.add_argument(
        "--format",
        metavar="LIST",
        type=_formats,
        default=["mp4"],
        help="any of mp4,gif,webp,png; default: mp4",
    )
    sub.add_argument("--json", action="store_true", help="print the folders as JSON")
    _overlays(sub)

    sub = command(
        "backends", list_backends, "Who can do each step, and what is missing.", "physgen backends --json"
    )
    sub.add_argument("--json", action="store_true", help="print as JSON")

    sub = command("schema", schema, "The JSON Schema of scene files.", "physgen schema > scene.schema.json")
    sub.add_argument("--markdown", action="store_true", help="the reference page instead")
    return parser


def _overlays(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="edit a key: objects.ball-1.mass=200; * stands for every object",
    )
    sub.add_argument("--variant", metavar="NAME", help="apply a named variant of the file, or all")
    sub.add_argument(
        "--allow-outside", action="store_true", help="let the scene read files outside its folder"
    )


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1000000")
    return value


def _count(text: str) -> int:
    value = int(text)
    if not 1 <= value <= 1024:
        raise argparse.ArgumentTypeError(f"{text} is not between 1 and 1024")
    return value


def _formats(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in FORMATS]
    if wrong:
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)} is not among {', '.join(FORMATS)}")
    return list(dict.fromkeys(names))


def _numbers(flag: str, text: str, count: int) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(v) < 1e6 for v in values):
        form = ",".join(("120", "80", "60", "60")[:count])
        raise InputError.of(flag, f'"{text}"', f"is not {count} numbers", f"write e.g. {form}")
    return values


def _four(flag: str, text: str) -> tuple[float, float, float, float]:
    a, b, c, d = _numbers(flag, text, 4)
    return a, b, c, d


def _two(flag: str, text: str) -> tuple[float, float]:
    a, b = _numbers(flag, text, 2)
    return a, b


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
    seen: dict[tuple[str, str | None], str] = {}
    problems = []
    for job in jobs:
        path = Path(job.path)
        name = path.resolve().parent.name if path.name == "scene.yaml" else path.stem
        other = seen.setdefault((name, job.variant), job.path)
        if other is not job.path:
            problems += InputError.of(
                job.path,
                "",
                f"would be written over {other}: both are called {name}",
                "render them into two folders",
            ).problems
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


def _print_json(data: Any) -> None:
    import json

    print(json.dumps(data, indent=1, ensure_ascii=False, default=str))


def _pair_header(world: Any) -> str:
    from physgen.compile.pairs import pair_table

    rows = [
        f"{p.first} x {p.second}: friction {p.friction:.4g}, elasticity {p.elasticity:.4g}"
        for p in pair_table(world)
    ]
    return "\n".join(["pair coefficients in use:", *rows]) if rows else ""


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
