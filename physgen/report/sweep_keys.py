"""Scene keys whose values differ between clips: the axes of a sweep, and the filters of a gallery."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import InputError
from physgen.report.clips import Clip
from physgen.scene.document import Source, plain
from physgen.scene.overlay import NAMED, edit_of_flag
from physgen.scene.schema import expanded
from physgen.text import dotted, natural

Value = float | str
KeyPath = tuple[str | int, ...]
"""Of a value in a document: `("objects", "ball", "mass")`."""

SECTIONS = ("world", "objects", "boundaries", "forces", "joints", "fields", "light", "render", "refine")
UNSWEPT = {"objects": {"from", "prompt", "label", "mask"}, "render": {"size", "scale", "overlay", "frames"}}
"""Keys of sections about sources, or about the making of the video."""
LONGEST_VECTOR = 4
"""Numbers of a list whose components are values of their own: a longer list is an outline."""
MOST_KEYS = 24
"""Keys that a gallery offers, those of `--set` first."""


@dataclass(frozen=True)
class SweptKey:
    """One key in which clips differ, or the same key of several objects that always agree."""

    path: str
    """As `--set` takes it: `objects.*.mass`."""
    name: str
    """As short as is unambiguous: `mass`, `ball mass`, `impulse x`."""
    unit: str
    values: tuple[Value | None, ...]
    """One per clip; None where the clip has no such key."""
    follows: bool
    """It splits the clips exactly as an earlier key does, as gravity follows the scale."""

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(value, float) for value in self.values if value is not None)


def swept_keys(clips: Sequence[Clip]) -> list[SweptKey]:
    """Keys whose values differ between clips of one scene: with the same photo and names of objects.

    Those of `--set` come first. Clips that failed have the values of their `--set`.
    """
    trees = [dict(_leaves(_active(clip.document))) for clip in clips]
    edits = [_edits(clip) for clip in clips]
    families: dict[object, list[Mapping[KeyPath, Value]]] = defaultdict(list)
    for clip, tree in zip(clips, trees, strict=True):
        if clip.document:
            families[clip.photo, frozenset(clip.document.get("objects") or {})].append(tree)
    paths = {path for edit in edits for path in edit if "*" not in path}
    for family in families.values():
        every = {path for tree in family for path in tree}
        paths |= {path for path in every if len({tree[path] for tree in family if path in tree}) > 1}
    edited = [path for edit in edits for path in edit]
    rows = []
    for group in _grouped(paths, trees):
        values = [_value(group, tree, edit) for tree, edit in zip(trees, edits, strict=True)]
        if len(set(values) - {None}) > 1:
            set_at = min(
                (k for k, path in enumerate(edited) if _matches(path, group[0])), default=len(edited)
            )
            rows.append(((set_at, values.count(None), natural(dotted(group[0]))), group, values))
    rows = sorted(rows, key=lambda row: row[0])[:MOST_KEYS]
    names = [dotted(group[0]) if len(group) == 1 else dotted(_starred(group[0])) for _, group, _ in rows]
    found: list[SweptKey] = []
    splits: set[tuple[int, ...]] = set()
    for (_, group, values), path, short in zip(rows, names, shortest_names(names), strict=True):
        made = [value for value, clip in zip(values, clips, strict=True) if clip.document]
        split = tuple(made.index(value) for value in made)
        name = " ".join(short).replace("_", " ")
        found.append(SweptKey(path, name, unit(group[0]), tuple(values), split in splits))
        splits.add(split)
    return found


def _active(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Without the settings of a refinement that is not done."""
    refine = document.get("refine")
    if not isinstance(refine, Mapping) or refine.get("backend") != "none":
        return document
    return {**document, "refine": {"backend": "none"}}


def _leaves(value: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Value]]:
    """Numbers and words of a document with their paths; vectors by component, outlines left out."""
    if path and path[0] not in SECTIONS:
        return
    depth = 2 if path[:1] == ("objects",) else 1
    if len(path) > depth and path[depth] in UNSWEPT.get(str(path[0]), ()):
        return
    if isinstance(value, Mapping):
        for key, child in value.items():
            yield from _leaves(child, (*path, str(key)))
    elif isinstance(value, list):
        if len(value) <= LONGEST_VECTOR or all(isinstance(item, Mapping) for item in value):
            for k, item in enumerate(value):
                if not isinstance(item, list):
                    yield from _leaves(item, (*path, k))
    elif isinstance(value, bool):
        yield path, "yes" if value else "no"
    elif isinstance(value, int | float):
        yield path, float(value)
    elif value is not None:
        yield path, str(value)


def _edits(clip: Clip) -> dict[KeyPath, Value]:
    """Values that `--set` gives a clip, with `*` for every name."""
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


def _starred(path: KeyPath) -> KeyPath:
    return (path[0], "*", *path[2:]) if path[0] in NAMED and len(path) > 2 else path


def _matches(edit: KeyPath, path: KeyPath) -> bool:
    """Whether an edit, with `*` for every name, sets the value at a path."""
    return len(edit) == len(path) and all(e in ("*", p) for e, p in zip(edit, path, strict=True))


def _grouped(paths: set[KeyPath], trees: Sequence[Mapping[KeyPath, Value]]) -> list[list[KeyPath]]:
    """Paths of all objects that have a key, where they agree in every clip, are one group."""
    alike: dict[KeyPath, list[KeyPath]] = defaultdict(list)
    for path in sorted(paths, key=lambda path: natural(dotted(path))):
        alike[_starred(path)].append(path)
    groups = []
    for star, group in alike.items():
        every = {path for tree in trees for path in tree if _matches(star, path)}
        agree = all(len({tree[path] for path in group if path in tree}) <= 1 for tree in trees)
        groups += [group] if every <= set(group) and agree else [[path] for path in group]
    return groups


def _value(
    group: Sequence[KeyPath], tree: Mapping[KeyPath, Value], edits: Mapping[KeyPath, Value]
) -> Value | None:
    """From the document, or from `--set` where the clip has none."""
    for path in group:
        if path in tree:
            return tree[path]
    return next((value for edit, value in reversed(list(edits.items())) if _matches(edit, group[0])), None)


def shortest_names(paths: Sequence[str]) -> list[list[str]]:
    """The fewest last parts of each path that are unambiguous; components are x, y and z.

    >>> shortest_names(["objects.*.mass", "objects.cue.velocity.0", "objects.cue.friction", "world.table.friction"])
    [['mass'], ['velocity', 'x'], ['cue', 'friction'], ['table', 'friction']]
    """
    split = [[part for part in re.findall(r"[^.\[\]]+", path) if part != "*"] for path in paths]
    named = [
        [*parts[:-1], "xyz"[int(parts[-1])]] if parts[-1] in ("0", "1", "2") else parts for parts in split
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
    part, found = expanded(), ""
    for n, key in enumerate(path):
        inner = part.get("properties", {}).get(key) if isinstance(key, str) else part.get("items")
        if inner is None and isinstance(key, int):
            inner = dict(enumerate(part.get("prefixItems", []))).get(key)
        inner = part.get("additionalProperties") if inner is None and n == 1 else inner
        if not isinstance(inner, dict):
            break
        part, found = inner, str(inner.get("x-unit", found))
    return found
