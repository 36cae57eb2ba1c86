"""Formats and a scene -> the maps that the scene lacks for them, told all at once."""

from __future__ import annotations

from collections.abc import Sequence

from physgen.export.writing import Kind
from physgen.percepts.maps import Percepts
from physgen.problems import InputError, Problem
from physgen.scene.model import Scene

HOW = {"depth": " --backend depth=NAME"}
"""What `perceive` has to be told to make a map that it does not make by itself."""


def lacking(kinds: Sequence[Kind], scene: Scene, maps: Percepts | None) -> None:
    """Raises InputError with every format that cannot be written for want of a map."""
    problems = []
    for kind in kinds:
        if not kind.needs or (maps is not None and getattr(maps, kind.needs) is not None):
            continue
        found = f'--format "{kind.name}"'
        if maps is None:
            place, path, expected = (
                scene.place("size"),
                "",
                "is made of a photo's maps, and there is no photo",
            )
            fix = f"leave {kind.name} out"
        else:
            place, path = scene.place("assets"), "assets"
            expected = f"is made of {kind.needs}.png, which is not there"
            how = HOW.get(kind.needs, "")
            fix = f"have it made: physgen perceive --refresh {place.file}{how} -o NEW.yaml"
        problems.append(Problem(place, path, found, expected, fix))
    if problems:
        raise InputError(problems)
