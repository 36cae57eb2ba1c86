"""Guess the number or list that a person meant by a text.

>>> meant_number("1,5", ""), meant_number("170 grams", "g"), meant_number("30%", "")
('1.5', '170 g', '0.3')
>>> meant_number("1,5 grams", "g"), meant_number("1,5 kg", "g")
('1.5 g', '1.5 kg')
>>> meant_list("512x512"), meant_list("(100, 0)"), meant_list("fast")
('[512, 512]', '[100, 0]', None)
"""

from __future__ import annotations

import re
import unicodedata

from physgen.text import quantity

LONGEST_SLIP = 200
"""Maximum length of a text to interpret, characters: a list of some ten numbers."""
_QUOTES = "\"'‘’‚“”„«»`´"
_SIGNS = {"\u2212": "-", "\u2013": "-", "\u2014": "-", "\u00d7": "x"}
"""Signs that look like minus, dashes and times -> the signs of YAML."""
_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_is_number = re.compile(_NUMBER).fullmatch
_amount = re.compile(rf"({_NUMBER})\s*(\D.*)").fullmatch
_UNITS = {
    "gram": "g",
    "kilogram": "kg",
    "kgs": "kg",
    "meter": "m",
    "metre": "m",
    "pixel": "px",
    "second": "s",
    "sec": "s",
    "minute": "min",
    "millisecond": "ms",
    "newton": "N",
    "revolution": "turn",
    "rev": "turn",
    "fps": "Hz",
    "hz": "Hz",
}
"""Names of units in the singular -> units of a scene file."""
_WORD = re.compile(r"[A-Za-z]+")
_PER_SECOND = ("degrees/s", "px/s")
"""Units of a rate, often written without `/s`."""


def normalize_text(text: str) -> str:
    """Return a text with the signs and digits of a keyboard, without surrounding
    quotes.
    """
    signs = "".join(map(_keyboard_sign, text))
    return unicodedata.normalize("NFKC", signs).strip().strip(_QUOTES).strip()


def _keyboard_sign(char: str) -> str:
    """Return the ASCII digit or sign of a similar character."""
    if char.isdecimal():
        return str(unicodedata.decimal(char))
    return _SIGNS.get(char, char)


def meant_number(text: str, unit: str) -> str | None:
    """Return the intended number of a text, with its unit if written."""
    if len(text) > LONGEST_SLIP:
        return None
    # A comment or a punctuation mark after a number does not belong to it.
    text = normalize_text(text).split("#")[0].rstrip(" ,;.")
    if has_decimal_comma(text):
        point_text = text.replace(",", ".")
        return meant_number(point_text, unit) or point_text
    if _is_number(text):
        return text
    # Thousands separators of several languages.
    if re.fullmatch(r"[-+]?\d{1,3}(?:[_' ]\d{3})+", text):
        return re.sub(r"[_' ]", "", text)
    if text.endswith("%") and _is_number(text[:-1].strip()) and not unit:
        return f"{float(text[:-1]) / 100:g}"
    return _meant_quantity(text, unit)


def has_decimal_comma(text: str) -> bool:
    """Return whether a text is a number with a decimal comma.

    >>> has_decimal_comma("0,5"), has_decimal_comma("1,5 kg"), has_decimal_comma("1,2,3")
    (True, True, False)
    """
    return (
        re.fullmatch(r"[-+]?\d+,\d+(\s*[^\W\d][^,\s]*)?", normalize_text(text))
        is not None
    )


def _meant_quantity(text: str, unit: str) -> str | None:
    """Return a number with a fitting unit, or None for another text."""
    parts = _amount(text)
    if not unit or parts is None:
        return None
    spelt = _WORD.sub(lambda word: _known_unit(word[0]), parts[2].strip())
    for unit_name in (spelt, f"{spelt}/s" if unit in _PER_SECOND else spelt):
        meaning = f"{parts[1]} {unit_name}"
        if meaning != text and quantity(meaning, unit, 100.0) is not None:
            return meaning
    return None


def _known_unit(word: str) -> str:
    """Return the unit with this name, or the word itself."""
    lower = word.lower()
    return _UNITS.get(lower) or _UNITS.get(lower.removesuffix("s")) or word


def meant_list(text: str) -> str | None:
    """Return the intended list of numbers of a text, or None for another text."""
    if len(text) > LONGEST_SLIP:
        return None
    inner = normalize_text(text).strip("()[]{} ")
    parts = []
    for part in re.split(r"\s*[,;xX]\s*|\s+", inner):
        if part:
            parts.append(part)
    if len(parts) < 2 or not all(map(_is_number, parts)):
        return None
    return f"[{', '.join(parts)}]"
