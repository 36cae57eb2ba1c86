"""The schema itself: whole, true to its own examples, and told in docs/scene.md."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from scene_reference import EXAMPLE, markdown

from physgen.problems import InputError
from physgen.scene.load import load
from physgen.scene.schema import (
    load_expanded_schema,
    load_published_schema,
    with_defaults,
)

ROOT = Path(__file__).parents[2]


def properties(
    schema: dict[str, Any], path: str = ""
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every property, with its path; what is in a list is in []."""
    for key, part in schema.get("properties", {}).items():
        yield f"{path}.{key}".lstrip("."), part
        yield from properties(part, f"{path}.{key}")
    for key, end in (
        ("additionalProperties", ".*"),
        ("items", "[]"),
        ("propertyNames", ".name"),
    ):
        if isinstance(schema.get(key), dict):
            yield f"{path}{end}".lstrip("."), schema[key]
            yield from properties(schema[key], path + end)


ALL = dict(properties(load_expanded_schema()))


def test_it_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(load_published_schema())
    jsonschema.Draft202012Validator.check_schema(load_expanded_schema())


@pytest.mark.parametrize(
    "path", [path for path in ALL if not path.endswith(("[]", "*"))]
)
def test_every_key_is_told_and_shown(path: str) -> None:
    part = ALL[path]
    assert part["description"].endswith(".")
    assert part["examples"]


@pytest.mark.parametrize("path", ALL)
def test_examples_and_defaults_are_valid(path: str) -> None:
    part = ALL[path]
    check = jsonschema.Draft202012Validator(part)
    for value in [
        *part.get("examples", []),
        *([part["default"]] if "default" in part else []),
    ]:
        check.validate(value)


def test_numbers_have_bounds() -> None:
    """No number of a file can grow past what a float or an index holds."""
    for path, part in ALL.items():
        if part.get("type") in ("number", "integer"):
            assert "maximum" in part, path
            assert "minimum" in part or "exclusiveMinimum" in part, path


def test_units_are_known() -> None:
    units = {part["x-unit"] for part in ALL.values() if "x-unit" in part}
    words = "px px/m px/s px/s² px³/s² s 1/s g g/s g/s² g/px² g·px/s g·px/s² g·px²/s² degrees degrees/s "
    words += "g·px² g·px³/s² g/px/s"
    assert units == set(words.split())


def test_defaults_are_filled_without_touching_the_schema() -> None:
    filled = with_defaults(
        {"physgen": 1, "size": [1, 1], "objects": {"a": {"mask": 1}}}
    )
    filled["objects"]["a"]["velocity"].append(3)
    filled["world"]["table"]["friction"] = 9
    again = with_defaults({"physgen": 1, "objects": {"a": {}}})
    assert again["objects"]["a"]["velocity"] == [0, 0]
    assert again["world"]["table"]["friction"] == 0


def test_the_reference_is_true() -> None:
    """Update it with: python benchmarks/scene_reference.py > docs/scene.md"""
    assert (ROOT / "docs" / "scene.md").read_text(encoding="utf-8") == markdown()


def test_the_reference_shows_every_key() -> None:
    text = markdown()
    for path in ALL:
        key = path.rpartition(".")[2]
        if path.endswith(("[]", "*", ".name")):
            continue
        assert f"| `{key}` |" in text, path


def test_the_example_of_the_reference_loads(tmp_path: Path) -> None:
    path = tmp_path / "example.yaml"
    path.write_text(EXAMPLE)
    assert load(path, variant="on-the-moon").world.gravity == (0, 162)


def test_every_message_of_a_missing_key_has_an_example(tmp_path: Path) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(
        "physgen: 1\nsize: [9, 9]\nlight: {}\nforces: [{}]\nobjects: {a: {shape: {box: {}, circle: {}}}}\n"
    )
    with pytest.raises(InputError) as caught:
        load(path)
    missing = [
        problem for problem in caught.value.problems if problem.expected == "missing"
    ]
    assert len(missing) == 6
    assert all("e.g." in problem.fix for problem in missing)


@pytest.mark.parametrize(
    ("word", "ours"),
    [
        ("restitution", "elasticity"),
        ("angular_velocity", "spin"),
        ("weight", "mass"),
        ("fixed", "motion: static"),
    ],
)
def test_words_of_other_engines_lead_to_ours(
    tmp_path: Path, word: str, ours: str
) -> None:
    path = tmp_path / "scene.yaml"
    ball = f"{{shape: {{circle: {{center: [4, 4], radius: 2}}}}, {word}: 1}}"
    path.write_text(f"physgen: 1\nsize: [9, 9]\nobjects: {{a: {ball}}}\n")
    with pytest.raises(InputError, match=f'unknown key; did you mean "{ours}"'):
        load(path)
