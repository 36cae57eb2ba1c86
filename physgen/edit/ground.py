"""Boundaries that follow a corrected mask."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physgen import registry
from physgen.geometry.polygon import Disc, Outline
from physgen.geometry.simplify import distances_to_line
from physgen.perceive import document
from physgen.perceive.perceive import fit_objects
from physgen.perceive.refresh import distance_to_wall, free_name, wall_distance
from physgen.perceive.roles import BoundaryGuess, Detections, Rgb, Wall
from physgen.pipeline.stages import Recent
from physgen.scene.scene import View

Data = dict[str, Any]
U16 = NDArray[np.uint16]

ITSELF = 4.0
"""px between a boundary of the file and that of perception which count as one: stored masks have rounder outlines."""


@dataclass(frozen=True)
class Ground:
    """Changes of the boundaries, and of objects that rest on them; by id of the masks."""

    ops: list[Data] = field(default_factory=list)
    """Operations on the scene's boundaries."""
    changed: frozenset[str] = frozenset()
    """Names of the scene's boundaries that go, or get other points."""
    remarks: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Comments of perception on each of them, before and after."""
    outlines: Mapping[int, Outline] = field(default_factory=dict)
    """Outlines that stand better than their masks."""
    moved: Mapping[int, tuple[Outline, Outline]] = field(default_factory=dict)
    """Outlines of objects, before and after, that change since their support does."""
    grip: Mapping[int, float] = field(default_factory=dict)
    """The least friction of objects at rest on a slope."""
    held: frozenset[int] = frozenset()
    """Objects without visible support that had one before, or are new."""
    freed: frozenset[int] = frozenset()
    """Objects that have a support now and had none, or are gone."""


@dataclass(frozen=True)
class _Laid:
    """The role's answer, and the outlines that objects have with it."""

    setting: BoundaryGuess
    outlines: Mapping[int, Outline]


class BoundaryModel:
    """Boundaries that perception finds for masks; those of the newest masks are kept for the next correction."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._laid: Recent[_Laid] = Recent(2)

    def follow(self, rgb: Rgb, was: U16, now: U16, view: View, walls: Mapping[str, Data]) -> Ground | None:
        """What follows from other masks. `was`, `now`: (H, W) ids; `walls`: the scene's boundaries as they are written.

        None where the scene's boundaries are not those of this backend.
        """
        ours = {name: wall for name, wall in walls.items() if isinstance((wall or {}).get("from"), str)}
        if not ours:
            return None
        before, after = (self._lay(rgb, labels, view) for labels in (was, now))
        files = _paired(ours, before.setting.walls)
        if len(before.setting.walls) > 1 and not set(files) - {"frame"}:
            return None
        ops, remarks = _ops(before.setting.walls, after.setting.walls, files, walls)
        there, old = set(np.unique(now).tolist()), set(np.unique(was).tolist())
        held, held_before = after.setting.held, before.setting.held
        return Ground(
            ops,
            frozenset(path[1] for op in ops for key, path in op.items() if key in ("set", "unset", "remove")),
            remarks,
            after.setting.outlines,
            {
                i: (one, after.outlines[i])
                for i, one in before.outlines.items()
                if i in after.outlines
                and (was == i).sum() == (now == i).sum()
                and distance(one, after.outlines[i]) > 0.01
            },
            after.setting.grip,
            frozenset(held - held_before | (held & (there - old))),
            frozenset(held_before - held),
        )

    def _lay(self, rgb: Rgb, labels: U16, view: View) -> _Laid:
        read = blake2b(rgb.tobytes() + labels.tobytes()).digest(), view

        def lay() -> _Laid:
            objects, _ = fit_objects(rgb, Detections(labels, "kept", {}, {}))
            setting: BoundaryGuess = registry.make("boundary")(rgb, labels, objects, view)
            return _Laid(setting, {one.id: setting.outlines.get(one.id, one.outline) for one in objects})

        with self._lock:
            return self._laid.of(read, lay)


def distance(one: Outline, other: Outline) -> float:
    """px from one outline to the farthest corner of the other, both ways; infinity for a disc and a polygon."""
    if isinstance(one, Disc) and isinstance(other, Disc):
        return float(np.hypot(*(one.center - other.center)) + abs(one.radius - other.radius))
    if isinstance(one, Disc) or isinstance(other, Disc):
        return float("inf")
    a, b = (
        [np.concatenate([ring.outer, ring.outer[:1]]) for ring in outline.rings] for outline in (one, other)
    )
    return max(
        float(np.min([distances_to_line(ring, mate, False) for mate in mates], axis=0).max())
        for rings, mates in ((a, b), (b, a))
        for ring in rings
    )


def _ops(
    old: Sequence[Wall], new: Sequence[Wall], files: Mapping[str, str], walls: Mapping[str, Data]
) -> tuple[list[Data], dict[str, tuple[str, str]]]:
    """Operations that replace boundaries of perception, and comments by name; others of the user stay."""
    pairs = _mates(old, new)
    ops: list[Data] = []
    remarks: dict[str, tuple[str, str]] = {}
    for wall in old:
        name = files.get(wall.name)
        if name is None:  # a user removed or moved it
            continue
        mate = pairs.get(wall.name)
        if mate is None:
            ops.append({"remove": ["boundaries", name]})
        elif mate.points != wall.points:
            ops += _changed(["boundaries", name], walls[name], document.wall_entry(mate))
            remarks[name] = wall.reason, mate.reason
    taken = set(walls)
    own = [wall for name, wall in walls.items() if name not in files.values()]
    for wall in new:
        entry = document.wall_entry(wall)
        if wall in pairs.values() or any(distance_to_wall(one or {}, entry) <= ITSELF for one in own):
            continue
        free = free_name(wall.name, taken)
        taken.add(free)
        ops.append({"add": ["boundaries", free], "value": entry})
        remarks[free] = "", wall.reason
    return ops, remarks


def _mates(old: Sequence[Wall], new: Sequence[Wall]) -> dict[str, Wall]:
    """The wall that each wall became: the nearest of its kind, as one more ledge renames all above it."""
    far = sorted(
        (wall_distance(document.wall_entry(one), document.wall_entry(other)), k, n)
        for k, one in enumerate(old)
        for n, other in enumerate(new)
        if _kind(one) == _kind(other)
    )
    found: dict[int, int] = {}
    for _, k, n in far:
        if k not in found and n not in found.values():
            found[k] = n
    return {old[k].name: new[n] for k, n in found.items()}


def _kind(wall: Wall) -> str:
    return wall.name.rstrip("-0123456789")


def _paired(ours: Mapping[str, Data], laid: Sequence[Wall]) -> dict[str, str]:
    """The boundary of the file that each wall of perception is."""
    pairs = sorted(
        (wall_distance(was, document.wall_entry(wall)), wall.name, own)
        for wall in laid
        for own, was in ours.items()
    )
    found: dict[str, str] = {}
    for far, name, own in pairs:
        if far <= ITSELF and name not in found and own not in found.values():
            found[name] = own
    return found


def _changed(path: Sequence[str], was: Data, now: Data) -> list[Data]:
    """Operations that change a boundary key by key, so that comments stay."""
    keys = ("segment", "polyline", "from")
    gone = [{"unset": [*path, key]} for key in keys if key in was and key not in now]
    return [
        {"set": [*path, key], "value": now[key]} for key in keys if key in now and was.get(key) != now[key]
    ] + gone
