"""`perceive`, `import` and `backends`: photos, or files of other programs, to scenes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.cli.arguments import four, nouns, scene_name, side, two
from physgen.cli.output import OK, Bar, print_backup, print_error, print_json, print_problem, write_result
from physgen.problems import InputError, Problem

if TYPE_CHECKING:
    from physgen.registry import Backends, Plan


# ----------------------------------------------------------------------
# `perceive`, `import` and `backends`: photos, or somebody else's files, to scenes.


def perceive(options: argparse.Namespace) -> int:
    from physgen import pipeline

    folder = options.output is not None and options.output.is_dir()
    if options.refresh is None and (len(options.image) > 1 or (options.image and folder)):
        return _perceive_many(options)
    scene_name(options.output)
    bar = Bar()
    told: dict[str, Any] = {
        "boxes": [four("--box", text) for text in options.box],
        "points": [two("--point", text) for text in options.point],
        "assets": options.assets,
        "crew": _crew(_plan(options)),
        "progress": bar.show,
        "warn": print_problem,
        "keep": print_backup,
    }
    if options.refresh:
        _refuse_beside_refresh(options)
        if options.output is None:
            fix = "say where the new scene goes, with its maps beside it: -o NEW.yaml"
            raise InputError.of("perceive", "--refresh", "needs -o", fix)
        from physgen.pipeline.refresh import refresh

        told |= {"allow_outside": options.allow_outside, "sheet": options.sheet, "asked": options.find}
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
    write_result(text, options.output)
    return OK


def _perceive_many(options: argparse.Namespace) -> int:
    """Several photos into one folder, with models loaded once; what is wrong with one leaves the others be."""
    from physgen import pipeline

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
    for lost in (image for image in options.image if not image.is_file()):
        problems += InputError.of(str(lost), "", "is not there", "name a photo").problems
    names = _names(options.image)
    for twin in sorted({name for name in names if names.count(name) > 1}):
        problems += InputError.of("perceive", f'"{twin}"', "is the name of two photos", "rename one").problems
    if problems:
        raise InputError(problems)
    crew = _crew(_plan(options, several=True))
    failed: list[Problem] = []
    bar = Bar()
    for k, image in enumerate(options.image):
        output = options.output / f"{names[k]}.yaml"

        def step(stage: str, done: int, total: int, k: int = k, name: str = image.name) -> None:
            bar.show(f"{name}: {stage}", k * total + done, len(options.image) * total)

        try:
            pipeline.perceive(
                image, output, crew=crew, asked=options.find, side=options.side,
                progress=step, warn=print_problem, keep=print_backup,
            )  # fmt: skip
            write_result("", output)
        except InputError as error:
            failed += error.problems
    bar.clear()
    if failed:
        raise InputError(failed)
    return OK


def _names(images: Sequence[Path]) -> list[str]:
    """What their scenes are called: as the photos, or as their folders where all photos have one name."""
    stems = [image.stem for image in images]
    folders = [image.resolve().parent.name for image in images]
    return folders if len(set(stems)) == 1 < len(stems) == len(set(folders)) else stems


def crew_of(options: argparse.Namespace) -> Backends:
    """Who perceives one photo, by the flags."""
    return _crew(_plan(options))


def _crew(plan: Plan) -> Backends:
    """Those of a plan who perceive: a model that it chooses for videos is not asked for here."""
    from physgen.perceive.perceive import ROLES
    from physgen.registry import Backends

    return Backends(plan.of(ROLES))


def _plan(options: argparse.Namespace, several: bool = False) -> Plan:
    """Models are kept for several photos, unless a flag or a file says otherwise."""
    from physgen.registry import configuration_files, load_plan

    if options.config is None:
        for path in configuration_files():
            print_error(f"{path}: says who perceives, where no flag does")
    return load_plan(
        options.backend,
        profile=options.profile,
        config=options.config,
        device=options.device,
        dtype=options.dtype,
        fallback=options.fallback,
        keep=getattr(options, "keep_models", None),
        otherwise={"keep": several},
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
        text = pipeline.import_physgen(options.path, options.output, bar.show, print_problem, print_backup)
    else:
        text = pipeline.import_coco(options.path, options.image, options.output, bar.show, print_backup)
    bar.clear()
    write_result(text, options.output)
    return OK


def list_backends(options: argparse.Namespace) -> int:
    from physgen import registry

    rows = registry.listing(_plan(options))
    if options.json:
        print_json({"backends": rows})
        return OK
    for line in registry.listing_lines(rows):
        print(line)
    print("\n* does its step unless --backend, --profile or physgen.toml says otherwise", file=sys.stderr)
    return OK


# ----------------------------------------------------------------------
# Flags of `perceive`, and of who perceives.


def add_perceive(sub: argparse.ArgumentParser) -> None:
    """Those of the command."""
    sub.add_argument(
        "image", metavar="IMAGE", type=Path, nargs="*", help="the photo; several go into the folder -o"
    )
    sub.add_argument(
        "--refresh",
        metavar="SCENE",
        type=Path,
        help="perceive a scene's photo again: what the scene says stays, boxes and points that it holds are asked "
        "again, new --box and --point correct or add objects",
    )
    sub.add_argument(
        "--allow-outside",
        action="store_true",
        help="with --refresh: the scene may read files outside its folder",
    )
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
    sub.add_argument(
        "--side",
        metavar="PX",
        type=side,
        help="longest side of the scene's photo, px; default: at most 1600",
    )
    sub.add_argument("--assets", metavar="DIR", type=Path, help="folder for the maps")
    sub.add_argument(
        "--sheet",
        metavar="FILE.png",
        type=Path,
        help="draw all that was perceived on one picture, to look at",
    )
    sub.add_argument(
        "--find",
        metavar="NOUN,...",
        type=nouns,
        default=[],
        help='what to look for, for backends that find what they are told to: "ball, wooden block"',
    )
    add_backends(sub)
    sub.add_argument(
        "--keep-models",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="keep models in memory after their step; without it, only where there are several photos",
    )


def add_backends(sub: argparse.ArgumentParser) -> None:
    """Flags that say who perceives, and where."""
    sub.add_argument(
        "--backend",
        metavar="ROLE=NAME[:WEIGHTS]",
        action="append",
        default=[],
        help="who does a step, and the hub id or path of what it loads; see physgen backends",
    )
    sub.add_argument(
        "--profile", metavar="NAME", help="a set of backends: offline, models, best, or one of physgen.toml"
    )
    sub.add_argument("--config", metavar="FILE", type=Path, help="read this in place of physgen.toml")
    sub.add_argument("--device", metavar="DEVICE", help="where models run: auto, cpu, cuda, cuda:1 or mps")
    sub.add_argument("--dtype", metavar="TYPE", help="their numbers: auto, float32, float16 or bfloat16")
    sub.add_argument(
        "--fallback",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="where a backend fails, let the offline one take over, and say so",
    )
