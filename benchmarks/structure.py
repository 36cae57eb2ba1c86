"""Size and structure of the code: a table of packages, long functions, wide signatures, constants, private idiom.

    python benchmarks/structure.py            # the table
    python benchmarks/structure.py --list     # and each function that breaks a limit

tests/test_structure.py holds the limits.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LONGEST = 100
"""Lines of a function, at most."""
WIDEST = 8
"""Parameters of a function, `self` and `cls` apart, at most."""
IDIOM = re.compile(r"\b(told|tells|thing|things|somebody|nobody|said)\b", re.IGNORECASE)
"""Words that the documents and the code avoid."""
PROSE = (".css", ".html", ".j2", ".js", ".md", ".py")


@dataclass
class Package:
    """What one package of physgen/ holds."""

    lines: int = 0
    modules: int = 0
    functions: int = 0
    constants: int = 0
    """Names of numeric constants at the top of modules."""
    long: list[str] = field(default_factory=list)
    """`file:line name lines` of functions of more than LONGEST lines."""
    wide: list[str] = field(default_factory=list)
    """`file:line name parameters` of functions with more than WIDEST parameters."""


def packages(folder: Path = ROOT / "physgen") -> dict[str, Package]:
    """Package name -> its figures; modules at the root are `core`."""
    found: dict[str, Package] = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).parts
        package = found.setdefault(parts[0] if len(parts) > 1 else "core", Package())
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        package.modules += 1
        package.lines += text.count("\n")
        package.constants += sum(len(_constants(statement)) for statement in tree.body)
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            package.functions += 1
            where = f"{path.relative_to(folder.parent)}:{node.lineno} {node.name}"
            lines, parameters = (
                (node.end_lineno or node.lineno) - node.lineno + 1,
                _parameters(node),
            )
            if lines > LONGEST:
                package.long.append(f"{where} {lines} lines")
            if parameters > WIDEST:
                package.wide.append(f"{where} {parameters} parameters")
    return found


def idiom(
    places: Sequence[str] = ("physgen", "templates", "docs", "README.md"),
    root: Path = ROOT,
) -> int:
    """How often the words of IDIOM stand in these files and folders."""
    return sum(
        len(IDIOM.findall(path.read_text(encoding="utf-8")))
        for path in _prose(places, root)
    )


def lines_of(folder: str, root: Path = ROOT) -> int:
    """Lines of Python below a folder."""
    return sum(
        path.read_text(encoding="utf-8").count("\n")
        for path in (root / folder).rglob("*.py")
    )


def _prose(places: Sequence[str], root: Path) -> Iterator[Path]:
    for place in places:
        path = root / place
        yield from (
            [path]
            if path.is_file()
            else sorted(p for p in path.rglob("*") if p.suffix in PROSE and p.is_file())
        )


def _parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    names = [
        one.arg
        for one in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
    ]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def _constants(statement: ast.stmt) -> list[str]:
    """Names in capitals that a statement at the top of a module sets to numbers."""
    if isinstance(statement, ast.Assign):
        targets, value = statement.targets, statement.value
    elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
        targets, value = [statement.target], statement.value
    else:
        return []
    names = [
        node.id
        for target in targets
        for node in ast.walk(target)
        if isinstance(node, ast.Name)
    ]
    held = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
    numbers = [
        one
        for one in held
        if isinstance(one, int | float) and not isinstance(one, bool)
    ]
    if not numbers or any(isinstance(one, str) for one in held):
        return []
    return names if all(name.lstrip("_").isupper() for name in names) else []


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Size and structure of the code.")
    parser.add_argument(
        "--list", action="store_true", help="name each function that breaks a limit"
    )
    listed = parser.parse_args().list
    found = packages()
    print(
        "| package | lines | modules | functions | constants | long | wide |\n|---|---|---|---|---|---|---|"
    )
    for name, one in sorted(found.items(), key=lambda item: -item[1].lines):
        print(
            f"| {name} | {one.lines} | {one.modules} | {one.functions} | {one.constants} "
            f"| {len(one.long)} | {len(one.wide)} |"
        )
    every = found.values()
    print(
        f"| all | {sum(p.lines for p in every)} | {sum(p.modules for p in every)} "
        f"| {sum(p.functions for p in every)} | {sum(p.constants for p in every)} "
        f"| {sum(len(p.long) for p in every)} | {sum(len(p.wide) for p in every)} |"
    )
    print(
        f"\ntests: {lines_of('tests')} lines, studio: {lines_of('studio')}, benchmarks: {lines_of('benchmarks')}"
    )
    print(
        f"words of the private idiom in physgen/, templates/, docs/ and README.md: {idiom()}"
    )
    if listed:
        print(*(line for one in every for line in (*one.long, *one.wide)), sep="\n")


if __name__ == "__main__":
    main()
