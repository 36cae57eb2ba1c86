"""A file's text and the operations of an edit -> its text after them, and what they are called."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physgen.edit.referring import remove, rename
from physgen.edit.refusing import impossible
from physgen.edit.targets import ABSENT, InFile, InVariant, Target, reach
from physgen.scene.schema import expanded
from physgen.scene.words import KeyPath, dotted
from physgen.scene.write import schema_at

KINDS = {"set": ("value",), "unset": (), "add": ("value",), "rename": ("to",), "remove": ()}
"""Operations, and what each says beside its path."""
MAX_STEPS, MAX_KEY = 40, 1000
"""Keys of a path, and characters of a key."""
EXACT = 12
"""Digits from which on a number is what arithmetic left, not what anybody wrote."""


@dataclass(frozen=True)
class Edited:
    """The text, and what was done."""

    text: str
    what: str


def edited(
    text: str, ops: Sequence[Mapping[str, Any]], variant: str | None, file: Path, allow_outside: bool
) -> Edited:
    """All operations, in order, in the file or in a variant. Raises EditError for the first that cannot be made."""
    told: list[str] = []
    for op in ops:
        within = InFile(text, file, allow_outside)
        target: Target = within if variant is None else InVariant(within, variant)
        try:
            told.append(_made(target, op))
        except ValueError as error:  # of the writer: a key that is too long
            raise impossible(str(error), "send what a scene can hold") from None
        text = target.text
    return Edited(text, ", ".join(dict.fromkeys(told))[:200])


def _made(target: Target, op: Mapping[str, Any]) -> str:
    kind = next((kind for kind in KINDS if kind in op), None)
    if kind is None or set(op) != {kind, *KINDS[kind]}:
        raise impossible(
            "an operation is none that is known", 'send {"set": [...], "value": ...} or the like'
        )
    path = _path(op[kind])
    if kind == "remove":
        return remove(target, path)
    if kind == "rename":
        return rename(target, path, op["to"])
    if kind == "unset" or op["value"] is None:
        target.unset(path)
        return f"unset {_called(path)}"
    value = short(op["value"])
    if kind == "set":
        target.put(path, value)
        return f"set {_called(path)}"
    seen = reach(target.data(), path)
    if isinstance(seen, list) or (
        (schema_at(path) or expanded()).get("type") == "array" and seen in (ABSENT, None)
    ):
        target.append(path, value)
    elif seen is not ABSENT:
        raise impossible(f"{dotted(path)} is there already", "choose another name, or set it")
    else:
        target.put(path, value)
    return f"add {_called(path)}"


def _called(path: KeyPath) -> str:
    """A path as the history names it: an object's key by the object."""
    return dotted(path[1:] if len(path) > 2 and path[0] == "objects" else path)


def _path(told: Any) -> KeyPath:
    if isinstance(told, list) and 0 < len(told) <= MAX_STEPS and all(map(_is_step, told)):
        return tuple(told)
    raise impossible("a path is no list of keys and numbers", 'send ["objects", "ball", "mass"]')


def _is_step(key: Any) -> bool:
    return (isinstance(key, int) and not isinstance(key, bool) and 0 <= key <= 10**6) or (
        isinstance(key, str) and len(key) <= MAX_KEY
    )


def short(value: Any) -> Any:
    """A value as it is written: whole numbers as such, no more digits than anybody means.

    >>> short([412.5000000000001, -30.0, 0.25, 12345678.9])
    [412.5, -30, 0.25, 12345678.9]
    """
    if isinstance(value, dict):
        return {str(key): short(child) for key, child in value.items()}
    if isinstance(value, list):
        return [short(child) for child in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise impossible("a number is not finite", "send a finite number")
        if sum(map(str.isdigit, repr(value).partition("e")[0].strip("-0."))) >= EXACT:
            value = float(f"{value:.6g}")
        return int(value) if value.is_integer() and abs(value) < 1e5 else value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 1e5:
        if abs(value) > 1e300:
            raise impossible("a number is too large", "send a finite number")
        return float(value) if float(f"{value:.1e}") == value else value
    return value
