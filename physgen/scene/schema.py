"""The JSON Schema of scene files, its defaults, and the advice for messages."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from physgen.files import resource
from physgen.text import UNITS, KeyPath, example, listed, number

Schema = dict[str, Any]


@cache
def load_published_schema() -> Schema:
    """Return the published schema."""
    schema: Schema = json.loads(
        resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8")
    )
    return schema


@cache
def load_expanded_schema() -> Schema:
    """Return the schema without $ref. Keys beside a $ref (unit, default) win over those
    of its target.

    The result is cached and shared: never change it.
    """
    return expand(load_published_schema())


def expand(root: Schema) -> Schema:
    """Return a schema without $ref."""
    root_part = {}
    for key, value in root.items():
        if key != "$defs":
            root_part[key] = value
    expanded_schema = _expand(root_part, root["$defs"])
    assert isinstance(expanded_schema, dict)
    return expanded_schema


def _expand(part: Any, defs: Schema) -> Any:
    if isinstance(part, list):
        return [_expand(item, defs) for item in part]
    if not isinstance(part, dict):
        return part
    own_keys = {}
    for key, value in part.items():
        if key != "$ref":
            own_keys[key] = _expand(value, defs)
    if (
        part.get("type") in (["number", "string"], ["array", "number", "string"])
        and "if" not in part
    ):
        # Texts with units are numbers before the check by the schema.
        own_keys["type"] = part["type"][0]
        own_keys.pop("pattern", None)
        # One number for a vector is a list before the check.
        if own_keys["type"] == "array":
            own_keys.pop("minimum", None)
            own_keys.pop("maximum", None)
    if "$ref" not in part:
        return own_keys
    target = _expand(defs[part["$ref"].removeprefix("#/$defs/")], defs)
    return {**target, **own_keys}


def find_schema_part(path: str) -> Schema:
    """Return the part of the schema at a dotted path, with `*` for a name:
    `objects.*.mass`.
    """
    part = load_expanded_schema()
    for key in path.split(".") if path else ():
        if key == "*":
            part = part["additionalProperties"]
        else:
            part = part["properties"][key]
    return part


def inner(schema: Schema | None, key: str | int) -> Schema | None:
    """Return the schema of a key's value or of a list's item, or None."""
    if schema is None:
        return None
    if isinstance(key, int):
        prefix = schema.get("prefixItems", [])
        if key < len(prefix):
            part = prefix[key]
        else:
            part = schema.get("items")
    else:
        part = schema.get("properties", {}).get(key, schema.get("additionalProperties"))
    if isinstance(part, dict):
        return part
    return None


def schema_at(path: KeyPath) -> Schema | None:
    """Return the schema of the value at a path of a scene, or None."""
    part: Schema | None = load_expanded_schema()
    for key in path:
        part = inner(part, key)
    return part


@cache
def parents() -> Mapping[str, tuple[str, ...]]:
    """Return the dotted paths of mappings with a key, by key of the schema.

    >>> parents()["gravity"], parents()["impulse"]
    (('world',), ('forces[]',))
    """
    index: dict[str, list[str]] = {}
    _index_keys(load_expanded_schema(), "", index)
    return {key: tuple(dict.fromkeys(paths)) for key, paths in index.items()}


def _index_keys(schema: Schema, path: str, index: dict[str, list[str]]) -> None:
    """Add the keys of a part of the schema at `path`, and those below it."""
    prefix = ""
    if path:
        prefix = f"{path}."
    for key, part in schema.get("properties", {}).items():
        index.setdefault(key, []).append(path)
        _index_keys(part, f"{prefix}{key}", index)
    entry = schema.get("additionalProperties")
    if isinstance(entry, dict):
        _index_keys(entry, f"{prefix}NAME", index)
    item = schema.get("items")
    if isinstance(item, dict):
        _index_keys(item, f"{path}[]", index)


def with_defaults(data: Any, schema: Schema | None = None) -> Any:
    """Return a copy of plain data with all default values, in the schema's order.

    >>> with_defaults({"physgen": 1, "objects": {"a": {"mask": 1}}})["objects"]["a"]["friction"]
    0.5
    """
    if schema is None:
        schema = load_expanded_schema()
    if isinstance(data, list):
        items = schema.get("items")
        if not isinstance(items, dict) or items.get("type") != "object":
            return data
        return [with_defaults(item, items) for item in data]
    if isinstance(data, Mapping):
        return _mapping_with_defaults(data, schema)
    return data


def _mapping_with_defaults(data: Mapping[str, Any], schema: Schema) -> dict[str, Any]:
    properties = schema.get("properties", {})
    values: dict[str, Any] = {}
    for key, part in properties.items():
        if key in data:
            values[key] = with_defaults(data[key], part)
        elif "default" in part:
            # A copy: callers may change the result, and the schema is shared.
            values[key] = with_defaults(copy.copy(part["default"]), part)
    rest = schema.get("additionalProperties")
    for key, value in data.items():
        if key in properties:
            continue
        values[key] = value
        if isinstance(rest, dict):
            values[key] = with_defaults(value, rest)
    return values


def bounds(schema: Schema) -> tuple[float, float, bool]:
    """Return the smallest and largest value, and whether the smallest itself is
    excluded.
    """
    open_ = "exclusiveMinimum" in schema
    if open_:
        lowest = schema["exclusiveMinimum"]
    else:
        lowest = schema["minimum"]
    return lowest, schema["maximum"], open_


def limit(value: float) -> str:
    """Return a bound in a person's form.

    >>> [limit(v) for v in (10, 0.01, 1.0e6, 1.0e15)]
    ['10', '0.01', '1000000', '1.0e15']
    """
    if value == int(value) and abs(value) < 1e9:
        return str(int(value))
    return number(value)


def measure(schema: Schema, unit: str, has_range: bool) -> str:
    """Return the form of a number: `grams above 0`, `a number from 0 to 10`; only the
    unit if not `has_range`.
    """
    lowest, greatest, open_ = bounds(schema)
    kind = "a number"
    if schema["type"] == "integer":
        kind = "a whole number"
    if unit:
        kind = UNITS.get(unit, unit)
        if not has_range:
            return kind
    # Bounds against overflow are no help for a user.
    huge = greatest >= 1e9
    if open_:
        return f"{kind} above {limit(lowest)}" + (
            "" if huge else f", at most {limit(greatest)}"
        )
    if huge:
        if lowest <= -1e9:
            return kind
        return f"{kind} of at least {limit(lowest)}"
    return f"{kind} from {limit(lowest)} to {limit(greatest)}"


def advice(schema: Schema) -> str:
    """Return the fix for a missing or wrong part of the schema."""
    if "enum" in schema or "const" in schema:
        return (
            f"write {listed(map(example, schema.get('enum', [schema.get('const')])))}"
        )
    hint = ""
    if "examples" in schema:
        hint = f", e.g. {example(schema['examples'][0])}"
    kind = schema["type"]
    unit = schema.get("x-unit", "")
    if kind in ("number", "integer"):
        return f"write {measure(schema, unit, has_range=False)}{hint}"
    if kind == "array":
        return f"write a list{f' in {UNITS.get(unit, unit)}' if unit else ''}{hint}"
    if "pattern" in schema:
        what = "a name"
    else:
        what = "a mapping"
        if kind == "string":
            what = "text"
    return f"write {what}{hint}"
