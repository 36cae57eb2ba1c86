"""`schemas/scene-1.schema.json` -> the schema without $ref, and documents with their defaults filled in."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from functools import cache
from typing import Any

from physgen.resources import resource

Schema = dict[str, Any]


@cache
def published() -> Schema:
    """The schema as it is published."""
    loaded: Schema = json.loads(resource("schemas", "scene-1.schema.json").read_text(encoding="utf-8"))
    return loaded


@cache
def expanded() -> Schema:
    """The schema without $ref: what stands beside a $ref (unit, default) wins over what it points to.

    Shared and cached: read it, never change it.
    """
    root = published()
    written = {key: value for key, value in root.items() if key != "$defs"}
    whole = _expand(written, root["$defs"])
    assert isinstance(whole, dict)
    return whole


def _expand(part: Any, defs: Schema) -> Any:
    if isinstance(part, list):
        return [_expand(item, defs) for item in part]
    if not isinstance(part, dict):
        return part
    own = {key: _expand(value, defs) for key, value in part.items() if key != "$ref"}
    if "$ref" not in part:
        return own
    target = _expand(defs[part["$ref"].removeprefix("#/$defs/")], defs)
    return {**target, **own}


def at(path: str) -> Schema:
    """The part of the schema for a dotted path, a name in it as `*`: `at("objects.*.mass")`."""
    part = expanded()
    for key in path.split("."):
        part = part["additionalProperties"] if key == "*" else part["properties"][key]
    return part


def with_defaults(data: Any, schema: Schema | None = None) -> Any:
    """A copy of plain data in which every key that has a default is written out, in the schema's order.

    >>> with_defaults({"physgen": 1, "objects": {"a": {"mask": 1}}})["objects"]["a"]["friction"]
    0.5
    """
    schema = expanded() if schema is None else schema
    if isinstance(data, list):
        items = schema.get("items")
        if not isinstance(items, dict) or items.get("type") != "object":
            return data
        return [with_defaults(item, items) for item in data]
    if not isinstance(data, Mapping):
        return data
    properties = schema.get("properties", {})
    filled: dict[str, Any] = {}
    for key, part in properties.items():
        if key in data:
            filled[key] = with_defaults(data[key], part)
        elif "default" in part:
            filled[key] = with_defaults(copy.copy(part["default"]), part)
    rest = schema.get("additionalProperties")
    for key, value in data.items():
        if key not in properties:
            filled[key] = with_defaults(value, rest) if isinstance(rest, dict) else value
    return filled
