"""Text -> data, and the place of every value in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from physgen.problems import InputError, Limit
from physgen.scene.document import Node, Source, decode, read, to_plain_data

SOURCE = Source("scene.yaml", Path())


def tree(text: str) -> Node:
    return read(text, SOURCE)


def child(node: Node, *path: str | int) -> Node:
    for key in path:
        value: Any = node.value
        node = value[key]
    return node


TEXT = """\
# a comment
physgen: 1
world: {view: side,
        gravity: [0, 980]}
objects:
  ball:   # the only one
    label: "a ball: red"
    mass:
      170
  größe: {mass: 1}
forces:
  - object: ball
    impulse:
      - 1
      - 2.5
  - {object: ball, torque: 3}
"""


@pytest.mark.parametrize(
    ("path", "line", "column"),
    [
        ((), 2, 1),
        (("physgen",), 2, 10),
        (("world",), 3, 8),
        (("world", "view"), 3, 15),
        (("world", "gravity"), 4, 18),
        (("world", "gravity", 1), 4, 22),
        (("objects",), 6, 3),
        (("objects", "ball"), 7, 5),
        (("objects", "ball", "label"), 7, 12),
        (("objects", "ball", "mass"), 9, 7),
        (("objects", "größe"), 10, 10),
        (("objects", "größe", "mass"), 10, 17),
        (("forces",), 12, 3),
        (("forces", 0), 12, 5),
        (("forces", 0, "impulse", 1), 15, 9),
        (("forces", 1, "torque"), 16, 28),
    ],
)
def test_places(path: tuple[str | int, ...], line: int, column: int) -> None:
    node = child(tree(TEXT), *path)
    assert node.place == ("scene.yaml", line, column)


def test_places_of_keys() -> None:
    assert child(tree(TEXT), "objects", "ball", "mass").key_place == (
        "scene.yaml",
        8,
        5,
    )
    assert child(tree(TEXT), "world", "gravity").key_place == ("scene.yaml", 4, 9)


def test_quoted_text_is_text() -> None:
    assert to_plain_data(tree("a: '8'\nb: \"true\"\nc: |\n  1\nd: ''\n")) == {
        "a": "8",
        "b": "true",
        "c": "1\n",
        "d": "",
    }


def test_keys_are_text() -> None:
    assert list(to_plain_data(tree("8: a\ntrue: b\n~: c\n"))) == ["8", "true", "~"]


def test_a_byte_order_mark_is_no_text() -> None:
    text = decode(b"\xef\xbb\xbfphysgen: 1\n", "scene.yaml")
    assert tree(text).place.column == 1
    assert to_plain_data(tree(text)) == {"physgen": 1}


@pytest.mark.slow
def test_the_limits_themselves_are_allowed() -> None:
    assert to_plain_data(
        tree("a: " + "[" * (Limit.DEPTH.most - 1) + "]" * (Limit.DEPTH.most - 1))
    )
    assert (
        len(to_plain_data(tree("a: [" + "0," * (Limit.VALUES.most - 3) + "]"))["a"])
        == Limit.VALUES.most - 3
    )


def test_anything_as_the_value_of_a_flag() -> None:
    source = Source("--set a=1", Path())
    for text, value in (
        ("", None),
        ("3", 3),
        ("[1, {b: 2}]", [1, {"b": 2}]),
        ("heavy", "heavy"),
        ("# x", None),
    ):
        node = read(text, source, has_lines=False)
        assert to_plain_data(node) == value
        assert node.place == ("--set a=1", 0, 0)


def test_pure_python_reads_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where PyYAML was built without libyaml."""
    fast = tree(TEXT)
    monkeypatch.setattr("physgen.scene.document.LOADER", yaml.SafeLoader)
    slow = tree(TEXT)
    assert to_plain_data(slow) == to_plain_data(fast)
    assert (
        child(slow, "forces", 0, "impulse", 1).place
        == child(fast, "forces", 0, "impulse", 1).place
    )
    for text in (
        "a: &b 1",
        "a: !!int 1",
        "a: [",
        "a: .nan",
        "a: 1\na: 2",
        "",
        "a: \x07",
    ):
        with pytest.raises(InputError) as caught:
            tree(text)
        assert len(caught.value.problems) == 1
