"""The layers of the design: a package imports only from below, and no two modules import each other."""

from __future__ import annotations

import ast
import importlib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import physgen

PACKAGE = Path(physgen.__file__).parent
LAYERS = (
    "core", "geometry", "scene", "compile", "simulate", "perceive", "render", "refine", "export", "sound", "report",
    "pipeline", "batch", "evaluate", "fit", "edit", "cli",
)  # fmt: skip
"""From the bottom up; the flat modules at the root are the core, apart from the entry points."""
ENTRY_POINTS = {"physgen.__main__": "cli"}
MODEL_LIBRARIES = {
    "torch",
    "transformers",
    "diffusers",
    "accelerate",
    "openai",
    "jax",
    "tensorflow",
}
WITH_MODELS = {"backends"}
"""Folders that may import them."""
BY_NAME = {"physgen.registry"}
"""The registry of backends."""
VAGUE = {"utils", "helpers", "common", "misc", "manager", "base"}


@cache
def modules() -> dict[str, Path]:
    """Dotted name -> file."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ("physgen", *path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def tree(name: str) -> ast.Module:
    return ast.parse(modules()[name].read_text(encoding="utf-8"))


@cache
def imports(name: str) -> tuple[tuple[int, str], ...]:
    """Line and absolute name of every import, also of those inside functions and for type checkers."""
    found = []
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, (
                f"{name}:{node.lineno}: write the import out in full"
            )
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.append(
                    (node.lineno, whole if whole in modules() else node.module or "")
                )
    return tuple(found)


def layer(name: str) -> int:
    if name in ENTRY_POINTS:
        return LAYERS.index(ENTRY_POINTS[name])
    parts = name.split(".")
    is_package = len(parts) > 1 and (PACKAGE / parts[1]).is_dir()
    return LAYERS.index(parts[1] if is_package else "core")


def test_a_package_imports_only_from_below() -> None:
    upward = [
        f"{name}:{line} imports {imported}"
        for name in modules()
        for line, imported in imports(name)
        if imported in modules() and layer(imported) > layer(name)
    ]
    assert not upward


def test_no_two_modules_import_each_other() -> None:
    below = {
        name: {other for _, other in imports(name) if other in modules()} - {name}
        for name in modules()
    }
    done: dict[str, bool] = {}  # False while a module's own imports are followed
    path: list[str] = []

    def follow(name: str) -> None:
        assert done.get(name, True), (
            f"import cycle: {' -> '.join([*path[path.index(name) :], name])}"
        )
        if name in done:
            return
        done[name] = False
        path.append(name)
        for other in sorted(below[name]):
            follow(other)
        path.pop()
        done[name] = True

    for name in modules():
        follow(name)


def calls(name: str) -> Iterator[tuple[int, str]]:
    """Line and function of every call."""
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)


def test_only_backends_are_imported_by_name() -> None:
    importers = {"importlib.import_module", "import_module", "__import__"}
    found = {
        name for name in modules() for _, called in calls(name) if called in importers
    }
    assert found <= BY_NAME


def test_model_libraries_stay_in_backends() -> None:
    users = {
        name
        for name in modules()
        for _, other in imports(name)
        if other.split(".")[0] in MODEL_LIBRARIES
    }
    assert not [name for name in users if not WITH_MODELS & set(name.split("."))]


def test_one_module_uses_the_engine_one_the_encoder_and_one_the_decoder() -> None:
    users = defaultdict(set)
    for name in modules():
        for _, imported in imports(name):
            users[imported.split(".")[0]].add(name)
    assert [name.split(".")[1] for name in users["pymunk"]] == ["simulate"]
    assert len(users["av"]) == 2


def test_only_the_command_line_prints() -> None:
    lower = [name for name in modules() if layer(name) < LAYERS.index("cli")]
    assert not [
        f"{name}:{line}"
        for name in lower
        for line, called in calls(name)
        if called == "print"
    ]


def test_modules_are_named_after_their_subject() -> None:
    assert not [name for name in modules() if name.split(".")[-1] in VAGUE]


def test_lazy_packages_load_the_names_that_type_checkers_see() -> None:
    """A name in only one of both lists fails at run time or for mypy."""
    count = 0
    for name, path in modules().items():
        if path.name != "__init__.py" or "lazy_loader" not in path.read_text("utf-8"):
            continue
        package = importlib.import_module(name)
        (block,) = [node for node in tree(name).body if isinstance(node, ast.If)]
        for statement in block.body:
            assert isinstance(statement, ast.ImportFrom)
            for alias in statement.names:
                assert hasattr(package, alias.name), f"{name}: {alias.name}"
                count += 1
    assert count > 80
