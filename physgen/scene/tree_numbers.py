"""Convert the quantities of a scene's tree to numbers in px, s, g and degrees."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from physgen.scene.document import (
    Node,
    children,
)
from physgen.scene.schema import (
    Schema,
    find_schema_part,
    inner,
    load_expanded_schema,
)
from physgen.text import KeyPath, quantity

ONE_FOR_TWO = ("gravity", "velocity", "force", "impulse", "wind")
"""Vectors that a single number with its unit can replace."""

LARGEST_SCALE = 1e6
"""Maximum scale of the schema, px/m."""

LONGEST = 10.0
"""Maximum duration of a clip that ends at rest, s."""


class OpenDuration(float):
    """The number for `auto`."""


def in_numbers(root: Node) -> Node:
    """Return the tree with numbers in place of texts with fitting units.

    The schema reports the other texts. A single number for a vector, with or without a
    unit, points to the right; for gravity, it points down.
    """
    return _NumberTree(_scale(root)).convert(root, load_expanded_schema(), (), "")


def _scale(root: Node) -> float:
    """Return the scale of the file, px/m, or the default without a valid one."""
    # A wrong scale is reported by the schema; conversions continue with the default.
    default = float(find_schema_part("world.pixels_per_meter")["default"])
    node = children(root, "world").get("pixels_per_meter")
    if node is None:
        return default
    value: object = node.value
    if isinstance(value, str):
        value = quantity(value, "px/m", 1.0)
    if isinstance(value, int | float) and 0 < value <= LARGEST_SCALE:
        return value
    return default


@dataclass(frozen=True)
class _NumberTree:
    """Conversion of the texts with units in a tree."""

    scale: float
    """px/m."""

    def convert(self, node: Node, part: Schema, path: KeyPath, unit: str) -> Node:
        """Return the node in numbers; `part` is the schema of the node."""
        value = node.value
        if isinstance(value, str):
            return self._text(node, part, path, unit)
        if isinstance(value, int | float):
            is_vector = part.get("type") == "array" and not isinstance(value, bool)
            if is_vector:
                return _vector(node, value, path[-1])
            return node
        if isinstance(value, dict):
            changes = self._children(value.items(), part, path, unit)
            if changes:
                return node.with_value({**value, **changes})
            return node
        # Lists of names have no numbers.
        if isinstance(value, list) and not _has_names(part):
            changes = self._children(enumerate(value), part, path, unit)
            if changes:
                children = [changes.get(n, child) for n, child in enumerate(value)]
                return node.with_value(children)
        return node

    def _text(self, node: Node, part: Schema, path: KeyPath, unit: str) -> Node:
        """Return the number or vector of a text, or the node itself."""
        text = str(node.value)
        if path == ("world", "duration") and text.strip() == "auto":
            return node.with_value(OpenDuration(LONGEST))
        if unit:
            number = quantity(text, unit, self.scale)
        else:
            number = None
        if number is None or part.get("type") not in ("number", "array"):
            return node
        if part["type"] == "number":
            return node.with_value(number, text=text)
        return _vector(node, number, path[-1], text)

    def _children(
        self,
        children: Iterable[tuple[Any, Node]],
        part: Schema,
        path: KeyPath,
        unit: str,
    ) -> dict[Any, Node]:
        """Return the changed children after conversion, by key or index."""
        changes: dict[Any, Node] = {}
        for key, child in children:
            # Single numbers need no conversion, except for numbers in place of vectors.
            if key not in ONE_FOR_TWO and not isinstance(
                child.value, str | list | dict
            ):
                continue
            schema = inner(part, key)
            if schema is None:
                continue
            # The items of a list have the unit of the list.
            inherited_unit = ""
            if isinstance(key, int):
                inherited_unit = unit
            unit_of_child = schema.get("x-unit", inherited_unit)
            converted = self.convert(child, schema, (*path, key), unit_of_child)
            if converted is not child:
                changes[key] = converted
        return changes


def _has_names(part: Schema) -> bool:
    """Return whether a schema describes a list of names."""
    return bool(part.get("items", {}).get("type") == "string")


def _vector(node: Node, length: float, key: str | int, text: str | None = None) -> Node:
    """Return the vector of a single number, or the node itself for other keys."""
    if key not in ONE_FOR_TWO:
        return node
    if key == "gravity":
        ends = (0.0, length)
    else:
        ends = (length, 0.0)
    return node.with_value([node.with_value(end, text=text) for end in ends])
