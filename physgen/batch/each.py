"""`objects.*.mass=~each uniform(50, 200)` and a scene -> a key with draws of its own for each thing that `*` means."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from physgen.batch.axes import STARS, Axis, Drawn, covers
from physgen.problems import InputError, Problem
from physgen.scene.words import KeyPath, dotted


def apart(axes: Sequence[Axis], documents: Sequence[Any]) -> tuple[Axis, ...]:
    """All axes, those with `each` as one for each key that they mean; what a later axis sets anyway is left out.

    `documents` are the resolved scenes that the sweep starts from, as plain data: what some of them lack is no key.
    Raises InputError where there is none at all.
    """
    found: list[Axis] = []
    problems: list[Problem] = []
    for n, axis in enumerate(axes):
        if not isinstance(axis, Drawn) or not axis.each:
            found.append(axis)
            continue
        ways = [list(_meant(document, axis.path)) for document in documents]
        common = [way for way in ways[0] if all(way in others for others in ways[1:])]
        if not common:
            problems.append(
                Problem(axis.place, "", "", "means nothing that the scene has", "see the key's first parts")
            )
        text = axis.argument.partition("=")[2].lstrip(" ~").removeprefix("each").strip()
        for way in common:
            if not any(covers(later.path, way) for later in axes[n + 1 :]):
                key = dotted(way)
                found.append(replace(axis, key=key, argument=f"{key}=~{text}", each=False))
    if problems:
        raise InputError(problems)
    return tuple(found)


def _meant(document: Any, path: KeyPath, way: KeyPath = ()) -> Iterator[KeyPath]:
    """Ways that the path means, its stars replaced; what stands behind the last star need not be there."""
    star = next((k for k, part in enumerate(path) if part in STARS), None)
    if star is None:
        yield (*way, *path)
        return
    place = document
    for part in path[:star]:
        place = _child(place, part)
    if isinstance(place, list) and path[star] in ("*", "[*]"):
        children: Iterator[tuple[str | int, Any]] = iter(enumerate(place))
    elif path[star] == "*" and hasattr(place, "items"):
        children = iter(place.items())
    else:
        return
    for name, child in children:
        yield from _meant(child, path[star + 1 :], (*way, *path[:star], name))


def _child(place: Any, part: str | int) -> Any:
    """None where there is none."""
    if isinstance(place, list):
        return place[int(part)] if str(part).isdecimal() and int(part) < len(place) else None
    return place.get(part) if hasattr(place, "get") else None
