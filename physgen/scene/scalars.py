"""Plain YAML scalar (text) -> None, bool, int, float or str, by YAML 1.2's core schema (section 10.3.2).

PyYAML follows YAML 1.1, where `on` is true, `1.0e6` is text and `1:30` is 90; here they mean what they say.
"""

from __future__ import annotations

import math
import re

Scalar = bool | int | float | str | None

MAX_NUMBER = 310
"""Characters of the longest number: more than any float needs, and far below Python's limit on int(text)."""

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_NUMBER = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?").fullmatch
_BASE = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+").fullmatch
_ENDLESS = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)").fullmatch
_STARTS = frozenset("+-.0123456789")


class RefusedNumberError(ValueError):
    """A number that no scene can hold; `expected` and `fix` say why, in the words of a Problem."""

    def __init__(self, expected: str, fix: str) -> None:
        super().__init__(expected)
        self.expected, self.fix = expected, fix


def resolve(text: str) -> Scalar:
    """What a plain (unquoted) scalar stands for.

    Raises RefusedNumberError for NaN, infinities and numbers too long or too large for a float.

    >>> [resolve(t) for t in ("on", "1.0e6", "0x1F", "0o17", "~", "True", "1_000", "-.5")]
    ['on', 1000000.0, 31, 15, None, True, '1_000', -0.5]
    """
    if not text or text[0] not in _STARTS:
        return _WORDS.get(text, text) if len(text) < 6 else text
    if _NUMBER(text):
        if "." not in text and "e" not in text and "E" not in text:
            return int(text) if len(text) < 20 else int(_short(text))
        number = float(text) if len(text) < 30 else float(_short(text))
        if math.isinf(number):
            raise RefusedNumberError("is too large a number", "write a finite number, at most 1.0e308")
        return number
    if _BASE(text):
        return int(_short(text), 0)
    if _ENDLESS(text):
        raise RefusedNumberError("is not a finite number", "write a finite number")
    return text


def _short(text: str) -> str:
    if len(text) > MAX_NUMBER:
        raise RefusedNumberError(f"is a number of {len(text)} characters", f"write at most {MAX_NUMBER}")
    return text
