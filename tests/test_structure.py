"""Density, structure and names of the code may improve and not get worse; see benchmarks/structure.py."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest
import structure

from physgen.files import install

IDIOM = 60
"""Words that design and documents avoid, in physgen/, templates/, docs/ and README.md."""
LOCAL_IMPORTS = 30
"""Imports inside functions of physgen/: of libraries that are optional or slow."""
LIMITS = structure.read_limits()
ORDINARY = '''
def mean_clearance(
    outlines: Sequence[Outline], boundary: Boundary, margin: float = MARGIN
) -> float:
    """Return the mean distance between outlines and a boundary, px."""
    distances = []
    for outline in outlines:
        nearest_points = boundary.project(outline.points)
        distance = np.linalg.norm(outline.points - nearest_points, axis=1)
        distances.append(distance.min())
    clear_distances = [distance for distance in distances if distance > margin]
    if not clear_distances:
        return 0.0
    return float(np.mean(clear_distances))
'''
"""A function as the design asks for."""
SAMPLE = '''"""A module."""

from __future__ import annotations

LIMIT_PX = 3.0
NAMES = ("a", 2)
_RATES, found = (0.5, -1), 7


class Ball:
    """A class."""

    radius: float = 2.0
    made: int = 4
    label: str = "none"

    def grow(self, by: float, *more: float, at_least: float = 0) -> float:
        """Return the new radius."""
        import math

        self.radius = math.sqrt(by) if by and by > at_least else 0.0
        sizes = [len(f"{name}{by:.1f}") for name in NAMES if name]
        for near_by, (row, _) in enumerate(more):
            assert near_by, "a text"
        return max(sizes) + (yes := 1)


def seen_made(one, other): pass


async def load(): pass
'''
COUNTS = {
    "lines": 17,
    "tokens": 146,
    "functions": 3,
    "complex_functions": 0,
    "large_functions": 0,
    "functions_of_many_locals": 0,
    "conditionals": 1,
    "comprehensions": 1,
    "imports_in_functions": 1,
    "constants": 4,  # LIMIT_PX, _RATES, radius, made
    "locals": 12,  # 4 of the module, 3 of the class, sizes, name, near_by, row, yes
    "weak_locals": 3,  # found, made, near_by
    "parameters": 4,
    "weak_parameters": 3,  # by, one, other
    "function_names": 3,
    "weak_function_names": 1,  # seen_made
    "fields": 3,
    "weak_fields": 1,  # made
    "classes": 1,
    "weak_classes": 0,
}


def measured(package: str) -> structure.Package:
    return structure.measure_package(structure.package_files()[package])


def counts_of(source: str) -> dict[str, int]:
    package = structure.Package()
    structure.measure_module(package, source, "module.py")
    return dict(package.counts)


@pytest.mark.parametrize("package", LIMITS)
def test_no_figure_of_a_package_rises(package: str) -> None:
    """If one does: write the new code more plainly, or give a reason and run `structure.py --reset`."""
    code = measured(package)
    assert structure.exceeded(code, LIMITS[package]) == []
    if package.startswith("physgen/"):  # no function is too long or too wide
        assert [*code.long, *code.wide] == []


def test_few_imports_are_inside_functions() -> None:
    """Import at the top; a package loads its modules on first use by lazy_loader."""
    count = 0
    for package in LIMITS:
        if package.startswith("physgen/"):
            count += measured(package).counts["imports_in_functions"]
    assert count <= LOCAL_IMPORTS


def test_every_package_has_limits() -> None:
    assert set(LIMITS) == set(structure.package_files())
    names = {measure.name for measure in structure.MEASURES}
    assert all(set(figures) == names for figures in LIMITS.values())


@pytest.mark.parametrize("package", ["physgen/core", "physgen/cli", "physgen/refine"])
def test_an_ordinary_function_is_no_rise(package: str) -> None:
    code = measured(package)
    limits = code.figures()
    structure.measure_module(code, ORDINARY, "module.py")
    assert structure.exceeded(code, limits) == []


def test_worse_code_is_a_rise() -> None:
    code = measured("physgen/scene")
    limits = code.figures()
    lines = "".join(f"    seen{k} = p if p else [a for a in p]\n" for k in range(16))
    body = f"    import numpy\n{lines}" + "    found = " + "p + " * 200 + "p\n"
    structure.measure_module(code, f"def made(p):\n{body}", "module.py")
    risen = {line.split()[0] for line in structure.exceeded(code, limits)}
    assert risen >= {
        "large_functions",
        "functions_of_many_locals",
        "conditional_expressions_per_1000_lines",
        "comprehensions_per_1000_lines",
        "imports_in_functions",
    }


def test_counts_of_a_small_module() -> None:
    assert counts_of(SAMPLE) == COUNTS


@pytest.mark.parametrize(
    ("code", "complexity"),
    [
        ("def f(): pass", 1),
        ("def f(a):\n if a and b or c: pass\n else: pass", 4),
        ("def f(a):\n for x in a:\n  while x: x = 1 if a else 2", 4),
        ("def f(a): return [x for x in a if x if not x]", 4),
        ("def f(a):\n try: assert a\n except ValueError: pass", 3),
        ("async def f(a):\n async for x in a:\n  def g(): return 1 if a else 2", 3),
    ],
)
def test_complexity_counts_branches_and_conditions(code: str, complexity: int) -> None:
    (function,) = ast.parse(code).body
    assert structure.complexity(function) == complexity


@pytest.mark.parametrize(
    ("name", "word_class"),
    [
        ("mask", None),
        ("visible_mask", None),
        ("found", "participle"),
        ("whole", "adjective"),
        ("speed", None),
        ("red", None),
        ("marked", "participle"),
        ("_near", "closed"),
        ("at_once", "closed"),
        ("kept_whole", "participle"),
        ("slender", "adjective"),
        ("_", None),
    ],
)
def test_a_name_needs_a_noun(name: str, word_class: str | None) -> None:
    assert structure.word_class(name) == word_class


def test_lowering_limits_never_raises_one() -> None:
    limits = {"a": {"x": 2.0, "y": 5}, "gone": {"x": 1.0}}
    today = {"a": {"x": 3.0, "y": 4}, "new": {"x": 7.0}}
    lowered = structure.lower_limits(limits, today)
    assert lowered == {"a": {"x": 2.0, "y": 4}, "new": {"x": 7.0}}


def test_a_long_and_a_wide_function_are_listed() -> None:
    names = ", ".join(f"p{k}" for k in range(structure.WIDEST + 1))
    body = "    p0 = 1\n" * (structure.LONGEST // 3)
    package = structure.Package()
    structure.measure_module(package, f"\ndef f({names}):\n{body}", "module.py")
    assert [line.split()[0] for line in package.long] == ["module.py:2"]
    assert [line.split()[0] for line in package.wide] == ["module.py:2"]
    package = structure.Package()
    names = names.replace("p0", "self")
    structure.measure_module(package, f"def f({names}): pass", "module.py")
    assert package.wide == []


@pytest.mark.parametrize("folder", ["benchmarks", "studio"])
def test_imports_of_scripts_exist(folder: str) -> None:
    """The type checker reads physgen alone; a name that was changed there breaks scripts."""
    missing = []
    for script in sorted((Path(__file__).parents[1] / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and _is_ours(node.module):
                missing += [f"{script.name}: {name}" for name in _missing_names(node)]
    assert missing == []


def _is_ours(module: str | None) -> bool:
    return module is not None and module.split(".")[0] == "physgen"


def _missing_names(statement: ast.ImportFrom) -> list[str]:
    """Return the names of an import that its module has not."""
    place = Path(__file__).parents[1].joinpath(*str(statement.module).split("."))
    module = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    known = {path.stem for path in place.glob("*")} | _names_of(module)
    return [alias.name for alias in statement.names if alias.name not in known]


@cache
def _names_of(module: Path) -> set[str]:
    """Return the names that a module defines or imports."""
    names = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.Name(id=name, ctx=ast.Store()):
                names.add(name)
            case ast.alias(name=name, asname=alias):
                names.add(alias or name)
    return names


def test_test_modules_have_names_of_their_own() -> None:
    """Pytest imports the tests of a folder without a package by their names alone."""
    tests = Path(__file__).parent
    folders = defaultdict(list)
    for module in tests.rglob("test_*.py"):
        folders[module.name].append(module.parent.relative_to(tests).as_posix())
    assert {name: found for name, found in folders.items() if len(found) > 1} == {}


def test_plain_words() -> None:
    assert structure.idiom() < IDIOM


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
