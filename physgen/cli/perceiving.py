"""`perceive`, `import` and `backends`: photos, or somebody else's files, to scenes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physgen.cli.printing import OK, Bar, hand_over, print_json, tell, tell_kept, tell_one
from physgen.flags.values import four, scene_name, two
from physgen.problems import InputError, Problem

if TYPE_CHECKING:
    from physgen.crew import Crew, Plan


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
        "warn": tell_one,
        "keep": tell_kept,
    }
    if options.refresh:
        _refuse_beside_refresh(options)
        if options.output is None:
            fix = "say where the new scene goes, with its maps beside it: -o NEW.yaml"
            raise InputError.of("perceive", "--refresh", "needs -o", fix)
        from physgen.refresh import refresh

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
    hand_over(text, options.output)
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
                progress=step, warn=tell_one, keep=tell_kept,
            )  # fmt: skip
            hand_over("", output)
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


def crew_of(options: argparse.Namespace) -> Crew:
    """Who perceives one photo, by the flags."""
    return _crew(_plan(options))


def _crew(plan: Plan) -> Crew:
    """Those of a plan who perceive: a model that it chooses for videos is not asked for here."""
    from physgen.crew import Crew
    from physgen.perceive.scene import ROLES

    return Crew(plan.of(ROLES))


def _plan(options: argparse.Namespace, several: bool = False) -> Plan:
    """Models are kept for several photos, unless a flag or a file says otherwise."""
    from physgen.configured import found, plan

    if options.config is None:
        for path in found():
            tell(f"{path}: says who perceives, where no flag does")
    return plan(
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
        text = pipeline.import_physgen(options.path, options.output, bar.show, tell_one, tell_kept)
    else:
        text = pipeline.import_coco(options.path, options.image, options.output, bar.show, tell_kept)
    bar.clear()
    hand_over(text, options.output)
    return OK


def list_backends(options: argparse.Namespace) -> int:
    from physgen import roster

    rows = roster.listing(_plan(options))
    if options.json:
        print_json({"backends": rows})
        return OK
    for line in roster.text(rows):
        print(line)
    print("\n* does its step unless --backend, --profile or physgen.toml says otherwise", file=sys.stderr)
    return OK
