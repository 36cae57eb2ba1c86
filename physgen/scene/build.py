"""Path of a scene file, flags -> frozen Scene; raises InputError with every problem at once."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from physgen.problems import InputError, Place, Problem
from physgen.scene import model
from physgen.scene.check import checker
from physgen.scene.files import read_scene, with_bases
from physgen.scene.freeze import frozen
from physgen.scene.ground import Files, Ground
from physgen.scene.node import Node, Source, children, items, plain
from physgen.scene.overlay import apply, edit_of_flag, edits_of_variant, targets, variants_of
from physgen.scene.report import Report, TooManyError
from physgen.scene.rules import check_rules
from physgen.scene.words import listed, nearest, quoted

MAX_CHECKS = 500_000
"""Variants times the things in a scene: what checking every variant may cost."""
MAX_EDITS = 20_000
"""Values that the variants of a file set, a * counted as often as it applies."""


def load(
    path: str | os.PathLike[str],
    overrides: Sequence[str] = (),
    variant: str | None = None,
    allow_outside: bool = False,
) -> model.Scene:
    """The scene of a file, with what it extends, one of its variants and `KEY=VALUE` overrides on top.

    Every variant of the file is checked, whichever is asked for. Paths in the file stay below its folder
    unless `allow_outside`; see files.py. Raises InputError with all problems, sorted by place.
    """
    name = os.fspath(path)
    file = Path(name)
    source = Source(name, Path(os.path.abspath(file)).parent)
    written = with_bases(read_scene(file, name), file, allow_outside)
    files = Files(allow_outside)
    edited = _edited(written, overrides, variant, source)
    report = Report()
    ground = _check(edited, report, files)
    _check_variants(written, report if edited is written else Report(), report, files)
    if report.problems:
        raise InputError(report.problems)
    return frozen(edited, scene_name(file), source, ground)


def written(path: str | os.PathLike[str], allow_outside: bool = False) -> dict[str, Any]:
    """A file as plain YAML data, with what it extends and without any default. Raises InputError."""
    name = os.fspath(path)
    document = plain(with_bases(read_scene(Path(name), name), Path(name), allow_outside))
    assert isinstance(document, dict)
    return document


def _edited(root: Node, overrides: Sequence[str], variant: str | None, source: Source) -> Node:
    """The tree after a variant and the overrides; raises InputError with every edit that cannot be made."""
    problems: list[Problem] = []
    edits = []
    if variant is not None:
        known = dict(variants_of(root))
        if variant in known:
            edits += edits_of_variant(known[variant], variant)
        else:
            close = nearest(variant, known)
            fix = f'did you mean "{close}"?' if close else f"write one of {listed(list(known)[:30])}"
            fix = fix if known else "the file has no variants"
            found = quoted(variant)
            problems.append(
                Problem(Place(f"--variant {quoted(variant, '')}"), "", found, "is not a variant", fix)
            )
    for text in overrides:
        try:
            edits.append(edit_of_flag(text, source))
        except InputError as error:
            problems += error.problems
    for edit in edits:
        try:
            root = apply(root, edit)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))
    return root


def _check(root: Node, report: Report, files: Files) -> Ground:
    try:
        checker()(root, (), report)
        return check_rules(root, report, files)
    except TooManyError:
        return Ground()


def _check_variants(root: Node, report: Report, into: Report, files: Files) -> None:
    """Adds to `into` what each variant of the file would break that the file itself does not."""
    named = list(variants_of(root))
    if not named or len(into.problems) > 100:
        return
    things = 16 + _things(root)
    edits = sum(targets(root, key) for _, node in named for key in children(node))
    place = children(root)["variants"].key_place
    if len(named) * things > MAX_CHECKS or edits > MAX_EDITS:
        into.problems[
            Problem(place, "variants", "", "are too many for a scene of this size", "use sweep")
        ] = None
        return
    if report is not into:
        _check(root, report, files)
    before = set(report.problems)
    for name, node in named:
        changed = root
        try:
            for edit in edits_of_variant(node, name):
                changed = apply(changed, edit)
        except InputError as error:
            report.problems.update(dict.fromkeys(error.problems))
            continue
        _check(changed, report, files)
    into.problems.update((problem, None) for problem in report.problems if problem not in before)


def _things(root: Node) -> int:
    """How many mappings and names the rules between keys look at."""
    sections = [children(root, key) for key in ("objects", "boundaries", "joints", "fields")]
    names = sum(len(items(children(node).get("objects"))) for part in sections[2:] for node in part.values())
    listed_things = (children(root).get("forces"), children(root, "render").get("camera"))
    return sum(map(len, sections)) + names + sum(len(items(node)) for node in listed_things)


def scene_name(file: Path) -> str:
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    return Path(os.path.abspath(file)).parent.name if file.name == "scene.yaml" else file.stem
