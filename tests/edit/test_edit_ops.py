"""Edits of a file's text: what is meant is what is read back, by another way, and all other lines stay as they were."""

from __future__ import annotations

import re
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physgen.edit.operations import apply_operations
from physgen.problems import EditError
from physgen.scene import yaml_edit
from physgen.scene.document import Node, Source, read, to_plain_data
from physgen.scene.load import OpenedScene
from physgen.scene.overlay import Edit, apply, edits_of_variant, variants_of
from physgen.scene.yaml_edit import are_equal, mark_values
from physgen.text import dotted

ROOT = Path(__file__).parents[2]
BUNDLED = [*sorted((ROOT / "scenes").rglob("*.yaml")), ROOT / "tests/scene/full.yaml"]
TEXTS = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in BUNDLED
}
HERE = Source("scene.yaml", Path())


def tree(text: str) -> Node:
    return read(text, HERE)


def data(text: str) -> Any:
    return to_plain_data(tree(text))


def made(text: str, *ops: dict[str, Any], variant: str | None = None) -> str:
    return apply_operations(text, ops, variant).text


def paths(node: Node, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Of every value."""
    found = [path] if path else []
    if isinstance(node.value, dict):
        for key, child in node.value.items():
            found += paths(child, (*path, key))
    elif isinstance(node.value, list):
        for at, child in enumerate(node.value):
            found += paths(child, (*path, at))
    return found


def at(node: Node, path: tuple[str | int, ...]) -> Node:
    for key in path:
        node = node.value[key]  # type: ignore[index]
    return node


def last_line(node: Node) -> int:
    value = node.value
    below = (
        value.values()
        if isinstance(value, dict)
        else value
        if isinstance(value, list)
        else ()
    )
    return max([node.line, *map(last_line, below)])


def span(root: Node, path: tuple[str | int, ...]) -> tuple[int, int]:
    """First and last line of a value with its key, or with all between it and the item before it, from 1."""
    node = at(root, path)
    if node.key is not None:
        return node.key[0], last_line(node)
    siblings, k = at(root, path[:-1]).value, path[-1]
    before = last_line(siblings[k - 1]) + 1 if k else at(root, path[:-1]).line  # type: ignore[index, operator]
    return min(before, node.line), last_line(node)


def owned(text: str, first: int, last: int) -> tuple[int, int]:
    """First and last line of an entry with the comments that belong to it, from 1."""
    lines = text.splitlines()
    column = len(lines[first - 1]) - len(lines[first - 1].lstrip())
    own = " " * column + "#"
    top = first
    while top > 1 and lines[top - 2].startswith(own):
        top -= 1
    first = first if top == 1 else top  # at the top of the file: about the file
    for number, line in enumerate(lines[last:], last + 1):
        if line.strip().startswith("#") and line.startswith(" " * (column + 1)):
            last = number
        elif line.strip():
            break
    return first, last


def changed(old: str, new: str) -> tuple[int, int, int]:
    """Lines that stay at the beginning, lines that go behind them, lines that come."""
    a, b = old.splitlines(keepends=True), new.splitlines(keepends=True)
    head = 0
    while head < min(len(a), len(b)) and a[head] == b[head]:
        head += 1
    tail = 0
    while tail < min(len(a), len(b)) - head and a[-1 - tail] == b[-1 - tail]:
        tail += 1
    return head, len(a) - head - tail, len(b) - head - tail


VALUES = st.recursive(
    st.one_of(
        st.integers(-(10**7), 10**7),
        st.floats(-1e6, 1e6).map(lambda x: float(f"{x:.5g}")),
        st.booleans(),
        st.sampled_from(
            [
                "red ball",
                "on",
                "1.5",
                "null",
                "a: b",
                "# none",
                "",
                " x ",
                "ü",
                "- a",
                "{",
                "'",
                '"',
                "\n",
            ]
        ),
    ),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["a", "b", "on", "1", "c d", "k:"]), inner, max_size=3
        )
    ),
    max_leaves=5,
)


# Bundled scenes, against the loader's own overlays


@given(st.data())
def test_an_edit_is_what_an_overlay_makes_of_it_and_touches_its_lines_alone(
    draw,
) -> None:
    """Set, or, where the value is None, taken away."""
    text = TEXTS[draw.draw(st.sampled_from(sorted(TEXTS)))].replace(
        "\n", draw.draw(st.sampled_from(["\n", "\r\n"]))
    )
    root = tree(text)
    path = draw.draw(
        st.sampled_from([p for p in paths(root) if p[0] not in ("variants", "extends")])
    )
    value = draw.draw(st.none() | VALUES if isinstance(path[-1], str) else VALUES)
    new = made(
        text,
        {"unset": list(path)} if value is None else {"set": list(path), "value": value},
    )
    assert data(new) == to_plain_data(
        apply(root, Edit(dotted(path), tree_of(value), ()))
    )
    alone = value is None and len(at(root, path[:-1]).value) == 1  # type: ignore[arg-type]
    first, last = span(root, path[:-1] if alone else path)
    if value is None:
        first, last = owned(text, first, last)
        last += 1  # one of two blank lines goes, too
    head, gone, _ = changed(text, new)
    assert first - 1 <= head
    assert head + gone <= last


def tree_of(value: Any) -> Node:
    if isinstance(value, dict):
        return Node({key: tree_of(child) for key, child in value.items()}, HERE)
    if isinstance(value, list):
        return Node([tree_of(child) for child in value], HERE)
    return Node(value, HERE)


# Any YAML: every style there is, a comment behind and above many lines

STYLES = """\
# above 1
a: {b: 1, "c": [1, 2,3 ], 'd': {}}  # behind 1
b:
  - x  # behind 2
  # above 2
  - "red ball"
  - - 1
    - [true, null]  # behind 3

  - c: 1
    # above 3
    d:  # behind 4
        e: 'x: y'
  -
    - ~
c: {  # behind 5
   a: 1,  # behind 6

   b: [on,
     "#"],  # behind 7
   c: {d: ""}
   }  # behind 8
'd': >-
   a text of words
"e":    # behind 9
f: |-  # behind 10
    red ball
g: [[1, 2],  # behind 11
    [3, 4]]
h: -7  # behind 12
# above 4
"""
NESTED = """\

a:
   b:  # behind 1
   - 1
   - {a: [1], b: ~}  # behind 2
   c: "x"
   d: {}
b: []  # behind 3
# end
"""
SMALL = st.recursive(
    st.one_of(
        st.integers(-99, 99),
        st.booleans(),
        st.none(),
        st.sampled_from(["a", "red ball", "on", "x: y", "#", ""]),
    ),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from("abcdefgh"), inner, max_size=4)
    ),
    max_leaves=12,
)


def reached(whole: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        whole = whole[key]
    return whole


def said(text: str) -> set[str]:
    """Its comments."""
    return set(re.findall(r"# (?:behind|above) \d+", text))


@settings(max_examples=100)
@given(st.sampled_from([STYLES, NESTED]), st.sampled_from(["\n", "\r\n"]), st.data())
def test_every_style_of_yaml_takes_every_change(text, end, draw) -> None:
    text = text.replace("\n", end)
    root, whole = tree(text), data(text)
    path = draw.draw(st.sampled_from(paths(root)))
    above = reached(whole, path[:-1])
    kind = draw.draw(st.sampled_from(["put", "drop", "add"]))
    want = deepcopy(whole)
    first, last = span(root, path)
    if kind == "put":
        value = draw.draw(SMALL)
        reached(want, path[:-1])[path[-1]] = value
        new = yaml_edit.put(text, path, value)
    elif kind == "drop":
        if isinstance(above, list) and above.count(above[int(path[-1])]) > 1:
            return  # any of them may go
        del reached(want, path[:-1])[path[-1]]
        new = yaml_edit.put(text, path[:-1], reached(want, path[:-1]))
        if len(above) == 1 and len(path) > 1:
            first, last = span(root, path[:-1])
        first, last = owned(text, first, last)
    else:
        value = draw.draw(SMALL)
        holder = reached(want, path)
        if isinstance(holder, list):
            holder.append(value)
            new = yaml_edit.put(text, (*path, len(holder) - 1), value)
        elif isinstance(holder, dict) or holder is None:
            if holder is None:
                reached(want, path[:-1])[path[-1]] = holder = {}
            holder["new"] = value
            new = yaml_edit.put(text, (*path, "new"), value)
        else:
            return
    assert are_equal(data(new), want)
    head, _, _ = changed(text, new)
    kept = (
        text.splitlines()[: first - 1]
        + text.splitlines()[last_of(text, root, path, last) :]
    )
    assert said("\n".join(kept)) <= said(new)
    assert new.startswith(
        "".join(text.splitlines(keepends=True)[: min(head, first - 1)])
    )
    if "\r\n" in text:
        assert "\n" not in new.replace("\r\n", "")


def last_of(text: str, root: Node, path: tuple[str | int, ...], last: int) -> int:
    """The line in which brackets that were opened are closed, too."""
    end = mark_values(text)
    for key in path[:-1]:
        end = end.child(key)  # type: ignore[assignment]
    child = end.child(path[-1])
    assert child is not None
    return max(
        last,
        text.count("\n", 0, max(child.end, end.end if len(end.children) == 1 else 0))
        + 1,
    )


def test_a_first_key_behind_a_dash_goes_and_the_comment_below_it_stays() -> None:
    text = 'a:\n  - a: "a"\n    # above b\n    b: 1\n'
    new = yaml_edit.put(text, ("a", 0), {"b": 1})
    assert data(new) == {"a": [{"b": 1}]}
    assert "    # above b\n    b: 1\n" in new


def test_the_comment_of_an_entry_goes_with_the_last_one() -> None:
    text = "a:\n  b: {x: 1}  # of b\n  c: {x: 2}  # of c\nd: 1  # of d\n"
    assert yaml_edit.put(text, ("a",), {}) == "a: {}\nd: 1  # of d\n"


# Scenes, word for word

SCENE = """\
physgen: 1
size: [512, 384]   # no photo
world: {view: top,
        pixels_per_meter: 200}  # a table
objects:
  ball:
    # seen from above
    shape: {circle: {center: [470.5, 257.0], radius: 30.2}}  # measured
    mass: 170    # g


  'crate':
      shape: {box: {center: [120, 200], size: [24, 120]}}
      density: 2.5
forces: []
"""


@pytest.mark.parametrize(
    ("op", "old", "new"),
    [
        ({"set": ["objects", "ball", "mass"], "value": 171.0}, "mass: 170    # g", "mass: 171    # g"),
        ({"set": ["world", "view"], "value": "side"}, "view: top", "view: side"),
        (
            {"set": ["objects", "ball", "shape", "circle", "center"], "value": [412.5000000000001, -30]},
            "[470.5, 257.0]",
            "[412.5, -30]",
        ),
        (
            {"set": ["objects", "ball", "velocity"], "value": [3, 4]},
            "    mass: 170    # g\n",
            "    mass: 170    # g\n    velocity: [3, 4]\n",
        ),
        (
            {"set": ["objects", "crate", "mass"], "value": 50},
            "      density: 2.5\n",
            "      mass: 50\n",
        ),
        (
            {"add": ["forces"], "value": {"object": "ball", "impulse": [-1000000, 0]}},
            "forces: []\n",
            "forces:\n  - {object: ball, impulse: [-1.0e6, 0]}\n",
        ),
        ({"set": ["world", "duration"], "value": 1.5}, "_meter: 200}", "_meter: 200,\n        duration: 1.5}"),
        (
            {"set": ["light", "direction"], "value": [0, 0, 1]},
            "forces: []\n",
            "forces: []\nlight: {direction: [0, 0, 1]}\n",
        ),
        (
            {"add": ["boundaries", "floor"], "value": {"segment": [[0, 300], [512, 300]]}},
            "      density: 2.5\n",
            "      density: 2.5\nboundaries:\n  floor: {segment: [[0, 300], [512, 300]]}\n",
        ),
        ({"set": ["objects", "ball", "label"], "value": "on"}, "    # seen", "    # seen"),
        ({"unset": ["objects", "ball", "mass"]}, "    mass: 170    # g\n", ""),
        ({"rename": ["objects", "crate"], "to": "box"}, "'crate'", "'box'"),
        ({"unset": ["objects", "ball", "spin"]}, "", ""),
    ],
)  # fmt: skip
def test_what_is_written_reads_as_a_person_writes(op, old, new) -> None:
    expected = SCENE.replace(old, new, 1) if old else SCENE
    if op.get("value") == "on":
        expected = SCENE.replace(
            "    mass: 170    # g\n", "    mass: 170    # g\n    label: on\n"
        )
        assert data(made(SCENE, op))["objects"]["ball"]["label"] == "on"
        return
    assert made(SCENE, op) == expected


def test_a_key_goes_where_the_schema_has_it() -> None:
    text = "objects:\n  ball:\n    mask: 1\n    velocity: [1, 2]\n    layer: 2\nlight: {direction: [0, 0, 1]}\n"
    new = made(
        text,
        {"set": ["objects", "ball", "friction"], "value": 0.5},
        {"set": ["forces"], "value": [{"object": "a"}]},
    )
    assert new.index("mask") < new.index("friction") < new.index("velocity")
    assert new.index("layer") < new.index("forces") < new.index("light")


FULL = TEXTS["tests/scene/full.yaml"].replace(
    "  hard: {objects.ball.velocity: [-900, 0]}",
    "  hard: {objects.ball.velocity: [-900, 0], 'forces[2].force': [0, 1], 'forces[0].start': 1}  # a break\n"
    "  soft:\n    objects.kite.friction: 0.2\n    objects.*.rolling: 0.3",
)


def loads(text: str, tmp_path: Path) -> OpenedScene:
    """A scene that is right, variants and all."""
    opened = OpenedScene(tmp_path / "scene.yaml", text=text)
    for variant in (None, *opened.variants):
        opened.scene((), variant)
    return opened


@pytest.mark.parametrize("name", ["ball", "crate", "ring", "blob", "kite"])
def test_an_object_goes_with_all_that_names_it(name, tmp_path) -> None:
    new = made(FULL, {"remove": ["objects", name]})
    assert (
        re.findall(
            rf"\b{name}\b(?! billiard)",
            re.sub(r'(label|title): .*|"a red ball, a photograph"', "", new),
        )
        == []
    )
    left = loads(new, tmp_path).scene()
    before = loads(FULL, tmp_path).scene()
    assert [item for item in before.objects if item.name != name] == list(left.objects)
    assert left.forces == tuple(
        force for force in before.forces if force.object != name
    )
    assert left.joints == tuple(
        joint for joint in before.joints if name not in joint.objects
    )


def test_edits_of_variants_that_count_forces_go_with_a_force_and_are_named() -> None:
    op = {"remove": ["forces", 1]}
    new = data(made(FULL, op))
    assert [force["object"] for force in new["forces"]] == ["ball", "kite"]
    assert set(new["variants"]["hard"]) == {"objects.ball.velocity"}
    assert "forces[2].force of hard" in apply_operations(FULL, [op]).title
    gone = data(made(FULL, {"remove": ["objects", "kite"]}))
    assert set(gone["variants"]["hard"]) == {"objects.ball.velocity"}
    assert set(gone["variants"]["soft"]) == {"objects.*.rolling"}


@pytest.mark.parametrize("name", ["ball", "crate", "kite"])
def test_a_new_name_is_used_everywhere(name, tmp_path) -> None:
    new = made(FULL, {"rename": ["objects", name], "to": "puck"})
    one, other = loads(FULL, tmp_path), loads(new, tmp_path)
    for variant in (None, "hard", "soft"):
        was, now = one.scene((), variant), other.scene((), variant)
        called = {item.name: item for item in now.objects}
        for item in was.objects:
            twin = called["puck" if item.name == name else item.name]
            assert (twin.shape, twin.velocity, twin.rolling) == (
                item.shape,
                item.velocity,
                item.rolling,
            )
        assert [f.object for f in now.forces] == [
            "puck" if f.object == name else f.object for f in was.forces
        ]
    assert changed(FULL, new)[1] == changed(FULL, new)[2]  # no line came or went


@pytest.mark.parametrize("to", ["ball", "2fast", "a b", "", "x" * 65, 3, None, "a.b"])
def test_a_name_that_is_none_or_taken_is_refused(to) -> None:
    with pytest.raises(EditError) as error:
        made(FULL, {"rename": ["objects", "crate"], "to": to})
    assert error.value.fix


# Variants


@settings(max_examples=20)
@given(st.data())
def test_a_variant_says_what_the_file_does_not(draw) -> None:
    root = tree(FULL)
    variant = draw.draw(st.sampled_from(["hard", "soft"]))
    seen = root
    for edit in edits_of_variant(dict(variants_of(root))[variant], variant):
        seen = apply(seen, edit)
    path = draw.draw(
        st.sampled_from(
            [path for path in paths(seen) if path[0] not in ("variants", "extends")]
        )
    )
    value = draw.draw(VALUES)
    new = tree(made(FULL, {"set": list(path), "value": value}, variant=variant))
    of_new = new
    for edit in edits_of_variant(dict(variants_of(new))[variant], variant):
        of_new = apply(of_new, edit)
    want = to_plain_data(apply(seen, Edit(dotted(path), tree_of(value), ())))
    want.pop("variants")
    got = to_plain_data(of_new)
    got.pop("variants")
    assert got == want
    file = {
        key: value for key, value in to_plain_data(root).items() if key != "variants"
    }
    assert {
        key: value for key, value in to_plain_data(new).items() if key != "variants"
    } == file


def test_a_variant_takes_an_object_away_and_keeps_the_file(tmp_path) -> None:
    new = made(FULL, {"remove": ["objects", "ball"]}, variant="soft")
    opened = loads(new, tmp_path)
    assert "ball" in {item.name for item in opened.scene().objects}
    soft = opened.scene((), "soft")
    assert "ball" not in {item.name for item in soft.objects}
    assert {force.object for force in soft.forces} == {"crate", "kite"}


@pytest.mark.parametrize(
    ("variant", "op"),
    [
        ("none", {"set": ["objects", "ball", "mass"], "value": 1}),
        ("hard", {"set": ["variants", "soft"], "value": {}}),
        ("hard", {"set": ["extends"], "value": "a.yaml"}),
        ("hard", {"set": ["objects", "a.b", "mass"], "value": 1}),
        ("hard", {"set": ["objects", "*", "mass"], "value": 1}),
        ("hard", {"rename": ["objects", "ball"], "to": "puck"}),
    ],
)
def test_what_a_variant_cannot_say_is_refused_with_a_way_out(variant, op) -> None:
    with pytest.raises(EditError) as error:
        made(FULL, op, variant=variant)
    assert error.value.why.value == 422
    assert error.value.fix


# What is refused


@pytest.mark.parametrize(
    "op",
    [
        {},
        {"set": ["a"]},
        {"set": ["a"], "value": 1, "unset": ["b"]},
        {"set": [], "value": 1},
        {"set": "a", "value": 1},
        {"set": [True], "value": 1},
        {"set": [-1], "value": 1},
        {"set": ["a", None], "value": 1},
        {"set": ["objects", "ball", "mass", "x"], "value": 1},
        {"set": ["objects", 3], "value": 1},
        {"set": ["forces", 9, "object"], "value": "ball"},
        {"add": ["objects", "ball"], "value": {}},
        {"remove": ["objects", "nobody"]},
        {"remove": ["forces", 7]},
        {"rename": ["world", "view"], "to": "x"},
        {"set": ["x" * 1001], "value": 1},
        {"set": ["world", "x"], "value": 10**400},
        {"fly": ["a"]},
    ],
    ids=lambda op: str(op)[:60],
)
def test_an_operation_that_cannot_be_made_says_so(op) -> None:
    with pytest.raises(EditError) as error:
        made(FULL, op)
    assert error.value.why.value == 422
    assert error.value.message
    assert error.value.fix


@pytest.mark.parametrize(
    "text",
    [
        "a: [1",
        "a: 1\na: 2\n",
        "a: &x 1\nb: *x\n",
        "a: !!int 3\n",
        "- 1\n",
        "",
        "# none\n",
        "\t",
    ],
)
def test_a_text_that_is_no_scene_is_edited_as_text_alone(text) -> None:
    with pytest.raises(EditError, match="cannot be read"):
        made(text, {"set": ["a"], "value": 1})


def test_a_file_that_extends_another_is_edited_as_text_alone() -> None:
    with pytest.raises(EditError, match="extends another"):
        made(
            "extends: base.yaml\nphysgen: 1\n",
            {"set": ["objects", "ball", "mass"], "value": 1},
        )


def test_all_operations_or_none() -> None:
    with pytest.raises(EditError):
        made(
            SCENE,
            {"set": ["objects", "ball", "mass"], "value": 1},
            {"remove": ["objects", "nobody"]},
        )
