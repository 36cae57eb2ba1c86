"""A request -> what it asks for, as plain checked data; raises EditError where it is not what the interface says."""

from __future__ import annotations

import json
import re
from itertools import islice
from typing import Any, NoReturn

from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request

from physgen.edit.refusing import EditError, Why
from physgen.edit.server.guard import too_large
from physgen.edit.server.limits import BODY, MAX_DEPTH, MAX_OPS, MAX_VALUES, MAX_WORDS
from physgen.edit.session import Asked

_MARKS = re.compile(rb'"(?:[^"\\]++|\\.)*+"?|[\[{,]', re.DOTALL)
"""Texts, beginnings of lists and objects, and commas: no fewer than there are values."""


def malformed(message: str, fix: str) -> EditError:
    """Not as the interface says."""
    return EditError(Why.MALFORMED, message, fix)


async def body(request: Request) -> dict[str, Any]:
    """The JSON mapping that a request carries. Raises EditError."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise EditError(Why.KIND, "the body is not called JSON", "send Content-Type: application/json")
    data = bytearray()
    try:
        async for part in request.stream():
            if len(data) + len(part) > BODY:
                raise too_large(BODY)
            data += part
    except ClientDisconnect:
        raise malformed("the body ended early", "send it again") from None
    return await run_in_threadpool(parsed, data)


def parsed(data: bytes | bytearray) -> dict[str, Any]:
    """Bytes -> a mapping. Raises EditError, and before anything is made of them where that would be too much."""
    if next(islice(_MARKS.finditer(data), MAX_VALUES, None), None) is not None:
        raise malformed(f"the body holds more than {MAX_VALUES:,} texts, lists and commas", "send less")
    try:
        text = data.decode("utf-8")
        told = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deep" if isinstance(error, RecursionError) else str(error)
        raise malformed(f"the body is not JSON: {reason}"[:300], "send a JSON object") from None
    if not isinstance(told, dict):
        raise malformed("the body is not a JSON object", 'send {"version": 1, ...}')
    if not _shallow(told) or not _encodable(told):
        raise malformed("the body holds what no scene can", "nest less, and send whole characters")
    return told


def _refuse_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) != len(pairs):
        raise ValueError("a key is written twice")
    return made


def _shallow(told: Any) -> bool:
    level = [told]
    for _ in range(MAX_DEPTH):
        level = [
            child
            for value in level
            if isinstance(value, dict | list)
            for child in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return True
    return False


def _encodable(told: Any) -> bool:
    """Whether every text in it is one: half a pair of surrogates is none."""
    try:
        json.dumps(told, ensure_ascii=False).encode("utf-8")
    except (UnicodeEncodeError, ValueError):
        return False
    return True


def query(request: Request, *names: str) -> dict[str, str]:
    """What stands behind the question mark: these names alone, each once. Raises EditError."""
    told: dict[str, str] = {}
    for name, value in request.query_params.multi_items():
        if name not in names or name in told:
            raise malformed(f"{name[:40]} is not asked here, or twice", f"send {', '.join(names) or 'none'}")
        told[name] = value
    return told


class Fields:
    """The keys of a body, each asked for by kind; what nobody asked for is refused at the end."""

    def __init__(self, told: dict[str, Any]) -> None:
        self._told = told
        self._known: set[str] = set()

    def take(self, key: str) -> Any:
        """The value of a key, None where it is absent."""
        self._known.add(key)
        return self._told.get(key)

    def version(self) -> int:
        """Of the state that was seen."""
        version = self.take("version")
        if isinstance(version, float) and version.is_integer():
            version = int(version)
        if not isinstance(version, int) or isinstance(version, bool) or not 0 <= version < 2**53:
            raise malformed("version is not a whole number", "send the version of the state that you see")
        return version

    def asked(self) -> Asked:
        """Version, variant, what, tag and id."""
        version = self.version()
        variant, what, tag = self.words("variant") or None, self.words("what") or "", self.words("tag")
        return Asked(version, variant, what, tag, self.words("id", 64))

    def words(self, key: str, most: int = MAX_WORDS) -> str | None:
        """A text on one line, or null."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, str) or len(value) > most:
            raise malformed(f"{key} is not a text of at most {most} characters", "send a short text or null")
        return value

    def choice(self, key: str, words: tuple[str, ...]) -> str | None:
        """One of several words, or null."""
        value = self.take(key)
        if value is not None and value not in words:
            raise malformed(f"{key} is none of {', '.join(words)}", "send one of them, or null")
        chosen: str | None = value
        return chosen

    def text(self, key: str) -> str:
        """A long text."""
        value = self.take(key)
        if not isinstance(value, str):
            raise malformed(f"{key} is not a text", "send the text of the file")
        return value

    def truth(self, key: str) -> bool:
        """True or false; true where it is absent."""
        value = self.take(key)
        if value is not None and not isinstance(value, bool):
            raise malformed(f"{key} is neither true nor false", "send one of the two")
        return value is not False

    def mapping(self, key: str) -> dict[str, Any]:
        """An object."""
        value = self.take(key)
        if not isinstance(value, dict):
            raise malformed(f"{key} is not an object", "send {...}")
        return value

    def listed(self, key: str) -> list[str | None] | None:
        """A list of names, in which null may be, or null."""
        value = self.take(key)
        if value is None:
            return None
        if not isinstance(value, list) or len(value) > MAX_OPS or not all(map(_is_name, value)):
            raise malformed(f"{key} is not a list of names", "send [...] or null")
        return value

    def ops(self) -> list[dict[str, Any]]:
        """Operations; what each says is looked at where it is made."""
        value = self.take("ops")
        if isinstance(value, list) and len(value) > MAX_OPS:
            raise malformed(f"more than {MAX_OPS} operations", "send fewer at a time")
        if not isinstance(value, list) or not all(isinstance(op, dict) for op in value):
            raise malformed("ops is not a list of objects", 'send [{"set": [...], "value": ...}]')
        return value

    def done(self) -> None:
        """Nothing else was sent. Raises EditError."""
        rest = min(set(self._told) - self._known, default=None)
        if rest is not None:
            raise malformed(f"{rest[:40]} is not known here", f"send {', '.join(sorted(self._known))}")


def _is_name(item: object) -> bool:
    return item is None or (isinstance(item, str) and len(item) <= MAX_WORDS)
