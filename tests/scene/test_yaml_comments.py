"""Comments belong to entries: they go with the one that is removed, others stay."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.edit.operations import apply_operations
from physgen.scene.yaml_comments import without_comments
from physgen.scene.yaml_edit import is_json, mark_values

NAMES = ("ball", "crate", "cup")
SHAPE = "{circle: {center: [20, 20], radius: 5}}"
HEAD = "# about the file\nphysgen: 1\nsize: [100, 100]\n"
TAIL = "# about forces\nforces: []\n"


def block(*parts: str) -> str:
    return HEAD + "".join(parts) + TAIL


# entries of an object with their own comments, and lines between objects that stay
LAYOUTS = {
    "above": (
        block(
            "# all\nobjects:  # section\n",
            *(
                f"  # {n} one\n  # {n} two\n  {n}:  # {n} three\n    shape: {SHAPE}\n"
                for n in NAMES
            ),
        )
    ),
    "inside": (
        block(
            "objects:\n",
            *(
                f"  {n}:\n    # {n} one\n    shape: {SHAPE}  # {n} two\n    # {n} three\n"
                for n in NAMES
            ),
        )
    ),
    "blank lines": (
        block(
            "objects:\n  # keep: the section\n\n",
            *(
                f"  # {n} one\n  {n}: {{shape: {SHAPE}}}  # {n} two\n\n  # keep: after {n}\n\n"
                for n in NAMES
            ),
        )
    ),
    "deep after a blank line": (
        block(
            "objects:\n",
            *(
                f"  {n}:\n    shape: {SHAPE}\n\n    # {n} one\n      # {n} two\n"
                for n in NAMES
            ),
            "  # keep: end of the section\n",
        )
    ),
    "four spaces": (
        block(
            "objects:   # keep: section\n",
            *(
                f"    # {n} one\n    '{n}':\n          # {n} two\n          shape: {SHAPE}\n"
                for n in NAMES
            ),
        )
    ),
    "shallower": (
        block(
            "objects:\n",
            *(
                f"# keep: left of {n}\n  {n}: {{shape: {SHAPE}}}  # {n} one\n"
                for n in NAMES
            ),
        )
    ),
    "brackets": (
        block(
            "objects: {  # keep: section\n",
            *(f"  # {n} one\n  {n}: {{shape: {SHAPE}}},  # {n} two\n\n" for n in NAMES),
            "  # keep: end\n  }\n",
        )
    ),
    "brackets without the last comma": (
        block(
            "objects: {\n",
            ",\n".join(f'  # {n} one\n  "{n}": {{shape: {SHAPE}}}' for n in NAMES),
            "  # cup two\n  }\n",
        )
    ),
}


def comments_of(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("layout", LAYOUTS)
def test_removed_object_takes_its_comments_alone(
    layout: str, name: str, end: str
) -> None:
    text = LAYOUTS[layout]
    new = apply_operations(
        text.replace("\n", end), [{"remove": ["objects", name]}]
    ).text
    expected = [one for one in comments_of(text) if not one.startswith(f"{name} ")]
    assert comments_of(new) == expected
    assert [*mark_values(new).data()["objects"]] == [
        one for one in NAMES if one != name
    ]
    before = set(text.splitlines())
    assert [line for line in new.splitlines() if line not in before] == []


@pytest.mark.parametrize("layout", [key for key in LAYOUTS if "brackets" not in key])
def test_only_object_leaves_comments_of_section(layout: str) -> None:
    text = LAYOUTS[layout]
    new = apply_operations(text, [{"remove": ["objects", name]} for name in NAMES]).text
    kept = [one for one in comments_of(text) if not one.startswith(NAMES)]
    assert comments_of(new) == kept
    assert mark_values(new).data()["objects"] == {}


def test_removed_item_takes_its_comments_alone() -> None:
    text = block(
        "objects:\n", *(f"  {name}: {{shape: {SHAPE}}}\n" for name in NAMES)
    ).replace(
        "forces: []\n",
        "forces:\n  # of ball\n  - object: ball\n    # ball deeper\n    impulse: [1, 2]\n"
        "  # of cup\n  - {object: cup, impulse: [1, 2]}  # cup, too\n",
    )
    without_ball = apply_operations(text, [{"remove": ["objects", "ball"]}]).text
    without_cup = apply_operations(text, [{"remove": ["objects", "cup"]}]).text
    top = ["about the file", "about forces"]
    assert comments_of(without_ball) == [*top, "of cup", "cup, too"]
    assert comments_of(without_cup) == [*top, "of ball", "ball deeper"]


# Comments of perception

PERCEIVED = """\
physgen: 1
size: [100, 100]
objects:  # 2 x ball, 1 x cup, found by learned, counted from left to right
  ball-1:
    label: ball  # shape 0.8
    shape: {circle: {center: [20, 20], radius: 5}}
    layer: 1  # in front: it hides parts of ball-2 and cup-1
  # mine: under 3 objects
  ball-2: {label: ball, shape: {circle: {center: [50, 20], radius: 5}}}
  cup-1: {label: cup, shape: {circle: {center: [80, 20], radius: 5}}}
boundaries:
  floor: {segment: [[0, 90], [100, 90]]}  # under 3 objects
  wall: {segment: [[0, 90], [0, 0]]}  # mine, of 3 objects
"""
COUNT = "found by learned, counted from left to right"
HIDES = "in front: it hides parts of"


@pytest.mark.parametrize(
    ("op", "expected"),
    [
        (
            {"remove": ["objects", "ball-2"]},
            [f"1 x ball, 1 x cup, {COUNT}", "shape 0.8", f"{HIDES} cup-1", "mine, of 3 objects"],
        ),
        (
            {"remove": ["objects", "ball-1"]},
            [f"1 x ball, 1 x cup, {COUNT}", "mine: under 3 objects", "mine, of 3 objects"],
        ),
        (
            {"rename": ["objects", "cup-1"], "to": "mug"},
            [
                f"2 x ball, 1 x cup, {COUNT}",
                "shape 0.8",
                f"{HIDES} ball-2 and mug",
                "mine: under 3 objects",
                "under 3 objects",
                "mine, of 3 objects",
            ],
        ),
        (
            {"set": ["objects", "cup-1", "label"], "value": "ball"},
            [
                f"3 x ball, {COUNT}",
                "shape 0.8",
                f"{HIDES} ball-2 and cup-1",
                "mine: under 3 objects",
                "under 3 objects",
                "mine, of 3 objects",
            ],
        ),
    ],
)  # fmt: skip
def test_comments_of_perception_stay_true(
    op: dict[str, Any], expected: list[str]
) -> None:
    assert comments_of(apply_operations(PERCEIVED, [op]).text) == expected


def test_comments_that_a_user_continued_stay() -> None:
    text = PERCEIVED.replace("to right\n", "to right, and mine\n")
    text = text.replace("and cup-1\n", "and cup-1, and mine\n")
    text = text.replace("}  # under 3 objects\n", "}  # under 3 objects, and mine\n")
    new = apply_operations(text, [{"remove": ["objects", "ball-2"]}]).text
    own = [one for one in comments_of(text) if "and mine" in one]
    assert len(own) == 3
    assert [one for one in comments_of(new) if "and mine" in one] == own


def test_updated_comments_are_still_those_of_perception() -> None:
    text = apply_operations(
        PERCEIVED, [{"rename": ["objects", "cup-1"], "to": "mug"}]
    ).text
    text = without_comments(text, [("objects", "ball-1", "layer")], ())
    assert HIDES not in text
    assert "# mine: under 3 objects" in text


# JSON

NAME = st.from_regex(r"[a-z][a-z0-9-]{0,8}", fullmatch=True)
LETTERS = st.sampled_from(list("aZ09 é#:,{}[]\"\\'-é漢"))
JSON_SHAPE = {"circle": {"center": [20, 20], "radius": 5}}


@st.composite
def json_scenes(draw: st.DrawFn) -> tuple[str, list[str]]:
    """The text of a JSON file in some layout, and the names of its objects."""
    names = draw(st.lists(NAME, min_size=1, max_size=5, unique=True))
    objects = {
        name: {"label": draw(st.text(LETTERS, max_size=5)), "shape": JSON_SHAPE}
        for name in names
    }
    forces = [{"object": name, "impulse": [1.5, -2e6]} for name in names[::2]]
    data = {"physgen": 1, "size": [100, 100], "objects": objects, "forces": forces}
    indent = draw(st.sampled_from([None, 1, 2, 4]))
    between = draw(st.sampled_from([None, (",", ":"), (" , ", " : ")]))
    ascii_only = draw(st.booleans())
    text = json.dumps(data, indent=indent, separators=between, ensure_ascii=ascii_only)
    return text + draw(st.sampled_from(["", "\n"])), names


@settings(max_examples=150)
@given(json_scenes(), st.data())
def test_json_stays_json(scene: tuple[str, list[str]], draw: st.DataObject) -> None:
    text, names = scene
    name = draw.draw(st.sampled_from(names))
    remove = draw.draw(st.booleans())
    expected = json.loads(text)
    if remove:
        op: dict[str, Any] = {"remove": ["objects", name]}
        del expected["objects"][name]
        expected["forces"] = [f for f in expected["forces"] if f["object"] != name]
    else:
        op = {"rename": ["objects", name], "to": "a-new-name"}
        expected["objects"] = {
            "a-new-name" if key == name else key: item
            for key, item in expected["objects"].items()
        }
        for force in expected["forces"]:
            if force["object"] == name:
                force["object"] = "a-new-name"
    new = apply_operations(text, [op]).text
    assert is_json(new)
    assert json.loads(new) == expected
    if text.count("\n") < 2:
        return
    lines = {bare(line) for line in text.splitlines()}
    fresh = {bare(line) for line in new.splitlines()} - lines
    if remove:
        assert fresh <= {'"objects":{}', '"forces":[]'}
    else:
        assert all("a-new-name" in line for line in fresh)


def bare(line: str) -> str:
    """A line without spaces, and without the comma that ends it."""
    return line.replace(" ", "").rstrip(",")
