"""Combine trees: inheritance (deep merge), and edits by dotted key (variants and
`--set`).

The order is extends < file < variant < --set. Trees are never changed: each step shares
unchanged nodes, so that a checked Node needs no second check.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

from physgen.messages import Message, did_you_mean
from physgen.problems import InputError, RefusedError
from physgen.scene.document import Node, Source, children, items, read
from physgen.scene.schema import schema_at
from physgen.text import KeyPath, counted, dotted, nearest, quoted

SEALED = ("extends", "variants")
"""Keys forbidden in edits: they are resolved before edits apply."""

NAMED = ("objects", "boundaries", "joints", "fields", "variants")
"""Sections with names as keys."""

_PART = re.compile(r"([^.\[\]]+)((?:\[(?:\d{1,9}|\*)\])*)(?:\.|$)")


@cache
def rivals(schema_path: KeyPath) -> Mapping[str, frozenset[str]]:
    """Return excluded keys of the same mapping by key: mass and density, kinds of
    shape, mask and wall.
    """
    part = schema_at(schema_path)
    if part is None:
        return {}
    groups = list(map(list, part.get("x-exclusive", [])))
    # Kinds of shapes, masks and profiles exclude each other.
    if part.get("maxProperties") == 1:
        groups.append(list(part["properties"]))
    return {key: frozenset(group) - {key} for group in groups for key in group}


def kind_of(path: KeyPath) -> KeyPath:
    """Return the path with one common name for objects, boundaries and so on, so that
    the cache of `rivals` stays small.
    """
    return tuple(
        0 if isinstance(key, int) else "*" if n == 1 and path[0] in NAMED else key
        for n, key in enumerate(path)
    )


def merge(base: Node, extension: Node, path: KeyPath = ()) -> Node:
    """Merge `extension` into `base`: mappings merge, other values replace, null removes an
    inherited key.

    A key of `extension` drops the inherited keys that it excludes.
    """
    if not isinstance(base.value, dict) or not isinstance(extension.value, dict):
        return extension
    children_by_key = dict(base.value)
    rival_keys = rivals(kind_of(path))
    for key in extension.value:
        for rival in rival_keys.get(key, ()):
            # A file with both keys has a fault, which the rules report.
            if rival not in extension.value:
                children_by_key.pop(rival, None)
    for key, child in extension.value.items():
        if key not in children_by_key:
            children_by_key[key] = child
        elif child.value is None:
            del children_by_key[key]
        else:
            children_by_key[key] = merge(children_by_key[key], child, (*path, key))
    return extension.with_value(children_by_key)


def parse_key(text: str) -> KeyPath | None:
    """Return the parts of `objects.*.mass` or `forces[0].impulse[1]`, or None for
    another text.

    >>> parse_key("forces[0].impulse[*]")
    ('forces', 0, 'impulse', '[*]')
    """
    parts: list[str | int] = []
    position = 0
    while position < len(text):
        match = _PART.match(text, position)
        # A limit on the parts bounds the recursion of edits.
        if not match or len(parts) > 60:
            return None
        parts.append(match[1])
        for index in re.findall(r"\[([^\]]+)\]", match[2]):
            parts.append("[*]" if index == "*" else int(index))
        position = match.end()
    if parts and not text.endswith("."):
        return tuple(parts)
    return None


class Edit:
    """One dotted key and its new value."""

    def __init__(self, key: str, value: Node, path: KeyPath) -> None:
        self.key, self.value, self.path = key, value, path

    @property
    def variant(self) -> str:
        """Return the name of the edit's variant, or ""."""
        if self.path:
            return str(self.path[1])
        return ""

    def error(self, refusal: RefusedError) -> InputError:
        """Return the error of an impossible edit."""
        path = ""
        if self.variant:
            path = self.key
        problem = refusal.problem(self.value.key_place, path)
        return InputError([replace(problem, variant=self.variant)])


def edits_of_variant(variant: Node, name: str) -> list[Edit]:
    """Return the edits of one entry of `variants`."""
    assert isinstance(variant.value, dict)
    return [
        Edit(key, child, ("variants", name)) for key, child in variant.value.items()
    ]


def edit_of_flag(text: str, folder: Source) -> Edit:
    """Return the edit of `KEY=VALUE` of one `--set`. An empty VALUE is null and removes
    the key.
    """
    source = Source(quoted(f"--set {text}", "", 80), folder.folder)
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        part = "="
        if equals:
            part = "key"
        raise Message.SET_INCOMPLETE.error(source.name, part=part)
    return Edit(key.strip(), read(value, source, has_lines=False), ())


def apply(root: Node, edit: Edit) -> Node:
    """Return the tree with the new value at the edit's key. Missing parents are
    created.

    Raise InputError with one problem for a wrong key.
    """
    path = parse_key(edit.key)
    if path is None:
        raise edit.error(Message.NOT_DOTTED_KEY.refusal(key=quoted(edit.key)))
    if path[0] in SEALED:
        raise edit.error(Message.KEY_SEALED.refusal(key=path[0]))
    # `ball.mass` instead of `objects.ball.mass` is a common slip.
    if path[0] in children(root, "objects") and schema_at(path[:1]) is None:
        key = quoted(str(path[0]))
        raise edit.error(Message.KEY_OF_OBJECTS.refusal(key=key, rest=edit.key))
    return _set(root, path, 0, edit, star=False, place_path=())


def _set(
    node: Node | None,
    path: KeyPath,
    depth: int,
    edit: Edit,
    star: bool,
    place_path: KeyPath,
) -> Node:
    """Return the node with the edit's value at path[depth:]. `place_path` is the current path
    in the scene.
    """
    # Recursion along the path: every node on the way is copied with one child changed,
    # and all others are shared.
    if depth == len(path):
        return edit.value
    step = path[depth]
    has_no_keys = node is None or isinstance(node.value, list)
    if has_no_keys and isinstance(step, str) and step.isdecimal():
        # `pivot.0` means the same as `pivot[0]`.
        step = int(step[:9])
        path = (*path[:depth], step, *path[depth + 1 :])
    if isinstance(step, int) or step == "[*]":
        if node is None:
            node = _default_list(edit, place_path)
        return _set_item(node, path, depth, edit, star, place_path)
    new_children = dict(children(node))
    is_mapping = node is not None and isinstance(node.value, dict)
    if step == "*":
        if not is_mapping:
            owner = dotted(place_path) or "the scene"
            raise edit.error(Message.STAR_MATCHES_NOTHING.refusal(owner=owner))
        for key in children(node):
            _put(new_children, key, path, depth, edit, True, place_path)
    else:
        _put(new_children, step, path, depth, edit, star, place_path)
    if node is None or not is_mapping:
        # A new mapping has the place of the edit, for messages.
        node = edit.value
    return Node(new_children, node.source, node.line, node.column, node.key)


def _default_list(edit: Edit, place_path: KeyPath) -> Node | None:
    """Return the default of a list, or None.

    It makes single components of an absent list possible, as in `velocity.0`.
    """
    default = (schema_at(kind_of(place_path)) or {}).get("default")
    if not isinstance(default, list) or not default:
        return None
    return edit.value.with_value([edit.value.with_value(item) for item in default])


def _put(
    new_children: dict[str, Node],
    key: str,
    path: KeyPath,
    depth: int,
    edit: Edit,
    star: bool,
    place_path: KeyPath,
) -> None:
    """Set or remove one key of a new mapping."""
    is_last = depth + 1 == len(path)
    if is_last and edit.value.value is None:
        if key in new_children:
            del new_children[key]
        # With a star, some of the objects may lack the key.
        elif not star:
            raise _nothing_to_remove(new_children, key, edit, place_path)
        return
    # `objects.new.shape` starts a new object.
    is_start = not is_last and path[depth + 1] in ("shape", "mask")
    is_known = is_last or key in new_children
    if place_path == ("objects",) and not is_known and not is_start:
        fix = _name_advice(key, list(new_children))
        message = Message.NO_OBJECT_CALLED
        raise edit.error(message.refusal(name=quoted(key), fix=fix))
    child = _set(new_children.get(key), path, depth + 1, edit, star, (*place_path, key))
    # Setting `mass` removes `density`: the user wants the new value to count.
    for rival in rivals(kind_of(place_path)).get(key, ()):
        new_children.pop(rival, None)
    new_children[key] = child


def _nothing_to_remove(
    siblings: dict[str, Node], key: str, edit: Edit, place_path: KeyPath
) -> InputError:
    """Return the error of an edit that removes an unknown key."""
    similar_key = nearest(key, siblings)
    fix = "leave it out"
    if similar_key:
        fix = did_you_mean(similar_key)
    path_text = dotted((*place_path, key))
    return edit.error(Message.NOTHING_TO_REMOVE.refusal(path=path_text, fix=fix))


def _name_advice(name: str, object_names: Sequence[str]) -> str:
    """Return advice on the right name for an unknown object."""
    close = nearest(name, object_names)
    if close:
        return did_you_mean(close)
    if not object_names:
        return "the scene has no objects"
    names = ", ".join(object_names[:8])
    if len(object_names) > 8:
        return f"the objects are {names}, ..."
    return f"the objects are {names}"


def _set_item(
    node: Node | None,
    path: KeyPath,
    depth: int,
    edit: Edit,
    star: bool,
    place_path: KeyPath,
) -> Node:
    step = path[depth]
    if node is None or not isinstance(node.value, list):
        if "[" in edit.key:
            list_key = edit.key.partition("[")[0]
        else:
            list_key = dotted(place_path)
        raise edit.error(
            Message.NOT_A_LIST.refusal(path=dotted(place_path), whole=list_key)
        )
    new_items = list(node.value)
    if isinstance(step, int) and step >= len(new_items):
        count = counted(len(new_items), "item")
        raise edit.error(
            Message.INDEX_TOO_LARGE.refusal(path=dotted(place_path), items=count)
        )
    # The step [*] sets every item of the list.
    for index in range(len(new_items)) if step == "[*]" else [int(step)]:
        new_items[index] = _set(
            new_items[index], path, depth + 1, edit, star, (*place_path, index)
        )
    return node.with_value(new_items)


def targets(root: Node, edit: Edit) -> int:
    """Return the number of places of an edit. A new place counts as one."""
    nodes: list[Node | None] = [root]
    for step in parse_key(edit.key) or ():
        if step in ("*", "[*]"):
            nodes = [
                child
                for node in nodes
                for child in (*children(node).values(), *items(node))
            ]
        elif isinstance(step, str):
            nodes = [children(node).get(step) for node in nodes]
        else:
            nodes = [dict(enumerate(items(node))).get(step) for node in nodes]
    return len(nodes)


def variants_of(root: Node) -> Iterator[tuple[str, Node]]:
    """Yield the name and mapping of every variant."""
    if isinstance(root.value, dict):
        entries = root.value.get("variants")
    else:
        entries = None
    if entries is not None and isinstance(entries.value, dict):
        for name, variant in entries.value.items():
            if isinstance(variant.value, dict):
                yield name, variant
