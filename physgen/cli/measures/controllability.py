"""`evaluate controllability`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from physgen.cli.measures.findings import hand_over
from physgen.cli.printing import Bar
from physgen.problems import InputError


def controllability(options: argparse.Namespace) -> int:
    from physgen import pipeline
    from physgen.evaluate.controllability.sweep import sweep
    from physgen.evaluate.controllability.told import findings
    from physgen.evaluate.page import check_folder

    check_folder(options.output)
    if options.variant == "all":
        raise InputError.of("--variant", "all", "names more than one", "write one name")
    if options.output:
        from physgen.report.plots.look import needed

        needed()
    where = Path(options.scene)
    if where.is_dir() and not (where / "scene.yaml").is_file():
        from physgen.evaluate.controllability.clips import swept_clips

        _refuse(options)
        swept = swept_clips(where, options.object)
    else:
        scene = pipeline.load(options.scene, options.set, options.variant, options.allow_outside)
        bar = Bar()
        swept = sweep(scene, options.object, options.angles, options.sizes, bar.show)
        bar.clear()
    told = findings(swept)
    if options.output:
        from physgen.evaluate.controllability.drawn import plots

        first, *rest = told.sections
        told = replace(told, sections=(replace(first, parts=(*plots(swept), *first.parts)), *rest))
    return hand_over(told, options)


def _refuse(options: argparse.Namespace) -> None:
    """Clips are as they are."""
    beside = {"--sizes": options.sizes, "--set": options.set, "--variant": options.variant}
    for flag, value in beside.items():
        if value:
            fix = f"leave {flag} out, or name a scene"
            raise InputError.of(flag, "", "has no meaning for clips that are made already", fix)
