"""Schema of numbers, points and outlines -> a test of one Node that says only yes or no.

They are most of a file; check.py asks why only where the answer is no.
"""

from __future__ import annotations

from collections.abc import Callable

from physgen.scene.advice import bounds
from physgen.scene.node import Node
from physgen.scene.schema import Schema

Quick = Callable[[Node], bool]


def quick_number(schema: Schema) -> Quick:
    """A test for a number in its range."""
    least, greatest, open_ = bounds(schema)
    whole = schema["type"] == "integer"

    def quick(node: Node) -> bool:
        value = node.value
        kind = type(value)
        if kind is float:
            if whole and not value.is_integer():  # type: ignore[union-attr]
                return False
        elif kind is not int:
            return False
        return least <= value <= greatest and not (open_ and value == least)  # type: ignore[operator]

    return quick


def quick_list(schema: Schema) -> Quick | None:
    """A test for lists of numbers and lists of those (points, outlines), most of a file; None for others."""
    prefix: list[Schema] = schema.get("prefixItems", [])
    items: Schema | None = schema.get("items")
    shortest, longest = schema.get("minItems", 0), schema.get("maxItems", 10**9)
    if prefix and all(part.get("type") == "number" for part in prefix) and shortest == longest == len(prefix):
        tests = [quick_number(part) for part in prefix]
        if len(tests) == 2:
            first, second = tests

            def pair(node: Node) -> bool:
                value = node.value
                return type(value) is list and len(value) == 2 and first(value[0]) and second(value[1])

            return pair
        return lambda node: (
            isinstance(node.value, list)
            and len(node.value) == len(tests)
            and all(test(item) for test, item in zip(tests, node.value, strict=True))
        )
    if items is None or prefix:
        return None
    each: Quick | None
    if items.get("type") in ("number", "integer"):
        each = quick_number(items)
    elif items.get("type") == "array":
        each = quick_list(items)
    else:
        return None
    if each is None:
        return None
    every = each
    return lambda node: (
        isinstance(node.value, list)
        and shortest <= len(node.value) <= longest
        and all(map(every, node.value))
    )
