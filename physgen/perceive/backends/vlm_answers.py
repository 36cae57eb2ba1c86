"""What a model says -> an answer that keeps to a JSON schema, or sentences about what is wrong with it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from jsonschema import Draft202012Validator

Schema = Mapping[str, Any]
LONGEST = 50_000
"""Characters of an answer that are read."""
TRIES = 200
"""Places where JSON may begin that are tried."""
LOCAL = frozenset(["minimum", "maximum", "exclusiveMinimum", "minLength", "minItems", "maxItems"])
"""Keywords that are held to here and not sent: many servers refuse a strict schema that has them."""
_START = re.compile(r"[\[{]")
_THOUGHT = re.compile(r"<think>.*?(</think>|\Z)", re.DOTALL)
_DECODER = json.JSONDecoder(
    parse_constant=lambda name: name
)  # NaN and Infinity are no numbers: they stay text


class NonsenseError(Exception):
    """An answer that cannot be used; `str` of it says why, for the model and for the user alike."""


@dataclass(frozen=True)
class Query:
    """A question about pictures."""

    about: str
    """In a word or three, for messages: `ball`."""
    text: str
    pictures: tuple[bytes, ...]
    """PNG."""
    schema: Schema
    """Of the answer."""
    odd: Callable[[Any], list[str]] = lambda answer: []
    """What is wrong with an answer that keeps to the schema."""


def record(**properties: Schema) -> dict[str, Any]:
    """The schema of an object that has these properties, all of them and no others."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def sent(schema: Any) -> Any:
    """The schema as a server is given it."""
    if isinstance(schema, Mapping):
        return {key: sent(value) for key, value in schema.items() if key not in LOCAL}
    return [sent(value) for value in schema] if isinstance(schema, list) else schema


def answer(text: str, query: Query) -> Any:
    """The first JSON in `text` that answers `query`; prose, fences and thoughts around it are passed over.

    Raises NonsenseError, about the first JSON that there is.
    """
    text = _THOUGHT.sub(" ", text[:LONGEST]).strip()
    if not text:
        raise NonsenseError("it was empty")
    first = ""
    for value in _values(text):
        eased = _eased(value, query.schema)
        wrong = list(_breaches(eased, query.schema)) or query.odd(eased)
        if not wrong:
            return eased
        first = first or "; ".join(wrong[:4])
    raise NonsenseError(first or f'it had no JSON in it, but "{_short(text, 60)}"')


def fits(value: Any, query: Query) -> bool:
    """Whether a value that was kept still answers `query`."""
    return not list(_breaches(value, query.schema)) and not query.odd(value)


def _values(text: str) -> Iterator[Any]:
    """Every JSON object and array in a text, not those inside others."""
    at = 0
    for _ in range(TRIES):
        if not (found := _START.search(text, at)):
            return
        try:
            value, at = _DECODER.raw_decode(text, found.start())
        except RecursionError:  # and it would be so from the next bracket on, too
            return
        except ValueError:
            at = found.end()
        else:
            yield value


def _breaches(value: Any, schema: Schema) -> Iterator[str]:
    errors = Draft202012Validator(schema).iter_errors(value)
    for error in sorted(errors, key=lambda e: (len(e.path), str(e.path))):
        where = error.json_path.removeprefix("$").lstrip(".")
        yield f"{where}: {_short(error.message, 120)}" if where else _short(error.message, 120)


def _eased(value: Any, schema: Schema) -> Any:
    """The value with what is plainly meant made so: numbers in quotes, yes for true, keys that nobody asked for."""
    kind = schema.get("type")
    if kind == "object":
        properties = schema["properties"]
        if isinstance(value, list) and len(properties) == 1:  # the list itself, without the key above it
            value = {next(iter(properties)): value}
        if isinstance(value, Mapping):
            return {key: _eased(value[key], properties[key]) for key in properties if key in value}
    elif kind == "array" and isinstance(value, list):
        return [_eased(item, schema["items"]) for item in value]
    elif kind == "boolean" and isinstance(value, str):
        return {"true": True, "yes": True, "false": False, "no": False}.get(value.strip().lower(), value)
    elif kind == "integer" and isinstance(value, str) and value.strip().isdecimal() and len(value) < 20:
        return int(value)
    elif kind == "number" and isinstance(value, str | int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            return _short(str(value), 40)
        return number if abs(number) < 1e30 else str(number)  # what is not finite is no number
    elif kind == "string" and isinstance(value, str):
        value = plain(value)
        return value.lower() if value.lower() in schema.get("enum", ()) else value
    return value


def plain(text: str, most: int = 300) -> str:
    """One line of what can be shown, cut at a word.

    >>> plain("a  red\\n# ball\\x1b[0m")
    'a red # ball[0m'
    """
    line = " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split())
    return line if len(line) <= most else f"{line[:most].rpartition(' ')[0] or line[:most]} ..."


def _short(text: str, most: int) -> str:
    line = plain(text, 10_000)
    return line if len(line) <= most else f"{line[: most - 3]}..."
