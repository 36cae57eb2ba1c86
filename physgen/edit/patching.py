"""A change of a text is made only where it means what was meant: the text is read back, and held against its data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from physgen.edit.marked import Marked, marked
from physgen.edit.places import Patch
from physgen.edit.refusing import EditError, impossible
from physgen.scene.words import KeyPath, dotted


def find(text: str, path: KeyPath) -> Marked:
    """The value at a path, which is there."""
    node = marked(text)
    for key in path:
        child = node.child(key)
        if child is None:
            raise impossible(f"{dotted(path)} is not there", "ask for the state and edit again")
        node = child
    return node


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal, true and 1 not being the same."""
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
    """The text with its patches, read back; `meant` makes the same change of the data."""
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
    """The value at a path, which is there."""
    for key in path:
        data = data[key]
    return data


def take(data: Any, path: KeyPath) -> None:
    """Without what is at a path."""
    del reach(data, path[:-1])[path[-1]]
