"""Whose pixels are whose, before and after a correction -> what of the ground that perception laid follows from it.

The role `boundary` is asked about both. Where its two answers differ, the scene follows, as far as its walls are still
perception's own; what a person drew or dragged stays, and so does what the correction has nothing to do with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import backends
from physgen.outline.outline import Outline
from physgen.perceive import words
from physgen.perceive.found import Found
from physgen.perceive.relaid import apart
from physgen.perceive.roles import Rgb, Setting
from physgen.perceive.scene import outlined
from physgen.pipeline.warm import Recent
from physgen.scene.model import View

Data = dict[str, Any]
U16 = NDArray[np.uint16]

ITSELF = 4.0
"""px between a wall of the file and the one that perception would lay there: outlines of stored masks are rounder."""


@dataclass(frozen=True)
class Ground:
    """What follows."""

    ops: list[Data] = field(default_factory=list)
    """Operations on the scene's boundaries."""
    outlines: Mapping[int, Outline] = field(default_factory=dict)
    """By id, of things that stand better than their masks tell."""
    held: frozenset[int] = frozenset()
    """Ids of things that nothing seen keeps from falling now, and that something did before, or that are new."""
    freed: frozenset[int] = frozenset()
    """Ids of those that something keeps from falling now."""


class Layer:
    """Lays the ground for masks; what it laid for the newest ones is what was before the next correction."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._laid: Recent[Setting] = Recent(2)

    def follow(self, rgb: Rgb, was: U16, now: U16, view: View, walls: Mapping[str, Data]) -> Ground:
        """`was`, `now`: (H, W) ids; `walls`: the scene's boundaries, as they are written."""
        ours = {name: wall for name, wall in walls.items() if isinstance((wall or {}).get("from"), str)}
        if not ours:
            return Ground()
        before, after = (self._setting(rgb, labels, view) for labels in (was, now))
        fresh = frozenset(np.unique(now).tolist()) - frozenset(np.unique(was).tolist())
        held = after.held - before.held | (after.held & fresh)
        return Ground(_ops(before, after, ours, set(walls)), after.outlines, held, before.held - after.held)

    def _setting(self, rgb: Rgb, labels: U16, view: View) -> Setting:
        read = blake2b(rgb.tobytes() + labels.tobytes()).digest(), view

        def lay() -> Setting:
            things, _ = outlined(rgb, Found(labels, "kept", {}, {}))
            setting: Setting = backends.make("boundary")(rgb, labels, things, view)
            return setting

        with self._lock:
            return self._laid.of(read, lay)


def _ops(before: Setting, after: Setting, ours: Mapping[str, Data], taken: set[str]) -> list[Data]:
    """What makes of the scene's walls those after, as far as they are the ones before."""
    old = {wall.name: words.wall(wall) for wall in before.walls}
    new = {wall.name: words.wall(wall) for wall in after.walls}
    files = _paired(ours, old)  # perception's name for a wall -> the file's
    ops: list[Data] = [{"remove": ["boundaries", files[name]]} for name in files if name not in new]
    for name, now in new.items():
        if name in old and apart(old[name], now) == 0:
            continue
        if name in files:
            ops += _changed(["boundaries", files[name]], ours[files[name]], now)
        elif name not in old:  # what the file had in place of an old one, a person took out or moved
            free = _free(name, taken)
            taken.add(free)
            ops.append({"add": ["boundaries", free], "value": now})
    return ops


def _paired(ours: Mapping[str, Data], laid: Mapping[str, Data]) -> dict[str, str]:
    """For each wall that is laid, the one of the file that is it."""
    pairs = sorted((apart(was, now), name, own) for name, now in laid.items() for own, was in ours.items())
    found: dict[str, str] = {}
    for far, name, own in pairs:
        if far <= ITSELF and name not in found and own not in found.values():
            found[name] = own
    return found


def _changed(path: Sequence[str], was: Data, now: Data) -> list[Data]:
    """Operations that make one of the other, key by key, so that comments stay."""
    keys = ("segment", "polyline", "from")
    gone = [{"unset": [*path, key]} for key in keys if key in was and key not in now]
    return [
        {"set": [*path, key], "value": now[key]} for key in keys if key in now and was.get(key) != now[key]
    ] + gone


def _free(name: str, taken: set[str]) -> str:
    free, k = name, 2
    while free in taken:
        free, k = f"{name}-{k}", k + 1
    return free
