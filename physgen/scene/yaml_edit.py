"""Changes of YAML text that keep all other lines and the comments as they are.

Positions come from the parser of scenes, so that a position holds what the scene has there; new values are written in
the style of `physgen.scene.write`. The new text is read back: one that does not hold the intended data is never
returned.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import yaml

from physgen.problems import EditError, InputError, impossible
from physgen.scene.document import LOADER, Source, read, resolve
from physgen.scene.schema import schema_at
from physgen.scene.write import entry_lines, flow_text, key_text
from physgen.text import KeyPath, dotted

_NOWHERE = Path()

Patch = tuple[int, int, str]
"""First and last character of what is removed, and what replaces it."""
BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


@dataclass
class Marked:
    """One value. `begin` and `end` are indices into the text; of a block, `end` is the end of its last value."""

    kind: type  # `dict`, `list`, or `str` for any scalar
    is_flow: bool  # whether it is written in brackets
    begin: int
    end: int
    column: int
    value: Any = None  # of a scalar
    style: str = ""
    """Of a scalar: `""` plain, or its quote, `|` or `>`."""
    keys: list[tuple[str, int, int]] = field(default_factory=list)
    """Of a mapping: each key, and where it stands."""
    children: list[Marked] = field(
        default_factory=list
    )  # values of a mapping, or items

    def place(self, key: str | int) -> int | None:
        """Index of the child at a key or an index; None where there is none."""
        if isinstance(key, int):
            return key if self.kind is list and 0 <= key < len(self.children) else None
        return self._places.get(key)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: at for at, (name, _, _) in enumerate(self.keys)}

    def child(self, key: str | int) -> Marked | None:
        """The value of a key or an index."""
        at = self.place(key)
        return None if at is None else self.children[at]

    def data(self) -> Any:
        """The plain data."""
        if self.kind is dict:
            return {
                key: child.data()
                for (key, _, _), child in zip(self.keys, self.children, strict=True)
            }
        if self.kind is list:
            return [child.data() for child in self.children]
        return self.value


@lru_cache(maxsize=4)
def marked(text: str) -> Marked:
    """The tree of a file's text. Raises EditError where it is not YAML of scenes, which can only be edited as text."""
    try:
        read(text, Source("", _NOWHERE))
    except InputError as error:
        problem = error.problems[0]
        where = f" (line {problem.place.line})" if problem.place.line else ""
        reason = f"{problem.found} {problem.expected}".strip()
        raise impossible(
            f"the file cannot be read{where}: {reason}", "correct the YAML, or undo"
        ) from None
    return _marked(yaml.compose(text, Loader=LOADER), text)


def _marked(node: Any, text: str) -> Marked:
    begin, end, column = (
        node.start_mark.index,
        node.end_mark.index,
        node.start_mark.column,
    )
    if isinstance(node, yaml.ScalarNode):
        style = node.style if node.style in ("'", '"', "|", ">") else ""
        if style in ("|", ">"):
            end = begin + len(text[begin:end].rstrip())
        value = node.value if style else resolve(node.value)
        return Marked(str, False, begin, end, column, value, style)
    keys: list[tuple[str, int, int]] = []
    if isinstance(node, yaml.MappingNode):
        keys = [
            (key.value, key.start_mark.index, key.end_mark.index)
            for key, _ in node.value
        ]
        children = [_marked(child, text) for _, child in node.value]
    else:
        children = [_marked(child, text) for child in node.value]
    flow = bool(node.flow_style)
    kind = dict if isinstance(node, yaml.MappingNode) else list
    return Marked(
        kind,
        flow,
        begin,
        end if flow else children[-1].end,
        column,
        keys=keys,
        children=children,
    )


def entry(text: str, parent: Marked, at: int) -> int:
    """Start of the entry of a child: its key, or its dash."""
    if parent.kind is dict:
        return parent.keys[at][1]
    if parent.is_flow:
        return parent.children[at].begin
    if at == 0:
        return parent.begin
    place = line_after(text, parent.children[at - 1].end)
    while (
        text[place : place + parent.column].strip(" ")
        or text[place + parent.column] != "-"
    ):
        place = line_after(text, place)
    return place + parent.column


def line_begin(text: str, place: int) -> int:
    """Where the line of a place begins."""
    while place and not BREAK.match(text[place - 1]):
        place -= 1
    return place


def line_end(text: str, place: int) -> int:
    """Where the line of a place ends, before its break."""
    found = BREAK.search(text, place)
    return found.start() if found else len(text)


def line_after(text: str, place: int) -> int:
    """Where the next line begins."""
    found = BREAK.search(text, place)
    return found.end() if found else len(text)


def leads(text: str, place: int) -> bool:
    """Whether a place is the first of its line, apart from spaces."""
    return not text[line_begin(text, place) : place].strip(" ")


def newline(text: str) -> str:
    """How the lines of a text end."""
    found = BREAK.search(text)
    return found[0] if found and found[0] in ("\r\n", "\r") else "\n"


def below(text: str, place: int, lines: Sequence[str]) -> Patch:
    """Lines after that of a place."""
    stop, line = line_end(text, place), newline(text)
    return stop, stop, line + line.join(lines)


def joint(text: str, node: Marked, before: Marked) -> str:
    """Separator of a new entry in brackets: with a line break where each entry has a line of its own."""
    begin = (
        node.keys[node.children.index(before)][1] if node.kind is dict else before.begin
    )
    if leads(text, begin) and line_begin(text, begin) > node.begin:
        return "," + newline(text) + text[line_begin(text, begin) : begin]
    return ", "


def find(text: str, path: Sequence[str | int]) -> Marked:
    """The value at a path. Raises EditError where there is none."""
    node = marked(text)
    for key in path:
        child = node.child(key)
        if child is None:
            raise impossible(
                f"{dotted(tuple(path))} is not there",
                "ask for the state and edit again",
            )
        node = child
    return node


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal; true and 1 are not."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(
            same(one[key], other[key]) for key in one
        )
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, bool) or isinstance(other, bool):
        return one is other
    return bool(one == other)


def parent_of(text: str, path: KeyPath) -> tuple[Marked, int]:
    """The collection that holds what is at a path, and which of its children that is."""
    parent = find(text, path[:-1])
    at = parent.place(path[-1])
    if at is None:
        raise impossible(
            f"{dotted(path)} is not there", "ask for the state and edit again"
        )
    return parent, at


def patched(text: str, *patches: Patch) -> str:
    """The text with patches, which do not overlap."""
    for begin, end, new in sorted(patches, reverse=True):
        text = text[:begin] + new + text[end:]
    return text


# Values


def write(text: str, data: dict[str, Any]) -> str:
    """The text of a file such that it holds `data`. Raises EditError."""
    try:
        made = put(text, (), data)
        if same(marked(made).data(), data):
            return made
    except EditError:
        pass
    raise impossible(
        "the YAML is written in a way that this cannot be written into",
        "edit the YAML beside",
    )


def written_anew(text: str, path: KeyPath, value: Any) -> str:
    """The text with the value at a path as a new file has it; as it is where a comment stands in brackets."""
    node = find(text, path)
    if "#" in text[node.begin : line_after(text, node.end - 1)]:
        return text
    return patched(text, *_rewritten(text, path, value))


def put(text: str, path: KeyPath, value: Any) -> str:
    """Set the value at a path whose holder is there."""
    if path and find(text, path[:-1]).place(path[-1]) is None:
        return _made(text, path, value)
    return (
        text if same(find(text, path).data(), value) else _replaced(text, path, value)
    )


def _drop(text: str, path: KeyPath) -> str:
    """Remove one of several keys or items."""
    parent, at = parent_of(text, path)
    begin = entry(text, parent, at)
    if parent.is_flow or not leads(text, begin):
        return patched(text, _cut(text, parent, at, begin))
    stop, first = line_after(text, parent.children[at].end), line_begin(text, begin)
    if stop == len(text) and not BREAK.search(
        text[-1:]
    ):  # nor does the new last line end
        first -= 2 if text[:first].endswith("\r\n") else 1
    return patched(text, (first, stop, ""))


def _cut(text: str, parent: Marked, at: int, begin: int) -> Patch:
    """Patch that removes one of several entries in brackets, and no comments of others."""
    child = parent.children[at]
    if at and leads(
        text, begin
    ):  # the comma before it may stay: YAML lets one stand at the end
        if re.fullmatch(r"\s*,\s*(#.*)?", text[child.end : line_end(text, child.end)]):
            return line_begin(text, begin), line_after(text, child.end), ""
        if at + 1 == len(parent.children):
            return begin, child.end, ""
    elif at:
        return parent.children[at - 1].end, child.end, ""
    after = entry(text, parent, at + 1)
    if (
        not parent.is_flow and "#" in text[line_end(text, child.end) : after]
    ):  # behind a dash, comments below
        return begin, line_end(text, child.end), ""
    return begin, after, ""


def _insert(text: str, path: KeyPath, value: Any) -> str:
    """Insert an item into a list, before the one at the path."""
    where, at = path[:-1], int(path[-1])
    node = find(text, where)
    if not node.children:
        return _replaced(text, where, [value])
    if node.is_flow:
        inner, before = flow_text(value, path), node.children[max(at - 1, 0)]
        if at == 0:
            return patched(text, (before.begin, before.begin, f"{inner}, "))
        return patched(
            text, (before.end, before.end, joint(text, node, before) + inner)
        )
    indent = " " * node.column
    lines = entry_lines(value, f"{indent}-", indent + "  ", path)
    if at:
        return patched(text, below(text, node.children[at - 1].end, lines))
    begin = entry(text, node, 0)
    return patched(
        text, (begin, begin, (newline(text).join([*lines, indent]))[node.column :])
    )


def _rename(text: str, path: KeyPath, to: str) -> str:
    """Rename a key."""
    parent, at = parent_of(text, path)
    _, begin, end = parent.keys[at]
    return patched(text, (begin, end, key_text(to)))


def _made(text: str, path: KeyPath, value: Any) -> str:
    """Add a key, or an item at the end."""
    where, key = path[:-1], path[-1]
    node = find(text, where)
    if isinstance(key, int):
        return _insert(text, path, value)
    if not node.children:
        return _replaced(text, where, {key: value})
    after = node.children[_before(node, where, key)]
    if node.is_flow:
        inner = f"{key_text(key)}: {flow_text(value, path)}"
        return patched(text, (after.end, after.end, joint(text, node, after) + inner))
    indent = " " * node.column
    return patched(
        text,
        below(
            text,
            after.end,
            entry_lines(value, f"{indent}{key_text(key)}:", indent + "  ", path),
        ),
    )


def _before(node: Marked, path: KeyPath, key: str) -> int:
    """Index of the key after which a new one is written: in the schema's order, else the last."""
    order = list((schema_at(path) or {}).get("properties", {}))
    if key not in order:
        return len(node.keys) - 1
    known = order[: order.index(key)]
    places = [at for at, (name, _, _) in enumerate(node.keys) if name in known]
    return max(places, default=len(node.keys) - 1)


def _replaced(text: str, path: KeyPath, value: Any) -> str:
    """Replace a value; of a collection only what differs."""
    node = find(text, path)
    if node.kind is dict and isinstance(value, dict) and value and node.children:
        keys = {key for key, _, _ in node.keys}
        if not node.is_flow or (keys != value.keys() and keys & value.keys()):
            return _entries(text, path, node, value)
    is_filled_list = (
        node.kind is list and isinstance(value, list) and value and node.children
    )
    if is_filled_list and (not node.is_flow or len(value) != len(node.children)):
        return _items(text, path, node.data(), value)

    patches = _differences(node, value, path) if node.is_flow else None
    if not path:
        lines = [
            line
            for key in value
            for line in entry_lines(value[key], f"{key_text(key)}:", "  ", (key,))
        ]
        patches = patches or [(node.begin, node.end, newline(text).join(lines) or "{}")]
    return patched(
        text, *(_rewritten(text, path, value) if patches is None else patches)
    )


def _entries(text: str, path: KeyPath, node: Marked, value: dict[str, Any]) -> str:
    """A mapping key by key; a key that is gone whose value is that of a new one is renamed."""
    old: dict[str, Any] = node.data()
    new = [key for key in value if key not in old]
    for key in old:
        if key in value:
            continue
        name = next((name for name in new if same(old[key], value[name])), None)
        if name is not None:
            new.remove(name)
            text = _rename(text, (*path, key), name)
            continue
        if len(find(text, path).children) == 1:  # an empty mapping would lose its style
            first = next(iter(value))
            text = put(text, (*path, first), value[first])
        text = _drop(text, (*path, key))
    for key, child in value.items():
        if key not in old or not same(old[key], child):
            text = put(text, (*path, key), child)
    return text


def _items(text: str, path: KeyPath, old: list[Any], new: list[Any]) -> str:
    """A list item by item between its ends that stay; from the last, so that numbers of items stay what they are."""
    most = min(len(old), len(new))
    head = next((at for at in range(most) if not same(old[at], new[at])), most)
    tail = next(
        (at for at in range(most - head) if not same(old[-1 - at], new[-1 - at])),
        most - head,
    )
    shared = most - tail
    for at in reversed(range(shared, len(old) - tail)):
        text = _drop(text, (*path, at))
    for at in range(shared, len(new) - tail):
        text = _insert(text, (*path, at), new[at])
    for at in range(head, shared):
        text = put(text, (*path, at), new[at])
    return text


def _differences(node: Marked, value: Any, path: KeyPath) -> list[Patch] | None:
    """Patches that change values inside brackets; None where keys or the number of items differ."""
    if (
        node.kind is dict
        and isinstance(value, dict)
        and {key for key, _, _ in node.keys} == value.keys()
    ):
        pairs = [
            (child, value[key], (*path, key))
            for (key, _, _), child in zip(node.keys, node.children, strict=True)
        ]
    elif (
        node.kind is list
        and isinstance(value, list)
        and len(node.children) == len(value)
    ):
        pairs = [
            (child, value[at], (*path, at)) for at, child in enumerate(node.children)
        ]
    else:
        return None
    patches: list[Patch] = []
    for child, new, where in pairs:
        if not same(child.data(), new):
            inner = _differences(child, new, where)
            patches += [_inside(child, new, where)] if inner is None else inner
    return patches


def _inside(node: Marked, value: Any, path: KeyPath) -> Patch:
    """Patch of a value in brackets."""
    gap = " " if node.begin == node.end else ""
    return node.begin, node.end, gap + flow_text(value, path)


def _rewritten(text: str, path: KeyPath, value: Any) -> list[Patch]:
    """Patches that write the value of a key or an item anew; a comment at the line's end stays, unless an entry's."""
    parent, at = parent_of(text, path)
    node = parent.children[at]
    end = (
        line_end(text, node.end)
        if node.kind in (dict, list) and not node.is_flow
        else node.end
    )
    if parent.is_flow:
        return [_inside(node, value, path)]
    begin = entry(text, parent, at)
    if parent.kind is dict:
        colon = text.index(":", parent.keys[at][2])
        start = " " * parent.column + text[begin : colon + 1]
    else:
        colon = begin
        start = " " * parent.column + "-"
    first, *rest = entry_lines(value, start, " " * parent.column + "  ", path)
    first = first[len(start) :]
    if (
        rest
        and not first
        and (node.kind is str or node.is_flow)
        and node.style not in ("|", ">")
    ):
        return [(colon + 1, node.end, ""), below(text, node.end, rest)]
    return [(colon + 1, end, newline(text).join([first, *rest]))]


# Comments of perception

LONGEST = 116
"""Columns of a line with a comment behind its value."""
DEEP = {"objects": 3, "world": 2, "boundaries": 2, "render": 1}
"""Keys of a path to a value with a comment of perception, by section."""


def without_comments(
    text: str, paths: Sequence[Sequence[str | int]], ours: Collection[str]
) -> str:
    """The text without the comments that are `ours` behind or above values that a user has set; others stay."""
    for path in paths:
        if depth := DEEP.get(str(path[0]), 0):
            text = _without_comment(text, tuple(path[:depth]), ours)
    return text


def with_comments(
    text: str, comments: Mapping[str, str], ours: Collection[str], new: Collection[str]
) -> str:
    """The text with comments at dotted keys, behind short values and above others, in the place of those that are
    `ours`; where none is, at keys that are `new` alone."""
    for key, comment in comments.items():
        try:
            parent, at = parent_of(text, tuple(key.split(".")))
        except EditError:
            continue
        begin, words = entry(text, parent, at), " ".join(comment.split())
        there = set(dict(_comments(text, begin)).values())
        if (
            parent.is_flow
            or not leads(text, begin)
            or words in there
            or not (key in new or there & set(ours))
        ):
            continue
        text = without_comments(text, [key.split(".")], ours)
        parent, at = parent_of(text, tuple(key.split(".")))
        begin = entry(text, parent, at)
        first, stop = line_begin(text, begin), line_end(text, begin)
        short = stop - first + len(words) <= LONGEST and "#" not in text[first:stop]
        child = parent.children[at]
        if short and (child.end <= stop or not (child.is_flow or child.kind is str)):
            text = patched(text, (stop, stop, f"  # {words}"))
        else:
            text = patched(
                text, (first, first, f"{text[first:begin]}# {words}{newline(text)}")
            )
    return text


def _comments(text: str, place: int) -> Iterator[tuple[int, str]]:
    """Index and words of the comment that ends the line of a place, and of the lines of comments above it."""
    lines, at = text.split("\n"), text.count("\n", 0, place)
    _, mark, words = lines[at].rpartition(" #")
    if mark:
        yield at, " ".join(words.split())
    while at and lines[at - 1].lstrip().startswith("#"):
        at -= 1
        yield at, " ".join(lines[at].lstrip(" #").split())


def _without_comment(text: str, path: KeyPath, ours: Collection[str]) -> str:
    try:
        parent, at = parent_of(text, path)
    except EditError:
        return text
    begin = entry(text, parent, at)
    if parent.is_flow or not leads(text, begin):
        return text
    lines = text.split("\n")
    for line, words in _comments(text, begin):
        if words in ours and lines[line].lstrip().startswith("#"):
            del lines[line]
        elif words in ours:
            lines[line] = lines[line].rpartition(" #")[0].rstrip() + "\r" * lines[
                line
            ].endswith("\r")
    return "\n".join(lines)
