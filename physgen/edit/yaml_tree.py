"""YAML text as a tree of values with their positions, and patches that are verified by reading the text back.

The text is read by the same parser and resolver as a scene, so that a position holds what the scene has there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from physgen.edit.errors import EditError, impossible
from physgen.problems import InputError
from physgen.scene.document import Source, read, resolve
from physgen.text import KeyPath, dotted

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NOWHERE = Path()

Patch = tuple[int, int, str]
"""First and last character of what is removed, and what replaces it."""
BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


class Kind(Enum):
    """What a value is, and how it is written."""

    SCALAR = "scalar"
    FLOW_MAP = "{}"
    BLOCK_MAP = "mapping"
    FLOW_LIST = "[]"
    BLOCK_LIST = "list"


@dataclass
class Marked:
    """One value. `begin` and `end` are indices into the text; of a block, `end` is the end of its last value."""

    kind: Kind
    begin: int
    end: int
    column: int
    value: Any = None
    """Of a scalar."""
    style: str = ""
    """Of a scalar: `""` plain, or its quote, `|` or `>`."""
    keys: list[tuple[str, int, int]] = field(default_factory=list)
    """Of a mapping: each key, and where it stands."""
    children: list[Marked] = field(default_factory=list)
    """Values of a mapping, or items."""
    _places: dict[str, int] = field(default_factory=dict)

    @property
    def is_map(self) -> bool:
        """Whether it holds keys."""
        return self.kind in (Kind.FLOW_MAP, Kind.BLOCK_MAP)

    @property
    def is_list(self) -> bool:
        """Whether it holds items."""
        return self.kind in (Kind.FLOW_LIST, Kind.BLOCK_LIST)

    @property
    def is_flow(self) -> bool:
        """Whether it is written in brackets."""
        return self.kind in (Kind.FLOW_MAP, Kind.FLOW_LIST)

    def place(self, key: str | int) -> int | None:
        """Index of the child at a key or an index; None where there is none."""
        if isinstance(key, int):
            return key if self.is_list and 0 <= key < len(self.children) else None
        if len(self._places) != len(self.keys):
            self._places = {name: at for at, (name, _, _) in enumerate(self.keys)}
        return self._places.get(key)

    def child(self, key: str | int) -> Marked | None:
        """The value of a key or an index."""
        at = self.place(key)
        return None if at is None else self.children[at]

    def data(self) -> Any:
        """The plain data."""
        if self.is_map:
            return {key: child.data() for (key, _, _), child in zip(self.keys, self.children, strict=True)}
        if self.is_list:
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
        raise impossible(f"the file cannot be read{where}: {reason}", "correct the YAML, or undo") from None
    return _tree(text)


def readable(text: str) -> bool:
    """Whether it is YAML as scenes are."""
    with suppress(EditError):
        marked(text)
        return True
    return False


def _tree(text: str) -> Marked:
    return _marked(yaml.compose(text, Loader=_LOADER), text)


def _marked(node: Any, text: str) -> Marked:
    begin, end, column = node.start_mark.index, node.end_mark.index, node.start_mark.column
    if isinstance(node, yaml.ScalarNode):
        style = node.style if node.style in ("'", '"', "|", ">") else ""
        if style in ("|", ">"):
            end = begin + len(text[begin:end].rstrip())
        value = node.value if style else resolve(node.value)
        return Marked(Kind.SCALAR, begin, end, column, value, style)
    flow = bool(node.flow_style)
    if isinstance(node, yaml.MappingNode):
        keys = [(key.value, key.start_mark.index, key.end_mark.index) for key, _ in node.value]
        children = [_marked(child, text) for _, child in node.value]
        kind = Kind.FLOW_MAP if flow else Kind.BLOCK_MAP
    else:
        keys, children = [], [_marked(child, text) for child in node.value]
        kind = Kind.FLOW_LIST if flow else Kind.BLOCK_LIST
    return Marked(kind, begin, end if flow else children[-1].end, column, keys=keys, children=children)


def entry(text: str, parent: Marked, at: int) -> int:
    """Start of the entry of a child: its key, or its dash."""
    if parent.is_map:
        return parent.keys[at][1]
    if parent.is_flow:
        return parent.children[at].begin
    if at == 0:
        return parent.begin
    place = line_after(text, parent.children[at - 1].end)
    while text[place : place + parent.column].strip(" ") or text[place + parent.column] != "-":
        place = line_after(text, place)
    return place + parent.column


def line_before(text: str, place: int) -> int:
    """The end of the line before the one that begins at `place`."""
    return place - (2 if text[:place].endswith("\r\n") else 1)


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
    begin = node.keys[node.children.index(before)][1] if node.is_map else before.begin
    if leads(text, begin) and line_begin(text, begin) > node.begin:
        return "," + newline(text) + text[line_begin(text, begin) : begin]
    return ", "


def find(text: str, path: KeyPath) -> Marked:
    """The value at a path. Raises EditError where there is none."""
    node = marked(text)
    for key in path:
        child = node.child(key)
        if child is None:
            raise impossible(f"{dotted(path)} is not there", "ask for the state and edit again")
        node = child
    return node


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal; true and 1 are not."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
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
        raise impossible(f"{dotted(path)} is not there", "ask for the state and edit again")
    return parent, at


def checked(text: str, patches: list[Patch], meant: Callable[[Any], Any]) -> str:
    """The text with patches. Raises EditError where its data is not that which `meant` makes of the old data.

    `meant` changes the data in place, or returns other data.
    """
    made = text
    for begin, end, new in sorted(patches, reverse=True):
        made = made[:begin] + new + made[end:]
    data = marked(text).data()
    whole = meant(data)
    data = data if whole is None else whole
    try:
        if same(marked(made).data(), data):
            return made
    except EditError:
        pass
    raise impossible("the YAML is written in a way that this cannot be written into", "edit the YAML beside")


def reach(data: Any, path: KeyPath) -> Any:
    """The value at a path that exists."""
    for key in path:
        data = data[key]
    return data
