"""Our compiled schema against jsonschema, on scenes with faults put in anywhere."""

from __future__ import annotations

import contextlib
import copy
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from physgen.problems import InputError
from physgen.scene.document import Node, Source, read, to_plain_data
from physgen.scene.load import load
from physgen.scene.schema import load_published_schema
from physgen.scene.validate import Findings, TooManyError, check_schema

SOURCE = Source("scene.yaml", Path())
ORACLE = jsonschema.Draft202012Validator(load_published_schema())

FULL = Path(__file__).with_name("full.yaml").read_bytes()
SCENE: dict[str, Any] = to_plain_data(read(FULL.decode(), SOURCE)) | {
    "image": "photo.png"
}
SCENE["objects"]["kite"]["mask"] = 1
"""Every key that there is, and a mask of each kind."""

KEYS = [
    "physgen",
    "mass",
    "density",
    "shape",
    "circle",
    "polygon",
    "box",
    "path",
    "a",
    "object",
    "x",
    "8",
    "",
    "a b",
    "impulse",
    "objects",
    "weld",
    "spring",
    "stiffness",
    "wind",
    "mask",
]
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from(
        [
            0,
            1,
            2,
            -1,
            1.0,
            1.5,
            0.0,
            -0.0,
            1e5,
            65535,
            65536,
            1e12,
            1e13,
            10**40,
            -(10**40),
            1e300,
            3600.5,
        ]
    ),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from(
        [
            "",
            "auto",
            "none",
            "natural",
            "static",
            "side",
            "sphere",
            "a",
            "x" * 201,
            "x" * 1025,
            "1",
        ]
    ),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(KEYS), inner, max_size=3),
    ),
    max_leaves=6,
)


def nodes(value: Any) -> Node:
    if isinstance(value, dict):
        return Node(
            {key: nodes(item) for key, item in value.items()}, SOURCE, 1, 1, (1, 1)
        )
    if isinstance(value, list):
        return Node([nodes(item) for item in value], SOURCE, 1, 1)
    return Node(value, SOURCE, 1, 1)


def ours(document: Any) -> list[str]:
    report = Findings()
    with contextlib.suppress(TooManyError):
        check_schema(nodes(document), report)
    return [str(problem) for problem in report.problems]


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [path] + [
        place for key, item in inner for place in places(item, (*path, key))
    ]


PLACES = places(SCENE)


def test_the_scene_is_valid() -> None:
    ORACLE.validate(SCENE)
    assert ours(SCENE) == []


@st.composite
def mutated(draw: st.DrawFn) -> Any:
    """The scene with one to three values replaced, taken out, doubled or put in."""
    document = copy.deepcopy(SCENE)
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(PLACES))
        if not path:
            continue
        parent: Any = document
        try:
            for key in path[:-1]:
                parent = parent[key]
            parent[path[-1]]
        except (KeyError, IndexError, TypeError):
            continue
        if not isinstance(
            parent, dict | list
        ):  # a value that was put in: of a text, a letter
            continue
        how = draw(st.sampled_from(["replace", "remove", "add", "double"]))
        if how == "replace":
            parent[path[-1]] = draw(VALUES)
        elif how == "remove":
            del parent[path[-1]]
        elif how == "double" and isinstance(parent, list):
            parent.append(copy.deepcopy(parent[path[-1]]))
        elif isinstance(parent, list):
            parent.insert(0, draw(VALUES))
        else:
            parent[draw(st.sampled_from(KEYS))] = draw(VALUES)
    return document


@pytest.mark.slow
@settings(max_examples=150)
@given(mutated())
def test_we_agree_with_jsonschema(document: Any) -> None:
    assert (ours(document) == []) == ORACLE.is_valid(document)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


def outcome(path: Path) -> str:
    """What becomes of a file: a scene or messages, never another error."""
    try:
        load(path)
    except InputError as error:
        return str(error)
    return "a scene"


@settings(max_examples=100)
@given(
    edits=st.lists(
        st.tuples(
            st.integers(0, len(FULL)),
            st.integers(0, 12),
            st.one_of(
                st.binary(max_size=3),
                st.sampled_from(
                    [
                        b"[",
                        b"}",
                        b": ",
                        b"- ",
                        b"\n",
                        b"&a ",
                        b"*a",
                        b"!!x ",
                        b"'",
                        b"#",
                    ]
                ),
            ),
        ),
        min_size=1,
        max_size=4,
    )
)
@example(edits=[])
def test_a_scene_or_messages_for_any_bytes(
    edits: list[tuple[int, int, bytes]], folder: Path
) -> None:
    data = FULL
    for at, gone, put in edits:
        data = data[:at] + put + data[at + gone :]
    (folder / "bytes.yaml").write_bytes(data)
    found = outcome(folder / "bytes.yaml")
    assert edits or found == "a scene"


@pytest.mark.slow
def test_every_value_replaced_by_every_kind() -> None:
    """No message is cut short by an error of ours, and each says what to write."""
    for path in PLACES[1:]:
        for value in (None, "no such word", -1e30, [[]], {"x": 1}):
            document = copy.deepcopy(SCENE)
            parent: Any = document
            for key in path[:-1]:
                parent = parent[key]
            parent[path[-1]] = value
            messages = ours(document)
            assert (messages == []) == ORACLE.is_valid(document), (path, value)
            assert all("; " in message for message in messages)
