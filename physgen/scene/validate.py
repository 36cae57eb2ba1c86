"""Checks a scene document against the JSON Schema; every problem has its line and its fix."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from itertools import islice
from typing import Any

from physgen.problems import Place, Problem
from physgen.scene.document import Node
from physgen.scene.schema import Schema, advice, at, bounds, expanded, limit, measure
from physgen.text import UNITS, KeyPath, dotted, example, listed, nearest, quoted, shown

# ----------------------------------------------------------------------
# Schema of numbers, points and outlines -> a test of one Node that says only yes or no.
#
# They are most of a file; check.py asks why only where the answer is no.

Quick = Callable[[Node], bool]


def quick_number(schema: Schema) -> Quick:
    """A test for a number in its range."""
    least, greatest, open_ = bounds(schema)
    whole = schema["type"] == "integer"

    def quick(node: Node) -> bool:
        value = node.value
        kind = type(value)
        if kind is float:
            if whole and not value.is_integer():  # type: ignore[union-attr]
                return False
        elif kind is not int:
            return False
        return least <= value <= greatest and not (open_ and value == least)  # type: ignore[operator]

    return quick


def quick_list(schema: Schema) -> Quick | None:
    """A test for lists of numbers and lists of those (points, outlines), most of a file; None for others."""
    prefix: list[Schema] = schema.get("prefixItems", [])
    items: Schema | None = schema.get("items")
    shortest, longest = schema.get("minItems", 0), schema.get("maxItems", 10**9)
    if prefix and all(part.get("type") == "number" for part in prefix) and shortest == longest == len(prefix):
        tests = [quick_number(part) for part in prefix]
        if len(tests) == 2:
            first, second = tests

            def pair(node: Node) -> bool:
                value = node.value
                return type(value) is list and len(value) == 2 and first(value[0]) and second(value[1])

            return pair
        return lambda node: (
            isinstance(node.value, list)
            and len(node.value) == len(tests)
            and all(test(item) for test, item in zip(tests, node.value, strict=True))
        )
    if items is None or prefix:
        return None
    each: Quick | None
    if items.get("type") in ("number", "integer"):
        each = quick_number(items)
    elif items.get("type") == "array":
        each = quick_list(items)
    else:
        return None
    if each is None:
        return None
    every = each
    return lambda node: (
        isinstance(node.value, list)
        and shortest <= len(node.value) <= longest
        and all(map(every, node.value))
    )


# ----------------------------------------------------------------------
# Problems found one by one in a tree -> those worth telling, and which parts of the tree were seen.

MAX_PROBLEMS = 200


class TooManyError(Exception):
    """More problems than anybody reads."""


class Findings:
    """Collects problems, and remembers which mappings were checked and which are wrong somewhere inside."""

    def __init__(self) -> None:
        self.problems: dict[Problem, None] = {}
        self._told: dict[Place, set[tuple[str, ...]]] = {}
        self.known: set[Node] = set()
        self.bad: set[Node] = set()
        self.ruled: set[Node] = set()
        """Mappings and outlines whose cross-field rules were looked at."""

    def beyond(self) -> Findings:
        """A fresh one that knows what this one has seen: for another tree that shares parts with the first."""
        other = Findings()
        other.known, other.bad, other.ruled = set(self.known), set(self.bad), set(self.ruled)
        return other

    def add(self, place: Place, path: KeyPath | str, found: str, expected: str, fix: str) -> None:
        """One problem; the same one of the same place is kept once. Raises TooManyError after MAX_PROBLEMS."""
        where = path if isinstance(path, str) else dotted(path)
        said = where.rpartition(".")[2], found, expected, fix
        if said in self._told.setdefault(place, set()):
            return  # of a key with a star: one mistake, in many objects
        if len(self.problems) >= MAX_PROBLEMS:
            stop = "more problems follow"
            self.problems[Problem(place, "", "", stop, "mend these first")] = None
            raise TooManyError
        self._told[place].add(said)
        self.problems[Problem(place, where, found, expected, fix)] = None

    def value(self, node: Node, path: KeyPath, expected: str, fix: str) -> None:
        """A problem with a value; one that an overlay wrote into many objects is told once."""
        if node not in self.bad:
            self.bad.add(node)
            self.add(node.place, path, shown(node.value), expected, fix)


# ----------------------------------------------------------------------
# Tree of a scene file -> Problems wherever it breaks the JSON Schema, worded from the schema itself.
#
# The schema is compiled once into one function a part. jsonschema, the oracle in
# tests/scene/test_agreement.py,
# took 66 ms for a scene of 16 outlines and 100 ms to import; this takes 2 ms, and says what to write instead.

Check = Callable[[Node, KeyPath, Findings], None]

KEYWORDS = {
    "type", "const", "enum", "minimum", "maximum", "exclusiveMinimum", "pattern", "minLength",
    "maxLength", "properties", "required", "additionalProperties", "propertyNames", "minProperties",
    "maxProperties", "items", "prefixItems", "minItems", "maxItems", "if", "then",
}  # fmt: skip
ANNOTATIONS = {
    "$schema", "$id", "title", "description", "default", "examples", "x-unit", "x-pattern",
    "x-exclusive",
}  # fmt: skip


@cache
def checker() -> Check:
    """The compiled schema: adds what is wrong in a tree to a Report."""
    return _compile(expanded(), "")


def _compile(schema: Schema, unit: str) -> Check:
    unknown = schema.keys() - KEYWORDS - ANNOTATIONS
    if unknown:
        raise NotImplementedError(
            f"the schema uses {listed(sorted(unknown))}, which check.py does not compile"
        )
    unit = schema.get("x-unit", unit)
    if "const" in schema:
        return _enum([schema["const"]], "is not a version that this physgen reads")
    if "enum" in schema:
        return _enum(schema["enum"])
    kind = schema["type"]
    if isinstance(kind, list):
        return _either(schema, kind, unit)
    return _KINDS[kind](schema, unit)


# Scalars


def _same(a: object, b: object) -> bool:
    return a == b and isinstance(a, bool) == isinstance(b, bool)


def _enum(choices: list[Any], expected: str = "") -> Check:
    names = [example(choice) for choice in choices]
    expected = expected or f"is not one of {listed(names)}"

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        value = node.value
        if any(_same(value, choice) for choice in choices):
            return
        close = nearest(value, names) if isinstance(value, str) else None
        fix = f'did you mean "{close}"?' if close else f"write {listed(names)}"
        report.value(node, path, expected, fix)

    return check


def _boolean(schema: Schema, unit: str) -> Check:
    meant = {"yes": "true", "on": "true", "y": "true", "no": "false", "off": "false", "n": "false"}

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        if not isinstance(node.value, bool):
            word = meant.get(node.value.lower()) if isinstance(node.value, str) else None
            report.value(node, path, "is not true or false", f"write {word or 'true or false'}")

    return check


def _text(schema: Schema, unit: str) -> Check:
    pattern = _pattern(schema)
    shortest, longest = schema.get("minLength", 0), schema.get("maxLength", 10**9)
    hint = example(schema["examples"][0])

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        value = node.value
        if not isinstance(value, str):
            scalar = isinstance(value, int | float)
            fix = f'write it in quotes: "{shown(value)}"' if scalar else f"write text, e.g. {hint}"
            report.value(node, path, "is not text", fix)
        elif len(value) > longest:
            report.value(node, path, f"is {len(value)} characters long", f"write at most {longest}")
        elif len(value) < shortest:
            report.value(node, path, "is empty", f"write text, e.g. {hint}")
        elif pattern and not pattern.search(value):
            report.value(node, path, "is not a name", f"write {schema['x-pattern']}, e.g. {hint}")

    return check


def _pattern(schema: Schema) -> re.Pattern[str] | None:
    """The pattern as JSON Schema means it: $ is the very end, where Python's also stands before a newline."""
    return re.compile(re.sub(r"\$$", r"\\Z", schema["pattern"])) if "pattern" in schema else None


def _number(schema: Schema, unit: str) -> Check:
    quick = quick_number(schema)
    least, greatest, _ = bounds(schema)
    whole = schema["type"] == "integer"
    hint = f", e.g. {example(schema['examples'][0])}" if "examples" in schema else ""

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        if quick(node):
            return
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            expected = "is not a whole number" if whole else "is not a number"
            report.value(node, path, expected, f"write {measure(schema, unit, ranged=False)}{hint}")
            return
        if whole and isinstance(value, float) and not value.is_integer():
            expected = "is not a whole number"
        elif value > greatest:
            expected = f"is above {limit(greatest)}"
        else:
            expected = f"is {'not above' if value == least else 'below'} {limit(least)}"
        fix = measure(schema, unit, ranged=True)
        if value > greatest and limit(greatest) not in fix:
            fix = f"{measure(schema, unit, ranged=False)} of at most {limit(greatest)}"
        report.value(node, path, expected, f"write {fix}{hint}")

    return check


# Collections


def _list(schema: Schema, unit: str) -> Check:
    quick = quick_list(schema)
    prefix = [_compile(part, unit) for part in schema.get("prefixItems", [])]
    each = _compile(schema["items"], unit) if "items" in schema else None
    shortest, longest = schema.get("minItems", 0), schema.get("maxItems", 10**9)
    inner: Schema = schema.get("items", {}) if not prefix else schema["prefixItems"][0]
    kinds = {"number": "numbers", "integer": "whole numbers", "array": "points", "object": "mappings"}
    what = kinds.get(inner.get("type", ""), "names" if inner.get("type") == "string" else "values")
    count = f"{shortest} {what}" if shortest == longest else what
    in_unit = f" in {UNITS.get(unit, unit)}" if unit and what != "mappings" else ""
    hint = f", e.g. {example(schema['examples'][0])}" if "examples" in schema else ""

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        if quick and quick(node):
            return
        value = node.value
        if not isinstance(value, list):
            report.value(node, path, f"is not a list of {count}", f"write {count}{in_unit}{hint}")
            return
        if not shortest <= len(value) <= longest:
            bound = shortest if len(value) < shortest else longest
            much = "" if shortest == longest else "at least " if bound == shortest else "at most "
            has = f"has {len(value)} item{'' if len(value) == 1 else 's'}"
            many = what if bound != 1 else what.removesuffix("s")
            report.add(node.place, path, "", has, f"write {much}{bound} {many}{in_unit}{hint}")
            report.bad.add(node)
            return
        for index, item in enumerate(value):
            test = prefix[index] if index < len(prefix) else each
            if test:
                test(item, (*path, index), report)
                if item in report.bad:
                    report.bad.add(node)

    return check


def _mapping(schema: Schema, unit: str) -> Check:
    parts: dict[str, Schema] = schema.get("properties", {})
    checks = {key: _compile(part, "") for key, part in parts.items()}
    rest = schema.get("additionalProperties", True)
    other = _compile(rest, "") if isinstance(rest, dict) else None
    name: Schema = schema.get("propertyNames", {})
    names = _pattern(name)
    naming = f"write {name['x-pattern']}, e.g. {example(name['examples'][0])}" if names else ""
    required: list[str] = schema.get("required", [])
    fewest, most = schema.get("minProperties", 0), schema.get("maxProperties", 10**9)
    hints = {key: advice(parts[key]) for key in required}
    hint = advice(schema)

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        if node in report.known:
            return
        value = node.value
        if not isinstance(value, dict):
            report.value(node, path, "is not a mapping", hint)
            return
        spoiled = False  # whether rules.py cannot rely on it; unknown keys and odd names do no harm
        known = [key for key in value if key in checks]
        if fewest == most == 1 and len(known) != 1:
            spoiled = True
            if len(known) == len(value):
                has = f"has {listed(known, 'and')}" if known else "is empty"
                report.add(node.place, path, "", has, f"write exactly one of {listed(parts)}")
        elif len(value) > most and not checks:
            report.add(node.place, path, "", f"has {len(value):,} keys", f"write at most {most:,}")
        for key in required:
            if key not in value:
                spoiled = True
                report.add(node.place, (*path, key), "", "missing", hints[key])
        for key, child in value.items():
            test = checks.get(key, other)
            if names and not names.search(key):
                report.add(child.key_place, (*path, key), quoted(key), "is not a name", naming)
            if test:
                test(child, (*path, key), report)
                spoiled = spoiled or child in report.bad
            elif rest is False:
                _unknown(child, (*path, key), list(parts), report)
        report.known.add(node)
        if spoiled:
            report.bad.add(node)

    return check


def _unknown(child: Node, path: KeyPath, known: list[str], report: Findings) -> None:
    key = str(path[-1])
    close = nearest(key, known)
    if len(path) == 1 and key in at("objects.*")["properties"]:
        report.add(child.key_place, path, "", "unknown key", f"it belongs to an object: objects.NAME.{key}")
        report.bad.add(child)
        return
    fix = f'did you mean "{close}"?' if close else f"write {listed(islice(known, 30))}"
    report.add(child.key_place, path, "", "unknown key", fix)
    report.bad.add(child)


def _either(schema: Schema, kinds: list[str], unit: str) -> Check:
    """A part that is one scalar type or one collection: `mask: 1` or `mask: {polygon: ...}`."""
    if set(kinds) == {"object", "array"}:
        return _one_or_more(schema, unit)
    (scalar,) = (kind for kind in kinds if kind not in ("object", "array"))
    (other,) = (kind for kind in kinds if kind in ("object", "array"))
    words: list[str] = schema.get("then", {}).get("enum", [])
    collection = _compile(
        {k: v for k, v in schema.items() if k not in ("if", "then")} | {"type": other}, unit
    )
    small: Schema = {
        "type": scalar,
        **{k: schema[k] for k in ("minimum", "maximum", "examples") if k in schema},
    }
    single = _enum(words) if words else _compile(small, unit)
    python: dict[str, Any] = {"string": str, "integer": (int, float), "object": dict, "array": list}
    ways = list(words) or ["a whole number"]
    ways += [f"{{{key}: ...}}" for key in schema.get("properties", {})] or [f"{schema['minItems']} numbers"]
    fix = f"write {listed(ways)}"

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        value = node.value
        if isinstance(value, python[other]):
            collection(node, path, report)
        elif isinstance(value, str) and words and value not in words:
            close = nearest(value, [*words, *schema.get("properties", {})])
            report.value(
                node, path, "is not known here", f'did you mean "{close}"?' if close in words else fix
            )
        elif isinstance(value, python[scalar]) and not isinstance(value, bool):
            single(node, path, report)
        else:
            report.value(node, path, "does not fit here", fix)

    return check


def _one_or_more(schema: Schema, unit: str) -> Check:
    """A mapping, or a list of them: `camera: {zoom: 2}` or `camera: [{time: 0}, ...]`."""
    one, more = (_compile({**schema, "type": kind}, unit) for kind in ("object", "array"))

    def check(node: Node, path: KeyPath, report: Findings) -> None:
        (more if isinstance(node.value, list) else one)(node, path, report)

    return check


_KINDS: dict[str, Callable[[Schema, str], Check]] = {
    "object": _mapping,
    "array": _list,
    "number": _number,
    "integer": _number,
    "string": _text,
    "boolean": _boolean,
}
