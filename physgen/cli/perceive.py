"""Run `perceive` and `import`: turn photos, or folders of the paper's code, into
scenes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import physgen.perceive
from physgen import pipeline
from physgen.cli.arguments import (
    Command,
    Parser,
    check_folder_name,
    check_scene_name,
    coordinates,
    integer_reader,
    names,
    refuse_split_values,
)
from physgen.cli.output import (
    OK,
    Bar,
    print_backup,
    print_error,
    print_problem,
    stdout_file,
    write_result,
)
from physgen.files import check_writable
from physgen.messages import Message
from physgen.problems import THIS_PHOTO, InputError, Place, Problem, collect
from physgen.registry import CONFIGURATION, PROFILES, Backends, load_plan

if TYPE_CHECKING:
    from physgen.registry import Plan

BEGIN = "begin"
"""Stage during the import of the perception packages, which takes seconds."""
LEAST_SIDE = 64
"""Minimum of --side, px. In bundled photos scaled down further, no object is found."""


def perceive(options: argparse.Namespace) -> int:
    bar = Bar()
    with bar.ticking():
        bar.show(BEGIN, 0, 1)
        return _perceive(options, bar)


def _perceive(options: argparse.Namespace, bar: Bar) -> int:
    refuse_split_values(options.command_line, list(map(str, options.image)))
    refuse_scenes(options.image)
    if options.refresh is None and len(options.image) > 1:
        result = perceive_photos(options, bar)
        bar.clear()
        for scene in result.scenes:
            write_result("", scene)
        if result.problems:
            raise InputError(result.problems)
        return OK
    _name_in_folder(options)
    output = options.output or options.refresh
    # The assets of a redirected scene lie beside the target file of stdout.
    if output:
        output_file = None
    else:
        output_file = stdout_file()
    text = perceive_photo(options, bar, output_file)
    bar.clear()
    write_result(text, output, output_file)
    return OK


def perceive_photo(
    options: argparse.Namespace, bar: Bar, stdout_target: Path | None = None
) -> str:
    """Perceive one photo, or refresh a scene. Return the scene's text.

    `stdout_target` is the target file of stdout. Raise InputError.
    """
    boxes = len(options.box)
    output = options.output or options.refresh
    # Collect the problems of all flags, so that the user sees them at once.
    checks: list[Callable[[], Any]] = [
        partial(crew_of, options),
        partial(check_scene_name, options.output),
        partial(_refuse_beside_refresh, options),
        partial(_refuse_push_and_still, options),
        partial(_refuse_without_point, options),
    ]
    coordinate_checks: list[Callable[[], Any]] = [
        *(partial(coordinates, "--box", text, 4) for text in options.box),
        *(partial(coordinates, "--point", text, 2) for text in options.point),
    ]
    results: list[Any] = collect([*checks, *coordinate_checks])
    crew = results[0]
    # Results have the order of the checks: first all boxes, then all points.
    marks = results[len(checks) :]
    settings: dict[str, Any] = {
        "boxes": marks[:boxes],
        "points": marks[boxes:],
        "smallest": options.smallest,
        "labels": options.label,
        "asked": options.find,
        "crew": crew,
        "progress": bar.show,
        "warn": bar.aside(print_problem),
        "keep": bar.aside(print_backup),
        "inform": bar.aside(print_error),
        "still": options.still,
        "pushes": options.push,
        "view": options.view,
    }
    if options.refresh:
        return pipeline.refreshing.refresh(
            options.refresh, output, allow_outside=options.allow_outside, **settings
        )
    settings |= {"masks": options.masks, "side": options.side, "story": options.story}
    settings |= {"stdout": stdout_target, "makes_cache": True}
    return pipeline.perceive(options.image[0], output, **settings)


def _name_in_folder(options: argparse.Namespace) -> None:
    """Put the scene of one photo into the folder of -o, if -o is a folder."""
    out = options.output
    if not options.image or out is None or out.name == "-":
        return
    # A new name without a suffix is that of a folder.
    if out.is_dir() or not (out.suffix or out.exists()):
        options.output = out / f"{options.image[0].stem}.yaml"


def refuse_scenes(images: Sequence[Path]) -> None:
    """Raise InputError if an argument is a scene file instead of a photo."""
    problems = []
    for image in images:
        if image.suffix in (".yaml", ".yml"):
            fix = f"write -o {image}"
            if image.is_file():
                fix = f"write --refresh {image} to perceive its photo again"
            scene = Message.SCENE_FOR_PHOTO
            problems.append(scene.problem(Place(str(image)), fix=fix))
    if problems:
        raise InputError(problems)


@dataclass(frozen=True)
class WrittenScenes:
    """The scenes of several photos."""

    scenes: Sequence[Path]
    problems: Sequence[Problem]
    """Problems of the photos without a scene."""


def _flag_problems(options: argparse.Namespace, names: list[str]) -> list[Problem]:
    """Return the problems of the flags for several photos, whose scenes get `names`."""
    command = Place("perceive")
    flags_of_one_photo = {
        "--masks": options.masks,
        "--box": options.box,
        "--point": options.point,
        "--smallest": options.smallest,
        "--label": options.label,
        "--push": options.push,
    }
    # Boxes, masks and names belong to one photo, and would be wrong for all others.
    problems = []
    for flag, value in flags_of_one_photo.items():
        if value:
            problems.append(Message.FLAG_OF_ONE_PHOTO.problem(command, "", flag))
    if options.output is None or options.output.suffix in (".yaml", ".yml"):
        folder, value_text = Message.PHOTOS_NEED_FOLDER, f"{len(names)} photos"
        problems.append(folder.problem(command, "", value_text))
    for photo in options.image:
        if not photo.is_file():
            problems.append(Message.PHOTO_MISSING.problem(Place(str(photo))))
    for name in sorted({name for name in names if names.count(name) > 1}):
        problems.append(Message.PHOTOS_CALLED_ALIKE.problem(command, "", f'"{name}"'))
    return problems


def perceive_photos(options: argparse.Namespace, bar: Bar) -> WrittenScenes:
    """Perceive several photos into one folder, and load models once.

    An error in one photo does not stop the others. Raise InputError for wrong flags.
    """
    names = _names(options.image)
    wrong_flags = _flag_problems(options, names)
    if wrong_flags:
        raise InputError(wrong_flags)
    check_folder_name(options.output)
    check_writable(options.output)
    # Models stay loaded for all photos.
    crew = crew_of(options, keep=True)
    scenes: list[Path] = []
    problems: list[Problem] = []
    for k, image in enumerate(options.image):
        output = options.output / f"{names[k]}.yaml"

        # The defaults bind the photo of this pass, since the loop changes its
        # variables.
        def step(
            stage: str, done: int, total: int, k: int = k, name: str = image.name
        ) -> None:
            bar.show(f"{name}: {stage}", k * total + done, len(options.image) * total)

        report = PhotoReport(image, bar)
        try:
            pipeline.perceive(
                image, output, crew=crew, asked=options.find, side=options.side, still=options.still,
                story=options.story,
                view=options.view,
                progress=step, warn=report.warn, keep=bar.aside(print_backup),
                inform=report.inform,
            )  # fmt: skip
            scenes.append(output)
        except InputError as error:
            problems += error.problems
        report.print_warnings()
    return WrittenScenes(scenes, problems)


@dataclass
class PhotoReport:
    """The printed report of one of several photos: its heading, then its warnings."""

    image: Path
    bar: Bar
    warnings: list[Problem] = field(default_factory=list)

    def warn(self, problem: Problem) -> None:
        """Keep a warning for the time after the heading, and add the photo's name."""
        if problem.place == THIS_PHOTO:
            problem = replace(problem, place=Place(str(self.image)))
        self.warnings.append(problem)

    def inform(self, summary: str) -> None:
        """Print the first line of a summary, and below it the stored warnings."""
        self.bar.aside(print_error)(summary.partition("\n")[0])
        self.print_warnings()

    def print_warnings(self) -> None:
        """Print the stored warnings."""
        for problem in self.warnings:
            self.bar.aside(print_problem)(problem)
        self.warnings.clear()


def _names(images: Sequence[Path]) -> list[str]:
    """Return the names of the scenes: names of the photos, or of their folders if all
    photos have one name.
    """
    stems = [image.stem for image in images]
    folders = [image.resolve().parent.name for image in images]
    # `a/photo.jpg b/photo.jpg`: only the folders tell the photos apart.
    if len(set(stems)) == 1 < len(stems) == len(set(folders)):
        return folders
    return stems


def crew_of(options: argparse.Namespace, *, keep: bool = False) -> Backends:
    """Return the perception backends chosen by flags. `keep` keeps models for further
    photos.
    """
    return Backends(
        replace(plan_of(options), keep=keep).of(physgen.perceive.perception_run.ROLES)
    )


def plan_of(options: argparse.Namespace) -> Plan:
    """Return the choice of backends from flags and the configuration file."""
    if options.config is None and Path(CONFIGURATION).is_file():
        print_error(
            f"{CONFIGURATION}: the one in this folder is not read; --config {CONFIGURATION} reads it"
        )
    return load_plan(options.backend, profile=options.profile, config=options.config)


def _refuse_beside_refresh(options: argparse.Namespace) -> None:
    """Raise InputError for flags that contradict --refresh: the scene determines its
    photo and masks.
    """
    if not options.refresh and not options.image:
        raise Message.NO_PHOTO.error("perceive")
    # A refresh reads the photo and the size from the scene: other ones would not fit
    # its masks.
    excluded_flags = {
        "IMAGE": (options.image or [None])[0],
        "--masks": options.masks,
        "--side": options.side,
    }
    place = Place("perceive")
    problems = []
    for flag, value in excluded_flags.items():
        if options.refresh and value is not None:
            problems.append(
                Message.NOT_WITH_REFRESH.problem(place, "", f'"{value}"', flag=flag)
            )
    if (
        options.refresh
        and not options.output
        and options.refresh.suffix not in (".yaml", ".yml")
    ):
        problems.append(Message.REFRESH_NEEDS_OUTPUT.problem(place, "", "--refresh"))
    if problems:
        raise InputError(problems)


def _refuse_push_and_still(options: argparse.Namespace) -> None:
    """Raise InputError if --push comes with --still, or a story with other pushes or an
    old scene.
    """
    if options.push:
        others = ["--push"]
    else:
        others = []
    others += ["--still"] if options.still else []
    others += ["--refresh"] if options.refresh else []
    if options.story is not None and others:
        found = f'"{options.story}"'
        raise Message.STORY_WITH_OTHERS.error("--story", found, flag=others[0])
    if options.push and options.still:
        value_text = f'"{options.push[0]}"'
        raise Message.PUSH_AND_STILL.error("--push", value_text)


def _refuse_without_point(options: argparse.Namespace) -> None:
    """Raise InputError for --smallest without a point."""
    if options.smallest and not options.point:
        raise Message.SMALLEST_WITHOUT_POINT.error("perceive", "--smallest")


def import_(options: argparse.Namespace) -> int:
    check_scene_name(options.output)
    if options.output:
        output_file = None
    else:
        output_file = stdout_file()
    bar = Bar()
    text = pipeline.import_physgen(
        options.path,
        options.output,
        bar.show,
        print_problem,
        print_backup,
        stdout=output_file,
        faithful=options.faithful,
    )
    bar.clear()
    write_result(text, options.output, output_file)
    return OK


def add_perceive(parser: Parser) -> None:
    help_text = "the photo; several photos go into the folder of -o, and one where that has no suffix"
    parser.add_argument("image", metavar="IMAGE", type=Path, nargs="*", help=help_text)
    help_text = (
        "perceive a scene's photo again, in place unless -o names another file: values in the scene are kept, its "
        "boxes and points are used again, and new --box and --point correct or add objects"
    )
    parser.option("--refresh", "SCENE", Path, help_text)
    parser.flag(
        "--allow-outside", "with --refresh: the scene may read files outside its folder"
    )
    parser.option(
        "-o --output",
        "SCENE",
        Path,
        "write the scene here (assets beside it); default: stdout",
    )
    add_photo_flags(parser)
    help_text = (
        "push this object in place of the one that perceive chooses: ball-1=right, "
        "ball-1=up-left@0.5 m/s; may be repeated"
    )
    parser.option(
        "--push", "NAME=DIRECTION[@SPEED]", str, help_text, [], action="append"
    )
    help_text = (
        'find the push by which a sentence comes true: "the ball hits the bottle"'
    )
    parser.option("--story", "SENTENCE", str, help_text)
    add_backends(parser)


def add_photo_flags(parser: Parser) -> None:
    """Add the flags of a photo's perception."""
    help_text = (
        "label map of the photo's size: an id or colour for each object, 0, black or "
        "transparent for none; of one opaque colour, each region is an object"
    )
    parser.option("--masks", "FILE", Path, help_text)
    help_text = (
        "box around an object, in px of the photo that you give; may be repeated; "
        "without --refresh, other objects are left out"
    )
    parser.option("--box", "X,Y,W,H", str, help_text, [], action="append")
    parser.option(
        "--point",
        "X,Y",
        str,
        "point on an object, in px of the photo that you give; may be repeated",
        [],
        action="append",
    )
    help_text = "with --point: the smallest object there, not the whole one"
    parser.flag("--smallest", help_text)
    help_text = "what an object is; may be repeated"
    parser.option("--label", "NAME=TEXT", str, help_text, [], action="append")
    help_text = "longest side of the scene's photo, px; default: at most 1600"
    parser.option("--side", "PX", integer_reader(LEAST_SIDE, 100_000), help_text)
    parser.flag("--still", "leave out the push that sets the scene in motion")
    help_text = "how the photo was taken, if perceive takes it the other way"
    parser.option("--view", "side|top", str, help_text, choices=("side", "top"))
    help_text = 'what to look for, for backends that find what they are asked for: "ball, wooden block"'
    parser.option("--find", "NOUN,...", names, help_text, [])


def add_backends(parser: Parser) -> None:
    """Add the flags of backends."""
    add_backend_choices(parser)
    parser.option(
        "--config", "FILE", Path, "read this in place of ~/.config/physgen/physgen.toml"
    )


def add_backend_choices(parser: Parser) -> None:
    """Add the flags of backends, without the configuration file."""
    help_text = "the backend of a step, and the hub id or path of its weights; see physgen backends"
    parser.option(
        "--backend", "ROLE=NAME[:WEIGHTS]", str, help_text, [], action="append"
    )
    help_text = f"a set of backends: {', '.join(PROFILES)}"
    parser.add_argument(
        "--profile", metavar="NAME", choices=list(PROFILES), help=help_text
    )


def add_import(parser: Parser) -> None:
    parser.add_argument(
        "kind", choices=("physgen",), help="a folder of the paper's code"
    )
    parser.add_argument("path", metavar="PATH", type=Path, help="the folder")
    parser.option(
        "-o --output",
        "SCENE",
        Path,
        "write the scene here (assets beside it); default: stdout",
    )
    parser.flag(
        "--faithful",
        "keep the paper's frames, discs, outlines and tables without friction",
    )


PERCEIVE = Command(
    "perceive",
    "Perceives a photo and writes its scene file and assets.",
    "physgen perceive photo.png > scene.yaml",
    add_perceive,
    perceive,
    is_order_free=True,
)
IMPORT = Command(
    "import",
    "Converts a scene folder of the paper's code to a scene.",
    "physgen import physgen data/pool -o pool.yaml",
    add_import,
    import_,
)
