"""Scene keys whose values differ between clips: the axes of a sweep."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
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
Part = str | int
Way = tuple[Part, ...]
"""Of a value in a document: `("objects", "ball", "mass")`."""

SECTIONS = ("world", "objects", "boundaries", "forces", "joints", "fields", "light", "render", "refine")
UNSWEPT = {"objects": {"from", "prompt", "label", "mask"}, "render": {"size", "scale", "overlay", "frames"}}
"""Keys of sections that tell where things come from, or how the film is made."""
LONGEST = 4
"""Numbers of a list that are values of their own: a longer one is an outline."""
MOST = 24
"""Keys that are told of, those of `--set` first."""


@dataclass(frozen=True)
class SweptKey:
    """One key in which clips differ, or several that always differ together."""

    path: str
    """As `--set` takes it: `objects.*.mass`."""
    name: str
    """As short as leaves no doubt: `mass`, `ball mass`, `impulse x`."""
    unit: str
    values: tuple[Value | None, ...]
    """One a clip; None where the clip has no such key."""
    named: bool
    """Somebody set it, with `--set`."""
    swept: bool
    """Clips of one scene differ in it, or several were told different values; else only different scenes differ."""
    follows: bool
    """It splits the clips exactly as one before it does, as gravity follows the scale."""

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(isinstance(value, float) for value in self.values if value is not None)


def swept_keys(clips: Sequence[Clip]) -> list[SweptKey]:
    """Keys whose values differ between clips of one scene, or, of world and render, between all; the likeliest first.

    Clips are of one scene where photo and names are the same. Clips that failed have the values of their `--set`.
    """
    trees = [dict(_leaves(_acting(clip.document))) for clip in clips]
    edits = [_edits(clip) for clip in clips]
    apart = _differing(clips, trees)
    ways = _set_apart(edits, trees) | apart
    rows: list[tuple[tuple[Any, ...], list[Way], list[Value | None], bool, bool]] = []
    edited = {way for edit in edits for way, _ in edit}
    for group in _grouped(ways, trees):
        values = [_value(group, tree) for tree in trees]
        here = {way for way in edited if _of(group, way)}
        told = [_told(group, here, edit) for edit in edits] if here else [None] * len(clips)
        values = [have if have is not None else said for have, said in zip(values, told, strict=True)]
        named = any(said is not None for said in told)
        within = ways[group[0]] or len(set(told) - {None}) > 1
        place = min((k for edit in edits for k, (way, _) in enumerate(edit) if way in here), default=99)
        missing = sum(value is None for value in values)
        rank = (not within, not named, place, missing, len(set(values)), natural(dotted(group[0])))
        if (within or group[0] in apart) and len(set(values) - {None}) > 1:
            rows.append((rank, group, values, named, within))
    rows.sort(key=lambda row: row[0])
    rows = rows[:MOST]
    paths = [_path(group, trees) for _, group, *_ in rows]
    names = _short(paths)
    found: list[SweptKey] = []
    seen: set[tuple[int, ...]] = set()
    for (_, group, values, named, within), path, name in zip(rows, paths, names, strict=True):
        split = _split([value for value, clip in zip(values, clips, strict=True) if clip.document])
        found.append(SweptKey(path, name, unit(group[0]), tuple(values), named, within, split in seen))
        seen.add(split)
    return found


def _acting(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Without the settings of a refinement that nobody does."""
    refine = document.get("refine")
    if not isinstance(refine, Mapping) or refine.get("backend") != "none":
        return document
    return {**document, "refine": {"backend": "none"}}


def _leaves(value: Any, way: Way = ()) -> Iterator[tuple[Way, Value]]:
    """Numbers and words of a document with their ways; vectors by component, outlines left out."""
    if isinstance(value, Mapping):
        for key, child in value.items():
            if (way or key in SECTIONS) and _told_of((*way, str(key))):
                yield from _leaves(child, (*way, str(key)))
    elif isinstance(value, list):
        if len(value) <= LONGEST or all(isinstance(item, Mapping) for item in value):
            for k, item in enumerate(value):
                if not isinstance(item, list):
                    yield from _leaves(item, (*way, k))
    elif isinstance(value, bool):
        yield way, "yes" if value else "no"
    elif isinstance(value, int | float):
        yield way, float(value)
    elif value is not None:
        yield way, str(value)


def _told_of(way: Way) -> bool:
    """Whether its key is none that is left out, at the section's level or below an object's name."""
    depth = 2 if way[0] == "objects" else 1
    return len(way) <= depth or way[depth] not in UNSWEPT.get(str(way[0]), ())


def _edits(clip: Clip) -> list[tuple[Way, Any]]:
    """What `--set` says of a clip: way, with `*` for every name, and value."""
    found = []
    for text in clip.overrides:
        try:
            edit = edit_of_flag(text, Source("--set", Path()))
        except InputError:
            continue
        parts = re.findall(r"[^.\[\]]+", edit.key)
        found.append((tuple(int(part) if part.isdecimal() else part for part in parts), plain(edit.value)))
    return found


def _differing(clips: Sequence[Clip], trees: Sequence[Mapping[Way, Value]]) -> dict[Way, bool]:
    """Ways whose values differ, and whether they do so within a scene."""
    families: dict[object, list[Mapping[Way, Value]]] = defaultdict(list)
    for clip, tree in zip(clips, trees, strict=True):
        if clip.document:
            names = (frozenset(clip.document.get(section) or {}) for section in NAMED[:-1])
            families[(clip.photo, *names)].append(tree)
    found: dict[Way, bool] = {}
    for family in families.values():
        found |= dict.fromkeys(_apart(family), True)
    made = [tree for clip, tree in zip(clips, trees, strict=True) if clip.document]
    wide = [{way: v for way, v in tree.items() if way[0] in ("world", "render")} for tree in made]
    return dict.fromkeys(_apart(wide, len(made) / 2), False) | found


def _set_apart(
    edits: Sequence[Sequence[tuple[Way, Any]]], trees: Sequence[Mapping[Way, Value]]
) -> dict[Way, bool]:
    """Ways of what `--set` says, as far as they name one value each; whether they differ is seen later."""
    leaves = {
        leaf for edit in edits for way, value in edit for leaf, _ in _leaves(value, way) if _told_of(leaf)
    }
    stars = [leaf for leaf in leaves if "*" in leaf]
    known = {way for tree in trees for way in tree} if stars else set()
    return dict.fromkeys((way for way in known if any(_of([way], star) for star in stars)), False) | {
        leaf: False for leaf in sorted(leaves, key=dotted) if "*" not in leaf and leaf[0] in SECTIONS
    }


def _apart(trees: Sequence[Mapping[Way, Value]], least: float = 2) -> Iterator[Way]:
    """Ways that at least so many trees have, with more than one value."""
    seen: dict[Way, set[Value]] = defaultdict(set)
    count: dict[Way, int] = defaultdict(int)
    for tree in trees:
        for way, value in tree.items():
            seen[way].add(value)
            count[way] += 1
    return (way for way, values in seen.items() if len(values) > 1 and count[way] >= least)


def _starred(way: Way) -> Way:
    return (way[0], "*", *way[2:]) if way[0] in NAMED and len(way) > 2 else way


def _grouped(ways: Iterable[Way], trees: Sequence[Mapping[Way, Value]]) -> list[list[Way]]:
    """Ways of several names that have one value in every clip are one."""
    alike: dict[Way, list[Way]] = defaultdict(list)
    for way in ways:
        alike[_starred(way)].append(way)
    groups = []
    for group in alike.values():
        together = all(len({tree[way] for way in group if way in tree}) <= 1 for tree in trees)
        groups += [group] if together else [[way] for way in group]
    return groups


def _value(group: Sequence[Way], tree: Mapping[Way, Value]) -> Value | None:
    return next((tree[way] for way in group if way in tree), None)


def _of(group: Sequence[Way], edited: Way) -> bool:
    """Whether an edit of that way changes the group's value."""
    return any(
        len(way) >= len(edited) and all(e in ("*", w) for w, e in zip(way, edited, strict=False))
        for way in group
    )


def _told(group: Sequence[Way], here: Set[Way], edits: Sequence[tuple[Way, Any]]) -> Value | None:
    """What edits say the group's value is, by those of the ways `here`; the last one counts."""
    for way, value in reversed(edits):
        if way in here:
            rest = group[0][len(way) :]
            return next((leaf for deeper, leaf in _leaves(value, way) if deeper[len(way) :] == rest), None)
    return None


def _path(group: Sequence[Way], trees: Sequence[Mapping[Way, Value]]) -> str:
    if len(group) == 1:
        return dotted(group[0])
    star = _starred(group[0])
    every = {way for tree in trees for way in tree if len(way) == len(star) and _starred(way) == star}
    if len(group) == len(every):
        return dotted(group[0]).replace(f".{dotted(group[0][1:2])}", ".*", 1)
    return f"{dotted(group[0])} and {len(group) - 1} more"


def shortest_names(paths: Sequence[str]) -> list[list[str]]:
    """The fewest last parts of each path that leave no doubt, in reading order; components are x, y and z.

    >>> apart(["objects.*.mass", "objects.cue.velocity.0", "objects.cue.friction", "world.table.friction"])
    [['mass'], ['velocity', 'x'], ['cue', 'friction'], ['table', 'friction']]
    """
    split = [[part for part in re.findall(r"[^.\[\]]+", path) if part != "*"] for path in paths]
    said = [
        [*parts[:-1], "xyz"[int(parts[-1])]] if parts[-1] in ("0", "1", "2") else parts for parts in split
    ]
    found = []
    for parts in said:
        least = 2 if parts[-1] in ("x", "y", "z") or parts[-2:-1] == ["table"] else 1
        while least < len(parts) and parts[-least].isdecimal():
            least += 1
        for count in range(min(least, len(parts)), len(parts) + 1):
            tail = parts[-count:]
            if sum(other[-count:] == tail for other in said) == 1:
                break
        found.append(tail)
    return found


def _short(paths: Sequence[str]) -> list[str]:
    return [" ".join(tail).replace("_", " ") for tail in shortest_names(paths)]


def unit(way: Way) -> str:
    """Of what stands there in a scene, by the schema; a name may be `*`."""
    part, told = expanded(), ""
    for n, key in enumerate(way):
        inner = part.get("properties", {}).get(key) if isinstance(key, str) else part.get("items")
        if inner is None and isinstance(key, int):
            inner = dict(enumerate(part.get("prefixItems", []))).get(key)
        inner = part.get("additionalProperties") if inner is None and n == 1 else inner
        if not isinstance(inner, dict):
            break
        part, told = inner, str(inner.get("x-unit", told))
    return told


def _split(values: Sequence[Value | None]) -> tuple[int, ...]:
    """Which clips are alike, whatever the values."""
    order: dict[Value | None, int] = {}
    return tuple(order.setdefault(value, len(order)) for value in values)
