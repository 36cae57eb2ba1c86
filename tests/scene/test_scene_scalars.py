"""Our resolver against the tables of YAML 1.2.2, sections 10.3.2 (core schema) and 2.4 (examples 2.19 to 2.21)."""

from __future__ import annotations

import math

import pytest

from physgen.scene.document import RefusedError, Scalar, resolve

TABLE: dict[str, Scalar] = {
    # section 10.3.2: null, bool, int, float
    "": None,
    "~": None,
    "null": None,
    "Null": None,
    "NULL": None,
    "true": True,
    "True": True,
    "TRUE": True,
    "false": False,
    "False": False,
    "FALSE": False,
    "0": 0,
    "-0": 0,
    "+12": 12,
    "-19": -19,
    "012345": 12345,
    "0o7": 7,
    "0o14": 12,
    "0x3A": 58,
    "0xC": 12,
    "0.": 0.0,
    "-0.0": -0.0,
    ".5": 0.5,
    "+12e03": 12000.0,
    "-2E+05": -200000.0,
    # examples 2.19 and 2.20
    "12345": 12345,
    "+12345": 12345,
    "1.23015e+3": 1230.15,
    "12.3015e+02": 1230.15,
    "1230.15": 1230.15,
    # what PyYAML's 1.1 reads otherwise
    "1.0e6": 1e6,
    "1e6": 1e6,
    "on": "on",
    "off": "off",
    "yes": "yes",
    "no": "no",
    "y": "y",
    "1:30": "1:30",
    "1_000": "1_000",
    "0b11": "0b11",
    "0o8": "0o8",
    "0xg": "0xg",
    "-0x1": "-0x1",
    "2001-12-14": "2001-12-14",
    "=": "=",
    "<<": "<<",
    # text that begins like a number
    "-": "-",
    ".": ".",
    "+": "+",
    "e5": "e5",
    "1e": "1e",
    "1.2.3": "1.2.3",
    "..5": "..5",
    "1 2": "1 2",
    "nan": "nan",
    "inf": "inf",
    "nUll": "nUll",
    "tRUE": "tRUE",
    "٣": "٣",
    "1\n": "1\n",
    "²": "²",
}


@pytest.mark.parametrize("text", TABLE)
def test_core_schema(text: str) -> None:
    found, expected = resolve(text), TABLE[text]
    assert found == expected
    assert type(found) is type(expected)
    if isinstance(found, float) and isinstance(expected, float):
        assert math.copysign(1, found) == math.copysign(1, expected)


@pytest.mark.parametrize(
    "text", [".inf", "-.inf", "+.Inf", ".INF", ".nan", ".NaN", ".NAN"]
)
def test_endless_numbers_are_refused(text: str) -> None:
    with pytest.raises(RefusedError, match="not a finite number"):
        resolve(text)


@pytest.mark.parametrize(
    "text",
    [
        "9" * 10**6,
        "-" + "9" * 5000,
        "0x" + "f" * 10**6,
        "0." + "1" * 10**6,
        "1e400",
        "-1e999",
    ],
)
def test_numbers_that_no_float_holds_are_refused(text: str) -> None:
    with pytest.raises(RefusedError):
        resolve(text)
