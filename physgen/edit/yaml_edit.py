"""Changes of YAML text that keep all other lines and the comments as they are."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
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
    take,
)
from physgen.scene.scene import Scene
from physgen.scene.write import entry_lines, flow_text, key_text, schema_at
from physgen.text import KeyPath, dotted

# ----------------------------------------------------------------------
# Comments in which perception told where a number came from -> the same for the number that took its place.

WIDTH = 100
"""Columns of a comment."""
OURS = {"mass": ("g: ",), "friction": ("friction", "ordinary friction"), "layer": ("in front: ",)}
"""How such a comment begins, by key; any other is a person's."""
GUESSED = {
    "mass": ("g: ",),
    "density": ("g: ",),
    "friction": ("friction", "ordinary friction", "at least this much", "nobody can see friction"),
    "layer": ("in front: ",),
    "motion": ("cut off by the photo's border", "nothing that is seen keeps"),
    "pixels_per_meter": ("1 px = 1 cm", "from the ordinary size", "as given; masses", "as it was, for what"),
    "view": ("side or top: ",),
    "table": ("nobody can see friction",),
}
"""The same of all that a person may set in their place."""


def reasoned(
    text: str, scene: Scene, file: str, reasons: Mapping[str, str], fresh: Collection[str] = ()
) -> str:
    """`reasons` by dotted path; `scene` is that of the text, which is in `file`. Comments of others stay.

    Objects that are `fresh` get comments where they have none.
    """
    lines = text.split("\n")
    for path, reason in sorted(reasons.items(), key=lambda item: -_line(scene, file, item[0])):
        at, starts = _line(scene, file, path), OURS.get(path.rpartition(".")[2])
        if not at or starts is None:
            continue
        line = lines[at - 1]
        behind = re.search(_behind(starts), line)
        if behind is not None:
            lines[at - 1] = f"{line[: behind.start()]}  # {' '.join(reason.split())}"
            continue
        _, name, key = path.split(".", 2)
        if name in fresh and re.fullmatch(rf"\s+{key}: [^#{{]*", line):
            lines[at - 1] = f"{line}  # {' '.join(reason.split())}"
            continue
        first = at - 1
        while first and lines[first - 1].lstrip().startswith("#"):
            first -= 1
        if first < at - 1 and lines[first].lstrip(" #").startswith(starts):
            indent = line[: len(line) - len(line.lstrip())]
            lines[first : at - 1] = [
                f"{indent}# {part}" for part in textwrap.wrap(reason, WIDTH - len(indent))
            ]
    return "\n".join(lines)


def said_of_walls(text: str, remarks: Mapping[str, tuple[str, str]]) -> str:
    """What perception said of walls, by name, and says now, behind each one's name; other remarks stay.

    >>> said_of_walls("boundaries:\\n  floor:  # below 3\\n    x: 1\\n", {"floor": ("below 3", "below 4")})
    'boundaries:\\n  floor:  # below 4\\n    x: 1\\n'
    """
    head, key, walls = text.partition("\nboundaries:") if "\nboundaries:" in text else ("", "", text)
    for name, (before, now) in remarks.items():
        old = rf"  # {re.escape(before)}" if before else ""
        said = f"  # {' '.join(now.split())}" if now else ""
        found = re.search(rf"(?m)^  {re.escape(name)}:(?P<old>{old})$", walls)
        if found is not None:
            walls = walls[: found.start("old")] + said + walls[found.end("old") :]
    return head + key + walls


def forgotten(text: str, paths: Sequence[Sequence[str | int]]) -> str:
    """The text without what perception said of numbers that a person has set now; other remarks stay.

    >>> forgotten("world:\\n  # 1 px = 1 cm, as\\n  pixels_per_meter: 9\\n", [["world", "pixels_per_meter"]])
    'world:\\n  pixels_per_meter: 9\\n'
    """
    for path in paths:
        for k, key in enumerate(path):
            if isinstance(key, str) and key in GUESSED and (k != 1 or path[0] == "world"):
                text = _without(text, path[: k + 1], GUESSED[key])
    return text


def _behind(starts: tuple[str, ...]) -> str:
    """A comment at the end of a line that begins in one of these ways."""
    return rf"\s+#\s+(?:{'|'.join(map(re.escape, starts))}).*$"


def _without(text: str, path: Sequence[str | int], starts: tuple[str, ...]) -> str:
    """Without the comment behind, or right above, the key at a path, where it begins in one of these ways."""
    try:
        node: Marked | None = marked(text)
    except EditError:
        return text
    for key in path[:-1]:
        node = None if node is None else node.child(key)
    begin = None if node is None else next((at for name, at, _ in node.keys if name == path[-1]), None)
    if begin is None:
        return text
    lines, number = text.split("\n"), text.count("\n", 0, begin)
    if lines[number][: begin - text.rfind("\n", 0, begin) - 1].strip():
        return text  # on a line with others
    behind = re.search(_behind(starts), lines[number])
    if behind is not None:
        lines[number] = lines[number][: behind.start()]
        return "\n".join(lines)
    first = number
    while first and lines[first - 1].lstrip().startswith("#"):
        first -= 1
    for k in range(first, number):
        if lines[k].lstrip(" #").startswith(starts):
            return "\n".join(lines[:k] + lines[number:])
    return text


def _line(scene: Scene, file: str, path: str) -> int:
    """Where a number stands, counted from 1; 0 where it is not in this file."""
    place = scene.places.get(path)
    return place.line if place is not None and place.file == file else 0


# ----------------------------------------------------------------------
# A file's text and one change of its data -> the text with that change, in which all other lines are as they
# were.
#
# Places come from the parser; what is new is written as `scene_text` writes scenes. After each change the
# text is read
# back: one that does not hold what was meant is never given out.

_LEFT = re.compile(r"\s*,\s*(#.*)?").fullmatch
MANY = 40
"""Items of a list that are changed one by one; beyond, the list is written anew."""


def put(text: str, path: KeyPath, value: Any) -> str:
    """The value at a path, which is there or can be made. Raises EditError."""
    node = marked(text)
    for depth, key in enumerate(path):
        if node.place(key) is None:
            return _made(text, path, depth, value)
        node = node.children[node.place(key) or 0]
    return text if same(node.data(), value) else _replaced(text, path, value)


def drop(text: str, path: KeyPath) -> str:
    """Without the key or the item at a path, which is there. Raises EditError."""
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
        if stop == len(text) and not BREAK.search(
            text[-1:]
        ):  # the last line has no end: nor has the new last one
            first = line_before(text, first)
        patch = (first, stop, "")
    return checked(text, [patch], lambda data: take(data, path))


def _cut(text: str, parent: Marked, at: int, begin: int) -> Patch:
    """What goes of brackets with one entry of several, and of what is said behind others nothing."""
    child = parent.children[at]
    if at and leads(text, begin):  # the comma before it may stay: YAML lets one stand at the end
        if _LEFT(text[child.end : line_end(text, child.end)]):
            return line_begin(text, begin), line_after(text, child.end), ""
        if at + 1 == len(parent.children):
            return begin, child.end, ""
    elif at:
        return parent.children[at - 1].end, child.end, ""
    return begin, entry(text, parent, at + 1), ""


def append(text: str, path: KeyPath, value: Any) -> str:
    """The value at the end of the list at a path. Raises EditError."""
    node = find(text, path)
    return insert(text, (*path, len(node.children)), value)


def insert(text: str, path: KeyPath, value: Any) -> str:
    """The value as an item of a list, before the one that is there. Raises EditError."""
    where, at = path[:-1], path[-1]
    node = find(text, where)
    assert isinstance(at, int)
    if not node.children:
        return _replaced(text, where, [value])
    return checked(
        text, [_item(text, node, where, at, value)], lambda data: reach(data, where).insert(at, value)
    )


def rename(text: str, path: KeyPath, to: str) -> str:
    """Another name for a key. Raises EditError."""
    parent, at = parent_of(text, path)
    _, begin, end = parent.keys[at]

    def meant(data: Any) -> None:
        above = reach(data, path[:-1])
        pairs = [(to if key == path[-1] else key, value) for key, value in above.items()]
        above.clear()
        above.update(pairs)

    return checked(text, [(begin, end, key_text(to))], meant)


# Making and replacing


def _made(text: str, path: KeyPath, depth: int, value: Any) -> str:
    """A key that is not there, and the mappings that lead to it."""
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
    """Which of the keys a new one comes after: that before it in the schema's order, else the last."""
    order = list((schema_at(path) or {}).get("properties", {}))
    if key not in order:
        return len(node.keys) - 1
    known = order[: order.index(key)]
    places = [at for at, (name, _, _) in enumerate(node.keys) if name in known]
    return max(places, default=len(node.keys) - 1)


def _replaced(text: str, path: KeyPath, value: Any) -> str:
    """Another value where one is; of a collection only what differs."""
    node = find(text, path)
    if node.is_map and isinstance(value, dict) and value and node.children:
        keys = {key for key, _, _ in node.keys}
        if not node.is_flow or (keys != value.keys() and keys & value.keys()):
            return _entries(text, path, node, value)
    elif node.is_list and isinstance(value, list) and value and node.children:
        steps = _steps(node.data(), value)
        if (not node.is_flow or len(value) != len(node.children)) and _count(steps) <= MANY:
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
    """Patches inside of brackets that make a value another; None where it is of another shape as a whole."""
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
    """Another value in brackets."""
    gap = " " if node.begin == node.end else ""
    return node.begin, node.end, gap + flow_text(value, path)


def _rewritten(text: str, path: KeyPath, value: Any) -> list[Patch]:
    """Patches that write the value of a key or of an item anew; what is said at the line's end stays."""
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
    """A collection that loses the last of what it holds."""
    node = find(text, path)
    empty: Any = {} if node.is_map else []
    if not path:
        return checked(text, [(node.begin, node.end, "{}")], lambda data: empty)

    def meant(data: Any) -> None:
        reach(data, path[:-1])[path[-1]] = empty

    return checked(text, _rewritten(text, path, empty), meant)


def _item(text: str, node: Marked, path: KeyPath, at: int, value: Any) -> Patch:
    """A new item of a list that has some."""
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
