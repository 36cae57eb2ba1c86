"""A sweep and its scene file -> what is wrong before anything is made: keys, and values that somebody wrote."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from physgen.batch.axes import Axis, Listed
from physgen.batch.sweep import Sweep
from physgen.batch.values import Value
from physgen.problems import InputError, Place, Problem, Severity, by_place
from physgen.scene.build import Opened
from physgen.scene.model import Scene
from physgen.scene.words import KeyPath, listed, quoted

MOST_TRIED = 200
"""Values that somebody wrote, tried at most: no sweep begins with a long wait."""
MOST_VARIANTS = 50


@dataclass(frozen=True)
class Trial:
    """What trying told."""

    objects: tuple[str, ...]
    """Names of all that can move, of all variants, in natural order."""
    size: tuple[int, int]
    """Of the video, px, as the first clip has it."""
    warnings: tuple[Problem, ...]
    """Values of which every clip will fail."""


def tried(sweep: Sweep, opened: Opened, overrides: Sequence[str] = ()) -> Trial:
    """The first value of every key together, then the other values one by one; `overrides` are those of `--set`.

    Raises InputError where the first ones make no scene: a key is misspelt, then, or no value fits it. Others that
    make none are warnings: their clips fail, and the rest does not.
    """
    typical = sweep.typical()
    scenes = []
    problems: dict[Problem, None] = {}
    for variant in sweep.variants[:MOST_VARIANTS]:
        try:
            scenes.append(_scene(sweep, opened, overrides, typical, variant))
        except InputError as error:
            problems |= dict.fromkeys(error.problems)
    if not problems:
        problems = dict.fromkeys(_without_effect(sweep.axes, typical, scenes[0]))
    if problems:
        raise InputError(problems)
    names = {item.name: None for scene in scenes for item in scene.objects if item.motion.value != "static"}
    warnings = by_place(_failing(sweep, opened, overrides, typical))
    return Trial(tuple(names), scenes[0].video_size, tuple(warnings))


def _scene(
    sweep: Sweep, opened: Opened, overrides: Sequence[str], values: Sequence[Value], variant: str | None
) -> Scene:
    """Raises InputError; what `--set` would say of a value, the argument says."""
    ours = sweep.set_to(values)
    named = {quoted(f"--set {text}", "", 80): axis.place for text, axis in zip(ours, sweep.axes, strict=True)}
    try:
        return opened.scene((*overrides, *ours), variant)
    except InputError as error:
        raise InputError(renamed(error.problems, named)) from None


def renamed(problems: Sequence[Problem], named: dict[str, Place]) -> list[Problem]:
    """Problems of files in `named`, with the places there."""
    return [replace(problem, place=named.get(problem.place.file, problem.place)) for problem in problems]


def _failing(
    sweep: Sweep, opened: Opened, overrides: Sequence[str], typical: tuple[Value, ...]
) -> Iterator[Problem]:
    """Each value in the company of the first ones of the other keys."""
    left = MOST_TRIED
    for n, axis in enumerate(sweep.axes):
        for index in axis.telling if isinstance(axis, Listed) else ():
            if index == 0:
                continue
            left -= 1
            if left < 0:
                return
            assert isinstance(axis, Listed)
            values = (*typical[:n], axis.at(index), *typical[n + 1 :])
            try:
                _scene(sweep, opened, overrides, values, sweep.variants[0])
            except InputError as error:
                yield from (
                    replace(
                        problem, fix=f"{problem.fix}; as it is, its clips fail", severity=Severity.WARNING
                    )
                    for problem in error.problems
                )


def _without_effect(axes: Sequence[Axis], values: Sequence[Value], scene: Scene) -> Iterator[Problem]:
    """Keys that another argument's key rules out, as a mass does a density: they are not in the scene."""
    for axis, value in zip(axes, values, strict=True):
        if value.data is not None and not _there(scene.document, axis.path):
            others = [str(other.place) for other in axes if other is not axis]
            expected = f"has no effect: {listed(others, 'or')} rules it out"
            yield Problem(axis.place, "", "", expected, "keep one of them")


def _there(document: Any, path: KeyPath) -> bool:
    """Whether anything in the document has the path."""
    if not path:
        return True
    part, rest = path[0], path[1:]
    if isinstance(document, list):
        if part in ("*", "[*]"):
            return any(_there(item, rest) for item in document)
        return str(part).isdecimal() and int(part) < len(document) and _there(document[int(part)], rest)
    try:
        items = dict(document)
    except (TypeError, ValueError):
        return False
    if part == "*":
        return any(_there(item, rest) for item in items.values())
    return part in items and _there(items[part], rest)
