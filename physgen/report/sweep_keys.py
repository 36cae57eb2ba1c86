"""Keys that `--set` gave different values: the axes of a sweep, and the filters of a gallery."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.report.clips import Clip
from physgen.scene.document import Source, plain
from physgen.scene.overlay import edit_of_flag
from physgen.scene.schema import expanded, inner
from physgen.text import KeyPath, dotted

Value = float | str
"""Of a value in a document: `("objects", "ball", "mass")`."""

MOST_KEYS = 24
"""Keys that a gallery offers."""


@dataclass(frozen=True)
class SweptKey:
    """One key in which clips differ."""

    path: str  # as `--set` takes it: `objects.*.mass`
    name: str  # as short as is unambiguous: `mass`, `ball mass`, `impulse x`
    unit: str
    values: tuple[Value | None, ...]  # one per clip; None where it is not known
    follows: bool  # it splits the clips exactly as an earlier key does, as gravity follows the scale

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(
            isinstance(value, float) for value in self.values if value is not None
        )


def swept_keys(clips: Sequence[Clip]) -> list[SweptKey]:
    """Keys of `--set`, in its order, whose values differ between clips of one photo.

    Clips that were not given one have the value of their scene.
    """
    edits = [_edits(clip) for clip in clips]
    subjects = {clip.subject for clip in clips if clip.document}
    only = (
        subjects.pop() if len(subjects) == 1 else ""
    )  # a clip that failed is of it, too
    rows = []
    for path in dict.fromkeys(path for edit in edits for path in edit):
        values = [
            edit[path] if path in edit else _value(clip.document, path)
            for clip, edit in zip(clips, edits, strict=True)
        ]
        pairs = zip(clips, values, strict=True)
        had = {
            (clip.subject or only, value) for clip, value in pairs if value is not None
        }
        if len(had) > len({subject for subject, _ in had}):
            rows.append((path, values))
    names = [dotted(path) for path, _ in rows[:MOST_KEYS]]
    found: list[SweptKey] = []
    splits: set[tuple[int, ...]] = set()
    for (path, values), key, short in zip(
        rows, names, shortest_names(names), strict=False
    ):
        made = [
            value for value, clip in zip(values, clips, strict=True) if clip.document
        ]
        split = tuple(made.index(value) for value in made)
        name = " ".join(short).replace("_", " ")
        plain = not any(
            isinstance(value, str) for value in values
        )  # a text has a unit of its own
        found.append(
            SweptKey(
                key, name, unit(path) if plain else "", tuple(values), split in splits
            )
        )
        splits.add(split)
    return found


def _edits(clip: Clip) -> dict[KeyPath, Value]:
    """Values that `--set` gives a clip, with `*` for every name; the last of a key counts."""
    found: dict[KeyPath, Value] = {}
    for text in clip.overrides:
        try:
            edit = edit_of_flag(text, Source("--set", Path()))
        except InputError:
            continue
        parts = re.findall(r"[^.\[\]]+", edit.key)
        path = tuple(int(part) if part.isdecimal() else part for part in parts)
        found |= dict(_leaves(plain(edit.value), path))
    return found


def _leaves(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Value]]:
    """Numbers and words below a path; lists by component."""
    if isinstance(value, Mapping | list):
        for key, child in (
            value.items() if isinstance(value, Mapping) else enumerate(value)
        ):
            yield from _leaves(child, (*path, key))
    elif isinstance(value, bool):
        yield path, "yes" if value else "no"
    elif isinstance(value, int | float):
        yield path, float(value)
    elif value is not None:
        yield path, str(value)


def _value(document: Any, path: KeyPath) -> Value | None:
    """Of a scene at a path; None where it has none."""
    for key in path:
        try:
            document = document[key]
        except (KeyError, IndexError, TypeError):
            return None
    return next((value for _, value in _leaves(document, ())), None)


def shortest_names(paths: Sequence[str]) -> list[list[str]]:
    """The fewest last parts of each path that are unambiguous; components are x, y and z.

    >>> shortest_names(["objects.*.mass", "objects.cue.velocity.0", "objects.cue.friction", "world.table.friction"])
    [['mass'], ['velocity', 'x'], ['cue', 'friction'], ['table', 'friction']]
    """
    split = [
        [part for part in re.findall(r"[^.\[\]]+", path) if part != "*"]
        for path in paths
    ]
    named = [
        [*parts[:-1], "xyz"[int(parts[-1])]] if parts[-1] in ("0", "1", "2") else parts
        for parts in split
    ]
    found = []
    for parts in named:
        least = 2 if parts[-1] in ("x", "y", "z") or parts[-2:-1] == ["table"] else 1
        while least < len(parts) and parts[-least].isdecimal():
            least += 1
        for count in range(min(least, len(parts)), len(parts) + 1):
            tail = parts[-count:]
            if sum(other[-count:] == tail for other in named) == 1:
                break
        found.append(tail)
    return found


def unit(path: KeyPath) -> str:
    """Of the value at a path of a scene, by the schema; a name may be `*`."""
    part, found = inner(expanded(), path[0]), ""
    for key in path[1:]:
        found = str((part or {}).get("x-unit", found))
        part = inner(part, key)
    return str((part or {}).get("x-unit", found))
