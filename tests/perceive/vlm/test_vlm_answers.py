"""What is read out of a text that should have been JSON."""

from __future__ import annotations

import json

import pytest
from vlm_stub import BALL

from physgen.perceive.backends.vlm import UnusableAnswerError, parse_answer
from physgen.perceive.backends.vlm_questions import (
    PHYSICS_SCHEMA,
    Query,
    mass_contradictions,
)

QUERY = Query("ball", "?", (), PHYSICS_SCHEMA, mass_contradictions)
GOOD = json.dumps(BALL)
HOSTILE = (
    "{" * 50_000,
    "[" * 50_000,
    '{"a":' * 10_000,
    "[1,2]" * 10_000,
    "\x00",
    "null",
    '"' * 50_000,
)


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        f"```json\n{GOOD}\n```",
        f"<think>{{a}} or [b]?</think>{GOOD}",
        f'First {{"mass": 1}}, or rather {GOOD} {GOOD}',
    ],
)
def test_what_is_plainly_meant_is_taken(text: str):
    assert parse_answer(text, QUERY) == BALL


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("72.0", "NaN"), "mass: 'NaN' is not of type 'number'"),
        (("72.0", "1e999"), "mass: inf is greater than the maximum of 10000000.0"),
        (("72.0", '"72 g"'), "mass: '72 g' is not of type 'number'"),
        (("72.0", "-3"), "mass: -3 is less than the minimum of 0.001"),
        (
            ("72.0", "9e6"),
            "mass: an object whose longest side is 0.05 m cannot weigh 9e+06 g",
        ),
        (('"mass": 72.0, ', ""), "'mass' is a required property"),
        (
            ("sphere", "cube"),
            "solid: 'cube' is not one of ['sphere', 'disc', 'hoop', 'plate']",
        ),
        (('"rubber"', '""'), "material: '' should be non-empty"),
    ],
)
def test_what_is_nonsense_is_said(change: tuple[str, str], told: str):
    with pytest.raises(UnusableAnswerError) as error:
        parse_answer(GOOD.replace(*change), QUERY)
    assert told in str(error.value)


def test_nothing_takes_long():
    for text in HOSTILE:
        with pytest.raises(UnusableAnswerError):
            parse_answer(text, QUERY)
