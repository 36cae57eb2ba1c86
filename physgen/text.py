"""Words for messages: quoted values, numbers, lists, dotted paths, and the nearest known name."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

UNITS = {
    "px": "pixels",
    "s": "seconds",
    "g": "grams",
    "px/m": "pixels per meter",
    "1/s": "a number per second",
}
"""Units that read better spelt out; the others are shown as they are."""

_LENGTH = (0, 1, 0, 0, 0)
_TIME = (0, 0, 1, 0, 0)
_MASS = (0, 0, 0, 1, 0)
_ANGLE = (0, 0, 0, 0, 1)
_FORCE = (0, 1, -2, 1, 0)
_MEASURES: dict[str, tuple[float, tuple[int, int, int, int, int]]] = {
    "m": (1.0, _LENGTH),
    "cm": (1e-2, _LENGTH),
    "mm": (1e-3, _LENGTH),
    "km": (1e3, _LENGTH),
    "s": (1.0, _TIME),
    "ms": (1e-3, _TIME),
    "min": (60.0, _TIME),
    "g": (1.0, _MASS),
    "kg": (1e3, _MASS),
    "mg": (1e-3, _MASS),
    "deg": (1.0, _ANGLE),
    "degree": (1.0, _ANGLE),
    "degrees": (1.0, _ANGLE),
    "°": (1.0, _ANGLE),
    "rad": (57.29577951308232, _ANGLE),
    "turn": (360.0, _ANGLE),
    "px": (1.0, (1, 0, 0, 0, 0)),
    "Hz": (1.0, (0, 0, -1, 0, 0)),
    "rpm": (6.0, (0, 0, -1, 0, 1)),
    "1": (1.0, (0, 0, 0, 0, 0)),
    "N": (1e3, _FORCE),
    "mN": (1.0, _FORCE),
    "J": (1e3, (0, 2, -2, 1, 0)),
}
"""Size of each unit in m, s, g and degrees, and exponents of px, m, s, g and degrees."""
ALLOWED = {
    "px": "px, mm, cm or m",
    "s": "ms, s or min",
    "g": "mg, g or kg",
    "degrees": "deg, rad or turn",
    "px/s": "px/s, cm/s or m/s",
    "px/s²": "px/s² or m/s²",
    "degrees/s": "deg/s, rad/s or rpm",
    "px/m": "px/m, px/cm or px/mm",
    "g·px/s": "N s, g m/s or g px/s",
    "g·px/s²": "N, mN or g px/s²",
    "g·px²/s²": "N m, J or g px²/s²",
    "g/px²": "kg/m², g/cm² or g/px²",
    "g/s²": "N/m, kg/s² or g/s²",
    "g/s": "N s/m, kg/s or g/s",
    "1/s": "Hz",
    "px³/s²": "m³/s² or px³/s²",
    "g·px²": "kg m² or g px²",
    "g·px³/s²": "N m² or g px³/s²",
    "g/px/s": "g/px/s",
}
"""Unit of a key -> units that a text may have there."""
_QUANTITY = re.compile(
    r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d\s.+-].{0,30})", re.DOTALL
).fullmatch
LONGEST_QUANTITY = 80
"""Characters of a number with its unit."""
_FACTOR = re.compile(r"([/·*]?)\s*([A-Za-z°]+|1)(?:\^?(-?\d)|([²³]))?\s*").match


def _measure(unit: str) -> tuple[float, list[int]] | None:
    """Return size and exponents of a unit such as `kg m/s²`; None for text that is no unit."""
    size, powers, place = 1.0, [0] * 5, 0
    while place < len(unit):
        factor = _FACTOR(unit, place)
        if factor is None or factor[2] not in _MEASURES:
            return None
        power = int(factor[3] or {"²": 2, "³": 3, None: 1}[factor[4]])
        if factor[1] == "/":
            power = -power
        factor_size, exponents = _MEASURES[factor[2]]
        size *= factor_size**power
        for k, exponent in enumerate(exponents):
            powers[k] += power * exponent
        place = factor.end()
    return size, powers


def quantity(text: str, unit: str, pixels_per_meter: float) -> float | None:
    """Return a number with its unit as a number of `unit`; None if it has no such unit.

    >>> quantity("170 g", "g", 100), quantity("1.2 m/s", "px/s", 500), quantity("5 N", "g·px/s²", 100)
    (170.0, 600.0, 500000.0)
    >>> quantity("90 deg/s", "degrees/s", 1), quantity("7 px/cm", "px/m", 1), quantity("3 kg", "px", 1)
    (90.0, 700.0, None)
    """
    match = _match_quantity(text)
    if match is None:
        return None
    written_unit, target_unit = _measure(match[2].strip()), _measure(unit)
    if written_unit is None or target_unit is None:
        return None
    pairs = zip(written_unit[1], target_unit[1], strict=True)
    pixels, meters, *others = [a - b for a, b in pairs]
    # Only px and m may differ, as the scale converts them; 0.3 mm/px is no 0.0003 px/m.
    is_other_kind = pixels + meters != 0 or any(others)
    if is_other_kind or (unit == "px/m" and (pixels or meters)):
        return None
    try:
        number = float(match[1]) * written_unit[0] / target_unit[0]
        number *= pixels_per_meter**meters
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _match_quantity(text: str) -> re.Match[str] | None:
    """Return the number and the unit of a text as groups 1 and 2; None for other text."""
    if len(text) > LONGEST_QUANTITY:
        return None
    return _QUANTITY(text.strip())


def pixel_power(unit: str) -> int:
    """Return the exponent of px in a unit; 0 where it has none.

    >>> pixel_power("px/s"), pixel_power("g·px²/s²"), pixel_power("g/px²")
    (1, 2, -2)
    """
    measure = _measure(unit)
    return 0 if measure is None else measure[1][0]


def rescaled_quantity(text: str, factor: float) -> str:
    """Return a number with a unit for pixels that are `factor` times as many.

    >>> rescaled_quantity("120 px/s", 0.5), rescaled_quantity("2 m/s", 0.5)
    ('60 px/s', '2 m/s')
    """
    match = _match_quantity(text)
    if match is None:
        return text
    unit = match[2].strip()
    power = pixel_power(unit)
    if power == 0:
        return text
    return f"{float(match[1]) * factor**power:.9g} {unit}"


KeyPath = tuple[str | int, ...]
"""Keys and indices from the top of a document to a value."""

_DIGITS = re.compile("([0-9]+)")
_PLAIN_KEY = re.compile(r"[\w*<.-]{1,64}").fullmatch


def quoted(text: str, mark: str = '"', width: int = 40) -> str:
    """Return text on one line, cut to a readable length, without control characters of a terminal.

    >>> quoted("a\\nb"), quoted("x" * 50, width=10)
    ('"a\\\\nb"', '"xxxxxxx..."')
    """
    if len(text) > width:
        text = text[: width - 3] + "..."
    if not text.isprintable():
        text = "".join(map(_printable, text))
    return f"{mark}{text}{mark}"


def _printable(character: str) -> str:
    if character.isprintable():
        return character
    return json.dumps(character)[1:-1]


def shown(value: Any) -> str:
    """Return a value as a message shows it: scalars as written, collections by kind.

    >>> [shown(v) for v in ("heavy", 3, None, True, [1], {})]
    ['"heavy"', '3', 'an empty value', 'true', 'a list', 'a mapping']
    """
    if value is None:
        return "an empty value"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return quoted(number(value), "")
    return "a mapping" if isinstance(value, dict) else "a list"


def number(value: int | float) -> str:
    """Return short text that our resolver reads as exactly the same number, of the same kind.

    >>> [number(v) for v in (2.0, 3, 0.1, -1e6, 123456.0, 1e22, 1e-7, -0.0)]
    ['2.0', '3', '0.1', '-1.0e6', '123456.0', '1.0e22', '1.0e-7', '-0.0']
    """
    text = repr(value)
    if not isinstance(value, float):
        return text
    if abs(value) >= 1e5 and float(f"{value:.1e}") == value:
        text = f"{value:.1e}"
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return text
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}e{int(exponent)}"


def rounded(value: float, digits: int = 3) -> str:
    """Return a number as people write it: with so many digits, thousands set apart.

    >>> [rounded(v) for v in (568.2, 0.0301, 9.81, 4.0, -0.0)], rounded(-27251.3, 4)
    (['568', '0.0301', '9.81', '4', '0'], '−27,250')
    """
    if not value or not math.isfinite(value):
        return f"{value or 0.0:g}"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    text = f"{round(value, places):,.{max(places, 0)}f}".replace("-", "−")
    return text.rstrip("0").rstrip(".") if "." in text else text


LEAST_WHOLE = 0.01
"""Share of 1 from which whole percents are exact enough."""


def percent(share: float) -> str:
    """Return a share of 1 as people write it.

    >>> percent(0.08), percent(0.463), percent(0.0031)
    ('8 %', '46 %', '0.31 %')
    """
    if abs(share) >= LEAST_WHOLE:
        return f"{100 * share:.0f} %"
    return f"{rounded(100 * share, 2)} %"


def value_text(value: object) -> str:
    """Return a value as people write it; empty for None.

    >>> [value_text(v) for v in (None, True, "side", 1234567.0, [4200.0, -356.5], {"steps": 25, "strength": 0.3})]
    ['', 'yes', 'side', '1,234,570', '(4,200, −356.5)', 'steps 25, strength 0.3']
    """
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return rounded(value, 6)
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {value_text(part)}" for name, part in value.items())
    if isinstance(value, Iterable) and not isinstance(value, str):
        return _list_text([*value])
    return str(value)


def _list_text(parts: Sequence[object]) -> str:
    """Return the parts of a list with commas, in parentheses if it is a vector."""
    texts = []
    for part in parts:
        text = rounded(part, 4) if isinstance(part, float) else value_text(part)
        texts.append(text)
    item_text = ", ".join(texts)
    is_vector = any(isinstance(part, float) for part in parts)
    return f"({item_text})" if is_vector else item_text


def name_ranges(names: Sequence[str]) -> str:
    """Return names, consecutive numbers as ranges.

    >>> name_ranges(["ball-1", "ball-2", "ball-3", "ball-7", "cup"])
    'ball-1 to ball-3, ball-7, cup'
    """
    ranges: list[tuple[str, str]] = []
    for name in names:
        stem, number = re.fullmatch(r"(.*?)(\d*)", name).groups()  # type: ignore[union-attr]
        if ranges and number and ranges[-1][1] == f"{stem}{int(number) - 1}":
            ranges[-1] = (ranges[-1][0], name)
        else:
            ranges.append((name, name))
    texts = []
    for first, last in ranges:
        texts.append(first if first == last else f"{first} to {last}")
    return ", ".join(texts)


def example(value: Any) -> str:
    """Return a value from the schema as YAML on one line, as a person writes it.

    >>> example({"impulse": [-1.0e6, 0], "label": ""})
    '{impulse: [-1.0e6, 0], label: ""}'
    """
    if isinstance(value, dict):
        pairs = [f"{key}: {example(item)}" for key, item in value.items()]
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(example, value))}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return number(value)
    return str(value) or '""'


def dotted(path: KeyPath) -> str:
    """Return a path as a person writes it.

    >>> dotted(("forces", 0, "impulse", 1))
    'forces[0].impulse[1]'
    """
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
            continue
        key = part if _PLAIN_KEY(part) else quoted(part)
        text = f"{text}.{key}" if text else key
    return text


def listed(words: Iterable[str], last: str = "or") -> str:
    """Return words as a list in a sentence.

    >>> listed(["a", "b", "c"])
    'a, b or c'
    """
    words = list(words)
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def counted(number: int, noun: str) -> str:
    """Return a number of objects of one kind: 1 shape, 2 shapes."""
    plural = "" if number == 1 else "s"
    return f"{number:,} {noun}{plural}"


def natural(name: str) -> tuple[tuple[str | int, ...], str]:
    """Return a key that sorts names as people do.

    >>> sorted(["ball-10", "ball", "ball-2"], key=natural)
    ['ball', 'ball-2', 'ball-10']
    """
    parts: list[str | int] = [*_DIGITS.split(name)]
    parts[1::2] = map(int, parts[1::2])
    return tuple(parts), name


_TIGHT_KEY = re.compile(r"[ \t]*(?:- +)*([A-Za-z_][\w-]*):(?=[^\s:/\\])").match


def add_space(text: str) -> str | None:
    """Return the fix of a key whose colon has no space after it, None for other text.

    >>> add_space("mass:3"), add_space("mass: 3")
    ('put a space after the colon: mass: 3', None)
    """
    tight = _TIGHT_KEY(text)
    if tight is None:
        return None
    spaced = f"{tight[1]}: {text[tight.end() :].strip()}"
    return f"put a space after the colon: {quoted(spaced, '')}"


def similarity(word: str, other: str) -> float:
    """Return how alike two words are, from 0 to 1."""
    return difflib.SequenceMatcher(None, other, word).ratio() if len(word) < 65 else 0


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that was probably meant."""
    if len(word) > 64:
        return None
    choices = list(known)[:300]
    matches = difflib.get_close_matches(word, choices, n=1, cutoff=0.6)
    return matches[0] if matches else None
