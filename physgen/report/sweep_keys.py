"""Keys with different values of `--set`: the axes of a sweep, and the filters of a
gallery.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.report.clips import Clip
from physgen.scene.document import Source, to_plain_data
from physgen.scene.overlay import edit_of_flag
from physgen.scene.schema import inner, load_expanded_schema
from physgen.text import KeyPath, dotted

Value = float | str
"""A value in a document at a path such as `("objects", "ball", "mass")`."""

MOST_KEYS = 24
"""Maximum number of keys in a gallery."""


@dataclass(frozen=True)
class SweptKey:
    """A key with different values in several clips."""

    path: str
    """Path in the syntax of `--set`: `objects.*.mass`."""
    name: str
    """Shortest unambiguous name: `mass`, `ball mass`, `impulse x`."""
    unit: str
    values: tuple[Value | None, ...]
    """One per clip; None if unknown."""
    follows: bool
    """True if it splits the clips exactly as an earlier key does, as gravity follows
    the scale.
    """

    @property
    def numeric(self) -> bool:
        """Return whether all values are numbers."""
        values = []
        for value in self.values:
            if value is not None:
                values.append(value)
        return all(isinstance(value, float) for value in values)


def swept_keys(clips: Sequence[Clip]) -> list[SweptKey]:
    """Return keys of `--set`, in its order, with different values in clips of one
    photo.

    Clips without a setting have the value of their scene.
    """
    rows = _differing_keys(clips)
    names = [dotted(path) for path, _ in rows[:MOST_KEYS]]
    keys: list[SweptKey] = []
    splits: set[tuple[int, ...]] = set()
    labels = zip(rows, names, shortest_names(names), strict=False)
    for (path, values), name, parts in labels:
        # Two keys with the same split are one axis: the second follows the first.
        split = _split(clips, values)
        key_unit = unit(path)
        # A text contains its own unit.
        if any(isinstance(value, str) for value in values):
            key_unit = ""
        short_name = " ".join(parts).replace("_", " ")
        follows = split in splits
        keys.append(SweptKey(name, short_name, key_unit, tuple(values), follows))
        splits.add(split)
    return keys


def _split(clips: Sequence[Clip], values: Sequence[Value | None]) -> tuple[int, ...]:
    """Return for each complete clip the first one with its value."""
    own_values = []
    for value, clip in zip(values, clips, strict=True):
        if clip.document:
            own_values.append(value)
    # Two keys that split the clips alike give equal tuples, whatever their values are.
    return tuple(map(own_values.index, own_values))


def _differing_keys(clips: Sequence[Clip]) -> list[tuple[KeyPath, list[Value | None]]]:
    """Return the paths of `--set` with the value of each clip, if clips of one photo
    differ.
    """
    edits = list(map(_edits, clips))
    subjects = set()
    for clip in clips:
        if clip.document:
            subjects.add(clip.subject)
    # A failed clip has no document; assume the only subject.
    only_subject: object = ""
    if len(subjects) == 1:
        only_subject = subjects.pop()
    paths = dict.fromkeys(path for edit in edits for path in edit)
    rows = []
    for path in paths:
        values: list[Value | None] = []
        by_subject: dict[object, set[Value]] = {}
        for clip, edit in zip(clips, edits, strict=True):
            value: Value | None
            if path in edit:
                value = edit[path]
            else:
                value = _value(clip.document, path)
            values.append(value)
            if value is not None:
                subject = clip.subject or only_subject
                by_subject.setdefault(subject, set()).add(value)
        # A key belongs to the sweep if clips of the same scene differ in it: different
        # scenes differ anyway.
        if any(len(own_values) > 1 for own_values in by_subject.values()):
            rows.append((path, values))
    return rows


def _edits(clip: Clip) -> dict[KeyPath, Value]:
    """Return the values of `--set` for a clip, with `*` for every name.

    The last setting of a key counts.
    """
    edits: dict[KeyPath, Value] = {}
    for text in clip.overrides:
        try:
            edit = edit_of_flag(text, Source("--set", Path()))
        # An older record may have settings that are no longer valid.
        except InputError:
            continue
        parts = re.findall(r"[^.\[\]]+", edit.key)
        path = tuple(int(part) if part.isdecimal() else part for part in parts)
        edits |= dict(_leaves(to_plain_data(edit.value), path))
    return edits


def _leaves(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Value]]:
    """Yield the numbers and words below a path, with lists by component."""
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
    """Return the value of a scene at a path, or None without one."""
    for key in path:
        try:
            document = document[key]
        except (KeyError, IndexError, TypeError):
            return None
    return next((value for _, value in _leaves(document, ())), None)


def shortest_names(paths: Sequence[str]) -> list[list[str]]:
    """Return the fewest unambiguous last parts of each path, with components as x, y
    and z.

    >>> shortest_names(["objects.*.mass", "objects.cue.velocity.0", "objects.cue.friction", "world.table.friction"])
    [['mass'], ['velocity', 'x'], ['cue', 'friction'], ['table', 'friction']]
    """
    every_path = list(map(_path_parts, paths))
    names = []
    for parts in every_path:
        # Add parts from the end until no other path ends alike.
        count = _least_parts(parts)
        while count < len(parts):
            duplicates = []
            for other in every_path:
                if other[-count:] == parts[-count:]:
                    duplicates.append(other)
            if len(duplicates) == 1:
                break
            count += 1
        names.append(parts[-count:])
    return names


def _path_parts(path: str) -> list[str]:
    """Return the parts of a path without `*`; a component at its end becomes
    x, y or z.
    """
    parts = []
    for part in re.findall(r"[^.\[\]]+", path):
        if part != "*":
            parts.append(part)
    if parts[-1] in ("0", "1", "2"):
        parts[-1] = "xyz"[int(parts[-1])]
    return parts


def _least_parts(parts: Sequence[str]) -> int:
    """Return the minimum number of last parts with a meaning."""
    is_component = parts[-1] in ("x", "y", "z")
    count = 1
    if is_component or parts[-2:-1] == ["table"]:
        count = 2
    # An index alone says nothing: add the name of the list.
    while count < len(parts) and parts[-count].isdecimal():
        count += 1
    return min(count, len(parts))


def unit(path: KeyPath) -> str:
    """Return the unit of the value at a path of a scene, from the schema. A name may be
    `*`.
    """
    part, result = inner(load_expanded_schema(), path[0]), ""
    for key in path[1:]:
        result = str((part or {}).get("x-unit", result))
        part = inner(part, key)
    return str((part or {}).get("x-unit", result))
