"""Path of a scene file, flags -> frozen Scene; raises InputError with every problem at once.

An `Opened` file makes any number of scenes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from physgen.problems import InputError, Place, Problem
from physgen.scene import model
from physgen.scene.check import checker
from physgen.scene.document import decode, read
from physgen.scene.files import read_scene, with_bases
from physgen.scene.freeze import frozen
from physgen.scene.ground import Files, Ground
from physgen.scene.node import Node, Source, children, items, plain
from physgen.scene.overlay import apply, edit_of_flag, edits_of_variant, targets, variants_of
from physgen.scene.report import Report, TooManyError
from physgen.scene.rules import check_rules
from physgen.scene.words import listed, nearest, quoted
from physgen.whole import stamped

MAX_CHECKS = 500_000
"""Variants times the things in a scene: what checking every variant may cost."""
MAX_EDITS = 20_000
"""Values that the variants of a file set, a * counted as often as it applies."""


class Opened:
    """A scene file that was read and checked, for any number of its variants: an edit costs what it changes.

    Of a scene that is right, what an edit leaves as it was is not checked again. `shown` is what messages call it
    where that is not its path. While it is being edited, `text` is what the file will hold, and `assets` the folder
    that its maps are in meanwhile.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        allow_outside: bool = False,
        shown: str | None = None,
        text: str | None = None,
        assets: Path | None = None,
    ) -> None:
        self.file = Path(os.fspath(path))
        name = shown or os.fspath(path)
        self._source = Source(name, Path(os.path.abspath(self.file)).parent)
        self._stamps = {self.file: stamped(self.file)} if text is None else {}
        own = read_scene(self.file, name) if text is None else _draft(text, self._source)
        self._root = with_bases(own, self.file, allow_outside, self._stamps)
        self._files = Files(allow_outside, assets)
        self.variants = tuple(name for name, _ in variants_of(self._root))
        self._own = Report()
        _check(self._root, self._own, self._files)
        self._of_variants = tuple(_problems_of_variants(self._root, self._own, self._files))

    def document(self) -> dict[str, Any]:
        """As plain YAML data, with what it extends and without any default."""
        data = plain(self._root)
        assert isinstance(data, dict)
        return data

    def stale(self) -> bool:
        """Whether it, or a file that it extends, was written since."""
        return any(stamped(file) != stamp for file, stamp in self._stamps.items())

    def scene(self, overrides: Sequence[str] = (), variant: str | None = None) -> model.Scene:
        """With one of its variants and `KEY=VALUE` overrides on top; raises InputError with all problems."""
        edited = _edited(self._root, overrides, variant, self._source)
        report = Report() if self._own.problems else self._own.beyond()
        ground = _check(
            edited, report, self._files
        )  # of the file itself too: the photo may be another by now
        problems = dict.fromkeys((*report.problems, *self._of_variants))
        if problems:
            raise InputError(problems)
        return replace(frozen(edited, scene_name(self.file), self._source, ground), files=tuple(self._stamps))


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
    return Opened(path, allow_outside).scene(overrides, variant)


def written(path: str | os.PathLike[str], allow_outside: bool = False) -> dict[str, Any]:
    """A file as plain YAML data, with what it extends and without any default. Raises InputError."""
    name = os.fspath(path)
    document = plain(with_bases(read_scene(Path(name), name), Path(name), allow_outside))
    assert isinstance(document, dict)
    return document


def _draft(text: str, source: Source) -> Node:
    """The tree of a file's text; raises InputError as if the file were read."""
    return read(decode(text.encode("utf-8", "surrogatepass"), source.name), source)


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


def _problems_of_variants(root: Node, own: Report, files: Files) -> Iterator[Problem]:
    """What each variant of the file would break that the file itself, of which `own` tells, does not."""
    named = list(variants_of(root))
    if not named or len(own.problems) > 100:
        return
    things = 16 + _things(root)
    edits = sum(targets(root, key) for _, node in named for key in children(node))
    place = children(root)["variants"].key_place
    if len(named) * things > MAX_CHECKS or edits > MAX_EDITS:
        yield Problem(place, "variants", "", "are too many for a scene of this size", "use sweep")
        return
    report = own.beyond()
    report.problems = dict(own.problems)
    for name, node in named:
        changed = root
        try:
            for edit in edits_of_variant(node, name):
                changed = apply(changed, edit)
        except InputError as error:
            report.problems.update(dict.fromkeys(error.problems))
            continue
        _check(changed, report, files)
    yield from (problem for problem in report.problems if problem not in own.problems)


def _things(root: Node) -> int:
    """How many mappings and names the rules between keys look at."""
    sections = [children(root, key) for key in ("objects", "boundaries", "joints", "fields")]
    names = sum(len(items(children(node).get("objects"))) for part in sections[2:] for node in part.values())
    listed_things = (children(root).get("forces"), children(root, "render").get("camera"))
    return sum(map(len, sections)) + names + sum(len(items(node)) for node in listed_things)


def scene_name(file: Path) -> str:
    """The file's stem, or its folder's name where the file is called `scene.yaml`."""
    return Path(os.path.abspath(file)).parent.name if file.name == "scene.yaml" else file.stem
