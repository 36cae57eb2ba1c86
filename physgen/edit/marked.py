"""YAML text -> the tree of its values, each with the first and the last character of where it stands.

Read by the same parser and the same scalars as a scene, so that what stands at a place is what the scene has there.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from yaml.events import MappingEndEvent, MappingStartEvent, ScalarEvent, SequenceEndEvent, SequenceStartEvent

from physgen.edit.refusing import EditError, impossible
from physgen.problems import InputError
from physgen.scene.document import read
from physgen.scene.node import Source
from physgen.scene.scalars import resolve

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NOWHERE = Path()


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
        """Which of the children a key or an index means; None: there is none."""
        if isinstance(key, int):
            return key if self.is_list and 0 <= key < len(self.children) else None
        names = [name for name, _, _ in self.keys]
        return names.index(key) if key in names else None

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
    """The tree of a file's text. Raises EditError where it is not YAML as scenes are: then it is edited as text."""
    try:
        read(text, Source("", _NOWHERE))
    except InputError as error:
        problem = error.problems[0]
        where = f" (line {problem.place.line})" if problem.place.line else ""
        said = f"{problem.found} {problem.expected}".strip()
        raise impossible(f"the file cannot be read{where}: {said}", "mend the YAML, or undo") from None
    return _tree(text)


def readable(text: str) -> bool:
    """Whether it is YAML as scenes are."""
    with suppress(EditError):
        marked(text)
        return True
    return False


def _tree(text: str) -> Marked:
    root: Marked | None = None
    stack: list[Marked] = []
    key: tuple[str, int, int] | None = None
    events: Any = yaml.parse(text, Loader=_LOADER)
    for event in events:
        kind = type(event)
        if kind is ScalarEvent or kind is MappingStartEvent or kind is SequenceStartEvent:
            above = stack[-1] if stack else None
            begin, end = event.start_mark.index, event.end_mark.index
            if above is not None and above.is_map and key is None:
                key = (event.value, begin, end)
                continue
            node = _node(event, kind, text, begin, end)
            if above is None:
                root = node
            else:
                above.children.append(node)
                if key is not None:
                    above.keys.append(key)
                    key = None
            if kind is not ScalarEvent:
                stack.append(node)
        elif kind is MappingEndEvent or kind is SequenceEndEvent:
            node = stack.pop()
            node.end = event.end_mark.index if node.is_flow else node.children[-1].end
    assert root is not None
    return root


def _node(event: Any, kind: type, text: str, begin: int, end: int) -> Marked:
    column = event.start_mark.column
    if kind is ScalarEvent:
        style = event.style if event.style in ("'", '"', "|", ">") else ""
        if style in ("|", ">"):
            end = begin + len(text[begin:end].rstrip())
        value = resolve(event.value) if event.implicit[0] else event.value
        return Marked(Kind.SCALAR, begin, end, column, value, style)
    if kind is MappingStartEvent:
        return Marked(Kind.FLOW_MAP if event.flow_style else Kind.BLOCK_MAP, begin, end, column)
    return Marked(Kind.FLOW_LIST if event.flow_style else Kind.BLOCK_LIST, begin, end, column)
