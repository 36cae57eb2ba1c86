"""The tree between text and Scene: plain data in which every value knows where it was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.problems import Place
from physgen.scene.scalars import Scalar


@dataclass(frozen=True)
class Source:
    """What a value was written in: a file, or a flag of the command line."""

    name: str
    """As messages show it: the path as given, or `--set KEY=VALUE`."""
    folder: Path
    """Where the paths written in it start."""


class Node:
    """One value with its place: a scalar, a list of Nodes or a dict of Nodes. Nodes are never changed.

    `line` and `column` count from 1 and are 0 for a flag; `key` is the line and column of the key that the
    value belongs to, None in a list.
    """

    __slots__ = ("column", "key", "line", "source", "value")

    def __init__(
        self,
        value: Scalar | list[Node] | dict[str, Node],
        source: Source,
        line: int = 0,
        column: int = 0,
        key: tuple[int, int] | None = None,
    ) -> None:
        self.value = value
        self.source = source
        self.line = line
        self.column = column
        self.key = key

    @property
    def place(self) -> Place:
        """Where the value was written."""
        return Place(self.source.name, self.line, self.column)

    @property
    def key_place(self) -> Place:
        """Where its key was written."""
        return Place(self.source.name, *self.key) if self.key else self.place

    def with_value(self, value: Scalar | list[Node] | dict[str, Node]) -> Node:
        """The same place with another value."""
        return Node(value, self.source, self.line, self.column, self.key)


def plain(node: Node) -> Any:
    """The data alone: scalars, lists and dicts."""
    value = node.value
    if isinstance(value, dict):
        return {key: plain(child) for key, child in value.items()}
    if isinstance(value, list):
        return [plain(child) for child in value]
    return value


def children(node: Node | None, *keys: str) -> dict[str, Node]:
    """The mapping below `keys`, empty where there is none."""
    for key in keys:
        node = node.value.get(key) if node is not None and isinstance(node.value, dict) else None
    return node.value if node is not None and isinstance(node.value, dict) else {}


def items(node: Node | None) -> list[Node]:
    """The items of a list, none where there is no list."""
    return node.value if node is not None and isinstance(node.value, list) else []


def whole(node: Node) -> list[int]:
    """The numbers of a list that the schema says holds whole ones."""
    numbers: Any = items(node)
    return [int(item.value) for item in numbers]
