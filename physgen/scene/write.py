"""Write scene files: documents as readable YAML."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from physgen.problems import RefusedError
from physgen.scene.document import resolve
from physgen.scene.schema import Schema, inner, load_expanded_schema, schema_at
from physgen.text import KeyPath, dotted, number

WIDTH = 112
"""Maximum number of columns of a line before a list of points is wrapped and a mapping
is written in block style.
"""

# YAML takes 1024 characters before the colon.
_LONGEST_KEY = 1000
_BLOCK = re.compile(
    r"world|objects(\.[^.]+)?|boundaries|doubtful|joints|fields|variants|"
).fullmatch
_WRAPPED = re.compile(r"boundaries\.[^.]+|light").fullmatch
_PLAIN = re.compile(r"(?!\.\.\.)(?:-(?=\d))?[\w./][\w./ ()+*=%-]*(?<! )").fullmatch


def scene_text(
    document: Mapping[str, Any],
    comments: Mapping[str, str] | None = None,
    header: str = "",
    schema: str | None = None,
) -> str:
    """Return the document in the schema's order of keys.

    `schema` is the path from the scene to its JSON Schema, for the modeline of editors;
    None leaves the line out. `comments` maps dotted paths (`objects.ball.mass`) to
    comments; a short one is written after the value, a long one above. Raise ValueError
    for infinities, NaN and keys that are not text.
    """
    lines = [f"# yaml-language-server: $schema={schema}"] if schema else []
    lines += _comment_lines(header, "") if header else []
    writer = _Writer(comments or {})
    lines += (
        writer.mapping(document, "", (), load_expanded_schema()) if document else ["{}"]
    )
    return "\n".join(lines) + "\n"


def entry_lines(value: Any, start: str, indent: str, path: KeyPath) -> list[str]:
    """Return the lines of `start` (a key with its colon, or a dash) and its value, as
    `scene_text` writes the value at `path`.

    >>> entry_lines({"object": "ball", "force": [0, -4.0e5]}, "  -", "    ", ("forces", 0))
    ['  - {object: ball, force: [0, -4.0e5]}']
    """
    return list(_Writer({}).entry(value, start, indent, path, schema_at(path)))


def flow_text(value: Any, path: KeyPath) -> str:
    """Return the value at `path` on one line."""
    return _flow(value, schema_at(path))


def edit_texts(edits: Mapping[str, Any]) -> tuple[str, ...]:
    """Return edits by dotted key as KEY=VALUE. None removes a key.

    >>> edit_texts({"objects.ball.mass": 5, "objects.cup": None})
    ('objects.ball.mass=5', 'objects.cup=')
    """
    texts = []
    for key, value in edits.items():
        if value is None:
            text = ""
        else:
            text = flow_text(value, ())
        texts.append(f"{key}={text}")
    return tuple(texts)


class _Writer:
    def __init__(self, comments: Mapping[str, str]) -> None:
        self.comments = comments
        path_parts = (re.split(r"(?=[.\[])", path) for path in comments)
        # A value with a comment inside it needs lines of its own.
        self.commented = {
            "".join(parts[:n]) for parts in path_parts for n in range(len(parts))
        }

    def mapping(
        self,
        value: Mapping[str, Any],
        indent: str,
        path: KeyPath,
        schema: Schema | None,
    ) -> Iterator[str]:
        for key in _order_keys(value, schema):
            part = inner(schema, key)
            yield from self.entry(
                value[key],
                f"{indent}{key_text(key)}:",
                indent + "  ",
                (*path, key),
                part,
            )

    def entry(
        self, value: Any, start: str, indent: str, path: KeyPath, schema: Schema | None
    ) -> Iterator[str]:
        """Yield the lines of `start` (a key with its colon, or a dash) and its value.
        `indent` belongs to the lines below.
        """
        comment = self.comments.get(dotted(path), "")
        value = _data(value)
        text = _flow(value, schema)
        if not self._is_block(value, len(start) + 1 + len(text), path):
            first = f"{start} {text}"
            line_above, line = _place_comment(comment, start, first, is_above=False)
            yield from line_above
            yield from _wrap_line(line, start, indent, text)
            return
        # The first key of a mapping follows the dash of its item.
        has_dash = isinstance(value, Mapping) and start.endswith("-")
        line_above, line = _place_comment(comment, start, start, is_above=has_dash)
        yield from line_above
        if not has_dash:
            yield line
        if isinstance(value, Mapping):
            lines = list(self.mapping(value, indent, path, schema))
            if has_dash:
                lines[0] = f"{start} {lines[0].lstrip()}"
            yield from lines
            return
        items = schema.get("items") if schema else None
        for index, item in enumerate(value):
            item_path = (*path, index)
            yield from self.entry(item, f"{indent}-", indent + "  ", item_path, items)

    def _is_block(self, value: Any, length: int, path: KeyPath) -> bool:
        """Return whether a value has lines of its own; `length` is that of one line."""
        if not value or not isinstance(value, Mapping | list):
            return False
        key_path = dotted(path)
        if isinstance(value, Mapping):
            if key_path in self.commented or _BLOCK(key_path):
                return True
        elif isinstance(value[0], Mapping):
            return True
        # A line slightly too long is easier to read than a broken one.
        if path[-1:] == ("from",) or length <= WIDTH + 8:
            return False
        return not (_points(value) or _WRAPPED(key_path))


def _place_comment(
    comment: str, start: str, line: str, *, is_above: bool
) -> tuple[list[str], str]:
    """Return the lines of a comment above a line, and the line with a short comment."""
    if not comment:
        return [], line
    is_long = "\n" in comment or len(line) + len(comment) + 4 > WIDTH + 8
    if is_above or is_long:
        margin = start[: len(start) - len(start.lstrip())]
        return _comment_lines(comment, margin), line
    return [], f"{line}  {_comment_lines(comment, '')[0]}"


def _comment_lines(text: str, indent: str) -> list[str]:
    words = (
        "".join(c if c.isprintable() else " " for c in line).strip()
        for line in text.strip().split("\n")
    )
    return [f"{indent}# {line}".rstrip() for line in words]


def _wrap_line(first: str, start: str, indent: str, text: str) -> Iterator[str]:
    """Yield a line with a value's `text`. A long line is broken between points, keys or
    numbers.
    """
    comment = first[len(start) + 1 + len(text) :]
    if len(first) - len(comment) <= WIDTH + 8 or text[:1] not in "[{":
        yield first
        return
    line = f"{start} "
    # A list of points breaks only between points, and never within one.
    for part in re.split(
        r"(?<=,) (?=\[|[a-z])" if "[" in text[1:] else r"(?<=,) ", text
    ):
        if len(line) + len(part) > WIDTH:
            yield line.rstrip()
            line = indent
        line += part + " "
    yield line.rstrip() + comment


def _points(value: Any) -> bool:
    """Return whether a value is a long list of numbers or points, which can be broken
    anywhere.
    """
    return (
        isinstance(value, list)
        and len(value) > 2
        and all(
            isinstance(item, int | float)
            or (
                isinstance(item, list) and all(isinstance(n, int | float) for n in item)
            )
            for item in value
        )
    )


def _data(value: Any) -> Any:
    """Convert tuples, and numpy's scalars and arrays, to plain data."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, tuple):
        return list(value)
    return value


def _order_keys(value: Mapping[str, Any], schema: Schema | None) -> list[str]:
    if schema:
        schema_keys = list(schema.get("properties", {}))
    else:
        schema_keys = []
    return [key for key in schema_keys if key in value] + [
        key for key in value if key not in schema_keys
    ]


def _flow(value: Any, schema: Schema | None) -> str:
    """Return a value on one line."""
    value = _data(value)
    if isinstance(value, Mapping):
        pairs = (
            f"{key_text(key)}: {_flow(value[key], inner(schema, key))}"
            for key in _order_keys(value, schema)
        )
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Sequence):
        items = schema.get("items") if schema else None
        return "[" + ", ".join(_flow(item, items) for item in value) + "]"
    return _scalar(value)


def _scalar(value: Any) -> str:
    """Return a number, a boolean or None as YAML."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, int | float):
        raise ValueError(f"a scene cannot hold {type(value).__name__}")
    # YAML has .inf and .nan, but scenes do not.
    if not math.isfinite(value):
        raise ValueError(f"a scene cannot hold {value}")
    return number(value)


def key_text(key: Any) -> str:
    """Return a key as YAML. Raise ValueError unless it is a short text."""
    if not isinstance(key, str) or len(key) > _LONGEST_KEY:
        raise ValueError("a scene's keys are short texts")
    return _text(key)


def _text(text: str) -> str:
    """Return text as YAML, in double quotes only if plain text would be read as
    something else.
    """
    if _PLAIN(text) and text.isprintable():
        try:
            # `on`, `1e3` and `null` would be read as other types.
            if resolve(text) == text:
                return text
        except RefusedError:
            pass
    return '"' + "".join(map(_escape, text)) + '"'


def _escape(char: str) -> str:
    if char in '"\\':
        return "\\" + char
    if char.isprintable():
        return char
    code = ord(char)
    if code < 256:
        return f"\\x{code:02x}"
    if code < 65536:
        return f"\\u{code:04x}"
    return f"\\U{code:08x}"
