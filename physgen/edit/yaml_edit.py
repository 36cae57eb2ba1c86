"""Changes of YAML text that keep all other lines and the comments as they are.

Positions come from the parser; new values are written in the style of `physgen.scene.write`. After each change the
text is read back: one that does not hold the intended data is never returned.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Any

from physgen.edit.errors import EditError, impossible
from physgen.edit.yaml_tree import (
    BREAK,
    Kind,
    Marked,
    Patch,
    below,
    checked,
    entry,
    find,
    joint,
    leads,
    line_after,
    line_before,
    line_begin,
    line_end,
    marked,
    newline,
    parent_of,
    reach,
    same,
)
from physgen.scene.schema import schema_at
from physgen.scene.write import entry_lines, flow_text, key_text
from physgen.text import KeyPath, dotted

COMMENT_WIDTH = 100
"""Columns of a comment."""
MAX_ITEM_CHANGES = 40
"""Items of a list that are changed one by one; with more, the list is written anew."""
REASONS = {"mass": ("g: ",), "friction": ("friction", "ordinary friction"), "layer": ("in front: ",)}
"""How comments of perception begin that give the reason of a value, by key; other comments are the user's."""
UNSEEN_FRICTION = ("friction cannot be seen", "nobody can see friction")
"""As perception writes it, and as it did in version 1."""
GUESSES = {
    "mass": ("g: ",),
    "density": ("g: ",),
    "friction": ("friction", "ordinary friction", "at least this much", *UNSEEN_FRICTION),
    "layer": ("in front: ",),
    "motion": ("cut off by the photo's border", "nothing that is seen keeps", "nothing visible"),
    "pixels_per_meter": ("1 px = 1 cm", "from the ordinary size", "as given; masses", "as it was, for what"),
    "view": ("side or top: ",),
    "table": UNSEEN_FRICTION,
}
"""The same for all values that a user may set in place of a guess."""


# Comments


@dataclass(frozen=True)
class _Comment:
    """The line of a key, counted from 0; `column`: of a comment behind it; `first`: line of one above it."""

    line: int
    column: int | None = None
    first: int | None = None


def _comment(text: str, path: Sequence[str | int], starts: tuple[str, ...]) -> _Comment | None:
    """The comment at a key that begins in one of these ways; None where the key has no line of its own."""
    try:
        node: Marked | None = marked(text)
    except EditError:
        return None
    for key in path[:-1]:
        node = None if node is None else node.child(key)
    begin = None if node is None else next((at for name, at, _ in node.keys if name == path[-1]), None)
    if begin is None or text[text.rfind("\n", 0, begin) + 1 : begin].strip():
        return None
    lines, line = text.split("\n"), text.count("\n", 0, begin)
    behind = re.search(rf"\s+#\s+(?:{'|'.join(map(re.escape, starts))}).*$", lines[line])
    if behind is not None:
        return _Comment(line, column=behind.start())
    first = line
    while first and lines[first - 1].lstrip().startswith("#"):
        first -= 1
    ours = (k for k in range(first, line) if lines[k].lstrip(" #").startswith(starts))
    return _Comment(line, first=next(ours, None))


def with_reasons(text: str, reasons: Mapping[str, str], fresh: Collection[str] = ()) -> str:
    """The text with other reasons in the comments of perception, by dotted path; other comments stay.

    Objects that are `fresh` get comments where they have none.
    """
    for dotted_path, reason in reasons.items():
        path = dotted_path.split(".")
        starts = REASONS.get(path[-1])
        found = None if starts is None else _comment(text, path, starts)
        if found is None:
            continue
        lines = text.split("\n")
        line = lines[found.line]
        if found.first is not None:
            indent = line[: len(line) - len(line.lstrip())]
            wrapped = textwrap.wrap(reason, COMMENT_WIDTH - len(indent))
            lines[found.first : found.line] = [f"{indent}# {part}" for part in wrapped]
        elif found.column is not None or (path[1] in fresh and re.fullmatch(r"\s+\w+: [^#{]*", line)):
            lines[found.line] = f"{line[: found.column]}  # {' '.join(reason.split())}"
        text = "\n".join(lines)
    return text


def with_boundary_comments(text: str, remarks: Mapping[str, tuple[str, str]]) -> str:
    """The text with other comments of perception behind the names of boundaries: by name, before and now.

    >>> with_boundary_comments("boundaries:\\n  floor:  # below 3\\n    x: 1\\n", {"floor": ("below 3", "below 4")})
    'boundaries:\\n  floor:  # below 4\\n    x: 1\\n'
    """
    head, key, walls = text.partition("\nboundaries:") if "\nboundaries:" in text else ("", "", text)
    for name, (before, now) in remarks.items():
        old = rf"  # {re.escape(before)}" if before else ""
        new = f"  # {' '.join(now.split())}" if now else ""
        found = re.search(rf"(?m)^  {re.escape(name)}:(?P<old>{old})$", walls)
        if found is not None:
            walls = walls[: found.start("old")] + new + walls[found.end("old") :]
    return head + key + walls


def without_guess_comments(text: str, paths: Sequence[Sequence[str | int]]) -> str:
    """The text without perception's comments on values that a user has set now; other comments stay.

    >>> without_guess_comments("world:\\n  # 1 px = 1 cm, as\\n  view: top\\n", [["world", "view"]])
    'world:\\n  # 1 px = 1 cm, as\\n  view: top\\n'
    """
    for path in paths:
        for k, key in enumerate(path):
            if not isinstance(key, str) or key not in GUESSES or (k == 1 and path[0] != "world"):
                continue
            found = _comment(text, path[: k + 1], GUESSES[key])
            lines = text.split("\n")
            if found is not None and found.column is not None:
                lines[found.line] = lines[found.line][: found.column]
            elif found is not None and found.first is not None:
                del lines[found.first : found.line]
            text = "\n".join(lines)
    return text


# Values


def put(text: str, path: KeyPath, value: Any) -> str:
    """Set the value at a path; missing mappings are made. Raises EditError."""
    node = marked(text)
    for depth, key in enumerate(path):
        if node.place(key) is None:
            return _made(text, path, depth, value)
        node = node.children[node.place(key) or 0]
    return text if same(node.data(), value) else _replaced(text, path, value)


def drop(text: str, path: KeyPath) -> str:
    """Remove the key or the item at a path. Raises EditError."""
    parent, at = parent_of(text, path)
    if len(parent.children) == 1:
        return _emptied(text, path[:-1])
    begin = entry(text, parent, at)
    child = parent.children[at]
    if parent.is_flow or not leads(text, begin):
        patch = _cut(text, parent, at, begin)
    else:
        stop = line_after(text, child.end)
        first = line_begin(text, begin)
        if stop == len(text) and not BREAK.search(text[-1:]):  # nor does the new last line end
            first = line_before(text, first)
        patch = (first, stop, "")

    def remove(data: Any) -> None:
        del reach(data, path[:-1])[path[-1]]

    return checked(text, [patch], remove)


def _cut(text: str, parent: Marked, at: int, begin: int) -> Patch:
    """Patch that removes one of several entries in brackets, and no comments of others."""
    child = parent.children[at]
    if at and leads(text, begin):  # the comma before it may stay: YAML lets one stand at the end
        if re.fullmatch(r"\s*,\s*(#.*)?", text[child.end : line_end(text, child.end)]):
            return line_begin(text, begin), line_after(text, child.end), ""
        if at + 1 == len(parent.children):
            return begin, child.end, ""
    elif at:
        return parent.children[at - 1].end, child.end, ""
    return begin, entry(text, parent, at + 1), ""


def insert(text: str, path: KeyPath, value: Any) -> str:
    """Insert an item into a list, before the one at the path. Raises EditError."""
    where, at = path[:-1], path[-1]
    node = find(text, where)
    assert isinstance(at, int)
    if not node.children:
        return _replaced(text, where, [value])
    return checked(
        text, [_item(text, node, where, at, value)], lambda data: reach(data, where).insert(at, value)
    )


def rename(text: str, path: KeyPath, to: str) -> str:
    """Rename a key. Raises EditError."""
    parent, at = parent_of(text, path)
    _, begin, end = parent.keys[at]

    def meant(data: Any) -> None:
        above = reach(data, path[:-1])
        pairs = [(to if key == path[-1] else key, value) for key, value in above.items()]
        above.clear()
        above.update(pairs)

    return checked(text, [(begin, end, key_text(to))], meant)


def _made(text: str, path: KeyPath, depth: int, value: Any) -> str:
    """Add a key, and the mappings that lead to it."""
    where, key = path[:depth], path[depth]
    node = find(text, where)
    for step in reversed(path[depth + 1 :]):
        if isinstance(step, int):
            raise impossible(f"{dotted(path)}: there is no such list in the file", "set the whole of it")
        value = {step: value}
    if node.is_list and key == len(node.children):
        return insert(text, (*where, key), value)
    if isinstance(key, int) or not (node.is_map or node.value is None):
        kind = "a list" if node.is_list else "one value" if not node.is_map else "a mapping"
        raise impossible(f"{dotted(where) or 'the file'} is {kind}: it has no {key}", "set the whole of it")
    if not node.children:
        return _replaced(text, where, {key: value})

    def meant(data: Any) -> None:
        reach(data, where)[key] = value

    after = node.children[_before(node, where, key)]
    if node.is_flow:
        inner = f"{key_text(key)}: {flow_text(value, (*where, key))}"
        patch = (after.end, after.end, joint(text, node, after) + inner)
    else:
        indent = " " * node.column
        lines = entry_lines(value, f"{indent}{key_text(key)}:", indent + "  ", (*where, key))
        patch = below(text, after.end, lines)
    return checked(text, [patch], meant)


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
    if node.is_map and isinstance(value, dict) and value and node.children:
        keys = {key for key, _, _ in node.keys}
        if not node.is_flow or (keys != value.keys() and keys & value.keys()):
            return _entries(text, path, node, value)
    elif node.is_list and isinstance(value, list) and value and node.children:
        steps = _steps(node.data(), value)
        if (not node.is_flow or len(value) != len(node.children)) and _count(steps) <= MAX_ITEM_CHANGES:
            return _items(text, path, steps, value)

    def meant(data: Any) -> Any:
        if not path:
            return value
        reach(data, path[:-1])[path[-1]] = value
        return None

    patches = _differences(node, value, path) if node.is_flow else None
    if not path:
        lines = [line for key in value for line in entry_lines(value[key], f"{key_text(key)}:", "  ", (key,))]
        patches = patches or [(node.begin, node.end, newline(text).join(lines) or "{}")]
    if patches is None:
        patches = _rewritten(text, path, value)
    return checked(text, patches, meant)


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
            text = rename(text, (*path, key), name)
            continue
        if len(find(text, path).children) == 1:  # an empty mapping would lose its style
            first = next(iter(value))
            text = put(text, (*path, first), value[first])
        text = drop(text, (*path, key))
    for key, child in value.items():
        if key not in old or not same(old[key], child):
            text = put(text, (*path, key), child)
    return text


Steps = list[tuple[int, int, int, int]]
"""Runs of items that differ: where they begin and end in the old list, and in the new one."""


def _steps(old: list[Any], new: list[Any]) -> Steps:
    if len(old) == len(new):
        pairs = zip(old, new, strict=True)
        return [(at, at + 1, at, at + 1) for at, (one, other) in enumerate(pairs) if not same(one, other)]
    matcher = SequenceMatcher(None, list(map(repr, old)), list(map(repr, new)), autojunk=False)
    return [step[1:] for step in matcher.get_opcodes() if step[0] != "equal"]


def _count(steps: Steps) -> int:
    return sum(max(end - begin, last - first) for begin, end, first, last in steps)


def _items(text: str, path: KeyPath, steps: Steps, new: list[Any]) -> str:
    """A list item by item, from its end, so that numbers of items stay what they are."""
    for begin, end, first, last in reversed(steps):
        shared = min(end - begin, last - first)
        for at in range(shared):
            text = put(text, (*path, begin + at), new[first + at])
        for at in range(shared, last - first):
            text = insert(text, (*path, begin + at), new[first + at])
        for at in reversed(range(begin + shared, end)):
            text = drop(text, (*path, at))
    return text


def _differences(node: Marked, value: Any, path: KeyPath) -> list[Patch] | None:
    """Patches that change values inside brackets; None where keys or the number of items differ."""
    if node.is_map and isinstance(value, dict) and {key for key, _, _ in node.keys} == value.keys():
        pairs = [
            (child, value[key], (*path, key))
            for (key, _, _), child in zip(node.keys, node.children, strict=True)
        ]
    elif node.is_list and isinstance(value, list) and len(node.children) == len(value):
        pairs = [(child, value[at], (*path, at)) for at, child in enumerate(node.children)]
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
    """Patches that write the value of a key or an item anew; a comment at the line's end stays."""
    parent, at = parent_of(text, path)
    node = parent.children[at]
    if parent.is_flow:
        return [_inside(node, value, path)]
    begin = entry(text, parent, at)
    if parent.is_map:
        colon = text.index(":", parent.keys[at][2])
        start = " " * parent.column + text[begin : colon + 1]
    else:
        colon = begin
        start = " " * parent.column + "-"
    first, *rest = entry_lines(value, start, " " * parent.column + "  ", path)
    first = first[len(start) :]
    if rest and not first and (node.kind is Kind.SCALAR or node.is_flow) and node.style not in ("|", ">"):
        return [(colon + 1, node.end, ""), below(text, node.end, rest)]
    return [(colon + 1, node.end, newline(text).join([first, *rest]))]


def _emptied(text: str, path: KeyPath) -> str:
    """Remove the last entry of a collection."""
    node = find(text, path)
    empty: Any = {} if node.is_map else []
    if not path:
        return checked(text, [(node.begin, node.end, "{}")], lambda data: empty)

    def meant(data: Any) -> None:
        reach(data, path[:-1])[path[-1]] = empty

    return checked(text, _rewritten(text, path, empty), meant)


def _item(text: str, node: Marked, path: KeyPath, at: int, value: Any) -> Patch:
    """Patch that inserts an item into a list that has some."""
    if node.is_flow:
        inner = flow_text(value, (*path, at))
        if at == 0:
            begin = node.children[0].begin
            return begin, begin, f"{inner}, "
        before = node.children[at - 1]
        return before.end, before.end, joint(text, node, before) + inner
    indent = " " * node.column
    lines = entry_lines(value, f"{indent}-", indent + "  ", (*path, at))
    if at:
        return below(text, node.children[at - 1].end, lines)
    begin = entry(text, node, 0)
    return begin, begin, (newline(text).join(lines) + newline(text) + indent)[node.column :]
