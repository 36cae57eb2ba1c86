"""Limits on the size and structure of the code; `python benchmarks/structure.py` prints where they stand."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest
import structure

from physgen.files import install

LIMITS = {"lines": 47_883, "modules": 207, "constants": 346}
"""Of physgen/. They only go down; the design asks for 48,000 lines, 240 modules and 700 constants."""
IDIOM = 60
"""Words that design and documents avoid, in physgen/, templates/, docs/ and README.md."""


@pytest.fixture(scope="module")
def packages() -> dict[str, structure.Package]:
    return structure.packages()


@pytest.mark.parametrize("what", LIMITS)
def test_the_code_does_not_grow(
    what: str, packages: dict[str, structure.Package]
) -> None:
    assert sum(getattr(package, what) for package in packages.values()) <= LIMITS[what]


def test_no_function_is_too_long_or_takes_too_many_parameters(
    packages: dict[str, structure.Package],
) -> None:
    assert [
        line for package in packages.values() for line in (*package.long, *package.wide)
    ] == []


def test_plain_words() -> None:
    assert structure.idiom() < IDIOM


def test_a_long_and_a_wide_function_are_found(tmp_path) -> None:
    folder = tmp_path / "physgen"
    folder.mkdir()
    names = ", ".join(f"p{k}" for k in range(9))
    body = "    pass\n" * structure.LONGEST
    (folder / "module.py").write_text(f"LIMIT = 3\n\n\ndef function({names}):\n{body}")
    (found,) = structure.packages(folder).values()
    counts = [
        found.modules,
        found.functions,
        found.constants,
        len(found.long),
        len(found.wide),
    ]
    assert counts == [1] * 5


def test_a_clone_is_told_to_install_its_own_extras(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """From any folder the path in the command leads to the clone, whose pyproject.toml has each extra that is named."""
    extras = tomllib.loads((structure.ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    texts = [path.read_text() for path in (structure.ROOT / "physgen").rglob("*.py")]
    named = {
        extra for text in texts for extra in re.findall(r"""install\(["'](\w+)""", text)
    }
    assert named <= set(extras)
    assert len(named) >= 3
    for folder in (structure.ROOT, tmp_path):
        monkeypatch.chdir(folder)
        *_, editable, what = shlex.split(install("edit"))
        assert editable == "-e"
        assert Path(what.removesuffix("[edit]")).resolve() == structure.ROOT
