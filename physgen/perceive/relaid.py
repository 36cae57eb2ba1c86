"""A scene's boundaries, some of which perception laid -> those it lays now in their place, and those that a person set.

Nothing in a file says whether a wall was moved by hand. But what perception lays under the objects as the file has
them can be laid again, for either view: a wall of the file that is one of those is perception's own.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from physgen.geometry import Array
from physgen.outline.simplify import distances_to_line
from physgen.perceive import words
from physgen.perceive.roles import Setting

NEAR = 0.5
"""px between two walls that are one: outlines of stored masks are a little rounder than those first found."""


def laid(boundaries: Mapping[str, Any], setting: Setting) -> set[str]:
    """Names of a scene's `boundaries` that a setting has too."""
    own = {wall.name: words.wall(wall) for wall in setting.walls}
    return {name for name, was in boundaries.items() if name in own and _same(was, own[name])}


def relaid(boundaries: Mapping[str, Any], ours: set[str], new: Mapping[str, Any]) -> dict[str, Any]:
    """The boundaries with `ours` taken out and the `new` ones in, under names that are free."""
    kept = {name: was for name, was in boundaries.items() if name not in ours}
    fresh: dict[str, Any] = {}
    for name, now in new.items():
        if not any(_same(was, now) for was in kept.values()):
            fresh[free_name(name, {*kept, *fresh})] = now
    return {**fresh, **kept}


def made_for(boundaries: Mapping[str, Any], settings: Sequence[Setting]) -> Setting | None:
    """The setting that most of the boundaries come from; None where none does."""
    counts = [len(laid(boundaries, setting)) for setting in settings]
    return settings[int(np.argmax(counts))] if any(counts) else None


def _same(was: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    alike = all(abs(was.get(key, -1) - now.get(key, -1)) < 1e-6 for key in ("friction", "elasticity"))
    return alike and apart(was, now) <= NEAR


def apart(was: Mapping[str, Any], now: Mapping[str, Any]) -> float:
    """px from one wall to the farthest point of another; infinity where one of them is no line."""
    return max(beside(was, now), beside(now, was))


def beside(was: Mapping[str, Any], now: Mapping[str, Any]) -> float:
    """px from one wall to the farthest point of another that may be a part of it; infinity where one is no line."""
    one, other = _points(was), _points(now)
    return float("inf") if one is None or other is None else float(distances_to_line(other, one, False).max())


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or the first of `name-2`, `name-3`, ... that is not taken."""
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free


def _points(wall: Mapping[str, Any]) -> Array | None:
    points = wall.get("segment") or wall.get("polyline")
    return None if points is None else np.asarray(points, np.float64)
