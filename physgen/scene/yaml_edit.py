"""Change YAML text, and keep all other lines and the comments.

Positions come from the parser of scenes, so that a position holds the scene's value.
New values have the style of `physgen.scene.write`, or of JSON in a JSON file. The new
text is read again: a text without the intended data is never returned.

A comment belongs to an entry at the end of its line, in deeper lines after it, or
directly above it with the same indentation and no blank line between. A removed entry
takes its comments along. Comments at the very top belong to the file, and a comment
after the key of a section belongs to the section.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import yaml

from physgen.messages import Message
from physgen.problems import EditError, InputError
from physgen.scene.document import LOADER, Source, read, resolve
from physgen.scene.schema import schema_at
from physgen.scene.write import entry_lines, flow_text, key_text
from physgen.text import KeyPath, dotted, number

_NOWHERE = Path()

Patch = tuple[int, int, str]
"""First and last character of the removed text, and the new text."""
BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


@dataclass
class MarkedValue:
    """A value with its position. `begin` and `end` are indices into the text; the `end`
    of a block is the end of its last value.
    """

    # `dict`, `list`, or `str` for any scalar.
    kind: type
    # True for a value in brackets.
    is_flow: bool
    begin: int
    end: int
    column: int
    # Value of a scalar.
    value: Any = None
    style: str = ""
    """Style of a scalar: `""` plain, or its quote, `

    ` or `>`.
    """
    keys: list[tuple[str, int, int]] = field(default_factory=list)
    """Keys of a mapping, with their positions."""
    # Values of a mapping, or items of a list.
    children: list[MarkedValue] = field(default_factory=list)

    def place(self, key: str | int) -> int | None:
        """Return the index of the child at a key or an index, or None."""
        if isinstance(key, int):
            if self.kind is list and 0 <= key < len(self.children):
                return key
            return None
        return self._places.get(key)

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: index for index, (name, _, _) in enumerate(self.keys)}

    def child(self, key: str | int) -> MarkedValue | None:
        """Return the value of a key or an index."""
        index = self.place(key)
        if index is None:
            return None
        return self.children[index]

    def data(self) -> Any:
        """Return the plain data."""
        if self.kind is dict:
            return {
                key: child.data()
                for (key, _, _), child in zip(self.keys, self.children, strict=True)
            }
        if self.kind is list:
            return [child.data() for child in self.children]
        return self.value


@lru_cache(maxsize=4)
def mark_values(text: str) -> MarkedValue:
    """Return the tree of a file's text. Raise EditError for invalid YAML, which can
    only be edited as text.
    """
    try:
        read(text, Source("", _NOWHERE))
    except InputError as error:
        problem = error.problems[0]
        line_text = ""
        if problem.place.line:
            line_text = f" (line {problem.place.line})"
        reason = f"{problem.found} {problem.expected}".strip()
        raise Message.EDITOR_UNREADABLE.impossible(
            where=line_text, reason=reason
        ) from None
    return _mark_tree(yaml.compose(text, Loader=LOADER), text)


def _mark_tree(node: Any, text: str) -> MarkedValue:
    begin = node.start_mark.index
    end = node.end_mark.index
    column = node.start_mark.column
    if isinstance(node, yaml.ScalarNode):
        style = ""
        if node.style in ("'", '"', "|", ">"):
            style = node.style
        if style in ("|", ">"):
            # PyYAML counts the empty lines after a block scalar.
            end = begin + len(text[begin:end].rstrip())
        # A quoted scalar is always text; a plain one may be a number or a truth value.
        if style:
            value = node.value
        else:
            value = resolve(node.value)
        return MarkedValue(str, False, begin, end, column, value, style)
    keys: list[tuple[str, int, int]] = []
    if isinstance(node, yaml.MappingNode):
        keys = []
        for key, _ in node.value:
            keys.append((key.value, key.start_mark.index, key.end_mark.index))
        children = [_mark_tree(child, text) for _, child in node.value]
    else:
        children = [_mark_tree(child, text) for child in node.value]
    flow = bool(node.flow_style)
    kind: type = list
    if isinstance(node, yaml.MappingNode):
        kind = dict
    # The parser ends a block at the next token, after comments and blank lines; here
    # its last value ends it.
    return MarkedValue(
        kind,
        flow,
        begin,
        end if flow else children[-1].end,
        column,
        keys=keys,
        children=children,
    )


def entry(text: str, parent: MarkedValue, index: int) -> int:
    """Return the start of a child's entry: its key, or its dash."""
    if parent.kind is dict:
        return parent.keys[index][1]
    if parent.is_flow:
        return parent.children[index].begin
    if index == 0:
        return parent.begin
    # The parser gives no position of a dash: find the line with a dash in the column of
    # the list.
    place = line_after(text, parent.children[index - 1].end)
    while (
        text[place : place + parent.column].strip(" ")
        or text[place + parent.column] != "-"
    ):
        place = line_after(text, place)
    return place + parent.column


def line_begin(text: str, place: int) -> int:
    """Return the start of the line of a place."""
    while place and not BREAK.match(text[place - 1]):
        place -= 1
    return place


def line_end(text: str, place: int) -> int:
    """Return the end of the line of a place, before its break."""
    line_break = BREAK.search(text, place)
    if line_break:
        return line_break.start()
    return len(text)


def line_after(text: str, place: int) -> int:
    """Return the start of the next line."""
    line_break = BREAK.search(text, place)
    if line_break:
        return line_break.end()
    return len(text)


def leads(text: str, place: int) -> bool:
    """Return whether a place is the first of its line, apart from spaces."""
    return not text[line_begin(text, place) : place].strip(" ")


def newline(text: str) -> str:
    """Return the line break of a text."""
    line_break = BREAK.search(text)
    if line_break and line_break[0] in ("\r\n", "\r"):
        return line_break[0]
    return "\n"


def patch_below(text: str, place: int, lines: Sequence[str]) -> Patch:
    """Return the patch that adds lines after the line of a place."""
    stop = line_end(text, place)
    line = newline(text)
    return stop, stop, line + line.join(lines)


def joint(text: str, node: MarkedValue, before: MarkedValue) -> str:
    """Return the separator before a new entry in brackets, with a line break if each
    entry has its own line.
    """
    if node.kind is dict:
        begin = node.keys[node.children.index(before)][1]
    else:
        begin = before.begin
    # A new entry gets the indentation of the one before it.
    if leads(text, begin) and line_begin(text, begin) > node.begin:
        return "," + newline(text) + text[line_begin(text, begin) : begin]
    return ", "


def find(text: str, path: Sequence[str | int]) -> MarkedValue:
    """Return the value at a path. Raise EditError if there is no value."""
    node = mark_values(text)
    for key in path:
        child = node.child(key)
        if child is None:
            raise Message.EDITOR_NOT_THERE.impossible(path=dotted(tuple(path)))
        node = child
    return node


def are_equal(first: Any, second: Any) -> bool:
    """Return whether two values are equal; true and 1 are not."""
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(
            are_equal(first[key], second[key]) for key in first
        )
    if isinstance(first, list) and isinstance(second, list):
        return len(first) == len(second) and all(map(are_equal, first, second))
    # Python counts True and 1 as equal; YAML writes them differently.
    if isinstance(first, bool) or isinstance(second, bool):
        return first is second
    return bool(first == second)


def parent_of(text: str, path: KeyPath) -> tuple[MarkedValue, int]:
    """Return the parent collection of the value at a path, and the index of the value
    in it.
    """
    parent = find(text, path[:-1])
    index = parent.place(path[-1])
    if index is None:
        raise Message.EDITOR_NOT_THERE.impossible(path=dotted(path))
    return parent, index


def apply_patches(text: str, *patches: Patch) -> str:
    """Return the text with patches. They must not overlap."""
    # From the end of the text, so that earlier positions stay valid.
    for begin, end, new in sorted(patches, reverse=True):
        text = text[:begin] + new + text[end:]
    return text


# ---- values


def write(text: str, data: dict[str, Any]) -> str:
    """Return the text of a file with the content `data`. Raise EditError."""
    try:
        new_text = put(text, (), data)
        # A block of YAML inside JSON is valid YAML, but no longer JSON.
        if is_json(text) and not is_json(new_text):
            new_text = json.dumps(data, indent=2, ensure_ascii=False) + "\n"
        # The result is read again: a wrong text must never replace a user's file.
        if are_equal(mark_values(new_text).data(), data):
            return new_text
    except EditError:
        pass
    raise Message.EDITOR_UNWRITABLE.impossible()


def written_anew(text: str, path: KeyPath, value: Any) -> str:
    """Return the text with the value at a path in the form of a new file. Keep a value
    with a comment in brackets.
    """
    node = find(text, path)
    # A rewrite would lose the comment.
    if "#" in text[node.begin : line_after(text, node.end - 1)]:
        return text
    return apply_patches(text, *_rewritten(text, path, value))


def put(text: str, path: KeyPath, value: Any) -> str:
    """Set the value at a path with an existing parent."""
    if path and find(text, path[:-1]).place(path[-1]) is None:
        return _make_entry(text, path, value)
    if are_equal(find(text, path).data(), value):
        return text
    return _replace_value(text, path, value)


def _drop(text: str, path: KeyPath) -> str:
    """Remove one of several keys or items, with its comments."""
    parent, index = parent_of(text, path)
    begin = entry(text, parent, index)
    if not leads(text, begin) or not _ends_line(text, parent, index):
        return apply_patches(text, _cut(text, parent, index, begin))
    first = _first_line(text, parent, index)
    stop = _last_line(text, parent, index)
    # Of the blank lines around a removed entry, only one stays.
    if _is_blank_line(text, stop) and first and _is_blank_line(text, first - 1):
        stop = line_after(text, stop)
    # Without a break at the end of the file, the new last line needs none.
    if stop == len(text) and not BREAK.search(text[-1:]):
        first -= 2 if text[:first].endswith("\r\n") else 1
    patches = [(first, stop, "")]
    is_last = index > 0 and index + 1 == len(parent.children)
    # JSON has no comma after the last entry.
    if is_last and is_json(text):
        end = parent.children[index - 1].end
        patches.append((end, text.index(",", end) + 1, ""))
    return apply_patches(text, *patches)


def _ends_line(text: str, parent: MarkedValue, index: int) -> bool:
    """Return whether only a comma and a comment follow an entry on its line."""
    if not parent.is_flow:
        return True
    end = parent.children[index].end
    rest = text[end : line_end(text, end)]
    return re.fullmatch(r"\s*,?\s*(#.*)?", rest) is not None


def _is_blank_line(text: str, place: int) -> bool:
    """Return whether the line of a place has only a break."""
    stop = line_end(text, place)
    return stop < len(text) and not text[line_begin(text, place) : stop].strip()


def _first_line(text: str, parent: MarkedValue, index: int) -> int:
    """Return the start of an entry's lines: of the comments directly above it."""
    begin = entry(text, parent, index)
    first = line_begin(text, begin)
    column = begin - first
    end_above = 0
    if index:
        end_above = parent.children[index - 1].end
    top = first
    # Comments directly above an entry, in its own column, belong to it and move with
    # it.
    while top > end_above:
        line = line_begin(text, top - len(_break_before(text, top)))
        words = text[line:top].rstrip()
        is_comment = words.lstrip(" ").startswith("#")
        if line < end_above or not is_comment or words.index("#") != column:
            return top
        top = line
    # Comments at the top of the file belong to the file.
    return first


def _break_before(text: str, place: int) -> str:
    """Return the line break before a place, or ""."""
    if text.endswith("\r\n", 0, place):
        return "\r\n"
    before = text[max(place - 1, 0) : place]
    if BREAK.match(before):
        return before
    return ""


def _last_line(text: str, parent: MarkedValue, index: int) -> int:
    """Return the end of an entry's lines: of the deeper comments after it."""
    begin = entry(text, parent, index)
    column = begin - line_begin(text, begin)
    stop = line_after(text, parent.children[index].end)
    return _after_deeper_comments(text, stop, column)


def _after_deeper_comments(text: str, place: int, column: int) -> int:
    """Return the end of the comments from a line on that are right of a column."""
    stop = place
    while place < len(text):
        words = text[place : line_end(text, place)]
        is_deeper = len(words) - len(words.lstrip(" ")) > column
        place = line_after(text, place)
        if words.lstrip().startswith("#") and is_deeper:
            stop = place
        elif words.strip():
            break
    return stop


def _cut(text: str, parent: MarkedValue, index: int, begin: int) -> Patch:
    """Return the patch that removes one of several entries in brackets, without
    comments of others.
    """
    child = parent.children[index]
    is_last = index + 1 == len(parent.children)
    if index and leads(text, begin):
        # After a comment, keep the comma before it: YAML allows a comma at the end.
        before = parent.children[index - 1].end
        if is_last:
            return begin if "#" in text[before:begin] else before, child.end, ""
    elif index:
        return parent.children[index - 1].end, child.end, ""
    after = entry(text, parent, index + 1)
    # Keep the comments below an item after a dash.
    if not parent.is_flow and "#" in text[line_end(text, child.end) : after]:
        return begin, line_end(text, child.end), ""
    return begin, after, ""


def _insert(text: str, path: KeyPath, value: Any) -> str:
    """Insert an item into a list, before the one at the path."""
    parent_path = path[:-1]
    index = int(path[-1])
    node = find(text, parent_path)
    # An empty list is written as brackets: replace it as a whole.
    if not node.children:
        return _replace_value(text, parent_path, [value])
    if node.is_flow:
        # A list on one line takes the new item between commas.
        inner = _inline(text, value, path)
        before = node.children[max(index - 1, 0)]
        if index == 0:
            return apply_patches(text, (before.begin, before.begin, f"{inner}, "))
        return apply_patches(
            text, (before.end, before.end, joint(text, node, before) + inner)
        )
    indent = " " * node.column
    lines = entry_lines(value, f"{indent}-", indent + "  ", path)
    if index:
        return apply_patches(
            text, patch_below(text, node.children[index - 1].end, lines)
        )
    begin = entry(text, node, 0)
    # The first dash already has its indentation before it.
    return apply_patches(
        text, (begin, begin, (newline(text).join([*lines, indent]))[node.column :])
    )


def _rename(text: str, path: KeyPath, new_name: str) -> str:
    """Rename a key."""
    parent, index = parent_of(text, path)
    _, begin, end = parent.keys[index]
    return apply_patches(
        text, (begin, end, _quoted_as(text, text[begin], new_name, key_text(new_name)))
    )


def _make_entry(text: str, path: KeyPath, value: Any) -> str:
    """Add a key, or an item at the end."""
    parent_path = path[:-1]
    key = path[-1]
    node = find(text, parent_path)
    if isinstance(key, int):
        return _insert(text, path, value)
    if not node.children:
        return _replace_value(text, parent_path, {key: value})
    # A new key goes to its place in the order of the schema, behind the keys before it.
    after = node.children[_before(node, parent_path, key)]
    if node.is_flow:
        inner = f"{_key(text, key)}: {_inline(text, value, path)}"
        return apply_patches(
            text, (after.end, after.end, joint(text, node, after) + inner)
        )
    indent = " " * node.column
    return apply_patches(
        text,
        patch_below(
            text,
            after.end,
            entry_lines(value, f"{indent}{key_text(key)}:", indent + "  ", path),
        ),
    )


def _before(node: MarkedValue, path: KeyPath, key: str) -> int:
    """Return the index of the key before a new one: in the schema's order, or
    the last.
    """
    order = list((schema_at(path) or {}).get("properties", {}))
    if key not in order:
        return len(node.keys) - 1
    earlier_keys = order[: order.index(key)]
    places = []
    for index, (name, _, _) in enumerate(node.keys):
        if name in earlier_keys:
            places.append(index)
    return max(places, default=len(node.keys) - 1)


def _replace_value(text: str, path: KeyPath, value: Any) -> str:
    """Replace a value; in a collection only the differences."""
    node = find(text, path)
    is_block = bool(node.children) and not node.is_flow
    if path and is_block and isinstance(value, node.kind) and not value:
        empty_text = _empty_collection(text, path)
        if empty_text is not None:
            return empty_text
    # First the smallest change, then larger ones: users keep their formatting.
    patches = None
    if node.is_flow:
        patches = _differences(text, node, value, path)
    if patches is None and _have_children(node, value):
        if node.kind is list:
            return _items(text, path, node.data(), value)
        if not node.is_flow or value.keys() & {key for key, _, _ in node.keys}:
            return _entries(text, path, node, value)
    # The document itself has no key to keep.
    if not path:
        patches = patches or [_new_document(text, node, value)]
    elif patches is None:
        patches = _rewritten(text, path, value)
    return apply_patches(text, *patches)


def _new_document(text: str, node: MarkedValue, value: Any) -> Patch:
    """Return the patch that replaces the whole document."""
    if is_json(text):
        return node.begin, node.end, _inline(text, value, ())
    lines: list[str] = []
    for key in value:
        lines += entry_lines(value[key], f"{key_text(key)}:", "  ", (key,))
    return node.begin, node.end, newline(text).join(lines) or "{}"


def _empty_collection(text: str, path: KeyPath) -> str | None:
    """Remove all entries of a section, and keep the section's own comments. Return None
    for an item.
    """
    parent, index = parent_of(text, path)
    node = parent.children[index]
    if parent.kind is not dict or not leads(text, entry(text, node, 0)):
        return None
    # Write an empty collection after the key, and remove the lines of all entries.
    colon = text.index(":", parent.keys[index][2])
    empty = " []"
    if node.kind is dict:
        empty = " {}"
    patches: list[Patch] = [(colon + 1, colon + 1, empty)]
    for child in range(len(node.children)):
        first = _first_line(text, node, child)
        stop = _last_line(text, node, child)
        patches.append((first, stop, ""))
    return apply_patches(text, *patches)


def _have_children(node: MarkedValue, value: Any) -> bool:
    """Return whether two values are non-empty mappings or lists."""
    is_same_kind = node.kind is not str and isinstance(value, node.kind)
    return is_same_kind and bool(node.children) and bool(value)


def _entries(text: str, path: KeyPath, node: MarkedValue, value: dict[str, Any]) -> str:
    """Return the text with a new mapping, key by key. A removed key with the value of a
    new key is renamed.
    """
    old: dict[str, Any] = node.data()
    new = []
    for key in value:
        if key not in old:
            new.append(key)
    for key in old:
        if key in value:
            continue
        # A rename keeps the comments and the position of the entry.
        name = next((name for name in new if are_equal(old[key], value[name])), None)
        if name is not None:
            new.remove(name)
            text = _rename(text, (*path, key), name)
            continue
        # An empty mapping would lose its style.
        if len(find(text, path).children) == 1:
            first = next(iter(value))
            text = put(text, (*path, first), value[first])
        text = _drop(text, (*path, key))
    for key, child in value.items():
        if key not in old or not are_equal(old[key], child):
            text = put(text, (*path, key), child)
    return text


def _items(text: str, path: KeyPath, old: list[Any], new: list[Any]) -> str:
    """Return the text with a new list, item by item between the unchanged ends. Work
    from the last item, so that the indices of earlier items stay valid.
    """
    shorter_length = min(len(old), len(new))
    # Equal items at both ends stay as they are.
    head = next(
        (
            index
            for index in range(shorter_length)
            if not are_equal(old[index], new[index])
        ),
        shorter_length,
    )
    tail = next(
        (
            index
            for index in range(shorter_length - head)
            if not are_equal(old[-1 - index], new[-1 - index])
        ),
        shorter_length - head,
    )
    # Drop surplus items first, insert missing ones, and change the rest in place: these
    # items keep their comments.
    end_of_change = shorter_length - tail
    for index in reversed(range(end_of_change, len(old) - tail)):
        text = _drop(text, (*path, index))
    for index in range(end_of_change, len(new) - tail):
        text = _insert(text, (*path, index), new[index])
    for index in range(head, end_of_change):
        text = put(text, (*path, index), new[index])
    return text


def _differences(
    text: str, node: MarkedValue, value: Any, path: KeyPath
) -> list[Patch] | None:
    """Return patches for values inside brackets, or None if keys or the number of items
    differ, at any depth.
    """
    keys = _common_keys(node, value)
    if keys is None:
        return None
    patches: list[Patch] = []
    for key, child in zip(keys, node.children, strict=True):
        new = value[key]
        child_path = (*path, key)
        if are_equal(child.data(), new):
            continue
        child_patches = _differences(text, child, new, child_path)
        # A value that cannot be patched is rewritten inside its own brackets, if none
        # of its parts could stay.
        if child_patches is None:
            if _have_children(child, new):
                return None
            child_patches = [_inside(text, child, new, child_path)]
        patches += child_patches
    return patches


def _common_keys(node: MarkedValue, value: Any) -> list[str | int] | None:
    """Return the keys or indices of a collection; None if those of `value` differ."""
    if node.kind is dict and isinstance(value, dict):
        keys = [key for key, _, _ in node.keys]
        return [*keys] if set(keys) == value.keys() else None
    if node.kind is not list or not isinstance(value, list):
        return None
    if len(node.children) != len(value):
        return None
    return [*range(len(value))]


def _inside(text: str, node: MarkedValue, value: Any, path: KeyPath) -> Patch:
    """Return the patch of a value in brackets."""
    gap = ""
    # An empty value ends at the colon, which needs a space behind it.
    if node.begin == node.end:
        gap = " "
    inner = _inline(text, value, path)
    if isinstance(value, str):
        inner = _quoted_as(text, node.style, value, inner)
    return node.begin, node.end, gap + inner


SIMPLE = re.compile(r"[\w][\w .-]*").fullmatch
"""Text without characters to escape in either kind of quotes."""


def _quoted_as(text: str, quote: str, value: str, plain_text: str) -> str:
    """Return text in these quotes, or `plain_text`; in a JSON file, as JSON."""
    if is_json(text):
        return _json(value)
    is_quoted = quote in ("'", '"') and SIMPLE(value) is not None
    if is_quoted:
        return f"{quote}{value}{quote}"
    return plain_text


@lru_cache(maxsize=4)
def is_json(text: str) -> bool:
    """Return whether a file is JSON with content."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(data, dict) and bool(data)


def _inline(text: str, value: Any, path: KeyPath) -> str:
    """Return a value on one line: as JSON in a JSON file, otherwise as YAML."""
    if is_json(text):
        return _json(value)
    return flow_text(value, path)


def _key(text: str, key: str) -> str:
    """Return a key: as JSON in a JSON file, otherwise as YAML."""
    if is_json(text):
        return _json(key)
    return key_text(key)


def _json(value: Any) -> str:
    """Return a value as JSON on one line, with numbers that YAML reads as numbers."""
    if isinstance(value, dict):
        pairs = [f"{_json(key)}: {_json(child)}" for key, child in value.items()]
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_json, value)) + "]"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return number(value)
    json_text = json.dumps(value, ensure_ascii=False)
    if json_text.isprintable():
        return json_text
    return json.dumps(value)


def _rewritten(text: str, path: KeyPath, value: Any) -> list[Patch]:
    """Return the patches that rewrite the value of a key or an item.

    A comment after the key or after a value on its line stays. Comments of entries are
    lost.
    """
    parent, index = parent_of(text, path)
    node = parent.children[index]
    if parent.is_flow:
        return [_inside(text, node, value, path)]
    # The rewritten part reaches from the colon or the dash to the end of the value, so
    # that a comment after it stays.
    begin = entry(text, parent, index)
    if parent.kind is dict:
        colon = text.index(":", parent.keys[index][2])
        start = " " * parent.column + text[begin : colon + 1]
    else:
        colon = begin
        start = " " * parent.column + "-"
    end, header = node.end, ""
    if node.kind in (dict, list) and not node.is_flow:
        end = _end_of_block(text, node, begin)
        line = text[colon + 1 : line_end(text, colon)]
        if line.lstrip().startswith("#"):
            header = line.rstrip()
    first, *rest = entry_lines(value, start, " " * parent.column + "  ", path)
    first = first[len(start) :]
    if isinstance(value, str) and node.kind is str:
        first = " " + _quoted_as(text, node.style, value, first.strip())
    # The value becomes a block below its key; a comment stays on the line of the key.
    if rest and not first and _is_on_one_line(node):
        return [(colon + 1, node.end, ""), patch_below(text, node.end, rest)]
    return [(colon + 1, end, newline(text).join([first + header, *rest]))]


def _end_of_block(text: str, node: MarkedValue, begin: int) -> int:
    """Return the end of a block collection with the deeper comments below it."""
    below_value = line_after(text, node.end)
    column = begin - line_begin(text, begin)
    stop = _after_deeper_comments(text, below_value, column)
    if stop > below_value:
        return stop - len(_break_before(text, stop))
    return line_end(text, node.end)


def _is_on_one_line(node: MarkedValue) -> bool:
    if node.style in ("|", ">"):
        return False
    return node.kind is str or node.is_flow
