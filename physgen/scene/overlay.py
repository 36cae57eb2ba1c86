"""Trees -> one tree: what a file inherits (deep merge), and edits by dotted key (variants and `--set`).

The order is extends < file < variant < --set. Trees are never changed: each step shares what it leaves alone,
so a Node that was checked once needs no second check.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache

from physgen.problems import InputError, Problem
from physgen.scene.document import Node, Source, children, items, read
from physgen.scene.schema import schema_at
from physgen.text import KeyPath, dotted, nearest, quoted

SEALED = ("extends", "variants")
"""Keys that no edit may touch: they are done with before edits apply."""

NAMED = ("objects", "boundaries", "joints", "fields", "variants")
"""Sections whose keys are names that the file's author chose."""

_PART = re.compile(r"([^.\[\]]+)((?:\[(?:\d{1,9}|\*)\])*)(?:\.|$)")


@cache
def rivals(schema_path: KeyPath) -> Mapping[str, frozenset[str]]:
    """Key -> keys of the same mapping that it rules out: mass and density, kinds of shape, mask and wall."""
    part = schema_at(schema_path)
    if part is None:
        return {}
    groups = [list(group) for group in part.get("x-exclusive", [])]
    if part.get("maxProperties") == 1:
        groups.append(list(part["properties"]))
    return {key: frozenset(group) - {key} for group in groups for key in group}


def kind_of(path: KeyPath) -> KeyPath:
    """The path with names of objects, boundaries and the like made one, so that `rivals` is asked for few."""
    return tuple(
        0 if isinstance(key, int) else "*" if n == 1 and path[0] in NAMED else key
        for n, key in enumerate(path)
    )


def merge(base: Node, over: Node, path: KeyPath = ()) -> Node:
    """`over` on top of `base`: mappings merge, anything else replaces, null takes an inherited key away.

    A key of `over` drops the inherited keys that it rules out.
    """
    if not isinstance(base.value, dict) or not isinstance(over.value, dict):
        return over
    merged = dict(base.value)
    against = rivals(kind_of(path))
    for key in over.value:
        for rival in against.get(key, ()):
            if rival not in over.value:
                merged.pop(rival, None)
    for key, child in over.value.items():
        if key not in merged:
            merged[key] = child
        elif child.value is None:
            del merged[key]
        else:
            merged[key] = merge(merged[key], child, (*path, key))
    return over.with_value(merged)


def parse_key(text: str) -> KeyPath | None:
    """`objects.*.mass` or `forces[0].impulse[1]` -> its parts, None when it is not a dotted key.

    >>> parse_key("forces[0].impulse[*]")
    ('forces', 0, 'impulse', '[*]')
    """
    parts: list[str | int] = []
    at = 0
    while at < len(text):
        match = _PART.match(text, at)
        if not match or len(parts) > 60:
            return None
        parts.append(match[1])
        for index in re.findall(r"\[([^\]]+)\]", match[2]):
            parts.append("[*]" if index == "*" else int(index))
        at = match.end()
    return tuple(parts) if parts and not text.endswith(".") else None


class Edit:
    """One dotted key and the value that it sets; `key_node` is where messages about the key point."""

    def __init__(self, key: str, value: Node, path: KeyPath) -> None:
        self.key, self.value, self.path = key, value, path

    @property
    def variant(self) -> str:
        """Return the name of the variant that the edit belongs to, or nothing."""
        return str(self.path[1]) if self.path else ""

    def problem(self, expected: str, fix: str) -> InputError:
        """Why the edit cannot be made."""
        path = self.key if self.variant else ""
        place = self.value.key_place
        problem = Problem(place, path, "", expected, fix, variant=self.variant)
        return InputError([problem])


def edits_of_variant(variant: Node, name: str) -> list[Edit]:
    """The edits of one entry of `variants`."""
    assert isinstance(variant.value, dict)
    return [
        Edit(key, child, ("variants", name)) for key, child in variant.value.items()
    ]


def edit_of_flag(text: str, folder: Source) -> Edit:
    """`KEY=VALUE` of one `--set` -> its edit; an empty VALUE is null and takes the key away."""
    source = Source(quoted(f"--set {text}", "", 80), folder.folder)
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        expected = "has no key" if equals else "has no ="
        raise InputError.of(
            source.name,
            "",
            expected,
            "write --set KEY=VALUE, e.g. --set objects.ball.mass=200",
        )
    return Edit(key.strip(), read(value, source, counted=False), ())


def apply(root: Node, edit: Edit) -> Node:
    """The tree with the value at the edit's key set; parents that are missing are made.

    Raises InputError with one problem when the key is wrong.
    """
    path = parse_key(edit.key)
    if path is None:
        raise edit.problem(
            f"{quoted(edit.key)} is not a dotted key",
            "write keys joined by dots, e.g. objects.ball.mass",
        )
    if path[0] in SEALED:
        raise edit.problem(f"{path[0]} cannot be set", "write it in the scene file")
    if path[0] in children(root, "objects") and schema_at(path[:1]) is None:
        raise edit.problem(
            f"{quoted(str(path[0]))} is not a key of the scene",
            f'did you mean "objects.{edit.key}"?',
        )
    return _set(root, path, 0, edit, star=False, at=())


def _set(
    node: Node | None, path: KeyPath, depth: int, edit: Edit, star: bool, at: KeyPath
) -> Node:
    """The node with path[depth:] set to the edit's value. `at` is where we are in the scene."""
    if depth == len(path):
        return edit.value
    step = path[depth]
    no_mapping = node is None or isinstance(node.value, list)
    if no_mapping and isinstance(step, str) and step.isdecimal():
        step = int(step[:9])  # pivot.0 says the same as pivot[0]
        path = (*path[:depth], step, *path[depth + 1 :])
    if isinstance(step, int) or step == "[*]":
        default = (schema_at(kind_of(at)) or {}).get("default")
        if (
            node is None and isinstance(default, list) and default
        ):  # so that velocity.0 alone can be set
            node = edit.value.with_value(
                [edit.value.with_value(item) for item in default]
            )
        return _set_item(node, path, depth, edit, star, at)
    changed = dict(children(node))
    if step == "*":
        if node is None or not isinstance(node.value, dict):
            raise edit.problem(
                f"{dotted(at) or 'the scene'} has no keys for * to stand for",
                "name a key that is there",
            )
        for key in children(node):
            _put(changed, key, path, depth, edit, True, at)
    else:
        _put(changed, step, path, depth, edit, star, at)
    where = node if node is not None and isinstance(node.value, dict) else edit.value
    return Node(changed, where.source, where.line, where.column, where.key)


def _put(
    changed: dict[str, Node],
    key: str,
    path: KeyPath,
    depth: int,
    edit: Edit,
    star: bool,
    at: KeyPath,
) -> None:
    """Sets or removes one key of a mapping that is being made."""
    last = depth + 1 == len(path)
    if last and edit.value.value is None:
        if key in changed:
            del changed[key]
        elif not star:
            known = nearest(key, changed)
            fix = f'did you mean "{known}"?' if known else "leave it out"
            raise edit.problem(f"{dotted((*at, key))} is not there to take away", fix)
        return
    may_begin = not last and path[depth + 1] in (
        "shape",
        "mask",
    )  # objects.new.shape makes one
    if at == ("objects",) and not last and key not in changed and not may_begin:
        known = nearest(key, changed)
        names = ", ".join(list(changed)[:8]) + (", ..." if len(changed) > 8 else "")
        fix = (
            f'did you mean "{known}"?'
            if known
            else f"the objects are {names}"
            if names
            else "there are none"
        )
        raise edit.problem(f"no object is called {quoted(key)}", fix)
    child = _set(changed.get(key), path, depth + 1, edit, star, (*at, key))
    for rival in rivals(kind_of(at)).get(key, ()):
        changed.pop(rival, None)
    changed[key] = child


def _set_item(
    node: Node | None, path: KeyPath, depth: int, edit: Edit, star: bool, at: KeyPath
) -> Node:
    step = path[depth]
    if node is None or not isinstance(node.value, list):
        whole = edit.key.partition("[")[0] if "[" in edit.key else dotted(at)
        raise edit.problem(
            f"{dotted(at)} is not a list", f"write {whole}=[...] to set all of it"
        )
    changed = list(node.value)
    if isinstance(step, int) and step >= len(changed):
        raise edit.problem(
            f"{dotted(at)} has {len(changed)} item{'' if len(changed) == 1 else 's'}",
            "count from 0",
        )
    for index in range(len(changed)) if step == "[*]" else [int(step)]:
        changed[index] = _set(changed[index], path, depth + 1, edit, star, (*at, index))
    return node.with_value(changed)


def targets(root: Node, edit: Edit) -> int:
    """Number of places at which an edit sets its value; a place that is made counts as one."""
    found: list[Node | None] = [root]
    for step in parse_key(edit.key) or ():
        if step in ("*", "[*]"):
            found = [
                child
                for node in found
                for child in (*children(node).values(), *items(node))
            ]
        elif isinstance(step, str):
            found = [children(node).get(step) for node in found]
        else:
            found = [dict(enumerate(items(node))).get(step) for node in found]
    return len(found)


def variants_of(root: Node) -> Iterator[tuple[str, Node]]:
    """Name and mapping of every variant that is one."""
    entries = root.value.get("variants") if isinstance(root.value, dict) else None
    if entries is not None and isinstance(entries.value, dict):
        for name, variant in entries.value.items():
            if isinstance(variant.value, dict):
                yield name, variant
