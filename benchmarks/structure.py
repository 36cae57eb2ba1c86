"""Density, structure and names of the code: figures of each package, which may fall and not rise.

    python benchmarks/structure.py            # today's figures
    python benchmarks/structure.py --list     # and each function that breaks a limit
    python benchmarks/structure.py --lower    # write figures that fell to benchmarks/results/structure.json
    python benchmarks/structure.py --reset    # write all of today's figures, also those that rose

tests/test_structure.py holds the code against that file.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import math
import re
import tokenize
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TypeAlias

import yaml

ROOT = Path(__file__).resolve().parent.parent
LIMITS = ROOT / "benchmarks" / "results" / "structure.json"
WORDS = ROOT / "benchmarks" / "word_classes.yaml"
FOLDERS = ("tests", "studio", "benchmarks")
"""Measured as wholes; each folder of physgen/ is a package of its own."""

COMPLEX = 10
"""Complexity above which a function counts as complex."""
LARGE = 400
"""Tokens above which a function counts as large."""
MANY_LOCALS = 15
"""Names that a function assigns, above which it counts as one of many locals."""
LONGEST = 1400
"""Tokens that no function may exceed; the longest has 1,337. How many are LARGE is limited for each package."""
WIDEST = 8
"""Parameters that no function may exceed, `self` and `cls` apart."""

RELATIVE_TOLERANCE = 0.01
"""Part of a rate by which it may rise: a package that loses well-written lines gets denser."""
CASE_TOLERANCE = 2
"""Cases by which a rate may rise: one new function of ordinary code has a comprehension or a constant or two."""
DECIMALS = 2
"""Of rates in the file, rounded up."""

Function: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
BRANCHES = (
    ast.If,
    ast.For,
    ast.While,
    ast.AsyncFor,
    ast.ExceptHandler,
    ast.IfExp,
    ast.Assert,
    ast.comprehension,
)
TOKENS = (tokenize.NAME, tokenize.NUMBER, tokenize.OP, tokenize.STRING)
UNNAMED = ("self", "cls", "_")

IDIOM = re.compile(r"\b(told|tells|thing|things|somebody|nobody|said)\b", re.IGNORECASE)
"""Words that the documents and the code avoid."""
PROSE = (".css", ".html", ".j2", ".js", ".md", ".py")


@dataclass(frozen=True)
class Measure:
    """A figure of a package: a count of cases, or its rate."""

    name: str
    cases: str
    """Key of the count."""
    size: str = ""
    """Key of the count that the cases are divided by; none for an absolute figure."""
    scale: float = 1
    """Factor of a rate: 100 for percent."""

    def value(self, counts: Counter[str]) -> float:
        """Return the figure, rounded up."""
        if not self.size:
            return counts[self.cases]
        rate = self.scale * counts[self.cases] / max(counts[self.size], 1)
        factor = 10**DECIMALS
        return math.ceil(round(rate * factor, 6)) / factor

    def highest(self, limit: float, counts: Counter[str]) -> float:
        """Return the highest figure that passes for a limit: rates have a tolerance."""
        if not self.size:
            return limit
        per_case = self.scale / max(counts[self.size], 1)
        return limit * (1 + RELATIVE_TOLERANCE) + CASE_TOLERANCE * per_case


MEASURES = (
    Measure("tokens_per_line", "tokens", "lines"),
    Measure("complex_functions_percent", "complex_functions", "functions", 100),
    Measure("large_functions", "large_functions"),
    Measure("functions_of_many_locals", "functions_of_many_locals"),
    Measure("conditional_expressions_per_1000_lines", "conditionals", "lines", 1000),
    Measure("comprehensions_per_1000_lines", "comprehensions", "lines", 1000),
    Measure("imports_in_functions", "imports_in_functions"),
    Measure("constants_per_1000_lines", "constants", "lines", 1000),
    Measure("weak_locals_percent", "weak_locals", "locals", 100),
    Measure("weak_parameters_percent", "weak_parameters", "parameters", 100),
    Measure("weak_function_names_percent", "weak_function_names", "function_names", 100),
    Measure("weak_fields_percent", "weak_fields", "fields", 100),
    Measure("weak_classes_percent", "weak_classes", "classes", 100),
)  # fmt: skip
"""Lines are lines of code: without blank lines, comments and docstrings. A weak name has no noun in it."""


@dataclass
class Package:
    """Counts of one package, and its functions that break a limit."""

    counts: Counter[str] = field(default_factory=Counter)
    long: list[str] = field(default_factory=list)
    """`file:line name tokens` of functions of more than LONGEST tokens."""
    wide: list[str] = field(default_factory=list)
    """`file:line name parameters` of functions with more than WIDEST parameters."""

    def figures(self) -> dict[str, float]:
        """Return the value of each measure by its name."""
        return {measure.name: measure.value(self.counts) for measure in MEASURES}


# --- packages --------------------------------------------------------------------------------------------------------


def package_files(root: Path = ROOT) -> dict[str, list[Path]]:
    """Return the modules of each package: `physgen/core` for those at the root, `physgen/cli`, ..., and `tests`."""
    files: dict[str, list[Path]] = {}
    for path in sorted((root / "physgen").rglob("*.py")):
        parts = path.relative_to(root).parts
        name = parts[1] if len(parts) > 2 else "core"
        files.setdefault(f"physgen/{name}", []).append(path)
    for folder in FOLDERS:
        if (root / folder).is_dir():
            files[folder] = sorted((root / folder).rglob("*.py"))
    return files


def measure_package(paths: Sequence[Path], root: Path = ROOT) -> Package:
    """Count everything in some modules."""
    package = Package()
    for path in paths:
        source = path.read_text(encoding="utf-8")
        measure_module(package, source, str(path.relative_to(root)))
    return package


def measure_module(package: Package, source: str, name: str) -> None:
    """Add the counts of one module, whose name is for lists of functions."""
    tree = ast.parse(source)
    tokens = count_tokens(source, tree)
    counts = package.counts
    counts["lines"] += len(tokens)
    counts["tokens"] += tokens.total()
    counts["constants"] += len(constant_names(tree))
    for node in ast.walk(tree):
        if isinstance(node, FUNCTIONS):
            _add_function(package, node, tokens, name)
            _add_parameters(counts, node)
        elif isinstance(node, ast.ClassDef):
            _add_class(counts, node)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            _add_name(counts, "locals", node.id)
        elif isinstance(node, ast.IfExp):
            counts["conditionals"] += 1
        elif isinstance(node, COMPREHENSIONS):
            counts["comprehensions"] += 1
    counts["imports_in_functions"] += _count_local_imports(tree)


def _add_function(
    package: Package, node: Function, tokens: Counter[int], module: str
) -> None:
    lines = range(node.lineno, (node.end_lineno or node.lineno) + 1)
    size = sum(tokens[line] for line in lines)
    counts = package.counts
    counts["functions"] += 1
    counts["complex_functions"] += complexity(node) > COMPLEX
    counts["large_functions"] += size > LARGE
    counts["functions_of_many_locals"] += len(_assigned_names(node)) > MANY_LOCALS
    if not node.name.startswith("__"):
        _add_name(counts, "function_names", node.name)
    place = f"{module}:{node.lineno} {node.name}"
    width = len(_parameters(node)) - _has_self(node)
    if size > LONGEST:
        package.long.append(f"{place} {size} tokens")
    if width > WIDEST:
        package.wide.append(f"{place} {width} parameters")


def _add_parameters(counts: Counter[str], node: Function) -> None:
    for name in _parameters(node):
        _add_name(counts, "parameters", name)


def _add_class(counts: Counter[str], node: ast.ClassDef) -> None:
    _add_name(counts, "classes", node.name)
    for statement in node.body:
        if not isinstance(statement, ast.AnnAssign):
            continue
        if isinstance(statement.target, ast.Name):
            _add_name(counts, "fields", statement.target.id)


def _add_name(counts: Counter[str], kind: str, name: str) -> None:
    if name in UNNAMED:
        return
    counts[kind] += 1
    counts[f"weak_{kind}"] += word_class(name) is not None


# --- measures --------------------------------------------------------------------------------------------------------


def count_tokens(source: str, tree: ast.Module) -> Counter[int]:
    """Return the tokens of each line of code, without docstrings and other texts that are statements.

    A formatted string is one token, as it was for `tokenize` before Python 3.12.
    """
    texts = _text_lines(tree)
    counts: Counter[int] = Counter()
    depth = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        kind = tokenize.tok_name[token.type]
        is_start = kind in ("FSTRING_START", "TSTRING_START")
        is_counted = token.type in TOKENS or is_start
        if is_counted and depth == 0 and token.start[0] not in texts:
            counts[token.start[0]] += 1
        depth += is_start
        depth -= kind in ("FSTRING_END", "TSTRING_END")
    return counts


def _text_lines(tree: ast.Module) -> set[int]:
    lines: set[int] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
            continue
        if isinstance(node.value.value, str):
            lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def complexity(function: ast.AST) -> int:
    """Return the number of ways through a function: 1, and 1 for each branch, condition and comprehension."""
    total = 1
    for node in ast.walk(function):
        if isinstance(node, BRANCHES):
            total += 1
        if isinstance(node, ast.BoolOp):
            total += len(node.values) - 1
        if isinstance(node, ast.comprehension):
            total += len(node.ifs)
    return total


def _assigned_names(function: Function) -> set[str]:
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


def _parameters(node: Function) -> list[str]:
    arguments = node.args
    every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
    return [argument.arg for argument in every]


def _has_self(node: Function) -> bool:
    return _parameters(node)[:1] in (["self"], ["cls"])


def _count_local_imports(tree: ast.Module) -> int:
    """Return the number of import statements inside functions, each once."""
    imports = set()
    for function in ast.walk(tree):
        if not isinstance(function, FUNCTIONS):
            continue
        for node in ast.walk(function):
            if isinstance(node, ast.Import | ast.ImportFrom):
                imports.add(node)
    return len(imports)


def constant_names(tree: ast.Module) -> list[str]:
    """Return the names of tuning constants: capitals that are set to numbers, and numeric defaults of fields."""
    names = []
    for statement in tree.body:
        if _is_numeric(statement):
            names += [name for name in _targets(statement) if _is_capital(name)]
        if isinstance(statement, ast.ClassDef):
            for line in statement.body:
                if _is_numeric(line):
                    names += _targets(line)
    return names


def _is_numeric(statement: ast.stmt) -> bool:
    """Return whether a statement assigns a value of numbers without texts."""
    if not isinstance(statement, ast.Assign | ast.AnnAssign):
        return False
    if statement.value is None:
        return False
    has_number = False
    for node in ast.walk(statement.value):
        if not isinstance(node, ast.Constant):
            continue
        if isinstance(node.value, str):
            return False
        is_number = isinstance(node.value, int | float)
        if is_number and not isinstance(node.value, bool):
            has_number = True
    return has_number


def _targets(statement: ast.stmt) -> list[str]:
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign):
        targets = [statement.target]
    else:
        return []
    nodes = [node for target in targets for node in ast.walk(target)]
    return [node.id for node in nodes if isinstance(node, ast.Name)]


def _is_capital(name: str) -> bool:
    return name.lstrip("_").isupper()


# --- names -----------------------------------------------------------------------------------------------------------


@cache
def _words() -> dict[str, frozenset[str]]:
    classes = yaml.safe_load(WORDS.read_text(encoding="utf-8"))
    return {name: frozenset(words.split()) for name, words in classes.items()}


def word_class(name: str) -> str | None:
    """Return the class of a name without a noun: `closed`, `participle` or `adjective`; None for other names.

    A compound belongs to the class of its first word if none of its words is a noun.
    """
    name = name.strip("_").lower()
    if "_" not in name:
        return _class_of_word(name)
    classes = [_class_of_word(word) for word in name.split("_") if word]
    return classes[0] if all(classes) else None


def _class_of_word(word: str) -> str | None:
    words = _words()
    if word in words["closed"]:
        return "closed"
    ends_as_participle = word.endswith("ed") and len(word) > 3
    if ends_as_participle and word not in words["not_participles"]:
        return "participle"
    if word in words["participles"]:
        return "participle"
    return "adjective" if word in words["adjectives"] else None


def idiom(
    places: Sequence[str] = ("physgen", "templates", "docs", "README.md"),
    root: Path = ROOT,
) -> int:
    """Return how often the words of IDIOM stand in these files and folders."""
    return sum(
        len(IDIOM.findall(path.read_text(encoding="utf-8")))
        for path in _prose(places, root)
    )


def _prose(places: Sequence[str], root: Path) -> Iterator[Path]:
    for place in places:
        path = root / place
        yield from (
            [path]
            if path.is_file()
            else sorted(p for p in path.rglob("*") if p.suffix in PROSE and p.is_file())
        )


# --- limits ----------------------------------------------------------------------------------------------------------

Figures: TypeAlias = dict[str, dict[str, float]]
"""Of each package, by the names of measures."""


def read_limits(path: Path = LIMITS) -> Figures:
    """Return the figures that the code must not exceed."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def lower_limits(limits: Figures, today: Figures) -> Figures:
    """Return the lower of both figures; packages that are gone have none, new packages today's."""
    lowered: Figures = {}
    for package, figures in today.items():
        before = limits.get(package, {})
        lowered[package] = {
            name: min(value, before.get(name, value)) for name, value in figures.items()
        }
    return lowered


def exceeded(package: Package, limits: dict[str, float]) -> list[str]:
    """Return a sentence for each figure of a package above its limit."""
    lines = []
    for measure in MEASURES:
        value = measure.value(package.counts)
        limit = limits[measure.name]
        if value > measure.highest(limit, package.counts):
            lines.append(f"{measure.name} rose from {limit:g} to {value:g}")
    return lines


def _write_limits(figures: Figures) -> None:
    LIMITS.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def _print_table(packages: dict[str, Package]) -> None:
    print("| package | " + " | ".join(measure.name for measure in MEASURES) + " |")
    print("|---" * (len(MEASURES) + 1) + "|")
    for name, package in packages.items():
        values = [f"{value:g}" for value in package.figures().values()]
        print(f"| {name} | {' | '.join(values)} |")


def main() -> None:
    """Print the table, and write the limits if asked to."""
    parser = argparse.ArgumentParser(description="Density, structure and names.")
    parser.add_argument(
        "--list", action="store_true", help="name each function that breaks a limit"
    )
    writing = parser.add_mutually_exclusive_group()
    writing.add_argument(
        "--lower", action="store_true", help="write the figures that fell"
    )
    writing.add_argument(
        "--reset", action="store_true", help="write all figures, also those that rose"
    )
    options = parser.parse_args()
    packages = {name: measure_package(files) for name, files in package_files().items()}
    _print_table(packages)
    words = "words of the private idiom in physgen/, templates/, docs/ and README.md"
    print(f"\n{words}: {idiom()}")
    if options.list:
        for package in packages.values():
            print(*package.long, *package.wide, sep="\n")
    today = {name: package.figures() for name, package in packages.items()}
    if options.reset:
        _write_limits(today)
    if options.lower:
        _write_limits(lower_limits(read_limits(), today))


if __name__ == "__main__":
    main()
