"""Read the text of a scene file into a tree of nodes. Every value has its file, line
and column.

A scene file is untrusted input. It is read as a stream of events and never composed by
PyYAML: its C composer recurses for each level and can crash. Limits are checked during
reading. Plain scalars follow the core schema of YAML 1.2 (section 10.3.2): PyYAML
follows YAML 1.1, where `on` is true, `1.0e6` is text and `1:30` is 90.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from physgen.messages import Message
from physgen.problems import InputError, Limit, Place, Problem, RefusedError
from physgen.scene.syntax import explain_syntax
from physgen.text import dotted, quoted

Scalar = bool | int | float | str | None

MAX_NUMBER = 310
"""Maximum number of characters of a number: more than any float needs, and far below
Python's limit on int(text).
"""

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_NUMBER = re.compile(
    r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
).fullmatch
_BASE = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+").fullmatch
_ENDLESS = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)").fullmatch
_STARTS = frozenset("+-.0123456789")


def resolve(text: str) -> Scalar:
    """Return the value of a plain (unquoted) scalar.

    Raise RefusedError for NaN, infinities and numbers too long or too large for a
    float.

    >>> [resolve(t) for t in ("on", "1.0e6", "0x1F", "0o17", "~", "True", "1_000", "-.5")]
    ['on', 1000000.0, 31, 15, None, True, '1_000', -0.5]
    """
    if not text or text[0] not in _STARTS:
        # The longest word is shorter than six letters: most texts need no lookup.
        if len(text) < 6:
            return _WORDS.get(text, text)
        return text
    if _NUMBER(text):
        # Integers stay exact: ids of masks must not become floats.
        if "." not in text and "e" not in text and "E" not in text:
            if len(text) < 20:
                return int(text)
            return int(_short(text))
        if len(text) < 30:
            number = float(text)
        else:
            number = float(_short(text))
        if math.isinf(number):
            raise Message.NUMBER_TOO_LARGE.refusal()
        return number
    if _BASE(text):
        return int(_short(text), 0)
    if _ENDLESS(text):
        raise Message.NUMBER_NOT_FINITE.refusal()
    return text


def _short(text: str) -> str:
    if len(text) > MAX_NUMBER:
        raise Message.NUMBER_TOO_LONG.refusal(length=len(text), most=MAX_NUMBER)
    return text


@dataclass(frozen=True)
class Source:
    """The origin of a value: a file, or a flag of the command line."""

    # Name in messages: the path as given, or `--set KEY=VALUE`.
    name: str
    # Start of relative paths in this source.
    folder: Path


@dataclass(slots=True, eq=False, repr=False)
class Node:
    """One value with its place: a scalar, a list of Nodes or a dict of Nodes. Nodes are
    never changed.

    `line` and `column` count from 1 and are 0 for a flag. `key` is the line and column
    of the value's key, None in a list. `text` is the quantity before its conversion to
    a number: `5 mm`.
    """

    value: Scalar | list[Node] | dict[str, Node]
    source: Source
    line: int = 0
    column: int = 0
    key: tuple[int, int] | None = None
    text: str | None = None

    @property
    def place(self) -> Place:
        """Return the place of the value."""
        return Place(self.source.name, self.line, self.column)

    @property
    def key_place(self) -> Place:
        """Return the place of the key."""
        if self.key:
            return Place(self.source.name, *self.key)
        return self.place

    def with_value(
        self,
        value: Scalar | list[Node] | dict[str, Node],
        text: str | None = None,
    ) -> Node:
        """Return the same place with another value, converted from `text` if given."""
        return Node(value, self.source, self.line, self.column, self.key, text)


def to_plain_data(node: Node) -> Any:
    """Return only the data: scalars, lists and dicts."""
    value = node.value
    if isinstance(value, dict):
        return {key: to_plain_data(child) for key, child in value.items()}
    if isinstance(value, list):
        return list(map(to_plain_data, value))
    return value


def children(node: Node | None, *keys: str) -> dict[str, Node]:
    """Return the mapping below `keys`, or an empty one."""
    for key in keys:
        if node is not None and isinstance(node.value, dict):
            node = node.value.get(key)
        else:
            node = None
    if node is not None and isinstance(node.value, dict):
        return node.value
    return {}


def items(node: Node | None) -> list[Node]:
    """Return the items of a list, or an empty list."""
    if node is not None and isinstance(node.value, list):
        return node.value
    return []


def read_integers(node: Node) -> list[int]:
    """Return the numbers of a list of integers, checked by the schema."""
    numbers: Any = items(node)
    return [int(item.value) for item in numbers]


LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def decode(data: bytes, name: str) -> str:
    """Return the text of a scene file. Raise InputError for too many bytes and for
    anything but UTF-8.
    """
    if len(data) > Limit.BYTES.most:
        raise Limit.BYTES.error(Place(name))
    try:
        # This decoder removes the byte order mark of some editors.
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # A photo or an archive in place of a scene is the most common mistake.
        if data.startswith((b"\x89PNG", b"\xff\xd8\xff", b"RIFF")):
            raise Message.PICTURE_FOR_SCENE.error(name) from None
        if data.startswith(b"PK\x03\x04"):
            raise Message.ZIP_FOR_SCENE.error(name) from None
        # Line and column of the first wrong byte.
        before = data[: error.start]
        place = Place(name, before.count(b"\n") + 1, error.start - before.rfind(b"\n"))
        raise Message.NOT_UTF8.error_at(place) from None


SCENE_START = "`physgen: 1` and `image: photo.png`"
"""First keys of a scene file, for messages."""


def read(
    text: str, source: Source, has_lines: bool = True, start: str = SCENE_START
) -> Node:
    """Return the tree of the text of a scene file, a mapping at the top.

    Raise InputError. Faults of syntax, limits, aliases and tags end the reading with
    one problem. Duplicate keys and infinite numbers are collected. `has_lines` is False
    for the value of a flag, which may have any type and has no line. `start` names the
    first keys of this kind of file.
    """
    reader = _Reader(source, has_lines)
    try:
        root = reader.tree(yaml.parse(text, Loader=LOADER))
    except yaml.YAMLError as error:
        raise InputError([_syntax_problem(error, text, source)]) from None
    # Collected problems are reported together, after the syntax is known to be right.
    if reader.problems:
        raise InputError(reader.problems)
    # The value of a flag may be empty, which is null.
    if not has_lines:
        if root is not None:
            return root
        return Node(None, source)
    if root is None or root.value is None:
        if start is SCENE_START:
            empty = Message.SCENE_EMPTY
        else:
            empty = Message.FILE_EMPTY
        raise empty.error(source.name, start=start)
    if not isinstance(root.value, dict):
        kind = "one value"
        if isinstance(root.value, list):
            kind = "a list"
        top = Message.TOP_NOT_MAPPING
        raise top.error_at(root.place, found=kind, start=start)
    return root


class _Reader:
    """Converts events to Nodes with its own stack, so that deep files need no
    recursion.
    """

    def __init__(self, source: Source, has_lines: bool) -> None:
        self.source = source
        self.has_lines = has_lines
        self.problems: list[Problem] = []

    def _place(self, event: Any) -> Place:
        line = 0
        if self.has_lines:
            line = event.start_mark.line + 1
        return Place(self.source.name, line, event.start_mark.column + 1 if line else 0)

    def _count_documents(self, event: Any, documents: int) -> int:
        """Return the number of documents after an event; refuse aliases and a second
        document.
        """
        if type(event) is AliasEvent:
            raise self._refusal(event)
        if type(event) is not DocumentStartEvent:
            return documents
        if documents:
            raise self._error(Message.SECOND_DOCUMENT, event)
        return documents + 1

    def _resolve_scalar(self, event: Any, stack: list[Node], key: str | None) -> Scalar:
        """Return the value of a plain scalar; collect the problem of a refused one."""
        try:
            return resolve(event.value)
        except RefusedError as error:
            place = self._place(event)
            key_path = _path(stack, key)
            value_text = quoted(event.value, "")
            self._collect(error.problem(place, key_path, value_text))
        text: str = event.value
        return text

    def tree(self, events: Iterator[Any]) -> Node | None:
        """Return the root of the tree of a document's events; None if it is empty."""
        source, has_lines = self.source, self.has_lines
        root: Node | None = None
        stack: list[Node] = []
        # The children of stack[-1].
        parent: Any = None
        # Key of a mapping, before its value.
        key: str | None = None
        # Place of the key.
        key_place: tuple[int, int] | None = None
        documents = nodes = line = column = 0
        # Local names are faster than attributes in the loop over all events.
        most_nodes = Limit.VALUES.most
        most_levels = Limit.DEPTH.most
        for event in events:
            kind = type(event)
            if kind is SequenceEndEvent or kind is MappingEndEvent:
                stack.pop()
                parent = stack[-1].value if stack else None
                continue
            if (
                kind is ScalarEvent
                or kind is SequenceStartEvent
                or kind is MappingStartEvent
            ):
                # Aliases can expand to gigabytes, and tags can construct objects: both
                # are refused.
                if event.anchor is not None or event.tag is not None:
                    raise self._refusal(event)
            else:
                documents = self._count_documents(event, documents)
                continue

            nodes += 1
            if nodes > most_nodes:
                raise Limit.VALUES.error(self._place(event))
            if has_lines:
                mark = event.start_mark
                line = mark.line + 1
                column = mark.column + 1
            if key is None and type(parent) is dict:
                key = self._key(event, parent, stack)
                key_place = (line, column)
                continue
            if kind is ScalarEvent:
                value: Any = event.value
                # A quoted scalar is text, even if it looks like a number.
                if event.implicit[0]:
                    value = self._resolve_scalar(event, stack, key)
            elif kind is SequenceStartEvent:
                value = []
            else:
                value = {}
            node = Node(value, source, line, column)
            if key is not None:
                node.key = key_place
                # The first of two equal keys counts; the second is reported.
                parent.setdefault(key, node)
                key = None
            elif parent is not None:
                parent.append(node)
            else:
                root = node
            if kind is not ScalarEvent:
                stack.append(node)
                parent = node.value
                if len(stack) > most_levels:
                    raise Limit.DEPTH.error(self._place(event))
        return root

    def _key(self, event: Any, siblings: dict[str, Node], stack: list[Node]) -> str:
        """Return the text of a key. Report a repeated or forbidden one."""
        if type(event) is not ScalarEvent:
            raise self._error(Message.KEY_NOT_TEXT, event)
        key: str = event.value
        if key in siblings:
            self._report_repeated_key(event, siblings[key], _path(stack, key))
        elif key == "<<" and event.implicit[0]:
            raise self._error(Message.MERGE_KEY, event)
        # The limit is checked during reading, before a huge file fills the memory.
        if len(stack) == 2 and len(siblings) == Limit.OBJECTS.most:
            top = stack[0].value
            assert isinstance(top, dict)
            # The last key read so far is the section of this mapping.
            if next(reversed(top)) == "objects":
                raise Limit.OBJECTS.error(self._place(event), "objects")
        return key

    def _report_repeated_key(self, event: Any, first: Node, key_path: str) -> None:
        line = ""
        if first.key and self.has_lines:
            line = f", first on line {first.key[0]}"
        self._collect(
            Message.KEY_TWICE.problem(self._place(event), key_path, first=line)
        )

    def _collect(self, problem: Problem) -> None:
        self.problems.append(problem)
        # More problems do not help in one message.
        if len(self.problems) > 100:
            raise InputError(self.problems)

    def _error(self, message: Message, event: Any, **values: object) -> InputError:
        return message.error_at(self._place(event), **values)

    def _refusal(self, event: Any) -> InputError:
        if getattr(event, "tag", None) is not None:
            return self._error(Message.TAG, event, tag=quoted(event.tag, ""))
        kind = "an anchor"
        if type(event) is AliasEvent:
            kind = "an alias"
        name = quoted(event.anchor, "")
        return self._error(Message.ANCHOR, event, kind=kind, name=name)


def _path(stack: list[Node], key: str | None) -> str:
    """Return the dotted path of the current value, through the last child of each open
    collection.
    """
    parts: list[str | int] = []
    # The reader is inside the last child of each open collection: its key or its number
    # is the path.
    for node in stack:
        value = node.value
        last = node is stack[-1]
        if isinstance(value, dict):
            parts.append(key if last and key is not None else next(reversed(value)))
        elif isinstance(value, list):
            parts.append(len(value) - (0 if last else 1))
    return dotted(tuple(parts))


_OPEN = re.compile(r"""(?<=[:,\[{-] )(?:"[^"\n]*|'[^'\n]*)$""", re.MULTILINE)
"""An unclosed quote at the end of a line."""
_CONTROL_CHARACTER = re.compile(
    r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)
"""A character that YAML does not allow."""


def _line_and_column(text: str, index: int) -> tuple[int, int]:
    """Return the line and the column of a character, both from 1."""
    start = text.rfind("\n", 0, index) + 1
    return text.count("\n", 0, index) + 1, index - start + 1


def _reason_of(error: yaml.MarkedYAMLError) -> str:
    """Return PyYAML's description of an error."""
    if error.context and error.problem:
        return f"{error.problem} {error.context}"
    return error.problem or error.context or "wrong YAML"


def _marked_fault(
    error: yaml.MarkedYAMLError, text: str, source: Source
) -> tuple[Place, str, str]:
    """Return place, reason and fix of an error with a position; the fix may be
    empty.
    """
    mark = error.problem_mark or error.context_mark
    place = Place(source.name)
    line_start = 0
    if mark:
        place = Place(source.name, mark.line + 1, mark.column + 1)
        line_start = text.rfind("\n", 0, mark.index) + 1
    reason = _reason_of(error)
    # PyYAML reports an unclosed quote at the end of the file. The first open quote is
    # the better place.
    quote_places = [match.start() for match in _OPEN.finditer(text, 0, line_start)]
    if "quoted scalar" in reason and error.context_mark:
        quote_places = [error.context_mark.index]
    if quote_places:
        reason = "a quoted scalar begins here and does not end in its line"
        place = Place(source.name, *_line_and_column(text, quote_places[-1]))
        return place, reason, ""
    fault = explain_syntax(error, text)
    if fault is None:
        return place, reason, ""
    return Place(source.name, fault.line, fault.column), fault.expectation, fault.fix


def _place_of_control_character(
    error: yaml.YAMLError, text: str, source: Source
) -> Place:
    """Return the place of the first control character."""
    index = min(getattr(error, "position", 0), len(text))
    # The error's position may not be an index into the text: find the character
    # itself.
    control_character = _CONTROL_CHARACTER.search(text)
    if control_character:
        index = control_character.start()
    return Place(source.name, *_line_and_column(text, index))


def _syntax_problem(error: yaml.YAMLError, text: str, source: Source) -> Problem:
    """Return PyYAML's message as a Problem, without its drawings."""
    if isinstance(error, yaml.MarkedYAMLError):
        place, reason, fix = _marked_fault(error, text, source)
    else:
        place = _place_of_control_character(error, text, source)
        reason, fix = "control characters are not allowed", ""
    # A flag has no lines: its text is the place.
    if source.name.startswith("--set "):
        place = Place(source.name)
    # libyaml 0.2.6 and later reach their own limit before ours.
    if "maximum nesting depth" in reason:
        return Limit.DEPTH.error(place).problems[0]
    if not fix:
        fixes = [text for start, text in _FIXES if start in reason]
        fix = [*fixes, "write `key: value`, one a line"][0]
    return Message.NOT_YAML.problem(place, reason=reason, fix=fix)


_FIXES = (
    (
        "could not find expected ':'",
        "put a space after the colon of a key, here or in the line above",
    ),
    (
        "mapping values are not allowed",
        'put text that holds ": " in quotes, and a space after the colon of every key, also in the line above',
    ),
    ("a tab character", "indent with spaces, not tabs"),
    (
        "parsing a block mapping",
        "indent the line as those beside it, and write `key: value`, one a line",
    ),
    (
        "cannot start any token",
        "put text that starts with @ or ` in quotes",
    ),
    ("flow sequence", "close the ["),
    ("flow mapping", "close the {"),
    ("invalid Unicode character escape", "write the character itself"),
    ("quoted scalar", "close the quote"),
    ("control characters", "take it out"),
)
