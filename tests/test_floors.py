"""The house of the design: a module imports downward or within its own room only."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import physgen

PACKAGE = Path(physgen.__file__).parent

FLOORS = {
    0: (
        "geometry",
        "problems",
        "backends",
        "crew",
        "roster",
        "configured",
        "photometry",
        "materials",
        "machine",
        "resources",
        "whole",
        "pictures",
        "framing",
        "showing",
        "stopping",
        "urls",
        "tables",
    ),
    1: ("percepts", "outline", "scene.model", "shadow"),
    2: ("scene",),
    3: ("perceive", "compile", "clips"),
    4: ("simulate",),
    5: ("render", "report.video", "fan"),
    6: ("refine", "export"),
    7: ("report",),
    8: ("cache", "refine_video"),
    9: ("pipeline", "refresh"),
    10: ("batch", "golden"),
    11: ("evaluate", "pytest_plugin", "notebook", "edit", "cli.evaluate"),
    12: ("flags",),
    13: ("cli",),
    14: ("__main__",),
}
HEAVY = {"torch", "transformers", "diffusers", "accelerate", "openai", "jax", "tensorflow"}
VAGUE = {"utils", "helpers", "common", "misc", "manager", "base"}


def modules() -> list[Path]:
    return sorted(p for p in PACKAGE.rglob("*.py"))


def dotted(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def floor_and_room(name: str) -> tuple[int, str]:
    """The longest row that names the module: `scene.model` lives a floor below its folder."""
    best = max(
        (
            (len(room), floor, room)
            for floor, rooms in FLOORS.items()
            for room in rooms
            if f"{name}.".startswith(f"{room}.")
        ),
        default=None,
    )
    assert best is not None, (
        f"physgen/{name.replace('.', '/')}.py stands on no floor: name it in tests/test_floors.py"
    )
    return best[1], best[2]


def imports(path: Path) -> list[tuple[int, str]]:
    """Absolute names with their lines; those under TYPE_CHECKING too, since they are arrows all the same."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: write the import out in full"
            module = node.module or ""
            for alias in node.names:
                whole = f"{module}.{alias.name}"
                is_module = module.startswith("physgen") and (
                    (PACKAGE.parent / (whole.replace(".", "/") + ".py")).exists()
                    or (PACKAGE.parent / whole.replace(".", "/") / "__init__.py").exists()
                )
                found.append((node.lineno, whole if is_module else module))
    return found


@pytest.mark.parametrize("path", modules(), ids=dotted)
def test_imports_go_down(path: Path) -> None:
    name = dotted(path)
    if not name:
        return
    floor, room = floor_and_room(name)
    for line, imported in imports(path):
        if imported == "physgen" or not imported.startswith("physgen."):
            continue
        target = imported.removeprefix("physgen.")
        other_floor, other_room = floor_and_room(target)
        own_folder = (
            other_room == room or target.split(".")[0] == name.split(".")[0] or other_floor == floor == 0
        )
        assert other_floor < floor or own_folder, (
            f"physgen/{path.relative_to(PACKAGE)}:{line}: {name} (floor {floor}) imports {target} (floor {other_floor})"
        )


@pytest.mark.parametrize("path", modules(), ids=dotted)
def test_model_libraries_stay_in_backends(path: Path) -> None:
    for line, imported in imports(path):
        if imported.split(".")[0] in HEAVY:
            assert "backends" in path.relative_to(PACKAGE).parts[:-1], f"{path}:{line} imports {imported}"


def test_one_engine_module_one_encoder_module_and_one_decoder_module() -> None:
    users: dict[str, set[str]] = {"pymunk": set(), "av": set()}
    for path in modules():
        for _, imported in imports(path):
            if imported.split(".")[0] in users:
                users[imported.split(".")[0]].add(dotted(path))
    assert users == {"pymunk": {"simulate.chipmunk"}, "av": {"report.video", "clips.film"}}


def test_only_the_command_line_prints() -> None:
    for path in modules():
        if dotted(path).startswith("cli") or dotted(path) == "scene.reference":
            continue  # reference is a page's generator, run as a module
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_print = (
                isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
            )
            assert not is_print, f"{path}:{node.lineno} prints"


def test_modules_are_named_for_what_they_are() -> None:
    for path in modules():
        assert path.stem not in VAGUE, path
