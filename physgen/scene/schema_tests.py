"""Tests of values against parts of the schema: a quick one, and jsonschema's with its
errors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

from physgen.scene.schema import (
    Schema,
    bounds,
    find_schema_part,
)

if TYPE_CHECKING:
    from jsonschema import ValidationError
    from jsonschema.protocols import Validator


def _part(schema_path: str, shallow: bool) -> Schema:
    """Return the part of the schema at a path. `shallow` leaves out the schemas of a
    mapping's values.
    """
    schema = find_schema_part(schema_path)
    if shallow:
        schema = {
            **schema,
            "properties": {key: {} for key in schema.get("properties", {})},
        }
        if isinstance(schema.get("additionalProperties"), dict):
            schema["additionalProperties"] = {}
    return schema


@cache
def schema_validator(schema_path: str, shallow: bool) -> Validator:
    """Return jsonschema's validator of a part of the schema, quick for lists of numbers
    and points.
    """
    # An import takes a fifth of the time of `check`, and most files do not need it.
    import jsonschema

    checks = {
        "items": _items,
        "pattern": _pattern_check(jsonschema.ValidationError),
    }
    validator_class: Any = jsonschema.validators.extend(
        jsonschema.Draft202012Validator, checks
    )  # type: ignore[no-untyped-call]
    validator: Validator = validator_class(_part(schema_path, shallow))
    return validator


def _items(
    validator: Any, part: Schema, instance: Any, schema: Schema
) -> Iterator[ValidationError]:
    """Yield the errors of the keyword `items`. Most of a file are valid numbers and
    points, which pass without a call of jsonschema.
    """
    if isinstance(instance, list):
        # A call of jsonschema per number is slow, and outlines have thousands of them.
        accepts = _quick_test(part)
        for index, item in enumerate(instance):
            if not accepts(item):
                yield from validator.descend(item, part, path=index)


def _pattern_check(error_class: type[ValidationError]) -> Any:
    """Return jsonschema's check of the keyword `pattern`. In JSON Schema, $ is the very
    end, not before a last line break.
    """

    def check(
        validator: Any, pattern: str, instance: Any, schema: Schema
    ) -> Iterator[ValidationError]:
        if isinstance(instance, str) and not _compile_pattern(pattern).search(instance):
            yield error_class(f"{instance!r} does not match {pattern!r}")

    return check


@cache
def _compile_pattern(pattern: str) -> re.Pattern[str]:
    return re.compile(re.sub(r"\$$", r"\\Z", pattern))


Test = Callable[[Any], bool]


@cache
def quick_check(schema_path: str, shallow: bool) -> Test:
    """Return the quick test of a part of the schema.

    An accepted part needs no jsonschema: its import alone takes a fifth of the time of
    `physgen check`.
    """
    return _quick_test(_part(schema_path, shallow))


def _quick_test(schema: Schema) -> Test:
    """Return a test that accepts only valid values. If it fails, jsonschema decides."""
    kinds = schema.get("type")
    if isinstance(kinds, list):
        return _quick_choice(schema, kinds)
    if "enum" in schema or "const" in schema:
        choices = schema.get("enum", [schema.get("const")])
        # In Python, 1 == True: the types must agree too.
        return lambda value: type(value) is type(choices[0]) and value in choices
    make_test = _TESTS.get(str(kinds))
    if make_test is None:
        return lambda value: True
    return make_test(schema)


def _quick_boolean(schema: Schema) -> Test:
    return lambda value: isinstance(value, bool)


def _quick_number(schema: Schema) -> Test:
    lowest, greatest, is_open = bounds(schema)
    types: tuple[type, ...] = (int, float)
    if schema["type"] == "integer":
        types = (int,)
    return lambda value: (
        type(value) in types
        and lowest <= value <= greatest
        and not (is_open and value == lowest)
    )


def _quick_text(schema: Schema) -> Test:
    shortest = schema.get("minLength", 0)
    longest = schema.get("maxLength", math.inf)
    search = _compile_pattern(schema.get("pattern", "")).search
    return lambda value: (
        isinstance(value, str)
        and shortest <= len(value) <= longest
        and bool(search(value))
    )


_TESTS: dict[str, Callable[[Schema], Test]] = {
    "boolean": _quick_boolean,
    "number": _quick_number,
    "integer": _quick_number,
    "string": _quick_text,
    "array": lambda schema: _quick_list(schema),
    "object": lambda schema: _quick_mapping(schema),
}
"""Maker of the test of each type."""


def _quick_choice(schema: Schema, kinds: list[str]) -> Test:
    """Return a test of a value with several possible types."""
    types = {
        "object": dict,
        "array": list,
        "string": str,
        "integer": int,
        "boolean": bool,
    }
    tests = {types[kind]: _quick_test({**schema, "type": kind}) for kind in kinds}
    if "then" in schema:
        tests[str] = _quick_test(schema["then"])
    return lambda value: type(value) in tests and tests[type(value)](value)


def _quick_list(schema: Schema) -> Test:
    # A list has either items of one kind, or a fixed sequence of kinds.
    prefix = list(map(_quick_test, schema.get("prefixItems", [])))
    if "items" in schema:
        item_test = _quick_test(schema["items"])
    else:
        item_test = None
    shortest = schema.get("minItems", 0)
    longest = schema.get("maxItems", math.inf)
    if item_test is not None:
        return lambda value: (
            type(value) is list
            and shortest <= len(value) <= longest
            and all(map(item_test, value))
        )
    # A list may be shorter than the sequence: its length has its own limits.
    return lambda value: (
        type(value) is list
        and shortest <= len(value) <= longest
        and all(test(item) for test, item in zip(prefix, value, strict=False))
    )


def _refuse(value: Any) -> bool:
    return False


def _quick_mapping(schema: Schema) -> Test:
    # Tests are built once, since a scene is validated on every edit.
    tests = {}
    for key, part in schema.get("properties", {}).items():
        tests[key] = _quick_test(part)
    rest = schema.get("additionalProperties", {})
    other: Test = _refuse
    if isinstance(rest, dict):
        other = _quick_test(rest)
    is_name = _quick_test(schema.get("propertyNames", {}))
    required_keys = schema.get("required", [])
    smallest = schema.get("minProperties", 0)
    largest = schema.get("maxProperties", math.inf)
    return lambda value: (
        isinstance(value, dict)
        and smallest <= len(value) <= largest
        and all(key in value for key in required_keys)
        and all(
            is_name(key) and tests.get(key, other)(item) for key, item in value.items()
        )
    )
