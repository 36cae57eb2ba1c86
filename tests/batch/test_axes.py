"""Arguments of a sweep: what they mean, how they are split, and what is told where they are wrong."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from physgen.batch.axes import ListAxis, read_axes
from physgen.batch.sweep import plan_clips
from physgen.problems import InputError


def values(argument: str) -> list[Any]:
    [axis] = read_axes([argument])
    assert isinstance(axis, ListAxis)
    return [value.data for value in axis.values]


def said(*arguments: str, **others: Any) -> list[str]:
    with pytest.raises(InputError) as caught:
        plan_clips(read_axes(arguments), **others)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("-100:-900:9", [-100, -200, -300, -400, -500, -600, -700, -800, -900]),
        (
            "0:1:11",
            [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1],
        ),  # no 0.30000000000000004
        ("1:1000:4:log", [1, 10, 100, 1000]),
        ("-1e3:-10:3:log", [-1000, -100, -10]),
        ("0.2,0.9", [0.2, 0.9]),
        ("0:2:3, 10", [0, 1, 2, 10]),
        ("[1,2],[3, 4]", [[1, 2], [3, 4]]),
        (
            "{circle: {center: [1, 2], radius: 3}}",
            [{"circle": {"center": [1, 2], "radius": 3}}],
        ),
        ("disc,hoop", ["disc", "hoop"]),
        ("true,false,null", [True, False, None]),
        ("'a,b',\"1:2:3\",it's", ["a,b", "1:2:3", "it's"]),
        ("on,1_0", ["on", "1_0"]),
    ],
)
def test_values_are_ranges_or_yaml(text: str, meant: list[Any]) -> None:
    found = values(f"a.b={text}")
    assert found == meant
    assert [type(value) for value in found] == [type(value) for value in meant]


words = st.from_regex(r"[a-z][a-z0-9_-]{0,8}", fullmatch=True).filter(
    lambda word: word not in ("true", "false", "null")
)
scalars = st.one_of(
    st.integers(-(10**6), 10**6),
    st.booleans(),
    words,
    st.text("a,b[]{}:'\" #", min_size=1, max_size=6),
    st.floats(allow_nan=False, allow_infinity=False, width=32),
)
trees = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3)
    ),
)


@pytest.mark.slow
@given(st.lists(trees, min_size=1, max_size=5))
def test_what_a_yaml_writer_writes_between_commas_is_read_back(
    meant: list[Any],
) -> None:
    unlike = [
        value
        for k, value in enumerate(meant)
        if not any(_same(value, other) for other in meant[:k])
    ]
    text = ",".join(
        yaml.safe_dump([value], default_flow_style=True, width=10**6)
        .strip()[1:-1]
        .strip()
        for value in unlike
    )
    assert all(map(_same, values(f"key={text}"), unlike))


def _same(a: Any, b: Any) -> bool:
    """1 and true are equal in Python, and 1.0 and 1 to a person."""
    if (
        isinstance(a, bool)
        or isinstance(b, bool)
        or isinstance(a, str)
        or isinstance(b, str)
    ):
        return type(a) is type(b) and a == b
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    return a == b


@given(
    st.integers(-999, 999),
    st.integers(-999, 999),
    st.integers(2, 50),
    st.integers(0, 4),
)
def test_a_range_is_the_float_next_to_the_true_step(
    a: int, b: int, count: int, digits: int
) -> None:
    from fractions import Fraction

    if a == b:
        return
    low, high = (f"{value / 10**digits:.{digits}f}" for value in (a, b))
    true = [
        Fraction(low) + (Fraction(high) - Fraction(low)) * k / (count - 1)
        for k in range(count)
    ]
    assert values(f"key={low}:{high}:{count}") == [float(value) for value in true]


@given(st.text(max_size=30))
def test_anything_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        told = [str(axis.place) for axis in read_axes([f"objects.ball.mass={text}"])]
    except InputError as error:
        told = list(map(str, error.problems))
    assert [len(line.splitlines()) for line in told] == [1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["objects.ball.mass"], "objects.ball.mass: has no =; write KEY=VALUES, in quotes if it"),
        (["=1,2"], "=1,2: has no key; write e.g. objects.ball.mass=100,200"),
        (["a..b=1,2"], 'a..b=1,2: "a..b" is not a dotted key; write e.g. objects.ball.mass=100,200'),
        (
            ["a.b=1:2"],
            "a.b=1:2: is not start:end:count; write e.g. 0.1:0.9:5, or 1:1000:4:log; text goes in quotes",
        ),
        (
            ["a.b=1:2:1"],
            "a.b=1:2:1: has no count from 2 to 100,000 after its ends; write e.g. 0.1:0.9:5, or",
        ),
        (
            ["a.b=0:2:5:log"],
            "a.b=0:2:5:log: has no logarithm: an end is 0, or 0 is between the ends; take both above 0, or both below",
        ),
        (["a.b=1,,2"], "a.b=1,,2: is not YAML with commas between the values; close brackets and quotes"),
        (["a.b=red #2, blue"], "a.b=red #2, blue: has # after a space, which begins a comment; put text with"),
        (["a.b=1,2,1"], "a.b=1,2,1: has 1 twice; keep one"),
        (
            ["a.b=[1,2"],
            "a.b=[1,2: is not YAML with commas between the values; close brackets and quotes, and put text",
        ),
        (
            ["a.b=uniform(1,2)"],
            "a.b=uniform(1,2): is plain text; a distribution begins with ~: a.b=~uniform(1,2)",
        ),
        (
            ["a.b=~unifrom(1,2)"],
            "a.b=~unifrom(1,2): is not a known distribution; did you mean ~uniform(0.2, 0.9)?",
        ),
        (
            ["a.b=~uniform(2,1)"],
            "a.b=~uniform(2,1): goes down, or nowhere; write e.g. ~uniform(0.2, 0.9)",
        ),
        (
            ["a.b=~normal(1,2,0,9)"],
            "a.b=~normal(1,2,0,9): does not hold a mean and a standard deviation; write e.g. ~normal(200, 15)",
        ),
        (["a.b=~each uniform(1,2)"], "a.b=~each uniform(1,2): is not a known distribution; write ~uniform(0.2, 0.9), "),
        (
            ["a.b=~normal(1,-1)"],
            "a.b=~normal(1,-1): has a standard deviation of -1; write e.g. ~normal(200, 15)",
        ),
        (["a.b=~choice(1)"], "a.b=~choice(1): has not two values to choose from; write e.g. ~choice(disc, hoop)"),
        (
            ["a.b=1,~uniform(0,1)"],
            "a.b=1,~uniform(0,1): mixes values and a distribution; write the distribution alone, or ~choice(...)",
        ),
        (
            ["a.b=1", "a.b=2"],
            "a.b=2: replaces all of a.b=1; keep one; several values go into one argument: a.b=VALUE,VALUE",
        ),
        (
            ["a.v.0=1,2", "a.v=[1,2],[3,4]"],
            "a.v=[1,2],[3,4]: replaces all of a.v.0=1,2; keep one; several values go into one argument",
        ),
        (
            ["a.b=~uniform(0,1)"],
            "a.b=~uniform(0,1): is a distribution without a number of draws; add e.g. --samples 100",
        ),
        ([], "sweep: has no keys to vary; write e.g. objects.ball.mass=100:900:9, or --variant all"),
        (
            ["a.b=1:9:4000", "a.c=1:9:4000"],
            "sweep: 4,000 x 4,000 are 16,000,000 clips; make at most 10,000,000; draws "
            "(KEY=~uniform(a, b) --samples N) cover many keys with few",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_the_way_out(
    arguments: list[str], message: str
) -> None:
    [told] = said(*arguments)
    assert told.startswith(message)


def test_flags_of_draws_without_draws_are_told() -> None:
    told = said("a.b=1,2", samples=10, seed=1)
    assert [line.partition(":")[0] for line in told] == ["--samples", "--seed"]
    assert all("has nothing to draw" in line for line in told)


def test_every_wrong_argument_is_told_at_once() -> None:
    assert len(said("a.b=1:2", "c.d=", "e.f=~what(1)", "g.h=1,2")) == 3


def test_a_grid_is_the_product_of_its_axes_in_order() -> None:
    sweep = plan_clips(read_axes(["a=1,2,3", "b=x,y", "c=0:1:4"]), (None, "other"))
    true = itertools.product((None, "other"), (1, 2, 3), "xy", (0, 1 / 3, 2 / 3, 1))
    assert [(p.variant, *(value.data for value in p.values)) for p in sweep] == list(
        true
    )
    assert [point.number for point in sweep] == list(range(48))
    assert len(sweep) == 48
    for bad in (-1, 48):
        with pytest.raises(IndexError):
            sweep[bad]


def test_overrides_say_exactly_the_value() -> None:
    sweep = plan_clips(
        read_axes(["a=0:1:7", "b=~normal(0, 1)", "c=~loguniform(1e-9, 1e9)"]),
        samples=40,
    )
    for point in sweep:
        for text, value in zip(point.overrides, point.values, strict=True):
            assert yaml.safe_load(text.partition("=")[2]) in (value.data, value.text)
            assert math.isclose(float(text.partition("=")[2]), value.data, rel_tol=0)
